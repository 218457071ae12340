"""The mechanism file: bodies, joints, contacts and effects of one slider-crank."""

import math
from typing import Any

import numpy as np
from pydantic import Field, ValidationError, model_validator

from jointgap.config.applied_effects import apply_effects, changes_data
from jointgap.config.config_errors import complaints
from jointgap.config.joint_config import Contact, Joint, Joints
from jointgap.effects import AnyEffect, Effect
from jointgap.errors import InputError, did_you_mean
from jointgap.joints import FROM_FRAME
from jointgap.quantities import Angle, Length, NonNegativeLength, PositiveInertia, PositiveLength, PositiveMass
from jointgap.section import Section

LEAST_FILM_SHARE = 0.5
"""Largest share of the clearance at which asperities may touch; beyond it there is no bearing to speak of."""

BENDING_COUPLING = 8 / (math.pi**2 - 8)
"""The mode sin(pi s / l) of a uniform beam of mass m takes the moment of inertia m b^2 times this from a rod that turns about
its mass centre at the distance b from midspan: 2 k^2 / (1 - 2 k^2) with the mode's mean k = 2 / pi."""

LEAST_INERTIA_SHARE = 0.5
"""Share of rod.inertia that bending has to leave: a rod whose mass centre is farther off is no uniform beam."""


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


class Mechanism(Section):
    """One slider-crank: everything that a simulation needs but its speed."""

    crank: Link
    rod: Link
    slider: Slider
    joints: Joints
    contacts: dict[str, Contact] = Field({}, description="contacts by name, for the joints to refer to")
    gravity_direction: Angle = Field(-math.pi / 2, description="direction of gravity in the plane, from +x")
    effects: tuple[AnyEffect, ...] = Field((), description="physical effects beyond contact and friction in the joints")

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
        clearances = sum(self.clearance(name) for name in self.loose)
        if self.crank.length + abs(self.slider.offset) + clearances >= self.rod.length:
            raise ValueError(
                f"crank.length {self.crank.length:g} m plus offset {abs(self.slider.offset):g} m plus clearances {clearances:g} m "
                f"is not shorter than rod.length {self.rod.length:g} m: the crank cannot turn; shorten the crank or lengthen the rod"
            )
        return self

    @model_validator(mode="after")
    def _effects_fit(self):
        places = [(effect.name, effect.place) for effect in self.effects]
        for name, place in places:
            if places.count((name, place)) > 1:
                raise ValueError(f"effects: {name} at {place} is listed more than once; add its parameters up in one")
        if any(changes_data(self, effect) for effect in self.effects):
            self.applied()  # complains itself, and checks the rest
            return self
        for effect in self.effects:
            self._check_pin(effect)
        if self.effect("rod_flexibility"):
            self._check_rod()
        return self

    def _check_rod(self) -> None:
        """Whether the rod is near enough to the uniform beam as which it bends."""
        rod = self.rod
        lost = BENDING_COUPLING * rod.mass * (rod.mass_centre - rod.length / 2) ** 2
        if lost > (1 - LEAST_INERTIA_SHARE) * rod.inertia:
            farthest = math.sqrt((1 - LEAST_INERTIA_SHARE) * rod.inertia / (BENDING_COUPLING * rod.mass))
            raise ValueError(
                f"effects: rod_flexibility is the law of a uniform beam, of which rod.mass_centre {rod.mass_centre:g} m is too far from "
                f"the middle: bending leaves {rod.inertia - lost:.3g} of rod.inertia {rod.inertia:g} kg m^2, less than "
                f"{LEAST_INERTIA_SHARE:g} of it; put the mass centre within {farthest:.3g} m of {rod.length / 2:g} m, or leave the effect out"
            )

    def _check_pin(self, effect: Effect) -> None:
        """Whether the pin at which `effect` acts has what it needs."""
        where = f"effects: {effect.name} at {effect.place}"
        if effect.name == "pin_friction" and self.joint(effect.site) is None:
            raise ValueError(
                f"{where} needs the joint's journal_radius; write the joint as a mapping, with 'loose: false' to stay ideal"
            )
        if effect.name != "lubricated_joint":
            return
        if effect.site not in self.loose:
            raise ValueError(f"{where} needs a loose joint, for a film needs a clearance; make it loose")
        thinnest, clearance = effect.parameters.least_film_m, self.clearance(effect.site)
        if thinnest > LEAST_FILM_SHARE * clearance:
            raise ValueError(
                f"{where}: least_film_m {thinnest:g} m is more than {LEAST_FILM_SHARE:g} of the clearance {clearance:g} m; lower it"
            )

    def joint(self, name: str) -> Joint | None:
        """The data of the joint `name`; None where it is the bare word ideal."""
        joint = getattr(self.joints, name)
        return joint if isinstance(joint, Joint) else None

    @property
    def loose(self) -> tuple[str, ...]:
        """Names of the loose joints, from the frame to the slider."""
        return tuple(name for name in FROM_FRAME if (joint := self.joint(name)) is not None and joint.loose)

    def clearance(self, name: str) -> float:
        """Radial clearance [m] of the joint `name` (equation 1); 0 where it is ideal."""
        joint = self.joint(name)
        return joint.clearance if joint is not None and joint.loose else 0.0

    def effect(self, name: str, site: str | None = None) -> Any:
        """Parameters of the effect `name`, at `site` where it has a choice; None where it is not listed."""
        for effect in self.effects:
            if effect.name == name and site in (None, effect.place):
                return effect.parameters
        return None

    @property
    def gravity(self) -> np.ndarray:
        """Acceleration of free fall, shape (2,) [m/s^2]; zero unless the effect is listed."""
        listed = self.effect("gravity")
        size = listed.acceleration_m_s2 if listed else 0.0
        return size * np.array([math.cos(self.gravity_direction), math.sin(self.gravity_direction)])

    def applied(self) -> "Mechanism":
        """The mechanism with all effects that merely change its data folded into them; `effects` keeps the others.

        Raises
        ------
        InputError
            The changed data are impossible; the message names the effects.
        """
        data = apply_effects(self)
        try:
            return Mechanism.model_validate(data)
        except ValidationError as error:
            names = ", ".join(effect.name for effect in self.effects if changes_data(self, effect))
            told = "; ".join(complaints(error, Mechanism))
            raise InputError(f"with the effects {names}: {told}" if names else told) from error

    def with_lengths(self, crank_length: float, rod_length: float) -> "Mechanism":
        """The mechanism with other link lengths [m]; mass centres keep their share, masses and inertias stay."""
        links = {"crank": self.crank.with_length(crank_length), "rod": self.rod.with_length(rod_length)}
        return self.model_copy(update=links)
