"""Order of the integration, within contacts and at their ends."""

import numpy as np
import pytest

from jointgap.motion.runge_kutta import (
    AFTER,
    BEFORE,
    COUNT,
    ERROR_3,
    ERROR_5,
    INTERPOLANT,
    LINEAR,
    MORE_NODES,
    MORE_STAGES,
    NODES,
    STAGES,
)
from jointgap.motion.simulation import integrate_to_angles
from jointgap.motion.slider_crank import start_state
from jointgap.motion.workspace import HERE, KEPT
from tests.motion.cases import SPEED, in_contact, integrated, mechanism, order


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
    """A model; integrations from the first impact, a quarter and half through its contact; time of
    separation [s]."""
    model, run = integrated(mechanism(), [0, 8], tolerance=1e-15)
    (begin, joint, _, approach), (end, *_) = run.events[:2, :4]
    times = np.array([0.0, begin, 0.75 * begin + 0.25 * end, 0.5 * (begin + end), end])
    at = integrate_to_angles(model, start_state(model), SPEED * times, 1e-15)
    name = model.loose[int(joint)]
    starts = [in_contact(model, times[i], at.states[i], name, approach, begin) for i in (1, 2, 3)]
    return model, *starts, end


def time_of(start):
    return start.k.time[HERE]


def test_a_smooth_contact_converges_with_order_8(impact):
    model, begin, quarter, _, end = impact
    length = 0.5 * (end - time_of(begin))
    assert order(model, quarter, LINEAR, 0.0, length, (2, 3, 4)) > 7.5


def test_after_an_impact_the_order_needs_the_root_of_time(impact):
    model, begin, _, middle, _ = impact
    length = time_of(middle) - time_of(begin)
    assert order(model, begin, AFTER, 0.0, np.sqrt(length), (3, 4, 6)) > 7.5
    assert order(model, begin, LINEAR, 0.0, length, (3, 4, 6)) < 4


def test_before_a_separation_the_order_needs_the_root_of_time(impact):
    model, _, _, middle, end = impact
    length = end - time_of(middle)
    assert order(model, middle, BEFORE, np.sqrt(length), 0.0, (3, 4, 6)) > 7
    assert order(model, middle, LINEAR, 0.0, length, (3, 4, 6)) < 4
