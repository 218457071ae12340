"""Drag of the slider with a power of its speed, the family of three effects of the list."""

from jointgap.core.candidates import LawFamily, Parameter
from jointgap.effects.base import FRICTION_SURVEY, SLIDER_SIGN, Effect, FitContext, amplitude, page, parameter

_LARGEST_EXPONENT = 6.0
_EXPONENTS_IN_USE = (0.0, 1.0, 2.0, 3.0, 5.0)


@page(order=45)
class SliderPowerDrag(Effect):
    """Drag of the slider with any power of its speed: the family of dry friction, viscous friction and quadratic drag.

    No candidate by itself: its exponent is fitted once a member of the family is found.
    """

    GROUP = "slider"
    SITE = "slider"
    LAW = f"F = -f |v/v0|^p sgn v, {SLIDER_SIGN}"
    REFERENCE = FRICTION_SURVEY
    WORDS = "drag of the slider"
    COMPILED = {"power_drag": "force_N", "power_drag_speed": "speed_m_s", "power_drag_exponent": "exponent"}
    MEMBERS = {"slider_coulomb_friction": 0.0, "slider_viscous_friction": 1.0, "slider_quadratic_drag": 2.0}
    PARAMETERS = {
        "force_N": parameter("N", "f, force at the speed v0", 10.0, ge=0),
        "speed_m_s": parameter("m/s", "v0, speed at which the force is f", 1.0, gt=0),
        "exponent": parameter("", "p, exponent of the speed", 3.0, ge=0, le=_LARGEST_EXPONENT),
    }

    @classmethod
    def family_of(cls, member: type[Effect], context: FitContext) -> LawFamily:
        """The family of a `member`, whose one parameter is its force over a power of the speed, in the `context` of a
        fit.
        """
        speed, exponent = context.scale.speed, cls.MEMBERS[member.NAME]
        (key,) = member.PARAMETERS
        law = cls.candidate(
            amplitude("force_N", context.scale.force, "N", 0.0),
            Parameter("exponent", exponent, 0.0, _LARGEST_EXPONENT, 0.1),
            amplitudes=("force_N",),
            parameters=lambda values: {**values, "speed_m_s": speed},
        )
        return LawFamily(
            law, "exponent", exponent, _EXPONENTS_IN_USE, lambda values: {"force_N": values[key] * speed**exponent}
        )
