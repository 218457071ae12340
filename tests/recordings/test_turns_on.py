"""A crank that stands still, turns back or jumps: its run is left out with the time and the way out, the others are
read."""

import re

import numpy as np
import pytest

from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.rig.read_files import read_measurements
from jointgap.rig.recording import from_frame, to_frame
from tests.recordings.rig import read_rig, table, write_rig

SPEED = 200 * np.pi / 30
ANGLE_DRIVES = {"drive": "measured_angle"}


def turning(course, noise_deg=0.1, turns=6.0, count=960, seed=0):
    """The slow run with a crank whose angle [turns] is `course` of how far it would have turned [turns]."""
    frame = table(200, turns=turns, count=count, first=0.0)
    noise = noise_deg * np.random.default_rng(seed).standard_normal(count)
    frame["theta"] = (360.0 * course(frame.t.to_numpy() * SPEED / (2 * np.pi)) + noise) % 360.0
    return frame


def with_roles():
    runs = [
        {"id": "slow", "file": "slow.csv", "speed": "200 rpm", "role": "confirm"},
        {"id": "fast", "file": "fast.csv", "speed": "600 rpm", "role": "identify"},
    ]
    return {"runs": runs}


def run_up(turned):
    """At rest for one turn's time, then faster for one, then steadily."""
    return np.where(turned < 1, 0.0, np.where(turned < 2, 0.5 * (turned - 1) ** 2, turned - 1.5))


def run_down(turned):
    return np.where(turned < 3, turned, np.where(turned < 4, 3 + 0.5 - 0.5 * (4 - turned) ** 2, 3.5))


def rest_between(turned):
    return np.clip(turned, None, 2.5) + np.clip(turned - 3.5, 0.0, None)


def turn_back(turned):
    return turned - np.clip(turned - 2.5, 0.0, 0.5) * 2.0


@pytest.mark.parametrize(
    ("course", "words", "until"),
    [
        (run_up, r"stands still until (\S+) s; cut the record there \(keep what comes after", 0.3 + 0.06),
        (run_down, r"stands still from (\S+) s on; cut the record there \(keep what comes before", 1.2 - 0.06),
        (rest_between, r"stands still from (\S+) s to 1.0\d* s; .*\(make two runs of it", 0.75),
        (turn_back, r"turns back from (\S+) s to 0.9\d* s; ", 0.74),
    ],
)
def test_a_crank_that_does_not_turn_on_is_told_with_the_time_and_its_run_left_out(tmp_path, course, words, until):
    read = read_rig(tmp_path, with_roles() | ANGLE_DRIVES, slow=turning(course))
    assert list(read.runs) == ["fast"]
    (told,) = [remark for remark in read.remarks if remark.startswith("run slow is left out: ")]
    assert read.left_out == {"slow": told.removeprefix("run slow is left out: ")}
    found = re.search(words, told)
    assert found and float(found[1]) == pytest.approx(until, abs=0.05), told
    assert "slow.csv, column theta, row" in told


def test_what_else_is_odd_in_a_run_that_is_left_out_is_no_doubt_of_a_channel(tmp_path):
    frame = turning(run_up)
    frame.loc[300:400:4, "M"] = -999.0
    read = read_rig(tmp_path, with_roles() | ANGLE_DRIVES, slow=frame)
    assert [(found.channel, found.kind) for found in read.contradictions] == [("crank_angle", "standstill")]
    assert any("crank_torque is far from all else" in remark for remark in read.remarks)
    kept = turning(lambda turned: turned).assign(M=frame.M)
    read = read_rig(tmp_path, with_roles() | ANGLE_DRIVES, slow=kept)
    assert [(found.channel, found.kind) for found in read.contradictions] == [("crank_torque", "no_data")]


@pytest.mark.parametrize("drive", ["measured_angle", "constant_speed"])
@pytest.mark.parametrize("step", [-40.0, 25.0, 138.24])
def test_a_step_that_stays_is_told_as_a_step_whatever_drives(tmp_path, drive, step):
    """Lost pulses; a counter that overflows at a number of counts that is no whole number of turns."""
    frame = turning(lambda turned: turned)
    frame.loc[500:, "theta"] = (frame.theta[500:] + step) % 360.0
    read = read_rig(tmp_path, with_roles() | {"drive": drive}, slow=frame)
    (told,) = read.left_out.values()
    size = float(re.search("the angle steps by (\\S+) deg", told)[1])
    assert size == pytest.approx(step, abs=1.0)
    assert "row 502" in told and "lost or counted twice" in told
    assert not any("far off its neighbours" in remark for remark in read.remarks)


def test_a_single_angle_that_the_encoder_misread_is_no_step(tmp_path):
    frame = turning(lambda turned: turned)
    frame.loc[500:501, "theta"] += 40.0
    read = read_rig(tmp_path, with_roles(), slow=frame)
    assert read.left_out == {}
    assert any("far off its neighbours" in remark for remark in read.remarks)


@pytest.mark.parametrize("unsteadiness", [0.3, 0.6, 0.9, 0.95])
@pytest.mark.parametrize("count", [180, 960])
def test_a_crank_that_slows_down_in_every_turn_without_stopping_is_read(tmp_path, unsteadiness, count):
    fine = np.linspace(0.0, 10.0, 100_001)
    time = np.cumsum(1.0 / (1.0 + unsteadiness * np.cos(2 * np.pi * fine)))
    time *= 10.0 / time[-1]
    read = read_rig(
        tmp_path, with_roles() | ANGLE_DRIVES, slow=turning(lambda turned: np.interp(turned, time, fine), count=count)
    )
    assert read.left_out == {}


def test_without_a_run_for_fitting_one_error_says_why_of_each(tmp_path):
    with pytest.raises(InputError, match=r"(?s)rig-a: no run for fitting can be used.*slow.csv.*stands still until"):
        read_rig(tmp_path, ANGLE_DRIVES, slow=turning(run_up))


def test_a_motor_may_start_its_crank_from_rest(tmp_path):
    motor = {"drive": "motor", "motor": {"stall_torque": "5 N*m", "no_load_speed": "300 rpm", "inertia": "0.01 kg*m^2"}}
    assert read_rig(tmp_path, with_roles() | motor, slow=turning(run_up)).left_out == {}


def test_a_run_that_is_left_out_survives_the_tidy_table(tmp_path):
    path = write_rig(tmp_path, with_roles() | ANGLE_DRIVES, slow=turning(run_up))
    own = load_campaign(path)
    read = read_measurements(own)
    again = from_frame(to_frame(read), own, read.remarks, read.contradictions)
    assert (list(again.runs), again.left_out) == (list(read.runs), read.left_out)
