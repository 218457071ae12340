"""A film of lubricant in a pin."""

from functools import partial
from typing import Any

from jointgap.effects.base import (
    PIN,
    Candidates,
    Effect,
    FitContext,
    Records,
    TrialContext,
    TrialSize,
    Values,
    amplitude,
    page,
    parameter,
)

LARGEST_FILM_SHARE = 0.5
"""Largest share of the clearance at which asperities may touch; beyond it there is no bearing to speak of."""

_VISCOSITIES = (0.03, 0.2)
"""[Pa s] of light and heavy oils, from which fits start: the least film carries the pin already."""


@page(order=220)
class LubricatedJoint(Effect):
    """A film of lubricant in a loose pin, squeeze included; dry contact begins where the film is thinner than h_min."""

    GROUP = "pins"
    SITE = "crank_pin or piston_pin"
    LAW = (
        "short bearing (Ocvirk) with squeeze, pressure p >= 0: d/dz(h^3 dp/dz) = 6 mu ((w_j + w_b) dh/dphi + 2 dh/dt); "
        "dry contact where h < h_min"
    )
    REFERENCE = "DuBois and Ocvirk, NACA report 1157 (1953)"
    WORDS = "a film of lubricant in the {site}"
    KEYS = PIN
    PARAMETERS = {
        "viscosity_Pa_s": parameter("Pa*s", "mu, dynamic viscosity", 0.05, gt=0),
        "length_m": parameter("m", "L, length of the bearing along its axis", 0.012, gt=0),
        "least_film_m": parameter(
            "m",
            "h_min, film thickness at which asperities of ground surfaces begin to touch: dry contact",
            1e-06,
            default=1e-6,
            gt=0,
        ),
    }

    def check(self, mechanism: Any) -> None:
        where = f"effects: lubricated_joint at {self.site}"
        if self.site not in mechanism.loose:
            raise ValueError(f"{where} needs a loose joint, for a film needs a clearance; make it loose")
        thinnest, clearance = self.parameters.least_film_m, mechanism.clearance(self.site)
        if thinnest > LARGEST_FILM_SHARE * clearance:
            raise ValueError(
                f"{where}: least_film_m {thinnest:g} m is more than {LARGEST_FILM_SHARE:g} of the clearance "
                f"{clearance:g} m; lower it"
            )

    def compile_into(self, records: Records) -> None:
        joint, values = records[self.site], self.parameters
        joint |= {"film_viscosity": values.viscosity_Pa_s, "film_length": values.length_m}
        joint["film_least"] = values.least_film_m
        joint["clearance"] -= values.least_film_m

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        scale = context.scale
        for pin in cls.sites():
            joint = context.mechanism.joint(pin)
            if joint is not None and joint.loose:
                length = 2.0 * joint.journal_radius
                force_per_viscosity = joint.journal_radius * length**3 * scale.turning / joint.clearance**2
                yield cls.candidate(
                    amplitude("viscosity_Pa_s", scale.force / force_per_viscosity, "Pa*s", 0.0),
                    site=pin,
                    initial_guesses=tuple({"viscosity_Pa_s": viscosity} for viscosity in _VISCOSITIES),
                    parameters=partial(_parameters, length),
                )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        if context.site not in context.rig.loose:
            return None
        length = 2 * context.rig.mechanism["joints"][context.site]["journal_radius"]
        return TrialSize(lambda viscosity: _parameters(length, {"viscosity_Pa_s": viscosity}), 0.1, 1.0, 0.03)


def _parameters(length: float, values: Values) -> dict[str, float]:
    """Viscosity as fitted, and the length of the bearing [m] that is assumed."""
    return {"viscosity_Pa_s": values["viscosity_Pa_s"], "length_m": length}
