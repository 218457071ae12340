"""Forces in all joints, ideal ones included, and the torque of the drive: from the accelerations,
by the balance of each body."""

from collections.abc import Mapping
from typing import NamedTuple

from jointgap.linkage.equations import (
    NOTHING,
    Dynamics,
    JointForce,
    Number,
    Pair,
    across,
    add,
    cross,
    dot,
    negative,
    subtract,
    times,
)
from jointgap.linkage.topology import FRAME, Place


class Balance(NamedTuple):
    """Forces that are needed for a motion."""

    forces: dict[str, Pair]  # By joint: of the partner on the body [N]
    moments: dict[str, Number]  # By slide: of the partner on the body, about its point [N m]
    torque: Number  # Of the drive on the crank [N m]
    on_frame: Pair  # Sum of the forces on the frame [N]


def balance(
    dynamics: Dynamics,
    loose: Mapping[str, JointForce],
    friction: Mapping[str, Number] | None = None,
    along: Mapping[str, Number] | None = None,
) -> Balance:
    """The balance of all bodies.

    Parameters
    ----------
    dynamics : Dynamics
        With accelerations and reactions.
    loose : mapping of str to JointForce
        The forces of the loose joints with which it was made.
    friction : mapping of str to Number, optional
        Moments [N m] on the bodies of ideal joints, with which it was made.
    along : mapping of str to Number, optional
        Forces along slides of moving bodies [N], with which it was made.
    """
    pose, linkage = dynamics.pose, dynamics.linkage
    friction, along = friction or {}, along or {}
    sums: dict[str, tuple[Pair, Number]] = {
        name: (NOTHING, 0.0) for name in (FRAME, *linkage.moving)
    }

    def push(body: str, place: Pair, force: Pair, moment: Number) -> None:
        total, turning = sums[body]
        arm = subtract(place, pose.point(body, None)[0]) if body != FRAME else NOTHING
        sums[body] = add(total, force), turning + cross(arm, force) + moment

    def press(one: Place, other: Place, force: Pair, moments: tuple[Number, Number]) -> None:
        push(one.body, pose.point(*one)[0], force, moments[0])
        push(other.body, pose.point(*other)[0], negative(force), moments[1])

    forces: dict[str, Pair] = {}
    moments: dict[str, Number] = {}
    for joint in linkage.loose:
        force = loose[joint.name]
        forces[joint.name] = force.fx, force.fy
        press(joint.body, joint.partner, forces[joint.name], (force.on_body, force.on_partner))
        if joint.kind == "slide":
            moments[joint.name] = force.on_body
    for name, reaction in dynamics.reactions.items():
        joint = linkage.joints[name]
        if joint.kind == "revolute":
            forces[name] = reaction
            moment = friction.get(name, 0.0)
            press(joint.body, joint.partner, reaction, (moment, -moment))
            continue
        line = pose.turned(joint.partner.body, pose.line(joint))
        forces[name], moments[name] = times(reaction[0], across(line)), reaction[1]
        if name in along:
            forces[name] = add(forces[name], times(along[name], line))
        here = pose.point(*joint.body)[0]
        push(joint.body.body, here, forces[name], reaction[1])
        push(joint.partner.body, here, negative(forces[name]), -reaction[1])
    torque: Number = 0.0
    for body in linkage.moving:
        joint = linkage.joint_with_frame(body)
        total, turning = sums[body]
        parameter = pose.arithmetic.parameter
        mass = parameter(f"{body}.mass", linkage.bodies[body].mass)
        inertia = parameter(f"{body}.inertia", linkage.bodies[body].inertia)
        missing = subtract(
            times(mass, subtract(dynamics.acceleration(body), pose.gravity)),
            total,
        )
        turn = inertia * dynamics.angular_acceleration(body) - turning
        if joint is not None:
            place = pose.point(*joint.place(body))[0]
            turn = turn - cross(subtract(place, pose.point(body, None)[0]), missing)
            if joint.kind == "slide":
                normal = across(pose.turned(FRAME, pose.line(joint)))
                missing = times(dot(normal, missing), normal)
                moments[joint.name] = turn if joint.body.body == body else -turn
            forces[joint.name] = missing if joint.body.body == body else negative(missing)
            total, _ = sums[FRAME]
            sums[FRAME] = subtract(total, missing), 0.0
        if body == linkage.crank:
            torque = turn
    return Balance(forces, moments, torque, sums[FRAME][0])
