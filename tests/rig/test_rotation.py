"""A crank that stands still, turns back or jumps: its run is left out with the time and the way
out, the others are read."""

import re

import numpy as np
import pytest

from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.rig.recording import from_frame, to_frame
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


@pytest.mark.parametrize(
    "course, words, time",
    [
        (run_up, r"stands still until (\S+) s; .*\(keep the later part", 0.36),
        (run_down, r"stands still from (\S+) s on; .*\(keep the earlier part", 1.14),
        (rest_between, r"stands still from (\S+) s to 1.0\d* s; .*\(make two runs of it", 0.75),
        (turn_back, r"reverses from (\S+) s to 0.9\d* s; ", 0.74),
    ],
)
def test_a_run_whose_crank_stops_or_reverses_is_left_out_with_the_time(
    read, tmp_path, course, words, time
):
    measurements = read(turning(course))
    assert list(measurements.runs) == ["fast"]
    (reason,) = measurements.left_out.values()
    assert f"run slow is not used: {reason}" in measurements.remarks
    assert "slow.csv, column theta, row" in reason
    assert float(re.search(words, reason)[1]) == pytest.approx(time, abs=0.05)
    campaign = load_campaign(tmp_path / "rig.yaml")
    back = from_frame(
        to_frame(measurements), campaign, measurements.remarks, measurements.contradictions
    )
    assert back.left_out == measurements.left_out


def test_a_motor_may_start_from_rest_and_one_run_must_be_usable(read):
    motor = {"stall_torque": "5 N*m", "no_load_speed": "300 rpm", "inertia": "0.01 kg*m^2"}
    assert read(turning(run_up), {"drive": "motor", "motor": motor}).left_out == {}
    with pytest.raises(InputError, match=r"(?s)no run for fitting is usable.*stands still until"):
        read(turning(run_up), {"runs": CAMPAIGN["runs"]} | ANGLE_DRIVES)


@pytest.mark.parametrize(
    "drive, step", [("measured_angle", -40.0), ("constant_speed", 25.0), ("constant_speed", 6.0)]
)
def test_a_permanent_step_of_the_angle_is_reported_with_its_size(read, drive, step):
    frame = turning(lambda turned: turned)
    frame.loc[500:, "theta"] = (frame.theta[500:] + step) % 360.0
    (reason,) = read(frame, {"drive": drive}).left_out.values()
    assert float(re.search("step of (\\S+) deg", reason)[1]) == pytest.approx(step, abs=1.0)
    assert "row 502" in reason


def test_a_single_misread_angle_is_no_step(read):
    frame = turning(lambda turned: turned)
    frame.loc[500:501, "theta"] += 40.0
    measurements = read(frame, {})
    assert measurements.left_out == {}
    assert any("far from its neighbours" in remark for remark in measurements.remarks)


def uneven(unsteadiness, turns=10.0):
    """Course of a crank that slows down in every turn without stopping."""
    fine = np.linspace(0.0, turns, 100_001)
    time = np.cumsum(1.0 / (1.0 + unsteadiness * np.cos(2 * np.pi * fine)))
    return lambda turned: np.interp(turned, turns * time / time[-1], fine)


@pytest.mark.parametrize("count", [180, 960])
def test_a_crank_that_slows_down_in_every_turn_without_stopping_is_read(read, count):
    assert read(turning(uneven(0.95), count=count)).left_out == {}


def swinging(share, count=540):
    return turning(lambda turned: turned + share * np.sin(2 * np.pi * turned), count=count)


@pytest.mark.parametrize("drive, share", [("constant_speed", 0.0), ("measured_angle", 0.01)])
@pytest.mark.parametrize("jump", [3600.0, 0.05, -0.4])
def test_a_clock_that_was_set_is_reported_with_its_row_and_size(read, drive, share, jump):
    frame = swinging(share)
    frame.loc[300:, "t"] += jump
    way = "forward" if jump > 0 else "back"
    with pytest.raises(InputError, match=rf"row 302: .*set {way} by (\S+) s; ") as error:
        read(frame, {"drive": drive})
    size = float(re.search(r" by (\S+) s; ", str(error.value))[1])
    assert size == pytest.approx(abs(jump), abs=2e-3)


@pytest.mark.parametrize("pause, share", [(1, 0.05), (100, 0.0), (250, 0.01)])
def test_a_pause_of_the_record_is_no_set_clock(read, pause, share):
    assert read(swinging(share).drop(index=range(200, 200 + pause))).left_out == {}


@pytest.mark.parametrize(
    "drive, width, count, level", [("constant_speed", 20, 540, 0), ("measured_angle", 70, 360, 180)]
)
def test_a_dead_zone_of_the_encoder_is_refused_with_its_row(read, drive, width, count, level):
    frame = turning(lambda turned: turned, count=count)
    dead = frame.theta.between(200.0, 200.0 + width)
    row = int(np.flatnonzero(dead)[0]) + 2
    with pytest.raises(InputError, match=f"theta, row {row}: the angle is {level} deg over"):
        read(frame.assign(theta=frame.theta.mask(dead, level)), {"drive": drive})
    frame.loc[dead, "theta"] = np.nan
    assert read(frame, {"drive": drive}).left_out == {}


@pytest.mark.parametrize("unsteadiness, step", [(0.0, 10.0), (0.9, 5.0)])
def test_a_slow_or_coarse_encoder_has_no_dead_zone(read, unsteadiness, step):
    frame = turning(uneven(unsteadiness), noise_deg=0.0, count=1440)
    assert read(frame.assign(theta=step * np.floor(frame.theta / step))).left_out == {}


def test_the_torque_of_a_motor_that_is_off_is_compared_with_zero(read):
    def slowing(over):
        frame = turning(lambda turned: turned - 0.02 * turned**2, noise_deg=0.01)
        ideal = table(200, turns=1.0, first=0.0)
        off = frame.assign(M=0.0, x=np.interp(frame.theta, ideal.theta, ideal.x, period=360.0))
        return read(off, {"channels": {"crank_torque": {"noise": 0.01}}} | over)

    result = slowing(ANGLE_DRIVES)
    assert result.contradictions == () and not result.runs["slow"].channels["crank_torque"].any()
    needed = {
        "'drive: measured_angle'": {},
        "noise": ANGLE_DRIVES | {"channels": {"crank_torque": {"noise": None}}},
    }
    for key, over in needed.items():
        with pytest.raises(
            InputError, match=rf"column M: all values are 0.*motor is off, give [^:]*{key}"
        ):
            slowing(over)


@pytest.mark.parametrize(
    "count, every, share, drive",
    [
        (60, 12, 0.5, "constant_speed"),
        (120, 12, 0.5, "measured_angle"),
        (60, 7, -0.3, "measured_angle"),
    ],
)
def test_late_times_of_even_angles_are_corrected_with_a_remark(read, count, every, share, drive):
    frame = turning(lambda turned: turned, noise_deg=0.05, count=6 * count)
    even, step = frame.t.to_numpy(copy=True), frame.t[1]
    frame.loc[5::every, "t"] += share * step
    measurements = read(frame, {"drive": drive})
    remark = f"every {every}th time is {'late' if share > 0 else 'early'} by {abs(share)} of the"
    assert any(remark in text for text in measurements.remarks)
    assert measurements.runs["slow"].time == pytest.approx(even, abs=1e-9)
    assert measurements.contradictions == ()


def test_late_samples_and_even_times_are_not_corrected(read):
    late = turning(lambda turned: turned, noise_deg=0.05, count=360)
    late.loc[5::12, ["t", "theta"]] += [0.5 * late.t[1], 3.0]
    for frame in (late, turning(lambda turned: turned, count=360)):
        remarks = read(frame.assign(theta=frame.theta % 360)).remarks
        assert not any(" time is " in remark for remark in remarks)
