"""Samples at which a fit is trained and judged, and the splines it is compared with."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline, make_smoothing_spline

from jointgap.core.errors import InputError

REGIONS = {"all": 0.0, "past_60_deg": np.radians(60.0)}
"""First crank angle of each region after the start; the paper's transient ends before 60 deg."""

NETWORK, REGULARISED = "network", "regularised"
"""Models in the tables: the paper's network and the regularised one."""

# strengths of a smoothing spline, over the cube of the mean distance of the points
_STRENGTHS = 10.0 ** np.arange(-8.0, 3.0, 2.0)
_HELD_OUT_EVERY = 3  # points, to select a strength

Function = Callable[[np.ndarray], np.ndarray]
"""A fit: from crank angles (n,) [rad] to values (n,)."""


@dataclass(frozen=True)
class Points:
    """Crank angles [rad] and values of one output; undefined points are removed and counted.

    ``shares`` are the relative parts of the revolution that the points represent; None: equal.
    """

    crank_angle: np.ndarray
    values: np.ndarray
    undefined: int = 0
    shares: np.ndarray | None = None

    @classmethod
    def of(cls, crank_angle: np.ndarray, values: np.ndarray) -> "Points":
        """Points of the samples that are defined."""
        defined = np.isfinite(values)
        return cls(crank_angle[defined], values[defined], int(np.sum(~defined)))

    def mean(self, quantity: np.ndarray) -> float:
        """Mean over the revolution of a quantity (n,) at the points."""
        return float(np.average(quantity, weights=self.shares))

    def square(self, fit: Function) -> float:
        """Mean square error of a fit at the points."""
        return self.mean((fit(self.crank_angle) - self.values) ** 2)

    @property
    def variance(self) -> float:
        return self.mean((self.values - self.mean(self.values)) ** 2)

    def past(self, angle: float) -> "Points":
        """The points from an angle [rad] on, all defined."""
        inside = self.crank_angle >= angle
        shares = None if self.shares is None else self.shares[inside]
        return Points(self.crank_angle[inside], self.values[inside], 0, shares)


def split_samples(
    trajectory: pd.DataFrame, output: str, training_points: int
) -> tuple[Points, Points]:
    """Training points of one output, every k-th sample of the first revolution, both ends included,
    and the held-out other samples."""
    angle = trajectory["crank_angle"].to_numpy()
    angle = angle[angle - angle[0] <= 2.0 * np.pi * (1.0 + 1e-9)]
    values = trajectory[output].to_numpy()[: len(angle)]
    stride, remainder = divmod(len(angle) - 1, training_points - 1)
    if remainder or stride < 2:
        raise InputError(
            f"surrogate.training_points {training_points} does not match {len(angle) - 1}"
            " samples per revolution; set simulate.samples_per_revolution to a multiple, at"
            f" least twice, of {training_points - 1}"
        )
    is_training = np.arange(len(angle)) % stride == 0
    return tuple(Points.of(angle[part], values[part]) for part in (is_training, ~is_training))


def smoothing_spline(training: Points) -> Function | None:
    """Smoothing spline of points, with the smoothness that is best at every third point; None below
    fifteen points.

    The default of `make_smoothing_spline`, generalised cross-validation, smooths exact samples a
    thousand times too much.
    """
    x, y = training.crank_angle, training.values
    if len(x) < 5 * _HELD_OUT_EVERY:
        return None
    is_held_out = np.arange(len(x)) % _HELD_OUT_EVERY == 1
    held_out = Points(x[is_held_out], y[is_held_out], shares=np.gradient(x)[is_held_out])

    def error(strength: float) -> float:
        fit = make_smoothing_spline(x[~is_held_out], y[~is_held_out], lam=strength)
        return held_out.square(fit)

    strengths = _STRENGTHS * np.diff(x).mean() ** 3
    return make_smoothing_spline(x, y, lam=min(strengths, key=error))


def refined(
    angle: np.ndarray, values: np.ndarray, indices: np.ndarray, tolerance: float
) -> np.ndarray:
    """`indices` of samples, plus those of samples whose interpolation error exceeds `tolerance`;
    increasing. Undefined values are skipped."""
    defined = np.isfinite(values)
    while True:
        between = (indices[:-1] + indices[1:]) // 2
        between = np.where(defined[between], between, between + 1)
        is_new = (between > indices[:-1]) & (between < indices[1:])
        between = between[is_new & defined[between]]
        interpolated = CubicSpline(angle[indices], values[indices])(angle[between])
        is_missed = np.abs(interpolated - values[between]) > tolerance
        if not is_missed.any():
            return indices
        indices = np.union1d(indices, between[is_missed])
