"""Friction of the slider in proportion to the load of its guide."""

from jointgap.effects.base import (
    SLIDER_SIGN,
    Candidates,
    Effect,
    FitContext,
    TrialContext,
    TrialSize,
    amplitude,
    page,
    parameter,
)


@page(order=50)
class SliderLoadFriction(Effect):
    """Dry friction between slider and guide in proportion to the guide's normal force N."""

    GROUP = "slider"
    SITE = "guide"
    LAW = f"F = -k |N| sgn v, {SLIDER_SIGN}, N: normal force of the guide"
    REFERENCE = "Amontons, Mém. Acad. R. Sci. (1699) 206-222"
    WORDS = "friction of the slider in proportion to the load of its guide"
    COMPILED = {"load_friction": "coefficient"}
    PARAMETERS = {
        "coefficient": parameter("", "k, coefficient of friction", 0.1, ge=0, le=1),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        step = min(context.scale.force / context.scale.guide, 0.1)
        yield cls.candidate(amplitude("coefficient", step, "1", 0.0, 1.0))

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        return TrialSize.of("coefficient", 0.1, 1.0)
