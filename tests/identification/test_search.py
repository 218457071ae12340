"""Which hypotheses are fitted, and when the search ends."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.core.errors import SimulationError
from jointgap.identification.baseline import recalibrate
from jointgap.identification.decide import decide
from jointgap.identification.fit import FAILED, NEEDS_DERIVATIVES, Fit, fit_hypothesis
from jointgap.identification.initial_fit import labels_of, without_other_effects
from jointgap.identification.problem import Problem
from jointgap.identification.search import (
    STEPS,
    Completion,
    Exchanges,
    MaskedPairs,
    OneMore,
    Proposal,
    Search,
    SingleEffects,
)
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
    searched,
    stated_noise,
    toy,
)

TWO = {"viscous": {"damping_N_s_m": 0.8}, "spring": {"stiffness_N_m": 3.0}}
DRY = {"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}}
THREE = {"coulomb": {"force_N": 0.3}, "viscous": {"damping_N_s_m": 0.3}}
THREE |= {"sensor_bias:torque": {"bias": 0.03}}
LIMITS = Thresholds(rate=0.01, omnibus=1.1, max_gain_threshold=12.0)


@dataclass(frozen=True)
class Known:
    """A step with the fits that are known before."""

    fits: tuple[Fit, ...]
    name: str = "known fits"

    def propose(self, search):
        if not search.is_new(self.name):
            return []
        return [
            Proposal(self.name, fit.hypothesis, 0.0, -np.inf, lambda _, fit=fit: [fit])
            for fit in self.fits
        ]


def best_labels(search):
    return labels_of(search.best.hypothesis)


# From one effect to several


@pytest.mark.parametrize("bias", [-0.03, 0.03])
def test_two_effects_that_mask_each_other_are_fitted_together(bias):
    """The bias cancels or doubles the mean torque of dry friction."""
    hidden = {"coulomb": {"force_N": 0.5}, "sensor_bias:torque": {"bias": bias}}
    search = searched(*analysed(toy(hidden, seed=3, channels=("torque",))))
    assert best_labels(search) == hidden.keys()
    assert search.is_sufficient(search.best)


@pytest.mark.parametrize("hidden", [TWO, DRY, THREE])
def test_effects_that_are_insufficient_alone_are_found_together(hidden):
    search = searched(*analysed(toy(hidden, seed=3)))
    alone = [fit for labels, fit in search.fits.items() if len(labels) == 1]
    assert not any(map(search.is_sufficient, alone))
    assert best_labels(search) == hidden.keys()
    assert search.is_sufficient(search.best)
    assert decide(search).verdict == "named"


def test_a_step_that_is_left_out_proposes_nothing():
    base, sensitivities, limits = analysed(toy(TWO, seed=3))
    search = Search(base, sensitivities, limits, (SingleEffects(),)).run()
    assert {len(labels) for labels in search.fits} == {0, 1}
    assert Search(base, sensitivities, limits, ()).run().made == []


def test_a_hypothesis_is_fitted_again_only_for_a_better_minimum():
    search = searched(*analysed(toy(TWO, seed=3)))
    assert len(search.made) == len({labels_of(fit.hypothesis) for fit in search.made})
    base, sensitivities = screened(toy(TWO, seed=3))
    spring, viscous = candidate_of("spring"), candidate_of("viscous")
    alone = fit_hypothesis(base.problem, (viscous,), differences=base.differences, refresh=True)
    start = {"viscous.damping_N_s_m": 9.0, "spring.stiffness_N_m": 90.0}
    poor = fit_hypothesis(base.problem, (viscous, spring), start, vary=())
    poor = replace(poor, parameters=base.problem.parameters(poor.hypothesis))
    values = [p.nominal for p in poor.parameters]
    jacobian = np.zeros((poor.residual.size, len(values)))
    poor = replace(poor, values=np.array(values), jacobian=jacobian)
    assert poor.chi2 > 4.0 * alone.chi2
    search = Search(base, sensitivities, LIMITS, (Known((alone, poor)), OneMore())).run()
    again = search.fits[frozenset(TWO)]
    assert again is not poor and search.is_sufficient(again)


# Before a name


def test_confusable_effects_are_fitted_before_naming():
    """The hidden quadratic drag was not fitted, and viscous friction would be named."""
    base, sensitivities, limits = analysed(
        toy({"quadratic": {"drag_N_s2_m2": 0.04}}, {"slider_mass": 0.51}, seed=4)
    )
    viscous = fit_hypothesis(
        base.problem, (candidate_of("viscous"),), differences=base.differences, refresh=True
    )
    assert viscous.chi2 < limits.omnibus * base.problem.size  # it leaves noise alone
    search = Search(base, sensitivities, limits, (Known((viscous,)), Exchanges())).run()
    assert "quadratic" in {fit.label for fit in search.made}
    assert "constant_force" not in {fit.label for fit in search.made}
    assert decide(search).chosen.label == "quadratic"


def test_a_second_effect_is_sought_from_the_minimum_of_a_pair():
    """The fit of the nonsmooth effect alone ended elsewhere. The hidden drag replaces friction."""
    model = toy(seed=6, hidden=lambda x, v, angle, _: ringing(0.31, angle) - 0.5 * v)
    base, sensitivities = screened(replace(model, candidates=(*model.candidates, RINGING)))
    start = {"ringing.size": 0.31, "coulomb.force_N": 0.3}
    pair = fit_hypothesis(base.problem, (candidate_of("coulomb"), RINGING), start, refresh=True)
    search = Search(base, sensitivities, LIMITS, (Known((pair,)), Exchanges())).run()
    assert best_labels(search) == {"ringing", "viscous"}
    assert search.best.chi2 < 1.1 * base.problem.size < pair.chi2


def test_an_effect_that_exceeds_a_nuisance_bound_replaces_another_effect():
    """Hidden: dry friction and a mass beyond its range. Fitted: friction and a sensor gain."""
    base, sensitivities, limits = analysed(
        toy({"coulomb": {"force_N": 0.2}, "added_mass": {"mass_kg": 0.1}}, seed=4)
    )
    effects = tuple(candidate_of(label) for label in ("coulomb", "sensor_gain:acceleration"))
    pair = fit_hypothesis(base.problem, effects, differences=base.differences)
    mass = next(p for p in pair.parameters if p.name == "slider_mass")
    assert pair.mapping["slider_mass"] == mass.high
    search = Search(base, sensitivities, limits, (Known((pair,)), Exchanges())).run()
    assert best_labels(search) == {"coulomb", "added_mass"}
    assert search.best.mapping["added_mass.mass_kg"] == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize("label", ["viscous", "harmonic_force", "sensor_bias:torque"])
def test_an_effect_that_only_found_a_better_base_minimum_is_not_named(label):
    """The base ended in another minimum, and an effect of zero size found the better one."""
    base, sensitivities = screened(toy(nuisances={"slider_mass": 0.515}, seed=2))
    start = base.base.mapping | {"crank_length": 0.147, "slider_mass": 0.475}
    astray = fit_hypothesis(base.problem, (), start, vary=())
    parameters = base.problem.parameters(())
    astray = replace(
        astray,
        parameters=parameters,
        values=np.array([start[p.key] for p in parameters]),
        jacobian=np.zeros((astray.residual.size, len(parameters))),
    )
    winner = fit_hypothesis(base.problem, (candidate_of(label),), differences=base.differences)
    assert astray.chi2 > 3.0 * winner.chi2
    steps = (Known((winner,)), Exchanges())
    search = Search(replace(base, base=astray), sensitivities, LIMITS, steps).run()
    decision = decide(search)
    assert decision.verdict == "parameters_only"
    assert decision.base.chi2 < 1.1 * winner.chi2


def test_a_base_that_is_right_is_not_fitted_again():
    search = searched(*screened(toy({"viscous": {"damping_N_s_m": 0.15}}, seed=11)), LIMITS)
    assert search.base is search.baseline.base
    assert decide(search).verdict == "named"


@pytest.mark.parametrize("other", ["spring", "added_mass"])
def test_one_effect_of_a_pair_without_the_other_keeps_everything_else(other):
    model = toy({"viscous": {"damping_N_s_m": 0.2}, "constant_force": {"force_N": 0.2}}, seed=5)
    problem, viscous = Problem(model, stated_noise(model)), candidate_of("viscous")
    pair = fit_hypothesis(problem, (candidate_of(other), viscous), refresh=True)
    rest = without_other_effects(problem, pair, (viscous,))
    assert rest.hypothesis == (viscous,)
    kept = {key: value for key, value in pair.mapping.items() if not key.startswith(other)}
    assert rest.mapping == {"slider_mass": 0.5, **kept}
    np.testing.assert_allclose(
        problem.residual(rest.mapping, (viscous,)), rest.residual, rtol=0, atol=1e-3
    )
    again = fit_hypothesis(problem, (viscous,), rest.mapping, refresh=True)
    slider_mass = [p.key for p in rest.parameters].index("slider_mass")
    assert rest.jacobian[:, slider_mass] == pytest.approx(
        again.jacobian[:, slider_mass], rel=0.05, abs=1.0
    )


# The end


def test_a_search_at_its_limit_says_what_was_not_searched():
    base, sensitivities, limits = analysed(toy(TWO, seed=3))
    model = base.problem.model
    few = replace(
        DEFAULT_SETTINGS, selection=replace(DEFAULT_SETTINGS.selection, max_simulations=10)
    )
    problem = Problem(model, stated_noise(model), settings=few)
    search = searched(replace(base, problem=problem), sensitivities, limits)
    assert {OneMore().name, SingleEffects().name} <= set(search.not_searched)
    assert decide(search).not_searched == tuple(search.not_searched)
    assert searched(base, sensitivities, limits).not_searched == []


def test_effects_that_cannot_be_simulated_form_no_pair():
    base, sensitivities, limits = analysed(toy(TWO, seed=3))
    spring = candidate_of("spring")
    failed = fit_hypothesis(base.problem, (spring,), differences=base.differences)
    failed = replace(failed, status=FAILED)
    steps = (Known((failed,)), *(step for step in STEPS if not isinstance(step, SingleEffects)))
    search = Search(base, sensitivities, limits, (*steps, MaskedPairs())).run()
    assert all(labels == {"spring"} or "spring" not in labels for labels in search.fits)


def test_a_rig_that_cannot_be_simulated_reports_the_reason():
    problem = linear()

    def simulate(*_, **__):
        raise SimulationError("the pins are beyond their bearings")

    problem.model.simulate = simulate
    with pytest.raises(SimulationError, match=r"the pins are beyond"):
        recalibrate(problem.model, noise_of(problem))


# Clearances


STIFFER = {"spring": {"size": 0.3, "damping": 0.0}}
SWINGING, BOTH = {"swing": {"size": 0.3}}, {"swing": {"size": 0.3}, "wobble": {"size": 0.3}}
LESSER = SWINGING | {"wobble": {"size": 0.05}}


@pytest.mark.parametrize(
    "hidden, lowest_deviance, has_clearances, clearances, best",
    [
        (BOTH, 4.9, True, "fitted", BOTH),  # a likely one is fitted before pairs
        (BOTH, 5.1, True, "tried", BOTH),
        (STIFFER, 4.9, True, "fitted", STIFFER),
        (STIFFER, 5.1, True, "tried", None),
        (STIFFER, 4.9, False, "", None),
        (SWINGING, 0.0, True, "", SWINGING),  # one force suffices, and no second one gains
        # it suffices and a second one gains: one clearance may do as two
        (LESSER, 4.9, True, "fitted", LESSER),
        (LESSER, 5.1, True, "tried", LESSER),
        (LESSER, 4.9, False, "", LESSER),
    ],
)
def test_clearances_are_searched_if_no_single_effect_suffices(
    hidden, lowest_deviance, has_clearances, clearances, best
):
    def deviance(effects):
        if not effects:
            return 5.0  # with ideal joints
        return lowest_deviance + 10.0 * max(abs(effects["spring"]["size"] - 0.3) - 0.05, 0.0)

    few = windows(jumps=(1.0, 0.3, 0.03, 0.001), fitted_sizes=1)
    problem = linear(
        hidden=hidden, candidates=(SWING, WOBBLE, HIDDEN_SPRING), deviance=deviance, settings=few
    )
    base = recalibrate(problem.model, noise_of(problem), settings=few)
    screening = screen_candidates(base, 0.01)
    search = Search(base, *screening, STEPS, has_clearances).run()
    turns = {turns for *_, turns in problem.model.filtered}
    assert turns == {"fitted": {1.0, np.inf}, "tried": {1.0}, "": set()}[clearances]
    if best:
        assert best_labels(search) == best.keys()
        assert search.best.in_windows == ("spring" in best)


def test_a_provisional_fit_that_would_be_named_is_completed():
    base, sensitivities = screened(toy({"viscous": {"damping_N_s_m": 0.5}}, seed=3))
    near = {"viscous.damping_N_s_m": 0.4}
    begun = fit_hypothesis(base.problem, (candidate_of("viscous"),), near, vary=())
    whole = fit_hypothesis(base.problem, (candidate_of("viscous"),), near)
    begun = replace(whole, values=whole.values, residual=begun.residual, reason=NEEDS_DERIVATIVES)
    search = Search(base, sensitivities, LIMITS, (Known((begun,)), Completion())).run()
    assert search.best.reason == ""
    assert search.best.chi2 < begun.chi2
    assert search.best.chi2 == pytest.approx(whole.chi2, abs=0.1)


def test_a_combination_off_course_is_not_fitted():
    """With two effects of at most three a third of the misfit must be explained."""
    base, sensitivities = screened(toy(TWO, seed=3))
    pair = (candidate_of("viscous"), candidate_of("spring"))
    made, misfit = [], base.base.chi2 - base.problem.size

    def fit(_):
        made.append(fit_hypothesis(base.problem, pair))
        return made[-1:]

    for share, count in ((0.3, 0), (0.4, 1)):
        chi2 = base.base.chi2 - share * misfit
        proposal = Proposal("pair", pair, chi2, chi2, fit, explores=True)
        step = SimpleNamespace(
            name="pair", propose=lambda search, one=proposal: [one] if search.is_new("pair") else []
        )
        Search(base, sensitivities, LIMITS, (step,)).run()
        assert len(made) == count
