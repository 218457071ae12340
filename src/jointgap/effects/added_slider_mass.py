"""A slider mass other than nominal."""

from jointgap.effects.base import (
    DETECTABLE_SHARE,
    Candidates,
    Effect,
    FitContext,
    TrialContext,
    TrialSize,
    amplitude,
    page,
    parameter,
)


@page(order=140)
class AddedSliderMass(Effect):
    """The slider is heavier, or lighter, than its nominal mass."""

    GROUP = "bodies"
    SITE = "slider"
    LAW = "slider.mass + m"
    REFERENCE = "definition"
    WORDS = "a slider mass other than nominal"
    ADDS_TO = {"mass_kg": ("slider", "mass")}
    PARAMETERS = {
        "mass_kg": parameter("kg", "m, mass beyond nominal", 0.05),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        mass = context.mechanism.slider.mass
        yield cls.candidate(
            amplitude("mass_kg", DETECTABLE_SHARE * mass, "kg", -0.95 * mass),
            replaces=context.replaced({"slider_mass": "mass_kg"}),
        )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        return TrialSize.of("mass_kg", 0.03, 3.0)
