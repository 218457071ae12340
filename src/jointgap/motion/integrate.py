"""Integration from event to event."""

import math
from typing import NamedTuple

import numpy as np

from jointgap.contact.joints import FLIGHT, direction, turns_after
from jointgap.core.numba_cache import compiled, inlined
from jointgap.motion.advance import advance
from jointgap.motion.events import switched
from jointgap.motion.rates import evaluate
from jointgap.motion.runge_kutta import (
    AFTER,
    BEFORE,
    COUNT,
    LINEAR,
    NODES,
    STAGES,
    dt_ds,
    elapsed_time,
    prepare_inside,
    state_inside,
)
from jointgap.motion.workspace import CONDITIONS, EPISODE, HERE

EVENT = (
    "time",
    "joint",
    "begins",
    "approach_speed",
    "impulse",
    "peak_force",
    "maxima",
    "crank_angle",
    "duration",
)
"""Columns of the events; the quantities of an episode belong to its end."""

EVENT_WIDTH = len(EVENT)

TAKEN = ("end", "time_map", "origin", "breaks")
"""Columns of the accepted steps: crank angle of the end [rad]; `LINEAR`, or `AFTER` or `BEFORE` an
event at the crank angle `origin`; whether the equations of motion change at the end."""

TAKEN_WIDTH = len(TAKEN)

EVENT_NAMES = np.array(["separation", "impact"], dtype=object)

MODES = ("ideal", "flight", "impact", "contact")
"""Modes of samples, by joint."""


class Samples(NamedTuple):
    """Samples and events of one integration; n samples, c contacts, d loose revolute joints."""

    times: np.ndarray  # (n,) [s]
    states: np.ndarray  # (n, states)
    modes: np.ndarray  # (n, c)
    approaches: np.ndarray  # (n, c) [m/s]
    begins: np.ndarray  # (n, c) [s]
    directions: np.ndarray  # (n, d) [rad] Of clearance vectors
    events: np.ndarray  # (e, EVENT_WIDTH)
    steps: int

    def part(self, chosen: slice | np.ndarray) -> "Samples":
        """The `chosen` samples only, with all events; with gaps in memory, code would be compiled
        anew."""
        return Samples(*(np.ascontiguousarray(each[chosen]) for each in self[:-2]), *self[-2:])


def room_for(times: np.ndarray, states: int, contacts: int, pins: int) -> Samples:
    """Samples at `times` (n,) [s], to be filled."""
    n = times.size
    numbers = (np.empty((n, each)) for each in (contacts, contacts, pins))
    return Samples(
        times,
        np.empty((n, states)),
        np.empty((n, contacts), np.int64),
        *numbers,
        np.empty((0, EVENT_WIDTH)),
        0,
    )


def mode_numbers(found: Samples, contact: int) -> np.ndarray:
    """Modes (n,) of a contact at samples, as indices in `MODES`: a contact with at most one
    maximum of its penetration is an impact."""
    column = {name: i for i, name in enumerate(EVENT)}
    events = found.events
    ends = events[(events[:, column["joint"]] == contact) & (events[:, column["begins"]] == 0)]
    following = np.searchsorted(ends[:, column["time"]], found.times)  # the next separation, if any
    maxima = np.append(ends[:, column["maxima"]], np.inf)[following]
    return np.where(found.modes[:, contact] != FLIGHT, np.where(maxima <= 1, 2, 3), 1)


DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, NOT_FINITE, STALLED = range(5)

_LONGEST_TURN = (
    0.1  # [rad] of crank angle per step: a clearance vector leaves its circle at most once in it
)
_AFTER_IMPACT = (
    0.1  # share of the tolerance there: errors of velocities persist through the following flight
)
_FAR = 20.0  # steps after an impact beyond which its branch point is negligible


@compiled
def contact_duration(joint, mass, speed):
    """Approximate duration [s] of an elastic impact of `mass` at `speed`."""
    n = joint.exponent
    return 3.0 * ((n + 1.0) * mass / (2.0 * joint.stiffness) * speed ** (1.0 - n)) ** (
        1.0 / (n + 1.0)
    )


@inlined
def next_knot(joint, begin, time, resolution) -> float:
    """Next time [s] at which the memory of a contact begins or ends to fade, or infinity."""
    knot = begin + joint.memory_time
    if knot > time + resolution:
        return knot
    knot += joint.fading_time
    return knot if knot > time + resolution else math.inf


@compiled
def time_at_angle(p, k, row, time_map, s, ds, angle, smooth):
    """Time [s] within a step at which a free crank passes `angle` [rad], by Newton's method."""
    low, high = k.time[HERE], k.time[row]
    time = low + (angle - k.angle[HERE]) / (k.angle[row] - k.angle[HERE]) * (high - low)
    for _ in range(50):
        state_inside(p, k, time_map, s, ds, time, smooth)
        reached, speed = k.z[2 * k.loose], k.z[k.half + 2 * k.loose]
        following = time - (reached - angle) / speed
        if reached < angle:
            low = time
        else:
            high = time
        if abs(following - time) <= 1e-15 * (k.time[row] - k.time[HERE]) + 4e-16 * abs(time):
            break
        time = following if low <= following <= high else 0.5 * (low + high)
    return time


@compiled
def _begin_episode(episodes, joint, time):
    """Start a contact at `time` [s]."""
    for i in range(3):
        episodes[joint, i] = 0.0
    episodes[joint, 3] = time


@inlined
def _follow(k, time) -> None:
    """Count the turns of the clearance vectors up to the state z."""
    h = k.half
    for j in range(k.pins):
        seen = (k.seen[j, 0], k.seen[j, 1], k.seen[j, 2], k.seen[j, 3])
        now = (k.z[2 * j], k.z[2 * j + 1], k.z[h + 2 * j], k.z[h + 2 * j + 1])
        k.turns[j] = turns_after(k.turns[j], seen, now, time - k.seen_time)
        for i in range(4):
            k.seen[j, i] = now[i]
    k.seen_time = time


@inlined
def _update_episodes(k, row, time_map, s, ds) -> None:
    """Update the episodes over an accepted step whose stages are in `k`."""
    if ds == 0.0:
        return
    for j in range(k.contacts):
        if k.modes[j] == FLIGHT:
            continue
        impulse, peak = 0.0, k.episodes[j, 1]
        for stage in range(COUNT):
            normal = max(k.normals[j, stage], 0.0)
            impulse += STAGES[COUNT, stage] * dt_ds(time_map, s + NODES[stage] * ds) * normal
            peak = max(peak, normal)
        k.episodes[j, 0] += ds * impulse
        k.episodes[j, 1] = peak
        if k.conditions[HERE, j, 1] > 0.0 >= k.conditions[row, j, 1]:
            k.episodes[j, 2] += 1.0


@inlined
def _record_event(event, k, j, begins, approach) -> None:
    """Write a row of events: see `EVENT`."""
    event[0], event[1], event[2] = k.time[HERE], j, 1.0 if begins else 0.0
    event[3] = approach if begins else math.nan
    for i in range(3):
        event[4 + i] = math.nan if begins else k.episodes[j, i]
    event[7] = k.angle[HERE]
    event[8] = math.nan if begins else k.time[HERE] - k.episodes[j, 3]


@inlined
def _take(k, row) -> None:
    """Let the next step start at a row."""
    k.time[HERE], k.angle[HERE] = k.time[row], k.angle[row]
    k.cosine[HERE], k.sine[HERE] = k.cosine[row], k.sine[row]
    for i in range(k.states):
        k.y[HERE, i], k.dy[HERE, i] = k.y[row, i], k.dy[row, i]
    for i in range(2 * k.rubbing + k.pushed):
        k.settled[HERE, i] = k.settled[row, i]
    for j in range(k.contacts):
        k.normal[HERE, j] = k.normal[row, j]
        for i in range(CONDITIONS):
            k.conditions[HERE, j, i] = k.conditions[row, j, i]


@inlined
def longest_step(p, k) -> float:
    """[s] From the state in the first row."""
    fastest = abs(p.drive.speed)
    if k.is_free:
        fastest = max(fastest, k.y[HERE, k.half + 2 * k.loose])
        if p.drive.stall_torque > 0.0:
            fastest = max(fastest, p.drive.no_load_speed)
    return _LONGEST_TURN / fastest


@compiled
def begin(p, k, share):
    """Prepare an integration from the state, time and modes in the first row of `k`, with a first
    step of a `share` of the longest one."""
    for i in range(2 * k.rubbing + k.pushed):
        k.settled[HERE, i] = 0.0
    evaluate(p, k, HERE)
    for j in range(k.contacts):
        for i in range(EPISODE):
            k.episodes[j, i] = 0.0
    for j in range(k.pins):
        k.turns[j] = 0.0
        x, v = 2 * j, k.half + 2 * j
        k.seen[j, 0], k.seen[j, 1] = k.z[x], k.z[x + 1]
        k.seen[j, 2], k.seen[j, 3] = k.z[v], k.z[v + 1]
    k.seen_time = k.time[HERE]
    k.proposal, k.time_map, k.s = share * longest_step(p, k), LINEAR, 0.0


@inlined
def _keep_episodes(source, target) -> None:
    for j in range(len(source)):
        for i in range(EPISODE):
            target[j, i] = source[j, i]


@inlined
def _leave(k, proposal, time_map, s) -> None:
    k.proposal, k.time_map, k.s = proposal, time_map, s


@compiled
def integrate(p, k, found, angles, tolerance, step_limit):
    """Continue the integration in `k` to the last of the crank `angles` (n,) [rad], with samples in
    the arrays of `found`.

    Afterwards `k` is at the start of the last step, for an exact continuation. Returns status,
    events, number of steps, and the accepted ones if `k` records them.
    """
    events, event_count, steps, sample = np.empty((64, EVENT_WIDTH)), 0, 0, 0
    taken, taken_count = np.empty((64 if k.records else 0, TAKEN_WIDTH)), 0
    proposal, time_map, s = k.proposal, k.time_map, k.s
    times, states = found.times, found.states
    while True:
        if steps >= step_limit:
            return TOO_MANY_STEPS, events[:event_count], steps, taken[:taken_count]
        longest = longest_step(p, k)
        proposal = unhindered = min(proposal, longest)
        resolution = 1e-15 * (abs(k.time[HERE]) + longest)
        for j in range(k.contacts):
            knot = next_knot(k.joints[j], k.begins[j], k.time[HERE], resolution)
            proposal = min(proposal, knot - k.time[HERE])
        if time_map == AFTER and s * s > _FAR * proposal:
            time_map, s = LINEAR, 0.0
        allowed = tolerance * (_AFTER_IMPACT if time_map == AFTER else 1.0)
        happens, contact, kind, step_map, start, ds, error, made, row = advance(
            p, k, time_map, s, proposal, allowed
        )
        steps += made
        factor = 5.0
        if error > 0.0:
            factor = min(5.0, max(0.2, 0.9 * math.sqrt(math.sqrt(math.sqrt(allowed / error)))))
        if not error <= allowed:
            factor = min(factor, 0.9) if error < math.inf else 0.1
            proposal = (
                0.5 * elapsed_time(step_map, start, ds)
                if step_map == BEFORE
                else elapsed_time(step_map, start, ds * factor)
            )
            if not proposal >= resolution:
                status = STEP_TOO_SMALL if error < math.inf else NOT_FINITE
                return status, events[:event_count], steps, taken[:taken_count]
            continue
        if k.is_free and k.y[row, k.half + 2 * k.loose] <= 0.0:
            if row != HERE:
                _take(k, row)
            return STALLED, events[:event_count], steps, taken[:taken_count]
        is_last = angles[-1] <= k.angle[row] if k.is_free else times[-1] <= k.time[row]
        if is_last:
            _keep_episodes(k.episodes, k.earlier)
        _update_episodes(k, row, step_map, start, ds)
        if k.records and row != HERE:
            if taken_count == taken.shape[0]:
                taken = np.concatenate((taken, np.empty_like(taken)))
            taken[taken_count, 0], taken[taken_count, 1] = k.angle[row], step_map
            taken[taken_count, 2] = k.angle[row] if step_map == BEFORE else k.origin
            taken[taken_count, 3] = 1.0 if happens or proposal < unhindered else 0.0
            taken_count += 1
        elif happens and taken_count > 0:
            taken[taken_count - 1, 3] = 1.0

        prepared = smooth = False
        while sample < times.size:
            if (angles[sample] > k.angle[row]) if k.is_free else (times[sample] > k.time[row]):
                break
            inside = row != HERE and (k.is_free or times[sample] < k.time[row])
            if inside and not prepared:
                smooth = prepare_inside(p, k, row, step_map, start, ds, tolerance)
                prepared = True
            if k.is_free and row != HERE:
                times[sample] = time_at_angle(
                    p, k, row, step_map, start, ds, angles[sample], smooth
                )
            elif k.is_free:
                times[sample] = k.time[HERE]
            if inside:
                state_inside(p, k, step_map, start, ds, times[sample], smooth)
            else:
                for i in range(k.states):
                    k.z[i] = k.y[row, i]
            _follow(k, times[sample])
            for i in range(k.states):
                states[sample, i] = k.z[i]
            for j in range(k.pins):
                vector = (k.z[2 * j], k.z[2 * j + 1])
                found.directions[sample, j] = direction(k.turns[j], vector)
            for j in range(k.contacts):
                found.modes[sample, j] = k.modes[j]
                found.approaches[sample, j] = k.approaches[j]
                found.begins[sample, j] = k.begins[j]
            sample += 1
        if sample == times.size:
            # this step is repeated by a continuation: its remaining part may contain samples
            _keep_episodes(k.earlier, k.episodes)
            _leave(k, unhindered, time_map, s)
            return DONE, events[:event_count], steps, taken[:taken_count]
        before_time = k.time[HERE]
        if row != HERE:
            for i in range(k.states):
                k.z[i] = k.y[row, i]
            _follow(k, k.time[row])
            _take(k, row)
        if time_map == AFTER:
            s = math.sqrt(s * s + k.time[HERE] - before_time)
        if not happens:
            following = elapsed_time(step_map, start + ds, ds * factor)
            if step_map == AFTER:
                # between equal steps in s (suitable near the impact) and in time (far from it)
                following = math.sqrt(following * factor * elapsed_time(step_map, start, ds))
            proposal = max(following, unhindered) if proposal < unhindered else following
            continue

        # the event: the contact's mode changes
        before = k.modes[contact]
        closing = max(-k.conditions[HERE, contact, 1], 0.0)
        mode, approach = switched(
            before, k.approaches[contact], kind, closing, k.joints[contact].least_approach
        )
        k.modes[contact], k.approaches[contact] = mode, approach
        if before == FLIGHT or mode == FLIGHT:
            if event_count == events.shape[0]:
                events = np.concatenate((events, np.empty_like(events)))
            _record_event(events[event_count], k, contact, before == FLIGHT, closing)
            event_count += 1
        if before == FLIGHT:
            _begin_episode(k.episodes, contact, k.time[HERE])
            k.begins[contact] = k.time[HERE]
            time_map, s, k.origin = AFTER, 0.0, k.angle[HERE]
            impact = contact_duration(k.joints[contact], k.masses[contact], approach)
            proposal = min(proposal, 0.1 * impact)
        elif mode == FLIGHT:
            k.begins[contact] = math.inf
            if k.bristles:  # bristles without contact are straight
                k.y[HERE, 2 * k.half + contact] = 0.0
            flying = True
            for j in range(k.contacts):
                flying = flying and k.modes[j] == FLIGHT
            if flying:
                time_map, s, proposal = LINEAR, 0.0, max(proposal, 0.2 * longest)
        evaluate(p, k, HERE)
