"""The search in windows, on the oscillator: which effects are fitted, which sizes of a spring are tried, and what comes
back."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.errors import SimulationError
from jointgap.identification import window_search
from jointgap.identification.baseline import Baseline
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.fit import FAILED, FiniteDifferences, fit_hypothesis
from jointgap.identification.likelihood import Estimate
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.verdict import Thresholds
from jointgap.identification.window_search import search_in_windows
from tests.identification.oscillator import PULL, SPRING, SWING, WOBBLE, linear

NOISE_ALONE = Thresholds(rate=0.01, omnibus=1.2, max_gain_threshold=10.0)
NEVER_ENOUGH = replace(NOISE_ALONE, omnibus=0.0)
JUMPS = 1.0, 0.3, 0.03  # fewer than usual, to save time
SIZES = SPRING.vanishing_amplitude + np.geomspace(0.1, 1.6, 10)  # by less than 1.4
HINGE = replace(SPRING, site="hinge", has_site=True, initial_guesses=({"size": 0.2, "damping": 0.1},))
TWO = {"swing": {"size": 0.03}, "wobble": {"size": 0.03}}


def windows(**changed):
    return replace(DEFAULT_SETTINGS, windows=replace(DEFAULT_SETTINGS.windows, jumps=JUMPS, **changed))


def problem_of(settings=None, **more):
    return linear(settings=settings or windows(), runs=("slow",), **more)


def baseline_of(problem, **base):
    """A baseline, and from here on what a filter is asked for."""
    nominal = fit_hypothesis(problem)
    problem.model.filtered.clear()
    return Baseline(problem, FiniteDifferences(problem), nominal, replace(nominal, **base))


def springs(place, by_shape=3.0, **more):
    """A problem that has windows with a spring alone. A filter says how far it is from a place among sizes, and as much
    as `by_shape` places for a damping of 0.3."""

    def deviance(effects):
        spring = effects["spring"]
        here = np.interp(spring["size"], SIZES, np.arange(10.0))
        return abs(here - place) + by_shape * spring["damping"] / 0.3

    more = {"candidates": (SWING, SPRING), "hidden": {"spring": {"size": 0.3, "damping": 0.0}}} | more
    return problem_of(windowed=lambda effects: "spring" in effects, deviance=deviance, **more)


def tried(problem):
    """Places and dampings of the sizes that the filter was asked for over one turn, in order."""
    found = [effects["spring"] for _, effects, _, turns in problem.model.filtered if turns == 1.0]
    return [(int(np.argmin(np.abs(SIZES - one["size"]))), one["damping"]) for one in found]


def fitted(problem):
    """The same of those from which a fit in windows began."""
    found = [
        effects["spring"] for _, effects, jump, turns in problem.model.filtered if turns > 1.0 and jump == JUMPS[0]
    ]
    return [(int(np.argmin(np.abs(SIZES - one["size"]))), one["damping"]) for one in found]


def test_of_several_forces_the_hidden_one_is_found_first_and_fitted_as_one_trajectory():
    problem = problem_of(hidden={"swing": {"size": 0.03}})
    fits = search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert [fit.hypothesis for fit in fits] == [(SWING,)]
    assert fits[0].mapping["swing.size"] == pytest.approx(0.03, abs=0.01)
    residual = problem.residual(fits[0].mapping, (SWING,))
    assert fits[0].chi2 == pytest.approx(residual @ residual) and fits[0].chi2 < 1.1 * problem.size
    assert fits[0].windows.shape == (4, 3)


def test_of_two_hidden_effects_that_no_single_one_stands_for_the_pair_is_found():
    hidden = {"swing": {"size": 0.3}, "wobble": {"size": 0.3}}
    problem = problem_of(hidden=hidden, settings=windows(far_behind=math.inf))
    fits = search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert {one.name for one in fits[0].hypothesis} == {"swing", "wobble"}
    assert fits[0].mapping["swing.size"] == pytest.approx(0.3, abs=0.02)
    assert fits[0].mapping["wobble.size"] == pytest.approx(0.3, abs=0.02)
    assert all(len(fit.hypothesis) == 1 or fit.chi2 >= fits[0].chi2 for fit in fits)


def test_no_pair_is_tried_where_an_effect_that_slopes_led_to_leaves_less():
    hidden = {"swing": {"size": 0.3}, "wobble": {"size": 0.3}}
    problem = problem_of(hidden=hidden, settings=windows(far_behind=math.inf))
    baseline = baseline_of(problem)
    less = replace(baseline.nominal, residual=np.full(problem.size, 1.2))
    fits = search_in_windows(baseline, NOISE_ALONE, [less])
    assert fits and all(len(fit.hypothesis) == 1 for fit in fits)


def test_a_size_whose_windows_leave_much_more_than_noise_gets_no_trajectory_and_its_partner_is_found():
    hidden = {"spring": {"size": 0.3, "damping": 0.0}, "swing": {"size": 0.3}}
    problem = springs(6.4, hidden=hidden, settings=windows(far_behind=math.inf))
    (spring,) = Estimate(problem, (SPRING,), {"spring.size": 0.3}).anneal().stages[-1:]
    assert spring.cost > problem.settings.stopping.poor_chi2_per_sample * problem.size
    fits = search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert [{one.name for one in fit.hypothesis} for fit in fits[:1]] == [{"spring", "swing"}]
    assert all(len(fit.hypothesis) == 2 for fit in fits)
    assert fits[0].mapping["spring.size"] == pytest.approx(0.3, abs=0.02)


def test_effects_begin_below_the_largest_jump():
    problem = problem_of(hidden=TWO)
    search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert max(jump for _, effects, jump, _ in problem.model.filtered if effects) == JUMPS[1]
    assert max(jump for _, effects, jump, _ in problem.model.filtered if not effects) == JUMPS[0]


def test_a_base_that_knows_its_values_in_windows_begins_there_and_below_the_largest_jump():
    problem = problem_of(hidden=TWO)
    known = np.array([[0.31, 0.1], [50.0, 0.0]])
    search_in_windows(baseline_of(problem, windows=known), NOISE_ALONE)
    values, effects, jump, _ = problem.model.filtered[0]
    assert (values, effects, jump) == ({"drive": 0.31, "zero": 0.1}, {}, JUMPS[1])


def test_a_base_that_knows_nothing_begins_at_nominal_values_but_for_those_of_single_runs():
    problem = problem_of(hidden=TWO)
    baseline = baseline_of(problem)
    search_in_windows(baseline, NOISE_ALONE)
    values, *_ = problem.model.filtered[0]
    assert values == {"drive": 0.2, "zero": baseline.nominal.mapping["zero@slow"]}


def test_what_promises_less_than_the_share_of_the_best_is_not_fitted():
    problem = problem_of(hidden=TWO, settings=windows(far_behind=math.inf))
    first, second, *_ = Estimate(problem, ()).anneal().scores(problem.model.candidates)
    for factor, found in ((0.999, 2), (1.001, 1)):
        problem.settings = windows(far_behind=math.inf, leading_share=factor * second[0] / first[0])
        assert len(search_in_windows(baseline_of(problem), NOISE_ALONE)) == found


def test_no_more_than_the_leading_effects_are_fitted():
    problem = problem_of(hidden=TWO, settings=windows(far_behind=math.inf, leading_share=-1.0))
    for leading in (1, 2, 3):
        problem.settings = windows(far_behind=math.inf, leading_share=-1.0, leading=leading)
        fits = search_in_windows(baseline_of(problem), NOISE_ALONE)
        assert len(fits) == leading
        assert [fit.chi2 for fit in fits] == sorted(fit.chi2 for fit in fits)


def test_what_is_far_behind_in_windows_gets_no_trajectory(monkeypatch):
    given = []

    def fit(estimate, differences, sufficient):
        given.append((estimate.hypothesis[0].name, sufficient))
        return window_search.FITTED(estimate, differences, sufficient)

    monkeypatch.setattr(window_search, "FITTED", window_search.fitted_from, raising=False)
    monkeypatch.setattr(window_search, "fitted_from", fit)
    problem = problem_of(hidden=TWO, settings=windows(leading_share=0.0))
    one, two = (Estimate(problem, (each,)).anneal(below=JUMPS[0]) for each in (SWING, WOBBLE))
    behind = (one.best.deviance - two.best.deviance) / problem.size
    first, second = ("wobble", "swing") if behind > 0.0 else ("swing", "wobble")
    for factor, names in ((0.8, [first]), (1.2, [first, second])):
        given.clear()
        # both go on to where they are compared, as both lead on
        problem.settings = windows(leading_share=0.0, far_behind=factor * abs(behind), compared_below=0.0)
        fits = search_in_windows(baseline_of(problem), NOISE_ALONE)
        assert [name for name, _ in given] == names
        assert given[0][1] == math.inf
    assert given[1][1] == fits[0].chi2
    problem.settings = windows(leading_share=0.0, far_behind=0.0, compared_below=0.0)
    assert len(search_in_windows(baseline_of(problem), NOISE_ALONE)) == 1


def test_a_fit_that_failed_is_last_and_no_measure_for_others():
    problem = problem_of(hidden=TWO, settings=windows(far_behind=math.inf, leading_share=-1.0))
    problem.model.failing = ("swing", "wobble")
    fits = [fit for fit in search_in_windows(baseline_of(problem), NOISE_ALONE) if len(fit.hypothesis) == 1]
    assert [fit.status == FAILED for fit in fits] == [False, True, True] and fits[0].hypothesis == (PULL,)
    assert fits[0].chi2 == pytest.approx(fit_hypothesis(problem).chi2, rel=0.01)


@pytest.mark.parametrize(("place", "best"), [(0.0, 0), (3.2, 3), (4.8, 5), (9.0, 9)])
def test_every_size_of_the_range_is_tried_and_the_best_in_all_its_shapes(place, best):
    problem = springs(place, settings=windows(tried_sizes=1, fitted_sizes=1))
    search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert tried(problem) == [*((at, 0.0) for at in range(len(SIZES))), (best, 0.3)]
    assert fitted(problem) == [(best, 0.0)]
    assert {jump for *_, jump, turns in problem.model.filtered if turns == 1.0} == {JUMPS[0]}


def test_the_sizes_that_are_tried_are_of_the_whole_range():
    problem = springs(9.0, settings=windows(fitted_sizes=1))
    search_in_windows(baseline_of(problem), NOISE_ALONE)
    sizes = sorted({effects["spring"]["size"] for _, effects, _, turns in problem.model.filtered if turns == 1.0})
    assert sizes == pytest.approx(SIZES, abs=1e-12)
    wide = springs(0.0, settings=windows(size_factor=100.0, fitted_sizes=1))
    search_in_windows(baseline_of(wide), NOISE_ALONE)
    sizes = sorted({effects["spring"]["size"] for _, effects, _, turns in wide.model.filtered if turns == 1.0})
    assert sizes == pytest.approx([-0.9, 0.6], abs=1e-12)


def test_of_sizes_that_are_neighbours_the_best_alone_is_fitted():
    problem = springs(4.1, settings=windows(tried_sizes=4, fitted_sizes=3))
    search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert fitted(problem) == [(4, 0.0), (6, 0.0), (2, 0.0)]
    assert tried(problem)[-4:] == [(4, 0.3), (6, 0.3), (2, 0.3), (8, 0.3)]


def test_the_better_shape_is_fitted():
    problem = springs(4.1, by_shape=-0.5, settings=windows(fitted_sizes=1))
    search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert fitted(problem) == [(4, 0.3)]


def test_the_same_size_of_two_effects_is_no_neighbour():
    problem = springs(4.1, candidates=(SPRING, HINGE), settings=windows(tried_sizes=2, fitted_sizes=2))
    fits = search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert fitted(problem) == [(4, 0.0), (4, 0.1)]
    assert {fit.label for fit in fits} == {"spring", "spring:hinge"}


def test_sizes_begin_at_the_values_of_single_runs_and_end_at_the_truth():
    settings = windows()
    settings = replace(settings, windows=replace(settings.windows, jumps=(*JUMPS, 0.001)))
    problem = springs(6.4, settings=settings)
    baseline = baseline_of(problem)
    fits = search_in_windows(baseline, NOISE_ALONE)
    values, *_ = problem.model.filtered[0]
    assert values == {"drive": 0.2, "zero": baseline.nominal.mapping["zero@slow"]}
    assert fits[0].mapping["spring.size"] == pytest.approx(0.3, abs=0.02)
    assert fits[0].mapping["drive"] == pytest.approx(0.3, abs=0.02)


def test_beside_joints_that_are_loose_sizes_begin_at_the_values_of_the_base():
    problem = problem_of(hidden=TWO, candidates=(SWING, WOBBLE, SPRING), settings=windows(fitted_sizes=1))
    search_in_windows(baseline_of(problem), NEVER_ENOUGH)
    at = [values["drive"] for values, _, _, turns in problem.model.filtered if turns == 1.0]
    assert at and np.ptp(at) == 0.0
    assert at[0] == pytest.approx(Estimate(problem, ()).anneal().mapping["drive"], abs=1e-9)


def test_sizes_are_not_tried_when_an_effect_leaves_noise_or_when_asked_not_to():
    settings = windows(fitted_sizes=1)
    problem = problem_of(hidden={"swing": {"size": 0.03}}, candidates=(SWING, SPRING), settings=settings)
    (fit,) = search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert not tried(problem)
    # at the limit itself, too
    search_in_windows(baseline_of(problem), replace(NOISE_ALONE, omnibus=reduced_chi2(fit)))
    assert not tried(problem)
    search_in_windows(baseline_of(problem), NEVER_ENOUGH, sizes=False)
    assert not tried(problem)
    search_in_windows(baseline_of(problem), NEVER_ENOUGH)
    assert tried(problem)


def test_sizes_are_not_scored_by_slopes():
    problem = problem_of(hidden=TWO, candidates=(SWING, WOBBLE, SPRING), settings=windows(leading_share=-1.0))
    fits = search_in_windows(baseline_of(problem), NEVER_ENOUGH, sizes=False)
    assert "spring" not in {name for _, effects, *_ in problem.model.filtered for name in effects}
    assert fits


def test_nothing_is_tried_where_a_candidate_has_no_windows():
    problem = springs(4.0, candidates=(SPRING, HINGE, SWING))
    assert search_in_windows(baseline_of(problem), NOISE_ALONE, sizes=False) == []
    assert problem.model.filtered == []
    problem.model.windowed = lambda effects: effects.get("spring", {}).get("damping") == 0.1
    search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert {damping for _, damping in tried(problem)} == {0.1}
    problem.model.windowed = lambda effects: False
    assert search_in_windows(baseline_of(problem), NOISE_ALONE) == []
    assert problem.model.filtered == []


def test_a_size_that_cannot_be_simulated_is_no_start():
    problem = springs(4.0, settings=windows(tried_sizes=1, fitted_sizes=1))
    known = problem.model.deviance

    def deviance(effects):
        if abs(effects["spring"]["size"] - SIZES[4]) < 1e-9:
            raise SimulationError("no such size")
        return known(effects)

    problem.model.deviance = deviance
    search_in_windows(baseline_of(problem), NOISE_ALONE)
    assert fitted(problem) in ([(3, 0.0)], [(5, 0.0)])


def test_a_base_that_cannot_be_simulated_in_windows_is_the_end():
    problem = problem_of(hidden=TWO, candidates=(SWING, WOBBLE, SPRING))

    def deviance(effects):
        if not effects:
            raise SimulationError("no windows after all")
        return 0.0

    problem.model.deviance = deviance
    assert search_in_windows(baseline_of(problem), NOISE_ALONE) == []
