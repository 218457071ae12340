"""Periodic motion over the crank angle, and its linearised changes.

A motion that repeats every revolution and in which no contact begins or ends has smooth equations
dz/dphi = f(phi, z) with constant modes. A small change of the parameters changes its states by the
periodic solution of dx/dphi = A x + b: A is the derivative of f by the states, b the change of f at
the unchanged states. Both are differences of f, so that every parameter of the equations of motion
is treated alike. The linear problem is solved by collocation at the two Gauss points of each
interval (order four; Hairer and Wanner, Solving Ordinary Differential Equations II, 1996, IV.5),
which is stable however stiff the contacts are.
"""

from collections.abc import Sequence
from functools import cache
from math import tau
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from jointgap.contact.joints import FLIGHT
from jointgap.core.numba_cache import compiled
from jointgap.linkage.drive import crank_times
from jointgap.motion.integrate import Samples
from jointgap.motion.model import Model, Workspace
from jointgap.motion.simulation import evaluated, integrate_on, observed

INTERVALS, STAGES = 2000, 3
"""Intervals of a revolution, and Gauss points in each."""

COARSE_ANGLES = 720
"""Angles per revolution that show where sliding reverses."""

_EVEN_SHARE = 0.6  # [1] Share of the intervals that is evenly distributed
_SUBDIVISION = 20  # Parts of a coarse interval in which a reversal is found
_LARGEST_MULTIPLIER = 0.5  # [1] Above, a disturbance lasts for more than some revolutions
# [1, of the largest change, and of the largest value] Allowed difference after a revolution
_PERIODIC, _ROUNDING = 1e-2, 1e-11
_CHECKED = 40  # Every such point is compared with the next revolution
_POSITION_STEP, _VELOCITY_STEP = 1e-11, 1e-7  # [m], [m/s] Differences by the states
_LONG_AGO = -1e6  # [s] Begin of a contact whose impact has no effect any more


def _has_vectors_only(model: Model) -> bool:
    """Whether the clearance vectors are the only states, and there are some: no bristles, no
    bending rod, no motor."""
    return 0 < model.states == 4 * len(model.loose)


class Orbit(NamedTuple):
    """One revolution of a periodic motion, divided into intervals."""

    model: Model
    edges: np.ndarray  # (k + 1,) crank angles [rad] of the intervals' ends
    angles: np.ndarray  # (n,) crank angles [rad] of their Gauss points, n = k STAGES
    motion: Samples  # at these


def _lasts(model: Model, motion: Samples) -> bool:
    """Whether no contact begins or ends in a motion, and none remembers its begin."""
    modes = motion.modes
    if motion.events.size or (modes != modes[0]).any():
        return False
    for number, name in enumerate(model.loose):
        joint, begin = model.bearings[name], motion.begins[-1, number]
        faded = motion.times[0] - begin > joint.memory_time + joint.fading_time
        if modes[0, number] != FLIGHT and joint.damping > 0.0 and not faded:
            return False
    return True


def _slips(model: Model, motion: Samples) -> list[np.ndarray]:
    """Sliding speeds (n,) over the speed of their regularisation [1]: of bodies on slides of the
    frame and of the loose joints."""
    seen, linkage = observed(model, motion), model.linkage
    sliding = [body for body, kind in linkage.kinds.items() if kind == "sliding"]
    slips = [seen[f"{body}_velocity"] / model.effects.slider_sign_speed for body in sliding]
    rotations = {linkage.crank: seen["crank_speed"]}
    for name in model.loose:
        joint, between = model.bearings[name], linkage.joints[name]
        body, partner = (
            rotations.get(each.body, seen.get(f"{each.body}_angular_velocity", 0.0))
            for each in (between.body, between.partner)
        )
        (x, y), (x_dot, y_dot) = (part.T for part in model.vector(motion.states, name))
        swing = (x * y_dot - y * x_dot) / np.hypot(x, y)
        turning = joint.body_radius * body - joint.partner_radius * partner
        slips.append((swing + joint.side * turning) / joint.friction_speed)
    return slips


def _edges(slips: Sequence[np.ndarray], begin: float, count: int) -> np.ndarray:
    """Edges (count + 1,) [rad] of the intervals of a revolution from `begin`, short where one of
    the `slips` (n,) at even angles passes zero.

    The density of the intervals is even in part, in part |ds| / sqrt(1 + s^2) of each slip s.
    """
    size = slips[0].size
    places = np.arange(size * _SUBDIVISION + 1) / _SUBDIVISION
    passed = np.zeros(places.size)
    for slip in slips:
        between = np.interp(places, np.arange(size + 1), np.append(slip[-1], slip))
        passed[1:] += np.cumsum(np.abs(np.diff(np.arcsinh(between))))
    share = _EVEN_SHARE * places / size
    share += (1.0 - _EVEN_SHARE) * passed / max(passed[-1], 1e-300)
    share /= share[-1]
    edges = begin + tau / size * np.interp(np.arange(count + 1) / count, share, places)
    edges[-1] = begin + tau
    return edges


def coarse_angles(begin: float) -> np.ndarray:
    """Evenly spaced crank angles (n,) [rad] of the revolution after `begin`."""
    return begin + tau * np.arange(1, COARSE_ANGLES + 1) / COARSE_ANGLES


def periodic_orbit(
    model: Model,
    workspace: Workspace,
    coarse: Samples,
    begin: float,
    tolerance: float,
    count: int = INTERVALS,
) -> Orbit | None:
    """The revolution from the crank angle `begin` [rad]; None if a contact begins or ends in it.

    `coarse` is the periodic motion at `coarse_angles` of the revolution before, `workspace` its
    end.
    """
    if not _has_vectors_only(model) or not _lasts(model, coarse):
        return None
    edges = _edges(_slips(model, coarse), begin, count)
    angles = (edges[:-1, None] + np.diff(edges)[:, None] * gauss_collocation(STAGES)[0]).ravel()
    motion, _ = integrate_on(model, workspace, angles, tolerance)
    if not _lasts(model, motion):
        return None
    # the time since their begin has no effect, also with other parameters
    motion = motion._replace(begins=np.where(np.isfinite(motion.begins), _LONG_AGO, np.inf))
    return Orbit(model, edges, angles, motion)


@cache
def gauss_collocation(stages: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points (s,) of the unit interval, and weights (s + 1, s) of the rates there in the
    changes up to these points and up to 1."""
    nodes = 0.5 + 0.5 * legendre.leggauss(stages)[0]
    powers = np.arange(stages)
    integrals = np.append(nodes, 1.0)[:, None] ** (powers + 1) / (powers + 1)
    return nodes, integrals @ np.linalg.inv(nodes[:, None] ** powers)


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
def collocated(lengths, weights, pace, derivatives, of_positions, of_velocities, state, found):
    """Solutions of linear equations of motion at the points of intervals, from the first `state`
    (2 d, m).

    x' = pace v + of_positions, v' = derivatives (x, v) + of_velocities, at the Gauss points:
    (n, s), (n, s, d, 2 d), (n, s, d, m). `weights` (s + 1, s): see `gauss_collocation`. The
    solutions are written to `found` (n, s + 1, 2 d, m).
    """
    count, stages, size, width = of_velocities.shape
    matrix = np.empty((stages * size, stages * size))
    rates = np.empty((stages * size, width))
    for n in range(count):
        h = lengths[n]
        for i in range(stages):
            for r in range(size):
                row = i * size + r
                for k in range(stages):
                    twice = 0.0
                    for j in range(stages):
                        twice += weights[i, j] * pace[n, j] * weights[j, k]
                    for c in range(size):
                        matrix[row, k * size + c] = -h * (
                            weights[i, k] * derivatives[n, i, r, size + c]
                            + h * twice * derivatives[n, i, r, c]
                        )
                matrix[row, row] += 1.0
                paced = 0.0
                for j in range(stages):
                    paced += h * weights[i, j] * pace[n, j]
                for m in range(width):
                    rates[row, m] = of_velocities[n, i, r, m]
                for c in range(size):
                    by_x = derivatives[n, i, r, c]
                    by_v = derivatives[n, i, r, size + c] + by_x * paced
                    for m in range(width):
                        rates[row, m] += by_x * state[c, m] + by_v * state[size + c, m]
                    for j in range(stages):
                        factor = by_x * h * weights[i, j]
                        for m in range(width):
                            rates[row, m] += factor * of_positions[n, j, c, m]
        _solve(matrix, rates)
        for point in range(stages + 1):
            for c in range(size):
                for m in range(width):
                    found[n, point, size + c, m] = state[size + c, m]
                for j in range(stages):
                    factor = h * weights[point, j]
                    for m in range(width):
                        found[n, point, size + c, m] += factor * rates[j * size + c, m]
        for point in range(stages + 1):
            for c in range(size):
                for m in range(width):
                    found[n, point, c, m] = state[c, m]
                for j in range(stages):
                    factor = h * weights[point, j]
                    for m in range(width):
                        found[n, point, c, m] += factor * (
                            pace[n, j] * found[n, j, size + c, m] + of_positions[n, j, c, m]
                        )
        state = found[n, stages]


class Evaluation(NamedTuple):
    """Equations of motion along an orbit, with d positions."""

    velocities: np.ndarray  # (n, d) derivatives of the positions by the crank angle
    rates: np.ndarray  # (n, d) derivatives of the velocities by the crank angle
    channels: np.ndarray  # (n, c)

    def minus(self, other: "Evaluation") -> "Evaluation":
        return Evaluation(*(a - b for a, b in zip(self, other, strict=True)))


class LinearMotion:
    """The equations of motion and `channels` (names of quantities), linearised along an orbit."""

    def __init__(self, orbit: Orbit, channels: Sequence[str]):
        self.orbit, self._channels = orbit, channels
        times = crank_times(orbit.model.p, orbit.angles)
        self._base, speeds = self._evaluated(orbit.model, orbit.motion, times)
        by_states = []
        half = orbit.model.positions
        for place in range(2 * half):
            step = _POSITION_STEP if place < half else _VELOCITY_STEP
            shifted = orbit.motion.states.copy()
            shifted[:, place] += step
            found, _ = self._evaluated(orbit.model, orbit.motion._replace(states=shifted), times)
            change = found.minus(self._base)
            by_states.append((change.rates / step, change.channels / step))
        self._rates_by_states, self._channels_by_states = (
            np.stack(columns, axis=-1) for columns in zip(*by_states, strict=True)
        )
        self._pace = (1.0 / speeds).reshape(-1, STAGES)

    @property
    def channels(self) -> np.ndarray:
        """The channels (n, c) of the orbit."""
        return self._base.channels

    def _evaluated(
        self, model: Model, motion: Samples, times: np.ndarray
    ) -> tuple[Evaluation, np.ndarray]:
        """The equations of motion of a model at the states of a motion, and the crank's speed."""
        motion = motion._replace(times=times)
        columns, accelerations = evaluated(model, motion)
        pace = 1.0 / columns["crank_speed"][:, None]
        half = model.positions
        channels = np.stack([columns[name] for name in self._channels], axis=1)
        velocities = pace * motion.states[:, half : 2 * half]
        return Evaluation(velocities, pace * accelerations, channels), columns["crank_speed"]

    def forcing(self, model: Model) -> Evaluation | None:
        """Change by other parameters at the states of the orbit; None if it is not periodic, or
        with other loose joints."""
        known = self.orbit.model
        if not _has_vectors_only(model) or model.loose != known.loose:
            return None
        motion, angles = self.orbit.motion, self.orbit.angles
        found, _ = self._evaluated(model, motion, crank_times(model.p, angles))
        checked = slice(None, None, _CHECKED)
        times = crank_times(model.p, angles[checked] + tau)
        later, _ = self._evaluated(model, motion.part(checked), times)
        change = found.minus(self._base)
        for there, here, added in zip(later, found, change, strict=True):
            allowed = _PERIODIC * np.abs(added).max(axis=0) + _ROUNDING * np.abs(here).max(axis=0)
            if not (np.abs(there - here[checked]).max(axis=0) <= allowed).all():
                return None  # also where a number is not finite
        return change

    def changes(self, forcing: Sequence[Evaluation]) -> np.ndarray | None:
        """Periodic changes (m, n, c) of the channels by m results of `forcing`; None if
        disturbances do not decay within some revolutions."""
        if not forcing:
            return np.empty((0, *self.channels.shape))
        lengths = np.diff(self.orbit.edges)
        count, size, width = lengths.size, self._base.rates.shape[1], len(forcing)
        unforced = np.zeros((2 * size, *self._base.rates.shape))
        of_positions, of_velocities = (
            np.stack([*unforced, *(change[k] for change in forcing)], axis=-1).reshape(
                count, STAGES, size, -1
            )
            for k in range(2)
        )
        start = np.hstack([np.eye(2 * size), np.zeros((2 * size, width))])
        found = np.empty((count, STAGES + 1, *start.shape))
        collocated(
            lengths,
            gauss_collocation(STAGES)[1],
            self._pace,
            self._rates_by_states.reshape(count, STAGES, size, 2 * size),
            of_positions,
            of_velocities,
            start,
            found,
        )
        over_revolution, particular = np.split(found[-1, -1], [2 * size], axis=1)
        if not np.isfinite(over_revolution).all():
            return None
        multipliers = np.abs(np.linalg.eigvals(over_revolution))
        if not (multipliers < _LARGEST_MULTIPLIER).all():
            return None
        start = np.linalg.solve(np.eye(2 * size) - over_revolution, particular)
        by_states = self._channels_by_states.reshape(count, STAGES, -1, 2 * size)
        response = (by_states @ found[:, :-1]).reshape(*self.channels.shape, -1)
        periodic = response[..., 2 * size :] + response[..., : 2 * size] @ start
        direct = np.stack([change.channels for change in forcing], axis=-1)
        return (direct + periodic).transpose(2, 0, 1)
