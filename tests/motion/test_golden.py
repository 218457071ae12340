"""Trajectories stay those of the hand-written slider-crank, as far as rounding does not matter."""

import numpy as np
import pytest

from tests.motion.golden import CASES, FILE, POSITIONS, trajectory

LEAST_ROWS = 4
"""Samples, 10 deg apart, up to which every case is reproducible."""

BOUNDS = 1e-12, 1e-8
"""Of positions [m], and of other columns over their largest value."""

STIFF = {"friction lugre": (3e-11, 1e-8), "all at once": (1e-12, 3e-7), "film": (1e-12, 5e-8)}
"""`BOUNDS` with stiff bristles and films: there the stored trajectories, at a tolerance of 1e-13 m,
are no more accurate. With bristles at 3e-15 m the hand-written equations agree with any others to
8e-13 m and 3e-8."""


@pytest.mark.parametrize("name", CASES)
def test_a_motion_agrees_with_the_hand_written_equations(name):
    """To the bounds, or to three times the change by the tolerance."""
    with np.load(FILE) as file:
        expected, change = file[name]
    assert len(expected) >= LEAST_ROWS
    found = trajectory(name)[: len(expected)]
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    position, other = STIFF.get(name, BOUNDS)
    bound = other * (np.nan_to_num(np.abs(expected)).max(axis=0) + 1.0)
    bound[POSITIONS] = position
    assert (np.nan_to_num(np.abs(found - expected)) <= bound + 3.0 * change).all()
