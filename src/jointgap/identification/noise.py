"""Noise of the channels."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import brentq

from jointgap.core.candidates import Driven, Model, Series, runs_of
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.confirmation import fit_run_parameters
from jointgap.identification.fit import FAILED, fit_hypothesis
from jointgap.identification.problem import Noise, Problem, autoregression
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings, NoiseSettings

# Lag-one correlations [1] of the first-order processes that are tried as a background.
_BACKGROUNDS = np.linspace(-0.9, 0.96, 32)[:, None]
# Scaled to leave the variance of white noise.
_FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)


@dataclass(frozen=True)
class Scatter:
    """Noise of one series as its cycles or samples show it."""

    sd: float  # Marginal standard deviation [unit of the series]
    spectrum: np.ndarray | None  # [unit^2] Of its variance over the frequencies from 0 to Nyquist's, evenly
    count: int  # Differences that it rests on


def scatter_between_cycles(
    residual: np.ndarray, angle: np.ndarray, settings: NoiseSettings, resolution: float = 0.0
) -> Scatter | None:
    """Noise from the differences of neighbouring cycles."""
    compared = compared_cycles(residual, angle, settings)
    if compared is None:
        return None
    difference, share = compared.difference, compared.share
    finite = np.isfinite(difference)
    per_cycle = int(2 * np.pi / np.median(np.diff(angle[np.isfinite(angle)])))
    difference = _without_drift(difference, per_cycle, settings)
    # Neighbouring differences share a cycle: covariances near a lag of one cycle are not the noise's own.
    lags = min(finite.size // 4, per_cycle // 2)
    if lags <= settings.max_ar_order:
        return Scatter(
            _robust_sd(difference[finite] / np.sqrt(1 + (1 - share[finite]) ** 2 + share[finite] ** 2)), None, 0
        )
    # Outliers are cut twice: coarsely, as they would look like lines, and finely once the lines are gone.
    clean = _without_outliers(difference, 5.0, 1.5 * resolution)
    clean = _without_outliers(_without_lines(clean, settings), 3.0, 1.5 * resolution)
    spectrum = _spectrum(clean, lags)
    frequency = np.linspace(0.0, np.pi, spectrum.size)
    # Interpolation between two samples damps what changes from one to the next.
    mixed = float(np.mean(share[finite] * (1.0 - share[finite])))
    spectrum = spectrum / (2.0 - 2.0 * mixed * (1.0 - np.cos(frequency)))
    return Scatter(float(np.sqrt(_mean(spectrum))), spectrum, int(finite.sum()))


def growth_with_rate(residual: np.ndarray, angle: np.ndarray, rate: np.ndarray, settings: NoiseSettings) -> float:
    """How the variance of the noise grows with a channel's squared rate: by the factor 1 + growth rate^2.

    The growth that makes the differences of neighbouring cycles most likely, as those of independent normal numbers.
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
    # minus twice the logarithm of the likelihood, with the best variance at rate 0 put in
    misfit = squares.size * np.log(np.mean(squares / factors, axis=1)) + np.log(factors).sum(axis=1)
    best = int(np.argmin(misfit))
    if misfit[0] - misfit[best] < settings.min_growth_gain:
        return 0.0
    return float(settings.noise_growths[best - 1]) / largest


def scatter_between_samples(residual: np.ndarray, settings: NoiseSettings) -> Scatter | None:
    """White noise from fourth differences, in which a motion that is smooth over five samples leaves nothing."""
    differences = np.convolve(residual, _FOURTH_DIFFERENCE, mode="valid")
    differences = differences[np.isfinite(differences)]
    few = differences.size < settings.max_ar_order
    return None if few else Scatter(_robust_sd(differences), None, differences.size)


def ar_autocorrelation(scatter: Scatter, max_order: int, stated_sd: float | None = None) -> tuple[float, ...]:
    """Autocorrelation at lags of 1, 2, ... of the autoregressive process that the Bayesian information criterion
    chooses.
    """
    spectrum = scatter.spectrum
    if stated_sd is not None:
        spectrum = np.minimum(spectrum, _level(spectrum, stated_sd**2))
    covariance = np.fft.irfft(spectrum)[: max_order + 1]
    if not covariance[0] > 0.0:
        return ()
    correlation = covariance / covariance[0]
    innovation = np.array([sd for _, sd in autoregression(correlation[1:])]) ** 2
    order = int(np.argmin(scatter.count * np.log(innovation) + np.arange(max_order + 1) * np.log(scatter.count)))
    return tuple(float(value) for value in correlation[1 : order + 1])


def effective_samples(count: int, autocorrelation: tuple[float, ...]) -> float:
    """How many independent samples determine a mean as well as `count` correlated ones, `count` at most."""
    weights, sd = autoregression(autocorrelation)[-1]
    return float(count * min((1.0 - weights.sum()) ** 2 / sd**2, 1.0))


@dataclass(frozen=True)
class ComparedCycles:
    """Samples of a residual beside those some cycles later at the same phase, between two samples interpolated."""

    difference: np.ndarray  # Sample minus later value [unit]; NaN where there is none, or none that can be compared
    share: np.ndarray  # Of the second of the two later samples [1]; NaN where there is none
    before: np.ndarray  # Places of the two later samples
    after: np.ndarray  # Places of the two later samples


def compared_cycles(residual: np.ndarray, angle: np.ndarray, settings: NoiseSettings) -> ComparedCycles | None:
    """Cycles beside the next ones or, where phases repeat after several cycles only, beside those.

    Where a residual rings as fast as it is sampled, a value interpolated between two samples is none of the noise's:
    such differences are left out.
    """
    best, most = None, 0
    for cycles in range(1, settings.max_cycles_apart + 1):
        found = _differences(residual, angle, cycles)
        known = int(np.isfinite(found.difference).sum())
        if known <= max(most, settings.min_differences - 1):
            break  # those farther apart are fewer still
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
    # An angle as measured may step back by its own noise.
    rising, value = np.maximum.accumulate(angle[finite]), residual[finite]
    later = rising + 2 * np.pi * cycles
    inside = later <= rising[-1] + 1e-9
    right = np.clip(np.searchsorted(rising, later[inside] - 1e-9), 1, rising.size - 1)
    apart = rising[right] - rising[right - 1]
    weight = np.clip((later[inside] - rising[right - 1]) / np.where(apart > 0.0, apart, 1.0), 0.0, 1.0)
    weight = np.where(weight > 1.0 - 1e-6, 1.0, np.where(weight < 1e-6, 0.0, weight))
    before, after = value[right - 1], value[right]
    # A sample of no weight may be missing.
    mixed = np.where(weight < 1, (1 - weight) * before, 0.0) + np.where(weight > 0, weight * after, 0.0)
    difference[finite[inside]] = value[inside] - mixed
    share[finite[inside]] = weight
    places[:, finite[inside]] = finite[right - 1], finite[right]
    return ComparedCycles(difference, share, *places)


def _where_smooth(
    compared: ComparedCycles, residual: np.ndarray, angle: np.ndarray, settings: NoiseSettings
) -> ComparedCycles:
    """Without differences from values that were interpolated where the residual bends by more than its noise does.

    A straight line between samples misses a sinusoid by a quarter of its second difference at most. The noise's own
    second difference is that of the differences; white noise has six times its variance there.
    """
    difference, share = compared.difference, compared.share
    known = np.isfinite(difference)
    bend = _mean_squared_bend(residual, angle)
    bend = np.maximum(bend[compared.before], bend[compared.after])
    missed = (4.0 * share * (1.0 - share)) ** 2
    samples = 1.0 + (1.0 - share) ** 2 + share**2  # so much of the noise's variance is in a difference
    kept = known
    while True:
        left = np.where(kept, (difference - np.median(difference[kept])) / np.sqrt(samples), np.nan)
        variance, own = _robust_variance(left), _robust_variance(np.diff(left, 2))
        excess = np.where(known, missed * (bend - max(6.0 * variance, own)), np.inf)
        # the smoothest are kept whatever they are: there is nothing better
        least = np.partition(excess, settings.min_differences - 1)[settings.min_differences - 1]
        smooth = kept & (excess <= max(settings.max_bend * variance, least))
        if smooth.sum() == kept.sum():
            return replace(compared, difference=np.where(kept, difference, np.nan))
        kept = smooth


def _mean_squared_bend(residual: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Mean square (n,) of second differences at the phase of each sample, of all cycles together [unit^2]."""
    bend = np.full(residual.size, np.nan)
    bend[1:-1] = np.diff(residual, 2)
    finite = np.flatnonzero(np.isfinite(bend) & np.isfinite(angle))
    square = np.zeros(residual.size)
    if finite.size:
        order = finite[np.argsort(np.mod(angle[finite], 2 * np.pi), kind="stable")]
        limit = (5.0 * _robust_sd(bend[finite])) ** 2
        cycles = np.ptp(angle[finite]) / (2 * np.pi)
        width = int(min(max(3 * cycles, 24), order.size))
        square[order] = uniform_filter1d(np.minimum(bend[order] ** 2, limit), width, mode="wrap")
    return square


def _without_drift(difference: np.ndarray, per_cycle: int, settings: NoiseSettings) -> np.ndarray:
    """Differences without their median and, where that wanders by more than noise with a memory could, without their
    mean over a cycle."""
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


def rounding_that_repeats(compared: ComparedCycles, predicted: np.ndarray, resolution: float, variance: float) -> float:
    """Variance [unit^2] of a sensor's rounding that cycles have in common, so that they do not differ by it.

    Noise of standard deviation s before the rounding leaves, of the error's k-th harmonic over the steps, the share
    exp(-(2 pi k s / step)^2) to what repeats; how far it does is told by how many steps lie between the values that
    are compared.
    """
    known = np.isfinite(compared.difference)
    k = np.arange(1, 41)[:, None]
    share = compared.share[known]
    alike = 0.0
    for place, weight in ((compared.before, 1.0 - share), (compared.after, share)):
        steps = (predicted[place[known]] - predicted[known]) / resolution
        alike = alike + np.where(weight > 0.0, weight * np.cos(2 * np.pi * k * np.nan_to_num(steps)), 0.0)
    k, alike = k[:, 0], np.maximum(alike.mean(axis=1), 0.0)

    def repeated(sd: float) -> float:
        harmonics = resolution**2 / (2 * np.pi**2 * k**2) * np.exp(-((2 * np.pi * k * sd / resolution) ** 2))
        return float(harmonics @ alike)

    def beyond(sd: float) -> float:
        return sd**2 + resolution**2 / 12.0 - repeated(sd) - variance

    return repeated(0.0 if beyond(0.0) >= 0.0 else brentq(beyond, 0.0, np.sqrt(variance)))


def _spectrum(values: np.ndarray, lags: int) -> np.ndarray:
    """Of the variance of values with gaps, smoothed by Parzen's window over so many lags; the mean is the variance."""
    finite = np.isfinite(values)
    covariance = _pairs(np.where(finite, values, 0.0), lags) / np.maximum(_pairs(finite.astype(float), lags), 1.0)
    u = np.arange(lags + 1) / (lags + 1)
    window = np.where(u <= 0.5, 1 - 6 * u**2 + 6 * u**3, 2 * (1 - u) ** 3)
    tapered = window * covariance
    points = 4 * lags  # enough that nothing between them is lost
    return np.maximum(np.fft.hfft(np.pad(tapered, (0, points - lags)), 2 * points)[: points + 1], 0.0)


def _pairs(values: np.ndarray, lags: int) -> np.ndarray:
    """Sums of products of values so many samples apart, for lags from 0."""
    size = 2 * values.size
    return np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size)[: lags + 1]


def _mean(spectrum: np.ndarray) -> float:
    """Over all frequencies; the outer two count half, as each stands for half as many."""
    return float(np.trapezoid(spectrum) / (spectrum.size - 1))


def _without_lines(values: np.ndarray, settings: NoiseSettings) -> np.ndarray:
    """Values without the sinusoids that stand out of a first-order process: those are a motion, not noise.

    One after the other, the most significant first, until noise alone would leave the next as often as it may.
    """
    finite = np.isfinite(values)
    index, left = np.flatnonzero(finite), values.copy()
    points = 4 * values.size  # a line between two frequencies of the plain periodogram is not missed
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
    """Spectrum of the first-order process nearest to a periodogram in logarithms, whose median a few lines do not
    move."""
    plain = slice(3, None, 4)
    logarithm = np.log(np.maximum(power[plain], np.finfo(float).tiny))
    shapes = -np.log(1 + _BACKGROUNDS**2 - 2 * _BACKGROUNDS * np.cos(frequency[plain]))
    level = np.median(logarithm - shapes, axis=1, keepdims=True)
    best = int(np.argmin(np.abs(logarithm - shapes - level).sum(axis=1)))
    rho = _BACKGROUNDS[best, 0]
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
    """Standard deviation by the median of absolute values, which a few outliers do not move.

    Coarsely rounded readings differ by nothing or by a step: where most are near 0, the rest tells it.
    """
    half, most = np.quantile(np.abs(values), [0.5, 0.9]) / [0.6744897501960817, 1.6448536269514722]
    if half > 0.1 * most:
        return float(half)
    return float(most) if most > 0.0 else float(np.sqrt(np.mean(values**2)))


def _robust_variance(values: np.ndarray) -> float:
    """Square of `_robust_sd` of what is known of them; 0 where that is nothing."""
    finite = np.isfinite(values)
    return _robust_sd(values[finite]) ** 2 if finite.any() else 0.0


def _without_outliers(values: np.ndarray, most: float, least: float = 0.0) -> np.ndarray:
    """Values cut at `most` standard deviations, or at `least` [unit] where that is more."""
    limit = max(most * _robust_sd(values[np.isfinite(values)]), least)
    return np.clip(values, -limit, limit)


Key = tuple[str, str]


@dataclass(frozen=True)
class NoiseEstimate(Noise):
    """Noise with what is to be known of it."""

    estimated_sd: float = np.nan  # Standard deviation [unit] that the data show, NaN where they cannot tell
    effective_samples: float = np.nan  # How many independent samples would determine a mean as well
    remarks: tuple[str, ...] = ()  # What a reader should know; empty where all is well


def noise_of_model(model: Model, settings: IdentificationSettings = DEFAULT_SETTINGS) -> dict[Key, NoiseEstimate]:
    """The noise of every series.

    The model as it stands is fitted with noise as stated or guessed; what its residuals do not repeat from cycle to
    cycle is noise.
    """
    guess = {series.key: _guess(series, settings.noise.guessed_share) for series in model.series}
    problem = Problem(model, guess, settings=settings)
    first = fit_hypothesis(problem)
    if first.status == FAILED:
        raise SimulationError(f"the model as it stands cannot be fitted: {first.reason}")
    values = first.mapping | fit_run_parameters(Problem(model, guess, held_out=True, settings=settings), first)
    residuals = {}
    for run in runs_of(model):
        predicted = problem.predict(run, values)
        residuals |= {s.key: s.value - predicted[s.channel] for s in model.series if s.run == run}
    return estimate_noise(model, residuals, settings.noise)


def _guess(series: Series, share: float) -> Noise:
    """Noise that weighs the channels for a first fit."""
    if series.stated_noise is not None:
        return Noise(np.hypot(series.stated_noise, series.rounding))
    measured = series.value[_is_for_noise(series) & np.isfinite(series.value)]
    spread = max(share * series.variation(measured), np.finfo(float).tiny) if measured.size else 1.0
    return Noise(np.full(series.value.shape, spread), source="guessed")


def estimate_noise(
    model: Model, residuals: Mapping[Key, np.ndarray], settings: NoiseSettings = DEFAULT_SETTINGS.noise
) -> dict[Key, NoiseEstimate]:
    """Noise of every series.

    The noise of a sample is the root of a sum of squares: white noise, the rounding to the sensor's steps, and what
    time stamps that are off make of the channel's rate there. A stated standard deviation is the first of these and is
    taken as it is; the correlation from sample to sample is always estimated, from the
    differences of neighbouring cycles. Where they differ by more than the stated noise, the rest is a motion out of
    step with the crank and is not taken for noise. Of a run that is held out in part, the part for fitting is used.
    """
    return {series.key: _noise_of(series, residuals[series.key], settings) for series in model.series}


def degrees_of_freedom(noise: Mapping[Key, NoiseEstimate]) -> float:
    """From how many independent numbers the noise was estimated; infinite where all of it is stated."""
    estimated = [series.effective_samples for series in noise.values() if series.source != "stated"]
    return float(np.nansum(estimated)) / 2.0 if estimated else np.inf  # two cycles give one difference


def _is_for_noise(series: Series) -> np.ndarray:
    """Samples of a series that its noise is estimated from, (n,) bool: those for fitting, or all where all of it is
    held out."""
    return ~series.held_out | series.held_out.all()


def _noise_of(series: Series, residual: np.ndarray, settings: NoiseSettings) -> NoiseEstimate:
    used = _is_for_noise(series)
    value, residual = np.where(used, series.value, np.nan), np.where(used, residual, np.nan)
    count = int(np.isfinite(value).sum())
    stated = series.stated_noise
    if series.statistic:
        if stated is None:
            raise InputError(f"run {series.run}, channel {series.channel}: statistics need a stated noise")
        return NoiseEstimate(stated, effective_samples=float(count))
    least = max(settings.min_share_of_channel * series.variation(value), series.rounding) if count else 0.0
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
            f"too few cycles of {series.channel} are known: its noise counts as independent from sample to sample"
        )
    if stated is not None:
        source, factor, known = "stated", settings.reported_mismatch, _rms(sd / shape)
        if series.unit == "rad" and known > settings.max_angle_rad:
            raise InputError(
                f"run {series.run}, channel {series.channel}: its stated noise of {np.degrees(known):.3g} deg is a "
                "large part of a turn; give what the sensor scatters, "
                f"{np.degrees(settings.max_angle_rad):.3g} deg at most"
            )
        if scatter is not None and not 1 / factor < max(scatter.sd, least) / max(known, least) < factor:
            remarks.append(_mismatch(series, scatter, known))
    elif scatter is None:
        raise InputError(
            f"run {series.run}, channel {series.channel}: {count} samples are too few to find the noise; "
            "state it as `noise` of the channel"
        )
    else:
        grown = scatter.sd * shape
        if scatter.sd < least:
            rounded = series.rounding == least
            source = "the sensor's steps" if rounded else "a share of what the channel varies by"
            which = "that of its steps" if rounded else "a ten-thousandth of its own"
            remarks.append(f"{series.channel} shows no noise: at least {least:.3g} {series.unit} is taken, {which}")
        elif sd is None and (jitter := _jitter(rate, grown)) > 0.0:
            remarks.append(
                f"{series.channel} scatters the more the faster it changes, as time stamps make it that are off by "
                f"{1e3 * jitter:.2g} ms: its noise is taken to grow so"
            )
        if sd is None:
            # The least is that of the white part, which is left where a channel stands still; jitter comes on top.
            sd = np.sqrt(grown**2 + max(least**2 - float(np.min(grown)) ** 2, 0.0))
        _check_is_noise(series, _rms(sd), value, predicted, settings)
    if not np.all(sd > 0.0):
        raise InputError(
            f"run {series.run}, channel {series.channel}: its noise is 0; state what the sensor resolves as `noise`"
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
    """Refuse a noise that was found where the model's motion is not that of the measurement."""
    most = settings.max_share_of_channel * series.variation(value)
    if series.unit == "rad":
        most = min(most, settings.max_angle_rad)
    # a channel that should stand still, as the speed of a steady crank does, may hold nothing but noise
    if sd > most and series.variation(predicted) > settings.least_motion * sd:
        raise InputError(
            f"run {series.run}, channel {series.channel}: its cycles differ by {sd:.3g} {series.unit} (standard "
            f"deviation), it varies by {series.variation(value):.3g}: that is no noise of a sensor, the model does not "
            "follow the motion. Check the drive, the bounds in `nuisance` and the column, or state the sensor's noise "
            "as `noise` of the channel"
        )


def _scatter(
    series: Series, residual: np.ndarray, predicted: np.ndarray, settings: NoiseSettings
) -> tuple[Scatter | None, str]:
    """What cycles of a residual do not repeat, else what neighbouring samples do not; and which of them it was.

    The rounding to the sensor's steps belongs to it, also where cycles have it in common.
    """
    scatter = scatter_between_cycles(residual, series.angle, settings, series.resolution)
    if scatter is None:
        return scatter_between_samples(residual, settings), "differences between neighbouring samples"
    if series.resolution:
        compared = compared_cycles(residual, series.angle, settings)
        repeated = rounding_that_repeats(compared, predicted, series.resolution, scatter.sd**2)
        spectrum = None if scatter.spectrum is None else scatter.spectrum + repeated
        scatter = replace(scatter, sd=float(np.hypot(scatter.sd, np.sqrt(repeated))), spectrum=spectrum)
    return scatter, "differences between neighbouring cycles"


def _rate(series: Series, predicted: np.ndarray) -> np.ndarray:
    """Rate (n,) of a channel over time [unit/s] as predicted; 0 where times are not known, or stamps are exact."""
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
    """How the noise changes over the samples, (n,) with a mean square of 1; and the noise (n,) [unit] itself where it
    is known so far.

    It is known where it is stated, and where the time stamps' jitter is: then the white part is what that leaves.
    """
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
    """Standard deviation of time stamps [s] that makes the noise `sd` (n,) grow with the `rate` (n,) as it does."""
    slow, fast = np.argmin(np.abs(rate)), np.argmax(np.abs(rate))
    change = rate[fast] ** 2 - rate[slow] ** 2
    return float(np.sqrt((sd[fast] ** 2 - sd[slow] ** 2) / change)) if change > 0.0 else 0.0


def _mismatch(series: Series, scatter: Scatter, stated: float) -> str:
    start = f"{series.channel} is stated to have a noise of {stated:.3g} {series.unit}; its cycles differ"
    if scatter.sd < stated:
        return f"{start} as if it were {scatter.sd:.3g}: small disagreements may be overlooked"
    return (
        f"{start} as if it were {scatter.sd:.3g}: it is larger than stated, something out of step with the crank "
        "acts, or impacts ring differently in each cycle"
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def numerics_noise(
    model: Model,
    values: Mapping[str, float],
    noise: Mapping[Key, Noise],
    settings: NoiseSettings = DEFAULT_SETTINGS.noise,
    of_drives_alone: bool = False,
) -> dict[Key, Noise]:
    """The noise together with what equally good numerics predict differently, unless states that are estimated make up
    for that, and with the errors of what drives runs.
    """
    changed, statistics = dict(noise), {series.key for series in model.series if series.statistic}
    for run in runs_of(model):
        nuisances = {p.name: values.get(p.key, p.nominal) for p in model.nuisances if p.run in (None, run)}
        numbers = range(0) if of_drives_alone else range(1, len(model.numerics) + 1)
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
                spread = _spread(np.mean(each, axis=0), own.sd, (run, channel) in statistics, settings)
                changed[run, channel] = replace(own, numerics=spread)
        if isinstance(model, Driven):
            errors = {c: each for c, each in model.drive_errors(run, nuisances).items() if (run, c) in changed}
            squares = [np.sum((each / changed[run, c].sd[:, None]) ** 2, axis=0) for c, each in errors.items()]
            counted = np.sqrt(np.sum(squares, axis=0)) > settings.negligible_numerics
            for channel, each in errors.items():
                if counted.any():
                    changed[run, channel] = replace(changed[run, channel], drive=each[:, counted])
    return changed


def _spread(square: np.ndarray, sd: np.ndarray, statistic: bool, settings: NoiseSettings) -> np.ndarray:
    """Root of the smoothed mean square (n,) of what other numerics change; 0 where that is negligible beside the noise
    `sd` (n,)."""
    window = np.ones(min(settings.numerics_window, square.size))
    smooth = np.convolve(square, window, mode="same") / np.convolve(np.ones(square.size), window, mode="same")
    spread = np.sqrt(np.maximum(smooth - sd**2, 0.0) if statistic else smooth)
    return np.where(spread > settings.negligible_numerics * sd, spread, 0.0)
