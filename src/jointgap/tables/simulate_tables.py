"""Tables of the stage simulate."""

from collections.abc import Iterable

from jointgap.joints import JOINT_NUMBERS, JOINTS, PINS
from jointgap.tables.columns import Column, Table


def _clearance(number: int, joint: str, ends: str) -> tuple[Column, ...]:
    r, gamma = f"r{number}", f"gamma{number}"
    undefined = "; null where the centres coincide, as in an ideal joint"
    return (
        Column(r, "m", f"distance of the centres of the {joint} ({ends}); 0 where it is ideal"),
        Column(f"{r}_dot", "m/s", f"first time derivative of {r}", nullable=True),
        Column(f"{r}_ddot", "m/s^2", f"second time derivative of {r}", nullable=True),
        Column(gamma, "rad", f"direction of the vector of length {r}, unwrapped{undefined}", nullable=True),
        Column(f"{gamma}_dot", "rad/s", f"first time derivative of {gamma}{undefined}", nullable=True),
        Column(f"{gamma}_ddot", "rad/s^2", f"second time derivative of {gamma}{undefined}", nullable=True),
    )


def _contact(joint: str, partner: str, body: str) -> tuple[Column, ...]:
    words = joint.replace("_", " ")
    return (
        Column(
            f"{joint}_normal_force", "N", f"force in the {words} along the clearance; size of an ideal one's reaction"
        ),
        Column(f"{joint}_friction_force", "N", f"force in the {words} along the tangent, with sign; 0 in an ideal one"),
        Column(f"{joint}_force_x", "N", f"force of the {partner} on the {body} in the {words}, x"),
        Column(f"{joint}_force_y", "N", f"force of the {partner} on the {body} in the {words}, y"),
    )


TRAJECTORY = Table(
    "trajectory",
    "Motion of the slider-crank at samples uniform in crank angle",
    (
        Column("time", "s", "time since the start"),
        Column("crank_angle", "rad", "crank angle theta2, running on over revolutions"),
        Column("crank_speed", "rad/s", "first time derivative of the crank angle"),
        Column("crank_acceleration", "rad/s^2", "second time derivative of the crank angle"),
        *_clearance(2, "crank pin", "from the crank's pin to the rod's end"),
        *_clearance(3, "piston pin", "from the slider's pin to the rod's end"),
        *_clearance(1, "crank pivot", "from the frame's centre to the crank's"),
        Column("rod_position_x", "m", "mass centre of the rod as if it did not bend, x"),
        Column("rod_position_y", "m", "mass centre of the rod as if it did not bend, y"),
        Column("rod_velocity_x", "m/s", "velocity of the rod's mass centre as if it did not bend, x"),
        Column("rod_velocity_y", "m/s", "velocity of the rod's mass centre as if it did not bend, y"),
        Column("rod_acceleration_x", "m/s^2", "acceleration of the rod's mass centre as if it did not bend, x"),
        Column("rod_acceleration_y", "m/s^2", "acceleration of the rod's mass centre as if it did not bend, y"),
        Column("rod_angle", "rad", "angle theta3 of the rod from +x, crank end to piston end"),
        Column("rod_angular_velocity", "rad/s", "first time derivative of the rod angle"),
        Column("rod_angular_acceleration", "rad/s^2", "second time derivative of the rod angle"),
        Column("rod_deflection", "m", "deflection of the rod at midspan, along its normal; 0 where it is rigid"),
        Column("slider_position", "m", "position of the slider's pin along x"),
        Column("slider_velocity", "m/s", "velocity of the slider"),
        Column("slider_acceleration", "m/s^2", "acceleration of the slider"),
        *_contact("crank_pin", "crank", "rod"),
        *_contact("piston_pin", "slider", "rod"),
        *_contact("crank_pivot", "frame", "crank"),
        *(
            Column(f"{joint}_mode", "", "ideal, flight, impact (the journal hits and rebounds) or contact", "text")
            for joint in JOINTS
        ),
        Column("crank_torque", "N*m", "torque of the drive on the crank, losses of the crank included"),
        Column("guide_force", "N", "normal force of the guide on the slider, +y"),
        Column("guide_moment", "N*m", "moment of the guide on the slider, about its pin"),
        Column("frame_force_x", "N", "force of the crank on the crank pivot's bearing, x"),
        Column("frame_force_y", "N", "force of the crank on the crank pivot's bearing, y"),
        Column("transmission_angle", "rad", "transmission angle mu, equation (10)"),
    ),
)

EVENTS = Table(
    "events",
    "Beginnings and ends of contact in the joints",
    (
        Column("time", "s", "time since the start"),
        Column("crank_angle", "rad", "crank angle theta2, running on over revolutions"),
        Column("joint", "", "crank_pin, piston_pin or crank_pivot", "text"),
        Column("event", "", "impact (contact begins) or separation (contact ends)", "text"),
        Column(
            "approach_speed",
            "m/s",
            "speed of approach along the normal at an impact; null at a separation",
            nullable=True,
        ),
        Column(
            "impulse", "N*s", "impulse of the normal force over the contact that ends; null at an impact", nullable=True
        ),
        Column(
            "peak_force",
            "N",
            "largest normal force of the contact that ends, at the points of the integration (up to 0.1 % below the true peak); null at an impact",
            nullable=True,
        ),
        Column("duration", "s", "time that the contact lasted which ends; null at an impact", nullable=True),
        Column("maxima", "1", "maxima of the penetration in the contact that ends; null at an impact", nullable=True),
    ),
)

_LEARNED = ("r", "gamma", "gamma_dot", "gamma_ddot")


def outputs(loose: Iterable[str]) -> tuple[str, ...]:
    """What networks learn of the joints `loose`, by column of the trajectory, in the paper's order."""
    numbers = sorted(JOINT_NUMBERS[joint] for joint in loose)
    return tuple(
        f"{quantity}{number}{'_' * bool(dots)}{dots}"
        for quantity, _, dots in (kind.partition("_") for kind in _LEARNED)
        for number in numbers
    )


def number_of(output: str) -> int:
    """Number of the joint that an output belongs to: 2 for gamma2_dot."""
    return int(output.partition("_")[0][-1])


OUTPUTS = outputs(PINS)
"""The eight outputs of the paper, whose pins are loose."""
