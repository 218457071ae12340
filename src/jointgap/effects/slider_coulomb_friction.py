"""Coulomb friction of the slider."""

from jointgap.effects.base import (
    SLIDER_SIGN,
    Candidates,
    Effect,
    FitContext,
    TrialContext,
    TrialSize,
    amplitude,
    page,
    parameter,
)
from jointgap.effects.slider_position_friction import SliderPositionFriction
from jointgap.effects.slider_power_drag import SliderPowerDrag
from jointgap.effects.slider_stribeck_friction import SliderStribeckFriction


@page(order=20)
class SliderCoulombFriction(Effect):
    """Dry friction of the slider that does not depend on the load of its guide, as that of piston rings."""

    GROUP = "slider"
    SITE = "slider"
    LAW = f"F = -f sgn v, {SLIDER_SIGN}"
    REFERENCE = "Coulomb, Théorie des machines simples (1785)"
    WORDS = "Coulomb friction of the slider"
    COMPILED = {"coulomb": "force_N"}
    PARAMETERS = {
        "force_N": parameter("N", "f, force of friction", 20.0, ge=0),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        further = (page.family_of(context) for page in (SliderStribeckFriction, SliderPositionFriction))
        families = SliderPowerDrag.family_of(cls, context), *further
        yield cls.candidate(amplitude("force_N", context.scale.force, "N", 0.0), families=families)

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        return TrialSize.of("force_N", 0.05 * context.rig.force)
