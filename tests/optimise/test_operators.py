import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jointgap.config import Box
from jointgap.lengths.region import Region
from jointgap.lengths.search import feasible_mutation, intermediate_crossover, rank_expectation, stochastic_uniform

REGION = Region.of(Box(crank_length=(0.147, 0.153), rod_length=(0.555, 0.564)), 0.27)


@given(
    weights=st.lists(st.floats(0.01, 10.0), min_size=2, max_size=30),
    count=st.integers(1, 80),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=200, deadline=None)
def test_each_parent_is_taken_within_one_of_its_expectation(weights, count, seed):
    expectation = np.array(weights) / np.sum(weights)
    chosen = stochastic_uniform(expectation, count, np.random.default_rng(seed))
    taken = np.bincount(chosen, minlength=len(weights))
    assert taken.sum() == count
    assert np.all(np.abs(taken - count * expectation) < 1.0 + 1e-9)


def test_selection_is_fair_in_the_long_run():
    expectation = np.array([0.5, 0.3, 0.15, 0.05])
    random = np.random.default_rng(3)
    taken = sum(np.bincount(stochastic_uniform(expectation, 7, random), minlength=4) for _ in range(4000))
    # each count is 7 p plus an error below 1 in size: its mean over 4000 throws scatters by less than 1/sqrt(4000)
    assert taken / 4000 == pytest.approx(7 * expectation, abs=4 / np.sqrt(4000))


def test_rank_counts_and_not_the_value():
    assert rank_expectation(np.array([3.0, 1.0, 2.0])) == pytest.approx(rank_expectation(np.array([1e9, -5.0, 0.0])))
    shares = rank_expectation(np.array([10.0, 20.0, 30.0, 40.0]))
    assert shares / shares[0] == pytest.approx([1.0, 1 / np.sqrt(2), 1 / np.sqrt(3), 0.5])
    assert shares.sum() == pytest.approx(1.0)


def test_crossover_lies_on_the_line_between_its_parents():
    random = np.random.default_rng(0)
    first, second = REGION.sample(100, random), REGION.sample(100, random)
    children = intermediate_crossover(first, second, random)
    across = np.cross(np.pad(second - first, ((0, 0), (0, 1))), np.pad(children - first, ((0, 0), (0, 1))))[:, 2]
    assert np.max(np.abs(across)) < 1e-17
    assert REGION.contains(children, slack=1e-15).all()


def test_mutants_stay_in_the_region_and_reach_all_of_it():
    random = np.random.default_rng(0)
    parents = REGION.sample(2000, random)
    mutants = feasible_mutation(parents, REGION, random)
    assert REGION.contains(mutants, slack=1e-15).all()
    moved = np.hypot(*((mutants - parents) / REGION.size).T)
    assert 0.0 < moved.min() and 0.9 < moved.max() <= 1.0
    for side in (mutants[:, 1] == REGION.upper[1], mutants[:, 1] == REGION.lower[1], mutants[:, 0] == REGION.lower[0]):
        assert side.any()  # steps cut at a bound end on it
