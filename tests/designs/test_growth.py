"""What a small change grows to decides what can be compared."""

import math

import numpy as np
import pytest

from jointgap.core.errors import InputError
from jointgap.designs.statistics import Growth, measure_growth
from tests.dynamics.cases import mechanism, options


def grown(rate: float, revolutions: int = 4, change: float = 1e-11) -> Growth:
    """A change that grows exponentially, exp(rate) a revolution, until it can grow no more."""
    angle = np.linspace(0, 2 * math.pi * revolutions, 1001)
    distance = np.minimum(change * np.exp(rate * angle / (2 * math.pi)), 1e-3)
    return Growth(angle, np.array([distance, distance]) / change, change, 1e-6)


def test_samples_can_be_compared_until_the_change_is_as_large_as_is_useful():
    found = grown(6.0)
    assert found.comparable_until == pytest.approx(2 * math.pi * math.log(1e5) / 6.0, abs=0.03)
    assert "up to 69" in found.verdict and "only statistics" in found.verdict
    assert math.isinf(grown(1.0).comparable_until)
    assert "samples can be compared throughout" in grown(1.0).verdict


def test_a_change_is_forgotten_with_friction_and_grows_without():
    wanted = options(revolutions=3, samples_per_revolution=180)
    rubbing, sliding = (measure_growth(mechanism(friction=mu), wanted, directions=3) for mu in (0.2, 0.0))
    np.testing.assert_allclose(rubbing.factors[:, 0], 1.0, rtol=1e-12)
    assert rubbing.frame()["median"][-180:].max() < 1
    assert "throughout" in rubbing.verdict
    assert sliding.frame()["median"][-180:].min() > 100
    assert set(rubbing.frame().columns) == {"crank_angle", "median", "low", "high"}


def test_a_small_change_grows_in_proportion_to_its_size():
    wanted = options(samples_per_revolution=360)
    one, ten = (measure_growth(mechanism(), wanted, change, directions=2) for change in (1e-11, 1e-10))
    np.testing.assert_allclose(one.factors[:, :90], ten.factors[:, :90], rtol=0.02)


def test_where_all_joints_are_ideal_there_is_nothing_to_change():
    with pytest.raises(InputError, match="all joints are ideal"):
        measure_growth(mechanism(loose=()), options())
