"""Viscous friction of the crank."""

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


@page(order=120)
class CrankViscousFriction(Effect):
    """Friction of the crank's bearings in their lubricant."""

    GROUP = "crank"
    SITE = "crank_pivot"
    LAW = "M = -c w"
    REFERENCE = FRICTION_SURVEY
    WORDS = "viscous friction of the crank"
    COMPILED = {"crank_viscous": "damping_N_m_s"}
    PARAMETERS = {
        "damping_N_m_s": parameter("N*m*s", "c, moment per speed", 0.01, ge=0),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        scale = context.scale
        yield cls.candidate(amplitude("damping_N_m_s", scale.force * scale.stroke / scale.turning, "N*m*s", 0.0))

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        return TrialSize.of("damping_N_m_s", 0.05 * context.rig.force * context.rig.stroke[1] / context.rig.speed)
