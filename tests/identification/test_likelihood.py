"""Fits in windows, on an oscillator with an exact Gaussian likelihood."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import least_squares

from jointgap.core.candidates import Parameter
from jointgap.core.errors import SimulationError
from jointgap.identification.fit import FAILED, fit_hypothesis
from jointgap.identification.likelihood import (
    Estimate,
    compete,
    fitted,
    has_windows,
    predicted,
    tame_squares,
    turned,
)
from jointgap.identification.problem import Problem, whiten
from jointgap.identification.screening import SensitivityRegression
from tests.identification.oscillator import (
    FREQUENCY,
    PULL,
    PUSH,
    SD,
    SPRING,
    START,
    SWING,
    WOBBLE,
    Oscillator,
    Windows,
    linear,
    measured,
    noise_of,
    windows,
)


def exact(
    problem: Problem, hypothesis, jump: float, per_turn: int = 4
) -> tuple[float, np.ndarray, np.ndarray]:
    """Minus twice the log marginal likelihood (without n log 2 pi), its optimum and covariance."""
    parameters, first = problem.parameters(hypothesis), problem.settings.windows.first_state
    base = {p.key: 0.0 for p in parameters}
    covariances, offsets, columns = [], [], []
    for run in problem.runs:
        parts = [part for part in problem.parts if part.series.run == run]

        def read(values, slow=None, run=run, parts=parts):
            """Whitened readings and the ends of windows."""
            own = {p.name: values[p.key] for p in problem.nuisances if p.run in (None, run)}
            windowed = problem.model.windows(
                run, own, [(c, {"size": values[f"{c.label}.size"]}) for c in hypothesis]
            )
            states = windowed.filter_states({}, {}, per_turn, jump, math.inf).states
            readings, ends, *_ = windowed.simulate(
                replace(states, slow=states.slow if slow is None else slow)
            )
            whitened = [whiten(readings[part.series.channel], part.noise) for part in parts]
            return np.concatenate(whitened), ends

        white, ends = read(base)
        count = len(ends)
        step, by_state = np.zeros((count, 2, 2)), np.zeros((white.size, 2 * count))
        for k, i in np.ndindex(count, 2):
            slow = np.zeros((count, 2))
            slow[k, i] = 1.0
            other, other_ends = read(base, slow)
            by_state[:, 2 * k + i], step[k, :, i] = other - white, other_ends[k] - ends[k]
        # states (2 k) as a linear function of the first one, the jumps, and what moves on without
        # them
        mix = np.eye(2 * count)
        for k in range(1, count):
            mix[2 * k : 2 * k + 2, : 2 * k] = step[k - 1] @ mix[2 * k - 2 : 2 * k, : 2 * k]
        spread = np.concatenate([[first] * 2, [jump] * (2 * count - 2)])
        changes = np.hstack([by_state @ mix * spread, problem.shared_changes(run)])
        covariances.append(np.eye(white.size) + changes @ changes.T)

        def mean(values, read=read, by_state=by_state, mix=mix):
            white, ends = read(values)
            return white + by_state @ (mix @ np.concatenate([np.zeros(2), ends[:-1].ravel()]))

        at_zero = mean(base)
        offsets.append(
            np.concatenate([whiten(part.series.value, part.noise) for part in parts]) - at_zero
        )
        columns.append(np.stack([mean(base | {p.key: 1.0}) - at_zero for p in parameters], axis=1))
    covariance = block_diag(*covariances)
    offset = np.concatenate(offsets)
    by_value = np.concatenate(columns)
    inverse, width = np.linalg.inv(covariance), np.array([p.high - p.low for p in parameters])
    prior = np.where([p in problem.nuisances for p in parameters], np.sqrt(12.0) / width, 0.0)
    nominal = np.array([p.nominal for p in parameters])
    information = by_value.T @ inverse @ by_value + np.diag(prior**2)
    at = np.linalg.solve(information, by_value.T @ inverse @ offset + prior**2 * nominal)
    left = offset - by_value @ at
    cost = left @ inverse @ left + np.sum((prior * (at - nominal)) ** 2)
    return cost + np.linalg.slogdet(covariance)[1], at, np.linalg.inv(information)


def annealed(problem: Problem, *hypothesis, **start) -> Estimate:
    return Estimate(problem, hypothesis, **start).anneal()


def swinging(size=0.03, **more) -> Problem:
    return linear(hidden={"swing": {"size": size}}, **more)


@pytest.fixture(scope="module")
def hidden():
    """A problem with a hidden swing; estimates without and with it."""
    problem = swinging()
    return problem, annealed(problem), annealed(problem, SWING)


@pytest.fixture(scope="module", params=["as measured", "driven by a measured angle"])
def either(request, hidden):
    """The same, and with drive errors that the channels of a run share, some larger than the
    noise."""
    if request.param == "as measured":
        return hidden
    rng, noise = np.random.default_rng(8), noise_of(hidden[0])
    for part in hidden[0].parts:
        waves = np.cos(np.outer(part.series.angle, [1, 2, 3]) + rng.uniform(0.0, math.tau, 3))
        noise[part.series.key] = replace(part.noise, drive=SD * np.array([5.0, 1.0, 0.2]) * waves)
    problem = Problem(hidden[0].model, noise, settings=hidden[0].settings)
    return problem, annealed(problem), annealed(problem, SWING)


def test_the_deviance_is_the_exact_gaussian_marginal_likelihood(either):
    problem, *estimates = either
    free = [
        [s for s in one.stages if s.jump <= problem.settings.windows.held_above]
        for one in estimates
    ]
    assert sum(map(len, free)) > 6
    for estimate, stages in zip(estimates, free, strict=True):
        for stage in stages:
            deviance, at, covariance = exact(problem, estimate.hypothesis, stage.jump)
            assert stage.deviance == pytest.approx(deviance, rel=1e-9)
            assert stage.values == pytest.approx(at, abs=1e-6 * np.sqrt(np.diag(covariance)).min())
            assert np.linalg.inv(stage.hessian) == pytest.approx(covariance, rel=1e-6, abs=1e-12)
    base, true = estimates
    assert true.best.jump <= 0.003 and true.best.deviance < base.best.deviance - 20.0


def test_at_the_smallest_jump_values_and_errors_are_those_of_one_trajectory(either):
    problem, _, estimate = either
    assert estimate.stages[-1].jump == problem.settings.windows.jumps[-1]
    _, at, covariance = exact(problem, (SWING,), 1e-7)
    assert np.abs((estimate.values - at) / np.sqrt(np.diag(covariance))).max() < 0.1
    _, _, covariance = exact(problem, (SWING,), problem.settings.windows.jumps[-1])
    fit = replace(estimate.fit(), gap_left=0.0)
    errors = np.sqrt(np.diag(fit.distribution.covariance)) / fit.scale
    assert errors == pytest.approx(np.sqrt(np.diag(covariance)), rel=0.05)


def test_sensitivities_predict_the_joint_fit_of_a_force_and_parameters(either):
    problem, base, true = either
    sensitivities = base.sensitivities([SWING])
    (own,) = sensitivities.entries
    # the weak law of the parameters, as rows
    law = np.hstack([np.diag(base.prior), np.zeros((base.values.size, 1))])
    rows = np.vstack([np.hstack([sensitivities.jacobian, own.columns]), law])
    off = base.values - np.array([p.nominal for p in base.parameters])
    left = np.concatenate([sensitivities.residual, base.prior * off])
    step, (lowest,), *_ = np.linalg.lstsq(rows, -left, rcond=None)
    with_it = next(stage for stage in true.stages if stage.jump == base.stages[-1].jump)
    assert left @ left == pytest.approx(base.stages[-1].cost, rel=1e-6)
    assert lowest == pytest.approx(with_it.cost, rel=1e-6)
    assert np.append(base.values, 0.0) + step == pytest.approx(with_it.values, abs=1e-5)
    assert sensitivities.residual.size == problem.size


def test_an_effect_that_replaces_a_nuisance_exceeds_its_bounds_and_excludes_others():
    problem = linear(drive=0.3, bounds=(0.0, 0.25))
    sensitivities = annealed(problem).sensitivities([PUSH])
    (single,) = SensitivityRegression(sensitivities).singles()
    assert sensitivities.residual @ sensitivities.residual - single.chi2 > 10.0
    assert single.start["push.size"] == pytest.approx(0.1, abs=0.02)  # beyond the nominal 0.2
    assert [
        one.candidate for one in annealed(problem, PUSH).sensitivities([SWING, PUSH]).entries
    ] == [SWING]


def test_bounds_hold_and_the_other_parameters_are_optimal_for_them():
    for drive, (low, high), at, held in (
        (0.3, (0.0, 0.25), 0.25, 0.25),
        (0.1, (0.15, 0.25), 0.15, 0.15),
    ):
        problem, drives, pulls = swinging(drive=drive, bounds=(low, high)), [], []
        make = problem.model.windows

        def windows_of(run, values, effects=(), make=make, drives=drives, pulls=pulls):
            drives.append(values["drive"])
            pulls.extend(at["size"] for _, at in effects)
            return make(run, values, effects)

        problem.model.windows = windows_of
        estimate = annealed(problem, PULL)
        assert estimate.mapping["drive"] == at and estimate.mapping["pull.size"] == 0.0
        (single,) = SensitivityRegression(annealed(problem).sensitivities([PULL])).singles()
        assert single.start["pull.size"] == 0.0
        assert low <= min(drives) and max(drives) <= high and min(pulls) == 0.0
        fixed = annealed(swinging(drive=drive, bounds=(held, held)), PULL)
        assert estimate.values == pytest.approx(fixed.values, abs=1e-6)


def test_derivatives_use_steps_of_about_a_standard_error():
    """The frequency acts nonlinearly: over a long step the difference quotient is wrong."""
    found = []
    for step in (1e-4, 0.3):
        own = Parameter("frequency", 1.3, 0.5, 2.0, step), Parameter("drive", 0.2, 0.0, 0.6, 0.01)
        found.append(
            annealed(measured(Oscillator(own), {"frequency": FREQUENCY, "drive": 0.3}, {}))
        )
    fine, coarse = found
    sd = np.sqrt(np.diag(np.linalg.inv(fine.stages[-1].hessian)))
    assert 0.3 > 100.0 * sd[0]
    assert np.abs((coarse.values - fine.values) / sd).max() < 0.1
    assert coarse.stages[-1].hessian == pytest.approx(fine.stages[-1].hessian, rel=0.05, abs=1.0)


def test_a_parameter_is_found_in_windows_where_one_trajectory_gets_stuck():
    frequency = Parameter("frequency", 1.0, 0.5, 2.0, 1e-3)
    steady = {"drive": 0.0, "damping": 0.001}
    problem = measured(Oscillator([frequency]), steady | {"frequency": FREQUENCY}, {})
    problem.model.windows = lambda run, values, effects=(): Windows(
        problem.model, run, steady | values, {}
    )

    def trajectory(at):
        run = Windows(problem.model, "slow", steady | {"frequency": at[0]}, {})
        motion = run.motion(run.times, np.zeros(1), at[None, 1:])
        return np.concatenate([motion[:, i] - problem.parts[i].series.value for i in (0, 1)]) / SD

    stuck = least_squares(trajectory, [1.0, *START["slow"]])
    assert 2.0 * stuck.cost > 4.0 * problem.size
    estimate = annealed(problem)
    sd = estimate.stages[-1].hessian[0, 0] ** -0.5
    assert estimate.mapping["frequency"] == pytest.approx(FREQUENCY, abs=4.0 * sd) and sd < 0.01
    assert estimate.stages[-1].cost < 1.3 * problem.size


# Windows, their states and what cannot be simulated


def test_a_failed_window_costs_but_does_not_end_the_fit():
    complete, cut = (annealed(linear(broken=broken)) for broken in (-1, 6))
    stage = cut.stages[-1]
    assert stage.jump == complete.stages[-1].jump and stage.lost == 1 / 16
    # of two runs, two channels and six samples each: as a residual of 10
    missed = float(tame_squares(np.array(10.0), cut.settings.large))
    assert stage.cost - complete.stages[-1].cost == pytest.approx(24 * missed, rel=0.05)
    assert cut.values == pytest.approx(complete.values, abs=0.02)
    for broken, carried in ((-1, range(8)), (6, [0, 1, 2, 3, 4, 5, 6, 0])):
        estimate = Estimate(linear(broken=broken), ())
        for jump in (0.03, 0.006):
            estimate.fit_at(jump)
        for run in estimate._runs.values():
            assert run.states.carried.windows[:8, 0] == pytest.approx(list(carried))


def test_angle_differences_are_wrapped_and_rates_are_not():
    after, before = np.array([6.0, 1.0, -6.0, -20.0]), np.array([0.0, 0.0, 0.5, 0.5])
    assert turned(after, before) == pytest.approx([6.0 - math.tau, 1.0, math.tau - 6.5, -20.5])


# Rivals


def test_a_dominated_rival_stops_early_and_equal_ones_continue(hidden):
    problem, *_ = hidden
    last = problem.settings.windows.jumps[-1]
    best, other = compete([Estimate(problem, (WOBBLE,)), Estimate(problem, (SWING,))])
    assert best.hypothesis == (SWING,) and other.hypothesis == (WOBBLE,)
    assert best.stages[-1].jump == last < other.stages[-1].jump
    below = compete([Estimate(problem, (SWING,))], below=0.1)[0]
    assert below.stages[0].jump < 0.1 and below.values == pytest.approx(best.values, abs=1e-3)
    nothing = linear()
    both = compete([Estimate(nothing, (SWING,)), Estimate(nothing, (WOBBLE,))])
    assert [one.stages[-1].jump for one in both] == [last] * 2
    assert both[0].best.deviance < both[1].best.deviance
    assert compete([]) == []


def test_a_hypothesis_that_cannot_be_simulated_in_windows_fails():
    def failing(effects):
        if "swing" not in effects:
            raise SimulationError("no states")
        return 0.0

    problem = linear(deviance=failing)
    found = compete([Estimate(problem, (WOBBLE,)), Estimate(problem, (SWING,))])
    assert [one.hypothesis for one in found] == [(SWING,)]
    found = fitted(problem, (SPRING,), {"spring.size": 0.1})
    assert found.status == FAILED
    assert found.reason == "no states"
    assert found.mapping["spring.size"] == 0.1
    problem.model.windowed = lambda effects: False
    with pytest.raises(SimulationError, match="run slow is not simulated in windows with base"):
        Estimate(problem, ()).find_states(1.0)


# Fits


def stiffer(**more):
    """A problem with a stiffer spring, whose model can simulate everything in windows."""
    return linear(hidden={"spring": {"size": 0.3, "damping": 0.0}}, candidates=(SPRING,), **more)


def test_only_hidden_clearances_are_fitted_in_windows():
    """The model has windows for all, as one with loose joints."""
    problem = swinging()
    found, usual = fitted(problem, (SWING,)), fit_hypothesis(problem, (SWING,))
    assert not found.in_windows and found.values == pytest.approx(usual.values)
    assert problem.model.filtered == []
    at = {"spring.size": 0.1}
    windowed = [has_windows(problem, one, at) for one in ((), (SWING,), (SPRING,), (SWING, SPRING))]
    assert windowed == [False, False, True, True]
    problem.model.windowed = lambda effects: "swing" not in effects
    assert not has_windows(problem, (SWING, SPRING), at)
    problem.model.series = [replace(one, statistic=True) for one in problem.model.series]
    assert not has_windows(Problem(problem.model, noise_of(problem)), (SPRING,), at)


def test_a_fit_in_windows_starts_from_the_states_of_a_near_fit():
    problem = stiffer()
    near = fitted(problem, (SPRING,), {"spring.size": 0.28})
    before, start = problem.simulations, near.mapping | {"drive": 0.25}
    problem.model.filtered.clear()
    fit = fitted(problem, (SPRING,), start, near=near)
    assert problem.model.filtered == [] and fit.simulations == problem.simulations - before > 0
    assert (np.abs(fit.values - near.values) <= 0.3 * np.sqrt(np.diag(near.covariance()))).all()
    assert fit.chi2 == pytest.approx(near.chi2, abs=1.0)
    other = replace(near, states={run: states[:-1] for run, states in near.states.items()})
    assert fitted(problem, (SPRING,), near.mapping, near=other).chi2 == pytest.approx(
        near.chi2, abs=1.0
    )
    assert problem.model.filtered


def test_a_window_fit_counts_jumps_as_residuals_without_the_prior():
    problem = stiffer()
    estimate = annealed(problem, SPRING, start={"spring.size": 0.28})
    fit, last = estimate.fit(), estimate.stages[-1]
    assert fit.in_windows and fit.status == "converged"
    np.testing.assert_array_equal(fit.values, estimate.values)
    assert fit.mapping["spring.size"] == pytest.approx(0.3, abs=0.01)
    assert fit.chi2 == pytest.approx(last.cost - estimate.cost_of_values)
    assert fit.chi2 == pytest.approx(problem.size, rel=0.25)
    curvature = last.hessian - np.diag(estimate.prior**2)
    np.testing.assert_allclose(
        fit.jacobian.T @ fit.jacobian, curvature, rtol=1e-6, atol=1e-6 * np.abs(curvature).max()
    )


def test_a_few_wild_readings_mislead_squares_but_not_a_fit_that_reports_them():
    def with_wild_readings(**changed):
        problem = swinging(0.3, settings=windows(**changed))
        problem.model.series = [
            replace(one, value=one.value + 60.0 * SD * (np.arange(one.value.size) % 24 == 5))
            for one in problem.model.series
        ]
        return Problem(problem.model, noise_of(problem), settings=problem.settings)

    tame, plain = (
        annealed(with_wild_readings(large=large), SWING).fit() for large in (5.0, math.inf)
    )
    away = [abs(fit.mapping["swing.size"] - 0.3) for fit in (tame, plain)]
    assert away[0] < 0.02 and away[1] > 3.0 * away[0]
    assert tame.chi2 > 0.99 * plain.chi2 > 10.0 * tame.residual.size


def test_a_prediction_at_fixed_values_adjusts_states_and_free_parameters_only():
    problem = stiffer(zero=0.1)
    at = {p.key: p.nominal for p in problem.parameters((SPRING,))}
    at |= {"spring.size": 0.3, "drive": 0.3}
    own = [p for p in problem.nuisances if p.run]
    held, free = predicted(problem, (SPRING,), at), predicted(problem, (SPRING,), at, own)
    assert dict(held.values) == at
    assert {key for key, value in free.values.items() if value != at[key]} == {p.key for p in own}
    assert all(free.values[p.key] == pytest.approx(0.1, abs=0.02) for p in own)
    assert free.residual @ free.residual < 1.3 * problem.size < held.residual @ held.residual
    for part in problem.parts:
        missed = part.series.value - free.readings[part.series.run][part.series.channel]
        assert np.std(missed) == pytest.approx(SD, rel=0.35)
