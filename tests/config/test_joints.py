"""Each joint is ideal or loose over the same data, with contacts and friction laws that say what they need."""

import math
import re

import pytest

from jointgap.config import Scenario, hertz_stiffness, parse_options, validate
from jointgap.core.errors import InputError
from tests.config.mechanisms import PIVOT, effect, mechanism, paper, with_contact

PENALTY = {"law": "penalty", "restitution": None, "penalty_damping": 1e3, "penalty_depth": "0.1 mm"}


def test_the_papers_mechanism_has_two_loose_joints_and_an_ideal_pivot():
    assert paper().loose == ("crank_pin", "piston_pin")
    assert not paper().joint("crank_pivot").loose
    assert paper().clearance("crank_pivot") == 0.0
    assert paper().clearance("piston_pin") == pytest.approx(1e-3, rel=1e-12)


def test_one_switch_makes_a_joint_ideal_over_the_same_data():
    switched = mechanism(joints={"crank_pin": {"loose": False}})
    assert switched.loose == ("piston_pin",)
    assert switched.clearance("crank_pin") == 0.0
    assert switched.joint("crank_pin").bearing_radius == paper().joint("crank_pin").bearing_radius


@pytest.mark.parametrize("pivot", [True, False])
@pytest.mark.parametrize("crank_pin", [True, False])
@pytest.mark.parametrize("piston_pin", [True, False])
def test_any_subset_of_the_joints_can_be_loose(pivot, crank_pin, piston_pin):
    switches = {"crank_pivot": pivot, "crank_pin": crank_pin, "piston_pin": piston_pin}
    made = mechanism(
        joints={"crank_pivot": PIVOT | {"loose": True}}
        | {name: {"loose": loose} for name, loose in switches.items() if name != "crank_pivot"}
        | ({"crank_pivot": PIVOT | {"loose": pivot}})
    )
    assert made.loose == tuple(name for name, loose in switches.items() if loose)


def test_the_bare_word_ideal_needs_no_data():
    bare = mechanism(joints={"crank_pin": "ideal", "piston_pin": "ideal"})
    assert bare.loose == ()
    assert bare.joint("crank_pin") is None


def test_joints_survive_the_command_line():
    made = mechanism(joints={"crank_pivot": PIVOT, "crank_pin": "ideal", "piston_pin": {"loose": False}})
    scenario = validate(Scenario, {"mechanism": made.model_dump()}, "mine")
    assert parse_options(scenario.model_dump_json(include={"mechanism"})).mechanism == made


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        ({"crank_pin": "idela"}, ["joints.crank_pin = 'idela'", "'ideal' or a mapping"]),
        ({"crank_pivot": PIVOT | {"journal": "rod"}}, ["joints.crank_pivot", "'frame' or 'crank'"]),
        ({"crank_pivot": PIVOT | {"contact": "brass"}}, ["joints: crank_pivot.contact names 'brass'"]),
        ({"crank_pivot": {"journal_radius": None}}, ["joints.crank_pivot.journal_radius"]),
        ({"crank_pin": {"lose": False}}, ["joints.crank_pin.lose", "did you mean 'loose'"]),
        ({"crank_pni": "ideal"}, ["joints.crank_pni", "did you mean 'crank_pin'"]),
    ],
)
def test_a_joint_that_makes_no_sense_is_refused(joints, words):
    with pytest.raises(InputError) as caught:
        mechanism(joints=joints)
    for word in words:
        assert word in str(caught.value)


def test_clearances_count_when_it_is_asked_whether_the_crank_can_turn():
    lengths = {"crank": {"length": "400 mm"}, "slider": {"offset": "-162.7 mm"}}  # 1.3 mm short of the rod's 564 mm
    assert mechanism(joints={"crank_pin": "ideal"}, **lengths).slider.offset < 0
    with pytest.raises(InputError, match=r"offset 0\.1627 m plus clearances 0\.002 m.*cannot turn"):
        mechanism(**lengths)
    with pytest.raises(InputError, match="cannot turn"):
        mechanism(joints={"crank_pin": "ideal", "crank_pivot": PIVOT | {"loose": True}}, **lengths)


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        ({"law": "penalty"}, ["law penalty needs penalty_damping and penalty_depth", "add them"]),
        ({"law": "penalty", "penalty_damping": 10, "penalty_depth": "1 um"}, ["does not read restitution"]),
        ({"restitution": None}, ["law lankarani_nikravesh needs restitution", "add it"]),
        ({"penalty_damping": 10}, ["does not read penalty_damping"]),
        ({"stiffness": 1e18}, ["stiffness 1e+18", "infinitely stiff", "3.16e+16 N/m^1.5 at most"]),
        ({"stiffness": 2e12, "exponent": 1}, ["infinitely stiff", "1e+12 N/m^1 at most"]),
        ({"youngs_modulus": "1e6 GPa"}, ["youngs_modulus", "10000000000000"]),
        ({"exponent": 0.5}, ["exponent = 0.5", "greater than or equal to 1"]),
        ({"exponent": 36, "stiffness": 1e10}, ["exponent = 36", "less than or equal to 10"]),
        ({"exponent": 3}, ["exponent 3 needs stiffness in N/m^3", "Hertz", "1.5 alone"]),
        ({"exponent": 1, "stiffness": None}, ["exponent 1 needs stiffness in N/m^1"]),
        ({"restitution": 1e-9}, ["restitution = 1e-09", "0.001"]),
        ({"friction_law": "columb"}, ["friction_law = 'columb'", "'coulomb'"]),
        ({"stribeck_speed": 0.1}, ["stribeck_speed is read by friction_law bengisu_akay and lugre", "not by coulomb"]),
        ({"friction_law": "lugre", "static_friction": 0.01}, ["static_friction 0.01 is less than friction 0.05"]),
        ({"friction_law": "ambrosio", "dead_band_speed": "2 mm/s"}, ["dead_band_speed 0.002", "0.001 m/s"]),
    ],
)
def test_a_contact_that_makes_no_sense_is_refused_once_with_the_mend(contact, words):
    with pytest.raises(InputError) as caught:
        with_contact(**contact)
    assert str(caught.value).startswith("mine.yaml: contacts.steel")
    assert len(str(caught.value).splitlines()) == 1
    for word in words:
        assert word in str(caught.value)


def test_a_contact_is_as_stiff_as_it_may_be_where_a_kilonewton_presses_a_nanometre():
    for exponent in (1.0, 1.5, 2.2):
        stiffest = 1e3 / 1e-9**exponent
        assert with_contact(stiffness=0.999 * stiffest, exponent=exponent)
        with pytest.raises(InputError, match="infinitely stiff"):
            with_contact(stiffness=1.001 * stiffest, exponent=exponent)


def test_a_contact_that_the_loads_would_press_in_by_half_the_journal_is_refused_with_the_least_value():
    radius, speed = paper().joint("crank_pin").journal_radius, 60.0
    load = (0.773 + 0.4482) * 0.15 * speed**2 * (1 + 0.15 / 0.564)  # rod and slider at the outer dead centre
    for exponent in (1.0, 1.5, 10.0):
        softest = load / (radius / 2) ** exponent
        with_contact(stiffness=1.001 * softest, exponent=exponent).check_contacts(speed)
        with pytest.raises(InputError, match=r"joints\.crank_pin: contact\.stiffness .* too soft.*journal_radius"):
            with_contact(stiffness=0.999 * softest, exponent=exponent).check_contacts(speed)
    with pytest.raises(InputError, match=r"joints\.crank_pin: contact\.youngs_modulus 10000 Pa is too soft") as caught:
        with_contact(youngs_modulus="10 kPa").check_contacts(speed)
    least = float(re.search(r"joints\.crank_pin.*give (\S+) Pa at least", str(caught.value)).group(1))
    joint = with_contact(youngs_modulus=1.01 * least).joint("crank_pin")
    assert hertz_stiffness(joint) * (radius / 2) ** 1.5 == pytest.approx(load, rel=0.02)


@pytest.mark.parametrize(
    "load",
    [
        effect("slider_constant_force", force_N=-5e4),
        effect("gas_pressure", force_N=500.0, dead_length_m=0.005, exponent=1.3),  # 100 times as much at the end
    ],
)
def test_soft_contacts_are_judged_at_the_loads_of_the_mechanism(load):
    """Rubber, 10 MPa: firm enough for what turns slowly and carries nothing."""
    rubber = {"steel": {"youngs_modulus": "10 MPa"}}
    slow, fast = ({"simulate": {"speed": f"{rpm} rpm"}} for rpm in (60, 3000))
    unloaded, loaded = mechanism(contacts=rubber), mechanism(load, contacts=rubber)
    assert validate(Scenario, slow | {"mechanism": unloaded.model_dump()}, "mine")
    for simulate, made in ((fast, unloaded), (slow, loaded)):
        with pytest.raises(InputError, match=r"mechanism\.joints\.crank_pin: contact\.youngs_modulus .* too soft"):
            validate(Scenario, simulate | {"mechanism": made.model_dump()}, "mine")


def test_an_ideal_joint_may_have_data_of_a_soft_contact():
    joints = {name: {"loose": False} for name in ("crank_pin", "piston_pin")}
    assert mechanism(contacts={"steel": {"stiffness": 1.0}}, joints=joints).loose == ()


def test_the_penalty_form_needs_no_restitution():
    made = with_contact(law="penalty", restitution=None, penalty_damping="1 N*s/mm", penalty_depth="1 um")
    assert made.joint("crank_pin").contact.penalty_damping == pytest.approx(1e3)
    assert made.joint("crank_pin").contact.penalty_depth == pytest.approx(1e-6)


def test_friction_laws_fill_in_what_is_left_out():
    given = with_contact(friction_law="lugre").joint("crank_pin").contact.friction_parameters()
    assert given["static_friction"] == given["friction"] == 0.05
    assert given["stribeck_speed"] == 0.01
    assert given["viscous_friction"] == 0.0
    pressed, mass = 1e3, 0.1  # critical damping of this mass on bristles under this force
    stiffness, damping = pressed * given["bristle_stiffness"], pressed * given["bristle_damping"]
    assert damping == pytest.approx(2 * math.sqrt(stiffness * mass), rel=1e-12)
    ambrosio = with_contact(friction_law="ambrosio", friction_speed="5 mm/s").joint("crank_pin").contact
    assert ambrosio.friction_parameters()["dead_band_speed"] == pytest.approx(5e-4)


def test_what_is_given_for_a_friction_law_is_taken():
    keys = {
        "static_friction": 0.2,
        "stribeck_speed": 0.02,
        "viscous_friction": 0.3,
        "bristle_stiffness": 4e5,
        "bristle_damping": 0.0,
    }
    given = with_contact(friction_law="lugre", **keys).joint("crank_pin").contact.friction_parameters()
    assert {key: given[key] for key in keys} == keys


def test_a_contact_forgets_the_impact_that_it_began_with_unless_it_is_as_published():
    assert with_contact().joint("crank_pin").contact.reference_speed == 0.05
    assert with_contact(memory="fading").joint("crank_pin").contact.reference_speed == 0.05
    faster = with_contact(reference_approach_speed="20 cm/s").joint("crank_pin").contact
    assert faster.reference_speed == pytest.approx(0.2)
    assert with_contact(memory="published").joint("crank_pin").contact.reference_speed is None
    assert with_contact(**PENALTY).joint("crank_pin").contact.reference_speed is None


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"memory": "published", "reference_approach_speed": 0.1}, "memory published does not read reference_approach"),
        ({"memory": "fading"} | PENALTY, "law penalty does not read memory"),
        ({"reference_approach_speed": 0.1} | PENALTY, "law penalty does not read reference_approach_speed"),
        ({"memory": "fade"}, "'fading' or 'published'"),
        ({"reference_approach_speed": 0}, "reference_approach_speed"),
    ],
)
def test_keys_of_memory_that_contradict_each_other_are_refused(keys, words):
    with pytest.raises(InputError, match=re.escape(words)):
        with_contact(**keys)
