"""Friction in a pin."""

from typing import Any

from jointgap.core.candidates import Candidate
from jointgap.effects.base import (
    CRANK_SIGN,
    PIN,
    Candidates,
    Effect,
    FitContext,
    Records,
    TrialContext,
    TrialSize,
    amplitude,
    joint_data,
    page,
    parameter,
)

LARGEST_COEFFICIENT = 0.6
"""Bound of a coefficient of friction, as that of a contact."""


@page(order=100)
class PinFriction(Effect):
    """Friction in a pin: in a loose one it replaces its contact's coefficient, in an ideal one it is a moment."""

    GROUP = "pins"
    SITE = "crank_pin or piston_pin"
    LAW = (
        f"loose: contact.friction = k; ideal: M = -k r |F| sgn w, {CRANK_SIGN}, r: journal_radius, F: the pin's force, "
        "w: relative speed of its bodies"
    )
    REFERENCE = "Haug, Wu and Yang, Mech. Mach. Theory 21 (1986) 401-406"
    WORDS = "friction in the {site}"
    KEYS = PIN
    ACTS_AT_ZERO = True  # friction in one of two pins stands for this pin's even where it is nominal
    PARAMETERS = {
        "coefficient": parameter("", "k, whole coefficient of friction", 0.1, ge=0, le=LARGEST_COEFFICIENT),
    }

    def changes_data(self, mechanism: Any) -> bool:
        """In a loose pin it is the contact's coefficient; a clearance that is listed too decides whether it is
        loose.
        """
        clearance = mechanism.effect(f"{self.site}_clearance")
        return self.site in mechanism.loose if clearance is None else clearance.clearance_m > 0

    def apply(self, data: dict[str, Any]) -> None:
        joint_data(data, self.NAME, self.site)["contact"] |= {"friction": self.parameters.coefficient}

    def check(self, mechanism: Any) -> None:
        if mechanism.joint(self.site) is None:
            raise ValueError(
                f"effects: pin_friction at {self.site} needs the joint's journal_radius; write the joint as a mapping, "
                "with 'loose: false' to stay ideal"
            )

    def compile_into(self, records: Records) -> None:
        records[self.site]["pin_friction"] = self.parameters.coefficient

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        for pin in cls.sites():
            joint = context.mechanism.joint(pin)
            if joint is not None:
                yield cls._of_pin(context, pin, joint)

    @classmethod
    def _of_pin(cls, context: FitContext, pin: str, joint: Any) -> Candidate:
        nominal = joint.contact.friction if joint.loose else 0.0
        own = {f"joint_friction_{pin}": "change", "joint_friction": "change"}
        replaces = context.replaced(own) if joint.loose else {}
        coordinates = [amplitude("change", 0.02, "1", -nominal, LARGEST_COEFFICIENT - nominal)]
        if "joint_friction" in replaces and set(context.mechanism.loose) - {pin, "crank_pivot"}:
            # The effect takes this pin out of what both share: what is left is the other pin's.
            coordinates.append(context.nuisances["joint_friction"])
        return cls.candidate(
            *coordinates,
            site=pin,
            amplitudes=("change",),
            initial_guesses=({shared.name: shared.nominal for shared in coordinates[1:]},),
            parameters=lambda values: {"coefficient": max(nominal + values["change"], 0.0)},
            replaces=replaces,
            is_perturbation=joint.loose and nominal > 0.0,
        )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        nominal = context.rig.mechanism["contacts"]["steel"]["friction"] if context.site in context.rig.loose else 0.0
        return TrialSize(lambda size: {"coefficient": nominal + size}, 0.05, LARGEST_COEFFICIENT - nominal)
