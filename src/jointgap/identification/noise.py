"""Estimation of channel noise."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from jointgap.core.candidates import Driven, Model, Series, runs_of
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.words import format_size
from jointgap.identification.confirmation import fit_run_parameters
from jointgap.identification.fit import FAILED, FiniteDifferences, fit_hypothesis
from jointgap.identification.problem import (
    Noise,
    Problem,
    autoregression,
    usual_step,
    values_in_run,
)
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings, NoiseSettings

# Lag-one correlations [1] of the candidate first-order background processes.
_BACKGROUNDS = np.linspace(-0.9, 0.96, 32)[:, None]
# Scaled to preserve the variance of white noise.
_FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)


@dataclass(frozen=True)
class Scatter:
    """Estimated noise of one series."""

    sd: float  # Marginal standard deviation [unit of the series]
    spectrum: (
        np.ndarray | None
    )  # [unit^2] Of the variance, at uniform frequencies from 0 to Nyquist
    count: int  # Number of differences


def scatter_between_cycles(
    residual: np.ndarray, angle: np.ndarray, settings: NoiseSettings, resolution: float = 0.0
) -> Scatter | None:
    """Noise from the differences of neighbouring cycles."""
    compared = compared_cycles(residual, angle, settings)
    if compared is None:
        return None
    difference, share = compared.difference, compared.share
    finite = np.isfinite(difference)
    per_cycle = int(2 * np.pi / usual_step(np.diff(angle[np.isfinite(angle)])))
    difference = _without_drift(difference, per_cycle, settings)
    # neighbouring differences share a cycle, so covariances near a lag of one cycle are biased
    lags = min(finite.size // 4, per_cycle // 2)
    if lags <= settings.max_ar_order:
        return Scatter(
            _robust_sd(
                difference[finite] / np.sqrt(1 + (1 - share[finite]) ** 2 + share[finite] ** 2)
            ),
            None,
            0,
        )
    # outliers are clipped coarsely before, and finely after the removal of lines
    clean = _without_outliers(difference, 5.0, 1.5 * resolution)
    clean = _without_outliers(_without_lines(clean, settings), 3.0, 1.5 * resolution)
    spectrum = _spectrum(clean, lags)
    frequency = np.linspace(0.0, np.pi, spectrum.size)
    # correct for the damping by interpolation
    mixed = float(np.mean(share[finite] * (1.0 - share[finite])))
    spectrum = spectrum / (2.0 - 2.0 * mixed * (1.0 - np.cos(frequency)))
    return Scatter(float(np.sqrt(_mean(spectrum))), spectrum, int(finite.sum()))


def growth_with_rate(
    residual: np.ndarray, angle: np.ndarray, rate: np.ndarray, settings: NoiseSettings
) -> float:
    """Growth of the noise variance with a channel's squared rate (factor 1 + growth rate^2), by
    maximum likelihood of the differences of neighbouring cycles.
    """
    compared = _differences(residual, angle, 1)
    difference, share = compared.difference, compared.share
    finite = np.isfinite(difference) & np.isfinite(rate)
    if finite.sum() < settings.min_differences or not np.ptp(rate[finite] ** 2) > 0.0:
        return 0.0
    scaled = difference[finite] / np.sqrt(1 + (1 - share[finite]) ** 2 + share[finite] ** 2)
    squares, largest = _without_outliers(scaled, 5.0) ** 2, float(np.max(rate[finite] ** 2))
    if not squares.any():
        return 0.0
    factors = 1.0 + np.append(0.0, settings.noise_growths)[:, None] * (rate[finite] ** 2 / largest)
    # minus twice the profile log-likelihood
    misfit = squares.size * np.log(np.mean(squares / factors, axis=1)) + np.log(factors).sum(axis=1)
    best = int(np.argmin(misfit))
    if misfit[0] - misfit[best] < settings.min_growth_gain:
        return 0.0
    return float(settings.noise_growths[best - 1]) / largest


def scatter_between_samples(residual: np.ndarray, settings: NoiseSettings) -> Scatter | None:
    """White noise from fourth differences, for a motion that is smooth over five samples."""
    differences = np.convolve(residual, _FOURTH_DIFFERENCE, mode="valid")
    differences = differences[np.isfinite(differences)]
    few = differences.size < settings.max_ar_order
    return None if few else Scatter(_robust_sd(differences), None, differences.size)


def ar_autocorrelation(
    scatter: Scatter, max_order: int, stated_sd: float | None = None
) -> tuple[float, ...]:
    """Autocorrelation at lags 1, 2, ... of the autoregressive process with the best BIC."""
    spectrum = scatter.spectrum
    if stated_sd is not None:
        spectrum = np.minimum(spectrum, _level(spectrum, stated_sd**2))
    covariance = np.fft.irfft(spectrum)[: max_order + 1]
    if not covariance[0] > 0.0:
        return ()
    correlation = covariance / covariance[0]
    innovation = np.array([sd for _, sd in autoregression(correlation[1:])]) ** 2
    order = int(
        np.argmin(
            scatter.count * np.log(innovation) + np.arange(max_order + 1) * np.log(scatter.count)
        )
    )
    return tuple(float(value) for value in correlation[1 : order + 1])


def effective_samples(count: int, autocorrelation: tuple[float, ...]) -> float:
    """Effective number of independent samples for `count` correlated ones."""
    weights, sd = autoregression(autocorrelation)[-1]
    return float(count * min((1.0 - weights.sum()) ** 2 / sd**2, 1.0))


@dataclass(frozen=True)
class ComparedCycles:
    """Differences of a residual to interpolated values some cycles later at the same phase."""

    difference: np.ndarray  # Sample minus later value [unit]; NaN if not comparable
    share: np.ndarray  # Interpolation weight of the second later sample [1]; NaN if there is none
    before: np.ndarray  # Index of the first later sample
    after: np.ndarray  # Index of the second later sample


def compared_cycles(
    residual: np.ndarray, angle: np.ndarray, settings: NoiseSettings
) -> ComparedCycles | None:
    """Comparison of cycles with the next ones or, if phases only repeat after several cycles, with
    those.

    Differences with poor interpolation (ringing at the sampling rate) are omitted.
    """
    best, most = None, 0
    for cycles in range(1, settings.max_cycles_apart + 1):
        found = _differences(residual, angle, cycles)
        known = int(np.isfinite(found.difference).sum())
        if known <= max(most, settings.min_differences - 1):
            break
        found = _where_smooth(found, residual, angle, settings)
        kept = int(np.isfinite(found.difference).sum())
        if kept > most:
            best, most = found, kept
    return best


def _differences(residual: np.ndarray, angle: np.ndarray, cycles: int) -> ComparedCycles:
    difference, share = np.full(residual.size, np.nan), np.full(residual.size, np.nan)
    places = np.zeros((2, residual.size), int)
    finite = np.flatnonzero(np.isfinite(angle))
    if finite.size < 2 or not angle[finite[-1]] > angle[finite[0]]:
        return ComparedCycles(difference, share, *places)
    # a measured angle may decrease by noise
    rising, value = np.maximum.accumulate(angle[finite]), residual[finite]
    later = rising + 2 * np.pi * cycles
    inside = later <= rising[-1] + 1e-9
    right = np.clip(np.searchsorted(rising, later[inside] - 1e-9), 1, rising.size - 1)
    apart = rising[right] - rising[right - 1]
    weight = np.clip(
        (later[inside] - rising[right - 1]) / np.where(apart > 0.0, apart, 1.0), 0.0, 1.0
    )
    weight = np.where(weight > 1.0 - 1e-6, 1.0, np.where(weight < 1e-6, 0.0, weight))
    before, after = value[right - 1], value[right]
    # a sample of weight 0 may be missing
    mixed = np.where(weight < 1, (1 - weight) * before, 0.0) + np.where(
        weight > 0, weight * after, 0.0
    )
    difference[finite[inside]] = value[inside] - mixed
    share[finite[inside]] = weight
    places[:, finite[inside]] = finite[right - 1], finite[right]
    return ComparedCycles(difference, share, *places)


def _where_smooth(
    compared: ComparedCycles, residual: np.ndarray, angle: np.ndarray, settings: NoiseSettings
) -> ComparedCycles:
    """Omit differences with an interpolation error that is large compared with the noise.

    The error of linear interpolation of a sinusoid is at most a quarter of its second difference.
    The second difference of noise is estimated from the differences (white noise: six times the
    variance).
    """
    difference, share = compared.difference, compared.share
    known = np.isfinite(difference)
    bend = _mean_squared_bend(residual, angle)
    bend = np.maximum(bend[compared.before], bend[compared.after])
    missed = (4.0 * share * (1.0 - share)) ** 2
    samples = 1.0 + (1.0 - share) ** 2 + share**2  # variance of a difference over that of noise
    kept = known
    while True:
        left = np.where(kept, (difference - np.median(difference[kept])) / np.sqrt(samples), np.nan)
        variance, own = _robust_variance(left), _robust_variance(np.diff(left, 2))
        excess = np.where(known, missed * (bend - max(6.0 * variance, own)), np.inf)
        # keep at least the smoothest
        least = np.partition(excess, settings.min_differences - 1)[settings.min_differences - 1]
        smooth = kept & (excess <= max(settings.max_bend * variance, least))
        if smooth.sum() == kept.sum():
            return replace(compared, difference=np.where(kept, difference, np.nan))
        kept = smooth


def _mean_squared_bend(residual: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Mean square (n,) [unit^2] of second differences over all cycles at the phase of each
    sample."""
    bend = np.full(residual.size, np.nan)
    bend[1:-1] = np.diff(residual, 2)
    finite = np.flatnonzero(np.isfinite(bend) & np.isfinite(angle))
    square = np.zeros(residual.size)
    if finite.size:
        order = finite[np.argsort(np.mod(angle[finite], 2 * np.pi), kind="stable")]
        limit = (5.0 * _robust_sd(bend[finite])) ** 2
        cycles = np.ptp(angle[finite]) / (2 * np.pi)
        width = int(min(max(3 * cycles, 24), order.size))
        around = (width // 2, (width - 1) // 2)
        near = np.pad(np.minimum(bend[order] ** 2, limit), around, mode="wrap")
        sums = np.cumsum(np.concatenate(([0.0], near)))
        square[order] = (sums[width:] - sums[:-width]) / width
    return square


def _without_drift(difference: np.ndarray, per_cycle: int, settings: NoiseSettings) -> np.ndarray:
    """Differences minus their median or, if they drift by more than correlated noise can, minus
    their mean over a cycle."""
    finite = np.isfinite(difference)
    difference = difference - np.median(difference[finite])
    window = np.ones(max(per_cycle, 1))
    count = np.convolve(finite, window, mode="same")
    total = np.convolve(np.where(finite, difference, 0.0), window, mode="same")
    if total.size != difference.size:  # less than a cycle
        return difference
    drift = np.where(finite, total / np.maximum(count, 1), np.nan)
    rest = difference - drift
    wanders = np.nanvar(drift) + np.nanmean(drift) ** 2
    return rest if wanders * per_cycle > settings.least_drift * np.nanmean(rest**2) else difference


def rounding_that_repeats(
    compared: ComparedCycles, predicted: np.ndarray, resolution: float, variance: float
) -> float:
    """Variance [unit^2] of rounding errors that are equal in the compared cycles.

    Noise of standard deviation s before the rounding reduces the repeated part of the k-th harmonic
    of the rounding error by exp(-(2 pi k s / step)^2); its phase is the difference of the compared
    values in steps.
    """
    known = np.isfinite(compared.difference)
    k = np.arange(1, 41)[:, None]
    share = compared.share[known]
    alike = 0.0
    for place, weight in ((compared.before, 1.0 - share), (compared.after, share)):
        steps = (predicted[place[known]] - predicted[known]) / resolution
        alike = alike + np.where(
            weight > 0.0, weight * np.cos(2 * np.pi * k * np.nan_to_num(steps)), 0.0
        )
    k, alike = k[:, 0], np.maximum(alike.mean(axis=1), 0.0)

    def repeated(sd: float) -> float:
        harmonics = (
            resolution**2
            / (2 * np.pi**2 * k**2)
            * np.exp(-((2 * np.pi * k * sd / resolution) ** 2))
        )
        return float(harmonics @ alike)

    def beyond(sd: float) -> float:
        return sd**2 + resolution**2 / 12.0 - repeated(sd) - variance

    return repeated(0.0 if beyond(0.0) >= 0.0 else brentq(beyond, 0.0, np.sqrt(variance)))


def _spectrum(values: np.ndarray, lags: int) -> np.ndarray:
    """Spectrum of values with gaps, smoothed by Parzen's window over `lags`; its mean is the
    variance."""
    finite = np.isfinite(values)
    covariance = _pairs(np.where(finite, values, 0.0), lags) / np.maximum(
        _pairs(finite.astype(float), lags), 1.0
    )
    u = np.arange(lags + 1) / (lags + 1)
    window = np.where(u <= 0.5, 1 - 6 * u**2 + 6 * u**3, 2 * (1 - u) ** 3)
    tapered = window * covariance
    points = 4 * lags
    return np.maximum(
        np.fft.hfft(np.pad(tapered, (0, points - lags)), 2 * points)[: points + 1], 0.0
    )


def _pairs(values: np.ndarray, lags: int) -> np.ndarray:
    """Sums of products of values at the lags 0 to `lags`."""
    size = 2 * values.size
    return np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size)[: lags + 1]


def _mean(spectrum: np.ndarray) -> float:
    """Mean over all frequencies."""
    return float(np.trapezoid(spectrum) / (spectrum.size - 1))


def _without_lines(values: np.ndarray, settings: NoiseSettings) -> np.ndarray:
    """Values without significant sinusoids, which are motion and not noise; background: a
    first-order process."""
    finite = np.isfinite(values)
    index, left = np.flatnonzero(finite), values.copy()
    points = 4 * values.size  # finer than the plain periodogram
    frequency = 2 * np.pi * np.arange(1, points // 2) / points
    for _ in range(settings.max_lines):
        power = np.abs(np.fft.rfft(np.where(finite, left, 0.0), points)[1 : points // 2]) ** 2
        if not power.any():
            return left
        share = power / _background(power, frequency)
        top = int(np.argmax(share))
        if share.size * np.exp(-share[top]) > settings.line_probability:
            return left
        phase = frequency[top] * index
        waves = np.column_stack([np.cos(phase), np.sin(phase)])
        left[index] -= waves @ np.linalg.lstsq(waves, left[index], rcond=None)[0]
    return left


def _background(power: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Spectrum of the first-order process nearest to the logarithm of a periodogram (median: robust
    to lines)."""
    plain = slice(3, None, 4)
    logarithm = np.log(np.maximum(power[plain], np.finfo(float).tiny))
    shapes = -np.log(1 + _BACKGROUNDS**2 - 2 * _BACKGROUNDS * np.cos(frequency[plain]))
    level = np.median(logarithm - shapes, axis=1, keepdims=True)
    best = int(np.argmin(np.abs(logarithm - shapes - level).sum(axis=1)))
    rho = _BACKGROUNDS[best, 0]
    mean = np.exp(level[best, 0]) / np.log(2.0)  # of an exponential distribution with that median
    return mean / (1 + rho**2 - 2 * rho * np.cos(frequency))


def _level(spectrum: np.ndarray, mean: float) -> float:
    """Level at which to clip a spectrum so that its mean is at most `mean`."""
    if _mean(spectrum) <= mean:
        return float(np.inf)
    low, high = 0.0, float(spectrum.max())
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _mean(np.minimum(spectrum, middle)) > mean else (middle, high)
    return high


def _robust_sd(values: np.ndarray) -> float:
    """Standard deviation from the median of absolute values; from the 90 % quantile if most are
    near 0 (rounding)."""
    half, most = np.quantile(np.abs(values), [0.5, 0.9]) / [0.6744897501960817, 1.6448536269514722]
    if half > 0.1 * most:
        return float(half)
    return float(most) if most > 0.0 else float(np.sqrt(np.mean(values**2)))


def _robust_variance(values: np.ndarray) -> float:
    """Square of `_robust_sd` of the finite values; 0 if there are none."""
    finite = np.isfinite(values)
    return _robust_sd(values[finite]) ** 2 if finite.any() else 0.0


def _without_outliers(values: np.ndarray, most: float, least: float = 0.0) -> np.ndarray:
    """Values clipped at `most` standard deviations or at `least` [unit], whichever is larger."""
    limit = max(most * _robust_sd(values[np.isfinite(values)]), least)
    return np.clip(values, -limit, limit)


Key = tuple[str, str]


@dataclass(frozen=True)
class NoiseEstimate(Noise):
    """Noise with its estimate."""

    estimated_sd: float = (
        np.nan
    )  # Standard deviation [unit] estimated from the data, NaN if not possible
    effective_samples: float = np.nan  # Effective number of independent samples
    remarks: tuple[str, ...] = ()


def noise_of_model(
    model: Model,
    values: Mapping[str, float] | None = None,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> dict[Key, NoiseEstimate]:
    """Noise of every series: the cycle-to-cycle variation of the residuals of the current model at
    `values` of its nuisances by key [SI] (default: `first_values`)."""
    values = first_values(model, settings) if values is None else values
    residuals = {}
    for run in runs_of(model):
        predicted = model.simulate(run, *values_in_run(model, run, values))
        residuals |= {s.key: s.value - predicted[s.channel] for s in model.series if s.run == run}
    return estimate_noise(model, residuals, settings.noise)


def first_values(
    model: Model, settings: IdentificationSettings = DEFAULT_SETTINGS
) -> dict[str, float]:
    """Nuisances by key [SI] of the current model, fitted with stated or guessed noise; of held-out
    runs their own ones."""
    guess = {series.key: _guess(series, settings.noise.guessed_share) for series in model.series}
    problem = Problem(model, guess, settings=settings)
    differences = FiniteDifferences(problem)
    nominal = {p.key: p.nominal for p in problem.nuisances}
    with suppress(InputError, SimulationError):  # reported by the fit
        differences.probe(problem.nuisances, nominal, problem.residual(nominal))
    first = fit_hypothesis(problem, differences=differences)
    if first.status == FAILED:
        raise SimulationError(
            f"{model.name}: the current model cannot be simulated: {first.reason}"
        )
    held_out = Problem(model, guess, held_out=True, settings=settings)
    return first.mapping | fit_run_parameters(held_out, first)


def _guess(series: Series, share: float) -> Noise:
    """Noise that weights the channels in the first fit."""
    if series.stated_noise is not None:
        return Noise(np.hypot(series.stated_noise, series.rounding))
    measured = series.value[_is_for_noise(series) & np.isfinite(series.value)]
    spread = max(share * series.variation(measured), np.finfo(float).tiny) if measured.size else 1.0
    return Noise(np.full(series.value.shape, spread), source="guessed")


def estimate_noise(
    model: Model,
    residuals: Mapping[Key, np.ndarray],
    settings: NoiseSettings = DEFAULT_SETTINGS.noise,
) -> dict[Key, NoiseEstimate]:
    """Noise of every series.

    It combines white noise, rounding to the sensor's resolution, and time jitter times the
    channel's rate (root sum of squares). Stated noise is the white part and is not changed. The
    autocorrelation is always estimated from the differences of neighbouring cycles; differences
    beyond stated noise count as motion out of step with the crank. For a partly held-out run the
    fitted part is used.
    """
    return {
        series.key: _noise_of(series, residuals[series.key], settings) for series in model.series
    }


def degrees_of_freedom(noise: Mapping[Key, NoiseEstimate]) -> float:
    """Degrees of freedom of the noise estimate; infinite if all noise is stated."""
    estimated = [series.effective_samples for series in noise.values() if series.source != "stated"]
    return float(np.nansum(estimated)) / 2.0 if estimated else np.inf  # two cycles: one difference


def _is_for_noise(series: Series) -> np.ndarray:
    """Samples (n,) bool for the noise estimate: the fitted ones, or all of a held-out series."""
    return ~series.held_out | series.held_out.all()


def _noise_of(series: Series, residual: np.ndarray, settings: NoiseSettings) -> NoiseEstimate:
    used = _is_for_noise(series)
    value, residual = np.where(used, series.value, np.nan), np.where(used, residual, np.nan)
    count = int(np.isfinite(value).sum())
    stated = series.stated_noise
    if series.statistic:
        if stated is None:
            raise InputError(
                f"run {series.run}, channel {series.channel}: statistics require a stated noise"
            )
        return NoiseEstimate(stated, effective_samples=float(count))
    least = (
        max(settings.min_share_of_channel * series.variation(value), series.rounding)
        if count
        else 0.0
    )
    predicted = value - residual
    rate = _rate(series, predicted)
    shape, sd = _known_shape(series, residual, predicted, rate, least, settings)
    scatter, source = _scatter(series, residual / shape, predicted, settings)
    remarks, autocorrelation = [], ()
    if scatter is not None and scatter.spectrum is not None:
        known = None if stated is None else _rms(sd / shape)
        autocorrelation = ar_autocorrelation(scatter, settings.max_ar_order, known)
    else:
        remarks.append(
            f"{series.channel} has too few cycles to estimate an autocorrelation: its noise is"
            " assumed to be white"
        )
    if stated is not None:
        source, factor, known = "stated", settings.reported_mismatch, _rms(sd / shape)
        if series.unit == "rad" and known > settings.max_angle_rad:
            raise InputError(
                f"run {series.run}, channel {series.channel}: the stated noise of"
                f" {np.degrees(known):.3g} deg is too large; give the standard deviation of the"
                f" sensor, at most {np.degrees(settings.max_angle_rad):.3g} deg"
            )
        if (
            scatter is not None
            and not 1 / factor < max(scatter.sd, least) / max(known, least) < factor
        ):
            remarks.append(_mismatch(series, scatter, known))
    elif scatter is None:
        raise InputError(
            f"run {series.run}, channel {series.channel}: {count} samples are too few to estimate"
            " the noise; state it as `noise` of the channel"
        )
    else:
        grown = scatter.sd * shape
        if scatter.sd < least:
            rounded = series.rounding == least
            source = "the sensor's resolution" if rounded else "a share of the channel's variation"
            which = "its rounding" if rounded else "1e-4 of its variation"
            remarks.append(
                f"{series.channel} has no visible noise: {format_size(least, series.unit)} is"
                f" assumed, {which}"
            )
        elif sd is None and (jitter := _jitter(rate, grown)) > 0.0:
            remarks.append(
                f"the noise of {series.channel} increases with its rate, like a time jitter of"
                f" {1e3 * jitter:.2g} ms; this is taken into account"
            )
        if sd is None:
            # the least noise is that of the white part, without jitter
            sd = np.sqrt(grown**2 + max(least**2 - float(np.min(grown)) ** 2, 0.0))
        _check_is_noise(series, _rms(sd), value, predicted, settings)
    if not np.all(sd > 0.0):
        raise InputError(
            f"run {series.run}, channel {series.channel}: the noise is 0; state the sensor's"
            " resolution as `noise`"
        )
    return NoiseEstimate(
        sd,
        autocorrelation,
        source=source,
        estimated_sd=np.nan if scatter is None else scatter.sd,
        effective_samples=effective_samples(count, autocorrelation),
        remarks=tuple(remarks),
    )


def _check_is_noise(
    series: Series, sd: float, value: np.ndarray, predicted: np.ndarray, settings: NoiseSettings
) -> None:
    """InputError if the estimated noise is so large that the model does not follow the measured
    motion."""
    most = settings.max_share_of_channel * series.variation(value)
    if series.unit == "rad":
        most = min(most, settings.max_angle_rad)
    # a nearly constant channel, such as the speed of a steady crank, may consist of noise
    if sd > most and series.variation(predicted) > settings.least_motion * sd:
        raise InputError(
            f"run {series.run}, channel {series.channel}: the residuals of cycles differ by"
            f" {format_size(sd, series.unit)} (standard deviation), but the channel varies only by"
            f" {format_size(series.variation(value), series.unit)}: the model does not follow the"
            " motion. Check the drive, the bounds in `nuisance` and the column, or state the"
            " sensor's noise as `noise` of the channel"
        )


def _scatter(
    series: Series, residual: np.ndarray, predicted: np.ndarray, settings: NoiseSettings
) -> tuple[Scatter | None, str]:
    """Noise from neighbouring cycles, or else from neighbouring samples, including repeated
    rounding; and its source."""
    scatter = scatter_between_cycles(residual, series.angle, settings, series.resolution)
    if scatter is None:
        return (
            scatter_between_samples(residual, settings),
            "differences between neighbouring samples",
        )
    if series.resolution:
        compared = compared_cycles(residual, series.angle, settings)
        repeated = rounding_that_repeats(compared, predicted, series.resolution, scatter.sd**2)
        spectrum = None if scatter.spectrum is None else scatter.spectrum + repeated
        scatter = replace(
            scatter, sd=float(np.hypot(scatter.sd, np.sqrt(repeated))), spectrum=spectrum
        )
    return scatter, "differences between neighbouring cycles"


def _rate(series: Series, predicted: np.ndarray) -> np.ndarray:
    """Predicted rate (n,) of a channel [unit/s]; 0 without times or with exact time stamps."""
    known = np.isfinite(predicted) & np.isfinite(series.time)
    if known.sum() < 3 or series.jitter == 0.0:
        return np.zeros(predicted.size)
    rate = np.gradient(predicted[known], series.time[known])
    return np.interp(np.arange(predicted.size), np.flatnonzero(known), rate)


def _known_shape(
    series: Series,
    residual: np.ndarray,
    predicted: np.ndarray,
    rate: np.ndarray,
    least: float,
    settings: NoiseSettings,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Relative noise over the samples (n,), with a mean square of 1; and the noise (n,) [unit] if
    it or the jitter is stated."""
    stated = series.stated_noise
    own = None if stated is None else np.hypot(stated, series.rounding)
    if not series.jitter:
        growth = 0.0
        if own is None and series.jitter is None:
            growth = growth_with_rate(residual, series.angle, rate, settings)
        grown = np.sqrt(1.0 + growth * rate**2)
        return grown / _rms(grown), own
    timing = series.jitter * np.abs(rate)
    if own is None:
        scatter, _ = _scatter(series, residual, predicted, settings)
        if scatter is None:
            return np.ones(rate.size), None
        own = np.sqrt(max(scatter.sd**2 - float(np.mean(timing**2)), least**2))
    whole = np.hypot(own, timing)
    return whole / _rms(whole), whole


def _jitter(rate: np.ndarray, sd: np.ndarray) -> float:
    """Jitter [s] of time stamps that explains the growth of the noise `sd` (n,) with the `rate`
    (n,)."""
    slow, fast = np.argmin(np.abs(rate)), np.argmax(np.abs(rate))
    change = rate[fast] ** 2 - rate[slow] ** 2
    return float(np.sqrt((sd[fast] ** 2 - sd[slow] ** 2) / change)) if change > 0.0 else 0.0


def _mismatch(series: Series, scatter: Scatter, stated: float) -> str:
    given, seen = (format_size(sd, series.unit) for sd in (stated, scatter.sd))
    start = f"{series.channel} has a stated noise of {given}, but its cycles vary by {seen}"
    if scatter.sd < stated:
        return f"{start}: small effects may be overlooked"
    return (
        f"{start}: larger noise, a motion out of step with the crank, or impacts that differ"
        " between cycles"
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def numerics_noise(
    model: Model,
    values: Mapping[str, float],
    noise: Mapping[Key, Noise],
    settings: NoiseSettings = DEFAULT_SETTINGS.noise,
) -> dict[Key, Noise]:
    """The noise with solver error and with the errors of measured drives."""
    changed, statistics = dict(noise), {series.key for series in model.series if series.statistic}
    for run in runs_of(model):
        nuisances = {
            p.name: values.get(p.key, p.nominal) for p in model.nuisances if p.run in (None, run)
        }
        numbers = range(1, len(model.numerics) + 1)
        usual = model.simulate(run, nuisances) if numbers else {}
        squares = {channel: [] for channel in usual}
        for number in numbers:
            try:
                other = model.simulate(run, nuisances, numerics=number)
            except (InputError, SimulationError):
                continue
            for channel, predicted in usual.items():
                squares[channel].append(np.square(other[channel] - predicted))
        for channel, each in squares.items():
            if each and (run, channel) in changed:
                own = changed[run, channel]
                spread = _spread(
                    np.mean(each, axis=0), own.sd, (run, channel) in statistics, settings
                )
                changed[run, channel] = replace(own, numerics=spread)
        if isinstance(model, Driven):
            errors = {
                c: each
                for c, each in model.drive_errors(run, nuisances).items()
                if (run, c) in changed
            }
            squares = [
                np.sum((each / changed[run, c].sd[:, None]) ** 2, axis=0)
                for c, each in errors.items()
            ]
            counted = np.sqrt(np.sum(squares, axis=0)) > settings.negligible_numerics
            for channel, each in errors.items():
                if counted.any():
                    changed[run, channel] = replace(changed[run, channel], drive=each[:, counted])
    return changed


def _spread(
    square: np.ndarray, sd: np.ndarray, statistic: bool, settings: NoiseSettings
) -> np.ndarray:
    """Root of the smoothed mean square (n,) of changes between solver variants; 0 if negligible
    compared with the noise `sd` (n,)."""
    window = np.ones(min(settings.numerics_window, square.size))
    smooth = np.convolve(square, window, mode="same") / np.convolve(
        np.ones(square.size), window, mode="same"
    )
    spread = np.sqrt(np.maximum(smooth - sd**2, 0.0) if statistic else smooth)
    return np.where(spread > settings.negligible_numerics * sd, spread, 0.0)
