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
        return cls(
            output,
            float(angle[0]),
            training=Points.of(angle[is_training], values[is_training]),
            held_out=Points.of(angle[~is_training], values[~is_training]),
        )


def error_frame(
    grid: Grid,
    fit: Function,
    training: Points,
    columns: dict[str, object],
    fit_at_paper: Function | None,
) -> pd.DataFrame:
    """The table fit_errors, a row per region; `columns` are model, seed, weights, iterations, stop,
    iterations_to_paper.

    `fit_at_paper`: fit of the iteration at which the training error first reached the paper's.
    """
    scale = Scaling.of(grid.training.values).range
    spline = CubicSpline(training.crank_angle, training.values)
    further_fits = {
        "smoothing_spline_held_out_mse": smoothing_spline(training),
        "held_out_mse_at_paper": fit_at_paper,
    }
    rows = []
    for region, begin in REGIONS.items():
        inside, held_out = training, grid.held_out
        if begin > 0.0:
            inside = inside.past(grid.start_angle + begin)
            held_out = held_out.past(grid.start_angle + begin)
        errors = fit(held_out.crank_angle) - held_out.values
        row = columns | {
            "output": grid.output,
            "unit": UNITS[grid.output],
            "region": region,
            "training_points": len(inside.values),
            "held_out_points": len(held_out.values),
            "undefined_points": inside.undefined + held_out.undefined,
            "range": scale,
            "paper_mse": TRAINING_MSE.get(grid.output),
            "held_out_peak": float(np.max(np.abs(errors))) / scale,
        }
        for name, points, square in (
            ("training", inside, inside.square(fit)),
            ("held_out", held_out, held_out.mean(errors**2)),
            ("spline_held_out", held_out, held_out.square(spline)),
        ):
            row[f"{name}_mse"] = square / scale**2
            row[f"{name}_rms"] = square**0.5
            row[f"{name}_mse_over_variance"] = square / points.variance
        for name, further_fit in further_fits.items():
            row[name] = further_fit and held_out.square(further_fit) / scale**2
        rows.append(row)
    numbers = dict.fromkeys(("paper_mse", *further_fits), "float64")  # null where there is none
    return pd.DataFrame(rows).astype(numbers | {"iterations_to_paper": "Int64"})


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
        is_new = (between > indices[:-1]) & (between < indices[1:]) & defined[between]
        between = between[is_new]
        interpolated = CubicSpline(angle[indices], values[indices])(angle[between])
        is_missed = np.abs(interpolated - values[between]) > tolerance
        if not is_missed.any():
            return indices
        indices = np.union1d(indices, between[is_missed])
