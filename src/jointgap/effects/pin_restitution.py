"""Restitution of pins beyond what a campaign says of it: of one pin, or of both alike."""

from typing import Any

from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.joints import PINS
from jointgap.effects.base import (
    PIN,
    Candidates,
    Effect,
    FitContext,
    amplitude,
    data_of_pins,
    joint_data,
    page,
    parameter,
)

SMALLEST, LARGEST = 1e-3, 0.999
"""Bounds of a coefficient of restitution, within those of a contact."""


class Restitution(Effect):
    """A coefficient of restitution in place of the contacts' own."""

    GROUP = "pins"
    REFERENCE = "Lankarani and Nikravesh, J. Mech. Des. 112 (1990) 369-376"
    ACTS_AT_ZERO = True  # it stands for its pins' even where that is nominal
    PARAMETERS = {
        "coefficient": parameter("", "e, whole coefficient of restitution", 0.3, ge=SMALLEST, le=LARGEST),
    }

    @classmethod
    def beyond(cls, nuisance: Parameter, site: str = "") -> Candidate:
        """The candidate at `site` that is the `nuisance` beyond its range."""
        nominal = nuisance.nominal
        return cls.candidate(
            amplitude("change", nuisance.step, "1", SMALLEST - nominal, LARGEST - nominal),
            site=site,
            parameters=lambda values: {"coefficient": nominal + values["change"]},
            replaces={nuisance.name: "change"},
            is_perturbation=True,  # a contact that gives nothing back is one like others
        )


@page(order=104)
class PinRestitution(Restitution):
    """A loose pin has this coefficient of restitution, in place of its contact's own."""

    SITE = "crank_pin or piston_pin"
    LAW = "contact.restitution = e of the loose pin"
    WORDS = "a restitution of the {site} other than stated"
    KEYS = PIN

    def apply(self, data: dict[str, Any]) -> None:
        joint_data(data, self.NAME, self.site)["contact"] |= {"restitution": self.parameters.coefficient}

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        for pin in cls.sites():
            alone = pin in context.mechanism.loose and not set(PINS) <= set(context.mechanism.loose)
            nuisance = context.nuisances.get(
                f"restitution_{pin}", context.nuisances.get("restitution") if alone else None
            )
            if nuisance is not None:
                yield cls.beyond(nuisance, pin)


@page(order=106)
class CommonPinRestitution(Restitution):
    """All loose pins have this coefficient of restitution, in place of their contacts' own."""

    SITE = "loose pins"
    LAW = "contact.restitution = e of every loose pin"
    WORDS = "a restitution of both pins other than stated"

    def apply(self, data: dict[str, Any]) -> None:
        for joint in data_of_pins(data, self.NAME):
            joint["contact"] |= {"restitution": self.parameters.coefficient}

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        shared = context.nuisances.get("restitution")
        if shared is not None and set(PINS) <= set(context.mechanism.loose):
            yield cls.beyond(shared)
