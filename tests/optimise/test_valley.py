import numpy as np
import pytest

from jointgap.lengths import objective as valley
from jointgap.lengths.objective import MEASURES
from jointgap.lengths.search import search_from_all


@pytest.fixture(scope="module")
def floor(objective, region):
    return valley.best_cranks(objective, region)


def test_the_invariant_is_constant_along_the_floor(floor):
    for name, rows in floor.groupby("measure"):
        spread = np.ptp(rows["invariant"]) / rows["invariant"].mean()
        assert spread < 2e-5, name  # 4 % of rod length along it


def test_the_floor_lies_below_the_grid(objective, region, floor):
    grid = valley.grid(objective, region)
    for name in MEASURES:
        lowest = grid.groupby("rod_length")[name].min().to_numpy()
        assert np.all(floor.query("measure == @name")["value"].to_numpy() <= lowest * (1 + 1e-12))


def test_the_grid_marks_what_the_inequality_forbids(objective, cut_region):
    grid = valley.grid(objective, cut_region)
    assert np.array_equal(grid["allowed"], grid["crank_length"] <= 0.262 * grid["rod_length"] + 1e-12)
    assert not grid["allowed"].all()


def test_at_the_rod_length_of_the_optimum_the_floor_is_the_optimum(objective, region, floor):
    best = min(search_from_all(objective, region, 1e-12), key=lambda result: result.value)
    rows = floor.query("measure == 'sum_of_squares'")
    predicted = np.interp(best.lengths[1], rows["rod_length"], rows["value"])
    assert predicted == pytest.approx(best.value, rel=1e-4)
