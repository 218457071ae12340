"""A constant force on the slider."""

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


@page(order=60)
class SliderConstantForce(Effect):
    """A constant force, such as a load or a difference of pressures."""

    GROUP = "slider"
    SITE = "slider"
    LAW = "F = f"
    REFERENCE = "definition"
    WORDS = "a constant force on the slider"
    COMPILED = {"constant": "force_N"}
    PARAMETERS = {
        "force_N": parameter("N", "f, force along +x", -50.0),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        yield cls.candidate(amplitude("force_N", context.scale.force, "N"))

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        return TrialSize.of("force_N", 0.05 * context.rig.force, 10 * context.rig.force, random_sign(context.rng))
