"""Sums of whitened residuals over blocks of samples."""

import numpy as np
import pytest

from jointgap.identification.baseline import probed_differences
from jointgap.identification.block_sums import BlockSums, fit_through_sums
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.problem import Problem

from .toy import KNOCKING, candidate_of, knocking, stated_noise, toy


@pytest.fixture(scope="module")
def problem() -> Problem:
    model = toy({"viscous": {"damping_N_s_m": 0.5}}, noise=0.02, samples=70)
    return Problem(model, stated_noise(model))


def test_a_sum_over_a_block_of_noise_has_variance_one(problem):
    sums = BlockSums(problem, 12)
    noise = np.random.default_rng(0).standard_normal((problem.size, 400))
    np.testing.assert_allclose(sums.sums(noise).var(axis=1), 1.0, atol=0.35)
    assert sums.size == 6 * 59  # 350 samples in blocks of 6, the last of 2


def test_blocks_sum_their_samples(problem):
    values = {p.key: p.nominal for p in problem.nuisances}
    sums, residual = BlockSums(problem, 10), problem.residual(values)
    np.testing.assert_allclose(
        sums.residual(values), residual.reshape(-1, 7).sum(axis=1) / np.sqrt(7.0)
    )


def test_a_fit_to_sums_finds_the_effect_and_counts_its_simulations(problem):
    before = problem.simulations
    fit = fit_hypothesis(BlockSums(problem, 12), (candidate_of("viscous"),))
    damping = dict(zip((p.key for p in fit.parameters), fit.values, strict=True))[
        "viscous.damping_N_s_m"
    ]
    assert abs(damping - 0.5) < 4 * np.sqrt(fit.covariance()[-1, -1])
    assert problem.simulations > before


@pytest.mark.parametrize("start", [0.2, 0.5, 0.8])
def test_fits_to_ever_shorter_sums_reach_the_optimum_where_a_sample_fit_does_not(start):
    model = toy(noise=0.05, samples=360, hidden=lambda x, v, angle, time: knocking(1.0, angle))
    problem, at = Problem(model, stated_noise(model)), {"knocking.size": start}
    differences = probed_differences(problem, {p.key: p.nominal for p in problem.nuisances})
    stalled = fit_hypothesis(problem, (KNOCKING,), at)
    assert stalled.chi2 > 2.0 * problem.size
    fit = fit_through_sums(problem, stalled, differences)
    assert fit.chi2 < 1.05 * problem.size
    assert fit.mapping["knocking.size"] == pytest.approx(1.0, abs=0.005)


def test_a_stalled_fit_improves_through_sums_though_an_effect_is_missing():
    """The constant force is not a candidate, so no sums are at noise level."""
    model = toy(
        noise=0.05, samples=360, hidden=lambda x, v, angle, time: knocking(1.0, angle) + 0.1
    )
    problem, at = Problem(model, stated_noise(model)), {"knocking.size": 0.5}
    differences = probed_differences(problem, {p.key: p.nominal for p in problem.nuisances})
    stalled = fit_hypothesis(problem, (KNOCKING,), at)
    fit = fit_through_sums(problem, stalled, differences)
    assert fit.chi2 < 0.95 * stalled.chi2
    assert (
        abs(fit.mapping["knocking.size"] - 1.0) < 0.2 < abs(stalled.mapping["knocking.size"] - 1.0)
    )
