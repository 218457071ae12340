"""Clearance of a joint: one effect for each of the three."""

import math
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.joints import REFERENCE_APPROACH_SPEED
from jointgap.core.section import ConfigModel
from jointgap.core.units import FrictionCoefficient, quantity
from jointgap.effects.base import Candidates, DataEffect, FitContext, Values, amplitude, joint_data, register_effect

#: [m] Far less is lost in the rounding of the radii too.
LEAST_CLEARANCE = 1e-9

# [m] and coefficients of friction of a joint that was ideal, from which fits start: where it slides and where it is
# stuck depends on friction so much that it is tried beside each size
_FIRST_CLEARANCE, _FIRST_FRICTIONS = 5e-5, (0.03, 0.1, 0.2)

# [m] of a joint that was ideal, between which it is searched: from a fit's play to a rattle
_CLEARANCES = (2e-6, 2e-3)

# [1, of the nominal clearance] of a loose joint, between which it is searched: what a gauge misread, and long wear
_LOOSER = (0.5, 3.0)

#: What the contact of a joint may have that was taken as ideal: nobody measured it. Steel on bronze or steel, dry to
#: greased.
RESTITUTIONS, FRICTIONS = (0.3, 0.9), (0.0, 0.3)

#: By what factor its stiffness may differ from what the file says of its contact, either way, and the damping of a
#: contact that lasts: lengths of bearings and their alignment are not in Hertz's formula; and the sliding speed over
#: which its friction rises: where a journal sticks, what is read depends on it by many times the noise.
STIFFNESS_FACTOR, DAMPING_FACTOR, FRICTION_SPEED_FACTOR = 3.0, 4.0, 4.0


def _none_or_more_than_atoms(clearance: float) -> float:
    if 0 < clearance < LEAST_CLEARANCE:
        raise ValueError(
            f"is less than {LEAST_CLEARANCE:g} m, a few atoms; give 0 for an ideal joint, or {LEAST_CLEARANCE:g} m or "
            "more"
        )
    return clearance


class ClearanceParameters(ConfigModel):
    """Parameters of the effects ``crank_pivot_clearance``, ``crank_pin_clearance`` and ``piston_pin_clearance``."""

    clearance_m: Annotated[quantity("m", ge=0), AfterValidator(_none_or_more_than_atoms)] = Field(
        description="c, whole radial clearance, not beyond nominal; 0 or 1e-9 m and more", examples=[0.0002]
    )
    restitution: quantity("", ge=1e-3, lt=1) | None = Field(
        None, description="coefficient of restitution of the joint's contact; null: as its contact says", examples=[0.6]
    )
    friction: FrictionCoefficient | None = Field(
        None, description="coefficient of friction of the joint's contact; null: as its contact says", examples=[0.1]
    )
    stiffness_factor: quantity("", gt=0) = Field(
        1.0, description="factor on the stiffness of the joint's contact", examples=[2.0]
    )
    damping_factor: quantity("", gt=0) = Field(
        1.0,
        description="factor on the damping of a contact that lasts, which needs one whose memory fades",
        examples=[0.5],
    )
    friction_speed_factor: quantity("", gt=0) = Field(
        1.0, description="factor on the sliding speed over which the contact's friction rises", examples=[2.0]
    )


class Clearance(DataEffect):
    """A joint that is loose, or looser."""

    GROUP = "clearances"
    REFERENCE = "Erkaya and Uzmay (2009), equation 1"
    PARAMETERS = ClearanceParameters

    def apply(self, data: dict[str, Any]) -> None:
        joint = joint_data(data, self.NAME, self.SITE)
        joint["loose"] = self.parameters.clearance_m > 0
        if joint["loose"]:
            joint["bearing_radius"] = joint["journal_radius"] + self.parameters.clearance_m
        joint["contact"] |= self._contact(joint["contact"])

    def _contact(self, contact: dict[str, Any]) -> dict[str, Any]:
        """What is other than `contact`, the content of the joint's in a mechanism file, says."""
        own = self.parameters
        changed = {key: getattr(own, key) for key in ("restitution", "friction") if getattr(own, key) is not None}
        if own.stiffness_factor != 1.0:  # Hertz's stiffness is in proportion to the modulus
            key = "youngs_modulus" if contact["stiffness"] is None else "stiffness"
            changed[key] = own.stiffness_factor * contact[key]
        if own.damping_factor != 1.0:
            reference = contact["reference_approach_speed"] or REFERENCE_APPROACH_SPEED
            changed["reference_approach_speed"] = reference / own.damping_factor
        if own.friction_speed_factor != 1.0:
            changed["friction_speed"] = own.friction_speed_factor * contact["friction_speed"]
        return changed

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        joint, nominal = context.mechanism.joint(cls.SITE), context.mechanism.clearance(cls.SITE)
        longest = 0.05 * context.mechanism.crank.length
        if joint is not None and nominal:
            yield cls.candidate(
                amplitude("change_m", 0.05 * nominal, "m", -0.95 * nominal, longest),
                parameters=lambda values: {"clearance_m": nominal + values["change_m"]},
                is_perturbation=True,
                search_range=tuple(min((part - 1.0) * nominal, longest) for part in _LOOSER),
                # the nuisance of a pin's clearance has the effect's name
                replaces=context.replaced({cls.NAME: "change_m"}),
            )
        elif joint is not None:
            yield cls._of_ideal_joint(joint.contact, longest)

    @classmethod
    def _of_ideal_joint(cls, contact: Any, longest: float) -> Candidate:
        """The candidate of a joint without clearance, up to the `longest` [m], whose `contact` nobody measured."""
        shapes = [Parameter("contact_friction", contact.friction, *FRICTIONS, step=0.02)]
        if contact.restitution is not None:
            shapes.insert(0, Parameter("contact_restitution", contact.restitution, *RESTITUTIONS, step=0.05))
        factors = {"stiffness": STIFFNESS_FACTOR, "friction_speed": FRICTION_SPEED_FACTOR}
        if contact.reference_speed is not None:
            factors["damping"] = DAMPING_FACTOR
        for name, factor in factors.items():
            reach = math.log(factor)
            shapes.append(Parameter(f"log_{name}_factor", 0.0, -reach, reach, step=0.05 * reach))

        def parameters(values: Values) -> dict[str, float]:
            keys = [key for key in ("restitution", "friction") if f"contact_{key}" in values]
            stated = {key: values[f"contact_{key}"] for key in keys}
            stated |= {f"{name}_factor": math.exp(values[f"log_{name}_factor"]) for name in factors}
            return {"clearance_m": values["change_m"], **stated}

        nominal = {shape.key: min(max(shape.nominal, shape.low), shape.high) for shape in shapes}
        return cls.candidate(
            amplitude("change_m", 2e-5, "m", 0.0, longest),
            *shapes,
            amplitudes=("change_m",),
            parameters=parameters,
            initial_guesses=tuple(
                {"change_m": _FIRST_CLEARANCE, **nominal, "contact_friction": friction}
                for friction in dict.fromkeys((nominal["contact_friction"], *_FIRST_FRICTIONS))
            ),
            search_range=(_CLEARANCES[0], min(_CLEARANCES[1], longest)),
        )


@register_effect(order=180)
class CrankPivotClearance(Clearance):
    """The crank pivot is loose, or looser; needs the joint's data (a mapping, not the word ideal)."""

    SITE = "crank_pivot"
    LAW = "crank pivot loose with the radial clearance c; c = 0: ideal"
    WORDS = "clearance in the crank pivot"


@register_effect(order=190)
class CrankPinClearance(Clearance):
    """The crank pin is loose, or looser; needs the joint's data (a mapping, not the word ideal)."""

    SITE = "crank_pin"
    LAW = "crank pin loose with the radial clearance c; c = 0: ideal"
    WORDS = "clearance in the crank pin"


@register_effect(order=200)
class PistonPinClearance(Clearance):
    """The piston pin is loose, or looser; needs the joint's data (a mapping, not the word ideal)."""

    SITE = "piston_pin"
    LAW = "piston pin loose with the radial clearance c; c = 0: ideal"
    WORDS = "clearance in the piston pin"
