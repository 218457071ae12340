"""Clearance of a revolute joint."""

import math
from collections.abc import Sequence
from itertools import product
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.joints import REFERENCE_APPROACH_SPEED
from jointgap.core.section import ConfigModel
from jointgap.core.units import FrictionCoefficient, quantity
from jointgap.effects.base import (
    Candidates,
    DataEffect,
    FitContext,
    Values,
    amplitude,
    joint_data,
    register_effect,
)

#: [m] Smaller clearances are lost in the rounding of the radii.
LEAST_CLEARANCE = 1e-9

# Start values [m] and [1] of fits for a joint that was ideal, besides its contact: sticking
# depends strongly on friction, bouncing on restitution
_FIRST_CLEARANCE, _FIRST_FRICTIONS = 5e-5, (0.03, 0.1, 0.2)
_FIRST_RESTITUTIONS = (0.4, 0.55, 0.7, 0.85)

# Search range [m] for a joint that was ideal
_CLEARANCES = (2e-6, 2e-3)

# Search range [1, of the nominal clearance] for a loose joint: from a measurement error to wear
_LOOSER = (0.5, 3.0)

#: Bounds for the contact of a joint that was ideal: steel on bronze or steel, dry to greased.
RESTITUTIONS, FRICTIONS = (0.3, 0.9), (0.0, 0.3)

#: Largest factor, either way, on contact stiffness and on damping of steady contact (bearing length
#: and alignment are not in Hertz's formula), and on the friction transition speed, to which
#: readings of a sticking journal are sensitive.
STIFFNESS_FACTOR, DAMPING_FACTOR, FRICTION_SPEED_FACTOR = 3.0, 4.0, 4.0


def _none_or_more_than_atoms(clearance: float) -> float:
    if 0 < clearance < LEAST_CLEARANCE:
        raise ValueError(
            f"is less than {LEAST_CLEARANCE:g} m; give 0 for an ideal joint, or at least"
            f" {LEAST_CLEARANCE:g} m"
        )
    return clearance


class ClearanceParameters(ConfigModel):
    """Parameters of a clearance, such as ``crank_pin_clearance``."""

    clearance_m: Annotated[quantity("m", ge=0), AfterValidator(_none_or_more_than_atoms)] = Field(
        description="c, total radial clearance; 0, or at least 1e-9 m", examples=[0.0002]
    )
    restitution: quantity("", ge=1e-3, lt=1) | None = Field(
        None,
        description="coefficient of restitution; null: that of the joint's contact",
        examples=[0.6],
    )
    friction: FrictionCoefficient | None = Field(
        None,
        description="coefficient of friction; null: that of the joint's contact",
        examples=[0.1],
    )
    stiffness_factor: quantity("", gt=0) = Field(
        1.0, description="factor on the stiffness of the joint's contact", examples=[2.0]
    )
    damping_factor: quantity("", gt=0) = Field(
        1.0,
        description=(
            "factor on the damping of steady contact; requires a contact with `memory: fading`"
        ),
        examples=[0.5],
    )
    friction_speed_factor: quantity("", gt=0) = Field(
        1.0, description="factor on the contact's `friction_speed`", examples=[2.0]
    )


@register_effect(order=180)
class Clearance(DataEffect):
    """Clearance of the {site}; requires the joint as a mapping (not ``ideal``)."""

    ON, GROUP = "revolute", "clearances"
    LAW = "{site} loose with the radial clearance c; c = 0: ideal"
    WORDS = "clearance in the {site}"
    REFERENCE = "Erkaya and Uzmay (2009), equation 1"
    PARAMETERS = ClearanceParameters

    def apply(self, data: dict[str, Any]) -> None:
        joint = joint_data(data, self.NAME, self.SITE)
        joint["loose"] = self.parameters.clearance_m > 0
        if joint["loose"]:
            joint["bearing_radius"] = joint["journal_radius"] + self.parameters.clearance_m
        joint["contact"] |= self._contact(joint["contact"])

    def _contact(self, contact: dict[str, Any]) -> dict[str, Any]:
        """The changed keys of `contact`."""
        parameters = self.parameters
        changed = parameters.model_dump(include={"restitution", "friction"}, exclude_none=True)
        if parameters.stiffness_factor != 1.0:  # Hertz's stiffness is proportional to the modulus
            key = "youngs_modulus" if contact["stiffness"] is None else "stiffness"
            changed[key] = parameters.stiffness_factor * contact[key]
        if parameters.damping_factor != 1.0:
            reference = contact["reference_approach_speed"] or REFERENCE_APPROACH_SPEED
            changed["reference_approach_speed"] = reference / parameters.damping_factor
        if parameters.friction_speed_factor != 1.0:
            speed = parameters.friction_speed_factor * contact["friction_speed"]
            changed["friction_speed"] = speed
        return changed

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        joint, nominal = context.mechanism.joint(cls.SITE), context.mechanism.clearance(cls.SITE)
        longest = 0.05 * context.scale.stroke
        if joint is not None and nominal:
            yield cls.candidate(
                amplitude("change_m", 0.05 * nominal, "m", -0.95 * nominal, longest),
                parameters=lambda values: {"clearance_m": nominal + values["change_m"]},
                is_perturbation=True,
                search_range=tuple(min((part - 1.0) * nominal, longest) for part in _LOOSER),
                # the nuisance has the effect's name
                replaces=context.replaced({cls.NAME: "change_m"}),
            )
        elif joint is not None:
            yield cls._of_ideal_joint(joint.contact, longest)

    @classmethod
    def _of_ideal_joint(cls, contact: Any, longest: float) -> Candidate:
        """The candidate of an ideal joint, with clearances up to `longest` [m] and unknown
        `contact`."""
        shapes = [Parameter("contact_friction", contact.friction, *FRICTIONS, step=0.02)]
        if contact.restitution is not None:
            restitution = contact.restitution
            shapes.insert(
                0, Parameter("contact_restitution", restitution, *RESTITUTIONS, step=0.05)
            )
        factors = {"stiffness": STIFFNESS_FACTOR, "friction_speed": FRICTION_SPEED_FACTOR}
        if contact.reference_speed is not None:
            factors["damping"] = DAMPING_FACTOR
        for name, factor in factors.items():
            reach = math.log(factor)
            shapes.append(Parameter(f"log_{name}_factor", 0.0, -reach, reach, step=0.05 * reach))

        def parameters(values: Values) -> dict[str, float]:
            parameters = {"clearance_m": values["change_m"]}
            for key in ("restitution", "friction"):
                if f"contact_{key}" in values:
                    parameters[key] = values[f"contact_{key}"]
            for name in factors:
                parameters[f"{name}_factor"] = math.exp(values[f"log_{name}_factor"])
            return parameters

        nominal = {shape.key: min(max(shape.nominal, shape.low), shape.high) for shape in shapes}
        others = {"contact_restitution": _FIRST_RESTITUTIONS, "contact_friction": _FIRST_FRICTIONS}
        first = {key: (nominal[key], *more) for key, more in others.items() if key in nominal}
        return cls.candidate(
            amplitude("change_m", 2e-5, "m", 0.0, longest),
            *shapes,
            amplitudes=("change_m",),
            parameters=parameters,
            initial_guesses=tuple(
                {"change_m": _FIRST_CLEARANCE} | nominal | dict(guess)
                for guess in product(*map(_guesses, first, first.values()))
            ),
            search_range=(_CLEARANCES[0], min(_CLEARANCES[1], longest)),
        )


def _guesses(key: str, values: Sequence[float]) -> list[tuple[str, float]]:
    return [(key, value) for value in dict.fromkeys(values)]
