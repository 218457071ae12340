"""Tables of the stage simulate."""

from jointgap.tables.columns import Column, Table


def _clearance(number: int, joint: str, ends: str) -> tuple[Column, ...]:
    r, gamma = f"r{number}", f"gamma{number}"
    undefined = "; null where the centres coincide"
    return (
        Column(r, "m", f"distance of the centres of the {joint} ({ends})"),
        Column(f"{r}_dot", "m/s", f"first time derivative of {r}", nullable=True),
        Column(f"{r}_ddot", "m/s^2", f"second time derivative of {r}", nullable=True),
        Column(gamma, "rad", f"direction of the vector of length {r}, unwrapped{undefined}", nullable=True),
        Column(f"{gamma}_dot", "rad/s", f"first time derivative of {gamma}{undefined}", nullable=True),
        Column(f"{gamma}_ddot", "rad/s^2", f"second time derivative of {gamma}{undefined}", nullable=True),
    )


def _contact(joint: str, carrier: str) -> tuple[Column, ...]:
    words = joint.replace("_", " ")
    return (
        Column(f"{joint}_normal_force", "N", f"contact force in the {words}, along the clearance, 0 in flight"),
        Column(f"{joint}_friction_force", "N", f"friction force in the {words}, along the tangent, with sign"),
        Column(f"{joint}_force_x", "N", f"force of the {carrier} on the rod in the {words}, x"),
        Column(f"{joint}_force_y", "N", f"force of the {carrier} on the rod in the {words}, y"),
    )


TRAJECTORY = Table(
    "trajectory",
    "Motion of the slider-crank at samples uniform in crank angle",
    (
        Column("time", "s", "time since the start"),
        Column("crank_angle", "rad", "crank angle theta2, running on over revolutions"),
        *_clearance(2, "crank pin", "from the crank's pin to the rod's end"),
        *_clearance(3, "piston pin", "from the slider's pin to the rod's end"),
        Column("rod_position_x", "m", "mass centre of the rod, x"),
        Column("rod_position_y", "m", "mass centre of the rod, y"),
        Column("rod_velocity_x", "m/s", "velocity of the rod's mass centre, x"),
        Column("rod_velocity_y", "m/s", "velocity of the rod's mass centre, y"),
        Column("rod_acceleration_x", "m/s^2", "acceleration of the rod's mass centre, x"),
        Column("rod_acceleration_y", "m/s^2", "acceleration of the rod's mass centre, y"),
        Column("rod_angle", "rad", "angle theta3 of the rod from +x, crank end to piston end"),
        Column("rod_angular_velocity", "rad/s", "first time derivative of the rod angle"),
        Column("rod_angular_acceleration", "rad/s^2", "second time derivative of the rod angle"),
        Column("slider_position", "m", "position of the slider's pin along x"),
        Column("slider_velocity", "m/s", "velocity of the slider"),
        Column("slider_acceleration", "m/s^2", "acceleration of the slider"),
        *_contact("crank_pin", "crank"),
        *_contact("piston_pin", "slider"),
        Column("crank_torque", "N*m", "torque of the drive on the crank"),
        Column("guide_force", "N", "force of the guide on the slider, +y"),
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
        Column("joint", "", "crank_pin or piston_pin", "text"),
        Column("event", "", "impact (contact begins) or separation (contact ends)", "text"),
        Column(
            "approach_speed",
            "m/s",
            "speed of approach along the normal at an impact; null at a separation",
            nullable=True,
        ),
    ),
)

OUTPUTS = ("r2", "r3", "gamma2", "gamma3", "gamma2_dot", "gamma3_dot", "gamma2_ddot", "gamma3_ddot")
"""The eight outputs that networks learn, by their column of the trajectory, in the paper's order."""
