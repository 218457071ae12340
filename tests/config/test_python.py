"""Sections made and changed in Python: told what is wrong as in a file."""

import pytest

from jointgap.config import Contact, Joint, Mechanism, Simulate, change, load_mechanism
from jointgap.core.errors import InputError

PAPER = "config/mechanisms/erkaya2009.yaml"


@pytest.fixture(scope="module")
def mechanism() -> Mechanism:
    return load_mechanism(PAPER)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Simulate(sped="600 rpm"), "Simulate: unknown key 'sped'; did you mean 'speed'?"),
        (lambda: Simulate("600 rpm"), r"Simulate: takes keys by name alone, such as Simulate\(speed=...\)"),
        (
            lambda: Simulate(drive={"kind": "motr"}),
            "Simulate: drive.kind = 'motr': no such kind; did you mean 'motor'?",
        ),
        (lambda: Contact(fricton=0.1, restitution=0.5), "Contact: unknown key 'fricton'; did you mean 'friction'?"),
        (
            lambda: Joint(
                journal="crank", journal_radius="7 mm", bearing_radius="6 mm", contact=Contact(restitution=0.5)
            ),
            "Joint: journal_radius 0.007 m is not smaller than bearing_radius 0.006 m",
        ),
    ],
)
def test_a_section_made_in_python_is_told_what_a_file_is_told(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_values_change_by_path_or_nested_and_units_are_read(mechanism):
    by_path = change(mechanism, {"slider.mass": "1.2 kg", "rod.inertia": "0.02 kg*m^2"})
    nested = change(mechanism, {"slider": {"mass": "1.2 kg"}, "rod": {"inertia": "0.02 kg*m^2"}})
    assert by_path == nested
    assert (nested.slider.mass, nested.rod.inertia) == (1.2, 0.02)
    assert nested.crank == mechanism.crank


def test_a_word_changes_every_loose_joint_and_a_path_one(mechanism):
    both = change(mechanism, {"clearance": "0.2 mm", "friction": 0.1})
    assert [both.clearance(joint) for joint in both.loose] == pytest.approx([2e-4, 2e-4])
    assert [both.joint(joint).contact.friction for joint in both.loose] == [0.1, 0.1]
    one = change(mechanism, {"joints.crank_pin.clearance": "0.2 mm"})
    assert one.clearance("crank_pin") == pytest.approx(2e-4)
    assert one.clearance("piston_pin") == mechanism.clearance("piston_pin")


def test_joints_follow_the_entry_of_contacts_that_they_refer_to(mechanism):
    (name,) = mechanism.contacts
    changed = change(mechanism, {f"contacts.{name}.friction": 0.2})
    assert [changed.joint(joint).contact.friction for joint in changed.loose] == [0.2, 0.2]


def test_an_effect_goes_by_its_name(mechanism):
    with_gravity = change(mechanism, {"effects": [{"name": "gravity"}]})
    on_the_moon = change(with_gravity, {"effects.gravity.parameters.acceleration_m_s2": 1.62})
    assert on_the_moon.effect("gravity").acceleration_m_s2 == 1.62
    with pytest.raises(InputError, match="effects has no 'gravty'; did you mean 'gravity'"):
        change(with_gravity, {"effects.gravty.parameters.acceleration_m_s2": 1.62})


def test_a_drive_of_another_kind_replaces_the_one_before():
    motor = change(Simulate(), {"drive": {"kind": "motor", "stall_torque": "3 N*m", "no_load_speed": "700 rpm"}})
    assert change(motor, {"drive": {"kind": "constant"}}) == Simulate()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"slider.maas": 1}, "Mechanism: unknown key 'slider.maas'; did you mean 'mass'?"),
        ({"clearance": "1 kg"}, "Mechanism: joints.crank_pin.clearance = '1 kg': has the unit 'kilogram'"),
        ({"clearance": "-1 mm"}, "Mechanism: joints.crank_pin: journal_radius 0.007 m is not smaller"),
    ],
)
def test_a_change_that_cannot_be_is_told_with_its_key(mechanism, changes, words):
    with pytest.raises(InputError, match=words):
        change(mechanism, changes)
