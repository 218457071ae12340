"""Straight line through values of which the scatter is unknown."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri, stdtr, stdtrit

_LEAST_SCALE = 1e-3  # [1] of the stated errors: values that agree better agree by rounding


class Line(NamedTuple):
    """Slope of a line with its error."""

    slope: float
    low: float  # of the 90 % interval of the slope
    high: float
    first: float  # value at x = 0
    p: float  # probability [1] of so large a slope, of either sign, of a level line
    error_scale: float  # scatter about the line over the stated errors [1]; 1 for two points


def fit_line(x: np.ndarray, y: np.ndarray, errors: np.ndarray) -> Line:
    """Line through two points or more by weighted least squares.

    The stated `errors` are weights; the size of the scatter is that of the n - 2 residuals, so that
    interval and probability are those of Student's distribution. If the values scatter more than
    stated, the further variance is taken as equal for all points (Paule and Mandel, J. Res. NBS 87
    (1982) 377), as errors that differ otherwise give the wrong weights. Through two points the
    stated errors hold.
    """
    free = x.size - 2
    slope, variance, first, chi2 = _weighted(x, y, errors, 0.0)
    if not free:
        error, scale, quantile = variance**0.5, 1.0, ndtri(0.95)
        p = 2.0 * ndtr(-abs(slope) / error)
    else:
        scale = (chi2 / free) ** 0.5
        if scale > 1.0:
            most = (
                2.0 * _weighted(x, y, np.ones(x.size), 0.0)[3] / free
            )  # with it chi2 is below n - 2
            added = brentq(
                lambda more: _weighted(x, y, errors, more)[3] - free,
                0.0,
                most,
                xtol=1e-12 * most,
                rtol=1e-6,
            )
            slope, variance, first, chi2 = _weighted(x, y, errors, added)
        error, quantile = (variance * max(chi2 / free, _LEAST_SCALE**2)) ** 0.5, stdtrit(free, 0.95)
        p = 2.0 * stdtr(free, -abs(slope) / error)
    half_width = float(quantile) * error
    return Line(slope, slope - half_width, slope + half_width, first, float(p), scale)


def _weighted(
    x: np.ndarray, y: np.ndarray, errors: np.ndarray, added: float
) -> tuple[float, float, float, float]:
    """Slope, its variance, value at 0 and chi2 with the variance `added` to that of all points."""
    weight = 1.0 / (errors**2 + added)
    centre, mean = weight @ x / weight.sum(), weight @ y / weight.sum()
    away = x - centre
    variance = 1.0 / float(weight @ away**2)
    slope = float(weight @ (away * y)) * variance
    return (
        slope,
        variance,
        float(mean - slope * centre),
        float(weight @ (y - mean - slope * away) ** 2),
    )
