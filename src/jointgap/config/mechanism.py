"""The mechanism file: bodies, joints, contacts and effects of one slider-crank."""

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from jointgap.config.quantities import (
    Acceleration,
    Angle,
    FrictionCoefficient,
    Length,
    NonNegativeLength,
    OpenFraction,
    PoissonRatio,
    PositiveInertia,
    PositiveLength,
    PositiveMass,
    PositiveNumber,
    PositivePressure,
    PositiveSpeed,
)
from jointgap.errors import did_you_mean

Law = Literal[
    "hunt_crossley",
    "lankarani_nikravesh",
    "lee_wang",
    "herbert_mcwhannell",
    "gonthier",
    "zhiying_qishao",
    "flores",
    "hu_guo",
    "carvalho_martins",
    "exact_restitution",
]


class Section(BaseModel):
    """Base of every part of a configuration: frozen, no unknown keys, defaults validated too."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class Link(Section):
    """A rigid link that turns in the plane."""

    length: PositiveLength = Field(description="distance between the link's two joints")
    mass: PositiveMass = Field(description="mass")
    inertia: PositiveInertia = Field(description="moment of inertia about the mass centre")
    mass_centre: NonNegativeLength = Field(
        description="distance of the mass centre from the joint nearer the crank pivot"
    )

    @model_validator(mode="after")
    def _mass_centre_lies_on_the_link(self):
        if self.mass_centre > self.length:
            raise ValueError(
                f"mass_centre {self.mass_centre:g} m lies beyond the link's length {self.length:g} m; "
                "measure it from the joint nearer the crank pivot"
            )
        return self

    def with_length(self, length: float) -> "Link":
        """The link at another length [m]: the mass centre keeps its share, mass and inertia stay."""
        return self.model_copy(update={"length": length, "mass_centre": self.mass_centre * length / self.length})


class Slider(Section):
    """The slider (piston), which moves along x at y = offset without turning."""

    mass: PositiveMass = Field(description="mass")
    offset: Length = Field(0.0, description="the slide is the line y = offset")


class Contact(Section):
    """Material, restitution and friction of one pair of journal and bearing."""

    law: Law = Field("lankarani_nikravesh", description="how damping follows from the restitution asked for")
    youngs_modulus: PositivePressure = Field(207e9, description="Young's modulus of journal and bearing")
    poisson_ratio: PoissonRatio = Field(0.3, description="Poisson's ratio of journal and bearing")
    restitution: OpenFraction = Field(description="coefficient of restitution asked for")
    friction: FrictionCoefficient = Field(0.0, description="coefficient of Coulomb friction")
    friction_speed: PositiveSpeed = Field(
        0.001,
        description="sliding speed over which Coulomb friction is regularised, friction * tanh(v / friction_speed)",
    )
    stiffness: PositiveNumber | None = Field(
        None, description="contact stiffness in N/m^exponent; null: Hertz, from material and radii"
    )
    exponent: PositiveNumber = Field(1.5, description="exponent of the penetration; 3/2 for Hertz")


class LooseJoint(Section):
    """A revolute joint whose journal is smaller than its bearing."""

    journal: Literal["crank", "rod", "slider"] = Field(description="the body that carries the journal")
    journal_radius: PositiveLength = Field(description="radius of the journal")
    bearing_radius: PositiveLength = Field(description="radius of the bearing")
    contact: Contact = Field(description="name of an entry of the mechanism's contacts, or its content")

    @model_validator(mode="after")
    def _journal_fits_its_bearing(self):
        if self.journal_radius >= self.bearing_radius:
            raise ValueError(
                f"journal_radius {self.journal_radius:g} m is not smaller than bearing_radius {self.bearing_radius:g} m; "
                "a loose joint needs a journal smaller than its bearing"
            )
        return self

    @property
    def clearance(self) -> float:
        """Radial clearance r_c = r_B - r_J [m] (equation 1)."""
        return self.bearing_radius - self.journal_radius


def _loose(carriers: tuple[str, str]) -> Any:
    def check(joint: Any) -> Any:
        if joint == "ideal":
            raise ValueError(
                "an ideal joint is not supported here yet; give a journal, its radius, bearing_radius, contact"
            )
        journal = joint.get("journal") if isinstance(joint, dict) else getattr(joint, "journal", None)
        if journal is not None and journal not in carriers:
            raise ValueError(f"journal must be '{carriers[0]}' or '{carriers[1]}', the bodies that meet in this joint")
        return joint

    return Annotated[LooseJoint, BeforeValidator(check)]


class Joints(Section):
    """The three revolute joints."""

    crank_pivot: Literal["ideal"] = Field("ideal", description="joint of frame and crank")
    crank_pin: _loose(("crank", "rod")) = Field(description="joint 2 of the paper")
    piston_pin: _loose(("slider", "rod")) = Field(description="joint 3 of the paper")


class GravityParameters(Section):
    """Parameters of the effect ``gravity``."""

    acceleration_m_s2: Acceleration = Field(9.80665, description="acceleration of free fall")


class Gravity(Section):
    """Weight of all bodies along the mechanism's gravity_direction."""

    name: Literal["gravity"]
    parameters: GravityParameters = GravityParameters()


class Mechanism(Section):
    """One slider-crank: everything that a simulation needs but its speed."""

    crank: Link
    rod: Link
    slider: Slider
    joints: Joints
    contacts: dict[str, Contact] = Field({}, description="contacts by name, for the joints to refer to")
    gravity_direction: Angle = Field(-math.pi / 2, description="direction of gravity in the plane, from +x")
    effects: tuple[Gravity, ...] = Field((), description="physical effects beyond contact and friction in the joints")

    @model_validator(mode="before")
    @classmethod
    def _joints_get_their_contact(cls, data: Any) -> Any:
        if not (isinstance(data, dict) and isinstance(data.get("joints"), dict)):
            return data
        contacts = data.get("contacts") or {}
        if not isinstance(contacts, dict):
            raise ValueError(f"contacts = {contacts!r} must map names to contacts, e.g. 'contacts: {{steel: {{...}}}}'")
        joints = dict(data["joints"])
        for name, joint in joints.items():
            if isinstance(joint, dict) and isinstance(joint.get("contact"), str):
                if joint["contact"] not in contacts:
                    hint = did_you_mean(joint["contact"], contacts) if contacts else "there is no section contacts"
                    raise ValueError(
                        f"joints.{name}.contact names '{joint['contact']}', which is not under contacts; {hint}"
                    )
                joints[name] = joint | {"contact": contacts[joint["contact"]]}
        return data | {"joints": joints}

    @model_validator(mode="after")
    def _crank_can_turn(self):
        reach = self.crank.length + abs(self.slider.offset)
        if reach >= self.rod.length:
            raise ValueError(
                f"crank.length {self.crank.length:g} m plus offset {abs(self.slider.offset):g} m is not shorter than "
                f"rod.length {self.rod.length:g} m: the crank cannot turn; shorten the crank or lengthen the rod"
            )
        return self

    @property
    def crank_pin(self) -> LooseJoint:
        """Joint 2: crank and rod."""
        return self.joints.crank_pin

    @property
    def piston_pin(self) -> LooseJoint:
        """Joint 3: rod and slider."""
        return self.joints.piston_pin

    @property
    def gravity(self) -> np.ndarray:
        """Acceleration of free fall, shape (2,) [m/s^2]; zero unless the effect is listed."""
        size = sum(effect.parameters.acceleration_m_s2 for effect in self.effects)
        return size * np.array([math.cos(self.gravity_direction), math.sin(self.gravity_direction)])

    def with_lengths(self, crank_length: float, rod_length: float) -> "Mechanism":
        """The mechanism with other link lengths [m]; mass centres keep their share, masses and inertias stay."""
        links = {"crank": self.crank.with_length(crank_length), "rod": self.rod.with_length(rod_length)}
        return self.model_copy(update=links)
