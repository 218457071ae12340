import numpy as np

from jointgap.lengths import search as local
from jointgap.lengths.objective import Objective
from jointgap.lengths.search import search, search_from_all, starting_points


def multipliers_are_right(objective, region, lengths):
    """Whether minus the gradient is a combination, with no negative share, of the active constraints' normals."""
    scale = region.size
    normals = []
    for axis in range(2):
        unit = np.eye(2)[axis]
        if lengths[axis] >= region.upper[axis] - 1e-9:
            normals.append(unit)
        if lengths[axis] <= region.lower[axis] + 1e-9:
            normals.append(-unit)
    if region.inequality(lengths) >= -1e-9:
        normals.append(np.array([1.0, -region.ratio_limit]) * scale / scale[0])
    downhill = -objective.gradient(lengths) * scale / objective.value(lengths)
    if not normals:
        return np.linalg.norm(downhill) < 1e-3
    shares, *_ = np.linalg.lstsq(np.array(normals).T, downhill, rcond=None)
    return np.all(shares >= -1e-9) and np.linalg.norm(downhill - np.array(normals).T @ shares) < 1e-3


def test_end_points_meet_the_conditions_of_an_optimum(objective, region):
    for result in search_from_all(objective, region, 1e-12):
        assert result.converged
        assert region.contains(result.lengths, slack=1e-12)
        assert multipliers_are_right(objective, region, result.lengths)


def test_end_points_on_the_inequality_meet_the_conditions_of_an_optimum(objective, cut_region):
    for result in search_from_all(objective, cut_region, 1e-12):
        assert cut_region.contains(result.lengths, slack=1e-9)
        assert "crank length at 0.262 times the rod length" in cut_region.active(result.lengths)
        assert multipliers_are_right(objective, cut_region, result.lengths)


def test_the_optimum_lies_where_the_valley_leaves_the_box(objective, region):
    for result in search_from_all(objective, region, 1e-12):
        assert "at its upper bound" in region.active(result.lengths)


def test_all_starts_end_at_one_point_when_the_tolerance_is_tight(objective, region):
    ends = np.array([result.lengths for result in search_from_all(objective, region, 1e-12)])
    assert np.max(np.ptp(ends, axis=0)) < 1e-7


def test_a_loose_tolerance_leaves_them_apart_in_the_valley(objective, region):
    results = search_from_all(objective, region, 1e-2)
    ends = np.array([result.lengths for result in results])
    best = min(result.value for result in search_from_all(objective, region, 1e-12))
    assert np.ptp(ends[:, 1]) > 1e-3
    assert all(result.value < 1.1 * best for result in results)


def test_paths_start_at_the_start_and_stop_at_the_end(objective, region):
    for start, result in zip(starting_points(region), search_from_all(objective, region, 1e-8), strict=True):
        assert np.array_equal(result.path[0], start)
        assert np.array_equal(result.path[-1], result.lengths)
        assert result.value == objective.value(result.path[-1]) < objective.value(start)


def test_the_six_starts_are_apart_and_allowed(region, cut_region):
    for each in (region, cut_region):
        starts = starting_points(each)
        assert starts.shape == (6, 2)
        assert each.contains(starts, slack=1e-15).all()
    assert len(np.unique(starting_points(region), axis=0)) == 6


def test_every_call_of_the_objective_is_counted(objective, region, monkeypatch):
    calls, value = [], Objective.value
    monkeypatch.setattr(Objective, "value", lambda self, lengths: calls.append(lengths) or value(self, lengths))
    result = search(objective, region, starting_points(region)[0], 1e-8)
    assert len(result.values) == result.evaluations and min(result.values) == result.value
    assert len(calls) - 2 == result.evaluations  # less the value at the original lengths and the one reported


def test_a_search_that_does_not_finish_says_so(objective, region, monkeypatch):
    stopped = local.minimize
    monkeypatch.setattr(
        local, "minimize", lambda *a, **k: stopped(*a, **k | {"options": {"maxiter": 1, "ftol": 1e-12}})
    )
    result = search(objective, region, starting_points(region)[0], 1e-12)
    assert not result.converged
    assert result.status.startswith("not converged (iteration limit reached)")
