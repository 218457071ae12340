"""Which hypotheses are fitted, and what a second effect has to gain: limits met from both sides by made-up fits."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import SimulationError
from jointgap.identification import model_selection
from jointgap.identification.baseline import other_numerics, recalibrate
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.model_selection import (
    _beyond_bounds,
    best_sufficient,
    fit_confusable_effects,
    fits_beyond_bounds,
    nonlinearity,
    refit_jacobian,
    second_effect_gain,
    select_hypothesis,
    shortlist_singles,
    swap_one_effect,
    two_effect_thresholds,
    with_other_ends,
    without_repetitions,
)
from jointgap.identification.problem import Problem
from jointgap.identification.screening import Sensitivities, Sensitivity, simulate_sensitivities
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.thresholds import thresholds
from jointgap.identification.verdict import Thresholds
from tests.identification.toy import RINGING, candidate_of, ringing, stated_noise, toy

SAMPLES = 200
LN = float(np.log(SAMPLES))
DOF = SAMPLES - 1  # one nuisance
LIMITS = Thresholds(rate=0.01, omnibus=1.5, max_gain_threshold=12.0)
WANTED = 0.5 * 12.0  # half of the gain that is called an effect


def effect(name, **more):
    """An effect with one amplitude."""
    return Candidate(name, "slider", (Parameter("size", 0.0),), ("size",), **more)


def sensitivities(rest, gains):
    """Sensitivities ``e0``, ``e1`` ... that each explain so much of chi2, of which `rest` is left if all are there."""
    residual = np.zeros(SAMPLES)
    residual[1 : len(gains) + 1], residual[-1] = np.sqrt(gains), np.sqrt(rest)
    unit = np.eye(SAMPLES)
    found = []
    for place in range(len(gains)):
        column = unit[:, [place + 1]]
        found.append(Sensitivity(effect(f"e{place}"), {}, column, residual, ("slow",)))
    return Sensitivities((Parameter("mass", 1.0),), np.array([1.0]), unit[:, :1], residual, found, {})


def shortlisted(*given):
    return [screened.label for screened in shortlist_singles(sensitivities(*given), LIMITS)]


def fitted(chi2, *effects, status="converged"):
    parameters = [Parameter("mass", 1.0), *(Parameter(f"{c.label}.size", 0.0) for c in effects)]
    residual = np.zeros(SAMPLES)
    residual[-1] = chi2**0.5
    return Fit(
        effects, tuple(parameters), np.ones(len(parameters)), residual, np.eye(SAMPLES)[:, : len(parameters)], 1, status
    )


COULOMB, SPRING = effect("coulomb"), effect("spring")


# Single effects


def test_where_the_base_leaves_more_than_noise_the_eight_best_are_fitted():
    gains = [float(100 + place) for place in range(10)]
    assert shortlisted(10.0, gains) == [f"e{place}" for place in range(9, 1, -1)]


@pytest.mark.parametrize(("gain", "count"), [(LN + WANTED + 0.01, 4), (LN + WANTED - 0.01, 3)])
def test_where_the_base_leaves_noise_alone_an_effect_has_to_promise_half_of_what_is_called_one(gain, count):
    assert len(shortlisted(100.0, [gain, gain + 1.0, gain + 2.0, gain + 3.0, 0.5])) == count


def test_three_are_fitted_in_any_case_and_never_more_than_eight():
    assert len(shortlisted(100.0, [0.1, 0.2, 0.3, 0.4])) == 3
    assert len(shortlisted(10.0, [12.0 + 0.1 * place for place in range(10)])) == 8
    assert shortlisted(100.0, []) == []


@pytest.mark.parametrize(("chi2", "all_fitted"), [(1.5 * DOF - 0.1, False), (1.5 * DOF + 0.1, True)])
def test_the_base_leaves_noise_alone_up_to_what_null_campaigns_do(chi2, all_fitted):
    assert len(shortlisted(chi2 - 4.0, [1.0, 1.0, 1.0, 1.0])) == (4 if all_fitted else 3)


# A second effect


@pytest.mark.parametrize(("share", "enough"), [(1.4999, True), (1.5001, False)])
def test_an_effect_is_sufficient_if_it_leaves_no_more_than_null_campaigns_do(share, enough):
    fit = fitted(share * (SAMPLES - 2), COULOMB)
    baseline = SimpleNamespace(base=fitted(900.0))
    assert best_sufficient(baseline, [fit], LIMITS) is (fit if enough else None)


def test_of_sufficient_effects_the_one_with_the_least_bic_is_best_and_it_has_to_beat_the_base():
    fits = [fitted(200.0, COULOMB), fitted(190.0, SPRING), fitted(189.0, COULOMB, SPRING)]
    assert best_sufficient(SimpleNamespace(base=fitted(900.0)), fits, LIMITS) is fits[1]
    assert best_sufficient(SimpleNamespace(base=fitted(190.0)), fits, LIMITS) is None


@pytest.fixture
def second(monkeypatch):
    """Thresholds of two effects where other numerics change chi2 by so much beyond what nuisances take up."""

    def made(changed, chi2, base=1000.0, fits=None):
        row = np.zeros(SAMPLES)
        row[0], row[5] = 99.0, changed**0.5  # the nuisance takes up the first
        monkeypatch.setattr(model_selection, "other_numerics", lambda *_: np.array([0.1 * row, row]))
        problem = SimpleNamespace(settings=DEFAULT_SETTINGS)
        baseline = SimpleNamespace(base=fitted(base), problem=problem)
        given = [fitted(chi2 + 1.0, SPRING), fitted(chi2, COULOMB), fitted(1.0, SPRING, COULOMB)]
        return two_effect_thresholds(baseline, given if fits is None else fits, LIMITS)

    return made


def test_what_other_numerics_change_raises_both_thresholds_of_a_second_effect(second):
    limits = second(changed=30.0, chi2=200.0)  # 5 % of 800 is 40
    assert limits.max_gain_threshold == pytest.approx(30.0)
    assert limits.omnibus == pytest.approx(1.5 + 30.0 / SAMPLES)


def test_what_other_numerics_change_counts_up_to_a_small_part_of_what_the_effect_explains(second):
    limits = second(changed=50.0, chi2=200.0)
    assert limits.max_gain_threshold == pytest.approx(40.0)
    assert limits.omnibus == 1.5


def test_less_than_the_threshold_of_single_effects_changes_nothing(second):
    assert second(changed=11.0, chi2=200.0) == LIMITS


@pytest.mark.parametrize(("chi2", "jump", "gain"), [(200.0, 70.0, 70.0), (200.0, 3.0, 12.0), (400.0, 70.0, 12.0)])
def test_a_jump_of_chi2_counts_where_the_single_effect_is_sufficient_alone(monkeypatch, chi2, jump, gain):
    monkeypatch.setattr(model_selection, "nonlinearity", lambda *_: jump)
    fits = [fitted(chi2 + 1.0, SPRING), fitted(chi2, COULOMB), fitted(1.0, SPRING, COULOMB)]
    assert second_effect_gain(None, fits, LIMITS) == gain


def test_without_a_fit_of_a_single_effect_the_thresholds_stay(second):
    assert second(30.0, 200.0, fits=[]) is LIMITS
    assert second(30.0, 200.0, fits=[fitted(200.0, COULOMB, status=FAILED), fitted(1.0, SPRING, COULOMB)]) is LIMITS


def jumping(jump, at=5):
    """A problem whose residuals depend on one parameter linearly, but for a jump of one sample above the fit."""

    def residual(values, hypothesis):
        change = np.zeros(SAMPLES)
        change[0] = values["mass"] - 1.0
        change[at] = jump * (values["mass"] > 1.0)
        return fitted(100.0).residual + change

    return SimpleNamespace(residual=residual)


def test_residuals_that_depend_on_parameters_linearly_have_no_jump():
    assert nonlinearity(jumping(0.0), fitted(100.0)) == pytest.approx(0.0, abs=1e-9)


def test_a_jump_is_what_chi2_has_beyond_what_the_other_side_predicts():
    assert nonlinearity(jumping(2.0), fitted(100.0)) == pytest.approx(4.0)
    assert nonlinearity(jumping(2.0, at=-1), fitted(100.0)) == pytest.approx(12.0**2 - 10.0**2)


def test_values_that_cannot_be_simulated_have_no_jump():
    def fails(*_):
        raise SimulationError("too far")

    assert nonlinearity(SimpleNamespace(residual=fails), fitted(100.0)) == 0.0


# Fits once more


def test_a_failed_fit_is_not_fitted_again():
    lost = fitted(1.0, COULOMB, status=FAILED)
    assert refit_jacobian(SimpleNamespace(), lost) is lost


def test_beside_what_rings_another_effect_is_sought_in_the_valley_of_the_pair():
    """A fit of the ringing alone ended elsewhere. The hidden drag is found in place of friction."""
    model = toy(hidden=lambda x, v, angle, time: ringing(0.31, angle) - 0.5 * v, seed=6)
    model = replace(model, candidates=(*model.candidates, RINGING))
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    friction = candidate_of("coulomb")
    pair = fit_hypothesis(
        base.problem, (friction, RINGING), {"coulomb.force_N": 0.3, "ringing.size": 0.31}, refresh=True
    )
    lost = replace(fit_hypothesis(base.problem, (RINGING,), {"ringing.size": 0.5}), status="stopped")
    swapped = {fit.label: fit for fit in swap_one_effect(base, sensitivities, [lost, pair])}
    assert swapped["ringing + viscous"].chi2 < 1.1 * base.problem.size < pair.chi2


def test_in_the_valley_of_a_pair_an_effect_may_take_a_nuisance_beyond_its_range():
    model = toy(nuisances={"slider_mass": 0.56}, hidden=lambda x, v, angle, time: ringing(0.31, angle), seed=6)
    model = replace(model, candidates=(*model.candidates, RINGING))
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    start = {"ringing.size": 0.31}
    pair = fit_hypothesis(base.problem, (candidate_of("centrifugal"), RINGING), start, refresh=True)
    heavier = next(fit for fit in swap_one_effect(base, sensitivities, [pair]) if fit.label == "ringing + added_mass")
    assert heavier.mapping["added_mass.mass_kg"] == pytest.approx(0.06, abs=0.002)
    again = base.problem.residual(heavier.mapping, heavier.hypothesis)
    np.testing.assert_allclose(again, heavier.residual, rtol=0, atol=1e-9)
    assert heavier.chi2 < 1.1 * base.problem.size < pair.chi2


def test_nothing_is_swapped_where_no_pair_is_best():
    assert swap_one_effect(SimpleNamespace(), None, []) == []
    fits = [fitted(100.0, COULOMB), fitted(400.0, COULOMB, SPRING), fitted(1.0, COULOMB, SPRING, status=FAILED)]
    assert swap_one_effect(SimpleNamespace(), None, fits) == []


@pytest.fixture(scope="module")
def heavier():
    """A dry friction and a mass that is beyond its range are hidden; friction and the gain of a sensor were fitted."""
    model = toy({"coulomb": {"force_N": 0.2}, "added_mass": {"mass_kg": 0.1}}, seed=4)
    base = recalibrate(model, stated_noise(model))
    pair = tuple(candidate_of(label) for label in ("coulomb", "sensor_gain:acceleration"))
    return base, fit_hypothesis(base.problem, pair, differences=base.differences)


def test_an_effect_that_takes_a_nuisance_beyond_its_bound_is_tried_in_place_of_each_other_one(heavier):
    base, pair = heavier
    mass = next(p for p in pair.parameters if p.name == "slider_mass")
    assert pair.mapping["slider_mass"] == mass.high
    first, second = fits_beyond_bounds(base, [base.base, pair])
    assert (first.label, second.label) == ("sensor_gain:acceleration + added_mass", "coulomb + added_mass")
    assert second.bic < pair.bic - 10.0
    assert second.mapping["added_mass.mass_kg"] == pytest.approx(0.1, abs=0.03)
    lost = [replace(fit, status=FAILED) for fit in (first, second)]
    assert fits_beyond_bounds(base, [pair, *lost]) == []
    assert fits_beyond_bounds(replace(base, base=replace(pair, hypothesis=())), [pair]) == []  # nothing is missing


def test_what_is_beyond_a_bound_is_open_to_choice(heavier):
    base, pair = heavier
    found = simulate_sensitivities(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, found, other_numerics(base.problem, base.base))
    assert select_hypothesis(base, found, [pair], limits).chosen.label == "coulomb + added_mass"


def test_of_effects_beyond_bounds_no_more_are_fitted_than_partners_of_an_effect(heavier):
    base, pair = heavier
    settings = base.problem.settings
    few = replace(settings, selection=replace(settings.selection, partners=1))
    model = base.problem.model
    base = replace(base, problem=Problem(model, stated_noise(model), settings=few))
    assert len(fits_beyond_bounds(base, [pair])) == 1


def test_an_effect_that_ends_where_the_nuisance_does_takes_it_nowhere(heavier):
    _, pair = heavier
    mass = next(p for p in pair.parameters if p.name == "slider_mass")
    added = candidate_of("added_mass")
    limited = replace(added, coordinates=(replace(added.coordinates[0], high=mass.high - mass.nominal),))
    for candidate, count in ((added, 2), (limited, 0)):
        problem = SimpleNamespace(model=SimpleNamespace(candidates=[candidate]))
        assert len(list(_beyond_bounds(problem, pair))) == count


def test_a_nuisance_is_not_replaced_twice(heavier):
    base, pair = heavier
    coulomb, gain = pair.hypothesis
    heavy = replace(coulomb, replaces={"slider_mass": "force_N"})
    (only,) = _beyond_bounds(base.problem, replace(pair, hypothesis=(heavy, gain)))
    assert [candidate.label for candidate in only] == ["sensor_gain:acceleration", "added_mass"]


def test_where_no_nuisance_is_at_its_bound_nothing_takes_it_beyond(heavier):
    base, pair = heavier
    inside = replace(pair, values=np.array([p.nominal for p in pair.parameters]))
    assert fits_beyond_bounds(base, [inside]) == []
    assert fits_beyond_bounds(base, [base.base]) == []


# Explanations that are one


@pytest.mark.parametrize(("apart", "left"), [(9.9, ["force"]), (10.1, ["force", "soft spring"])])
def test_a_limit_that_predicts_the_same_stands_for_both(apart, left):
    """A soft spring that differs from a constant force by less than the data can decide is that force."""
    force, spring = fitted(300.0, effect("force")), fitted(300.0, effect("soft spring"), effect("preload"))
    spring = replace(spring, hypothesis=(effect("soft spring"),), residual=force.residual.copy())
    spring.residual[0] += np.sqrt(apart)
    best = {frozenset([fit.label]): fit for fit in (spring, force)}
    found = without_repetitions(best, lambda special, general: special == (effect("force"),), 10.0)
    assert sorted(fit.label for fit in found.values()) == left


def test_effects_that_predict_the_same_and_are_no_limits_of_each_other_stay_two():
    spring, inertia = fitted(300.0, effect("spring")), fitted(300.0, effect("inertia"), effect("more"))
    best = {frozenset([fit.label]): fit for fit in (spring, inertia)}
    assert without_repetitions(best, lambda special, general: False, 10.0) == best


# Before a name


def test_what_looks_like_the_explanation_that_would_be_named_is_fitted_before():
    """The true one was never fitted: quadratic drag is hidden, and viscous friction would be named."""
    model = toy({"quadratic": {"drag_N_s2_m2": 0.04}}, {"slider_mass": 0.51}, seed=4)
    base = recalibrate(model, stated_noise(model))
    found = simulate_sensitivities(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, found, other_numerics(base.problem, base.base))
    viscous = fit_hypothesis(base.problem, (candidate_of("viscous"),), differences=base.differences, refresh=True)
    assert viscous.chi2 < limits.omnibus * base.problem.size  # it leaves noise alone
    alike = {fit.label for fit in fit_confusable_effects(base, found, viscous)}
    assert {"coulomb", "quadratic"} <= alike
    assert "constant_force" not in alike
    assert select_hypothesis(base, found, [viscous], limits).chosen.label == "quadratic"


def test_so_it_is_where_the_best_explains_too_little_but_leaves_no_more_than_null_campaigns_do():
    """The noise is known so poorly that viscous friction, which explains 94 %, would pass."""
    model = toy({"quadratic": {"drag_N_s2_m2": 0.1}}, seed=4)
    base = recalibrate(model, stated_noise(model))
    found = simulate_sensitivities(base.problem, base.base, base.differences)
    viscous = fit_hypothesis(base.problem, (candidate_of("viscous"),), differences=base.differences, refresh=True)
    for omnibus, label in ((1.1, ""), (1.5, "quadratic")):
        limits = Thresholds(rate=0.01, omnibus=omnibus, max_gain_threshold=12.0)
        decision = select_hypothesis(base, found, [viscous], limits)
        assert decision.chosen.label == (label or decision.base.label)
        assert (decision.best_known is None) == bool(label)


def test_in_a_pair_what_looks_like_one_effect_is_fitted_beside_the_other():
    model = toy({"quadratic": {"drag_N_s2_m2": 0.1}, "spring": {"stiffness_N_m": 5.0}}, seed=4)
    base = recalibrate(model, stated_noise(model))
    found = simulate_sensitivities(base.problem, base.base, base.differences)
    pair = fit_hypothesis(base.problem, (candidate_of("viscous"), candidate_of("spring")), refresh=True)
    best = min(fit_confusable_effects(base, found, pair), key=lambda fit: fit.chi2)
    assert best.label == "spring + quadratic"
    assert best.chi2 < 1.1 * base.problem.size < pair.chi2


# Other ends


@pytest.mark.parametrize(("left", "factor", "is_wider"), [(2.0, 1.9, True), (2.0, 2.1, False), (1.05, 1.0, False)])
def test_where_more_than_noise_is_left_errors_hold_another_end_that_is_as_good(left, factor, is_wider):
    noise = SAMPLES - 2.0
    fit = fitted(noise * left, COULOMB)
    end = replace(fitted(noise * (1.0 + factor * (left - 1.0)), COULOMB), values=fit.values + [0.0, 9.0])
    near = replace(end, values=fit.values + [0.0, 0.5])
    other = replace(fitted(noise, SPRING), values=fit.values + [0.0, 99.0])
    wider = with_other_ends(fit, [near, end, fit, other])
    before, after = (np.sqrt(np.diag(each.distribution.covariance)) for each in (fit, wider))
    assert after[0] == pytest.approx(before[0])
    assert after[1] == pytest.approx(np.hypot(before[1], 9.0 if is_wider else 0.0))


def test_draws_hold_such_an_end_too():
    fit = fitted(400.0, COULOMB)
    drawn = replace(fit, draws=np.random.default_rng(1).standard_normal((4000, 2)) + fit.values)
    wider = with_other_ends(drawn, [replace(fit, values=fit.values + [0.0, 9.0])])
    assert np.std(wider.distribution.draws, axis=0) == pytest.approx([1.0, np.hypot(1.0, 9.0)], rel=0.05)
