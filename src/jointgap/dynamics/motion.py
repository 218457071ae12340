"""Motion of the two bodies of a joint relative to each other, at one instant and between two."""

import math

from jointgap.dynamics.compiled import compiled, inlined

_PIECES = 16


@inlined
def relative_motion(here):
    """Clearance vector, rate and second rate of crank pin, piston pin and crank pivot, 6 numbers each [m, m/s, m/s^2]."""
    y, a, x, b = here.y, here.slope, here.x, here.further_slope
    return (
        (y[0], y[1], y[4], y[5], a[4], a[5]),
        (y[2], y[3], y[6], y[7], a[6], a[7]),
        (x[0], x[1], x[4], x[5], b[4], b[5]),
    )


@compiled
def swept_angle(before, after, duration):
    """Angle [rad] through which a clearance vector turns between two instants of one step, whole turns included.

    Parameters
    ----------
    before, after : tuples of 6 floats
        Clearance vector, rate and second rate at both instants.
    duration : float
        Time between them [s].
    """
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
def direction(angle, before, after, duration):
    """Unwrapped direction [rad] of a clearance vector after `duration`, NaN where its length is zero.

    `angle` is the direction before; NaN (not known yet) starts afresh within (-pi, pi].
    """
    if after[0] == 0.0 and after[1] == 0.0:
        return math.nan
    if math.isnan(angle):
        return math.atan2(after[1], after[0])
    return angle + swept_angle(before, after, duration)


@inlined
def directions(angles, before, after, duration):
    """`direction` in all three joints."""
    return (
        direction(angles[0], before[0], after[0], duration),
        direction(angles[1], before[1], after[1], duration),
        direction(angles[2], before[2], after[2], duration),
    )
