"""Trajectories stay those of the hand-written slider-crank, as far as rounding does not matter."""

import numpy as np
import pytest

from tests.dynamics.golden import CASES, FILE, POSITIONS, trajectory

LEAST_ROWS = 4
"""Samples, 10 deg apart, up to which every case is reproducible."""


@pytest.mark.parametrize("name", CASES)
def test_a_motion_agrees_with_the_hand_written_equations(name):
    """To 1e-12 m (other columns: 1e-8 of the largest value), or to the change by the tolerance."""
    with np.load(FILE) as file:
        expected, change = file[name]
    assert len(expected) >= LEAST_ROWS
    found = trajectory(name)[: len(expected)]
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    bound = 1e-8 * np.nan_to_num(np.abs(expected)).max(axis=0) + 1e-8
    bound[POSITIONS] = 1e-12
    assert (np.nan_to_num(np.abs(found - expected)) <= bound + 3.0 * change).all()
