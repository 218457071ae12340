"""The frozen objective: equation (12), its gradient, measures and evaluation samples."""

import math

import numpy as np
import pytest

from jointgap.config import Optimise, Simulate
from jointgap.lengths.objective import evaluation_samples, frozen_objective, measure
from jointgap.motion.kinematics import clearance_lift

LENGTHS = np.array([0.1492, 0.5611])


def test_the_objective_is_equation_12_summed_by_hand(objective, clearance):
    total = 0.0
    for angle, r2, gamma2, r3, gamma3 in zip(clearance[0], *clearance[1].values(), strict=True):
        desired = math.acos(0.150 * math.sin(angle) / 0.564)
        height = 0.1492 * math.sin(angle) + r2 * math.sin(gamma2) - r3 * math.sin(gamma3)
        total += (desired - math.acos(height / 0.5611)) ** 2
    assert objective.value(LENGTHS) == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_gradient_is_the_derivative(objective, axis):
    step = 1e-5 * np.eye(2)[axis]
    # central differences of fourth order: error about 1e-20 of the fifth derivative
    values = [objective.value(LENGTHS + factor * step) for factor in (-2, -1, 1, 2)]
    slope = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / 12e-5
    assert objective.gradient(LENGTHS)[axis] == pytest.approx(slope, rel=1e-9)


def test_measures_of_a_known_error_are_known():
    assert measure([3.0, -4.0, 0.0, 0.0]) == (2.5, 1.75, 4.0, 25.0)


def test_without_clearance_there_is_no_error_also_with_an_offset(mechanism, clearance):
    angle, vectors = clearance
    slider = mechanism.slider.model_copy(update={"offset": 0.03})
    shifted = mechanism.model_copy(update={"slider": slider})
    for ideal in (mechanism, shifted):
        assert frozen_objective(ideal, angle, 0.0 * angle).value((0.150, 0.564)) < 1e-28
    objective = frozen_objective(shifted, angle, clearance_lift(vectors))
    height = 0.150 * np.sin(angle) + clearance_lift(vectors) - 0.03
    desired = np.arccos((0.150 * np.sin(angle) - 0.03) / 0.564)
    assert objective.error((0.150, 0.564)) == pytest.approx(
        desired - np.arccos(height / 0.564), abs=1e-15
    )


def test_evaluation_samples_are_no_training_points_and_lie_in_the_window():
    def samples(**window):
        return evaluation_samples(Simulate(start_angle=0.7), Optimise(**window), 361)

    indices = samples()["window"]
    assert len(indices) == 3600 - 360
    assert not np.any(indices % 10 == 0) and indices[-1] < 3600
    late = samples(window=("60 deg", "360 deg"))["window"]
    assert late[0] == 601 and len(late) == 2700
    assert list(samples()["settled"][[0, -1]]) == [3 * 3600, 4 * 3600 - 1]
