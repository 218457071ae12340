"""Dry friction of the slider that varies along its stroke, a family of Coulomb friction."""

from jointgap.core.candidates import LawFamily, Parameter
from jointgap.effects.base import SLIDER_SIGN, Effect, FitContext, amplitude, page, parameter

_SHARES_IN_USE = (0.0, 0.5, 1.0)

_TIGHTEST = (0.0, -2.0 / 3.0, 2.0 / 3.0)
"""Positions [half strokes from mid-stroke] of most friction from which fits begin: each within a third of any other."""


@page(order=27)
class SliderPositionFriction(Effect):
    """Dry friction of the slider of which a share varies along its stroke: a family of Coulomb friction.

    The least that a bore which is tight in one place, or worn in the other, does: one wave over the stroke. No
    candidate by itself: the share is fitted once Coulomb friction is found.
    """

    GROUP = "slider"
    SITE = "slider"
    LAW = f"F = -f [1 - s + s (1 + cos(2 pi (x - x_t) / l)) / 2] sgn v, {SLIDER_SIGN}"
    REFERENCE = "definition"
    WORDS = "dry friction that varies along the stroke"
    COMPILED = {
        "position_friction": "force_N",
        "position_friction_tightest": "tightest_position_m",
        "position_friction_length": "length_m",
        "position_friction_share": "varying_share",
    }
    MEMBERS = {"slider_coulomb_friction": 0.0}
    PARAMETERS = {
        "force_N": parameter("N", "f, force of friction where it is largest", 20.0, ge=0),
        "tightest_position_m": parameter("m", "x_t, position of the slider where friction is largest", 0.56),
        "length_m": parameter("m", "l, distance after which friction is the same again", 0.3, gt=0),
        "varying_share": parameter("", "s, share of the force that varies", 0.5, ge=0, le=1),
    }

    @classmethod
    def family_of(cls, context: FitContext) -> LawFamily:
        """The family of Coulomb friction in the `context` of a fit."""
        own, scale = cls.MEMBERS["slider_coulomb_friction"], context.scale
        middle, half = scale.middle, scale.stroke
        law = cls.candidate(
            amplitude("force_N", scale.force, "N", 0.0),
            # A stroke to either side of mid-stroke, so that no place on the stroke is a bound of what is periodic.
            Parameter("tightest_position_m", middle, middle - 2.0 * half, middle + 2.0 * half, 0.1 * half, "m"),
            Parameter("varying_share", own, 0.0, 1.0, 0.1),
            amplitudes=("force_N",),
            initial_guesses=tuple({"tightest_position_m": middle + share * half} for share in _TIGHTEST),
            parameters=lambda values: {**values, "length_m": 2.0 * half},
        )
        return LawFamily(law, "varying_share", own, _SHARES_IN_USE, dict, idle_at_own=1)
