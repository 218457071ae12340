"""The search in windows, on the oscillator: which effects are fitted, which sizes of a spring are tried, and what comes
back."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import Parameter
from jointgap.core.errors import SimulationError
from jointgap.identification.baseline import Baseline
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.fit import FiniteDifferences, fit_hypothesis
from jointgap.identification.likelihood import Estimate, fitted, sensitivities_about
from jointgap.identification.screening import SensitivityRegression
from jointgap.identification.verdict import Thresholds
from jointgap.identification.window_search import search_in_windows
from tests.identification import oscillator
from tests.identification.oscillator import PULL, SPRING, SWING, TURNS, WOBBLE, Oscillator, linear

NOISE_ALONE = Thresholds(rate=0.01, omnibus=1.2, max_gain_threshold=10.0)
NEVER_ENOUGH = replace(NOISE_ALONE, omnibus=0.0)
JUMPS = 1.0, 0.3, 0.03  # fewer than usual, to save time
SIZES = SPRING.vanishing_amplitude + np.geomspace(0.1, 1.6, 10)  # by less than 1.4
HINGE = replace(SPRING, site="hinge", has_site=True, initial_guesses=({"size": 0.2, "damping": 0.1},))
FILM = replace(SWING, initial_guesses=({"size": 0.1}, {"size": 0.25}))
"""Never small."""
STIFFER = {"spring": {"size": 0.3, "damping": 0.0}}
ONE, TWO = {"swing": {"size": 0.3}}, {"swing": {"size": 0.3}, "wobble": {"size": 0.3}}
SMALL = {name: {"size": 0.03} for name in TWO}
"""Of which even none leaves about noise."""


def windows(**changed):
    return oscillator.windows(**{"jumps": JUMPS} | changed)


def problem_of(settings=None, **more):
    return linear(settings=settings or windows(), runs=("slow",), **more)


def selecting(problem, **changed):
    """The problem with other settings of the selection."""
    problem.settings = replace(problem.settings, selection=replace(problem.settings.selection, **changed))
    return problem


def baseline_of(problem):
    """The model as it stands, in windows if it has these."""
    base = fitted(problem)
    return Baseline(problem, FiniteDifferences(problem), base if base.in_windows else fit_hypothesis(problem), base)


def slopes(problem):
    """Their chi2 without an effect, and what they say of single ones, the most promising first by BIC."""
    baseline = baseline_of(problem)
    found = sensitivities_about(problem, baseline.base, baseline.differences)
    return found.residual @ found.residual, SensitivityRegression(found).singles(), len(found.parameters)


def search(problem, limits=NOISE_ALONE, alone=(), **how):
    """What is found, and from here on what a filter was asked for by the search alone."""
    baseline = baseline_of(problem)
    sensitivities = sensitivities_about(problem, baseline.base, baseline.differences)
    problem.model.filtered.clear()
    return search_in_windows(baseline, sensitivities, limits, alone, **how)


def singles(fits):
    return [fit for fit in fits if len(fit.hypothesis) == 1]


def names(fit):
    return {one.name for one in fit.hypothesis}


def springs(place, by_shape=3.0, **more):
    """A problem that has windows with a spring alone. A filter says how far it is from a place among sizes, and as much
    as `by_shape` places for a damping of 0.3."""

    def deviance(effects):
        spring = effects["spring"]
        here = np.interp(spring["size"], SIZES, np.arange(10.0))
        return abs(here - place) + by_shape * spring["damping"] / 0.3

    more = {"candidates": (SWING, SPRING), "hidden": STIFFER} | more
    return problem_of(windowed=lambda effects: "spring" in effects, deviance=deviance, **more)


def failing(problem, fails):
    """The problem of which the effects for which `fails` holds cannot be simulated."""
    known = problem.model.deviance

    def deviance(effects):
        if fails(effects):
            raise SimulationError("no such motion")
        return known(effects)

    problem.model.deviance = deviance
    return problem


def springs_of(problem, asked):
    found = [effects["spring"] for _, effects, jump, turns in problem.model.filtered if asked(jump, turns)]
    return [(int(np.argmin(np.abs(SIZES - one["size"]))), one["damping"]) for one in found]


def tried(problem):
    """Places and dampings of the sizes that the filter was asked for over one turn, in order."""
    return springs_of(problem, lambda jump, turns: turns == 1.0)


def begun(problem):
    """The same of those from which a fit began."""
    return springs_of(problem, lambda jump, turns: turns > 1.0 and jump == JUMPS[0])


# Effects that slopes lead to


def test_of_two_hidden_effects_that_no_single_one_stands_for_the_pair_is_found_as_long_as_the_budget_lasts():
    problem = problem_of(hidden=TWO)
    fits = search(problem)
    assert names(fits[0]) == {"swing", "wobble"}
    assert [fits[0].mapping[f"{name}.size"] for name in TWO] == pytest.approx([0.3, 0.3], abs=0.02)
    assert [fit.chi2 for fit in fits] == sorted(fit.chi2 for fit in fits)
    assert fits[0].states["slow"].shape == (TURNS * problem.model.per_turn, 2)
    fits = search(selecting(problem, max_simulations=0))
    assert {len(fit.hypothesis) for fit in fits} == {1} and all(fit.simulations > 0 for fit in fits)


def test_an_effect_that_cannot_be_simulated_is_left_out_and_is_no_measure_for_others():
    fits = search(failing(problem_of(hidden=TWO), lambda effects: "swing" in effects))
    assert "wobble" in {fit.label for fit in fits} and not any("swing" in fit.label for fit in fits)


def test_the_partner_of_a_size_whose_windows_leave_much_more_than_noise_is_found_and_the_size_alone_goes_no_further():
    problem = springs(6.4, hidden=ONE | STIFFER)
    (spring,) = Estimate(problem, (SPRING,), {"spring.size": 0.3}).anneal().stages[-1:]
    assert spring.cost > problem.settings.stopping.poor_chi2_per_sample * problem.size
    fits = search(problem)
    assert names(fits[0]) == {"spring", "swing"} and singles(fits) == []
    assert fits[0].mapping["spring.size"] == pytest.approx(0.3, abs=0.02)
    # no partner is sought where an effect that slopes led to leaves less
    less = replace(fit_hypothesis(problem), residual=np.full(problem.size, 1.2))
    assert search(problem, alone=[less]) == []
    assert begun(problem) and all(len(effects) == 1 for _, effects, *_ in problem.model.filtered)


def test_where_the_base_leaves_noise_an_effect_is_fitted_if_it_promises_more_than_half_of_what_chance_does():
    problem = problem_of(candidates=(SWING, WOBBLE, PULL, SPRING, FILM))
    assert search(problem) == [] and problem.model.filtered == []
    problem = problem_of(hidden=SMALL)
    without, (first, *_), count = slopes(problem)
    gain = without + count * math.log(problem.size) - first.bic
    assert reduced_chi2(baseline_of(problem).base) < NOISE_ALONE.omnibus
    for factor, fits in ((0.999, True), (1.001, False)):
        chance = factor * gain / problem.settings.selection.linear_share
        assert bool(search(problem, replace(NOISE_ALONE, max_gain_threshold=chance))) == fits


def test_an_effect_that_is_sufficient_gets_the_partner_that_gains_more_than_chance():
    problem = problem_of(hidden={"swing": {"size": 0.1}, "wobble": {"size": 0.05}})
    fits = search(problem)
    single, pair = (min((f for f in fits if len(f.hypothesis) == n), key=lambda f: f.bic) for n in (1, 2))
    assert reduced_chi2(single) < NOISE_ALONE.omnibus
    assert names(pair) == {"swing", "wobble"} and single.bic - pair.bic > 10.0
    assert all(len(fit.hypothesis) == 1 for fit in search(problem, replace(NOISE_ALONE, max_gain_threshold=1e3)))


def test_a_whole_number_is_held_where_slopes_say_and_is_among_the_values_of_a_fit():
    order = Parameter("order", 1.0, 1.0, 5.0, 1e-3, whole=True)
    whole = replace(SWING, coordinates=(*SWING.coordinates, order), initial_guesses=({"order": 2.0},))
    problem = problem_of(hidden=ONE, candidates=(whole,))
    (fit,) = search(problem)
    assert {effects["swing"]["order"] for _, effects, *_ in problem.model.filtered} == {2.0}
    assert fit.mapping["swing.order"] == 2.0


# Effects that have no windows


def film_in(candidates, **more):
    """A problem that has no windows with a film, and how often the filter was asked before each try of the film."""
    problem, asked = problem_of(candidates=candidates, windowed=lambda effects: "swing" not in effects, **more), []

    def simulate(run, values, effects=(), numerics=0):
        asked.append(len(problem.model.filtered))
        return Oscillator.simulate(problem.model, run, values, effects, numerics)

    problem.model.simulate = simulate
    return problem, asked


def test_a_film_is_fitted_to_one_trajectory_from_the_best_of_its_sizes_when_all_else_is_tried():
    problem, asked = film_in((FILM, WOBBLE, SPRING), hidden=ONE, settings=windows(fitted_sizes=1))
    fit, *others = search(problem)
    assert fit.hypothesis == (FILM,) and not fit.in_windows
    assert fit.mapping["swing.size"] == pytest.approx(0.3, abs=0.01)
    residual = problem.residual(fit.mapping, (FILM,))
    assert fit.chi2 == pytest.approx(residual @ residual) and fit.chi2 < 1.1 * problem.size
    assert begun(problem) and all(other.in_windows for other in others)
    assert set(asked) == {len(problem.model.filtered)}


def test_no_film_is_tried_where_something_in_windows_leaves_noise_nor_fitted_if_it_leaves_more_than_the_base():
    problem, asked = film_in((FILM, WOBBLE), hidden={"wobble": {"size": 0.3}})
    (fit,) = search(problem)
    assert fit.hypothesis == (WOBBLE,) and asked == []
    problem, asked = film_in((FILM,), hidden={"swing": {"size": -0.3}})
    assert search(problem) == [] and len(asked) == len(FILM.initial_guesses)


# Sizes that are tried


def test_every_size_of_the_range_is_tried_and_the_best_in_all_its_shapes():
    for place, best in ((0.0, 0), (3.2, 3), (9.0, 9)):
        problem = springs(place, settings=windows(tried_sizes=1, fitted_sizes=1))
        search(problem)
        assert tried(problem) == [*((at, 0.0) for at in range(len(SIZES))), (best, 0.3)]
        assert begun(problem) == [(best, 0.0)]
        asked = {
            (effects["spring"]["size"], jump) for _, effects, jump, turns in problem.model.filtered if turns == 1.0
        }
        assert sorted(size for size, _ in asked) == pytest.approx(SIZES, abs=1e-12)
        assert {jump for _, jump in asked} == {JUMPS[0]}
    wide = springs(0.0, settings=windows(size_factor=100.0, fitted_sizes=1))
    search(wide)
    assert {place for place, _ in tried(wide)} == {0, 9}


def test_of_sizes_that_are_neighbours_the_best_alone_is_fitted_in_its_better_shape():
    problem = springs(4.1, settings=windows(tried_sizes=4, fitted_sizes=3))
    search(problem)
    assert begun(problem) == [(4, 0.0), (6, 0.0), (2, 0.0)]
    assert tried(problem)[-4:] == [(4, 0.3), (6, 0.3), (2, 0.3), (8, 0.3)]
    problem = springs(4.1, by_shape=-0.5, settings=windows(fitted_sizes=1))
    search(problem)
    assert begun(problem) == [(4, 0.3)]
    # the same size of two effects is no neighbour
    problem = springs(4.1, candidates=(SPRING, HINGE), settings=windows(tried_sizes=2, fitted_sizes=2))
    assert {fit.label for fit in search(problem)} == {"spring", "spring:hinge"}
    assert begun(problem) == [(4, 0.0), (4, 0.1)]


def test_sizes_are_not_tried_when_an_effect_leaves_noise_or_when_asked_not_to_and_slopes_do_not_lead_to_them():
    problem = problem_of(hidden=ONE, candidates=(SWING, SPRING), settings=windows(fitted_sizes=1))
    (fit,) = search(problem)
    assert not tried(problem)
    search(problem, replace(NOISE_ALONE, omnibus=reduced_chi2(fit)))  # at the limit itself, too
    assert not tried(problem)
    problem.settings = windows(fitted_sizes=1, leading_share=-1.0)
    assert search(problem, NEVER_ENOUGH, sizes=False)
    assert not any("spring" in effects for _, effects, *_ in problem.model.filtered)
    search(problem, NEVER_ENOUGH)
    assert tried(problem)


def test_nothing_is_tried_where_a_candidate_has_no_windows():
    problem = springs(4.0, candidates=(SPRING, HINGE, SWING))
    assert search(problem, sizes=False) == [] and problem.model.filtered == []
    problem.model.windowed = lambda effects: effects.get("spring", {}).get("damping") == 0.1
    search(problem)
    assert {damping for _, damping in tried(problem)} == {0.1}
    problem.model.windowed = lambda effects: False
    assert search(problem) == [] and problem.model.filtered == []


def test_a_size_that_cannot_be_simulated_is_no_start():
    problem = springs(4.0, settings=windows(tried_sizes=1, fitted_sizes=1))
    search(failing(problem, lambda effects: abs(effects["spring"]["size"] - SIZES[4]) < 1e-9))
    assert begun(problem) in ([(3, 0.0)], [(5, 0.0)])
