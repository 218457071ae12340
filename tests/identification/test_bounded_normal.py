"""Parameters given data and bounds: exact distributions and coverage."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.stats import kstest, norm, truncnorm

from jointgap.core.candidates import Parameter, Series
from jointgap.identification import baseline
from jointgap.identification.baseline import with_intervals
from jointgap.identification.fit import (
    AT_BOUND,
    Fit,
    bounded_normal,
    bounded_step,
    coordinate_estimate,
    fit_hypothesis,
    nuisance_estimates,
    prior_of_bounds,
)
from jointgap.identification.problem import Noise, Problem

FREE = -np.inf, np.inf


def known_of(jacobian, low, high, values=None, slope=None, scale=1.0, shifts=None):
    """The distribution about `values` (0 by default), where chi2 has the given slope."""
    jacobian = np.atleast_2d(jacobian)
    count = jacobian.shape[1]
    values, slope = (
        np.zeros(count) if given is None else np.atleast_1d(given) for given in (values, slope)
    )
    low, high = (np.zeros(count) + end for end in (low, high))
    shifts = np.empty((0, count)) if shifts is None else shifts
    return bounded_normal(jacobian, slope, scale, values, low, high, shifts)


def fit_of(jacobian, data, low, high, shifts=None):
    """The least-squares fit of `data` = jacobian @ values + noise of variance 1 within bounds."""
    middle = 0.5 * (low + high)
    step, _ = bounded_step(jacobian, jacobian @ middle - data, low - middle, high - middle)
    values = np.clip(middle + step, low, high)
    parameters = tuple(
        Parameter(f"p{i}", m, a, b)
        for i, (m, a, b) in enumerate(zip(middle, low, high, strict=True))
    )
    return Fit(
        (), parameters, values, jacobian @ values - data, jacobian, 1, "converged", shifts=shifts
    )


def correlated(rng, count=3):
    """Derivatives of 40 residuals by parameters that act nearly alike."""
    return (rng.normal(size=(40, 1)) + 0.4 * rng.normal(size=(40, count))) / np.sqrt(40) * 5.0


def test_one_parameter_has_a_truncated_normal_distribution():
    """At the bound 0 chi2 has a slope: the minimum is at -slope / 4 for a derivative of 2."""

    for value, slope in [(0.0, 3.0), (0.0, 0.0), (0.4, 0.0)]:
        known, mean, sd = known_of([2.0], 0.0, 2.0, value, slope), value - slope / 4.0, 0.5
        exact = truncnorm((0.0 - mean) / sd, (2.0 - mean) / sd, mean, sd)
        assert np.quantile(known.draws, [0.05, 0.5, 0.95]) == pytest.approx(
            exact.ppf([0.05, 0.5, 0.95]), abs=0.02 * sd
        )
        assert known.covariance[0, 0] == pytest.approx(exact.var(), rel=0.05)
    # an inward slope is an unfinished fit and does not count
    inwards, none = (known_of([2.0], 0.0, 9.0, slope=slope) for slope in (-3.0, 0.0))
    assert np.array_equal(inwards.draws, none.draws)


def test_two_parameters_agree_with_a_grid_integral():
    jacobian = np.array([[3.0, 2.9], [0.0, 0.8]])
    values = np.array([0.0, 0.5])
    slope = np.array([1.5, 0.0])
    known = known_of(jacobian, np.array([0.0, -0.5]), 1.0, values, slope)
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 400), np.linspace(-0.5, 1.0, 400))
    away = np.stack([x - values[0], y - values[1]])
    chi2 = np.sum(np.einsum("ij,jab->iab", jacobian, away) ** 2, axis=0) + 2.0 * slope[0] * away[0]
    weight = np.exp(-0.5 * chi2) / np.exp(-0.5 * chi2).sum()
    mean = np.array([np.sum(weight * x), np.sum(weight * y)])
    assert known.draws.mean(axis=0) == pytest.approx(mean, abs=0.01)
    assert known.covariance[0, 1] == pytest.approx(
        np.sum(weight * (x - mean[0]) * (y - mean[1])), rel=0.1
    )
    assert known.covariance[1, 1] == pytest.approx(np.sum(weight * (y - mean[1]) ** 2), rel=0.05)


def test_an_undetermined_parameter_is_uniform_within_its_bounds():
    known = known_of([1.0, 0.0], np.array([-9.0, -1.0]), np.array([9.0, 3.0]))
    assert kstest(known.draws[::30, 1], "uniform", (-1.0, 4.0)).pvalue > 1e-3
    assert known.covariance[0, 0] == pytest.approx(1.0, rel=0.05)
    one = np.random.default_rng(1).normal(size=(40, 1))  # two parameters that change the same
    known = known_of(
        np.hstack([1e4 * one, 3e4 * one]), -1.0, 1.0, np.array([-1.0, 0.0]), scale=30.0
    )
    assert np.isfinite(known.covariance).all() and np.all(np.abs(known.draws) <= 1.0)


@pytest.mark.parametrize(
    "size, direction", list(product([10.0, 30.0, 100.0], [(1.0, 1.0), (1.0, -2.0)]))
)
def test_large_numerical_shifts_widen_each_parameter_separately_within_its_bounds(size, direction):
    """Two parameters with error 1; one is truncated at half a shift. The other is unaffected."""
    shift, low = size * np.array([direction]), np.array([-0.5 * size, -np.inf])
    known, sd = known_of(np.eye(2), low, np.inf, shifts=shift), np.sqrt(1.0 + shift[0] ** 2)
    first = truncnorm(low[0] / sd[0], np.inf, 0.0, sd[0])
    independent = 0.5 * len(known.draws)  # neighbouring sweeps go together
    for share in (0.05, 0.5, 0.95):
        exact = first.ppf(share)
        error = np.sqrt(share * (1.0 - share) / independent) / first.pdf(exact)
        assert np.quantile(known.draws[:, 0], share) == pytest.approx(exact, abs=4.0 * error)
    second = known.draws[:, 1]
    assert second.mean() == pytest.approx(0.0, abs=4.0 * sd[1] / np.sqrt(independent))
    assert second.std() == pytest.approx(sd[1], rel=4.0 / np.sqrt(2.0 * independent))


@pytest.mark.integration  # many fits
def test_ranks_of_the_truth_are_uniform_and_90_percent_intervals_cover_90_percent():
    """Truths are uniform within narrow bounds. Fixing parameters at their bounds would give
    intervals that are too short."""
    ranks, inside, at_bound, plainly = [], [], [], []
    low, high = np.zeros(3), np.array([0.5, 1.0, 4.0])
    for seed in range(150):
        rng = np.random.default_rng([20, seed])
        jacobian, truth = correlated(rng), rng.uniform(low, high)
        shifts = rng.normal(size=(2, 3)) * 0.1
        moved, noise = jacobian @ (truth + rng.normal(size=2) @ shifts), rng.normal(size=40)
        fit = fit_of(jacobian, moved + noise, low, high, shifts)
        estimates = [coordinate_estimate(fit, place) for place in range(3)]
        ranks.append(np.mean(fit.distribution.draws < truth, axis=0))
        ends = np.array([estimate["interval_90"] for estimate in estimates])
        inside.append((ends[:, 0] <= truth) & (truth <= ends[:, 1]))
        at_bound.append([estimate.get("remark") == AT_BOUND for estimate in estimates])
        held = fit_of(jacobian, jacobian @ truth + noise, low, high)
        sd = np.sqrt(np.diag(held.covariance()))
        plainly += list((np.abs(held.values - truth) <= 1.645 * sd)[sd > 0.0])
    inside, at_bound = np.array(inside), np.array(at_bound)
    assert all(kstest(own, "uniform").pvalue > 0.01 for own in np.array(ranks).T)
    assert 0.2 < at_bound.mean() < 0.8
    for held in (inside, inside[at_bound], inside[~at_bound]):
        assert abs(held.mean() - 0.9) < norm.ppf(0.995) * 0.3 / np.sqrt(held.size) + 0.01
    assert np.mean(plainly) < 0.8


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_shift_at_a_bound_widens_the_other_parameters_intervals_to_both_sides(sign):
    """Its sign and its correlation with other shifts are unknown."""
    jacobian, low, high = 100.0 * np.eye(2), np.array([0.0, 0.0]), np.array([2.0, 9.0])
    fit = fit_of(jacobian, jacobian @ [1.0, -1e-4], low, high, shifts=np.array([[0.1, sign * 0.1]]))
    (_, inside), (_, at_bound) = nuisance_estimates(fit)
    assert at_bound["remark"] == AT_BOUND and at_bound["interval_90"][0] == 0.0
    half_width = 1.645 * np.hypot(0.1, 0.01)
    assert inside["interval_90"] == pytest.approx([1.0 - half_width, 1.0 + half_width], abs=0.01)


@pytest.mark.integration  # many fits
def test_90_percent_intervals_cover_90_percent_with_numerical_shifts():
    """Simulations err by as much as other numerics change the values, in any direction."""
    low = np.zeros(3)
    high = np.array([0.5, 1.0, 4.0])
    size = np.array([0.2, 0.1, 0.3])
    inside = []
    ends = []
    for seed in range(30):
        rng = np.random.default_rng([21, seed])
        jacobian, truth = correlated(rng), rng.uniform(low, high)
        shift = size * rng.choice([-1.0, 1.0], 3)
        moved = jacobian @ (truth + size * rng.normal(size=3)) + rng.normal(size=40)
        fit = fit_of(jacobian, moved, low, high, shift[None, :])
        for place, (p, true) in enumerate(zip(fit.parameters, truth, strict=True)):
            estimate = coordinate_estimate(fit, place)
            begin, end = estimate["interval_90"]
            inside.append(begin <= true <= end)
            ends.append(p.low < estimate["value"] < p.high and not begin < estimate["value"] < end)
    assert not any(ends)
    assert abs(np.mean(inside) - 0.9) < norm.ppf(0.995) * 0.3 / np.sqrt(len(inside)) + 0.01


class Line:
    """A model that reads x."""

    name, candidates, numerics = "line", (), ()
    nuisances = (Parameter("x", 0.0, -9.0, 9.0, 0.01),)

    def __init__(self):
        none = np.zeros(9)
        self.series = (
            Series("run", "y", "1", none + 0.5, none, none, none > 0.0, np.full(9, 0.01)),
        )

    def simulate(self, run, values, effects=(), numerics=0):
        return {"y": np.full(9, values.get("x", 0.0))}


def test_refits_from_drawn_starts_widen_an_interval_by_their_mean_square_change(monkeypatch):
    model = Line()
    problem = Problem(model, {series.key: Noise(series.stated_noise) for series in model.series})
    none, fit = (
        fit_hypothesis(problem, refresh=True, vary=model.nuisances[:count]) for count in (0, 1)
    )
    sd = np.sqrt(fit.distribution.covariance[0, 0])
    assert with_intervals(problem, none) is none
    # of a linear residual they end where it did
    assert np.all(np.abs(with_intervals(problem, fit).shifts) < 0.22 * sd)
    ends = iter((0.3, -0.4))
    monkeypatch.setattr(
        baseline, "fit_hypothesis", lambda *of, **more: replace(fit, values=fit.values + next(ends))
    )
    widened = with_intervals(problem, fit).distribution.covariance[0, 0]
    assert widened == pytest.approx(sd**2 + 0.5 * (0.3**2 + 0.4**2))


def test_the_prior_of_bounds_has_the_standard_deviation_of_a_uniform_distribution():
    low, high = np.array([0.9, 2.0, 0.0]), np.array([1.1, 2.0, np.inf])
    drawn = np.random.default_rng(0).uniform(0.9, 1.1, 100_000)
    assert prior_of_bounds(low, high) == pytest.approx([1.0 / np.std(drawn), 0.0, 0.0], rel=0.01)
