"""What data and bounds say of parameters together: against the exact distribution, and by whether truths are found."""

import numpy as np
import pytest
from scipy.stats import kstest, norm, truncnorm

from jointgap.core.candidates import Parameter
from jointgap.identification.fit import AT_BOUND, Fit, bounded_normal, bounded_step, nuisance_estimates

NO_SHIFTS = np.empty((0, 1))


def fit_of(jacobian, data, low, high, shifts=None):
    """The least-squares fit of `data` = jacobian @ values + noise of variance 1 within bounds."""
    middle = 0.5 * (low + high)
    step, _ = bounded_step(jacobian, jacobian @ middle - data, low - middle, high - middle)
    values = np.clip(middle + step, low, high)
    parameters = tuple(Parameter(f"p{i}", m, a, b) for i, (m, a, b) in enumerate(zip(middle, low, high, strict=True)))
    return Fit((), parameters, values, jacobian @ values - data, jacobian, 1, "converged", shifts=shifts)


def correlated(rng, samples=40, count=3):
    """Derivatives of residuals by parameters of which each two change nearly the same."""
    common = rng.normal(size=(samples, 1))
    return (common + 0.4 * rng.normal(size=(samples, count))) / np.sqrt(samples) * 5.0


def test_far_from_its_bounds_it_is_the_normal_distribution():
    known = bounded_normal(
        np.array([[2.0]]), np.zeros(1), 1.0, np.zeros(1), np.array([-9.0]), np.array([9.0]), NO_SHIFTS
    )
    assert known.draws is None
    assert known.covariance == pytest.approx(0.25)


@pytest.mark.parametrize(("value", "slope"), [(0.0, 3.0), (0.0, 0.0), (0.4, 0.0)])
def test_one_parameter_is_a_cut_off_normal_number(value, slope):
    """At the bound 0 chi2 falls on by its slope: the minimum lies at -slope / 4 for a derivative of 2."""
    low, high, sd = np.zeros(1), np.array([2.0]), 0.5
    known = bounded_normal(np.array([[2.0]]), np.array([slope]), 1.0, np.array([value]), low, high, NO_SHIFTS)
    mean = value - slope / 4.0
    exact = truncnorm((0.0 - mean) / sd, (2.0 - mean) / sd, mean, sd)
    assert np.quantile(known.draws, [0.05, 0.5, 0.95]) == pytest.approx(exact.ppf([0.05, 0.5, 0.95]), abs=0.02 * sd)
    assert known.covariance[0, 0] == pytest.approx(exact.var(), rel=0.05)


def test_a_slope_that_leads_inwards_is_what_the_fit_left_over_and_does_not_count():
    at_bound = np.zeros(1), np.array([9.0])
    inwards, none = (
        bounded_normal(np.array([[2.0]]), np.array([slope]), 1.0, np.zeros(1), *at_bound, NO_SHIFTS)
        for slope in (-3.0, 0.0)
    )
    assert np.array_equal(inwards.draws, none.draws)


def test_two_parameters_agree_with_a_sum_over_a_grid():
    jacobian = np.array([[3.0, 2.9], [0.0, 0.8]])
    values, low, high = np.array([0.0, 0.5]), np.array([0.0, -0.5]), np.array([1.0, 1.0])
    slope = np.array([1.5, 0.0])
    known = bounded_normal(jacobian, slope, 1.0, values, low, high, np.empty((0, 2)))
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 400), np.linspace(-0.5, 1.0, 400))
    away = np.stack([x - values[0], y - values[1]])
    chi2 = np.sum(np.einsum("ij,jab->iab", jacobian, away) ** 2, axis=0) + 2.0 * slope[0] * away[0]
    weight = np.exp(-0.5 * chi2) / np.exp(-0.5 * chi2).sum()
    mean = np.array([np.sum(weight * x), np.sum(weight * y)])
    assert known.draws.mean(axis=0) == pytest.approx(mean, abs=0.01)
    assert known.covariance[0, 1] == pytest.approx(np.sum(weight * (x - mean[0]) * (y - mean[1])), rel=0.1)
    assert known.covariance[1, 1] == pytest.approx(np.sum(weight * (y - mean[1]) ** 2), rel=0.05)


def test_a_parameter_that_the_data_say_nothing_of_is_anywhere_within_its_bounds():
    known = bounded_normal(
        np.array([[1.0, 0.0]]), np.zeros(2), 1.0, np.zeros(2), np.array([-9.0, -1.0]), np.array([9.0, 3.0]),
        np.empty((0, 2)),
    )  # fmt: skip
    assert kstest(known.draws[::30, 1], "uniform", (-1.0, 4.0)).pvalue > 1e-3
    assert known.covariance[0, 0] == pytest.approx(1.0, rel=0.05)


def test_what_other_numerics_change_adds_to_the_covariance():
    shifts = np.array([[0.3, 0.0], [0.0, 0.4]])
    free = np.full(2, -np.inf), np.full(2, np.inf)
    known = bounded_normal(np.diag([2.0, 5.0]), np.zeros(2), 1.0, np.zeros(2), *free, shifts)
    assert known.covariance == pytest.approx(np.diag([0.25 + 0.09, 0.04 + 0.16]))


@pytest.mark.parametrize("size", [10.0, 30.0, 100.0])
@pytest.mark.parametrize("direction", [(1.0, 1.0), (1.0, -2.0)])
def test_shifts_of_many_standard_errors_are_drawn_as_they_are_beside_a_bound(size, direction):
    """Of two parameters with error 1 that go together, one is cut off at half a shift below."""
    shift = size * np.array([direction])
    low, high = np.array([-0.5 * size, -np.inf]), np.full(2, np.inf)
    known = bounded_normal(np.eye(2), np.zeros(2), 1.0, np.zeros(2), low, high, shift)
    covariance = np.eye(2) + shift.T @ shift
    sd = np.sqrt(np.diag(covariance))
    first = truncnorm(low[0] / sd[0], np.inf, 0.0, sd[0])
    # half of the draws count: neighbouring sweeps go together
    independent = 0.5 * len(known.draws)
    for share in (0.05, 0.5, 0.95):
        exact = first.ppf(share)
        error = np.sqrt(share * (1.0 - share) / independent) / first.pdf(exact)
        assert np.quantile(known.draws[:, 0], share) == pytest.approx(exact, abs=4.0 * error)
    # the second is normal given the first
    slope = covariance[0, 1] / covariance[0, 0]
    spread = np.sqrt(slope**2 * first.var() + covariance[1, 1] - slope * covariance[0, 1])
    assert known.draws[:, 1].mean() == pytest.approx(slope * first.mean(), abs=4.0 * spread / np.sqrt(independent))
    assert known.draws[:, 1].std() == pytest.approx(spread, rel=4.0 / np.sqrt(2.0 * independent))


def test_the_others_are_less_sure_where_one_ends_at_its_bound():
    """Held at its bound, the one that looks nearly alike would make the other look known better than it is."""
    rng = np.random.default_rng(3)
    jacobian, low, high = correlated(rng, count=2), np.zeros(2), np.array([1.0, 9.0])
    fit = fit_of(jacobian, jacobian @ [-0.1, 4.0], low, high)
    (_, bound), (_, other) = nuisance_estimates(fit)
    assert bound["remark"] == AT_BOUND and bound["sd"] is None and bound["interval_90"][0] == 0.0
    assert 0.0 < bound["interval_90"][1] < 1.0
    assert other["sd"] > 1.3 * np.sqrt(fit.covariance()[1, 1])


def test_at_its_upper_bound_the_interval_ends_there():
    jacobian = np.array([[4.0]])
    fit = fit_of(jacobian, np.array([4.8]), np.zeros(1), np.ones(1))
    ((_, found),) = nuisance_estimates(fit)
    assert found["interval_90"] == pytest.approx([truncnorm(-4.8, -0.8, 1.2, 0.25).ppf(0.1), 1.0], abs=0.01)


SEEDS = 150


@pytest.fixture(scope="module")
def calibration():
    """Truths drawn evenly within bounds that cut off much: ranks among the draws, and whether intervals hold them."""
    ranks, inside, at_bound = [], [], []
    low, high = np.zeros(3), np.array([0.5, 1.0, 4.0])
    for seed in range(SEEDS):
        rng = np.random.default_rng([20, seed])
        jacobian, truth = correlated(rng), rng.uniform(low, high)
        shifts = rng.normal(size=(2, 3)) * 0.1
        moved = jacobian @ (truth + rng.normal(size=2) @ shifts)
        fit = fit_of(jacobian, moved + rng.normal(size=40), low, high, shifts)
        estimates = [estimate for _, estimate in nuisance_estimates(fit)]
        ranks.append(np.mean(fit.distribution.draws < truth, axis=0))
        ends = np.array([estimate["interval_90"] for estimate in estimates])
        inside.append((ends[:, 0] <= truth) & (truth <= ends[:, 1]))
        at_bound.append([estimate.get("remark") == AT_BOUND for estimate in estimates])
    return np.array(ranks), np.array(inside), np.array(at_bound)


def test_ranks_of_the_truth_are_even(calibration):
    ranks, _, _ = calibration
    for own in ranks.T:
        assert kstest(own, "uniform").pvalue > 0.01


def test_nine_of_ten_intervals_hold_the_truth_at_the_bounds_and_beside_them(calibration):
    _, inside, at_bound = calibration
    assert 0.2 < at_bound.mean() < 0.8
    for held in (inside, inside[at_bound], inside[~at_bound]):
        assert abs(held.mean() - 0.9) < norm.ppf(0.995) * 0.3 / np.sqrt(held.size) + 0.01


def test_with_parameters_held_at_their_bounds_intervals_hold_too_rarely():
    """What the distribution within the bounds is for: the same truths, each parameter at a bound taken as known."""
    inside = []
    low, high = np.zeros(3), np.array([0.5, 1.0, 4.0])
    for seed in range(SEEDS):
        rng = np.random.default_rng([20, seed])
        jacobian, truth = correlated(rng), rng.uniform(low, high)
        fit = fit_of(jacobian, jacobian @ truth + rng.normal(size=40), low, high)
        sd = np.sqrt(np.diag(fit.covariance()))
        inside += list((np.abs(fit.values - truth) <= 1.645 * sd)[sd > 0.0])
    assert np.mean(inside) < 0.8


def test_of_two_parameters_that_change_the_same_the_ranges_say_what_the_data_do_not():
    rng = np.random.default_rng(1)
    one = rng.normal(size=(40, 1))
    jacobian = np.hstack([1e4 * one, 3e4 * one])
    low, high = -np.ones(2), np.ones(2)
    known = bounded_normal(jacobian, np.zeros(2), 30.0, np.array([-1.0, 0.0]), low, high, np.empty((0, 2)))
    assert np.isfinite(known.covariance).all()
    assert np.all(known.draws >= low)
    assert np.all(known.draws <= high)
