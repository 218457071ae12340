"""The march through time: steps under error control, ended at events, with samples taken inside the steps.

A sample is a shorter step of the same method from the start of the step that it lies in. So it is as exact as the step,
and the march does not depend on where samples are taken.
"""

import math

import numpy as np

from jointgap.dynamics.advance import advance
from jointgap.dynamics.compiled import compiled
from jointgap.dynamics.equations import FLIGHT, STATES
from jointgap.dynamics.events import all_conditions, switched
from jointgap.dynamics.integrator import AFTER, BEFORE, COUNT, LINEAR, elapsed, instant, step, stretch
from jointgap.dynamics.motion import direction, relative_motion, resolution

DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, NOT_FINITE = 0, 1, 2, 3

_LONGEST_TURN = 0.1  # rad of crank angle in one step: a clearance vector leaves its circle once in it, not twice
_AFTER_IMPACT = 0.1  # share of the tolerance there: velocities wrong by that much last through the flight that follows
_FAR = 20.0  # steps after an impact from which on its branch point no longer matters


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
    k = np.empty((COUNT, STATES))
    events, event_count, steps, sample = np.empty((64, 4)), 0, 0, 0
    least, longest = resolution(p), _LONGEST_TURN / abs(p.speed)
    proposal, course, s = 0.1 * longest, LINEAR, 0.0

    y = (start[0], start[1], start[2], start[3], start[4], start[5], start[6], start[7])
    here = instant(p, times[0], y, (FLIGHT, FLIGHT), (math.inf, math.inf))
    motion = relative_motion(p, here)
    holding = all_conditions(p, here, motion)
    seen, seen_time = motion, here.time  # where the directions were last followed to
    gamma2 = direction(math.nan, motion[0], motion[0], 0.0, least)
    gamma3 = direction(math.nan, motion[1], motion[1], 0.0, least)

    while True:
        if steps >= step_limit:
            return TOO_MANY_STEPS, here.time, here.y, events[:event_count], steps
        proposal = min(proposal, longest)
        if course == AFTER and s * s > _FAR * proposal:
            course, s = LINEAR, 0.0
        allowed = tolerance * (_AFTER_IMPACT if course == AFTER else 1.0)
        happens, joint, kind, there, there_motion, there_holding, run, begin, ds, error, made = advance(
            p, here, motion, holding, course, s, proposal, allowed, velocity_time, k
        )
        steps += made

        # Accepted or not, the error says how long the next step may be.
        factor = 5.0 if error == 0.0 else min(5.0, max(0.2, 0.9 * (allowed / error) ** 0.125))
        if not error <= allowed:
            factor = min(factor, 0.9) if error < math.inf else 0.1
            proposal = 0.5 * elapsed(run, begin, ds) if run == BEFORE else elapsed(run, begin, ds * factor)
            if proposal < 1e-15 * (abs(here.time) + longest):
                status = STEP_TOO_SMALL if error < math.inf else NOT_FINITE
                return status, here.time, here.y, events[:event_count], steps
            continue

        while sample < times.size and times[sample] <= there.time:
            time, y = times[sample], there.y
            if time < there.time:
                y, _ = step(p, here, run, begin, stretch(run, begin, time - here.time), velocity_time, k)
            now = relative_motion(p, instant(p, time, y, here.modes, here.approaches))
            gamma2 = direction(gamma2, seen[0], now[0], time - seen_time, least)
            gamma3 = direction(gamma3, seen[1], now[1], time - seen_time, least)
            seen, seen_time = now, time
            for i in range(STATES):
                states[sample, i] = y[i]
            for j in range(2):
                modes_at[sample, j], approaches_at[sample, j] = here.modes[j], here.approaches[j]
            directions_at[sample, 0], directions_at[sample, 1] = gamma2, gamma3
            sample += 1
        if sample == times.size:
            return DONE, there.time, there.y, events[:event_count], steps
        gamma2 = direction(gamma2, seen[0], there_motion[0], there.time - seen_time, least)
        gamma3 = direction(gamma3, seen[1], there_motion[1], there.time - seen_time, least)
        seen, seen_time = there_motion, there.time
        if course == AFTER:
            s = math.sqrt(s * s + there.time - here.time)
        if not happens:
            proposal = elapsed(run, begin + ds, ds * factor)
            here, motion, holding = there, there_motion, there_holding
            continue

        # The event: the joint's mode changes.
        modes, approaches = here.modes, here.approaches
        before = modes[joint]
        mode, approach = switched(before, approaches[joint], kind, -there_holding[joint][1])
        modes = (mode, modes[1]) if joint == 0 else (modes[0], mode)
        approaches = (approach, approaches[1]) if joint == 0 else (approaches[0], approach)
        if before == FLIGHT or mode == FLIGHT:
            if event_count == events.shape[0]:
                events = np.concatenate((events, np.empty_like(events)))
            events[event_count, 0], events[event_count, 1] = there.time, joint
            events[event_count, 2] = 1.0 if before == FLIGHT else 0.0
            events[event_count, 3] = approach if before == FLIGHT else math.nan
            event_count += 1
        if before == FLIGHT:
            course, s = AFTER, 0.0
            lasts = contact_duration(p.crank_pin if joint == 0 else p.piston_pin, 0.5 / p.rod_inverse_mass, approach)
            proposal = min(proposal, 0.1 * lasts)
        elif modes[0] == FLIGHT and modes[1] == FLIGHT:
            course, s, proposal = LINEAR, 0.0, max(proposal, 0.2 * longest)
        here = instant(p, there.time, there.y, modes, approaches)
        motion = relative_motion(p, here)
        holding = all_conditions(p, here, motion)
