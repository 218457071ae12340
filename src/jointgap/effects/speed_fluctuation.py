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
    order_of_crank,
    page,
    parameter,
    stated_order,
)


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
        "order": parameter("", "k, cycles per revolution", 2, ge=0.5, le=12, multiple_of=0.5),
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
            order = order_of_crank(range(1, 13), context.runs)
            yield cls.candidate(
                amplitude("cosine", 1e-3, "1", -0.3, 0.3),
                amplitude("sine", 1e-3, "1", -0.3, 0.3),
                order,
                amplitudes=("cosine", "sine"),
                initial_guesses=tuple({"order": tried} for tried in order.tried if tried < 9),
                parameters=lambda values: (
                    from_cosine_and_sine("ratio", "phase_rad", values) | {"order": stated_order(values["order"])}
                ),
            )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        order, phase = int(context.rng.choice([1, 2, 3, 4])), float(context.rng.uniform(-math.pi, math.pi))
        return TrialSize.of("ratio", 0.005, 0.3, order=order, phase_rad=phase)
