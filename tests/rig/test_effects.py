"""Effects by the coordinates of a fit are the effects of a mechanism file, and every candidate does
something."""

import math

import pytest

from jointgap.config import EFFECTS
from jointgap.core.joints import PINS
from jointgap.rig.model import build_model
from tests.rig.rigs import campaign, chosen, mechanism, read, recorded, seen, worst

POLAR = {"cosine": 0.3 * math.cos(0.7), "sine": 0.3 * math.sin(0.7)}
STRETCH = {"farthest_out_N_m": 120.0, "farthest_in_N_m": 80.0}
NEAR = (30.0, 31.0)  # rad/s


def effect(name, **parameters):
    return {"name": name, "parameters": parameters}


@pytest.mark.parametrize(
    "made, coordinates",
    [
        (effect("slider_coulomb_friction", force_N=5.0), None),
        (effect("slider_spring", stiffness_N_m=200.0, rest_position_m=0.564 + 0.2 * 0.9), STRETCH),
        (effect("gas_pressure", force_N=9.0, dead_length_m=0.05, exponent=1.3), None),
        (effect("crank_unbalance", unbalance_kg_m=0.3, angle_rad=0.7), POLAR),
        (
            effect("crank_periodic_torque", torque_N_m=0.3, order=12, phase_rad=0.7),
            POLAR | {"order": 12.0},
        ),
        (effect("gravity", acceleration_m_s2=9.81), None),
        (effect("added_slider_mass", mass_kg=0.05), None),
        (effect("slider_offset", offset_m=0.01), None),
        (effect("link_length_error", crank_m=1e-3, rod_m=-2e-3), None),
        (effect("crank_viscous_friction", damping_N_m_s=0.01), None),
    ],
)
def test_an_effect_by_coordinates_is_the_effect_of_a_mechanism_file(made, coordinates):
    coordinates = coordinates or made["parameters"]
    model = build_model(campaign(mechanism()), recorded(campaign(mechanism(effects=[made]))))
    assert worst(read(model, (made["name"], coordinates)), seen(model)) < 1e-9
    assert chosen(model, made["name"]).parameters(coordinates) == pytest.approx(made["parameters"])


def test_a_speed_fluctuation_has_the_phase_of_the_measured_angles():
    made = effect("speed_fluctuation", ratio=0.05, order=2, phase_rad=0.6)
    measurements = recorded(campaign(mechanism(effects=[made])))
    # whole revolutions, so that the mean speed is that of the straight line
    for item in measurements.runs.values():
        item.time[:] -= item.time[0]
    model = build_model(campaign(mechanism()), measurements)
    values = {"cosine": 0.05 * math.cos(0.6), "sine": 0.05 * math.sin(0.6), "order": 2.0}
    assert worst(read(model, (made["name"], values)), seen(model)) < 2e-3


def test_a_harmonic_force_has_its_phase_in_the_time_of_each_record():
    made = effect("harmonic_force", force_N=8.0, frequency_Hz=7.3, phase_rad=0.4)
    model = build_model(campaign(mechanism()), recorded(campaign(mechanism(effects=[made]))))
    # after the two revolutions that are not recorded
    phase = 0.4 + math.tau * 7.3 * 2 * math.tau / 30.0
    values = {"cosine": 8.0 * math.cos(phase), "sine": -8.0 * math.sin(phase), "frequency_Hz": 7.3}
    assert worst(read(model, (made["name"], values)), seen(model)) < 1e-9
    candidate = chosen(model, made["name"])
    stated = candidate.parameters(values)
    assert stated["force_N"] == pytest.approx(8.0)
    assert math.cos(stated["phase_rad"] - phase) == pytest.approx(1.0)
    assert [p.key for p in candidate.coordinates_in(("slow",))] == [
        "cosine@slow",
        "sine@slow",
        "frequency_Hz",
    ]
    of_runs = {
        "cosine@slow": 3.0,
        "sine@slow": 0.0,
        "cosine@fast": 0.0,
        "sine@fast": -3.0,
        "frequency_Hz": 7.3,
    }
    # the parts refer to the middle of each record, where they do not depend on the frequency
    turned = math.tau * 7.3 * candidate.middles["slow"]
    stated = candidate.parameters(of_runs)
    assert (stated["force_N"], stated["frequency_Hz"]) == (pytest.approx(3.0), 7.3)
    assert math.cos(stated["phase_rad"] + turned) == pytest.approx(1.0)


@pytest.mark.parametrize("loose", [(), PINS])
def test_each_candidate_changes_the_readings_unless_its_size_is_zero(loose):
    model = build_model(campaign(mechanism(loose, effects=[effect("gravity")]), speeds=NEAR))
    values, base = model.nominal("slow"), read(model)
    assert len({item.label for item in model.candidates}) == len(model.candidates)
    for candidate in model.candidates:
        sizes = {
            p.name: p.step
            for p in candidate.coordinates_in(("slow",))
            if p.key in candidate.amplitudes
        }
        absent = dict(candidate.initial_guesses[0]) | dict.fromkeys(sizes, 0.0)
        assert worst(model.simulate("slow", values, [(candidate, absent)]), base) == 0.0, (
            candidate.label
        )
        for name, step in sizes.items():
            result = model.simulate("slow", values, [(candidate, absent | {name: step})])
            assert worst(result, base) > 1e-6, candidate.label


def test_each_physical_effect_is_a_candidate_or_the_family_of_candidates():
    shared = {"joint_friction": [0.05, 0.15], "restitution": [0.3, 0.9]}
    own = {"restitution_crank_pin": [0.3, 0.9]}
    loose = [
        build_model(campaign(mechanism(PINS), nuisance=item, speeds=NEAR)) for item in (shared, own)
    ]
    candidates = [item for model in loose for item in model.candidates if not item.sensor]
    families = {
        (family.law.name, item.name): family.effect_shape
        for item in candidates
        for family in item.families
    }
    assert families == {
        (law.NAME, name): shape for law in EFFECTS.values() for name, shape in law.MEMBERS.items()
    }
    names, laws = {item.name for item in candidates}, {law for law, _ in families}
    assert not names & laws
    known = {"slider_force_table", "crank_brake"}  # measured or stated loads are not searched for
    assert names | laws == {name for name in EFFECTS if not name.startswith("discovered")} - known


def test_effects_that_cannot_act_are_no_candidates():
    content = mechanism(effects=[effect("gravity")])
    content["joints"]["crank_pivot"] = "ideal"
    model = build_model(campaign(content, ["time", "crank_torque"], run={"first_angle": 0.0}))
    labels = {item.label for item in model.candidates}
    assert not labels & {
        "gravity",
        "crank_pivot_clearance",
        "lubricated_joint:crank_pin",
        "encoder_offset",
    }
    assert {label for label in labels if label.startswith("sensor")} == {
        f"sensor_{fault}:crank_torque" for fault in ("bias", "gain", "lag", "delay", "high_pass")
    }
    rod = {"length": 0.564, "mass": 0.773, "inertia": 1e-2, "mass_centre": 0.19}
    of_rod, of_middle = (
        {item.label for item in build_model(campaign(mechanism(**k))).candidates}
        for k in ({"rod": rod}, {})
    )
    assert of_middle - of_rod == {"rod_flexibility"}


def test_an_effect_replaces_the_nuisance_of_the_same_parameter():
    wide = {"joint_friction": [0.0, 0.2], "restitution": [0.3, 0.9]}
    data = {"slider_mass": "5 %", "crank_pin_clearance": "20 %"}

    def replaced(loose, nuisance):
        model = build_model(campaign(mechanism(loose), nuisance=nuisance, speeds=NEAR))
        return {item.label: item.replaces for item in model.candidates if item.replaces}

    assert replaced(PINS, data | wide) == {
        "added_slider_mass": {"slider_mass": "mass_kg"},
        "crank_pin_clearance": {"crank_pin_clearance": "change_m"},
        "pin_friction:crank_pin": {"joint_friction": "change"},
        "pin_friction:piston_pin": {"joint_friction": "change"},
        "common_pin_friction": {"joint_friction": "change"},
        "common_pin_restitution": {"restitution": "change"},
    }
    of_one = replaced(("piston_pin",), {"restitution": [0.3, 0.9]})
    assert [label for label, keys in of_one.items() if "restitution" in keys] == [
        "pin_restitution:piston_pin"
    ]
