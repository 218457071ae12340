"""Fading of the impact memory of a lasting contact."""

import numpy as np
import pytest

from jointgap.contact.joints import CONTACT
from jointgap.contact.normal_force import LAWS, damping_factor_at, elastic_duration
from jointgap.motion.integrate import EVENT
from jointgap.motion.runge_kutta import LINEAR
from jointgap.motion.simulation import integrate_to_angles
from jointgap.motion.slider_crank import model_of, simulate, start_state
from tests.motion.cases import (
    ALL,
    SPEED,
    free_impact,
    in_contact,
    integrated,
    mechanism,
    options,
    order,
)
from tests.motion.laws import faded_damping, impact_duration, joint

CHI, APPROACH = 0.8, 0.4
FADING = {"damping": CHI, "memory_time": 2e-3, "fading_time": 1e-3}
FADING["steady_contact_damping"] = CHI / 0.05


@pytest.mark.parametrize("exponent, speed", [(1.0, 0.5), (1.5, 1e-3), (3.0, 0.5)])
def test_the_duration_of_an_elastic_impact_is_exact(exponent, speed):
    exact = impact_duration(3.6e10, exponent, 0.7, speed)
    assert elastic_duration(3.6e10, exponent, 0.7, speed) == pytest.approx(exact, rel=1e-9)


def test_memory_and_fading_times_are_as_documented():
    model = model_of(mechanism(loose=ALL), options())
    for name, mass in {"crank_pin": 1.2212, "piston_pin": 1.2212, "crank_pivot": 1.5916}.items():
        numbers = model.bearings[name]
        duration = impact_duration(numbers.stiffness, 1.5, mass, 1e-3)
        assert numbers.memory_time == pytest.approx(2.5 * duration, rel=1e-9)
        assert numbers.fading_time == pytest.approx(2.5 * duration, rel=1e-9)
        assert numbers.steady_contact_damping == numbers.damping / 0.05


def test_damping_fades_as_a_smooth_step_of_order_9():
    numbers, times = joint(**FADING), np.linspace(0.0, 4e-3, 401)
    found = [damping_factor_at(numbers, APPROACH, 1.0, 1.0 + time) for time in times]
    np.testing.assert_allclose(found, faded_damping(numbers, APPROACH, times), rtol=1e-11)
    assert set(found[:201]) == {CHI / APPROACH} and set(found[301:]) == {CHI / 0.05}


@pytest.mark.parametrize(
    "law, restitution",
    [("exact_restitution", 0.1), ("lankarani_nikravesh", 0.46), ("flores", 0.95)],
)
def test_a_free_impact_is_the_published_one(law, restitution):
    by_form = [
        free_impact(mechanism(law=law, restitution=restitution, memory=memory), 0.773, 0.3)[1]
        for memory in ("published", "fading")
    ]
    np.testing.assert_array_equal(*by_form)


@pytest.mark.parametrize("law", LAWS)
def test_the_slowest_impact_ends_before_its_memory_fades(law):
    """Also an impact 90 times slower than the slowest damped as such."""
    for speed in (1e-3, 1e-3 / 90):
        model, (impact, separation) = free_impact(
            mechanism(law=law, restitution=0.1), mass=1.2212, speed=speed
        )
        assert impact[EVENT.index("approach_speed")] == pytest.approx(speed, rel=1e-9)
        assert separation[EVENT.index("duration")] < model.bearings["crank_pin"].memory_time


def test_the_order_is_kept_while_memory_fades_and_after():
    made = mechanism(friction=0.2, friction_speed=0.1, loose=("crank_pin",))
    model, run = integrated(made, np.linspace(0.0, 90.0, 2), tolerance=1e-15)
    pin = model.bearings["crank_pin"]
    begin, approach, length = run.begins[-1, 0], run.approaches[-1, 0], pin.fading_time
    # where fading begins and ends
    knots = begin + pin.memory_time + np.array([0.0, length])
    assert run.modes[-1, 0] == CONTACT and knots[1] < run.times[-1]
    at = integrate_to_angles(
        model, start_state(model), SPEED * np.concatenate(([0.0], knots)), 1e-15
    )
    for i in (1, 2):
        here = in_contact(model, at.times[i], at.states[i], "crank_pin", approach, begin)
        assert order(model, here, LINEAR, 0.0, length, (12, 16, 24)) > 7.5


STARTS, SAMPLES = 12, 360


def settled(**contact) -> np.ndarray:
    """Slider acceleration and crank torque of a settled revolution by start angle, (12, 2, 360)."""
    made, found = mechanism(friction=0.15, gravity=True, **contact), []
    chosen = {"speed": 10 * np.pi, "revolutions": 12, "tolerance": 1e-10}
    chosen["samples_per_revolution"] = SAMPLES
    for start in range(STARTS):
        run = simulate(made, options(start_angle=2 * np.pi * start / STARTS, **chosen))
        last = run.samples[["slider_acceleration", "crank_torque"]].to_numpy()[-SAMPLES - 1 : -1].T
        found.append(np.roll(last, start * SAMPLES // STARTS, axis=1))
    return np.array(found)


def apart(motions: np.ndarray) -> np.ndarray:
    """Largest RMS difference of two motions over the standard deviation of the signal."""
    between = np.sqrt(((motions[:, None] - motions[None]) ** 2).mean(axis=-1))
    return (between / motions.std(axis=-1).mean(axis=0)).max(axis=-1)


def test_the_settled_motion_does_not_depend_on_the_start_angle(worst):
    worst("settled motions apart, over the signal's sd", apart(settled()).max(), 1e-4)


def test_without_fading_the_settled_motion_depends_on_the_start_angle():
    between = apart(settled(memory="published"))
    different = [i for i in range(STARTS) if (between[i, :i] > 1e-4).all()]
    assert len(different) >= 7 and between.max() > 5e-3
