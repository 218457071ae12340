"""Equations of motion of the slider-crank, whichever of its joints are loose.

State: the clearance vectors of crank pin and piston pin and their rates, eight numbers; zero for good where the joint
is ideal. Everything else follows from them and from the crank angle. The clearance vectors themselves, not the
positions of the bodies: a clearance is a thousandth of a length, and so is the rounding.

Auxiliary states, all constant unless the mechanism has them: clearance vector of the crank pivot, crank angle of a
motor, deflection of a flexible rod; the rates of these four; a bristle for each joint with LuGre friction.

In each joint the clearance vector runs from the partner's centre (crank, slider, frame) to the body's (rod, rod,
crank); its length is r, the normal points along it, the tangent is the normal turned by +90 degrees.

Reactions of ideal pins are the forces under which their bodies do not part: see `jointgap.dynamics.model.ideal_pins`.
"""

import math
from typing import NamedTuple

from jointgap.dynamics.compilation import inlined
from jointgap.dynamics.model.bodies import bodies_under
from jointgap.dynamics.model.effect_laws import crank_losses, motor_torque, slider_force
from jointgap.dynamics.model.ideal_pins import under_reactions
from jointgap.dynamics.model.joint_forces import NOTHING, bristle_motion, joint_force
from jointgap.dynamics.model.parameters import MOTOR

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
    """Where rod and slider are, from the clearance vectors."""
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
    """All accelerations at a state, and the forces behind them."""
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
    if p.drive.kind == MOTOR:
        torque = motor_torque(p.drive, crank.speed)
        torque += crank_losses(p, here.slider, here.slider_speed, crank.speed, crank_angle, time)
    if p.effects.on_slider:
        # Of an ideal piston pin's guide the force is not known yet: what it rubs is added with the reactions.
        guide = piston[3] - p.bodies.slider_mass * p.bodies.gravity_y if p.piston_pin.loose else 0.0
        force = slider_force(p, guide, here.slider, here.slider_speed, crank.speed, crank_angle, time)
    if p.switches.constrained:
        found, pin, piston, force = under_reactions(p, crank, here, x, torque, force, pin, piston, pivot)
        return found, pin, piston, pivot, torque, force, bristles
    return (
        bodies_under(p, crank, here, x, torque, force, pin, piston, pivot),
        pin,
        piston,
        pivot,
        torque,
        force,
        bristles,
    )
