"""A motion in windows: the full contact model over short parts of a record, each with its own
initial state.

The state of a loose joint in a window is the angle of its pin on the clearance circle and the rate
of that angle. The distance of the centres follows: in contact the equilibrium penetration, plus the
deviation at the end of the previous window; in flight its share of the clearance. Windows that join
form one trajectory from an estimated start.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jointgap.contact.joints import CONTACT, FLIGHT
from jointgap.core.numba_cache import compiled
from jointgap.core.records import Record
from jointgap.linkage.drive import crank_times
from jointgap.motion.integrate import DONE, Samples, begin, integrate
from jointgap.motion.model import Columns, Model
from jointgap.motion.rates import evaluate
from jointgap.motion.sampling import fill_samples
from jointgap.motion.simulation import observed
from jointgap.motion.workspace import HERE

STEPS_PER_REVOLUTION = 30_000
"""Largest number of steps of a window, per revolution: states that require more are unrealistic."""

_LONG_AGO = -1e6  # [s] beginning of a contact whose impact has no effect any more
_NEWTON, _CLOSE = (
    6,
    1e-6,
)  # largest number of steps to the equilibrium, and its tolerance of the forces [1]
_LOST = 100.0  # [1] squared residual of each reading in a failed window
_NEGLIGIBLE = 0.3  # [1] decrease of a window's squares below which iteration stops
_WIDEST = 10.0  # [rad^2], [crank speeds^2] bound of a state's variance
_LEAST_FORCE = 1e-4  # [N] of a contact in equilibrium without load


class Carried(NamedTuple):
    """Initial values of each of k windows besides its state, from the previous window; c loose
    joints."""

    states: np.ndarray  # (k, states), of which those of the clearance vectors are not used
    modes: np.ndarray  # (k, c)
    approaches: np.ndarray  # (k, c) [m/s]
    begins: np.ndarray  # (k, c) [s]
    # (k, c) in contact the penetration minus that of the equilibrium [m], in flight r over
    # clearance
    off: np.ndarray
    radial: np.ndarray  # (k, c) radial speeds [m/s]


@dataclass(frozen=True)
class WindowStates:
    """States at the beginning of each of k windows of a record.

    `slow` (k, d) contains angle [rad] and rate over the crank speed [1] of each loose joint.
    """

    edges: np.ndarray  # (k + 1,) times since the record's first sample [s]
    slow: np.ndarray
    carried: Carried


def resting(model: Model, count: int) -> Carried:
    """Default initial values: all joints in lasting contact, in equilibrium."""
    least = [model.bearings[name].least_approach for name in model.loose]
    shape = count, len(least)
    return Carried(
        np.zeros((count, model.states)),
        np.full(shape, CONTACT),
        np.tile(np.array(least, dtype=float), (count, 1)),
        np.full(shape, _LONG_AGO),
        np.zeros(shape),
        np.zeros(shape),
    )


@compiled
def _solve(matrix, right):
    """Solve for `right` (d, m) in place, by elimination with pivoting; `matrix` (d, d) is lost.

    Returns the logarithm of its determinant's magnitude. The routines of numpy take seconds to
    compile.
    """
    d, columns = right.shape
    log_determinant = 0.0
    for i in range(d):
        pivot = i
        for row in range(i + 1, d):
            if abs(matrix[row, i]) > abs(matrix[pivot, i]):
                pivot = row
        for j in range(d):
            matrix[i, j], matrix[pivot, j] = matrix[pivot, j], matrix[i, j]
        for j in range(columns):
            right[i, j], right[pivot, j] = right[pivot, j], right[i, j]
        log_determinant += math.log(abs(matrix[i, i]))
        for row in range(i + 1, d):
            share = matrix[row, i] / matrix[i, i]
            for j in range(i, d):
                matrix[row, j] -= share * matrix[i, j]
            for j in range(columns):
                right[row, j] -= share * right[i, j]
    for i in range(d - 1, -1, -1):
        for j in range(columns):
            for row in range(i + 1, d):
                right[i, j] -= matrix[i, row] * right[row, j]
            right[i, j] /= matrix[i, i]
    return log_determinant


@compiled
def _inverse(matrix):
    """The inverse of a matrix (d, d)."""
    inverse = np.eye(len(matrix))
    _solve(matrix.copy(), inverse)
    return inverse


@compiled
def _place(p, k, angle, rate, depth, radial):
    """Evaluate the state with the loose joints at `angle` (c,) with `rate`, `depth` and `radial`
    speed."""
    for j in range(k.contacts):
        r, c, s = k.joints[j].clearance + depth[j], math.cos(angle[j]), math.sin(angle[j])
        x, v = 2 * j, k.half + 2 * j
        k.y[HERE, x], k.y[HERE, x + 1] = r * c, r * s
        k.y[HERE, v] = radial[j] * c - rate[j] * r * s
        k.y[HERE, v + 1] = radial[j] * s + rate[j] * r * c
    evaluate(p, k, HERE)


@compiled
def _leaving(k, angle, rate, depth, out):
    """Second rate [m/s^2] of the distance of centres of each loose joint."""
    for j in range(k.contacts):
        v = k.half + 2 * j
        swing = (k.joints[j].clearance + depth[j]) * rate[j] ** 2
        away = k.dy[HERE, v] * math.cos(angle[j]) + k.dy[HERE, v + 1] * math.sin(angle[j])
        out[j] = away + swing


@compiled
def _balance(p, k, angle, rate, depth, radial):
    """The `depth` [m] (c,) with the equilibrium penetration of joints in contact, which keeps them
    on their circles.

    Newton's method for the forces; accelerations are linear in them, except for friction.
    """
    count = k.contacts
    force, depth, still = np.zeros(count), depth.copy(), radial.copy()
    out, moved = np.zeros(count), np.zeros(count)
    touching = np.zeros(count, np.bool_)
    for j in range(count):
        touching[j] = k.modes[j] != FLIGHT
        if touching[j]:
            depth[j], still[j] = 1e-9, 0.0
            force[j] = k.joints[j].stiffness * depth[j] ** k.joints[j].exponent
    for _ in range(_NEWTON):
        _place(p, k, angle, rate, depth, still)
        _leaving(k, angle, rate, depth, out)
        matrix, largest = np.eye(count), 0.0
        for j in range(count):
            if touching[j]:
                joint, more = k.joints[j], max(1e-3 * force[j], 1e-3)
                before = depth[j]
                depth[j] = ((force[j] + more) / joint.stiffness) ** (1.0 / joint.exponent)
                _place(p, k, angle, rate, depth, still)
                _leaving(k, angle, rate, depth, moved)
                depth[j] = before
                for i in range(count):
                    if touching[i]:
                        matrix[i, j] = (moved[i] - out[i]) / more
        change = np.zeros((count, 1))
        for j in range(count):
            change[j, 0] = -out[j] if touching[j] else 0.0
        _solve(matrix, change)
        for j in range(count):
            if touching[j]:
                joint = k.joints[j]
                largest = max(largest, abs(change[j, 0]) / (force[j] + 1e-3))
                force[j] = max(force[j] + change[j, 0], _LEAST_FORCE)
                depth[j] = (force[j] / joint.stiffness) ** (1.0 / joint.exponent)
        if largest < _CLOSE:
            break
    return depth


@compiled
def _polar(k):
    """Distance of the centres, its rate, angle and its rate, (c, 4), of the loose joints."""
    out = np.zeros((k.contacts, 4))
    for j in range(k.contacts):
        x, v = 2 * j, k.half + 2 * j
        ex, ey, vx, vy = k.y[HERE, x], k.y[HERE, x + 1], k.y[HERE, v], k.y[HERE, v + 1]
        r = math.sqrt(ex * ex + ey * ey)
        out[j, 0] = r
        if r > 0.0:
            out[j, 1], out[j, 2] = (ex * vx + ey * vy) / r, math.atan2(ey, ex)
            out[j, 3] = (ex * vy - ey * vx) / (r * r)
    return out


@compiled
def _begin(p, k, time, w, slow, speed, carried):
    """Start the integration of window `w` in its state `slow` (d,)."""
    count = k.contacts
    angle, rate, depth = np.zeros(count), np.zeros(count), np.zeros(count)
    radial = carried.radial[w].copy()
    for i in range(k.states):
        k.y[HERE, i] = carried.states[w, i]
    k.time[HERE] = time
    for i in range(2 * k.rubbing + k.pushed):
        k.settled[HERE, i] = 0.0
    for j in range(count):
        k.modes[j], k.approaches[j] = carried.modes[w, j], carried.approaches[w, j]
        k.begins[j] = carried.begins[w, j]
        angle[j], rate[j] = slow[2 * j], slow[2 * j + 1] * speed
        if k.modes[j] == FLIGHT:
            clearance = k.joints[j].clearance
            depth[j] = min(carried.off[w, j], 1.0 - 1e-9) * clearance - clearance
    depth = _balance(p, k, angle, rate, depth, radial)
    for j in range(count):
        if k.modes[j] != FLIGHT:
            depth[j] = max(depth[j] + carried.off[w, j], 1e-12)
    _place(p, k, angle, rate, depth, radial)
    begin(p, k, 0.05)


@compiled
def _part(found, first, last):
    """Rows of an integration from `first` to `last`."""
    return Samples(
        found.times[first:last],
        found.states[first:last],
        found.modes[first:last],
        found.approaches[first:last],
        found.begins[first:last],
        found.directions[first:last],
        found.events,
        0,
    )


@compiled
def _run(p, w, slow, run):
    """Integrate window `w` from the state `slow` (d,); returns whether it succeeded.

    Its samples are those of the rows, the last one at its end. The state there and its other values
    become row `w` of `run.end` and `run.after`.
    """
    k, speed, rows, end, after = run.k, abs(p.drive.speed), run.rows, run.end, run.after
    found, first, last = rows.found, rows.bounds[w], rows.bounds[w + 1]
    part, n = _part(found, first, last), last - 1
    _begin(p, k, part.times[0], w, slow, speed, run.carried)
    status, _, _, _ = integrate(p, k, part, rows.angles[first:last], run.tolerance, rows.limits[w])
    if status != DONE:
        return False
    for i in range(k.states):
        k.y[HERE, i] = after.states[w, i] = found.states[n, i]
    k.time[HERE] = found.times[n]
    polar, depth = _polar(k), np.zeros(k.contacts)
    for j in range(k.contacts):
        k.modes[j], k.approaches[j] = found.modes[n, j], found.approaches[n, j]
        k.begins[j] = found.begins[n, j]
        depth[j] = polar[j, 0] - k.joints[j].clearance
    angle, rate, radial = polar[:, 2].copy(), polar[:, 3].copy(), polar[:, 1].copy()
    balance = _balance(p, k, angle, rate, depth, radial)
    for j in range(k.contacts):
        after.modes[w, j], after.approaches[w, j] = k.modes[j], k.approaches[j]
        after.begins[w, j], after.radial[w, j] = k.begins[j], polar[j, 1]
        end[w, 2 * j], end[w, 2 * j + 1] = polar[j, 2], polar[j, 3] / speed
        flies = k.modes[j] == FLIGHT
        clearance = k.joints[j].clearance
        after.off[w, j] = polar[j, 0] / clearance if flies else depth[j] - balance[j]
    return True


class Rows(NamedTuple):
    """Rows of an integration in windows: beginning, samples and end of each window."""

    angles: np.ndarray  # (n,) [rad]
    bounds: np.ndarray  # (k + 1,) first rows of the windows
    sample: np.ndarray  # (n,) sample index of each row; -1 for ends of windows
    found: Samples
    limits: np.ndarray  # (k,) largest numbers of steps


def rows_of(model: Model, edges: np.ndarray, angles: np.ndarray) -> Rows:
    """Rows for samples at sorted crank `angles` [rad] in windows between the crank angles `edges`
    (k + 1,) [rad]."""
    count = edges.size - 1
    window = np.clip(np.searchsorted(edges, angles, side="right") - 1, 0, count - 1)
    places, turned = np.arange(count), np.clip(angles, edges[0], edges[-1])
    of = np.concatenate([places, window, places])  # sorted stably: beginning, samples, end
    order = np.argsort(of, kind="stable")
    sample = np.concatenate([np.full(count, -1), np.arange(angles.size), np.full(count, -1)])[order]
    all_angles = np.concatenate([edges[:-1], turned, edges[1:]])[order]
    found = model.room_for(crank_times(model.p, all_angles))
    limits = np.ceil(STEPS_PER_REVOLUTION * np.maximum(np.diff(edges) / math.tau, 0.02)).astype(
        np.int64
    )
    return Rows(all_angles, np.searchsorted(of[order], np.arange(count + 1)), sample, found, limits)


@compiled
def _like(carried):
    return Carried(
        np.zeros_like(carried.states),
        np.zeros_like(carried.modes),
        np.zeros_like(carried.approaches),
        np.zeros_like(carried.begins),
        np.zeros_like(carried.off),
        np.zeros_like(carried.radial),
    )


@compiled
def _copy_row(before, k, after, later):
    """Copy row `k` of `before` to row `later` of `after`."""
    for i in range(before.states.shape[1]):
        after.states[later, i] = before.states[k, i]
    for j in range(before.modes.shape[1]):
        after.modes[later, j] = before.modes[k, j]
        after.approaches[later, j] = before.approaches[k, j]
        after.begins[later, j] = before.begins[k, j]
        after.off[later, j] = before.off[k, j]
        after.radial[later, j] = before.radial[k, j]


class Readings(NamedTuple):
    """Readings for the filter: c channels, by row of an integration in windows."""

    columns: np.ndarray  # (c,) indices of the channels in `Model.columns`
    factor: np.ndarray  # (c,) scale of the readings
    shift: np.ndarray  # (c,) offset of the readings [unit]
    data: np.ndarray  # (n, c) [unit]
    weight: (
        np.ndarray
    )  # (n, c) 1 over the standard deviation of the noise [1/unit]; 0 for missing readings


class FilterSettings(NamedTuple):
    """Settings of the filter."""

    # [rad], [crank speeds] standard deviation of a state relative to the end of the previous window
    jump: float
    most: float = math.inf  # deviance at which the filter ends
    first: float = 1.0  # as `jump`, for the first state relative to the best guess
    heavy: float = 9.0  # degrees of freedom of the heavy-tailed residuals
    iterations: int = 6
    bad: float = 4.0  # mean squared residual above which the filter may have diverged
    angle_step: float = 1e-4  # [rad] of difference quotients
    rate_step: float = 2e-4  # [crank speeds]
    renewed_below: float = 0.5  # [1] gain ratio below which derivatives are computed again


def heavy_squares(residual: np.ndarray, heavy: float = FilterSettings(1.0).heavy) -> np.ndarray:
    """Squares of whitened residuals (n,) as the filter counts them: few large ones weigh less."""
    return heavy * np.log1p(residual**2 / heavy)


@compiled
def _misfit(p, k, found, first, last, bodies, numbers, nothing, readings, heavy, out):
    """Residuals of the rows from `first` to `last`, into `out` (c n,); returns their number and sum
    of squares."""
    fill_samples(p, k, _part(found, first, last), bodies, numbers[first:last], nothing)
    n, total = 0, 0.0
    for i in range(first, last):
        for c in range(readings.columns.size):
            weight = readings.weight[i, c]
            if weight > 0.0:
                value = readings.factor[c] * numbers[i, readings.columns[c]] + readings.shift[c]
                r = (value - readings.data[i, c]) * weight
                r = (
                    math.copysign(math.sqrt(heavy * math.log1p(r * r / heavy)), r)
                    if abs(r) < 1e9
                    else 1e2
                )
                out[n] = r
                total += r * r
                n += 1
    return n, total


@compiled
def _turned_by(after, before, out):
    """Difference of two states, with angles in the shorter direction."""
    for i in range(after.size):
        out[i] = after[i] - before[i]
        if i % 2 == 0:
            out[i] -= 2.0 * math.pi * math.floor(out[i] / (2.0 * math.pi) + 0.5)


class _Windows(NamedTuple):
    """Data and work arrays of a simulation or filter."""

    rows: Rows
    tolerance: float  # [m]
    carried: Carried  # initial values of the windows
    after: Carried  # the same at their ends
    end: np.ndarray  # (k, d) states at the ends
    k: Record  # workspace of the integration


class _Filtering(NamedTuple):
    """Data and work arrays of the filter; the accepted state is the best trial state so far."""

    readings: Readings
    settings: FilterSettings
    bodies: int  # of those with a direction
    numbers: np.ndarray  # (n, columns) of the rows
    nothing: np.ndarray  # (0, 0)
    residual: np.ndarray  # (m,) of the accepted state, and of a trial state
    moved: np.ndarray
    jacobian: np.ndarray  # (m, d) derivatives of the residuals
    forward: np.ndarray  # (d, d) derivatives of the state at the end
    end: np.ndarray  # (d,) at the end of the accepted state
    change: np.ndarray  # (d,)


@compiled
def _trial(p, k, state, run, of):
    """Simulate window `k` from a `state`; returns number and squares of residuals, 0 and infinity
    for a failure."""
    rows = run.rows
    if not _run(p, k, state, run):
        return 0, math.inf
    first, last, heavy = rows.bounds[k], rows.bounds[k + 1], of.settings.heavy
    return _misfit(
        p,
        run.k,
        rows.found,
        first,
        last,
        of.bodies,
        of.numbers,
        of.nothing,
        of.readings,
        heavy,
        of.moved,
    )


@compiled
def _accept(k, n, run, of):
    """Accept the last trial state of window `k`, with `n` residuals."""
    for j in range(n):  # copies of slices compile slowly
        of.residual[j] = of.moved[j]
    for i in range(of.end.size):
        of.end[i] = run.end[k, i]
    if k + 1 < len(run.end):
        _copy_row(run.after, k, run.carried, k + 1)


@compiled
def _pull(state, mean, precision, change):
    """Squared deviation of a `state` from its `mean`."""
    _turned_by(state, mean, change)
    total = 0.0
    for i in range(change.size):
        for j in range(change.size):
            total += change[i] * precision[i, j] * change[j]
    return total


@compiled
def _differentiate(p, k, state, n, run, of):
    """Derivatives by the accepted state of window `k`, by differences."""
    for i in range(state.size):
        step = of.settings.angle_step if i % 2 == 0 else of.settings.rate_step
        other = state.copy()
        other[i] += step
        m, _ = _trial(p, k, other, run, of)
        _turned_by(run.end[k], of.end, of.change)
        for j in range(n):
            of.jacobian[j, i] = (of.moved[j] - of.residual[j]) / step if m == n else 0.0
        for j in range(state.size):
            of.forward[j, i] = of.change[j] / step if m == n else (1.0 if i == j else 0.0)


@compiled
def _update(k, step, n, run, of):
    """Broyden's update of the derivatives after a `step` (d,) to the last trial state."""
    square = 0.0
    for i in range(step.size):
        square += step[i] ** 2
    _turned_by(run.end[k], of.end, of.change)
    for j in range(n):
        missed = of.moved[j] - of.residual[j]
        for i in range(step.size):
            missed -= of.jacobian[j, i] * step[i]
        for i in range(step.size):
            of.jacobian[j, i] += missed * step[i] / square
    for j in range(step.size):
        missed = of.change[j]
        for i in range(step.size):
            missed -= of.forward[j, i] * step[i]
        for i in range(step.size):
            of.forward[j, i] += missed * step[i] / square


@compiled
def _information(n, of):
    """Information (d, d) of the readings on the accepted state."""
    d = of.change.size
    out = np.zeros((d, d))
    for i in range(d):
        for j in range(i + 1):
            for row in range(n):
                out[i, j] += of.jacobian[row, i] * of.jacobian[row, j]
            out[j, i] = out[i, j]
    return out


@compiled
def _refined_state(p, k, state, n, total, mean, precision, run, of):
    """The best state of window `k` near the accepted `state`, by Levenberg-Marquardt steps, with
    its squares of residuals and of the deviation from its `mean`."""
    d, settings, damping, stale = state.size, of.settings, 1e-3, True
    for _ in range(settings.iterations):
        if n == 0:
            break
        here = total + _pull(state, mean, precision, of.change)
        off = of.change.copy()
        if stale:
            _differentiate(p, k, state, n, run, of)
        hessian, gradient = _information(n, of), np.zeros((d, 1))
        for i in range(d):
            for j in range(d):
                hessian[i, j] += precision[i, j]
                gradient[i, 0] += precision[i, j] * off[j]
            for row in range(n):
                gradient[i, 0] += of.jacobian[row, i] * of.residual[row]
        newton, promised = gradient.copy(), 0.0
        _solve(hessian.copy(), newton)
        for i in range(d):
            promised += gradient[i, 0] * newton[i, 0]
        if promised < _NEGLIGIBLE:
            break
        better, there, step = False, math.inf, np.zeros(d)
        for _ in range(4):
            damped, newton = hessian.copy(), gradient.copy()
            for i in range(d):
                damped[i, i] *= 1.0 + damping
            _solve(damped, newton)
            for i in range(d):
                reach = 0.8 if i % 2 == 0 else 3.0
                step[i] = -min(max(newton[i, 0], -reach), reach)
            _, squares = _trial(p, k, state + step, run, of)
            there = squares + _pull(state + step, mean, precision, of.change)
            if there < here:
                better = True
                break
            damping = max(8.0 * damping, 1e-3)
        if not better:
            break
        _update(k, step, n, run, of)
        state, total = state + step, squares
        _accept(k, n, run, of)
        if here - there < 0.02 * here and here - there < 3.0:
            break
        stale = here - there < settings.renewed_below * promised
        damping *= 0.2
    return state, n, total, _pull(state, mean, precision, of.change)


@compiled
def _first_state(p, k, guesses, first_is_known, run, of):
    """Accept the best of the `guesses` for window `k`; the first of them if that is known and
    fits well. Returns it with number and squares of its residuals."""
    state, n, total = guesses[0].copy(), 0, math.inf
    for g in range(len(guesses)):
        if g > 0 and first_is_known and total <= of.settings.bad * n:
            break
        m, squares = _trial(p, k, guesses[g], run, of)
        if squares < total:
            state, n, total = guesses[g].copy(), m, squares
            _accept(k, m, run, of)
    return state, n, total


@compiled
def _find_states(p, run, of, guesses, first_is_known, others, slow, squares, sizes):
    """Estimate the states of all windows one after the other, each from the end of the previous
    one.

    An iterated extended Kalman filter. The first state is near the best of the `guesses`, or near
    the first of them if that is known and fits well. For a window with large residuals the one of
    the `others` (k, d) is tried too, unless it is NaN. Fills `slow` (k, d), the initial values of
    the windows, and squares (k,) and numbers (k,) of the residuals. Returns sums over the windows:
    squares of residuals and jumps, and log determinants, which give the log marginal likelihood.
    """
    count, d = slow.shape
    rows, settings = run.rows, of.settings
    mean, covariance = guesses[0].copy(), np.eye(d) * settings.first**2
    cost = log_determinant = 0.0
    for k in range(count):
        if cost + log_determinant > settings.most:
            break
        prior = covariance + (settings.jump**2 if k > 0 else 0.0) * np.eye(d)
        precision, state = _inverse(prior), mean.copy()
        if k == 0:
            state, n, total = _first_state(p, k, guesses, first_is_known, run, of)
            mean = state.copy()
        else:
            n, total = _trial(p, k, state, run, of)
            if total < math.inf:
                _accept(k, n, run, of)
            if not math.isnan(others[k, 0]) and total > settings.bad * n:
                m, tried = _trial(p, k, others[k], run, of)
                if tried < total:
                    _accept(k, m, run, of)
                    state = others[k].copy()
                    if tried < 0.5 * total < math.inf:  # do not start from a failed window's end
                        mean, prior = state.copy(), np.eye(d) * settings.first**2
                        precision = _inverse(prior)
                    n, total = m, tried
        state, n, total, pull = _refined_state(p, k, state, n, total, mean, precision, run, of)
        for i in range(d):
            slow[k, i] = state[i]
        if n > 0:
            squares[k], sizes[k] = total, n
            sensed = _information(n, of)
            # of 1 + prior sensed, as of the sum of both precisions times the prior
            posterior = np.eye(d)
            precise = sensed + precision
            log_determinant += _solve(precise, posterior) + _solve(prior.copy(), np.eye(d))
            cost += total + pull
            covariance = np.zeros((d, d))
            for i in range(d):
                for j in range(d):
                    for a in range(d):
                        for b in range(d):
                            covariance[i, j] += (
                                of.forward[i, a] * posterior[a, b] * of.forward[j, b]
                            )
            # standard deviations stay below sqrt(_WIDEST)
            limited = np.eye(d) + covariance / _WIDEST
            _solve(limited, covariance)
            mean = of.end.copy()
        elif total == math.inf:
            squares[k] = total
            turned = rows.angles[rows.bounds[k + 1] - 1] - rows.angles[rows.bounds[k]]
            for i in range(0, d, 2):
                mean[i], mean[i + 1] = state[i] + state[i + 1] * turned, state[i + 1]
            covariance = np.eye(d)
        else:  # no readings
            mean, covariance = of.end.copy(), prior
    return cost, log_determinant


@compiled
def run_windows(p, run, of, estimate, guesses, first_is_known, others, slow, squares, sizes):
    """Simulate all windows from the states `slow` (k, d), or with `estimate` find these states.

    One function for both, as each one that contains the integration takes long to compile.
    Simulated windows have `squares` 0, failed ones infinity.
    """
    if estimate:
        return _find_states(p, run, of, guesses, first_is_known, others, slow, squares, sizes)
    for k in range(len(slow)):
        squares[k] = 0.0 if _run(p, k, slow[k], run) else math.inf
    return 0.0, 0.0


_NO_READINGS = Readings(np.empty(0, np.int64), *np.zeros((2, 0)), *np.zeros((2, 0, 0)))


def _filtering(
    model: Model, readings: Readings, settings: FilterSettings, rows: int, most: int
) -> _Filtering:
    """Work arrays of the filter for windows with up to `most` readings and d numbers a state."""
    numbers, d = np.zeros((rows, len(model.columns))), 2 * len(model.loose)
    return _Filtering(
        readings,
        settings,
        model.bodies,
        numbers,
        np.empty((0, 0)),
        np.zeros(most),
        np.zeros(most),
        np.zeros((most, d)),
        np.zeros((d, d)),
        np.zeros(d),
        np.zeros(d),
    )


def simulate_windows(
    model: Model, rows: Rows, slow: np.ndarray, carried: Carried, tolerance: float
) -> tuple[Columns, np.ndarray, Carried, np.ndarray]:
    """Quantities (m,) at the samples of the `rows`, by name; states (k, d) at the ends of the
    windows, further values there, and the success (k,) of each window.

    NaN in failed windows.
    """
    end, after, squares = np.full(slow.shape, np.nan), _like(carried), np.zeros(len(slow))
    workspace = model.workspace()
    run = _Windows(rows, tolerance, carried, after, end, workspace.k)
    of = _filtering(model, _NO_READINGS, FilterSettings(1.0), 1, 0)
    run_windows(model.p, run, of, False, slow[:1], False, slow, slow, squares, np.zeros(len(slow)))
    done = np.isfinite(squares)
    window = np.repeat(np.arange(done.size), np.diff(rows.bounds))
    chosen = np.flatnonzero((rows.sample >= 0) & done[window])
    columns, count = observed(model, rows.found.part(chosen)), int(rows.sample.max()) + 1
    out = {}
    for name, values in columns.items():
        out[name] = np.full(count, np.nan)
        out[name][rows.sample[chosen]] = values
    return out, end, after, done


class Found(NamedTuple):
    """Result of the filter."""

    slow: np.ndarray  # (k, d) states
    carried: Carried


class Sums(NamedTuple):
    """Sums of the filter."""

    deviance: float  # minus twice the log marginal likelihood, up to a constant
    readings: float


def filtered(
    model: Model,
    rows: Rows,
    count: int,
    readings: Readings,
    settings: FilterSettings,
    guesses: np.ndarray,
    first_is_known: bool,
    others: np.ndarray,
    tolerance: float,
) -> tuple[Found, Sums]:
    """States of the first `count` windows of the `rows`, by a filter.

    The first state is near the best of the `guesses` (g, d), or near the first of them if that is
    known and fits well. For a window with large residuals the one of the `others` (k, d) is tried
    too, unless it is NaN. The filter ends where the deviance exceeds that of the `settings`.
    """
    d, carried = others.shape[1], resting(model, count)
    slow, squares, sizes = np.zeros((count, d)), np.zeros(count), np.zeros(count)
    most = int(np.max(np.diff(rows.bounds[: count + 1]))) * readings.columns.size
    of = _filtering(model, readings, settings, rows.angles.size, most)
    end = np.zeros((count, d))
    workspace = model.workspace()
    run = _Windows(rows, tolerance, carried, _like(carried), end, workspace.k)
    cost, determinant = run_windows(
        model.p, run, of, True, guesses, first_is_known, others, slow, squares, sizes
    )
    lost = ~np.isfinite(squares)
    # a failed window counts as much as one that misses all of its readings
    usual = (
        float(np.mean(sizes[~lost])) if (~lost).any() else float(np.count_nonzero(readings.weight))
    )
    return Found(slow, carried), Sums(
        cost + determinant + _LOST * usual * int(lost.sum()), float(sizes.sum())
    )
