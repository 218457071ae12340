"""Thresholds from simulated campaigns in which nothing is hidden: noise, and the disagreement of equally good numerics."""

from dataclasses import dataclass

import numpy as np

from jointgap.discrepancy.alike import Subspaces, orthonormal
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
    subspaces = Subspaces(known)
    basis = subspaces.nuisances
    spaces = [(orthonormal(subspaces.projected(one.columns)), len(one.candidate.coordinates)) for one in known.found]
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
