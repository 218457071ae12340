"""Quadratic drag of the slider."""

from jointgap.effects.base import Candidates, Effect, FitContext, TrialContext, TrialSize, amplitude, page, parameter
from jointgap.effects.slider_power_drag import SliderPowerDrag


@page(order=40)
class SliderQuadraticDrag(Effect):
    """Drag of a fluid that the slider pushes aside or through an orifice."""

    GROUP = "slider"
    SITE = "slider"
    LAW = "F = -d v |v|"
    REFERENCE = "Newton, Principia (1687), book II, section II"
    WORDS = "quadratic drag of the slider"
    COMPILED = {"drag": "drag_N_s2_m2"}
    PARAMETERS = {
        "drag_N_s2_m2": parameter("N*s^2/m^2", "d, force per velocity squared", 0.5, ge=0),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        scale = context.scale
        families = (SliderPowerDrag.family_of(cls, context),)
        size = amplitude("drag_N_s2_m2", scale.force / scale.speed**2, "N*s^2/m^2", 0.0)
        yield cls.candidate(size, families=families)

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        return TrialSize.of("drag_N_s2_m2", 0.05 * context.rig.force / context.rig.velocity**2)
