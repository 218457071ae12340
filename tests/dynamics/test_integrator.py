"""Order of the integration, within contacts and at their ends."""

import numpy as np
import pytest

from jointgap.dynamics.joints import CONTACT, FLIGHT
from jointgap.dynamics.runge_kutta import (
    AFTER,
    BEFORE,
    COUNT,
    ERROR_3,
    ERROR_5,
    INTERPOLANT,
    KEPT,
    LINEAR,
    MORE_NODES,
    MORE_STAGES,
    NODES,
    STAGES,
    instant,
)
from jointgap.dynamics.simulation import integrate_to_angles, start_state
from tests.dynamics.cases import SPEED, integrated, mechanism, order


def test_the_tableau_fulfils_its_order_conditions():
    np.testing.assert_allclose(STAGES.sum(axis=1), NODES, atol=1e-14)
    weights, nodes = STAGES[COUNT], NODES[:COUNT]
    for power in range(8):
        assert weights @ nodes**power == pytest.approx(1 / (power + 1), rel=1e-13)
        nested = weights @ (STAGES[:COUNT] @ nodes**power)
        if power < 7:
            assert nested == pytest.approx(1 / ((power + 1) * (power + 2)), rel=1e-13)
    for estimator, exact_to in ((ERROR_5, 5), (ERROR_3, 3)):
        for power in range(exact_to):
            assert estimator @ nodes**power == pytest.approx(0, abs=1e-14)
        assert abs(estimator @ nodes**exact_to) > 1e-4


@pytest.mark.parametrize("share", (0.0, 0.3, 1.0))
def test_the_interpolant_fulfils_the_order_conditions_of_order_7(share):
    rest, identity = 1.0 - share, np.eye(KEPT)
    weights = np.append(STAGES[COUNT], np.zeros(KEPT - COUNT))
    first = identity[0]
    end = identity[COUNT]
    terms = [weights, first - weights, 2 * weights - first - end, *INTERPOLANT]
    value = np.zeros(KEPT)
    for number, term in reversed(list(enumerate(terms))):
        value = (term + value) * (share if number % 2 == 0 else rest)
    nodes = np.concatenate((NODES, MORE_NODES))
    for power in range(7):
        assert value @ nodes**power == pytest.approx(share ** (power + 1) / (power + 1), abs=1e-13)
    inner = np.vstack((np.pad(STAGES, ((0, 0), (0, KEPT - COUNT))), MORE_STAGES))
    for power in range(6):
        exact = share ** (power + 2) / ((power + 1) * (power + 2))
        assert value @ (inner @ nodes**power) == pytest.approx(exact, abs=1e-13)


@pytest.fixture(scope="module")
def impact():
    """Parameters; instants of the first impact, a quarter and half through its contact; time of
    separation [s]."""
    p, run = integrated(mechanism(), [0, 8], tolerance=1e-15)
    (begin, _, _, approach), (end, *_) = run.events[:2, :4]
    times = np.array([0.0, begin, 0.75 * begin + 0.25 * end, 0.5 * (begin + end), end])
    at = integrate_to_angles(p, start_state(p), SPEED * times, 1e-15)
    contact = (CONTACT, FLIGHT, FLIGHT), (approach, np.inf, np.inf), (begin, np.inf, np.inf)
    instants = [
        instant(p, times[i], tuple(at.states[i]), tuple(at.auxiliary_states[i]), *contact)
        for i in (1, 2, 3)
    ]
    return p, *instants, end


def test_a_smooth_contact_converges_with_order_8(impact):
    p, begin, quarter, _, end = impact
    assert order(p, quarter, LINEAR, 0.0, 0.5 * (end - begin.time), (2, 3, 4)) > 7.5


def test_after_an_impact_the_order_needs_the_root_of_time(impact):
    p, begin, _, middle, _ = impact
    length = middle.time - begin.time
    assert order(p, begin, AFTER, 0.0, np.sqrt(length), (3, 4, 6)) > 7.5
    assert order(p, begin, LINEAR, 0.0, length, (3, 4, 6)) < 4


def test_before_a_separation_the_order_needs_the_root_of_time(impact):
    p, _, _, middle, end = impact
    length = end - middle.time
    assert order(p, middle, BEFORE, np.sqrt(length), 0.0, (3, 4, 6)) > 7
    assert order(p, middle, LINEAR, 0.0, length, (3, 4, 6)) < 4
