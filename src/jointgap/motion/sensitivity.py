"""Derivatives of a simulated motion by its parameters, through impacts and separations."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from jointgap.contact.joints import CONTACT
from jointgap.core.records import Record
from jointgap.linkage.drive import crank_times
from jointgap.motion.integrate import EVENT, Samples
from jointgap.motion.model import Columns, Model, Workspace, beginning
from jointgap.motion.simulation import evaluated, integrate_on
from jointgap.motion.variation import (
    STAGES,
    Intervals,
    Linear,
    Solution,
    along,
    at_angles,
    chained,
    depths_of,
    derivatives_by_states,
    differences,
    intervals_of,
    linear_motion,
    rates_over_angle,
    refined,
    slips_of,
    weights_of,
)
from jointgap.motion.workspace import CORNERS

_CONTACT, _BEGINS, _ANGLE = map(EVENT.index, ("joint", "begins", "crank_angle"))
_MOMENT = 1e-8  # [s] Of differences of a gap over time
_BATCH = 1500  # Steps that are linearised together: some ten megabytes
_TINY = 1e-6  # [1] Share of the changes of states in differences of a gap


class Varied(NamedTuple):
    """A model and its start (states,) with a parameter increased by a step."""

    model: Model
    start: np.ndarray
    step: float


def derivatives(
    model: Model,
    start: np.ndarray,
    angles: np.ndarray,
    tolerance: float,
    varied: Sequence[Varied],
    see: Callable[[Model, Samples], Columns],
) -> list[Columns]:
    """Derivatives (n,) by each parameter, at crank angles (n,) [rad], the first being the start
    angle, of the quantities that `see` returns of a model and a motion."""
    workspace = beginning(model, start, crank_times(model.p, angles[:1])[0])
    motion, end = integrate_on(model, workspace, angles, tolerance, records=True)
    change = np.zeros((angles.size, weights_of(model).size, len(varied)))
    if model.states:
        changed, kept = _changes(
            model, start, workspace, end.taken, motion, angles, tolerance, varied
        )
        change[:, : model.states], change[:, model.states : -1] = changed, kept
    here, found = see(model, motion), []
    for number, one in enumerate(varied):
        there = see(one.model, at_angles(one.model, motion, angles))
        direct = differences(there, here)
        nearby = along(model, motion, change[:, :, number], see)
        found.append({key: direct[key] / one.step + nearby[key] for key in nearby})
    return found


def _changes(
    model: Model,
    start: np.ndarray,
    workspace: Workspace,
    taken: np.ndarray,
    motion: Samples,
    angles: np.ndarray,
    tolerance: float,
    varied: Sequence[Varied],
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the states (n, states, m), and of approach speeds and begins of contacts (n, 2
    contacts, m), at the samples of a `motion` from a `workspace` with the `taken` steps."""
    contacts, width = len(model.contacts), len(varied)
    state = np.stack([(one.start - start) / one.step for one in varied], axis=-1)
    if model.is_free:
        state[2 * len(model.loose)] = 0.0  # the time
    sizes = np.eye(width + 2 * contacts, width)
    changed = np.empty((angles.size, *state.shape))
    kept = np.empty((angles.size, 2 * contacts, width))
    cuts = taken[_BATCH::_BATCH, 0]
    cuts = [angles[0], *cuts[cuts < angles[-1]], angles[-1]]
    for begin, end in pairwise(cuts):
        part = _Part(model, workspace, tolerance, varied)
        linear, later = part.linear_motion(intervals_of(taken, begin, end))
        events = motion.events[
            (motion.events[:, _ANGLE] >= begin) & (motion.events[:, _ANGLE] < end)
        ]
        solution, state, sizes = part.through_events(linear, events, state, sizes)
        rows = (angles >= begin) & (angles <= end)
        place, _ = linear.intervals.find(angles[rows])
        changed[rows], kept[rows] = solution(angles[rows]), solution.forcing[place, width:]
        workspace = later
    return changed, kept


class _Part(NamedTuple):
    """A part of a motion, which starts from a workspace."""

    model: Model
    workspace: Workspace
    tolerance: float
    varied: Sequence[Varied]

    def at(self, angles: np.ndarray) -> tuple[Samples, Workspace]:
        return integrate_on(self.model, self.workspace, angles, self.tolerance)

    def linear_motion(self, intervals: Intervals) -> tuple[Linear, Workspace]:
        """The linearised equations, and the workspace at the end; forcings are the parameters, then
        approach speeds and begins of the contacts."""
        model = self.model
        coarse, _ = self.at(intervals.points().ravel())
        features = (slips_of(model, coarse), depths_of(model, coarse))
        intervals = refined(
            intervals, *(each.reshape(-1, STAGES, each.shape[1]) for each in features)
        )
        points = intervals.points().ravel()
        nodes, later = self.at(points)
        rates, count = rates_over_angle(model, nodes), model.states
        by_states = derivatives_by_states(model, nodes, rates, count + 2 * len(model.contacts))
        forced = [
            (rates_over_angle(one.model, at_angles(one.model, nodes, points)) - rates) / one.step
            for one in self.varied
        ]
        forcing = np.concatenate([np.stack(forced, axis=-1), by_states[:, :, count:]], axis=2)
        by_states, forcing = (
            each.reshape(-1, STAGES, *each.shape[1:]) for each in (by_states[:, :, :count], forcing)
        )
        return linear_motion(intervals, model.positions, by_states, forcing), later

    def through_events(
        self, linear: Linear, events: np.ndarray, state: np.ndarray, sizes: np.ndarray
    ) -> tuple[Solution, np.ndarray, np.ndarray]:
        """The solution from derivatives of the first `state` (N, m) with the `sizes` (c, m) of the
        forcings; both at the end too."""
        model, (count, width) = self.model, state.shape
        contacts, impact = len(model.contacts), 0
        impacts = events[events[:, _BEGINS] == 1.0, _ANGLE]
        if impacts.size:
            memory = _Memory(model, self.at(impacts)[0], impacts, self.varied)
        edges, ends = linear.intervals.angles, linear.over_intervals()
        starts = np.empty((len(ends), count, width))
        forcing = np.empty((len(ends), len(sizes), width))
        done = 0
        for event in events:
            contact, begins = int(event[_CONTACT]), event[_BEGINS] == 1.0
            if not begins and not model.has_bristles:
                continue
            place = int(np.searchsorted(edges[:-1], event[_ANGLE]))
            state = chained(ends[done:place], state, sizes, starts[done:place])
            forcing[done:place], done = sizes, place
            if begins:
                sizes = sizes.copy()
                speed, begin, bristles = memory.after(impact, contact, state)
                sizes[width + contact], sizes[width + contacts + contact] = speed, begin
                impact += 1
            else:
                bristles = 0.0  # without contact they are straight
            if model.has_bristles:
                state[2 * model.positions + contact] = bristles
        state = chained(ends[done:], state, sizes, starts[done:])
        forcing[done:] = sizes
        return Solution(linear, starts, forcing), state, sizes


class _Memory:
    """Derivatives of what contacts keep of their begins: approach speed and time."""

    def __init__(self, model: Model, motion: Samples, angles: np.ndarray, varied: Sequence[Varied]):
        self._model, self._motion, self._varied = model, motion, varied
        columns, self._accelerations = evaluated(model, motion)
        self._speeds = columns["crank_speed"]
        self._later = np.stack(  # (n, m) of the times at these crank angles
            [
                (at_angles(one.model, motion, angles).times - motion.times) / one.step
                for one in varied
            ],
            axis=-1,
        )

    def after(
        self, impact: int, contact: int, states: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives (m,) of approach speed, begin and bristles, from those of the states (N,
        m)."""
        model, motion, pins = self._model, self._motion, len(self._model.pins)
        name, is_pin = model.contacts[contact], contact < pins
        at = 2 * (contact if is_pin else pins + (contact - pins) // CORNERS)
        half, joint = model.positions, model.bearings[name]
        place, rate = motion.states[impact, at : at + 2], motion.states[impact, half + at :][:2]
        second = self._accelerations[impact, at : at + 2]

        def moved(moment: float) -> np.ndarray:
            return _gap(joint, is_pin, place + moment * rate, rate + moment * second)

        _, speed = _gap(joint, is_pin, place, rate)
        _, onward = (moved(_MOMENT) - moved(-_MOMENT)) / (2.0 * _MOMENT)
        by_place, by_rate = states[at : at + 2], states[half + at :][:2]
        size = np.abs(by_place).max(axis=0) + np.abs(by_rate).max(axis=0) * _MOMENT
        share = _TINY * joint.clearance / np.maximum(size, 1e-300)
        ahead, behind = (
            _gap(
                joint,
                is_pin,
                place[:, None] + sign * share * by_place,
                rate[:, None] + sign * share * by_rate,
            )
            for sign in (1.0, -1.0)
        )
        change = (ahead - behind) / (2.0 * share)
        for number, one in enumerate(self._varied):
            there = _gap(one.model.bearings[name], is_pin, place, rate)
            change[:, number] += (there - _gap(joint, is_pin, place, rate)) / one.step
        later = -change[0] / speed
        begin = later + self._later[impact]
        if model.is_free:
            begin += states[2 * len(model.loose)]
        kept = float(-speed > joint.least_approach)
        bristles = np.zeros_like(later)
        if model.has_bristles:  # they bend from the begin on
            row = motion.part(np.array([impact]))
            row.modes[0, contact] = CONTACT
            rate = rates_over_angle(model, row)[0, 2 * half + contact]
            bristles = -rate * self._speeds[impact] * later
        return -kept * (change[1] + onward * later), begin, bristles


def _gap(joint: Record, is_pin: bool, place: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Distance of a contact's surfaces in flight, and its rate (2, ...), from the clearance vector,
    of a corner offset and tilt (2, ...), and its rate."""
    if is_pin:
        clearance = joint.clearance
        square, product = (place**2).sum(axis=0), (place * rate).sum(axis=0)
        return np.array([0.5 * (clearance - square / clearance), -product / clearance])
    (offset, tilt), (offset_rate, tilt_rate) = place, rate
    along_wall = np.cos(tilt) * joint.corner_x - np.sin(tilt) * joint.corner_y
    across = np.sin(tilt) * joint.corner_x + np.cos(tilt) * joint.corner_y
    side = np.sign(joint.corner_y)
    depth = side * (offset + across) - joint.clearance
    return np.array([-depth, -side * (offset_rate + along_wall * tilt_rate)])
