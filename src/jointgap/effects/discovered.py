"""Force laws that somebody found or wants to try: formulas in field terms."""

from typing import ClassVar, Literal

from pydantic import Field, model_validator

from jointgap.effects.effect import Effect
from jointgap.formula import compile_formula
from jointgap.quantities import quantity
from jointgap.section import Section

REFERENCE = "by regression, e.g. Brunton, Proctor and Kutz, PNAS 113 (2016) 3932-3937"


class FormulaParameters(Section):
    """Parameters of ``discovered_slider_force`` and ``discovered_crank_torque``."""

    formula: str = Field(
        description="SI; of v, x (slider), w, theta (crank), t, pi, sin cos tan tanh exp log sqrt abs sgn, |..|, ^",
        examples=["-a*v*|v| + b*sin(theta)"],
    )
    coefficients: dict[str, quantity("")] = Field(
        {}, description="names in the formula -> numbers, SI", examples=[{"a": 1.2, "b": 3.0}]
    )

    @model_validator(mode="after")
    def _formula_can_be_read(self):
        compile_formula(self.formula, self.coefficients)
        return self


class DiscoveredSliderForce(Effect):
    """A force on the slider, along +x [N]."""

    SITE: ClassVar = "slider"
    LAW: ClassVar = "F = formula of v, x, w, theta, t"
    REFERENCE: ClassVar = REFERENCE

    name: Literal["discovered_slider_force"]
    label: str = Field("", description="what to call it in tables and figures")
    parameters: FormulaParameters


class DiscoveredCrankTorque(Effect):
    """A moment on the crank, counter-clockwise [N m]."""

    SITE: ClassVar = "crank"
    LAW: ClassVar = "M = formula of v, x, w, theta, t"
    REFERENCE: ClassVar = REFERENCE

    name: Literal["discovered_crank_torque"]
    label: str = Field("", description="what to call it in tables and figures")
    parameters: FormulaParameters
