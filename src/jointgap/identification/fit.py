"""Fits of a model to measured data by forward simulation, and what they say of parameters and hypotheses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.bounded_normal import BoundedNormal, bounded_normal
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.gauss_newton import StoppingRule, bounded_step, broyden_update, next_damping
from jointgap.identification.problem import Hypothesis, Problem, label_of
from jointgap.identification.protocol import Parameter
from jointgap.identification.settings import DEFAULT_SETTINGS, DampingSettings, IdentificationSettings

CONVERGED, STOPPED, FAILED, MATCHED = "converged", "stopped", "failed", "matched"

_ROUGH = "steps that should help do not: the motion depends on its parameters roughly here"


@dataclass(frozen=True)
class Fit:
    """One hypothesis fitted."""

    hypothesis: Hypothesis
    parameters: tuple[Parameter, ...]  # What was varied, k of them
    values: np.ndarray  # [SI]
    residual: np.ndarray  # Whitened
    jacobian: np.ndarray  # Derivatives of the residual [1/SI]
    simulations: int  # Runs simulated
    status: str  # ``converged``
    reason: str = ""  # What to know of the status; empty where all is well
    slope: np.ndarray | None = None  # Half the derivative of chi2 by the values [1/SI]
    shifts: np.ndarray | None = None  # What m other numerics, or other starts, change in the values [SI]
    draws: np.ndarray | None = None
    settings: IdentificationSettings = DEFAULT_SETTINGS  # Those of the problem that was fitted
    gap_left: float = 1.0  # [1] Gap on the held-out data, where these were predicted

    @property
    def label(self) -> str:
        """The hypothesis in words."""
        return label_of(self.hypothesis)

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals; infinite where the fit failed."""
        return np.inf if self.status == FAILED else float(self.residual @ self.residual)

    @property
    def bic(self) -> float:
        """Bayesian information criterion: chi2 + k ln n (Schwarz 1978), and 2 ln m for each choice among m.

        Parameters that change nothing (`active`) do not count. A nuisance that an effect replaces still counts, since
        the effect says that it is out of its range; otherwise replacing would be cheaper than adding.
        """
        replaced = sum(len(candidate.replaces) for candidate in self.hypothesis)
        size, counted = self.residual.size, zip(self.parameters, self.active, strict=True)
        price = sum(p.price(size) for p, active in counted if active or p.choices)
        return self.chi2 + price + replaced * np.log(size)

    @property
    def active(self) -> np.ndarray:
        """Which parameters change what was measured, over their range or a typical step where it has no end: (k,) bool.

        The first angle of a run whose drive is the measured angle changes nothing, nor does a mass where no force is
        read.
        """
        if self.status == FAILED:  # nothing is known of its derivatives
            return np.ones(len(self.parameters), bool)
        low, high = bounds_of(self.parameters)
        steps = np.array([p.step for p in self.parameters])
        reach = np.where(np.isfinite(high - low), high - low, steps)
        return np.linalg.norm(self.jacobian, axis=0) * reach > self.settings.differences.negligible_change

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
        """Factor of the variance where more than noise is left [1]: chi2 over its degrees of freedom, or the squared
        gap of the held-out data if that is more."""
        return max(self._inflation_of_chi2, self.gap_left**2)

    @property
    def scale(self) -> float:
        """Factor of errors and intervals beside those of noise alone [1]: the largest gap that is left, at least 1; 1
        where features of the cycle told the values, to which samples say nothing."""
        return 1.0 if self.status == MATCHED else float(np.sqrt(self.inflation))

    @property
    def _inflation_of_chi2(self) -> float:
        return max(1.0, self.chi2 / max(self.residual.size - self.values.size, 1))

    @cached_property
    def distribution(self) -> BoundedNormal:
        """What the data and the bounds say of the values, for intervals; variances inflated like the `covariance`."""
        if self.status == FAILED:  # nothing is known
            return BoundedNormal(np.zeros((self.values.size, self.values.size)))
        low, high = self._bounds()
        if self.draws is not None:  # they hold what the fitted data leave already
            wider = np.sqrt(self.inflation / self._inflation_of_chi2)
            draws, shifts = self.values + wider * (self.draws - self.values), self.shifts
            if shifts is not None:
                draws = draws + np.random.default_rng(0).standard_normal((len(draws), len(shifts))) @ shifts
            draws = self.draws if wider == 1.0 and shifts is None else np.clip(draws, low, high)
            return BoundedNormal(np.atleast_2d(np.cov(draws, rowvar=False)), draws)
        shifts = np.empty((0, self.values.size)) if self.shifts is None else self.shifts
        slope = np.nan_to_num(self.half_derivative)
        intervals = self.settings.intervals
        return bounded_normal(self.jacobian, slope, self.inflation, self.values, low, high, shifts, intervals)

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds [SI], each (k,); choices are held where they are."""
        held = np.array([bool(p.choices) for p in self.parameters], dtype=bool)
        low, high = bounds_of(self.parameters)
        return np.where(held, self.values, low), np.where(held, self.values, high)

    def covariance(self, released: Sequence[int] = ()) -> np.ndarray:
        """Of the values, (k, k) [SI], where those at a bound are held there: zero rows for them.

        It is for steps and comparisons about the values. What is stated of the values is the `distribution`. Inflated
        where the residual is more than noise.

        Flat bounds count as what they say of a parameter by themselves, a twelfth of the squared width, so that what
        the data do not determine is no more uncertain than that.
        """
        if self.status == FAILED:  # nothing is known
            return np.zeros((self.values.size, self.values.size))
        low, high = self._bounds()
        length = np.linalg.norm(self.jacobian, axis=0)
        width = high - low
        inside = (self.values > low) & (self.values < high)
        inside[list(released)] = True
        free = inside & ((length > 0) | np.isfinite(width))
        covariance = np.zeros((self.values.size, self.values.size))
        if free.any():
            inflation = max(1.0, self.chi2 / max(self.residual.size - free.sum(), 1), self.gap_left**2)
            bounded = np.isfinite(width) & (width > 0)
            prior = np.diag(np.where(bounded, np.sqrt(12.0 * inflation) / np.where(bounded, width, 1.0), 0.0))
            rows = np.vstack([self.jacobian, prior])[:, free]
            scale = np.linalg.norm(rows, axis=0)
            _, singular_values, right = np.linalg.svd(rows / scale, full_matrices=False)
            # a combination that changes nothing is as uncertain as rounding allows to say, not certain
            least = self.settings.intervals.least_singular_value * singular_values[0]
            inverse = right.T / np.maximum(singular_values, least)
            covariance[np.ix_(free, free)] = inflation * (inverse @ inverse.T) / np.outer(scale, scale)
        return covariance


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
    smoother: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Fit:
    """Fit nuisances and the parameters of a hypothesis's effects, with few simulations.

    Gauss-Newton steps within bounds, damped where they overreach; the Jacobian is made once, corrected after each step
    by what the step found, and made anew where that no longer helps (`jointgap.identification.gauss_newton`). Of whole
    numbers of a run, which no step leads from one to another, all are tried before the first step and after the last
    one.
    """
    parameters = tuple(problem.parameters(hypothesis) if vary is None else vary)
    differences = differences or FiniteDifferences(problem)
    simulations = problem.simulations
    descent = _Descent(problem, hypothesis, parameters, start or {}, differences, smoother)

    def finished(status: str, reason: str = "") -> Fit:
        count = problem.simulations - simulations
        found = Fit(hypothesis, parameters, descent.values, descent.residual, descent.jacobian, count, status, reason)
        return replace(found, settings=problem.settings)

    try:
        descent.begin(known_derivatives)
    except (InputError, SimulationError) as error:
        return finished(FAILED, str(error))
    status, reason, goes_on = STOPPED, "", True
    while goes_on:
        stopping = StoppingRule(
            problem.settings.stopping,
            problem.size,
            differences.numerical_noise_chi2,
            sufficient_chi2,
            smoothed=smoother is not None,
        )
        try:
            status, reason = _descend(descent, stopping, problem.settings.damping)
        except (InputError, SimulationError) as error:  # of a Jacobian that was to be made anew
            status, reason = STOPPED, str(error)
        # a fit that is smoothed, or beaten, is no rival: it keeps its choices
        beaten = descent.chi2 > problem.settings.stopping.beaten_factor * sufficient_chi2
        goes_on = smoother is None and not beaten and descent.choose()
        if goes_on:
            try:
                descent.renew()
            except (InputError, SimulationError) as error:
                status, reason, goes_on = STOPPED, str(error), False
    if refresh:
        try:
            descent.jacobian = descent.derivatives(fine=smoother is None)
        except (InputError, SimulationError) as error:
            reason = reason or str(error)
    return finished(status, reason)


def _descend(descent: "_Descent", stopping: StoppingRule, damping: DampingSettings) -> tuple[str, str]:
    """Take steps until the stopping rule ends them: the status, and what to know of it."""
    stopping.record(descent.chi2)
    for iteration in range(stopping.max_steps):
        if stopping.poor_and_slow():
            return STOPPED, "poor, and hardly better from step to step"
        if not descent.fresh and stopping.creeping(iteration):
            if not stopping.renew(iteration):
                return STOPPED, f"hardly better from step to step after {iteration}"
            descent.renew()
        min_decrease = stopping.min_decrease()
        step, predicted = descent.propose()
        if predicted < min_decrease and (descent.fresh or descent.trusted):
            return (CONVERGED, "") if descent.damping < damping.rough else (STOPPED, _ROUGH)
        gain_ratio = -np.inf  # a worn Jacobian that promises nothing is as bad as a step that fails
        if predicted >= min_decrease:
            gain_ratio = descent.attempt(step, predicted)
            stopping.record(descent.chi2)
        descent.trusted = gain_ratio > damping.trusted_gain_ratio
        following = next_damping(descent.damping, gain_ratio, descent.fresh, damping)
        if following is None:
            descent.renew()
        else:
            descent.damping = following
    return STOPPED, f"no end after {stopping.max_steps} steps"


class _Descent:
    """Where a fit stands, and how it moves."""

    def __init__(
        self,
        problem: Problem,
        hypothesis: Hypothesis,
        parameters: Sequence[Parameter],
        start: Mapping[str, float],
        differences: FiniteDifferences,
        smoother: Callable[[np.ndarray], np.ndarray] | None,
    ):
        self._problem, self._hypothesis, self._differences = problem, hypothesis, differences
        self._parameters, self._smooth = parameters, smoother or (lambda values: values)
        self._fixed = {p.key: p.nominal for p in problem.parameters(hypothesis)} | dict(start)
        self._low, self._high = bounds_of(parameters)
        self.values = np.clip([self._fixed[p.key] for p in parameters], self._low, self._high)
        self.residual, self.jacobian = np.full(problem.size, np.nan), np.empty((problem.size, 0))
        self.fresh, self.trusted, self.damping = True, smoother is None, 0.0

    def begin(self, known_derivatives: Mapping[str, np.ndarray] | None) -> None:
        """Simulate the start; columns of the Jacobian in `known_derivatives` are taken as they are."""
        self.residual = self._simulate(self.values)
        self._smoothed = self._smooth(self.residual)
        if self.choose():
            known_derivatives = None  # they are of another motion
        self.jacobian = self.derivatives(known_derivatives)
        self.fresh = not known_derivatives

    @property
    def chi2(self) -> float:
        """Sum of squares of what is to be small."""
        return float(self._smoothed @ self._smoothed)

    def derivatives(self, known_derivatives: Mapping[str, np.ndarray] | None = None, fine: bool = False) -> np.ndarray:
        """The Jacobian here, (n, k); `known_derivatives` and `fine` as in `FiniteDifferences.jacobian`."""
        at = self._by_key(self.values)
        return self._differences.jacobian(
            self._parameters, at, self.residual, self._hypothesis, known_derivatives, fine
        )

    def choose(self) -> bool:
        """Try every choice of each run that is not met, and take the one that leaves least, if that is clearly less:
        whether one was taken."""
        least_fall, chose = self._problem.settings.stopping.least_fall_by_choice, False
        for place, parameter in enumerate(self._parameters):
            if not parameter.choices or self._is_met(parameter.run):
                continue
            before, best = self.values[place], (self.values, self.residual, self._smoothed)
            for choice in parameter.choices:
                if choice == before:
                    continue
                values = self.values.copy()
                values[place] = choice
                try:
                    residual = self._problem.residual(
                        self._by_key(values), self._hypothesis, (parameter.run,), self.residual
                    )
                except (InputError, SimulationError):
                    continue
                smoothed = self._smooth(residual)
                if smoothed @ smoothed < best[2] @ best[2]:
                    best = values, residual, smoothed
            if self.chi2 - best[2] @ best[2] > least_fall:
                self.values, self.residual, self._smoothed = best
                self.fresh, self.trusted, chose = False, False, True
        return chose

    def _is_met(self, run: str) -> bool:
        """Whether each channel of a run leaves what noise does."""
        sigmas = self._problem.settings.stopping.met_sigmas
        for part in (part for part in self._problem.parts if part.series.run == run):
            own = self.residual[part.place]
            if own @ own > own.size + sigmas * np.sqrt(2.0 * own.size):
                return False
        return True

    def renew(self) -> None:
        """Make the Jacobian anew here; the next step is undamped."""
        self.jacobian, self.fresh, self.damping = self.derivatives(), True, 0.0

    def propose(self) -> tuple[np.ndarray, float]:
        """The step (k,) [SI], and the decrease of chi2 that the linear model predicts for it."""
        low, high = self._low - self.values, self._high - self.values
        step, remainder = bounded_step(self._smooth(self.jacobian), self._smoothed, low, high, self.damping)
        return step, self._smoothed @ self._smoothed - remainder

    def attempt(self, step: np.ndarray, predicted: float) -> float:
        """Try a step, and keep it where chi2 falls: its gain ratio, -inf where it cannot be simulated.

        The Jacobian learns from the step either way.
        """
        values = np.clip(self.values + step, self._low, self._high)
        try:
            residual = self._simulate(values)
        except (InputError, SimulationError):
            return -np.inf
        smoothed = self._smooth(residual)
        gain_ratio = (self._smoothed @ self._smoothed - smoothed @ smoothed) / predicted
        self.jacobian = broyden_update(self.jacobian, values - self.values, residual - self.residual)
        if gain_ratio > 0:
            self.values, self.residual, self._smoothed = values, residual, smoothed
            self.fresh = False
        return gain_ratio

    def _simulate(self, values: np.ndarray) -> np.ndarray:
        return self._problem.residual(self._by_key(values), self._hypothesis)

    def _by_key(self, values: np.ndarray) -> dict[str, float]:
        return self._fixed | {p.key: float(v) for p, v in zip(self._parameters, values, strict=True)}
