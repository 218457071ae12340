"""Linear equations of motion by collocation, and their intervals."""

import numpy as np
import pytest

from jointgap.motion import variation
from jointgap.motion.runge_kutta import AFTER, BEFORE, LINEAR
from jointgap.motion.variation import (
    Intervals,
    Solution,
    chained,
    gauss_collocation,
    integral_weights,
    intervals_of,
    linear_motion,
    refined,
)

STIFFNESS, DAMPING = 7.3, 0.8


def even_in_angle(edges: np.ndarray) -> Intervals:
    """Intervals (k,) between the crank angles `edges` (k + 1,)."""
    count = edges.size - 1
    inside = np.stack([np.zeros(count), np.diff(edges)], axis=-1)
    return Intervals(edges[:-1], np.zeros(count), inside, edges)


def solved(intervals: Intervals, by_states, forcing, start: np.ndarray) -> Solution:
    """Solution from `start` (N,); `by_states` and `forcing` return (N, N) and (N,) at an angle."""
    points = intervals.points()
    linear = linear_motion(
        intervals,
        start.size // 2,
        np.array([[by_states(angle) for angle in row] for row in points]),
        np.array([[forcing(angle) for angle in row] for row in points])[..., None],
    )
    ends = linear.over_intervals()
    starts, one = np.empty((len(ends), start.size, 1)), np.ones((1, 1))
    chained(ends, start[:, None], one, starts)
    return Solution(linear, starts, np.broadcast_to(one, (len(ends), 1, 1)))


def oscillator_errors(count: int) -> tuple[float, float]:
    """Errors of x'' = cos(phi) - k x - c x' at the edges of uneven intervals of a revolution and
    between them, from the state of its periodic solution."""
    amplitude = 1.0 / (STIFFNESS - 1.0 + 1j * DAMPING)
    even = 2 * np.pi * np.arange(count + 1) / count
    edges = even + 0.3 * np.sin(even)
    solution = solved(
        even_in_angle(edges),
        lambda _: np.array([[0.0, 1.0], [-STIFFNESS, -DAMPING]]),
        lambda angle: np.array([0.0, np.cos(angle)]),
        np.array([amplitude.real, (1j * amplitude).real]),
    )

    def error(angles: np.ndarray, states: np.ndarray) -> float:
        exact = amplitude * np.exp(1j * angles[:, None]) * np.array([1.0, 1j])
        return float(np.abs(states - exact.real).max())

    between = np.linspace(0.01, 6.2, 300)
    return (
        error(edges[:-1], solution.starts[:, :, 0]),
        error(between, solution(between)[:, :, 0]),
    )


@pytest.mark.parametrize("stages", [2, 3, 4])
def test_the_order_is_twice_the_number_of_gauss_points_at_edges(stages, monkeypatch):
    monkeypatch.setattr(variation, "STAGES", stages)
    (coarse, coarse_inside), (fine, fine_inside) = map(oscillator_errors, (12, 24))
    assert np.log2(coarse / fine) == pytest.approx(2 * stages, abs=0.5)
    assert np.log2(coarse_inside / fine_inside) == pytest.approx(stages + 1, abs=0.5)


def test_forced_positions_and_changing_paces_are_integrated():
    """x' = (1 + phi) v + phi^2, v' = 2 phi with polynomials, which collocation solves exactly."""
    solution = solved(
        even_in_angle(np.linspace(0.0, 2.0, 4)),
        lambda angle: np.array([[0.0, 1.0 + angle], [0.0, 0.0]]),
        lambda angle: np.array([angle**2, 2.0 * angle]),
        np.array([0.5, 1.0]),
    )
    angles = np.linspace(0.0, 2.0, 23)
    x, v = solution(angles)[:, :, 0].T
    np.testing.assert_allclose(v, 1.0 + angles**2, rtol=1e-12)
    exact = 0.5 + angles + angles**2 / 2 + 2.0 * angles**3 / 3 + angles**4 / 4
    np.testing.assert_allclose(x, exact, rtol=1e-12)


@pytest.mark.parametrize("sign", [AFTER, BEFORE], ids=["after", "before"])
def test_roots_of_the_angle_from_an_event_are_integrated_to_rounding(sign):
    """v' = root of the angle from an event at 0, which is smooth in the variable of the steps."""
    edges = sign * np.linspace(*((0.0, 1.0) if sign == AFTER else (1.0, 0.0)), 4) ** 2
    intervals = intervals_of(
        np.array([[end, sign, 0.0, 0.0] for end in edges[1:]]), edges[0], edges[-1]
    )
    solution = solved(
        intervals,
        lambda _: np.zeros((2, 2)),
        lambda angle: np.array([0.0, np.sqrt(abs(angle))]),
        np.zeros(2),
    )
    change = solution(edges[-1:])[0, 1, 0]
    assert change == pytest.approx(2.0 / 3.0, rel=1e-13)


def test_steps_are_cut_at_the_ends_of_the_motion():
    taken = np.array([[0.4, LINEAR, 0.0, 0.0], [1.0, LINEAR, 0.0, 0.0], [1.7, LINEAR, 0.0, 0.0]])
    intervals = intervals_of(taken, 0.5, 1.5)
    np.testing.assert_allclose(intervals.angles, [0.5, 1.0, 1.5])
    places, shares = intervals.find(np.array([0.5, 0.75, 1.5]))
    assert places.tolist() == [0, 0, 1]
    np.testing.assert_allclose(shares, [0.0, 0.5, 1.0])


def test_intervals_are_divided_where_sliding_reverses_or_a_contact_is_almost_lost():
    intervals = even_in_angle(np.linspace(0.0, 4.0, 5))
    points = intervals.points()
    still, deep = np.full((*points.shape, 1), 500.0), np.full((*points.shape, 1), 1e-6)
    assert refined(intervals, still, deep).angles.tolist() == intervals.angles.tolist()
    reversing = 200.0 * (points[..., None] - 1.5)
    parts = np.diff(refined(intervals, reversing, deep).angles)
    assert np.sum(parts < 0.5) >= 8  # the second interval alone
    assert parts.min() < 0.05 and parts.sum() == pytest.approx(4.0)
    almost_lost = 1e-6 * ((points[..., None] - 2.5) ** 2 + 1e-2)
    assert np.diff(refined(intervals, still, almost_lost).angles).min() < 0.2


def test_weights_integrate_polynomials_exactly():
    nodes, weights = gauss_collocation(4)
    shares = np.array([0.0, 0.3, 1.0])
    for power in range(4):
        exact = shares ** (power + 1) / (power + 1)
        np.testing.assert_allclose(integral_weights(4, shares) @ nodes**power, exact, atol=1e-14)
        np.testing.assert_allclose(weights @ nodes**power, nodes ** (power + 1) / (power + 1))
