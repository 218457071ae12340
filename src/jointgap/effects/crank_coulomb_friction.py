"""Coulomb friction of the crank."""

from jointgap.effects.base import (
    CRANK_SIGN,
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
from jointgap.effects.crank_angle_friction import CrankAngleFriction


@page(order=110)
class CrankCoulombFriction(Effect):
    """Dry friction of the crank's bearings and seals, whatever their load."""

    GROUP = "crank"
    SITE = "crank_pivot"
    LAW = f"M = -m sgn w, {CRANK_SIGN}"
    REFERENCE = FRICTION_SURVEY
    WORDS = "Coulomb friction of the crank"
    COMPILED = {"crank_coulomb": "torque_N_m"}
    PARAMETERS = {
        "torque_N_m": parameter("N*m", "m, moment of friction", 0.3, ge=0),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        scale = context.scale
        moment = amplitude("torque_N_m", scale.force * scale.stroke, "N*m", 0.0)
        yield cls.candidate(moment, families=(CrankAngleFriction.family_of(context),))

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        return TrialSize.of("torque_N_m", 0.05 * context.rig.force * context.rig.stroke[1])
