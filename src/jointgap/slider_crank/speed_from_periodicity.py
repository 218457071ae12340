"""The speed of a crank whose angle nobody read, from what repeats with it."""

from collections.abc import Sequence

import numpy as np

_HARMONICS = 6  # of the crank's turning that a channel's course is made of here
_STEP = 0.02  # revolutions, over the whole record, between speeds that are tried


def speed_from_periodicity(elapsed: np.ndarray, values: Sequence[np.ndarray], low: float, high: float) -> float:
    """The speed [rad/s] with which channels repeat best.

    A Fourier series of the crank angle is fitted at each speed; the one that leaves least is refined by a parabola.

    Parameters
    ----------
    elapsed : (n,) array
        Times since the first sample [s].
    values : sequence of (n,) arrays
        Channels; NaN where nothing was measured. Each counts by its own variance.
    low, high : float
        Bounds of the speed [rad/s].
    """
    step = 2.0 * np.pi * _STEP / max(float(elapsed[-1]), 1e-300)
    tried = np.linspace(low, high, max(int(np.ceil((high - low) / step)), 2) + 1)
    left = np.array([_left(elapsed, values, speed) for speed in tried])
    best = int(np.argmin(left))
    if not 0 < best < tried.size - 1:
        return float(tried[best])
    before, here, after = left[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(tried[best] + shift * (tried[1] - tried[0]))


def _left(elapsed, values, speed) -> float:
    """Share of the variance that a Fourier series at `speed` leaves, summed over channels."""
    angle = np.arange(1, _HARMONICS + 1) * (speed * elapsed)[:, None]
    series = np.column_stack([np.ones(elapsed.size), np.cos(angle), np.sin(angle)])
    total = 0.0
    for value in values:
        known = np.isfinite(value)
        centred = value[known] - value[known].mean()
        weight = np.linalg.lstsq(series[known], centred, rcond=None)[0]
        away = centred - series[known] @ weight
        total += float(away @ away) / max(float(centred @ centred), 1e-300)
    return total
