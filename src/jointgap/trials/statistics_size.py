"""How large an effect is where the motion never repeats: by statistics over the crank angle instead of by samples."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import lsq_linear

from jointgap.trials.draw_rigs import Design, with_values
from jointgap.trials.sensor_readings import Numerics, Turn, read
from jointgap.trials.size_calibration import Found

BINS, MOTIONS = 36, 4
"""Bins of the crank angle, and motions as long as the measured one over which expectations are taken."""

QUICK = Numerics(1e-8)
"""Single motions part within revolutions whatever the tolerance; their statistics agree."""

_STEP = 0.3  # of a nuisance's range: its effect has to stand out of the scatter of the motions


class StatisticGauge:
    """As `jointgap.trials.size_calibration.Gauge`, of mean and logarithm of the variance in bins of the crank angle.

    A difference is measured by its standard error in one run as long as the measured one; what the scatter of the
    simulated motions themselves adds is taken off.
    """

    def __init__(self, design: Design, runs: Sequence[str]):
        self.design, self.runs = design, tuple(runs)
        found = {run: self._statistics(run, design.true, design.runs[run]) for run in self.runs}
        self._error = np.concatenate([error for _, error, _ in found.values()])
        self.base = {run: values for run, (values, _, _) in found.items()}
        self._spread = {run: spread for run, (_, _, spread) in found.items()}
        self._known: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def spread(self) -> dict[str, float]:
        """Standard deviation of each channel in the fastest run of these, SI."""
        return self._spread[max(self.runs, key=lambda run: self.design.runs[run].speed)]

    def _statistics(self, run: str, content: dict, turn: Turn, hidden: Found = ()):
        """Statistics (channels * 2 * BINS,), their standard errors in one run, and the channels' standard deviations."""
        design, values, errors, spread = self.design, [], [], {}
        motions = [
            read(content, Turn(turn.speed, turn.phase + 2 * math.pi * 7 * motion, turn.times), QUICK, tuple(design.sensors), hidden)
            for motion in range(MOTIONS)
        ]  # fmt: skip
        cycle = np.floor(turn.times * turn.speed / (2 * math.pi)).astype(int)
        angle = (turn.phase + turn.times * turn.speed) % (2 * math.pi)
        place = np.minimum((angle / (2 * math.pi) * BINS).astype(int), BINS - 1)
        cell, cells = cycle * BINS + place, (cycle.max() + 1) * BINS
        count = np.bincount(cell, minlength=cells).reshape(-1, BINS).astype(float)
        count[count == 0] = np.nan
        for channel, sensor in design.sensors.items():
            spread[channel] = float(np.std(np.concatenate([motion[channel] for motion in motions])))
            noise = (sensor.share * spread[channel]) ** 2
            seen = np.array([motion[channel] for motion in motions])
            means = np.array([np.bincount(cell, one, cells).reshape(-1, BINS) / count for one in seen]).reshape(
                -1, BINS
            )
            mean = np.nanmean(means, axis=0)
            squares = np.array(
                [np.bincount(cell, (one - mean[place]) ** 2, cells).reshape(-1, BINS) / count for one in seen]
            )
            squares = squares.reshape(-1, BINS) + noise
            variance, cycles = np.nanmean(squares, axis=0), cycle.max() + 1
            values += [mean, np.log(variance)]
            errors += [
                np.sqrt((np.nanvar(means, axis=0) + noise / np.nanmean(count)) / cycles),
                np.sqrt((np.nanvar(squares, axis=0) / variance**2 + 2 / np.nanmean(count)) / cycles),
            ]
        return np.concatenate(values), np.concatenate(errors), spread

    def _all(self, content: dict, hidden: Found = ()) -> np.ndarray:
        return np.concatenate(
            [self._statistics(run, content, self.design.runs[run], hidden)[0] for run in self.runs]
        )  # fmt: skip

    def _slopes(self):
        if self._known is None:
            design, columns, low, high = self.design, [], [], []
            base = np.concatenate(list(self.base.values()))
            for key, (down, up) in design.nuisance.items():
                if key == "speed":
                    continue  # hardly changes a statistic over the crank angle
                value = design.values[key]
                step = _STEP * (up - down) * (1 if value < 0.5 * (down + up) else -1)
                columns.append((self._all(with_values(design.true, {key: value + step})) - base) / self._error)
                ends = sorted(((down - value) / step, (up - value) / step))
                low.append(ends[0])
                high.append(ends[1])
            self._known = np.array(columns).T.reshape(self._error.size, -1), np.array(low), np.array(high)
        return self._known

    def gap(self, hidden: Found) -> float:
        """Root of 1 plus the mean over statistics of the squared difference that recalibration leaves."""
        base = np.concatenate(list(self.base.values()))
        difference = (self._all(self.design.true, hidden) - base) / self._error
        slopes, low, high = self._slopes()
        if slopes.shape[1]:
            difference = difference - slopes @ lsq_linear(slopes, difference, (low, high)).x
        return math.sqrt(1 + max(float(np.mean(difference**2)) - 2 / MOTIONS, 0.0))
