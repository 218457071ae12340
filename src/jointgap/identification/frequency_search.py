"""Frequencies at which a swinging effect may be hidden in a residual."""

from collections.abc import Sequence

import numpy as np

from jointgap.identification.problem import Part
from jointgap.identification.protocol import Parameter
from jointgap.identification.settings import ScreeningSettings


def likely_frequencies(
    parts: Sequence[Part],
    residual: np.ndarray,
    jacobian: np.ndarray,
    carrier: np.ndarray,
    frequency: Parameter,
    settings: ScreeningSettings,
) -> list[float]:
    """The most likely frequencies [Hz] of an effect that is `carrier` times a cosine in time, the likeliest first.

    A periodogram by least squares: at each frequency the carrier times a cosine and a sine, of each run its own, are
    fitted beside the nuisances. It is exact where the motion does not respond to the force (a prescribed motion, of
    which forces are read).

    Parameters
    ----------
    parts : sequence of Part
        Series with times; others take no part.
    residual : (n,) array
        [1] Whitened.
    jacobian : (n, k) array
        [1/unit] Derivatives with respect to the nuisances.
    carrier : (n,) array
        [1/unit] Derivative with respect to the steady effect's amplitude.
    frequency : Parameter
        Its bounds [Hz] are the range that is searched.
    settings : ScreeningSettings
    """
    time, run = np.full(residual.size, np.nan), np.empty(residual.size, dtype=object)
    for part in parts:
        run[part.place] = part.series.run
        if not part.series.statistic:
            time[part.place] = part.series.time[part.used]
    timed = np.isfinite(time)
    if not timed.any() or not residual.any():  # a preflight has nothing to search
        return []
    span = max(np.ptp(part.series.time[part.used]) for part in parts if timed[part.place].all())
    step = 1.0 / (settings.frequencies_per_line * span)
    densest = min(np.median(np.diff(part.series.time[part.used])) for part in parts if timed[part.place].all())
    tried = np.arange(max(frequency.low, 0.5 / span), min(frequency.high, 0.5 / densest), step)
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    left = residual - basis @ (basis.T @ residual)
    carriers = [np.where(timed & (run == name), carrier, 0.0) for name in dict.fromkeys(run)]
    power = np.array([_power(hertz, np.where(timed, time, 0.0), carriers, basis, left) for hertz in tried])
    inner = np.arange(1, power.size - 1)
    peaks = inner[(power[inner] >= power[inner - 1]) & (power[inner] > power[inner + 1])]
    return [float(tried[i]) for i in sorted(peaks, key=lambda i: -power[i])[: settings.max_frequencies]]


def _power(
    hertz: float, time: np.ndarray, carriers: Sequence[np.ndarray], basis: np.ndarray, left: np.ndarray
) -> float:
    """How much of the squared residual a cosine and a sine explain, in each run by themselves."""
    phase = 2 * np.pi * hertz * time
    columns = np.column_stack([carrier * wave for carrier in carriers for wave in (np.cos(phase), np.sin(phase))])
    columns -= basis @ (basis.T @ columns)
    weight = np.linalg.lstsq(columns, left, rcond=None)[0]
    return float(left @ (columns @ weight))
