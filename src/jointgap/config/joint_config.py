"""Revolute joints: ideal or loose, with the contact of the journal in its bearing: how stiff, how lossy, how rough."""

import math
from typing import Annotated, Any, Literal

from pydantic import Field, WrapValidator, model_validator

from jointgap.config.friction_laws import FRICTION_LAWS, FRICTION_PARAMETERS, described, laws_reading
from jointgap.core.joints import JOINT, REFERENCE_APPROACH_SPEED
from jointgap.core.units import (
    FrictionCoefficient,
    NonNegativeNumber,
    PoissonRatio,
    PositiveLength,
    PositiveNumber,
    PositiveSpeed,
    quantity,
)
from jointgap.section import Section

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
