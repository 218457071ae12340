"""Clearance of a joint: one effect for each of the three."""

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from jointgap.effects.base import Candidates, Effect, FitContext, TrialContext, TrialSize, amplitude, joint_data, page
from jointgap.quantities import quantity
from jointgap.section import Section

LEAST_CLEARANCE = 1e-9
"""[m] Far less is lost in the rounding of the radii too."""

_FIRST_CLEARANCES = (2e-5, 1e-4)
"""[m] of a joint that was ideal, from which fits start: any of them lets the pin fly and hit."""

_CLEARANCES = tuple(8e-6 * 1.35**place for place in range(15))
"""[m] of a joint that was ideal, 8 um to 0.5 mm, in the steps that a `Candidate`'s grid asks for."""


def _none_or_more_than_atoms(clearance: float) -> float:
    if 0 < clearance < LEAST_CLEARANCE:
        raise ValueError(
            f"is less than {LEAST_CLEARANCE:g} m, a few atoms; give 0 for an ideal joint, or {LEAST_CLEARANCE:g} m or "
            "more"
        )
    return clearance


class ClearanceParameters(Section):
    """Parameters of the effects ``crank_pivot_clearance``, ``crank_pin_clearance`` and ``piston_pin_clearance``."""

    clearance_m: Annotated[quantity("m", ge=0), AfterValidator(_none_or_more_than_atoms)] = Field(
        description="c, whole radial clearance, not beyond nominal; 0 or 1e-9 m and more", examples=[0.0002]
    )


class Clearance(Effect):
    """A joint that is loose, or looser."""

    GROUP = "clearances"
    REFERENCE = "Erkaya and Uzmay (2009), equation 1"
    PARAMETERS = ClearanceParameters

    def apply(self, data: dict[str, Any]) -> None:
        joint = joint_data(data, self.NAME, self.SITE)
        joint["loose"] = self.parameters.clearance_m > 0
        if joint["loose"]:
            joint["bearing_radius"] = joint["journal_radius"] + self.parameters.clearance_m

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        mechanism = context.mechanism
        if mechanism.joint(cls.SITE) is None:
            return
        nominal, longest = mechanism.clearance(cls.SITE), 0.05 * mechanism.crank.length
        yield cls.candidate(
            amplitude("change_m", 0.05 * nominal if nominal else 2e-5, "m", -0.95 * nominal, longest),
            parameters=lambda values: {"clearance_m": nominal + values["change_m"]},
            initial_guesses=({},) if nominal else tuple({"change_m": value} for value in _FIRST_CLEARANCES),
            grid=() if nominal else _CLEARANCES,
            is_perturbation=nominal > 0.0,
            replaces=context.replaced(
                {cls.NAME: "change_m"}
            ),  # the nuisance of a pin's clearance has the effect's name
        )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        data = context.rig.mechanism["joints"][cls.SITE]
        nominal = data["bearing_radius"] - data["journal_radius"] if cls.SITE in context.rig.loose else 0.0
        first = 1e-5 if nominal else 5e-5
        return TrialSize(lambda size: {"clearance_m": nominal + size}, first, 1.5e-3, 2e-6)


@page(order=180)
class CrankPivotClearance(Clearance):
    """The crank pivot is loose, or looser; needs the joint's data (a mapping, not the word ideal)."""

    SITE = "crank_pivot"
    LAW = "crank pivot loose with the radial clearance c; c = 0: ideal"
    WORDS = "clearance in the crank pivot"


@page(order=190)
class CrankPinClearance(Clearance):
    """The crank pin is loose, or looser; needs the joint's data (a mapping, not the word ideal)."""

    SITE = "crank_pin"
    LAW = "crank pin loose with the radial clearance c; c = 0: ideal"
    WORDS = "clearance in the crank pin"


@page(order=200)
class PistonPinClearance(Clearance):
    """The piston pin is loose, or looser; needs the joint's data (a mapping, not the word ideal)."""

    SITE = "piston_pin"
    LAW = "piston pin loose with the radial clearance c; c = 0: ideal"
    WORDS = "clearance in the piston pin"
