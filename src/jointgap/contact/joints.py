"""Relative motion and forces in revolute joints and at the corners of slides."""

import math

import numpy as np

from jointgap.contact.friction import LUGRE, bristle_rate, friction_coefficient
from jointgap.contact.normal_force import film_force, normal_force
from jointgap.core.numba_cache import compiled, inlined

_PIECES = 16


@compiled
def swept_angle(before, after, duration):
    """Angle [rad] by which a clearance vector turns between two instants of one step, whole turns
    included."""
    x0, y0, x1, y1 = before[0], before[1], after[0], after[1]
    direct = math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
    if abs(direct) < 0.5:
        return direct
    # possibly a passage near the centre: follow the cubic Hermite curve
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
    """Whole turns of a clearance vector after `duration` [s], counted at its passages of the
    negative x-axis.

    Its direction is atan2(y, x) + 2 pi `turns`.
    """
    x0, y0, x1, y1 = before[0], before[1], after[0], after[1]
    along = x0 * x1 + y0 * y1
    if along > 0.0 and along * along > 0.77 * (x0 * x0 + y0 * y0) * (
        x1 * x1 + y1 * y1
    ):  # within half a radian
        if x0 + x1 >= 0.0 or (y0 < 0.0) == (y1 < 0.0):
            return turns
        return turns + (1.0 if y1 < 0.0 else -1.0)
    if (x0 == 0.0 and y0 == 0.0) or (x1 == 0.0 and y1 == 0.0):
        return turns
    sweep = math.atan2(y0, x0) + swept_angle(before, after, duration) - math.atan2(y1, x1)
    return turns + math.floor(sweep / (2.0 * math.pi) + 0.5)


@compiled
def direction(turns, vector):
    """Unwrapped direction [rad] of a clearance vector, NaN for length zero."""
    if vector[0] == 0.0 and vector[1] == 0.0:
        return math.nan
    return math.atan2(vector[1], vector[0]) + 2.0 * math.pi * turns


FLIGHT, CONTACT, FORCE_FREE = (np.int64(mode) for mode in (0, 1, 2))
"""Modes of a joint: apart; in contact; penetrated without force, because an attractive force is
replaced by zero."""

NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inlined
def arms_and_sliding(joint, penetration, swing, body_rate, partner_rate) -> tuple:
    """Levers [m] of the contact point about both centres, and sliding speed [m/s]; `swing`: that of
    the centres."""
    body_arm = joint.side * joint.body_radius - 0.5 * penetration
    partner_arm = joint.side * joint.partner_radius + 0.5 * penetration
    return body_arm, partner_arm, swing + body_arm * body_rate - partner_arm * partner_rate


@inlined
def joint_force(
    joint, mode, damping_factor, ex, ey, vx, vy, body_rate, partner_rate, bristle
) -> tuple:
    """Force of the partner on the body in a loose joint.

    The contact point is in the middle of the overlap for both bodies, which conserves angular
    momentum.
    """
    if mode != CONTACT and joint.film_viscosity == 0.0:
        return NOTHING
    normal = tangential = fx = fy = on_body = on_partner = 0.0
    square = ex * ex + ey * ey
    r = math.sqrt(square)
    penetration = r - joint.clearance
    if mode == CONTACT and penetration > 0.0:
        inverse = r * (1.0 / square)  # 1 / r; this division is independent of the root
        nx, ny = ex * inverse, ey * inverse
        normal = normal_force(joint, penetration, vx * nx + vy * ny, damping_factor)
        body_arm, partner_arm, sliding = arms_and_sliding(
            joint, penetration, vy * nx - vx * ny, body_rate, partner_rate
        )
        # first everything that is independent of the normal force
        mu = friction_coefficient(joint, sliding, bristle)
        tangential = -normal * mu
        fx, fy = normal * (mu * ny - nx), -normal * (mu * nx + ny)
        on_body, on_partner = -normal * (mu * body_arm), normal * (mu * partner_arm)
    if joint.film_viscosity > 0.0:
        film_x, film_y, film_body, film_partner = film_force(
            joint, ex, ey, vx, vy, body_rate, partner_rate
        )
        fx, fy, on_body, on_partner = (
            fx + film_x,
            fy + film_y,
            on_body + film_body,
            on_partner + film_partner,
        )
        if r > 0.0:
            normal, tangential = -(fx * ex + fy * ey) / r, (fy * ex - fx * ey) / r
    return normal, tangential, fx, fy, on_body, on_partner


@compiled
def bristle_motion(joint, mode, ex, ey, vx, vy, body_rate, partner_rate, bristle):
    """Rate [m/s] of the bristles' deflection [m]; arguments as in `joint_force`."""
    if joint.friction_law != LUGRE or mode == FLIGHT:
        return 0.0
    r = math.sqrt(ex * ex + ey * ey)
    penetration = r - joint.clearance
    _, _, sliding = arms_and_sliding(
        joint, penetration, (vy * ex - vx * ey) / r, body_rate, partner_rate
    )
    return bristle_rate(joint, sliding, bristle)


@inlined
def corner_motion(joint, offset, tilt, offset_rate, tilt_rate) -> tuple:
    """A corner of a slide: place along and across the slide from the body's point [m], penetration
    of its wall [m], its rate [m/s], and the sign of its side."""
    c, s = math.cos(tilt), math.sin(tilt)
    along = c * joint.corner_x - s * joint.corner_y
    across = s * joint.corner_x + c * joint.corner_y
    side = math.copysign(1.0, joint.corner_y)
    depth = side * (offset + across) - joint.clearance
    return along, across, depth, side * (offset_rate + along * tilt_rate), side


@inlined
def corner_force(
    joint, mode, damping_factor, offset, tilt, offset_rate, tilt_rate, speed, bristle
) -> tuple:
    """Normal force of a wall on a corner, and force along and across the slide and moment about the
    body's point; `speed` is that along the slide."""
    if mode != CONTACT:
        return 0.0, 0.0, 0.0, 0.0
    along, across, depth, rate, side = corner_motion(joint, offset, tilt, offset_rate, tilt_rate)
    if depth <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    normal = normal_force(joint, depth, rate, damping_factor)
    rubbing = -normal * friction_coefficient(joint, speed - across * tilt_rate, bristle)
    pushing = -side * normal
    return normal, rubbing, pushing, along * pushing - across * rubbing


@inlined
def corner_bristle_motion(joint, mode, tilt, tilt_rate, speed, bristle) -> float:
    """Rate [m/s] of the deflection [m] of a corner's bristles; arguments as in `corner_force`."""
    if joint.friction_law != LUGRE or mode == FLIGHT:
        return 0.0
    across = math.sin(tilt) * joint.corner_x + math.cos(tilt) * joint.corner_y
    return bristle_rate(joint, speed - across * tilt_rate, bristle)
