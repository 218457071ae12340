"""Periodic motion over the crank angle, and its linearised changes.

A motion that repeats every revolution and in which no contact begins or ends changes with the
parameters by the periodic solution of the linearised equations of motion: see
`jointgap.motion.variation`.
"""

from collections.abc import Sequence
from math import tau
from typing import NamedTuple

import numpy as np

from jointgap.contact.joints import FLIGHT
from jointgap.motion.integrate import Samples
from jointgap.motion.model import Model, Workspace
from jointgap.motion.simulation import integrate_on
from jointgap.motion.variation import (
    STAGES,
    Intervals,
    Solution,
    at_angles,
    chained,
    depths_of,
    derivatives_by_states,
    intervals_of,
    linear_motion,
    rates_over_angle,
    refined,
    slips_of,
)

COMPARED_ANGLES = 120
"""Angles per revolution at which motions are compared: each costs about as much as a step."""

_LARGEST_MULTIPLIER = 0.5  # [1] Above, a disturbance lasts for more than some revolutions
# [1, of the largest change, and of the largest value] Allowed difference after a revolution
_PERIODIC, _ROUNDING = 1e-2, 1e-11
_CHECKED = 40  # Every such point is compared with the next revolution
_LONG_AGO = -1e6  # [s] Begin of a contact whose impact has no effect any more


def _has_vectors_only(model: Model) -> bool:
    """Whether the clearance vectors are the only states, and there are some: no bristles, no
    bending rod, no motor."""
    return 0 < model.states == 4 * len(model.loose)


class Orbit(NamedTuple):
    """One revolution of a periodic motion, divided into intervals."""

    model: Model
    begin: Workspace  # The integration at its begin
    tolerance: float  # [m]
    intervals: Intervals
    angles: np.ndarray  # (n,) crank angles [rad] of their Gauss points
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


def compared_angles(begin: float) -> np.ndarray:
    """Evenly spaced crank angles (n,) [rad] of the revolution after `begin`."""
    return begin + tau * np.arange(1, COMPARED_ANGLES + 1) / COMPARED_ANGLES


def periodic_orbit(
    model: Model, workspace: Workspace, earlier: Samples, begin: float, tolerance: float
) -> Orbit | None:
    """The revolution from the crank angle `begin` [rad]; None if a contact begins or ends in it.

    `earlier` is the periodic motion in the revolution before, `workspace` its end with its steps.
    """
    if not _has_vectors_only(model) or not _lasts(model, earlier):
        return None
    taken = workspace.taken + np.array([tau, 0.0, tau, 0.0])
    intervals = intervals_of(taken, begin, begin + tau)
    coarse, _ = integrate_on(model, workspace, intervals.points().ravel(), tolerance)
    features = (slips_of(model, coarse), depths_of(model, coarse))
    intervals = refined(intervals, *(each.reshape(-1, STAGES, each.shape[1]) for each in features))
    angles = intervals.points().ravel()
    motion, _ = integrate_on(model, workspace, angles, tolerance)
    if not _lasts(model, motion):
        return None
    # the time since their begin has no effect, also with other parameters
    motion = motion._replace(begins=np.where(np.isfinite(motion.begins), _LONG_AGO, np.inf))
    return Orbit(model, workspace, tolerance, intervals, angles, motion)


class LinearMotion:
    """The equations of motion, linearised along an orbit."""

    def __init__(self, orbit: Orbit):
        self.orbit = orbit
        self._rates = rates_over_angle(orbit.model, orbit.motion)
        count = orbit.model.states
        self._by_states = derivatives_by_states(orbit.model, orbit.motion, self._rates, count)

    def forcing(self, model: Model) -> np.ndarray | None:
        """Change (n, states) of the rates by other parameters, at the states of the orbit; None if
        it is not periodic, or with other loose joints."""
        known, motion, angles = self.orbit.model, self.orbit.motion, self.orbit.angles
        if not _has_vectors_only(model) or model.loose != known.loose:
            return None

        def change(part: slice | np.ndarray, turns: float) -> np.ndarray:
            there = at_angles(model, motion.part(part), angles[part] + turns)
            return rates_over_angle(model, there) - self._rates[part]

        found, checked = change(slice(None), 0.0), np.arange(0, angles.size, _CHECKED)
        later = np.abs(change(checked, tau) - found[checked])
        allowed = _PERIODIC * np.abs(found).max(axis=0) + _ROUNDING * np.abs(self._rates).max(
            axis=0
        )
        if not (later.max(axis=0) <= allowed).all():
            return None  # also where a number is not finite
        return found

    def solution(self, forcing: Sequence[np.ndarray]) -> Solution | None:
        """Periodic changes of the states by m results of `forcing`; None if disturbances do not
        decay within some revolutions."""
        model, width = self.orbit.model, len(forcing)
        count = model.states
        by_states, forced = (
            each.reshape(-1, STAGES, *each.shape[1:])
            for each in (self._by_states, np.stack(forcing, axis=-1))
        )
        linear = linear_motion(self.orbit.intervals, model.positions, by_states, forced)
        ends = linear.over_intervals()
        starts = np.empty((len(ends), count, count + width))
        forcing_alone = np.eye(width, count + width, count)
        over = chained(ends, np.eye(count, count + width), forcing_alone, starts)
        over_revolution, particular = over[:, :count], over[:, count:]
        if not np.isfinite(over).all():
            return None
        multipliers = np.abs(np.linalg.eigvals(over_revolution))
        if not (multipliers < _LARGEST_MULTIPLIER).all():
            return None
        periodic = np.linalg.solve(np.eye(count) - over_revolution, particular)
        starts = starts[:, :, :count] @ periodic + starts[:, :, count:]
        return Solution(linear, starts, np.broadcast_to(np.eye(width), (len(ends), width, width)))
