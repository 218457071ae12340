"""Thresholds from simulated campaigns in which nothing is hidden: noise, and the disagreement of equally good
numerics."""

from typing import NamedTuple

import numpy as np

from jointgap.identification.baseline import Baseline, other_numerics
from jointgap.identification.likelihood import signatures_about
from jointgap.identification.problem import Problem
from jointgap.identification.screening import Signatures, SignatureSubspaces, orthonormal
from jointgap.identification.verdict import Thresholds


class Screening(NamedTuple):
    """Signatures of all candidates, and the thresholds of the campaign."""

    signatures: Signatures
    limits: Thresholds


def screen_candidates(base: Baseline, rate: float, noise_dof: float = np.inf, seed: int = 0) -> Screening:
    """Simulate every candidate at a small size, and find what null campaigns would show of them."""
    signatures = signatures_about(base.problem, base.base, base.differences)
    numerics = other_numerics(base.problem, base.base)
    numerical_noise = base.differences.numerical_noise_chi2
    return Screening(signatures, thresholds(base.problem, signatures, numerics, rate, noise_dof, numerical_noise, seed))


def thresholds(
    problem: Problem,
    signatures: Signatures,
    numerics: np.ndarray,
    rate: float = 0.01,
    noise_dof: float = np.inf,
    numerical_noise: float = 0.0,
    seed: int = 0,
) -> Thresholds:
    """Thresholds of one campaign, from null campaigns in which the motion answers to everything linearly.

    A null campaign's residual is the measurement's noise, plus what each of the other numerics changes times a normal
    number, less what the nuisances take up.
    """
    size = signatures.residual.size
    generator = np.random.default_rng(seed)
    # Whitening divides by noise and numerics together; the noise alone is less than 1 where numerics disagree.
    measured = np.concatenate([(part.noise.sd / part.noise.spread)[part.used] for part in problem.parts])
    subspaces = SignatureSubspaces(signatures, problem.settings.screening)
    numerics = subspaces.projected(numerics.T)
    draws = problem.settings.screening.null_campaigns
    amounts = generator.standard_normal((draws, numerics.shape[1]))

    # chi2: squares of many independent numbers, so normal about its mean, and what the numerics add to it.
    # That is amounts @ numerics.T, of which sums over the samples alone are needed: all of it would fill the memory.
    added, met = (_lengths(amounts, weight * numerics) for weight in (1.0, measured[:, None]))
    chi2 = np.sum(measured**2) - subspaces.nuisances.shape[1] + added
    chi2 += np.sqrt(2 * np.sum(measured**4) + 4 * met) * generator.standard_normal(draws)
    if np.isfinite(noise_dof):  # noise taken for smaller or larger than it is
        chi2 *= noise_dof / generator.chisquare(noise_dof, draws)

    # Gains: lengths of projections, which depend on the draws through as many numbers as there are signatures.
    spaces = [
        (orthonormal(subspaces.projected(signature.columns)), len(signature.coordinates) * np.log(size))
        for signature in signatures.entries
    ]
    joint = np.hstack([space for space, _ in spaces]) if spaces else np.empty((size, 0))
    noise = np.linalg.qr(joint * measured[:, None], mode="r").T if joint.size else np.empty((0, 0))
    drawn = np.square(generator.standard_normal((draws, noise.shape[1])) @ noise.T + amounts @ (numerics.T @ joint))
    gains, begin = np.zeros(draws), 0
    for space, price in spaces:
        gain = drawn[:, begin : begin + space.shape[1]].sum(axis=1) - price
        gains, begin = np.maximum(gains, gain), begin + space.shape[1]
    # Any candidate may happen to resemble what another choice of numerics changes, and a fit gain what numerical noise
    # leaves.
    dof = max(size - subspaces.nuisances.shape[1], 1)
    changed = float(np.max(np.sum(numerics**2, axis=0), initial=0.0))
    max_gain = max(float(np.quantile(gains, 1 - rate)), changed, numerical_noise)
    return Thresholds(rate, float(np.quantile(chi2, 1 - rate) / dof), max_gain, numerical_noise)


def _lengths(amounts: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Squared length of each sum of the columns (n, m) with amounts (draws, m), shape (draws,)."""
    return np.einsum("di,ij,dj->d", amounts, columns.T @ columns, amounts)
