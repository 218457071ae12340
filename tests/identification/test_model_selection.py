"""Which hypotheses are fitted, and the gain that a second effect needs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification import model_selection
from jointgap.identification.baseline import recalibrate
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.hypothesis_fits import fit_pairs, fit_singles
from jointgap.identification.initial_fit import labels_of
from jointgap.identification.model_selection import (
    best_sufficient,
    fit_confusable_effects,
    fits_beyond_bounds,
    select_hypothesis,
    shortlist_singles,
    swap_one_effect,
    two_effect_thresholds,
    with_other_ends,
    without_repetitions,
)
from jointgap.identification.problem import Problem
from jointgap.identification.screening import Sensitivities, Sensitivity
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.thresholds import screen_candidates
from jointgap.identification.verdict import Thresholds
from tests.identification.oscillator import HIDDEN_SPRING, SWING, WOBBLE, linear, noise_of, windows
from tests.identification.toy import (
    RINGING,
    analysed,
    candidate_of,
    ringing,
    screened,
    stated_noise,
    toy,
)

SAMPLES = 200
LN = float(np.log(SAMPLES))
DOF = SAMPLES - 1  # one nuisance
LIMITS = Thresholds(rate=0.01, omnibus=1.5, max_gain_threshold=12.0)
WANTED = 0.5 * 12.0  # half of the gain that is called an effect


def effect(name):
    """An effect with one amplitude."""
    return Candidate(name, "slider", (Parameter("size", 0.0),), ("size",))


def shortlisted(rest, gains):
    """Labels shortlisted from sensitivities e0, e1 ... with these gains in chi2 and this
    remainder."""
    residual, unit = np.zeros(SAMPLES), np.eye(SAMPLES)
    residual[1 : len(gains) + 1], residual[-1] = np.sqrt(gains), np.sqrt(rest)
    entries = [
        Sensitivity(effect(f"e{place}"), {}, unit[:, [place + 1]], residual, ("slow",))
        for place in range(len(gains))
    ]
    sensitivities = Sensitivities(
        (Parameter("mass", 1.0),), np.array([1.0]), unit[:, :1], residual, entries, {}
    )
    return [one.label for one in shortlist_singles(sensitivities, LIMITS)]


def fitted(chi2, *effects, status="converged"):
    parameters = (Parameter("mass", 1.0), *(Parameter(f"{c.label}.size", 0.0) for c in effects))
    residual, jacobian = np.zeros(SAMPLES), np.eye(SAMPLES)[:, : len(parameters)]
    residual[-1] = chi2**0.5
    return Fit(effects, parameters, np.ones(len(parameters)), residual, jacobian, 1, status)


TWO = {"viscous": {"damping_N_s_m": 0.8}, "spring": {"stiffness_N_m": 3.0}}
DRY = {"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}}
COULOMB, SPRING = effect("coulomb"), effect("spring")


# Single effects


def test_the_shortlist_depends_on_the_misfit_of_the_base_and_the_gains():
    assert shortlisted(10.0, [float(100 + place) for place in range(10)]) == [
        f"e{place}" for place in range(9, 1, -1)
    ]
    for more, count in ((0.01, 4), (-0.01, 3)):  # three in any case
        gain = LN + WANTED + more
        assert len(shortlisted(100.0, [gain, gain + 1.0, gain + 2.0, gain + 3.0, 0.5])) == count
    assert len(shortlisted(100.0, [0.1, 0.2, 0.3, 0.4])) == 3
    assert len(shortlisted(10.0, [12.0 + 0.1 * place for place in range(10)])) == 8
    assert shortlisted(100.0, []) == []
    for more, count in ((-0.1, 3), (0.1, 4)):  # it leaves noise alone up to what null campaigns do
        assert len(shortlisted(1.5 * DOF + more - 4.0, [1.0, 1.0, 1.0, 1.0])) == count


# A second effect


def test_an_effect_is_sufficient_at_the_level_of_null_campaigns_if_it_beats_the_base():
    base = SimpleNamespace(base=fitted(900.0))
    just, more = (fitted(share * (SAMPLES - 2), COULOMB) for share in (1.4999, 1.5001))
    assert best_sufficient(base, [just], LIMITS) is just
    assert best_sufficient(base, [more], LIMITS) is None
    fits = [fitted(200.0, COULOMB), fitted(190.0, SPRING), fitted(189.0, COULOMB, SPRING)]
    assert best_sufficient(base, fits, LIMITS) is fits[1]
    assert best_sufficient(SimpleNamespace(base=fitted(190.0)), fits, LIMITS) is None


def singles(chi2):
    """Fits of two single effects and a pair; the better single one has this chi2."""
    return [fitted(chi2 + 1.0, SPRING), fitted(chi2, COULOMB), fitted(1.0, SPRING, COULOMB)]


def test_numerical_differences_raise_the_thresholds_of_a_second_effect(monkeypatch):
    """Up to 5 % of the explained 800, if larger than the threshold of one effect."""

    def second(changed, fits):
        row = np.zeros(SAMPLES)
        row[0], row[5] = 99.0, changed**0.5  # the nuisance takes up the first
        monkeypatch.setattr(
            model_selection, "other_numerics", lambda *_: np.array([0.1 * row, row])
        )
        baseline = SimpleNamespace(
            base=fitted(1000.0), problem=SimpleNamespace(settings=DEFAULT_SETTINGS)
        )
        return two_effect_thresholds(baseline, fits, LIMITS)

    changes = [second(changed, singles(200.0)) for changed in (30.0, 50.0)]
    assert [one.max_gain_threshold for one in changes] == pytest.approx([30.0, 40.0])
    assert [one.omnibus for one in changes] == pytest.approx([1.5 + 30.0 / SAMPLES, 1.5])
    assert second(11.0, singles(200.0)) == LIMITS
    for no_single in ([], [fitted(200.0, COULOMB, status=FAILED), fitted(1.0, SPRING, COULOMB)]):
        assert second(30.0, no_single) is LIMITS


# Fits once more


def test_a_second_effect_is_sought_from_the_minimum_of_a_pair():
    """The fit of the nonsmooth effect alone ended elsewhere. The hidden drag replaces friction."""
    model = toy(seed=6, hidden=lambda x, v, angle, _: ringing(0.31, angle) - 0.5 * v)
    base, sensitivities = screened(replace(model, candidates=(*model.candidates, RINGING)))
    start = {"ringing.size": 0.31, "coulomb.force_N": 0.3}
    pair = fit_hypothesis(base.problem, (candidate_of("coulomb"), RINGING), start, refresh=True)
    lost = replace(
        fit_hypothesis(base.problem, (RINGING,), {"ringing.size": 0.5}), status="stopped"
    )
    swapped = {fit.label: fit for fit in swap_one_effect(base, sensitivities, [lost, pair])}
    assert swapped["ringing + viscous"].chi2 < 1.1 * base.problem.size < pair.chi2


@pytest.fixture(scope="module")
def heavier():
    """Hidden: dry friction and a mass beyond its range. Fitted: friction and a sensor gain."""
    base, *found = analysed(
        toy({"coulomb": {"force_N": 0.2}, "added_mass": {"mass_kg": 0.1}}, seed=4)
    )
    pair = tuple(candidate_of(label) for label in ("coulomb", "sensor_gain:acceleration"))
    return base, fit_hypothesis(base.problem, pair, differences=base.differences), *found


def test_an_effect_that_exceeds_a_nuisance_bound_replaces_each_other_effect(heavier):
    base, pair, sensitivities, limits = heavier
    mass = next(p for p in pair.parameters if p.name == "slider_mass")
    assert pair.mapping["slider_mass"] == mass.high
    first, second = fits_beyond_bounds(base, [base.base, pair])
    assert first.label == "sensor_gain:acceleration + added_mass"
    assert second.label == "coulomb + added_mass"
    assert second.bic < pair.bic - 10.0
    assert second.mapping["added_mass.mass_kg"] == pytest.approx(0.1, abs=0.03)
    assert select_hypothesis(base, sensitivities, [pair], limits).chosen.label == second.label
    lost = [replace(fit, status=FAILED) for fit in (first, second)]
    inside = replace(pair, values=np.array([p.nominal for p in pair.parameters]))
    for given in ([pair, *lost], [inside], [base.base]):
        assert fits_beyond_bounds(base, given) == []
    # nothing is missing
    assert fits_beyond_bounds(replace(base, base=replace(pair, hypothesis=())), [pair]) == []
    model, settings = base.problem.model, base.problem.settings
    few = replace(settings, selection=replace(settings.selection, partners=1))
    problem = Problem(model, stated_noise(model), settings=few)
    assert len(fits_beyond_bounds(replace(base, problem=problem), [pair])) == 1


# Explanations that are one


def test_a_special_case_that_predicts_the_same_represents_both():
    """A soft spring that the data cannot distinguish from a constant force is that force."""
    force = fitted(300.0, effect("force"))
    spring = fitted(300.0, effect("soft spring"), effect("preload"))
    for apart, is_limit, count in ((9.9, True, 1), (10.1, True, 2), (0.0, False, 2)):
        spring = replace(
            spring, hypothesis=(effect("soft spring"),), residual=force.residual.copy()
        )
        spring.residual[0] += np.sqrt(apart)
        best = {frozenset([fit.label]): fit for fit in (spring, force)}

        def is_special_case(special, _, is_limit=is_limit):
            return is_limit and special == (effect("force"),)

        found = without_repetitions(best, is_special_case, 10.0)
        assert sorted(fit.label for fit in found.values()) == ["force", "soft spring"][:count]


# Before a name


def test_confusable_effects_are_fitted_before_naming():
    """The hidden quadratic drag was not fitted, and viscous friction would be named."""
    base, found, limits = analysed(
        toy({"quadratic": {"drag_N_s2_m2": 0.04}}, {"slider_mass": 0.51}, seed=4)
    )
    viscous = fit_hypothesis(
        base.problem, (candidate_of("viscous"),), differences=base.differences, refresh=True
    )
    assert viscous.chi2 < limits.omnibus * base.problem.size  # it leaves noise alone
    alike = {fit.label for fit in fit_confusable_effects(base, found, viscous)}
    assert {"coulomb", "quadratic"} <= alike and "constant_force" not in alike
    assert select_hypothesis(base, found, [viscous], limits).chosen.label == "quadratic"


# Other ends


def test_errors_include_another_minimum_that_is_as_good():
    noise = SAMPLES - 2.0
    for left, factor, is_wider in ((2.0, 1.9, True), (2.0, 2.1, False), (1.05, 1.0, False)):
        fit = fitted(noise * left, COULOMB)
        end = replace(
            fitted(noise * (1.0 + factor * (left - 1.0)), COULOMB), values=fit.values + [0.0, 9.0]
        )
        near = replace(end, values=fit.values + [0.0, 0.5])
        other = replace(fitted(noise, SPRING), values=fit.values + [0.0, 99.0])
        wider = with_other_ends(fit, [near, end, fit, other])
        before, after = (np.sqrt(np.diag(one.distribution.covariance)) for one in (fit, wider))
        assert after == pytest.approx([before[0], np.hypot(before[1], 9.0 if is_wider else 0.0)])
    fit = fitted(400.0, COULOMB)
    drawn = replace(fit, draws=np.random.default_rng(1).standard_normal((4000, 2)) + fit.values)
    wider = with_other_ends(drawn, [replace(fit, values=fit.values + [0.0, 9.0])])
    assert np.std(wider.distribution.draws, axis=0) == pytest.approx(
        [1.0, np.hypot(1.0, 9.0)], rel=0.05
    )


# The order of a search


@pytest.mark.parametrize("bias", [-0.03, 0.03])
def test_two_effects_that_mask_each_other_are_fitted_together(bias):
    """The bias cancels or doubles the mean torque of dry friction."""
    hidden = {"coulomb": {"force_N": 0.5}, "sensor_bias:torque": {"bias": bias}}
    base, sensitivities, limits = analysed(toy(hidden, seed=3, channels=("torque",)))
    alone = [fit_hypothesis(base.problem, (candidate_of("spring"),), differences=base.differences)]
    found = min(fit_pairs(base, sensitivities, limits, alone)[0], key=lambda fit: fit.chi2)
    assert labels_of(found.hypothesis) == hidden.keys()
    assert found.chi2 < limits.omnibus * base.problem.size


@pytest.mark.parametrize("hidden", [TWO, DRY])
def test_two_effects_that_are_insufficient_alone_are_found_together(hidden):
    base, sensitivities, limits = analysed(toy(hidden, seed=3))
    alone, _ = fit_singles(base, sensitivities, limits)
    assert min(fit.chi2 for fit in alone) > limits.omnibus * base.problem.size
    found, seconds = fit_pairs(base, sensitivities, limits, alone)
    best = min(found, key=lambda fit: fit.bic)
    assert labels_of(best.hypothesis) == hidden.keys()
    assert best.chi2 < 1.1 * base.problem.size
    assert len({labels_of(fit.hypothesis) for fit in found}) == len(found) == len(seconds)


def test_an_exhausted_search_stops_and_failed_effects_form_no_pair():
    base, sensitivities, limits = analysed(toy(TWO, seed=3))
    alone, _ = fit_singles(base, sensitivities, limits)
    lost = [replace(fit, status=FAILED) if fit.label == "spring" else fit for fit in alone]

    def search(alone, **changed):
        """Labels of the effects that are found, and how many runs that took."""
        settings = replace(
            DEFAULT_SETTINGS, selection=replace(DEFAULT_SETTINGS.selection, **changed)
        )
        problem = Problem(base.problem.model, stated_noise(base.problem.model), settings=settings)
        found, _ = fit_pairs(replace(base, problem=problem), sensitivities, limits, alone)
        return {label for fit in found for label in labels_of(fit.hypothesis)}, problem.simulations

    (labels, usual), (_, few) = search(alone), search(alone, max_simulations=0)
    assert "spring" in labels and "spring" not in search(lost)[0]
    assert few < usual


STIFFER = {"spring": {"size": 0.3, "damping": 0.0}}
SWINGING, BOTH = {"swing": {"size": 0.3}}, {"swing": {"size": 0.3}, "wobble": {"size": 0.3}}
LESSER = SWINGING | {"wobble": {"size": 0.02}}


@pytest.mark.parametrize(
    "hidden, lowest_deviance, inconsistent, clearances, best",
    [
        (BOTH, 4.9, False, "fitted", BOTH),  # a likely one is fitted before pairs
        (BOTH, 5.1, False, "tried", BOTH),
        (STIFFER, 4.9, False, "fitted", STIFFER),
        (STIFFER, 5.1, False, "tried", None),
        (STIFFER, 4.9, True, "", None),
        (SWINGING, 0.0, False, "", None),  # one force suffices, and no second one gains
        # it suffices and a second one gains: one clearance may do as two
        (LESSER, 4.9, False, "fitted", LESSER),
        (LESSER, 5.1, False, "tried", LESSER),
        (LESSER, 4.9, True, "", LESSER),
    ],
)
def test_clearances_come_before_pairs(hidden, lowest_deviance, inconsistent, clearances, best):
    def deviance(effects):
        return lowest_deviance + 10.0 * max(abs(effects["spring"]["size"] - 0.3) - 0.05, 0.0)

    few = windows(jumps=(1.0, 0.3, 0.03, 0.001), fitted_sizes=1)
    problem = linear(
        hidden=hidden, candidates=(SWING, WOBBLE, HIDDEN_SPRING), deviance=deviance, settings=few
    )
    base = recalibrate(problem.model, noise_of(problem), few)
    screening = screen_candidates(base, 0.01)
    alone, _ = fit_singles(base, *screening)
    fits, seconds = fit_pairs(base, *screening, alone, inconsistent=inconsistent)
    assert len(fits) == len(seconds)
    turns = {turns for *_, turns in problem.model.filtered}
    assert turns == {"fitted": {1.0, np.inf}, "tried": {1.0}, "": set()}[clearances]
    if best:
        found = min(fits, key=lambda fit: fit.chi2)
        assert (labels_of(found.hypothesis), found.in_windows) == (best.keys(), "spring" in best)
    assert fit_pairs(base, *screening, alone, part=1, parts=2) == ([], [])
