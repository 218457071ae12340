"""A crank that stands still, turns back or jumps: its run is left out with the time and the way out, the others are
read."""

import re

import numpy as np
import pytest

from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.rig.recording import from_frame, to_frame
from tests.catalogue import each
from tests.recordings.rig import CAMPAIGN, read_rig, table

SPEED = 200 * np.pi / 30
ANGLE_DRIVES = {"drive": "measured_angle"}
ROLES = [run | {"role": role} for run, role in zip(CAMPAIGN["runs"], ("confirm", "identify"), strict=True)]


def turning(course, noise_deg=0.1, turns=6.0, count=960, seed=0):
    """The slow run with a crank whose angle [turns] is `course` of how far it would have turned [turns]."""
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
    return np.where(turned < 3, turned, np.where(turned < 4, 3 + 0.5 - 0.5 * (4 - turned) ** 2, 3.5))


def rest_between(turned):
    return np.clip(turned, None, 2.5) + np.clip(turned - 3.5, 0.0, None)


def turn_back(turned):
    return turned - np.clip(turned - 2.5, 0.0, 0.5) * 2.0


def test_a_crank_that_does_not_turn_on_is_reported_with_the_time_and_its_run_left_out(read, tmp_path):
    def left_out(course, words, until):
        found = read(turning(course))
        assert list(found.runs) == ["fast"]
        (told,) = found.left_out.values()
        assert f"run slow is not used: {told}" in found.remarks and "slow.csv, column theta, row" in told
        time = re.search(words, told)
        assert time and float(time[1]) == pytest.approx(until, abs=0.05), told
        own = load_campaign(tmp_path / "rig.yaml")
        again = from_frame(to_frame(found), own, found.remarks, found.contradictions)
        assert (list(again.runs), again.left_out) == (list(found.runs), found.left_out)

    cases = [
        (run_up, r"stands still until (\S+) s; cut the record there \(keep the later part", 0.3 + 0.06),
        (run_down, r"stands still from (\S+) s on; cut the record there \(keep the earlier part", 1.2 - 0.06),
        (rest_between, r"stands still from (\S+) s to 1.0\d* s; .*\(make two runs of it", 0.75),
        (turn_back, r"reverses from (\S+) s to 0.9\d* s; ", 0.74),
    ]
    each(left_out, cases)
    with pytest.raises(InputError, match=r"(?s)rig-a: no run for fitting is usable.*slow.csv.*stands still until"):
        read(turning(run_up), {"runs": CAMPAIGN["runs"]} | ANGLE_DRIVES)
    motor = {"drive": "motor", "motor": {"stall_torque": "5 N*m", "no_load_speed": "300 rpm", "inertia": "0.01 kg*m^2"}}
    assert read(turning(run_up), motor).left_out == {}  # which may start from rest


def test_a_step_that_stays_is_reported_as_a_step_and_a_single_misread_angle_is_none(read):
    """Lost pulses; a counter that overflows at a number of counts that is no whole number of turns."""

    def told_as_step(drive, step):
        frame = turning(lambda turned: turned)
        frame.loc[500:, "theta"] = (frame.theta[500:] + step) % 360.0
        found = read(frame, {"drive": drive})
        (told,) = found.left_out.values()
        assert float(re.search("step of (\\S+) deg", told)[1]) == pytest.approx(step, abs=1.0)
        assert "row 502" in told and "double-counted" in told
        assert not any("far from its neighbours" in remark for remark in found.remarks)

    each(told_as_step, [("measured_angle", -40.0), ("constant_speed", 25.0), ("measured_angle", 138.24)])
    frame = turning(lambda turned: turned)
    frame.loc[500:501, "theta"] += 40.0
    found = read(frame, {})
    assert found.left_out == {} and any("far from its neighbours" in remark for remark in found.remarks)


def test_a_crank_that_slows_down_in_every_turn_without_stopping_is_read(read):
    fine = np.linspace(0.0, 10.0, 100_001)

    def is_read(unsteadiness, count):
        time = np.cumsum(1.0 / (1.0 + unsteadiness * np.cos(2 * np.pi * fine)))
        time *= 10.0 / time[-1]
        assert read(turning(lambda turned: np.interp(turned, time, fine), count=count)).left_out == {}

    each(is_read, [(share, count) for share in (0.3, 0.95) for count in (180, 960)])
