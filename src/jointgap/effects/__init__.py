"""The catalogue of physical effects: laws, parameters with units and bounds, references."""

from typing import Annotated

from pydantic import Field

from jointgap.effects.crank_effects import CrankCoulombFriction, CrankUnbalance, CrankViscousFriction, SpeedFluctuation
from jointgap.effects.discovered import DiscoveredCrankTorque, DiscoveredSliderForce
from jointgap.effects.effect import CRANK_SIGN_SPEED, SLIDER_SIGN_SPEED, Effect
from jointgap.effects.joint_and_rod_effects import (
    CrankPinClearance,
    CrankPivotClearance,
    Gravity,
    LinkLengthError,
    LubricatedJoint,
    PinFriction,
    PistonPinClearance,
    RodFlexibility,
)
from jointgap.effects.slider_effects import (
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
