"""Viscous friction of the slider."""

from jointgap.effects.base import (
    FRICTION_SURVEY,
    Candidates,
    Effect,
    FitContext,
    TrialContext,
    TrialSize,
    amplitude,
    page,
    parameter,
)
from jointgap.effects.slider_power_drag import SliderPowerDrag


@page(order=30)
class SliderViscousFriction(Effect):
    """Friction of the slider in a film of lubricant."""

    GROUP = "slider"
    SITE = "slider"
    LAW = "F = -c v"
    REFERENCE = FRICTION_SURVEY
    WORDS = "viscous friction of the slider"
    COMPILED = {"viscous": "damping_N_s_m"}
    PARAMETERS = {
        "damping_N_s_m": parameter("N*s/m", "c, force per velocity", 5.0, ge=0),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        scale = context.scale
        families = (SliderPowerDrag.family_of(cls, context),)
        yield cls.candidate(amplitude("damping_N_s_m", scale.force / scale.speed, "N*s/m", 0.0), families=families)

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        return TrialSize.of("damping_N_s_m", 0.05 * context.rig.force / context.rig.velocity)
