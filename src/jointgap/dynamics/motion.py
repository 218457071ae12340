"""Motion of the two bodies of a joint relative to each other, at one instant and between two."""

import math

from jointgap.dynamics.compiled import compiled
from jointgap.dynamics.equations import clearance_vectors

_PIECES = 16


@compiled
def resolution(p):
    """Distance [m] below which two joint centres count as coincident: what rounding leaves of positions."""
    return 1e-15 * (p.crank_length + p.rod_to_crank_end + p.rod_to_piston_end)


@compiled
def relative_motion(p, here):
    """Clearance vector, rate and second rate of crank pin and piston pin, 6 numbers each [m, m/s, m/s^2]."""
    y, slope, rod_cos, rod_sin = here.y, here.slope, here.rod_cos, here.rod_sin
    a, b, c = p.rod_to_crank_end, p.rod_to_piston_end, p.crank_length * p.speed**2
    pin, piston = clearance_vectors(p, here.crank_cos, here.crank_sin, rod_cos, rod_sin, y)
    square, alpha = y[6] * y[6], slope[6]
    pin_x = slope[4] + a * (alpha * rod_sin + square * rod_cos) + c * here.crank_cos
    pin_y = slope[5] - a * (alpha * rod_cos - square * rod_sin) + c * here.crank_sin
    piston_x = slope[4] - b * (alpha * rod_sin + square * rod_cos) - slope[7]
    piston_y = slope[5] + b * (alpha * rod_cos - square * rod_sin)
    return pin + (pin_x, pin_y), piston + (piston_x, piston_y)


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
def direction(angle, before, after, duration, least):
    """Unwrapped direction [rad] of a clearance vector after `duration`, NaN where it is no longer than `least`.

    `angle` is the direction before; NaN (not known yet) starts afresh within (-pi, pi].
    """
    if math.hypot(after[0], after[1]) <= least:
        return math.nan
    if math.isnan(angle):
        return math.atan2(after[1], after[0])
    return angle + swept_angle(before, after, duration)
