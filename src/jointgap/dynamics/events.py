"""Events that end a mode of a joint: conditions, their first zero within a step, and the step that
ends there.

Each mode has two conditions, which are positive while the mode lasts:

    FLIGHT     c^2 - r^2 over 2c                 (impact; smooth at r = 0, unlike c - r)
    CONTACT    d                                 (separation)
               d' + d'_0 / chi                   (zero force: then FORCE_FREE; chi / v_ref once
               memory has faded)
    FORCE_FREE d                                 (separation)
               -(d' + d'_0 / chi)                (the force returns)

For laws without restitution see `jointgap.dynamics.contact.pushing_margin`."""

import math

import numpy as np

from jointgap.core.joints import JOINTS
from jointgap.dynamics.contact import force_free_speed, pushing_margin
from jointgap.dynamics.joints import CONTACT, FLIGHT, FORCE_FREE, relative_motion
from jointgap.dynamics.numba_cache import compiled, inlined
from jointgap.dynamics.runge_kutta import (
    AFTER,
    BEFORE,
    ds_for,
    elapsed_time,
    instant,
    instant_in_place,
    step,
)

NOWHERE, JOINT_COUNT = 2.0, len(JOINTS)

DISTANCE, FORCE = (np.int64(kind) for kind in (0, 1))
"""Index of a mode's condition."""

_PIECES = 16


@inlined
def conditions(joint, mode, approach, begin, time, relative) -> tuple:
    """Both conditions of a joint's mode with their time derivatives.

    `relative` contains clearance vector, rate and second rate (ex, ey, vx, vy, ax, ay).
    """
    if not joint.loose:
        return 1.0, 0.0, 0.0, 1.0, 0.0
    ex, ey, vx, vy, ax, ay = relative
    if mode == FLIGHT:
        c = joint.clearance
        gap = 0.5 * (c - (ex * ex + ey * ey) / c)
        return gap, -(ex * vx + ey * vy) / c, -(vx * vx + vy * vy + ex * ax + ey * ay) / c, 1.0, 0.0
    r = math.sqrt(ex * ex + ey * ey)
    nx, ny = ex / r, ey / r
    rate = vx * nx + vy * ny
    curvature = ax * nx + ay * ny + (vy * nx - vx * ny) ** 2 / r
    depth = r - joint.clearance
    free_speed, free_rate = force_free_speed(joint, approach, begin, time)
    margin, margin_rate = pushing_margin(joint, depth, rate, curvature, free_speed, free_rate)
    if mode == CONTACT:
        return depth, rate, curvature, margin, margin_rate
    return depth, rate, curvature, -margin, -margin_rate


@compiled
def first_crossing(g0, v0, a0, g1, v1, a1, duration, margin):
    """Fraction of a step at which a condition first decreases through zero, on its quintic Hermite
    interpolant."""
    if g0 <= 0.0 and v0 < 0.0:
        return 0.0
    v0, v1, a0, a1 = v0 * duration, v1 * duration, a0 * duration**2, a1 * duration**2
    # The smallest Bernstein coefficient is a lower bound of the interpolant, usually sufficient.
    # Signs at the ends are not: a clearance vector may leave its circle, return and cross it.
    near = min(g0, g0 + 0.2 * v0, g0 + 0.4 * v0 + 0.05 * a0)
    if min(near, g1, g1 - 0.2 * v1, g1 - 0.4 * v1 + 0.05 * a1) >= max(margin, 0.0):
        return NOWHERE
    rise = g1 - g0
    c3 = 10.0 * rise - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15.0 * rise + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
    c5 = 6.0 * rise - 3.0 * (v0 + v1) - 0.5 * (a0 - a1)
    value, slope = (g0, v0, 0.5 * a0, c3, c4, c5), (v0, a0, 3.0 * c3, 4.0 * c4, 5.0 * c5, 0.0)
    low, high, fall = 0.0, NOWHERE, v0
    for i in range(1, _PIECES + 1):
        x = i / _PIECES
        rate = _quintic(slope, x)
        if fall < 0.0 <= rate:
            bottom = _sign_change(slope, low, x, -1.0)
            g = _quintic(value, bottom)
            if 0.0 <= g < margin:
                return bottom
            if g < 0.0:
                high = bottom
                break
        if _quintic(value, x) < 0.0:
            high = x
            break
        low, fall = x, rate
    if high == NOWHERE:
        return NOWHERE
    # At the start the condition has just become true: zero up to rounding, and increasing.
    return _sign_change(value, low, high, 1.0)


@compiled
def _quintic(c, x):
    """c[0] + c[1] x + ... + c[5] x^5."""
    return c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))


@compiled
def _sign_change(c, low, high, sign):
    """Zero of `_quintic` between `low`, where it has the sign `sign`, and `high`, where it has not.

    Newton's method, safeguarded by bisection.
    """
    x = 0.5 * (low + high)
    for _ in range(60):
        value = _quintic(c, x)
        if value * sign < 0.0:
            high = x
        else:
            low = x
        rate = c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * (4.0 * c[4] + x * 5.0 * c[5])))
        following = x - value / rate
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - x) <= 2e-16 or high - low <= 2e-16:
            break
        x = following
    return x


@inlined
def all_conditions(p, here, motion) -> tuple:
    """`conditions` of crank pin, piston pin and crank pivot."""
    return (
        conditions(
            p.crank_pin, here.modes[0], here.approaches[0], here.begins[0], here.time, motion[0]
        ),
        conditions(
            p.piston_pin, here.modes[1], here.approaches[1], here.begins[1], here.time, motion[1]
        ),
        conditions(
            p.crank_pivot, here.modes[2], here.approaches[2], here.begins[2], here.time, motion[2]
        ),
    )


@inlined
def with_conditions(p, here) -> tuple:
    """An instant with the relative motion in its joints and their conditions."""
    motion = relative_motion(here)
    return here, motion, all_conditions(p, here, motion)


@compiled
def next_event(before, after, duration, margin):
    """The first event of any joint in a step: fraction (or `NOWHERE`), joint, index of its
    condition."""
    first, which, kind = NOWHERE, 0, DISTANCE
    for joint in range(JOINT_COUNT):
        g0, v0, a0, h0, w0 = before[joint]
        g1, v1, a1, h1, w1 = after[joint]
        x = first_crossing(g0, v0, a0, g1, v1, a1, duration, margin)
        if x < first:
            first, which, kind = x, joint, DISTANCE
        if h0 > 0.0 and h1 >= 0.0 and not w0 < 0.0 < w1:
            continue
        # The second condition has only a first derivative; with the cubic's curvatures the quintic
        # equals that cubic.
        slope = (h1 - h0) / duration
        bend0, bend1 = (
            (6.0 * slope - 4.0 * w0 - 2.0 * w1) / duration,
            (2.0 * w0 + 4.0 * w1 - 6.0 * slope) / duration,
        )
        x = first_crossing(h0, w0, bend0, h1, w1, bend1, duration, 0.0)
        if x < first:
            first, which, kind = x, joint, FORCE
    return first, which, kind


@compiled
def switched(mode, approach, kind, speed, least):
    """Mode and approach speed of a joint after the event of condition `kind`, with the surfaces
    closing at `speed`.

    The approach speed is at least `least`: for d'_0 -> 0 the damping chi d'/d'_0 would diverge.
    """
    if mode == FLIGHT:
        return CONTACT, max(speed, least)
    if kind == DISTANCE:
        return FLIGHT, approach
    return (FORCE_FREE if mode == CONTACT else CONTACT), approach


@compiled
def locate(p, here, time_map, s, limit, crossed, joint, kind, guess, close, tolerance, k):
    """Repeat a step so that it ends where condition `kind` of `joint` decreases through zero.

    Newton's method with true steps, between the closest points before and after the event. Towards
    a separation the step is a function of the root of the remaining time: see
    `jointgap.dynamics.runge_kutta`.
    """
    to_separation = (
        kind == DISTANCE and here.modes[joint] == CONTACT and not (time_map == AFTER and s == 0.0)
    )
    low, high = 0.0, limit if crossed else math.inf
    for count in range(1, 60):
        if to_separation:
            step_map, step_start = BEFORE, math.sqrt(guess)
            ds = -step_start
        else:
            step_map, step_start, ds = time_map, s, ds_for(time_map, s, guess)
        y, x, error = step(p, here, step_map, step_start, ds, k)
        if not error <= tolerance:
            return False, here, step_map, step_start, ds, error, count
        there = instant(p, here.time + guess, y, x, here.modes, here.approaches, here.begins)
        g, v, _, h, w = all_conditions(p, there, relative_motion(there))[joint]
        if kind == FORCE:
            g, v = h, w
        if abs(g) <= close:
            return True, there, step_map, step_start, ds, error, count
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
            return True, there, step_map, step_start, ds, error, count
        if guess > limit:
            break
    return False, here, step_map, step_start, ds, 0.0, count


_HOPELESS = (
    100.0  # error in tolerances above which events are not located: the step is repeated, shorter
)
_CLOSE = 0.01  # tolerance of an event's location, in tolerances
_MARGIN = 100.0  # error of the interpolant at a grazing passage, in tolerances
_UNKNOWN = np.bool_(
    False
)  # whether an event is passed; a literal would compile `locate` a second time


@inlined
def _separation_ahead(here, holding) -> tuple:
    """Time [s] until a contact ends, by parabolic extrapolation of its penetration, and its joint;
    infinite if none."""
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
def _holds(conditions) -> bool:
    """Whether all modes last."""
    pin, piston, pivot = conditions
    return min(pin[0], pin[3], piston[0], piston[3], pivot[0], pivot[3]) >= 0.0


@compiled
def advance(p, now, time_map, s, duration, tolerance, k):
    """Take a step of `duration` [s], or a shorter one to the first event in it.

    Returns whether an event ends it, its joint and condition, the instant at its end (as `now`,
    with its conditions), the time map of the step, its start and length, its error, and the number
    of attempts.
    """
    steps, (here, _, holding) = 0, now
    # The force has a kink at a separation, which a step must not cross: aim at it where one is
    # near.
    ahead, joint = _separation_ahead(here, holding)
    if ahead < duration:
        close = max(_CLOSE * tolerance, 1e-18)
        found, there, step_map, step_start, ds, error, steps = locate(
            p, here, time_map, s, 2.0 * ahead, _UNKNOWN, joint, DISTANCE, ahead, close, tolerance, k
        )
        if found:
            then = with_conditions(p, there)
            fraction, other, kind = next_event(
                holding, then[2], there.time - here.time, _MARGIN * tolerance
            )
            if fraction == NOWHERE or (other == joint and kind == DISTANCE):
                return True, joint, DISTANCE, then, (step_map, step_start, ds), error, steps
        else:
            duration = 0.5 * ahead

    ds = ds_for(time_map, s, duration)
    duration = elapsed_time(time_map, s, ds)
    y, x, error = step(p, here, time_map, s, ds, k)
    steps += 1
    if not error <= _HOPELESS * tolerance:
        return False, 0, DISTANCE, now, (time_map, s, ds), error, steps
    there = instant_in_place(
        p, here.time + duration, y, x, here.modes, here.approaches, here.begins
    )
    then = with_conditions(p, there)
    fraction, joint, kind = next_event(holding, then[2], duration, _MARGIN * tolerance)
    if fraction == 0.0:
        return True, joint, kind, now, (time_map, s, 0.0), 0.0, steps
    if fraction < NOWHERE:
        close = (
            max(_CLOSE * tolerance, 1e-18) if kind == DISTANCE else 1e-9 * here.approaches[joint]
        )
        crossed = then[2][joint][0 if kind == DISTANCE else 3] < 0.0
        guess = fraction * duration
        found, event, step_map, step_start, event_ds, event_error, made = locate(
            p, here, time_map, s, duration, crossed, joint, kind, guess, close, tolerance, k
        )
        steps += made
        if found:
            then = with_conditions(p, event)
            return True, joint, kind, then, (step_map, step_start, event_ds), event_error, steps
        if not event_error <= tolerance:
            return False, 0, DISTANCE, now, (step_map, step_start, event_ds), event_error, steps
        if not _holds(then[2]):  # an event behind a near miss: go to the near miss first
            error = _HOPELESS * tolerance
        else:  # restore the stages of the accepted step in `k`
            step(p, here, time_map, s, ds, k)
            steps += 1
    return False, 0, DISTANCE, then, (time_map, s, ds), error, steps
