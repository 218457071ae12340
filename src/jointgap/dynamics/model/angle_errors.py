"""How far off a smooth crank angle may be, by the noise of the readings that it was made from.

Once knots and smoothness are chosen, smoothing is linear in the readings: error = H noise. So it is a sum of few
independent errors, each a smooth function of time by which a drive can be moved.
"""

import math

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, PPoly
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.sparse import sparray

from jointgap.dynamics.model.measured_drive import repeated_basis

_MOST_KNOTS = 400  # of the splines that stand for those of the smoothing, which has one at every sample
_LEFT_OUT = 1e-3  # share of their variance, by angle, speed and acceleration, that errors too small to count have
_MOST_ERRORS = 100


class AngleErrors:
    """The independent errors of a smooth angle, each of one standard deviation."""

    def __init__(
        self,
        time: np.ndarray,
        angle: np.ndarray,
        smooth: PPoly,
        stepped: bool,
        copies: sparray,
        noise: float | None,
        common: np.ndarray | None = None,
    ):
        degree = 5 if stepped else 3
        inner = smooth.x[1:-1] if stepped else time[2 : -2 : math.ceil(time.size / _MOST_KNOTS)]
        knots = np.concatenate([[time[0]] * (degree + 1), inner, [time[-1]] * (degree + 1)])
        self._spline = BSpline(knots, np.eye(knots.size - degree - 1), degree)
        drift, orders = (np.empty((time.size, 0)),) * 2 if stepped else repeated_basis(time, angle)
        self._orders = CubicSpline(time, orders) if orders.size else None
        told = np.linalg.pinv(np.hstack([drift, orders]))[drift.shape[1] :]  # sizes of the orders, from angles
        basis, left = self._spline(time), smooth(time) - angle
        bending = None if stepped else self._bending()
        kept, shapes = _shrinkage(basis, bending, angle - orders @ (told @ angle), left)
        spline = (shapes * kept) @ (basis @ shapes).T
        if noise is None:
            noise = math.sqrt(left @ left / max(time.size - kept.sum() - orders.shape[1], 1.0))
        sizes = (copies.T @ np.vstack([spline - (spline @ orders) @ told, told]).T).T  # from readings
        covariance = noise**2 * (sizes @ sizes.T)
        if common is not None:
            covariance += (sizes @ common) @ (sizes @ common).T
        self._weights = self._independent(time, covariance, (angle[-1] - angle[0]) / (time[-1] - time[0]))

    @property
    def count(self) -> int:
        """How many errors."""
        return self._weights.shape[1]

    def __call__(self, time: np.ndarray, derivative: int = 0) -> np.ndarray:
        """The errors (n, count) at times (n,) [s], or a derivative of theirs by time [rad/s^derivative]."""
        return self._basis(time, derivative) @ self._weights

    def _basis(self, time: np.ndarray, derivative: int) -> np.ndarray:
        columns = self._spline(time, derivative)
        return columns if self._orders is None else np.hstack([columns, self._orders(time, derivative)])

    def _bending(self) -> np.ndarray:
        """Rows whose sum of squares is the integral of a spline's squared second derivative, by two Gauss points."""
        ends = np.unique(self._spline.t)
        half, middle = np.diff(ends) / 2, (ends[1:] + ends[:-1]) / 2
        points = np.concatenate([middle - half / math.sqrt(3), middle + half / math.sqrt(3)])
        return np.sqrt(np.tile(half, 2))[:, None] * self._spline(points, 2)

    def _independent(self, time: np.ndarray, covariance: np.ndarray, speed: float) -> np.ndarray:
        """Weights of the basis for each error; the largest come first, in angle, speed and acceleration together."""
        rows = [self._basis(time, derivative) / speed**derivative for derivative in range(3)]
        squares, vectors = np.linalg.eigh(sum(each.T @ each for each in rows))
        root = (vectors * np.sqrt(np.maximum(squares, 0.0))) @ vectors.T
        squares, vectors = np.linalg.eigh(root @ covariance @ root)
        left = np.cumsum(np.maximum(squares, 0.0))
        chosen = np.flatnonzero(left > _LEFT_OUT * left[-1])[::-1][:_MOST_ERRORS]
        return covariance @ root @ (vectors[:, chosen] / np.sqrt(squares[chosen]))


def _shrinkage(basis, bending, angle, left) -> tuple[np.ndarray, np.ndarray]:
    """What smoothing keeps (k,) of each of the spline's independent shapes, and their weights (k, k) of the basis.

    Without bending all is kept; else as much as leaves of the angle what the smoothing has left.
    """
    gram = basis.T @ basis
    rough = np.zeros(gram.shape) if bending is None else bending.T @ bending
    roughness, vectors = eigh(rough, gram)
    if bending is None:
        return np.ones(roughness.size), vectors
    roughness[:2] = 0.0  # of straight lines
    sizes = vectors.T @ (basis.T @ angle)
    unreached = angle - basis @ (vectors @ sizes)
    excess_alone = unreached @ unreached - left @ left

    def excess(log_smoothness: float) -> float:
        return float(excess_alone + np.sum(((1.0 - kept(log_smoothness)) * sizes) ** 2))

    def kept(log_smoothness: float) -> np.ndarray:
        return 1.0 / (1.0 + math.exp(log_smoothness) * roughness)

    smoothest, roughest = -math.log(roughness[2]) + 10.0, -math.log(roughness[-1]) - 5.0
    if excess(smoothest) <= 0.0:
        return kept(smoothest), vectors
    return kept(roughest if excess(roughest) >= 0.0 else brentq(excess, roughest, smoothest)), vectors
