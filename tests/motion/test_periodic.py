"""Linear periodic motion by collocation."""

from math import tau

import numpy as np
import pytest

from jointgap.motion.periodic import collocated, gauss_collocation

STIFFNESS, DAMPING = 7.3, 0.8


def driven_oscillator(intervals: int, stages: int) -> float:
    """Error after a revolution of x'' = cos(phi) - k x - c x' from the state of its periodic
    solution, in uneven intervals."""
    amplitude = 1.0 / (STIFFNESS - 1.0 + 1j * DAMPING)
    nodes, weights = gauss_collocation(stages)
    even = tau * np.arange(intervals + 1) / intervals
    edges = even + 0.3 * np.sin(even)
    angles = edges[:-1, None] + np.diff(edges)[:, None] * nodes
    derivatives = np.tile([-STIFFNESS, -DAMPING], (intervals, stages, 1, 1))
    force = np.cos(angles)[:, :, None, None]
    found = np.empty((intervals, stages + 1, 2, 1))
    start = np.array([[amplitude.real], [(1j * amplitude).real]])
    collocated(
        np.diff(edges),
        weights,
        np.ones(angles.shape),
        derivatives,
        0.0 * force,
        force,
        start,
        found,
    )
    points = np.column_stack([angles, edges[1:]])
    exact = np.stack(
        [(amplitude * power * np.exp(1j * points)).real for power in (1.0, 1j)], axis=-1
    )
    assert np.abs(found[:, -1, :, 0] - exact[:, -1]).max() == pytest.approx(
        np.abs(found[:, :, :, 0] - exact).max(), rel=50.0
    )
    return float(np.abs(found[:, -1, :, 0] - exact[:, -1]).max())


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_the_order_is_twice_the_number_of_gauss_points(stages):
    coarse, fine = (driven_oscillator(intervals, stages) for intervals in (24, 48))
    assert np.log2(coarse / fine) == pytest.approx(2 * stages, abs=0.35)


def test_changing_pace_and_forced_positions_are_integrated():
    """x' = pace v + p, v' = q with polynomials of the crank angle, which collocation solves
    exactly."""
    nodes, weights = gauss_collocation(3)
    edges = np.linspace(0.0, 2.0, 4)
    angles = edges[:-1, None] + np.diff(edges)[:, None] * nodes
    found = np.empty((3, 4, 2, 1))
    collocated(
        np.diff(edges),
        weights,
        1.0 + angles,
        np.zeros((3, 3, 1, 2)),
        angles[:, :, None, None] ** 2,
        2.0 * angles[:, :, None, None],
        np.array([[0.5], [1.0]]),
        found,
    )
    end = edges[1:]
    np.testing.assert_allclose(found[:, -1, 1, 0], 1.0 + end**2)
    exact = 0.5 + end + end**2 / 2 + 2.0 * end**3 / 3 + end**4 / 4
    np.testing.assert_allclose(found[:, -1, 0, 0], exact)
