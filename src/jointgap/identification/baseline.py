"""Fit of the model as it stands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from scipy.optimize import minimize
from scipy.signal import oaconvolve
from scipy.stats import qmc

from jointgap.core.candidates import FAST, Candidate, Model, Parameter
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
)
from jointgap.identification.initial_fit import with_nuisances_of
from jointgap.identification.noise import numerics_noise
from jointgap.identification.problem import Hypothesis, Noise, Problem
from jointgap.identification.settings import (
    DEFAULT_SETTINGS,
    EnsembleSettings,
    IdentificationSettings,
    SmoothingSettings,
    ValleySettings,
)


class ResidualSurrogate:
    """Residuals about a fit of k parameters to n samples."""

    def __init__(
        self,
        values: np.ndarray,
        residual: np.ndarray,
        jacobian: np.ndarray,
        errors: np.ndarray,
        settings: ValleySettings = DEFAULT_SETTINGS.valley,
    ):
        self._values, self.errors, self._settings = values, errors, settings
        self._residual, self._jacobian = residual, jacobian
        # of the fit itself, where the linear model is exact, and then of what was simulated
        self._points, self._changes = np.zeros((1, values.size)), np.zeros((1, residual.size))
        self._log_lengths = np.full(values.size, np.log(settings.usual_length))
        self._prepare()

    def add(self, points: np.ndarray, residuals: np.ndarray) -> None:
        """Learn the `residuals` (m, n) that were simulated at `points` (m, k) [SI], and the lengths from them all."""
        away = points - self._values
        self._points = np.vstack([self._points, away / self.errors])
        self._changes = np.vstack([self._changes, residuals - self._residual - away @ self._jacobian.T])
        products = self._changes @ self._changes.T
        apart = (self._points[:, None, :] - self._points[None, :, :]) ** 2
        settings = self._settings
        farthest = settings.max_length_spreads * settings.log_length_spread  # beyond, exponentials overflow
        ends = np.log(settings.usual_length) + farthest * np.array([-1.0, 1.0])
        found = minimize(
            self._improbability,
            self._log_lengths,
            (products, apart),
            jac=True,
            method="L-BFGS-B",
            bounds=[ends] * self._log_lengths.size,
            options={"maxiter": settings.max_length_steps},
        )
        self._log_lengths = found.x
        self._prepare()

    def chi2(self, points: np.ndarray) -> np.ndarray:
        """Sum of squared residuals at `points` (m, k) [SI], (m,)."""
        away = points - self._values
        scaled = away / self.errors / np.exp(self._log_lengths)
        distance = np.sum(scaled**2, axis=1)[:, None] + self._squares - 2.0 * scaled @ self._scaled.T
        weights = np.exp(-0.5 * np.maximum(distance, 0.0)) @ self._inverse
        factors = np.hstack([np.ones((len(points), 1)), away, weights])
        return np.sum((factors @ self._products) * factors, axis=1)

    def _prepare(self) -> None:
        """What `chi2` needs, for the lengths and simulations that there are."""
        self._scaled = self._points / np.exp(self._log_lengths)
        self._squares = np.sum(self._scaled**2, axis=1)
        apart = (self._points[:, None, :] - self._points[None, :, :]) ** 2
        self._inverse = np.linalg.inv(self._kernel(self._log_lengths, apart))
        rows = np.vstack([self._residual, self._jacobian.T, self._changes])
        self._products = rows @ rows.T

    def _kernel(self, log_lengths: np.ndarray, apart: np.ndarray) -> np.ndarray:
        return np.exp(-0.5 * apart @ np.exp(-2.0 * log_lengths)) + self._settings.nugget * np.eye(len(apart))

    def _improbability(
        self, log_lengths: np.ndarray, products: np.ndarray, apart: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Minus the log-likelihood of the lengths per sample, for the best variance, less their prior; its derivative.

        Samples are far from independent, so all of them count as one number for each simulation.
        """
        count, kernel = len(apart), self._kernel(log_lengths, apart)
        inverse = np.linalg.inv(kernel)
        explained = inverse @ products @ inverse
        total = max(float(np.sum(inverse * products)), 1e-300)
        by_kernel = 0.5 * inverse - 0.5 * count / total * explained
        slope = np.einsum("ij,ijk->k", by_kernel * kernel, apart) * np.exp(-2.0 * log_lengths)
        off = (log_lengths - np.log(self._settings.usual_length)) / self._settings.log_length_spread
        value = 0.5 * np.linalg.slogdet(kernel)[1] + 0.5 * count * np.log(total) + 0.5 * off @ off
        return value, slope + off / self._settings.log_length_spread


def draws_along_valley(problem: Problem, fit: Fit, numerical_noise_chi2: float = 0.0) -> np.ndarray | None:
    """Draws of all that a fit varies, from exp(-chi2 / 2) within the bounds.

    chi2 counts less where the residual is more than noise, as in `Fit.distribution`.
    """
    settings, known = problem.settings.valley, fit.distribution
    errors = np.sqrt(np.diag(known.covariance))
    live = (errors > 0.0) & ~np.array([parameter.whole for parameter in fit.parameters])
    if not live.any():
        return None
    generator = np.random.default_rng(0)
    low, high = bounds_of(fit.parameters)
    if known.draws is None:
        correlation = known.covariance[np.ix_(live, live)] / np.outer(errors[live], errors[live])
        normal = generator.multivariate_normal(np.zeros(live.sum()), correlation, settings.walkers, method="svd")
        ensemble = np.clip(fit.values[live] + errors[live] * normal, low[live], high[live])
    else:
        ensemble = known.draws[generator.choice(len(known.draws), settings.walkers, replace=False)][:, live]
    surrogate = ResidualSurrogate(fit.values[live], fit.residual, fit.jacobian[:, live], errors[live], settings)
    bounds, inflation = (low[live], high[live]), fit.inflation

    def simulate(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What can be simulated of `points`, and the residuals."""
        kept, residuals = [], []
        for point in points:
            values = fit.values.copy()
            values[live] = point
            at = dict(zip((p.key for p in fit.parameters), map(float, values), strict=True))
            try:
                residuals.append(problem.residual(fit.mapping | at, fit.hypothesis))
            except (InputError, SimulationError):
                continue
            kept.append(point)
        return np.array(kept).reshape(-1, points.shape[1]), np.array(residuals).reshape(-1, problem.size)

    farther = fit.values[live] + settings.probe_reach * (ensemble[: settings.probes] - fit.values[live])
    probes, residuals = simulate(np.clip(farther, *bounds))
    missed = np.abs(np.sum(residuals**2, axis=1) - surrogate.chi2(probes))
    if not np.any(missed > settings.quadratic_within * inflation + numerical_noise_chi2):
        return None
    surrogate.add(probes, residuals)
    for temperature in settings.temperatures:
        ensemble = _drawn(surrogate, ensemble, bounds, temperature * inflation, generator, settings)[-len(ensemble) :]
        points, residuals = simulate(ensemble[generator.choice(len(ensemble), settings.batch, replace=False)])
        if len(points):
            surrogate.add(points, residuals)
    ensemble = _drawn(surrogate, ensemble, bounds, inflation, generator, settings)[-len(ensemble) :]
    drawn = _drawn(surrogate, ensemble, bounds, inflation, generator, settings)
    drawn = drawn[generator.choice(len(drawn), min(settings.kept_draws, len(drawn)), replace=False)]
    draws = np.tile(fit.values, (len(drawn), 1))
    draws[:, live] = drawn
    return draws


def _drawn(
    surrogate: ResidualSurrogate,
    ensemble: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    temperature: float,
    generator: np.random.Generator,
    settings: ValleySettings,
) -> np.ndarray:
    """The ensembles (walkers, k) of the second half of the steps, every tenth, one below the other: the last is last.

    The density is exp(-chi2 / (2 `temperature`)) within the `bounds` (k,). One half of the ensemble moves by
    differences between members of the other, which stands still, so that the move is symmetric.
    """
    low, high = bounds
    now, chi2 = ensemble.copy(), surrogate.chi2(ensemble)
    count, half = ensemble.shape[1], len(ensemble) // 2
    kept = []
    for step in range(settings.steps):
        for moving, standing in ((slice(half), slice(half, None)), (slice(half, None), slice(half))):
            others = now[standing]
            size = len(now[moving])
            first, second = generator.integers(len(others), size=(2, size))
            jumps = generator.random(size) < settings.long_jumps
            gamma = np.where(jumps, 1.0, generator.uniform(0.3, 1.2, size) * 2.38 / np.sqrt(2.0 * count))
            proposed = now[moving] + gamma[:, None] * (others[first] - others[second])
            proposed += settings.jitter * surrogate.errors * generator.normal(size=proposed.shape)
            inside = np.all((proposed >= low) & (proposed <= high), axis=1)
            there = np.full(size, np.inf)
            if inside.any():
                there[inside] = surrogate.chi2(proposed[inside])
            fall = np.where(inside, chi2[moving] - there, -np.inf)
            taken = np.log(generator.random(size)) < fall / (2.0 * temperature)
            now[moving] = np.where(taken[:, None], proposed, now[moving])
            chi2[moving] = np.where(taken, there, chi2[moving])
        if step >= settings.steps // 2 and (step + 1) % 10 == 0:
            kept.append(now.copy())
    return np.concatenate(kept)


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
    draws[:, live] = _ensemble_regression_drawn(known, centre, bounds, settings.draws, generator)
    return replace(fit, values=values, residual=left, jacobian=jacobian, slope=None, draws=draws)


def _mean_realisation(problem: Problem, fit: Fit, live: np.ndarray, centre: np.ndarray) -> np.ndarray | None:
    """Residuals (n,) at values (k,) of the live parameters, as the mean of some realisations; None if there is none."""
    steps = problem.settings.differences.probe_step * np.array([p.step for p in fit.parameters])[live]
    low, high = (bound[live] for bound in bounds_of(fit.parameters))
    counts = np.arange(problem.settings.ensemble.realisations)[:, None]
    inwards = np.where(centre + counts[-1] * steps > high, -steps, steps)  # at a bound all would be the same point
    realisations = _simulated(problem, fit, live, np.clip(centre + counts * inwards, low, high))[1]
    return realisations.mean(axis=0) if len(realisations) else None


def _ensemble_regression_drawn(
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


@dataclass(frozen=True)
class Smoother:
    """Residuals smoothed over the cycle, each still of variance 1 where they are noise."""

    kernels: tuple[tuple[slice, np.ndarray], ...]

    @property
    def overlap(self) -> float:
        """Factor on the errors of slow parameters: neighbours share samples, so they are not independent."""
        return float(np.mean([weights.sum() for _, weights in self.kernels]))

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Residuals (n,) or their derivatives (n, k), smoothed."""
        smoothed = np.empty_like(values)
        for place, weights in self.kernels:
            if weights.size > 1:
                shaped = weights if values.ndim == 1 else weights[:, None]
                smoothed[place] = oaconvolve(values[place], shaped, mode="same", axes=0)
            else:
                smoothed[place] = values[place]
        return smoothed


def smoothers_of(problem: Problem) -> tuple[Smoother, ...]:
    """Smoothers of a problem's residuals, coarsest first; none where they would change nothing.

    Statistics over cycles, and series of which no angle is known, stay as they are.
    """
    settings, smoothers = problem.settings.smoothing, []
    for width in np.deg2rad(settings.widths_deg):
        kernels = []
        for part in problem.parts:
            step = np.abs(np.diff(part.series.angle[part.used]))
            step = float(np.median(step[np.isfinite(step)])) if np.isfinite(step).any() else 0.0
            plain = part.series.statistic or not step > 0.0
            count = part.place.stop - part.place.start
            kernels.append((part.place, np.ones(1) if plain else _weights(width / step, count, settings.kernel_reach)))
        if any(weights.size > 1 for _, weights in kernels):
            smoothers.append(Smoother(tuple(kernels)))
    return tuple(smoothers)


def _weights(sd: float, count: int, reach: float) -> np.ndarray:
    """Gaussian weights over samples, `sd` in samples, at most about as many as there are samples."""
    half = min(int(np.ceil(reach * sd)), max((count - 1) // 2, 0))
    weights = np.exp(-0.5 * np.square(np.arange(-half, half + 1) / max(sd, 1e-9)))
    return weights / np.linalg.norm(weights)


def coarse_to_fine_fit(
    problem: Problem,
    hypothesis: Hypothesis,
    start: Mapping[str, float],
    differences: FiniteDifferences,
    smoothers: Sequence[Smoother],
) -> Fit:
    """The fit with the last smoother by way of all before it; what each leaves undetermined is scanned in the next."""
    result, derivatives = None, None
    for smoother, finer in zip(smoothers, (*smoothers[1:], None), strict=True):
        fit = fit_hypothesis(problem, hypothesis, start, derivatives, differences, smoother=smoother)
        if fit.status == FAILED:
            return result or fit
        result, start, derivatives = (
            fit,
            fit.mapping,
            dict(zip((p.key for p in fit.parameters), fit.jacobian.T, strict=True)),
        )
        scanned = coordinate_scan(problem, fit, smoother, finer)
        if scanned is not None:
            start, derivatives = scanned, None  # after a jump derivatives do not hold any more
            if finer is None:
                values = np.array([scanned[p.key] for p in fit.parameters])
                result = replace(fit, values=values, residual=problem.residual(scanned, hypothesis), reason="")
    return result


def fit_via_smoothers(
    problem: Problem,
    hypothesis: Hypothesis,
    start: Mapping[str, float],
    differences: FiniteDifferences,
    smoothers: Sequence[Smoother],
) -> Fit:
    """The fit to the samples that starts from the coarse-to-fine fit; from `start` where there is none or it fails.

    Arguments as in `coarse_to_fine_fit`, but there may be no smoothers.
    """
    coarse = coarse_to_fine_fit(problem, hypothesis, start, differences, smoothers) if smoothers else None
    start = start if coarse is None or coarse.status == FAILED else coarse.mapping
    return fit_hypothesis(problem, hypothesis, start, differences=differences)


def coordinate_scan(
    problem: Problem, fit: Fit, smoother: Smoother, finer: Smoother | None, amplitudes_only: bool = False
) -> dict[str, float] | None:
    """Better values by key, from scans of undetermined parameters one after the other; None if none are better.

    At each value of a scan the other parameters take up what they can linearly; chi2 is that of the finer smoother.
    """
    smooth = (lambda values: values) if finer is None else finer
    low, high = bounds_of(fit.parameters)
    matrix, values = smooth(fit.jacobian), fit.mapping
    _, best_chi2 = bounded_step(matrix, smooth(fit.residual), low - fit.values, high - fit.values)
    moved, amplitudes = False, _amplitudes(fit)
    for i, scan in _undetermined(fit, smoother, matrix, problem.settings.smoothing):
        p, others = fit.parameters[i], np.delete(matrix, i, axis=1)
        if amplitudes_only and p.key not in amplitudes:
            continue
        here = np.array([values[q.key] for q in fit.parameters])
        room = np.delete(low - here, i), np.delete(high - here, i)
        best = values
        for value in scan:
            trial = {**values, p.key: float(np.clip(value, p.low, p.high))}
            try:
                residual = problem.residual(trial, fit.hypothesis)
            except (InputError, SimulationError):
                continue
            _, chi2 = bounded_step(others, smooth(residual), *room)
            if chi2 < best_chi2:
                best_chi2, best, moved = chi2, trial, True
        values = best
    return values if moved else None


def _amplitudes(fit: Fit) -> dict[str, Candidate]:
    """The amplitudes of effects among the parameters, by key, and whose they are."""
    return {f"{candidate.label}.{name}": candidate for candidate in fit.hypothesis for name in candidate.amplitudes}


def _undetermined(
    fit: Fit, smoother: Smoother, finer_jacobian: np.ndarray, settings: SmoothingSettings
) -> list[tuple[int, np.ndarray]]:
    """Which parameters are to be scanned, and at what values.

    Those are nuisances and shapes that the smoother leaves uncertain though they matter to the finer one, and
    perturbations of known quantities, of which small ones say little of large ones.
    """
    if not fit.parameters:
        return []
    width = np.array([p.high - p.low for p in fit.parameters])
    bounded = np.isfinite(width) & (width > 0.0)
    prior = np.where(bounded, np.sqrt(12.0) / np.where(bounded, width, 1.0), 0.0)
    scale = np.where(bounded, width, 1.0) / np.sqrt(12.0)
    matrix = np.vstack([smoother(fit.jacobian) / smoother.overlap, np.diag(prior)]) * scale
    _, singular_values, right = np.linalg.svd(matrix, full_matrices=False)
    errors = np.linalg.norm(right.T / np.maximum(singular_values, 1e-12 * singular_values[0]), axis=1) * scale
    influence = np.linalg.norm(finer_jacobian, axis=0) * np.where(bounded, width, 0.0)
    factor, amplitudes, scans = settings.perturbation_scan_factor, _amplitudes(fit), []
    ratios = np.geomspace(1.0 / factor, factor, settings.perturbation_scan_points)
    for i, p in enumerate(fit.parameters):
        if not bounded[i] or p.run is not None:
            continue
        if p.key in amplitudes:
            if amplitudes[p.key].is_perturbation:
                values = np.unique(np.clip(p.low + (p.nominal - p.low) * ratios, p.low, p.high))
                scans.append((i, values[~np.isclose(values, p.nominal, rtol=0.0, atol=1e-6 * width[i])]))
            continue
        matters = influence[i] > settings.min_influence * np.sqrt(finer_jacobian.shape[0])
        if matters and errors[i] > settings.undetermined_error * width[i]:
            scans.append((i, np.linspace(p.low, p.high, settings.scan_points)))
    return scans


@dataclass(frozen=True)
class Baseline:
    """The model as it stands, that every hypothesis is compared with."""

    problem: Problem  # With the noise of the numerics in it
    differences: FiniteDifferences
    nominal: Fit  # All shared nuisances at nominal; only what belongs to single runs (speed, first angle) is fitted
    base: Fit  # All nuisances fitted


def recalibrate(
    model: Model, noise: Mapping[tuple[str, str], Noise], settings: IdentificationSettings = DEFAULT_SETTINGS
) -> Baseline:
    """Fit the nuisances; then count in what equally good numerics would predict, and fit again."""
    first = Problem(model, noise, settings=settings)
    start = multistart_fit(first, probed_differences(first, {p.key: p.nominal for p in first.nuisances}))
    if start.status == FAILED:
        raise SimulationError(f"{model.name}: cannot be simulated as it stands: {start.reason}")
    problem = Problem(model, numerics_noise(model, start.mapping, noise, settings.noise), settings=settings)
    differences = probed_differences(problem, start.mapping)
    nominal = fit_hypothesis(
        problem,
        start={key: value for key, value in start.mapping.items() if "@" in key},
        differences=differences,
        vary=[p for p in problem.nuisances if p.run is not None],
    )
    base = fit_hypothesis(problem, start=start.mapping, differences=differences, refresh=True)
    if problem.has_statistics:
        base = fit_over_ensembles(problem, base, _enough(problem, base))
    # differences probed anew, as they are when a later stage reads the fits from files
    return Baseline(problem, probed_differences(problem, base.mapping), nominal, base)


def multistart_fit(
    problem: Problem,
    differences: FiniteDifferences,
    hypothesis: Hypothesis = (),
    start: Mapping[str, float] | None = None,
    max_starts: int | None = None,
) -> Fit:
    """The best of fits from several values of the nuisances; the first that leaves noise alone ends the search.

    Where joints are loose, fits may be caught in a valley that is not the deepest. So all but the first go from
    coarsely smoothed residuals to the samples, where these can be smoothed. One that ends in the same minimum as the
    best before it ends the search too.
    """
    settings = problem.settings.baseline
    count = settings.max_starts if max_starts is None else max_starts
    given = {p.key: p.nominal for p in problem.parameters(hypothesis)} | dict(start or {})
    best = fit_hypothesis(problem, hypothesis, given, differences=differences)
    smoothers = smoothers_of(problem)
    again = (given,) if smoothers else ()  # the same start once more, by way of smoothed residuals
    for values in (*again, *(given | drawn for drawn in random_nuisances(problem, hypothesis, count - 1))):
        if best.status == FAILED or best.chi2 < _enough(problem, best):
            break
        fit = fit_via_smoothers(problem, hypothesis, values, differences, smoothers)
        same = is_same_minimum(fit, best, differences)
        best = min(best, fit, key=lambda fit: fit.chi2)
        if same:
            break
    return best


def _enough(problem: Problem, fit: Fit) -> float:
    """chi2 that noise alone leaves of a fit."""
    dof = max(problem.size - len(fit.parameters), 1)
    return dof + problem.settings.baseline.noise_sigmas * float(np.sqrt(2.0 * dof))


def is_same_minimum(fit: Fit, other: Fit, differences: FiniteDifferences) -> bool:
    """Whether two fits ended in the same minimum, as far as chi2 says and its numerical noise lets it."""
    least = differences.problem.settings.baseline.same_minimum * other.chi2
    return abs(fit.chi2 - other.chi2) < max(least, differences.numerical_noise_chi2)


def shared_nuisances(problem: Problem, hypothesis: Hypothesis) -> list[Parameter]:
    """The bounded nuisances that runs share."""
    shared = [p for p in problem.parameters(hypothesis) if p.run is None and p in problem.nuisances]
    return [p for p in shared if np.isfinite(p.high - p.low)]


def random_nuisances(problem: Problem, hypothesis: Hypothesis, count: int) -> list[dict[str, float]]:
    """Values of the nuisances that runs share, drawn evenly from their ranges; none where there are no such
    nuisances.
    """
    bounded = shared_nuisances(problem, hypothesis)
    generator = np.random.default_rng(0)
    return [{p.key: float(generator.uniform(p.low, p.high)) for p in bounded} for _ in range(count if bounded else 0)]


def probed_differences(problem: Problem, values: Mapping[str, float]) -> FiniteDifferences:
    """Finite differences that know the numerical noise at `values` (by key [SI]), if `problem` can be simulated."""
    differences = FiniteDifferences(problem)
    try:
        differences.probe(problem.nuisances, values, problem.residual(values))
    except (InputError, SimulationError):
        pass  # the fit that starts there says why
    return differences


def with_intervals(problem: Problem, fit: Fit, differences: FiniteDifferences) -> Fit:
    """A fit to the `problem` that knows what its intervals ask for: draws of chaotic motion's parameters, or along a
    curved valley of chi2, or shifts.

    Where chi2 is quadratic, intervals count what other numerics, another start among them, change in the values: it is
    projected onto the parameters as the data and the widths of the bounds determine them. Along a curved valley a
    projection would lead astray, and there numerics count in the noise alone. Of chaotic motion the values are those of
    the regression, and what is left is as it was. A fit that failed, that has draws, that cannot be regressed, or that
    cannot be simulated by other numerics, is left as it is; the `differences` know the numerical noise.
    """
    if fit.status == FAILED or fit.draws is not None:
        return fit
    if problem.has_statistics:
        # what is left stays as it is: by that explanations were compared
        return replace(regressed_over_ensemble(problem, fit), residual=fit.residual)
    draws = draws_along_valley(problem, fit, differences.numerical_noise_chi2)
    if draws is not None:
        return replace(fit, draws=draws)
    try:
        changes = other_numerics(problem, fit)
    except (InputError, SimulationError):
        return fit
    low, high = bounds_of(fit.parameters)
    widths = np.diag(np.where(np.isfinite(high - low), np.sqrt(12.0) / (high - low), 0.0))
    rows = np.vstack([fit.jacobian, widths])
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    changes = np.hstack([changes, np.zeros((len(changes), scale.size))])
    least = problem.settings.intervals.least_singular_value
    return replace(fit, shifts=np.linalg.lstsq(rows / scale, changes.T, rcond=least)[0].T / scale)


def other_numerics(problem: Problem, base: Fit) -> np.ndarray:
    """What other numerics change in the whitened residuals of the fit `base` to `problem`: (number of numerics, n)."""
    changes = []
    for i in range(len(problem.model.numerics)):
        changes.append(problem.residual(base.mapping, base.hypothesis, numerics=i + 1) - base.residual)
    return np.array(changes).reshape(len(changes), problem.size)


def fit_from_scattered_starts(baseline: Baseline, fit: Fit, sufficient_chi2: float) -> Fit:
    """The best of the fits of a hypothesis from the best of many points, and the `fit` that is there."""
    problem, differences = baseline.problem, baseline.differences
    best = fit
    for start in _best_points(baseline, fit):
        if best.chi2 <= sufficient_chi2:
            break
        found = fit_hypothesis(problem, fit.hypothesis, start, differences=differences)
        if found.status != FAILED and found.chi2 < best.chi2:
            best = found
    return best


def _best_points(baseline: Baseline, fit: Fit) -> list[dict[str, float]]:
    """Values by key [SI] of the points that leave the least chi2, best first; each is simulated while it may be one."""
    problem, settings = baseline.problem, baseline.problem.settings.scattered_starts
    nuisances = shared_nuisances(problem, fit.hypothesis)
    names = {f"{candidate.label}.{name}" for candidate in fit.hypothesis for name in candidate.amplitudes}
    sizes = [p for p in fit.parameters if p.name in names]
    points, chi2 = [], []
    for place in qmc.Sobol(len(nuisances) + 1, seed=settings.seed).random_base2(settings.points_log2):
        factor = settings.size_factor ** (2.0 * place[-1] - 1.0)
        values = fit.mapping | {p.key: float(np.clip(factor * fit.mapping[p.key], p.low, p.high)) for p in sizes}
        values |= {p.key: p.low + s * (p.high - p.low) for p, s in zip(nuisances, place[:-1], strict=True)}
        known = sorted(chi2)
        limit = known[settings.starts - 1] if len(known) >= settings.starts else np.inf
        if (left := _chi2_up_to(baseline, fit, values, limit)) < limit:
            points.append(values)
            chi2.append(left)
    return [points[i] for i in np.argsort(chi2, kind="stable")[: settings.starts]]


def _chi2_up_to(baseline: Baseline, fit: Fit, values: Mapping[str, float], limit: float) -> float:
    """chi2 of a hypothesis at `values` by key, simulated run by run; infinite once it is above the `limit`."""
    problem = baseline.problem
    residual = np.zeros(problem.size)
    for run in problem.runs:
        try:
            residual = problem.residual(values, fit.hypothesis, (run,), residual, FAST)
        except (InputError, SimulationError):
            return np.inf
        if residual @ residual > limit:
            return np.inf
    return float(residual @ residual)
