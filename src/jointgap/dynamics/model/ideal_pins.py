"""Reactions of ideal pins: the forces under which the accelerations of their bodies do not part.

With J the openings of both pins by the motion of the bodies and M their inertias, forces in the pins open them at
J M^-1 J^T times the forces, and the reactions take back what all else would open. The matrix consists of 2x2 blocks,
one of each pin and one between them; a loose pin has no reaction. Friction of ideal pins, and of a guide that an ideal
pin loads, depends on the reactions in turn: it takes a few rounds.
"""

import math
from typing import NamedTuple

from jointgap.dynamics.compilation import compiled, inlined
from jointgap.dynamics.model.bodies import STILL_SHARE, bending_levers, bodies_under, crank_moment, rod_accelerations
from jointgap.dynamics.model.joint_forces import NOTHING, pin_friction, reaction
from jointgap.dynamics.model.parameters import MOTOR

_ROUNDS, _SETTLED = 200, 1e-13  # relative to the reactions and to the inertia forces of which they are the rest


class _Compliance(NamedTuple):
    """Accelerations by forces in the pins: openings by blocks and their solution, and how the crank gives way.

    With the openings [[A, B], [B^T, D]]: A^-1 (xx, xy, yy), B (xx, xy, yx, yy), A^-1 B and (D - B^T A^-1 B)^-1, where
    an inverse is zero if its pin is loose; for the crank 1 / mass of a loose pivot, 1 / inertia under a motor, and the
    lever (x, y) [m] of the pin's force.
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
    """How everything gives way to forces in the pins."""
    b, c, s = p.bodies, here.rod_cos, here.rod_sin
    # A force on the rod moves all of it by (xx, xy, yy) and turns it by its lever, longer along a rod that bends.
    xx = yy = b.rod_inverse_mass
    xy = along = across = 0.0
    turn = b.rod_inverse_inertia
    if b.rod_angular_frequency != 0.0:
        along, across, inertia = bending_levers(b, bend)
        turn, softer = 1.0 / inertia, xx / STILL_SHARE
        xx, xy, yy = xx * c * c + softer * s * s, (xx - softer) * c * s, xx * s * s + softer * c * c
    near, far = across - b.rod_centre, across + (b.rod_length - b.rod_centre)
    nx, ny, fx, fy = along * c - near * s, along * s + near * c, along * c - far * s, along * s + far * c
    bxx, bxy, byx, byy = xx + turn * nx * fx, xy + turn * nx * fy, xy + turn * ny * fx, yy + turn * ny * fy
    dxx, dxy, dyy = xx + turn * fx * fx + b.slider_inverse_mass, xy + turn * fx * fy, yy + turn * fy * fy
    give = swing = wx = wy = gxx = gxy = gyx = gyy = 0.0
    crank_pin = piston_pin = (0.0, 0.0, 0.0)
    if not p.crank_pin.loose:
        axx, axy, ayy = xx + turn * nx * nx, xy + turn * nx * ny, yy + turn * ny * ny
        if p.crank_pivot.loose:
            give = 1.0 / b.crank_mass
            axx, ayy = axx + give, ayy + give
        if p.drive.kind == MOTOR:
            hx, hy = crank_moment(b, crank)
            wx, wy = give * hy - b.crank_length * crank.sine, b.crank_length * crank.cosine - give * hx
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
    return _Compliance(crank_pin, (bxx, bxy, byx, byy), (gxx, gxy, gyx, gyy), piston_pin, give, swing, (wx, wy))


@inlined
def _closing(solved, opening) -> tuple:
    """Forces in crank pin (x, y) and piston pin (x, y) [N] that take back how the pins open [m/s^2]."""
    (cxx, cxy, cyy), (gxx, gxy, gyx, gyy), (pxx, pxy, pyy) = solved.crank_pin, solved.passed_on, solved.piston_pin
    ax, ay = opening[0], opening[1]
    bx, by = opening[2] - gxx * ax - gyx * ay, opening[3] - gxy * ax - gyy * ay
    fx, fy = -pxx * bx - pxy * by, -pxy * bx - pyy * by
    return -cxx * ax - cxy * ay - gxx * fx - gxy * fy, -cxy * ax - cyy * ay - gyx * fx - gyy * fy, fx, fy


@compiled
def _with_friction(p, crank, here, x, torque, free, loaded, pin, piston, pivot, solved):
    """Accelerations without the reactions, reactions, force on the slider, moments on the rod by friction in its pins.

    Parameters as of `under_reactions`; `free` is its force on the slider, `loaded` the guide's coefficient of friction.
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
        on_piston = piston if p.piston_pin.loose else (0.0, 0.0, 0.0, 0.0, piston_moment, -piston_moment)
        a = bodies_under(p, crank, here, x, torque, force, on_pin, on_piston, pivot)
        g0, g1, g2, g3 = _closing(solved, a)
        change = abs(g0 - f0) + abs(g1 - f1) + abs(g2 - f2) + abs(g3 - f3)
        size = abs(g0) + abs(g1) + abs(g2) + abs(g3) + inertia
        f0, f1, f2, f3 = f0 + share * (g0 - f0), f1 + share * (g1 - f1), f2 + share * (g2 - f2), f3 + share * (g3 - f3)
        if not change > _SETTLED * size:
            return a, (f0, f1, f2, f3), force, pin_moment, piston_moment
        pin_moment = pin_friction(p.crank_pin, f0, f1, here.rod_speed - crank.speed, width)
        piston_moment = pin_friction(p.piston_pin, f2, f3, here.rod_speed, width)
        overshot, before = change > before, change
        if overshot:  # steep friction against the load: again from its beginning, more slowly
            share, before = 0.5 * share, math.inf
            f0 = f1 = f2 = f3 = pin_moment = piston_moment = 0.0
    return a, (math.nan, math.nan, math.nan, math.nan), math.nan, math.nan, math.nan


@inlined
def under_reactions(p, crank, here, x, torque, force, pin, piston, pivot) -> tuple:
    """Accelerations of everything where a pin is ideal, and the forces that belong to them."""
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

    # What the reactions change; an ideal joint does not open by rounding either, but what is not a number stays so.
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
