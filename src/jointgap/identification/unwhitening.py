"""Whitened residuals turned back into residuals."""

import numpy as np
from scipy.signal import lfilter, lfiltic

from jointgap.identification.whitening import Noise, prediction


def unwhiten(white: np.ndarray, noise: Noise) -> np.ndarray:
    """The inverse of `jointgap.identification.whitening.whiten`, measured by the noise's spread.

    Parameters
    ----------
    white : (n,) array
        Whitened residuals; NaN where there is no datum.
    noise : Noise

    Returns
    -------
    (n,) array
        Residual over `Noise.spread`; NaN where there is no datum.
    """
    if not noise.autocorrelation:
        return white
    orders = prediction(noise.autocorrelation)
    weights, sd = orders[-1]
    found = np.full(white.size, np.nan)
    known = np.isfinite(white)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], known, [False]))))
    for begin, end in edges.reshape(-1, 2):
        ahead = min(begin + weights.size, end)
        for i in range(begin, ahead):  # the first ones know fewer samples before them
            earlier, rest = orders[i - begin]
            found[i] = rest * white[i] + earlier @ found[begin:i][::-1]
        if ahead < end:
            past = lfiltic([sd], np.concatenate(([1.0], -weights)), found[begin:ahead][::-1])
            found[ahead:end] = lfilter([sd], np.concatenate(([1.0], -weights)), white[ahead:end], zi=past)[0]
    return found
