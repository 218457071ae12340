"""A force on the slider that oscillates at a frequency of its own."""

import math

from jointgap.core.candidates import Parameter
from jointgap.effects.base import (
    Candidates,
    Effect,
    FitContext,
    Records,
    TrialContext,
    TrialSize,
    Values,
    page,
    parameter,
)


@page(order=90)
class HarmonicForce(Effect):
    """A force that swings at a frequency of its own, not locked to the crank."""

    GROUP = "slider"
    SITE = "slider"
    LAW = "F = f cos(2 pi nu t + phase), not locked to the crank"
    REFERENCE = "definition"
    WORDS = "a force on the slider that swings at a frequency of its own"
    COMPILED = {"harmonic": "force_N", "harmonic_phase": "phase_rad"}
    PARAMETERS = {
        "force_N": parameter("N", "f, amplitude", 10.0, ge=0),
        "frequency_Hz": parameter("Hz", "nu, cycles per second", 37.0),
        "phase_rad": parameter("rad", "phase at t = 0", 0.0, default=0.0),
    }

    def compile_into(self, records: Records) -> None:
        super().compile_into(records)
        records["effects"]["harmonic_angular_frequency"] = 2 * math.pi * self.parameters.frequency_Hz

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        frequency, runs = context.frequency_Hz, context.runs
        yield cls.candidate(
            # Runs are recorded one after the other: each has a phase of its own.
            *(
                Parameter(part, 0.0, step=context.scale.force, unit="N", run=run)
                for run in runs
                for part in ("cosine", "sine")
            ),
            Parameter("frequency_Hz", frequency, 0.0, math.inf, 1e-3 * frequency, "Hz"),
            amplitudes=tuple(f"{part}@{run}" for run in runs for part in ("cosine", "sine")),
            initial_guesses=({"frequency_Hz": frequency},),
            parameters=_stated,
            steady_counterpart="slider_constant_force",
        )

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        frequency = float(context.rig.speed / (2 * math.pi) * context.rng.uniform(1.3, 6.0))
        phase = float(context.rng.uniform(-math.pi, math.pi))
        return TrialSize.of("force_N", 0.05 * context.rig.force, frequency_Hz=frequency, phase_rad=phase)


def _stated(values: Values) -> dict[str, float]:
    """Parameters of one run, or the mean amplitude over runs and the phase in the first."""
    cosines = {key.removeprefix("cosine"): values[key] for key in values if key.startswith("cosine")}
    # f cos(w t + phase) = f cos(phase) cos(w t) - f sin(phase) sin(w t)
    sines = {run: -values[f"sine{run}"] for run in cosines}
    first = next(iter(cosines))
    return {
        "force_N": math.sqrt(sum(cosines[run] ** 2 + sines[run] ** 2 for run in cosines) / len(cosines)),
        "frequency_Hz": values["frequency_Hz"],
        "phase_rad": math.atan2(sines[first], cosines[first]),
    }
