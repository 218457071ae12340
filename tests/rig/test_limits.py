"""Limits of tolerances, sample grids and plausibility."""

import math

import numpy as np
import pytest

from jointgap.rig.checks import angle_outliers, outliers
from jointgap.rig.sampling import sample_grid
from jointgap.rig.simulate_run import tolerance_for
from tests.rig.rigs import campaign, mechanism


def test_a_film_or_a_small_clearance_reduces_the_tolerance():
    film = {
        "name": "lubricated_joint",
        "site": "piston_pin",
        "parameters": {"viscosity_Pa_s": 0.1, "length_m": 0.01},
    }
    dry, wet = (
        campaign(mechanism(("piston_pin",), effects=effects)).mechanism.applied()
        for effects in ((), (film,))
    )
    assert (tolerance_for(dry), tolerance_for(wet)) == (1e-10, 1e-11)
    assert tolerance_for(dry, 1e-6) == pytest.approx(1e-4 * 5e-4)


def test_the_reach_of_speed_and_first_angle_is_ten_standard_errors_of_the_line_and_half_a_step():
    rng, n, sd, step = np.random.default_rng(0), 4000, 2e-3, 1e-3
    time = np.linspace(5.0, 7.0, n)
    read = 1.0 + 30.0 * (time - time[0]) + sd * rng.standard_normal(n)
    read[100] += 1.0  # an outlier counts neither for the line nor for its scatter
    grid = sample_grid(time, read, speed=29.0, first_angle=None, step=step)
    assert grid.speed == pytest.approx(30.0, abs=5 * math.sqrt(12 / n) * sd / 2.0)
    assert grid.first_angle == pytest.approx(1.0, abs=5 * 2 * sd / math.sqrt(n))
    assert grid.first_reach == pytest.approx(2 * 10 * sd / math.sqrt(n) + step / 2, rel=0.05)
    assert grid.speed_reach == pytest.approx(
        (math.sqrt(12) * 10 * sd / math.sqrt(n) + step / 2) / 2.0, rel=0.05
    )


def test_outliers_are_far_from_the_quartiles_or_the_neighbours():
    values = np.append(np.linspace(-1.0, 1.0, 101), [299.0, 310.0])  # quartiles about -0.5 and 0.5
    assert outliers(values).tolist() == [102]
    time = np.arange(50.0)
    for off, result in ((0.09, []), (0.11, [20])):
        assert angle_outliers(time, 0.1 * time + off * (time == 20)).tolist() == result
