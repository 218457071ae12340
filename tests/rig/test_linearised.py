"""Linearised changes of the readings against differences of simulations."""

import numpy as np
import pytest

from jointgap.core.candidates import Linearised
from tests.rig.rigs import chosen, mechanism, rig

PISTON, PINS = ("piston_pin",), ("crank_pin", "piston_pin")
NUISANCES = {
    "slider_mass": "5 %",
    "rod_mass": "5 %",
    "crank_pin_clearance": "10 %",
    "joint_friction": "30 %",
    "speed": "1 %",
}
# Steps of the differences, over those of the parameter: sliding reverses within narrow ranges
STEPS = (1e-1, 3e-2, 1e-2, 3e-3)


def changed(model, variations, effects=()):
    """Changes of the readings of the run ``slow`` by small steps of values and effects."""
    return model.changes("slow", model.nominal("slow"), list(effects), variations)


def variation(model, key: str, share: float, effects=()):
    """Step of a nuisance, or of the amplitude of an effect by its label, and the varied run."""
    values = model.nominal("slow")
    nuisance = next((p for p in model.nuisances if p.name == key), None)
    if nuisance is not None:
        return nuisance.step * share, (values | {key: values[key] + share * nuisance.step}, effects)
    candidate = chosen(model, key)
    sizes = {
        p.key: share * p.step if p.key == candidate.amplitudes[0] else 0.0
        for p in candidate.coordinates
        if p.key in candidate.amplitudes
    }
    sizes |= {p.key: p.nominal for p in candidate.coordinates if p.key not in sizes}
    step = sizes[candidate.amplitudes[0]]
    return step, (values, [*effects, (candidate, sizes | dict(candidate.initial_guesses[0]))])


def stacked(readings: dict, scale: dict) -> np.ndarray:
    """All channels over their standard deviations."""
    return np.concatenate([readings[name] / max(scale[name].std(), 1e-3) for name in readings])


def cosines(model, keys, effects=(), steps=STEPS, small=1e-5) -> dict[str, float]:
    """Of each derivative with the most similar of the differences over several steps."""
    here = model.simulate("slow", model.nominal("slow"), effects)
    found = {}
    nearby = [variation(model, key, small, effects)[1] for key in keys]
    for key, change in zip(keys, changed(model, nearby, effects), strict=True):
        derivative = stacked(change, here)
        found[key] = 0.0
        for share in steps:
            _, (values, with_effect) = variation(model, key, share, effects)
            there = model.simulate("slow", values, with_effect)
            secant = stacked({name: there[name] - here[name] for name in here}, here)
            lengths = np.linalg.norm(derivative) * np.linalg.norm(secant)
            found[key] = max(found[key], float(derivative @ secant / max(lengths, 1e-300)))
    return found


@pytest.mark.parametrize("loose", [PISTON, PINS], ids=["one", "two"])
def test_nuisances_of_loose_joints(loose):
    model = rig(mechanism(loose), nuisance=NUISANCES)
    assert min(cosines(model, ["slider_mass", "rod_mass", "joint_friction"]).values()) > 0.97
    # differences by the speed of the regularisation are rough: small steps are numerical noise
    assert cosines(model, ["friction_speed"], steps=(1.0, 0.3))["friction_speed"] > 0.98
    assert loose == PISTON or cosines(model, ["crank_pin_clearance"])["crank_pin_clearance"] > 0.99


@pytest.mark.parametrize("key", ["speed", "first_angle"])
def test_nuisances_of_a_run(key, two_pins):
    # the encoder is exact, so that their bounds and steps are rounding errors
    step = next(p.step for p in two_pins.nuisances if p.name == key)
    steps = (1e-3 / step, 3e-4 / step, 1e-4 / step)
    assert cosines(two_pins, [key], steps=steps, small=1e-7 / step)[key] > 0.97


@pytest.mark.parametrize(
    "label",
    [
        "slider_viscous_friction",
        "slider_constant_force",
        "gas_pressure",
        "crank_coulomb_friction",
        "gravity",
        "encoder_offset",
        "encoder_windup",
        "sensor_gain:crank_torque",
        "sensor_lag:crank_torque",
        "sensor_delay:crank_torque",
    ],
)
def test_effects_and_sensor_faults(label, two_pins):
    assert cosines(two_pins, [label])[label] > 0.97


@pytest.fixture(scope="module")
def two_pins():
    return rig(mechanism(PINS), nuisance=NUISANCES)


def test_several_variations_are_independent_of_each_other(two_pins):
    keys = ["slider_mass", "slider_viscous_friction", "speed"]
    variations = [variation(two_pins, key, 1e-5)[1] for key in keys]
    together = changed(two_pins, variations)
    for one, expected in zip(variations, together, strict=True):
        (alone,) = changed(two_pins, [one])
        for name in alone:
            np.testing.assert_allclose(alone[name], expected[name], rtol=1e-6, atol=1e-300)


def test_filtered_sensors():
    sensors = {
        "crank_torque": {"bandwidth": "60 Hz", "filter": "causal"},
        "slider_acceleration": {"high_pass": "0.5 Hz"},
    }
    model = rig(mechanism(PINS), nuisance=NUISANCES, sensors=sensors)
    assert min(cosines(model, ["slider_mass", "slider_viscous_friction"]).values()) > 0.97


def test_about_an_effect_that_is_there(two_pins):
    friction = (chosen(two_pins, "slider_viscous_friction"), {"damping_N_s_m": 3.0})
    found = cosines(two_pins, ["slider_constant_force", "rod_mass"], [friction])
    assert min(found.values()) > 0.97


def test_a_variation_that_does_not_repeat_is_left_to_simulations(two_pins):
    assert isinstance(two_pins, Linearised)
    kept = variation(two_pins, "slider_mass", 1e-5)[1]
    swing = variation(two_pins, "harmonic_force", 1e-5)[1]
    change, none = changed(two_pins, [kept, swing])
    assert none is None and set(change) == set(two_pins.plans["slow"].channels)


@pytest.mark.parametrize(
    "content, keys",
    [
        (mechanism(), {}),
        (mechanism(PINS), {"run": {"start": "at_rest"}}),
        (
            mechanism(
                PINS,
                effects=[
                    {
                        "name": "harmonic_force",
                        "parameters": {"force_N": 5.0, "frequency_Hz": 3.3, "phase_rad": 0.0},
                    }
                ],
            ),
            {},
        ),
    ],
    ids=["ideal joints", "start at rest", "harmonic force"],
)
def test_motion_that_is_not_linearised(content, keys):
    model = rig(content, nuisance={"slider_mass": "5 %"}, **keys)
    assert changed(model, [variation(model, "slider_mass", 1e-5)[1]]) is None
