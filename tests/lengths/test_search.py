"""Both searches of the lengths, their regions, and the line of equal ratio that they end on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jointgap.config import Box, Genetic
from jointgap.core.errors import InputError
from jointgap.lengths.region import Region
from jointgap.lengths.search import (
    evolve,
    feasible_mutation,
    search_from_all,
    stochastic_uniform,
)
from jointgap.lengths.tables import valley, valley_floor


def multipliers_are_right(objective, region, lengths):
    """Whether minus the gradient is a combination, with no negative share, of the active
    constraints' normals."""
    scale = region.size
    normals = [
        *np.eye(2)[lengths >= region.upper - 1e-9],
        *-np.eye(2)[lengths <= region.lower + 1e-9],
    ]
    if region.inequality(lengths) >= -1e-9:
        normals.append(np.array([1.0, -region.ratio_limit]) * scale / scale[0])
    downhill = -objective.gradient(lengths) * scale / objective.value(lengths)
    shares, *_ = np.linalg.lstsq(np.array(normals).T, downhill, rcond=None)
    residual = np.linalg.norm(downhill - np.array(normals).T @ shares)
    return np.all(shares >= -1e-9) and residual < 1e-3


@pytest.mark.parametrize(
    "within, words",
    [
        ("region", "at its upper bound"),
        ("cut_region", "crank length at 0.262 times the rod length"),
    ],
)
def test_all_local_searches_end_at_one_point_that_meets_the_conditions_of_an_optimum(
    objective, request, within, words
):
    within = request.getfixturevalue(within)
    ends = [result.lengths for result in search_from_all(objective, within, 1e-12)]
    assert np.max(np.ptp(ends, axis=0)) < 1e-7
    for lengths in ends:
        assert within.contains(lengths, slack=1e-9) and words in within.active(lengths)
        assert multipliers_are_right(objective, within, lengths)


def test_a_ratio_limit_that_excludes_the_box_is_an_error():
    with pytest.raises(InputError, match=r"ratio_limit 0\.2 excludes the whole box"):
        Region.of(Box(crank_length=(0.147, 0.153), rod_length=(0.555, 0.564)), 0.2)


@pytest.fixture(scope="module")
def run(objective, region):
    return evolve(objective, region, Genetic(population=20, generations=100, seed=5))


def test_the_genetic_algorithm_comes_near_the_optimum_of_local_searches_and_of_a_dense_grid(
    objective, region, run
):
    best = min(result.value for result in search_from_all(objective, region, 1e-12))
    assert best * (1 - 1e-9) <= run.value <= best * (1 + 1e-3)
    grid = valley(objective, region)
    assert run.value <= grid.loc[grid["allowed"], "objective"].min() * (1 + 1e-3)


def test_each_generation_has_fixed_shares_and_feasible_lengths(objective, region, run):
    for number, generation in run.history.groupby("generation"):
        shares = {"first": 20} if number == 0 else {"elite": 2, "crossover": 14, "mutation": 4}
        assert generation["origin"].value_counts().to_dict() == shares
    lengths = run.history[["crank_length", "rod_length"]].to_numpy()
    assert region.contains(lengths, slack=1e-15).all()
    assert objective.value(lengths) == pytest.approx(run.history["objective"].to_numpy(), rel=1e-13)


def test_a_seed_repeats_the_search(objective, region):
    histories = [
        evolve(objective, region, Genetic(population=8, generations=3, seed=seed)).history
        for seed in (5, 5, 6)
    ]
    assert histories[0].equals(histories[1]) and not histories[0].equals(histories[2])


@given(
    weights=st.lists(st.floats(0.01, 10.0), min_size=2, max_size=30),
    count=st.integers(1, 80),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=20, deadline=None)
def test_each_parent_is_taken_within_one_of_its_expectation(weights, count, seed):
    expectation = np.array(weights) / np.sum(weights)
    parents = stochastic_uniform(expectation, count, np.random.default_rng(seed))
    taken = np.bincount(parents, minlength=len(weights))
    assert taken.sum() == count
    assert np.all(np.abs(taken - count * expectation) < 1.0 + 1e-9)


def test_mutants_lie_in_the_region_up_to_its_bounds(region):
    random = np.random.default_rng(0)
    parents = region.sample(2000, random)
    mutants = feasible_mutation(parents, region, random)
    assert region.contains(np.vstack([parents, mutants]), slack=1e-15).all()
    moved = np.hypot(*((mutants - parents) / region.size).T)
    assert 0.0 < moved.min() and 0.9 < moved.max() <= 1.0
    # steps cut at a bound or at the inequality end on it
    assert (mutants == region.lower).any(axis=0).all() and (mutants[:, 1] == region.upper[1]).any()
    assert (np.abs(region.inequality(mutants)) < 1e-15).any()


def test_the_valley_floor_is_below_the_grid_and_falls_with_the_rod(objective, region):
    """(1 - R) L3, for the sum of squares (1 - R) L3^2, is constant along the floor."""
    floor, grid = valley_floor(objective, region), valley(objective, region)
    for name, rows in floor.groupby("measure"):
        power = 2 if name == "sum_of_squares" else 1
        invariant = (1 - rows["reduction"]) * rows["rod_length"] ** power
        assert np.ptp(invariant) / invariant.mean() < 2e-5, name  # rod lengths differ by 4 %
    for name, column in (("rms", "rms"), ("sum_of_squares", "objective")):
        lowest = grid.groupby("rod_length")[column].min().to_numpy()
        values = floor.loc[floor["measure"] == name, "value"].to_numpy()
        assert np.all(values <= lowest * (1 + 1e-12))
    best = min(search_from_all(objective, region, 1e-12), key=lambda result: result.value)
    rows = floor[floor["measure"] == "sum_of_squares"]
    on_floor = np.interp(best.lengths[1], rows["rod_length"], rows["value"])
    assert on_floor == pytest.approx(best.value, rel=1e-4)


def test_the_grid_marks_the_lengths_that_the_inequality_excludes(objective, cut_region):
    grid = valley(objective, cut_region)
    is_allowed = grid["crank_length"] <= 0.262 * grid["rod_length"] + 1e-12
    assert np.array_equal(grid["allowed"], is_allowed) and not grid["allowed"].all()
