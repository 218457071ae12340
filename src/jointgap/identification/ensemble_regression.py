"""What chaotic motion says of the parameters of a fit: a regression over an ensemble of simulations.

Motion that never repeats is met by its statistics, and each simulation of it is one realisation: a derivative from two
of them is mostly their scatter, and chi2 scatters by more than parameters change it near its minimum. So points are
drawn about the fit, some standard errors wide, and the whitened residuals of all are regressed on the parameters at
once. The scatter averages out of the slopes, which also hold over the width that counts (statistical linearisation; an
iterative ensemble smoother without localisation: Y. Chen and D. S. Oliver, Comput. Geosci. 17 (2013) 689-703). What the
regression leaves is the scatter itself. It goes together over a whole run, some of its modes far louder than noise, so
that parameters which move the motion along such a mode are known no better than the rig's own realisation scatters: the
covariance of what is left is I + S, of noise and this scatter (generalised least squares, A. C. Aitken, Proc. R. Soc.
Edinb. 55 (1936) 42-48); that of the simulated realisations averages out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from jointgap.errors import InputError, SimulationError
from jointgap.identification.bounded_normal import BoundedNormal, bounded_normal
from jointgap.identification.fit import FAILED, Fit, bounds_of
from jointgap.identification.gauss_newton import bounded_step
from jointgap.identification.nesting import with_nuisances_of
from jointgap.identification.problem import Problem
from jointgap.identification.settings import EnsembleSettings


@dataclass(frozen=True)
class _Scatter:
    """Modes (n, m) of what realisations differ by, orthonormal, and their variances (m,) [1, of that of noise]."""

    modes: np.ndarray
    variances: np.ndarray

    @classmethod
    def of(cls, left: np.ndarray, degrees_of_freedom: int, settings: EnsembleSettings) -> "_Scatter":
        """Of what a regression leaves of realisations (members, n)."""
        try:
            _, singular_values, right = np.linalg.svd(left, full_matrices=False)
        except np.linalg.LinAlgError:  # divide and conquer gives up now and then; what is slower does not
            _, singular_values, right = scipy.linalg.svd(left, full_matrices=False, lapack_driver="gesvd")
        variances = singular_values**2 / degrees_of_freedom
        counted = variances > settings.least_variance
        return cls(right[counted].T, variances[counted])

    def whiten(self, values: np.ndarray) -> np.ndarray:
        """Values (n,) or (n, k) that are whitened for noise, for noise and scatter."""
        removed = 1.0 - 1.0 / np.sqrt(1.0 + self.variances)
        return values - (self.modes * removed) @ (self.modes.T @ values)


def leading_over_ensembles(problem: Problem, base: Fit, fits: Sequence[Fit]) -> tuple[Fit, list[Fit]]:
    """The base and the fits, those that lead regressed over ensembles: chi2 of a single realisation scatters by more
    than explanations differ. The base too, from the nuisances of the best fit as well: it must not lose by having
    worse ones. All others that are better than the base leave the mean of as many realisations, so that all are
    measured alike.
    """
    settings = problem.settings.ensemble
    single = base if base.draws is None else _with_single_residual(problem, base)
    better = sorted((fit for fit in fits if fit.status != FAILED and fit.bic < single.bic), key=lambda fit: fit.bic)
    if not better:
        return base, list(fits)
    most = single.bic - settings.leading_share * (single.bic - better[0].bic)
    leading = [fit for fit in better[: settings.leading] if fit.bic <= most]
    due = {id(fit) for fit in (base, *leading) if fit.draws is None}
    others = {id(fit) for fit in better if fit.draws is None} - due
    base, *fits = (
        regressed_over_ensemble(problem, fit)
        if id(fit) in due
        else _with_mean_residual(problem, fit)
        if id(fit) in others
        else fit
        for fit in (base, *fits)
    )
    best = min((fit for fit in fits if fit.status != FAILED), key=lambda fit: fit.bic)
    if due and best.bic < base.bic:
        # an effect that replaces a nuisance goes beyond its bounds, the base does not
        values = np.clip(list(with_nuisances_of(problem, base, best).values()), *bounds_of(base.parameters))
        base = min(base, regressed_over_ensemble(problem, replace(base, values=values)), key=lambda fit: fit.chi2)
    return base, fits


def _with_single_residual(problem: Problem, fit: Fit) -> Fit:
    """The fit with the residual of one realisation; as it was where that cannot be simulated."""
    try:
        return replace(fit, residual=problem.residual(fit.mapping, fit.hypothesis))
    except (InputError, SimulationError):
        return fit


def _with_mean_residual(problem: Problem, fit: Fit) -> Fit:
    """The fit with the mean of some realisations as its residual; as it was where none can be simulated."""
    live = _drawn_parameters(fit)
    left = _mean_realisation(problem, fit, live, fit.values[live])
    return fit if left is None else replace(fit, residual=left)


def _drawn_parameters(fit: Fit) -> np.ndarray:
    """Which parameters (k,) are drawn: not those that change nothing, have no width or are whole numbers."""
    low, high = bounds_of(fit.parameters)
    whole = np.array([p.whole for p in fit.parameters], dtype=bool)
    return np.asarray(fit.active, dtype=bool) & (high > low) & ~whole


def fit_over_ensembles(problem: Problem, fit: Fit, sufficient_chi2: float) -> Fit:
    """The fit after as many regressions, each from the minimum of the one before, as make it markedly better."""
    for _ in range(problem.settings.ensemble.passes):
        if fit.chi2 <= sufficient_chi2:
            break
        before, found = fit.chi2, regressed_over_ensemble(problem, fit)
        if found.chi2 < before:
            fit = found
        if not found.chi2 < (1.0 - problem.settings.ensemble.marked_fall) * before:
            break
    return fit


def regressed_over_ensemble(problem: Problem, fit: Fit) -> Fit:
    """The fit where the regression has its minimum, if that leaves less than its own values, with draws."""
    settings, generator = problem.settings.ensemble, np.random.default_rng(0)
    (low, high), live = bounds_of(fit.parameters), _drawn_parameters(fit)
    if not live.any():
        return fit
    centre, bounds, count = fit.values[live], (low[live], high[live]), settings.members_per_parameter * int(live.sum())
    slopes, slope, inflation = fit.jacobian[:, live], fit.half_derivative[live], fit.inflation
    known, no_shifts = None, np.empty((0, centre.size))
    for width in settings.widths:
        wide = bounded_normal(slopes, slope, width**2 * inflation, centre, *bounds, no_shifts)
        members, residuals = _simulated(problem, fit, live, _drawn(wide, centre, bounds, count, generator))
        degrees_of_freedom = len(members) - centre.size - 1
        if degrees_of_freedom < centre.size:
            return fit
        middle, spread = members.mean(axis=0), members.std(axis=0)
        spread = np.where(spread > 0.0, spread, 1.0)
        columns = np.column_stack([np.ones(len(members)), (members - middle) / spread])
        coefficients = np.linalg.lstsq(columns, residuals, rcond=None)[0]
        scatter = _Scatter.of(residuals - columns @ coefficients, degrees_of_freedom, settings)
        plain = (coefficients[1:] / spread[:, None]).T
        slopes, reach = scatter.whiten(plain), settings.reach * spread
        ends = np.maximum(bounds[0] - middle, -reach), np.minimum(bounds[1] - middle, reach)
        step, _ = bounded_step(slopes, scatter.whiten(coefficients[0]), *ends)
        before, centre = centre, np.clip(middle + step, *bounds)
        white = scatter.whiten(coefficients[0] + plain @ (centre - middle))
        slope, inflation = slopes.T @ white, max(1.0, float(white @ white) / max(white.size - centre.size, 1))
        # how far an ensemble still moves the minimum tells what its slopes leave open
        moved, first = (centre - before)[None, :], known is None
        known = bounded_normal(slopes, slope, inflation, centre, *bounds, moved)
        if not first and np.all(np.square(moved[0]) <= settings.settled_share * np.diag(known.covariance)):
            break
    left, own = (_mean_realisation(problem, fit, live, at) for at in (centre, fit.values[live]))
    if left is None:
        return fit
    if own is not None and own @ own < left @ left:
        moved, slope = (fit.values[live] - centre)[None, :], slopes.T @ scatter.whiten(own)
        centre, left = fit.values[live], own
        known = bounded_normal(slopes, slope, inflation, centre, *bounds, moved)
    values, jacobian = fit.values.copy(), np.zeros((problem.size, live.size))
    jacobian[: len(fit.jacobian)] = fit.jacobian  # in fewer rows where the fit comes from files
    values[live], jacobian[:, live] = centre, plain
    draws = np.tile(values, (settings.draws, 1))
    draws[:, live] = _drawn(known, centre, bounds, settings.draws, generator)
    return replace(fit, values=values, residual=left, jacobian=jacobian, slope=None, draws=draws)


def _mean_realisation(problem: Problem, fit: Fit, live: np.ndarray, centre: np.ndarray) -> np.ndarray | None:
    """Residuals (n,) at values (k,) of the live parameters, as the mean of some realisations; None if there is none."""
    steps = problem.settings.differences.probe_step * np.array([p.step for p in fit.parameters])[live]
    low, high = (bound[live] for bound in bounds_of(fit.parameters))
    counts = np.arange(problem.settings.ensemble.realisations)[:, None]
    inwards = np.where(centre + counts[-1] * steps > high, -steps, steps)  # at a bound all would be the same point
    realisations = _simulated(problem, fit, live, np.clip(centre + counts * inwards, low, high))[1]
    return realisations.mean(axis=0) if len(realisations) else None


def _drawn(
    known: BoundedNormal,
    centre: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    count: int,
    generator: np.random.Generator,
) -> np.ndarray:
    """Points (count, k) of what is `known` of the parameters about the `centre` (k,)."""
    if known.draws is not None:
        return known.draws[generator.choice(len(known.draws), count, replace=len(known.draws) < count)]
    errors = np.sqrt(np.diag(known.covariance))
    unit = np.where(errors > 0.0, errors, 1.0)
    normal = generator.multivariate_normal(
        np.zeros(centre.size), known.covariance / np.outer(unit, unit), count, method="svd"
    )
    return np.clip(centre + unit * normal, *bounds)


def _simulated(problem: Problem, fit: Fit, live: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Those of the `points` (m, k) of the live parameters that can be simulated, and their residuals (m, n)."""
    keys = [p.key for p, own in zip(fit.parameters, live, strict=True) if own]
    kept, residuals = [], []
    for point in points:
        try:
            at = fit.mapping | dict(zip(keys, map(float, point), strict=True))
            residuals.append(problem.residual(at, fit.hypothesis))
        except (InputError, SimulationError):
            continue
        kept.append(point)
    return np.array(kept).reshape(-1, points.shape[1]), np.array(residuals).reshape(-1, problem.size)
