"""Fit of the current model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from jointgap.core.candidates import Model
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.fit import (
    FAILED,
    BoundedNormal,
    FiniteDifferences,
    Fit,
    bounded_normal,
    bounded_step,
    bounds_of,
    fit_hypothesis,
    prior_of_bounds,
)
from jointgap.identification.initial_fit import with_nuisances_of
from jointgap.identification.noise import numerics_noise
from jointgap.identification.problem import Noise, Problem
from jointgap.identification.settings import (
    DEFAULT_SETTINGS,
    EnsembleSettings,
    IdentificationSettings,
)


@dataclass(frozen=True)
class _Scatter:
    """Scatter of realisations: orthonormal modes (n, m) and variances (m,) [1, of that of
    noise]."""

    modes: np.ndarray
    variances: np.ndarray

    @classmethod
    def of(
        cls, left: np.ndarray, degrees_of_freedom: int, settings: EnsembleSettings
    ) -> "_Scatter":
        """From the residuals (members, n) of a regression."""
        try:
            _, singular_values, right = np.linalg.svd(left, full_matrices=False)
        except np.linalg.LinAlgError:  # divide and conquer may fail to converge
            _, singular_values, right = scipy.linalg.svd(
                left, full_matrices=False, lapack_driver="gesvd"
            )
        variances = singular_values**2 / degrees_of_freedom
        counted = variances > settings.least_variance
        return cls(right[counted].T, variances[counted])

    def whiten(self, values: np.ndarray) -> np.ndarray:
        """Whiten values (n,) or (n, k), already whitened for noise, for the scatter too."""
        removed = 1.0 - 1.0 / np.sqrt(1.0 + self.variances)
        return values - (self.modes * removed) @ (self.modes.T @ values)


def leading_over_ensembles(
    problem: Problem, base: Fit, fits: Sequence[Fit]
) -> tuple[Fit, list[Fit]]:
    """The base and the fits, the leading ones regressed over ensembles, as chi2 of a single
    realisation scatters by more than the differences of explanations.

    The base is also regressed from the nuisances of the best fit, so that it does not lose by worse
    ones. Other fits that are better than the base get the mean residual of as many realisations.
    """
    settings = problem.settings.ensemble
    single = base if base.draws is None else _with_single_residual(problem, base)
    better = sorted(
        (fit for fit in fits if fit.status != FAILED and fit.bic < single.bic),
        key=lambda fit: fit.bic,
    )
    if not better:
        return base, list(fits)
    most = single.bic - settings.leading_share * (single.bic - better[0].bic)
    leading = [fit for fit in better[: settings.leading] if fit.bic <= most]
    due = {id(fit) for fit in (base, *leading) if fit.draws is None}
    others = {id(fit) for fit in better if fit.draws is None} - due
    base, *fits = (
        (
            regressed_over_ensemble(problem, fit)
            if id(fit) in due
            else _with_mean_residual(problem, fit)
            if id(fit) in others
            else fit
        )
        for fit in (base, *fits)
    )
    best = min((fit for fit in fits if fit.status != FAILED), key=lambda fit: fit.bic)
    if due and best.bic < base.bic:
        # an effect that replaces a nuisance may exceed its bounds, the base may not
        values = np.clip(
            list(with_nuisances_of(problem, base, best).values()), *bounds_of(base.parameters)
        )
        base = min(
            base,
            regressed_over_ensemble(problem, replace(base, values=values)),
            key=lambda fit: fit.chi2,
        )
    return base, fits


def _with_single_residual(problem: Problem, fit: Fit) -> Fit:
    """The fit with the residual of one realisation; unchanged if that cannot be simulated."""
    try:
        return replace(fit, residual=problem.residual(fit.mapping, fit.hypothesis))
    except (InputError, SimulationError):
        return fit


def _with_mean_residual(problem: Problem, fit: Fit) -> Fit:
    """The fit with the mean residual of some realisations; unchanged if none can be simulated."""
    live = _drawn_parameters(fit)
    left = _mean_realisation(problem, fit, live, fit.values[live])
    return fit if left is None else replace(fit, residual=left)


def _drawn_parameters(fit: Fit) -> np.ndarray:
    """Mask (k,) of drawn parameters: not inactive, fixed or integer ones."""
    low, high = bounds_of(fit.parameters)
    whole = np.array([p.integer for p in fit.parameters], dtype=bool)
    return np.asarray(fit.active, dtype=bool) & (high > low) & ~whole


def fit_over_ensembles(problem: Problem, fit: Fit, sufficient_chi2: float) -> Fit:
    """The fit after repeated regressions, while each improves it markedly."""
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
    """The fit at the minimum of a regression over an ensemble, if that is better, with draws."""
    settings, generator = problem.settings.ensemble, np.random.default_rng(0)
    (low, high), live = bounds_of(fit.parameters), _drawn_parameters(fit)
    if not live.any():
        return fit
    centre, bounds, count = (
        fit.values[live],
        (low[live], high[live]),
        settings.members_per_parameter * int(live.sum()),
    )
    slopes, slope, inflation = fit.jacobian[:, live], fit.half_derivative[live], fit.inflation
    known, no_shifts = None, np.empty((0, centre.size))
    for width in settings.widths:
        wide = bounded_normal(slopes, slope, width**2 * inflation, centre, *bounds, no_shifts)
        members, residuals = _simulated(
            problem, fit, live, _ensemble_regression_drawn(wide, centre, bounds, count, generator)
        )
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
        slope, inflation = (
            slopes.T @ white,
            max(1.0, float(white @ white) / max(white.size - centre.size, 1)),
        )
        # the last change of the minimum is an error of the regression
        moved, first = (centre - before)[None, :], known is None
        known = bounded_normal(slopes, slope, inflation, centre, *bounds, moved)
        if not first and np.all(
            np.square(moved[0]) <= settings.settled_share * np.diag(known.covariance)
        ):
            break
    left, own = (_mean_realisation(problem, fit, live, at) for at in (centre, fit.values[live]))
    if left is None:
        return fit
    if own is not None and own @ own < left @ left:
        moved, slope = (fit.values[live] - centre)[None, :], slopes.T @ scatter.whiten(own)
        centre, left = fit.values[live], own
        known = bounded_normal(slopes, slope, inflation, centre, *bounds, moved)
    values, jacobian = fit.values.copy(), np.zeros((problem.size, live.size))
    jacobian[: len(fit.jacobian)] = fit.jacobian  # fewer rows if read from files
    values[live], jacobian[:, live] = centre, plain
    draws = np.tile(values, (settings.draws, 1))
    draws[:, live] = _ensemble_regression_drawn(known, centre, bounds, settings.draws, generator)
    return replace(fit, values=values, residual=left, jacobian=jacobian, slope=None, draws=draws)


def _mean_realisation(
    problem: Problem, fit: Fit, live: np.ndarray, centre: np.ndarray
) -> np.ndarray | None:
    """Mean residuals (n,) of some realisations at values (k,) of the live parameters; None if none
    can be simulated."""
    steps = (
        problem.settings.differences.probe_step * np.array([p.step for p in fit.parameters])[live]
    )
    low, high = (bound[live] for bound in bounds_of(fit.parameters))
    counts = np.arange(problem.settings.ensemble.realisations)[:, None]
    inwards = np.where(centre + counts[-1] * steps > high, -steps, steps)
    realisations = _simulated(problem, fit, live, np.clip(centre + counts * inwards, low, high))[1]
    return realisations.mean(axis=0) if len(realisations) else None


def _ensemble_regression_drawn(
    known: BoundedNormal,
    centre: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    count: int,
    generator: np.random.Generator,
) -> np.ndarray:
    """Points (count, k) from the distribution `known` of the parameters about the `centre` (k,)."""
    if known.draws is not None:
        return known.draws[
            generator.choice(len(known.draws), count, replace=len(known.draws) < count)
        ]
    errors = np.sqrt(np.diag(known.covariance))
    unit = np.where(errors > 0.0, errors, 1.0)
    normal = generator.multivariate_normal(
        np.zeros(centre.size), known.covariance / np.outer(unit, unit), count, method="svd"
    )
    return np.clip(centre + unit * normal, *bounds)


def _simulated(
    problem: Problem, fit: Fit, live: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The `points` (m, k) of the live parameters that can be simulated, and their residuals (m,
    n)."""
    keys = [p.key for p, own in zip(fit.parameters, live, strict=True) if own]
    kept, residuals = [], []
    for point in points:
        try:
            at = fit.mapping | dict(zip(keys, map(float, point), strict=True))
            residuals.append(problem.residual(at, fit.hypothesis))
        except (InputError, SimulationError):
            continue
        kept.append(point)
    return np.array(kept).reshape(-1, points.shape[1]), np.array(residuals).reshape(
        -1, problem.size
    )


@dataclass(frozen=True)
class Baseline:
    """The current model, the reference of all hypotheses."""

    problem: Problem  # Its noise includes solver error
    differences: FiniteDifferences
    nominal: (
        Fit  # Shared nuisances at nominal; only run-specific values (speed, first angle) are fitted
    )
    base: Fit  # All nuisances fitted


def recalibrate(
    model: Model,
    noise: Mapping[tuple[str, str], Noise],
    values: Mapping[str, float] | None = None,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> Baseline:
    """Fit the nuisances from `values` by key [SI] (default: nominal), with solver error as
    noise."""
    start = {p.key: p.nominal for p in model.nuisances} | dict(values or {})
    problem = Problem(model, numerics_noise(model, start, noise, settings.noise), settings=settings)
    differences = probed_differences(problem, start)
    base = fit_hypothesis(problem, start=start, differences=differences)
    if base.status == FAILED:
        raise SimulationError(f"{model.name}: the current model cannot be simulated: {base.reason}")
    nominal = fit_hypothesis(
        problem,
        start={key: value for key, value in base.mapping.items() if "@" in key},
        differences=differences,
        vary=[p for p in problem.nuisances if p.run is not None],
    )
    if problem.has_statistics:
        base = fit_over_ensembles(problem, base, _enough(problem, base))
    return Baseline(problem, differences, nominal, base)


def _enough(problem: Problem, fit: Fit) -> float:
    """Upper limit of chi2 for noise."""
    dof = max(problem.size - len(fit.parameters), 1)
    return dof + problem.settings.baseline.noise_sigmas * float(np.sqrt(2.0 * dof))


def probed_differences(problem: Problem, values: Mapping[str, float]) -> FiniteDifferences:
    """Finite differences with the numerical noise at `values` (by key [SI]), if `problem` can be
    simulated."""
    differences = FiniteDifferences(problem)
    try:
        differences.probe(problem.nuisances, values, problem.residual(values))
    except (InputError, SimulationError):
        pass  # reported by the fit that starts there
    return differences


def with_intervals(problem: Problem, fit: Fit) -> Fit:
    """The fit with draws (chaotic motion) or shifts for its intervals.

    Shifts are the changes of the values between solver variants (including another start),
    projected onto the parameters with the widths of their bounds, and the changes of fits that
    begin at draws from the distribution of the values: where the residual is no linear function of
    them, these end elsewhere. For chaotic motion the values are those of the regression; the
    residual is kept. The fit is unchanged if this fails.
    """
    if fit.status == FAILED or fit.draws is not None or fit.in_windows or not fit.values.size:
        return fit
    if problem.has_statistics:
        # explanations were compared by this residual
        return replace(regressed_over_ensemble(problem, fit), residual=fit.residual)
    try:
        changes = other_numerics(problem, fit)
    except (InputError, SimulationError):
        return fit
    rows = np.vstack([fit.jacobian, np.diag(prior_of_bounds(*bounds_of(fit.parameters)))])
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    changes = np.hstack([changes, np.zeros((len(changes), scale.size))])
    least = problem.settings.intervals.least_singular_value
    shifts = np.linalg.lstsq(rows / scale, changes.T, rcond=least)[0].T / scale
    return replace(fit, shifts=np.vstack([shifts, _ends_from_draws(problem, fit)]))


def _ends_from_draws(problem: Problem, fit: Fit) -> np.ndarray:
    """Changes (m, k) [SI] of the values by fits from draws, over the root of their number: a mean
    square."""
    count, generator = problem.settings.intervals.starts, np.random.default_rng(0)
    starts = _ensemble_regression_drawn(
        fit.distribution, fit.values, bounds_of(fit.parameters), count, generator
    )
    known = {p.key: column for p, column in zip(fit.parameters, fit.jacobian.T, strict=True)}
    ends = []
    for start in starts:
        values = {p.key: float(value) for p, value in zip(fit.parameters, start, strict=True)}
        end = fit_hypothesis(problem, fit.hypothesis, values, known, vary=fit.parameters)
        if end.status != FAILED:
            ends.append(end.values - fit.values)
    return np.array(ends).reshape(-1, fit.values.size) / np.sqrt(max(len(ends), 1))


def other_numerics(problem: Problem, base: Fit) -> np.ndarray:
    """Change (number of variants, n) of the whitened residuals of the fit `base` between solver
    variants."""
    changes: list[np.ndarray] = []
    # estimated states compensate for solver variants
    for i in range(0 if base.in_windows else len(problem.model.numerics)):
        changes.append(
            problem.residual(base.mapping, base.hypothesis, numerics=i + 1) - base.residual
        )
    return np.array(changes).reshape(len(changes), problem.size)
