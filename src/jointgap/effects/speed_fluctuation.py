"""A drive whose speed fluctuates."""

import math

from jointgap.effects.base import (
    Candidates,
    Effect,
    FitContext,
    Records,
    TrialContext,
    TrialSize,
    amplitude,
    from_cosine_and_sine,
    page,
    parameter,
)
from jointgap.identification.protocol import Parameter


@page(order=150)
class SpeedFluctuation(Effect):
    """The drive's speed depends on the crank angle; for the constant drive alone, of which simulate.speed is w0."""

    GROUP = "crank"
    SITE = "drive"
    LAW = "w = w0 (1 + a cos(k theta - phase))"
    REFERENCE = "definition"
    WORDS = "a drive whose speed fluctuates"
    DRIVE = "constant"
    PARAMETERS = {
        "ratio": parameter("", "a, amplitude over the mean", 0.02, ge=0, le=0.3),
        "order": parameter("", "k, cycles per revolution", 2, kind=int, ge=1, le=12),
        "phase_rad": parameter("rad", "angle k theta of the largest speed", 0.5, default=0.0),
    }

    def compile_into(self, records: Records) -> None:
        ratio, order, phase = self.parameters.ratio, float(self.parameters.order), self.parameters.phase_rad
        records["drive"] |= {"kind": "fluctuating", "ratio": ratio, "order": order, "phase": phase}

    def mirrored(self) -> Effect:
        return self.with_parameters(phase_rad=-self.parameters.phase_rad)

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        if context.constant_speed:
            yield cls.candidate(
                amplitude("cosine", 1e-3, "1", -0.3, 0.3),
                amplitude("sine", 1e-3, "1", -0.3, 0.3),
                Parameter("order", 1.0, 1.0, 12.0, 1e-3, whole=True),
                amplitudes=("cosine", "sine"),
                initial_guesses=tuple({"order": float(order)} for order in range(1, 9)),
                parameters=lambda values: (
                    from_cosine_and_sine("ratio", "phase_rad", values) | {"order": round(values["order"])}
                ),
            )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        order, phase = int(context.rng.choice([1, 2, 3, 4])), float(context.rng.uniform(-math.pi, math.pi))
        return TrialSize.of("ratio", 0.005, 0.3, order=order, phase_rad=phase)
