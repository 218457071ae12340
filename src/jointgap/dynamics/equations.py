"""Equations of motion of the slider-crank with a prescribed crank and two loose joints, explicit in eight states.

State: rod's mass centre x, y [m], rod angle [rad], slider x [m], and their rates. In each loose joint the clearance
vector runs from the partner's centre (crank's pin, slider's pin) to the rod's end; its length is r, the normal points
along it, the tangent is the normal turned by +90 degrees.
"""

import math

import numpy as np

from jointgap.dynamics.compiled import compiled
from jointgap.dynamics.contact import normal_force
from jointgap.dynamics.friction import friction_coefficient

FLIGHT, CONTACT, CLAMPED = (np.int64(mode) for mode in (0, 1, 2))
"""Modes of a joint: apart; in contact; penetrated, but parting so fast that the force, which never pulls, is zero."""

STATES = 8

SIN_3, SIN_5, SIN_7, SIN_9 = (1 / math.factorial(n) for n in (3, 5, 7, 9))
COS_4, COS_6, COS_8, COS_10 = (1 / math.factorial(n) for n in (4, 6, 8, 10))


@compiled
def turned(cosine, sine, angle):
    """Cosine and sine of an angle further on by `angle` [rad] than the one with the given `cosine` and `sine`."""
    if abs(angle) > 0.1:
        c, s = math.cos(angle), math.sin(angle)
    else:  # Taylor polynomials, exact to the last digit here and many times faster than the library's functions
        q = angle * angle
        q2 = q * q
        s = angle + angle * q * ((q * SIN_5 - SIN_3) + q2 * (q * SIN_9 - SIN_7))
        c = 1.0 + q * ((q * COS_4 - 0.5) + q2 * ((q * COS_8 - COS_6) - q2 * COS_10))
    return cosine * c - sine * s, sine * c + cosine * s


@compiled
def clearance_vectors(p, crank_cos, crank_sin, rod_cos, rod_sin, state):
    """Clearance vectors of both joints and their rates: (e2x, e2y, v2x, v2y), (e3x, e3y, v3x, v3y) [m, m/s]."""
    x, y, _, slider, vx, vy, rate, slider_speed = state
    a, b, c, w = p.rod_to_crank_end, p.rod_to_piston_end, p.crank_length, p.speed
    pin = (
        x - a * rod_cos - c * crank_cos,
        y - a * rod_sin - c * crank_sin,
        vx + a * rate * rod_sin + c * w * crank_sin,
        vy - a * rate * rod_cos - c * w * crank_cos,
    )
    piston = (
        x + b * rod_cos - slider,
        y + b * rod_sin - p.slider_offset,
        vx - b * rate * rod_sin - slider_speed,
        vy + b * rate * rod_cos,
    )
    return pin, piston


@compiled
def joint_force(joint, mode, hysteresis, vector, rod_rate, partner_rate):
    """Force of the partner on the rod in one joint.

    The bodies touch halfway through their overlap: one common point, so that no angular momentum is lost between them.

    Parameters
    ----------
    joint : JointParameters
    mode, hysteresis
        Mode of the joint and chi / d'_0 [s/m] of its contact.
    vector : tuple of 4 floats
        Clearance vector and its rate.
    rod_rate, partner_rate
        Angular velocities [rad/s] of the two bodies.

    Returns
    -------
    tuple of 6 floats
        Normal force (pushing, >= 0 but for rounding), friction force along the tangent, x, y [N]; moments of the
        friction about the rod's end on the rod and about the partner's centre on the partner [N m].
    """
    ex, ey, vx, vy = vector
    if mode != CONTACT:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    r = math.sqrt(ex * ex + ey * ey)
    penetration = r - joint.clearance
    if penetration <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    inverse = 1.0 / r
    nx, ny = ex * inverse, ey * inverse
    normal = normal_force(penetration, vx * nx + vy * ny, hysteresis, joint.stiffness, joint.exponent)
    rod_arm = joint.side * joint.rod_radius - 0.5 * penetration
    partner_arm = joint.side * joint.partner_radius + 0.5 * penetration
    sliding = vy * nx - vx * ny + rod_arm * rod_rate - partner_arm * partner_rate
    tangential = normal * friction_coefficient(-sliding, joint.friction, joint.friction_speed)
    fx = -normal * nx - tangential * ny
    fy = -normal * ny + tangential * nx
    return normal, tangential, fx, fy, rod_arm * tangential, -partner_arm * tangential


@compiled
def accelerations(p, rod_cos, rod_sin, pin, piston):
    """Accelerations of rod (x, y [m/s^2], angle [rad/s^2]) and slider [m/s^2] under the forces of both joints."""
    ax = (pin[2] + piston[2]) * p.rod_inverse_mass + p.gravity_x
    ay = (pin[3] + piston[3]) * p.rod_inverse_mass + p.gravity_y
    moment = (
        pin[4]
        + piston[4]
        - p.rod_to_crank_end * (rod_cos * pin[3] - rod_sin * pin[2])
        + p.rod_to_piston_end * (rod_cos * piston[3] - rod_sin * piston[2])
    )
    return ax, ay, moment * p.rod_inverse_inertia, p.gravity_x - piston[2] * p.slider_inverse_mass
