"""The catalogue of physical effects: laws, parameters with units and bounds, references."""

from typing import Annotated

from pydantic import Field

from jointgap.config.effects.base import CRANK_SIGN_SPEED, SLIDER_SIGN_SPEED, Effect
from jointgap.config.effects.crank import CrankCoulombFriction, CrankUnbalance, CrankViscousFriction, SpeedFluctuation
from jointgap.config.effects.discovered import DiscoveredCrankTorque, DiscoveredSliderForce
from jointgap.config.effects.slider import (
    AddedSliderMass,
    GasPressure,
    HarmonicForce,
    SliderConstantForce,
    SliderCoulombFriction,
    SliderLoadFriction,
    SliderOffset,
    SliderQuadraticDrag,
    SliderSpring,
    SliderViscousFriction,
)
from jointgap.config.effects.structure import (
    CrankPinClearance,
    CrankPivotClearance,
    Gravity,
    LinkLengthError,
    LubricatedJoint,
    PinFriction,
    PistonPinClearance,
    RodFlexibility,
)

AnyEffect = Annotated[
    Gravity
    | SliderCoulombFriction
    | SliderViscousFriction
    | SliderQuadraticDrag
    | SliderLoadFriction
    | SliderConstantForce
    | SliderSpring
    | GasPressure
    | HarmonicForce
    | PinFriction
    | CrankCoulombFriction
    | CrankViscousFriction
    | CrankUnbalance
    | AddedSliderMass
    | SpeedFluctuation
    | SliderOffset
    | LinkLengthError
    | CrankPivotClearance
    | CrankPinClearance
    | PistonPinClearance
    | RodFlexibility
    | LubricatedJoint
    | DiscoveredSliderForce
    | DiscoveredCrankTorque,
    Field(discriminator="name"),
]
"""One effect of a mechanism file, told from the others by its name."""

EFFECTS: dict[str, type[Effect]] = {
    effect.model_fields["name"].annotation.__args__[0]: effect for effect in AnyEffect.__args__[0].__args__
}
"""Every effect by its name, in the order of the catalogue."""

__all__ = ["CRANK_SIGN_SPEED", "EFFECTS", "SLIDER_SIGN_SPEED", "AnyEffect", "Effect"]
