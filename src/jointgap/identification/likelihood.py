"""Likelihood with a clearance: states of the pins and parameters are estimated together (multiple
shooting).

The position of a pin whose clearance is searched is unknown at the begin of a record. Each run is
divided into windows with their own initial states; the jump between the end of a window and the
begin of the next is normal with the standard deviation q. A large q gives a wide basin of
attraction; as q decreases the misfit becomes that of one trajectory. A filter finds initial states.
States and parameters are then fitted by Gauss-Newton steps with banded normal equations, bordered
by the parameters (H. G. Bock, 1983; B. M. Bell, SIAM J. Optim. 4 (1994) 626-636). During the search
hypotheses are compared by their marginal likelihood over the states (Laplace approximation), each
at its best q."""

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from jointgap.core.candidates import Candidate, Parameter, WindowedRun
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.fit import (
    CONVERGED,
    FAILED,
    FiniteDifferences,
    Fit,
    bounded_step,
    bounds_of,
    fit_hypothesis,
    prior_of_bounds,
)
from jointgap.identification.problem import (
    Hypothesis,
    Problem,
    SearchLimit,
    label_of,
    values_in_run,
    whiten,
)
from jointgap.identification.screening import (
    Sensitivities,
    Sensitivity,
    oscillating_shapes,
    steady_first,
)
from jointgap.identification.settings import WindowSettings

ANGLE_STEP, RATE_STEP = 1e-4, 2e-4  # [rad], [crank speeds] Finite-difference steps of states
# [1] Largest norm of the residuals' change over a parameter step, tolerated excess, and largest
# shortening of a step
CHANGE, TOO_LONG, SHORTER = 1.0, 10.0, 1e4
FAILURES = (InputError, SimulationError, np.linalg.LinAlgError)
"""Exceptions of values that cannot be simulated."""

_Columns = Mapping[str, tuple[np.ndarray, np.ndarray]]
"""Derivatives by run: of residuals (n, m) and of the ends of windows (k, d, m)."""

MISSED = 10.0  # [1] Whitened residual of samples in a window that could not be simulated


def tame_squares(residual: np.ndarray, large: float) -> np.ndarray:
    """Squares of whitened residuals (n,), of those beyond `large` their tangents (P. J. Huber, Ann.
    Math. Stat. 35 (1964) 73-101)."""
    near = np.minimum(np.abs(residual), large)
    return near * (2.0 * np.abs(residual) - near)


def turned(after: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Differences of states (..., d), with wrapped angles."""
    out = after - before
    out[..., 0::2] -= math.tau * np.round(out[..., 0::2] / math.tau)
    return out


@dataclass(frozen=True)
class _Motion:
    """A run simulated in windows."""

    readings: Mapping[str, np.ndarray]
    ends: np.ndarray  # (k, d) states at the ends of the windows
    handed: Any  # other states at the ends
    done: np.ndarray  # (k,) mask of simulated windows
    residual: np.ndarray  # (n,) whitened, part by part


class _Run:
    """A run of a problem in windows."""

    def __init__(self, problem: Problem, run: str, windowed: WindowedRun, states: Any):
        self._problem = problem
        self.parts, self.states = [part for part in problem.parts if part.series.run == run], states
        self.shared = problem.shared_changes(run)  # (n, e) changes by drive errors of variance 1
        self._weights = np.linalg.inv(np.eye(self.shared.shape[1]) + self.shared.T @ self.shared)
        self.first, parts = states.slow[0].copy(), self.parts
        self.windows = [windowed.window_of(part.series.time, self.states) for part in parts]
        self.window = np.concatenate(
            [w[part.used] for w, part in zip(self.windows, parts, strict=True)]
        )

    def without_shared(self, residual: np.ndarray) -> np.ndarray:
        """Residuals (n,) minus the most likely changes by drive errors."""
        return residual - self.shared @ (self._weights @ (self.shared.T @ residual))

    def motion(self, windowed: WindowedRun, slow: np.ndarray) -> _Motion:
        """The run from the states `slow` (k, d)."""
        self._problem.simulations += 1
        readings, ends, handed, done = windowed.simulate(replace(self.states, slow=slow))
        out = []
        for part in self.parts:
            away = readings[part.series.channel] - part.series.value
            white = whiten(np.where(part.used, away, np.nan), part.noise)[part.used]
            out.append(np.where(np.isfinite(white), white, MISSED))
        return _Motion(readings, ends, handed, done, np.concatenate(out))

    def change(self, motion: _Motion, other: _Motion, parity: int | None = None) -> np.ndarray:
        """Whitened change (n,) between two motions; with `parity` only of samples in even or odd
        windows."""
        out = []
        for part, window in zip(self.parts, self.windows, strict=True):
            value = other.readings[part.series.channel] - motion.readings[part.series.channel]
            if parity is not None:
                value = np.where(window % 2 == parity, value, 0.0)
            white = whiten(np.where(part.used, value, np.nan), part.noise)[part.used]
            out.append(np.where(np.isfinite(white), white, 0.0))
        return np.concatenate(out)

    def cost(
        self, slow: np.ndarray, motion: _Motion, jump: float, settings: WindowSettings
    ) -> float:
        """Squares of residuals (tame), of jumps, and of the deviation of the first state from the
        filter's."""
        gap = turned(slow[1:], motion.ends[:-1])[motion.done[:-1]]
        first = turned(slow[0], self.first) / settings.first_state
        left = self.without_shared(motion.residual)
        of_drive = (motion.residual - left) @ left
        squares = np.sum(tame_squares(left, settings.large))
        return float(squares + of_drive + np.sum((gap / jump) ** 2) + first @ first)

    def settled(self, windowed: WindowedRun) -> "_Run | None":
        """The run with the states of a motion that began long before the record."""
        states = windowed.steady_states(self.states)
        if states is None:
            return None
        other = copy(self)
        other.states = states
        return other

    def hand_on(self, slow: np.ndarray, motion: _Motion) -> None:
        """Start each window with the other states at the end of the previous one."""
        known, carried = motion.done[:-1], []
        for own, handed in zip(self.states.carried, motion.handed, strict=True):
            carried.append(own.copy())
            carried[-1][1:][known] = handed[:-1][known]
        carried = type(motion.handed)(*carried)
        self.states = replace(self.states, slow=slow, carried=carried)


@dataclass(frozen=True)
class _Normal:
    """The normal equations with the states eliminated."""

    hessian: np.ndarray  # (m, m) by the parameters
    gradient: np.ndarray  # (m,)
    determinant: float  # log determinant of the states
    states: list[
        np.ndarray
    ]  # by run, (k d, m + 1): response of states to the parameters, and their own step
    gain: float  # decrease of the cost by the states alone

    def step(
        self, low: np.ndarray, high: np.ndarray, damping: float = 0.0
    ) -> tuple[np.ndarray, float]:
        """The step (m,) of the parameters within bounds, and its decrease of the cost."""
        if not self.gradient.size:
            return np.zeros(0), 0.0
        scale = np.sqrt(np.maximum(np.diag(self.hessian), 1e-300))
        values, vectors = np.linalg.eigh(self.hessian / np.outer(scale, scale))
        values = np.sqrt(np.maximum(values, 1e-9 * values[-1]))
        root, target = values[:, None] * vectors.T, vectors.T @ (self.gradient / scale) / values
        step, _ = bounded_step(root, target, low * scale, high * scale, damping)
        step = step / scale
        return step, -float(2.0 * self.gradient @ step + step @ self.hessian @ step)


@dataclass(frozen=True)
class Stage:
    """Result of the fit at one jump."""

    jump: float
    cost: float  # squares of residuals, jumps and deviations of parameters from nominal
    deviance: float  # minus twice the log marginal likelihood, up to a constant
    lost: float  # share of windows that could not be simulated
    values: np.ndarray
    hessian: np.ndarray


class Estimate:
    """Estimate of the states and parameters of a hypothesis."""

    def __init__(
        self,
        problem: Problem,
        hypothesis: Hypothesis,
        start: Mapping[str, float] | None = None,
        vary: Sequence[Parameter] | None = None,
    ):
        self.problem, self.hypothesis = problem, hypothesis
        self.settings: WindowSettings = problem.settings.windows
        # integers, such as the order of a torque, are fixed
        self._varied = tuple(problem.parameters(hypothesis) if vary is None else vary)
        self.parameters = tuple(p for p in self._varied if not p.integer)
        self._fixed = {p.key: p.nominal for p in problem.parameters(hypothesis)} | dict(start or {})
        self._low, self._high = bounds_of(self.parameters)
        self.values = np.clip([self._fixed[p.key] for p in self.parameters], self._low, self._high)
        self._nominal = np.array([p.nominal for p in self.parameters])
        self.prior = prior_of_bounds(self._low, self._high)
        self._steps = np.array([p.step for p in self.parameters])
        self.stages: list[Stage] = []
        self._runs: dict[str, _Run] = {}
        self._slow: dict[str, np.ndarray] = {}
        self._motions: dict[str, _Motion] = {}
        self._columns: dict[str, tuple[np.ndarray, np.ndarray]] | None = None
        self._simulated = problem.simulations

    @property
    def mapping(self) -> dict[str, float]:
        """Values by key [SI]."""
        return self._by_key(self.values)

    @property
    def best(self) -> Stage:
        """The stage of the largest marginal likelihood."""
        return min(self.stages, key=lambda stage: stage.deviance)

    @property
    def cost_of_values(self) -> float:
        """Cost of the prior of the parameters."""
        return float(np.sum((self.prior * (self.values - self._nominal)) ** 2))

    @property
    def residual(self) -> np.ndarray:
        """Whitened residuals (n,) of the problem, measured minus simulated."""
        found = np.zeros(self.problem.size)
        for run, one in self._runs.items():
            ends = np.cumsum([int(part.used.sum()) for part in one.parts])[:-1]
            for part, own in zip(
                one.parts, np.split(self._motions[run].residual, ends), strict=True
            ):
                found[part.place] = -own
        return self.problem.together(found)

    @property
    def readings(self) -> dict[str, Mapping[str, np.ndarray]]:
        """Simulated readings by run and channel [unit]."""
        return {run: motion.readings for run, motion in self._motions.items()}

    def _by_key(self, values: np.ndarray) -> dict[str, float]:
        return self._fixed | {p.key: float(v) for p, v in zip(self.parameters, values, strict=True)}

    def _windowed(self, run: str, values: np.ndarray) -> WindowedRun:
        return self._windowed_with(run, self._by_key(values), self.hypothesis)

    def _windowed_with(
        self, run: str, values: Mapping[str, float], hypothesis: Hypothesis
    ) -> WindowedRun:
        found = windowed_run(self.problem, run, values, hypothesis)
        if found is None:
            raise SimulationError(
                f"run {run} is not simulated in windows with {label_of(hypothesis)}"
            )
        return found

    def find_states(self, jump: float, turns: float = math.inf, most: float = math.inf) -> float:
        """Find the states in the first `turns` revolutions by the filter at a jump; return the
        deviance.

        If it exceeds `most`, the filter ends early.
        """
        deviance, per_turn, self._columns = 0.0, self._windows_a_turn(), None
        for run in self.problem.runs:
            windowed = self._windowed(run, self.values)
            readings = self._readings(run, windowed, turns)
            found = windowed.filter_states(*readings, per_turn, jump, turns, most - deviance)
            deviance += found.deviance
            if deviance > most:
                break
            self._runs[run] = _Run(self.problem, run, windowed, found.states)
            self._slow[run] = found.states.slow.copy()
        return deviance

    def deviance_without(self, turns: float = math.inf) -> float:
        """The deviance of the same readings by the base, whose states are not estimated."""
        deviance = 0.0
        for run in self.problem.runs:
            windowed = self._windowed(run, self.values)
            predicted = self.problem.predict(run, self.mapping)
            deviance += windowed.deviance_of(predicted, *self._readings(run, windowed, turns))
        return deviance

    def _readings(
        self, run: str, windowed: WindowedRun, turns: float
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Readings that depend on the states in the first `turns` revolutions of a run, NaN for
        gaps, and their noise, by channel."""
        measured, noise = {}, {}
        for part in self.problem.parts:
            if part.series.run == run and part.series.channel in windowed.channels:
                time = part.series.time
                share = (time - time[0]) / max(time[-1] - time[0], 1e-300)
                used = part.used & (share * windowed.turns < turns)
                measured[part.series.channel] = np.where(used, part.series.value, np.nan)
                noise[part.series.channel] = part.noise.spread
        return measured, noise

    def _windows_a_turn(self) -> int:
        """Number of windows per revolution with enough readings for each state variable."""
        settings, least = self.settings, math.inf
        for run in self.problem.runs:
            windowed = self._windowed(run, self.values)
            parts = [part for part in self.problem.parts if part.series.run == run]
            readings = sum(
                int(part.used.sum()) for part in parts if part.series.channel in windowed.channels
            )
            least = min(
                least, readings / windowed.turns / (settings.readings_per_number * windowed.size)
            )
        return int(np.clip(least, settings.least_windows, settings.most_windows))

    def _simulate(self, values: np.ndarray, slow: Mapping[str, np.ndarray]) -> dict[str, _Motion]:
        return {
            run: one.motion(self._windowed(run, values), slow[run])
            for run, one in self._runs.items()
        }

    def _cost(
        self, values: np.ndarray, slow: Mapping, motions: Mapping[str, _Motion], jump: float
    ) -> float:
        of_runs = (
            self._runs[run].cost(slow[run], motion, jump, self.settings)
            for run, motion in motions.items()
        )
        return float(np.sum((self.prior * (values - self._nominal)) ** 2)) + sum(of_runs)

    def _by_states(self, values: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Derivatives by the states of windows: of residuals (2, n, d) for even and odd windows,
        and of ends (k, d, d)."""
        found = {}
        for run, one in self._runs.items():
            motion, slow, windowed = (
                self._motions[run],
                self._slow[run],
                self._windowed(run, values),
            )
            d = slow.shape[1]
            own, ends = np.zeros((2, motion.residual.size, d)), np.zeros((len(slow), d, d))
            for i in range(d):
                h = ANGLE_STEP if i % 2 == 0 else RATE_STEP
                other = one.motion(windowed, slow + h * (np.arange(d) == i))
                for parity in (0, 1):
                    own[parity, :, i] = one.change(motion, other, parity) / h
                ends[:, :, i] = _both(motion, other, turned(other.ends, motion.ends)) / h
            found[run] = own, ends
        return found

    def _by_values(self, values: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Derivatives by the parameters: of residuals (n, m) and of the ends of windows (k, d, m),
        by run."""
        columns = []
        for i, p in enumerate(self.parameters):
            for _ in range(2):
                step = (
                    self._steps[i]
                    if values[i] + self._steps[i] <= self._high[i]
                    else -self._steps[i]
                )
                shifted = self._by_key(values) | {p.key: float(values[i] + step)}
                column = self._by_value(p.run, step, shifted, self.hypothesis)
                length = math.hypot(*(np.linalg.norm(by_value) for by_value, _ in column.values()))
                self._steps[i] = p.step / min(max(p.step * length / CHANGE, 1.0), SHORTER)
                if abs(step) < TOO_LONG * self._steps[i]:
                    break
            columns.append(column)
        if not columns:
            return self._nothing()
        return {
            run: tuple(np.stack([c[run][j] for c in columns], axis=-1) for j in (0, 1))
            for run in self._runs
        }

    def _nothing(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Zero derivatives, for fixed parameters."""
        shape = (self.values.size,)
        return {
            run: (np.zeros(motion.residual.shape + shape), np.zeros(motion.ends.shape + shape))
            for run, motion in self._motions.items()
        }

    def _by_value(
        self, own_run: str | None, step: float, shifted: Mapping[str, float], hypothesis: Hypothesis
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Derivatives by the parameter that is `shifted` by a `step`."""
        found = {}
        for run, one in self._runs.items():
            motion = self._motions[run]
            if own_run not in (None, run):
                found[run] = np.zeros(motion.residual.size), np.zeros(motion.ends.shape)
                continue
            other = one.motion(self._windowed_with(run, shifted, hypothesis), self._slow[run])
            ends = _both(motion, other, turned(other.ends, motion.ends)) / step
            found[run] = one.change(motion, other) / step, ends
        return found

    def _normal(
        self,
        off: np.ndarray,
        prior: np.ndarray,
        columns: Mapping[str, tuple[np.ndarray, np.ndarray]],
        by_states: Mapping[str, tuple[np.ndarray, np.ndarray]],
        jump: float,
        damping: float = 0.0,
    ) -> _Normal:
        """The normal equations for parameters with the deviation `off` (m,) from their prior's
        mean."""
        m = off.size
        hessian, gradient = np.diag(prior**2), prior**2 * off
        determinant, gain, states = 0.0, 0.0, []
        for run, one in self._runs.items():
            motion, slow = self._motions[run], self._slow[run]
            (by_value, end_by_value), (own, ends) = columns[run], by_states[run]
            # drive errors are eliminated at their most likely values
            by_value = np.hstack([by_value, one.shared])
            count, d = slow.shape
            diagonal, below = np.zeros((count, d, d)), np.zeros((count - 1, d, d))
            border, slope = np.zeros((count, d, by_value.shape[1])), np.zeros((count, d))
            left, window = one.without_shared(motion.residual), one.window
            weight = np.sqrt(
                np.minimum(1.0, self.settings.large / np.maximum(np.abs(left), 1e-300))
            )
            left, by_value, own = weight * left, weight[:, None] * by_value, weight[:, None] * own
            for parity in (0, 1):
                # correlated noise couples a sample to the previous window too
                at_home = window % 2 == parity
                spilt = ~at_home & (window > 0) & np.any(own[parity] != 0.0, axis=1)
                for rows, place in ((at_home, window), (spilt, window - 1)):
                    a, w = own[parity][rows], place[rows]
                    np.add.at(diagonal, w, a[:, :, None] * a[:, None, :])
                    np.add.at(border, w, a[:, :, None] * by_value[rows][:, None, :])
                    np.add.at(slope, w, a * left[rows, None])
                later = own[1 - parity][spilt]
                np.add.at(
                    below, window[spilt] - 1, later[:, :, None] * own[parity][spilt][:, None, :]
                )
            weight = np.where(motion.done[:-1], 1.0 / jump**2, 0.0)[:, None, None]
            gap = np.where(motion.done[:-1, None], turned(slow[1:], motion.ends[:-1]), 0.0)[
                :, :, None
            ]
            f, g = ends[:-1], end_by_value[:-1]
            ft, gt = f.transpose(0, 2, 1), g.transpose(0, 2, 1)
            diagonal[1:] += weight * np.eye(d)
            diagonal[:-1] += weight * (ft @ f)
            below -= weight * f
            border[1:, :, :m] -= weight * g
            border[:-1, :, :m] += weight * (ft @ g)
            slope[1:] += (weight * gap)[:, :, 0]
            slope[:-1] -= (weight * (ft @ gap))[:, :, 0]
            first = self.settings.first_state
            diagonal[0] += np.eye(d) / first**2
            slope[0] += turned(slow[0], one.first) / first**2
            factor = cholesky_banded(_band(diagonal, below, damping), lower=True)
            determinant += 2.0 * float(np.sum(np.log(factor[0])) + d * math.log(first))
            determinant += 2.0 * d * int(motion.done[:-1].sum()) * math.log(jump)
            border, slope = border.reshape(count * d, -1), slope.reshape(count * d)
            solved = cho_solve_banded((factor, True), np.column_stack([border, slope]))
            square = by_value.T @ by_value - border.T @ solved[:, :-1]
            square[:m, :m] += np.sum(weight * (gt @ g), axis=0)
            side = by_value.T @ left - border.T @ solved[:, -1]
            side[:m] -= np.sum(weight * (gt @ gap), axis=0)[:, 0]
            side[m:] = (
                -border[:, m:].T @ solved[:, -1]
            )  # the gradient by the most likely drive errors is zero
            gain += float(slope @ solved[:, -1])
            own_square = square[m:, m:] + np.eye(len(square) - m)
            follow = np.linalg.solve(own_square, np.column_stack([square[m:, :m], side[m:]]))
            hessian = hessian + square[:m, :m] - square[:m, m:] @ follow[:, :m]
            gradient = gradient + side[:m] - square[:m, m:] @ follow[:, m]
            gain += float(side[m:] @ follow[:, m])
            determinant += np.linalg.slogdet(own_square)[1]
            states.append(np.delete(solved, np.s_[m:-1], axis=1) - solved[:, m:-1] @ follow)
        return _Normal(0.5 * (hessian + hessian.T), gradient, determinant, states, gain)

    def fit_at(self, jump: float) -> None:
        """Fit at a jump, from the result of the previous one."""
        for run, one in self._runs.items():
            one.hand_on(self._slow[run], self._motions[run])
        if not self._runs or jump >= self.settings.filtered_above:
            self._filtered(jump, anew=not self._runs)
        held = jump > self.settings.held_above or not self.parameters
        self._descend(jump, held)
        if self._settled(jump):
            self.stages.pop()
            self._descend(jump, held)

    @property
    def leads_on(self) -> bool:
        """Whether the likelihood is near its maximum over the jumps; for a wrong model it decreases
        for small ones."""
        return (
            self.stages[-1].deviance
            <= self.best.deviance + self.settings.far_behind * self.problem.size
        )

    def anneal(self, below: float = math.inf) -> "Estimate":
        """Fit at decreasing jumps `below` a value while `leads_on`."""
        for jump in self.settings.jumps:
            if jump < below:
                self.fit_at(jump)
                if not self.leads_on:
                    break
        return self

    def branch(self) -> "Estimate":
        """A copy with these states."""
        other = Estimate(self.problem, self.hypothesis, self.mapping, self._varied)
        other._runs = {run: copy(one) for run, one in self._runs.items()}
        other._slow, other._motions = dict(self._slow), dict(self._motions)
        other._simulated = self._simulated
        other.stages, other._columns, other._steps = (
            list(self.stages),
            self._columns,
            self._steps.copy(),
        )
        return other

    def begin_at(self, states: Mapping[str, np.ndarray]) -> bool:
        """Start at given states if they fit these runs and joints; return whether they do."""
        per_turn = self._windows_a_turn()
        for run in self.problem.runs:
            windowed = self._windowed(run, self.values)
            known = windowed.states_from(states[run], per_turn) if run in states else None
            if known is None:
                self._runs = {}
                return False
            one, slow = _Run(self.problem, run, windowed, known), states[run]
            for _ in range(2):  # for consistent other states
                one.hand_on(slow, one.motion(windowed, slow))
            self._runs[run], self._slow[run], self._motions[run] = (
                one,
                slow,
                one.motion(windowed, slow),
            )
        return True

    def to_its_end(self) -> "Estimate":
        """Fit at all further jumps, without `leads_on`; from given states only at those that need
        no filter."""
        last = self.stages[-1].jump if self.stages else self.settings.filtered_above
        for jump in self.settings.jumps:
            if jump < last:
                self.fit_at(jump)
        return self

    def _filtered(self, jump: float, anew: bool) -> None:
        """Find the states by the filter, if that reduces the cost."""
        if anew:
            self.find_states(jump)
            return
        before = dict(self._runs), dict(self._slow), self._columns
        known = self._cost(self.values, self._slow, self._simulate(self.values, self._slow), jump)
        self.find_states(jump)
        if (
            self._cost(self.values, self._slow, self._simulate(self.values, self._slow), jump)
            > known
        ):
            self._runs, self._slow, self._columns = before

    def _settled(self, jump: float) -> bool:
        """Use the states of a settled motion for each run if that reduces the cost; return whether
        one changed."""
        changed = False
        for run, one in self._runs.items():
            windowed = self._windowed(run, self.values)
            if (settled := one.settled(windowed)) is None:
                continue
            slow = settled.states.slow
            known = one.cost(self._slow[run], self._motions[run], jump, self.settings)
            if settled.cost(slow, settled.motion(windowed, slow), jump, self.settings) < known:
                self._runs[run], self._slow[run], self._columns, changed = settled, slow, None, True
        return changed

    def _descend(self, jump: float, held: bool) -> None:
        """Damped Gauss-Newton steps at one jump until the predicted decrease is negligible."""
        settings = self.settings
        self._motions = self._simulate(self.values, self._slow)
        cost, damping = self._cost(self.values, self._slow, self._motions, jump), 0.0
        by_states, still = self._by_states(self.values), np.zeros(self.values.size)
        fresh, stale, last = False, self._columns is None, jump <= settings.jumps[-1]
        for _ in range(settings.iterations):
            if stale:
                self._columns = self._nothing() if held else self._by_values(self.values)
                fresh, stale = True, False
            room = (still, still) if held else (self._low - self.values, self._high - self.values)
            # a poor fit need not be accurate
            accurate = (
                last
                and cost <= self.problem.settings.stopping.poor_chi2_per_sample * self.problem.size
            )
            improved, negligible = False, max(1.0, 0.0 if accurate else settings.decrease * cost)
            for _ in range(8):
                normal = self._at(jump, by_states, damping)
                step, gain = normal.step(*room, damping)
                values = np.clip(self.values + step, self._low, self._high)
                slow, promised = self._followed(normal, values - self.values), gain + normal.gain
                motions, new = self._tried(values, slow, jump)
                if new < cost:
                    improved = True
                    break
                damping = max(10.0 * damping, 1e-3)
                if promised < negligible:
                    break
            if improved:
                ratio, decrease, cost = (cost - new) / max(promised, 1e-300), cost - new, new
                self.values, self._slow, self._motions = values, slow, motions
                damping = damping * (0.1 if ratio > 0.75 else 0.5) if damping > 1e-4 else 0.0
                by_states = self._by_states(self.values)
                ends = max(decrease, promised) < negligible
            else:
                ends, ratio, damping = True, 0.0, 0.0
            if ends and (fresh or (improved and not last)):
                break
            fresh, stale = False, ends or ratio < settings.renewed_below
        normal = self._at(jump, by_states)
        lost = float(np.mean(np.concatenate([~motion.done for motion in self._motions.values()])))
        if held:
            self._columns = None
        self.stages.append(
            Stage(jump, cost, cost + normal.determinant, lost, self.values.copy(), normal.hessian)
        )

    def _tried(
        self, values: np.ndarray, slow: Mapping, jump: float
    ) -> tuple[dict[str, _Motion], float]:
        """The motions and their cost (infinite on failure)."""
        try:
            motions = self._simulate(values, slow)
        except FAILURES:
            return {}, math.inf
        return motions, self._cost(values, slow, motions, jump)

    def _at(self, jump: float, by_states: Mapping, damping: float = 0.0) -> _Normal:
        return self._normal(
            self.values - self._nominal, self.prior, self._columns, by_states, jump, damping
        )

    def _followed(self, normal: _Normal, step: np.ndarray) -> dict[str, np.ndarray]:
        """The states after a step of the parameters."""
        found = {}
        for (run, slow), solved in zip(self._slow.items(), normal.states, strict=True):
            change = -(solved[:, -1] + solved[:, :-1] @ step).reshape(slow.shape)
            reach = np.tile(
                [0.6, 3.0], slow.shape[1] // 2
            )  # [rad], [crank speeds] limit of the linearisation
            found[run] = slow + np.clip(change, -reach, reach)
        return found

    def fit(self) -> Fit:
        """The result as a `Fit`; jumps count like residuals, and large residuals by their squares
        as in other fits."""
        size, count, residual = self.problem.size, len(self.parameters), self.residual
        plain, jump = replace(self.settings, large=math.inf), self.stages[-1].jump
        chi2 = sum(
            one.cost(self._slow[run], self._motions[run], jump, plain)
            for run, one in self._runs.items()
        )
        residual = residual * math.sqrt(chi2 / max(float(residual @ residual), 1e-300))
        jacobian = np.zeros((size, len(self._varied)))
        free = [i for i, p in enumerate(self._varied) if not p.integer]
        jacobian[:count, free] = _root(self.stages[-1].hessian - np.diag(self.prior**2))
        values = np.array([self.mapping[p.key] for p in self._varied])
        count = self.problem.simulations - self._simulated
        found = Fit(self.hypothesis, self._varied, values, residual, jacobian, count, CONVERGED)
        return replace(
            found,
            slope=np.zeros(values.size),
            states=dict(self._slow),
            settings=self.problem.settings,
        )

    def failed(self, reason: str) -> Fit:
        """A fit that failed."""
        values = np.array([self.mapping[p.key] for p in self._varied])
        residual, nothing = np.full(self.problem.size, np.nan), np.empty((self.problem.size, 0))
        found = Fit(self.hypothesis, self._varied, values, residual, nothing, 0, FAILED, reason)
        return replace(found, settings=self.problem.settings)

    def sensitivities(self, candidates: Sequence[Candidate]) -> Sensitivities:
        """Sensitivities of candidates with the states eliminated, in compressed rows; without
        secants."""
        taken = {claim for effect in self.hypothesis for claim in effect.claims}
        by_states, columns, m = (
            self._by_states(self.values),
            self._by_values(self.values),
            self.values.size,
        )
        found: list[tuple[Candidate, Mapping[str, float], list]] = []
        failed: dict[str, str] = {}
        for candidate in steady_first(
            candidate for candidate in candidates if not taken & candidate.claims
        ):
            steady = next(
                (own[0] for each, _, own in found if each.label == candidate.carrier), None
            )
            guesses = [
                guess
                for guess in candidate.initial_guesses
                if not set(guess) & set(candidate.amplitudes)
            ]
            if steady and guesses:
                left = self._in_time(_wide(columns, [steady]), by_states)
                guesses = oscillating_shapes(
                    self.problem, candidate, left[:, -1], left[:, :-2], left[:, -2]
                )
            # a partly replaced nuisance keeps its value
            kept = {
                p.key: self.mapping[p.key] for p in candidate.coordinates if p.key in self.mapping
            }
            for shapes in ({**guess, **kept} for guess in guesses):
                try:
                    found.append((candidate, shapes, self._by_amplitudes(candidate, shapes)))
                except FAILURES as error:
                    failed[candidate.label] = str(error)
        rows = self._rows(
            _wide(columns, [column for *_, own in found for column in own]), by_states
        )
        residual, entries, begin = rows[:, -1], [], m
        for candidate, shapes, own in found:
            changes, begin = rows[:, begin : begin + len(own)], begin + len(own)
            offsets = np.array([here for _, here in self._amplitudes(candidate)])
            origin = residual - changes @ offsets if offsets.any() else residual
            entries.append(
                Sensitivity(candidate, dict(shapes), changes, origin, tuple(self.problem.runs))
            )
        failed = {
            label: why
            for label, why in failed.items()
            if label not in {each.label for each, *_ in found}
        }
        return Sensitivities(
            self.parameters, self.values.copy(), rows[:, :m], residual, entries, failed
        )

    def _amplitudes(self, candidate: Candidate) -> list[tuple[Parameter, float]]:
        """Amplitudes of an absent effect with their values: the deviation from nominal of a
        replaced nuisance, else 0."""
        beyond = {p.key: self.mapping[p.key] - p.nominal for p in self.parameters}
        # the first one has priority
        replaces = reversed(candidate.replaces.items())
        replaced = {amplitude: beyond[name] for name, amplitude in replaces if name in beyond}
        own = (
            p for p in candidate.coordinates_in(self.problem.runs) if p.key in candidate.amplitudes
        )
        return [(p, replaced.get(p.key, 0.0)) for p in own]

    def _by_amplitudes(self, candidate: Candidate, shapes: Mapping[str, float]) -> list[_Columns]:
        """Derivatives by the amplitudes of an absent effect."""
        label, amplitudes, found = candidate.label, self._amplitudes(candidate), []
        at = self.mapping | {
            f"{label}.{p.key}": shapes.get(p.key, p.nominal)
            for p in candidate.coordinates_in(self.problem.runs)
        }
        at |= {f"{label}.{p.key}": here for p, here in amplitudes}
        for p, here in amplitudes:
            step = p.step if here + p.step <= p.high else -p.step
            shifted = at | {f"{label}.{p.key}": here + step}
            found.append(self._by_value(p.run, step, shifted, (*self.hypothesis, candidate)))
        return found

    def _rows(self, columns: _Columns, by_states: Mapping) -> np.ndarray:
        """Columns and the residual (last) with the states eliminated: (n, m + 1), all but the first
        m + 1 rows 0."""
        m = next(iter(columns.values()))[0].shape[1]
        normal = self._normal(np.zeros(m), np.zeros(m), columns, by_states, self.stages[-1].jump)
        cost = self.stages[-1].cost - self.cost_of_values - normal.gain
        square = np.block(
            [
                [normal.hessian, normal.gradient[:, None]],
                [normal.gradient[None, :], np.array([[cost]])],
            ]
        )
        rows = np.zeros((max(self.problem.size, m + 1), m + 1))
        rows[: m + 1] = _root(square)
        return rows

    def _in_time(self, columns: _Columns, by_states: Mapping) -> np.ndarray:
        """Columns and the residual (last) at the samples with the states eliminated: (n, m + 1)."""
        m = next(iter(columns.values()))[0].shape[1]
        normal = self._normal(np.zeros(m), np.zeros(m), columns, by_states, self.stages[-1].jump)
        found = np.zeros((self.problem.size, m + 1))
        for (run, one), solved in zip(self._runs.items(), normal.states, strict=True):
            left = np.column_stack([columns[run][0], self._motions[run].residual])
            follow = solved.reshape(*self._slow[run].shape, m + 1)
            for parity in (0, 1):
                window = np.maximum(
                    np.where(one.window % 2 == parity, one.window, one.window - 1), 0
                )
                left -= np.einsum("nd,ndm->nm", by_states[run][0][parity], follow[window])
            ends = np.cumsum([int(part.used.sum()) for part in one.parts])[:-1]
            for part, own in zip(one.parts, np.split(left, ends), strict=True):
                found[part.place] = own
        return found


def _wide(columns: _Columns, further: Sequence[_Columns]) -> _Columns:
    """Derivatives with further columns."""
    return {
        run: tuple(
            np.concatenate([own[j], *(each[run][j][..., None] for each in further)], axis=-1)
            for j in (0, 1)
        )
        for run, own in columns.items()
    }


def _root(square: np.ndarray) -> np.ndarray:
    """A matrix root: rows whose inner products are a positive semidefinite matrix."""
    scale = np.sqrt(np.maximum(np.diag(square), 1e-300))
    values, vectors = np.linalg.eigh(square / np.outer(scale, scale))
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * scale


def _both(motion: _Motion, other: _Motion, change: np.ndarray) -> np.ndarray:
    """A change of ends (k, d), 0 for windows that one of the motions could not simulate."""
    return np.where((motion.done & other.done)[:, None], change, 0.0)


def _band(diagonal: np.ndarray, below: np.ndarray, damping: float) -> np.ndarray:
    """A symmetric block tridiagonal matrix ((k, d, d) on and (k - 1, d, d) below the diagonal) in
    lower banded form."""
    count, d, _ = diagonal.shape
    band = np.zeros((2 * d, count * d))
    for j in range(d):
        for i in range(j, d):
            band[i - j, j::d] = diagonal[:, i, j]
        for i in range(d):
            band[d + i - j, j::d][: count - 1] = below[:, i, j]
    band[0] = band[0] * (1.0 + damping) + 1e-10
    return band


def windowed_run(
    problem: Problem, run: str, values: Mapping[str, float], hypothesis: Hypothesis = ()
) -> WindowedRun | None:
    """A run in windows with `values` by key [SI]; None if the model does not support it."""
    make = getattr(problem.model, "windows", None)
    return make(run, *values_in_run(problem.model, run, values, hypothesis)) if make else None


def has_windows(problem: Problem, hypothesis: Hypothesis, values: Mapping[str, float]) -> bool:
    """Whether a hypothesis is fitted in windows: with a clearance, and all runs compared by
    samples."""
    if problem.has_statistics or not any(one.search_range for one in hypothesis):
        return False
    at = {p.key: p.nominal for p in problem.parameters(hypothesis)} | dict(values)
    try:
        return all(windowed_run(problem, run, at, hypothesis) is not None for run in problem.runs)
    except FAILURES:
        return False


def compete(
    estimates: Sequence[Estimate], below: float = math.inf, limit: SearchLimit | None = None
) -> list[Estimate]:
    """Fit all at decreasing jumps `below` a value; those far behind the best or without `leads_on`
    end, and all at the limit.

    Best first, without those that cannot be simulated.
    """
    going, failed = list(estimates), []
    for jump in (
        jump for jump in (estimates[0].settings.jumps if estimates else ()) if jump < below
    ):
        for estimate in going:
            if limit and limit.reached():
                return _ranked(estimates, failed)
            try:
                estimate.fit_at(jump)
            except FAILURES:
                failed.append(estimate)
        going = [each for each in going if each not in failed and each.leads_on]
        if going and jump <= (settings := going[0].settings).held_above:
            least = min(each.stages[-1].deviance for each in going)
            # at large jumps the true effect need not lead yet
            far = settings.far_behind if jump <= settings.compared_below else settings.far_before
            going = [
                each
                for each in going
                if each.stages[-1].deviance <= least + far * each.problem.size
            ]
    return _ranked(estimates, failed)


def _ranked(estimates: Sequence[Estimate], failed: Sequence[Estimate]) -> list[Estimate]:
    """Those that were fitted, best first."""
    done = [each for each in estimates if each.stages and each not in failed]
    return sorted(done, key=lambda each: each.best.deviance)


def fitted(
    problem: Problem,
    hypothesis: Hypothesis = (),
    start: Mapping[str, float] | None = None,
    known_derivatives: Mapping[str, np.ndarray] | None = None,
    differences: FiniteDifferences | None = None,
    *,
    refresh: bool = False,
    vary: Sequence[Parameter] | None = None,
    near: Fit | None = None,
) -> Fit:
    """Fit a hypothesis: in windows with a clearance, from the states of a fit `near` it; otherwise
    by `fit_hypothesis`, which uses the other arguments."""
    at = dict(start or {})
    if not has_windows(problem, hypothesis, at):
        return fit_hypothesis(
            problem, hypothesis, at, known_derivatives, differences, refresh=refresh, vary=vary
        )
    estimate = Estimate(problem, hypothesis, at, vary)
    try:
        if near is None or not estimate.begin_at(near.states or {}):
            estimate.anneal(estimate.settings.jumps[0]).to_its_end()
        elif vary is None:
            estimate.to_its_end()
        else:  # fixed parameters changed little
            estimate.fit_at(estimate.settings.jumps[-1])
        return estimate.fit()
    except FAILURES as error:
        return estimate.failed(str(error))


class Prediction(NamedTuple):
    """Prediction of the runs of a problem."""

    values: Mapping[str, float]  # by key [SI]
    residual: np.ndarray  # (n,) whitened
    readings: Mapping[str, Mapping[str, np.ndarray]]  # by run and channel [unit]


def as_fitted(problem: Problem, fit: Fit) -> Prediction:
    """The prediction of a fit; in windows from its states."""
    if fit.states is None:
        readings = {run: problem.predict(run, fit.mapping, fit.hypothesis) for run in problem.runs}
        return Prediction(fit.mapping, problem.residual(fit.mapping, fit.hypothesis), readings)
    estimate = Estimate(problem, fit.hypothesis, fit.mapping, vary=())
    if not estimate.begin_at(fit.states):  # a delay of 0 gives fewer windows
        estimate.anneal(estimate.settings.jumps[0]).to_its_end()
    return Prediction(fit.mapping, estimate.residual, estimate.readings)


def predicted(
    problem: Problem,
    hypothesis: Hypothesis,
    values: Mapping[str, float],
    vary: Sequence[Parameter] = (),
) -> Prediction:
    """The prediction from the most likely states of the joints at `values`; the parameters `vary`
    are fitted."""
    estimate = Estimate(problem, hypothesis, values, vary)
    estimate.anneal(estimate.settings.jumps[0]).to_its_end()
    return Prediction(estimate.mapping, estimate.residual, estimate.readings)
