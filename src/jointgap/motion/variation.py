"""Small changes of a motion: the linearised equations of motion along it.

All is a function of the crank angle phi: the states are the positions q, the velocities and
bristles w, and, where the torque turns the crank, the time in place of its angle. A small change x
= (q, w) of the states, by a change of the parameters or of the start, follows

    dq/dphi = P w + p,    dw/dphi = A (q, w) + b

with P, A from the derivatives by the states and p, b from those by the parameters, all of them
differences of the equations of motion, so that every parameter is treated alike. Forces are
continuous where a contact begins or ends, and so is x. A contact keeps its approach speed and its
begin, whose changes follow from those of the gap at the event, and enter b afterwards.

The linear equations are solved by collocation at the Gauss points of intervals (order twice their
number; Hairer and Wanner, Solving Ordinary Differential Equations II, 1996, IV.5), which is stable
however stiff the contacts are. The intervals are the steps of the integration, and like these even
in the root of the angle next to an event; longer ones do not resolve the vibration of contacts.
"""

from collections.abc import Callable
from functools import cache
from math import pi, tau
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from jointgap.core.numba_cache import compiled, inlined
from jointgap.effects.base import SLIDER_SIGN_SPEED
from jointgap.linkage.drive import crank_times
from jointgap.linkage.topology import FRAME
from jointgap.motion.integrate import Samples
from jointgap.motion.model import Columns, Model
from jointgap.motion.runge_kutta import LINEAR, VELOCITY_TIME
from jointgap.motion.sampling import take_row
from jointgap.motion.simulation import observed

STAGES = 4
"""Gauss points in an interval."""

# [m] Differences by the states, over their weights in the error of a step: one-sided, central, and
# central by the time
_STEP, _DIRECTION, _TIME_DIRECTION = 1e-12, 1e-10, 1e-8
_BEGIN_WEIGHT = 1e-2  # [m/s] Of begins of contacts, which count while their memory fades
# Largest change of the inverse hyperbolic sine of a sliding speed and of the logarithm of a
# penetration in an interval
_FINEST = 1.4
_SHALLOW = 1e-3  # [1, of the largest] Penetrations that count as equal
_PARTS = 32  # Parts of an interval in which a reversal of sliding is found
_EVEN = 0.5 * _FINEST  # Share of an interval's parts that is even, over their number


@cache
def gauss_collocation(stages: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points (s,) of the unit interval, and weights (s, s) of the rates there in the changes
    up to these points."""
    nodes = 0.5 + 0.5 * legendre.leggauss(stages)[0]
    return nodes, integral_weights(stages, nodes)


def integral_weights(stages: int, shares: np.ndarray) -> np.ndarray:
    """Weights (n, s) of the rates at the Gauss points in the changes up to `shares` (n,) of an
    interval."""
    nodes = 0.5 + 0.5 * legendre.leggauss(stages)[0]
    powers = np.arange(stages)
    integrals = shares[:, None] ** (powers + 1) / (powers + 1)
    return integrals @ np.linalg.inv(nodes[:, None] ** powers)


class Intervals(NamedTuple):
    """Intervals of a motion, even in u: phi = origin + u, or origin + sign u^2 next to an event."""

    origins: np.ndarray  # (k,) [rad]
    signs: np.ndarray  # (k,) 0 where phi = origin + u
    edges: np.ndarray  # (k, 2) u of begin and end
    angles: np.ndarray  # (k + 1,) [rad] Crank angles of begins, and of the last end

    @property
    def lengths(self) -> np.ndarray:
        return np.diff(self.edges)[:, 0]

    def points(self) -> np.ndarray:
        """Crank angles (k, s) [rad] of the Gauss points."""
        u = self._u(gauss_collocation(STAGES)[0])
        square = self.signs[:, None] * u**2
        return self.origins[:, None] + np.where(self.signs[:, None] == LINEAR, u, square)

    def paces(self) -> np.ndarray:
        """dphi/du (k, s) at the Gauss points."""
        signs, u = self.signs[:, None], self._u(gauss_collocation(STAGES)[0])
        return np.where(signs == LINEAR, 1.0, 2.0 * signs * u)

    def _u(self, shares: np.ndarray) -> np.ndarray:
        return self.edges[:, :1] + self.lengths[:, None] * shares

    def find(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Intervals (n,) in which crank angles lie, and shares (n,) of them before."""
        place = np.searchsorted(self.angles[1:-1], angles, side="left")
        u = _u_at(angles, self.origins[place], self.signs[place])
        return place, (u - self.edges[place, 0]) / self.lengths[place]


def _u_at(angles: np.ndarray, origins: np.ndarray, signs: np.ndarray) -> np.ndarray:
    ahead = angles - origins
    root = signs * np.sqrt(np.maximum(signs * ahead, 0.0))
    return np.where(signs == LINEAR, ahead, root)


def intervals_of(taken: np.ndarray, begin: float, end: float) -> Intervals:
    """Intervals between two crank angles: the accepted steps (a, 4) of an integration."""
    ends, signs, origins, _ = taken.T
    begins = np.concatenate([[min(begin, ends[0])], ends[:-1]])
    inside = (ends > begin) & (begins < end)
    angles = np.append(np.maximum(begins[inside], begin), end)
    signs, origins = signs[inside], origins[inside]
    origins = np.where(signs == LINEAR, angles[:-1], origins)
    edges = [_u_at(each, origins, signs) for each in (angles[:-1], angles[1:])]
    return Intervals(origins, signs, np.stack(edges, axis=-1), angles)


def refined(intervals: Intervals, slips: np.ndarray, depths: np.ndarray) -> Intervals:
    """Intervals divided where the derivatives of contact forces change much.

    One of the sliding speeds at the Gauss points (k, s, m), over the speed of its regularisation,
    passes zero, or one of the penetrations (k, s, c) [m] becomes small.
    """
    largest = depths.max(axis=(0, 1), initial=0.0)

    def sizes(slips: np.ndarray, depths: np.ndarray) -> np.ndarray:
        of_depths = np.log(np.maximum(depths, _SHALLOW * largest + 1e-300))
        return np.concatenate([np.arcsinh(slips), of_depths], axis=2)

    rough = np.flatnonzero(np.ptp(sizes(slips, depths), axis=1).sum(axis=1) > 0.5 * _FINEST)
    shares, powers = np.arange(_PARTS + 1) / _PARTS, np.arange(STAGES)
    nodes = gauss_collocation(STAGES)[0]
    through_nodes = shares[:, None] ** powers @ np.linalg.inv(nodes[:, None] ** powers)
    changes = np.diff(sizes(*(through_nodes @ each[rough] for each in (slips, depths))), axis=1)
    passed = np.zeros((rough.size, _PARTS + 1))
    passed[:, 1:] = np.cumsum(np.abs(changes).sum(axis=2), axis=1)
    counts = np.ones(len(slips), int)
    counts[rough] = np.maximum(np.ceil(passed[:, -1] / _FINEST), 1)
    # an even share keeps the parts between reversals as short as the others
    passed += shares * counts[rough, None] * _EVEN
    firsts = np.cumsum(counts) - counts
    places = np.repeat(np.arange(counts.size), counts)
    ends = np.tile([0.0, 1.0], (places.size, 1))
    for place, levels in zip(rough, passed, strict=True):
        divided = np.interp(np.linspace(0.0, levels[-1], counts[place] + 1), levels, shares)
        part = slice(firsts[place], firsts[place] + counts[place])
        ends[part, 0], ends[part, 1] = divided[:-1], divided[1:]
    edges = intervals.edges[places, :1] + intervals.lengths[places, None] * ends
    signs, origins = intervals.signs[places], intervals.origins[places]
    angles = origins + np.where(signs == LINEAR, edges[:, 0], signs * edges[:, 0] ** 2)
    angles[firsts] = intervals.angles[:-1]  # exactly: events are found by them
    return Intervals(origins, signs, edges, np.append(angles, intervals.angles[-1]))


def depths_of(model: Model, motion: Samples) -> np.ndarray:
    """Penetrations (n, m) [m] of the loose revolute joints; negative in flight."""
    depths = [
        np.hypot(*model.vector(motion.states, name)[0].T) - model.bearings[name].clearance
        for name in model.pins
    ]
    return np.stack(depths, axis=-1) if depths else np.zeros((motion.times.size, 1))


def slips_of(model: Model, motion: Samples) -> np.ndarray:
    """Sliding speeds (n, m) over the speed of their regularisation [1]: of the loose joints, and of
    the bodies on slides and pivots of the frame."""
    seen, linkage = observed(model, motion), model.linkage
    speeds = {linkage.crank: seen["crank_speed"]}
    for body in linkage.moving:
        speeds[body] = seen.get(f"{body}_angular_velocity", speeds.get(body, 0.0))
    slips = []
    for name, joint in linkage.joints.items():
        if FRAME not in joint.bodies:
            continue
        body, law = joint.other(FRAME).body, model.pushed.get(name)
        if joint.kind == "slide" and not joint.loose:
            width = SLIDER_SIGN_SPEED if law is None else law.sign_speed
            slips.append(seen[f"{body}_velocity"] / width)
        elif law is not None and body != linkage.crank:
            slips.append(speeds[body] / law.sign_speed)
    for name in model.pins:
        bearing, joint = model.bearings[name], linkage.joints[name]
        body, partner = (speeds.get(each, 0.0) for each in (joint.body.body, joint.partner.body))
        (x, y), (vx, vy) = (part.T for part in model.vector(motion.states, name))
        swing = (x * vy - y * vx) / np.maximum(np.hypot(x, y), 1e-300)
        turning = bearing.body_radius * body - bearing.partner_radius * partner
        slips.append((swing + bearing.side * turning) / bearing.friction_speed)
    return np.stack(slips, axis=-1) if slips else np.zeros((motion.times.size, 1))


@compiled
def _fill_rates(p, k, found, rates):
    """Rates (n, states) over the crank angle at samples, see `rates_over_angle`."""
    for n in range(found.times.size):
        take_row(p, k, found, n)
        _take_rates(k, rates[n])


@inlined
def _take_rates(k, rates) -> None:
    pace, crank = 1.0 / k.crank[2], 2 * k.loose
    for i in range(k.states):
        rates[i] = pace * k.slope[i]
    if k.is_free:
        rates[crank] = pace


@compiled
def _fill_derivatives(p, k, found, rates, steps, derivatives):
    """Differences (n, states, c) of the `rates` (n, states) by `steps` (c,) of the first c states,
    approach speeds and begins."""
    count, crank, moved = k.states, 2 * k.loose if k.is_free else -1, np.empty(k.states)
    for n in range(found.times.size):
        for c in range(steps.size):
            time, j = found.times[n], (c - count) % max(k.contacts, 1)
            approach, begin = found.approaches[n, j], found.begins[n, j]
            if c == crank:
                found.times[n] += steps[c]
            elif c < count:
                found.states[n, c] += steps[c]
            elif c < count + k.contacts:
                found.approaches[n, j] += steps[c]
            else:
                found.begins[n, j] += steps[c]
            take_row(p, k, found, n)
            _take_rates(k, moved)
            for i in range(count):
                derivatives[n, i, c] = (moved[i] - rates[n, i]) / steps[c]
            if c < count and c != crank:
                found.states[n, c] = k.z[c] - steps[c]
            found.times[n], found.approaches[n, j], found.begins[n, j] = time, approach, begin


def rates_over_angle(model: Model, motion: Samples) -> np.ndarray:
    """Rates (n, states) of the states over the crank angle; the time is in the place of a free
    crank's angle."""
    rates = np.empty(motion.states.shape)
    _fill_rates(model.p, model.workspace().k, motion, rates)
    return rates


def at_angles(model: Model, motion: Samples, angles: np.ndarray) -> Samples:
    """The states of a motion at crank angles (n,) [rad] under the drive of another `model`."""
    return motion if model.is_free else motion._replace(times=crank_times(model.p, angles))


def shifted(model: Model, motion: Samples, change: np.ndarray) -> Samples:
    """A motion with a `change` (n, states + 2 contacts + 1) of its states, approach speeds, begins
    of contacts and time, at the same crank angles."""
    count, contacts = model.states, len(model.contacts)
    states, times = motion.states + change[:, :count], motion.times + change[:, -1]
    if model.is_free:
        place = 2 * len(model.loose)
        states[:, place] = motion.states[:, place]
        times = times + change[:, place]
    directions = motion.directions.copy()
    for column, name in enumerate(model.pins):
        (x, y), (x1, y1) = (model.vector(each, name)[0].T for each in (motion.states, states))
        directions[:, column] += np.arctan2(x * y1 - y * x1, x * x1 + y * y1)
    return motion._replace(
        times=times,
        states=states,
        directions=directions,
        approaches=motion.approaches + change[:, count : count + contacts],
        begins=motion.begins + change[:, count + contacts : -1],
    )


def weights_of(model: Model) -> np.ndarray:
    """Weights (states + 2 contacts + 1,) that make changes comparable with a length [m]."""
    k, contacts = model.workspace().k, len(model.contacts)
    weights, of_time = np.array(k.weights[: model.states]), model.reach * abs(model.drive.speed)
    of_time = max(of_time, 1e-3)
    if model.is_free:  # the time is in the place of the angle
        weights[2 * len(model.loose)] = of_time
    others = (np.full(contacts, VELOCITY_TIME), np.full(contacts, _BEGIN_WEIGHT), [of_time])
    return np.concatenate([weights, *others])


def derivatives_by_states(
    model: Model, motion: Samples, rates: np.ndarray, count: int
) -> np.ndarray:
    """Derivatives (n, states, count) of the `rates` over the crank angle by the first `count`
    states, approach speeds and begins."""
    found = np.empty((*rates.shape, count))
    steps = _STEP / weights_of(model)[:count]
    own = motion._replace(
        times=motion.times.copy(),
        states=motion.states.copy(),
        approaches=motion.approaches.copy(),
        begins=motion.begins.copy(),
    )
    _fill_derivatives(model.p, model.workspace().k, own, rates, steps, found)
    return found


def along(
    model: Model, motion: Samples, change: np.ndarray, see: Callable[[Model, Samples], Columns]
) -> Columns:
    """Derivatives (n,) of what `see` returns of a motion in the direction of a `change` (n, states
    + 2 contacts + 1), see `shifted`."""
    weights, is_time = weights_of(model), np.zeros(change.shape[1], bool)
    is_time[-1] = True
    if model.is_free:
        is_time[2 * len(model.loose)] = True
    found: Columns = {}
    # in separate steps: a change of the time may be many orders larger
    for chosen, step in ((~is_time, _DIRECTION), (is_time, _TIME_DIRECTION)):
        part = np.where(chosen, change, 0.0)
        if found and not part.any():
            break
        factor = step / np.maximum(np.abs(part * weights).max(axis=1), 1e-300)
        part *= factor[:, None]
        ahead, behind = (see(model, shifted(model, motion, sign * part)) for sign in (1.0, -1.0))
        for name, values in differences(ahead, behind).items():
            found[name] = found.get(name, 0.0) + values / (2.0 * factor)
    return found


def differences(ahead: Columns, behind: Columns) -> Columns:
    """Small differences of quantities, of angles without whole turns."""
    found = {name: ahead[name] - behind[name] for name in ahead}
    turns = {name: np.remainder(each + pi, tau) - pi for name, each in found.items()}
    return found | {name: each for name, each in turns.items() if name.endswith("_angle")}


class Linear(NamedTuple):
    """Solutions of linear equations of motion in intervals: from unit changes of the N states at
    its begin, and by c unit forcings."""

    intervals: Intervals
    slopes: np.ndarray  # (k, s, N, N + c) Rates over u at the Gauss points

    def over_intervals(self) -> np.ndarray:
        """States (k, N, N + c) at the ends."""
        weights = integral_weights(STAGES, np.ones(1))
        count = self.slopes.shape[2]
        sums = weights @ self.slopes.reshape(*self.slopes.shape[:2], -1)
        found = self.intervals.lengths[:, None, None] * sums.reshape(-1, *self.slopes.shape[2:])
        found[:, :, :count] += np.eye(count)
        return found


@compiled
def chained(ends, start, forcing, starts):
    """States after intervals, from `start` (N, m): `ends` (k, N, N + c) of `Linear.over_intervals`,
    sizes `forcing` (c, m); `starts` (k, N, m) become the states at the begins."""
    size, width = start.shape
    state, moved = start.copy(), np.empty_like(start)
    for n in range(len(ends)):
        for i in range(size):
            for m in range(width):
                starts[n, i, m] = state[i, m]
                moved[i, m] = 0.0
            for j in range(size):
                factor = ends[n, i, j]
                for m in range(width):
                    moved[i, m] += factor * state[j, m]
            for j in range(forcing.shape[0]):
                factor = ends[n, i, size + j]
                for m in range(width):
                    moved[i, m] += factor * forcing[j, m]
        state, moved = moved, state
    return state


class Solution(NamedTuple):
    """m solutions of linear equations of motion."""

    linear: Linear
    starts: np.ndarray  # (k, N, m) States at the begins of the intervals
    forcing: np.ndarray  # (k, c, m) Sizes of the forcings

    def __call__(self, angles: np.ndarray) -> np.ndarray:
        """States (n, N, m) at crank angles (n,) [rad]."""
        place, shares = self.linear.intervals.find(angles)
        weights = self.linear.intervals.lengths[place, None] * integral_weights(STAGES, shares)
        moved = np.einsum("ns,nsab->nab", weights, self.linear.slopes[place])
        count = self.starts.shape[1]
        starts = self.starts[place]
        return starts + moved[..., :count] @ starts + moved[..., count:] @ self.forcing[place]


def linear_motion(
    intervals: Intervals, positions: int, by_states: np.ndarray, forcing: np.ndarray
) -> Linear:
    """Solve x' = `by_states` x + `forcing`, rates over the crank angle at the Gauss points (k, s,
    N, N) and (k, s, N, c), where the rates of the first `positions` states depend on the others
    only."""
    count, width = forcing.shape[2:]
    slopes = np.empty((*by_states.shape[:2], count, count + width))
    weights = gauss_collocation(STAGES)[1]
    paces = intervals.paces()
    _fill_slopes(intervals.lengths, paces, weights, positions, by_states, forcing, slopes)
    return Linear(intervals, slopes)


@compiled
def _solve(matrix, right):
    """Solve matrix x = right in place by elimination with pivoting: (n, n), (n, m)."""
    size, width = right.shape
    for c in range(size):
        pivot = c
        for r in range(c + 1, size):
            if abs(matrix[r, c]) > abs(matrix[pivot, c]):
                pivot = r
        if pivot != c:
            for k in range(c, size):
                matrix[c, k], matrix[pivot, k] = matrix[pivot, k], matrix[c, k]
            for k in range(width):
                right[c, k], right[pivot, k] = right[pivot, k], right[c, k]
        inverse = 1.0 / matrix[c, c]
        for r in range(c + 1, size):
            factor = matrix[r, c] * inverse
            for k in range(c + 1, size):
                matrix[r, k] -= factor * matrix[c, k]
            for k in range(width):
                right[r, k] -= factor * right[c, k]
    for c in range(size - 1, -1, -1):
        inverse = 1.0 / matrix[c, c]
        for k in range(width):
            right[c, k] *= inverse
        for r in range(c):
            factor = matrix[r, c]
            for k in range(width):
                right[r, k] -= factor * right[c, k]


@compiled
def _fill_slopes(lengths, paces, a, half, by_states, forcing, slopes):
    """`Linear.slopes` (k, s, N, N + c), by elimination of the positions; `a` (s, s) are the weights
    of the Gauss points."""
    count, stages, states, width = forcing.shape
    others, columns = states - half, states + width
    size = stages * others
    matrix, rates = np.empty((size, size)), np.empty((size, columns))
    steady = np.empty((stages, half, columns))
    twice = np.empty((half, others))
    for n in range(count):
        h = lengths[n]
        # rates of the positions with velocities that do not change
        for i in range(stages):
            pace = paces[n, i]
            for r in range(half):
                for c in range(columns):
                    steady[i, r, c] = 0.0
                for c in range(others):
                    steady[i, r, half + c] = pace * by_states[n, i, r, half + c]
                for c in range(width):
                    steady[i, r, states + c] = pace * forcing[n, i, r, c]
        for i in range(stages):
            pace = paces[n, i]
            for m in range(stages):
                for r in range(half):
                    for c in range(others):
                        twice[r, c] = 0.0
                        for j in range(stages):
                            twice[r, c] += a[i, j] * a[j, m] * steady[j, r, half + c]
                for r in range(others):
                    row = by_states[n, i, half + r]
                    for c in range(others):
                        total = a[i, m] * row[half + c]
                        for b in range(half):
                            total += h * row[b] * twice[b, c]
                        matrix[i * others + r, m * others + c] = -h * pace * total
            for r in range(others):
                row, out = by_states[n, i, half + r], rates[i * others + r]
                matrix[i * others + r, i * others + r] += 1.0
                for c in range(states):
                    out[c] = row[c]
                for c in range(width):
                    out[states + c] = forcing[n, i, half + r, c]
                for b in range(half):
                    for j in range(stages):
                        factor = h * row[b] * a[i, j]
                        for c in range(half, columns):
                            out[c] += factor * steady[j, b, c]
                for c in range(columns):
                    out[c] *= pace
        _solve(matrix, rates)
        for i in range(stages):
            for r in range(others):
                for c in range(columns):
                    slopes[n, i, half + r, c] = rates[i * others + r, c]
            for r in range(half):
                out = slopes[n, i, r]
                for c in range(columns):
                    out[c] = steady[i, r, c]
                for b in range(others):
                    factor = h * steady[i, r, half + b]
                    if factor == 0.0:
                        continue
                    for j in range(stages):
                        for c in range(columns):
                            out[c] += factor * a[i, j] * rates[j * others + b, c]
