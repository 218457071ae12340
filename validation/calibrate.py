"""How large an injected effect has to be: the whitened gap that it leaves once the model without it is recalibrated."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.problem import Noise, whiten
from jointgap.rig.model import LASTING_DAMPING_FACTOR
from validation.effects import InjectedEffect
from validation.rig import CrankRun, InjectedEffects, Numerics, VirtualRig, noise_free_readings, with_nuisances

SIZING_NUMERICS = Numerics(1e-10)
"""Truth and base alike, so that no difference between numerics counts as the effect's."""

CHAOTIC_NUMERICS = Numerics(1e-8)
"""For motions that never repeat: they part within revolutions whatever the tolerance, but their statistics agree."""

GAP_TOLERANCE = 0.08
"""Relative deviation from the target at which a gap is close enough."""

BINS, MOTIONS = 36, 4
"""Bins of the crank angle, and motions as long as the measured one over which expectations are taken."""

_MOST_STEPS = 16  # of the search for a size

Readings = dict[str, dict[str, np.ndarray]]
"""By run and channel, SI."""


class Calibrator:
    """Measures gaps of a rig: noise-free differences between a truth and the recalibrated base, over the noise."""

    step_share = 0.1  # of a nuisance's range, for derivatives: beyond the integrator's noise, small enough to be linear

    def __init__(self, rig: VirtualRig):
        self.rig, self.runs = rig, tuple(rig.identify_runs)
        self.base = {run: self._read(run, rig.true, rig.runs[run]) for run in self.runs}
        self._noises: list[tuple[str, str, Noise, slice]] = []
        self.size = 0
        for run in self.runs:
            for channel, sensor in rig.sensors.items():
                series = self.base[run][channel]
                sd = np.full(series.size, sensor.noise_share * series.std())
                noise = Noise(sd, (sensor.correlation,) if sensor.correlation else ())
                self._noises.append((run, channel, noise, slice(self.size, self.size + series.size)))
                self.size += series.size
        self._slopes: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def gap(self, effects: InjectedEffects) -> float:
        """Root of 1 plus the mean square of what recalibration within the nuisances' bounds leaves of `effects`."""
        left = self._difference(effects)
        if self._slopes is None:
            self._slopes = self._derivatives()
        slopes, low, high = self._slopes
        if slopes.shape[1]:
            scale = self._scale(slopes)
            left = left - slopes @ (lsq_linear(slopes / scale, left, (low * scale, high * scale)).x / scale)
        return self._gap_of(left)

    def numerics_gap(self, effects: InjectedEffects, readings: Readings) -> float:
        """Gap, before nuisances move, between a truth by the calibrator's own numerics and its `readings` by others."""
        own = {run: self._read(run, self.rig.true, self.rig.runs[run], effects) for run in self.runs}
        return self._gap_of(self._whitened(own, readings))

    def spread(self) -> dict[str, float]:
        """Standard deviation of each channel in the fastest run, SI."""
        fastest = max(self.runs, key=lambda run: self.rig.runs[run].speed)
        return {channel: float(self.base[fastest][channel].std()) for channel in self.rig.sensors}

    def _read(
        self, run: str, content: Mapping, crank: CrankRun, effects: InjectedEffects = ()
    ) -> dict[str, np.ndarray]:
        return noise_free_readings(content, crank, SIZING_NUMERICS, tuple(self.rig.sensors), effects)

    def _whitened(self, readings: Readings, others: Readings) -> np.ndarray:
        white = np.empty(self.size)
        for run, channel, noise, place in self._noises:
            white[place] = whiten(readings[run][channel] - others[run][channel], noise)
        return white

    def _difference(self, effects: InjectedEffects) -> np.ndarray:
        """Differences (size,) of a truth with `effects` from the base."""
        rig, readings, base = self.rig, {}, {}
        for run in self.runs:
            crank = rig.runs[run]
            readings[run] = self._read(run, rig.true, crank, effects)
            base[run] = self.base[run]
            if rig.angle_noise and any(effect.name in ("encoder_offset", "speed_fluctuation") for effect, _ in effects):
                # The analyst's base turns as the encoder says: on the line through its readings.
                speed, phase = np.polyfit(crank.times, readings[run]["crank_angle"], 1)
                base[run] = self._read(run, rig.true, replace(crank, speed=float(speed), phase=float(phase)))
        return self._whitened(readings, base)

    def _nuisances(self) -> dict[str, tuple[float, float, float]]:
        """True value and bounds of all that a recalibration may move; ``key@run`` of one run alone."""
        rig = self.rig
        free = {
            key: (rig.nuisance_values[key], *bounds) for key, bounds in rig.nuisance_bounds.items() if key != "speed"
        }
        reach = math.log(LASTING_DAMPING_FACTOR)
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

    def _moved(self, key: str, value: float) -> np.ndarray:
        """Differences (size,) from the base where one nuisance has another value [SI]."""
        name, _, only = key.partition("@")
        readings = dict(self.base)
        for run in (only,) if only else self.runs:
            crank = self.rig.runs[run]
            if name == "speed":
                crank = replace(crank, speed=value)
            elif name == "first_angle":
                crank = replace(crank, phase=value)
            readings[run] = self._read(run, with_nuisances(self.rig.true, {name: value}), crank)
        return self._whitened(readings, self.base)

    def _derivatives(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives (size, k) by the nuisances, in steps away from the nearer bound; bounds in steps."""
        columns, low, high = [], [], []
        for key, (value, lower, upper) in self._nuisances().items():
            step = self.step_share * (upper - lower) * (1 if value < 0.5 * (lower + upper) else -1)
            columns.append(self._moved(key, value + step))
            ends = sorted(((lower - value) / step, (upper - value) / step))
            low.append(ends[0])
            high.append(ends[1])
        return np.array(columns).T.reshape(self.size, -1), np.array(low), np.array(high)

    def _scale(self, slopes: np.ndarray) -> np.ndarray | float:
        return np.maximum(np.linalg.norm(slopes, axis=0), 1e-12)

    def _gap_of(self, white: np.ndarray) -> float:
        return math.sqrt(1 + float(np.mean([np.mean(white[place] ** 2) for *_, place in self._noises])))


class StatisticsCalibrator(Calibrator):
    """As `Calibrator`, for motions that never repeat: of mean and log variance in bins of the crank angle.

    A difference is measured by its standard error in one run as long as the measured one; what the scatter of the
    simulated motions themselves adds is taken off.
    """

    step_share = 0.3  # the effect of a step has to stand out of the scatter of the motions

    def __init__(self, rig: VirtualRig):
        self.rig, self.runs, self._slopes = rig, tuple(rig.identify_runs), None
        by_run = {run: self._statistics(run, rig.true) for run in self.runs}
        self._base, self._error = (np.concatenate([own[place] for own in by_run.values()]) for place in (0, 1))
        self.size = self._error.size
        self._spread = {run: spread for run, (_, _, spread) in by_run.items()}

    def spread(self) -> dict[str, float]:
        """Standard deviation of each channel in the fastest run, SI."""
        return self._spread[max(self.runs, key=lambda run: self.rig.runs[run].speed)]

    def _statistics(
        self, run: str, content: Mapping, effects: InjectedEffects = ()
    ) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
        """Statistics (channels * 2 * BINS,), their standard errors in one run, the channels' standard deviations."""
        crank, values, errors, spread = self.rig.runs[run], [], [], {}
        later = 2 * math.pi * 7  # seven revolutions: enough for the motions to have parted
        motions = [
            noise_free_readings(
                content,
                replace(crank, phase=crank.phase + later * motion),
                CHAOTIC_NUMERICS,
                tuple(self.rig.sensors),
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

    def _difference(self, effects: InjectedEffects, content: Mapping | None = None) -> np.ndarray:
        statistics = [self._statistics(run, content or self.rig.true, effects)[0] for run in self.runs]
        return (np.concatenate(statistics) - self._base) / self._error

    def _nuisances(self) -> dict[str, tuple[float, float, float]]:
        # the speed hardly changes a statistic over the crank angle
        values, bounds = self.rig.nuisance_values, self.rig.nuisance_bounds
        return {key: (values[key], *own) for key, own in bounds.items() if key != "speed"}

    def _moved(self, key: str, value: float) -> np.ndarray:
        return self._difference((), with_nuisances(self.rig.true, {key: value}))

    def _scale(self, slopes: np.ndarray) -> float:
        return 1.0

    def _gap_of(self, white: np.ndarray) -> float:
        return math.sqrt(1 + max(float(np.mean(white**2)) - 2 / MOTIONS, 0.0))


def calibrate_size(calibrator: Calibrator, effect: InjectedEffect, target: float) -> tuple[float, float]:
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
