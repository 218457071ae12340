"""The mechanism file: bodies, joints with their contacts, and effects of one slider-crank."""

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, WrapValidator, model_validator

from jointgap.config.friction_laws import FRICTION_LAWS, FRICTION_PARAMETERS, described, laws_reading
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import FROM_FRAME, JOINT, REFERENCE_APPROACH_SPEED
from jointgap.core.section import Section, complaints
from jointgap.core.units import (
    Angle,
    FrictionCoefficient,
    Length,
    NonNegativeNumber,
    PoissonRatio,
    PositiveInertia,
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
"""A force [N] that must press a journal into its bearing by more than this [m].

Atoms are a fifth of it apart: a contact that yields less is rigid for all that continuum mechanics can say."""


class Contact(Section):
    """Material, restitution and friction of one pair of journal and bearing."""

    law: Law = Field(
        "lankarani_nikravesh", description="how damping follows from the restitution asked for; or penalty"
    )
    youngs_modulus: quantity("Pa", gt=0, le=1e13) = Field(
        207e9, description="Young's modulus of journal and bearing; diamond has 1.2e12 Pa, more than 1e13 Pa is refused"
    )
    poisson_ratio: PoissonRatio = Field(0.3, description="Poisson's ratio of journal and bearing")
    restitution: quantity("", ge=1e-3, lt=1) | None = Field(
        None, description="coefficient of restitution asked for; needed unless the law is penalty, which has none"
    )
    least_approach_speed: PositiveSpeed = Field(
        0.001,
        description="a slower impact is damped as one at this speed, for the laws' damping has no bound as the speed "
        "goes to zero",
    )
    memory: Literal["fading", "published"] | None = Field(
        None,
        description="what damps a contact that lasts; fading: once a free impact would be over (with exponent 1.5 and "
        "a restitution of 0.1 or more), its damping goes over from that of its own impact to that of one at "
        "reference_approach_speed; published: it keeps the approach speed of its last impact for good, as the laws are "
        "printed. null: fading; law penalty has no memory",
    )
    reference_approach_speed: PositiveSpeed | None = Field(
        None,
        description="memory fading: approach speed as whose impact a lasting contact is damped; null: "
        f"{REFERENCE_APPROACH_SPEED:g} m/s",
    )
    penalty_damping: quantity("N*s/m", ge=0, le=1e9) | None = Field(
        None,
        description="law penalty: largest damping c_max, reached at penalty_depth; 1e9 N s/m stop 1 kg within 1 ns",
    )
    penalty_depth: quantity("m", gt=0) | None = Field(
        None, description="law penalty: penetration d_max from which on the damping is c_max"
    )
    stiffness: PositiveNumber | None = Field(
        None, description="contact stiffness in N/m^exponent; null: Hertz, from material and radii"
    )
    exponent: quantity("", ge=1, le=10) = Field(
        1.5, description="exponent of the penetration; 3/2 for Hertz, another needs a stiffness"
    )
    friction_law: Literal[tuple(FRICTION_LAWS)] = Field(
        "coulomb", description="how friction depends on the sliding speed"
    )
    friction: FrictionCoefficient = Field(
        0.0, description="coefficient of kinetic friction; 0: no friction, whatever the law"
    )
    friction_speed: PositiveSpeed = Field(
        0.001,
        description="sliding speed over which friction is regularised around zero, e.g. friction * tanh(v / "
        "friction_speed)",
    )
    dead_band_speed: quantity("m/s", ge=0) | None = Field(None, description=described("dead_band_speed"))
    static_friction: quantity("", ge=0, le=1) | None = Field(None, description=described("static_friction"))
    stribeck_speed: PositiveSpeed | None = Field(None, description=described("stribeck_speed"))
    viscous_friction: NonNegativeNumber | None = Field(None, description=described("viscous_friction"))
    bristle_stiffness: PositiveNumber | None = Field(None, description=described("bristle_stiffness"))
    bristle_damping: NonNegativeNumber | None = Field(None, description=described("bristle_damping"))

    @model_validator(mode="after")
    def _law_has_what_it_needs(self):
        penalty = {"penalty_damping": self.penalty_damping, "penalty_depth": self.penalty_depth}
        needed, spare = penalty, {"restitution": self.restitution}
        if self.law != "penalty":
            needed, spare = spare, needed
        if missing := [key for key, value in needed.items() if value is None]:
            raise ValueError(
                f"law {self.law} needs {' and '.join(missing)}; add {'it' if len(missing) == 1 else 'them'}"
            )
        if given := [key for key, value in spare.items() if value is not None]:
            raise ValueError(
                f"law {self.law} does not read {' and '.join(given)}; leave out or set to null, or choose another law"
            )
        return self

    @model_validator(mode="after")
    def _only_what_fades_has_a_reference(self):
        if self.law == "penalty":
            for key in ("memory", "reference_approach_speed"):
                if getattr(self, key) is not None:
                    raise ValueError(
                        f"law penalty does not read {key}, for its damping knows no approach speed; leave it out or "
                        "set it to null, or choose another law"
                    )
        elif self.memory == "published" and self.reference_approach_speed is not None:
            raise ValueError(
                "memory published does not read reference_approach_speed, for a contact keeps that of its last impact; "
                "leave it out or set it to null, or choose memory fading"
            )
        return self

    @property
    def reference_speed(self) -> float | None:
        """Approach speed [m/s] as whose impact a lasting contact is damped; None where nothing fades."""
        if self.law == "penalty" or self.memory == "published":
            return None
        return self.reference_approach_speed or REFERENCE_APPROACH_SPEED

    @model_validator(mode="after")
    def _friction_law_reads_what_is_given(self):
        for key in FRICTION_PARAMETERS:
            if getattr(self, key) is not None and key not in FRICTION_LAWS[self.friction_law].reads:
                raise ValueError(
                    f"{key} is read by friction_law {' and '.join(laws_reading(key))} alone, not by "
                    f"{self.friction_law}; leave it out or set it to null"
                )
        if self.static_friction is not None and self.static_friction < self.friction:
            raise ValueError(
                f"static_friction {self.static_friction:g} is less than friction {self.friction:g}; raise it"
            )
        if self.dead_band_speed is not None and self.dead_band_speed >= self.friction_speed:
            raise ValueError(
                f"dead_band_speed {self.dead_band_speed:g} m/s is not below friction_speed {self.friction_speed:g} "
                "m/s; lower it"
            )
        return self

    @model_validator(mode="after")
    def _hertz_has_one_exponent(self):
        if self.stiffness is None and self.exponent != 1.5:
            raise ValueError(
                f"exponent {self.exponent:g} needs stiffness in N/m^{self.exponent:g}; Hertz's, which is taken where "
                "stiffness is "
                "null, holds for exponent 1.5 alone"
            )
        return self

    @model_validator(mode="after")
    def _it_yields(self):
        stiffest = FIRM_FORCE / FIRM_PENETRATION**self.exponent
        if self.stiffness is not None and self.stiffness > stiffest:
            raise ValueError(
                f"stiffness {self.stiffness:g} N/m^{self.exponent:g} makes the contact infinitely stiff: "
                f"{FIRM_FORCE:g} N would "
                f"press it in by less than {FIRM_PENETRATION:g} m, a few atoms; give {stiffest:.3g} "
                f"N/m^{self.exponent:g} at most "
                "(Hertz for steel pins has some 1e10 N/m^1.5)"
            )
        return self

    def friction_parameters(self) -> dict[str, float]:
        """Every key of the friction laws in SI, defaults filled in."""
        values = {"friction": self.friction, "friction_speed": self.friction_speed}
        for key, parameter in FRICTION_PARAMETERS.items():
            given = getattr(self, key)
            values[key] = parameter.default(values) if given is None else given
        return values


SOFT_SHARE = 0.5
"""Share of the journal's radius by which its loads may press it in: laws of contact are for small depths."""


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
                f"journal_radius {self.journal_radius:g} m is not smaller than bearing_radius "
                f"{self.bearing_radius:g} m; "
                "a loose joint needs a journal smaller than its bearing"
            )
        return self

    def too_soft_for(self, load: float) -> str:
        """Why its contact is too soft for a force of `load` [N], and what to do; empty where it is not."""
        hertz, exponent = self.contact.stiffness is None, self.contact.exponent
        stiffness = hertz_stiffness(self) if hertz else self.contact.stiffness
        softest = load / (SOFT_SHARE * self.journal_radius) ** exponent
        if stiffness >= softest:
            return ""
        key, value, unit = "stiffness", stiffness, f"N/m^{exponent:g}"
        if hertz:
            key, value, unit = "youngs_modulus", self.contact.youngs_modulus, "Pa"
        return (
            f"contact.{key} {value:g} {unit} is too soft: {load:.4g} N would press the journal in by "
            f"{(load / stiffness) ** (1 / exponent):.3g} m, more than {SOFT_SHARE:g} of journal_radius "
            f"{self.journal_radius:g} m; give {value * softest / stiffness:.3g} {unit} at least"
        )

    @property
    def clearance(self) -> float:
        """Radial clearance r_c = r_B - r_J [m] (equation 1) of the joint's data, be it loose or not."""
        return self.bearing_radius - self.journal_radius


def hertz_stiffness(joint: Joint) -> float:
    """K [N/m^1.5] of a journal in a bearing of the same material; conforming contact of Hertz."""
    material = (1 - joint.contact.poisson_ratio**2) / joint.contact.youngs_modulus
    return 4 / (3 * 2 * material) * math.sqrt(joint.bearing_radius * joint.journal_radius / joint.clearance)


def _joint(name: str) -> Any:
    """Type of a joint: ideal, or with a journal that one of its two bodies carries."""
    carriers = JOINT[name].partner, JOINT[name].body

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

    crank_pivot: _joint("crank_pivot") = Field("ideal", description="joint of frame and crank")
    crank_pin: _joint("crank_pin") = Field(description="joint 2 of the paper")
    piston_pin: _joint("piston_pin") = Field(description="joint 3 of the paper")


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
            raise InputError(f"with the effects {names}: {'; '.join(complaints(error, data))}") from error

    def with_lengths(self, crank_length: float, rod_length: float) -> "Mechanism":
        """The mechanism with other `crank_length` and `rod_length` [m]; mass centres keep their share, all else
        stays.
        """
        links = {"crank": self.crank.with_length(crank_length), "rod": self.rod.with_length(rod_length)}
        return self.model_copy(update=links)
