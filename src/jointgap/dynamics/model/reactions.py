"""Reactions of ideal pins: the forces under which their bodies do not part.

The accelerations depend linearly on the forces. Those of ideal pins follow from one small system of equations; where
friction depends on them in turn, from a few rounds of it.
"""

import math

import numpy as np

from jointgap.dynamics.compilation import compiled
from jointgap.dynamics.model.bodies import bodies_under
from jointgap.dynamics.model.effect_laws import slider_force
from jointgap.dynamics.model.joint_forces import pin_friction, reaction

_PROBE = 1e8  # N: a force beside which inertia and weight are small, so that little is lost in the difference
_ROUNDS, _SETTLED = 200, 1e-13  # relative to the reactions and to the inertia forces of which they are the rest


@compiled
def constrained(p, time, crank_angle, crank, here, x, torque, pin, piston, pivot, bristles):
    """What `jointgap.dynamics.model.equations.accelerations` returns where a pin is ideal.

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
    factorise(matrix, first, last)

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
        solved = solve(matrix, first, last, base)
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
def factorise(matrix, first, last):
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
def solve(factors, first, last, right):
    """Solution (4,) of matrix * solution = -right from the matrix's `factorise`d form.

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
