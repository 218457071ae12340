"""A spring on the slider."""

from jointgap.effects.base import Candidates, Effect, FitContext, TrialContext, TrialSize, amplitude, page, parameter

_SOFTEST = 1e-9
"""Least stiffness over the one that noise could just hide."""


@page(order=70)
class SliderSpring(Effect):
    """A linear spring between frame and slider."""

    GROUP = "slider"
    SITE = "slider"
    LAW = "F = -k (x - x0)"
    REFERENCE = "Hooke, De potentia restitutiva (1678)"
    WORDS = "a spring on the slider"
    COMPILED = {"spring_stiffness": "stiffness_N_m", "spring_rest": "rest_position_m"}
    PARAMETERS = {
        "stiffness_N_m": parameter("N/m", "k, force per length", 2000.0, ge=0),
        "rest_position_m": parameter("m", "x0, position of the slider without force", 0.56),
    }

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        scale = context.scale
        # Force at mid-stroke in place of the rest position: the motion depends on both amplitudes linearly.
        coordinates = (
            amplitude("stiffness_N_m", scale.force / scale.stroke, "N/m", 0.0),
            amplitude("force_at_middle_N", scale.force, "N"),
        )

        def parameters(values):
            # A constant force is a soft spring whose rest position is far away.
            stiffness = max(values["stiffness_N_m"], _SOFTEST * scale.force / scale.stroke)
            rest = scale.middle + values["force_at_middle_N"] / stiffness
            return {"stiffness_N_m": stiffness, "rest_position_m": rest}

        yield cls.candidate(*coordinates, parameters=parameters)

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        middle, half = context.rig.stroke
        rest = float(middle + context.rng.uniform(-0.7, 0.7) * half)
        return TrialSize.of("stiffness_N_m", 0.05 * context.rig.force / half, rest_position_m=rest)
