"""Sections made and changed in Python: told what is wrong as in a file."""

import json
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from jointgap.config import Contact, DrivenMechanism, Joint, Runs, Simulate, change
from jointgap.config.variations import with_values
from tests.catalogue import refused
from tests.config.mechanisms import paper


def test_a_section_made_in_python_is_checked_like_a_file():
    pin = {"journal": "crank", "journal_radius": "7 mm", "bearing_radius": "6 mm"}
    cases = [
        (lambda: Simulate(sped="600 rpm"), "Simulate: unknown key 'sped'; did you mean 'speed'?"),
        (
            lambda: Simulate("600 rpm"),
            "Simulate: accepts keyword arguments only, such as Simulate(speed=...)",
        ),
        (
            lambda: Simulate(drive={"kind": "motr"}),
            "Simulate: drive.kind = 'motr': no such kind; did you mean 'motor'?",
        ),
        (
            lambda: Contact(fricton=0.1, restitution=0.5),
            "Contact: unknown key 'fricton'; did you mean 'friction'?",
        ),
        (
            lambda: Joint(contact=Contact(restitution=0.5), **pin),
            "Joint: journal_radius 0.007 m is not smaller",
        ),
    ]
    refused(lambda make: make(), cases)


def test_values_change_by_path_or_nested_and_units_are_read():
    by_path = change(paper(), {"slider.mass": "1.2 kg", "rod.inertia": "0.02 kg*m^2"})
    nested = change(paper(), {"slider": {"mass": "1.2 kg"}, "rod": {"inertia": "0.02 kg*m^2"}})
    assert by_path == nested and (nested.slider.mass, nested.rod.inertia) == (1.2, 0.02)
    assert nested.crank == paper().crank
    motor = change(
        Simulate(),
        {"drive": {"kind": "motor", "stall_torque": "3 N*m", "no_load_speed": "700 rpm"}},
    )
    assert (
        change(motor, {"drive": {"kind": "constant"}}) == Simulate()
    )  # another kind replaces the one before


def test_a_length_moves_the_mass_centre_wherever_it_is_changed_unless_the_centre_is_given():
    made, crank = paper(), paper().crank
    longer, centre = 1.2 * crank.length, 1.2 * crank.mass_centre
    text = f"{1e3 * longer} mm"
    for changed in (
        change(made, {"crank.length": text}).crank,
        change(made, {"crank": {"length": longer}}).crank,
        change(crank, {"length": text}),
        with_values(
            DrivenMechanism(mechanism=made), {"crank_length": longer}, "vary"
        ).mechanism.crank,
        with_values(
            DrivenMechanism(mechanism=made), {"mechanism.crank.length": text}, "vary"
        ).mechanism.crank,
        made.with_lengths(longer, made.rod.length).crank,
    ):
        assert (changed.length, changed.mass_centre) == pytest.approx((longer, centre))
        assert (changed.mass, changed.inertia) == (crank.mass, crank.inertia)
    for changed in (
        change(made, {"crank.length": longer, "crank.mass_centre": "10 mm"}).crank,
        change(made, {"crank": {"length": longer, "mass_centre": 0.01}}).crank,
        change(made, {"crank": change(crank, {"length": longer, "mass_centre": 0.01})}).crank,
        with_values(
            DrivenMechanism(mechanism=made),
            {"mechanism.crank.mass_centre": 0.01, "mechanism.crank.length": longer},
            "vary",
        ).mechanism.crank,
    ):
        assert (changed.length, changed.mass_centre) == pytest.approx((longer, 0.01))
    refused(
        lambda keys: change(made, keys),
        [({"crank.length": "1 kg"}, "Mechanism: crank.length = '1 kg'")],
    )


FAST = {"no_load_speed": "700 rpm"}
NUMBERS = (np.float32, np.float64, np.int16, np.int64, Decimal, Fraction)


def test_numbers_of_numpy_decimal_and_fractions_are_numbers():
    for kind in NUMBERS:
        options = Simulate(
            speed=kind(60),
            revolutions=kind(3),
            drive={"kind": "motor", "stall_torque": kind(2), **FAST},
        )
        assert (options.speed, options.revolutions, options.drive.stall_torque) == (
            60.0,
            3,
            2.0,
        ), kind
        assert {type(options.speed), type(options.revolutions)} == {float, int}
        assert (
            change(paper(), {"slider": {"mass": kind(2)}, "crank.mass": kind(1)}).slider.mass == 2.0
        )
    runs = Runs(
        vary={"speed": np.array([60, 70]), "friction": [Decimal("0.1"), np.float64(0.2)]},
        members=np.int8(2),
    )
    assert runs.vary == {"speed": (60, 70), "friction": (0.1, 0.2)}
    json.dumps(runs.model_dump())
    cases = [
        (lambda: Simulate(speed=np.bool_(True)), "must be a number"),
        (lambda: Simulate(revolutions=np.bool_(True)), "not true or false"),
        (lambda: Simulate(revolutions=Decimal("2.5")), "must be a whole number"),
        (lambda: Simulate(speed=np.complex64(1)), "must be a number"),
        (lambda: Simulate(speed=Decimal("NaN")), "must be finite"),
        (lambda: Simulate(speed=Fraction(10**400)), "must be finite"),
    ]
    refused(lambda make: make(), cases)


def test_a_word_changes_every_loose_joint_and_a_path_one():
    both = change(paper(), {"clearance": "0.2 mm", "friction": 0.1})
    assert [both.clearance(joint) for joint in both.loose] == pytest.approx([2e-4, 2e-4])
    assert [both.joint(joint).contact.friction for joint in both.loose] == [0.1, 0.1]
    one = change(paper(), {"joints.crank_pin.clearance": "0.2 mm"})
    assert [one.clearance(joint) for joint in one.loose] == pytest.approx([2e-4, 1e-3])
    by_reference = change(paper(), {f"contacts.{next(iter(paper().contacts))}.friction": 0.2})
    assert [by_reference.joint(joint).contact.friction for joint in by_reference.loose] == [
        0.2,
        0.2,
    ]


def test_an_effect_goes_by_its_name_and_a_change_that_cannot_be_is_reported_with_its_key():
    with_gravity = change(paper(), {"effects": [{"name": "gravity"}]})
    on_the_moon = change(with_gravity, {"effects.gravity.parameters.acceleration_m_s2": 1.62})
    assert on_the_moon.effect("gravity").acceleration_m_s2 == 1.62
    gravty = {"effects.gravty.parameters.acceleration_m_s2": 1.62}
    cases = [
        (gravty, "effects has no 'gravty'; did you mean 'gravity'"),
        ({"slider.maas": 1}, "Mechanism: unknown key 'slider.maas'; did you mean 'mass'?"),
        (
            {"clearance": "1 kg"},
            "Mechanism: joints.crank_pin.clearance = '1 kg': has the unit 'kilogram'",
        ),
        (
            {"clearance": "-1 mm"},
            "Mechanism: joints.crank_pin: journal_radius 0.007 m is not smaller",
        ),
    ]
    refused(lambda changes: change(with_gravity, changes), cases)
