"""Dry friction of the crank that varies with its angle, the family of Coulomb friction."""

import math

from jointgap.core.candidates import LawFamily, Parameter
from jointgap.effects.base import CRANK_SIGN, Effect, FitContext, amplitude, page, parameter

_SHARES_IN_USE = (0.0, 0.5, 1.0)

_TIGHTEST = (0.0, -2.0 * math.pi / 3.0, 2.0 * math.pi / 3.0)
"""Angles [rad] of most friction from which fits begin: each within 60 degrees of any other."""


@page(order=115)
class CrankAngleFriction(Effect):
    """Dry friction of the crank of which a share varies with its angle: the family of Coulomb friction.

    The least that an eccentric seal or a bent shaft does: one wave over the revolution. No candidate by itself: the
    share is fitted once Coulomb friction is found.
    """

    GROUP = "crank"
    SITE = "crank_pivot"
    LAW = f"M = -m [1 - s + s (1 + cos(theta - a)) / 2] sgn w, {CRANK_SIGN}"
    REFERENCE = "definition"
    WORDS = "dry friction of the crank that varies with its angle"
    COMPILED = {
        "angle_friction": "torque_N_m",
        "angle_friction_tightest": "tightest_angle_rad",
        "angle_friction_share": "varying_share",
    }
    MEMBERS = {"crank_coulomb_friction": 0.0}
    PARAMETERS = {
        "torque_N_m": parameter("N*m", "m, moment of friction where it is largest", 0.3, ge=0),
        "tightest_angle_rad": parameter("rad", "a, angle of the crank where friction is largest", 0.5, default=0.0),
        "varying_share": parameter("", "s, share of the moment that varies", 0.5, ge=0, le=1),
    }

    def mirrored(self) -> Effect:
        # theta' = -theta and w' = -w, M' = -M: the moment is largest at -a
        return self.with_parameters(tightest_angle_rad=-self.parameters.tightest_angle_rad)

    @classmethod
    def family_of(cls, context: FitContext) -> LawFamily:
        """The family of Coulomb friction in the `context` of a fit."""
        own, scale = cls.MEMBERS["crank_coulomb_friction"], context.scale
        law = cls.candidate(
            amplitude("torque_N_m", scale.force * scale.stroke, "N*m", 0.0),
            # A revolution to either side of 0, so that no angle is a bound of what is periodic.
            Parameter("tightest_angle_rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, 0.1, "rad"),
            Parameter("varying_share", own, 0.0, 1.0, 0.1),
            amplitudes=("torque_N_m",),
            initial_guesses=tuple({"tightest_angle_rad": angle} for angle in _TIGHTEST),
        )
        return LawFamily(law, "varying_share", own, _SHARES_IN_USE, dict, idle_at_own=1)
