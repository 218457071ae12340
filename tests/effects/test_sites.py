"""Effects of any linkage: one law at each of its sites, by a name that follows from the site."""

import copy
import math
import pickle

import numpy as np
import pytest

from jointgap.config import Simulate, load_mechanism, read_yaml, shipped_mechanisms
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import validate
from jointgap.core.errors import InputError
from jointgap.core.formula import compile_formula
from jointgap.core.sites import SLIDER_CRANK
from jointgap.effects import EFFECTS, effects_of
from jointgap.effects.base import example
from jointgap.linkage.laws import evaluate
from jointgap.motion.linkage import simulate_linkage
from tests.config.mechanisms import effect

OF_SLIDER_CRANK = """
    gravity slider_coulomb_friction slider_stribeck_friction slider_position_friction
    slider_viscous_friction slider_quadratic_drag slider_power_drag slider_load_friction
    slider_constant_force slider_spring slider_nonlinear_spring gas_pressure slider_force_table
    harmonic_force pin_friction common_pin_friction pin_restitution common_pin_restitution
    crank_coulomb_friction crank_angle_friction crank_viscous_friction crank_brake
    crank_periodic_torque crank_unbalance added_slider_mass speed_fluctuation slider_offset
    link_length_error crank_pivot_clearance crank_pin_clearance piston_pin_clearance
    rod_flexibility lubricated_joint discovered_slider_force discovered_crank_torque
"""
EVERYWHERE = """
    gravity pin_friction common_pin_friction pin_restitution common_pin_restitution crank_brake
    crank_periodic_torque crank_unbalance speed_fluctuation link_length_error lubricated_joint
"""
AT_PIVOT = "{}_coulomb_friction {}_angle_friction {}_viscous_friction discovered_{}_torque"
ON_SLIDE = """
    {}_coulomb_friction {}_stribeck_friction {}_position_friction {}_viscous_friction
    {}_quadratic_drag {}_power_drag {}_load_friction {}_constant_force {}_spring
    {}_nonlinear_spring {}_gas_pressure {}_force_table {}_harmonic_force {}_offset
    discovered_{}_force
"""
ON_TRACK = "{}_coulomb_friction {}_viscous_friction"
RULES = {
    "four_bar": {
        AT_PIVOT: ("crank", "rocker"),
        "added_{}_mass": ("coupler", "rocker"),
        "{}_clearance": "OABC",
    },
    "quick_return": {
        AT_PIVOT: ("crank", "rocker"),
        ON_SLIDE: ("ram",),
        ON_TRACK: ("track",),
        "added_{}_mass": ("block", "rocker", "rod", "ram"),
        "{}_clearance": "OABCD",
    },
    "six_bar": {
        AT_PIVOT: ("crank", "rocker", "output"),
        "added_{}_mass": ("coupler", "rocker", "link", "output"),
        "{}_clearance": "OABCDEF",
    },
}
FOUR_BAR, QUICK_RETURN, SIX_BAR = (load_mechanism(name) for name in RULES)
SITES = {"slider_crank": SLIDER_CRANK} | {name: load_mechanism(name).sites for name in RULES}
PLACED = [
    pytest.param(each, id=f"{name}-{each.NAME}")
    for name, sites in SITES.items()
    for each in effects_of(sites).values()
]
SPEED, AT = 10.0 * math.pi, (0.7, -0.3, 12.0, 2.1, 0.4)
OPTIONS = Simulate(speed=SPEED, revolutions=1, samples_per_revolution=60)


def content(name, *effects):
    """A shipped linkage's file, with bearing data at all of its joints."""
    data = copy.deepcopy(read_yaml(shipped_mechanisms()[name]))
    for joint, (one, _) in load_mechanism(name).shared_by_two.items():
        radii = {"journal_radius": "9.9 mm", "bearing_radius": "10 mm"}
        ideal = {"loose": False, "journal": one, "contact": "steel"} | radii
        data["joints"].setdefault(joint, ideal)
    return data | {"effects": list(effects)}


def linkage(name, *effects):
    return validate(LinkageFile, content(name, *effects), f"{name}.yaml")


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A load of one revolution."""
    file = tmp_path_factory.mktemp("tables") / "load.csv"
    rows = (f"{angle},{100.0 * math.cos(math.radians(angle))}\n" for angle in range(0, 361, 10))
    file.write_text("angle,force\n" + "".join(rows), encoding="utf-8")
    return file


def entry(placed, table, loose=()):
    """An example entry, of a contact's effect at a `loose` joint."""
    made = example(placed)
    if "site" in made and loose:
        made["site"] = loose[0]
    if placed.LAW_NAME.startswith("discovered"):
        made["parameters"] = {"formula": "-2*v + 3*sin(theta)"}
    if placed.LAW_NAME == "force_table":
        columns = {"angle": ("angle", "deg"), "force": ("force", "N")}
        named = {key: {"column": column, "unit": unit} for key, (column, unit) in columns.items()}
        made["parameters"] = {"file": str(table)} | named
    return made


def test_names_at_a_slider_crank_are_those_of_its_files():
    assert list(EFFECTS) == OF_SLIDER_CRANK.split()
    assert effects_of(SLIDER_CRANK) == EFFECTS


@pytest.mark.parametrize("name", RULES)
def test_names_at_another_linkage_follow_from_its_bodies_and_joints(name):
    rules = [(rule, site) for rule, sites in RULES[name].items() for site in sites]
    named = {each for rule, site in rules for each in rule.replace("{}", site).split()}
    assert {*effects_of(load_mechanism(name).sites)} == named | {*EVERYWHERE.split()}


@pytest.mark.parametrize("placed", PLACED)
def test_texts_of_an_effect_name_its_site(placed):
    words = placed.WORDS.replace("{site}", "") if placed.PLACES else placed.WORDS
    for text in (placed.__doc__, placed.LAW, placed.SITE, words):
        assert "{" not in text


@pytest.mark.parametrize("placed", PLACED)
def test_an_effect_is_the_same_after_pickling(placed, table):
    made = placed.model_validate(entry(placed, table))
    again = pickle.loads(pickle.dumps(made))
    assert again == made and type(again) is type(made)
    parameters = pickle.loads(pickle.dumps(made.parameters))
    assert parameters == made.parameters and type(parameters) is type(made.parameters)
    assert made == placed.model_validate(made.model_dump())


@pytest.mark.parametrize("placed", PLACED)
def test_a_mirrored_effect_mirrored_again_is_the_effect(placed, table):
    made = placed.model_validate(entry(placed, table))
    again = made.mirrored().mirrored()
    if placed.LAW_NAME.startswith("discovered"):
        values = []
        for each in (made, again):
            program = compile_formula(each.parameters.formula, {})
            values.append(evaluate(program.codes, program.numbers, *AT))
        assert values[0] == values[1] != 0.0
        return
    parameters = again.parameters.model_dump()
    expected = made.parameters.model_dump()
    numbers = {key for key, value in expected.items() if type(value) is float}
    for key in numbers:
        assert parameters[key] == pytest.approx(expected[key], abs=1e-15)
    assert {**parameters, **{key: expected[key] for key in numbers}} == expected


@pytest.mark.parametrize("given", [FOUR_BAR, QUICK_RETURN, SIX_BAR])
def test_a_mirrored_linkage_has_the_same_sites(given):
    assert given.mirrored().sites == given.sites


@pytest.mark.parametrize(
    "name, wrong, near",
    [
        ("four_bar", "roker_viscous_friction", "rocker_viscous_friction"),
        ("four_bar", "A_clearence", "A_clearance"),
        ("quick_return", "ram_visous_friction", "ram_viscous_friction"),
        ("quick_return", "trak_coulomb_friction", "track_coulomb_friction"),
        ("six_bar", "output_coulomb_fricton", "output_coulomb_friction"),
    ],
)
def test_a_wrong_name_is_one_error_with_the_near_name(name, wrong, near):
    with pytest.raises(InputError) as error:
        linkage(name, effect(wrong, force_N=1.0))
    text = str(error.value)
    assert f"'{wrong}': no such effect of this linkage; did you mean '{near}'" in text
    assert text.count(wrong) <= 2 and "\n" not in text  # the entry and the name


def test_an_unknown_parameter_of_an_effect_is_an_error_with_the_near_one():
    with pytest.raises(InputError, match=r"rocker_viscous_friction: .*did you mean.*damping_N_m_s"):
        linkage("four_bar", effect("rocker_viscous_friction", damping_N_m=0.1))
    with pytest.raises(InputError, match=r"rocker_viscous_friction: .*damping_N_m_s = -0.1"):
        linkage("four_bar", effect("rocker_viscous_friction", damping_N_m_s=-0.1))


def test_the_same_effect_twice_at_one_site_is_an_error():
    rubbing = effect("rocker_coulomb_friction", torque_N_m=0.1)
    with pytest.raises(InputError, match="rocker_coulomb_friction at C is listed more than once"):
        linkage("four_bar", rubbing, rubbing)


def test_effects_of_another_kind_of_mechanism_are_refused():
    for name in ("slider_viscous_friction", "rod_flexibility", "crank_pin_clearance"):
        with pytest.raises(InputError, match=f"'{name}': no such effect of this linkage"):
            linkage("four_bar", effect(name))


TWO_RAMS = {
    "frame": {"points": {"O": ["0 mm", "0 mm"]}},
    "bodies": {
        "crank": {
            "points": {"O": ["0 mm", "0 mm"], "A": ["50 mm", "0 mm"], "B": ["-50 mm", "0 mm"]},
            "mass": "1 kg",
            "inertia": "1e-3 kg*m^2",
        },
        **{
            rod: {
                "length": "200 mm",
                "ends": ends,
                "mass": "0.5 kg",
                "inertia": "2e-3 kg*m^2",
                "mass_centre": "80 mm",
                "angle": angle,
            }
            for rod, ends, angle in (
                ("right_rod", ["A", "C"], "0 deg"),
                ("left_rod", ["B", "D"], "180 deg"),
            )
        },
        "right": {"points": {"C": ["0 mm", "0 mm"]}, "mass": "1 kg"},
        "left": {"points": {"D": ["0 mm", "0 mm"]}, "mass": "1 kg"},
    },
    "joints": {
        "guide": {"slide": ["frame", "right"]},
        "other_guide": {"slide": ["frame", "left"], "direction": "180 deg"},
    },
    "drive": "O",
}
"""Two opposed sliders on one crank."""


def two_rams(*effects):
    return validate(LinkageFile, TWO_RAMS | {"effects": list(effects)}, "boxer.yaml")


def test_force_tables_on_different_bodies_are_refused_and_two_on_one_body_add_up(table):
    placed = effects_of(two_rams().sites)
    right, left = (entry(placed[f"{body}_force_table"], table) for body in ("right", "left"))
    with pytest.raises(InputError, match="right and left have force tables; only one body can"):
        two_rams(right, left)
    torques = [
        simulate_linkage(two_rams(*each), OPTIONS).samples["crank_torque"]
        for each in ((), (right,), (right, right))
    ]
    once, twice = torques[1] - torques[0], torques[2] - torques[0]
    np.testing.assert_allclose(twice, 2.0 * once, atol=1e-9 * np.abs(twice).max())
    assert np.abs(once).max() > 1.0


def test_a_force_table_may_have_unevenly_spaced_rows(tmp_path):
    torques = []
    for name, angles in (
        ("even", range(0, 361, 5)),
        ("dense_at_end", [*range(0, 270, 5), *range(270, 361)]),
        ("dense_at_begin", [*range(90), *range(90, 361, 5)]),
    ):
        file = tmp_path / f"{name}.csv"
        rows = (f"{angle},{100.0 * math.cos(math.radians(angle))}\n" for angle in angles)
        file.write_text("angle,force\n" + "".join(rows), encoding="utf-8")
        law = entry(effects_of(two_rams().sites)["right_force_table"], file)
        torques.append(simulate_linkage(two_rams(law), OPTIONS).samples["crank_torque"].to_numpy())
    np.testing.assert_allclose(torques[1:], [torques[0]] * 2, atol=1e-3)


def test_laws_act_at_each_of_two_slides_and_are_those_of_the_own_body():
    """Opposed sliders move alike: the same law costs the same torque on either side."""
    torques = {}
    for bodies in ((), ("right",), ("left",), ("right", "left")):
        laws = [effect(f"{body}_viscous_friction", damping_N_s_m=20.0) for body in bodies]
        laws += [effect(f"discovered_{body}_force", formula="-30*v*|v|") for body in bodies]
        torques[bodies] = simulate_linkage(two_rams(*laws), OPTIONS).samples["crank_torque"]
    right, left, both = (
        (torques[bodies] - torques[()]).to_numpy()
        for bodies in (("right",), ("left",), ("right", "left"))
    )
    np.testing.assert_allclose(right, left, atol=1e-10)
    np.testing.assert_allclose(both, right + left, atol=1e-10)
    assert np.abs(right).max() > 0.5


@pytest.fixture(scope="module")
def plain():
    """Samples of the shipped linkages without effects."""
    return {name: simulate_linkage(linkage(name), OPTIONS).samples for name in RULES}


EVERY = [(name, law) for name in RULES for law in effects_of(load_mechanism(name).sites)]


@pytest.mark.parametrize("name, law", EVERY)
def test_every_effect_of_every_shipped_linkage_acts_as_in_its_example(name, law, plain, table):
    given = linkage(name)
    listed = entry(effects_of(given.sites)[law], table, tuple(given.loose_pins))
    samples = simulate_linkage(linkage(name, listed), OPTIONS).samples
    numbers = plain[name].select_dtypes("number")
    assert np.isfinite(samples["crank_torque"]).all()
    changed = {
        column
        for column in numbers
        if np.abs(samples[column] - numbers[column]).max() > 1e-6 * np.abs(numbers[column]).max()
    }
    assert changed & {"crank_torque", "shaking_force_x"}


@pytest.mark.parametrize("name", RULES)
def test_pin_friction_acts_in_ideal_pins_of_moving_bodies_too(name, plain):
    given = linkage(name)
    for pin in given.sites.pins:
        rubbing = effect("pin_friction", pin, coefficient=0.3)
        samples = simulate_linkage(linkage(name, rubbing), OPTIONS).samples
        assert np.abs(samples["crank_torque"] - plain[name]["crank_torque"]).max() > 1e-3


def test_pin_friction_in_an_ideal_joint_of_the_frame_is_refused_with_the_effect_to_use():
    with pytest.raises(InputError, match=r"pin_friction at O requires a loose joint.*coulomb"):
        linkage("four_bar", effect("pin_friction", "O", coefficient=0.1))
