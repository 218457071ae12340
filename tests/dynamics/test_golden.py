"""Trajectories stay those of the hand-written slider-crank, to the rounding of a revolution."""

import numpy as np
import pytest

from tests.dynamics.golden import CASES, COLUMNS, FILE, trajectory

POSITION = 1e-12
"""[m] Of clearances and slider."""


@pytest.mark.parametrize("name", CASES)
def test_a_revolution_agrees_with_the_hand_written_equations(name):
    with np.load(FILE) as file:
        expected = file[name]
    found = trajectory(name)
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    apart = np.nan_to_num(np.abs(found - expected).max(axis=0))
    size = np.nan_to_num(np.abs(expected).max(axis=0))
    for column, difference, largest in zip(COLUMNS, apart, size, strict=True):
        if (column.startswith("r") and column[1:].isdigit()) or column == "slider_position":
            assert difference <= POSITION, column
        else:  # forces are steep functions of penetrations of micrometres
            assert difference <= 1e-6 * max(largest, 1e-3), column
