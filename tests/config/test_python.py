"""Sections that are created and changed in Python."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from jointgap.config import Contact, DrivenMechanism, Simulate, change
from jointgap.config.variations import with_values
from jointgap.core.errors import InputError
from tests.config.mechanisms import paper


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Simulate(sped="600 rpm"), "Simulate: unknown key 'sped'; did you mean 'speed'"),
        (lambda: Simulate("600 rpm"), "accepts keyword arguments only, such as Simulate.speed="),
        (lambda: Simulate(drive={"kind": "motr"}), "drive.kind = 'motr': no such kind; did you"),
        (lambda: Contact(fricton=0.1, restitution=0.5), "Contact: unknown key 'fricton'; did you"),
        (lambda: Simulate(speed=np.bool_(True)), "must be a number"),
        (lambda: Simulate(revolutions=np.bool_(True)), "not true or false"),
        (lambda: Simulate(revolutions=Decimal("2.5")), "must be a whole number"),
        (lambda: Simulate(speed=np.complex64(1)), "must be a number"),
        (lambda: Simulate(speed=Fraction(10**400)), "must be finite"),
    ],
)
def test_a_section_in_python_is_checked_like_a_file(make, words):
    with pytest.raises(InputError, match=words):
        make()


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


CRANK = paper().crank
LONGER, CENTRE = 1.2 * CRANK.length, 1.2 * CRANK.mass_centre
MILLIMETRES = f"{1e3 * LONGER} mm"


def varied(**values):
    return with_values(DrivenMechanism(mechanism=paper()), values, "vary").mechanism.crank


@pytest.mark.parametrize(
    "longer",
    [
        lambda: change(paper(), {"crank.length": MILLIMETRES}).crank,
        lambda: change(paper(), {"crank": {"length": LONGER}}).crank,
        lambda: change(CRANK, {"length": MILLIMETRES}),
        lambda: varied(crank_length=LONGER),
        lambda: varied(**{"mechanism.crank.length": MILLIMETRES}),
        lambda: paper().with_lengths(LONGER, paper().rod.length).crank,
    ],
)
def test_a_length_scales_the_mass_centre(longer):
    crank = longer()
    assert (crank.length, crank.mass_centre) == pytest.approx((LONGER, CENTRE))
    assert (crank.mass, crank.inertia) == (CRANK.mass, CRANK.inertia)


@pytest.mark.parametrize(
    "longer",
    [
        lambda: change(paper(), {"crank.length": LONGER, "crank.mass_centre": "10 mm"}).crank,
        lambda: change(paper(), {"crank": {"length": LONGER, "mass_centre": 0.01}}).crank,
        lambda: varied(**{"mechanism.crank.mass_centre": 0.01, "mechanism.crank.length": LONGER}),
    ],
)
def test_a_mass_centre_that_is_set_too_is_not_scaled(longer):
    crank = longer()
    assert (crank.length, crank.mass_centre) == pytest.approx((LONGER, 0.01))


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


WITH_GRAVITY = change(paper(), {"effects": [{"name": "gravity"}]})


def test_an_effect_is_found_by_its_name():
    moon = change(WITH_GRAVITY, {"effects.gravity.parameters.acceleration_m_s2": 1.62})
    assert moon.effect("gravity").acceleration_m_s2 == 1.62


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"effects.gravty.parameters.acceleration_m_s2": 1}, "effects has no 'gravty'; did you"),
        ({"slider.maas": 1}, "Mechanism: unknown key 'slider.maas'; did you mean 'mass'"),
        ({"crank.length": "1 kg"}, "Mechanism: crank.length = '1 kg'"),
        ({"clearance": "1 kg"}, "crank_pin.clearance = '1 kg': has the unit 'kilogram'"),
        ({"clearance": "-1 mm"}, "joints.crank_pin: journal_radius 0.007 m is not smaller"),
    ],
)
def test_a_wrong_change_is_an_error_with_its_key(changes, words):
    with pytest.raises(InputError, match=words):
        change(WITH_GRAVITY, changes)
