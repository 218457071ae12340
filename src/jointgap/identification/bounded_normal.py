"""What data and bounds together say of the parameters of a fit: a normal distribution, cut off at the bounds.

Near its minimum chi2 is a quadratic function of the parameters, and the bounds are flat inside. Where the minimum lies
at a bound, chi2 has a slope there: the parameter is known to one side, and what it may be counts for all others. The
distribution is drawn from by Gibbs' sampler, along the parameters, the axes of chi2 and those of the distribution in
turn (S. Geman and D. Geman, IEEE Trans. Pattern Anal. Mach. Intell. 6 (1984) 721-741); no simulation is needed.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from jointgap.identification.settings import DEFAULT_SETTINGS, IntervalSettings


@dataclass(frozen=True)
class BoundedNormal:
    """A normal distribution of k parameters within bounds."""

    covariance: np.ndarray  # [SI] Within the bounds; zero rows of parameters of which nothing is known
    draws: np.ndarray | None = None  # Drawn from the distribution [SI]


def bounded_normal(
    jacobian: np.ndarray,
    slope: np.ndarray,
    inflation: float,
    values: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    shifts: np.ndarray,
    settings: IntervalSettings = DEFAULT_SETTINGS.intervals,
) -> BoundedNormal:
    """The distribution around the minimum of ``|residual|^2`` within bounds, of residuals that are linear there."""
    length, width = np.linalg.norm(jacobian, axis=0), high - low
    live = (width > 0) & ((length > 0) | np.isfinite(width))
    covariance = np.zeros((values.size, values.size))
    if not live.any():
        return BoundedNormal(covariance)
    unit = np.where(length > 0, 1.0 / np.where(length > 0, length, 1.0), width)[live]
    _, singular_values, right = np.linalg.svd(jacobian[:, live] * unit, full_matrices=False)
    if singular_values.size < unit.size:  # fewer residuals than parameters
        right = np.linalg.svd(jacobian[:, live] * unit)[2]
        singular_values = np.append(singular_values, np.zeros(unit.size - singular_values.size))
    singular_values = np.maximum(singular_values, settings.least_singular_value * max(singular_values[0], 1e-300))
    # In the axes of chi2 the data have the variance `inflation`, and what shifts the values adds to it.
    changed = singular_values[:, None] * (right @ (shifts[:, live] / unit).T)
    variance = inflation * np.eye(unit.size) + changed @ changed.T
    inverse = right.T / singular_values
    free = inverse @ variance @ inverse.T
    below, above = (low - values)[live] / unit, (high - values)[live] / unit
    sd = np.sqrt(np.diag(free))
    places = np.ix_(live, live)
    if np.all(np.minimum(-below, above) > settings.far_standard_deviations * sd):
        covariance[places] = free * np.outer(unit, unit)
        return BoundedNormal(covariance)
    slope = slope[live] * unit
    outwards = ((below >= 0) & (slope > 0)) | ((above <= 0) & (slope < 0))
    beyond = np.linalg.solve(variance, (right @ np.where(outwards, slope, 0.0)) / singular_values)
    precision = (right.T * singular_values) @ np.linalg.solve(variance, singular_values[:, None] * right)
    pull = -right.T @ (singular_values * beyond)
    axes = np.vstack([np.eye(unit.size), right])
    if shifts.any():  # they turn the axes of the distribution out of those of chi2
        axes = np.vstack([axes, np.linalg.eigh(free)[1].T])
    drawn = _gibbs(precision, pull, np.minimum(below, 0.0), np.maximum(above, 0.0), axes, settings) * unit
    covariance[places] = np.atleast_2d(np.cov(drawn, rowvar=False))
    draws = np.tile(values, (len(drawn), 1))
    draws[:, live] = np.clip(values[live] + drawn, low[live], high[live])
    return BoundedNormal(covariance, draws)


def _gibbs(
    precision: np.ndarray,
    pull: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    axes: np.ndarray,
    settings: IntervalSettings,
) -> np.ndarray:
    """Draws (s, k) of the density exp(pull x - x precision x / 2) from `low` to `high` (k,), along `axes` (a, k)."""
    generator = np.random.default_rng(0)
    least = 1e-12 * np.trace(precision)  # of what changes nothing, rounding may leave less than none
    x = np.zeros((settings.chains, low.size))
    kept = []
    for sweep in range(settings.settling_sweeps + settings.sweeps):
        for axis in axes:
            curvature = max(float(axis @ precision @ axis), least)
            moving = np.abs(axis) > 1e-12  # beyond the rounding of axes of length 1
            with np.errstate(invalid="ignore"):
                ends = (low - x)[:, moving] / axis[moving], (high - x)[:, moving] / axis[moving]
            begin, end = np.minimum(*ends).max(axis=1), np.maximum(*ends).min(axis=1)
            mean = (pull @ axis - x @ (precision @ axis)) / curvature
            x = x + _cut_normal(generator, mean, curvature**-0.5, begin, end)[:, None] * axis
            x = np.clip(x, low, high)
        if sweep >= settings.settling_sweeps:
            kept.append(x)
    return np.concatenate(kept)


def _cut_normal(
    generator: np.random.Generator, mean: np.ndarray, sd: float, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Normal numbers of `mean` (c,) and `sd` from `low` to `high` (c,): the inverse of the distribution function."""
    a, b = (low - mean) / sd, (high - mean) / sd
    turned = a > -b  # in the left tail small probabilities are exact
    a, b = np.where(turned, -b, a), np.where(turned, -a, b)
    log_a, log_b = log_ndtr(a), log_ndtr(b)
    share = generator.random(mean.size)
    z = ndtri_exp(np.minimum(log_b + np.log(share + (1.0 - share) * np.exp(log_a - log_b)), 0.0))
    z = np.clip(z, a, np.maximum(b, a))
    return mean + sd * np.where(turned, -z, z)
