"""Times and crank angles of the samples of a run, estimated from the record."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import tau

import numpy as np

# [1, robust standard deviations] Distance of an outlier of the crank angle from its line
OUTLIER = 5.0
# [rad] Angles without times that are nearer to a line over their rows are uniform in time
EVEN_ROWS = math.radians(0.5)
# [1] Bounds of estimated speed and phase: five standard errors, doubled as errors of an encoder
# repeat
REACH = 2.0 * 5.0
# [revolutions], [1], [1, of the mean speed] Of a free crank: readings for its speed at the first
# sample, their least number, and the least bounds of that speed
START_TURN, LEAST_OF_START, LEAST_START_REACH = 0.2, 8, 0.02
SPEED_HARMONICS = 6  # Of the Fourier series that estimates the speed of a crank without encoder
SPEED_STEP = 0.02  # [revolutions over the record] An eighth of the period of the sixth harmonic


@dataclass(frozen=True)
class SampleGrid:
    """Samples of one run."""

    time: np.ndarray  # [s], as recorded, or from angle and speed
    read: np.ndarray  # Measured crank angle [rad]; NaN if not measured
    angle: np.ndarray  # Crank angle of the samples [rad] at constant speed, best estimate
    first_angle: float  # Crank angle at the first sample [rad]
    speed: float  # Mean speed [rad/s]
    first_reach: float = 0.0  # Largest error of `first_angle` [rad]
    speed_reach: float = 0.0  # Largest error of `speed` [rad/s]
    timed: bool = True  # Whether times were recorded
    computed: bool = False  # Whether the angles were computed instead of measured
    start: tuple[float, float] | None = None  # Of a free crank: `start_speed`, `start_reach`

    @property
    def encoded(self) -> bool:
        """Whether times and angles were both recorded."""
        return self.timed and bool(np.isfinite(self.read).any())

    @property
    def start_speed(self) -> float:
        """Speed of a free crank at the first sample [rad/s]."""
        return self.start[0] if self.start else self.speed

    @property
    def start_reach(self) -> float:
        """Largest error of `start_speed` [rad/s]."""
        return self.start[1] if self.start else 0.0

    @property
    def elapsed(self) -> np.ndarray:
        """Times since the first sample [s]."""
        return self.time - self.time[0]

    @property
    def turned(self) -> float:
        """Angle turned in the record [rad]."""
        return float(self.angle.max() - self.angle.min())

    def _resampled(self, resample: Callable[[np.ndarray], np.ndarray]) -> "SampleGrid":
        columns = {name: resample(getattr(self, name)) for name in ("time", "read", "angle")}
        return replace(self, **columns)

    def first(self, turned: float) -> "SampleGrid":
        """The samples of the first `turned` [rad]."""
        is_used = self.angle < self.angle[0] + turned
        return self._resampled(lambda values: values[is_used])

    def extended(self, turned: float) -> "SampleGrid":
        """The record, extended uniformly to `turned` [rad] if it is shorter."""
        count = self.time.size
        more = max(math.ceil((turned / self.turned - 1.0) * (count - 1)), 0)
        steps = np.arange(1, more + 1) / (count - 1)
        return self._resampled(
            lambda values: np.append(values, values[-1] + (values[-1] - values[0]) * steps)
        )

    def refined(self, factor: int) -> "SampleGrid":
        """The record with `factor` times as many samples, which include its own."""
        count = self.time.size
        places = np.arange((count - 1) * factor + 1) / factor
        return self._resampled(lambda values: np.interp(places, np.arange(count), values))

    def line(self, angle: np.ndarray) -> tuple[float, float]:
        """First value [rad] and slope [rad/s] of the line through `angle` (n,) [rad] at measured
        angles."""
        finite = np.isfinite(self.read)
        slope, start = np.polyfit(self.elapsed[finite], angle[finite], 1)
        return float(start), float(slope)


def planned_grid(
    speed: float, first_angle: float, encoded: bool, revolutions: int = 4, per_revolution: int = 120
) -> SampleGrid:
    """Samples of a planned run at uniform times: four cycles separate noise from motion, 120
    samples resolve the orders of effects.
    """
    count = revolutions * per_revolution
    elapsed = np.arange(count) * (tau / speed / per_revolution)
    angle = first_angle + speed * elapsed
    return SampleGrid(
        elapsed, angle if encoded else np.full(elapsed.size, np.nan), angle, first_angle, speed
    )


def sample_grid(
    time: np.ndarray,
    read: np.ndarray,
    speed: float,
    first_angle: float | None,
    step: float = 0.0,
    constant: bool = True,
) -> SampleGrid:
    """The samples of a recording whose encoder has the resolution `step` [rad]."""
    finite = np.isfinite(read)
    timed = np.isfinite(time).all()
    if timed and finite.sum() >= 2:
        elapsed = time - time[0]
        slope, first_angle, sd = _robust_line(elapsed[finite], read[finite])
        error = REACH * sd / math.sqrt(finite.sum())
        span = max(np.ptp(elapsed[finite]), 1e-300)
        angle = first_angle + slope * elapsed
        if not constant:
            angle = np.interp(elapsed, elapsed[finite], read[finite])
        # standard errors of a line: first value 2, slope sqrt(12) / span times that of the mean
        first_reach = 2.0 * error + 0.5 * step
        speed_reach = (math.sqrt(12.0) * error + 0.5 * step) / span
        return SampleGrid(time, read, angle, first_angle, slope, first_reach, speed_reach)
    if timed:
        first_angle = first_angle or 0.0
        return SampleGrid(time, read, first_angle + speed * (time - time[0]), first_angle, speed)
    rows = np.arange(read.size)
    slope, start, _ = _robust_line(rows[finite].astype(float), read[finite])
    angle = start + slope * rows
    if np.abs(read - angle)[finite].max() > max(EVEN_ROWS, 2.0 * step):
        angle = np.interp(rows, rows[finite], read[finite])
    return SampleGrid((angle - angle[0]) / speed, read, angle, float(angle[0]), speed, timed=False)


def with_start(grid: SampleGrid, speeds: np.ndarray | None, step: float) -> SampleGrid:
    """The samples of a free crank with its angle and speed at the first one, from a polynomial
    through the first readings of the angle, with the resolution `step` [rad], or of the `speeds`
    (n,) [rad/s]."""
    readings = grid.read if np.isfinite(grid.read).any() else speeds
    begin = np.flatnonzero(np.isfinite(readings))
    early = np.searchsorted(grid.elapsed[begin], START_TURN * tau / grid.speed)
    rows = begin[: max(early, LEAST_OF_START)]
    degree = 3 if readings is grid.read else 2
    powers = np.vander(grid.elapsed[rows], degree + 1, increasing=True)
    weights = np.linalg.lstsq(powers, readings[rows], rcond=None)[0]
    left = readings[rows] - powers @ weights
    variance = float(left @ left) / max(rows.size - degree - 1, 1)
    errors = np.sqrt(variance * np.diag(np.linalg.pinv(powers.T @ powers)))
    place = degree - 2  # of the speed
    speed, reach = float(weights[place]), REACH * float(errors[place])
    reach = min(max(reach, LEAST_START_REACH * grid.speed), 0.5 * grid.speed)
    if not place:
        return replace(grid, start=(speed, reach))
    first_reach = REACH * float(errors[0]) + 0.5 * step
    return replace(
        grid, first_angle=float(weights[0]), first_reach=first_reach, start=(speed, reach)
    )


def channel_rows(elapsed: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Rows (n,) bool of a channel at its own rate, for joined files of several loggers.

    Rows with a value, and those in gaps longer than its median step; all rows of a planned channel.
    """
    is_read = np.isfinite(value)
    rows = np.flatnonzero(is_read)
    if rows.size < 2:
        return np.ones(value.size, bool)
    lapse = np.diff(elapsed[rows])
    between = np.clip(np.searchsorted(rows, np.arange(value.size)) - 1, 0, lapse.size - 1)
    return is_read | (lapse > 1.5 * np.median(lapse))[between]


def _robust_line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Slope, value at 0 and residual standard deviation of a line, without outliers."""
    is_used = np.ones(x.size, bool)
    for _ in range(3):
        slope, start = np.polyfit(x[is_used], y[is_used], 1)
        away = np.abs(y - start - slope * x)
        sd = 1.4826 * np.median(away[is_used])
        is_used = away <= OUTLIER * sd + 1e-9
    return float(slope), float(start), float(np.sqrt(np.mean(away[is_used] ** 2)))


def aperiodic_share(speed: float, elapsed: np.ndarray, values: Sequence[np.ndarray]) -> float:
    """Residual of a Fourier series over `speed` times `elapsed` [1, of the variance], summed over
    channels."""
    angle = np.arange(1, SPEED_HARMONICS + 1) * (speed * elapsed)[:, None]
    series = np.column_stack([np.ones(elapsed.size), np.cos(angle), np.sin(angle)])
    total = 0.0
    for value in values:
        finite = np.isfinite(value)
        x = series[finite]
        centred = value[finite] - value[finite].mean()
        residual = centred - x @ np.linalg.lstsq(x.T @ x, x.T @ centred, rcond=None)[0]
        total += residual @ residual / max(centred @ centred, 1e-300)
    return total


def speed_from_periodicity(
    elapsed: np.ndarray, values: Sequence[np.ndarray], low: float, high: float
) -> float:
    """The speed [rad/s] of a crank without encoder at which channels are most periodic.

    The residual of a Fourier series over the crank angle is minimised over the speed and refined by
    a parabola.
    """
    step = tau * SPEED_STEP / max(elapsed[-1], 1e-300)
    speeds = np.linspace(low, high, max(int(np.ceil((high - low) / step)), 2) + 1)
    misfit = np.array([aperiodic_share(speed, elapsed, values) for speed in speeds])
    best = np.argmin(misfit)
    if not 0 < best < speeds.size - 1:
        return float(speeds[best])
    low_side, lowest, right = misfit[best - 1 : best + 2]
    curvature = low_side - 2.0 * lowest + right
    shift = 0.5 * (low_side - right) / curvature if curvature > 0.0 else 0.0
    return float(speeds[best] + shift * (speeds[1] - speeds[0]))
