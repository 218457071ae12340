"""Derivatives of a simulated motion by its parameters, through impacts and separations."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from jointgap.contact.joints import FLIGHT
from jointgap.linkage.drive import crank_times
from jointgap.motion.integrate import EVENT, Samples
from jointgap.motion.model import Columns, Model, beginning
from jointgap.motion.rates import evaluate
from jointgap.motion.simulation import integrate_on
from jointgap.motion.variation import (
    STAGES,
    Solution,
    along,
    at_angles,
    chained,
    depths_of,
    derivatives_by_states,
    intervals_of,
    linear_motion,
    rates_over_angle,
    refined,
    shifted,
    slips_of,
    weights_of,
)
from jointgap.motion.workspace import HERE

_TIME, _CONTACT, _BEGINS, _ANGLE = map(EVENT.index, ("time", "joint", "begins", "crank_angle"))
_GAP_STEP = 1e-11  # [m] Of differences at events


class Varied(NamedTuple):
    """A model and its start (states,) with a parameter increased and decreased."""

    ahead: Model
    behind: Model
    ahead_start: np.ndarray
    behind_start: np.ndarray
    width: float  # Difference of the parameter


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
    intervals = intervals_of(end.taken, angles[0], angles[-1])

    def at(points: np.ndarray) -> Samples:
        return integrate_on(model, workspace, points, tolerance)[0]

    coarse = at(intervals.points().ravel())
    features = (slips_of(model, coarse), depths_of(model, coarse))
    intervals = refined(intervals, *(each.reshape(-1, STAGES, each.shape[1]) for each in features))
    points = intervals.points().ravel()
    nodes = at(points)
    count, contacts, width = model.states, len(model.contacts), len(varied)
    by_states = derivatives_by_states(
        model, nodes, rates_over_angle(model, nodes), count + 2 * contacts
    )
    direct = []
    for one in varied:
        ahead, behind = (
            rates_over_angle(each, at_angles(each, nodes, points))
            for each in (one.ahead, one.behind)
        )
        direct.append((ahead - behind) / one.width)
    forcing = np.concatenate([np.stack(direct, axis=-1), by_states[:, :, count:]], axis=2)
    by_states, forcing = (
        each.reshape(-1, STAGES, *each.shape[1:]) for each in (by_states[:, :, :count], forcing)
    )
    linear = linear_motion(intervals, model.positions, by_states, forcing)
    solution = _through_events(model, linear, motion.events, at, varied)
    place, _ = intervals.find(angles)
    change = np.zeros((angles.size, weights_of(model).size, width))
    change[:, :count], change[:, count:-1] = solution(angles), solution.forcing[place, width:]
    found = []
    for number, one in enumerate(varied):
        ahead, behind = (
            see(each, at_angles(each, motion, angles)) for each in (one.ahead, one.behind)
        )
        nearby = along(model, motion, change[:, :, number], see)
        found.append({name: (ahead[name] - behind[name]) / one.width + nearby[name] for name in nearby})
    return found


def _through_events(
    model: Model, linear, events: np.ndarray, at: Callable[[np.ndarray], Samples], varied
) -> Solution:
    """The solution from the derivatives of the start, with the contacts' memory of their begins."""
    count, contacts, width = model.states, len(model.contacts), len(varied)
    edges, ends = linear.intervals.angles, linear.over_intervals()
    inside = (events[:, _ANGLE] > edges[0]) & (events[:, _ANGLE] < edges[-1])
    events = events[inside]
    impacts = events[:, _BEGINS] == 1.0
    motions = at(np.unique(events[:, _ANGLE])) if impacts.any() else None
    state = np.stack([(one.ahead_start - one.behind_start) / one.width for one in varied], axis=-1)
    if model.is_free:
        state[2 * len(model.loose)] = 0.0  # the time of the start
    starts = np.empty((len(ends), count, width))
    forcing = np.zeros((len(ends), width + 2 * contacts, width))
    sizes = np.vstack([np.eye(width), np.zeros((2 * contacts, width))])
    done = 0
    for event in events:
        place = int(np.searchsorted(edges, event[_ANGLE]))
        state = chained(ends[done:place], state, sizes, starts[done:place])
        forcing[done:place], done = sizes, place
        contact, sizes = int(event[_CONTACT]), sizes.copy()
        if event[_BEGINS] == 1.0:
            number = np.searchsorted(motions.times, event[_TIME] * (1.0 - 1e-15))
            row = motions.part(slice(min(number, motions.times.size - 1), None)).part(slice(0, 1))
            change = np.vstack([state, sizes[width:], np.zeros((1, width))])
            speed, begin = _at_impact(model, row, contact, change, varied, event[_ANGLE])
            sizes[width + contact], sizes[width + contacts + contact] = speed, begin
        elif model.has_bristles:  # without contact they are straight
            state[2 * model.positions + contact] = 0.0
    chained(ends[done:], state, sizes, starts[done:])
    forcing[done:] = sizes
    return Solution(linear, starts, forcing)


def _at_impact(
    model: Model, row: Samples, contact: int, change: np.ndarray, varied, angle: float
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (m,) of approach speed and begin of a contact that begins at a crank angle."""
    _, speed, acceleration = _gap(model, row, contact)
    least = model.workspace().k.joints[contact].least_approach
    approaches, begins = np.zeros(len(varied)), np.zeros(len(varied))
    for number, one in enumerate(varied):
        here = change[:, number]
        factor = _GAP_STEP / max(np.abs(here * weights_of(model)).max(), 1e-300)
        ahead, behind = (
            _gap(model, shifted(model, row, sign * factor * here[None]), contact)
            for sign in (1.0, -1.0)
        )
        gap, rate, _ = (ahead - behind) / (2.0 * factor)
        ahead, behind = (
            _gap(each, at_angles(each, row, np.array([angle])), contact)
            for each in (one.ahead, one.behind)
        )
        gap, rate, _ = np.array([gap, rate, 0.0]) + (ahead - behind) / one.width
        later = -gap / speed
        if -speed > least:
            approaches[number] = -(rate + acceleration * later)
        if model.is_free:
            begins[number] = later + here[2 * len(model.loose)]
        else:
            times = [crank_times(each.p, np.array([angle]))[0] for each in (one.ahead, one.behind)]
            begins[number] = later + (times[0] - times[1]) / one.width
    return approaches, begins


def _gap(model: Model, row: Samples, contact: int) -> np.ndarray:
    """Distance (3,) of a contact's surfaces in flight, and its first and second rate."""
    k = model.workspace().k
    k.y[HERE, : model.states], k.time[HERE] = row.states[0], row.times[0]
    for j in range(k.contacts):
        k.modes[j], k.approaches[j] = row.modes[0, j], row.approaches[0, j]
        k.begins[j] = row.begins[0, j]
    k.modes[contact] = FLIGHT
    evaluate(model.p, k, HERE)
    return np.array(k.conditions[HERE, contact, :3])
