"""Effects of bodies and joints: weight, lengths, clearances, friction and film in the pins, a bending rod."""

from typing import ClassVar, Literal

from pydantic import Field, field_validator

from jointgap.effects.effect import CRANK_SIGN, Effect
from jointgap.quantities import quantity
from jointgap.section import Section

Pin = Literal["crank_pin", "piston_pin"]
CLEARANCE_LAW = "{joint} loose with the radial clearance c; c = 0: ideal"
LEAST_CLEARANCE = 1e-9  # [m] far less is lost in the rounding of the radii too
CLEARANCE_REFERENCE = "Erkaya and Uzmay (2009), equation 1"


class GravityParameters(Section):
    """Parameters of the effect ``gravity``."""

    acceleration_m_s2: quantity("m/s^2", ge=0, le=15) = Field(
        9.80665, description="g, acceleration of free fall", examples=[9.80665]
    )


class Gravity(Effect):
    """Weight of all bodies along the mechanism's gravity_direction."""

    SITE: ClassVar = "all bodies"
    LAW: ClassVar = "F = m g along gravity_direction, each body"
    REFERENCE: ClassVar = "3rd Conférence générale des poids et mesures (1901)"

    name: Literal["gravity"]
    parameters: GravityParameters = GravityParameters()


class LinkLengthErrorParameters(Section):
    """Parameters of ``link_length_error``."""

    crank_m: quantity("m") = Field(0.0, description="a, crank's length beyond nominal", examples=[0.0005])
    rod_m: quantity("m") = Field(0.0, description="b, rod's length beyond nominal", examples=[-0.001])


class LinkLengthError(Effect):
    """Crank and rod are longer, or shorter, than nominal; mass centres keep their share, masses and inertias stay."""

    SITE: ClassVar = "crank, rod"
    LAW: ClassVar = "crank.length + a, rod.length + b"
    REFERENCE: ClassVar = "definition"

    name: Literal["link_length_error"]
    parameters: LinkLengthErrorParameters


class ClearanceParameters(Section):
    """Parameters of the effects ``crank_pivot_clearance``, ``crank_pin_clearance`` and ``piston_pin_clearance``."""

    clearance_m: quantity("m", ge=0) = Field(
        description="c, whole radial clearance, not beyond nominal; 0 or 1e-9 m and more", examples=[0.0002]
    )

    @field_validator("clearance_m")
    @classmethod
    def _is_none_or_more_than_atoms(cls, clearance: float) -> float:
        if 0 < clearance < LEAST_CLEARANCE:
            raise ValueError(
                f"is less than {LEAST_CLEARANCE:g} m, a few atoms; give 0 for an ideal joint, or {LEAST_CLEARANCE:g} m or more"
            )
        return clearance


class CrankPivotClearance(Effect):
    """The crank pivot is loose, or looser; needs the joint's data (a mapping, not the word ideal)."""

    SITE: ClassVar = "crank_pivot"
    LAW: ClassVar = CLEARANCE_LAW.format(joint="crank pivot")
    REFERENCE: ClassVar = CLEARANCE_REFERENCE

    name: Literal["crank_pivot_clearance"]
    parameters: ClearanceParameters


class CrankPinClearance(Effect):
    """The crank pin is loose, or looser; needs the joint's data (a mapping, not the word ideal)."""

    SITE: ClassVar = "crank_pin"
    LAW: ClassVar = CLEARANCE_LAW.format(joint="crank pin")
    REFERENCE: ClassVar = CLEARANCE_REFERENCE

    name: Literal["crank_pin_clearance"]
    parameters: ClearanceParameters


class PistonPinClearance(Effect):
    """The piston pin is loose, or looser; needs the joint's data (a mapping, not the word ideal)."""

    SITE: ClassVar = "piston_pin"
    LAW: ClassVar = CLEARANCE_LAW.format(joint="piston pin")
    REFERENCE: ClassVar = CLEARANCE_REFERENCE

    name: Literal["piston_pin_clearance"]
    parameters: ClearanceParameters


class PinFrictionParameters(Section):
    """Parameters of ``pin_friction``."""

    coefficient: quantity("", ge=0, le=0.6) = Field(description="k, whole coefficient of friction", examples=[0.1])


class PinFriction(Effect):
    """Friction in a pin: in a loose one it replaces its contact's coefficient, in an ideal one it is a moment."""

    SITE: ClassVar = "crank_pin or piston_pin"
    LAW: ClassVar = (
        f"loose: contact.friction = k; ideal: M = -k r |F| sgn w, {CRANK_SIGN}, r: journal_radius, F: the pin's force, "
        "w: relative speed of its bodies"
    )
    REFERENCE: ClassVar = "Haug, Wu and Yang, Mech. Mach. Theory 21 (1986) 401-406"

    name: Literal["pin_friction"]
    site: Pin = Field(description="the pin")
    parameters: PinFrictionParameters


class LubricatedJointParameters(Section):
    """Parameters of ``lubricated_joint``."""

    viscosity_Pa_s: quantity("Pa*s", gt=0) = Field(description="mu, dynamic viscosity", examples=[0.05])
    length_m: quantity("m", gt=0) = Field(description="L, length of the bearing along its axis", examples=[0.012])
    least_film_m: quantity("m", gt=0) = Field(
        1e-6,
        description="h_min, film thickness at which asperities of ground surfaces begin to touch: dry contact",
        examples=[1e-06],
    )


class LubricatedJoint(Effect):
    """A film of lubricant in a loose pin, squeeze included; dry contact begins where the film is thinner than h_min."""

    SITE: ClassVar = "crank_pin or piston_pin"
    LAW: ClassVar = (
        "short bearing (Ocvirk) with squeeze, pressure p >= 0: d/dz(h^3 dp/dz) = 6 mu ((w_j + w_b) dh/dphi + 2 dh/dt); "
        "dry contact where h < h_min"
    )
    REFERENCE: ClassVar = "DuBois and Ocvirk, NACA report 1157 (1953)"

    name: Literal["lubricated_joint"]
    site: Pin = Field(description="the pin")
    parameters: LubricatedJointParameters


class RodFlexibilityParameters(Section):
    """Parameters of ``rod_flexibility``."""

    frequency_Hz: quantity("Hz", gt=0) = Field(description="nu, natural frequency of the mode", examples=[250.0])
    damping_ratio: quantity("", ge=0, lt=1) = Field(description="zeta, damping over critical damping", examples=[0.01])


class RodFlexibility(Effect):
    """The rod bends across its axis; excited by the inertia of its own mass. Its mass centre is near the middle."""

    SITE: ClassVar = "rod"
    LAW: ClassVar = (
        "q'' + 2 zeta (2 pi nu) q' + (2 pi nu)^2 q = inertia, deflection q sin(pi s / l): first mode of the "
        "pinned-pinned uniform beam with the rod's mass"
    )
    REFERENCE: ClassVar = "Meirovitch, Fundamentals of vibrations (2001)"

    name: Literal["rod_flexibility"]
    parameters: RodFlexibilityParameters
