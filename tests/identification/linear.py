"""The simplest model there is: what every run reads is a level, of its own and shared, plus a slope over its
samples.
"""

from dataclasses import dataclass, field

import numpy as np

from jointgap.core.candidates import Candidate, Parameter, Series
from jointgap.core.errors import SimulationError
from jointgap.identification.problem import Noise

SAMPLES = 40
SLOPE = Candidate("slope", "sensor", (Parameter("rise", 0.0, step=0.1),), ("rise",))


@dataclass
class Levels:
    """Channel ``y`` of each run: shared + own + rise * (0 .. 1); a rise of more than 9 cannot be simulated in the run
    ``stiff``.
    """

    runs: dict[str, tuple[float, float]]
    held_out: tuple[str, ...] = ()
    noise_sd: float = 0.5
    name: str = "levels"
    numerics: tuple[str, ...] = ()
    candidates: tuple[Candidate, ...] = (SLOPE,)
    nuisances: tuple[Parameter, ...] = field(init=False)
    series: list[Series] = field(init=False)

    def __post_init__(self):
        own = tuple(Parameter("own", 0.0, step=0.1, run=run) for run in self.runs)
        self.nuisances = (Parameter("shared", 0.0, step=0.1), *own)
        x = np.linspace(0.0, 1.0, SAMPLES)
        self.series = [
            Series(run, "y", "1", level + rise * x + self._scatter(), x, x, np.full(SAMPLES, run in self.held_out))
            for run, (level, rise) in self.runs.items()
        ]

    def _scatter(self):
        """One standard deviation up and down in turn: a residual of this alone has a mean square of exactly 1."""
        return self.noise_sd * np.resize([1.0, -1.0, -1.0, 1.0], SAMPLES)

    def simulate(self, run, values, effects=(), numerics=0):
        rise = sum(amplitudes["rise"] for _, amplitudes in effects)
        if run == "stiff" and abs(rise) > 9.0:
            raise SimulationError("too steep")
        return {"y": values["shared"] + values["own"] + rise * np.linspace(0.0, 1.0, SAMPLES)}

    @property
    def noise(self):
        return {series.key: Noise(np.full(SAMPLES, self.noise_sd)) for series in self.series}
