"""Noise of every channel of every run: from repeated cycles, or as stated; and what the choice of numerics adds to
it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.confirmation import fit_run_parameters
from jointgap.identification.cycle_noise import (
    Scatter,
    ar_autocorrelation,
    compared_cycles,
    effective_samples,
    growth_with_rate,
    rounding_that_repeats,
    scatter_between_cycles,
    scatter_between_samples,
)
from jointgap.identification.fit import FAILED, fit_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.protocol import Driven, Model, Series, runs_of
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings, NoiseSettings
from jointgap.identification.whitening import Noise

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
) -> dict[Key, Noise]:
    """The noise together with what equally good numerics predict differently, and with the errors of what drives
    runs.
    """
    changed, statistics = dict(noise), {series.key for series in model.series if series.statistic}
    for run in runs_of(model):
        nuisances = {p.name: values.get(p.key, p.nominal) for p in model.nuisances if p.run in (None, run)}
        usual = model.simulate(run, nuisances)
        squares = {channel: [] for channel in usual}
        for number in range(1, len(model.numerics) + 1):
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
