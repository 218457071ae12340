"""Thresholds from simulated null campaigns: noise and differences between solver variants."""

from typing import NamedTuple

import numpy as np

from jointgap.identification.baseline import Baseline, other_numerics
from jointgap.identification.problem import Problem
from jointgap.identification.screening import (
    Sensitivities,
    SensitivitySubspaces,
    orthonormal,
    simulate_sensitivities,
)
from jointgap.identification.verdict import Thresholds


class Screening(NamedTuple):
    """Sensitivities of all candidates, and the thresholds of the campaign."""

    sensitivities: Sensitivities
    limits: Thresholds


def screen_candidates(
    base: Baseline, rate: float, noise_dof: float = np.inf, seed: int = 0
) -> Screening:
    """Compute the sensitivities of all candidates and the thresholds of null campaigns."""
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    numerics = other_numerics(base.problem, base.base)
    numerical_noise = base.differences.numerical_noise_chi2
    return Screening(
        sensitivities,
        thresholds(base.problem, sensitivities, numerics, rate, noise_dof, numerical_noise, seed),
    )


def thresholds(
    problem: Problem,
    sensitivities: Sensitivities,
    numerics: np.ndarray,
    rate: float = 0.01,
    noise_dof: float = np.inf,
    numerical_noise: float = 0.0,
    seed: int = 0,
) -> Thresholds:
    """Thresholds of a campaign from linearised null campaigns.

    Residual of a null campaign: noise, plus the change by each solver variant times a normal
    number, projected onto the complement of the nuisances.
    """
    size = sensitivities.residual.size
    generator = np.random.default_rng(seed)
    # whitening divides by noise and solver error together, so noise alone is less than 1
    measured = np.concatenate(
        [(part.noise.sd / part.noise.spread)[part.used] for part in problem.parts]
    )
    subspaces = SensitivitySubspaces(sensitivities, problem.settings.screening)
    numerics = subspaces.projected(numerics.T)
    draws = problem.settings.screening.null_campaigns
    amounts = generator.standard_normal((draws, numerics.shape[1]))

    # chi2 is normal about its mean, plus the part of the numerics, amounts @ numerics.T: only sums
    # over the samples are required
    added, crossed = (_lengths(amounts, weight * numerics) for weight in (1.0, measured[:, None]))
    chi2 = np.sum(measured**2) - subspaces.nuisances.shape[1] + added
    chi2 += np.sqrt(2 * np.sum(measured**4) + 4 * crossed) * generator.standard_normal(draws)
    if np.isfinite(noise_dof):  # error of the estimated noise
        chi2 *= noise_dof / generator.chisquare(noise_dof, draws)

    # gains: lengths of projections
    spaces = [
        (
            orthonormal(subspaces.projected(sensitivity.columns)),
            len(sensitivity.coordinates) * np.log(size),
        )
        for sensitivity in sensitivities.entries
    ]
    joint = np.hstack([space for space, _ in spaces]) if spaces else np.empty((size, 0))
    noise = np.linalg.qr(joint * measured[:, None], mode="r").T if joint.size else np.empty((0, 0))
    drawn = np.square(
        generator.standard_normal((draws, noise.shape[1])) @ noise.T
        + amounts @ (numerics.T @ joint)
    )
    gains, begin = np.zeros(draws), 0
    for space, price in spaces:
        gain = drawn[:, begin : begin + space.shape[1]].sum(axis=1) - price
        gains, begin = np.maximum(gains, gain), begin + space.shape[1]
    # a candidate may resemble the change by a solver variant, and a fit may gain numerical noise
    dof = max(size - subspaces.nuisances.shape[1], 1)
    changed = float(np.max(np.sum(numerics**2, axis=0), initial=0.0))
    max_gain = max(float(np.quantile(gains, 1 - rate)), changed, numerical_noise)
    return Thresholds(rate, float(np.quantile(chi2, 1 - rate) / dof), max_gain, numerical_noise)


def _lengths(amounts: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Squared lengths (draws,) of the sums of columns (n, m) with amounts (draws, m)."""
    return np.einsum("di,ij,dj->d", amounts, columns.T @ columns, amounts)
