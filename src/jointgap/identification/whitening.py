"""Noise of one channel of one run, residuals whitened by it, and back."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter, lfiltic


@dataclass(frozen=True)
class Noise:
    """Noise of one series, by which its residual is measured."""

    sd: np.ndarray  # Marginal standard deviation of the measurement [unit]
    autocorrelation: tuple[float, ...] = ()
    numerics: np.ndarray | float = 0.0  # Standard deviation of what equally good numerics predict otherwise [unit]
    source: str = "stated"  # Where `sd` is from, in words
    drive: np.ndarray | None = None

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation [unit] of a residual of the true model, shape (n,)."""
        return np.sqrt(self.sd**2 + np.square(self.numerics))


def whiten(residual: np.ndarray, noise: Noise) -> np.ndarray:
    """Residuals as independent numbers of variance 1 if nothing but noise is in them.

    From each sample its prediction from the samples before it, back to the last gap, is subtracted: exact for an
    autoregressive process.
    """
    flat = residual.ndim == 1
    scaled = (residual[:, None] if flat else residual) / noise.spread[:, None]
    if noise.autocorrelation:
        scaled = _innovations(scaled, autoregression(noise.autocorrelation))
    return scaled[:, 0] if flat else scaled


class SharedErrors:
    """Errors that several series share, beside their noise: after it, they are whitened together."""

    def __init__(self, changes: np.ndarray):
        self._directions, sizes, _ = np.linalg.svd(changes, full_matrices=False)
        self._excess = 1.0 - 1.0 / np.hypot(1.0, sizes)

    def whiten(self, residual: np.ndarray) -> np.ndarray:
        """Residuals (n,) with covariance I + changes changes' as independent numbers of variance 1.

        By the symmetric root, so that each stays with its sample.
        """
        return residual - self._directions @ (self._excess * (self._directions.T @ residual))


def autoregression(autocorrelation: Sequence[float]) -> list[tuple[np.ndarray, float]]:
    """Weights of the last 0, 1, ..., p samples that predict the next, and the remaining sd (Levinson).

    Each (weights, sd) is of shapes (order,) and (), in standard deviations of the process; `autocorrelation` is at lags
    1 ... p.
    """
    rho = np.concatenate(([1.0], autocorrelation))
    weights, variance = np.empty(0), 1.0
    orders = [(weights, 1.0)]
    for order in range(1, rho.size):
        reflection = (rho[order] - weights @ rho[order - 1 : 0 : -1]) / variance
        weights = np.append(weights - reflection * weights[::-1], reflection)
        variance *= 1.0 - reflection**2
        if not variance > 0.0:
            raise ValueError(f"autocorrelation {list(autocorrelation)} is not that of any process")
        orders.append((weights, float(np.sqrt(variance))))
    return orders


def _innovations(scaled: np.ndarray, orders: list[tuple[np.ndarray, float]]) -> np.ndarray:
    present = np.isfinite(scaled[:, 0])
    index = np.arange(present.size)
    since_gap = index - np.maximum.accumulate(np.where(present, -1, index))  # samples in a row, this one included
    innovations = np.full(scaled.shape, np.nan)
    for order, (weights, sd) in enumerate(orders):
        last = order == len(orders) - 1
        chosen = index[present & ((since_gap > order) if last else (since_gap == order + 1))]
        value = scaled[chosen]
        for lag, weight in enumerate(weights, 1):
            value = value - weight * scaled[chosen - lag]
        innovations[chosen] = value / sd
    return innovations


def unwhiten(white: np.ndarray, noise: Noise) -> np.ndarray:
    """The inverse of `whiten`, in units of the noise's spread."""
    if not noise.autocorrelation:
        return white
    orders = autoregression(noise.autocorrelation)
    weights, sd = orders[-1]
    scaled = np.full(white.size, np.nan)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], np.isfinite(white), [False]))))
    for begin, end in edges.reshape(-1, 2):
        ahead = min(begin + weights.size, end)
        for i in range(begin, ahead):  # the first ones have fewer samples before them
            earlier, innovation = orders[i - begin]
            scaled[i] = innovation * white[i] + earlier @ scaled[begin:i][::-1]
        if ahead < end:
            past = lfiltic([sd], np.concatenate(([1.0], -weights)), scaled[begin:ahead][::-1])
            scaled[ahead:end] = lfilter([sd], np.concatenate(([1.0], -weights)), white[ahead:end], zi=past)[0]
    return scaled
