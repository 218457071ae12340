"""Steps that end at events."""

import math

import numpy as np

from jointgap.contact.joints import CONTACT
from jointgap.core.numba_cache import compiled, inlined
from jointgap.motion.events import DISTANCE, FORCE, NOWHERE, first_crossing
from jointgap.motion.rates import evaluate
from jointgap.motion.runge_kutta import AFTER, BEFORE, ds_for, elapsed_time, step
from jointgap.motion.workspace import EVENT, HERE, THERE


@inlined
def _condition(k, row, j) -> tuple:
    c = k.conditions
    return c[row, j, 0], c[row, j, 1], c[row, j, 2], c[row, j, 3], c[row, j, 4]


@compiled
def next_event(k, row, duration, margin):
    """The first event between the start of the step and a row: fraction (or `NOWHERE`), contact,
    index of its condition."""
    first, which, kind = NOWHERE, 0, DISTANCE
    for j in range(k.contacts):
        g0, v0, a0, h0, w0 = _condition(k, HERE, j)
        g1, v1, a1, h1, w1 = _condition(k, row, j)
        x = first_crossing(g0, v0, a0, g1, v1, a1, duration, margin)
        if x < first:
            first, which, kind = x, j, DISTANCE
        if h0 > 0.0 and h1 >= 0.0 and not w0 < 0.0 < w1:
            continue
        # only a first derivative: with the cubic's curvatures the quintic equals that cubic
        slope = (h1 - h0) / duration
        bend0 = (6.0 * slope - 4.0 * w0 - 2.0 * w1) / duration
        bend1 = (2.0 * w0 + 4.0 * w1 - 6.0 * slope) / duration
        x = first_crossing(h0, w0, bend0, h1, w1, bend1, duration, 0.0)
        if x < first:
            first, which, kind = x, j, FORCE
    return first, which, kind


@compiled
def locate(p, k, time_map, s, limit, crossed, contact, kind, guess, close, tolerance):
    """Repeat the step, into the row `EVENT`, so that it ends where condition `kind` of a contact
    decreases through zero.

    Newton's method with true steps, between the closest points before and after the event. Towards
    a separation the step is a function of the root of the remaining time.
    """
    to_separation = (
        kind == DISTANCE and k.modes[contact] == CONTACT and not (time_map == AFTER and s == 0.0)
    )
    low, high = 0.0, limit if crossed else math.inf
    for count in range(1, 60):
        if to_separation:
            step_map, step_start = BEFORE, math.sqrt(guess)
            ds = -step_start
        else:
            step_map, step_start, ds = time_map, s, ds_for(time_map, s, guess)
        error = step(p, k, EVENT, step_map, step_start, ds)
        if not error <= tolerance:
            return False, step_map, step_start, ds, error, count
        k.time[EVENT] = k.time[HERE] + guess
        evaluate(p, k, EVENT)
        g, v = k.conditions[EVENT, contact, 0], k.conditions[EVENT, contact, 1]
        if kind == FORCE:
            g, v = k.conditions[EVENT, contact, 3], k.conditions[EVENT, contact, 4]
        if abs(g) <= close:
            return True, step_map, step_start, ds, error, count
        if g < 0.0:
            high = guess
        elif v >= 0.0 and high == math.inf:
            break  # beyond an inner minimum above zero
        else:
            low = guess
        guess -= g / v
        if not low < guess < high:
            guess = 0.5 * (low + high)
        if high - low <= 1e-14 * limit or low == guess or guess == high:
            return True, step_map, step_start, ds, error, count
        if guess > limit:
            break
    return False, step_map, step_start, ds, 0.0, count


_HOPELESS = (
    100.0  # error in tolerances above which events are not located: the step is repeated, shorter
)
_CLOSE = 0.01  # tolerance of an event's location, in tolerances
_MARGIN = 100.0  # error of the interpolant at a grazing passage, in tolerances
_UNKNOWN = np.bool_(
    False
)  # whether an event is passed; a literal would compile `locate` a second time


@inlined
def _separation_ahead(k) -> tuple:
    """Time [s] until a contact ends, by a parabola, and which; infinite if none."""
    first, which = math.inf, 0
    for j in range(k.contacts):
        depth, rate, curvature, _, _ = _condition(k, HERE, j)
        square = rate * rate - 2.0 * curvature * depth
        if k.modes[j] == CONTACT and depth > 0.0 and rate < 0.0 and square >= 0.0:
            time = 2.0 * depth / (math.sqrt(square) - rate)
            if time < first:
                first, which = time, j
    return first, which


@inlined
def _holds(k, row) -> bool:
    """Whether all modes last."""
    for j in range(k.contacts):
        if k.conditions[row, j, 0] < 0.0 or k.conditions[row, j, 3] < 0.0:
            return False
    return True


@compiled
def advance(p, k, time_map, s, duration, tolerance):
    """Take a step of `duration` [s], or a shorter one to the first event in it.

    Returns whether an event ends it, its contact and condition, the time map of the step, its start
    and length, its error, the number of attempts, and the row of its end.
    """
    steps = 0
    # The force has a kink at a separation, which a step must not cross: aim at it where one is
    # near.
    ahead, contact = _separation_ahead(k)
    if ahead < duration:
        close = max(_CLOSE * tolerance, 1e-18)
        found, step_map, start, ds, error, steps = locate(
            p,
            k,
            time_map,
            s,
            2.0 * ahead,
            _UNKNOWN,
            contact,
            DISTANCE,
            ahead,
            close,
            tolerance,
        )
        if found:
            fraction, other, kind = next_event(
                k, EVENT, k.time[EVENT] - k.time[HERE], _MARGIN * tolerance
            )
            if fraction == NOWHERE or (other == contact and kind == DISTANCE):
                return True, contact, DISTANCE, step_map, start, ds, error, steps, EVENT
        else:
            duration = 0.5 * ahead
    ds = ds_for(time_map, s, duration)
    duration = elapsed_time(time_map, s, ds)
    error = step(p, k, THERE, time_map, s, ds)
    steps += 1
    if not error <= _HOPELESS * tolerance:
        return False, 0, DISTANCE, time_map, s, ds, error, steps, HERE
    k.time[THERE] = k.time[HERE] + duration
    evaluate(p, k, THERE)
    fraction, contact, kind = next_event(k, THERE, duration, _MARGIN * tolerance)
    if fraction == 0.0:
        return True, contact, kind, time_map, s, 0.0, 0.0, steps, HERE
    if fraction < NOWHERE:
        close = max(_CLOSE * tolerance, 1e-18) if kind == DISTANCE else 1e-9 * k.approaches[contact]
        crossed = k.conditions[THERE, contact, 0 if kind == DISTANCE else 3] < 0.0
        found, step_map, start, event_ds, event_error, made = locate(
            p,
            k,
            time_map,
            s,
            duration,
            crossed,
            contact,
            kind,
            fraction * duration,
            close,
            tolerance,
        )
        steps += made
        if found:
            return True, contact, kind, step_map, start, event_ds, event_error, steps, EVENT
        if not event_error <= tolerance:
            return False, 0, DISTANCE, step_map, start, event_ds, event_error, steps, HERE
        if not _holds(k, THERE):  # an event behind a near miss: go to the near miss first
            error = _HOPELESS * tolerance
        else:  # restore the stages of the accepted step
            later = k.time[THERE]
            step(p, k, THERE, time_map, s, ds)
            k.time[THERE] = later
            steps += 1
    return False, 0, DISTANCE, time_map, s, ds, error, steps, THERE
