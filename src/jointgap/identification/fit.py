"""Gauss-Newton fits, parameter distributions and estimates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import chdtrc, log_ndtr, ndtri_exp

from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.problem import Hypothesis, Problem, label_of
from jointgap.identification.settings import (
    DEFAULT_SETTINGS,
    DampingSettings,
    IdentificationSettings,
    IntervalSettings,
    StoppingSettings,
)


@dataclass(frozen=True)
class BoundedNormal:
    """A normal distribution of k parameters within bounds."""

    covariance: np.ndarray  # [SI] Within the bounds; zero rows of undetermined parameters
    draws: np.ndarray | None = None  # [SI]


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
    """The distribution around the minimum of ``|residual|^2`` within bounds, for linear
    residuals."""
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
    singular_values = np.maximum(
        singular_values, settings.least_singular_value * max(singular_values[0], 1e-300)
    )
    # in the axes of chi2: variance `inflation` plus that of the shifts, whose signs and
    # correlations are unknown
    changed = (
        singular_values[:, None] * right * (np.sqrt(np.sum(shifts[:, live] ** 2, axis=0)) / unit)
    )
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
    precision = (right.T * singular_values) @ np.linalg.solve(
        variance, singular_values[:, None] * right
    )
    pull = -right.T @ (singular_values * beyond)
    axes = np.vstack([np.eye(unit.size), right])
    if shifts.any():  # then the axes of the distribution differ from those of chi2
        axes = np.vstack([axes, np.linalg.eigh(free)[1].T])
    drawn = (
        _gibbs(precision, pull, np.minimum(below, 0.0), np.maximum(above, 0.0), axes, settings)
        * unit
    )
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
    """Draws (s, k) of the density exp(pull x - x precision x / 2) from `low` to `high` (k,), along
    `axes` (a, k)."""
    generator = np.random.default_rng(0)
    least = 1e-12 * np.trace(precision)  # rounding may make the curvature negative
    x = np.zeros((settings.chains, low.size))
    kept = []
    for sweep in range(settings.settling_sweeps + settings.sweeps):
        for axis in axes:
            curvature = max(float(axis @ precision @ axis), least)
            moving = np.abs(axis) > 1e-12
            with np.errstate(invalid="ignore"):
                ends = (low - x)[:, moving] / axis[moving], (high - x)[:, moving] / axis[moving]
            begin, end = np.minimum(*ends).max(axis=1), np.maximum(*ends).min(axis=1)
            mean = (pull @ axis - x @ (precision @ axis)) / curvature
            x = x + _truncated_normal(generator, mean, curvature**-0.5, begin, end)[:, None] * axis
            x = np.clip(x, low, high)
        if sweep >= settings.settling_sweeps:
            kept.append(x)
    return np.concatenate(kept)


def _truncated_normal(
    generator: np.random.Generator, mean: np.ndarray, sd: float, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Truncated normal numbers with `mean` (c,) and `sd` from `low` to `high` (c,), by the inverse
    distribution."""
    a, b = (low - mean) / sd, (high - mean) / sd
    turned = a > -b  # in the left tail small probabilities are exact
    a, b = np.where(turned, -b, a), np.where(turned, -a, b)
    log_a, log_b = log_ndtr(a), log_ndtr(b)
    share = generator.random(mean.size)
    z = ndtri_exp(np.minimum(log_b + np.log(share + (1.0 - share) * np.exp(log_a - log_b)), 0.0))
    z = np.clip(z, a, np.maximum(b, a))
    return mean + sd * np.where(turned, -z, z)


class Direction(NamedTuple):
    """A parameter that is varied, and the values and hypothesis where it is."""

    parameter: Parameter
    values: Mapping[str, float]
    hypothesis: Hypothesis


class LinearisedColumn(NamedTuple):
    """Derivative (n,) [1/SI] of the residuals of some `runs`; zero in the others."""

    derivative: np.ndarray
    runs: tuple[str, ...]


class FiniteDifferences:
    """Derivatives of a problem's residuals, with adapted steps."""

    def __init__(self, problem: Problem):
        self.problem = problem
        statistics = sum(
            part.place.stop - part.place.start for part in problem.parts if part.series.statistic
        )
        self.settings = problem.settings.differences
        self.target = max(
            self.settings.target_length, self.settings.target_per_statistic * np.sqrt(statistics)
        )
        self._steps: dict[str, float] = {}
        self.numerical_noise = 0.0

    @property
    def numerical_noise_chi2(self) -> float:
        """Change of chi2 by numerical noise (added to residuals of about unit length along it)."""
        return 2.0 * self.numerical_noise

    def probe(
        self, parameters: Sequence[Parameter], values: Mapping[str, float], residual: np.ndarray
    ) -> None:
        """Estimate the numerical noise: norm of the whitened change for tiny changes of parameters.

        It limits derivatives and the accuracy of fits, as the integration steps depend on contact
        times.
        """
        count = self.settings.probed_parameters
        shared = [p for p in parameters if p.run is None][:count] or list(parameters[:count])
        changes = []
        for p in shared:
            size = self.settings.probe_step * p.step
            step = size * (1.0 if values[p.key] + 2.0 * size <= p.high else -1.0)
            changes.append(self._noise_of(p.key, step, values, residual))
        self.numerical_noise = float(max(changes, default=0.0))
        self.target = max(
            self.target, self.settings.target_over_numerical_noise * self.numerical_noise
        )

    def _noise_of(
        self, key: str, step: float, values: Mapping[str, float], residual: np.ndarray
    ) -> float:
        """Norm of the part of a change that is not proportional to the step."""
        change = self.problem.residual({**values, key: values[key] + step}) - residual
        length = float(np.linalg.norm(change))
        if length <= 0.5 * self.problem.settings.stopping.min_decrease:
            return length
        twice = self.problem.residual({**values, key: values[key] + 2.0 * step}) - residual
        return min(length, float(np.linalg.norm(twice - 2.0 * change)))

    def jacobian(
        self,
        parameters: Sequence[Parameter],
        values: Mapping[str, float],
        residual: np.ndarray,
        hypothesis: Hypothesis,
        known_derivatives: Mapping[str, np.ndarray] | None = None,
        fine: bool = False,
    ) -> np.ndarray:
        """Derivatives of the residuals: by linearisation where the model offers it and they need
        not be `fine`, else by differences."""
        columns = dict(known_derivatives or {})
        unknown = [p for p in parameters if p.key not in columns]
        linearised: list[LinearisedColumn | None] = [None] * len(unknown)
        if not fine:
            directions = [Direction(p, values, hypothesis) for p in unknown]
            linearised = self.linearised(values, hypothesis, directions)
        for p, known in zip(unknown, linearised, strict=True):
            columns[p.key] = self.column(p, values, residual, hypothesis, fine, known)
        return np.column_stack(
            [columns[p.key] for p in parameters] or [np.empty((residual.size, 0))]
        )

    def linearised(
        self,
        values: Mapping[str, float],
        hypothesis: Hypothesis,
        directions: Sequence[Direction],
    ) -> list[LinearisedColumn]:
        """Derivatives at `values` by linearisation, as far as the model linearises its runs.

        The values and hypotheses of the `directions` give the same residuals as `values` and
        `hypothesis`, such as those of an effect of size 0.
        """
        steps, variations = [], []
        for p, here, effects in directions:
            step = self._within(p, self.settings.linearised_step * p.step)
            steps.append(step if here[p.key] + step <= p.high else -step)
            variations.append(({**here, p.key: here[p.key] + steps[-1]}, effects))
        changes = self.problem.linearised(values, hypothesis, variations)
        return [
            LinearisedColumn(change / step, runs)
            for (change, runs), step in zip(changes, steps, strict=True)
        ]

    def column(
        self,
        parameter: Parameter,
        values: Mapping[str, float],
        residual: np.ndarray,
        hypothesis: Hypothesis,
        fine: bool = False,
        linearised: LinearisedColumn | None = None,
    ) -> np.ndarray:
        """Derivative with respect to one parameter, (n,) [1/SI]; by differences in the runs that
        are not `linearised`."""
        runs = self.problem.runs if parameter.run is None else (parameter.run,)
        if linearised is not None:
            runs = tuple(run for run in runs if run not in linearised.runs)
            if not runs:
                return linearised.derivative
        settings, target = self.settings, self.target
        if not fine:
            target = max(
                target, settings.target_share_of_residual * float(np.linalg.norm(residual))
            )
        step = self._steps.get(parameter.key, parameter.step)
        change, step = self._change(parameter, step, values, residual, hypothesis, runs)
        length, accepted = float(np.linalg.norm(change)), settings.accepted_factor
        if length > 0 and not target / accepted < length < target * accepted:
            ratio = np.clip(target / length, settings.min_step_ratio, settings.max_step_ratio)
            better, other = self._within(parameter, step * ratio), settings.min_step_change
            if abs(better) < abs(step) / other or abs(better) > abs(step) * other:
                try:
                    change, step = self._change(
                        parameter, abs(better), values, residual, hypothesis, runs
                    )
                except (InputError, SimulationError):
                    pass  # keep the first change
        self._steps[parameter.key] = abs(step)
        derivative = change / step
        return derivative if linearised is None else derivative + linearised.derivative

    def _within(self, parameter: Parameter, step: float) -> float:
        span = parameter.high - parameter.low
        return min(step, self.settings.max_share_of_range * span) if np.isfinite(span) else step

    def _change(
        self, parameter, step, values, residual, hypothesis, runs
    ) -> tuple[np.ndarray, float]:
        """Change of the residuals of `runs` over a step up, or down if up is out of bounds or
        fails."""
        here, step = values[parameter.key], self._within(parameter, step)
        problems = []
        for signed in (step, -step) if here + step <= parameter.high else (-step,):
            if not parameter.low <= here + signed <= parameter.high:
                continue
            shifted = {**values, parameter.key: here + signed}
            try:
                return self.problem.residual(shifted, hypothesis, runs, residual) - residual, signed
            except (InputError, SimulationError) as error:
                problems.append(error)
        raise (
            problems[0]
            if problems
            else SimulationError(f"{parameter.key} cannot be varied within its bounds")
        )


def compress_rows(*blocks: np.ndarray) -> list[np.ndarray]:
    """The columns of the blocks in fewer rows, with the same inner products."""
    wide = [block[:, None] if block.ndim == 1 else block for block in blocks]
    small = np.linalg.qr(np.hstack(wide), mode="r")
    ends = np.cumsum([block.shape[1] for block in wide])[:-1]
    return [
        part[:, 0] if block.ndim == 1 else part
        for part, block in zip(np.split(small, ends, axis=1), blocks, strict=True)
    ]


def bounded_step(
    jacobian: np.ndarray,
    residual: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    damping: float = 0.0,
) -> tuple[np.ndarray, float]:
    """The step within bounds that minimises ``|residual + jacobian @ step|^2``, and the minimum."""
    length = np.linalg.norm(jacobian, axis=0)
    live = (length > 0) & (high > low)
    step = np.zeros(jacobian.shape[1])
    if not live.any():
        return step, float(residual @ residual)
    small, rest = compress_rows(jacobian[:, live] / length[live], residual)
    # a small damping keeps inactive combinations of parameters off the bounds
    ridge = np.sqrt(damping + 1e-10) * np.eye(small.shape[1])
    scale = length[live]
    bounds = np.minimum(low[live], 0.0) * scale, np.maximum(high[live], 0.0) * scale
    matrix, target = np.vstack([small, ridge]), np.concatenate([-rest, np.zeros(small.shape[1])])
    free = np.linalg.lstsq(matrix, target, rcond=None)[0]
    if (free < bounds[0]).any() or (free > bounds[1]).any():
        free = lsq_linear(matrix, target, bounds, method="bvls").x
    step[live] = free / scale
    remainder = rest + small @ free
    return step, float(remainder @ remainder + max(residual @ residual - rest @ rest, 0.0))


def broyden_update(jacobian: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The Jacobian corrected for one step (Broyden 1965), with scaled columns."""
    weight = step * np.sum(jacobian**2, axis=0)
    if not (inner := weight @ step) > 0:
        return jacobian
    return jacobian + np.outer(change - jacobian @ step, weight / inner)


def next_damping(
    damping: float, gain_ratio: float, fresh: bool, settings: DampingSettings
) -> float | None:
    """The damping of the next step; None: recompute the Jacobian instead (if it is not `fresh`)."""
    if gain_ratio > settings.good_gain_ratio:
        return damping / settings.factor if damping > settings.negligible else 0.0
    return max(settings.factor * damping, settings.first) if fresh else None


class StoppingRule:
    """End of a descent, from the history of chi2."""

    def __init__(
        self,
        settings: StoppingSettings,
        size: int,
        numerical_noise_chi2: float = 0.0,
        sufficient_chi2: float = np.inf,
    ):
        self.settings, self.size = settings, size
        self._numerical_noise, self._sufficient = numerical_noise_chi2, sufficient_chi2
        self._stalled = max(settings.stalled_decrease, numerical_noise_chi2)
        self._renewed, self._chi2_at_renewal, self._minimum = 0, np.inf, np.inf
        self.chi2: list[float] = []

    def record(self, chi2: float) -> None:
        """Record chi2 at the start and after each tried step."""
        self.chi2.append(chi2)

    def _before(self, steps: int) -> float:
        return self.chi2[max(len(self.chi2) - 1 - steps, 0)]

    def min_decrease(self) -> float:
        """The smallest predicted decrease of chi2 for a further step."""
        chi2 = self.chi2[-1]
        per_sample = max(1.0, chi2 / self.size)
        wanted = min(self.settings.min_decrease * per_sample**2, per_sample)
        return max(wanted, self._numerical_noise)

    def poor_and_slow(self) -> bool:
        """Whether the fit is poor and hardly improves; earlier for a dominated one."""
        settings, chi2 = self.settings, self.chi2[-1]
        dominated = chi2 > settings.dominated_factor * self._sufficient
        window = settings.dominated_window if dominated else settings.stalled_window
        progress = settings.dominated_progress if dominated else settings.poor_progress
        if len(self.chi2) <= window:
            return False
        slow = self._before(window) - chi2 < progress * chi2
        return slow and progress * chi2 > progress * settings.poor_chi2_per_sample * self.size

    def dominated(self, minimum: float) -> bool:
        """Record the predicted `minimum` of a linear model that has proved right; whether it is far
        above a sufficient chi2 and hardly less than the one before."""
        before, self._minimum = self._minimum, minimum
        is_far = minimum > self._sufficient + self.settings.dominated_excess
        return is_far and minimum > (1.0 - self.settings.dominated_progress) * before

    def stalled(self, iteration: int) -> bool:
        """Whether a long fit hardly improves with its corrected Jacobian."""
        settings = self.settings
        long = iteration >= self._renewed + settings.stalled_after
        return long and self._before(settings.stalled_window) - self.chi2[-1] < self._stalled

    def renew(self, iteration: int) -> bool:
        """Record a new Jacobian of a stalled fit; False if the last one did not help."""
        if self._renewed and self._chi2_at_renewal - self.chi2[-1] < self._stalled:
            return False
        self._renewed, self._chi2_at_renewal = iteration, self.chi2[-1]
        return True


CONVERGED, STOPPED, FAILED = "converged", "stopped", "failed"

NEEDS_DERIVATIVES = "the linear model has proved wrong: new derivatives are needed"
"""Reason of a provisional fit."""

_NONSMOOTH = "predicted decreases are not found: the residual is nonsmooth here"


@dataclass(frozen=True)
class Fit:
    """One hypothesis fitted."""

    hypothesis: Hypothesis
    parameters: tuple[Parameter, ...]  # The varied ones, k
    values: np.ndarray  # [SI]
    residual: np.ndarray  # Whitened
    jacobian: np.ndarray  # Derivatives of the residual [1/SI]
    simulations: int  # Number of simulated runs
    status: str  # ``converged``, ``stopped`` or ``failed``
    reason: str = ""  # Of a status other than converged
    slope: np.ndarray | None = None  # Half the derivative of chi2 by the values [1/SI]
    shifts: np.ndarray | None = (
        None  # Changes (m, k) [SI] of the values by m solver variants or other minima
    )
    draws: np.ndarray | None = None
    settings: IdentificationSettings = DEFAULT_SETTINGS  # Of the problem
    gap_left: float = 1.0  # [1] Gap on the held-out data, once predicted
    states: Mapping[str, np.ndarray] | None = (
        None  # By run (k, d): states of loose joints in k windows, if estimated
    )

    @property
    def in_windows(self) -> bool:
        """Whether states of loose joints were estimated in windows of the record."""
        return self.states is not None

    @property
    def label(self) -> str:
        return label_of(self.hypothesis)

    @cached_property
    def chi2(self) -> float:
        """Sum of squared whitened residuals; infinite if the fit failed."""
        return np.inf if self.status == FAILED else float(self.residual @ self.residual)

    @cached_property
    def predicted_chi2(self) -> float:
        """The minimum of chi2 that the derivatives predict."""
        low, high = bounds_of(self.parameters)
        return bounded_step(self.jacobian, self.residual, low - self.values, high - self.values)[1]

    @cached_property
    def bic(self) -> float:
        """Bayesian information criterion: chi2 + k ln n (Schwarz 1978).

        Only `active` parameters count, and nuisances that an effect replaces, as replacing must not
        be cheaper than adding.
        """
        replaced = sum(len(candidate.replaces) for candidate in self.hypothesis)
        return self.chi2 + (self.active.sum() + replaced) * np.log(self.residual.size)

    @cached_property
    def active(self) -> np.ndarray:
        """Mask (k,) of parameters that influence the residual, over their range or a typical
        step."""
        if self.status == FAILED:  # without derivatives
            return np.ones(len(self.parameters), bool)
        low, high = bounds_of(self.parameters)
        steps = np.array([p.step for p in self.parameters])
        reach = np.where(np.isfinite(high - low), high - low, steps)
        return (
            np.linalg.norm(self.jacobian, axis=0) * reach
            > self.settings.differences.negligible_change
        )

    @property
    def mapping(self) -> dict[str, float]:
        """Values by key."""
        return {p.key: float(value) for p, value in zip(self.parameters, self.values, strict=True)}

    @property
    def half_derivative(self) -> np.ndarray:
        """Half the derivative of chi2 by the values, (k,) [1/SI]."""
        return self.jacobian.T @ self.residual if self.slope is None else self.slope

    @property
    def inflation(self) -> float:
        """Factor on variances [1]: reduced chi2 or the squared gap of the held-out data, at least
        1."""
        return max(self._inflation_of_chi2, self.gap_left**2)

    @property
    def scale(self) -> float:
        """Factor on errors and intervals [1]: root of `inflation`."""
        return float(np.sqrt(self.inflation))

    @property
    def _inflation_of_chi2(self) -> float:
        return max(1.0, self.chi2 / max(self.residual.size - self.values.size, 1))

    @cached_property
    def distribution(self) -> BoundedNormal:
        """Distribution of the values by data and bounds, for intervals; inflated like the
        `covariance`."""
        if self.status == FAILED:
            return BoundedNormal(np.zeros((self.values.size, self.values.size)))
        low, high = bounds_of(self.parameters)
        if self.draws is not None:  # they include the inflation by chi2
            wider = np.sqrt(self.inflation / self._inflation_of_chi2)
            draws, shifts = self.values + wider * (self.draws - self.values), self.shifts
            if shifts is not None:
                draws = (
                    draws
                    + np.random.default_rng(0).standard_normal((len(draws), len(shifts))) @ shifts
                )
            draws = self.draws if wider == 1.0 and shifts is None else np.clip(draws, low, high)
            return BoundedNormal(np.atleast_2d(np.cov(draws, rowvar=False)), draws)
        shifts = np.empty((0, self.values.size)) if self.shifts is None else self.shifts
        slope = np.nan_to_num(self.half_derivative)
        intervals = self.settings.intervals
        return bounded_normal(
            self.jacobian, slope, self.inflation, self.values, low, high, shifts, intervals
        )

    def covariance(self, released: Sequence[int] = ()) -> np.ndarray:
        """Covariance (k, k) [SI] of the values, inflated if the residual exceeds noise; zero rows
        for values at a bound, unless `released`.

        For steps and comparisons; stated intervals follow from the `distribution`. Bounds count as
        a prior with the variance of a uniform distribution.
        """
        if self.status == FAILED:
            return np.zeros((self.values.size, self.values.size))
        low, high = bounds_of(self.parameters)
        length = np.linalg.norm(self.jacobian, axis=0)
        width = high - low
        inside = (self.values > low) & (self.values < high)
        inside[list(released)] = True
        free = inside & ((length > 0) | np.isfinite(width))
        covariance = np.zeros((self.values.size, self.values.size))
        if free.any():
            inflation = max(
                1.0, self.chi2 / max(self.residual.size - free.sum(), 1), self.gap_left**2
            )
            prior = np.diag(np.sqrt(inflation) * prior_of_bounds(low, high))
            rows = np.vstack([self.jacobian, prior])[:, free]
            scale = np.linalg.norm(rows, axis=0)
            _, singular_values, right = np.linalg.svd(rows / scale, full_matrices=False)
            # limit the uncertainty of inactive combinations
            least = self.settings.intervals.least_singular_value * singular_values[0]
            inverse = right.T / np.maximum(singular_values, least)
            covariance[np.ix_(free, free)] = (
                inflation * (inverse @ inverse.T) / np.outer(scale, scale)
            )
        return covariance


def prior_of_bounds(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Bounds as a prior: one over its standard deviations, (k,) [1/SI], which are those of uniform
    distributions; 0 without bounds."""
    width = high - low
    bounded = np.isfinite(width) & (width > 0.0)
    return np.where(bounded, np.sqrt(12.0) / np.where(bounded, width, 1.0), 0.0)


def bounds_of(parameters: Sequence[Parameter]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds [SI], each (k,)."""
    return np.array([p.low for p in parameters]), np.array([p.high for p in parameters])


def fit_hypothesis(
    problem: Problem,
    hypothesis: Hypothesis = (),
    start: Mapping[str, float] | None = None,
    known_derivatives: Mapping[str, np.ndarray] | None = None,
    differences: FiniteDifferences | None = None,
    *,
    refresh: bool = False,
    vary: Sequence[Parameter] | None = None,
    sufficient_chi2: float = np.inf,
    provisional: bool = False,
) -> Fit:
    """Fit the nuisances and the parameters of a hypothesis with few simulations.

    Damped Gauss-Newton steps within bounds, with Broyden updates of the Jacobian, which is
    recomputed if the fit stalls; a `provisional` fit stops there.
    """
    parameters = tuple(problem.parameters(hypothesis) if vary is None else vary)
    differences = differences or FiniteDifferences(problem)
    simulations = problem.simulations
    descent = _Descent(problem, hypothesis, parameters, start or {}, differences)

    def finished(status: str, reason: str = "") -> Fit:
        count = problem.simulations - simulations
        found = Fit(
            hypothesis,
            parameters,
            descent.values,
            descent.residual,
            descent.jacobian,
            count,
            status,
            reason,
        )
        return replace(found, settings=problem.settings)

    try:
        descent.begin(known_derivatives)
    except (InputError, SimulationError) as error:
        return finished(FAILED, str(error))
    stopping = StoppingRule(
        problem.settings.stopping, problem.size, differences.numerical_noise_chi2, sufficient_chi2
    )
    try:
        status, reason = _descend(descent, stopping, problem.settings.damping, provisional)
    except (InputError, SimulationError) as error:  # in a new Jacobian
        status, reason = STOPPED, str(error)
    if refresh:
        try:
            descent.jacobian = descent.derivatives(fine=True)
        except (InputError, SimulationError) as error:
            reason = reason or str(error)
    return finished(status, reason)


def _descend(
    descent: "_Descent", stopping: StoppingRule, damping: DampingSettings, provisional: bool
) -> tuple[str, str]:
    """Iterate until the stopping rule ends; return status and reason."""
    stopping.record(descent.chi2)
    max_steps, max_renewals = stopping.settings.max_steps, stopping.settings.max_renewals
    for iteration in range(max_steps):
        if descent.renewals > max_renewals:
            return STOPPED, f"not converged with {max_renewals} new Jacobians"
        if stopping.poor_and_slow():
            return STOPPED, "poor fit, stalled"
        if not descent.fresh and stopping.stalled(iteration):
            if not stopping.renew(iteration):
                return STOPPED, f"stalled after {iteration} steps"
            if provisional:
                return STOPPED, NEEDS_DERIVATIVES
            descent.renew()
        min_decrease = stopping.min_decrease()
        step, predicted = descent.propose()
        is_linear = iteration and descent.trusted and not descent.damping
        if is_linear and stopping.dominated(descent.chi2 - predicted):
            return STOPPED, "another effect fits far better"
        if predicted < min_decrease and (descent.fresh or descent.trusted):
            return (CONVERGED, "") if descent.damping < damping.rough else (STOPPED, _NONSMOOTH)
        gain_ratio = -np.inf  # no predicted decrease: treat as a failed step
        if predicted >= min_decrease:
            gain_ratio = descent.attempt(step, predicted)
            stopping.record(descent.chi2)
        descent.trusted = gain_ratio > damping.trusted_gain_ratio
        following = next_damping(descent.damping, gain_ratio, descent.fresh, damping)
        if following is None and provisional:
            return STOPPED, NEEDS_DERIVATIVES
        if following is None:
            descent.renew()
        else:
            descent.damping = following
    return STOPPED, f"not converged after {max_steps} steps"


class _Descent:
    """State of a fit."""

    def __init__(
        self,
        problem: Problem,
        hypothesis: Hypothesis,
        parameters: Sequence[Parameter],
        start: Mapping[str, float],
        differences: FiniteDifferences,
    ):
        self._problem, self._hypothesis, self._differences = problem, hypothesis, differences
        self._parameters = parameters
        self._fixed = {p.key: p.nominal for p in problem.parameters(hypothesis)} | dict(start)
        self._low, self._high = bounds_of(parameters)
        self.values = np.clip([self._fixed[p.key] for p in parameters], self._low, self._high)
        self.residual, self.jacobian = np.full(problem.size, np.nan), np.empty((problem.size, 0))
        self.fresh, self.trusted, self.damping = True, True, 0.0
        self.renewals = 0

    def begin(self, known_derivatives: Mapping[str, np.ndarray] | None) -> None:
        """Simulate the start; `known_derivatives` are used as columns of the Jacobian."""
        self.residual = self._simulate(self.values)
        self.jacobian = self.derivatives(known_derivatives)
        self.fresh = not known_derivatives

    @property
    def chi2(self) -> float:
        return float(self.residual @ self.residual)

    def derivatives(
        self, known_derivatives: Mapping[str, np.ndarray] | None = None, fine: bool = False
    ) -> np.ndarray:
        """The Jacobian here, (n, k); `known_derivatives` and `fine` as in
        `FiniteDifferences.jacobian`."""
        at = self._by_key(self.values)
        return self._differences.jacobian(
            self._parameters, at, self.residual, self._hypothesis, known_derivatives, fine
        )

    def renew(self) -> None:
        """Recompute the Jacobian; the next step is undamped."""
        self.jacobian, self.fresh, self.damping = self.derivatives(), True, 0.0
        self.renewals += bool(self._hypothesis) and self._problem.is_rough

    def propose(self) -> tuple[np.ndarray, float]:
        """The step (k,) [SI], and the decrease of chi2 that the linear model predicts for it."""
        low, high = self._low - self.values, self._high - self.values
        step, remainder = bounded_step(self.jacobian, self.residual, low, high, self.damping)
        return step, self.chi2 - remainder

    def attempt(self, step: np.ndarray, predicted: float) -> float:
        """Try a step, keep it if chi2 falls, and update the Jacobian; return the gain ratio (-inf
        on failure)."""
        values = np.clip(self.values + step, self._low, self._high)
        try:
            residual = self._simulate(values)
        except (InputError, SimulationError):
            return -np.inf
        gain_ratio = (self.chi2 - residual @ residual) / predicted
        self.jacobian = broyden_update(
            self.jacobian, values - self.values, residual - self.residual
        )
        if gain_ratio > 0:
            self.values, self.residual = values, residual
            self.fresh = False
        return gain_ratio

    def _simulate(self, values: np.ndarray) -> np.ndarray:
        return self._problem.residual(self._by_key(values), self._hypothesis)

    def _by_key(self, values: np.ndarray) -> dict[str, float]:
        return self._fixed | {
            p.key: float(v) for p, v in zip(self._parameters, values, strict=True)
        }


def wald_statistic(fit: Fit, candidate: Candidate) -> float:
    """Wald statistic [1] of an effect's amplitudes: the gain in chi2 by the effect within the same
    minimum, for linear residuals (Wald 1943).

    Amplitudes at a bound other than 0 have the error that they would have without the bound.
    """
    amplitudes, free, covariance = _amplitudes(fit, candidate)
    if not free.any():
        return 0.0
    scale = np.sqrt(np.diag(covariance))
    scaled = amplitudes[free] / scale
    return float(
        scaled @ np.linalg.pinv(covariance / np.outer(scale, scale), hermitian=True) @ scaled
    )


def chance(fit: Fit, candidate: Candidate) -> float:
    """Probability [1] of such amplitudes without the effect."""
    amplitudes, free, _ = _amplitudes(fit, candidate)
    statistic = wald_statistic(fit, candidate)
    return float(chdtrc(max(int(free.sum()), 1), statistic)) if amplitudes.size else 1.0


def _amplitudes(fit: Fit, candidate: Candidate) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Amplitudes (m,) of an effect, the mask of those with an error, and their covariance."""
    own = {f"{candidate.label}.{key}" for key in candidate.amplitudes}
    places = [i for i, p in enumerate(fit.parameters) if p.key in own]
    if fit.draws is not None:
        covariance = fit.distribution.covariance
    else:
        covariance = fit.covariance(released=[i for i in places if fit.values[i] != 0.0])
    covariance = covariance[np.ix_(places, places)]
    free = np.diag(covariance) > 0.0
    return fit.values[places], free, covariance[np.ix_(free, free)]


HALF_WIDTHS = {50: 0.6745, 90: 1.645, 99: 2.576}
"""Half widths of intervals of the normal distribution [standard deviations] by level [%]."""

LEVELS = tuple(HALF_WIDTHS)
"""Levels of stated intervals [%]; those besides 90 % serve for the calibration."""

AT_BOUND = "at its bound"
"""Remark: the fit ended at a bound, so there is no standard error."""

NOT_ESTIMATED = "not estimated"
"""Remark: a value that is not fitted, such as the length of a film or an integer order."""

CHANGES_NOTHING = "changes nothing in what was measured"
"""Remark (a value of ``verdict.json``): no measured value depends on it, such as a mass without a
force channel."""

NOT_DETERMINED = "not determined by the data"
"""Remark: the data allow almost the whole range, so there is no interval."""


def nuisance_estimates(fit: Fit) -> list[tuple[Parameter, dict[str, Any]]]:
    """Nuisances of a fit with their estimates as of `coordinate_estimate`, without intervals almost
    as wide as their ranges.
    """
    of_effects = {f"{c.label}.{p.key}" for c in fit.hypothesis for p in c.coordinates}
    active = fit.active

    def estimate(place: int) -> dict[str, Any]:
        p, value = fit.parameters[place], fit.values[place]
        if not active[place]:
            return no_estimate(value, CHANGES_NOTHING)
        found = coordinate_estimate(fit, place)
        low, high = found["interval_90"]
        is_wide = low is not None and high - low >= DEFAULT_SETTINGS.intervals.determined_share * (
            p.high - p.low
        )
        return no_estimate(value, found.get("remark", NOT_DETERMINED)) if is_wide else found

    return [(p, estimate(i)) for i, p in enumerate(fit.parameters) if p.key not in of_effects]


def determined_values(fit: Fit) -> dict[str, float]:
    """Values of a fit by key; nuisances that the data do not determine are nominal.

    Those with a remark: at a bound, without influence, or not determined.
    """
    values = fit.mapping
    for p, estimate in nuisance_estimates(fit):
        if not is_taken_over(estimate):
            values[p.key] = p.nominal
    return values


def is_taken_over(estimate: dict[str, Any]) -> bool:
    """Whether the augmented mechanism uses the fitted value of a nuisance: if the data determine
    it, or if it is not varied.
    """
    return estimate.get("remark", NOT_ESTIMATED) == NOT_ESTIMATED


def coordinate_estimate(fit: Fit, place: int) -> dict[str, Any]:
    """Value, standard error and intervals (`LEVELS`) of the parameter with the index `place`.

    Intervals truncated by bounds are those of the draws. Only at a bound do they end at the value;
    there the standard error is None, with a remark.
    """
    p, value, known = fit.parameters[place], float(fit.values[place]), fit.distribution
    if p.integer:
        return no_estimate(value, NOT_ESTIMATED)
    sd = float(np.sqrt(known.covariance[place, place]))
    if known.draws is None or not sd > 0.0:
        return estimate_with_interval(value, sd, p.low, p.high)
    return _from_draws(value, known.draws[:, place], sd, not p.low < value < p.high, p.low, p.high)


def effect_estimates(fit: Fit, candidate: Candidate) -> dict[str, dict[str, Any]]:
    """Stated parameters of an effect by name, each with an estimate as of `coordinate_estimate`.

    Errors of derived parameters (such as an amplitude from cosine and sine parts) are propagated
    linearly, or by draws if a bound truncates a coordinate.
    """
    keys = [p.key for p in fit.parameters]
    own = [p for p in candidate.coordinates if f"{candidate.label}.{p.key}" in keys]
    columns = [keys.index(f"{candidate.label}.{p.key}") for p in own]
    fitted = {p.key: fit.values[column] for p, column in zip(own, columns, strict=True)}
    known = fit.distribution
    sd = np.sqrt(np.diag(known.covariance))
    values = candidate.parameters(fitted)
    slopes = {name: np.zeros(len(columns)) for name in values}
    for i, (p, column) in enumerate(zip(own, columns, strict=True)):
        if sd[column] > 0:
            step = 1e-3 * sd[column]
            sides = [
                candidate.parameters(fitted | {p.key: fitted[p.key] + sign * step})
                for sign in (1, -1)
            ]
            for name in values:
                slopes[name][i] = (sides[0][name] - sides[1][name]) / (2 * step)
    block = known.covariance[np.ix_(columns, columns)]
    cut = np.array([_is_cut_off(fit, column) for column in columns], dtype=bool)
    # coordinates at a bound, each with a value inside: parameters that depend on them are at the
    # bound too
    inside = [(p, fitted[p.key] + p.step) for p in own if fitted[p.key] <= p.low]
    inside += [(p, fitted[p.key] - p.step) for p in own if fitted[p.key] >= p.high]
    estimates = {}
    for name, value in values.items():
        same = next(
            (
                i
                for p, i in zip(own, columns, strict=True)
                if p.key == name and value == fitted[name]
            ),
            None,
        )
        if same is not None:
            estimates[name] = coordinate_estimate(fit, same)
            continue
        error = float(np.sqrt(max(slopes[name] @ block @ slopes[name], 0.0)))
        at_bound = any(
            candidate.parameters(fitted | {p.key: nearby})[name] != value for p, nearby in inside
        )
        if at_bound and known.draws is None:
            estimates[name] = no_estimate(value, AT_BOUND)
        elif at_bound or (known.draws is not None and any(cut & (slopes[name] != 0.0))):
            mapped = _mapped_draws(fit, candidate, [p.key for p in own], columns, name)
            estimates[name] = _from_draws(float(value), mapped, error, at_bound)
        elif fit.draws is not None and error > 0.0:
            changes = (fit.draws[:, columns] - fit.values[columns]) @ slopes[name]
            estimates[name] = _from_draws(float(value), value + changes, error, False)
        else:
            estimates[name] = estimate_with_interval(value, error, -np.inf, np.inf)
    if candidate.formula:  # no catalogue has its units
        for p in own:
            estimates[p.key]["unit"] = p.unit
    return estimates


def _is_cut_off(fit: Fit, place: int) -> bool:
    """Whether a bound truncates the distribution of a parameter."""
    p, value = fit.parameters[place], fit.values[place]
    far = fit.settings.intervals.far_standard_deviations * np.sqrt(
        fit.distribution.covariance[place, place]
    )
    return bool(min(value - p.low, p.high - value) <= far)


def _mapped_draws(
    fit: Fit, candidate: Candidate, keys: Sequence[str], columns: Sequence[int], name: str
) -> np.ndarray:
    """Draws (s,) of a parameter derived from the coordinates `keys` of an effect (`columns` of the
    fit)."""
    draws = fit.distribution.draws[:, columns]
    draws = draws[:: max(len(draws) // fit.settings.intervals.mapped_draws, 1)]
    return np.array(
        [candidate.parameters(dict(zip(keys, map(float, row), strict=True)))[name] for row in draws]
    )


def _from_draws(
    value: float,
    draws: np.ndarray,
    sd: float,
    at_bound: bool,
    low: float = -np.inf,
    high: float = np.inf,
) -> dict[str, Any]:
    """The estimate of a `value` from its `draws` (s,), with intervals that hold their share of the
    draws.

    They are equal-tailed, but the tail on one side is at most half of the draws on that side of the
    value, so that the value is inside. If hardly a draw is there and the value is at no bound, they
    are symmetric about the value.
    """
    estimate: dict[str, Any] = {"value": value, "sd": None if at_bound else sd}
    below, above = float(np.mean(draws < value)), float(np.mean(draws > value))
    one_sided = not at_bound and min(below, above) < 0.5 - 0.5 * max(LEVELS) / 100.0
    for level in LEVELS:
        share = level / 100.0
        least, most = min(0.5 - 0.5 * share, 0.5 * below), min(0.5 - 0.5 * share, 0.5 * above)
        if most < least:
            least = 1.0 - share - most
        with np.errstate(invalid="ignore"):  # some draws may be infinite
            ends = np.quantile(draws, [least, min(least + share, 1.0)])
            ends = [min(float(ends[0]), value), max(float(ends[1]), value)]
            if one_sided:
                half_width = float(np.quantile(np.abs(draws - value), share))
                ends = [max(value - half_width, low), min(value + half_width, high)]
        # an infinite end, such as of the frequency of a rigid rod, is None
        estimate[f"interval_{level}"] = [end if np.isfinite(end) else None for end in ends]
    return estimate | {"remark": AT_BOUND} if at_bound else estimate


def estimate_with_interval(value: float, sd: float, low: float, high: float) -> dict[str, Any]:
    """Value, standard error and intervals (`LEVELS`) within the bounds; without an error a
    remark."""
    if not sd > 0.0:
        return no_estimate(value, NOT_ESTIMATED if low < value < high else AT_BOUND)
    estimate: dict[str, Any] = {"value": float(value), "sd": float(sd)}
    for level in LEVELS:
        half_width = HALF_WIDTHS[level] * sd
        ends = np.clip([value - half_width, value + half_width], low, high)
        estimate[f"interval_{level}"] = [float(end) for end in ends]
    return estimate


def no_estimate(value: float, remark: str) -> dict[str, Any]:
    """A value without standard error and intervals."""
    intervals = {f"interval_{level}": [None, None] for level in LEVELS}
    return {"value": float(value), "sd": None, **intervals, "remark": remark}
