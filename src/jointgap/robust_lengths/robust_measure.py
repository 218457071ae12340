"""What of many errors is minimised: their mean and so many standard deviations, or a quantile.

The measures of robustness and reliability that OpenTURNS' module otrobopt offers for designs under uncertainty: mean,
mean and standard deviation, quantile, and the probability with which each constraint holds.
"""

import math
from dataclasses import dataclass

import numpy as np

from jointgap.config.robust_config import OptimiseRobust


@dataclass(frozen=True)
class RobustMeasure:
    """One number of the values that a quantity has in many draws."""

    kind: str = "mean_plus_deviations"  # mean_plus_deviations or quantile
    deviations: float = 2.0  # Standard deviations that are added to the mean
    quantile: float = 0.95  # Share of the draws below the quantile

    @classmethod
    def of_options(cls, options: OptimiseRobust) -> "RobustMeasure":
        """The one that a configuration asks for."""
        return cls(options.measure, options.deviations, options.quantile)

    def of(self, values: np.ndarray) -> np.ndarray:
        """The number, shape (...), of `values` (..., n) in n draws; draws that are NaN do not count."""
        if self.kind == "quantile":
            return _quantile(values, self.quantile)
        return _mean(values) + self.deviations * deviation(values)

    @property
    def words(self) -> str:
        """Its name in a sentence."""
        if self.kind == "quantile":
            return f"{100 * self.quantile:g} % quantile"
        return f"mean plus {self.deviations:g} standard deviations" if self.deviations else "mean"


def deviation(values: np.ndarray) -> np.ndarray:
    """Standard deviation, shape (...), of `values` (..., n), unbiased in its square; 0 of one value."""
    counts = np.count_nonzero(np.isfinite(values), axis=-1)
    squares = np.nansum((values - _mean(values)[..., None]) ** 2, axis=-1)
    return np.sqrt(squares / np.maximum(counts - 1, 1))


def held_quantile(missed: np.ndarray, probability: float) -> np.ndarray:
    """By how much a constraint is missed in all but the worst draws, shape (...).

    At most 0 just where the constraint holds in a share of `probability` of the draws, or more.
    """
    n = missed.shape[-1]
    place = min(math.ceil(probability * n - 1e-9), n) - 1
    ordered = np.sort(np.where(np.isnan(missed), np.inf, missed), axis=-1)
    return ordered[..., place]


def _mean(values: np.ndarray) -> np.ndarray:
    counts = np.count_nonzero(np.isfinite(values), axis=-1)
    return np.where(counts, np.nansum(values, axis=-1) / np.maximum(counts, 1), np.nan)


def _quantile(values: np.ndarray, share: float) -> np.ndarray:
    if np.isnan(values).any():  # several times as slow, and warns where nothing is left
        some = np.isfinite(values).any(axis=-1)
        return np.where(some, np.nanquantile(np.where(some[..., None], values, 0.0), share, axis=-1), np.nan)
    return np.quantile(values, share, axis=-1)
