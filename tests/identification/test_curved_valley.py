"""Draws along a curved valley of chi2: against a sum over a grid, by simulation-based calibration, and their cost."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from jointgap.core.candidates import Parameter
from jointgap.core.errors import SimulationError
from jointgap.identification.baseline import draws_along_valley, with_intervals
from jointgap.identification.fit import LEVELS, FiniteDifferences, fit_hypothesis, nuisance_estimates
from jointgap.identification.settings import DEFAULT_SETTINGS

SAMPLES = 200
RESTITUTION, MASS = Parameter("restitution", 0.5, 0.0, 1.0, 0.01), Parameter("mass", 0.0, -1.0, 1.0, 0.01)
SETTINGS = replace(
    DEFAULT_SETTINGS,
    valley=replace(DEFAULT_SETTINGS.valley, batch=6, walkers=100),  # less to learn of two parameters
)


class Rig:
    """Of two parameters the data know mass + bend * (restitution - 0.5)^2 to 0.02 and restitution to 0.3."""

    size, nuisances, parts, has_statistics = SAMPLES, (RESTITUTION, MASS), (), False

    def __init__(self, bend, restitution=0.5, mass=0.0, seed=0, fails_above=np.inf):
        self.settings, self.simulations, self.bend, self.fails_above = SETTINGS, 0, bend, fails_above
        rng = np.random.default_rng([7, seed])
        pattern = np.linalg.qr(rng.normal(size=(SAMPLES, 2)))[0]
        self.along, self.across = pattern[:, 0] / 0.3, pattern[:, 1] / 0.02
        self.data = self.signal(restitution, mass) + rng.normal(size=SAMPLES)
        self.model = self

    numerics = ()

    def signal(self, restitution, mass):
        return self.along * restitution + self.across * (mass + self.bend * (restitution - 0.5) ** 2)

    def parameters(self, hypothesis):
        return self.nuisances

    def residual(self, values, hypothesis=(), runs=None, out=None, numerics=0):
        self.simulations += 1
        if values["restitution"] > self.fails_above:
            raise SimulationError("too far")
        return self.data - self.signal(values["restitution"], values["mass"])

    def fitted(self):
        return fit_hypothesis(self, refresh=True)


def on_grid(rig, inflation):
    """Means of restitution and mass and their covariance, from a sum of exp(-chi2 / 2) over the range."""
    restitution, mass = np.meshgrid(np.linspace(0.0, 1.0, 401), np.linspace(-1.0, 1.0, 2001), indexing="ij")
    off = mass + rig.bend * (restitution - 0.5) ** 2
    chi2 = np.sum(rig.data**2) - 2.0 * (rig.data @ rig.along * restitution + rig.data @ rig.across * off)
    chi2 += rig.along @ rig.along * restitution**2 + rig.across @ rig.across * off**2
    weight = np.exp(-0.5 * (chi2 - chi2.min()) / inflation).ravel()
    points = np.stack([restitution.ravel(), mass.ravel()])
    mean = points @ weight / weight.sum()
    return mean, np.cov(points, aweights=weight)


@pytest.mark.parametrize("restitution", [0.3, 0.95])
def test_draws_follow_the_valley_as_a_sum_over_a_grid_does(restitution):
    rig = Rig(2.0, restitution)
    fit = rig.fitted()
    draws = draws_along_valley(rig, fit)
    mean, covariance = on_grid(rig, fit.inflation)
    sd = np.sqrt(np.diag(covariance))
    assert np.abs(draws.mean(axis=0) - mean) / sd == pytest.approx([0.0, 0.0], abs=0.15)
    assert draws.std(axis=0) == pytest.approx(sd, rel=0.15)
    # along the valley mass is known to 0.02, though by itself to a tenth
    assert np.std(draws[:, 1] + 2.0 * (draws[:, 0] - 0.5) ** 2) == pytest.approx(0.02, rel=0.2)
    assert np.all((draws[:, 0] >= 0.0) & (draws[:, 0] <= 1.0))


def test_a_straight_valley_costs_three_simulations_and_has_the_intervals_of_the_quadratic_chi2():
    rig = Rig(0.0)
    fit, before = rig.fitted(), rig.simulations
    assert draws_along_valley(rig, fit) is None
    assert rig.simulations - before == SETTINGS.valley.probes
    stated = with_intervals(rig, fit, FiniteDifferences(rig))
    assert stated.draws is None
    assert stated.shifts is not None


def test_a_curved_valley_is_what_a_fit_states_in_place_of_what_other_numerics_change():
    rig = Rig(2.0)
    stated = with_intervals(rig, rig.fitted(), FiniteDifferences(rig))
    assert stated.shifts is None
    assert stated.distribution.draws is stated.draws
    np.testing.assert_array_equal(stated.draws, draws_along_valley(rig, rig.fitted()))


def test_differences_that_numerical_noise_could_make_are_no_valley():
    rig = Rig(2.0)
    assert draws_along_valley(rig, rig.fitted(), numerical_noise_chi2=1e6) is None


def test_where_parts_of_the_range_cannot_be_simulated_the_rest_is_drawn_from():
    rig = Rig(2.0)
    fit = rig.fitted()
    rig.fails_above = 0.9
    assert draws_along_valley(rig, fit) is not None
    rig.fails_above = -1.0
    assert draws_along_valley(rig, fit) is None


DATA_SETS = 60


@pytest.fixture(scope="module")
def calibration():
    """Truths drawn evenly within the bounds (Talts et al., arXiv:1804.06788): their ranks among draws, and which
    intervals hold them; along the valley and of the quadratic chi2.
    """
    ranks, inside = {"valley": [], "quadratic": []}, {"valley": [], "quadratic": []}
    for seed in range(DATA_SETS):
        rng = np.random.default_rng([11, seed])
        truth = rng.uniform(0.0, 1.0), rng.uniform(-0.4, 0.4)
        rig = Rig(2.0, *truth, seed=seed)
        rig.nuisances = (RESTITUTION, replace(MASS, low=-0.4, high=0.4))
        fit = rig.fitted()
        for kind, known in (("valley", replace(fit, draws=draws_along_valley(rig, fit))), ("quadratic", fit)):
            ranks[kind].append(np.mean(known.distribution.draws < truth, axis=0))
            estimates = [estimate for _, estimate in nuisance_estimates(known)]
            ends = np.array([[estimate[f"interval_{level}"] for level in LEVELS] for estimate in estimates])
            at = np.array(truth)[:, None]
            inside[kind].append((ends[:, :, 0] <= at) & (at <= ends[:, :, 1]))
    return {kind: np.array(rows) for kind, rows in ranks.items()}, {kind: np.array(r) for kind, r in inside.items()}


@pytest.mark.slow
def test_ranks_of_the_truth_are_even_along_the_valley_and_not_by_the_quadratic_chi2(calibration):
    ranks, _ = calibration
    for own in ranks["valley"].T:
        assert kstest(own, "uniform").pvalue > 0.01
    assert kstest(ranks["quadratic"][:, 1], "uniform").pvalue < 1e-4


@pytest.mark.slow
def test_intervals_hold_as_often_as_they_say_along_the_valley_and_too_rarely_by_the_quadratic_chi2(calibration):
    _, inside = calibration
    for place, level in enumerate(LEVELS):
        share = level / 100.0
        error = np.sqrt(share * (1.0 - share) / DATA_SETS)  # the two parameters count as one
        assert inside["valley"][:, :, place].mean() == pytest.approx(share, abs=2.6 * error + 0.02)
    assert inside["quadratic"][:, 1, 1].mean() < 0.7
