"""Equations of motion of the slider-crank, whichever of its joints are loose.

State: the clearance vectors of crank pin and piston pin and their rates, eight numbers; zero for good where the joint
is ideal. Everything else follows from them and from the crank angle. The clearance vectors themselves, not the
positions of the bodies: a clearance is a thousandth of a length, and so is the rounding.

Auxiliary states, all constant unless the mechanism has them: clearance vector of the crank pivot, crank angle of a
motor, deflection of a flexible rod; the rates of these four; a bristle for each joint with LuGre friction.

In each joint the clearance vector runs from the partner's centre (crank, slider, frame) to the body's (rod, rod,
crank); its length is r, the normal points along it, the tangent is the normal turned by +90 degrees.

Reactions of ideal pins are the forces under which their bodies do not part. The accelerations depend linearly on the
forces: those of ideal pins follow from one small system of equations; where friction depends on them in turn, from a
few rounds of it.
"""

import math
from typing import NamedTuple

import numpy as np

from jointgap.dynamics.compilation import compiled, inlined
from jointgap.dynamics.model.bodies import bodies_under
from jointgap.dynamics.model.effect_laws import crank_losses, motor_torque, slider_force
from jointgap.dynamics.model.joint_forces import NOTHING, bristle_motion, joint_force, pin_friction, reaction

STATES, AUXILIARY_STATES = 8, 11
"""How many states there are, and how many auxiliary ones."""


class Crank(NamedTuple):
    """Motion of the crank: cosine and sine of its angle, speed [rad/s], acceleration [rad/s^2] where prescribed."""

    cosine: float
    sine: float
    speed: float
    acceleration: float


class Pose(NamedTuple):
    """Rod and slider at an instant: direction and angular velocity of the rod, position and velocity of the slider."""

    rod_cos: float
    rod_sin: float
    rod_speed: float
    slider: float
    slider_speed: float


@inlined
def pose(bodies, crank, y, x) -> Pose:
    """Where rod and slider are, from the clearance vectors.

    Parameters
    ----------
    bodies : BodyParameters
    crank : Crank
    y, x : tuples of 8 and 11 floats
        Clearance state and auxiliary state.
    """
    length, inverse = bodies.rod_length, bodies.rod_inverse_length
    end_y = bodies.crank_length * crank.sine + y[1] + x[1]
    end_vy = bodies.crank_length * crank.speed * crank.cosine + y[5] + x[5]
    s = (bodies.slider_offset + y[3] - end_y) * inverse
    square = 1.0 - s * s
    c = math.sqrt(square)
    speed = (y[7] - end_vy) * inverse * (c * (1.0 / square))  # over c; the division does not wait for the root
    end_x = bodies.crank_length * crank.cosine + y[0] + x[0]
    end_vx = y[4] + x[4] - bodies.crank_length * crank.speed * crank.sine
    return Pose(c, s, speed, end_x + length * c - y[2], end_vx - length * speed * s - y[6])


@inlined
def accelerations(p, time, crank_angle, crank, y, x, modes, damping) -> tuple:
    """All accelerations at a state, and the forces behind them.

    Parameters
    ----------
    p : Parameters
    time, crank_angle : float
        [s], [rad].
    crank : Crank
    y, x : tuples of 8 and 11 floats
        State and auxiliary states.
    modes, damping : tuples of 3
        Modes of crank pin, piston pin and crank pivot, chi / d'_0 [s/m] of their contacts.

    Returns
    -------
    tuple
        Accelerations as `bodies_under` has them; forces in crank pin, piston pin, crank pivot; torque of motor and
        losses on the crank [N m], force on the slider [N]; rates of the bristles (3).
    """
    here = pose(p.bodies, crank, y, x)
    pin = joint_force(p.crank_pin, modes[0], damping[0], y[0], y[1], y[4], y[5], here.rod_speed, crank.speed, x[8])
    piston = joint_force(p.piston_pin, modes[1], damping[1], y[2], y[3], y[6], y[7], here.rod_speed, 0.0, x[9])
    pivot = NOTHING
    torque = force = 0.0
    bristles = (0.0, 0.0, 0.0)
    if p.switches.auxiliary:
        if p.crank_pivot.loose:
            pivot = joint_force(p.crank_pivot, modes[2], damping[2], x[0], x[1], x[4], x[5], crank.speed, 0.0, x[10])
        if p.switches.bristles:
            w, turn = here.rod_speed, crank.speed
            bristles = (
                bristle_motion(p.crank_pin, modes[0], y[0], y[1], y[4], y[5], w, turn, x[8]),
                bristle_motion(p.piston_pin, modes[1], y[2], y[3], y[6], y[7], w, 0.0, x[9]),
                bristle_motion(p.crank_pivot, modes[2], x[0], x[1], x[4], x[5], turn, 0.0, x[10]),
            )
    if p.switches.free_crank:
        torque = motor_torque(p.drive, crank.speed)
        torque += crank_losses(p, here.slider, here.slider_speed, crank.speed, crank_angle, time)
    if p.effects.on_slider:
        guide = piston[3] - p.bodies.slider_mass * p.bodies.gravity_y
        force = slider_force(p, guide, here.slider, here.slider_speed, crank.speed, crank_angle, time)
    if p.switches.constrained:
        return _constrained(p, time, crank_angle, crank, here, x, torque, pin, piston, pivot, bristles)
    return (
        bodies_under(p, crank, here, x, torque, force, pin, piston, pivot),
        pin,
        piston,
        pivot,
        torque,
        force,
        bristles,
    )


_PROBE = 1e8  # N: a force beside which inertia and weight are small, so that little is lost in the difference
_ROUNDS, _SETTLED = 200, 1e-13  # relative to the reactions and to the inertia forces of which they are the rest


@compiled
def _constrained(p, time, crank_angle, crank, here, x, torque, pin, piston, pivot, bristles):
    """What `accelerations` returns where a pin is ideal.

    Parameters
    ----------
    p, time, crank_angle, crank, x
        As there.
    here : Pose
    torque : float
        On the crank, where it is free [N m].
    pin, piston, pivot, bristles : tuples
        Forces in the joints that are loose, rates of the bristles.
    """
    first, last = 2 * p.crank_pin.loose, 4 - 2 * p.piston_pin.loose
    base = bodies_under(p, crank, here, x, torque, 0.0, pin, piston, pivot)
    matrix = np.empty((4, 4))
    for column in range(first, last):
        fx, fy = (_PROBE, 0.0) if column % 2 == 0 else (0.0, _PROBE)
        on_pin, on_piston = (reaction(fx, fy, 0.0), piston) if column < 2 else (pin, reaction(fx, fy, 0.0))
        probed = bodies_under(p, crank, here, x, torque, 0.0, on_pin, on_piston, pivot)
        for row in range(first, last):
            matrix[row, column] = (probed[row] - base[row]) / _PROBE
    _factorise(matrix, first, last)

    forces, weight = np.zeros(4), p.bodies.slider_mass * p.bodies.gravity_y
    force = pin_moment = piston_moment = 0.0
    width, share, before = p.effects.crank_sign_speed, 1.0, math.inf
    inertia = p.bodies.crank_length * crank.speed**2 + p.bodies.rod_length * here.rod_speed**2
    inertia *= p.bodies.rod_mass + p.bodies.slider_mass
    for _ in range(_ROUNDS):
        if p.effects.on_slider:
            guide = (piston[3] if p.piston_pin.loose else forces[3]) - weight
            force = slider_force(p, guide, here.slider, here.slider_speed, crank.speed, crank_angle, time)
        on_pin = pin if p.crank_pin.loose else reaction(0.0, 0.0, pin_moment)
        on_piston = piston if p.piston_pin.loose else reaction(0.0, 0.0, piston_moment)
        base = bodies_under(p, crank, here, x, torque, force, on_pin, on_piston, pivot)
        change = size = 0.0
        solved = _solve(matrix, first, last, base)
        for row in range(first, last):
            change += abs(solved[row] - forces[row])
            size += abs(solved[row])
            forces[row] = solved[row] if share == 1.0 else forces[row] + share * (solved[row] - forces[row])
        pin_moment = pin_friction(p.crank_pin, forces[0], forces[1], here.rod_speed - crank.speed, width)
        piston_moment = pin_friction(p.piston_pin, forces[2], forces[3], here.rod_speed, width)
        if not change > _SETTLED * (size + inertia):
            break
        before, overshot = change, change > before
        if overshot:  # steep friction against the load: again from its beginning, more slowly
            share, before, forces[:], pin_moment, piston_moment = 0.5 * share, math.inf, 0.0, 0.0, 0.0
    else:
        force = math.nan  # friction holds itself: no motion obeys the equations
    if not p.crank_pin.loose:
        pin = reaction(forces[0], forces[1], pin_moment)
    if not p.piston_pin.loose:
        piston = reaction(forces[2], forces[3], piston_moment)
    a = bodies_under(p, crank, here, x, torque, force, pin, piston, pivot)
    # An ideal joint does not open by rounding either; but what is not a number stays so.
    ax, ay = (a[0], a[1]) if p.crank_pin.loose else (0.0 * a[0], 0.0 * a[1])
    bx, by = (a[2], a[3]) if p.piston_pin.loose else (0.0 * a[2], 0.0 * a[3])
    return (ax, ay, bx, by, a[4], a[5], a[6], a[7]), pin, piston, pivot, torque, force, bristles


@compiled
def _factorise(matrix, first, last):
    """Replace the rows and columns first ... last of a positive definite matrix by its triangular factors L D L^T.

    Parameters
    ----------
    matrix : (4, 4) array
        Changed in place.
    first, last : int
        Rows that count: first ... last - 1.
    """
    for i in range(first, last):
        for j in range(first, i):
            share = matrix[i, j]
            for k in range(first, j):
                share -= matrix[i, k] * matrix[k, k] * matrix[j, k]
            matrix[i, j] = share / matrix[j, j]
        for k in range(first, i):
            matrix[i, i] -= matrix[i, k] ** 2 * matrix[k, k]


@compiled
def _solve(factors, first, last, right):
    """Solution (4,) of matrix * solution = -right from the matrix's factorised form.

    Parameters
    ----------
    factors : (4, 4) array
        Factorised matrix.
    first, last : int
        Rows that count: first ... last - 1.
    right : tuple of 4 floats or more
    """
    solution = np.zeros(4)
    for i in range(first, last):
        solution[i] = -right[i]
        for k in range(first, i):
            solution[i] -= factors[i, k] * solution[k]
    for i in range(last - 1, first - 1, -1):
        solution[i] /= factors[i, i]
        for k in range(i + 1, last):
            solution[i] -= factors[k, i] * solution[k]
    return solution
