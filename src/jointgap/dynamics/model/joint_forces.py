"""Forces in the joints: contact with friction, film, reaction of an ideal joint with its friction."""

import math

import numpy as np

from jointgap.dynamics.compilation import compiled, inlined
from jointgap.dynamics.model.film import film_force
from jointgap.dynamics.model.friction import LUGRE, bristle_rate, friction_coefficient
from jointgap.dynamics.model.normal_contact import normal_force

FLIGHT, CONTACT, CLAMPED = (np.int64(mode) for mode in (0, 1, 2))
"""Modes of a joint: apart; in contact; penetrated, but parting so fast that the force, which never pulls, is zero."""

NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inlined
def arms_and_sliding(joint, penetration, swing, body_rate, partner_rate) -> tuple:
    """Levers [m] of the contact point about both centres, sliding speed [m/s] there; `swing` is that of the centres."""
    body_arm = joint.side * joint.body_radius - 0.5 * penetration
    partner_arm = joint.side * joint.partner_radius + 0.5 * penetration
    return body_arm, partner_arm, swing + body_arm * body_rate - partner_arm * partner_rate


@inlined
def joint_force(joint, mode, damping_factor, ex, ey, vx, vy, body_rate, partner_rate, bristle) -> tuple:
    """Force of the partner on the body in a loose joint.

    The bodies touch halfway through their overlap: one common point, so that no angular momentum is lost between them.
    """
    if mode != CONTACT and joint.film_viscosity == 0.0:
        return NOTHING
    normal = tangential = fx = fy = on_body = on_partner = 0.0
    square = ex * ex + ey * ey
    r = math.sqrt(square)
    penetration = r - joint.clearance
    if mode == CONTACT and penetration > 0.0:
        inverse = r * (1.0 / square)  # 1 / r; the division does not wait for the root
        nx, ny = ex * inverse, ey * inverse
        normal = normal_force(joint, penetration, vx * nx + vy * ny, damping_factor)
        body_arm, partner_arm, sliding = arms_and_sliding(
            joint, penetration, vy * nx - vx * ny, body_rate, partner_rate
        )
        # All that does not wait for the normal force first.
        mu = friction_coefficient(joint, sliding, bristle)
        tangential = -normal * mu
        fx, fy = normal * (mu * ny - nx), -normal * (mu * nx + ny)
        on_body, on_partner = -normal * (mu * body_arm), normal * (mu * partner_arm)
    if joint.film_viscosity > 0.0:
        film_x, film_y, film_body, film_partner = film_force(joint, ex, ey, vx, vy, body_rate, partner_rate)
        fx, fy, on_body, on_partner = fx + film_x, fy + film_y, on_body + film_body, on_partner + film_partner
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
    _, _, sliding = arms_and_sliding(joint, penetration, (vy * ex - vx * ey) / r, body_rate, partner_rate)
    return bristle_rate(joint, sliding, bristle)


@compiled
def pin_friction(joint, fx, fy, speed, sign_speed):
    """Moment [N m] on the body by friction in an ideal joint under the reaction (fx, fy): -k r |F| sgn w, w =
    `speed`.
    """
    if joint.pin_friction == 0.0:
        return 0.0
    size = math.sqrt(fx * fx + fy * fy)
    return -joint.pin_friction * joint.pin_radius * size * math.tanh(speed / sign_speed)


@compiled
def reaction(fx, fy, moment):
    """Force in an ideal joint, as `joint_force` has it, with the friction's `moment` [N m] on the body."""
    return math.sqrt(fx * fx + fy * fy), 0.0, fx, fy, moment, -moment
