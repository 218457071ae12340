"""Periodic motion: one simulated revolution replaces all."""

import numpy as np
import pytest

from jointgap.dynamics.integrate import beginning
from jointgap.dynamics.simulation import integrate_on, integrate_to_angles, start_state
from jointgap.rig import simulate_run as motion
from jointgap.rig.drives import constant_speed_run
from jointgap.rig.model import build_model
from tests.rig.rigs import campaign, mechanism, recorded

TURN = 2 * np.pi
TOLERANCE = motion.TOLERANCE
SEEN = ("slider_acceleration", "crank_torque", "guide_force", "frame_force_y")
PISTON, PINS = ("piston_pin",), ("crank_pin", "piston_pin")


def driven(loose, *effects, kept=5, friction=0.1, **keys):
    rig_campaign = campaign(mechanism(loose, friction, effects), **keys)
    plan = build_model(rig_campaign, recorded(rig_campaign, kept=kept)).plans["slow"]
    return constant_speed_run(rig_campaign.mechanism.applied(), plan, {}, 0.0, TOLERANCE)


def effect(name, site=None, **parameters):
    return {"name": name, "parameters": parameters} | ({"site": site} if site else {})


def integrated(p, angles):
    """Every sample of the record simulated, one after the other."""
    result = integrate_to_angles(
        p, start_state(p), np.append(p.drive.start_angle, angles), TOLERANCE
    )
    return {name: values[1:] for name, values in result.observed(p).items()} | {
        "time": result.times[1:]
    }


def apart(one, other):
    return max(
        np.sqrt(np.mean((one[name] - other[name]) ** 2)) / np.std(other[name]) for name in SEEN
    )


def over_noise(one, other):
    """Length of the change, over a noise of 1 % of the variation of the channel."""
    return np.sqrt(
        sum(
            np.sum((one[name] - other[name]) ** 2) / (0.01 * np.std(one[name])) ** 2
            for name in SEEN
        )
    )


@pytest.fixture
def followed(monkeypatch):
    """A function that simulates a run for its samples, and how many revolutions from the start each
    of its simulations ends; each goes on where the one before ended.
    """
    ends = []

    def counted(p, progress, angles, *settings):
        ends.append((angles[-1] - p.drive.start_angle) / TURN)
        return integrate_on(p, progress, angles, *settings)

    def follow(run):
        ends.clear()
        result = motion.channels_at(run.numbers, run.angles, TOLERANCE, change=over_noise)
        assert result["crank_angle"] == pytest.approx(run.angles)
        return result, list(ends)

    monkeypatch.setattr(motion, "integrate_on", counted)
    return follow


@pytest.mark.parametrize("loose, length", [(PISTON, 4), (PINS, 5)])
def test_one_settled_revolution_replaces_the_record(loose, length, followed):
    run = driven(loose)
    result, ends = followed(run)
    assert ends[-1] == pytest.approx(length, abs=0.1)
    # long after the start nothing else is seen
    later = integrated(run.numbers, np.sort(run.angles) + 6 * TURN)
    assert apart(result, later) < 2e-3
    assert result["time"] == pytest.approx(
        (run.angles - run.numbers.drive.start_angle) / run.numbers.drive.speed
    )


@pytest.mark.parametrize(
    "effects, keys",
    [
        ([effect("harmonic_force", force_N=20.0, frequency_Hz=7.3, phase_rad=0.0)], {}),
        ([], {"start": "dead_centre"}),
    ],
)
def test_non_periodic_forces_and_records_from_the_start_are_simulated_in_full(
    effects, keys, followed
):
    run = driven(PISTON, *effects, run=keys)
    result, ends = followed(run)
    assert len(ends) == 1 and (keys or ends[0] > 6.5)
    assert apart(result, integrated(run.numbers, run.angles)) < 1e-6


def test_non_periodic_motion_is_simulated_in_full(followed):
    run = driven(PINS, friction=0.0, kept=2)
    result, ends = followed(run)
    later = integrated(run.numbers, run.angles + 11 * TURN)  # it begins after two revolutions
    assert ends[-2] == pytest.approx(13.0, abs=0.1)
    assert apart(result, later) < 1e-6


def test_a_continued_integration_equals_an_uninterrupted_one():
    p = driven(PINS).numbers
    angles = p.drive.start_angle + np.sort(
        np.random.default_rng([3, 1]).uniform(0.0, 4 * TURN, 300)
    )
    complete = integrate_to_angles(
        p, start_state(p), np.append(p.drive.start_angle, angles), TOLERANCE
    )
    progress, steps = beginning(p, *start_state(p), 0.0), 0
    for begin, end in ((0, 1), (1, 2), (2, 100), (100, 300)):
        part, progress = integrate_on(p, progress, angles[begin:end], TOLERANCE)
        for name in (
            "times",
            "states",
            "auxiliary_states",
            "modes",
            "approaches",
            "begins",
            "directions",
        ):
            np.testing.assert_array_equal(
                getattr(part, name), getattr(complete, name)[1 + begin : 1 + end]
            )
        steps += part.steps
    assert 0 <= steps - complete.steps < 20  # the step that holds the last sample is made again


def test_a_weakly_damped_rod_settles_before_one_revolution_is_used(followed):
    """Some ten and a half times a revolution; seven time constants of its decay take eleven
    revolutions and more."""
    run = driven((), effect("rod_flexibility", frequency_Hz=10.5 * 30.0 / TURN, damping_ratio=0.01))
    back = round((run.angles.min() - run.numbers.drive.start_angle) / TURN)
    result, ends = followed(run)
    assert back > 10 and ends[-1] == pytest.approx(back + 1.0, abs=0.1)
    assert over_noise(result, integrated(run.numbers, np.sort(run.angles) + 40 * TURN)) < 1.0
