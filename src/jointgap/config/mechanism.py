"""The mechanism file: bodies, joints with their contacts, and effects of one slider-crank."""

import math
import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    ValidationError,
    ValidationInfo,
    WrapValidator,
    field_validator,
)

from jointgap.config.friction_laws import FRICTION_KEYS, FRICTION_LAWS
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import FROM_FRAME, JOINT, REFERENCE_APPROACH_SPEED
from jointgap.core.section import ConfigModel, complaints
from jointgap.core.sites import SLIDER_CRANK, Sites
from jointgap.core.units import (
    Angle,
    Length,
    PositiveLength,
    PositiveMass,
    PositiveNumber,
    PositiveSpeed,
    quantity,
)
from jointgap.effects import AnyEffect

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
    "penalty",
]

FIRM_FORCE, FIRM_PENETRATION = 1e3, 1e-9
"""Limit of stiffness: force [N] and its smallest penetration [m]."""

BRISTLE_ACCELERATION = 1e4
"""[m/s^2] Default bristle_damping is critical for a body with this normal force per mass (1 kN on
0.1 kg)."""


class Contact(ConfigModel):
    """Material, restitution and friction of a journal in its bearing."""

    law: Law = Field(
        "lankarani_nikravesh", description="relation of damping and restitution, or penalty"
    )
    youngs_modulus: quantity("Pa", gt=0, le=1e13) = Field(
        207e9, description="of journal and bearing"
    )
    poisson_ratio: quantity("", ge=0, lt=0.5) = Field(0.3, description="of journal and bearing")
    restitution: quantity("", ge=1e-3, lt=1) | None = Field(
        None, description="coefficient; not with law penalty"
    )
    least_approach_speed: PositiveSpeed = Field(
        0.001, description="lower limit of the approach speed in the damping"
    )
    memory: Literal["fading", "published"] | None = Field(
        None,
        description=(
            "damping of a lasting contact: fading to that at reference_approach_speed, or as"
            " published"
        ),
    )
    reference_approach_speed: PositiveSpeed | None = Field(
        None, description="of memory: fading; null: 0.05 m/s"
    )
    penalty_damping: quantity("N*s/m", ge=0, le=1e9) | None = Field(
        None, description="law penalty: largest damping"
    )
    penalty_depth: PositiveLength | None = Field(
        None, description="law penalty: penetration of the largest damping"
    )
    stiffness: PositiveNumber | None = Field(
        None, description="in N/m^exponent; null: Hertz, from material and radii"
    )
    exponent: quantity("", ge=1, le=10) = Field(
        1.5, description="of the penetration; not 3/2: requires stiffness"
    )
    friction_law: Literal[tuple(FRICTION_LAWS)] = Field(
        "coulomb", description="friction over the sliding speed"
    )
    friction: quantity("", ge=0, le=0.6) = Field(
        0.0, description="coefficient of kinetic friction; 0: none, for all laws"
    )
    friction_speed: PositiveSpeed = Field(
        0.001, description="sliding speed up to which friction rises from zero"
    )
    dead_band_speed: quantity("m/s", ge=0) | None = Field(
        None,
        description=(
            "ambrosio: no friction below it, full above friction_speed; null: a tenth of"
            " friction_speed"
        ),
    )
    static_friction: quantity("", ge=0, le=1) | None = Field(
        None, description="bengisu_akay, lugre: coefficient of static friction; null: friction"
    )
    stribeck_speed: PositiveSpeed | None = Field(
        None,
        description=(
            "bengisu_akay, lugre: speed scale from static to kinetic friction; null: 0.01 m/s"
        ),
    )
    viscous_friction: quantity("", ge=0) | None = Field(
        None, description="lugre: sigma_2 in s/m; null: 0"
    )
    bristle_stiffness: PositiveNumber | None = Field(
        None, description="lugre: sigma_0 in 1/m; null: 1e5 1/m"
    )
    bristle_damping: quantity("", ge=0) | None = Field(
        None, description="lugre: sigma_1 in s/m; null: critical"
    )

    def errors(self) -> Iterator[str]:
        required, unused = ("restitution",), ("penalty_damping", "penalty_depth")
        if self.law == "penalty":
            required, unused = unused, ("restitution", "memory", "reference_approach_speed")
        if missing := [key for key in required if getattr(self, key) is None]:
            pronoun = "it" if len(missing) == 1 else "them"
            yield f"law {self.law} requires {' and '.join(missing)}; add {pronoun}"
        choices = dict.fromkeys(unused, "law")
        if self.memory == "published":
            choices["reference_approach_speed"] = "memory"
        choices |= dict.fromkeys(FRICTION_KEYS, "friction_law")
        read = FRICTION_LAWS[self.friction_law].reads
        for key, choice in choices.items():
            if getattr(self, key) is not None and key not in read:
                yield (
                    f"{choice} {getattr(self, choice)} does not use {key}; remove it or set it to"
                    f" null, or choose another {choice}"
                )
        if self.static_friction is not None and self.static_friction < self.friction:
            yield (
                f"static_friction {self.static_friction:g} is less than friction {self.friction:g};"
                " raise it"
            )
        if self.dead_band_speed is not None and self.dead_band_speed >= self.friction_speed:
            yield (
                f"dead_band_speed {self.dead_band_speed:g} must be below friction_speed"
                f" {self.friction_speed:g} m/s"
            )
        unit = f"N/m^{self.exponent:g}"
        if self.stiffness is None and self.exponent != 1.5:
            yield (
                f"exponent {self.exponent:g} requires stiffness in {unit}; Hertz's law has"
                " exponent 1.5"
            )
        stiffest = FIRM_FORCE / FIRM_PENETRATION**self.exponent
        if self.stiffness is not None and self.stiffness > stiffest:
            yield (
                f"stiffness {self.stiffness:g} {unit} is too large; give at most {stiffest:.3g}"
                f" {unit}"
            )

    @property
    def reference_speed(self) -> float | None:
        """Approach speed [m/s] that determines the damping of a lasting contact; None where it does
        not fade."""
        if self.law == "penalty" or self.memory == "published":
            return None
        return self.reference_approach_speed or REFERENCE_APPROACH_SPEED

    def friction_parameters(self) -> dict[str, float]:
        """All keys of the friction laws in SI, with defaults."""
        values = {
            "friction": self.friction,
            "friction_speed": self.friction_speed,
            "dead_band_speed": 0.1 * self.friction_speed,
            "static_friction": self.friction,
            "stribeck_speed": 0.01,  # friction is kinetic at some times this speed
            "viscous_friction": 0.0,
            "bristle_stiffness": 1e5,  # friction 0.1 after a micrometre, the size of asperities
        }
        values |= {key: value for key, value in self if key in FRICTION_KEYS and value is not None}
        critical = 2 * math.sqrt(values["bristle_stiffness"] / BRISTLE_ACCELERATION)
        return {"bristle_damping": critical} | values


SOFT_SHARE = 0.5
"""Largest penetration over the journal's radius: contact laws apply to small penetrations."""


class Joint(ConfigModel):
    """A revolute joint with journal, bearing and contact; loose or ideal."""

    loose: bool = Field(True, description="false: ideal, keeping the data")
    journal: Literal["frame", "crank", "rod", "slider"] = Field(
        description="the body that carries the journal"
    )
    journal_radius: quantity("m", ge=1e-6) = Field(description="radius of the journal")
    bearing_radius: PositiveLength = Field(description="radius of the bearing")
    contact: Contact = Field(
        description="name of an entry of the mechanism's contacts, or its content"
    )

    def errors(self) -> Iterator[str]:
        if self.loose and self.journal_radius >= self.bearing_radius:
            radii = f"journal_radius {self.journal_radius:g} m is not smaller than bearing_radius"
            yield f"{radii} {self.bearing_radius:g} m; a loose joint needs a clearance"

    def too_soft_for(self, load: float) -> str:
        """Error message if the contact is too soft for a force of `load` [N], or ''."""
        exponent, stiffness = self.contact.exponent, self.contact.stiffness
        key, value, unit = "stiffness", stiffness, f"N/m^{exponent:g}"
        if stiffness is None:
            stiffness = hertz_stiffness(self)
            key, value, unit = "youngs_modulus", self.contact.youngs_modulus, "Pa"
        softest = load / (SOFT_SHARE * self.journal_radius) ** exponent
        if stiffness >= softest:
            return ""
        return (
            f"contact.{key} {value:g} {unit} is too soft: the penetration at {load:.4g} N would be"
            f" {(load / stiffness) ** (1 / exponent):.3g} m, more than {SOFT_SHARE:g} of"
            f" journal_radius {self.journal_radius:g} m; give at least"
            f" {value * softest / stiffness:.3g} {unit}"
        )

    @property
    def clearance(self) -> float:
        """Radial clearance r_c = r_B - r_J [m] (equation 1) of the data, for loose and ideal
        joints."""
        return self.bearing_radius - self.journal_radius


def hertz_stiffness(joint: Joint) -> float:
    """K [N/m^1.5] of a journal in a bearing of the same material: conforming Hertz contact."""
    material = (1 - joint.contact.poisson_ratio**2) / joint.contact.youngs_modulus
    radius = joint.bearing_radius * joint.journal_radius / joint.clearance
    return 4 / (3 * 2 * material) * math.sqrt(radius)


def _joint(name: str) -> Any:
    """Type of a joint: ideal, or with a journal on one of its two bodies."""
    carriers = JOINT[name].partner, JOINT[name].body

    def read(joint: Any, _) -> Any:
        if joint == "ideal":
            return joint
        if not isinstance(joint, dict | Joint):
            raise ValueError(
                "must be 'ideal' or a mapping with journal, journal_radius, bearing_radius and"
                " contact"
            )
        joint = Joint.model_validate(joint)
        if joint.journal not in carriers:
            raise ValueError(
                f"journal must be '{carriers[0]}' or '{carriers[1]}', the bodies of this joint"
            )
        return joint

    return Annotated[Literal["ideal"] | Joint, WrapValidator(read)]


class Joints(ConfigModel):
    """The three revolute joints."""

    crank_pivot: _joint("crank_pivot") = Field("ideal", description="joint of frame and crank")
    crank_pin: _joint("crank_pin") = Field(description="joint 2 of the paper")
    piston_pin: _joint("piston_pin") = Field(description="joint 3 of the paper")


_INERTIA_ARM = {"crank": 20.0, "rod": 2.0}
"""Largest radius of gyration over the length of a link, of a crank with its flywheel; a uniform rod
has 0.29."""


class Link(ConfigModel):
    """A rigid link in plane motion."""

    length: PositiveLength = Field(description="distance between the link's two joints")
    mass: PositiveMass = Field(description="mass")
    inertia: quantity("kg*m^2", gt=0) = Field(description="moment of inertia about the mass centre")
    mass_centre: Length = Field(
        description="its distance along the link from the joint nearer to the crank pivot"
    )
    mass_centre_across: Length = Field(
        0.0, description="of a crank: its distance from the line, 90 deg ahead"
    )

    def errors(self) -> Iterator[str]:
        for name in ("mass_centre", "mass_centre_across"):
            if abs(distance := getattr(self, name)) > self.length:
                yield (
                    f"{name} {distance:g} m is beyond the link's length {self.length:g} m; correct"
                    " one of them"
                )

    def with_length(self, length: float) -> "Link":
        """The link with another length [m]; `mass_centre` is scaled, all else is unchanged."""
        mass_centre = self.mass_centre * length / self.length
        return self.model_copy(update={"length": length, "mass_centre": mass_centre})


class Slider(ConfigModel):
    """The slider (piston), in translation along x at y = offset."""

    mass: PositiveMass = Field(description="mass")
    offset: Length = Field(0.0, description="the slide is the line y = offset")


_DIRECTIONS = {"right": 0, "up": 90, "left": 180, "down": -90}
_DIRECTIONS |= {"+x": 0, "+y": 90, "-x": 180, "-y": -90}
"""Angles [deg] from +x; +x points from the crank pivot along the slide."""


def angle_of(direction: Any) -> Any:
    """The angle of a direction in words; all else unchanged."""
    if not isinstance(direction, str) or re.search("[0-9]", direction):
        return direction
    if (word := direction.strip().lower()) not in _DIRECTIONS:
        raise ValueError(
            "is not a direction; write an angle from +x such as -90 deg, or down (-y), up (+y),"
            " left (-x) or right (+x, from the crank to the slider)"
        )
    return math.radians(_DIRECTIONS[word])


def with_contacts(joints: Any, contacts: dict[str, Contact] | None) -> Any:
    """The content of joints with their contacts in place of names; None: contacts are invalid."""
    if not isinstance(joints, dict):
        return joints
    joints = dict(joints)
    for name, joint in joints.items():
        key = joint.get("contact") if isinstance(joint, dict) else None
        if not isinstance(key, str):
            continue
        if contacts is None:  # they have their own errors
            contact = Contact.model_construct(restitution=0.5, stiffness=1.0)
        elif not (contact := contacts.get(key)):
            hint = did_you_mean(key, contacts) if contacts else "the section contacts is missing"
            raise ValueError(f"contact of {name}: no entry '{key}' in contacts; {hint}")
        joints[name] = joint | {"contact": contact}
    return joints


class OfAnyKind(ConfigModel):
    """What a slider-crank and another linkage have in common."""

    @property
    def files(self) -> tuple[str, ...]:
        """Files of its effects."""
        return tuple(
            effect.parameters.file for effect in self.effects if hasattr(effect.parameters, "file")
        )

    def clearance(self, name: str) -> float:
        """Radial clearance [m] of the joint `name` (equation 1), of a slide half its play; 0 where
        it is ideal."""
        joint = self.joint(name)
        return joint.clearance if joint and joint.loose else 0.0

    def effect(self, name: str, site: str | None = None) -> Any:
        """Parameters of the effect `name`, at `site` if it has several; None if it is not
        listed."""
        for effect in self.effects:
            if effect.name == name and site in (None, effect.place):
                return effect.parameters
        return None

    @property
    def gravity(self) -> np.ndarray:
        """Gravitational acceleration, shape (2,) [m/s^2]; zero unless the effect is listed."""
        gravity, direction = self.effect("gravity"), self.gravity_direction
        size = gravity.acceleration_m_s2 if gravity else 0.0
        return size * np.array([math.cos(direction), math.sin(direction)])

    @property
    def without_bearing(self) -> tuple[str, ...]:
        """Revolute joints whose bearing the file does not have, so that no clearance is tested."""
        return tuple(name for name in self.sites.revolutes if self.joint(name) is None)

    def applied(self) -> Self:
        """The mechanism with its parameters modified by the effects that only change data;
        `effects` keeps the others.

        InputError where the modified data are invalid.
        """
        of_data = [effect for effect in self.effects if effect.changes_data(self)]
        if not of_data:
            return self
        data = self.model_dump()
        data["effects"] = [effect.model_dump() for effect in self.effects if effect not in of_data]
        for effect in of_data:
            effect.apply(data)
        try:
            return type(self).model_validate(data)
        except ValidationError as error:
            names = ", ".join(effect.name for effect in of_data)
            raise InputError(
                f"with the effects {names}: {'; '.join(complaints(error, data))}"
            ) from error

    def errors_of_effects(self) -> Iterator[str]:
        """Errors of effects that are listed twice, and of those that cannot act here."""
        sites = [(effect.name, effect.place) for effect in self.effects if not effect.SEVERAL]
        for name, site in sites:
            if sites.count((name, site)) > 1:
                yield (
                    f"effects: {name} at {site} is listed more than once; combine its parameters"
                    " in one entry"
                )
        if any(effect.changes_data(self) for effect in self.effects):
            self.applied()  # raises for invalid data
            return
        for effect in self.effects:
            effect.check(self)

    def _check_contact(self, name: str, load: float, speed: float) -> None:
        """InputError where the contact of a joint is too soft for a `load` [N], at a crank speed of
        `speed` [rad/s]."""
        if reason := self.joint(name).too_soft_for(load):
            raise InputError(
                f"mechanism.joints.{name}: {reason} (load: inertia at"
                f" {speed * 30 / math.pi:.4g} rpm, weight and effects)"
            )


class Mechanism(OfAnyKind):
    """A slider-crank, without its drive."""

    crank: Link
    rod: Link
    slider: Slider
    contacts: dict[str, Contact] = Field(
        {}, description="contacts by name, for the joints to refer to"
    )
    joints: Joints
    gravity_direction: Annotated[Angle, BeforeValidator(angle_of)] = Field(
        -math.pi / 2,
        description=(
            "direction of gravity in the plane, from +x; or down, up, left (-x), right (+x)"
        ),
    )
    effects: tuple[AnyEffect, ...] = Field(
        (), description="effects besides contact and friction in the joints"
    )

    @field_validator("joints", mode="before")
    @classmethod
    def _joints_get_their_contact(cls, joints: Any, info: ValidationInfo) -> Any:
        return with_contacts(joints, info.data.get("contacts"))

    def errors(self) -> Iterator[str]:
        if self.rod.mass_centre_across != 0:
            yield (
                "rod.mass_centre_across must be 0: only a crank's mass centre may lie off its line;"
                " remove it"
            )
        for name, arm in _INERTIA_ARM.items():
            link = getattr(self, name)
            largest = link.mass * (arm * link.length) ** 2
            if link.inertia > largest:
                yield (
                    f"{name}.inertia {link.inertia:g} kg*m^2 is too large for mass {link.mass:g} kg"
                    f" and length {link.length:g} m; give at most {largest:.3g} kg*m^2 (check the"
                    " units)"
                )
        clearances = sum(map(self.clearance, self.loose))
        if self.crank.length + abs(self.slider.offset) + clearances >= self.rod.length:
            yield (
                f"crank.length {self.crank.length:g} m plus offset {abs(self.slider.offset):g} m"
                f" plus clearances {clearances:g} m exceed rod.length {self.rod.length:g} m: the"
                " crank cannot turn; lengthen the rod, shorten the crank, or check the units of"
                " the lengths and radii"
            )
        yield from self.errors_of_effects()

    @property
    def sites(self) -> Sites:
        """Its bodies and joints."""
        return SLIDER_CRANK

    def body(self, name: str) -> Link | Slider:
        """The data of the body `name`."""
        return getattr(self, name)

    def slide_direction(self, name: str) -> float:
        """Direction [rad] of the slide `name`, from +x."""
        return 0.0

    def joint(self, name: str) -> Joint | None:
        """The data of the joint `name`; None for ``ideal`` without data."""
        joint = getattr(self.joints, name)
        return joint if isinstance(joint, Joint) else None

    @property
    def loose(self) -> tuple[str, ...]:
        """Names of the loose joints, from the frame to the slider."""
        return tuple(name for name in FROM_FRAME if (joint := self.joint(name)) and joint.loose)

    def mirrored(self) -> "Mechanism":
        """The mirror image in y = 0, in which a clockwise crank turns counter-clockwise."""
        across = -self.crank.mass_centre_across
        update = {
            "crank": self.crank.model_copy(update={"mass_centre_across": across}),
            "slider": self.slider.model_copy(update={"offset": -self.slider.offset}),
            "gravity_direction": -self.gravity_direction,
            "effects": tuple(effect.mirrored() for effect in self.effects),
        }
        return self.model_copy(update=update)

    def check_contacts(self, speed: float) -> None:
        """InputError where a loose joint's contact is too soft for its loads at a crank speed of
        `speed` [rad/s].

        The loads are approximately the largest ones without clearance: inertia of the moved bodies,
        weight and effects.
        """
        crank, rod = self.crank, self.rod
        # of the slider at its outer dead centre
        inertial = crank.length * speed**2 * (1 + crank.length / rod.length)
        acceleration = inertial + float(np.hypot(*self.gravity))
        masses = {"piston_pin": self.slider.mass, "crank_pin": rod.mass + self.slider.mass}
        masses["crank_pivot"] = crank.mass + masses["crank_pin"]
        force = sum(effect.largest_force(2 * crank.length) for effect in self.effects)
        for name in self.loose:
            self._check_contact(name, masses[name] * acceleration + force, speed)

    def with_lengths(self, crank_length: float, rod_length: float) -> "Mechanism":
        """The mechanism with other lengths [m]; mass centres are scaled, all else is unchanged."""
        crank, rod = self.crank.with_length(crank_length), self.rod.with_length(rod_length)
        return self.model_copy(update={"crank": crank, "rod": rod})
