"""Thresholds from simulated campaigns in which nothing is hidden: noise, and the disagreement of equally good numerics."""

from dataclasses import dataclass

import numpy as np

from jointgap.discrepancy.screen import Signatures

DRAWS = 1000


@dataclass(frozen=True)
class Thresholds:
    """What the null campaigns exceed with the stated rate.

    Attributes
    ----------
    rate : float
        Share of null campaigns that exceed each threshold.
    omnibus : float
        Of the base's chi2 over its degrees of freedom.
    directed : float
        Of the largest gain of chi2 by one candidate, less ln n for each of its coordinates.
    """

    rate: float
    omnibus: float
    directed: float


def thresholds(
    known: Signatures, numerics: np.ndarray, rate: float = 0.01, noise_dof: float = np.inf, seed: int = 0
) -> Thresholds:
    """Thresholds of one campaign, from null campaigns in which the motion answers to everything linearly.

    A null campaign's residual is white noise, plus what each of the other numerics changes times a normal number, less what
    the nuisances take up.

    Parameters
    ----------
    known : Signatures
    numerics : (m, n) array
        As `jointgap.discrepancy.recalibrate.other_numerics` gives them.
    rate : float
        False alarms allowed.
    noise_dof : float
        Degrees of freedom from which the noise was estimated; infinite where it is stated.
    seed : int
    """
    size = known.residual.size
    generator = np.random.default_rng(seed)
    basis = _basis(known.jacobian)
    spaces = [(_basis(_projected(one.columns, basis)), len(one.candidate.coordinates)) for one in known.found]
    joint = np.hstack([space for space, _ in spaces]) if spaces else np.empty((size, 0))
    chi2, gains = np.empty(DRAWS), np.empty(DRAWS)
    for i in range(DRAWS):
        drawn = generator.standard_normal(size)
        if len(numerics):
            drawn += generator.standard_normal(len(numerics)) @ numerics
        if np.isfinite(noise_dof):  # noise taken for smaller or larger than it is
            drawn *= np.sqrt(generator.chisquare(noise_dof) / noise_dof)
        drawn -= basis @ (basis.T @ drawn)
        chi2[i] = drawn @ drawn
        inner, at, best = np.square(joint.T @ drawn), 0, 0.0
        for space, count in spaces:
            best = max(best, inner[at : at + space.shape[1]].sum() - count * np.log(size))
            at += space.shape[1]
        gains[i] = best
    dof = max(size - basis.shape[1], 1)
    return Thresholds(rate, float(np.quantile(chi2, 1 - rate) / dof), float(np.quantile(gains, 1 - rate)))


def _basis(columns: np.ndarray) -> np.ndarray:
    """Orthonormal columns of the same span."""
    if not columns.shape[1]:
        return columns
    length = np.linalg.norm(columns, axis=0)
    left, sizes, _ = np.linalg.svd(columns / np.where(length > 0, length, 1.0), full_matrices=False)
    return left[:, sizes > 1e-9 * max(sizes[0], 1e-300)] if sizes[0] > 0 else left[:, :0]


def _projected(columns: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """What of the columns is not in the span of `basis`; nothing where that is rounding."""
    left = columns - basis @ (basis.T @ columns)
    lost = np.linalg.norm(left, axis=0) < 1e-6 * np.linalg.norm(columns, axis=0)
    return np.where(lost, 0.0, left)
