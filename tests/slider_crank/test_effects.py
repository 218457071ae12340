"""Effects by the coordinates of a fit are the effects of a mechanism file, and every candidate does something."""

import math

import numpy as np
import pytest

from jointgap.config import EFFECTS, Mechanism
from jointgap.core.joints import PINS
from jointgap.rig.model import build_model
from jointgap.rig.simulate_run import augmented_mechanism, with_nuisances
from tests.slider_crank.rigs import campaign, mechanism, recorded, worst

FILE_EFFECTS = {
    "slider_coulomb_friction": ({"force_N": 5.0}, {"force_N": 5.0}),
    "slider_spring": (
        {"farthest_out_N_m": 120.0, "farthest_in_N_m": 80.0},
        {"stiffness_N_m": 200.0, "rest_position_m": 0.564 + 0.2 * 0.9},
    ),
    "gas_pressure": (
        {"force_N": 9.0, "dead_length_m": 0.05, "exponent": 1.3},
        {"force_N": 9.0, "dead_length_m": 0.05, "exponent": 1.3},
    ),
    "crank_unbalance": (
        {"cosine": 0.01 * math.cos(0.7), "sine": 0.01 * math.sin(0.7)},
        {"unbalance_kg_m": 0.01, "angle_rad": 0.7},
    ),
    "crank_periodic_torque": (
        {"cosine": 0.3 * math.cos(0.7), "sine": 0.3 * math.sin(0.7), "order": 12.0},
        {"torque_N_m": 0.3, "order": 12, "phase_rad": 0.7},
    ),
    "gravity": ({"acceleration_m_s2": 9.81}, {"acceleration_m_s2": 9.81}),
    "added_slider_mass": ({"mass_kg": 0.05}, {"mass_kg": 0.05}),
    "slider_offset": ({"offset_m": 0.01}, {"offset_m": 0.01}),
    "link_length_error": ({"crank_m": 1e-3, "rod_m": -2e-3}, {"crank_m": 1e-3, "rod_m": -2e-3}),
    "crank_viscous_friction": ({"damping_N_m_s": 0.01}, {"damping_N_m_s": 0.01}),
}


def chosen(model, label):
    return next(one for one in model.candidates if one.label == label)


@pytest.mark.parametrize("name", FILE_EFFECTS)
def test_an_effect_by_coordinates_is_the_effect_of_a_mechanism_file(name):
    coordinates, parameters = FILE_EFFECTS[name]
    with_it = campaign(mechanism(effects=[{"name": name, "parameters": parameters}]))
    measurements = recorded(with_it)
    model = build_model(campaign(mechanism()), measurements)
    found = model.simulate("slow", model.nominal("slow"), [(chosen(model, name), coordinates)])
    assert worst(found, {s.channel: s.value for s in model.series if s.run == "slow"}) < 1e-9
    assert chosen(model, name).parameters(coordinates) == pytest.approx(parameters)


def test_a_speed_that_fluctuates_is_phased_by_the_angles_read():
    effect = {"name": "speed_fluctuation", "parameters": {"ratio": 0.05, "order": 2, "phase_rad": 0.6}}
    measurements = recorded(campaign(mechanism(effects=[effect])))
    for one in measurements.runs.values():  # whole revolutions, so that the mean speed is that of the straight line
        one.time[:] -= one.time[0]
    model = build_model(campaign(mechanism()), measurements)
    values = {"cosine": 0.05 * math.cos(0.6), "sine": 0.05 * math.sin(0.6), "order": 2.0}
    found = model.simulate("slow", model.nominal("slow"), [(chosen(model, "speed_fluctuation"), values)])
    assert worst(found, {s.channel: s.value for s in model.series if s.run == "slow"}) < 2e-3


def test_a_harmonic_force_is_phased_by_the_clock_of_the_record():
    effect = {"name": "harmonic_force", "parameters": {"force_N": 8.0, "frequency_Hz": 7.3, "phase_rad": 0.4}}
    measurements = recorded(campaign(mechanism(effects=[effect])))
    before = 2 * 2 * math.pi / 30.0  # the two revolutions that are not recorded
    phase = 0.4 + 2 * math.pi * 7.3 * before
    model = build_model(campaign(mechanism()), measurements)
    values = {"cosine": 8.0 * math.cos(phase), "sine": -8.0 * math.sin(phase), "frequency_Hz": 7.3}
    candidate = chosen(model, "harmonic_force")
    found = model.simulate("slow", model.nominal("slow"), [(candidate, values)])
    assert worst(found, {s.channel: s.value for s in model.series if s.run == "slow"}) < 1e-9
    stated = candidate.parameters(values)
    assert stated["force_N"] == pytest.approx(8.0)
    assert math.cos(stated["phase_rad"] - phase) == pytest.approx(1.0)


@pytest.mark.parametrize("loose", [(), PINS], ids=["ideal", "loose"])
def test_every_candidate_changes_something_and_nothing_at_zero_size(loose):
    effects = [{"name": "gravity", "parameters": {}}]  # so that an unbalance is seen
    model = build_model(campaign(mechanism(loose, effects=effects), speeds=(30.0, 31.0)))
    values = model.nominal("slow")
    base = model.simulate("slow", values)
    labels = [one.label for one in model.candidates]
    assert len(set(labels)) == len(labels)
    for candidate in model.candidates:
        shapes = dict(candidate.initial_guesses[0])
        sizes = {p.name: p.step for p in candidate.coordinates_in(("slow",)) if p.key in candidate.amplitudes}
        absent = shapes | dict.fromkeys(sizes, 0.0)
        assert worst(model.simulate("slow", values, [(candidate, absent)]), base) == 0.0, candidate.label
        for name, step in sizes.items():
            assert worst(model.simulate("slow", values, [(candidate, absent | {name: step})]), base) > 1e-6, (
                candidate.label
            )


def test_every_physical_effect_of_the_catalogue_is_a_candidate_where_it_can_act_or_the_family_of_some():
    shared = {"joint_friction": [0.05, 0.15], "restitution": [0.3, 0.9]}
    own = {"restitution_crank_pin": [0.3, 0.9]}
    loose = [build_model(campaign(mechanism(PINS), nuisance=each, speeds=(30.0, 31.0))) for each in (shared, own)]
    candidates = [one for model in loose for one in model.candidates if not one.sensor]
    families = {(family.law.name, one.name): family.own for one in candidates for family in one.families}
    shapes = {(law.NAME, name): shape for law in EFFECTS.values() for name, shape in law.MEMBERS.items()}
    assert families == shapes
    names, laws = {one.name for one in candidates}, {law for law, _ in families}
    assert not names & laws
    measured_load = {"slider_force_table"}  # is known, and not searched for
    assert names | laws == {name for name in EFFECTS if not name.startswith("discovered")} - measured_load


def test_what_cannot_act_is_no_candidate():
    content = mechanism(effects=[{"name": "gravity", "parameters": {}}])
    content["joints"]["crank_pivot"] = "ideal"
    model = build_model(campaign(content, ["time", "crank_torque"], run={"first_angle": 0.0}))
    labels = {one.label for one in model.candidates}
    assert not labels & {"gravity", "crank_pivot_clearance", "lubricated_joint:crank_pin", "encoder_offset"}
    assert {label for label in labels if label.startswith("sensor")} == {
        f"sensor_{fault}:crank_torque" for fault in ("bias", "gain", "lag", "delay")
    }


def test_what_a_mechanism_file_refuses_is_no_candidate():
    rod = {"length": 0.564, "mass": 0.773, "inertia": 1e-2, "mass_centre": 0.19}
    labels = {one.label for one in build_model(campaign(mechanism(rod=rod))).candidates}
    middle = {one.label for one in build_model(campaign(mechanism())).candidates}
    assert middle - labels == {"rod_flexibility"}


def test_nuisances_are_the_mechanisms_data():
    own = campaign(
        mechanism(PINS),
        nuisance={
            "slider_mass": "5 %",
            "rod_length": "1 %",
            "piston_pin_clearance": [2e-4, 6e-4],
            "joint_friction": [0.0, 0.2],
            "restitution_crank_pin": [0.3, 0.9],
        },
        speeds=(30.0, 31.0),
    )
    other = {
        "slider_mass": 0.46,
        "rod_length": 0.566,
        "piston_pin_clearance": 4e-4,
        "joint_friction": 0.07,
        "restitution_crank_pin": 0.6,
    }
    made = augmented_mechanism(own.mechanism, (), other)
    assert made.slider.mass == 0.46
    assert made.rod.length == 0.566
    assert made.clearance("piston_pin") == pytest.approx(4e-4)
    assert made.joint("crank_pin").contact.friction == made.joint("piston_pin").contact.friction == 0.07
    assert made.joint("crank_pin").contact.restitution == 0.6
    assert made.joint("piston_pin").contact.restitution == 0.46
    model, again = build_model(own), build_model(own.model_copy(update={"mechanism": made, "nuisance": {}}))
    found = model.simulate("slow", model.nominal("slow") | other)
    assert worst(found, again.simulate("slow", again.nominal("slow"))) < 1e-9


def test_an_effect_that_is_a_nuisances_own_parameter_replaces_it():
    own = campaign(
        mechanism(PINS),
        nuisance={
            "slider_mass": "5 %",
            "crank_pin_clearance": "20 %",
            "joint_friction": [0.0, 0.2],
            "restitution": [0.3, 0.9],
        },
        speeds=(30.0, 31.0),
    )
    replaces = {one.label: one.replaces for one in build_model(own).candidates if one.replaces}
    assert replaces == {
        "added_slider_mass": {"slider_mass": "mass_kg"},
        "crank_pin_clearance": {"crank_pin_clearance": "change_m"},
        "pin_friction:crank_pin": {"joint_friction": "change"},
        "pin_friction:piston_pin": {"joint_friction": "change"},
        "common_pin_friction": {"joint_friction": "change"},
        "common_pin_restitution": {"restitution": "change"},
    }


def test_a_loose_joint_is_searched_from_half_to_three_times_its_clearance_but_within_what_it_can_have():
    own = campaign(mechanism(("piston_pin",)))
    nominal = own.mechanism.clearance("piston_pin")
    model = build_model(own)
    candidate, ideal = (chosen(model, f"{pin}_clearance") for pin in ("piston_pin", "crank_pin"))
    assert candidate.search_range == pytest.approx((-0.5 * nominal, 2.0 * nominal))
    assert candidate.vanishing_amplitude == pytest.approx(-0.95 * nominal)
    assert ideal.vanishing_amplitude == 0.0 < ideal.search_range[0]
    crank = own.mechanism.crank.model_copy(update={"length": nominal / 0.05, "mass_centre": 0.0, "inertia": 1e-6})
    own = own.model_copy(update={"mechanism": own.mechanism.model_copy(update={"crank": crank})})
    assert chosen(build_model(own), "piston_pin_clearance").search_range == pytest.approx((-0.5 * nominal, nominal))


def test_what_both_pins_share_beyond_its_range_is_one_effect_of_both():
    nuisance = {"joint_friction": [0.05, 0.15], "restitution": [0.3, 0.9]}
    own = campaign(mechanism(PINS), nuisance=nuisance, speeds=(30.0, 31.0))
    model = build_model(own)
    effects = [("common_pin_friction", "friction", 0.2), ("common_pin_restitution", "restitution", -0.21)]
    for name, key, change in effects:
        candidate = chosen(model, name)
        made = augmented_mechanism(own.mechanism, (candidate,), {f"{name}.change": change})
        contacts = [made.applied().joint(pin).contact for pin in PINS]
        nominal = getattr(own.mechanism.joint("crank_pin").contact, key)
        assert [getattr(contact, key) for contact in contacts] == pytest.approx([nominal + change] * 2)
        assert candidate.parameters({"change": change}) == pytest.approx({"coefficient": nominal + change})


def test_of_one_loose_pin_the_restitution_beyond_its_range_is_an_effect_of_that_pin():
    own = campaign(mechanism(("piston_pin",)), nuisance={"restitution": [0.3, 0.9]}, speeds=(30.0, 31.0))
    labels = {one.label for one in build_model(own).candidates if "restitution" in one.replaces}
    assert labels == {"pin_restitution:piston_pin"}


def test_friction_in_one_pin_leaves_the_nuisance_to_the_other():
    own = campaign(mechanism(PINS), nuisance={"joint_friction": [0.0, 0.3]}, speeds=(30.0, 31.0))
    candidate = chosen(build_model(own), "pin_friction:crank_pin")
    values = {"pin_friction:crank_pin.change": 0.1, "pin_friction:crank_pin.joint_friction": 0.15}
    made = augmented_mechanism(own.mechanism, (candidate,), values).applied()
    assert made.joint("crank_pin").contact.friction == pytest.approx(0.2)
    assert made.joint("piston_pin").contact.friction == pytest.approx(0.15)


def test_the_file_has_the_effects_and_can_be_read_again():
    model = build_model(campaign(mechanism(), nuisance={"slider_mass": "5 %"}))
    explanation = tuple(chosen(model, name) for name in ("slider_spring", "gravity", "sensor_bias:crank_torque"))
    values = {
        "slider_mass": 0.46,
        "speed@slow": 29.0,
        "slider_spring.farthest_out_N_m": 50.0,
        "slider_spring.farthest_in_N_m": 50.0,
        "gravity.acceleration_m_s2": 9.8,
        "sensor_bias:crank_torque.bias": 0.1,
    }
    made = augmented_mechanism(model.campaign.mechanism, explanation, values)
    assert [effect.name for effect in made.effects] == ["slider_spring", "gravity"]
    assert Mechanism.model_validate(made.model_dump()) == made
    assert with_nuisances(made, {}) == made


def test_numerics_that_are_as_good_hardly_differ():
    model = build_model(campaign(mechanism(PINS), speeds=(30.0, 31.0)))
    values = model.nominal("slow")
    base = model.simulate("slow", values)
    for place in range(1, len(model.numerics) + 1):
        other = model.simulate("slow", values, numerics=place)
        apart = max(np.sqrt(np.mean((other[k] - base[k]) ** 2)) / max(np.std(base[k]), 1e-3) for k in base)
        assert 0.0 < apart < 0.1, model.numerics[place - 1]


def test_a_swinging_force_has_a_phase_of_its_own_in_each_run():
    model = build_model(campaign(mechanism(), speeds=(30.0, 31.0)))
    candidate = chosen(model, "harmonic_force")
    assert [p.key for p in candidate.coordinates_in(("slow",))] == ["cosine@slow", "sine@slow", "frequency_Hz"]
    stated = candidate.parameters(
        {"cosine@slow": 3.0, "sine@slow": 0.0, "cosine@fast": 0.0, "sine@fast": -3.0, "frequency_Hz": 7.3}
    )
    assert stated == {"force_N": pytest.approx(3.0), "frequency_Hz": 7.3, "phase_rad": 0.0}
