"""Events: none is missed, however short the contact, and none invented."""

import numpy as np
import pytest

from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.equations import AUXILIARY_STATES
from jointgap.dynamics.events import NOWHERE, first_crossing
from jointgap.dynamics.simulation import integrate_to_angles
from tests.dynamics.cases import mechanism, options, with_numbers

GRAVITY, SPEED = 9.81, 0.14
HEIGHT = SPEED**2 / (2 * GRAVITY)


def thrown(clearance):
    """Events of a body thrown up from the middle of a ring of that clearance, so that it turns near the ring's top.

    A crank and a lever of no length make the rod's mass centre the journal's; its whole flight fits into one step.
    """
    p = with_numbers(
        parameters(mechanism(), options(speed=1.0)),
        bodies={"crank_length": 0.0, "rod_centre": 0.0, "gravity_y": -GRAVITY},
        crank_pin={"clearance": clearance},
        piston_pin={"clearance": 10.0},
    )
    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, SPEED, 0.0, SPEED]), np.zeros(AUXILIARY_STATES)
    return integrate_to_angles(p, start, np.array([0.0, 1.5 * SPEED / GRAVITY]), 1e-12).events


@pytest.mark.parametrize("share", (1e-3, 1e-6, 1e-9))
def test_a_grazing_impact_between_two_step_ends_is_found(share):
    events = thrown(HEIGHT * (1 - share))
    assert events.shape[0] == 2
    assert events[0, 0] == pytest.approx(SPEED / GRAVITY * (1 - np.sqrt(share)), rel=1e-6)
    assert events[0, 3] == pytest.approx(SPEED * np.sqrt(share), rel=1e-2)


@pytest.mark.parametrize("share", (1e-3, 1e-6, 1e-9))
def test_a_near_miss_is_none(share):
    assert thrown(HEIGHT * (1 + share)).shape[0] == 0


def crossing(polynomial, duration=0.1, margin=0.0):
    rate, second = polynomial.deriv(), polynomial.deriv(2)
    ends = (f(t) for t in (0.0, duration) for f in (polynomial, rate, second))
    return first_crossing(*ends, duration, margin) * duration


@pytest.mark.parametrize("roots", ([0.03, 0.2], [0.03, 0.05], [0.0301, 0.0302], [0.03, 0.09, 0.095]))
def test_the_first_of_several_crossings_is_reported(roots):
    falling = np.polynomial.Polynomial.fromroots([*roots, -1.0])
    falling = falling if falling(0.0) > 0 else -falling
    assert crossing(falling) == pytest.approx(roots[0], rel=1e-9)


def test_a_condition_that_has_only_just_come_true_may_start_at_zero():
    assert crossing(np.polynomial.Polynomial([0.0, 1.0, -20.0])) == pytest.approx(0.05, rel=1e-9)
    assert crossing(np.polynomial.Polynomial([0.0, 1.0, -5.0])) == NOWHERE * 0.1
    assert crossing(np.polynomial.Polynomial([-1e-17, -1.0, 5.0])) == 0.0


def test_a_shallow_minimum_is_reported_within_the_margin_only():
    dip = np.polynomial.Polynomial([0.05**2 + 1e-9, -0.1, 1.0])
    assert crossing(dip) == NOWHERE * 0.1
    assert crossing(dip, margin=1e-8) == pytest.approx(0.05, rel=1e-6)
