"""No hypothesis fits worse than its parts, and none wins by a better minimum of the base."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.initial_fit import (
    chi2_without_effects,
    refit_from_part,
    with_effects_absent,
    without_other_effects,
)
from jointgap.identification.model_selection import select_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.verdict import Thresholds
from tests.identification.toy import RINGING, candidate_of, screened, stated_noise, toy

LIMITS = Thresholds(rate=0.01, omnibus=1.1, max_gain_threshold=12.0)
DRAG = {"viscous": {"damping_N_s_m": 0.2}}
VISCOUS, SPRING, STEADY = map(candidate_of, ("viscous", "spring", "constant_force"))


def problem_of(*args, **more):
    model = toy(*args, seed=5, **more)
    return Problem(model, stated_noise(model))


@pytest.fixture(scope="module")
def dragging():
    """The base of a toy with a hidden drag and a nonsmooth candidate."""
    model = toy(DRAG, seed=3)
    return screened(replace(model, candidates=(RINGING, VISCOUS)))[0]


@pytest.mark.parametrize(
    "label, amplitude",
    [("viscous", "damping_N_s_m"), ("added_mass", "mass_kg"), ("harmonic_force", "sine_N")],
)
def test_with_absent_effects_a_hypothesis_predicts_the_base(label, amplitude):
    problem, hypothesis = problem_of(DRAG, {"slider_mass": 0.52}), (candidate_of(label),)
    base = fit_hypothesis(problem)
    values = with_effects_absent(problem, hypothesis, base)
    np.testing.assert_allclose(
        problem.residual(values, hypothesis), base.residual, rtol=0, atol=1e-9
    )
    replaced = base.mapping["slider_mass"] - 0.5 if label == "added_mass" else 0.0
    assert values[f"{label}.{amplitude}"] == pytest.approx(replaced)
    # the nuisance that an effect replaces is at nominal whatever values say
    if label == "added_mass":
        other = problem.residual({**values, "slider_mass": 0.53}, hypothesis)
        np.testing.assert_array_equal(problem.residual(values, hypothesis), other)


@pytest.mark.parametrize("other", ["spring", "added_mass"])
def test_one_effect_of_a_pair_without_the_other_keeps_everything_else(other):
    problem = problem_of(DRAG | {"constant_force": {"force_N": 0.2}})
    pair = fit_hypothesis(problem, (candidate_of(other), VISCOUS), refresh=True)
    found = without_other_effects(problem, pair, (VISCOUS,))
    assert found.hypothesis == (VISCOUS,)
    kept = {key: value for key, value in pair.mapping.items() if not key.startswith(other)}
    assert found.mapping == {"slider_mass": 0.5, **kept}
    np.testing.assert_allclose(
        problem.residual(found.mapping, (VISCOUS,)), found.residual, rtol=0, atol=1e-3
    )
    again = fit_hypothesis(problem, (VISCOUS,), found.mapping, refresh=True)
    slider_mass = [p.key for p in found.parameters].index("slider_mass")
    assert found.jacobian[:, slider_mass] == pytest.approx(
        again.jacobian[:, slider_mass], rel=0.05, abs=1.0
    )


def stuck(base, hypothesis, start):
    """A fit that stays at its start and has no derivatives."""
    high = fit_hypothesis(base.problem, hypothesis, start, differences=base.differences, vary=())
    parameters = base.problem.parameters(hypothesis)
    values = np.array([high.mapping.get(p.key, start.get(p.key, 0.0)) for p in parameters])
    jacobian = np.zeros((high.residual.size, len(parameters)))
    high = replace(high, parameters=parameters, values=values, jacobian=jacobian)
    assert high.chi2 > base.base.chi2
    return high


def test_a_fit_above_its_part_continues_from_the_part(dragging):
    base, hypothesis = dragging, (VISCOUS, STEADY)
    part = fit_hypothesis(base.problem, hypothesis[:1], differences=base.differences)
    high = stuck(
        base, hypothesis, dict.fromkeys(["viscous.damping_N_s_m", "constant_force.force_N"], 40.0)
    )
    refitted = refit_from_part(base.problem, base.differences, high, [base.base, part])
    assert high.chi2 > base.base.chi2 > part.chi2 >= refitted.chi2
    assert refit_from_part(base.problem, base.differences, refitted, [base.base, part]) is refitted


def test_a_searched_effect_starts_where_it_is_absent_only_for_statistics(dragging):
    """There is no slope from there and simulations take longest. Statistics over cycles are
    smooth."""
    high = stuck(dragging, (RINGING,), {"ringing.size": 0.6})
    simulations = dragging.problem.simulations
    assert refit_from_part(dragging.problem, dragging.differences, high, [dragging.base]) is high
    assert dragging.problem.simulations == simulations
    model = dragging.problem.model
    base, _ = screened(
        replace(model, series=tuple(replace(series, statistic=True) for series in model.series))
    )
    high = stuck(base, (RINGING,), {"ringing.size": 0.6})
    refitted = refit_from_part(base.problem, base.differences, high, [base.base])
    # the residual of the base is a mean of several simulations
    where_absent = base.problem.residual(base.base.mapping)
    assert refitted.chi2 <= where_absent @ where_absent + 1e-9


def test_chi2_without_the_effect_is_that_of_the_base_for_linear_residuals():
    base, _ = screened(toy({"viscous": {"damping_N_s_m": 0.05}}, seed=3))
    for label in ("viscous", "constant_force", "added_mass"):
        found = fit_hypothesis(base.problem, (candidate_of(label),), refresh=True)
        assert chi2_without_effects(base.problem, found) == pytest.approx(base.base.chi2, rel=1e-3)


def test_an_effect_that_only_found_a_better_base_minimum_is_not_named():
    """The base ended in another minimum, and an effect of zero size found the better one."""
    base, sensitivities = screened(toy(nuisances={"slider_mass": 0.515}, seed=2))
    astray = stuck(base, (), base.base.mapping | {"crank_length": 0.147, "slider_mass": 0.475})
    for label in ("viscous", "harmonic_force", "sensor_bias:torque"):
        winner = fit_hypothesis(base.problem, (candidate_of(label),), differences=base.differences)
        assert astray.chi2 > 3.0 * winner.chi2
        decision = select_hypothesis(replace(base, base=astray), sensitivities, [winner], LIMITS)
        assert decision.verdict == "parameters_only"
        assert decision.chosen is decision.base  # the better one that was found on the way
        assert decision.base.chi2 < 1.1 * winner.chi2
    base, sensitivities = screened(toy({"viscous": {"damping_N_s_m": 0.15}}, seed=11))
    found = fit_hypothesis(base.problem, (VISCOUS,), differences=base.differences)
    decision = select_hypothesis(base, sensitivities, [found], LIMITS)
    assert decision.verdict == "named" and decision.base is base.base  # it is there: the base stays
