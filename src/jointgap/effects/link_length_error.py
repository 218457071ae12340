"""Other lengths of crank and rod."""

from typing import Any

from jointgap.effects.base import (
    Candidates,
    Effect,
    FitContext,
    TrialContext,
    TrialSize,
    amplitude,
    page,
    parameter,
    random_sign,
)


@page(order=170)
class LinkLengthError(Effect):
    """Crank and rod are longer, or shorter, than nominal; mass centres keep their share, masses and inertias stay."""

    GROUP = "bodies"
    SITE = "crank, rod"
    LAW = "crank.length + a, rod.length + b"
    REFERENCE = "definition"
    WORDS = "other lengths of crank and rod"
    ADDS_TO = {"crank_m": ("crank", "length"), "rod_m": ("rod", "length")}
    PARAMETERS = {
        "crank_m": parameter("m", "a, crank's length beyond nominal", 0.0005, default=0.0),
        "rod_m": parameter("m", "b, rod's length beyond nominal", -0.001, default=0.0),
    }

    def apply(self, data: dict[str, Any]) -> None:
        for key, (body, _) in self.ADDS_TO.items():
            link, error = data[body], getattr(self.parameters, key)
            link["mass_centre"] *= (link["length"] + error) / link["length"]
            link["length"] += error

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        crank, rod = context.mechanism.crank.length, context.mechanism.rod.length
        yield cls.candidate(
            amplitude("crank_m", 2e-3 * crank, "m", -0.5 * crank),
            amplitude("rod_m", 2e-3 * rod, "m", -0.5 * rod),
            replaces=context.replaced({"crank_length": "crank_m", "rod_length": "rod_m"}),
        )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        link = str(context.rng.choice(["crank_m", "rod_m"]))
        return TrialSize.of(link, 1e-4, 0.02, random_sign(context.rng))
