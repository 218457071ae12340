"""A mechanism as the plain numbers that compiled code reads."""

from typing import NamedTuple

from jointgap.config import LooseJoint, Mechanism
from jointgap.dynamics.contact import LAWS, hertz_stiffness


class JointParameters(NamedTuple):
    """One loose joint of the rod with its partner (crank or slider); lengths in m.

    `side` is the direction of the contact point along the clearance vector, which runs from the partner's centre to
    the rod's: -1 where the rod carries the bearing, +1 where it carries the journal.
    """

    clearance: float
    rod_radius: float
    partner_radius: float
    side: float
    stiffness: float
    exponent: float
    damping: float
    friction: float
    friction_speed: float


class Parameters(NamedTuple):
    """Everything that the equations of motion know of a mechanism and its drive; SI."""

    crank_length: float
    crank_mass: float
    crank_mass_centre: float
    rod_inverse_mass: float
    rod_inverse_inertia: float
    rod_to_crank_end: float
    rod_to_piston_end: float
    slider_mass: float
    slider_inverse_mass: float
    slider_offset: float
    gravity_x: float
    gravity_y: float
    speed: float
    start_angle: float
    crank_pin: JointParameters
    piston_pin: JointParameters


def joint_parameters(joint: LooseJoint) -> JointParameters:
    """The numbers of one loose joint."""
    contact = joint.contact
    rod_has_journal = joint.journal == "rod"
    radii = (joint.journal_radius, joint.bearing_radius)
    rod_radius, partner_radius = radii if rod_has_journal else radii[::-1]
    return JointParameters(
        clearance=joint.clearance,
        rod_radius=rod_radius,
        partner_radius=partner_radius,
        side=1.0 if rod_has_journal else -1.0,
        stiffness=hertz_stiffness(joint) if contact.stiffness is None else contact.stiffness,
        exponent=contact.exponent,
        damping=LAWS[contact.law](contact.restitution),
        friction=contact.friction,
        friction_speed=contact.friction_speed,
    )


def parameters(mechanism: Mechanism, speed: float, start_angle: float) -> Parameters:
    """The numbers of `mechanism` driven at `speed` [rad/s] from the crank angle `start_angle` [rad]."""
    rod = mechanism.rod
    gravity_x, gravity_y = (float(component) for component in mechanism.gravity)
    return Parameters(
        crank_length=mechanism.crank.length,
        crank_mass=mechanism.crank.mass,
        crank_mass_centre=mechanism.crank.mass_centre,
        rod_inverse_mass=1 / rod.mass,
        rod_inverse_inertia=1 / rod.inertia,
        rod_to_crank_end=rod.mass_centre,
        rod_to_piston_end=rod.length - rod.mass_centre,
        slider_mass=mechanism.slider.mass,
        slider_inverse_mass=1 / mechanism.slider.mass,
        slider_offset=mechanism.slider.offset,
        gravity_x=gravity_x,
        gravity_y=gravity_y,
        speed=speed,
        start_angle=start_angle,
        crank_pin=joint_parameters(mechanism.crank_pin),
        piston_pin=joint_parameters(mechanism.piston_pin),
    )
