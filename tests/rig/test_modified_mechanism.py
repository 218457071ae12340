"""Changes of a mechanism by nuisances and effects, without a simulation."""

import pytest

from jointgap.config import EFFECTS, Mechanism
from jointgap.core.joints import PINS
from jointgap.rig.model import build_model
from jointgap.rig.simulate_run import (
    augmented_mechanism,
    simulated_effects,
    with_effects,
    with_nuisances,
)
from tests.rig.rigs import campaign, mechanism

JOINTS = ("crank_pivot", *PINS)


def made(loose=JOINTS, **content):
    return Mechanism.model_validate(mechanism(loose, **content))


@pytest.fixture(scope="module")
def candidates():
    """Candidates by label."""
    rig_campaign = campaign(
        mechanism(PINS), speeds=(30.0, 31.0), nuisance={"joint_friction": [0.0, 0.3]}
    )
    return {item.label: item for item in build_model(rig_campaign).candidates}


@pytest.mark.parametrize(
    "name, value, read",
    [
        ("rod_mass", 0.8, lambda m: m.rod.mass),
        ("rod_inertia", 0.03, lambda m: m.rod.inertia),
        ("slider_mass", 0.5, lambda m: m.slider.mass),
        ("crank_pivot_clearance", 2e-4, lambda m: m.clearance("crank_pivot")),
        ("crank_pin_clearance", 3e-4, lambda m: m.clearance("crank_pin")),
        ("joint_friction_piston_pin", 0.2, lambda m: m.joint("piston_pin").contact.friction),
        ("restitution_crank_pin", 0.7, lambda m: m.joint("crank_pin").contact.restitution),
    ],
)
def test_a_nuisance_changes_only_its_own_value(name, value, read):
    changed, own = with_nuisances(made(), {name: value}), made()
    assert read(changed) == pytest.approx(value, rel=1e-12) != read(own)
    parts = ("crank", "rod", "slider", "joints", "effects")
    assert len([part for part in parts if getattr(changed, part) != getattr(own, part)]) == 1
    assert with_nuisances(own, {"speed": 3.0, "first_angle": 1.0, "crank_pivot": 2.0}) == own


FORCE = {"frequency_Hz": 7.0}


@pytest.mark.parametrize(
    "label, values, expected",
    [
        ("slider_coulomb_friction", {"force_N": 0.0}, {}),
        ("sensor_bias:crank_torque", {"bias": 1.0}, {}),
        ("crank_unbalance", {"cosine": 0.0, "sine": 0.0}, {}),
        ("crank_unbalance", {"cosine": 0.0, "sine": 0.02}, {"unbalance_kg_m": 0.02}),
        ("pin_friction:crank_pin", {"change": 0.0}, {"coefficient": 0.1}),
        ("harmonic_force", FORCE | {"cosine": 0.0, "sine": 0.0}, {}),
        ("harmonic_force", FORCE | {"cosine@slow": 3.0, "sine@slow": 4.0}, {"force_N": 5.0}),
    ],
)
def test_an_effect_without_size_is_left_out(candidates, label, values, expected):
    effects = with_effects(made(), [(candidates[label], values)]).effects
    assert bool(effects) == bool(expected)
    for name, value in expected.items():
        assert getattr(effects[0].parameters, name) == pytest.approx(value)


def test_a_stiff_rod_is_simulated_at_the_limit_with_its_share(candidates):
    rod, stiff = candidates["rod_flexibility"], {"compliance_s2": 1e-12}
    nearest, share = EFFECTS["rod_flexibility"].simulated(stiff)
    others = [(candidates["slider_coulomb_friction"], {"force_N": 5.0})]
    limited, exact, part = simulated_effects([(rod, stiff), *others, (rod, stiff)])
    assert limited == [(rod, nearest), *others, (rod, nearest)]
    assert exact == others and part == share**2 and 0.0 < share < 1.0
    assert simulated_effects(others) == (others, others, 1.0)


def test_a_fit_changes_the_mechanism_by_nuisances_and_effects_of_all_runs(candidates):
    values = {
        "slider_mass": 0.5,
        "speed@slow": 29.0,
        "rod_mass@slow": 2.0,
        "pin_friction:crank_pin.change": 0.1,
        "pin_friction:crank_pin.joint_friction": 0.15,
        "slider_coulomb_friction.force_N": 5.0,
        "sensor_bias:crank_torque.bias": 1.0,
    }
    assert augmented_mechanism(made(), (), values) == with_nuisances(made(), {"slider_mass": 0.5})
    labels = ("pin_friction:crank_pin", "slider_coulomb_friction", "sensor_bias:crank_torque")
    changed = augmented_mechanism(made(PINS), tuple(map(candidates.get, labels)), values)
    assert (changed.slider.mass, changed.rod.mass) == (0.5, made().rod.mass)
    assert changed.joint("piston_pin").contact.friction == 0.15
    assert [item.name for item in changed.effects] == ["pin_friction", "slider_coulomb_friction"]
    assert changed.effect("pin_friction").coefficient == pytest.approx(0.2)
    assert changed.effect("slider_coulomb_friction").force_N == 5.0
    assert Mechanism.model_validate(changed.model_dump()) == changed
