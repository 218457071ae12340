"""Motion of the two bodies of a joint relative to each other, at one instant and between two."""

import math

from jointgap.dynamics.compilation import compiled, inlined

_PIECES = 16


@inlined
def relative_motion(here) -> tuple:
    """Clearance vector and its two rates at crank pin, piston pin and crank pivot, 6 numbers each [m, m/s, m/s^2]."""
    y, a, x, b = here.clearance_state, here.clearance_rates, here.auxiliary_state, here.auxiliary_rates
    return (
        (y[0], y[1], y[4], y[5], a[4], a[5]),
        (y[2], y[3], y[6], y[7], a[6], a[7]),
        (x[0], x[1], x[4], x[5], b[4], b[5]),
    )


@inlined
def clearances(y, x) -> tuple:
    """Clearance vector and its rate at crank pin, piston pin and crank pivot, 4 numbers each [m, m/s]."""
    return (y[0], y[1], y[4], y[5]), (y[2], y[3], y[6], y[7]), (x[0], x[1], x[4], x[5])


@compiled
def swept_angle(before, after, duration):
    """Angle [rad] through which a clearance vector turns between two instants of one step, whole turns included."""
    x0, y0, x1, y1 = before[0], before[1], after[0], after[1]
    direct = math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
    if abs(direct) < 0.5:
        return direct
    # Perhaps a passage near the centre: follow the cubic Hermite curve.
    total = 0.0
    px, py = x0, y0
    for i in range(1, _PIECES + 1):
        t = i / _PIECES
        start, end = (1.0 + 2.0 * t) * (1.0 - t) ** 2, t * t * (3.0 - 2.0 * t)
        start_rate, end_rate = duration * t * (1.0 - t) ** 2, duration * t * t * (t - 1.0)
        qx = start * x0 + end * x1 + start_rate * before[2] + end_rate * after[2]
        qy = start * y0 + end * y1 + start_rate * before[3] + end_rate * after[3]
        total += math.atan2(px * qy - py * qx, px * qx + py * qy)
        px, py = qx, qy
    return total


@compiled
def turns_after(turns, before, after, duration):
    """Whole turns of a clearance vector after `duration` [s], counted where it passes the negative x-axis.

    Its direction is atan2(y, x) + 2 pi `turns`.
    """
    x0, y0, x1, y1 = before[0], before[1], after[0], after[1]
    along = x0 * x1 + y0 * y1
    if along > 0.0 and along * along > 0.77 * (x0 * x0 + y0 * y0) * (x1 * x1 + y1 * y1):  # within half a radian
        if x0 + x1 >= 0.0 or (y0 < 0.0) == (y1 < 0.0):
            return turns
        return turns + (1.0 if y1 < 0.0 else -1.0)
    if (x0 == 0.0 and y0 == 0.0) or (x1 == 0.0 and y1 == 0.0):
        return turns
    sweep = math.atan2(y0, x0) + swept_angle(before, after, duration) - math.atan2(y1, x1)
    return turns + math.floor(sweep / (2.0 * math.pi) + 0.5)


@inlined
def all_turns(turns, before, after, duration) -> tuple:
    """`turns_after` in all three joints."""
    return (
        turns_after(turns[0], before[0], after[0], duration),
        turns_after(turns[1], before[1], after[1], duration),
        turns_after(turns[2], before[2], after[2], duration),
    )


@compiled
def direction(turns, vector):
    """Unwrapped direction [rad] of a clearance vector, NaN where its length is zero."""
    if vector[0] == 0.0 and vector[1] == 0.0:
        return math.nan
    return math.atan2(vector[1], vector[0]) + 2.0 * math.pi * turns
