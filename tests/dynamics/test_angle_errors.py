"""The errors of a smooth angle, from how it was made, are those that noise makes when it is drawn again and again."""

import numpy as np
import pytest
from scipy.sparse import eye_array

from jointgap.dynamics.drive import AngleErrors, smooth_angle

SPEED, TURNS, PER_TURN, NOISE = 30.0, 5, 30, 1e-3


def crank(unsteady: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and true angles of a crank that runs ahead, by so many rad, in its first two orders and once in a while."""
    time = np.arange(TURNS * PER_TURN) * (2 * np.pi / SPEED / PER_TURN)
    phase = SPEED * time
    return time, 0.4 + phase + unsteady * (np.sin(phase) + 0.3 * np.cos(2 * phase) + 0.5 * np.sin(phase / 3.7))


@pytest.mark.parametrize(
    ("unsteady", "stepped"), [(0.0, False), (0.05, False), (0.0, True)], ids=["steady", "unsteady", "stepped"]
)
def test_errors_are_as_large_as_those_of_drawn_noise(unsteady, stepped):
    time, true = crank(unsteady)
    rng, inside = np.random.default_rng(0), slice(PER_TURN // 2, -PER_TURN // 2)
    resolution = np.sqrt(12.0) * NOISE if stepped else None  # a quintic for white noise of that size
    drawn, told = [], []
    for draw in range(24):
        angle = true + NOISE * rng.standard_normal(time.size)
        smooth = smooth_angle(time, angle, resolution)
        drawn.append([smooth(time, derivative)[inside] for derivative in range(3)])
        if draw < 3:
            errors = AngleErrors(time, angle, smooth, stepped, eye_array(time.size, format="csr"), None)
            told.append([np.mean(errors(time, derivative)[inside] ** 2) * errors.count for derivative in range(3)])
    for derivative in range(3):
        spread = np.sqrt(np.mean(np.var([each[derivative] for each in drawn], axis=0)))
        assert np.sqrt(np.mean(told, axis=0)[derivative]) == pytest.approx(spread, rel=0.3)
