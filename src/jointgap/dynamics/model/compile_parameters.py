"""From a configured mechanism and its drive to the plain numbers of the equations of motion."""

import math

import numpy as np

from jointgap.config import Mechanism, Simulate, check_drive, check_tolerance, hertz_stiffness
from jointgap.config.scenario import MeasuredDrive, MotorDrive
from jointgap.dynamics.model.friction import FRICTION_LAWS
from jointgap.dynamics.model.measured_drive import angle_pieces
from jointgap.dynamics.model.normal_contact import LAWS
from jointgap.dynamics.model.parameters import (
    CONSTANT,
    FLUCTUATING,
    MEASURED,
    MOTOR,
    NO_KNOTS,
    NO_PROGRAM,
    BodyParameters,
    DriveParameters,
    EffectParameters,
    JointParameters,
    Parameters,
    Switches,
    knots_record,
    program_record,
    record,
)
from jointgap.effects import CRANK_SIGN_SPEED, SLIDER_SIGN_SPEED
from jointgap.formula import compile_formula
from jointgap.joints import JOINT, JOINTS


def joint_parameters(mechanism: Mechanism, name: str) -> JointParameters:
    """The numbers of one joint of a mechanism whose effects are applied."""
    joint, rubbing = mechanism.joint(name), mechanism.effect("pin_friction", name)
    if joint is None:
        return JointParameters()
    if not joint.loose:
        return JointParameters(pin_friction=rubbing.coefficient if rubbing else 0.0, pin_radius=joint.journal_radius)
    contact, film = joint.contact, mechanism.effect("lubricated_joint", name)
    body_has_journal = joint.journal == JOINT[name].body
    radii = (joint.journal_radius, joint.bearing_radius)
    body_radius, partner_radius = radii if body_has_journal else radii[::-1]
    penalty = contact.law == "penalty"
    return JointParameters(
        loose=True,
        clearance=joint.clearance - (film.least_film_m if film else 0.0),
        body_radius=body_radius,
        partner_radius=partner_radius,
        side=1.0 if body_has_journal else -1.0,
        stiffness=hertz_stiffness(joint) if contact.stiffness is None else contact.stiffness,
        exponent=contact.exponent,
        damping=0.0 if penalty else LAWS[contact.law](contact.restitution),
        least_approach=contact.least_approach_speed,
        penalty_damping=contact.penalty_damping if penalty else 0.0,
        penalty_depth=contact.penalty_depth if penalty else 0.0,
        friction_law=FRICTION_LAWS[contact.friction_law],
        **contact.friction_parameters(),
        film_viscosity=film.viscosity_Pa_s if film else 0.0,
        film_length=film.length_m if film else 0.0,
        film_clearance=joint.clearance,
        film_least=film.least_film_m if film else 0.0,
    )


def body_parameters(mechanism: Mechanism) -> BodyParameters:
    """The numbers of crank, rod and slider; an unbalance is a mass at the crank's length from the pivot."""
    crank, rod, slider = mechanism.crank, mechanism.rod, mechanism.slider
    unbalance, bending = mechanism.effect("crank_unbalance"), mechanism.effect("rod_flexibility")
    extra = unbalance.unbalance_kg_m if unbalance else 0.0
    angle = unbalance.angle_rad if unbalance else 0.0
    gravity_x, gravity_y = (float(component) for component in mechanism.gravity)
    return BodyParameters(
        crank_length=crank.length,
        crank_mass=crank.mass + extra / crank.length,
        crank_moment_x=crank.mass * crank.mass_centre + extra * math.cos(angle),
        crank_moment_y=extra * math.sin(angle),
        crank_inertia=crank.inertia + crank.mass * crank.mass_centre**2 + extra * crank.length,
        rod_length=rod.length,
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
        rod_pulsation=2 * math.pi * bending.frequency_Hz if bending else 0.0,
        rod_damping_ratio=bending.damping_ratio if bending else 0.0,
    )


def effect_parameters(mechanism: Mechanism) -> EffectParameters:
    """The numbers of forces on the slider and torques on the crank."""
    found: dict[str, float] = {}
    for name, keys in {
        "slider_coulomb_friction": {"coulomb": "force_N"},
        "slider_viscous_friction": {"viscous": "damping_N_s_m"},
        "slider_quadratic_drag": {"drag": "drag_N_s2_m2"},
        "slider_load_friction": {"load_friction": "coefficient"},
        "slider_constant_force": {"constant": "force_N"},
        "slider_spring": {"spring_stiffness": "stiffness_N_m", "spring_rest": "rest_position_m"},
        "gas_pressure": {"gas_force": "force_N", "gas_length": "dead_length_m", "gas_exponent": "exponent"},
        "harmonic_force": {"harmonic": "force_N", "harmonic_phase": "phase_rad"},
    }.items():
        if values := mechanism.effect(name):
            found |= {key: getattr(values, attribute) for key, attribute in keys.items()} | {"on_slider": True}
            if name == "harmonic_force":
                found["harmonic_pulsation"] = 2 * math.pi * values.frequency_Hz
    for name, key, attribute in (
        ("crank_coulomb_friction", "crank_coulomb", "torque_N_m"),
        ("crank_viscous_friction", "crank_viscous", "damping_N_m_s"),
    ):
        if values := mechanism.effect(name):
            found[key] = getattr(values, attribute)
    if mechanism.effect("discovered_slider_force"):
        found["on_slider"] = True
    reach = mechanism.crank.length + mechanism.rod.length
    return EffectParameters(
        **found,
        gas_outermost=math.sqrt(reach**2 - mechanism.slider.offset**2),
        slider_sign_speed=SLIDER_SIGN_SPEED,
        crank_sign_speed=CRANK_SIGN_SPEED,
    )


def drive_parameters(mechanism: Mechanism, options: Simulate, pieces: np.ndarray | None) -> DriveParameters:
    """The numbers of the drive; `pieces` are those of a measured angle."""
    drive, fluctuation = options.drive, mechanism.effect("speed_fluctuation")
    if pieces is not None:
        speed = (pieces[-1, 6] - pieces[0, 6]) / (pieces[-1, 0] - pieces[0, 0]) if len(pieces) > 1 else pieces[0, 5]
        return DriveParameters(kind=MEASURED, speed=float(speed), start_angle=options.start_angle)
    common = {"speed": options.speed, "start_angle": options.start_angle}
    if isinstance(drive, MotorDrive):
        return DriveParameters(
            kind=MOTOR,
            **common,
            stall_torque=drive.stall_torque,
            no_load_speed=drive.no_load_speed,
            rotor_inertia=drive.inertia,
        )
    if fluctuation:
        wave = {"ratio": fluctuation.ratio, "order": float(fluctuation.order), "phase": fluctuation.phase_rad}
        return DriveParameters(kind=FLUCTUATING, **common, **wave)
    return DriveParameters(kind=CONSTANT, **common)


def parameters(mechanism: Mechanism, options: Simulate) -> Parameters:
    """The numbers of `mechanism`, its effects applied, under the drive of `options`.

    Raises
    ------
    InputError
        Effects that make it impossible, a measured crank angle that cannot be used, a tolerance too coarse for a clearance.
    """
    made = mechanism.applied()
    check_drive(made, options)
    check_tolerance(made, options)
    measured = isinstance(options.drive, MeasuredDrive)
    pieces, end = angle_pieces(options) if measured else (None, 0.0)
    joints = {name: joint_parameters(made, name) for name in JOINTS}
    bodies = body_parameters(made)
    motor = isinstance(options.drive, MotorDrive)
    bristles = any(joint.friction_law == FRICTION_LAWS["lugre"] for joint in joints.values())
    free_crank = motor or joints["crank_pivot"].loose
    slider_formula, crank_formula = made.effect("discovered_slider_force"), made.effect("discovered_crank_torque")
    return Parameters(
        bodies=record(bodies),
        **{name: record(joint) for name, joint in joints.items()},
        drive=record(drive_parameters(made, options, pieces)),
        effects=record(effect_parameters(made)),
        switches=record(
            Switches(
                further=free_crank or bristles or bodies.rod_pulsation > 0,
                constrained=not (joints["crank_pin"].loose and joints["piston_pin"].loose),
                free_crank=free_crank,
                bristles=bristles,
            )
        ),
        slider_formula=_program(slider_formula),
        crank_formula=_program(crank_formula),
        knots=NO_KNOTS if pieces is None else knots_record(pieces, end),
    )


def _program(values) -> np.record:
    return program_record(compile_formula(values.formula, values.coefficients)) if values else NO_PROGRAM
