"""The toy with knocks: short blows at angles that depend on a clearance, and on what else acts, far more than all the
rest does.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from jointgap.core.candidates import Effects, Parameter
from tests.identification.toy import Toy, candidate_of, coloured, toy

CLEARANCE = Parameter("clearance", 1.0, 0.9, 1.1, 0.005, "mm")
WIDTH = 0.02  # rad
BLOW = 3.0  # times the acceleration's own standard deviation
LATER = 4.0  # rad per mm: over the range of the clearance, blows move by 46 deg
BY_SPRING = 0.15  # rad per N/m


@dataclass(frozen=True)
class Knocking(Toy):
    """A `jointgap.core.candidates.Model`."""

    def simulate(
        self, run: str, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> Mapping[str, np.ndarray]:
        """What the sensors read."""
        read = dict(super().simulate(run, values, effects, numerics))
        angle = next(series for series in self.series if series.run == run).angle
        late = LATER * (values["clearance"] - 1.0)
        late += BY_SPRING * sum(at["stiffness_N_m"] for one, at in effects if one.name == "spring")
        for place, sign in ((1.0, 1.0), (2.5, -1.0), (4.5, 1.0)):
            off = np.angle(np.exp(1j * (angle - place - late)))
            read["acceleration"] = read["acceleration"] + sign * BLOW * np.std(read["acceleration"]) * np.exp(
                -0.5 * np.square(off / WIDTH)
            )
        return read


def knocking(
    effects: Mapping[str, Mapping[str, float]] | None = None, clearance: float = 1.0, seed: int = 0
) -> Knocking:
    """The toy with knocks, and data measured on it in which `effects` act and the clearance is `clearance` [mm]."""
    plain = toy(samples=360, planned=True)
    model = Knocking(plain.series, (*plain.nuisances, CLEARANCE), plain.candidates, plain.speeds)
    acting = [(candidate_of(label), at) for label, at in (effects or {}).items()]
    rng, measured = np.random.default_rng(seed), []
    for run in plain.speeds:
        values = {p.name: p.nominal for p in model.nuisances if p.run in (None, run)} | {"clearance": clearance}
        clean = model.simulate(run, values, acting)
        for one in (series for series in model.series if series.run == run):
            sd = 0.02 * float(np.std(clean[one.channel]))
            value = clean[one.channel] + sd * coloured(one.angle.size, 0.0, rng)
            measured.append(replace(one, value=value, stated_noise=np.full(one.angle.size, sd)))
    return replace(model, series=tuple(measured))
