"""The catalogue of effects: bounds, errors, and effects that change data of the mechanism."""

import math

import numpy as np
import pytest

from jointgap.config import EFFECTS, Scenario, parse_options, validate
from jointgap.core.errors import InputError, did_you_mean
from jointgap.effects.base import example, parameters_of
from tests.config.mechanisms import PIVOT, effect, mechanism, paper


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_can_be_listed_as_in_its_example(name):
    made = mechanism(example(EFFECTS[name]), joints={"crank_pivot": PIVOT})
    assert made.effect(name) == made.effects[0].parameters
    assert (
        EFFECTS[name].LAW
        and EFFECTS[name].REFERENCE
        and all(row.meaning for row in parameters_of(EFFECTS[name]))
    )
    scenario = validate(Scenario, {"mechanism": made.model_dump()}, "mine")
    assert parse_options(scenario.model_dump_json(include={"mechanism"})).mechanism == made


@pytest.mark.parametrize(
    "name, parameter, inside, outside",
    [
        ("gravity", "acceleration_m_s2", (0, 15), (-0.1, 15.1)),
        ("slider_coulomb_friction", "force_N", (0, 1e4), (-1,)),
        ("slider_stribeck_friction", "stribeck_share", (0, 1), (-0.1, 1.1)),
        ("slider_position_friction", "length_m", (1e-3,), (0,)),
        ("slider_power_drag", "exponent", (0, 6), (-0.1, 6.1)),
        ("slider_load_friction", "coefficient", (0, 1), (-0.1, 1.1)),
        ("slider_constant_force", "force_N", (-5, 5), ()),
        ("slider_nonlinear_spring", "cubic_share", (-0.5, 1), (-0.6, 1.1)),
        ("gas_pressure", "exponent", (1, 1.4), (0.9, 1.5)),
        ("common_pin_friction", "coefficient", (0, 0.6), (-0.1, 0.7)),
        ("pin_restitution", "coefficient", (1e-3, 0.999), (0, 1)),
        ("crank_periodic_torque", "order", (0.5, 1, 1.5, 100), (0, 101, 1.25)),
        ("speed_fluctuation", "ratio", (0, 0.3), (-0.1, 0.31)),
        ("piston_pin_clearance", "clearance_m", (0, 1e-9, 1e-4), (-1e-4, 1e-20, 0.9e-9)),
        ("rod_flexibility", "damping_ratio", (0, 0.5), (-0.1, 1)),
        ("lubricated_joint", "viscosity_Pa_s", (1e-3,), (0,)),
    ],
)
def test_parameters_have_bounds(name, parameter, inside, outside):
    entry = example(EFFECTS[name])

    def listed(value):
        return mechanism(entry | {"parameters": entry["parameters"] | {parameter: value}})

    for value in inside:
        assert getattr(listed(value).effect(name), parameter) == value
    for value in outside:
        with pytest.raises(InputError, match=f"{name}.parameters.{parameter} = {value}"):
            listed(value)


def film(**parameters):
    return effect("lubricated_joint", "crank_pin", viscosity_Pa_s=0.05, length_m=0.01, **parameters)


RUBBING = effect("pin_friction", "crank_pin", coefficient=0.1)
RUBBING_7 = effect("pin_friction", "piston_pin", coefficient=7)


@pytest.mark.parametrize(
    "effects, words",
    [
        ([effect("slidr_spring")], "effects.0.name = 'slidr_spring'.*did you mean 'slider_spring'"),
        ([{"parameters": {}}], "effects.0.name' is missing"),
        ([effect("gravity", acceleration=9)], "'effects.gravity.parameters.acceleration'; did you"),
        ([RUBBING, RUBBING_7], "pin_friction@piston_pin.par"),
        ([effect("pin_friction", coefficient=0.1)], "site' is missing"),
        ([effect("pin_friction", "crank_pivot", coefficient=0.1)], "site = 'crank_pivot'"),
        ([effect("gravity")] * 2, "gravity at all bodies is listed more than once"),
        ([RUBBING] * 2, "pin_friction at crank_pin is listed more than once"),
        ([effect("discovered_slider_force", formula="a*v")], "unknown name 'a'"),
        ([effect("added_slider_mass", mass_kg=-1)], "added_slider_mass.*mass.*greater than 0"),
        ([effect("slider_offset", offset_m=0.5)], "effects slider_offset.*cannot turn"),
        ([film(least_film_m=6e-4)], "lubricated_joint at crank_pin.*more than 0.5 of"),
        (
            [film(), effect("crank_pin_clearance", clearance_m=0)],
            "lubricated_joint at crank_pin requires a clearance",
        ),
    ],
)
def test_a_wrong_effect_is_an_error(effects, words):
    with pytest.raises(InputError, match=words):
        mechanism(*effects)


def test_an_effect_on_a_joint_requires_its_data():
    wider = effect("crank_pivot_clearance", clearance_m=1e-4)
    with pytest.raises(InputError, match="crank_pivot_clearance requires the data of crank_pivot"):
        mechanism(wider, joints={"crank_pivot": "ideal"})
    with pytest.raises(InputError, match="pin_friction at crank_pin requires the joint's journal"):
        mechanism(RUBBING, joints={"crank_pin": "ideal"})


@pytest.mark.parametrize(
    "word, x, y",
    [("down", 0, -1), ("-y", 0, -1), ("Up", 0, 1), ("left", -1, 0), ("-x", -1, 0), ("right", 1, 0)],
)
def test_the_direction_of_gravity_is_an_angle_or_a_word(word, x, y):
    gravity = effect("gravity")
    made = mechanism(gravity, gravity_direction=word)
    assert made.gravity / math.hypot(*made.gravity) == pytest.approx([x, y], abs=1e-15)
    angle = made.model_dump()["gravity_direction"]
    assert mechanism(gravity, gravity_direction=angle).gravity_direction == made.gravity_direction
    with pytest.raises(
        InputError, match=r"gravity_direction = 'along'.*angle.*-90 deg.*down.*left"
    ):
        mechanism(gravity_direction="along")


def bending(**rod):
    return mechanism(effect("rod_flexibility", frequency_Hz=250, damping_ratio=0.01), rod=rod)


def test_a_rod_bends_only_if_its_mass_centre_is_near_the_middle():
    rod = paper().rod
    # of a rod that turns, a_n = alpha (s - centre), the mode takes the projection of this on sin(pi
    # s / l), which moves the mass centre in turn: in numbers, the remaining inertia with the
    # modal coordinate free
    s = (np.arange(20_000) + 0.5) / 20_000 * rod.length
    dm, mode = rod.mass / len(s), np.sin(np.pi * s / rod.length)
    off = 0.02
    shift = np.array([[rod.mass, dm * mode.sum()], [dm * mode.sum(), dm * (mode**2).sum()]])
    coupling = np.array([0.0, dm * (mode * (s - rod.length / 2 + off)).sum()])
    taken = coupling @ np.linalg.solve(shift, coupling)
    farthest = off * math.sqrt(0.5 * rod.inertia / taken)
    for side in (-1, 1):
        assert bending(mass_centre=rod.length / 2 + side * 0.999 * farthest)
        with pytest.raises(
            InputError, match=r"rod_flexibility .*uniform beam.*rod\.mass_centre .*rod\.inertia"
        ):
            bending(mass_centre=rod.length / 2 + side * 1.001 * farthest)
    assert (
        mechanism(rod={"mass_centre": 0.1}).rod.mass_centre == 0.1
    )  # a rigid one may have it anywhere


@pytest.mark.parametrize(
    "word, name",
    {
        "gas_force": "gas_pressure",
        "drag": "slider_quadratic_drag",
        "friction": "slider_coulomb_friction",
        "cogging": "crank_periodic_torque",
        "stiction": "slider_stribeck_friction",
        "oil_film": "lubricated_joint",
        "indicator_diagram": "slider_force_table",
    }.items(),
)
def test_another_word_for_an_effect_gets_a_suggestion(word, name):
    with pytest.raises(InputError, match=f"did you mean .*'{name}'"):
        mechanism(effect(word))


def test_mass_offset_and_lengths_change_the_data():
    applied = mechanism(
        effect("added_slider_mass", mass_kg=0.05),
        effect("slider_offset", offset_m="-10 mm"),
        effect("link_length_error", crank_m="1 mm", rod_m="-4 mm"),
        effect("gravity"),
        slider={"offset": "2 mm"},
    ).applied()
    assert applied.slider.mass == pytest.approx(0.4982)
    assert applied.slider.offset == pytest.approx(-0.008)
    assert (applied.crank.length, applied.rod.length) == pytest.approx((0.151, 0.560))
    assert (applied.crank.mass_centre, applied.rod.mass_centre) == pytest.approx(
        (0.0755, 0.280)
    )  # half way, as before
    assert [one.name for one in applied.effects] == ["gravity"]
    assert applied.applied() == applied


def test_a_clearance_is_the_total_clearance_and_zero_makes_the_joint_ideal():
    applied = mechanism(
        effect("crank_pivot_clearance", clearance_m="0.2 mm"),
        effect("crank_pin_clearance", clearance_m=0),
        effect("piston_pin_clearance", clearance_m="1.5 mm"),
        joints={"crank_pivot": PIVOT | {"loose": False}},
    ).applied()
    assert applied.loose == ("crank_pivot", "piston_pin")
    assert applied.clearance("crank_pivot") == pytest.approx(2e-4)
    assert applied.clearance("piston_pin") == pytest.approx(1.5e-3)
    assert applied.joint("piston_pin").journal_radius == paper().joint("piston_pin").journal_radius


def test_friction_of_a_loose_pin_is_that_of_its_contact():
    loose, ideal = (
        effect("pin_friction", "crank_pin", coefficient=0.1),
        effect("pin_friction", "piston_pin", coefficient=0.2),
    )
    applied = mechanism(loose, ideal, joints={"piston_pin": {"loose": False}}).applied()
    assert applied.joint("crank_pin").contact.friction == 0.1
    assert applied.effect("pin_friction", "crank_pin") is None
    assert applied.effect("pin_friction", "piston_pin").coefficient == 0.2
    assert applied.joint("piston_pin").contact.friction == 0.05


def test_an_unknown_name_suggests_effects_of_that_meaning():
    suggestion = did_you_mean("dry_friction", EFFECTS)
    assert "'slider_coulomb_friction'" in suggestion and "gas_pressure" not in suggestion
