"""The revolute joints, each ideal or loose."""

import math
from typing import Annotated, Any, Literal

from pydantic import Field, WrapValidator, model_validator

from jointgap.config.contact_config import FIRM_FORCE, Contact
from jointgap.quantities import PositiveLength, quantity
from jointgap.section import Section

NAMES = ("crank_pivot", "crank_pin", "piston_pin")
"""All joints, from the frame to the slider."""

SOFT_SHARE = 0.5
"""Share of the journal's radius by which `FIRM_FORCE` may press it into its bearing: laws of contact are for small depths."""


class Joint(Section):
    """A revolute joint with its journal, its bearing and their contact; it may be loose or ideal."""

    loose: bool = Field(True, description="false: ideal, with the same data at hand")
    journal: Literal["frame", "crank", "rod", "slider"] = Field(description="the body that carries the journal")
    journal_radius: quantity("m", ge=1e-6) = Field(description="radius of the journal")
    bearing_radius: PositiveLength = Field(description="radius of the bearing")
    contact: Contact = Field(description="name of an entry of the mechanism's contacts, or its content")

    @model_validator(mode="after")
    def _journal_fits_its_bearing(self):
        if self.loose and self.journal_radius >= self.bearing_radius:
            raise ValueError(
                f"journal_radius {self.journal_radius:g} m is not smaller than bearing_radius {self.bearing_radius:g} m; "
                "a loose joint needs a journal smaller than its bearing"
            )
        return self

    @model_validator(mode="after")
    def _contact_is_firmer_than_the_geometry(self):
        if not self.loose:
            return self
        hertz, exponent = self.contact.stiffness is None, self.contact.exponent
        stiffness = hertz_stiffness(self) if hertz else self.contact.stiffness
        deepest = SOFT_SHARE * self.journal_radius
        softest = FIRM_FORCE / deepest**exponent
        if stiffness < softest:
            key, value, unit = "stiffness", stiffness, f"N/m^{exponent:g}"
            if hertz:
                key, value, unit = "youngs_modulus", self.contact.youngs_modulus, "Pa"
            raise ValueError(
                f"contact.{key} {value:g} {unit} is too soft: {FIRM_FORCE:g} N would press the journal in by "
                f"{(FIRM_FORCE / stiffness) ** (1 / exponent):.3g} m, more than {SOFT_SHARE:g} of journal_radius "
                f"{self.journal_radius:g} m; give {value * softest / stiffness:.3g} {unit} at least"
            )
        return self

    @property
    def clearance(self) -> float:
        """Radial clearance r_c = r_B - r_J [m] (equation 1) of the joint's data, be it loose or not."""
        return self.bearing_radius - self.journal_radius


def hertz_stiffness(joint: Joint) -> float:
    """K [N/m^1.5] of a journal in a bearing of the same material; conforming contact of Hertz."""
    material = (1 - joint.contact.poisson_ratio**2) / joint.contact.youngs_modulus
    return 4 / (3 * 2 * material) * math.sqrt(joint.bearing_radius * joint.journal_radius / joint.clearance)


def _between(*carriers: str) -> Any:
    """Type of the joint between two bodies."""

    def read(joint: Any, _) -> Any:
        if joint == "ideal":
            return joint
        if not isinstance(joint, dict | Joint):
            raise ValueError(
                "must be the word 'ideal' or a mapping with journal, journal_radius, bearing_radius and contact"
            )
        journal = joint.get("journal") if isinstance(joint, dict) else joint.journal
        if journal is not None and journal not in carriers:
            raise ValueError(f"journal must be '{carriers[0]}' or '{carriers[1]}', the bodies that meet in this joint")
        return Joint.model_validate(joint)

    return Annotated[Literal["ideal"] | Joint, WrapValidator(read)]


class Joints(Section):
    """The three revolute joints."""

    crank_pivot: _between("frame", "crank") = Field("ideal", description="joint of frame and crank")
    crank_pin: _between("crank", "rod") = Field(description="joint 2 of the paper")
    piston_pin: _between("slider", "rod") = Field(description="joint 3 of the paper")
