"""A spring on the slider."""

from jointgap.effects.base import Candidates, Effect, FitContext, TrialContext, TrialSize, amplitude, page, parameter
from jointgap.effects.slider_nonlinear_spring import SliderNonlinearSpring

_FARTHEST_STROKES = 3.0
"""How far from mid-stroke a spring may rest [strokes]: farther away it is a constant force, to a sixth of it."""


@page(order=70)
class SliderSpring(Effect):
    """A linear spring between frame and slider."""

    GROUP = "slider"
    SITE = "slider"
    LAW = "F = -k (x - x0)"
    REFERENCE = "Hooke, De potentia restitutiva (1678)"
    WORDS = "a linear spring on the slider"
    COMPILED = {"spring_stiffness": "stiffness_N_m", "spring_rest": "rest_position_m"}
    PARAMETERS = {
        "stiffness_N_m": parameter("N/m", "k, force per length", 2000.0, ge=0),
        "rest_position_m": parameter("m", "x0, position of the slider without force", 0.56),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        scale = context.scale
        # Two springs that rest at either end of where one may rest do what any one between them does, and the motion
        # depends on both stiffnesses linearly.
        farthest = _FARTHEST_STROKES * 2.0 * scale.stroke
        coordinates = (
            amplitude("farthest_out_N_m", scale.force / farthest, "N/m", 0.0),
            amplitude("farthest_in_N_m", scale.force / farthest, "N/m", 0.0),
        )

        def parameters(values):
            outer, inner = values["farthest_out_N_m"], values["farthest_in_N_m"]
            stiffness = outer + inner
            share = (outer - inner) / stiffness if stiffness > 0.0 else 0.0
            return {"stiffness_N_m": stiffness, "rest_position_m": scale.middle + share * farthest}

        families = (SliderNonlinearSpring.family_of(coordinates, parameters, context),)
        yield cls.candidate(*coordinates, parameters=parameters, families=families)

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        middle, half = context.rig.stroke
        rest = float(middle + context.rng.uniform(-0.7, 0.7) * half)
        return TrialSize.of("stiffness_N_m", 0.05 * context.rig.force / half, rest_position_m=rest)
