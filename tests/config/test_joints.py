"""Joints, contacts and friction laws of a mechanism file."""

import itertools
import math
import re

import pytest

from jointgap.config import hertz_stiffness
from jointgap.core.errors import InputError
from tests.config.mechanisms import PIVOT, mechanism, paper, with_contact

PENALTY = {"law": "penalty", "restitution": None, "penalty_damping": 1e3, "penalty_depth": "0.1 mm"}


def contact(**keys):
    return with_contact(**keys).joint("crank_pin").contact


@pytest.mark.parametrize("loose", list(itertools.product((True, False), repeat=3)))
def test_any_subset_of_the_joints_can_be_loose(loose):
    switches = dict(zip(("crank_pivot", "crank_pin", "piston_pin"), loose, strict=True))
    joints = {name: {"loose": switch} for name, switch in switches.items()}
    made = mechanism(joints=joints | {"crank_pivot": PIVOT | joints["crank_pivot"]})
    assert made.loose == tuple(name for name, switch in switches.items() if switch)
    assert all((made.clearance(name) > 0) == switch for name, switch in switches.items())
    assert made.joint("crank_pin").bearing_radius == paper().joint("crank_pin").bearing_radius


def test_an_ideal_joint_needs_no_data():
    bare = mechanism(joints={"crank_pin": "ideal", "piston_pin": "ideal"})
    assert bare.loose == () and bare.joint("crank_pin") is None


@pytest.mark.parametrize(
    "joints, words",
    [
        ({"crank_pin": "idela"}, "joints.crank_pin = 'idela'.*'ideal' or a mapping"),
        ({"crank_pivot": {"journal_radius": None}}, "joints.crank_pivot.journal_radius"),
        ({"crank_pin": {"lose": False}}, "joints.crank_pin.lose.*did you mean 'loose'"),
        ({"crank_pni": "ideal"}, "joints.crank_pni.*did you mean 'crank_pin'"),
        ({"crank_pivot": PIVOT | {"journal": "rod"}}, "joints.crank_pivot.*'frame' or 'crank'"),
        ({"crank_pivot": PIVOT | {"contact": "brass"}}, "contact of crank_pivot: no entry 'brass'"),
    ],
)
def test_a_wrong_joint_is_an_error(joints, words):
    with pytest.raises(InputError, match=words):
        mechanism(joints=joints)


def test_clearances_count_towards_the_length_that_lets_the_crank_turn():
    # 1.3 mm shorter than the rod's 564 mm
    lengths = {"crank": {"length": "400 mm"}, "slider": {"offset": "-162.7 mm"}}
    assert mechanism(joints={"crank_pin": "ideal"}, **lengths).slider.offset < 0
    with pytest.raises(InputError, match=r"offset 0\.1627 m plus clearances 0\.002 m.*cannot turn"):
        mechanism(**lengths)
    with pytest.raises(InputError, match="cannot turn"):
        mechanism(joints={"crank_pin": "ideal", "crank_pivot": PIVOT | {"loose": True}}, **lengths)


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"law": "penalty"}, "law penalty requires penalty_damping and penalty_depth; add them"),
        (PENALTY | {"restitution": 0.5}, "does not use restitution"),
        (PENALTY | {"memory": "fading"}, "law penalty does not use memory"),
        ({"restitution": None}, "law lankarani_nikravesh requires restitution; add it"),
        ({"penalty_damping": 10}, "does not use penalty_damping"),
        ({"exponent": 3}, r"exponent 3 requires stiffness in N/m\^3.*Hertz.*1.5"),
        ({"stribeck_speed": 0.1}, "friction_law coulomb does not use stribeck_speed"),
        ({"friction_law": "lugre", "static_friction": 0.01}, "0.01 is less than friction 0.05"),
        ({"friction_law": "ambrosio", "dead_band_speed": "2 mm/s"}, "0.002 must be below.*0.001"),
        (
            {"memory": "published", "reference_approach_speed": 0.1},
            "memory published does not use reference_approach",
        ),
    ],
)
def test_a_wrong_contact_is_one_error(keys, words):
    with pytest.raises(InputError, match=f"^mine.yaml: contacts.steel.*{words}") as error:
        with_contact(**keys)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("exponent", (1.0, 1.5, 2.2))
def test_a_kilonewton_may_press_at_least_a_nanometre(exponent):
    stiffest = 1e3 / 1e-9**exponent
    assert with_contact(stiffness=0.999 * stiffest, exponent=exponent)
    with pytest.raises(InputError, match="is too large"):
        with_contact(stiffness=1.001 * stiffest, exponent=exponent)


def test_a_contact_that_the_loads_press_by_half_the_journal_radius_is_an_error():
    radius, speed = paper().joint("crank_pin").journal_radius, 60.0
    # rod and slider at the outer dead centre
    load = (0.773 + 0.4482) * 0.15 * speed**2 * (1 + 0.15 / 0.564)
    for exponent in (1.0, 1.5, 10.0):
        softest = load / (radius / 2) ** exponent
        with_contact(stiffness=1.001 * softest, exponent=exponent).check_contacts(speed)
        with pytest.raises(InputError, match=r"crank_pin: contact\.stiffness .* too soft"):
            with_contact(stiffness=0.999 * softest, exponent=exponent).check_contacts(speed)
    with pytest.raises(InputError, match=r"contact\.youngs_modulus 10000 Pa is too soft") as error:
        with_contact(youngs_modulus="10 kPa").check_contacts(speed)
    smallest = float(re.search(r"crank_pin.*give at least (\S+) Pa", str(error.value)).group(1))
    joint = with_contact(youngs_modulus=1.01 * smallest).joint("crank_pin")
    assert hertz_stiffness(joint) * (radius / 2) ** 1.5 == pytest.approx(load, rel=0.02)


def test_friction_laws_have_defaults():
    lugre = contact(friction_law="lugre").friction_parameters()
    assert (lugre["static_friction"], lugre["stribeck_speed"]) == (0.05, 0.01)
    force, mass = 1e3, 0.1  # critical damping of this mass on bristles under this force
    stiffness, damping = force * lugre["bristle_stiffness"], force * lugre["bristle_damping"]
    assert damping == pytest.approx(2 * math.sqrt(stiffness * mass), rel=1e-12)
    ambrosio = contact(friction_law="ambrosio", friction_speed="5 mm/s").friction_parameters()
    assert ambrosio["dead_band_speed"] == pytest.approx(5e-4)
    keys = {"static_friction": 0.2, "stribeck_speed": 0.02, "viscous_friction": 0.3}
    keys |= {"bristle_stiffness": 4e5, "bristle_damping": 0.0}
    assert keys.items() <= contact(friction_law="lugre", **keys).friction_parameters().items()


@pytest.mark.parametrize(
    "keys, speed",
    [
        ({}, 0.05),
        ({"memory": "fading"}, 0.05),
        ({"reference_approach_speed": "20 cm/s"}, 0.2),
        ({"memory": "published"}, None),
        (PENALTY, None),
    ],
)
def test_the_damping_of_a_lasting_contact_fades_unless_it_is_as_published(keys, speed):
    assert contact(**keys).reference_speed == (speed and pytest.approx(speed))
