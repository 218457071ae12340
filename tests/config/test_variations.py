"""Paths of varied parameters: one joint, one of two equal effects, and errors."""

import pytest

import jointgap as jg
from jointgap.config import DrivenMechanism
from jointgap.config.variations import with_values
from jointgap.core.errors import InputError
from tests.motion.cases import effect, mechanism, options

COARSE = options(samples_per_revolution=90, tolerance=1e-9)


def changed(values: dict, base=None) -> DrivenMechanism:
    return with_values(
        DrivenMechanism(mechanism=base or mechanism(), simulate=COARSE), values, "sweep.parameters"
    )


def test_the_clearance_of_one_joint_is_varied_by_its_path():
    made = changed({"mechanism.joints.piston_pin.clearance": "0.3 mm"}).mechanism
    assert made.clearance("piston_pin") == pytest.approx(3e-4)
    assert made.clearance("crank_pin") == mechanism().clearance("crank_pin")


def test_an_effect_at_two_sites_is_varied_by_name_and_site():
    pins = ("crank_pin", "piston_pin")
    base = mechanism(*(effect("pin_friction", site=pin, coefficient=0.1) for pin in pins), loose=())
    key = "mechanism.effects.pin_friction{}.parameters.coefficient"
    made = changed({key.format("@piston_pin"): 0.2}, base).mechanism
    assert [made.effect("pin_friction", pin).coefficient for pin in pins] == [0.1, 0.2]
    with pytest.raises(InputError, match=r"did you mean .*'pin_friction@crank_pin'"):
        changed({key.format(""): 0.2}, base)


def test_a_change_of_a_contact_reaches_all_joints_that_refer_to_it():
    for base in ("erkaya2009", "four_bar"):
        made = jg.load_mechanism(base)
        (contact,) = made.contacts
        driven = changed({f"mechanism.contacts.{contact}.friction": 0.03}, made).mechanism
        for each in (driven, jg.change(made, {f"contacts.{contact}.friction": 0.03})):
            assert {each.joint(joint).contact.friction for joint in made.loose} == {0.03}


def test_words_and_lengths_of_a_linkage_change_as_those_of_a_slider_crank():
    four_bar = jg.load_mechanism("four_bar")
    made = jg.change(four_bar, {"clearance": "0.1 mm", "bodies.coupler.length": "440 mm"})
    assert [made.clearance(joint) for joint in "ABC"] == pytest.approx([1e-4] * 3)
    assert made.bodies["coupler"].mass_centre == pytest.approx(0.22)
    assert jg.change(made, {"joints.B.clearance": 2e-4}).clearance("B") == pytest.approx(2e-4)
    moved = jg.change(made, {"frame.points.C.y": "5 mm"})
    assert moved.frame.points["C"] == (0.3, 0.005)


@pytest.mark.parametrize(
    "key, value, message",
    [
        ("sped", 1, "did you mean 'speed'"),
        ("mechanism.contacts.steel.friction", 0.1, "mechanism.contacts has no 'steel'"),
        ("clearance", "1 s", "sweep.parameters.clearance"),
        ("mechanism.joints.crank_pn.clearance", "1 mm", "did you mean 'crank_pin'"),
        ("mechanism.crank.length", 0.7, "the crank cannot turn"),
        ("mechanism.effects.added_slider_mass.parameters.mass_kg", 1, "vary the key itself"),
    ],
)
def test_a_wrong_key_or_value_is_an_error_with_its_key(key, value, message):
    with pytest.raises(InputError) as error:
        changed({key: value})
    assert message in str(error.value)
