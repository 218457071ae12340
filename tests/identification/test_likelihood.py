"""States and parameters together in windows, on an oscillator whose exact solution is linear in its state and forces:
the marginal likelihood is that of a Gaussian computation, and what a trajectory hides is found."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import least_squares

from jointgap.core.candidates import Parameter
from jointgap.identification.fit import Fit
from jointgap.identification.likelihood import MISSED, Estimate, compete, has_windows, intervals_in_windows
from jointgap.identification.problem import Problem, whiten
from tests.identification.oscillator import (
    FREQUENCY,
    PULL,
    SD,
    START,
    SWING,
    WOBBLE,
    Oscillator,
    Windows,
    linear,
    measured,
)


def exact(problem: Problem, hypothesis, jump: float, per_turn: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Minus twice the log marginal likelihood but for n log 2 pi, the parameters of most, and their covariance: dense,
    from the covariance of all readings."""
    parameters, first = problem.parameters(hypothesis), problem.settings.windows.first_state
    base = {p.key: 0.0 for p in parameters}

    def read(run, values, slow):
        own = {p.name: values[p.key] for p in problem.nuisances if p.run in (None, run)}
        windowed = problem.model.windows(run, own, [(c, {"size": values[f"{c.label}.size"]}) for c in hypothesis])
        found = windowed.find({}, {}, per_turn, jump, math.inf).states
        return windowed.simulate(replace(found, slow=found.slow if slow is None else slow))

    covariances, offsets, columns = [], [], []
    for run in problem.runs:
        parts = [part for part in problem.parts if part.series.run == run]

        def white(readings, parts=parts):
            return np.concatenate([whiten(readings[part.series.channel], part.noise) for part in parts])

        readings, ends, _, _ = read(run, base, None)
        count = len(ends)
        step, by_state = np.zeros((count, 2, 2)), np.zeros((white(readings).size, 2 * count))
        for k in range(count):
            for i in range(2):
                slow = np.zeros((count, 2))
                slow[k, i] = 1.0
                other, other_ends, _, _ = read(run, base, slow)
                by_state[:, 2 * k + i], step[k, :, i] = white(other) - white(readings), other_ends[k] - ends[k]
        # states (2 k) as a linear function of the first one, the jumps, and what moves on without them
        mix = np.eye(2 * count)
        for k in range(1, count):
            mix[2 * k : 2 * k + 2, : 2 * k] = step[k - 1] @ mix[2 * k - 2 : 2 * k, : 2 * k]
        spread = np.concatenate([[first] * 2, [jump] * (2 * count - 2)])
        covariances.append(np.eye(len(by_state)) + (by_state @ mix * spread**2) @ (by_state @ mix).T)

        def mean(values, run=run, white=white, by_state=by_state, mix=mix):
            readings, ends, _, _ = read(run, values, None)
            drift = np.concatenate([np.zeros(2), ends[:-1].ravel()])
            return white(readings) + by_state @ (mix @ drift)

        at_zero = mean(base)
        offsets.append(white({part.series.channel: part.series.value for part in parts}) - at_zero)
        columns.append(np.stack([mean(base | {p.key: 1.0}) - at_zero for p in parameters], axis=1))
    covariance, offset, by_value = block_diag(*covariances), np.concatenate(offsets), np.concatenate(columns)
    inverse, width = np.linalg.inv(covariance), np.array([p.high - p.low for p in parameters])
    prior = np.where([p in problem.nuisances for p in parameters], 2.0 / width, 0.0)
    nominal = np.array([p.nominal for p in parameters])
    information = by_value.T @ inverse @ by_value + np.diag(prior**2)
    at = np.linalg.solve(information, by_value.T @ inverse @ offset + prior**2 * nominal)
    left = offset - by_value @ at
    cost = left @ inverse @ left + np.sum((prior * (at - nominal)) ** 2)
    return cost + np.linalg.slogdet(covariance)[1], at, np.linalg.inv(information)


@pytest.fixture(scope="module")
def hidden():
    """A problem with a hidden swing, and estimates of the base and with it."""
    problem = linear(hidden={"swing": {"size": 0.03}})
    return problem, Estimate(problem, ()).anneal(), Estimate(problem, (SWING,)).anneal()


def test_the_deviance_is_the_marginal_likelihood_of_a_gaussian_computation(hidden):
    problem, *estimates = hidden
    compared = 0
    for estimate in estimates:
        for stage in estimate.stages:
            if stage.jump <= problem.settings.windows.held_above:
                deviance, at, covariance = exact(problem, estimate.hypothesis, stage.jump, 4)
                assert stage.deviance == pytest.approx(deviance, rel=1e-9)
                assert stage.values == pytest.approx(at, abs=1e-6 * np.sqrt(np.diag(covariance)).min())
                assert np.linalg.inv(stage.hessian) == pytest.approx(covariance, rel=1e-6, abs=1e-12)
                compared += 1
    assert compared > 6


def test_of_two_hypotheses_the_true_one_has_the_larger_likelihood_at_small_jumps(hidden):
    _, base, true = hidden
    assert true.best.jump <= 0.003
    assert true.best.deviance < base.best.deviance - 20.0


def test_at_the_smallest_jump_the_estimate_is_the_least_squares_of_one_trajectory(hidden):
    problem, _, estimate = hidden
    assert estimate.stages[-1].jump == problem.settings.windows.jumps[-1]
    _, at, covariance = exact(problem, (SWING,), 1e-7, 4)
    assert np.abs((estimate.values - at) / np.sqrt(np.diag(covariance))).max() < 0.1


def test_intervals_are_those_of_the_likelihood_and_reach_from_one_end_to_the_other(hidden):
    problem, _, estimate = hidden
    _, _, covariance = exact(problem, (SWING,), problem.settings.windows.jumps[-1], 4)
    off = np.sqrt(np.diag(covariance)) * np.where(np.arange(estimate.values.size) == 0, 5.0, 0.0)
    jacobian = np.zeros((problem.size, estimate.values.size))
    residual = np.full(problem.size, 0.9)
    fit = Fit((SWING,), estimate.parameters, estimate.values + off, residual, jacobian, 0, "converged")
    found = intervals_in_windows(problem, fit)
    errors = np.sqrt(np.diag(found.distribution.covariance))
    assert errors[1:] == pytest.approx(np.sqrt(np.diag(covariance))[1:], rel=0.3)
    assert errors[0] == pytest.approx(math.hypot(1.0, 5.0) * np.sqrt(covariance[0, 0]), rel=0.3)
    kept = intervals_in_windows(problem, replace(fit, windows=estimate.known(fit)))
    np.testing.assert_allclose(kept.distribution.covariance, found.distribution.covariance, rtol=0.05, atol=1e-9)
    assert intervals_in_windows(problem, replace(fit, status="failed")) is None


def test_what_is_far_behind_a_rival_ends_at_a_larger_jump(hidden):
    problem, *_ = hidden
    best, other = compete([Estimate(problem, (WOBBLE,)), Estimate(problem, (SWING,))])
    assert best.hypothesis == (SWING,) and other.hypothesis == (WOBBLE,)
    assert best.stages[-1].jump == problem.settings.windows.jumps[-1] < other.stages[-1].jump
    below = compete([Estimate(problem, (SWING,))], below=0.1)[0]
    assert below.stages[0].jump < 0.1 and below.values == pytest.approx(best.values, abs=1e-3)


def test_scores_rank_the_hidden_force_first_and_tell_its_gain(hidden):
    _, base, true = hidden
    (gain, candidate, values), (second, *_), *_ = base.scores([WOBBLE, PULL, SWING])
    assert candidate is SWING and second < 0.5 * gain
    jump = base.stages[-1].jump
    with_it = next(stage for stage in true.stages if stage.jump == jump)
    assert gain == pytest.approx(base.stages[-1].deviance - with_it.deviance, rel=1e-6)
    assert values["swing.size"] == pytest.approx(0.03, abs=0.005)


def test_bounds_hold():
    problem = linear(drive=0.3, hidden={"swing": {"size": 0.03}}, bounds=(0.0, 0.25))
    estimate = Estimate(problem, (PULL,)).anneal()
    for stage in estimate.stages:
        at = dict(zip((p.key for p in estimate.parameters), stage.values, strict=True))
        assert at["drive"] <= 0.25 and at["pull.size"] >= 0.0
    assert estimate.mapping["drive"] == 0.25 and estimate.mapping["pull.size"] == 0.0
    ((gain, _, values),) = Estimate(problem, ()).anneal().scores([PULL])
    assert gain == pytest.approx(0.0, abs=1e-6) and values["pull.size"] == 0.0


def test_a_window_that_cannot_be_simulated_costs_and_does_not_end_the_fit():
    whole, cut = (Estimate(linear(broken=broken), ()).anneal() for broken in (-1, 6))
    stage = cut.stages[-1]
    assert stage.jump == whole.stages[-1].jump and stage.lost == 1 / 16
    # of two runs, two channels and six samples each
    assert stage.cost - whole.stages[-1].cost == pytest.approx(24 * MISSED**2, rel=0.05)
    assert cut.values == pytest.approx(whole.values, abs=0.02)


def test_what_one_long_trajectory_has_no_slope_to_is_found_in_windows():
    frequency = Parameter("frequency", 1.0, 0.5, 2.0, 1e-3)
    steady = {"drive": 0.0, "damping": 0.001}
    problem = measured(Oscillator([frequency]), steady | {"frequency": FREQUENCY}, {})
    problem.model.windows = lambda run, values, effects=(): Windows(problem.model, run, steady | values, {})

    def trajectory(at):
        run = Windows(problem.model, "slow", steady | {"frequency": at[0]}, {})
        motion = run.motion(run.times, np.zeros(1), at[None, 1:])
        return np.concatenate([motion[:, i] - problem.parts[i].series.value for i in (0, 1)]) / SD

    stuck = least_squares(trajectory, [1.0, *START["slow"]])
    assert 2.0 * stuck.cost > 4.0 * problem.size
    estimate = Estimate(problem, ()).anneal()
    sd = estimate.stages[-1].hessian[0, 0] ** -0.5
    assert estimate.mapping["frequency"] == pytest.approx(FREQUENCY, abs=4.0 * sd) and sd < 0.01
    assert estimate.stages[-1].cost < 1.3 * problem.size


def test_what_has_no_windows_is_not_fitted_in_them():
    problem = linear()
    assert has_windows(problem, (SWING,), {"swing.size": 0.1})
    problem.model.windows = lambda *_: None
    assert not has_windows(problem, (SWING,), {"swing.size": 0.1})
