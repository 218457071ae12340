"""Errors of a fit: samples, regions and scaling."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline, make_smoothing_spline

from jointgap.core.errors import InputError
from jointgap.core.schema import TRAJECTORY
from jointgap.networks.network import Scaling
from jointgap.paper.printed import TRAINING_MSE

UNITS = {column.name: column.unit for column in TRAJECTORY.columns}
REGIONS = {"all": 0.0, "past_60_deg": np.radians(60.0)}
"""First crank angle of each region after the start; the paper's transient ends before 60 deg."""

NETWORK, REGULARISED = "network", "regularised"
"""Models in the tables: the paper's network and the regularised one."""

_SMOOTHING = 10.0 ** np.arange(
    -8.0, 3.0, 2.0
)  # parameters of a smoothing spline, over the cube of the mean distance
_LEFT_OUT = 3  # every third point is held out to select one


@dataclass(frozen=True)
class Points:
    """Crank angles [rad] and values of one output; undefined points are removed and counted.

    ``shares`` are the relative parts of the revolution that the points represent; None: equal.
    """

    crank_angle: np.ndarray
    values: np.ndarray
    undefined: int = 0
    shares: np.ndarray | None = None

    def mean(self, quantity: np.ndarray) -> float:
        """Mean over the revolution of a quantity (n,) at the points."""
        return float(np.average(quantity, weights=self.shares))

    def square(self, fit: Callable[[np.ndarray], np.ndarray]) -> float:
        """Mean square error of a fit at the points."""
        return self.mean((fit(self.crank_angle) - self.values) ** 2)

    @property
    def variance(self) -> float:
        return self.mean((self.values - self.mean(self.values)) ** 2)

    @classmethod
    def of(cls, crank_angle: np.ndarray, values: np.ndarray) -> "Points":
        """Points of the samples that are defined."""
        defined = np.isfinite(values)
        return cls(crank_angle[defined], values[defined], int(np.sum(~defined)))

    def past(self, angle: float) -> "Points":
        """The points from an angle [rad] on, all defined."""
        inside = self.crank_angle >= angle
        shares = None if self.shares is None else self.shares[inside]
        return Points(self.crank_angle[inside], self.values[inside], 0, shares)


@dataclass(frozen=True)
class Grid:
    """One output over the first revolution, split into training points and held-out samples."""

    output: str
    start_angle: float
    training: Points
    held_out: Points

    @classmethod
    def of(cls, trajectory: pd.DataFrame, output: str, training_points: int) -> "Grid":
        """Every k-th sample of the first revolution, both ends included, is a training point;
        others are held out."""
        angle = trajectory["crank_angle"].to_numpy()
        first = angle - angle[0] <= 2.0 * np.pi * (1.0 + 1e-9)
        angle, values = angle[first], trajectory[output].to_numpy()[first]
        stride, remainder = divmod(len(angle) - 1, training_points - 1)
        if remainder or stride < 2:
            raise InputError(
                f"surrogate.training_points {training_points} does not match {len(angle) - 1}"
                " samples per revolution; set simulate.samples_per_revolution to a multiple, at"
                f" least twice, of {training_points - 1}"
            )
        trains = np.arange(len(angle)) % stride == 0
        split = (Points.of(angle[part], values[part]) for part in (trains, ~trains))
        return cls(output, float(angle[0]), *split)


def error_rows(
    grid: Grid,
    predict: Callable[[np.ndarray], np.ndarray],
    training: Points,
    trained: dict[str, object],
    at_paper: Callable[[np.ndarray], np.ndarray] | None = None,
) -> list[dict[str, object]]:
    """Rows of the table fit_errors, one per region; `trained` has the columns model, seed, weights,
    iterations, stop.

    `at_paper`: prediction at the iteration where the training error first reached the paper's.
    """
    scale = Scaling.of(grid.training.values).range
    spline = CubicSpline(training.crank_angle, training.values)
    smoothing = smoothing_spline(training)
    rows = []
    for region, first in REGIONS.items():
        within, outside = training, grid.held_out
        if first > 0.0:
            within, outside = (
                points.past(grid.start_angle + first) for points in (within, outside)
            )
        unseen = predict(outside.crank_angle) - outside.values
        row = {"iterations_to_paper": None} | trained
        row |= {
            "output": grid.output,
            "unit": UNITS[grid.output],
            "region": region,
            "training_points": len(within.values),
            "held_out_points": len(outside.values),
            "undefined_points": within.undefined + outside.undefined,
            "range": scale,
            "paper_mse": TRAINING_MSE.get(grid.output),
            "held_out_peak": float(np.max(np.abs(unseen))) / scale,
        }
        for name, points, square in (
            ("training", within, within.square(predict)),
            ("held_out", outside, outside.mean(unseen**2)),
            ("spline_held_out", outside, outside.square(spline)),
        ):
            row[f"{name}_mse"] = square / scale**2
            row[f"{name}_rms"] = square**0.5
            row[f"{name}_mse_over_variance"] = square / points.variance
        for name, other in (
            ("smoothing_spline_held_out_mse", smoothing),
            ("held_out_mse_at_paper", at_paper),
        ):
            row[name] = other and outside.square(other) / scale**2
        rows.append(row)
    return rows


def error_frame(rows: list[dict[str, object]]) -> pd.DataFrame:
    """Rows of the table fit_errors as a frame; missing numbers remain missing."""
    of_numbers = ("held_out_mse_at_paper", "paper_mse", "smoothing_spline_held_out_mse")
    types = {"seed": "Int64", "iterations_to_paper": "Int64"} | dict.fromkeys(of_numbers, "float64")
    return pd.DataFrame(rows).astype(types)


def smoothing_spline(training: Points) -> Callable[[np.ndarray], np.ndarray] | None:
    """Smoothing spline of points, with the smoothness that is best at every third point; None below
    fifteen points.

    The default of `make_smoothing_spline`, generalised cross-validation, smooths exact samples a
    thousand times too much.
    """
    x, y = training.crank_angle, training.values
    if len(x) < 5 * _LEFT_OUT:
        return None
    left_out = np.arange(len(x)) % _LEFT_OUT == 1
    judged = Points(x[left_out], y[left_out], shares=np.gradient(x)[left_out])

    def missed(strength: float) -> float:
        return judged.square(make_smoothing_spline(x[~left_out], y[~left_out], lam=strength))

    return make_smoothing_spline(x, y, lam=min(_SMOOTHING * np.diff(x).mean() ** 3, key=missed))


def refined(
    angle: np.ndarray, table: np.ndarray, kept: np.ndarray, usable: np.ndarray, missed: float
) -> np.ndarray:
    """Indices `kept`, plus those of samples with an interpolation error above `missed`;
    increasing."""
    while True:
        between = (kept[:-1] + kept[1:]) // 2
        between = np.where(usable[between], between, between + 1)
        between = between[(between > kept[:-1]) & (between < kept[1:]) & usable[between]]
        errors = np.abs(CubicSpline(angle[kept], table[kept])(angle[between]) - table[between]).max(
            axis=1
        )
        if not (errors > missed).any():
            return kept
        kept = np.union1d(kept, between[errors > missed])
