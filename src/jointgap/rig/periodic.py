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

from jointgap.core.joints import JOINTS
from jointgap.dynamics.drive import crank_times
from jointgap.dynamics.equations import STATES
from jointgap.dynamics.integrate import Progress
from jointgap.dynamics.joints import FLIGHT
from jointgap.dynamics.numba_cache import compiled
from jointgap.dynamics.parameters import MOTOR, Parameters
from jointgap.dynamics.runge_kutta import instant
from jointgap.dynamics.sampling import SAMPLE, fill_samples
from jointgap.dynamics.simulation import IntegrationResult, integrate_on

INTERVALS, STAGES = 1500, 3
"""Intervals of a revolution, and Gauss points in each."""

COARSE_ANGLES = 720
"""Angles per revolution that show where sliding reverses."""

_EVEN_SHARE = 0.5  # [1] Share of the intervals that is evenly distributed
_SUBDIVISION = 50  # Parts of a coarse interval in which a reversal is found
_LARGEST_MULTIPLIER = 0.5  # [1] Above, a disturbance lasts for more than some revolutions
_PERIODIC = 1e-6  # [1, of the largest rate] Difference of the rates after a revolution
_CHECKED = 40  # Every such point is compared with the next revolution
_POSITION_STEP, _VELOCITY_STEP = 1e-11, 1e-7  # [m], [m/s] Differences by the states
_LONG_AGO = -1e6  # [s] Begin of a contact whose impact has no effect any more

# Places of positions and velocities among the states and auxiliary states: clearance vectors by
# joint, and a rod's deflection
_VECTORS = (
    ((0, 1), (4, 5)),
    ((2, 3), (6, 7)),
    ((STATES, STATES + 1), (STATES + 4, STATES + 5)),
)
_BENDING = ((STATES + 3,), (STATES + 7,))


class Contacts(NamedTuple):
    """State of the joints' contacts; see `jointgap.dynamics.runge_kutta.Instant`."""

    modes: tuple
    approaches: tuple
    begins: tuple


@compiled
def _rates(p, time, z, contacts, velocities, rates):
    """Time [s] per crank angle [rad]; the derivatives of the states `velocities` with respect to
    the crank angle are written to `rates`."""
    y = (z[0], z[1], z[2], z[3], z[4], z[5], z[6], z[7])
    x = (z[8], z[9], z[10], z[11], z[12], z[13], z[14], z[15], z[16], z[17], z[18])
    here = instant(p, time, y, x, contacts.modes, contacts.approaches, contacts.begins)
    pace = 1.0 / here.crank.speed
    for i in range(velocities.size):
        place = velocities[i]
        if place < STATES:
            rates[i] = here.clearance_rates[place] * pace
        else:
            rates[i] = here.auxiliary_rates[place - STATES] * pace
    return pace


@compiled
def rates_along(p, times, states, contacts, velocities):
    """Time (n,) [s] per crank angle [rad], and derivatives (n, d) of the states `velocities` with
    respect to the crank angle, at `states` (n, 19)."""
    pace, rates = np.empty(times.size), np.empty((times.size, velocities.size))
    for n in range(times.size):
        pace[n] = _rates(p, times[n], states[n], contacts, velocities, rates[n])
    return pace, rates


@compiled
def state_derivatives(p, times, states, contacts, velocities, varied, steps):
    """Derivatives (n, d, q) of the rates of `rates_along` with respect to the states `varied`, by
    differences over `steps` (q,)."""
    size, count = velocities.size, varied.size
    found = np.empty((times.size, size, count))
    base, shifted, z = np.empty(size), np.empty(size), np.empty(states.shape[1])
    for n in range(times.size):
        z[:] = states[n]
        _rates(p, times[n], z, contacts, velocities, base)
        for j in range(count):
            place = varied[j]
            z[place] += steps[j]
            _rates(p, times[n], z, contacts, velocities, shifted)
            z[place] = states[n, place]
            for i in range(size):
                found[n, i, j] = (shifted[i] - base[i]) / steps[j]
    return found


class VaryingStates(NamedTuple):
    """Places of the states that vary, d positions [m] and their rates [m/s], among the 19 states
    and auxiliary states."""

    positions: np.ndarray
    velocities: np.ndarray

    @property
    def all(self) -> np.ndarray:
        return np.concatenate(self)


def varying_states(p: Parameters) -> VaryingStates | None:
    """Clearance vectors of loose joints and a rod's deflection; None with bristles or a motor,
    which have further states."""
    if p.switches.bristles or p.drive.kind == MOTOR:
        return None
    pairs = [pair for name, pair in zip(JOINTS, _VECTORS, strict=True) if getattr(p, name).loose]
    if p.bodies.rod_angular_frequency:
        pairs.append(_BENDING)
    return VaryingStates(
        *(np.array([i for pair in pairs for i in pair[k]], np.int64) for k in range(2))
    )


class Orbit(NamedTuple):
    """One revolution of a periodic motion, divided into intervals.

    The points are the Gauss points and the end of each interval.
    """

    p: Parameters
    edges: np.ndarray  # (k + 1,) crank angles [rad] of the intervals' ends
    points: np.ndarray  # (k, STAGES + 1) crank angles [rad] of the points
    motion: IntegrationResult  # at the points
    contacts: Contacts


def _contacts(p: Parameters, motion: IntegrationResult) -> Contacts | None:
    """The contacts of a motion in which none begins or ends and none remembers its begin; else
    None."""
    modes = motion.modes
    if motion.events.size or (modes != modes[0]).any():
        return None
    begins = []
    for number, name in enumerate(JOINTS):
        joint, begin = getattr(p, name), motion.begins[-1, number]
        touching = joint.loose and modes[0, number] != FLIGHT
        faded = motion.times[0] - begin > joint.memory_time + joint.fading_time
        if touching and not faded and joint.damping > 0.0:
            return None
        begins.append(_LONG_AGO if touching else begin)
    return Contacts(
        tuple(np.int64(mode) for mode in modes[0]),
        tuple(float(speed) for speed in motion.approaches[-1]),
        tuple(map(float, begins)),
    )


def _joined(motion: IntegrationResult) -> np.ndarray:
    """States and auxiliary states (n, 19)."""
    return np.hstack([motion.states, motion.auxiliary_states])


def _slips(p: Parameters, observed: dict[str, np.ndarray]) -> list[np.ndarray]:
    """Sliding speeds (n,) over the speed of their regularisation [1]: of the loose joints and of
    the slider."""
    turning = {
        "crank_pin": ("2", "rod_angular_velocity", "crank_speed"),
        "piston_pin": ("3", "rod_angular_velocity", None),
        "crank_pivot": ("1", "crank_speed", None),
    }
    slips = [observed["slider_velocity"] / p.effects.slider_sign_speed]
    for name, (number, body, partner) in turning.items():
        joint = getattr(p, name)
        if joint.loose:
            swing = observed[f"r{number}"] * observed[f"gamma{number}_dot"]
            rotation = joint.body_radius * observed[body]
            if partner:
                rotation = rotation - joint.partner_radius * observed[partner]
            slips.append((swing + joint.side * rotation) / joint.friction_speed)
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
    p: Parameters,
    progress: Progress,
    coarse: IntegrationResult,
    begin: float,
    tolerance: float,
    count: int = INTERVALS,
) -> Orbit | None:
    """The revolution from the crank angle `begin` [rad]; None if a contact begins or ends in it.

    `coarse` is the periodic motion at `coarse_angles` of the revolution before, `progress` its end.
    """
    if varying_states(p) is None or _contacts(p, coarse) is None:
        return None
    edges = _edges(_slips(p, coarse.observed(p)), begin, count)
    nodes, _ = gauss_collocation(STAGES)
    points = edges[:-1, None] + np.diff(edges)[:, None] * np.append(nodes, 1.0)
    points[:, -1] = edges[1:]
    motion, _ = integrate_on(p, progress, points.ravel(), tolerance)
    if (contacts := _contacts(p, motion)) is None:
        return None
    return Orbit(p, edges, points, motion, contacts)


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


class LinearMotion:
    """Equations of motion linearised along an orbit."""

    def __init__(self, orbit: Orbit):
        self.orbit = orbit
        p, self._varying = orbit.p, varying_states(orbit.p)
        inner = np.arange(orbit.points.size) % (STAGES + 1) < STAGES
        self._angles = orbit.points[:, :-1].ravel()
        self._states = _joined(orbit.motion.part(inner))
        times, contacts, varying = crank_times(p, self._angles), orbit.contacts, self._varying
        self._pace, self._rates = rates_along(p, times, self._states, contacts, varying.velocities)
        steps = np.repeat([_POSITION_STEP, _VELOCITY_STEP], varying.positions.size)
        self._derivatives = state_derivatives(
            p, times, self._states, contacts, varying.velocities, varying.all, steps
        )

    def forcing(self, p: Parameters) -> np.ndarray | None:
        """Change (2, n, d) by other parameters of the derivatives of positions and velocities with
        respect to the crank angle; None if they are not periodic, or if other states vary."""
        varying, contacts = varying_states(p), self.orbit.contacts
        if varying is None or not np.array_equal(varying.all, self._varying.all):
            return None
        times = crank_times(p, self._angles)
        pace, rates = rates_along(p, times, self._states, contacts, varying.velocities)
        checked = slice(None, None, _CHECKED)
        later = crank_times(p, self._angles[checked] + tau)
        _, repeated = rates_along(p, later, self._states[checked], contacts, varying.velocities)
        difference = np.abs(repeated - rates[checked]).max(axis=0, initial=0.0)
        if not (difference <= _PERIODIC * np.abs(rates).max(axis=0, initial=0.0)).all():
            return None
        changed_pace = (pace - self._pace)[:, None] * self._states[:, varying.velocities]
        return np.stack([changed_pace, rates - self._rates])

    def changes(self, forcing: Sequence[np.ndarray]) -> np.ndarray | None:
        """Periodic changes (m, n, 2 d) of the varying states at the orbit's points, by m results of
        `forcing`; None if disturbances do not decay within some revolutions."""
        lengths = np.diff(self.orbit.edges)
        count, size, width = lengths.size, self._varying.positions.size, len(forcing)
        shape = 2, count, STAGES, size, 2 * size + width
        forced = np.zeros(shape)
        forced[..., 2 * size :] = np.stack(forcing, axis=-1).reshape(*shape[:-1], width)
        start = np.hstack([np.eye(2 * size), np.zeros((2 * size, width))])
        found = np.empty((count, STAGES + 1, *start.shape))
        derivatives = self._derivatives.reshape(count, STAGES, size, 2 * size)
        weights, pace = gauss_collocation(STAGES)[1], self._pace.reshape(count, STAGES)
        collocated(lengths, weights, pace, derivatives, *forced, start, found)
        over_revolution, particular = np.split(found[-1, -1], [2 * size], axis=1)
        multipliers = np.abs(np.linalg.eigvals(over_revolution))
        if not (multipliers < _LARGEST_MULTIPLIER).all():
            return None
        start = np.linalg.solve(np.eye(2 * size) - over_revolution, particular)
        solutions = found.reshape(-1, 2 * size + width)
        periodic = solutions[:, 2 * size :] + solutions[:, : 2 * size] @ start
        return periodic.reshape(-1, 2 * size, width).transpose(2, 0, 1)

    def observed(self, p: Parameters, change: np.ndarray | float = 0.0) -> np.ndarray:
        """All quantities at the orbit's points, as records of `SAMPLE` (n,), with the parameters
        `p` and a `change` (n, 2 d) of the varying states."""
        orbit = self.orbit
        states = _joined(orbit.motion)
        states[:, self._varying.all] += change
        motion = orbit.motion._replace(
            times=crank_times(p, orbit.points.ravel()),
            states=np.ascontiguousarray(states[:, :STATES]),
            auxiliary_states=np.ascontiguousarray(states[:, STATES:]),
            begins=np.tile(orbit.contacts.begins, (states.shape[0], 1)),
        )
        samples = np.empty(states.shape[0], SAMPLE)
        fill_samples(p, motion, samples)
        return samples
