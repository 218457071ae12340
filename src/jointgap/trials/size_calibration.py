"""How large an injected effect has to be: the whitened gap that it leaves once the model without it is recalibrated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.problem import Noise, whiten
from jointgap.rig.settings import DEFAULT_SETTINGS
from jointgap.trials.injected_effects import InjectedEffect
from jointgap.trials.sensor_readings import CrankRun, InjectedEffects, Numerics, noise_free_readings
from jointgap.trials.virtual_rig import VirtualRig, with_nuisances

SIZING_NUMERICS = Numerics(1e-10)
"""Truth and base alike, so that no difference between numerics counts as the effect's."""

CHAOTIC_NUMERICS = Numerics(1e-8)
"""For motions that never repeat: they part within revolutions whatever the tolerance, but their statistics agree."""

GAP_TOLERANCE = 0.08
"""Relative deviation from the target at which a gap is close enough."""

BINS, MOTIONS = 36, 4
"""Bins of the crank angle, and motions as long as the measured one over which expectations are taken."""

_STEP_SHARE = 0.1  # of a nuisance's range, for derivatives: beyond the integrator's noise, small enough to be linear
_CHAOTIC_STEP_SHARE = 0.3  # larger, for its effect has to stand out of the scatter of the motions
_MOST_STEPS = 16  # of the search for a size

Readings = dict[str, dict[str, np.ndarray]]
"""By run and channel, SI."""


@dataclass(frozen=True)
class _ChannelNoise:
    """The noise of one channel in one run [SI], and the place of its samples in the residual."""

    run: str
    channel: str
    noise: Noise
    place: slice


class SizeCalibrator:
    """Measures gaps of one rig: noise-free differences between a truth and the recalibrated base, over the noise."""

    def __init__(self, rig: VirtualRig, runs: Sequence[str]):
        self.rig, self.runs = rig, tuple(runs)
        self.base = {run: self._read(run, rig.true, rig.runs[run]) for run in self.runs}
        self.channel_noises: list[_ChannelNoise] = []
        begin = 0
        for run in self.runs:
            for channel, sensor in rig.sensors.items():
                series = self.base[run][channel]
                sd = np.full(series.size, sensor.noise_share * series.std())
                noise = Noise(sd, (sensor.correlation,) if sensor.correlation else ())
                self.channel_noises.append(_ChannelNoise(run, channel, noise, slice(begin, begin + series.size)))
                begin += series.size
        self.size = begin
        self._slopes: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None

    def spread(self) -> dict[str, float]:
        """Standard deviation of each channel in the fastest run, SI."""
        fastest = max(self.runs, key=lambda run: self.rig.runs[run].speed)
        return {channel: float(self.base[fastest][channel].std()) for channel in self.rig.sensors}

    def _read(self, run: str, content: dict, crank: CrankRun, effects: InjectedEffects = ()) -> dict[str, np.ndarray]:
        return noise_free_readings(content, crank, SIZING_NUMERICS, tuple(self.rig.sensors), effects)

    def _difference(self, readings: Readings, others: Readings) -> tuple[np.ndarray, np.ndarray]:
        """Differences (size,), whitened and merely over the noise's standard deviation."""
        white, plain = np.empty(self.size), np.empty(self.size)
        for part in self.channel_noises:
            difference = readings[part.run][part.channel] - others[part.run][part.channel]
            white[part.place], plain[part.place] = whiten(difference, part.noise), difference / part.noise.sd
        return white, plain

    def _base_with(self, key: str, value: float) -> Readings:
        """The base with one nuisance at another value [SI]; ``key@run`` changes one run alone."""
        name, _, only = key.partition("@")
        readings = dict(self.base)
        for run in (only,) if only else self.runs:
            crank = self.rig.runs[run]
            if name == "speed":
                crank = replace(crank, speed=value)
            elif name == "first_angle":
                crank = replace(crank, phase=value)
            readings[run] = self._read(run, with_nuisances(self.rig.true, {name: value}), crank)
        return readings

    def _derivatives(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives (size, k) by the nuisances in steps of their ranges, whitened and not; bounds in these steps."""
        if self._slopes is None:
            white, plain, low, high = [], [], [], []
            for key, (value, lower, upper) in self._free_nuisances().items():
                step = _inward_step(value, lower, upper, _STEP_SHARE)
                columns = self._difference(self._base_with(key, value + step), self.base)
                white.append(columns[0])
                plain.append(columns[1])
                ends = sorted(((lower - value) / step, (upper - value) / step))
                low.append(ends[0])
                high.append(ends[1])
            shaped = (np.array(columns).T.reshape(self.size, -1) for columns in (white, plain))
            self._slopes = *shaped, np.array(low), np.array(high)
        return self._slopes

    def _free_nuisances(self) -> dict[str, tuple[float, float, float]]:
        """True value and bounds of all that a recalibration may move."""
        rig = self.rig
        free = {
            key: (rig.nuisance_values[key], *bounds) for key, bounds in rig.nuisance_bounds.items() if key != "speed"
        }
        reach = math.log(DEFAULT_SETTINGS.nuisances.lasting_damping_factor)
        for joint in rig.loose:
            key = f"lasting_damping_{joint}"
            free[key] = (rig.nuisance_values.get(key, 0.0), -reach, reach)
        for run in self.runs:
            crank = rig.runs[run]
            if "speed" in rig.nuisance_bounds:
                nominal = rig.nominal_speeds[run]
                free[f"speed@{run}"] = (crank.speed, nominal * 0.997, nominal * 1.003)
            if not rig.angle_noise:
                free[f"first_angle@{run}"] = (crank.phase, crank.phase - 0.05, crank.phase + 0.05)
        return free

    def residual(self, effects: InjectedEffects) -> tuple[np.ndarray, np.ndarray]:
        """Differences (size,) of a truth with `effects` from the recalibrated base: whitened, and over the noise."""
        rig, readings, base = self.rig, {}, {}
        for run in self.runs:
            crank = rig.runs[run]
            readings[run] = self._read(run, rig.true, crank, effects)
            base[run] = self.base[run]
            if rig.angle_noise and any(effect.name in ("encoder_offset", "speed_fluctuation") for effect, _ in effects):
                # The analyst's base turns as the encoder says: on the line through its readings.
                speed, phase = np.polyfit(crank.times, readings[run]["crank_angle"], 1)
                base[run] = self._read(run, rig.true, replace(crank, speed=float(speed), phase=float(phase)))
        white, plain = self._difference(readings, base)
        slopes, others, low, high = self._derivatives()
        if not slopes.shape[1]:
            return white, plain
        scale = np.maximum(np.linalg.norm(slopes, axis=0), 1e-12)
        shift = lsq_linear(slopes / scale, white, (low * scale, high * scale)).x / scale
        return white - slopes @ shift, plain - others @ shift

    def numerics_gap(self, effects: InjectedEffects, readings: Readings) -> float:
        """Gap between the truth with `effects` by the calibrator's own numerics and its noise-free `readings` by
        others.

        It is taken before nuisances move.
        """
        own = {run: self._read(run, self.rig.true, self.rig.runs[run], effects) for run in self.runs}
        return self._gap_of(self._difference(own, readings)[0])

    def gap(self, effects: InjectedEffects) -> float:
        """Root of 1 plus the mean over runs and channels of the mean square of the whitened residual."""
        return self._gap_of(self.residual(effects)[0])

    def _gap_of(self, white: np.ndarray) -> float:
        return math.sqrt(1 + float(np.mean([np.mean(white[part.place] ** 2) for part in self.channel_noises])))


class StatisticsSizeCalibrator:
    """As `SizeCalibrator`, for motions that never repeat: of mean and log variance in bins of the crank angle.

    A difference is measured by its standard error in one run as long as the measured one; what the scatter of the
    simulated motions themselves adds is taken off.
    """

    def __init__(self, rig: VirtualRig, runs: Sequence[str]):
        self.rig, self.runs = rig, tuple(runs)
        by_run = {run: self._statistics(run, rig.true, rig.runs[run]) for run in self.runs}
        self._error = np.concatenate([error for _, error, _ in by_run.values()])
        self._base = np.concatenate([values for values, _, _ in by_run.values()])
        self._spread = {run: spread for run, (_, _, spread) in by_run.items()}
        self._slopes: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def spread(self) -> dict[str, float]:
        """Standard deviation of each channel in the fastest run, SI."""
        return self._spread[max(self.runs, key=lambda run: self.rig.runs[run].speed)]

    def _statistics(
        self, run: str, content: dict, crank: CrankRun, effects: InjectedEffects = ()
    ) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
        """Statistics (channels * 2 * BINS,), their standard errors in one run, the channels' standard deviations."""
        channels, values, errors, spread = tuple(self.rig.sensors), [], [], {}
        later = 2 * math.pi * 7  # seven revolutions: enough for the motions to have parted
        motions = [
            noise_free_readings(
                content,
                replace(crank, phase=crank.phase + later * motion),
                CHAOTIC_NUMERICS,
                channels,
                effects,
            )
            for motion in range(MOTIONS)
        ]
        cycle = np.floor(crank.times * crank.speed / (2 * math.pi)).astype(int)
        angle = (crank.phase + crank.times * crank.speed) % (2 * math.pi)
        place = np.minimum((angle / (2 * math.pi) * BINS).astype(int), BINS - 1)
        cycles = cycle.max() + 1
        cell, cells = cycle * BINS + place, cycles * BINS
        count = np.bincount(cell, minlength=cells).reshape(-1, BINS).astype(float)
        count[count == 0] = np.nan

        def by_bin(series: np.ndarray) -> np.ndarray:
            """Means (motions * cycles, BINS) of each of some series (motions, n) in the bins of each cycle."""
            sums = [np.bincount(cell, own, cells).reshape(-1, BINS) / count for own in series]
            return np.array(sums).reshape(-1, BINS)

        for channel, sensor in self.rig.sensors.items():
            series = np.array([motion[channel] for motion in motions])
            spread[channel] = float(np.std(np.concatenate([motion[channel] for motion in motions])))
            noise = (sensor.noise_share * spread[channel]) ** 2
            means = by_bin(series)
            mean = np.nanmean(means, axis=0)
            squares = by_bin((series - mean[place]) ** 2) + noise
            variance = np.nanmean(squares, axis=0)
            values += [mean, np.log(variance)]
            errors += [
                np.sqrt((np.nanvar(means, axis=0) + noise / np.nanmean(count)) / cycles),
                np.sqrt((np.nanvar(squares, axis=0) / variance**2 + 2 / np.nanmean(count)) / cycles),
            ]
        return np.concatenate(values), np.concatenate(errors), spread

    def _all_statistics(self, content: dict, effects: InjectedEffects = ()) -> np.ndarray:
        return np.concatenate([self._statistics(run, content, self.rig.runs[run], effects)[0] for run in self.runs])

    def _derivatives(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if self._slopes is None:
            columns, low, high = [], [], []
            for key, (lower, upper) in self.rig.nuisance_bounds.items():
                if key == "speed":
                    continue  # hardly changes a statistic over the crank angle
                value = self.rig.nuisance_values[key]
                step = _inward_step(value, lower, upper, _CHAOTIC_STEP_SHARE)
                changed = self._all_statistics(with_nuisances(self.rig.true, {key: value + step}))
                columns.append((changed - self._base) / self._error)
                ends = sorted(((lower - value) / step, (upper - value) / step))
                low.append(ends[0])
                high.append(ends[1])
            self._slopes = np.array(columns).T.reshape(self._error.size, -1), np.array(low), np.array(high)
        return self._slopes

    def gap(self, effects: InjectedEffects) -> float:
        """Root of 1 plus the mean over statistics of the squared difference that recalibration leaves."""
        difference = (self._all_statistics(self.rig.true, effects) - self._base) / self._error
        slopes, low, high = self._derivatives()
        if slopes.shape[1]:
            difference = difference - slopes @ lsq_linear(slopes, difference, (low, high)).x
        return math.sqrt(1 + max(float(np.mean(difference**2)) - 2 / MOTIONS, 0.0))


def _inward_step(value: float, lower: float, upper: float, share: float) -> float:
    """A step of a `share` of the range that stays within it: away from the nearer bound."""
    return share * (upper - lower) * (1 if value < 0.5 * (lower + upper) else -1)


def calibrate_size(
    calibrator: SizeCalibrator | StatisticsSizeCalibrator, effect: InjectedEffect, target: float
) -> tuple[float, float]:
    """Size of an effect at which its gap is about `target`, and that gap; the nearest possible where none is.

    Secants in the logarithms of size and excess, kept between sizes that are too small and too large. Sizes that cannot
    be simulated are too large.
    """
    goal = target**2 - 1
    low, high, size = None, None, min(effect.first, effect.most)
    best = None
    for _ in range(_MOST_STEPS):
        try:
            gap = calibrator.gap([(effect, size)])
        except (InputError, SimulationError):
            gap = math.inf
        if gap < math.inf and (best is None or abs(math.log(gap / target)) <= abs(math.log(best[1] / target))):
            best = size, gap
        if abs(gap / target - 1) < GAP_TOLERANCE:
            break
        point = math.log(size), math.log(max(gap**2 - 1, 1e-9) / goal)
        low, high = (point, high) if gap < target else (low, point)
        if high is None:
            if size >= effect.most:
                break
            size = min(size * min(max(math.exp(-0.5 * point[1]), 1.3), 30.0), effect.most)
        elif low is None:
            if size <= effect.least:
                break
            smaller = size * max(math.exp(-0.5 * min(point[1], 8.0)), 1e-3) if point[1] < math.inf else 0.3 * size
            size = max(smaller, effect.least)
        elif high[1] < math.inf:
            share = -low[1] / (high[1] - low[1])
            size = math.exp(low[0] + min(max(share, 0.1), 0.9) * (high[0] - low[0]))
        else:
            size = math.exp(0.5 * (low[0] + high[0]))
        if low and high and high[0] - low[0] < 1e-3:
            break
    return best or (size, 1.0)
