"""Noise of one channel of one run, and residuals measured by it."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Noise:
    """What a series' residual is measured by.

    Attributes
    ----------
    sd : (n,) array
        Marginal standard deviation of the measurement [unit].
    autocorrelation : tuple of float
        At lags of 1, 2, ... samples as far as the noise remembers (an autoregressive process of that order); empty for white.
    numerics : (n,) array
        Standard deviation of what equally good numerics predict otherwise [unit].
    source : str
        Where `sd` is from, in words.
    """

    sd: np.ndarray
    autocorrelation: tuple[float, ...] = ()
    numerics: np.ndarray | float = 0.0
    source: str = "stated"

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation [unit] of a residual of the true model, shape (n,)."""
        return np.sqrt(self.sd**2 + np.square(self.numerics))


def whiten(residual: np.ndarray, noise: Noise) -> np.ndarray:
    """Residuals as independent numbers of variance 1 if nothing but noise is in them.

    Each sample is compared with what the samples before it, back to the last gap, let expect of it: exact for an
    autoregressive process.

    Parameters
    ----------
    residual : (n,) or (n, m) array
        Measured minus predicted [unit]; NaN (in the first column) where there is no datum.
    noise : Noise

    Returns
    -------
    array of the same shape
        NaN where there is no datum.
    """
    flat = residual.ndim == 1
    scaled = (residual[:, None] if flat else residual) / noise.spread[:, None]
    if noise.autocorrelation:
        scaled = _innovations(scaled, prediction(noise.autocorrelation))
    return scaled[:, 0] if flat else scaled


def prediction(autocorrelation) -> list[tuple[np.ndarray, float]]:
    """Weights of the last 0, 1, ..., p samples that predict the next, and the standard deviation that remains (Levinson)."""
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
    known = np.isfinite(scaled[:, 0])
    index = np.arange(known.size)
    since_gap = index - np.maximum.accumulate(np.where(known, -1, index))  # samples known in a row, this one included
    found = np.full(scaled.shape, np.nan)
    for order, (weights, sd) in enumerate(orders):
        last = order == len(orders) - 1
        chosen = index[known & ((since_gap > order) if last else (since_gap == order + 1))]
        value = scaled[chosen]
        for lag, weight in enumerate(weights, 1):
            value = value - weight * scaled[chosen - lag]
        found[chosen] = value / sd
    return found
