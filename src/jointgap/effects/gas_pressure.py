"""Pressure of a closed gas volume on the slider."""

from jointgap.core.candidates import Parameter
from jointgap.effects.base import Candidates, Effect, FitContext, TrialContext, TrialSize, amplitude, page, parameter


@page(order=80)
class GasPressure(Effect):
    """A closed gas spring beyond the slider: compressed and expanded without loss. What a cylinder with valves or
    combustion does is a `slider_force_table`.
    """

    GROUP = "slider"
    SITE = "slider"
    LAW = "F = -f (h / (h + x_out - x))^n, closed cycle, x_out: farthest-out position"
    REFERENCE = "Heywood, Internal combustion engine fundamentals (1988)"
    WORDS = "the pressure of a closed gas volume on the slider"
    COMPILED = {"gas_force": "force_N", "gas_length": "dead_length_m", "gas_exponent": "exponent"}
    PARAMETERS = {
        "force_N": parameter("N", "f, force with the slider farthest out", 100.0, ge=0),
        "dead_length_m": parameter("m", "h, length of the cylinder beyond the farthest-out position", 0.05, gt=0),
        "exponent": parameter("", "n, polytropic exponent: 1 isothermal, 1.4 adiabatic for air", 1.3, ge=1, le=1.4),
    }

    def largest_force(self, stroke: float) -> float:
        given = self.parameters
        return given.force_N * (1 + stroke / given.dead_length_m) ** given.exponent

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        stroke = context.scale.stroke
        lengths = (0.2 * stroke, stroke)
        yield cls.candidate(
            amplitude("force_N", context.scale.force, "N", 0.0),
            Parameter("dead_length_m", lengths[0], 0.01 * stroke, 20.0 * stroke, 0.1 * lengths[0], "m"),
            Parameter("exponent", 1.2, 1.0, 1.4, 0.05),
            amplitudes=("force_N",),
            initial_guesses=tuple({"dead_length_m": length, "exponent": 1.2} for length in lengths),
        )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        length = float(context.rig.stroke[1] * context.rng.uniform(0.2, 0.8))
        exponent = float(context.rng.uniform(1.0, 1.4))
        return TrialSize.of("force_N", 0.1 * context.rig.force, dead_length_m=length, exponent=exponent)
