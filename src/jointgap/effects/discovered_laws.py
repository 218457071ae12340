"""Force laws that a regression found or that somebody wants to try: formulas in field terms."""

import re

from pydantic import Field, model_validator

from jointgap.effects.base import Effect, Records, page
from jointgap.formula import compile_formula
from jointgap.quantities import quantity
from jointgap.section import Section

_MIRRORED = re.compile(r"\b(theta|w)\b", re.ASCII)
"""Variables of a formula that have the other sign as seen from behind."""


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


class DiscoveredLaw(Effect):
    """A law by its formula; its candidates are the single terms of `jointgap.rig.model`."""

    REFERENCE = "by regression, e.g. Brunton, Proctor and Kutz, PNAS 113 (2016) 3932-3937"
    KEYS = {"label": (str, Field("", description="what to call it in tables and figures"))}
    PARAMETERS = FormulaParameters

    def compile_into(self, records: Records) -> None:
        super().compile_into(records)
        program = compile_formula(self.parameters.formula, self.parameters.coefficients)
        records["formulas"][f"{self.GROUP}_formula"] = program

    def mirrored(self) -> Effect:
        return self.with_parameters(formula=_MIRRORED.sub(r"(-\1)", self.parameters.formula))


@page(order=230)
class DiscoveredSliderForce(DiscoveredLaw):
    """A force on the slider, along +x [N]."""

    GROUP = "slider"
    SITE = "slider"
    LAW = "F = formula of v, x, w, theta, t"
    WORDS = "a force on the slider that follows a formula found by regression"


@page(order=240)
class DiscoveredCrankTorque(DiscoveredLaw):
    """A moment on the crank, counter-clockwise [N m]."""

    GROUP = "crank"
    SITE = "crank"
    LAW = "M = formula of v, x, w, theta, t"
    WORDS = "a torque on the crank that follows a formula found by regression"

    def mirrored(self) -> Effect:
        seen = super().mirrored()
        return seen.with_parameters(formula=f"-({seen.parameters.formula})")
