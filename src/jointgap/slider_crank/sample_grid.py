"""Where in time and crank angle the samples of a run lie, as far as the record itself tells."""

import math
from dataclasses import dataclass, replace

import numpy as np

from jointgap.errors import InputError

TURN = 2.0 * math.pi
PLANNED_REVOLUTIONS, PLANNED_PER_REVOLUTION = 4, 120
"""Samples of a run that is yet to be measured."""

MOST_PLANNED = 60
"""Revolutions at most of a chaotic run that is planned as long as it was recorded: of more, the simulated ones are what limits."""

_OUTLIER = 5.0  # robust standard deviations beyond which a reading of the angle is taken for an outlier
_STEADY = math.radians(0.5)  # angles that keep this near a line over their rows were sampled evenly in time
_REACH = 5.0  # standard errors that an estimated speed or phase may be off
_MEMORY = 2.0  # standard errors are larger than those of independent readings by about this


@dataclass(frozen=True)
class SampleGrid:
    """Samples of one run.

    Attributes
    ----------
    time : (n,) array
        [s], as recorded, or from angle and speed.
    read : (n,) array
        Crank angle as read [rad]; NaN where it was not.
    angle : (n,) array
        Crank angle of the samples [rad] at constant speed, about as true as the record allows.
    first_angle, speed : float
        Crank angle at the first sample [rad] and mean speed [rad/s]: estimated, or as the campaign states them.
    first_reach, speed_reach : float
        How far these estimates may be off; 0 where there is nothing to estimate them from.
    timed : bool
        Whether times were recorded; else samples lie at angles.
    """

    time: np.ndarray
    read: np.ndarray
    angle: np.ndarray
    first_angle: float
    speed: float
    first_reach: float
    speed_reach: float
    timed: bool

    @property
    def encoded(self) -> bool:
        """Whether times and angles were both recorded: the mean speed follows from them."""
        return self.timed and bool(np.isfinite(self.read).any())

    @property
    def elapsed(self) -> np.ndarray:
        """Times since the first sample [s]."""
        return self.time - self.time[0]

    @property
    def turned(self) -> float:
        """How far the crank turns in the record [rad]."""
        return float(self.angle.max() - self.angle.min())

    def first(self, turned: float) -> "SampleGrid":
        """The record's samples until the crank has `turned` [rad]."""
        kept = self.angle < self.angle[0] + turned
        return replace(self, time=self.time[kept], read=self.read[kept], angle=self.angle[kept])

    def line(self, angle: np.ndarray) -> tuple[float, float]:
        """Value at the first sample and slope over time of the straight line through `angle` where the angle was read."""
        known = np.isfinite(self.read)
        slope, first = np.polyfit(self.elapsed[known], angle[known], 1)
        return float(first), float(slope)


def planned_grid(speed: float, first_angle: float, encoded: bool, revolutions: int = PLANNED_REVOLUTIONS) -> SampleGrid:
    """Samples of a run that is yet to be measured, at even times."""
    elapsed = np.arange(revolutions * PLANNED_PER_REVOLUTION) * (TURN / speed / PLANNED_PER_REVOLUTION)
    angle = first_angle + speed * elapsed
    return SampleGrid(
        elapsed, angle if encoded else np.full(elapsed.size, np.nan), angle, first_angle, speed, 0.0, 0.0, True
    )


def sample_grid(
    time: np.ndarray,
    read: np.ndarray,
    speed: float,
    first_angle: float | None,
    resolution: float = 0.0,
    constant: bool = True,
) -> SampleGrid:
    """The samples of a recording.

    Parameters
    ----------
    time, read : (n,) arrays
        As `jointgap.recordings` reads them [s], [rad]; all NaN where not recorded.
    speed : float
        Nominal [rad/s].
    first_angle : float or None
        Stated crank angle at the first sample [rad]; None where it has to be found.
    resolution : float
        Step of the encoder [rad].
    constant : bool
        Whether the crank turns at constant speed, so that readings of its angle may be averaged.

    Raises
    ------
    InputError
        Neither times nor angles.
    """
    known, timed = np.isfinite(read), bool(np.isfinite(time).all())
    if timed and known.sum() >= 2:
        elapsed = time - time[0]
        slope, first, sd = _robust_line(elapsed[known], read[known])
        error = _MEMORY * _REACH * sd / math.sqrt(known.sum())
        reach = 2.0 * error + 0.5 * resolution
        span = max(float(np.ptp(elapsed[known])), 1e-300)
        angle = first + slope * elapsed
        if not constant:
            angle = np.interp(elapsed, elapsed[known], read[known])
        return SampleGrid(
            time, read, angle, first, slope, reach, (math.sqrt(12.0) * error + 0.5 * resolution) / span, True
        )
    if timed:
        first = first_angle or 0.0
        return SampleGrid(time, read, first + speed * (time - time[0]), first, speed, 0.0, 0.0, True)
    if known.sum() < 2:
        raise InputError("a run has neither times nor crank angles; give the column of one of them")
    rows = np.arange(read.size)
    slope, start, _ = _robust_line(rows[known].astype(float), read[known])
    angle = start + slope * rows
    if np.abs(read - angle)[known].max() > max(_STEADY, 2.0 * resolution):
        angle = np.interp(rows, rows[known], read[known])
    return SampleGrid((angle - angle[0]) / speed, read, angle, float(angle[0]), speed, 0.0, 0.0, False)


def _robust_line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Slope, value at 0 and residual standard deviation of a straight line, outliers left out."""
    kept = np.ones(x.size, bool)
    for _ in range(3):
        slope, first = np.polyfit(x[kept], y[kept], 1)
        away = np.abs(y - first - slope * x)
        sd = 1.4826 * float(np.median(away[kept]))
        kept = away <= _OUTLIER * sd + 1e-9
    return float(slope), float(first), float(np.sqrt(np.mean(away[kept] ** 2)))
