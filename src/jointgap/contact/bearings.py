"""Parameters of bearings and of the corners of loose slides."""

from typing import Any

from jointgap.config import Contact, Joint, hertz_stiffness
from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.config.linkage_file import Slide
from jointgap.contact.normal_force import FADING_DURATIONS, LAWS, MEMORY_DURATIONS, elastic_duration
from jointgap.contact.parameters import JointParameters


def bearing_parameters(joint: Joint, body_has_journal: bool, mass: float) -> JointParameters:
    """Parameters of a bearing, loose or ideal; `mass`: the largest that can rebound there [kg]."""
    if not joint.loose:
        return JointParameters(pin_radius=joint.journal_radius)
    contact = joint.contact
    radii = (joint.journal_radius, joint.bearing_radius)
    body_radius, partner_radius = radii if body_has_journal else radii[::-1]
    stiffness = hertz_stiffness(joint) if contact.stiffness is None else contact.stiffness
    return JointParameters(
        clearance=joint.clearance,
        body_radius=body_radius,
        partner_radius=partner_radius,
        side=1.0 if body_has_journal else -1.0,
        film_clearance=joint.clearance,
        **_contact_parameters(contact, stiffness, mass),
    )


def corner_parameters(slide: Slide, corner: tuple[float, float], mass: float) -> JointParameters:
    """Parameters of a corner of a loose slide, on the given sides along and across it."""
    ahead, beside = corner
    return JointParameters(
        clearance=0.5 * slide.width + slide.clearance,
        corner_x=0.5 * ahead * slide.length,
        corner_y=0.5 * beside * slide.width,
        **_contact_parameters(slide.contact, slide.contact.stiffness, mass),
    )


def _contact_parameters(contact: Contact, stiffness: float, mass: float) -> dict[str, Any]:
    """Normal force and friction of a loose joint."""
    penalty = contact.law == "penalty"
    damping = 0.0 if penalty else LAWS[contact.law](contact.restitution)
    fading = {}
    if contact.reference_speed is not None:
        duration = elastic_duration(stiffness, contact.exponent, mass, contact.least_approach_speed)
        fading = {
            "memory_time": MEMORY_DURATIONS * duration,
            "fading_time": FADING_DURATIONS * duration,
            "steady_contact_damping": damping / contact.reference_speed,
        }
    return {
        "loose": True,
        "stiffness": stiffness,
        "exponent": contact.exponent,
        "damping": damping,
        "least_approach": contact.least_approach_speed,
        **fading,
        "penalty_damping": contact.penalty_damping if penalty else 0.0,
        "penalty_depth": contact.penalty_depth if penalty else 0.0,
        "friction_law": FRICTION_LAWS[contact.friction_law].code,
        **contact.friction_parameters(),
    }
