"""The revolute joints, each ideal or loose."""

from typing import Annotated, Any, Literal

from pydantic import Field, WrapValidator, model_validator

from jointgap.config.contact import Contact
from jointgap.config.quantities import PositiveLength
from jointgap.config.section import Section

NAMES = ("crank_pivot", "crank_pin", "piston_pin")
"""All joints, from the frame to the slider."""


class Joint(Section):
    """A revolute joint with its journal, its bearing and their contact; it may be loose or ideal."""

    loose: bool = Field(True, description="false: ideal, with the same data at hand")
    journal: Literal["frame", "crank", "rod", "slider"] = Field(description="the body that carries the journal")
    journal_radius: PositiveLength = Field(description="radius of the journal")
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

    @property
    def clearance(self) -> float:
        """Radial clearance r_c = r_B - r_J [m] (equation 1) of the joint's data, be it loose or not."""
        return self.bearing_radius - self.journal_radius


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
