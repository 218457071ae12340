"""Each joint is ideal or loose over the same data, with contacts and friction laws that say what
they need."""

import itertools
import math
import re

import pytest

from jointgap.config import hertz_stiffness
from jointgap.core.errors import InputError
from tests.catalogue import each, refused, written
from tests.config.mechanisms import PIVOT, mechanism, paper, with_contact

PENALTY = {"law": "penalty", "restitution": None, "penalty_damping": 1e3, "penalty_depth": "0.1 mm"}


def test_any_subset_of_the_joints_can_be_loose_over_the_same_data():
    for loose in itertools.product((True, False), repeat=3):
        switches = dict(zip(("crank_pivot", "crank_pin", "piston_pin"), loose, strict=True))
        joints = {name: {"loose": switch} for name, switch in switches.items()}
        made = mechanism(joints=joints | {"crank_pivot": PIVOT | joints["crank_pivot"]})
        assert made.loose == tuple(name for name, switch in switches.items() if switch)
        assert all((made.clearance(name) > 0) == switch for name, switch in switches.items())
        assert made.joint("crank_pin").bearing_radius == paper().joint("crank_pin").bearing_radius
    bare = mechanism(joints={"crank_pin": "ideal", "piston_pin": "ideal"})
    assert bare.loose == () and bare.joint("crank_pin") is None


def test_a_joint_that_makes_no_sense_is_refused():
    rows = """
    {crank_pin: idela} => joints.crank_pin = 'idela' ~ 'ideal' or a mapping
    {crank_pivot: {journal_radius: null}} => joints.crank_pivot.journal_radius
    {crank_pin: {lose: false}} => joints.crank_pin.lose ~ did you mean 'loose'
    {crank_pni: ideal} => joints.crank_pni ~ did you mean 'crank_pin'
    """
    pivots = [
        ({"crank_pivot": PIVOT | {"journal": "rod"}}, "joints.crank_pivot ~ 'frame' or 'crank'"),
        (
            {"crank_pivot": PIVOT | {"contact": "brass"}},
            "joints: crank_pivot.contact: no entry 'brass'",
        ),
    ]
    refused(lambda joints: mechanism(joints=joints), written(rows) + pivots)


def test_clearances_count_when_it_is_asked_whether_the_crank_can_turn():
    lengths = {
        "crank": {"length": "400 mm"},
        "slider": {"offset": "-162.7 mm"},
    }  # 1.3 mm short of the rod's 564 mm
    assert mechanism(joints={"crank_pin": "ideal"}, **lengths).slider.offset < 0
    with pytest.raises(InputError, match=r"offset 0\.1627 m plus clearances 0\.002 m.*cannot turn"):
        mechanism(**lengths)
    with pytest.raises(InputError, match="cannot turn"):
        mechanism(joints={"crank_pin": "ideal", "crank_pivot": PIVOT | {"loose": True}}, **lengths)


CONTACTS = """
{law: penalty} => law penalty requires penalty_damping and penalty_depth ~ add them
{law: penalty, penalty_damping: 10, penalty_depth: 1 um} => does not use restitution
{restitution: null} => law lankarani_nikravesh requires restitution ~ add it
{penalty_damping: 10} => does not use penalty_damping
{stiffness: 1.0e+18} => stiffness 1e+18 ~ at most 3.16e+16 N/m^1.5
{stiffness: 2.0e+12, exponent: 1} => stiffness 2e+12 ~ at most 1e+12 N/m^1
{exponent: 3} => exponent 3 requires stiffness in N/m^3 ~ Hertz ~ 1.5
{stribeck_speed: 0.1} => stribeck_speed is used by friction_law bengisu_akay and lugre ~ not by coulomb
{friction_law: lugre, static_friction: 0.01} => static_friction 0.01 is less than friction 0.05
{friction_law: ambrosio, dead_band_speed: 2 mm/s} => dead_band_speed 0.002 ~ 0.001 m/s
{memory: published, reference_approach_speed: 0.1} => memory published does not use reference_approach
"""


def test_a_contact_that_makes_no_sense_is_refused_once_with_the_mend():
    cases = written(CONTACTS)
    for keys in ({"memory": "fading"}, {"reference_approach_speed": 0.1}):
        cases.append((PENALTY | keys, f"law penalty does not use {next(iter(keys))}"))

    def once(keys):
        try:
            with_contact(**keys)
        except InputError as error:
            assert len(str(error).splitlines()) == 1
            raise

    refused(once, cases, starts="mine.yaml: contacts.steel")


def test_a_contact_is_as_stiff_as_it_may_be_where_a_kilonewton_presses_a_nanometre():
    for exponent in (1.0, 1.5, 2.2):
        stiffest = 1e3 / 1e-9**exponent
        assert with_contact(stiffness=0.999 * stiffest, exponent=exponent)
        with pytest.raises(InputError, match="is too large"):
            with_contact(stiffness=1.001 * stiffest, exponent=exponent)


def test_a_contact_that_the_loads_would_press_in_by_half_the_journal_is_refused_with_the_least_value():
    radius, speed = paper().joint("crank_pin").journal_radius, 60.0
    load = (
        (0.773 + 0.4482) * 0.15 * speed**2 * (1 + 0.15 / 0.564)
    )  # rod and slider at the outer dead centre
    for exponent in (1.0, 1.5, 10.0):
        softest = load / (radius / 2) ** exponent
        with_contact(stiffness=1.001 * softest, exponent=exponent).check_contacts(speed)
        with pytest.raises(
            InputError, match=r"joints\.crank_pin: contact\.stiffness .* too soft.*journal_radius"
        ):
            with_contact(stiffness=0.999 * softest, exponent=exponent).check_contacts(speed)
    with pytest.raises(
        InputError, match=r"joints\.crank_pin: contact\.youngs_modulus 10000 Pa is too soft"
    ) as caught:
        with_contact(youngs_modulus="10 kPa").check_contacts(speed)
    least = float(
        re.search(r"joints\.crank_pin.*give at least (\S+) Pa", str(caught.value)).group(1)
    )
    joint = with_contact(youngs_modulus=1.01 * least).joint("crank_pin")
    assert hertz_stiffness(joint) * (radius / 2) ** 1.5 == pytest.approx(load, rel=0.02)
    ideal = {name: {"loose": False} for name in ("crank_pin", "piston_pin")}
    assert mechanism(contacts={"steel": {"stiffness": 1.0}}, joints=ideal).loose == ()


def test_friction_laws_fill_in_what_is_left_out_and_take_what_is_given():
    given = with_contact(friction_law="lugre").joint("crank_pin").contact.friction_parameters()
    filled = {
        "static_friction": 0.05,
        "friction": 0.05,
        "stribeck_speed": 0.01,
        "viscous_friction": 0.0,
    }
    assert {key: given[key] for key in filled} == filled
    pressed, mass = 1e3, 0.1  # critical damping of this mass on bristles under this force
    stiffness, damping = pressed * given["bristle_stiffness"], pressed * given["bristle_damping"]
    assert damping == pytest.approx(2 * math.sqrt(stiffness * mass), rel=1e-12)
    ambrosio = (
        with_contact(friction_law="ambrosio", friction_speed="5 mm/s").joint("crank_pin").contact
    )
    assert ambrosio.friction_parameters()["dead_band_speed"] == pytest.approx(5e-4)
    keys = {"static_friction": 0.2, "stribeck_speed": 0.02, "viscous_friction": 0.3}
    keys |= {"bristle_stiffness": 4e5, "bristle_damping": 0.0}
    given = (
        with_contact(friction_law="lugre", **keys).joint("crank_pin").contact.friction_parameters()
    )
    assert {key: given[key] for key in keys} == keys


def test_a_contact_forgets_the_impact_that_it_began_with_unless_it_is_as_published():
    def remembers(keys, speed):
        assert with_contact(**keys).joint("crank_pin").contact.reference_speed == speed

    faster = {"reference_approach_speed": "20 cm/s"}
    each(remembers, [({}, 0.05), ({"memory": "fading"}, 0.05), (faster, pytest.approx(0.2))])
    each(remembers, [({"memory": "published"}, None), (PENALTY, None)])
    penalty = with_contact(**PENALTY).joint("crank_pin").contact
    assert (penalty.penalty_damping, penalty.penalty_depth) == pytest.approx((1e3, 1e-4))
