"""Moments on the crank, positive counter-clockwise; its drive and its balance."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from jointgap.effects.effect import CRANK_SIGN, FRICTION_SURVEY, Effect
from jointgap.quantities import quantity
from jointgap.section import Section


class CrankCoulombFrictionParameters(Section):
    """Parameters of ``crank_coulomb_friction``."""

    torque_N_m: quantity("N*m", ge=0) = Field(description="m, moment of friction", examples=[0.3])


class CrankCoulombFriction(Effect):
    """Dry friction of the crank's bearings and seals, whatever their load."""

    SITE: ClassVar = "crank_pivot"
    LAW: ClassVar = f"M = -m sgn w, {CRANK_SIGN}"
    REFERENCE: ClassVar = FRICTION_SURVEY

    name: Literal["crank_coulomb_friction"]
    parameters: CrankCoulombFrictionParameters


class CrankViscousFrictionParameters(Section):
    """Parameters of ``crank_viscous_friction``."""

    damping_N_m_s: quantity("N*m*s", ge=0) = Field(description="c, moment per speed", examples=[0.01])


class CrankViscousFriction(Effect):
    """Friction of the crank's bearings in their lubricant."""

    SITE: ClassVar = "crank_pivot"
    LAW: ClassVar = "M = -c w"
    REFERENCE: ClassVar = FRICTION_SURVEY

    name: Literal["crank_viscous_friction"]
    parameters: CrankViscousFrictionParameters


class CrankUnbalanceParameters(Section):
    """Parameters of ``crank_unbalance``."""

    unbalance_kg_m: quantity("kg*m", ge=0) = Field(
        description="U, mass times distance from the pivot", examples=[0.005]
    )
    angle_rad: quantity("rad") = Field(0.0, description="its direction, from the crank's own", examples=[1.0])


class CrankUnbalance(Effect):
    """A mass on the crank beyond nominal.

    It sits at the crank's length from the pivot, so that U / crank.length is its mass and U crank.length its inertia.
    Frame forces, gravity and a motor's drive show it.
    """

    SITE: ClassVar = "crank"
    LAW: ClassVar = "mass U / crank.length, crank.length from the pivot"
    REFERENCE: ClassVar = "ISO 21940-2:2017, rotor balancing, vocabulary"

    name: Literal["crank_unbalance"]
    parameters: CrankUnbalanceParameters


class SpeedFluctuationParameters(Section):
    """Parameters of ``speed_fluctuation``."""

    ratio: quantity("", ge=0, le=0.3) = Field(description="a, amplitude over the mean", examples=[0.02])
    order: Annotated[int, Field(ge=1, le=12)] = Field(description="k, cycles per revolution", examples=[2])
    phase_rad: quantity("rad") = Field(0.0, description="angle k theta of the largest speed", examples=[0.5])


class SpeedFluctuation(Effect):
    """The drive's speed depends on the crank angle; for the constant drive alone, of which simulate.speed is w0."""

    SITE: ClassVar = "drive"
    LAW: ClassVar = "w = w0 (1 + a cos(k theta - phase))"
    REFERENCE: ClassVar = "definition"

    name: Literal["speed_fluctuation"]
    parameters: SpeedFluctuationParameters
