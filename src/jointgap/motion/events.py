"""Events that end a mode of a joint: conditions, and their first zero within a step.

Each mode has two conditions, which are positive while the mode lasts:

    FLIGHT     c^2 - r^2 over 2c                 (impact; smooth at r = 0, unlike c - r;
                                                  of a corner -d)
    CONTACT    d                                 (separation)
               d' + d'_0 / chi                   (zero force: then FORCE_FREE; chi / v_ref once
               memory has faded)
    FORCE_FREE d                                 (separation)
               -(d' + d'_0 / chi)                (the force returns)

For laws without restitution see `jointgap.contact.normal_force.pushing_margin`."""

import math

import numpy as np

from jointgap.contact.joints import CONTACT, FLIGHT, FORCE_FREE, corner_motion
from jointgap.contact.normal_force import force_free_speed, pushing_margin
from jointgap.core.numba_cache import compiled, inlined

NOWHERE = 2.0

DISTANCE, FORCE = (np.int64(kind) for kind in (0, 1))
"""Index of a mode's condition."""

_PIECES = 16


@inlined
def conditions(joint, mode, approach, begin, time, relative) -> tuple:
    """Both conditions of a joint's mode with their time derivatives.

    `relative` contains clearance vector, rate and second rate (ex, ey, vx, vy, ax, ay).
    """
    ex, ey, vx, vy, ax, ay = relative
    if mode == FLIGHT:
        c = joint.clearance
        gap = 0.5 * (c - (ex * ex + ey * ey) / c)
        return gap, -(ex * vx + ey * vy) / c, -(vx * vx + vy * vy + ex * ax + ey * ay) / c, 1.0, 0.0
    r = math.sqrt(ex * ex + ey * ey)
    inverse = 1.0 / r
    nx, ny = ex * inverse, ey * inverse
    rate = vx * nx + vy * ny
    curvature = ax * nx + ay * ny + (vy * nx - vx * ny) ** 2 * inverse
    depth = r - joint.clearance
    return contact_conditions(joint, mode, approach, begin, time, depth, rate, curvature)


@inlined
def corner_conditions(joint, mode, approach, begin, time, relative) -> tuple:
    """`conditions` of a corner of a slide; `relative` contains offset and tilt, their rates and
    second rates."""
    offset, tilt, offset_rate, tilt_rate, acceleration, turning = relative
    along, across, depth, rate, side = corner_motion(joint, offset, tilt, offset_rate, tilt_rate)
    curvature = side * (acceleration + along * turning - across * tilt_rate**2)
    if mode == FLIGHT:
        return -depth, -rate, -curvature, 1.0, 0.0
    return contact_conditions(joint, mode, approach, begin, time, depth, rate, curvature)


@inlined
def contact_conditions(joint, mode, approach, begin, time, depth, rate, curvature) -> tuple:
    """`conditions` of a joint that is not in flight, from its penetration and rates."""
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
