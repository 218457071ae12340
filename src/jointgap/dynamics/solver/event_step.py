"""One step onwards, ended at the first event in it."""

import math

from jointgap.dynamics.compilation import compiled, inlined
from jointgap.dynamics.model.joint_forces import CONTACT
from jointgap.dynamics.model.relative_motion import relative_motion
from jointgap.dynamics.solver.events import DISTANCE, JOINT_COUNT, NOWHERE, all_conditions, locate, next_event
from jointgap.dynamics.solver.runge_kutta import ds_for, elapsed_time, instant_in_place, step

_HOPELESS = 100.0  # tolerances of error beyond which no event is looked for: the step will be repeated, shorter
_CLOSE = 0.01  # tolerances of distance by which an event may be missed
_MARGIN = 100.0  # tolerances by which the interpolant of a grazing passage may err


@inlined
def separation_ahead(here, holding) -> tuple:
    """Time [s] until a contact ends if its penetration goes on as a parabola, and its joint; infinite if it does not.

    Parameters
    ----------
    here : Instant
    holding : tuple
        `all_conditions` there.
    """
    first, which = math.inf, 0
    for joint in range(JOINT_COUNT):
        depth, rate, curvature, _, _ = holding[joint]
        square = rate * rate - 2.0 * curvature * depth
        if here.modes[joint] == CONTACT and depth > 0.0 and rate < 0.0 and square >= 0.0:
            time = 2.0 * depth / (math.sqrt(square) - rate)
            if time < first:
                first, which = time, joint
    return first, which


@inlined
def holds(conditions) -> bool:
    """Whether no mode has ended."""
    pin, piston, pivot = conditions
    return min(pin[0], pin[3], piston[0], piston[3], pivot[0], pivot[3]) >= 0.0


@compiled
def advance(p, here, motion, holding, time_map, s, duration, tolerance, velocity_time, k):
    """Take a step of `duration` [s], or a shorter one to the first event in it.

    Parameters
    ----------
    p, here, time_map, s, velocity_time, k
        As in `jointgap.dynamics.solver.runge_kutta.step`.
    motion, holding
        `relative_motion` and `all_conditions` at `here`.
    tolerance : float
        Local error allowed [m].

    Returns
    -------
    tuple
        Whether the step ends at an event, the event's joint and condition; instant, motion and conditions at the end
        of the step; its time_map, s, ds and error [m]; how many steps that took. With too large an error only time_map,
        s, ds and error say anything.
    """
    steps = 0
    # A step across a separation is lost, for the force ends in a kink: where one is near, aim at it.
    ahead, joint = separation_ahead(here, holding)
    if ahead < duration:
        close = max(_CLOSE * tolerance, 1e-18)
        found, there, step_map, step_start, ds, error, steps = locate(
            p, here, time_map, s, 2.0 * ahead, False, joint, DISTANCE, ahead, close, tolerance, velocity_time, k
        )
        if found:
            there_motion = relative_motion(there)
            there_holding = all_conditions(p, there, there_motion)
            fraction, other, kind = next_event(holding, there_holding, there.time - here.time, _MARGIN * tolerance)
            if fraction == NOWHERE or (other == joint and kind == DISTANCE):
                return True, joint, DISTANCE, there, there_motion, there_holding, step_map, step_start, ds, error, steps
        else:
            duration = 0.5 * ahead

    ds = ds_for(time_map, s, duration)
    duration = elapsed_time(time_map, s, ds)
    y, x, error = step(p, here, time_map, s, ds, velocity_time, k)
    steps += 1
    if not error <= _HOPELESS * tolerance:
        return False, 0, DISTANCE, here, motion, holding, time_map, s, ds, error, steps
    there = instant_in_place(p, here.time + duration, y, x, here.modes, here.approaches)
    there_motion = relative_motion(there)
    there_holding = all_conditions(p, there, there_motion)
    fraction, joint, kind = next_event(holding, there_holding, duration, _MARGIN * tolerance)
    if fraction == 0.0:
        return True, joint, kind, here, motion, holding, time_map, s, 0.0, 0.0, steps
    if fraction < NOWHERE:
        close = max(_CLOSE * tolerance, 1e-18) if kind == DISTANCE else 1e-9 * here.approaches[joint]
        crossed = there_holding[joint][0 if kind == DISTANCE else 3] < 0.0
        found, event, step_map, step_start, event_ds, event_error, made = locate(
            p,
            here,
            time_map,
            s,
            duration,
            crossed,
            joint,
            kind,
            fraction * duration,
            close,
            tolerance,
            velocity_time,
            k,
        )
        steps += made
        if found:
            there_motion = relative_motion(event)
            there_holding = all_conditions(p, event, there_motion)
            return (
                True,
                joint,
                kind,
                event,
                there_motion,
                there_holding,
                step_map,
                step_start,
                event_ds,
                event_error,
                steps,
            )
        if not event_error <= tolerance:
            return False, 0, DISTANCE, here, motion, holding, step_map, step_start, event_ds, event_error, steps
        if not holds(there_holding):  # a near miss, and an event behind it: go to the near miss first
            error = _HOPELESS * tolerance
        else:  # for `k` to hold the stages of the step that is kept
            step(p, here, time_map, s, ds, velocity_time, k)
            steps += 1
    return False, 0, DISTANCE, there, there_motion, there_holding, time_map, s, ds, error, steps
