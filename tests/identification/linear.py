"""The simplest model there is: what every run reads is a level, of its own and shared, plus a slope over its
samples.
"""

from dataclasses import dataclass, field, replace

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


def stairs(starts: dict[str, int], held_out: tuple[str, ...] = (), noise_sd: float = 0.1) -> Levels:
    """Runs that rise by 3 from one of four places on, `starts` of the last one by run: a whole number of each run."""
    shift = SAMPLES // 4

    class Stairs(Levels):
        def simulate(self, run, values, effects=(), numerics=0):
            flat = np.full(SAMPLES, values["shared"] + values["own"])
            for _, own in effects:
                flat += np.roll(own["rise"] * np.linspace(0.0, 1.0, SAMPLES), shift * round(own["start"]))
            return {"y": flat}

    model = Stairs({run: (0.0, 0.0) for run in starts}, held_out, noise_sd)
    own = tuple(Parameter("start", 0.0, 0.0, 3.0, run=run, whole=True) for run in starts)
    guess = {"rise": 1.0} | {p.key: 0.0 for p in own}
    rise = Candidate("rise", "sensor", (Parameter("rise", 0.0, step=0.1), *own), ("rise",), (guess,))
    model.candidates = (rise,)
    model.series = [
        replace(series, value=series.value + np.roll(np.linspace(0.0, 3.0, SAMPLES), shift * starts[series.run]))
        for series in model.series
    ]
    return model
