"""Friction of all loose pins alike: what a campaign's nuisance says of them together, beyond its range."""

from typing import Any

from jointgap.core.joints import PINS
from jointgap.effects.base import (
    Candidates,
    Effect,
    FitContext,
    amplitude,
    data_of_pins,
    page,
    parameter,
)
from jointgap.effects.pin_friction import LARGEST_COEFFICIENT


@page(order=102)
class CommonPinFriction(Effect):
    """All loose pins have this coefficient of friction, in place of their contacts' own."""

    GROUP = "pins"
    SITE = "loose pins"
    LAW = "contact.friction = k of every loose pin"
    REFERENCE = "definition"
    WORDS = "friction of both pins other than stated"
    ACTS_AT_ZERO = True  # it stands for both pins' even where that is nominal
    PARAMETERS = {
        "coefficient": parameter("", "k, whole coefficient of friction", 0.1, ge=0, le=LARGEST_COEFFICIENT),
    }

    def apply(self, data: dict[str, Any]) -> None:
        for joint in data_of_pins(data, self.NAME):
            joint["contact"] |= {"friction": self.parameters.coefficient}

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        shared = context.nuisances.get("joint_friction")
        if shared is None or not set(PINS) <= set(context.mechanism.loose):
            return  # of one pin it is the friction of that pin
        nominal = shared.nominal
        yield cls.candidate(
            amplitude("change", shared.step, "1", -nominal, LARGEST_COEFFICIENT - nominal),
            parameters=lambda values: {"coefficient": max(nominal + values["change"], 0.0)},
            replaces={"joint_friction": "change"},
            is_perturbation=nominal > 0.0,
        )
