"""Periodic motion: one simulated revolution replaces all."""

import numpy as np
import pytest

from jointgap.motion.model import beginning
from jointgap.motion.simulation import integrate_on, integrate_to_angles, observed
from jointgap.motion.slider_crank import start_state
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


def integrated(model, angles):
    """Every sample of the record simulated, one after the other."""
    result = integrate_to_angles(
        model, start_state(model), np.append(model.drive.start_angle, angles), TOLERANCE
    )
    return {name: values[1:] for name, values in observed(model, result).items()}


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

    def counted(model, workspace, angles, *settings):
        ends.append((angles[-1] - model.drive.start_angle) / TURN)
        return integrate_on(model, workspace, angles, *settings)

    def follow(run):
        ends.clear()
        result = motion.channels_at(run.model, run.angles, TOLERANCE, change=over_noise)
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
    later = integrated(run.model, np.sort(run.angles) + 6 * TURN)
    assert apart(result, later) < 2e-3
    assert result["time"] == pytest.approx(
        (run.angles - run.model.drive.start_angle) / run.model.drive.speed
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
    assert apart(result, integrated(run.model, run.angles)) < 1e-6


def test_non_periodic_motion_is_simulated_in_full(followed):
    run = driven(PINS, friction=0.0, kept=2)
    result, ends = followed(run)
    later = integrated(run.model, run.angles + 11 * TURN)  # it begins after two revolutions
    assert ends[-2] == pytest.approx(13.0, abs=0.1)
    assert apart(result, later) < 1e-6


def test_a_continued_integration_equals_an_uninterrupted_one():
    model = driven(PINS).model
    angles = model.drive.start_angle + np.sort(
        np.random.default_rng([3, 1]).uniform(0.0, 4 * TURN, 300)
    )
    complete = integrate_to_angles(
        model, start_state(model), np.append(model.drive.start_angle, angles), TOLERANCE
    )
    workspace, steps = beginning(model, start_state(model), 0.0), 0
    for begin, end in ((0, 1), (1, 2), (2, 100), (100, 300)):
        part, workspace = integrate_on(model, workspace, angles[begin:end], TOLERANCE)
        for name in (
            "times",
            "states",
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
    back = round((run.angles.min() - run.model.drive.start_angle) / TURN)
    result, ends = followed(run)
    assert back > 10 and ends[-1] == pytest.approx(back + 1.0, abs=0.1)
    assert over_noise(result, integrated(run.model, np.sort(run.angles) + 40 * TURN)) < 1.0
