"""The march through time: steps under error control, ended at events, with samples taken inside the steps.

A sample is a shorter step of the same method from the start of the step that it lies in. So it is as exact as the step,
and the march does not depend on where samples are taken.
"""

import math

import numpy as np

from jointgap.dynamics.compiled import compiled
from jointgap.dynamics.equations import FLIGHT, STATES
from jointgap.dynamics.events import NOWHERE, joint_conditions, locate, next_event, switched
from jointgap.dynamics.integrator import AFTER, BEFORE, COUNT, LINEAR, elapsed, step, stretch
from jointgap.dynamics.motion import directions, relative_motion, resolution, slope_of, swept_angle

DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, NOT_FINITE = 0, 1, 2, 3

_LONGEST_TURN = 0.1  # rad of crank angle in one step: a clearance vector leaves its circle once in it, not twice
_FAR = 20.0  # steps after an impact from which on its branch point no longer matters
_MARGIN = 100.0  # tolerances by which the interpolant of a grazing passage may err


@compiled
def direction(angle, before, after, duration, least):
    """Unwrapped direction [rad] of a clearance vector after `duration`, NaN where it is no longer than `least`.

    `angle` is the direction before; NaN (not known yet) starts afresh within (-pi, pi].
    """
    if math.hypot(after[0], after[1]) <= least:
        return math.nan
    if math.isnan(angle):
        return math.atan2(after[1], after[0])
    return angle + swept_angle(before, after, duration)


@compiled
def contact_duration(joint, mass, speed):
    """About how long [s] an elastic impact of `mass` at `speed` lasts."""
    n = joint.exponent
    return 3.0 * ((n + 1.0) * mass / (2.0 * joint.stiffness) * speed ** (1.0 - n)) ** (1.0 / (n + 1.0))


@compiled
def march(p, start, times, tolerance, velocity_time, step_limit, states, modes_at, approaches_at, directions_at):
    """Integrate from `times[0]`, both joints in flight, and take samples at `times`.

    Parameters
    ----------
    p : Parameters
    start : (8,) array
        State at the first of `times`.
    times : (n,) array
        Samples [s], growing.
    tolerance : float
        Local error of a step [m].
    velocity_time : float
        Time [s] that turns an error in a velocity into one in a position.
    step_limit : int
        Most steps, rejected ones included.
    states, modes_at, approaches_at, directions_at : (n, 8), (n, 2), (n, 2), (n, 2) arrays
        Overwritten with the samples: states, modes, approach speeds [m/s] of the contacts, unwrapped directions [rad]
        of the clearance vectors (NaN where the centres coincide).

    Returns
    -------
    tuple
        Status, time and state at the end, events as an (m, 4) array (time, joint, 1 for impact and 0 for separation,
        approach speed), number of steps.
    """
    y, slope = start.copy(), np.empty(STATES)
    new, new_slope = np.empty(STATES), np.empty(STATES)
    spot, spot_slope = np.empty(STATES), np.empty(STATES)
    k = np.empty((COUNT, STATES))
    events, event_count, steps, sample = np.empty((64, 4)), 0, 0, 0
    rod_length = p.rod_to_crank_end + p.rod_to_piston_end
    weights = (rod_length, velocity_time, velocity_time * rod_length)
    least = resolution(p)
    longest = _LONGEST_TURN / abs(p.speed)
    proposal = 0.1 * longest

    time, modes, approaches = times[0], (FLIGHT, FLIGHT), (0.0, 0.0)
    course, s = LINEAR, 0.0
    angles = directions(p, time, y[2])
    slope_of(p, angles, y, modes, approaches, slope)
    motion = relative_motion(p, angles, y, slope)
    seen, seen_time = motion, time  # where the directions were last followed to
    gamma2 = direction(math.nan, motion[0], motion[0], 0.0, least)
    gamma3 = direction(math.nan, motion[1], motion[1], 0.0, least)

    while True:
        # The step, or a shorter one to the first event in it.
        if steps >= step_limit:
            return TOO_MANY_STEPS, time, y, events[:event_count], steps
        proposal = min(proposal, longest)
        if course == AFTER and s * s > _FAR * proposal:
            course, s = LINEAR, 0.0
        run, begin, ds = course, s, stretch(course, s, proposal)
        error = step(p, angles, modes, approaches, y, slope, run, begin, ds, weights, k, new, new_slope)
        steps += 1
        duration = elapsed(run, begin, ds)
        happens, joint, kind = False, 0, 0
        if error <= 100.0 * tolerance:
            end = directions(p, time + duration, new[2])
            end_motion = relative_motion(p, end, new, new_slope)
            x, joint, kind = next_event(p, modes, approaches, motion, end_motion, duration, _MARGIN * tolerance)
            if x == 0.0:
                happens, ds, duration, error = True, 0.0, 0.0, 0.0
                new[:], new_slope[:], end, end_motion = y, slope, angles, motion
            elif x < NOWHERE:
                close = max(1e-3 * tolerance, 1e-15) if kind == 0 else 1e-9 * approaches[joint]
                happens, run, begin, ds, error, made = locate(
                    p,
                    angles,
                    modes,
                    approaches,
                    y,
                    slope,
                    time,
                    course,
                    s,
                    duration,
                    joint,
                    kind,
                    x * duration,
                    close,
                    weights,
                    k,
                    new,
                    new_slope,
                )
                steps += made
                duration = elapsed(run, begin, ds)
                if not happens:
                    error = step(p, angles, modes, approaches, y, slope, run, begin, ds, weights, k, new, new_slope)
                end = directions(p, time + duration, new[2])
                end_motion = relative_motion(p, end, new, new_slope)

        # Accepted or not, the error says how long the next step may be.
        factor = 5.0 if error == 0.0 else min(5.0, max(0.2, 0.9 * (tolerance / error) ** 0.125))
        if not error <= tolerance:
            if run == BEFORE:
                proposal = 0.5 * duration
            else:
                factor = min(factor, 0.9) if error < math.inf else 0.1
                proposal = elapsed(run, begin, ds * factor)
            if proposal < 1e-15 * (abs(time) + longest):
                status = STEP_TOO_SMALL if error < math.inf else NOT_FINITE
                return status, time, y, events[:event_count], steps
            continue

        # Samples inside the step.
        while sample < times.size and times[sample] <= time + duration:
            at = times[sample] - time
            if at < duration:
                part = stretch(run, begin, at)
                step(p, angles, modes, approaches, y, slope, run, begin, part, weights, k, spot, spot_slope)
            else:
                spot[:], spot_slope[:] = new, new_slope
            now = relative_motion(p, directions(p, times[sample], spot[2]), spot, spot_slope)
            gamma2 = direction(gamma2, seen[0], now[0], times[sample] - seen_time, least)
            gamma3 = direction(gamma3, seen[1], now[1], times[sample] - seen_time, least)
            seen, seen_time = now, times[sample]
            states[sample] = spot
            for j in range(2):
                modes_at[sample, j], approaches_at[sample, j] = modes[j], approaches[j]
            directions_at[sample, 0], directions_at[sample, 1] = gamma2, gamma3
            sample += 1
        if sample == times.size:
            return DONE, times[-1], spot, events[:event_count], steps
        gamma2 = direction(gamma2, seen[0], end_motion[0], time + duration - seen_time, least)
        gamma3 = direction(gamma3, seen[1], end_motion[1], time + duration - seen_time, least)

        # On to the end of the step.
        time += duration
        y, new = new, y
        slope, new_slope = new_slope, slope
        angles, motion, seen, seen_time = end, end_motion, end_motion, time
        if run == AFTER:
            s = begin + ds
        if not happens:
            proposal = elapsed(run, begin + ds, ds * factor)
            continue

        # The event: the joint's mode changes.
        speed = -joint_conditions(p, joint, modes, approaches, motion)[1]
        before = modes[joint]
        mode, approach = switched(before, approaches[joint], kind, speed)
        modes = (mode, modes[1]) if joint == 0 else (modes[0], mode)
        approaches = (approach, approaches[1]) if joint == 0 else (approaches[0], approach)
        slope_of(p, angles, y, modes, approaches, slope)
        motion = relative_motion(p, angles, y, slope)
        seen = motion
        if before == FLIGHT or mode == FLIGHT:
            if event_count == events.shape[0]:
                events = np.concatenate((events, np.empty_like(events)))
            events[event_count, 0], events[event_count, 1] = time, joint
            events[event_count, 2] = 1.0 if before == FLIGHT else 0.0
            events[event_count, 3] = approach if before == FLIGHT else math.nan
            event_count += 1
        if before == FLIGHT:
            course, s = AFTER, 0.0
            lasts = contact_duration(p.crank_pin if joint == 0 else p.piston_pin, 0.5 * p.rod_mass, approach)
            proposal = min(proposal, 0.1 * lasts)
        elif modes[0] == FLIGHT and modes[1] == FLIGHT:
            course, s, proposal = LINEAR, 0.0, max(proposal, 0.2 * longest)
