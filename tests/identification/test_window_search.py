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
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.verdict import Thresholds
from jointgap.identification.window_search import search_in_windows
from tests.identification.oscillator import PULL, SPRING, SWING, TURNS, WOBBLE, Oscillator, linear

NOISE_ALONE = Thresholds(rate=0.01, omnibus=1.2, max_gain_threshold=10.0)
NEVER_ENOUGH = replace(NOISE_ALONE, omnibus=0.0)
JUMPS = 1.0, 0.3, 0.03  # fewer than usual, to save time
SIZES = SPRING.vanishing_amplitude + np.geomspace(0.1, 1.6, 10)  # by less than 1.4
HINGE = replace(SPRING, site="hinge", has_site=True, initial_guesses=({"size": 0.2, "damping": 0.1},))
FILM = replace(SWING, initial_guesses=({"size": 0.1}, {"size": 0.25}))
"""Never small."""
ONE, TWO = {"swing": {"size": 0.3}}, {"swing": {"size": 0.3}, "wobble": {"size": 0.3}}
SMALL = {name: {"size": 0.03} for name in TWO}
"""Of which even none leaves about noise."""


def windows(**changed):
    return replace(DEFAULT_SETTINGS, windows=replace(DEFAULT_SETTINGS.windows, jumps=JUMPS, **changed))


def problem_of(settings=None, **more):
    return linear(settings=settings or windows(), runs=("slow",), **more)


def baseline_of(problem):
    """The model as it stands, in windows if it has these."""
    base = fitted(problem)
    return Baseline(problem, FiniteDifferences(problem), base if base.in_windows else fit_hypothesis(problem), base)


def signatures_of(problem):
    baseline = baseline_of(problem)
    return sensitivities_about(problem, baseline.base, baseline.differences)


def search(problem, limits=NOISE_ALONE, alone=(), sizes=True):
    """What is found, and from here on what a filter was asked for by the search alone."""
    baseline, sensitivities = baseline_of(problem), signatures_of(problem)
    problem.model.filtered.clear()
    return search_in_windows(baseline, sensitivities, limits, alone, **({} if sizes else {"sizes": False}))


def singles(fits):
    return [fit for fit in fits if len(fit.hypothesis) == 1]


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


def begun(problem):
    """The same of those from which a fit began."""
    found = [
        effects["spring"] for _, effects, jump, turns in problem.model.filtered if turns > 1.0 and jump == JUMPS[0]
    ]
    return [(int(np.argmin(np.abs(SIZES - one["size"]))), one["damping"]) for one in found]


def test_of_several_forces_the_hidden_one_is_found_with_the_states_of_its_windows():
    problem = problem_of(hidden=ONE)
    (fit,) = search(problem)
    assert fit.hypothesis == (SWING,)
    assert fit.mapping["swing.size"] == pytest.approx(0.3, abs=0.01)
    assert fit.mapping["drive"] == pytest.approx(0.3, abs=0.01)
    assert fit.chi2 < 1.1 * problem.size
    assert fit.states["slow"].shape == (TURNS * problem.model.per_turn, 2)


def test_of_two_hidden_effects_that_no_single_one_stands_for_the_pair_is_found():
    problem = problem_of(hidden=TWO)
    fits = search(problem)
    assert {one.name for one in fits[0].hypothesis} == {"swing", "wobble"}
    assert fits[0].mapping["swing.size"] == pytest.approx(0.3, abs=0.02)
    assert fits[0].mapping["wobble.size"] == pytest.approx(0.3, abs=0.02)
    assert [fit.chi2 for fit in fits] == sorted(fit.chi2 for fit in fits)


def test_no_second_effect_is_sought_once_the_budget_of_simulated_runs_is_spent():
    problem = problem_of(hidden=TWO)
    problem.settings = replace(problem.settings, selection=replace(problem.settings.selection, max_simulations=0))
    assert {len(fit.hypothesis) for fit in search(problem)} == {1}
    assert all(fit.simulations > 0 for fit in search(problem))


def test_the_partner_of_a_size_whose_windows_leave_much_more_than_noise_is_found_and_the_size_alone_goes_no_further():
    problem = springs(6.4, hidden=ONE | {"spring": {"size": 0.3, "damping": 0.0}})
    (spring,) = Estimate(problem, (SPRING,), {"spring.size": 0.3}).anneal().stages[-1:]
    assert spring.cost > problem.settings.stopping.poor_chi2_per_sample * problem.size
    fits = search(problem)
    assert {one.name for one in fits[0].hypothesis} == {"spring", "swing"}
    assert singles(fits) == []
    assert fits[0].mapping["spring.size"] == pytest.approx(0.3, abs=0.02)


def test_no_partner_is_sought_where_an_effect_that_slopes_led_to_leaves_less():
    problem = springs(6.4, hidden=ONE | {"spring": {"size": 0.3, "damping": 0.0}})
    less = replace(fit_hypothesis(problem), residual=np.full(problem.size, 1.2))
    assert search(problem, alone=[less]) == []
    assert begun(problem) and all(len(effects) == 1 for _, effects, *_ in problem.model.filtered)


def test_effects_begin_below_the_largest_jump_at_the_sizes_that_slopes_say_and_the_values_of_the_base():
    problem = problem_of(hidden=SMALL)
    base, first = baseline_of(problem).base, SensitivityRegression(signatures_of(problem)).singles()[0]
    search(problem)
    assert {jump for _, _, jump, _ in problem.model.filtered} == {JUMPS[1]}
    values, effects, *_ = problem.model.filtered[0]
    assert values == {"drive": base.mapping["drive"], "zero": base.mapping["zero@slow"]}
    assert effects == {first.label: {"size": first.start[f"{first.label}.size"]}}


def test_where_the_base_leaves_noise_and_no_slope_promises_more_than_chance_nothing_is_fitted():
    problem = problem_of(candidates=(SWING, WOBBLE, PULL, SPRING, FILM))
    assert search(problem) == []
    assert problem.model.filtered == []


def test_where_the_base_leaves_noise_an_effect_is_fitted_if_it_promises_more_than_half_of_what_chance_does():
    problem = problem_of(hidden=SMALL)
    sensitivities = signatures_of(problem)
    without = sensitivities.residual @ sensitivities.residual + len(sensitivities.parameters) * math.log(problem.size)
    gain = without - SensitivityRegression(sensitivities).singles()[0].bic
    assert reduced_chi2(baseline_of(problem).base) < NOISE_ALONE.omnibus
    for factor, fits in ((0.999, True), (1.001, False)):
        chance = factor * gain / problem.settings.selection.linear_share
        assert bool(search(problem, replace(NOISE_ALONE, max_gain_threshold=chance))) == fits


def test_beside_such_an_effect_its_rivals_are_fitted():
    problem = problem_of(hidden=SMALL, settings=windows(far_behind=math.inf))
    rivals = SensitivityRegression(signatures_of(problem)).singles()
    for partners in (1, 2, 3):
        selection = replace(problem.settings.selection, partners=partners)
        problem.settings = replace(problem.settings, selection=selection)
        fits = search(problem)
        alone = sorted(fit.label for fit in fits if len(fit.hypothesis) == 1)
        assert alone == sorted(one.label for one in rivals[:partners])


def test_an_effect_that_is_sufficient_gets_the_partner_that_gains_more_than_chance():
    problem = problem_of(hidden={"swing": {"size": 0.1}, "wobble": {"size": 0.05}})
    fits = search(problem)
    single, pair = (min((f for f in fits if len(f.hypothesis) == n), key=lambda f: f.bic) for n in (1, 2))
    assert reduced_chi2(single) < NOISE_ALONE.omnibus
    assert {one.name for one in pair.hypothesis} == {"swing", "wobble"} and single.bic - pair.bic > 10.0
    assert all(len(fit.hypothesis) == 1 for fit in search(problem, replace(NOISE_ALONE, max_gain_threshold=1e3)))


def test_what_promises_less_than_the_share_of_the_best_is_not_fitted():
    problem = problem_of(hidden=SMALL, settings=windows(far_behind=math.inf))
    sensitivities = signatures_of(problem)
    first, second, *_ = (sensitivities.residual @ sensitivities.residual - one.chi2 for one in by_chi2(sensitivities))
    for factor, found in ((0.999, 2), (1.001, 1)):
        problem.settings = windows(far_behind=math.inf, leading_share=factor * second / first)
        assert len(singles(search(problem, NEVER_ENOUGH))) == found


def by_chi2(sensitivities):
    """What slopes say of single effects, the most promising ones first."""
    return sorted(SensitivityRegression(sensitivities).singles(), key=lambda one: one.chi2)


def test_no_more_than_the_leading_effects_are_fitted():
    problem = problem_of(hidden=SMALL)
    for leading in (1, 2, 3):
        problem.settings = windows(far_behind=math.inf, leading_share=-1.0, leading=leading)
        fits = singles(search(problem, NEVER_ENOUGH))
        assert len(fits) == leading
        assert [fit.chi2 for fit in fits] == sorted(fit.chi2 for fit in fits)


def test_what_is_far_behind_at_its_best_jump_goes_no_further():
    problem = problem_of(hidden=SMALL, settings=windows(leading_share=0.0))
    one, two = (Estimate(problem, (each,)).anneal(below=JUMPS[0]) for each in (SWING, WOBBLE))
    behind = (one.best.deviance - two.best.deviance) / problem.size
    first, second = ("wobble", "swing") if behind > 0.0 else ("swing", "wobble")
    for factor, names in ((0.8, [first]), (1.2, [first, second])):
        # both go on to where they are compared, as both lead on
        problem.settings = windows(leading_share=0.0, far_behind=factor * abs(behind), compared_below=0.0)
        assert [fit.label for fit in singles(search(problem, NEVER_ENOUGH))] == names


def test_an_effect_that_cannot_be_simulated_is_left_out_and_is_no_measure_for_others():
    problem = problem_of(hidden=TWO)

    def deviance(effects):
        if "swing" in effects:
            raise SimulationError("no such motion")
        return 0.0

    problem.model.deviance = deviance
    fits = search(problem)
    assert "wobble" in {fit.label for fit in fits} and not any("swing" in fit.label for fit in fits)


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


def test_no_film_is_tried_where_something_in_windows_leaves_noise():
    problem, asked = film_in((FILM, WOBBLE), hidden={"wobble": {"size": 0.3}})
    (fit,) = search(problem)
    assert fit.hypothesis == (WOBBLE,) and asked == []


def test_a_film_that_at_its_best_size_leaves_more_than_the_base_is_not_fitted():
    problem, asked = film_in((FILM,), hidden={"swing": {"size": -0.3}})
    assert search(problem) == [] and len(asked) == len(FILM.initial_guesses)


@pytest.mark.parametrize(("place", "best"), [(0.0, 0), (3.2, 3), (4.8, 5), (9.0, 9)])
def test_every_size_of_the_range_is_tried_and_the_best_in_all_its_shapes(place, best):
    problem = springs(place, settings=windows(tried_sizes=1, fitted_sizes=1))
    search(problem)
    assert tried(problem) == [*((at, 0.0) for at in range(len(SIZES))), (best, 0.3)]
    assert begun(problem) == [(best, 0.0)]
    assert {jump for *_, jump, turns in problem.model.filtered if turns == 1.0} == {JUMPS[0]}


def test_the_sizes_that_are_tried_are_of_the_whole_range():
    problem = springs(9.0, settings=windows(fitted_sizes=1))
    search(problem)
    sizes = sorted({effects["spring"]["size"] for _, effects, _, turns in problem.model.filtered if turns == 1.0})
    assert sizes == pytest.approx(SIZES, abs=1e-12)
    wide = springs(0.0, settings=windows(size_factor=100.0, fitted_sizes=1))
    search(wide)
    sizes = sorted({effects["spring"]["size"] for _, effects, _, turns in wide.model.filtered if turns == 1.0})
    assert sizes == pytest.approx([-0.9, 0.6], abs=1e-12)


def test_of_sizes_that_are_neighbours_the_best_alone_is_fitted():
    problem = springs(4.1, settings=windows(tried_sizes=4, fitted_sizes=3))
    search(problem)
    assert begun(problem) == [(4, 0.0), (6, 0.0), (2, 0.0)]
    assert tried(problem)[-4:] == [(4, 0.3), (6, 0.3), (2, 0.3), (8, 0.3)]


def test_the_better_shape_is_fitted():
    problem = springs(4.1, by_shape=-0.5, settings=windows(fitted_sizes=1))
    search(problem)
    assert begun(problem) == [(4, 0.3)]


def test_the_same_size_of_two_effects_is_no_neighbour():
    problem = springs(4.1, candidates=(SPRING, HINGE), settings=windows(tried_sizes=2, fitted_sizes=2))
    fits = search(problem)
    assert begun(problem) == [(4, 0.0), (4, 0.1)]
    assert {fit.label for fit in fits} == {"spring", "spring:hinge"}


def test_sizes_begin_at_the_values_of_single_runs_and_end_at_the_truth():
    settings = windows()
    settings = replace(settings, windows=replace(settings.windows, jumps=(*JUMPS, 0.001)))
    problem = springs(6.4, settings=settings)
    fits = search(problem)
    values, *_ = problem.model.filtered[0]
    assert values == {"drive": 0.2, "zero": baseline_of(problem).nominal.mapping["zero@slow"]}
    assert fits[0].mapping["spring.size"] == pytest.approx(0.3, abs=0.02)
    assert fits[0].mapping["drive"] == pytest.approx(0.3, abs=0.02)


def test_beside_joints_that_are_loose_sizes_begin_at_the_values_of_the_base():
    problem = problem_of(hidden=TWO, candidates=(SWING, WOBBLE, SPRING), settings=windows(fitted_sizes=1))
    search(problem, NEVER_ENOUGH)
    at = {values["drive"] for values, _, _, turns in problem.model.filtered if turns == 1.0}
    assert at == {baseline_of(problem).base.mapping["drive"]}


def test_sizes_are_not_tried_when_an_effect_leaves_noise_or_when_asked_not_to():
    problem = problem_of(hidden=ONE, candidates=(SWING, SPRING), settings=windows(fitted_sizes=1))
    (fit,) = search(problem)
    assert not tried(problem)
    # at the limit itself, too
    search(problem, replace(NOISE_ALONE, omnibus=reduced_chi2(fit)))
    assert not tried(problem)
    search(problem, NEVER_ENOUGH, sizes=False)
    assert not tried(problem)
    search(problem, NEVER_ENOUGH)
    assert tried(problem)


def test_sizes_are_not_scored_by_slopes():
    problem = problem_of(hidden=TWO, candidates=(SWING, WOBBLE, SPRING), settings=windows(leading_share=-1.0))
    fits = search(problem, NEVER_ENOUGH, sizes=False)
    assert "spring" not in {name for _, effects, *_ in problem.model.filtered for name in effects}
    assert fits


def test_nothing_is_tried_where_a_candidate_has_no_windows():
    problem = springs(4.0, candidates=(SPRING, HINGE, SWING))
    assert search(problem, sizes=False) == []
    assert problem.model.filtered == []
    problem.model.windowed = lambda effects: effects.get("spring", {}).get("damping") == 0.1
    search(problem)
    assert {damping for _, damping in tried(problem)} == {0.1}
    problem.model.windowed = lambda effects: False
    assert search(problem) == []
    assert problem.model.filtered == []


def test_a_size_that_cannot_be_simulated_is_no_start():
    problem = springs(4.0, settings=windows(tried_sizes=1, fitted_sizes=1))
    known = problem.model.deviance

    def deviance(effects):
        if abs(effects["spring"]["size"] - SIZES[4]) < 1e-9:
            raise SimulationError("no such size")
        return known(effects)

    problem.model.deviance = deviance
    search(problem)
    assert begun(problem) in ([(3, 0.0)], [(5, 0.0)])


def test_a_whole_number_is_held_where_slopes_say_and_is_among_the_values_of_a_fit():
    order = Parameter("order", 1.0, 1.0, 5.0, 1e-3, whole=True)
    whole = replace(SWING, coordinates=(*SWING.coordinates, order), initial_guesses=({"order": 2.0},))
    problem = problem_of(hidden=ONE, candidates=(whole,))
    (fit,) = search(problem)
    assert {effects["swing"]["order"] for _, effects, *_ in problem.model.filtered} == {2.0}
    assert fit.mapping["swing.order"] == 2.0
