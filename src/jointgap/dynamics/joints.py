"""Relative motion and forces in the joints, loose and ideal."""

import math
from typing import NamedTuple

import numpy as np

from jointgap.dynamics.bodies import (
    STILL_SHARE,
    bending_levers,
    bodies_under,
    crank_moment,
    rod_accelerations,
)
from jointgap.dynamics.contact import film_force, normal_force
from jointgap.dynamics.friction import LUGRE, bristle_rate, friction_coefficient
from jointgap.dynamics.numba_cache import compiled, inlined
from jointgap.dynamics.parameters import MOTOR

_PIECES = 16


@inlined
def relative_motion(here) -> tuple:
    """Clearance vector and its two rates at crank pin, piston pin and crank pivot, 6 numbers each
    [m, m/s, m/s^2]."""
    y, a, x, b = (
        here.clearance_state,
        here.clearance_rates,
        here.auxiliary_state,
        here.auxiliary_rates,
    )
    return (
        (y[0], y[1], y[4], y[5], a[4], a[5]),
        (y[2], y[3], y[6], y[7], a[6], a[7]),
        (x[0], x[1], x[4], x[5], b[4], b[5]),
    )


@inlined
def clearances(y, x) -> tuple:
    """Clearance vector and its rate at crank pin, piston pin and crank pivot, 4 numbers each [m,
    m/s]."""
    return (y[0], y[1], y[4], y[5]), (y[2], y[3], y[6], y[7]), (x[0], x[1], x[4], x[5])


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


@compiled
def pin_friction(joint, fx, fy, speed, sign_speed):
    """Friction moment [N m] on the body in an ideal joint under the reaction (fx, fy): -k r |F| sgn
    w, w = `speed`."""
    if joint.pin_friction == 0.0:
        return 0.0
    size = math.sqrt(fx * fx + fy * fy)
    return -joint.pin_friction * joint.pin_radius * size * math.tanh(speed / sign_speed)


@compiled
def reaction(fx, fy, moment):
    """Force in an ideal joint, in the form of `joint_force`, with the friction `moment` [N m] on
    the body."""
    return math.sqrt(fx * fx + fy * fy), 0.0, fx, fy, moment, -moment


_ROUNDS, _SETTLED = 200, 1e-13  # iterations; tolerance relative to reactions and inertia forces


class _Compliance(NamedTuple):
    """Compliance of the linkage to forces in the pins: opening accelerations by blocks, their
    inverse, and the crank.

    With the openings [[A, B], [B^T, D]]: A^-1 (xx, xy, yy), B (xx, xy, yx, yy), A^-1 B and (D - B^T
    A^-1 B)^-1, where an inverse is zero for a loose pin; for the crank 1 / mass of a loose pivot, 1
    / inertia under a motor, and the lever (x, y) [m] of the pin force.
    """

    crank_pin: tuple[float, float, float]
    between: tuple[float, float, float, float]
    passed_on: tuple[float, float, float, float]
    piston_pin: tuple[float, float, float]
    give: float
    swing: float
    lever: tuple[float, float]


@inlined
def _inverse(xx, xy, yy) -> tuple:
    """Inverse of a symmetric 2x2 matrix."""
    share = 1.0 / (xx * yy - xy * xy)
    return yy * share, -xy * share, xx * share


@inlined
def _compliance(p, crank, here, bend) -> _Compliance:
    """Compliance of all bodies to forces in the pins."""
    b, c, s = p.bodies, here.rod_cos, here.rod_sin
    # A force on the rod gives the acceleration (xx, xy, yy) and a rotation by its lever, longer for
    # a bending rod.
    xx = yy = b.rod_inverse_mass
    xy = along = across = 0.0
    turn = b.rod_inverse_inertia
    if b.rod_angular_frequency != 0.0:
        along, across, inertia = bending_levers(b, bend)
        turn, softer = 1.0 / inertia, xx / STILL_SHARE
        xx, xy, yy = xx * c * c + softer * s * s, (xx - softer) * c * s, xx * s * s + softer * c * c
    near, far = across - b.rod_centre, across + (b.rod_length - b.rod_centre)
    nx, ny, fx, fy = (
        along * c - near * s,
        along * s + near * c,
        along * c - far * s,
        along * s + far * c,
    )
    bxx, bxy, byx, byy = (
        xx + turn * nx * fx,
        xy + turn * nx * fy,
        xy + turn * ny * fx,
        yy + turn * ny * fy,
    )
    dxx, dxy, dyy = (
        xx + turn * fx * fx + b.slider_inverse_mass,
        xy + turn * fx * fy,
        yy + turn * fy * fy,
    )
    give = swing = wx = wy = gxx = gxy = gyx = gyy = 0.0
    crank_pin = piston_pin = (0.0, 0.0, 0.0)
    if not p.crank_pin.loose:
        axx, axy, ayy = xx + turn * nx * nx, xy + turn * nx * ny, yy + turn * ny * ny
        if p.crank_pivot.loose:
            give = 1.0 / b.crank_mass
            axx, ayy = axx + give, ayy + give
        if p.drive.kind == MOTOR:
            hx, hy = crank_moment(b, crank)
            wx, wy = (
                give * hy - b.crank_length * crank.sine,
                b.crank_length * crank.cosine - give * hx,
            )
            swing = 1.0 / (b.crank_inertia + p.drive.rotor_inertia - give * (hx * hx + hy * hy))
            axx, axy, ayy = axx + swing * wx * wx, axy + swing * wx * wy, ayy + swing * wy * wy
        ixx, ixy, iyy = crank_pin = _inverse(axx, axy, ayy)
        if not p.piston_pin.loose:
            gxx, gxy = ixx * bxx + ixy * byx, ixx * bxy + ixy * byy
            gyx, gyy = ixy * bxx + iyy * byx, ixy * bxy + iyy * byy
            dxx -= bxx * gxx + byx * gyx
            dxy -= bxx * gxy + byx * gyy
            dyy -= bxy * gxy + byy * gyy
    if not p.piston_pin.loose:
        piston_pin = _inverse(dxx, dxy, dyy)
    return _Compliance(
        crank_pin, (bxx, bxy, byx, byy), (gxx, gxy, gyx, gyy), piston_pin, give, swing, (wx, wy)
    )


@inlined
def _closing(solved, opening) -> tuple:
    """Forces in crank pin (x, y) and piston pin (x, y) [N] that cancel the opening of the pins
    [m/s^2]."""
    (cxx, cxy, cyy), (gxx, gxy, gyx, gyy), (pxx, pxy, pyy) = (
        solved.crank_pin,
        solved.passed_on,
        solved.piston_pin,
    )
    ax, ay = opening[0], opening[1]
    bx, by = opening[2] - gxx * ax - gyx * ay, opening[3] - gxy * ax - gyy * ay
    fx, fy = -pxx * bx - pxy * by, -pxy * bx - pyy * by
    return (
        -cxx * ax - cxy * ay - gxx * fx - gxy * fy,
        -cxy * ax - cyy * ay - gyx * fx - gyy * fy,
        fx,
        fy,
    )


@compiled
def _with_friction(p, crank, here, x, torque, free, loaded, pin, piston, pivot, solved):
    """Accelerations without the reactions, reactions, force on the slider, friction moments on the
    rod in its pins.

    Parameters as in `under_reactions`; `free` is its force on the slider, `loaded` the guide's
    coefficient of friction.
    """
    width, weight = p.effects.crank_sign_speed, p.bodies.slider_mass * p.bodies.gravity_y
    loaded *= math.tanh(here.slider_speed / p.effects.slider_sign_speed)
    inertia = p.bodies.crank_length * crank.speed**2 + p.bodies.rod_length * here.rod_speed**2
    inertia *= p.bodies.rod_mass + p.bodies.slider_mass
    share, before = 1.0, math.inf
    f0 = f1 = f2 = f3 = pin_moment = piston_moment = 0.0
    for _ in range(_ROUNDS):
        force = free - loaded * abs(f3 - weight)
        on_pin = pin if p.crank_pin.loose else (0.0, 0.0, 0.0, 0.0, pin_moment, -pin_moment)
        on_piston = (
            piston if p.piston_pin.loose else (0.0, 0.0, 0.0, 0.0, piston_moment, -piston_moment)
        )
        a = bodies_under(p, crank, here, x, torque, force, on_pin, on_piston, pivot)
        g0, g1, g2, g3 = _closing(solved, a)
        change = abs(g0 - f0) + abs(g1 - f1) + abs(g2 - f2) + abs(g3 - f3)
        size = abs(g0) + abs(g1) + abs(g2) + abs(g3) + inertia
        f0, f1, f2, f3 = (
            f0 + share * (g0 - f0),
            f1 + share * (g1 - f1),
            f2 + share * (g2 - f2),
            f3 + share * (g3 - f3),
        )
        if not change > _SETTLED * size:
            return a, (f0, f1, f2, f3), force, pin_moment, piston_moment
        pin_moment = pin_friction(p.crank_pin, f0, f1, here.rod_speed - crank.speed, width)
        piston_moment = pin_friction(p.piston_pin, f2, f3, here.rod_speed, width)
        overshot, before = change > before, change
        if overshot:  # steep friction against the load: restart with stronger damping
            share, before = 0.5 * share, math.inf
            f0 = f1 = f2 = f3 = pin_moment = piston_moment = 0.0
    return a, (math.nan, math.nan, math.nan, math.nan), math.nan, math.nan, math.nan


@inlined
def under_reactions(p, crank, here, x, torque, force, pin, piston, pivot) -> tuple:
    """Accelerations of all bodies where a pin is ideal, and the forces."""
    solved = _compliance(p, crank, here, x[3])
    if not p.crank_pin.loose:
        pin = NOTHING
    if not p.piston_pin.loose:
        piston = NOTHING
    a = bodies_under(p, crank, here, x, torque, force, pin, piston, pivot)
    f0, f1, f2, f3 = _closing(solved, a)
    pin_moment = piston_moment = 0.0
    loaded = 0.0 if p.piston_pin.loose else p.effects.load_friction
    if loaded != 0.0 or p.crank_pin.pin_friction != 0.0 or p.piston_pin.pin_friction != 0.0:
        a, (f0, f1, f2, f3), force, pin_moment, piston_moment = _with_friction(
            p, crank, here, x, torque, force, loaded, pin, piston, pivot, solved
        )

    # Corrections by the reactions; ideal joints stay exactly closed, but NaN is kept.
    ax = ay = 0.0 * f0
    bx = by = 0.0 * f2
    bxx, bxy, byx, byy = solved.between
    if p.crank_pin.loose:
        ax, ay = a[0] + bxx * f2 + bxy * f3, a[1] + byx * f2 + byy * f3
    else:
        pin = reaction(f0, f1, pin_moment)
    if p.piston_pin.loose:
        bx, by = a[2] + bxx * f0 + byx * f1, a[3] + bxy * f0 + byy * f1
    else:
        piston = reaction(f2, f3, piston_moment)
    pivot_x, pivot_y, alpha, bend = a[4], a[5], a[6], a[7]
    if p.switches.free_crank:
        hx, hy = crank_moment(p.bodies, crank)
        change = -solved.swing * (solved.lever[0] * f0 + solved.lever[1] * f1)
        alpha += change
        pivot_x += solved.give * (change * hy - f0)
        pivot_y -= solved.give * (change * hx + f1)
    if p.bodies.rod_angular_frequency != 0.0:
        b, c, s = p.bodies, here.rod_cos, here.rod_sin
        moment = pin[4] + piston[4] + b.rod_centre * (s * pin[2] - c * pin[3])
        moment += (b.rod_length - b.rod_centre) * (c * piston[3] - s * piston[2])
        fx, fy = pin[2] + piston[2], pin[3] + piston[3]
        bend = rod_accelerations(b, c, s, here.rod_speed, x[3], x[7], fx, fy, moment)[3]
    return (ax, ay, bx, by, pivot_x, pivot_y, alpha, bend), pin, piston, force
