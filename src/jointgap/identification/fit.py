"""Fits of a model to measured data by forward simulation: bounded, with few simulations.

Gauss-Newton steps within bounds, damped where they overreach (Levenberg-Marquardt); the Jacobian is made once, corrected
after each step by what the step found (Broyden's rank-one update) and made anew where that no longer helps.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.bounded_step import bounded_step
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.problem import Hypothesis, Problem, label_of
from jointgap.identification.protocol import Parameter

CONVERGED, STOPPED, FAILED = "converged", "stopped", "failed"

_GAIN = (
    0.05  # of chi2: less than this is not worth a step; a hundredth of what counts in a BIC. Poor fits need less care.
)
_MOST_STEPS = 80  # valleys may be long
_LONG, _CREEPING = (
    10,
    2.0,
)  # steps, and chi2: a fit that long that gains less over `_PATIENCE` has its Jacobian made anew
_PATIENCE = 4  # steps over which a fit that is still poor has to gain
_PROGRESS = 0.02  # of its chi2
_POOR = 2.0  # chi2 per sample
_BEATEN, _SHORT, _HASTE = 3.0, 2, 0.2  # chi2 over that of an explanation that is enough; patience and progress there
_COARSE, _FEW_STEPS = (
    0.01,
    10,
)  # of its chi2, what a step is worth where fits are but on their way, and how many steps there
_ROUGH = 10.0  # damping at which steps are so short that a gain foretold and not found is the model's roughness
_ROUGHNESS = "steps that should help do not: the motion depends on its parameters roughly here"


@dataclass(frozen=True)
class Fit:
    """One explanation fitted.

    Attributes
    ----------
    hypothesis : tuple of Candidate
    parameters : tuple of Parameter
        What was varied, k of them.
    values : (k,) array
        SI.
    residual : (n,) array
        Whitened.
    jacobian : (n, k) array
        Derivatives of the residual.
    simulations : int
        Runs simulated.
    status : str
        ``converged``; ``stopped``: no further step helps, though one should; ``failed``: see `reason`.
    reason : str
        What to know of the status; empty where all is well.
    """

    hypothesis: Hypothesis
    parameters: tuple[Parameter, ...]
    values: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    simulations: int
    status: str
    reason: str = ""

    @property
    def label(self) -> str:
        """The explanation in words."""
        return label_of(self.hypothesis)

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals; infinite where the fit failed."""
        return np.inf if self.status == FAILED else float(self.residual @ self.residual)

    @property
    def bic(self) -> float:
        """Bayesian information criterion: chi2 + k ln n (Schwarz 1978).

        A nuisance that an effect replaces still counts: the effect says that it is out of its range.
        """
        replaced = sum(len(candidate.replaces) for candidate in self.hypothesis)
        return self.chi2 + (len(self.parameters) + replaced) * np.log(self.residual.size)

    @property
    def mapping(self) -> dict[str, float]:
        """Values by key."""
        return {p.key: float(value) for p, value in zip(self.parameters, self.values, strict=True)}

    def covariance(self) -> np.ndarray:
        """Of the values, (k, k); zero rows for those at a bound. Inflated where the residual is more than noise.

        Flat bounds count as what they say of a parameter by themselves, a twelfth of the squared width, so that what the data
        leave open is no more uncertain than that.
        """
        low, high = bounds_of(self.parameters)
        length = np.linalg.norm(self.jacobian, axis=0)
        width = high - low
        free = (self.values > low) & (self.values < high) & ((length > 0) | np.isfinite(width))
        found = np.zeros((self.values.size, self.values.size))
        if free.any():
            left = max(1.0, self.chi2 / max(self.residual.size - free.sum(), 1))
            known = np.diag(np.where(np.isfinite(width), np.sqrt(12.0 * left) / width, 0.0))
            rows = np.vstack([self.jacobian, known])[:, free]
            scale = np.linalg.norm(rows, axis=0)
            _, sizes, turned = np.linalg.svd(rows / scale, full_matrices=False)
            # what nothing tells apart is as uncertain as numbers can say, not certain
            inverse = turned.T / np.maximum(sizes, 1e-8 * sizes[0])
            found[np.ix_(free, free)] = left * (inverse @ inverse.T) / np.outer(scale, scale)
        return found


def bounds_of(parameters: Sequence[Parameter]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds, each (k,)."""
    return np.array([p.low for p in parameters]), np.array([p.high for p in parameters])


def fit_hypothesis(
    problem: Problem,
    hypothesis: Hypothesis = (),
    start: Mapping[str, float] | None = None,
    known: Mapping[str, np.ndarray] | None = None,
    differences: FiniteDifferences | None = None,
    refresh: bool = False,
    vary: Sequence[Parameter] | None = None,
    sufficient_chi2: float = np.inf,
    smoother: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Fit:
    """Fit nuisances and the parameters of an explanation's effects.

    Parameters
    ----------
    problem : Problem
    hypothesis : tuple of Candidate
        () for the model as it stands.
    start : mapping of str to float
        Values by key to start from; nominal where absent.
    known : mapping of str to (n,) array
        Derivatives by key that were found near the start: they save simulations.
    differences : FiniteDifferences
        Shared with other fits of the problem, so that good steps are found once.
    refresh : bool
        Whether to make the Jacobian anew at the end, for intervals.
    vary : sequence of Parameter
        Vary these alone, the others stay at `start`. All that belong to the explanation by default.
    sufficient_chi2 : float
        chi2 of another explanation that leaves noise alone: a fit far above it, and no more in haste, ends early.
    smoother : function
        Linear, from residuals or a Jacobian to what of them is to be small (`jointgap.identification.smoother`): such a fit is on its way
        to another, and takes less care.

    Returns
    -------
    Fit
        A fit that cannot be simulated at its start comes out as failed, with the reason.
    """
    parameters = tuple(problem.parameters(hypothesis) if vary is None else vary)
    fixed = {p.key: p.nominal for p in problem.parameters(hypothesis)} | dict(start or {})
    low, high = bounds_of(parameters)
    x = np.clip([fixed[p.key] for p in parameters], low, high)
    differences = differences or FiniteDifferences(problem)
    begin = problem.simulations

    def named(values) -> dict[str, float]:
        return fixed | {p.key: float(v) for p, v in zip(parameters, values, strict=True)}

    def derivatives(at, residual, known=None, fine=False):
        return differences.jacobian(parameters, named(at), residual, hypothesis, known, fine)

    def finished(status, reason=""):
        return Fit(hypothesis, parameters, x, r, jacobian, problem.simulations - begin, status, reason)

    r, jacobian = np.full(problem.size, np.nan), np.empty((problem.size, 0))
    try:
        r = problem.residual(named(x), hypothesis)
        jacobian = derivatives(x, r, known)
    except (InputError, SimulationError) as error:
        return finished(FAILED, str(error))

    # `fresh`: the Jacobian was made at x. `trusted`: it foretold the last step well, so it may say that the end is reached.
    fresh, trusted, damping = not known, smoother is None, 0.0
    most, share = (_MOST_STEPS, 0.0) if smoother is None else (_FEW_STEPS, _COARSE)
    seen = smoother or (lambda values: values)
    status, reason = STOPPED, f"no end after {most} steps"
    rough, sr = differences.numerical_noise_chi2, seen(r)
    creeping, renewed, at_renewal = max(_CREEPING, rough), 0, np.inf
    course = [float(sr @ sr)]
    for taken in range(most):
        beaten = course[-1] > _BEATEN * sufficient_chi2
        patience, progress = (_SHORT, _HASTE) if beaten else (_PATIENCE, _PROGRESS)
        behind = course[max(len(course) - 1 - patience, 0)]
        if len(course) > patience and behind - course[-1] < progress * course[-1] > progress * _POOR * r.size:
            reason = "poor, and hardly better from step to step"
            break
        if (
            not fresh
            and taken >= renewed + _LONG
            and course[max(len(course) - 1 - _PATIENCE, 0)] - course[-1] < creeping
        ):
            if renewed and at_renewal - course[-1] < creeping:
                reason = f"hardly better from step to step after {taken}"
                break
            renewed, at_renewal = taken, course[-1]
            try:
                jacobian, fresh, damping = derivatives(x, r), True, 0.0
            except (InputError, SimulationError) as error:
                reason = str(error)
                break
        worth = max(_GAIN * max(1.0, course[-1] / r.size) ** 2, rough, share * course[-1])
        step, left = bounded_step(seen(jacobian), sr, low - x, high - x, damping)
        promised = sr @ sr - left
        if promised < worth and (fresh or trusted):
            status, reason = (CONVERGED, "") if damping < _ROUGH else (STOPPED, _ROUGHNESS)
            break
        gain = -np.inf
        if promised >= worth:
            trial = np.clip(x + step, low, high)
            try:
                r_trial = problem.residual(named(trial), hypothesis)
            except (InputError, SimulationError):
                r_trial = None
            if r_trial is not None:
                sr_trial = seen(r_trial)
                gain = (sr @ sr - sr_trial @ sr_trial) / promised
                jacobian = _corrected(jacobian, trial - x, r_trial - r)
                if gain > 0:
                    x, r, sr, fresh = trial, r_trial, sr_trial, False
            course.append(float(sr @ sr))
        trusted = gain > 0.5
        if gain > 0.25:
            damping = damping / 10 if damping > 1e-4 else 0.0
        elif not fresh:
            try:
                jacobian, fresh, damping = derivatives(x, r), True, 0.0
            except (InputError, SimulationError) as error:
                reason = str(error)
                break
        else:
            damping = max(10 * damping, 1e-3)
    if refresh:
        try:
            jacobian = derivatives(x, r, fine=smoother is None)
        except (InputError, SimulationError) as error:
            reason = reason or str(error)
    return finished(status, reason)


def _corrected(jacobian: np.ndarray, moved: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The Jacobian made to agree with one step (Broyden 1965), measured by the columns' lengths so that units do not matter."""
    weight = moved * np.sum(jacobian**2, axis=0)
    if not (inner := weight @ moved) > 0:
        return jacobian
    return jacobian + np.outer(change - jacobian @ moved, weight / inner)
