"""No contact is missed, not even a grazing one: as many as with steps a hundredth as long; and none is invented."""

import numpy as np
import pytest

from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.equations import AUXILIARY_STATES
from jointgap.dynamics.parameters import MEASURED, knots_record
from jointgap.dynamics.simulation import integrate_to_angles, start_state
from tests.dynamics.cases import ALL, SPEED, mechanism, options, with_numbers
from tests.rows import each

SETTLING = {
    "small clearance": ({"clearance": 1e-4}, 1.0),
    "crank pivot loose": ({"loose": ("crank_pivot",)}, 1.0),
    "three loose": ({"loose": ALL}, 1.0),
    "offset and gravity": ({"offset": 0.05, "gravity": True}, 1.0),
    "strongly damped": ({"restitution": 0.1, "law": "exact_restitution"}, 1.0),
    # Its small changes grow by 1e6 in a quarter turn: after that rounding decides.
    "hardly damped": ({"restitution": 0.9, "law": "exact_restitution"}, 0.3),
}


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


def as_many_contacts_as_in_fine_steps(keys, revolutions):
    usual, fine = both(mechanism(friction=0.1, **keys), 3 * revolutions, 1e-12)
    assert contacts(usual) == contacts(fine)
    np.testing.assert_allclose(usual.events[:, 0], fine.events[:, 0], rtol=1e-3)
    usual, fine = both(mechanism(**keys), revolutions, 1e-13)
    assert contacts(usual) == contacts(fine)


def test_there_are_as_many_contacts_as_in_steps_of_a_hundredth():
    as_many_contacts_as_in_fine_steps({}, 0.5)


@pytest.mark.slow
@each("case", SETTLING)
def test_so_are_there_whatever_the_mechanism(case):
    as_many_contacts_as_in_fine_steps(*SETTLING[case])


def test_the_finer_run_is_the_same_motion():
    made = mechanism()
    p, angles = parameters(made, options()), np.linspace(0.0, 1.0, 50)
    usual, fine = (integrate_to_angles(one, start_state(p), angles, 1e-14).states for one in (p, finely(p, 1e-4)))
    np.testing.assert_allclose(usual[:, :4], fine[:, :4], atol=1e-11)


FALL, THROW = 9.81, 0.14
HEIGHT = THROW**2 / (2 * FALL)


def thrown(clearance):
    """Events of a body thrown up from the middle of a ring of that clearance, so that it turns near the ring's top.

    A crank and a lever of no length make the rod's mass centre the journal's; its whole flight fits into one step.
    """
    p = with_numbers(
        parameters(mechanism(), options(speed=1.0)),
        bodies={"crank_length": 0.0, "rod_centre": 0.0, "gravity_y": -FALL},
        crank_pin={"clearance": clearance},
        piston_pin={"clearance": 10.0},
    )
    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, THROW, 0.0, THROW]), np.zeros(AUXILIARY_STATES)
    return integrate_to_angles(p, start, np.array([0.0, 1.5 * THROW / FALL]), 1e-12).events


@each("share", (1e-3, 1e-6, 1e-9))
def test_a_grazing_impact_between_two_step_ends_is_found_and_a_near_miss_is_none(share):
    events = thrown(HEIGHT * (1 - share))
    assert events.shape[0] == 2
    assert events[0, 0] == pytest.approx(THROW / FALL * (1 - np.sqrt(share)), rel=1e-6)
    assert events[0, 3] == pytest.approx(THROW * np.sqrt(share), rel=1e-2)
    assert thrown(HEIGHT * (1 + share)).shape[0] == 0
