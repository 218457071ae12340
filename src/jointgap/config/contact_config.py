"""Contact of a journal with its bearing: how stiff, how lossy, how rough."""

import math
from typing import Literal

from pydantic import Field, model_validator

from jointgap.quantities import (
    FrictionCoefficient,
    NonNegativeNumber,
    PoissonRatio,
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
FrictionLaw = Literal["coulomb", "threlfall", "ambrosio", "bengisu_akay", "lugre"]

FIRM_FORCE, FIRM_PENETRATION = 1e3, 1e-9
"""A force [N] that must press a journal into its bearing by more than this [m]: atoms are a fifth of it apart, so that a
contact that yields less is rigid for all that continuum mechanics can say."""

STRIBECK_SPEED = 0.01
"""[m/s] Default of stribeck_speed: friction has fallen from its static to its kinetic value some times above it."""

BRISTLE_STIFFNESS = 1e5
"""[1/m] Default of bristle_stiffness: friction 0.1 is reached after a micrometre, the size of asperities."""

BRISTLE_ACCELERATION = 1e4
"""[m/s^2] Default bristle_damping is critical for a body that is pressed on with this force per mass (1 kN on 0.1 kg)."""

# Which friction laws read a key beyond `friction`.
_READ_BY = {
    "dead_band_speed": ("ambrosio",),
    "static_friction": ("bengisu_akay", "lugre"),
    "stribeck_speed": ("bengisu_akay", "lugre"),
    "viscous_friction": ("lugre",),
    "bristle_stiffness": ("lugre",),
    "bristle_damping": ("lugre",),
}


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
        description="a slower impact is damped as one at this speed, for the laws' damping has no bound as the speed goes to zero",
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
    friction_law: FrictionLaw = Field("coulomb", description="how friction depends on the sliding speed")
    friction: FrictionCoefficient = Field(
        0.0, description="coefficient of kinetic friction; 0: no friction, whatever the law"
    )
    friction_speed: PositiveSpeed = Field(
        0.001,
        description="sliding speed over which friction is regularised around zero, e.g. friction * tanh(v / friction_speed)",
    )
    dead_band_speed: quantity("m/s", ge=0) | None = Field(
        None,
        description="ambrosio: no friction below it, full friction above friction_speed; null: a tenth of friction_speed",
    )
    static_friction: quantity("", ge=0, le=1) | None = Field(
        None, description="bengisu_akay, lugre: coefficient of static friction; null: as friction"
    )
    stribeck_speed: PositiveSpeed | None = Field(
        None, description="bengisu_akay, lugre: speed over which static friction falls to kinetic; null: 0.01 m/s"
    )
    viscous_friction: NonNegativeNumber | None = Field(
        None, description="lugre: sigma_2 in s/m, coefficient of friction per sliding speed; null: 0"
    )
    bristle_stiffness: PositiveNumber | None = Field(
        None, description="lugre: sigma_0 in 1/m, per normal force; null: 1e5 1/m"
    )
    bristle_damping: NonNegativeNumber | None = Field(
        None,
        description="lugre: sigma_1 in s/m, per normal force; null: critical, 2 sqrt(bristle_stiffness / 1e4 m/s^2)",
    )

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
    def _friction_law_reads_what_is_given(self):
        for key, laws in _READ_BY.items():
            if getattr(self, key) is not None and self.friction_law not in laws:
                raise ValueError(
                    f"{key} is read by friction_law {' and '.join(laws)} alone, not by {self.friction_law}; leave it out or set it to null"
                )
        if self.static_friction is not None and self.static_friction < self.friction:
            raise ValueError(
                f"static_friction {self.static_friction:g} is less than friction {self.friction:g}; raise it"
            )
        if self.dead_band_speed is not None and self.dead_band_speed >= self.friction_speed:
            raise ValueError(
                f"dead_band_speed {self.dead_band_speed:g} m/s is not below friction_speed {self.friction_speed:g} m/s; lower it"
            )
        return self

    @model_validator(mode="after")
    def _hertz_has_one_exponent(self):
        if self.stiffness is None and self.exponent != 1.5:
            raise ValueError(
                f"exponent {self.exponent:g} needs stiffness in N/m^{self.exponent:g}; Hertz's, which is taken where stiffness is "
                "null, holds for exponent 1.5 alone"
            )
        return self

    @model_validator(mode="after")
    def _it_yields(self):
        stiffest = FIRM_FORCE / FIRM_PENETRATION**self.exponent
        if self.stiffness is not None and self.stiffness > stiffest:
            raise ValueError(
                f"stiffness {self.stiffness:g} N/m^{self.exponent:g} makes the contact infinitely stiff: {FIRM_FORCE:g} N would "
                f"press it in by less than {FIRM_PENETRATION:g} m, a few atoms; give {stiffest:.3g} N/m^{self.exponent:g} at most "
                "(Hertz for steel pins has some 1e10 N/m^1.5)"
            )
        return self

    def friction_parameters(self) -> dict[str, float]:
        """Every key of the friction laws in SI, defaults filled in."""

        def given_or(key: str, default: float) -> float:
            return default if getattr(self, key) is None else getattr(self, key)

        stiffness = given_or("bristle_stiffness", BRISTLE_STIFFNESS)
        return {
            "friction": self.friction,
            "friction_speed": self.friction_speed,
            "dead_band_speed": given_or("dead_band_speed", 0.1 * self.friction_speed),
            "static_friction": given_or("static_friction", self.friction),
            "stribeck_speed": given_or("stribeck_speed", STRIBECK_SPEED),
            "viscous_friction": given_or("viscous_friction", 0.0),
            "bristle_stiffness": stiffness,
            "bristle_damping": given_or("bristle_damping", 2 * math.sqrt(stiffness / BRISTLE_ACCELERATION)),
        }
