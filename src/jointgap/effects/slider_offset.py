"""An offset of the slide."""

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


@page(order=160)
class SliderOffset(Effect):
    """The slide lies beside its nominal line."""

    GROUP = "bodies"
    SITE = "guide"
    LAW = "slider.offset + b"
    REFERENCE = "definition"
    WORDS = "an offset of the slide"
    ADDS_TO = {"offset_m": ("slider", "offset")}
    PARAMETERS = {
        "offset_m": parameter("m", "b, offset beyond nominal", 0.01),
    }

    def mirrored(self) -> Effect:
        return self.with_parameters(offset_m=-self.parameters.offset_m)

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        crank, rod = context.mechanism.crank.length, context.mechanism.rod.length
        yield cls.candidate(
            amplitude("offset_m", 0.01 * crank, "m", -rod, rod),
            replaces=context.replaced({"slider_offset": "offset_m"}),
        )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        return TrialSize.of("offset_m", 1e-3, 0.1, random_sign(context.rng))
