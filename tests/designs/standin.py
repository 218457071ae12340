"""Formulas in place of the simulation, whose best lengths are known."""

import numpy as np
from scipy import stats
from scipy.stats import qmc

from jointgap.config import Box, Constraints
from jointgap.config.designs import OptimiseRobust
from jointgap.designs.optimise_robust import Responses, RobustProblem
from jointgap.lengths.region import Region

BOX = Box(crank_length=(0.14, 0.16), rod_length=(0.54, 0.59))
NOMINAL, STEADY, ROD = 0.147, 0.155, 0.57
"""Crank lengths at which the mean and the deviation of the error are smallest, and the best rod
length [m]."""


def problem(
    constraints: Constraints | None = None, region: Region | None = None, **options
) -> RobustProblem:
    """Original lengths in the middle of the box; `options` of the section `optimise_robust`."""
    small = {"generations": 16, "population": 12, "resamples": 100}
    return RobustProblem(
        region=region or Region.of(BOX, None),
        original=(0.15, 0.564),
        options=OptimiseRobust(**small | options),
        constraints=constraints or Constraints(),
    )


def standard_samples(count: int = 64) -> np.ndarray:
    """Normal samples of mean 0 and deviation 1, exactly, shape (count,)."""
    z = stats.norm.ppf(qmc.Sobol(1, rng=0).random_base2(10)[:count, 0])
    return (z - z.mean()) / z.std(ddof=1)


class Formula:
    """Error with mean 1 + a^2 and deviation 1 + b^2, a and b distances from two lengths [cm]."""

    def __init__(self, z: np.ndarray, force=lambda lengths, z: 0.0 * z):
        self.z, self.force = z, force

    def __call__(self, lengths: np.ndarray) -> Responses:
        crank, rod = 100.0 * lengths[:, :1], 100.0 * lengths[:, 1:]
        mean = 1.0 + (crank - 100.0 * NOMINAL) ** 2 + (rod - 100.0 * ROD) ** 2
        error = mean + self.z * (0.3 + (crank - 100.0 * STEADY) ** 2)
        actual = np.repeat(lengths[:, None, :], len(self.z), axis=1)
        force = self.force(lengths, self.z) * np.ones_like(error)
        reasons = np.full(error.shape, None)
        return Responses(lengths, actual, error, force, 2.0 * actual[..., 0], reasons)
