"""What is written into a mechanism, value for value and without a simulation."""

import math

import pytest

from jointgap.config import EFFECTS, Mechanism
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.joints import PINS
from jointgap.rig.model import build_model
from jointgap.rig.simulate_run import (
    augmented_mechanism,
    friction_speed,
    simulated_effects,
    steady_contact_damping,
    with_effects,
    with_nuisances,
)
from tests.catalogue import each as of_all
from tests.catalogue import refused
from tests.rows import each
from tests.slider_crank.rigs import campaign, mechanism

JOINTS = ("crank_pivot", *PINS)


def made(loose=JOINTS, **content):
    return Mechanism.model_validate(mechanism(loose, **content))


def with_contacts(steel=None, pin=None, **content):
    """All joints loose; keys of the usual contact, and of the crank pin's own."""
    content = mechanism(JOINTS, **content)
    content["contacts"]["steel"] |= steel or {}
    content["contacts"]["other"] = {"restitution": 0.6, "friction": 0.1} | (pin or {})
    content["joints"]["crank_pin"]["contact"] = "other" if pin else "steel"
    return Mechanism.model_validate(content)


@pytest.fixture(scope="module")
def candidates():
    """What a fit can vary, by label."""
    own = campaign(mechanism(PINS), speeds=(30.0, 31.0), nuisance={"joint_friction": [0.0, 0.3]})
    terms = [f"discovered_{law}" for law in ("slider_force", "slider_force[v^3]", "crank_torque[w]", "slider_force[x]")]
    terms = [Candidate(term, "slider", (Parameter("size", 0.0),), ("size",)) for term in terms]
    return {one.label: one for one in [*build_model(own).candidates, *terms]}


def dumped(effects):
    return [one.model_dump(exclude_defaults=True) for one in effects]


@each(
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
def test_a_nuisance_changes_the_datum_of_its_name_alone(name, value, read):
    changed, own = with_nuisances(made(), {name: value}), made()
    assert read(changed) == pytest.approx(value, rel=1e-12) != read(own)
    parts = ("crank", "rod", "slider", "joints", "effects")
    assert len([part for part in parts if getattr(changed, part) != getattr(own, part)]) == 1
    assert with_nuisances(own, {"speed": 3.0, "first_angle": 1.0, "crank_pivot": 2.0}) == own


def test_lengths_are_those_of_the_bodies_and_their_centres_move_along():
    assert with_nuisances(made(), {"crank_length": 0.16, "rod_length": 0.57}) == made().with_lengths(0.16, 0.57)
    assert with_nuisances(made(), {"rod_length": 0.57}) == made().with_lengths(0.15, 0.57)


def test_friction_and_restitution_are_those_of_the_pins_and_a_pins_own_value_goes_first():
    values = {"joint_friction": 0.2, "joint_friction_crank_pin": 0.3, "restitution": 0.7, "restitution_piston_pin": 0.8}
    contacts = [with_nuisances(made(), values).joint(joint).contact for joint in JOINTS]
    assert [(one.friction, one.restitution) for one in contacts] == [(0.1, 0.46), (0.3, 0.7), (0.2, 0.8)]


def test_the_speed_of_friction_is_that_of_the_first_joint_with_friction_and_the_others_follow_in_proportion():
    other = with_contacts(pin={"friction_speed": 4e-3})
    first = other.joint("crank_pivot").contact.friction_speed
    assert friction_speed(other) == first != 4e-3
    changed = with_nuisances(other, {"friction_speed": 3.0 * first})
    assert changed.joint("crank_pivot").contact.friction_speed == pytest.approx(3.0 * first)
    assert changed.joint("crank_pin").contact.friction_speed == pytest.approx(12e-3)
    assert friction_speed(with_contacts({"friction": 0.0}, {"friction_speed": 4e-3})) == 4e-3
    assert friction_speed(made(loose=())) is friction_speed(made(friction=0.0)) is None


def test_the_damping_of_a_lasting_contact_is_a_logarithm_of_its_own_for_each_loose_joint_where_it_fades():
    assert steady_contact_damping(made(loose=("piston_pin",))) == {"piston_pin": "lasting_damping_piston_pin"}
    changed = with_nuisances(made(), {"lasting_damping_piston_pin": math.log(2.0)})
    assert changed.joint("piston_pin").contact.reference_speed == pytest.approx(0.025, rel=1e-12)
    assert changed.joint("crank_pin").contact.reference_speed == 0.05
    penalty = {"law": "penalty", "restitution": None, "penalty_damping": 1e3, "penalty_depth": 1e-4}
    assert (
        steady_contact_damping(with_contacts({"memory": "published"}))
        == steady_contact_damping(with_contacts(penalty))
        == {}
    )


def test_an_effect_of_no_size_is_left_out_unless_it_stands_for_something_there(candidates):
    def stays(label, values, *expected):
        found = with_effects(made(), [(candidates[label], values)]).effects
        assert [getattr(found[0].parameters, expected[0])] == [pytest.approx(expected[1])] if expected else not found

    force = {"frequency_Hz": 7.0}
    cases = [
        ("slider_coulomb_friction", {"force_N": 0.0}),
        ("sensor_bias:crank_torque", {"bias": 1.0}),  # a fault of a sensor is no part of the mechanism
        ("crank_unbalance", {"cosine": 0.0, "sine": 0.0}),
        ("crank_unbalance", {"cosine": 0.0, "sine": 0.02}, "unbalance_kg_m", 0.02),
        ("pin_friction:crank_pin", {"change": 0.0}, "coefficient", 0.1),
        ("harmonic_force", force | {"cosine": 0.0, "sine": 0.0}),  # a shape alone is no size
        ("harmonic_force", force | {"cosine@slow": 3.0, "sine@slow": 4.0}, "force_N", 5.0),
        ("harmonic_force", force | {"cosine": 3.0, "sine": 4.0}, "force_N", 5.0),
    ]
    of_all(stays, cases)


def test_effects_are_added_after_those_there_and_terms_of_one_law_are_one_effect(candidates):
    sizes = {
        "discovered_slider_force[v^3]": {"size": -2.0},
        "discovered_crank_torque[w]": {"size": 0.5},
        "pin_friction:piston_pin": {"change": 0.1},
        "discovered_slider_force[x]": {"size": 3.0},
    }
    own = made(effects=[{"name": "gravity", "parameters": {}}])
    changed = with_effects(own, [(candidates[label], values) for label, values in sizes.items()])
    formula = {"formula": "c1*(v^3) + c2*(x)", "coefficients": {"c1": -2.0, "c2": 3.0}}
    assert changed.effects[0] == own.effects[0]
    assert dumped(changed.effects[1:]) == [
        {"name": "pin_friction", "site": "piston_pin", "parameters": {"coefficient": pytest.approx(0.2)}},
        {"name": "discovered_slider_force", "parameters": formula},
        {"name": "discovered_crank_torque", "parameters": {"formula": "c1*(w)", "coefficients": {"c1": 0.5}}},
    ]
    assert changed.model_copy(update={"effects": own.effects}) == own


def test_what_makes_no_mechanism_is_refused_with_the_name_of_the_effect_or_the_datum(candidates):
    cases = [
        ("discovered_slider_force", {"size": 1.0}, "has no term ~ discovered_slider_force[v^3]"),
        ("slider_coulomb_friction", {"force_N": -5.0}, "slider_coulomb_friction: parameters.force_N"),
    ]
    refused(lambda label, values: with_effects(made(), [(candidates[label], values)]), cases)
    refused(
        lambda values: augmented_mechanism(made(), (), values), [({"slider_mass": -1.0}, "augmented mechanism ~ mass")]
    )


def test_a_rod_that_is_too_stiff_to_simulate_is_simulated_at_the_limit_with_its_share(candidates):
    rod, stiff = candidates["rod_flexibility"], {"compliance_s2": 1e-12}
    nearest, share = EFFECTS["rod_flexibility"].simulated(stiff)
    others = [(candidates["slider_coulomb_friction"], {"force_N": 5.0})]
    limited, exact, part = simulated_effects([(rod, stiff), *others, (rod, stiff)])
    assert limited == [(rod, nearest), *others, (rod, nearest)]
    assert exact == others and part == share**2 and 0.0 < share < 1.0
    assert simulated_effects(others) == (others, others, 1.0)


def test_a_fit_writes_its_nuisances_its_effects_and_what_they_replaced_and_nothing_of_single_runs(candidates):
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
    assert [one.name for one in changed.effects] == ["pin_friction", "slider_coulomb_friction"]
    assert changed.effect("pin_friction").coefficient == pytest.approx(0.2)
    assert changed.effect("slider_coulomb_friction").force_N == 5.0
    assert Mechanism.model_validate(changed.model_dump()) == changed
