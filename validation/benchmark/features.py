"""A campaign as arrays of fixed width: the input of the network classifier (`network.py`)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import tau
from pathlib import Path

import numpy as np

from jointgap.config.load import load_campaign
from jointgap.core.candidates import Candidate, Parameter, Series, Variation
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import JOINTS
from jointgap.identification.noise import estimate_noise
from jointgap.rig.model import LinkageModel, build_model
from jointgap.rig.read_files import read_measurements
from jointgap.rig.sensors import ENCODER_FAULTS, FAULTS, LAG_AND_DELAY
from validation.rig import CHANNELS, LABELS

CHANNEL_NAMES = ("crank_angle", *CHANNELS)
"""Channels whose tokens the network distinguishes."""

SENSOR_FAULTS = tuple(name for name in FAULTS if name not in (*ENCODER_FAULTS, LAG_AND_DELAY))
"""Faults of a single channel."""

EFFECTS = (
    *(label for label in LABELS if label.partition(":")[0] not in FAULTS),
    *ENCODER_FAULTS,
)
"""Labels that belong to no single channel."""

BINS = 36  # of the crank angle
_LEAST_SAMPLES = 8  # of a channel of a run
_ORDERS = np.arange(0.25, 12.01, 0.25)  # of the crank, in the spectrum of a residual

# [1] Prior standard deviation of a nuisance over the half width of its bounds (uniform within them)
_NUISANCE_SPREAD = 1.0 / math.sqrt(3.0)

# Signals and their changes (n,) by channel, of one run
Readings = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Features:
    """Numbers that describe a campaign.

    Attributes
    ----------
    channels : (n,) int array
        Channel of each token, a place in `CHANNEL_NAMES`. A token is a channel of a run (of
        motion that never repeats: one of its two statistics).
    tokens : (n, t) array
        Residual of the nominal model over the noise [1]: in bins of the crank angle, its spectrum,
        regression on what sensor faults cause, before and after a linear recalibration.
    rig : (g,) array
        Dimensions of the rig, speeds, and the linear gain of each effect.
    gap : float
        Root mean square of the residuals over the noise after the recalibration, 1 is noise.
    """

    channels: np.ndarray
    tokens: np.ndarray
    rig: np.ndarray
    gap: float


def features(campaign_file: Path) -> Features:
    """The features of a campaign, from its files without the held-out runs.

    Raises
    ------
    InputError, SimulationError
        The files cannot be read, or the nominal model cannot be simulated.
    """
    campaign = load_campaign(campaign_file)
    fitted = tuple(run for run in campaign.runs if run.role != "confirm")
    campaign = campaign.model_copy(update={"runs": fitted})
    model = build_model(campaign, read_measurements(campaign, compared=False))
    predicted = {run: model.simulate(run, model.nominal(run)) for run in model.plans}
    parts = _parts(model, predicted)
    raw = np.concatenate([part.residual for part in parts])
    nuisances, effects = _sensitivities(model, parts, predicted)
    beyond = _Beyond(nuisances)
    recalibrated = beyond(raw)[: raw.size]
    gains = {label: beyond.gain(raw, columns) for label, columns in effects.items()}
    tokens, begin = [], 0
    for part in parts:
        place = slice(begin, begin + part.residual.size)
        begin = place.stop
        tokens.append(_token(model, part, recalibrated[place], gains))
    mean_squares = [np.mean(np.square(token[:BINS])) for token in tokens]
    largest = math.sqrt(max(*mean_squares, 1e-12))
    tokens = [np.concatenate([token, token[:BINS] / largest]) for token in tokens]
    return Features(
        np.array([part.channel for part in parts]),
        _compressed(np.array(tokens)),
        _compressed(_rig(model, gains)),
        float(np.sqrt(np.mean(np.square(recalibrated)))),
    )


def _compressed(values: np.ndarray) -> np.ndarray:
    """Values of any size as single-precision numbers of a few units."""
    return np.arcsinh(np.nan_to_num(values, posinf=1e6, neginf=-1e6)).astype(np.float32)


@dataclass(frozen=True)
class _Part:
    """The used samples of a series."""

    series: Series
    used: np.ndarray  # (n,) bool
    spread: np.ndarray  # standard deviation of the noise at the used samples
    residual: np.ndarray  # of the nominal model over the noise, at the used samples
    signal: np.ndarray  # of the nominal model, at the used samples

    @property
    def channel(self) -> int:
        return CHANNEL_NAMES.index(self.series.channel.partition(" ")[0])

    def scaled(self, change: Readings | None) -> np.ndarray:
        """A change of the readings over the noise, at the used samples; 0 without one."""
        if change is None:
            return np.zeros(self.residual.size)
        return change[self.series.channel][self.used] / self.spread


def _parts(model: LinkageModel, predicted: Mapping[str, Readings]) -> list[_Part]:
    residuals = {
        series.key: series.value - predicted[series.run][series.channel] for series in model.series
    }
    noise, parts = estimate_noise(model, residuals), []
    for series in model.series:
        residual, spread = residuals[series.key], noise[series.key].spread
        used = np.isfinite(residual) & np.isfinite(series.angle) & (spread > 0.0)
        used &= ~series.held_out
        if used.sum() >= _LEAST_SAMPLES:
            signal = predicted[series.run][series.channel][used]
            scaled = residual[used] / spread[used]
            parts.append(_Part(series, used, spread[used], scaled, signal))
    return parts


def _sensitivities(
    model: LinkageModel, parts: Sequence[_Part], predicted: Mapping[str, Readings]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Changes of the residuals by each nuisance (n, k), in half widths of its bounds, and by the
    amplitudes of each effect (n, a), by label."""
    nuisances = [p for p in model.nuisances if math.isfinite(p.high - p.low)]
    amplitudes = [
        (candidate, p)
        for candidate in model.candidates
        if not candidate.carrier and candidate.name not in SENSOR_FAULTS
        for p in candidate.coordinates
        if p.name in candidate.amplitudes
    ]
    runs = {part.series.run for part in parts}
    columns = {run: _changes(model, run, nuisances, amplitudes, predicted) for run in runs}
    scaled = [
        np.array([part.scaled(change) for change in columns[part.series.run]]).T for part in parts
    ]
    matrix = np.concatenate(scaled)
    effects: dict[str, list[np.ndarray]] = {}
    for (candidate, _), column in zip(amplitudes, matrix.T[len(nuisances) :], strict=True):
        effects.setdefault(candidate.label, []).append(column)
    for label, column in _fault_columns(parts).items():
        effects[label] = [column]
    halves = np.array([0.5 * (p.high - p.low) / p.step for p in nuisances])
    stacked = {label: np.column_stack(columns) for label, columns in effects.items()}
    return matrix[:, : len(nuisances)] * halves, stacked


def _fault_columns(parts: Sequence[_Part]) -> dict[str, np.ndarray]:
    """Changes (n,) of the residuals by a fault of each sensor, by label: a constant, the signal,
    and its rate for faults that depend on its past."""
    columns = {}
    for channel in {part.series.channel for part in parts if not part.series.statistic}:
        changes: dict[str, list[np.ndarray]] = {fault: [] for fault in SENSOR_FAULTS}
        for part in parts:
            shapes = {}
            rate = np.zeros(part.residual.size)
            if part.series.channel == channel:
                rate = np.gradient(part.signal, part.series.time[part.used])
                shapes = {"sensor_bias": np.ones_like(rate), "sensor_gain": part.signal}
            for fault, column in changes.items():
                column.append(shapes.get(fault, rate) / part.spread)
        columns |= {f"{fault}:{channel}": np.concatenate(made) for fault, made in changes.items()}
    return columns


def _changes(
    model: LinkageModel,
    run: str,
    nuisances: Sequence[Parameter],
    amplitudes: Sequence[tuple[Candidate, Parameter]],
    predicted: Mapping[str, Readings],
) -> list[Readings | None]:
    """Changes of a run's readings by a step of each nuisance and amplitude; None for a step of
    another run, and where changes are not computed: of motion that never repeats, and of effects
    with loose joints without a periodic motion."""
    nominal = model.nominal(run)
    steps: list[Variation | None] = [
        ({**nominal, p.name: p.nominal + p.step}, ()) if p.run in (None, run) else None
        for p in nuisances
    ]
    for candidate, amplitude in amplitudes:
        values = dict(candidate.initial_guesses[0])
        values = {p.name: values.get(p.name, p.nominal) for p in candidate.coordinates_in((run,))}
        values[amplitude.name] = values.get(amplitude.name) or amplitude.step
        acts = amplitude.run in (None, run)
        steps.append((nominal, ((candidate, values),)) if acts else None)
    if model.chaotic(run):
        return [None] * len(steps)
    places = [place for place, step in enumerate(steps) if step is not None]
    nearby = model.changes(run, nominal, (), [steps[place] for place in places])
    if nearby is None:
        if model.campaign.mechanism.loose:
            places = [place for place in places if place < len(nuisances)]
        nearby = [_difference(model, run, steps[place], predicted[run]) for place in places]
    changes: list[Readings | None] = [None] * len(steps)
    for place, change in zip(places, nearby, strict=True):
        changes[place] = change
    return changes


def _difference(
    model: LinkageModel, run: str, step: Variation, predicted: Readings
) -> Readings | None:
    """The change of a run's readings by a simulated step; None if it cannot be simulated."""
    try:
        readings = model.simulate(run, *step)
    except (InputError, SimulationError):
        return None
    return {name: values - predicted[name] for name, values in readings.items()}


class _Beyond:
    """What of the residuals (n,) a linear recalibration of the nuisances leaves."""

    def __init__(self, nuisances: np.ndarray):
        prior = np.eye(nuisances.shape[1]) / _NUISANCE_SPREAD
        self._basis, _ = np.linalg.qr(np.vstack([nuisances, prior]))

    def __call__(self, columns: np.ndarray) -> np.ndarray:
        """Columns (n,) or (n, k) with the prior's rows appended, beyond the nuisances."""
        rows = self._basis.shape[0] - columns.shape[0]
        padded = np.concatenate([columns, np.zeros((rows, *columns.shape[1:]))])
        return padded - self._basis @ (self._basis.T @ padded)

    def gain(self, residual: np.ndarray, columns: np.ndarray) -> float:
        """Decrease of chi2 by the columns (n, a) besides the nuisances; negative if that asks for
        a negative amplitude of a single column."""
        beyond = self(columns)
        lengths = np.linalg.norm(beyond, axis=0)
        if not (np.isfinite(lengths).all() and (lengths > 0.0).all()):
            return 0.0
        basis, _ = np.linalg.qr(beyond / lengths)
        along = basis.T @ self(residual)
        upward = columns.shape[1] > 1 or beyond[:, 0] @ self(residual) > 0.0
        return float(along @ along) * (1.0 if upward else -1.0)


def _token(
    model: LinkageModel, part: _Part, recalibrated: np.ndarray, gains: Mapping[str, float]
) -> np.ndarray:
    """Numbers of a channel of a run: first the recalibrated residual in bins of the angle."""
    series = part.series
    plan = model.plans[series.run]
    angle = series.angle[part.used]
    bins = np.floor(angle / tau % 1.0 * BINS).astype(int) % BINS
    count = np.maximum(np.bincount(bins, minlength=BINS), 1)

    def folded(values: np.ndarray) -> np.ndarray:
        return np.bincount(bins, values, BINS) / count

    total = max(float(recalibrated @ recalibrated), 1e-12)
    channel = series.channel.partition(" ")[0]
    fault_gains = [gains.get(f"{fault}:{channel}", 0.0) for fault in SENSOR_FAULTS]
    spread = float(np.std(part.signal)) or 1.0
    between = recalibrated - folded(recalibrated)[bins]
    flags = [
        series.statistic,
        series.channel.endswith("variance"),
        plan.measured is not None,
    ]
    sizes = [
        math.log(part.residual.size),
        math.log(plan.samples.speed),
        math.log(spread / float(np.median(part.spread))),
        *(math.log(np.mean(np.square(v)) + 1e-9) for v in (part.residual, recalibrated, between)),
    ]
    return np.concatenate(
        [
            folded(recalibrated),
            folded(part.residual),
            folded((part.signal - part.signal.mean()) / spread),
            _spectrum(recalibrated, angle),
            _fault_regression(part, recalibrated, angle, spread),
            np.sign(fault_gains) * np.log1p(np.abs(fault_gains)),
            np.array(fault_gains) / total,
            sizes,
            np.array(flags, float),
        ]
    )


def _spectrum(residual: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Amplitudes of a residual at the orders of the crank."""
    waves = np.exp(-1j * np.outer(_ORDERS, angle))
    return 2.0 * np.abs(waves @ residual) / residual.size


def _fault_regression(
    part: _Part, residual: np.ndarray, angle: np.ndarray, spread: float
) -> np.ndarray:
    """Coefficients of a residual on a constant, the signal, its rate, its square, its cube and a
    trend, each of unit size."""
    signal = (part.signal - part.signal.mean()) / spread
    rate = np.gradient(signal, angle) if np.all(np.diff(angle) > 0.0) else np.gradient(signal)
    trend = np.linspace(-1.0, 1.0, signal.size)
    columns = np.column_stack([np.ones_like(signal), signal, rate, signal**2, signal**3, trend])
    sizes = np.maximum(np.sqrt(np.mean(np.square(columns), axis=0)), 1e-12)
    coefficients, *_ = np.linalg.lstsq(columns / sizes, residual, rcond=1e-8)
    return coefficients


def _rig(model: LinkageModel, gains: Mapping[str, float]) -> np.ndarray:
    """Numbers of the rig, and gains of the effects: of the whole and relative to the largest."""
    made = model.campaign.mechanism
    speeds = [plan.samples.speed for plan in model.plans.values()]
    loose = [joint in made.loose for joint in JOINTS]
    effects = np.array([gains.get(label, 0.0) for label in EFFECTS])
    largest = max(max(map(abs, gains.values()), default=0.0), 1e-12)
    return np.array(
        [
            *loose,
            model.campaign.drive == "measured_angle",
            "crank_angle" in model.campaign.channels,
            any(model.chaotic(run) for run in model.plans),
            made.crank.length / made.rod.length,
            *(math.log(body.mass) for body in (made.crank, made.rod, made.slider)),
            100.0 * made.slider.offset,
            *(math.log(speed) for speed in (min(speeds), max(speeds))),
            *(np.sign(effects) * np.log1p(np.abs(effects))),
            *(effects / largest),
        ],
        float,
    )
