"""Noise told from repeated cycles: what differs between neighbouring cycles at one angle is no part of a periodic motion."""

from dataclasses import dataclass

import numpy as np

from jointgap.identification.whitening import autoregression

ORDERS = 4
"""The noise remembers at most so many samples."""

_LEAST = 32  # differences; fewer tell nothing of a memory
_LINES, _SURE = 24, 1e-4  # at most so many lines are taken out, of a probability below that in noise
_MEMORIES = np.linspace(-0.9, 0.96, 32)[:, None]  # of first-order processes that are tried as a background
_ROUGHNESS = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)  # fourth differences, of white noise's own variance


@dataclass(frozen=True)
class Scatter:
    """Noise of one series as it was found.

    Attributes
    ----------
    sd : float
        Marginal standard deviation [unit of the series].
    spectrum : (m,) array or None
        Of its variance over the frequencies from 0 to Nyquist's, evenly; the mean is ``sd**2``. None where too little is known.
    count : int
        Numbers that it rests on.
    """

    sd: float
    spectrum: np.ndarray | None
    count: int


def from_cycles(residual: np.ndarray, angle: np.ndarray) -> Scatter | None:
    """Noise from the differences of neighbouring cycles.

    Parameters
    ----------
    residual : (n,) array
        Measured minus predicted; NaN gaps. What repeats from cycle to cycle may be left in it.
    angle : (n,) array
        Rising [rad]; NaN where not known.

    Returns
    -------
    Scatter or None
        None where the cycles do not overlap enough.
    """
    difference, share = cycle_differences(residual, angle)
    known = np.isfinite(difference)
    if known.sum() < _LEAST:
        return None
    per_cycle = int(2 * np.pi / np.median(np.diff(angle[np.isfinite(angle)])))
    # Neighbouring differences share a cycle: covariances near a lag of one cycle are not the noise's own.
    lags = min(known.size // 4, per_cycle // 2)
    if lags <= ORDERS:
        return Scatter(
            _robust_sd(difference[known] / np.sqrt(1 + (1 - share[known]) ** 2 + share[known] ** 2)), None, 0
        )
    smooth = _without_outliers(_without_lines(_without_outliers(difference, 5.0)), 3.0)
    spectrum = _spectrum(smooth, lags)
    frequency = np.linspace(0.0, np.pi, spectrum.size)
    # Interpolation between two samples damps what changes from one to the next.
    mixed = float(np.mean(share[known] * (1.0 - share[known])))
    spectrum = spectrum / (2.0 - 2.0 * mixed * (1.0 - np.cos(frequency)))
    return Scatter(float(np.sqrt(_mean(spectrum))), spectrum, int(known.sum()))


def from_roughness(residual: np.ndarray) -> Scatter | None:
    """White noise from fourth differences, in which a motion that is smooth over five samples leaves nothing."""
    rough = np.convolve(residual, _ROUGHNESS, mode="valid")
    rough = rough[np.isfinite(rough)]
    return Scatter(_robust_sd(rough), None, rough.size) if rough.size >= ORDERS else None


def memory(scatter: Scatter, stated: float | None = None) -> tuple[float, ...]:
    """Autocorrelation at lags of 1, 2, ... of the autoregressive process that the Bayesian information criterion chooses.

    Parameters
    ----------
    scatter : Scatter
        Of a known spectrum.
    stated : float, optional
        Standard deviation that the noise has [unit]. What the cycles differ by beyond it, where the spectrum is highest, is
        not noise: a force out of step with the crank, or a drift.

    Returns
    -------
    tuple of float
        Empty for white noise.
    """
    spectrum = scatter.spectrum
    if stated is not None:
        spectrum = np.minimum(spectrum, _level(spectrum, stated**2))
    covariance = _covariance(spectrum, ORDERS)
    if not covariance[0] > 0.0:
        return ()
    correlation = covariance / covariance[0]
    left = np.array([sd for _, sd in autoregression(correlation[1:])]) ** 2
    order = int(np.argmin(scatter.count * np.log(left) + np.arange(ORDERS + 1) * np.log(scatter.count)))
    return tuple(float(value) for value in correlation[1 : order + 1])


def effective_samples(count: int, autocorrelation: tuple[float, ...]) -> float:
    """How many independent samples tell a mean as well as `count` of a noise with that memory, `count` at most."""
    weights, sd = autoregression(autocorrelation)[-1]
    return float(count * min((1.0 - weights.sum()) ** 2 / sd**2, 1.0))


def cycle_differences(residual: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each sample minus the residual one cycle later, between samples interpolated linearly.

    Returns
    -------
    difference, share : (n,) array
        NaN where the next cycle has no datum; the share of the later one of the two samples.
    """
    difference, share = np.full(residual.size, np.nan), np.full(residual.size, np.nan)
    placed = np.flatnonzero(np.isfinite(angle))
    if placed.size < 2 or not angle[placed[-1]] > angle[placed[0]]:
        return difference, share
    at, value = (
        np.maximum.accumulate(angle[placed]),
        residual[placed],
    )  # an angle as measured may step back by its own noise
    later = at + 2 * np.pi
    inside = later <= at[-1] + 1e-9
    right = np.clip(np.searchsorted(at, later[inside] - 1e-9), 1, at.size - 1)
    apart = at[right] - at[right - 1]
    weight = np.clip((later[inside] - at[right - 1]) / np.where(apart > 0.0, apart, 1.0), 0.0, 1.0)
    weight = np.where(weight > 1.0 - 1e-6, 1.0, np.where(weight < 1e-6, 0.0, weight))
    before, after = value[right - 1], value[right]
    # A sample of no weight may be missing.
    mixed = np.where(weight < 1, (1 - weight) * before, 0.0) + np.where(weight > 0, weight * after, 0.0)
    difference[placed[inside]] = value[inside] - mixed
    share[placed[inside]] = weight
    return difference, share


def _spectrum(values: np.ndarray, lags: int) -> np.ndarray:
    """Of the variance of values with gaps, smoothed by Parzen's window over so many lags; the mean is the variance."""
    known = np.isfinite(values)
    covariance = _pairs(np.where(known, values, 0.0), lags) / np.maximum(_pairs(known.astype(float), lags), 1.0)
    u = np.arange(lags + 1) / (lags + 1)
    window = np.where(u <= 0.5, 1 - 6 * u**2 + 6 * u**3, 2 * (1 - u) ** 3)
    turned = window * covariance
    points = 4 * lags  # enough that nothing between them is lost
    return np.maximum(np.fft.hfft(np.pad(turned, (0, points - lags)), 2 * points)[: points + 1], 0.0)


def _pairs(values: np.ndarray, lags: int) -> np.ndarray:
    """Sums of products of values so many samples apart, for lags from 0."""
    size = 2 * values.size
    return np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size)[: lags + 1]


def _mean(spectrum: np.ndarray) -> float:
    """Over all frequencies; the outer two count half, as each stands for half as many."""
    return float(np.trapezoid(spectrum) / (spectrum.size - 1))


def _covariance(spectrum: np.ndarray, lags: int) -> np.ndarray:
    return np.fft.irfft(spectrum)[: lags + 1]


def _without_lines(values: np.ndarray) -> np.ndarray:
    """Values without the sinusoids that stand out of a first-order process: those are a motion, not noise.

    One after the other, the surest first, until what is left is as noise has it.
    """
    known = np.isfinite(values)
    place, left = np.flatnonzero(known), values.copy()
    points = 4 * values.size  # a line between two frequencies of the plain periodogram is not missed
    frequency = 2 * np.pi * np.arange(1, points // 2) / points
    for _ in range(_LINES):
        power = np.abs(np.fft.rfft(np.where(known, left, 0.0), points)[1 : points // 2]) ** 2
        if not power.any():
            return left
        share = power / _background(power, frequency)
        top = int(np.argmax(share))
        if share.size * np.exp(-share[top]) > _SURE:
            return left
        phase = frequency[top] * place
        waves = np.column_stack([np.cos(phase), np.sin(phase)])
        left[place] -= waves @ np.linalg.lstsq(waves, left[place], rcond=None)[0]
    return left


def _background(power: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Spectrum of the first-order process nearest to a periodogram in logarithms, whose median a few lines do not move."""
    plain = slice(3, None, 4)
    seen = np.log(np.maximum(power[plain], np.finfo(float).tiny))
    shapes = -np.log(1 + _MEMORIES**2 - 2 * _MEMORIES * np.cos(frequency[plain]))
    level = np.median(seen - shapes, axis=1, keepdims=True)
    best = int(np.argmin(np.abs(seen - shapes - level).sum(axis=1)))
    rho = _MEMORIES[best, 0]
    mean = np.exp(level[best, 0]) / np.log(2.0)  # of an exponential distribution with that median
    return mean / (1 + rho**2 - 2 * rho * np.cos(frequency))


def _level(spectrum: np.ndarray, mean: float) -> float:
    """Where to cut a spectrum off so that its mean is at most `mean`."""
    if _mean(spectrum) <= mean:
        return float(np.inf)
    low, high = 0.0, float(spectrum.max())
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _mean(np.minimum(spectrum, middle)) > mean else (middle, high)
    return high


def _robust_sd(values: np.ndarray) -> float:
    """Standard deviation by the median of absolute values, which a few wild ones do not move."""
    plain = float(np.sqrt(np.mean(values**2)))
    robust = float(np.median(np.abs(values)) / 0.6744897501960817)
    return robust if robust > 1e-6 * plain else plain  # coarsely rounded readings hardly ever differ


def _without_outliers(values: np.ndarray, most: float) -> np.ndarray:
    """Values cut at `most` standard deviations."""
    limit = most * _robust_sd(values[np.isfinite(values)])
    return np.clip(values, -limit, limit)
