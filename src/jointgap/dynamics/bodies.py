"""Accelerations of the bodies under given forces: the rod, rigid or bending, the crank, the
slider."""

import math

from jointgap.dynamics.numba_cache import compiled, inlined
from jointgap.dynamics.parameters import MOTOR

_SHARE = 2.0 / math.pi  # mean of the bending mode sin(pi s / L), of which the mean square is 1/2
STILL_SHARE = 1.0 - 2.0 * _SHARE * _SHARE
"""Share of a bending rod's transverse inertia that the bending mode does not relieve."""


@inlined
def bending_levers(bodies, bend) -> tuple:
    """Levers [m] of a force along and across a bending rod at its mass centre, and its inertia [kg
    m^2]."""
    m, k, beyond = bodies.rod_mass, _SHARE, 0.5 * bodies.rod_length - bodies.rod_centre
    along, across = k * bend, 2.0 * k * k * beyond / STILL_SHARE
    inertia = bodies.rod_inertia + m * (0.5 * bend**2 - 2.0 * k * k * beyond**2)
    inertia -= m * (along**2 + 2.0 * k * k * beyond * across)
    return along, across, inertia


@compiled
def rod_accelerations(bodies, rod_cos, rod_sin, speed, bend, bend_rate, fx, fy, moment):
    """Accelerations of the rod.

    A flexible rod is a uniform beam, pinned at both ends, in its first mode w = q sin(pi s / L),
    with a floating frame through the ends. With the speed v of the frame, the kinetic energy is 1/2
    int rho [(v_t - W w)^2 + (v_n + w')^2] ds; stiffness and damping are those of a mode of the
    given frequency. The Lagrange equations include all terms.
    """
    if bodies.rod_angular_frequency == 0.0:
        ax = fx * bodies.rod_inverse_mass + bodies.gravity_x
        ay = fy * bodies.rod_inverse_mass + bodies.gravity_y
        return ax, ay, moment * bodies.rod_inverse_inertia, 0.0
    m, k, frequency = bodies.rod_mass, _SHARE, bodies.rod_angular_frequency
    beyond = 0.5 * bodies.rod_length - bodies.rod_centre  # from the mass centre to midspan
    along, across = rod_cos * fx + rod_sin * fy, rod_cos * fy - rod_sin * fx
    free = (
        -2.0 * bodies.rod_damping_ratio * frequency * bend_rate - (frequency**2 - speed**2) * bend
    )
    # Substitute bend'' = free - 2 k (a_n + alpha beyond): three equations, of which the first two
    # give a_t and a_n.
    right_t = along + 2.0 * k * m * speed * bend_rate
    right_n = across + k * m * (speed**2 * bend - free)
    right = moment - m * speed * bend * bend_rate - k * m * beyond * free
    tangential, normal, inertia = bending_levers(bodies, bend)
    alpha = (right + tangential * right_t + normal * right_n) / inertia
    at = right_t / m + tangential * alpha
    an = right_n / (m * STILL_SHARE) + normal * alpha
    ax = rod_cos * at - rod_sin * an + bodies.gravity_x
    ay = rod_sin * at + rod_cos * an + bodies.gravity_y
    return ax, ay, alpha, free - 2.0 * k * (an + alpha * beyond)


@inlined
def crank_moment(bodies, crank) -> tuple:
    """First moment of the crank's mass about its pivot end [kg m], x and y."""
    hx = bodies.crank_moment_x * crank.cosine - bodies.crank_moment_y * crank.sine
    return hx, bodies.crank_moment_x * crank.sine + bodies.crank_moment_y * crank.cosine


@compiled
def crank_accelerations(p, crank, torque, pivot, pin):
    """Accelerations of the crank."""
    b, alpha = p.bodies, crank.acceleration
    inertia = b.crank_inertia + p.drive.rotor_inertia
    hx, hy = crank_moment(b, crank)
    # m a + alpha z x h - w^2 h = force,  J alpha + h x a = moment about the pivot end
    fx = pivot[2] - pin[2] + b.crank_mass * b.gravity_x + crank.speed**2 * hx
    fy = pivot[3] - pin[3] + b.crank_mass * b.gravity_y + crank.speed**2 * hy
    moment = torque + pivot[4] + pin[5] + hx * b.gravity_y - hy * b.gravity_x
    moment -= b.crank_length * (crank.cosine * pin[3] - crank.sine * pin[2])
    if not p.crank_pivot.loose:
        return 0.0, 0.0, moment / inertia if p.drive.kind == MOTOR else alpha
    if p.drive.kind == MOTOR:
        moment -= (hx * fy - hy * fx) / b.crank_mass
        alpha = moment / (inertia - (hx * hx + hy * hy) / b.crank_mass)
    return (fx + alpha * hy) / b.crank_mass, (fy - alpha * hx) / b.crank_mass, alpha


@inlined
def bodies_under(p, crank, here, x, torque, force, pin, piston, pivot) -> tuple:
    """Accelerations of all bodies under given forces."""
    b, c, s, speed = p.bodies, here.rod_cos, here.rod_sin, here.rod_speed
    near, far, radius = b.rod_centre, b.rod_length - b.rod_centre, b.crank_length
    pivot_x = pivot_y = 0.0
    alpha2 = crank.acceleration
    if p.switches.free_crank:
        pivot_x, pivot_y, alpha2 = crank_accelerations(p, crank, torque, pivot, pin)
    # Sums start with terms that are available early: each stage of a step waits for the last term.
    moment = (near * s * pin[2] - near * c * pin[3]) + (far * c * piston[3] - far * s * piston[2])
    moment += pin[4] + piston[4]
    ax, ay, alpha, bend = rod_accelerations(
        b, c, s, speed, x[3], x[7], pin[2] + piston[2], pin[3] + piston[3], moment
    )
    slider = b.gravity_x + (force - piston[2]) * b.slider_inverse_mass
    swing, pull = speed * speed * c + alpha * s, alpha * c - speed * speed * s
    turn, square = alpha2 * crank.sine, crank.speed * crank.speed
    pin_x = radius * (turn + square * crank.cosine) - pivot_x
    pin_y = radius * (alpha2 * crank.cosine - square * crank.sine) + pivot_y
    return (
        (ax + pin_x) + near * swing,
        (ay - pin_y) - near * pull,
        (ax - slider) - far * swing,
        ay + far * pull,
        pivot_x,
        pivot_y,
        alpha2,
        bend,
    )
