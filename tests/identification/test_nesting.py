"""No hypothesis ends above what it holds, and none wins by a valley that the base could lie in too."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.identification.baseline import recalibrate
from jointgap.identification.fit import compress_rows, fit_hypothesis
from jointgap.identification.hypothesis_fits import fit_singles
from jointgap.identification.initial_fit import (
    best_fit_per_hypothesis,
    chi2_without_effects,
    refit_from_part,
    with_effects_absent,
    without_other_effects,
)
from jointgap.identification.model_selection import select_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.screening import simulate_sensitivities
from jointgap.identification.verdict import Thresholds
from tests.identification.knocks import knocking
from tests.identification.toy import RINGING, candidate_of, stated_noise, toy

LIMITS = Thresholds(rate=0.01, omnibus=1.1, max_gain_threshold=12.0)


def recalibrated(model):
    base = recalibrate(model, stated_noise(model))
    return base, simulate_sensitivities(base.problem, base.base, base.differences)


def test_of_each_hypothesis_the_lowest_fit_counts_in_whatever_order_its_effects_stand():
    def fit(chi2, *labels):
        return SimpleNamespace(hypothesis=tuple(map(candidate_of, labels)), chi2=chi2)

    higher, lower, single = fit(3.0, "spring", "viscous"), fit(2.0, "viscous", "spring"), fit(4.0, "spring")
    assert best_fit_per_hypothesis([single, higher, lower]) == [lower, single]


@pytest.mark.parametrize(
    ("label", "amplitude"), [("viscous", "damping_N_s_m"), ("added_mass", "mass_kg"), ("harmonic_force", "sine_N")]
)
def test_with_its_effects_absent_a_hypothesis_predicts_what_the_base_does(label, amplitude):
    model = toy({"viscous": {"damping_N_s_m": 0.2}}, {"slider_mass": 0.52}, seed=5)
    problem, hypothesis = Problem(model, stated_noise(model)), (candidate_of(label),)
    base = fit_hypothesis(problem)
    values = with_effects_absent(problem, hypothesis, base)
    np.testing.assert_allclose(problem.residual(values, hypothesis), base.residual, rtol=0, atol=1e-9)
    replaced = base.mapping["slider_mass"] - 0.5 if label == "added_mass" else 0.0
    assert values[f"{label}.{amplitude}"] == pytest.approx(replaced)


def test_a_pair_keeps_the_effect_that_was_fitted_and_lacks_the_other():
    model = toy({"viscous": {"damping_N_s_m": 0.2}}, seed=5)
    problem, viscous, spring = Problem(model, stated_noise(model)), candidate_of("viscous"), candidate_of("spring")
    part = fit_hypothesis(problem, (viscous,))
    values = with_effects_absent(problem, (spring, viscous), part)
    assert values["viscous.damping_N_s_m"] == part.mapping["viscous.damping_N_s_m"]
    assert values["spring.stiffness_N_m"] == 0.0
    np.testing.assert_allclose(problem.residual(values, (spring, viscous)), part.residual, rtol=0, atol=1e-9)


@pytest.mark.parametrize("other", ["spring", "added_mass"])
def test_of_a_pair_one_effect_leaves_what_it_does_with_the_other_absent_and_all_else_in_place(other):
    model = toy({"viscous": {"damping_N_s_m": 0.2}, "constant_force": {"force_N": 0.2}}, seed=5)
    problem, viscous = Problem(model, stated_noise(model)), candidate_of("viscous")
    pair = fit_hypothesis(problem, (candidate_of(other), viscous), refresh=True)
    found = without_other_effects(problem, pair, (viscous,))
    assert found.hypothesis == (viscous,)
    kept = {key: value for key, value in pair.mapping.items() if not key.startswith(other)}
    assert found.mapping == {"slider_mass": 0.5, **kept}
    np.testing.assert_allclose(problem.residual(found.mapping, (viscous,)), found.residual, rtol=0, atol=1e-3)
    again = fit_hypothesis(problem, (viscous,), found.mapping, refresh=True)
    slider_mass = [p.key for p in found.parameters].index("slider_mass")
    assert found.jacobian[:, slider_mass] == pytest.approx(again.jacobian[:, slider_mass], rel=0.05, abs=1.0)


def test_a_nuisance_that_an_effect_replaces_is_at_nominal_whatever_values_say():
    model = toy(seed=5)
    problem, heavier = Problem(model, stated_noise(model)), (candidate_of("added_mass"),)
    values = {p.key: p.nominal for p in problem.parameters(heavier)} | {"added_mass.mass_kg": 0.02}
    other = problem.residual({**values, "slider_mass": 0.52}, heavier)
    np.testing.assert_array_equal(problem.residual(values, heavier), other)


def test_no_fit_of_a_single_effect_ends_above_the_base():
    """A ringing that is not there, whose fits start at a finite size and find no way back to none."""
    model = toy({"viscous": {"damping_N_s_m": 0.2}}, seed=3)
    loose = replace(RINGING, search_range=(), initial_guesses=({"size": 0.3},))
    base, sensitivities = recalibrated(replace(model, candidates=(loose, candidate_of("viscous"))))
    fits, _ = fit_singles(base, sensitivities, LIMITS)
    assert {fit.label for fit in fits} == {"ringing", "viscous"}
    for fit in fits:
        assert fit.chi2 <= base.base.chi2 + 1e-6


def test_a_fit_above_a_part_of_it_goes_on_from_there():
    model = toy({"viscous": {"damping_N_s_m": 0.2}}, seed=3)
    base, _ = recalibrated(model)
    hypothesis = (candidate_of("viscous"), candidate_of("constant_force"))
    part = fit_hypothesis(base.problem, hypothesis[:1], differences=base.differences)
    far = dict.fromkeys(["viscous.damping_N_s_m", "constant_force.force_N"], 40.0)
    high = fit_hypothesis(base.problem, hypothesis, far, differences=base.differences, vary=())
    high = replace(
        high,
        parameters=base.problem.parameters(hypothesis),
        values=np.zeros(6),
        jacobian=np.zeros((high.residual.size, 6)),
    )
    mended = refit_from_part(base.problem, base.differences, high, [base.base, part])
    assert high.chi2 > base.base.chi2 > part.chi2 >= mended.chi2
    assert refit_from_part(base.problem, base.differences, mended, [base.base, part]) is mended


def test_no_fit_of_an_effect_that_is_searched_begins_where_it_is_absent():
    """There is no slope from there, and a joint with hardly any clearance takes longest to simulate."""
    base, _ = recalibrated(
        toy({"viscous": {"damping_N_s_m": 0.2}}, seed=3, candidates=(RINGING, candidate_of("viscous")))
    )
    high = fit_hypothesis(base.problem, (RINGING,), {"ringing.size": 0.6}, differences=base.differences, vary=())
    simulations = base.problem.simulations
    assert high.chi2 > base.base.chi2
    assert refit_from_part(base.problem, base.differences, high, [base.base]) is high
    assert base.problem.simulations == simulations


def test_statistics_over_cycles_are_smooth_so_that_a_fit_of_them_begins_where_its_effect_is_absent():
    model = toy({"viscous": {"damping_N_s_m": 0.2}}, seed=3)
    model = replace(model, candidates=(RINGING, candidate_of("viscous")))
    model = replace(model, series=tuple(replace(one, statistic=True) for one in model.series))
    base, _ = recalibrated(model)
    high = fit_hypothesis(base.problem, (RINGING,), {"ringing.size": 0.6}, differences=base.differences, vary=())
    parameters = base.problem.parameters((RINGING,))
    values = np.array([high.mapping.get(p.key, 0.6) for p in parameters])
    high = replace(high, parameters=parameters, values=values, jacobian=np.zeros((high.residual.size, len(parameters))))
    assert high.chi2 > base.base.chi2
    mended = refit_from_part(base.problem, base.differences, high, [base.base])
    where_absent = base.problem.residual(base.base.mapping)  # what the base leaves is a mean of several simulations
    assert mended.chi2 <= where_absent @ where_absent + 1e-9


def test_what_the_base_would_leave_in_a_fits_valley_is_what_it_leaves_where_residuals_are_linear():
    model = toy({"viscous": {"damping_N_s_m": 0.05}}, seed=3)
    base, _ = recalibrated(model)
    for label in ("viscous", "constant_force", "added_mass"):
        found = fit_hypothesis(base.problem, (candidate_of(label),), refresh=True)
        assert chi2_without_effects(base.problem, found) == pytest.approx(base.base.chi2, rel=1e-3)


@pytest.mark.parametrize("label", ["viscous", "harmonic_force", "sensor_bias:torque"])
def test_an_effect_that_won_by_its_nuisances_better_valley_is_not_named(label):
    """The blows of a clearance off by a twentieth: the base missed its valley, and an effect of no size found it."""
    model = knocking(clearance=1.05, seed=2)
    base, sensitivities = recalibrated(model)
    astray = fit_hypothesis(base.problem, start={"clearance": 0.95}, differences=base.differences)
    baseline = replace(base, base=astray)
    start = {"clearance": 1.05, "harmonic_force.frequency_Hz": 7.0}
    hypothesis = (candidate_of(label),)
    winner = fit_hypothesis(base.problem, hypothesis, start, differences=base.differences)
    assert astray.chi2 > 10.0 * winner.chi2
    assert LIMITS.numerical_noise == 0.0
    decision = select_hypothesis(baseline, sensitivities, [winner], LIMITS)
    assert decision.verdict == "parameters_only"
    assert decision.chosen is decision.base  # the better one that was found on the way
    assert decision.base.chi2 < 1.1 * winner.chi2


def test_fits_from_a_file_hold_their_derivatives_in_fewer_rows_and_that_is_enough():
    model = toy({"viscous": {"damping_N_s_m": 0.2}}, seed=3)
    base, _ = recalibrated(model)
    hypothesis = (candidate_of("viscous"),)
    found = fit_hypothesis(base.problem, hypothesis, differences=base.differences)
    stored = replace(found, jacobian=compress_rows(found.jacobian)[0])
    without = chi2_without_effects(base.problem, found)
    assert chi2_without_effects(base.problem, stored) == pytest.approx(without)
    poor = replace(stored, values=0.9 * stored.values, residual=2.0 * base.base.residual)
    assert refit_from_part(base.problem, base.differences, poor, [base.base]).chi2 < base.base.chi2


def test_an_effect_that_is_there_keeps_the_base_where_it_is():
    model = toy({"viscous": {"damping_N_s_m": 0.15}}, seed=11)
    base, sensitivities = recalibrated(model)
    found = fit_hypothesis(base.problem, (candidate_of("viscous"),), differences=base.differences)
    decision = select_hypothesis(base, sensitivities, [found], LIMITS)
    assert decision.verdict == "named"
    assert decision.base is base.base
