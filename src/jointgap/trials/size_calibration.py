"""How large an effect is: the whitened gap that it leaves after the model without it has been recalibrated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from jointgap.errors import InputError, SimulationError
from jointgap.identification.whitening import Noise, whiten
from jointgap.trials.draw_rigs import Design, with_values
from jointgap.trials.injected_effects import Hidden
from jointgap.trials.sensor_readings import Numerics, Turn, read

SIZING = Numerics(1e-10)
"""Truth and base alike, so that no difference between numerics counts as the effect's."""

NEAR = 0.08
"""How near, as a share, a gap comes to what was asked for."""

Found = Sequence[tuple[Hidden, float]]


@dataclass(frozen=True)
class Yardstick:
    """The noise by which one channel of one run is measured [SI], and where its samples lie in the residual."""

    run: str
    channel: str
    noise: Noise
    place: slice


class Gauge:
    """Measures gaps of one rig: noise-free differences between a truth and the recalibrated base, over the noise.

    Parameters
    ----------
    design : Design
    runs : sequence of str
        Those that are measured.
    """

    def __init__(self, design: Design, runs: Sequence[str]):
        self.design, self.runs = design, tuple(runs)
        self.base = {run: self._seen(run, design.true, design.runs[run]) for run in self.runs}
        self.yardsticks, begin = [], 0
        for run in self.runs:
            for channel, sensor in design.sensors.items():
                series = self.base[run][channel]
                sd = np.full(series.size, sensor.share * series.std())
                noise = Noise(sd, (sensor.memory,) if sensor.memory else ())
                self.yardsticks.append(Yardstick(run, channel, noise, slice(begin, begin + series.size)))
                begin += series.size
        self.size = begin
        self._slopes: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None

    def spread(self) -> dict[str, float]:
        """Standard deviation of each channel in the fastest run of these, SI."""
        fastest = max(self.runs, key=lambda run: self.design.runs[run].speed)
        return {channel: float(self.base[fastest][channel].std()) for channel in self.design.sensors}

    def _seen(self, run: str, content: dict, turn: Turn, hidden: Found = ()) -> dict[str, np.ndarray]:
        return read(content, turn, SIZING, tuple(self.design.sensors), hidden)

    def _difference(self, seen: dict[str, dict[str, np.ndarray]], other: dict[str, dict[str, np.ndarray]]):
        """Differences (size,), whitened and merely over the noise's standard deviation."""
        white, plain = np.empty(self.size), np.empty(self.size)
        for one in self.yardsticks:
            off = seen[one.run][one.channel] - other[one.run][one.channel]
            white[one.place], plain[one.place] = whiten(off, one.noise), off / one.noise.sd
        return white, plain

    def _with(self, key: str, value: float) -> dict[str, dict[str, np.ndarray]]:
        """The base with one nuisance at another value."""
        name, _, only = key.partition("@")
        found = dict(self.base)
        for run in (only,) if only else self.runs:
            turn = self.design.runs[run]
            if name == "speed":
                turn = Turn(value, turn.phase, turn.times)
            elif name == "first_angle":
                turn = Turn(turn.speed, value, turn.times)
            found[run] = self._seen(run, with_values(self.design.true, {name: value}), turn)
        return found

    def slopes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives (size, k) by the nuisances in steps of their ranges, whitened and not, and the bounds in those steps."""
        if self._slopes is None:
            white, plain, low, high = [], [], [], []
            for key, (value, down, up) in self._free().items():
                step = 0.1 * (up - down) * (1 if value < 0.5 * (down + up) else -1)
                columns = self._difference(self._with(key, value + step), self.base)
                white.append(columns[0])
                plain.append(columns[1])
                ends = sorted(((down - value) / step, (up - value) / step))
                low.append(ends[0])
                high.append(ends[1])
            shaped = (np.array(columns).T.reshape(self.size, -1) for columns in (white, plain))
            self._slopes = *shaped, np.array(low), np.array(high)
        return self._slopes

    def _free(self) -> dict[str, tuple[float, float, float]]:
        """True value and bounds of all that a recalibration may move."""
        design = self.design
        found = {
            key: (design.values[key], *bounds) for key, bounds in design.nuisance.items() if key != "speed"
        }  # fmt: skip
        for run in self.runs:
            turn = design.runs[run]
            if "speed" in design.nuisance:
                nominal = design.speeds[run]
                found[f"speed@{run}"] = (turn.speed, nominal * 0.997, nominal * 1.003)
            if not design.angle_noise:
                found[f"first_angle@{run}"] = (turn.phase, turn.phase - 0.05, turn.phase + 0.05)
        return found

    def leftover(self, hidden: Found) -> np.ndarray:
        """Whitened noise-free difference (size,) of a truth with `hidden` from the recalibrated base."""
        return self._recalibrated(hidden)[0]

    def unwhitened(self, hidden: Found) -> np.ndarray:
        """The same difference over the noise's standard deviation alone, (size,)."""
        return self._recalibrated(hidden)[1]

    def _recalibrated(self, hidden: Found) -> tuple[np.ndarray, np.ndarray]:
        design, seen, read_as = self.design, {}, {}
        for run in self.runs:
            turn = design.runs[run]
            seen[run] = self._seen(run, design.true, turn, hidden)
            read_as[run] = self.base[run]
            if design.angle_noise and any(one.name in ("encoder_offset", "speed_fluctuation") for one, _ in hidden):
                # The analyst's base turns as the encoder says: on the line through its readings.
                speed, phase = np.polyfit(turn.times, seen[run]["crank_angle"], 1)
                read_as[run] = self._seen(run, design.true, Turn(float(speed), float(phase), turn.times))
        white, plain = self._difference(seen, read_as)
        slopes, others, low, high = self.slopes()
        if not slopes.shape[1]:
            return white, plain
        scale = np.maximum(np.linalg.norm(slopes, axis=0), 1e-12)
        moved = lsq_linear(slopes / scale, white, (low * scale, high * scale)).x / scale
        return white - slopes @ moved, plain - others @ moved

    def numerics_gap(self, hidden: Found, numerics: Numerics) -> float:
        """Gap between two simulations of the truth, by `numerics` and by those of the gauge, before nuisances move."""
        turns, sensors = self.design.runs, tuple(self.design.sensors)
        seen, other = (
            {run: read(self.design.true, turns[run], chosen, sensors, hidden) for run in self.runs}
            for chosen in (SIZING, numerics)
        )
        return self._gap(self._difference(seen, other)[0])

    def gap(self, hidden: Found) -> float:
        """Root of 1 plus the mean over runs and channels of the leftover's mean square."""
        return self._gap(self.leftover(hidden))

    def _gap(self, left: np.ndarray) -> float:
        return math.sqrt(1 + float(np.mean([np.mean(left[one.place] ** 2) for one in self.yardsticks])))


def sized(gauge, one: Hidden, target: float) -> tuple[float, float]:
    """Size of an effect at which its gap is about `target`, and the gap; the nearest that can be had where none is.

    Secants in the logarithms of size and excess, kept between sizes that are too small and too large. Sizes that cannot be
    simulated are too large.
    """
    goal = target**2 - 1
    low, high, size = None, None, min(one.first, one.most)
    best = None
    for _ in range(16):
        try:
            gap = gauge.gap([(one, size)])
        except (InputError, SimulationError):
            gap = math.inf
        if gap < math.inf and (best is None or abs(math.log(gap / target)) <= abs(math.log(best[1] / target))):
            best = size, gap
        if abs(gap / target - 1) < NEAR:
            break
        point = math.log(size), math.log(max(gap**2 - 1, 1e-9) / goal)
        low, high = (point, high) if gap < target else (low, point)
        if high is None:
            if size >= one.most:
                break
            size = min(size * min(max(math.exp(-0.5 * point[1]), 1.3), 30.0), one.most)
        elif low is None:
            if size <= one.least:
                break
            smaller = size * max(math.exp(-0.5 * min(point[1], 8.0)), 1e-3) if point[1] < math.inf else 0.3 * size
            size = max(smaller, one.least)
        elif high[1] < math.inf:
            share = -low[1] / (high[1] - low[1])
            size = math.exp(low[0] + min(max(share, 0.1), 0.9) * (high[0] - low[0]))
        else:
            size = math.exp(0.5 * (low[0] + high[0]))
        if low and high and high[0] - low[0] < 1e-3:
            break
    return best or (size, 1.0)
