"""Converts a mechanism and its drive to the parameters of the equations of motion; each effect adds
its own."""

import math

import numpy as np

from jointgap.config import (
    Joint,
    Mechanism,
    Simulate,
    check_drive,
    check_tolerance,
    hertz_stiffness,
)
from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.config.scenario import MeasuredDrive, MotorDrive
from jointgap.core.errors import InputError
from jointgap.core.formula import NOTHING
from jointgap.core.joints import JOINT, JOINTS
from jointgap.dynamics.contact import FADING_DURATIONS, LAWS, MEMORY_DURATIONS, elastic_duration
from jointgap.dynamics.drive import angle_pieces
from jointgap.dynamics.parameters import (
    DRIVE_KINDS,
    NO_KNOTS,
    NO_TABLE,
    BodyParameters,
    DriveParameters,
    EffectParameters,
    JointParameters,
    Parameters,
    Switches,
    knots_record,
    program_record,
    record,
    table_record,
)
from jointgap.effects.base import CRANK_SIGN_SPEED, SLIDER_SIGN_SPEED


def joint_parameters(mechanism: Mechanism, name: str) -> JointParameters:
    """Parameters of the joint `name` of a `mechanism` without effects."""
    joint = mechanism.joint(name)
    if joint is None:
        return JointParameters()
    # total mass beyond the joint: the largest mass that can rebound there
    beyond = ("crank", "rod", "slider") if name == "crank_pivot" else ("rod", "slider")
    mass = sum(getattr(mechanism, body).mass for body in beyond)
    return bearing_parameters(joint, joint.journal == JOINT[name].body, mass)


def bearing_parameters(joint: Joint, body_has_journal: bool, mass: float) -> JointParameters:
    """Parameters of a bearing, loose or ideal; `mass`: the largest that can rebound there [kg]."""
    if not joint.loose:
        return JointParameters(pin_radius=joint.journal_radius)
    contact = joint.contact
    radii = (joint.journal_radius, joint.bearing_radius)
    body_radius, partner_radius = radii if body_has_journal else radii[::-1]
    penalty = contact.law == "penalty"
    stiffness = hertz_stiffness(joint) if contact.stiffness is None else contact.stiffness
    damping = 0.0 if penalty else LAWS[contact.law](contact.restitution)
    fading = {}
    if contact.reference_speed is not None:
        duration = elastic_duration(stiffness, contact.exponent, mass, contact.least_approach_speed)
        fading = {
            "memory_time": MEMORY_DURATIONS * duration,
            "fading_time": FADING_DURATIONS * duration,
            "steady_contact_damping": damping / contact.reference_speed,
        }
    return JointParameters(
        loose=True,
        clearance=joint.clearance,
        body_radius=body_radius,
        partner_radius=partner_radius,
        side=1.0 if body_has_journal else -1.0,
        stiffness=stiffness,
        exponent=contact.exponent,
        damping=damping,
        least_approach=contact.least_approach_speed,
        **fading,
        penalty_damping=contact.penalty_damping if penalty else 0.0,
        penalty_depth=contact.penalty_depth if penalty else 0.0,
        friction_law=FRICTION_LAWS[contact.friction_law].code,
        **contact.friction_parameters(),
        film_clearance=joint.clearance,
    )


def _bodies(mechanism: Mechanism) -> BodyParameters:
    """Parameters of crank, rod and slider without effects except weight."""
    crank, rod, slider = mechanism.crank, mechanism.rod, mechanism.slider
    gravity_x, gravity_y = (float(component) for component in mechanism.gravity)
    return BodyParameters(
        crank_length=crank.length,
        crank_mass=crank.mass,
        crank_moment_x=crank.mass * crank.mass_centre,
        crank_moment_y=crank.mass * crank.mass_centre_across,
        crank_inertia=crank.inertia
        + crank.mass * (crank.mass_centre**2 + crank.mass_centre_across**2),
        rod_length=rod.length,
        rod_inverse_length=1 / rod.length,
        rod_mass=rod.mass,
        rod_inertia=rod.inertia,
        rod_inverse_mass=1 / rod.mass,
        rod_inverse_inertia=1 / rod.inertia,
        rod_centre=rod.mass_centre,
        slider_mass=slider.mass,
        slider_inverse_mass=1 / slider.mass,
        slider_offset=slider.offset,
        gravity_x=gravity_x,
        gravity_y=gravity_y,
        rod_angular_frequency=0.0,
        rod_damping_ratio=0.0,
    )


def drive_parameters(options: Simulate, pieces: np.ndarray | None) -> DriveParameters:
    """Parameters of the drive except its kind; `pieces` are those of a measured angle."""
    drive, speed, motor = options.drive, options.speed, {}
    if pieces is not None:
        steady = len(pieces) == 1
        speed = (
            pieces[0, 5]
            if steady
            else (pieces[-1, 6] - pieces[0, 6]) / (pieces[-1, 0] - pieces[0, 0])
        )
    elif isinstance(drive, MotorDrive):
        motor = {"stall_torque": drive.stall_torque, "no_load_speed": drive.no_load_speed}
        motor["rotor_inertia"] = drive.inertia
    return DriveParameters(speed=float(speed), start_angle=options.start_angle, **motor)


def parameters(mechanism: Mechanism, options: Simulate) -> Parameters:
    """Parameters of `mechanism`, with its effects, under the drive of `options`."""
    if options.speed < 0:
        raise InputError(
            f"simulate.speed {options.speed:g} rad/s is clockwise, which only single simulations"
            " support; mirror the mechanism (opposite sign of slider.offset, gravity_direction and"
            " phases) and give a positive speed"
        )
    made = mechanism.applied()
    check_drive(made, options)
    check_tolerance(made, options)
    pieces, end = angle_pieces(options) if isinstance(options.drive, MeasuredDrive) else (None, 0.0)
    drive = drive_parameters(options, pieces)
    made.check_contacts(max(abs(drive.speed), options.highest_speed))
    outermost = math.sqrt((made.crank.length + made.rod.length) ** 2 - made.slider.offset**2)
    signs = {"slider_sign_speed": SLIDER_SIGN_SPEED, "crank_sign_speed": CRANK_SIGN_SPEED}
    groups = {
        "bodies": _bodies(made),
        **{name: joint_parameters(made, name) for name in JOINTS},
        "drive": drive,
        "effects": EffectParameters(gas_outermost=outermost, **signs),
    }
    fields = {name: group._asdict() for name, group in groups.items()}
    fields["formulas"] = {"slider_formula": NOTHING, "crank_formula": NOTHING}
    fields["tables"] = {}
    fields["drive"]["kind"] = options.drive.kind
    for effect in made.effects:
        effect.compile_into(fields)
    fields["drive"]["kind"] = DRIVE_KINDS.index(fields["drive"]["kind"])
    programs = {name: program_record(program) for name, program in fields["formulas"].items()}
    bristles = any(fields[name]["friction_law"] == FRICTION_LAWS["lugre"].code for name in JOINTS)
    free_crank = isinstance(options.drive, MotorDrive) or fields["crank_pivot"]["loose"]
    switches = Switches(
        auxiliary=free_crank or bristles or fields["bodies"]["rod_angular_frequency"] > 0,
        constrained=not (fields["crank_pin"]["loose"] and fields["piston_pin"]["loose"]),
        free_crank=free_crank,
        bristles=bristles,
    )
    return Parameters(
        **{name: record(group._replace(**fields[name])) for name, group in groups.items()},
        switches=record(switches),
        **programs,
        slider_table=(
            table_record(fields["tables"]["slider_table"]) if fields["tables"] else NO_TABLE
        ),
        knots=NO_KNOTS if pieces is None else knots_record(pieces, end),
    )
