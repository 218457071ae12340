"""A crank that stands still, turns back or jumps: its run is left out with the time and the way
out, the others are read."""

import re

import numpy as np
import pytest

from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.rig.recording import from_frame, to_frame
from tests.catalogue import each
from tests.rig.recorded_files import CAMPAIGN, read_rig, table

SPEED = 200 * np.pi / 30
ANGLE_DRIVES = {"drive": "measured_angle"}
ROLES = [
    run | {"role": role}
    for run, role in zip(CAMPAIGN["runs"], ("confirm", "identify"), strict=True)
]


def turning(course, noise_deg=0.1, turns=6.0, count=960, seed=0):
    """The slow run with a crank whose angle [turns] is `course` of how far it would have turned
    [turns]."""
    frame = table(200, turns=turns, count=count, first=0.0)
    noise = noise_deg * np.random.default_rng(seed).standard_normal(count)
    frame["theta"] = (360.0 * course(frame.t.to_numpy() * SPEED / (2 * np.pi)) + noise) % 360.0
    return frame


@pytest.fixture
def read(tmp_path):
    """Measurements where the slow run confirms and the other one identifies."""
    return lambda slow, over=ANGLE_DRIVES: read_rig(tmp_path, {"runs": ROLES} | over, slow=slow)


def run_up(turned):
    """At rest for one turn's time, then faster for one, then steadily."""
    return np.where(turned < 1, 0.0, np.where(turned < 2, 0.5 * (turned - 1) ** 2, turned - 1.5))


def run_down(turned):
    return np.where(
        turned < 3, turned, np.where(turned < 4, 3 + 0.5 - 0.5 * (4 - turned) ** 2, 3.5)
    )


def rest_between(turned):
    return np.clip(turned, None, 2.5) + np.clip(turned - 3.5, 0.0, None)


def turn_back(turned):
    return turned - np.clip(turned - 2.5, 0.0, 0.5) * 2.0


def test_a_crank_that_does_not_turn_on_is_reported_with_the_time_and_its_run_left_out(
    read, tmp_path
):
    def left_out(course, words, until):
        found = read(turning(course))
        assert list(found.runs) == ["fast"]
        (told,) = found.left_out.values()
        assert (
            f"run slow is not used: {told}" in found.remarks
            and "slow.csv, column theta, row" in told
        )
        time = re.search(words, told)
        assert time and float(time[1]) == pytest.approx(until, abs=0.05), told
        own = load_campaign(tmp_path / "rig.yaml")
        again = from_frame(to_frame(found), own, found.remarks, found.contradictions)
        assert (list(again.runs), again.left_out) == (list(found.runs), found.left_out)

    cases = [
        (
            run_up,
            r"stands still until (\S+) s; cut the record there \(keep the later part",
            0.3 + 0.06,
        ),
        (
            run_down,
            r"stands still from (\S+) s on; cut the record there \(keep the earlier part",
            1.2 - 0.06,
        ),
        (rest_between, r"stands still from (\S+) s to 1.0\d* s; .*\(make two runs of it", 0.75),
        (turn_back, r"reverses from (\S+) s to 0.9\d* s; ", 0.74),
    ]
    each(left_out, cases)
    with pytest.raises(
        InputError, match=r"(?s)rig-a: no run for fitting is usable.*slow.csv.*stands still until"
    ):
        read(turning(run_up), {"runs": CAMPAIGN["runs"]} | ANGLE_DRIVES)
    motor = {
        "drive": "motor",
        "motor": {"stall_torque": "5 N*m", "no_load_speed": "300 rpm", "inertia": "0.01 kg*m^2"},
    }
    assert read(turning(run_up), motor).left_out == {}  # which may start from rest


def test_a_step_that_stays_is_reported_as_a_step_and_a_single_misread_angle_is_none(read):
    """Lost pulses; a counter that overflows at a number of counts that is no whole number of
    turns."""

    def told_as_step(drive, step):
        frame = turning(lambda turned: turned)
        frame.loc[500:, "theta"] = (frame.theta[500:] + step) % 360.0
        found = read(frame, {"drive": drive})
        (told,) = found.left_out.values()
        assert float(re.search("step of (\\S+) deg", told)[1]) == pytest.approx(step, abs=1.0)
        assert "row 502" in told and "double-counted" in told
        assert not any("far from its neighbours" in remark for remark in found.remarks)

    steps = [
        ("measured_angle", -40.0),
        ("constant_speed", 25.0),
        ("measured_angle", 138.24),
        ("constant_speed", 6.0),
    ]
    each(told_as_step, steps)
    frame = turning(lambda turned: turned)
    frame.loc[500:501, "theta"] += 40.0
    found = read(frame, {})
    assert found.left_out == {} and any(
        "far from its neighbours" in remark for remark in found.remarks
    )


def test_a_crank_that_slows_down_in_every_turn_without_stopping_is_read(read):
    fine = np.linspace(0.0, 10.0, 100_001)

    def is_read(unsteadiness, count):
        time = np.cumsum(1.0 / (1.0 + unsteadiness * np.cos(2 * np.pi * fine)))
        time *= 10.0 / time[-1]
        assert (
            read(turning(lambda turned: np.interp(turned, time, fine), count=count)).left_out == {}
        )

    each(is_read, [(share, count) for share in (0.3, 0.95) for count in (180, 960)])


def test_stamps_that_are_late_in_a_pattern_are_told_and_moved_where_the_angle_is_even(read):
    """At 60 to 120 samples a turn; where the angle is late too, the samples were."""

    def told(count, every, share, drive, course=lambda turned: turned):
        frame = turning(course, noise_deg=0.05, count=6 * count)
        even, step = frame.t.to_numpy(copy=True), frame.t[1]
        frame.loc[5::every, "t"] += share * step
        found = read(frame, {"drive": drive})
        how = (
            f"row 7: every {every}th time is {'late' if share > 0 else 'early'} by {abs(share)} of"
            " the sampling period"
        )
        assert any(how in remark and "its crank angle is not" in remark for remark in found.remarks)
        assert (
            found.runs["slow"].time == pytest.approx(even, abs=1e-9) and found.contradictions == ()
        )

    cases = [
        (60, 12, 0.5, "constant_speed"),
        (120, 12, 0.5, "measured_angle"),
        (60, 7, -0.3, "measured_angle"),
    ]
    each(
        told,
        [
            *cases,
            (
                60,
                12,
                0.5,
                "measured_angle",
                lambda turned: turned + 0.01 * np.sin(2 * np.pi * turned),
            ),
        ],
    )
    late = turning(lambda turned: turned, noise_deg=0.05, count=360)
    late.loc[5::12, ["t", "theta"]] += [0.5 * late.t[1], 3.0]
    for sound in (late, turning(lambda turned: turned, count=360)):
        assert not any(
            " time is " in remark for remark in read(sound.assign(theta=sound.theta % 360)).remarks
        )


def test_a_clock_that_was_set_is_told_with_its_row_and_how_much_and_a_pause_is_none(read):
    def told(drive, jump, unsteady):
        frame = turning(lambda turned: turned + unsteady * np.sin(2 * np.pi * turned), count=540)
        frame.loc[300:, "t"] += jump
        with pytest.raises(InputError) as error:
            read(frame, {"drive": drive})
        text = str(error.value)
        assert (
            "column t, row 302: " in text and f"set {'forward' if jump > 0 else 'back'} by " in text
        )
        size = float(re.search(r" by (\S+) s; ", text)[1])
        assert size == pytest.approx(abs(jump), abs=2e-3)

    jumps = [3600.0, 0.4, 0.05, -0.02, -0.4, -3600.0]
    each(
        told,
        [("constant_speed", jump, 0.0) for jump in jumps]
        + [("measured_angle", jump, 0.01) for jump in jumps],
    )
    for pause in (1, 8, 100, 250):
        for unsteady in (0.0, 0.01, 0.05):
            frame = turning(
                lambda turned, share=unsteady: turned + share * np.sin(2 * np.pi * turned),
                count=540,
            )
            assert read(frame.drop(index=range(200, 200 + pause))).left_out == {}


def test_an_encoder_that_reads_one_angle_over_a_part_of_each_turn_is_told_and_a_slow_or_coarse_one_is_not(
    read,
):
    def told(drive, width, count, level):
        frame = turning(lambda turned: turned, count=count)
        dead = frame.theta.between(200.0, 200.0 + width)
        first, text = (
            int(np.flatnonzero(dead)[0]) + 2,
            f"({np.count_nonzero(dead)} samples); leave these cells empty",
        )
        with pytest.raises(InputError) as error:
            read(frame.assign(theta=frame.theta.mask(dead, level)), {"drive": drive})
        assert f"column theta, row {first}: the angle is {level} deg" in str(
            error.value
        ) and text in str(error.value)
        frame.loc[dead, "theta"] = np.nan
        assert read(frame, {"drive": drive}).left_out == {}

    each(
        told,
        [
            ("constant_speed", 20, 540, 0),
            ("measured_angle", 40, 540, 0),
            ("constant_speed", 70, 360, 180),
        ],
    )
    fine = np.linspace(0.0, 10.0, 100_001)
    for unsteadiness, step in ((0.0, 10.0), (0.9, 1.0), (0.9, 5.0)):
        time = np.cumsum(1.0 / (1.0 + unsteadiness * np.cos(2 * np.pi * fine)))
        course = lambda turned, time=10.0 * time / time[-1]: np.interp(turned, time, fine)  # noqa: E731
        frame = turning(course, noise_deg=0.0, count=1440)
        assert read(frame.assign(theta=step * np.floor(frame.theta / step))).left_out == {}


def test_a_torque_of_a_motor_that_is_off_is_compared_with_zero_once_its_noise_is_stated(read):
    def slowing(over):
        frame = turning(lambda turned: turned - 0.02 * turned**2, noise_deg=0.01)
        ideal = table(200, turns=1.0, first=0.0)
        off = frame.assign(M=0.0, x=np.interp(frame.theta, ideal.theta, ideal.x, period=360.0))
        return read(off, {"channels": {"crank_torque": {"noise": 0.01}}} | over)

    found = slowing(ANGLE_DRIVES)
    assert found.contradictions == () and not found.runs["slow"].channels["crank_torque"].any()
    needed = {
        "'drive: measured_angle'": {},
        "noise": ANGLE_DRIVES | {"channels": {"crank_torque": {"noise": None}}},
    }
    for key, over in needed.items():
        with pytest.raises(
            InputError, match=rf"column M: all values are 0.*motor is off, give [^:]*{key}"
        ):
            slowing(over)
