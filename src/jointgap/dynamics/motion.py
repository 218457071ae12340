"""Motion of the two bodies of a joint relative to each other, at one instant and between two."""

import math

from jointgap.dynamics.compiled import compiled
from jointgap.dynamics.equations import clearance_vectors
from jointgap.dynamics.integrator import rates

_PIECES = 16


@compiled
def resolution(p):
    """Distance [m] below which two joint centres count as coincident: what rounding leaves of positions."""
    return 1e-15 * (p.crank_length + p.rod_to_crank_end + p.rod_to_piston_end)


@compiled
def directions(p, time, rod_angle):
    """Cosine and sine of crank and rod angle."""
    crank_angle = p.start_angle + p.speed * time
    return math.cos(crank_angle), math.sin(crank_angle), math.cos(rod_angle), math.sin(rod_angle)


@compiled
def relative_motion(p, angles, y, slope):
    """Clearance vector, rate and second rate of both joints, 6 numbers each."""
    a, b, c = p.rod_to_crank_end, p.rod_to_piston_end, p.crank_length * p.speed**2
    crank_cos, crank_sin, rod_cos, rod_sin = angles
    pin, piston = clearance_vectors(p, crank_cos, crank_sin, rod_cos, rod_sin, y[0], y[1], y[3], y[4], y[5], y[6], y[7])
    square, alpha = y[6] * y[6], slope[6]
    pin_x = slope[4] + a * (alpha * rod_sin + square * rod_cos) + c * crank_cos
    pin_y = slope[5] - a * (alpha * rod_cos - square * rod_sin) + c * crank_sin
    piston_x = slope[4] - b * (alpha * rod_sin + square * rod_cos) - slope[7]
    piston_y = slope[5] + b * (alpha * rod_cos - square * rod_sin)
    return pin + (pin_x, pin_y), piston + (piston_x, piston_y)


@compiled
def slope_of(p, angles, y, modes, approaches, slope):
    """Write the time derivative of state `y` into `slope`."""
    slope[:4] = y[4:]
    slope[4], slope[5], slope[6], slope[7] = rates(
        p, angles, 0.0, y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7], y[2], modes, approaches
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
