"""Forces on the slider; positive along +x."""

from typing import ClassVar, Literal

from pydantic import Field

from jointgap.effects.effect import FRICTION_SURVEY, SLIDER_SIGN, Effect
from jointgap.quantities import quantity
from jointgap.section import Section


class SliderCoulombFrictionParameters(Section):
    """Parameters of ``slider_coulomb_friction``."""

    force_N: quantity("N", ge=0) = Field(description="f, force of friction", examples=[20.0])


class SliderCoulombFriction(Effect):
    """Dry friction of the slider that does not depend on the load of its guide, as that of piston rings."""

    SITE: ClassVar = "slider"
    LAW: ClassVar = f"F = -f sgn v, {SLIDER_SIGN}"
    REFERENCE: ClassVar = "Coulomb, Théorie des machines simples (1785)"

    name: Literal["slider_coulomb_friction"]
    parameters: SliderCoulombFrictionParameters


class SliderViscousFrictionParameters(Section):
    """Parameters of ``slider_viscous_friction``."""

    damping_N_s_m: quantity("N*s/m", ge=0) = Field(description="c, force per velocity", examples=[5.0])


class SliderViscousFriction(Effect):
    """Friction of the slider in a film of lubricant."""

    SITE: ClassVar = "slider"
    LAW: ClassVar = "F = -c v"
    REFERENCE: ClassVar = FRICTION_SURVEY

    name: Literal["slider_viscous_friction"]
    parameters: SliderViscousFrictionParameters


class SliderQuadraticDragParameters(Section):
    """Parameters of ``slider_quadratic_drag``."""

    drag_N_s2_m2: quantity("N*s^2/m^2", ge=0) = Field(description="d, force per velocity squared", examples=[0.5])


class SliderQuadraticDrag(Effect):
    """Drag of a fluid that the slider pushes aside or through an orifice."""

    SITE: ClassVar = "slider"
    LAW: ClassVar = "F = -d v |v|"
    REFERENCE: ClassVar = "Newton, Principia (1687), book II, section II"

    name: Literal["slider_quadratic_drag"]
    parameters: SliderQuadraticDragParameters


class SliderLoadFrictionParameters(Section):
    """Parameters of ``slider_load_friction``."""

    coefficient: quantity("", ge=0, le=1) = Field(description="k, coefficient of friction", examples=[0.1])


class SliderLoadFriction(Effect):
    """Dry friction between slider and guide in proportion to the guide's normal force N."""

    SITE: ClassVar = "guide"
    LAW: ClassVar = f"F = -k |N| sgn v, {SLIDER_SIGN}, N: normal force of the guide"
    REFERENCE: ClassVar = "Amontons, Mém. Acad. R. Sci. (1699) 206-222"

    name: Literal["slider_load_friction"]
    parameters: SliderLoadFrictionParameters


class SliderConstantForceParameters(Section):
    """Parameters of ``slider_constant_force``."""

    force_N: quantity("N") = Field(description="f, force along +x", examples=[-50.0])


class SliderConstantForce(Effect):
    """A constant force, such as a load or a difference of pressures."""

    SITE: ClassVar = "slider"
    LAW: ClassVar = "F = f"
    REFERENCE: ClassVar = "definition"

    name: Literal["slider_constant_force"]
    parameters: SliderConstantForceParameters


class SliderSpringParameters(Section):
    """Parameters of ``slider_spring``."""

    stiffness_N_m: quantity("N/m", ge=0) = Field(description="k, force per length", examples=[2000.0])
    rest_position_m: quantity("m") = Field(description="x0, position of the slider without force", examples=[0.56])


class SliderSpring(Effect):
    """A linear spring between frame and slider."""

    SITE: ClassVar = "slider"
    LAW: ClassVar = "F = -k (x - x0)"
    REFERENCE: ClassVar = "Hooke, De potentia restitutiva (1678)"

    name: Literal["slider_spring"]
    parameters: SliderSpringParameters


class GasPressureParameters(Section):
    """Parameters of ``gas_pressure``."""

    force_N: quantity("N", ge=0) = Field(description="f, force with the slider farthest out", examples=[100.0])
    dead_length_m: quantity("m", gt=0) = Field(
        description="h, length of the cylinder beyond the farthest-out position", examples=[0.05]
    )
    exponent: quantity("", ge=1, le=1.4) = Field(
        description="n, polytropic exponent: 1 isothermal, 1.4 adiabatic for air", examples=[1.3]
    )


class GasPressure(Effect):
    """A closed cylinder of gas beyond the slider: compressed and expanded without loss."""

    SITE: ClassVar = "slider"
    LAW: ClassVar = "F = -f (h / (h + x_out - x))^n, closed cycle, x_out: farthest-out position"
    REFERENCE: ClassVar = "Heywood, Internal combustion engine fundamentals (1988)"

    name: Literal["gas_pressure"]
    parameters: GasPressureParameters


class HarmonicForceParameters(Section):
    """Parameters of ``harmonic_force``."""

    force_N: quantity("N", ge=0) = Field(description="f, amplitude", examples=[10.0])
    frequency_Hz: quantity("Hz") = Field(description="nu, cycles per second", examples=[37.0])
    phase_rad: quantity("rad") = Field(0.0, description="phase at t = 0", examples=[0.0])


class HarmonicForce(Effect):
    """A force that swings at a frequency of its own, not locked to the crank."""

    SITE: ClassVar = "slider"
    LAW: ClassVar = "F = f cos(2 pi nu t + phase), not locked to the crank"
    REFERENCE: ClassVar = "definition"

    name: Literal["harmonic_force"]
    parameters: HarmonicForceParameters


class AddedSliderMassParameters(Section):
    """Parameters of ``added_slider_mass``."""

    mass_kg: quantity("kg") = Field(description="m, mass beyond nominal", examples=[0.05])


class AddedSliderMass(Effect):
    """The slider is heavier, or lighter, than its nominal mass."""

    SITE: ClassVar = "slider"
    LAW: ClassVar = "slider.mass + m"
    REFERENCE: ClassVar = "definition"

    name: Literal["added_slider_mass"]
    parameters: AddedSliderMassParameters


class SliderOffsetParameters(Section):
    """Parameters of ``slider_offset``."""

    offset_m: quantity("m") = Field(description="b, offset beyond nominal", examples=[0.01])


class SliderOffset(Effect):
    """The slide lies beside its nominal line."""

    SITE: ClassVar = "guide"
    LAW: ClassVar = "slider.offset + b"
    REFERENCE: ClassVar = "definition"

    name: Literal["slider_offset"]
    parameters: SliderOffsetParameters
