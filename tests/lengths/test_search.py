"""Both searches of the lengths, the regions that they keep to, and the valley that they end in."""

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
    intermediate_crossover,
    rank_expectation,
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
    if not normals:
        return np.linalg.norm(downhill) < 1e-3
    shares, *_ = np.linalg.lstsq(np.array(normals).T, downhill, rcond=None)
    return (
        np.all(shares >= -1e-9) and np.linalg.norm(downhill - np.array(normals).T @ shares) < 1e-3
    )


def test_end_points_meet_the_conditions_of_an_optimum_at_bounds_and_on_the_inequality(
    objective, region, cut_region
):
    for within, words in (
        (region, "at its upper bound"),
        (cut_region, "crank length at 0.262 times the rod length"),
    ):
        ends = [result.lengths for result in search_from_all(objective, within, 1e-12)]
        assert np.max(np.ptp(ends, axis=0)) < 1e-7  # all starts end at one point
        for lengths in ends:
            assert within.contains(lengths, slack=1e-9) and words in within.active(lengths)
            assert multipliers_are_right(objective, within, lengths)
    with pytest.raises(InputError, match=r"ratio_limit 0\.2 excludes the whole box"):
        Region.of(Box(crank_length=(0.147, 0.153), rod_length=(0.555, 0.564)), 0.2)


OPTIONS = Genetic(population=20, generations=100, seed=5)


@pytest.fixture(scope="module")
def run(objective, region):
    return evolve(objective, region, OPTIONS)


def test_it_comes_near_what_local_searches_and_a_dense_grid_find(objective, region, run):
    best = min(result.value for result in search_from_all(objective, region, 1e-12))
    assert best * (1 - 1e-9) <= run.value <= best * (1 + 1e-3)
    cranks, rods = np.meshgrid(*np.linspace(region.lower, region.upper, 61).T)
    points = np.stack([cranks.ravel(), rods.ravel()], axis=1)
    points = points[region.contains(points, slack=1e-12)]
    assert run.value <= min(
        np.min(objective.value(part)) for part in np.array_split(points, 10)
    ) * (1 + 1e-3)


def test_each_generation_has_the_configured_shares_and_feasible_lengths(objective, region, run):
    for number, generation in run.history.groupby("generation"):
        origins = generation["origin"].value_counts().to_dict()
        assert origins == (
            {"first": 20} if number == 0 else {"elite": 2, "crossover": 14, "mutation": 4}
        )
    lengths = run.history[["crank_length", "rod_length"]].to_numpy()
    assert region.contains(lengths, slack=1e-15).all()
    values = run.history["objective"].to_numpy()
    assert objective.value(lengths) == pytest.approx(values, rel=1e-13)


def test_a_seed_repeats_the_search(objective, region):
    histories = [
        evolve(objective, region, Genetic(population=8, generations=3, seed=seed)).history
        for seed in (5, 5, 6)
    ]
    assert histories[0].equals(histories[1]) and not histories[0].equals(histories[2])


REGION = Region.of(Box(crank_length=(0.147, 0.153), rod_length=(0.555, 0.564)), 0.27)


@given(
    weights=st.lists(st.floats(0.01, 10.0), min_size=2, max_size=30),
    count=st.integers(1, 80),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=50, deadline=None)
def test_each_parent_is_taken_within_one_of_its_expectation(weights, count, seed):
    expectation = np.array(weights) / np.sum(weights)
    chosen = stochastic_uniform(expectation, count, np.random.default_rng(seed))
    taken = np.bincount(chosen, minlength=len(weights))
    assert taken.sum() == count
    assert np.all(np.abs(taken - count * expectation) < 1.0 + 1e-9)


def test_rank_counts_and_not_the_value():
    assert rank_expectation(np.array([3.0, 1.0, 2.0])) == pytest.approx(
        rank_expectation(np.array([1e9, -5.0, 0.0]))
    )
    shares = rank_expectation(np.array([10.0, 20.0, 30.0, 40.0]))
    assert shares / shares[0] == pytest.approx([1.0, 1 / np.sqrt(2), 1 / np.sqrt(3), 0.5])
    assert shares.sum() == pytest.approx(1.0)


def test_children_lie_between_their_parents_and_mutants_in_the_region_up_to_its_bounds():
    random = np.random.default_rng(0)
    first, second = REGION.sample(2000, random), REGION.sample(2000, random)
    children, mutants = (
        intermediate_crossover(first, second, random),
        feasible_mutation(first, REGION, random),
    )
    across = np.cross(
        np.pad(second - first, ((0, 0), (0, 1))), np.pad(children - first, ((0, 0), (0, 1)))
    )[:, 2]
    assert np.max(np.abs(across)) < 1e-17
    assert (
        REGION.contains(children, slack=1e-15).all() and REGION.contains(mutants, slack=1e-15).all()
    )
    moved = np.hypot(*((mutants - first) / REGION.size).T)
    assert 0.0 < moved.min() and 0.9 < moved.max() <= 1.0
    for side in (
        mutants[:, 1] == REGION.upper[1],
        mutants[:, 1] == REGION.lower[1],
        mutants[:, 0] == REGION.lower[0],
    ):
        assert side.any()  # steps cut at a bound end on it


def test_samples_fill_the_region_and_nothing_else():
    points = REGION.sample(5000, np.random.default_rng(1))
    assert points.shape == (5000, 2)
    assert REGION.contains(points).all()
    cranks, rods = np.meshgrid(np.linspace(0.147, 0.153, 2001), np.linspace(0.555, 0.564, 2001))
    by_area = np.mean(cranks[cranks <= 0.27 * rods] > 0.150)
    assert by_area < 0.45  # the inequality cuts off the corner of long cranks and short rods
    assert np.mean(points[:, 0] > 0.150) == pytest.approx(by_area, abs=0.03)


def test_a_step_is_cut_exactly_at_the_edge_it_meets():
    start = np.array([0.149, 0.560])
    assert REGION.reach(start, [0.0, 0.008]) == pytest.approx(0.5)
    assert REGION.reach(start, [-0.004, 0.0]) == pytest.approx(0.5)
    assert REGION.reach(start, [0.0, 0.001]) == 1.0
    to_inequality = 0.27 * 0.560 - 0.149
    assert REGION.reach(start, [2 * to_inequality, 0.0]) == pytest.approx(0.5)
    assert REGION.reach(REGION.upper, [0.0, 0.001]) == 0.0


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
