"""Integration from event to event."""

import math
from typing import NamedTuple

import numpy as np

from jointgap.core.joints import JOINTS
from jointgap.dynamics.dense_output import prepare_inside, state_inside
from jointgap.dynamics.equations import AUXILIARY_STATES, STATES
from jointgap.dynamics.events import advance, switched, with_conditions
from jointgap.dynamics.joints import FLIGHT, all_turns, clearances, direction
from jointgap.dynamics.numba_cache import compiled, inlined
from jointgap.dynamics.parameters import MOTOR, Parameters
from jointgap.dynamics.runge_kutta import (
    AFTER,
    BEFORE,
    COUNT,
    LINEAR,
    NODES,
    STAGES,
    Instant,
    dt_ds,
    elapsed_time,
    instant,
    next_knot,
)

EPISODE = 4
"""Quantities of a joint's contact: impulse [N s], largest normal force [N], maxima of the
penetration, begin [s]."""

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

EVENT_NAMES = np.array(["separation", "impact"], dtype=object)

MODES = ("ideal", "flight", "impact", "contact")
"""Modes of samples, by joint."""


@inlined
def update_episodes(episodes, here, motion, there_motion, step_map, step_start, ds, k) -> None:
    """Update the episodes over an accepted step whose stages are in `k`."""
    flying = here.modes[0] == FLIGHT and here.modes[1] == FLIGHT and here.modes[2] == FLIGHT
    if flying or ds == 0.0:
        return
    for joint in range(3):
        if here.modes[joint] == FLIGHT:
            continue
        impulse, peak = 0.0, episodes[joint, 1]
        for stage in range(COUNT):
            normal = max(k.normals[joint, stage], 0.0)
            impulse += (
                STAGES[COUNT, stage] * dt_ds(step_map, step_start + NODES[stage] * ds) * normal
            )
            peak = max(peak, normal)
        episodes[joint, 0] += ds * impulse
        episodes[joint, 1] = peak
        ex, ey, vx, vy, _, _ = motion[joint]
        fx, fy, wx, wy, _, _ = there_motion[joint]
        if ex * vx + ey * vy > 0.0 >= fx * wx + fy * wy:
            episodes[joint, 2] += 1.0


@compiled
def begin_episode(episodes, joint, time):
    """Start a contact at `time` [s]."""
    for i in range(3):
        episodes[joint, i] = 0.0
    episodes[joint, 3] = time


@compiled
def record_event(event, episodes, there, joint, begins, approach):
    """Write a row of events: see `EVENT`."""
    event[0], event[1], event[2], event[7] = (
        there.time,
        joint,
        1.0 if begins else 0.0,
        there.crank_angle,
    )
    event[3] = approach if begins else math.nan
    for i in range(3):
        event[4 + i] = math.nan if begins else episodes[joint, i]
    event[8] = math.nan if begins else there.time - episodes[joint, 3]


def mode_numbers(
    p: Parameters, times: np.ndarray, modes: np.ndarray, events: np.ndarray
) -> np.ndarray:
    """Modes of the joints at samples, as indices in `MODES`, shape (n, 3), int8."""
    found = np.zeros((times.size, 3), np.int8)
    column = {name: i for i, name in enumerate(EVENT)}
    for number, joint in enumerate(JOINTS):
        if not getattr(p, joint).loose:
            continue
        ends = events[(events[:, column["joint"]] == number) & (events[:, column["begins"]] == 0)]
        following = np.searchsorted(ends[:, column["time"]], times)  # the next separation, if any
        maxima = np.append(ends[:, column["maxima"]], np.inf)[following]
        found[:, number] = np.where(modes[:, number] != FLIGHT, np.where(maxima <= 1, 2, 3), 1)
    return found


def sample_modes(
    p: Parameters, times: np.ndarray, modes: np.ndarray, events: np.ndarray
) -> dict[str, np.ndarray]:
    """Columns ``crank_pin_mode``, ... of the table ``trajectory``; parameters as `mode_numbers`."""
    numbers = mode_numbers(p, times, modes, events)
    return {
        f"{joint}_mode": np.array(MODES, dtype=object)[numbers[:, i]]
        for i, joint in enumerate(JOINTS)
    }


DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, NOT_FINITE, STALLED = range(5)

_LONGEST_TURN = (
    0.1  # [rad] of crank angle per step: a clearance vector leaves its circle at most once in it
)
_AFTER_IMPACT = (
    0.1  # share of the tolerance there: errors of velocities persist through the following flight
)
_FAR = 20.0  # steps after an impact beyond which its branch point is negligible


class Progress(NamedTuple):
    """State of an integration, complete for an exact continuation."""

    here: Instant  # Start of the next step; the samples so far are before or within this step
    # `clearances` at the instant up to which the directions of the clearance vectors were followed
    seen: tuple
    seen_time: float  # That instant [s]
    turns: tuple  # Rotation of the clearance vectors [rad]
    episodes: np.ndarray  # See `jointgap.dynamics.integrate`
    proposal: float  # Length of the next step [s]
    time_map: int  # Time map of the next step
    s: float  # Start of the next step in the variable of that map


@compiled
def contact_duration(joint, mass, speed):
    """Approximate duration [s] of an elastic impact of `mass` at `speed`."""
    n = joint.exponent
    return 3.0 * ((n + 1.0) * mass / (2.0 * joint.stiffness) * speed ** (1.0 - n)) ** (
        1.0 / (n + 1.0)
    )


@compiled
def contact_begins(p, joint, approach):
    """`contact_duration` of a joint with the rod's mass as an approximation."""
    mass = 0.5 * p.bodies.rod_mass
    if joint == 0:
        return contact_duration(p.crank_pin, mass, approach)
    return contact_duration(p.piston_pin if joint == 1 else p.crank_pivot, mass, approach)


@compiled
def least_approach(p, joint):
    """Smallest approach speed [m/s] in the damping of a joint."""
    if joint == 0:
        return p.crank_pin.least_approach
    return p.piston_pin.least_approach if joint == 1 else p.crank_pivot.least_approach


@inlined
def time_to_knot(p, here, resolution) -> float:
    """Time [s] from `here` until a step has to end because the memory of a contact begins or ends
    to fade."""
    knot = min(
        next_knot(p.crank_pin, here.begins[0], here.time, resolution),
        next_knot(p.piston_pin, here.begins[1], here.time, resolution),
        next_knot(p.crank_pivot, here.begins[2], here.time, resolution),
    )
    return knot - here.time


@compiled
def replaced(values, place, value):
    """Three values with one of them replaced."""
    return (
        value if place == 0 else values[0],
        value if place == 1 else values[1],
        value if place == 2 else values[2],
    )


@compiled
def time_at_angle(p, here, there, taken, angle, smooth, k):
    """Time [s] within a step at which a motor's crank passes `angle` [rad], by Newton's method."""
    low, high = here.time, there.time
    share = (angle - here.crank_angle) / (there.crank_angle - here.crank_angle)
    time = low + share * (high - low)
    for _ in range(50):
        _, x = state_inside(p, here, taken, time, smooth, k)
        following = time - (x[2] - angle) / x[6]
        if x[2] < angle:
            low = time
        else:
            high = time
        if abs(following - time) <= 1e-15 * (there.time - here.time) + 4e-16 * abs(time):
            break
        time = following if low <= following <= high else 0.5 * (low + high)
    return time


@inlined
def longest_step(p) -> float:
    fastest = (
        max(p.drive.speed, p.drive.no_load_speed) if p.drive.kind == MOTOR else abs(p.drive.speed)
    )
    return _LONGEST_TURN / fastest


@compiled
def beginning(p, y, x, time):
    """State of an integration at its start, all joints in flight."""
    y_start = (y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7])
    x_start = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10])
    nowhere = (math.inf, math.inf, math.inf)
    here = instant(p, time, y_start, x_start, (FLIGHT, FLIGHT, FLIGHT), nowhere, nowhere)
    seen = clearances(y_start, x_start)
    episodes = np.zeros((3, EPISODE))
    return Progress(
        here, seen, here.time, (0.0, 0.0, 0.0), episodes, 0.1 * longest_step(p), LINEAR, 0.0
    )


@compiled
def integrate(p, progress, found, angles, tolerance, step_limit, k):
    """Continue the integration, with samples in the arrays of `found`."""
    times, states, auxiliary_states = found.times, found.states, found.auxiliary_states
    modes_at, approaches_at = found.modes, found.approaches
    begins_at, directions_at = found.begins, found.directions
    events, event_count, steps, sample = np.empty((64, EVENT_WIDTH)), 0, 0, 0
    motor, longest = p.drive.kind == MOTOR, longest_step(p)
    here, seen, seen_time, turns, episodes, proposal, time_map, s = progress
    episodes = episodes.copy()  # not the caller's
    before_step = episodes.copy()
    now = with_conditions(p, here)

    while True:
        if steps >= step_limit:
            end = Progress(here, seen, seen_time, turns, episodes, proposal, time_map, s)
            return TOO_MANY_STEPS, end, events[:event_count], steps
        proposal = unhindered = min(proposal, longest)
        proposal = min(proposal, time_to_knot(p, here, 1e-15 * (abs(here.time) + longest)))
        if time_map == AFTER and s * s > _FAR * proposal:
            time_map, s = LINEAR, 0.0
        allowed = tolerance * (_AFTER_IMPACT if time_map == AFTER else 1.0)
        happens, joint, kind, then, taken, error, made = advance(
            p, now, time_map, s, proposal, allowed, k
        )
        step_map, step_start, ds = taken
        there, steps = then[0], steps + made

        # accepted or rejected, the error determines the length of the next step
        factor = (
            5.0
            if error == 0.0
            else min(5.0, max(0.2, 0.9 * math.sqrt(math.sqrt(math.sqrt(allowed / error)))))
        )
        if not error <= allowed:
            factor = min(factor, 0.9) if error < math.inf else 0.1
            proposal = (
                0.5 * elapsed_time(step_map, step_start, ds)
                if step_map == BEFORE
                else elapsed_time(step_map, step_start, ds * factor)
            )
            if not proposal >= 1e-15 * (abs(here.time) + longest):
                end = Progress(here, seen, seen_time, turns, episodes, proposal, time_map, s)
                return (
                    STEP_TOO_SMALL if error < math.inf else NOT_FINITE,
                    end,
                    events[:event_count],
                    steps,
                )
            continue
        if motor and there.crank.speed <= 0.0:
            end = Progress(there, seen, seen_time, turns, episodes, proposal, time_map, s)
            return STALLED, end, events[:event_count], steps
        is_last = angles[-1] <= there.crank_angle if motor else times[-1] <= there.time
        if is_last:
            for i in range(3):
                for j in range(EPISODE):
                    before_step[i, j] = episodes[i, j]
        update_episodes(episodes, here, now[1], then[1], step_map, step_start, ds, k)

        prepared = smooth = False
        while sample < times.size:
            if (angles[sample] > there.crank_angle) if motor else (times[sample] > there.time):
                break
            at_end = not motor and times[sample] == there.time
            if not at_end and not prepared:
                smooth = prepare_inside(p, here, there, taken, tolerance, k)
                prepared = True
            if motor:
                times[sample] = time_at_angle(p, here, there, taken, angles[sample], smooth, k)
            time, y_now, x_now = times[sample], there.clearance_state, there.auxiliary_state
            if time < there.time:
                y_now, x_now = state_inside(p, here, taken, time, smooth, k)
            now = clearances(y_now, x_now)
            turns = all_turns(turns, seen, now, time - seen_time)
            seen, seen_time = now, time
            for i in range(STATES):
                states[sample, i] = y_now[i]
            for i in range(AUXILIARY_STATES):
                auxiliary_states[sample, i] = x_now[i]
            for i in range(3):
                modes_at[sample, i], directions_at[sample, i] = (
                    here.modes[i],
                    direction(turns[i], now[i]),
                )
                approaches_at[sample, i], begins_at[sample, i] = here.approaches[i], here.begins[i]
            sample += 1
        if sample == times.size:
            # this step is repeated by a continuation: its remaining part may contain samples
            end = Progress(here, seen, seen_time, turns, before_step, unhindered, time_map, s)
            return DONE, end, events[:event_count], steps
        now = clearances(there.clearance_state, there.auxiliary_state)
        turns = all_turns(turns, seen, now, there.time - seen_time)
        seen, seen_time = now, there.time
        if time_map == AFTER:
            s = math.sqrt(s * s + there.time - here.time)
        if not happens:
            following = elapsed_time(step_map, step_start + ds, ds * factor)
            if step_map == AFTER:
                # between equal steps in s (suitable near the impact) and in time (far from it):
                # fewer rejected steps
                following = math.sqrt(following * factor * elapsed_time(step_map, step_start, ds))
            proposal = max(following, unhindered) if proposal < unhindered else following
            here, now = there, then
            continue

        # the event: the joint's mode changes
        before, modes, x_after = here.modes[joint], here.modes, there.auxiliary_state
        approaches, begins = here.approaches, here.begins
        closing = max(-then[2][joint][1], 0.0)
        mode, approach = switched(
            before, approaches[joint], kind, closing, least_approach(p, joint)
        )
        modes, approaches = replaced(modes, joint, mode), replaced(approaches, joint, approach)
        if before == FLIGHT or mode == FLIGHT:
            if event_count == events.shape[0]:
                events = np.concatenate((events, np.empty_like(events)))
            record_event(events[event_count], episodes, there, joint, before == FLIGHT, closing)
            event_count += 1
        if before == FLIGHT:
            begin_episode(episodes, joint, there.time)
            begins = replaced(begins, joint, there.time)
            time_map, s = AFTER, 0.0
            proposal = min(proposal, 0.1 * contact_begins(p, joint, approach))
        elif mode == FLIGHT:
            begins = replaced(begins, joint, math.inf)
            # bristles without contact are straight
            x_after = x_after[:8] + replaced((x_after[8], x_after[9], x_after[10]), joint, 0.0)
            if modes[0] == FLIGHT and modes[1] == FLIGHT and modes[2] == FLIGHT:
                time_map, s, proposal = LINEAR, 0.0, max(proposal, 0.2 * longest)
        here = instant(p, there.time, there.clearance_state, x_after, modes, approaches, begins)
        now = with_conditions(p, here)
