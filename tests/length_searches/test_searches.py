"""Searches for the best lengths: each finds the optimum of a known error, within its budget of CPU time."""

import itertools

import numpy as np
import pytest

from jointgap.design_networks.design_space import design_space
from jointgap.design_networks.settled_motion import SettledMotion
from jointgap.length_searches.cma_search import cma_search
from jointgap.length_searches.error_surrogate import train_surrogate
from jointgap.length_searches.learned_search import LearnedObjective, learned_search
from jointgap.length_searches.settings import SETTINGS
from jointgap.length_searches.training_pool import LEAST_DESIGNS, fill_pool
from jointgap.lengths.region import Region
from tests.design_networks.spaces import scenario

REGION = Region(np.array([0.148, 0.560]), np.array([0.152, 0.568]), 0.27)
ORIGINAL = 0.15, 0.564
BEST = np.array([0.1510, 0.5662])


class Clock:
    """Time that goes on by a fixed step whenever somebody looks."""

    def __init__(self, step: float):
        self.ticks = itertools.count()
        self.step = step

    def __call__(self) -> float:
        return next(self.ticks) * self.step


def squares(lengths: np.ndarray) -> np.ndarray:
    """A narrow valley along the ratio of the lengths, with its lowest point at `BEST`."""
    away = (lengths - BEST) / REGION.size
    return 1e-6 + 4e-4 * (away[:, 0] - away[:, 1]) ** 2 + 1e-5 * (away[:, 0] + away[:, 1]) ** 2


def test_cma_es_finds_the_lowest_point_of_a_narrow_valley():
    steps = cma_search(lambda at: np.sqrt(squares(at)), REGION, np.array(ORIGINAL), 1, SETTINGS, Clock(1.0), 150.0)
    assert steps[0].error == pytest.approx(np.sqrt(squares(np.array([ORIGINAL])))[0])
    assert steps[-1].error == pytest.approx(1e-3, rel=1e-3)
    np.testing.assert_allclose(steps[-1].lengths, BEST, atol=1e-4)
    assert np.all(np.diff([step.error for step in steps]) <= 0.0)


def test_cma_es_stays_in_the_region_and_ends_with_its_budget():
    tried = []

    def error(lengths):
        tried.append(lengths)
        return lengths[:, 1] - lengths[:, 0]  # the best lengths are at two bounds and beyond the ratio's limit

    region = Region(REGION.lower, REGION.upper, 0.268)
    steps = cma_search(error, region, np.array(ORIGINAL), 1, SETTINGS, Clock(0.5), 10.0)
    assert region.contains(np.concatenate(tried), slack=1e-9).all()
    assert steps[-1].evaluations == len(np.concatenate(tried))
    assert 10.0 <= steps[-1].cpu_time + 2 * 0.5 <= 12.0


def test_cma_es_goes_round_lengths_that_cannot_be_simulated():
    def error(lengths):
        return np.where(lengths[:, 0] > 0.1515, np.nan, np.sqrt(squares(lengths)))

    steps = cma_search(error, REGION, np.array(ORIGINAL), 3, SETTINGS, Clock(1.0), 150.0)
    np.testing.assert_allclose(steps[-1].lengths, BEST, atol=2e-4)


def test_the_search_on_what_was_learned_finds_the_lowest_point_wherever_its_zero_lies():
    for shift in (0.0, -1e-5):  # a surrogate of squares may lie below 0
        found = learned_search(lambda at, shift=shift: squares(at) + shift, REGION, ORIGINAL, SETTINGS)
        np.testing.assert_allclose(found, BEST, atol=2e-6)


def test_slopes_by_differences_are_those_of_the_formula():
    objective = LearnedObjective(squares, REGION, ORIGINAL, SETTINGS.difference)
    at = np.array([0.1495, 0.5631])
    away = (at - BEST) / REGION.size
    slope = 8e-4 * (away[0] - away[1]) * np.array([1.0, -1.0]) + 2e-5 * (away[0] + away[1])
    ratio = objective.gradient(at) / (slope / REGION.size)
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-6)
    assert objective.value(ORIGINAL) == 1.0


@pytest.fixture(scope="module")
def motion():
    return SettledMotion(design_space(scenario()), 36)


def test_the_surrogate_of_an_error_that_is_a_polynomial_is_exact(motion):
    space = motion.space

    def formula(design, lengths):
        return squares(lengths) * (1.0 + 0.3 * space.inputs(design, lengths)[:, -1])

    designs = list(space.drawn(128, 0))
    errors = np.sqrt([formula(each, np.array([each.lengths]))[0] for each in designs])
    surrogate = train_surrogate(space, designs, errors, 0, SETTINGS)
    for design in space.fresh(4, [7]):
        lengths = np.array([design.lengths, ORIGINAL])
        np.testing.assert_allclose(surrogate.squares(design, lengths), formula(design, lengths), rtol=1e-6)


def test_a_pool_charges_a_smaller_budget_for_what_it_would_have_simulated_alone(motion):
    pool = fill_pool(motion, 64, 0, np.inf, Clock(0.25), 1)
    assert len(pool.designs) == 64
    assert pool.simulations.tolist() == list(range(1, 65))
    assert np.all(np.diff(pool.cpu_time) >= 0.0)
    part = pool.within(pool.cpu_time[39])
    assert len(part.designs) == 40 or pool.cpu_time[40] == pool.cpu_time[39]
    assert len(pool.within(0.0).designs) == LEAST_DESIGNS
    small = fill_pool(motion, 32, 0, np.inf, Clock(0.25), 2)
    np.testing.assert_array_equal(small.vectors, pool.vectors[:32])


def test_a_pool_ends_with_its_budget(motion):
    pool = fill_pool(motion, 10_000, 0, 5.0, Clock(1.0), 1)
    assert len(pool.designs) == 3 * 16  # the least that is simulated, whatever it costs
