"""No contact is missed, not even a grazing one: as many as with steps a hundredth as long."""

import numpy as np
import pytest

from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.parameters import MEASURED, knots_record
from jointgap.dynamics.simulation import integrate_to_angles, start_state
from tests.dynamics.cases import ALL, SPEED, mechanism, options, with_numbers

SETTLING = {
    "two loose": {},
    "hardly damped": {"restitution": 0.9, "law": "exact_restitution"},
    "small clearance": {"clearance": 1e-4},
    "crank pin loose": {"loose": ("crank_pin",)},
    "piston pin loose": {"loose": ("piston_pin",)},
    "crank pivot loose": {"loose": ("crank_pivot",)},
    "three loose": {"loose": ALL},
    "offset and gravity": {"offset": 0.05, "gravity": True},
    "strongly damped": {"restitution": 0.1, "law": "exact_restitution"},
}


MOST = [
    case if case in ("two loose", "hardly damped") else pytest.param(case, marks=pytest.mark.slow) for case in SETTLING
]
REVOLUTIONS = {"hardly damped": 0.3}
"""Its small changes grow by 1e6 in a quarter turn: after that rounding decides."""


def finely(p, step):
    """The same motion in steps of `step` [rad] at most instead of a tenth of a radian.

    How far a step may go is told in turns of the mean speed. A measured angle has its own mean speed beside its pieces,
    so that one piece of constant speed is the same drive with steps as short as wanted.
    """
    piece = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, SPEED, 0.0]])
    return with_numbers(p, drive={"kind": MEASURED, "speed": 0.1 / step * SPEED})._replace(knots=knots_record(piece))


def both(made, revolutions, tolerance):
    """A usual run, and one in steps of a hundredth of its mean step."""
    p, angles = parameters(made, options()), np.array([0.0, 2 * np.pi * revolutions])
    usual = integrate_to_angles(p, start_state(p), angles, tolerance)
    fine = integrate_to_angles(finely(p, 0.01 * angles[1] / usual.steps), start_state(p), angles, tolerance)
    assert fine.steps > 100 * usual.steps
    return usual, fine


def contacts(run):
    """Contacts begun, by joint."""
    begun = run.events[run.events[:, 2] == 1]
    return [int((begun[:, 1] == joint).sum()) for joint in range(3)]


@pytest.mark.parametrize("case", MOST)
def test_revolutions_with_friction_have_as_many_contacts_as_in_steps_of_a_hundredth(case):
    usual, fine = both(mechanism(friction=0.1, **SETTLING[case]), 3, 1e-12)
    assert contacts(usual) == contacts(fine)
    np.testing.assert_allclose(usual.events[:, 0], fine.events[:, 0], rtol=1e-3)


@pytest.mark.parametrize("case", MOST)
def test_the_first_revolution_without_friction_has_as_many_contacts_as_in_steps_of_a_hundredth(case):
    usual, fine = both(mechanism(**SETTLING[case]), REVOLUTIONS.get(case, 1.0), 1e-13)
    assert contacts(usual) == contacts(fine)


def test_the_finer_run_is_the_same_motion():
    made = mechanism()
    p, angles = parameters(made, options()), np.linspace(0.0, 1.0, 50)
    usual, fine = (integrate_to_angles(one, start_state(p), angles, 1e-14).states for one in (p, finely(p, 1e-4)))
    np.testing.assert_allclose(usual[:, :4], fine[:, :4], atol=1e-11)
