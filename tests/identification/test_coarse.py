"""Fits that come from afar: they find valleys that fits among samples do not."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.identification import baseline, coarse_search, hypothesis_fits, model_selection
from jointgap.identification import baseline as smoothing
from jointgap.identification.baseline import coarse_to_fine_fit, other_numerics, recalibrate, smoothers_of
from jointgap.identification.coarse_search import search_pairs, search_singles
from jointgap.identification.fit import FAILED, STOPPED, FiniteDifferences, fit_hypothesis
from jointgap.identification.hypothesis_fits import fit_pairs, fit_singles
from jointgap.identification.initial_fit import fit_screened
from jointgap.identification.model_selection import refit_and_decide, shortlist_singles
from jointgap.identification.problem import Problem
from jointgap.identification.screening import simulate_signatures
from jointgap.identification.thresholds import thresholds
from tests.identification.knocks import knocking
from tests.identification.toy import stated_noise, toy


def problem_of(model) -> Problem:
    return Problem(model, stated_noise(model))


def test_noise_keeps_its_variance_in_every_view():
    problem = problem_of(toy(samples=360))
    noise = np.random.default_rng(0).standard_normal((problem.size, 40))
    for smoother in smoothers_of(problem):
        assert np.mean(np.square(smoother(noise))) == pytest.approx(1.0, abs=0.05)
        assert smoother(noise[:, 0]) == pytest.approx(smoother(noise)[:, 0])


def test_a_view_keeps_what_is_slow_and_loses_what_is_sharp():
    problem = problem_of(toy(samples=360))
    spike = np.zeros(problem.size)
    spike[200] = 1.0
    slow = np.sin(np.arange(problem.size) * 2 * np.pi / 360)
    for smoother, samples in zip(smoothers_of(problem), (24, 6), strict=True):
        assert np.abs(smoother(spike)).max() == pytest.approx((np.sqrt(np.pi) * samples) ** -0.5, rel=0.01)
        assert np.abs(smoother(slow)).max() == pytest.approx((2.0 * np.sqrt(np.pi) * samples) ** 0.5, rel=0.1)


def test_nothing_is_seen_from_afar_where_no_angle_is_known_or_statistics_are_compared():
    model = toy()
    for change in ({"angle": np.full(360, np.nan)}, {"statistic": True}):
        assert (
            smoothers_of(problem_of(replace(model, series=tuple(replace(one, **change) for one in model.series)))) == ()
        )


@pytest.mark.parametrize("clearance", [0.93, 0.97, 1.04, 1.08])
def test_a_fit_from_afar_ends_in_the_valley_of_the_truth(clearance):
    problem = problem_of(knocking(clearance=clearance))
    differences = FiniteDifferences(problem)
    near = fit_hypothesis(problem, differences=differences)
    far = coarse_to_fine_fit(problem, (), {}, differences, smoothers_of(problem))
    found = fit_hypothesis(problem, start=far.mapping, differences=differences)
    assert near.chi2 > 3.0 * problem.size
    assert found.chi2 < 1.1 * problem.size
    assert found.mapping["clearance"] == pytest.approx(clearance, abs=1e-3)


def test_a_descent_that_fails_in_a_finer_view_ends_with_the_coarser_fit(monkeypatch):
    problem, made = problem_of(knocking(clearance=1.04)), []

    def once(*args, **options):
        made.append(fit_hypothesis(*args, **options))
        return made[0] if len(made) == 1 else replace(made[-1], status=FAILED)

    monkeypatch.setattr(smoothing, "fit_hypothesis", once)
    assert coarse_to_fine_fit(problem, (), {}, FiniteDifferences(problem), smoothers_of(problem)) is made[0]
    assert len(made) == 2


@pytest.mark.parametrize("is_found_twice", [True, False])
def test_a_poor_fit_of_statistics_is_tried_from_drawn_starts_until_two_find_one_minimum(is_found_twice, monkeypatch):
    model = toy(hidden=lambda x, v, angle, time: -0.3 * v**3, seed=1)
    model = replace(model, series=tuple(replace(one, statistic=True) for one in model.series))
    problem, starts = problem_of(model), []

    def counted(*args, **options):
        starts.append(dict(options.get("start") or args[2]))
        return fit_hypothesis(*args, **options)

    for module in (baseline, smoothing):
        monkeypatch.setattr(module, "fit_hypothesis", counted)
    if not is_found_twice:
        monkeypatch.setattr(baseline, "is_same_minimum", lambda *fits: False)
    baseline.multistart_fit(problem, FiniteDifferences(problem))
    assert len(starts) == (2 if is_found_twice else problem.settings.baseline.max_starts)
    assert len({start["slider_mass"] for start in starts}) == len(starts)


def test_the_base_of_statistics_is_fitted_from_drawn_nuisances_until_its_minimum_is_found_twice(monkeypatch):
    model = toy(hidden=lambda x, v, angle, time: -0.3 * v**3, seed=1)
    model = replace(model, series=tuple(replace(one, statistic=True) for one in model.series))
    base, starts = recalibrate(model, stated_noise(model)), []

    def counted(*args, **options):
        starts.append(dict(options.get("start") or args[2])["slider_mass"])
        return fit_hypothesis(*args, **options)

    monkeypatch.setattr(smoothing, "fit_hypothesis", counted)
    assert model_selection._deepest(base, base.base).chi2 <= base.base.chi2
    (drawn,) = starts
    nominal = next(p.nominal for p in base.problem.nuisances if p.key == "slider_mass")
    assert drawn != nominal


@pytest.mark.parametrize("clearance", [0.92, 1.06])
def test_recalibration_finds_parameters_whose_valley_is_narrow(clearance):
    model = knocking(clearance=clearance, seed=1)
    base = recalibrate(model, stated_noise(model)).base
    assert base.chi2 < 1.1 * base.residual.size
    assert base.mapping["clearance"] == pytest.approx(clearance, abs=1e-3)


def test_an_effect_that_moves_every_knock_is_found_by_the_second_look_alone():
    model = knocking({"spring": {"stiffness_N_m": 2.0}}, clearance=1.05, seed=2)
    base = recalibrate(model, stated_noise(model))
    signatures = simulate_signatures(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, signatures, other_numerics(base.problem, base.base))
    first = [
        fit_screened(base.problem, base.differences, signatures, one) for one in shortlist_singles(signatures, limits)
    ]
    assert min(one.chi2 for one in first) > 2.0 * base.problem.size
    best, *_ = search_singles(base, limits)
    assert best.label == "spring"
    assert best.chi2 < 1.1 * base.problem.size
    fits, _ = fit_singles(base, signatures, limits)
    more, seconds = fit_pairs(base, signatures, limits, fits)
    assert len({one.label for one in more}) == len(more) == len(seconds)
    again = [one for part in (1, 0) for one in fit_pairs(base, signatures, limits, fits[::-1], part, 2)[0]]
    assert [one.label for one in again] == [one.label for one in more]
    assert [one.chi2 for one in again] == [one.chi2 for one in more]
    decision = refit_and_decide(base, signatures, [*fits, *more], limits)
    assert decision.verdict == "named"
    assert decision.chosen.label == "spring"
    assert decision.chosen.mapping["spring.stiffness_N_m"] == pytest.approx(2.0, rel=0.02)


def test_two_effects_that_move_every_knock_are_found_among_few_pairs(monkeypatch):
    hidden = {"spring": {"stiffness_N_m": 2.0}, "coulomb": {"force_N": 0.3}}
    model = knocking(hidden, clearance=1.05, seed=3)
    base = recalibrate(model, stated_noise(model))
    signatures = simulate_signatures(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, signatures, other_numerics(base.problem, base.base))
    fits = [*fit_singles(base, signatures, limits)[0], *search_singles(base, limits)]
    assert min(one.chi2 for one in fits) > 100.0 * base.problem.size
    tried, race = [], coarse_search.successive_elimination

    def successive_elimination(base, chosen, *rest):
        tried.extend([candidate.label for candidate in pair.hypothesis] for pair, _ in chosen)
        return race(base, chosen, *rest)

    monkeypatch.setattr(coarse_search, "successive_elimination", successive_elimination)
    best, *_ = search_pairs(base, fits, limits, smoothers_of(base.problem))
    assert {candidate.label for candidate in best.hypothesis} == hidden.keys()
    assert best.chi2 < 1.1 * base.problem.size
    leading = tried[0][0]
    assert [
        leading,
        "added_mass",
    ] in tried  # small sizes say little of it, but every pair costs: beside the best one alone
    others = [first for first, _ in tried if first != leading]
    assert others and all(
        others.count(first) <= base.problem.settings.coarse_search.partners_per_single for first in others
    )
    assert not any("added_mass" in pair for pair in tried if leading not in pair)


def recalibrated(model):
    base = recalibrate(model, stated_noise(model))
    signatures = simulate_signatures(base.problem, base.base, base.differences)
    return base, signatures, thresholds(base.problem, signatures, other_numerics(base.problem, base.base))


def no_coarse_search(*args):
    raise AssertionError("a search from smoothed residuals")


def test_an_effect_that_missed_its_valley_is_found_from_the_nuisances_of_another_that_did_not(monkeypatch):
    model = knocking({"spring": {"stiffness_N_m": 1.5}}, clearance=1.0, seed=2)
    base, signatures, limits = recalibrated(model)
    spring, viscous = (next(one for one in model.candidates if one.label == label) for label in ("spring", "viscous"))
    astray = fit_hypothesis(base.problem, (spring,), {"clearance": 0.93}, differences=base.differences)
    near = fit_hypothesis(base.problem, (viscous,), {"clearance": 1.06}, differences=base.differences)
    assert astray.chi2 > 10.0 * base.problem.size
    assert near.chi2 > 1.1 * base.problem.size
    monkeypatch.setattr(hypothesis_fits, "search_singles", no_coarse_search)
    found, _ = fit_pairs(base, signatures, limits, [replace(astray, status=STOPPED), near])
    best = min(found, key=lambda fit: fit.bic)
    assert best.label == "spring"
    assert best.chi2 < 1.1 * base.problem.size


def test_two_effects_of_which_one_explains_most_are_found_without_smoothing(monkeypatch):
    hidden = {"viscous": {"damping_N_s_m": 0.8}, "spring": {"stiffness_N_m": 3.0}}
    base, signatures, limits = recalibrated(toy(hidden, seed=3))
    fits, _ = fit_singles(base, signatures, limits)
    monkeypatch.setattr(hypothesis_fits, "search_singles", no_coarse_search)
    found, _ = fit_pairs(base, signatures, limits, fits)
    best = min(found, key=lambda fit: fit.bic)
    assert {candidate.label for candidate in best.hypothesis} == hidden.keys()
    assert best.chi2 < 1.1 * base.problem.size
