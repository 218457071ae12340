"""Dry friction of the slider that falls with its speed, a family of Coulomb friction."""

from jointgap.core.candidates import LawFamily, Parameter
from jointgap.effects.base import FRICTION_SURVEY, SLIDER_SIGN, Effect, FitContext, amplitude, page, parameter

_SHARES_IN_USE = (0.0, 0.5, 1.0)

_STRIBECK_SPEED, _SLOWEST, _FASTEST = 0.2, 0.1, 0.5
"""Stribeck speed [of the slider's speed, root mean square] from which a fit begins, and its bounds.

The slider is slower than a tenth for 4.5 % of the time: of what falls more steeply so few samples tell that nearly any
share would do. What falls over more than a half looks like viscous friction of the other sign.
"""


@page(order=25)
class SliderStribeckFriction(Effect):
    """Dry friction of the slider of which a share falls with its speed: a family of Coulomb friction.

    No candidate by itself: the share is fitted once Coulomb friction is found.
    """

    GROUP = "slider"
    SITE = "slider"
    LAW = f"F = -f (1 - s + s exp(-|v|/v_s)) sgn v, {SLIDER_SIGN}"
    REFERENCE = FRICTION_SURVEY
    WORDS = "dry friction of the slider"
    COMPILED = {
        "stribeck": "force_N",
        "stribeck_speed": "stribeck_speed_m_s",
        "stribeck_share": "stribeck_share",
    }
    MEMBERS = {"slider_coulomb_friction": 0.0}
    PARAMETERS = {
        "force_N": parameter("N", "f, force of friction at the least speed", 20.0, ge=0),
        "stribeck_speed_m_s": parameter("m/s", "v_s, Stribeck speed, over which friction falls", 0.3, gt=0),
        "stribeck_share": parameter("", "s, share of the force that falls with speed", 0.5, ge=0, le=1),
    }

    @classmethod
    def family_of(cls, context: FitContext) -> LawFamily:
        """The family of Coulomb friction in the `context` of a fit."""
        own, speed = cls.MEMBERS["slider_coulomb_friction"], context.scale.speed
        start, slowest, fastest = (share * speed for share in (_STRIBECK_SPEED, _SLOWEST, _FASTEST))
        law = cls.candidate(
            amplitude("force_N", context.scale.force, "N", 0.0),
            Parameter("stribeck_speed_m_s", start, slowest, fastest, 0.1 * start, "m/s"),
            Parameter("stribeck_share", own, 0.0, 1.0, 0.1),
            amplitudes=("force_N",),
        )
        return LawFamily(
            law,
            "stribeck_share",
            own,
            _SHARES_IN_USE,
            lambda force: {**force, "stribeck_speed_m_s": start},
            idle_at_own=1,
        )
