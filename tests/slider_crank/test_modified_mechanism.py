"""What is written into a mechanism, and into its mirror image, value for value and without a simulation."""

import math

import pytest

from jointgap.config import EFFECTS, Mechanism
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError
from jointgap.core.joints import PINS
from jointgap.effects.base import example
from jointgap.rig.simulate_run import (
    augmented_mechanism,
    friction_speed,
    simulated_effects,
    steady_contact_damping,
    with_effects,
    with_nuisances,
)
from tests.slider_crank.rigs import mechanism

JOINTS = ("crank_pivot", *PINS)


def made(loose=JOINTS, **content):
    return Mechanism.model_validate(mechanism(loose, **content))


def of_two_steels(**pin_contact):
    """All joints loose; the contact of the crank pin is a steel of its own."""
    content = mechanism(JOINTS)
    content["contacts"]["other"] = {"restitution": 0.6, "friction": 0.1} | pin_contact
    content["joints"]["crank_pin"]["contact"] = "other"
    return Mechanism.model_validate(content)


def effect(name, *sizes, site="slider", others=(), **more):
    """An effect as a fit varies it: its sizes, and other coordinates."""
    coordinates = (*(Parameter(size, 0.0) for size in sizes), *(Parameter(other, 1.0) for other in others))
    return Candidate(name, site, coordinates, sizes, **more)


def _friction(values):
    return {"coefficient": 0.1 + values["change"]}


def _polar(values):
    return {"unbalance_kg_m": math.hypot(values["cosine"], values["sine"]), "angle_rad": 0.3}


def _harmonic(values):
    return {"force_N": 5.0, "frequency_Hz": values["frequency_Hz"], "phase_rad": 0.2}


COULOMB = effect("slider_coulomb_friction", "force_N")
BIAS = effect("sensor_bias", "bias", site="crank_torque", sensor=True, has_site=True)
PIN_FRICTION = {
    pin: effect("pin_friction", "change", site=pin, others=("joint_friction",), has_site=True, parameters=_friction)
    for pin in PINS
}
UNBALANCE = effect("crank_unbalance", "cosine", "sine", site="crank", parameters=_polar)
HARMONIC = Candidate(
    "harmonic_force",
    "slider",
    (Parameter("cosine", 0.0, run="slow"), Parameter("sine", 0.0, run="slow"), Parameter("frequency_Hz", 7.0)),
    ("cosine@slow", "sine@slow"),
    parameters=_harmonic,
)
ROD = effect("rod_flexibility", "compliance_s2", site="rod")


def term(name):
    """A term of a library of force laws."""
    return Candidate(name, "slider", (Parameter("size", 0.0),), ("size",))


def dumped(effects):
    return [effect.model_dump(exclude_defaults=True) for effect in effects]


# Nuisances


def test_without_values_a_mechanism_stays_as_it_is():
    assert with_nuisances(made(), {}) == made()


def test_values_that_are_none_of_the_mechanism_are_passed_over():
    assert with_nuisances(made(), {"speed": 3.0, "first_angle": 1.0, "crank_pivot": 2.0}) == made()


@pytest.mark.parametrize(
    ("name", "value", "read"),
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
    changed = with_nuisances(made(), {name: value})
    assert read(changed) == pytest.approx(value, rel=1e-12)
    assert read(made()) != pytest.approx(value)
    apart = [
        key for key in ("crank", "rod", "slider", "joints", "effects") if getattr(changed, key) != getattr(made(), key)
    ]
    assert len(apart) == 1


def test_lengths_are_those_of_the_bodies_and_their_centres_move_along():
    changed = with_nuisances(made(), {"crank_length": 0.16, "rod_length": 0.57})
    assert (changed.crank.length, changed.rod.length) == (0.16, 0.57)
    assert changed == made().with_lengths(0.16, 0.57)
    assert with_nuisances(made(), {"rod_length": 0.57}) == made().with_lengths(0.15, 0.57)


def test_friction_and_restitution_are_those_of_the_pins_and_a_pins_own_value_goes_first():
    values = {"joint_friction": 0.2, "joint_friction_crank_pin": 0.3, "restitution": 0.7, "restitution_piston_pin": 0.8}
    changed = with_nuisances(made(), values)
    contacts = {joint: changed.joint(joint).contact for joint in JOINTS}
    assert {joint: contact.friction for joint, contact in contacts.items()} == {
        "crank_pivot": 0.1,
        "crank_pin": 0.3,
        "piston_pin": 0.2,
    }
    assert {joint: contact.restitution for joint, contact in contacts.items()} == {
        "crank_pivot": 0.46,
        "crank_pin": 0.7,
        "piston_pin": 0.8,
    }


def test_the_speed_of_friction_is_that_of_the_first_joint_with_friction_and_the_others_follow_in_proportion():
    other = of_two_steels(friction_speed=4e-3)
    first = other.joint("crank_pivot").contact.friction_speed
    assert friction_speed(other) == first
    assert first != 4e-3
    changed = with_nuisances(other, {"friction_speed": 3.0 * first})
    assert changed.joint("crank_pivot").contact.friction_speed == pytest.approx(3.0 * first)
    assert changed.joint("crank_pin").contact.friction_speed == pytest.approx(12e-3)
    assert friction_speed(made(loose=())) is None
    assert friction_speed(made(friction=0.0)) is None


def test_the_speed_of_friction_is_not_asked_of_a_joint_without_friction():
    content = mechanism(JOINTS, friction=0.0)
    content["contacts"]["other"] = {"restitution": 0.6, "friction": 0.1, "friction_speed": 4e-3}
    content["joints"]["crank_pin"]["contact"] = "other"
    assert friction_speed(Mechanism.model_validate(content)) == 4e-3


def test_the_damping_of_a_lasting_contact_is_a_logarithm_of_its_own_for_each_loose_joint():
    assert steady_contact_damping(made(loose=("piston_pin",))) == {"piston_pin": "lasting_damping_piston_pin"}
    changed = with_nuisances(made(), {"lasting_damping_piston_pin": math.log(2.0)})
    assert changed.joint("piston_pin").contact.reference_speed == pytest.approx(0.025, rel=1e-12)
    assert changed.joint("crank_pin").contact.reference_speed == 0.05
    assert with_nuisances(changed, {"lasting_damping_piston_pin": -math.log(2.0)}).joint(
        "piston_pin"
    ).contact.reference_speed == pytest.approx(0.05, rel=1e-12)


@pytest.mark.parametrize(
    "contact",
    [
        {"restitution": 0.46, "memory": "published"},
        {"law": "penalty", "restitution": None, "penalty_damping": 1e3, "penalty_depth": 1e-4},
    ],
)
def test_a_contact_that_never_fades_has_no_such_nuisance(contact):
    content = mechanism(JOINTS)
    content["contacts"]["steel"] |= contact
    assert steady_contact_damping(Mechanism.model_validate(content)) == {}


# Effects


def test_effects_are_added_after_those_that_are_there_and_faults_of_sensors_are_no_part():
    own = made(effects=[{"name": "gravity", "parameters": {}}])
    effects = [
        (BIAS, {"bias": 1.0}),
        (COULOMB, {"force_N": 5.0}),
        (PIN_FRICTION["piston_pin"], {"change": 0.1}),
    ]
    changed = with_effects(own, effects)
    assert changed.effects[0] == own.effects[0]
    assert dumped(changed.effects[1:]) == [
        {"name": "slider_coulomb_friction", "parameters": {"force_N": 5.0}},
        {"name": "pin_friction", "site": "piston_pin", "parameters": {"coefficient": pytest.approx(0.2)}},
    ]
    assert changed.model_copy(update={"effects": own.effects}) == own


def test_an_effect_of_no_size_is_left_out_unless_it_stands_for_something_there():
    absent = [
        (COULOMB, {"force_N": 0.0}),
        (UNBALANCE, {"cosine": 0.0, "sine": 0.0}),
    ]
    assert with_effects(made(), absent).effects == ()
    (stays,) = with_effects(made(), [(PIN_FRICTION["crank_pin"], {"change": 0.0})]).effects
    assert stays.parameters.coefficient == pytest.approx(0.1)
    (turned,) = with_effects(made(), [(UNBALANCE, {"cosine": 0.0, "sine": 0.02})]).effects
    assert turned.parameters.unbalance_kg_m == pytest.approx(0.02)


def test_a_shape_alone_is_no_size_and_a_size_of_one_run_is():
    assert with_effects(made(), [(HARMONIC, {"cosine": 0.0, "sine": 0.0, "frequency_Hz": 7.0})]).effects == ()
    (there,) = with_effects(made(), [(HARMONIC, {"cosine@slow": 3.0, "sine@slow": 4.0, "frequency_Hz": 7.0})]).effects
    assert there.parameters.force_N == pytest.approx(5.0)


def test_terms_of_one_law_are_one_effect_and_those_of_another_a_second_one():
    terms = [
        (term("discovered_slider_force[v^3]"), {"size": -2.0}),
        (term("discovered_crank_torque[w]"), {"size": 0.5}),
        (term("discovered_slider_force[sin(theta)]"), {"size": 3.0}),
    ]
    effects = with_effects(made(), [*terms, (COULOMB, {"force_N": 5.0})]).effects
    assert dumped(effects) == [
        {"name": "slider_coulomb_friction", "parameters": {"force_N": 5.0}},
        {
            "name": "discovered_slider_force",
            "parameters": {"formula": "c1*(v^3) + c2*(sin(theta))", "coefficients": {"c1": -2.0, "c2": 3.0}},
        },
        {"name": "discovered_crank_torque", "parameters": {"formula": "c1*(w)", "coefficients": {"c1": 0.5}}},
    ]


def test_a_law_without_a_term_is_refused_with_an_example():
    with pytest.raises(InputError) as refused:
        with_effects(made(), [(term("discovered_slider_force"), {"size": 1.0})])
    assert str(refused.value) == "discovered_slider_force: has no term; use a name such as discovered_slider_force[v^3]"


def test_a_parameter_out_of_its_bounds_is_refused_with_the_name_of_the_effect():
    with pytest.raises(InputError, match=r"^slider_coulomb_friction: parameters\.force_N"):
        with_effects(made(), [(COULOMB, {"force_N": -5.0})])


def test_a_rod_that_is_too_stiff_to_simulate_is_simulated_at_the_limit_with_its_share():
    page = EFFECTS["rod_flexibility"]
    stiff = {"compliance_s2": 1e-12}
    nearest, share = page.simulated(stiff)
    assert 0.0 < share < 1.0
    law = term("discovered_slider_force[v]")
    others = [(COULOMB, {"force_N": 5.0}), (BIAS, {"bias": 1.0}), (law, {"size": 2.0})]
    limited, exact, part = simulated_effects([(ROD, stiff), *others, (ROD, stiff)])
    assert limited == [(ROD, nearest), *others, (ROD, nearest)]
    assert exact == others
    assert part == share**2
    assert simulated_effects(others) == (others, others, 1.0)
    assert simulated_effects([]) == ([], [], 1.0)


# What a fit found


def test_a_fit_without_effects_writes_its_nuisances_and_nothing_of_single_runs():
    assert augmented_mechanism(made()) == made()
    changed = augmented_mechanism(made(), (), {"slider_mass": 0.5, "speed@slow": 29.0, "rod_mass@slow": 2.0})
    assert changed == with_nuisances(made(), {"slider_mass": 0.5})


def test_a_fit_with_effects_writes_their_values_and_those_that_it_replaced():
    hypothesis = (PIN_FRICTION["crank_pin"], COULOMB, BIAS)
    values = {
        "slider_mass": 0.5,
        "pin_friction:crank_pin.change": 0.1,
        "pin_friction:crank_pin.joint_friction": 0.15,
        "slider_coulomb_friction.force_N": 5.0,
        "sensor_bias:crank_torque.bias": 1.0,
    }
    changed = augmented_mechanism(made(PINS), hypothesis, values)
    assert changed.slider.mass == 0.5
    assert changed.joint("piston_pin").contact.friction == 0.15
    assert [effect.name for effect in changed.effects] == ["pin_friction", "slider_coulomb_friction"]
    assert changed.effect("pin_friction").coefficient == pytest.approx(0.2)
    assert changed.effect("slider_coulomb_friction").force_N == 5.0


def test_a_fit_that_makes_the_mechanism_impossible_is_refused():
    with pytest.raises(InputError, match=r"^the augmented mechanism: "):
        augmented_mechanism(made(), (), {"slider_mass": -1.0})


# The mirror image


def test_the_mirror_turns_the_offset_and_gravity_and_leaves_all_data_beside_them():
    own = made(slider={"mass": 0.4482, "offset": 0.03}, gravity_direction=0.4)
    behind = own.mirrored()
    assert (behind.slider.offset, behind.slider.mass) == (-0.03, 0.4482)
    assert behind.gravity_direction == -0.4
    assert behind.model_copy(update={"slider": own.slider, "gravity_direction": own.gravity_direction}) == own


@pytest.mark.parametrize(
    ("name", "turned"),
    [("speed_fluctuation", "phase_rad"), ("crank_unbalance", "angle_rad"), ("slider_offset", "offset_m")],
)
def test_of_an_effect_with_a_side_one_parameter_is_the_opposite_behind(name, turned):
    (own,) = made(effects=[example(EFFECTS[name])]).effects
    expected = own.parameters.model_dump() | {turned: -getattr(own.parameters, turned)}
    assert own.mirrored().parameters.model_dump() == expected
    assert getattr(own.parameters, turned) != 0.0
    assert made(effects=[example(EFFECTS[name])]).mirrored().effects == (own.mirrored(),)


def test_the_phase_of_a_periodic_torque_is_mirrored_about_a_quarter_turn():
    (own,) = made(effects=[example(EFFECTS["crank_periodic_torque"])]).effects
    behind = own.mirrored().parameters
    assert behind.phase_rad == math.pi - own.parameters.phase_rad
    assert (behind.torque_N_m, behind.order) == (own.parameters.torque_N_m, own.parameters.order)
    theta = 0.3  # M' = -M at theta' = -theta
    moment, moment_behind = (
        p.torque_N_m * math.cos(p.order * t - p.phase_rad) for p, t in ((own.parameters, theta), (behind, -theta))
    )
    assert moment_behind == pytest.approx(-moment)


@pytest.mark.parametrize(
    ("name", "behind"),
    [
        ("discovered_slider_force", "a*(-theta)*v + b*exp((-w)*x)"),
        ("discovered_crank_torque", "-(a*(-theta)*v + b*exp((-w)*x))"),
    ],
)
def test_a_formula_has_the_angle_and_the_speed_of_the_crank_turned_and_a_torque_as_a_whole(name, behind):
    parameters = {"formula": "a*theta*v + b*exp(w*x)", "coefficients": {"a": 1.0, "b": 2.0}}
    (own,) = made(effects=[{"name": name, "parameters": parameters, "label": "found"}]).effects
    assert own.mirrored().parameters.formula == behind
    assert own.mirrored().parameters.coefficients == {"a": 1.0, "b": 2.0}
    assert own.mirrored().label == "found"


SIDELESS = set(EFFECTS) - {
    "speed_fluctuation",
    "crank_unbalance",
    "crank_periodic_torque",
    "crank_angle_friction",
    "slider_offset",
    "slider_force_table",
    "discovered_slider_force",
    "discovered_crank_torque",
}


@pytest.mark.parametrize("name", sorted(SIDELESS))
def test_an_effect_without_a_side_is_its_own_mirror_image(name):
    (own,) = made(effects=[example(EFFECTS[name])]).effects
    assert own.mirrored() == own
