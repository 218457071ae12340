"""The mechanism file: bodies, joints, contacts and effects of one slider-crank."""

import math
from typing import Any

import numpy as np
from pydantic import Field, ValidationError, model_validator

from jointgap.complaints import complaints
from jointgap.config.joint_config import Contact, Joint, Joints
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import FROM_FRAME
from jointgap.core.units import Angle, Length, PositiveInertia, PositiveLength, PositiveMass
from jointgap.effects import AnyEffect
from jointgap.section import Section

_INERTIA_ARM = 2.0
"""Radius of gyration of a link [lengths] beyond which its inertia is refused: a uniform rod has 0.29."""


class Link(Section):
    """A rigid link that turns in the plane."""

    length: PositiveLength = Field(description="distance between the link's two joints")
    mass: PositiveMass = Field(description="mass")
    inertia: PositiveInertia = Field(description="moment of inertia about the mass centre")
    mass_centre: Length = Field(
        description="distance of the mass centre from the joint nearer the crank pivot, along the link; negative "
        "beyond that joint"
    )
    mass_centre_across: Length = Field(
        0.0,
        description="distance of the crank's mass centre from the line of the link, positive 90 deg ahead of it; "
        "0 for the rod",
    )

    @model_validator(mode="after")
    def _mass_centre_lies_near_the_link(self):
        for name in ("mass_centre", "mass_centre_across"):
            distance = getattr(self, name)
            if abs(distance) > self.length:
                raise ValueError(
                    f"{name} {distance:g} m lies beyond the link's length {self.length:g} m; "
                    "measure it from the joint nearer the crank pivot"
                )
        return self

    @model_validator(mode="after")
    def _inertia_fits_mass_and_length(self):
        most = self.mass * (_INERTIA_ARM * self.length) ** 2
        if self.inertia > most:
            raise ValueError(
                f"inertia {self.inertia:g} kg*m^2 is more than mass {self.mass:g} kg at a distance of "
                f"{_INERTIA_ARM:g} lengths ({self.length:g} m) from the mass centre has; give {most:.3g} kg*m^2 at "
                "most (check the units of all three), and a flywheel's as the motor's inertia"
            )
        return self

    def with_length(self, length: float) -> "Link":
        """The link at another length [m]: `mass_centre` keeps its share, all else stays."""
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
    def _rods_mass_centre_lies_on_its_line(self):
        if self.rod.mass_centre_across != 0:
            raise ValueError(
                f"rod.mass_centre_across is {self.rod.mass_centre_across:g} m, but only a crank's mass centre may lie "
                "beside its line; leave it out"
            )
        return self

    @model_validator(mode="after")
    def _crank_can_turn(self):
        clearances = sum(self.clearance(name) for name in self.loose)
        if self.crank.length + abs(self.slider.offset) + clearances >= self.rod.length:
            raise ValueError(
                f"crank.length {self.crank.length:g} m plus offset {abs(self.slider.offset):g} m plus clearances "
                f"{clearances:g} m "
                f"is not shorter than rod.length {self.rod.length:g} m: the crank cannot turn; shorten the crank or "
                "lengthen the rod"
            )
        return self

    @model_validator(mode="after")
    def _effects_fit(self):
        places = [(effect.name, effect.place) for effect in self.effects]
        for name, place in places:
            if places.count((name, place)) > 1:
                raise ValueError(f"effects: {name} at {place} is listed more than once; add its parameters up in one")
        if any(effect.changes_data(self) for effect in self.effects):
            self.applied()  # complains itself, and checks the rest
            return self
        for effect in self.effects:
            effect.check(self)
        return self

    @property
    def files(self) -> tuple[str, ...]:
        """Files that its effects read."""
        return tuple(effect.parameters.file for effect in self.effects if hasattr(effect.parameters, "file"))

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

    def mirrored(self) -> "Mechanism":
        """The mechanism as seen from behind, where a clockwise crank turns counter-clockwise: its mirror image in the
        line y = 0.
        """
        slider = self.slider.model_copy(update={"offset": -self.slider.offset})
        effects = tuple(effect.mirrored() for effect in self.effects)
        crank = self.crank.model_copy(update={"mass_centre_across": -self.crank.mass_centre_across})
        update = {"crank": crank, "slider": slider, "gravity_direction": -self.gravity_direction, "effects": effects}
        return self.model_copy(update=update)

    def joint_loads(self, speed: float) -> dict[str, float]:
        """About the largest force [N] in each joint without clearance, from the frame to the slider.

        It adds up the inertia forces of what the joint moves at a crank speed of `speed` [rad/s], its weight, and the
        loads that effects state.
        """
        crank, rod = self.crank, self.rod
        swing = crank.length * speed**2 * (1 + crank.length / rod.length)  # of the slider at its outer dead centre
        acceleration = swing + float(np.hypot(*self.gravity))
        beyond = {"piston_pin": self.slider.mass, "crank_pin": rod.mass + self.slider.mass}
        beyond["crank_pivot"] = crank.mass + beyond["crank_pin"]
        stated = sum(effect.largest_force(2 * crank.length) for effect in self.effects)
        return {name: beyond[name] * acceleration + stated for name in FROM_FRAME}

    def check_contacts(self, speed: float) -> None:
        """Whether the contacts of loose joints are firm enough for the loads at a crank speed of `speed` [rad/s].

        Raises
        ------
        InputError
            One that is too soft, with the least value.
        """
        loads = self.joint_loads(speed)
        for name in self.loose:
            if why := self.joint(name).too_soft_for(loads[name]):
                raise InputError(
                    f"mechanism.joints.{name}: {why} (load: inertia at {speed * 30 / math.pi:.4g} rpm, weight and the "
                    "forces of effects)"
                )

    def applied(self) -> "Mechanism":
        """The mechanism with all effects that merely change its data folded into them; `effects` keeps the others.

        Raises
        ------
        InputError
            The changed data are impossible; the message names the effects.
        """
        folded = [effect for effect in self.effects if effect.changes_data(self)]
        if not folded:
            return self
        data = self.model_dump()
        data["effects"] = [effect.model_dump() for effect in self.effects if effect not in folded]
        for effect in folded:
            effect.apply(data)
        try:
            return Mechanism.model_validate(data)
        except ValidationError as error:
            names = ", ".join(effect.name for effect in folded)
            raise InputError(f"with the effects {names}: {'; '.join(complaints(error, Mechanism))}") from error

    def with_lengths(self, crank_length: float, rod_length: float) -> "Mechanism":
        """The mechanism with other `crank_length` and `rod_length` [m]; mass centres keep their share, all else
        stays.
        """
        links = {"crank": self.crank.with_length(crank_length), "rod": self.rod.with_length(rod_length)}
        return self.model_copy(update=links)
