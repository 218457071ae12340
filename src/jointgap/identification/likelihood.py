"""The likelihood of a hypothesis whose joints are loose: states of the pins and parameters together.

Nobody knows where the pins are in their bearings when a record begins. So each run is cut in windows. In each of them
the full model runs from a state of its own, and the jump from where one window ends to where the next one begins is
normal with the standard deviation q. With a large q the misfit is a wide funnel around the truth; as q falls it becomes
that of one trajectory. A filter finds first states. Then states and parameters are found together by Gauss-Newton
steps, of which the normal equations are banded in the states with the parameters as a border (multiple shooting: H. G.
Bock, 1983; Kalman smoothing as Gauss-Newton: B. M. Bell, SIAM J. Optim. 4 (1994) 626-636). Hypotheses are compared by
their marginal likelihood over the states (Laplace), each at its own best q."""

import math
from collections.abc import Mapping, Sequence
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
)
from jointgap.identification.problem import Hypothesis, Part, Problem, label_of, values_in_run, whiten
from jointgap.identification.settings import WindowSettings

ANGLE_STEP, RATE_STEP = 1e-4, 2e-4  # [rad], [crank's rates] of differences by states, at a tolerance of 1e-10 m
# [1] Length of the residuals' change in differences by values at most: a usual step of a clearance is hundreds of its
# standard errors, and residuals bend over tens. By what factor it is too long, and a step is shortened at most
CHANGE, TOO_LONG, SHORTER = 1.0, 10.0, 1e4
FAILURES = (InputError, SimulationError, np.linalg.LinAlgError)
"""What values that cannot be simulated may raise."""

MISSED = 10.0  # [1] whitened residual of a sample in a window that could not be simulated


def turned(after: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Differences of states (..., d), angles the shorter way round."""
    out = after - before
    out[..., 0::2] -= math.tau * np.round(out[..., 0::2] / math.tau)
    return out


@dataclass(frozen=True)
class _Motion:
    """A run simulated in windows."""

    readings: Mapping[str, np.ndarray]
    ends: np.ndarray  # (k, d) states at the ends of the windows
    handed: Any  # what they hand on
    done: np.ndarray  # (k,) which could be simulated
    residual: np.ndarray  # (n,) whitened, part after part


class _Run:
    """A run of a problem in windows."""

    def __init__(self, parts: Sequence[Part], windowed: WindowedRun, per_turn: int, jump: float, turns: float):
        self.parts = parts
        channels = {part.series.channel: part for part in parts}
        measured = {name: np.where(part.used, part.series.value, np.nan) for name, part in channels.items()}
        noise = {name: part.noise.spread for name, part in channels.items()}
        found = windowed.find(measured, noise, per_turn, jump, turns)
        self.states, self.filtered = found.states, found
        self.first = self.states.slow[0].copy()
        self.windows = [windowed.window_of(part.series.time, self.states) for part in parts]
        self.window = np.concatenate([w[part.used] for w, part in zip(self.windows, parts, strict=True)])

    def motion(self, windowed: WindowedRun, slow: np.ndarray) -> _Motion:
        """The run from the states `slow` (k, d)."""
        readings, ends, handed, done = windowed.simulate(replace(self.states, slow=slow))
        out = []
        for part in self.parts:
            away = readings[part.series.channel] - part.series.value
            white = whiten(np.where(part.used, away, np.nan), part.noise)[part.used]
            out.append(np.where(np.isfinite(white), white, MISSED))
        return _Motion(readings, ends, handed, done, np.concatenate(out))

    def change(self, motion: _Motion, other: _Motion, parity: int | None = None) -> np.ndarray:
        """Whitened change (n,) from one motion to another; of the samples in every other window alone, if asked."""
        out = []
        for part, window in zip(self.parts, self.windows, strict=True):
            value = other.readings[part.series.channel] - motion.readings[part.series.channel]
            if parity is not None:
                value = np.where(window % 2 == parity, value, 0.0)
            white = whiten(np.where(part.used, value, np.nan), part.noise)[part.used]
            out.append(np.where(np.isfinite(white), white, 0.0))
        return np.concatenate(out)

    def hand_on(self, slow: np.ndarray, motion: _Motion) -> None:
        """Let each window begin with what the one before hands on."""
        carried = type(motion.handed)(
            *(np.concatenate([c[:1], h[:-1]]) for c, h in zip(self.states.carried, motion.handed, strict=True))
        )
        self.states = replace(self.states, slow=slow, carried=carried)


@dataclass(frozen=True)
class _Normal:
    """The normal equations with the states eliminated."""

    hessian: np.ndarray  # (m, m) by the parameters
    gradient: np.ndarray  # (m,)
    determinant: float  # logarithm, of the states
    states: list[np.ndarray]  # by run, (k d, m + 1): how states follow the parameters, and their own step
    gain: float  # by which the states alone lower the cost

    def step(self, low: np.ndarray, high: np.ndarray, damping: float = 0.0) -> tuple[np.ndarray, float]:
        """The step (m,) of the parameters between bounds, and by how much it lowers the cost."""
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
    """Where the fit stood at one jump."""

    jump: float
    cost: float  # squares of residuals, of jumps and of how far parameters are from nominal
    deviance: float  # minus twice the logarithm of the marginal likelihood, but for a constant
    lost: float  # share of windows that could not be simulated
    values: np.ndarray
    hessian: np.ndarray


class Estimate:
    """States and parameters of a hypothesis together."""

    def __init__(
        self,
        problem: Problem,
        hypothesis: Hypothesis,
        start: Mapping[str, float] | None = None,
        vary: Sequence[Parameter] | None = None,
    ):
        self.problem, self.hypothesis = problem, hypothesis
        self.settings: WindowSettings = problem.settings.windows
        # whole numbers, such as the order of a torque, are held
        varied = problem.parameters(hypothesis) if vary is None else vary
        self.parameters = tuple(p for p in varied if not p.whole)
        self._fixed = {p.key: p.nominal for p in problem.parameters(hypothesis)} | dict(start or {})
        self._low, self._high = bounds_of(self.parameters)
        self.values = np.clip([self._fixed[p.key] for p in self.parameters], self._low, self._high)
        self._nominal = np.array([p.nominal for p in self.parameters])
        width = self._high - self._low
        finite = np.isfinite(width) & (width > 0.0)
        # flat bounds, as a normal law: half their width is a standard deviation
        self.prior = np.where(finite, 2.0 / np.where(finite, width, 1.0), 0.0)
        self._steps = np.array([p.step for p in self.parameters])
        self.stages: list[Stage] = []
        self._runs: dict[str, _Run] = {}
        self._slow: dict[str, np.ndarray] = {}
        self._motions: dict[str, _Motion] = {}
        self._columns: dict[str, tuple[np.ndarray, np.ndarray]] | None = None

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
        """What the weak law of the parameters costs."""
        return float(np.sum((self.prior * (self.values - self._nominal)) ** 2))

    @property
    def residual(self) -> np.ndarray:
        """Whitened residuals of the whole problem, (n,), measured less simulated."""
        found = np.zeros(self.problem.size)
        for run, one in self._runs.items():
            ends = np.cumsum([int(part.used.sum()) for part in one.parts])[:-1]
            for part, own in zip(one.parts, np.split(self._motions[run].residual, ends), strict=True):
                found[part.place] = -own
        return found

    @property
    def readings(self) -> dict[str, Mapping[str, np.ndarray]]:
        """What is read at the samples, by run and channel [unit]."""
        return {run: motion.readings for run, motion in self._motions.items()}

    def _by_key(self, values: np.ndarray) -> dict[str, float]:
        return self._fixed | {p.key: float(v) for p, v in zip(self.parameters, values, strict=True)}

    def _windowed(self, run: str, values: np.ndarray) -> WindowedRun:
        return self._windowed_with(run, self._by_key(values), self.hypothesis)

    def _windowed_with(self, run: str, values: Mapping[str, float], hypothesis: Hypothesis) -> WindowedRun:
        found = windowed_run(self.problem, run, values, hypothesis)
        if found is None:
            raise SimulationError(f"run {run} is not simulated in windows with {label_of(hypothesis)}")
        return found

    def find_states(self, jump: float, turns: float = math.inf) -> float:
        """Find the states by the filter at a jump: the deviance for each reading."""
        deviance, readings = 0.0, 0.0
        per_turn, self._columns = self._windows_a_turn(), None
        for run in self.problem.runs:
            parts = [part for part in self.problem.parts if part.series.run == run]
            one = self._runs[run] = _Run(parts, self._windowed(run, self.values), per_turn, jump, turns)
            self._slow[run] = one.states.slow.copy()
            deviance, readings = deviance + one.filtered.deviance, readings + one.filtered.readings
        return deviance / max(readings, 1.0)

    def _windows_a_turn(self) -> int:
        """So many that each window holds some readings for each number of its state."""
        settings, least = self.settings, math.inf
        for run in self.problem.runs:
            windowed = self._windowed(run, self.values)
            parts = [part for part in self.problem.parts if part.series.run == run]
            readings = sum(int(part.used.sum()) for part in parts if part.series.channel in windowed.channels)
            least = min(least, readings / windowed.turns / (settings.readings_per_number * windowed.size))
        return int(np.clip(least, settings.least_windows, settings.most_windows))

    def _simulate(self, values: np.ndarray, slow: Mapping[str, np.ndarray]) -> dict[str, _Motion]:
        return {run: one.motion(self._windowed(run, values), slow[run]) for run, one in self._runs.items()}

    def _cost(self, values: np.ndarray, slow: Mapping, motions: Mapping[str, _Motion], jump: float) -> float:
        total = float(np.sum((self.prior * (values - self._nominal)) ** 2))
        for run, motion in motions.items():
            gap = turned(slow[run][1:], motion.ends[:-1])[motion.done[:-1]]
            first = turned(slow[run][0], self._runs[run].first) / self.settings.first_state
            total += float(motion.residual @ motion.residual + np.sum((gap / jump) ** 2) + first @ first)
        return total

    def _by_states(self, values: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Derivatives by the state of each window: of residuals (2, n, d), by whether the window is an even one, and of
        its end (k, d, d)."""
        found = {}
        for run, one in self._runs.items():
            motion, slow, windowed = self._motions[run], self._slow[run], self._windowed(run, values)
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
        """Derivatives by the parameters: of residuals (n, m) and of the ends of windows (k, d, m), run by run."""
        columns = []
        for i, p in enumerate(self.parameters):
            for _ in range(2):
                step = self._steps[i] if values[i] + self._steps[i] <= self._high[i] else -self._steps[i]
                moved = self._by_key(values) | {p.key: float(values[i] + step)}
                column = self._by_value(p.run, step, moved, self.hypothesis)
                length = math.hypot(*(np.linalg.norm(by_value) for by_value, _ in column.values()))
                self._steps[i] = p.step / min(max(p.step * length / CHANGE, 1.0), SHORTER)
                if abs(step) < TOO_LONG * self._steps[i]:
                    break
            columns.append(column)
        return {run: tuple(np.stack([c[run][j] for c in columns], axis=-1) for j in (0, 1)) for run in self._runs}

    def _nothing(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Derivatives by parameters that are held."""
        shape = (self.values.size,)
        return {
            run: (np.zeros(motion.residual.shape + shape), np.zeros(motion.ends.shape + shape))
            for run, motion in self._motions.items()
        }

    def _by_value(
        self, own_run: str | None, step: float, moved: Mapping[str, float], hypothesis: Hypothesis
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Derivatives by what is `moved` by a `step`."""
        found = {}
        for run, one in self._runs.items():
            motion = self._motions[run]
            if own_run not in (None, run):
                found[run] = np.zeros(motion.residual.size), np.zeros(motion.ends.shape)
                continue
            other = one.motion(self._windowed_with(run, moved, hypothesis), self._slow[run])
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
        """The normal equations, of parameters that are `off` (m,) their prior's mean."""
        m = off.size
        hessian, gradient = np.diag(prior**2), prior**2 * off
        determinant, gain, states = 0.0, 0.0, []
        for run, one in self._runs.items():
            motion, slow = self._motions[run], self._slow[run]
            (by_value, end_by_value), (own, ends) = columns[run], by_states[run]
            count, d = slow.shape
            diagonal, below = np.zeros((count, d, d)), np.zeros((count - 1, d, d))
            border, slope = np.zeros((count, d, m)), np.zeros((count, d))
            residual, window = motion.residual[:, None], one.window
            for parity in (0, 1):
                # a sample answers to its own window's state and, by the memory of noise, to that of the one before
                at_home = window % 2 == parity
                spilt = ~at_home & (window > 0) & np.any(own[parity] != 0.0, axis=1)
                for rows, place in ((at_home, window), (spilt, window - 1)):
                    a, w = own[parity][rows], place[rows]
                    np.add.at(diagonal, w, a[:, :, None] * a[:, None, :])
                    np.add.at(border, w, a[:, :, None] * by_value[rows][:, None, :])
                    np.add.at(slope, w, a * residual[rows])
                later = own[1 - parity][spilt]
                np.add.at(below, window[spilt] - 1, later[:, :, None] * own[parity][spilt][:, None, :])
            weight = np.where(motion.done[:-1], 1.0 / jump**2, 0.0)[:, None, None]
            gap = np.where(motion.done[:-1, None], turned(slow[1:], motion.ends[:-1]), 0.0)[:, :, None]
            f, g = ends[:-1], end_by_value[:-1]
            ft, gt = f.transpose(0, 2, 1), g.transpose(0, 2, 1)
            diagonal[1:] += weight * np.eye(d)
            diagonal[:-1] += weight * (ft @ f)
            below -= weight * f
            border[1:] -= weight * g
            border[:-1] += weight * (ft @ g)
            slope[1:] += (weight * gap)[:, :, 0]
            slope[:-1] -= (weight * (ft @ gap))[:, :, 0]
            hessian = hessian + by_value.T @ by_value + np.sum(weight * (gt @ g), axis=0)
            gradient = gradient + by_value.T @ motion.residual - np.sum(weight * (gt @ gap), axis=0)[:, 0]
            first = self.settings.first_state
            diagonal[0] += np.eye(d) / first**2
            slope[0] += turned(slow[0], one.first) / first**2
            factor = cholesky_banded(_band(diagonal, below, damping), lower=True)
            determinant += 2.0 * float(np.sum(np.log(factor[0])) + d * math.log(first))
            determinant += 2.0 * d * int(motion.done[:-1].sum()) * math.log(jump)
            border, slope = border.reshape(count * d, m), slope.reshape(count * d)
            solved = cho_solve_banded((factor, True), np.column_stack([border, slope]))
            hessian, gradient = hessian - border.T @ solved[:, :m], gradient - border.T @ solved[:, m]
            gain += float(slope @ solved[:, m])
            states.append(solved)
        return _Normal(0.5 * (hessian + hessian.T), gradient, determinant, states, gain)

    def fit_at(self, jump: float) -> None:
        """Fit at a jump, from where the one before ended."""
        for run, one in self._runs.items():
            one.hand_on(self._slow[run], self._motions[run])
        if not self._runs or jump >= self.settings.filtered_above:
            self._filtered(jump, anew=not self._runs)
        self._descend(jump, held=jump > self.settings.held_above or not self.parameters)

    @property
    def leads_on(self) -> bool:
        """Whether the likelihood is about as large as ever; of a wrong model it is largest somewhere in between."""
        return self.stages[-1].deviance <= self.best.deviance + self.settings.far_behind * self.problem.size

    def anneal(self, below: float = math.inf) -> "Estimate":
        """Fit at one jump `below` some after the other, while that leads on."""
        for jump in self.settings.jumps:
            if jump < below:
                self.fit_at(jump)
                if not self.leads_on:
                    break
        return self

    def _filtered(self, jump: float, anew: bool) -> None:
        """Let the filter find the states, if that makes the cost smaller."""
        if anew:
            self.find_states(jump)
            return
        before = dict(self._runs), dict(self._slow), self._columns
        known = self._cost(self.values, self._slow, self._simulate(self.values, self._slow), jump)
        self.find_states(jump)
        if self._cost(self.values, self._slow, self._simulate(self.values, self._slow), jump) > known:
            self._runs, self._slow, self._columns = before

    def _descend(self, jump: float, held: bool) -> None:
        """Gauss-Newton steps at one jump, damped where they overreach, until the next one promises little."""
        settings = self.settings
        self._motions = self._simulate(self.values, self._slow)
        cost, damping = self._cost(self.values, self._slow, self._motions, jump), 0.0
        by_states, still = self._by_states(self.values), np.zeros(self.values.size)
        fresh, stale = False, self._columns is None
        for _ in range(settings.iterations):
            if stale:
                self._columns = self._nothing() if held else self._by_values(self.values)
                fresh, stale = True, False
            room = (still, still) if held else (self._low - self.values, self._high - self.values)
            moved, negligible = False, max(1.0, settings.decrease * cost)
            for _ in range(8):
                normal = self._at(jump, by_states, damping)
                step, gain = normal.step(*room, damping)
                values = np.clip(self.values + step, self._low, self._high)
                slow, promised = self._followed(normal, values - self.values), gain + normal.gain
                motions, new = self._tried(values, slow, jump)
                if new < cost:
                    moved = True
                    break
                damping = max(10.0 * damping, 1e-3)
                if promised < negligible:
                    break
            if moved:
                ratio, decrease, cost = (cost - new) / max(promised, 1e-300), cost - new, new
                self.values, self._slow, self._motions = values, slow, motions
                damping = damping * (0.1 if ratio > 0.75 else 0.5) if damping > 1e-4 else 0.0
                by_states = self._by_states(self.values)
                ends = max(decrease, promised) < negligible
            else:
                ends, ratio, damping = True, 0.0, 0.0
            if ends and fresh:
                break
            fresh, stale = False, ends or ratio < settings.renewed_below
        normal = self._at(jump, by_states)
        lost = float(np.mean(np.concatenate([~motion.done for motion in self._motions.values()])))
        if held:
            self._columns = None
        self.stages.append(Stage(jump, cost, cost + normal.determinant, lost, self.values.copy(), normal.hessian))

    def _tried(self, values: np.ndarray, slow: Mapping, jump: float) -> tuple[dict[str, _Motion], float]:
        """The motions from there, and their cost: infinity where they cannot be simulated."""
        try:
            motions = self._simulate(values, slow)
        except FAILURES:
            return {}, math.inf
        return motions, self._cost(values, slow, motions, jump)

    def _at(self, jump: float, by_states: Mapping, damping: float = 0.0) -> _Normal:
        return self._normal(self.values - self._nominal, self.prior, self._columns, by_states, jump, damping)

    def _followed(self, normal: _Normal, step: np.ndarray) -> dict[str, np.ndarray]:
        """The states after a step of the parameters."""
        found = {}
        for (run, slow), solved in zip(self._slow.items(), normal.states, strict=True):
            change = -(solved[:, -1] + solved[:, :-1] @ step).reshape(slow.shape)
            reach = np.tile([0.6, 3.0], slow.shape[1] // 2)  # [rad], [crank's rates] beyond, the linear model is idle
            found[run] = slow + np.clip(change, -reach, reach)
        return found

    def known(self, fit: Fit, ended: bool = False) -> np.ndarray:
        """`Fit.windows` of a fit that began here; an estimate that ended earlier counts for one at its end if asked."""
        keys = [p.key for p in fit.parameters]
        places = [keys.index(p.key) for p in self.parameters]
        values, rows = fit.values.copy(), np.zeros((0, fit.values.size))
        values[places] = self.values
        if ended or self.stages[-1].jump <= self.settings.jumps[-1]:
            # bounds count by themselves
            roots, vectors = np.linalg.eigh(self.stages[-1].hessian - np.diag(self.prior**2))
            rows = np.zeros((roots.size, fit.values.size))
            rows[:, places] = np.sqrt(np.maximum(roots, 0.0))[:, None] * vectors.T
        return np.vstack([values, rows])

    def scores(self, candidates: Sequence[Candidate]) -> list[tuple[float, Candidate, dict[str, float]]]:
        """By how much each candidate would lower the deviance here if all were linear, and at which values; the most
        first."""
        jump = self.stages[-1].jump
        by_states, columns = self._by_states(self.values), self._by_values(self.values)
        without = self._normal(self.values - self._nominal, self.prior, columns, by_states, jump)
        room = self._low - self.values, self._high - self.values
        alone, found = without.step(*room)[1], []
        taken = {claim for effect in self.hypothesis for claim in effect.claims}
        for candidate in candidates:
            if taken & candidate.claims:
                continue
            tried = []
            for guess in candidate.initial_guesses:
                if not set(guess) & set(candidate.amplitudes):  # what is never small has no slope
                    try:
                        tried.append(self._score(candidate, guess, jump, by_states, columns))
                    except FAILURES:
                        continue
            if tried:
                gain, values = max(tried, key=lambda each: each[0])
                found.append((gain - alone, candidate, values))
        return sorted(found, key=lambda each: -each[0])

    def _score(
        self, candidate: Candidate, guess: Mapping[str, float], jump: float, by_states: Mapping, columns: Mapping
    ) -> tuple[float, dict[str, float]]:
        own = {p.key: f"{candidate.label}.{p.key}" for p in candidate.coordinates_in(self.problem.runs)}
        absent = {key: guess.get(key, 0.0 if key in candidate.amplitudes else None) for key in own}
        by_key = {p.key: p for p in candidate.coordinates}
        at = self.mapping | {own[key]: by_key[key].nominal if value is None else value for key, value in absent.items()}
        amplitudes = [by_key[key] for key in own if key in candidate.amplitudes]
        both, steps, further = (*self.hypothesis, candidate), [], []
        # a nuisance that it replaces goes on from where it is
        for name, amplitude in candidate.replaces.items():
            if name in self.mapping and own.get(amplitude):
                at[own[amplitude]] = self.mapping[name] - next(p.nominal for p in self.parameters if p.key == name)
        for p in amplitudes:
            here = at[own[p.key]]
            step = p.step if here + p.step <= p.high else -p.step
            further.append(self._by_value(p.run, step, at | {own[p.key]: here + step}, both))
            steps.append((p.low - here, p.high - here))
        wide = {
            run: tuple(
                np.concatenate([columns[run][j], np.stack([c[run][j] for c in further], axis=-1)], axis=-1)
                for j in (0, 1)
            )
            for run in self._runs
        }
        more = np.zeros(len(amplitudes))
        off = np.append(self.values - self._nominal, more)
        normal = self._normal(off, np.append(self.prior, more), wide, by_states, jump)
        low, high = np.array(steps).T
        step, gain = normal.step(np.append(self._low - self.values, low), np.append(self._high - self.values, high))
        # nuisances begin where they are: what is far from here moves them by less than slopes say
        sizes = {
            own[p.key]: at[own[p.key]] + float(s) for p, s in zip(amplitudes, step[self.values.size :], strict=True)
        }
        return gain, at | sizes


def _both(motion: _Motion, other: _Motion, change: np.ndarray) -> np.ndarray:
    """A change of ends (k, d), 0 of windows that either could not simulate."""
    return np.where((motion.done & other.done)[:, None], change, 0.0)


def _band(diagonal: np.ndarray, below: np.ndarray, damping: float) -> np.ndarray:
    """A symmetric matrix of blocks (k, d, d) on its diagonal and (k - 1, d, d) below, in lower banded form."""
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
    """A run in windows with `values` by key [SI] put in; None where its model has none for it."""
    make = getattr(problem.model, "windows", None)
    return make(run, *values_in_run(problem.model, run, values, hypothesis)) if make else None


def has_windows(problem: Problem, hypothesis: Hypothesis, values: Mapping[str, float]) -> bool:
    """Whether a hypothesis can be fitted in windows: its joints are loose, and all runs are compared by samples."""
    if problem.has_statistics:
        return False
    at = {p.key: p.nominal for p in problem.parameters(hypothesis)} | dict(values)
    try:
        return all(windowed_run(problem, run, at, hypothesis) is not None for run in problem.runs)
    except FAILURES:
        return False


def compete(estimates: Sequence[Estimate], below: float = math.inf) -> list[Estimate]:
    """Fit all at one jump `below` some after the other; what is far behind the best, or does not lead on, ends.

    Best first, without those that cannot be simulated.
    """
    going, failed = list(estimates), []
    for jump in (jump for jump in (estimates[0].settings.jumps if estimates else ()) if jump < below):
        for estimate in going:
            try:
                estimate.fit_at(jump)
            except FAILURES:
                failed.append(estimate)
        going = [each for each in going if each not in failed and each.leads_on]
        if going and jump <= going[0].settings.compared_below:
            least = min(each.stages[-1].deviance for each in going)
            far = going[0].settings.far_behind * going[0].problem.size
            going = [each for each in going if each.stages[-1].deviance <= least + far]
    return sorted((each for each in estimates if each not in failed), key=lambda each: each.best.deviance)


def fitted_from(estimate: Estimate, differences: FiniteDifferences, sufficient_chi2: float = math.inf) -> Fit:
    """The fit that an estimate leads to.

    Of joints that became loose it is the estimate itself: the base, with ideal joints, has no states. Beside joints
    that are loose it is one of one trajectory of each run, as that of the base: it begins where the estimate ended,
    and knows that.
    """
    problem, hypothesis = estimate.problem, estimate.hypothesis
    ended = estimate.stages[-1].jump <= estimate.settings.jumps[-1]
    if ended and not has_windows(problem, (), estimate.mapping):
        return _fit_of(estimate)
    fit = fit_hypothesis(
        problem, hypothesis, estimate.mapping, differences=differences, sufficient_chi2=sufficient_chi2
    )
    return replace(fit, windows=estimate.known(fit))


def _fit_of(estimate: Estimate) -> Fit:
    """An estimate at its end as a fit. Jumps count like residuals."""
    size, count = estimate.problem.size, len(estimate.parameters)
    residual, cost = estimate.residual, estimate.stages[-1].cost - estimate.cost_of_values
    residual = residual * math.sqrt(cost / max(float(residual @ residual), 1e-300))
    settings = estimate.problem.settings
    blank = np.zeros((size, count))
    fit = Fit(estimate.hypothesis, estimate.parameters, estimate.values.copy(), residual, blank, 0, CONVERGED)
    windows = estimate.known(fit)
    blank[:count] = windows[1:]
    return replace(fit, slope=np.zeros(count), windows=windows, settings=settings)


class Prediction(NamedTuple):
    """What a hypothesis predicts of the runs of a problem."""

    values: Mapping[str, float]  # by key [SI]
    residual: np.ndarray  # (n,) whitened
    readings: Mapping[str, Mapping[str, np.ndarray]]  # by run and channel [unit]


def predicted(
    problem: Problem, hypothesis: Hypothesis, values: Mapping[str, float], vary: Sequence[Parameter] = ()
) -> Prediction:
    """What is predicted from the states of loose joints that are most likely at `values`; some of these may `vary`."""
    estimate = Estimate(problem, hypothesis, values, vary)
    for jump in estimate.settings.jumps:
        estimate.fit_at(jump)
    return Prediction(estimate.mapping, estimate.residual, estimate.readings)


def intervals_in_windows(problem: Problem, fit: Fit) -> Fit | None:
    """A fit to one trajectory with its intervals from windows; None where it has none.

    Of one trajectory differences are noise where impacts pass samples, and its valley is narrower than what is known:
    the curvature is that of the marginal likelihood at the last jump, and how far the two ends are apart is a shift of
    the values.
    """
    if fit.status == FAILED or not has_windows(problem, fit.hypothesis, fit.mapping):
        return None
    windows = fit.windows
    if windows is None or len(windows) == 1:
        try:
            windows = Estimate(problem, fit.hypothesis, fit.mapping).anneal().known(fit, ended=True)
        except FAILURES:
            return None
    jacobian = np.zeros(fit.jacobian.shape)
    jacobian[: len(windows) - 1] = windows[1:]
    slope, shifts = np.zeros(fit.values.size), windows[:1] - fit.values
    return replace(fit, jacobian=jacobian, slope=slope, shifts=shifts, draws=None)
