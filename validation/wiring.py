"""Ways in which the data of a campaign are wired wrongly: nothing is wrong with the mechanism, but
with its files."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config.campaign import CHANNELS, UNITS
from jointgap.core.units import unit_factor

_ZERO_OFF_DEG = (20.0, 180.0)  # of the encoder, to either side: less is an effect of the list
_GAINS = (1.3, 3.0)  # [1] or one over it: less is a fault of the list
_STRETCHES = (
    1.15,
    1.9,
)  # [1] of times or a stated speed, or one over it: what files are not refused for
_CLIPPED = (0.03, 0.15)  # [1] share of the samples beyond the range of an amplifier, on one side


class _Data:
    """The content of a campaign file and the samples by run, to damage."""

    def __init__(
        self, rng: np.random.Generator, campaign: dict[str, Any], frames: dict[str, pd.DataFrame]
    ):
        self.rng, self.campaign, self.frames = rng, campaign, frames
        self.channels = campaign["channels"]
        self.sensor = self.pick(
            [name for name in self.channels if name not in ("time", "crank_angle")]
        )
        self.run = self.pick(list(frames))

    def pick(self, names: Sequence[str]) -> str:
        return str(self.rng.choice(names))

    def either_way(self, low: float, high: float) -> float:
        """A factor within limits, or one over it."""
        return float(self.rng.uniform(low, high) ** self.rng.choice([-1.0, 1.0]))

    def change(
        self, channel: str, changed: Callable[[pd.Series], pd.Series], runs: Sequence[str] = ()
    ) -> None:
        column = self.channels[channel]["column"]
        for run in runs or self.frames:
            self.frames[run][column] = changed(self.frames[run][column])


def _swapped(data: _Data) -> dict:
    first = data.sensor
    second = data.pick([name for name in data.channels if name not in (first, "time")])
    columns = [data.channels[name]["column"] for name in (second, first)]
    for name, column in zip((first, second), columns, strict=True):
        data.channels[name]["column"] = column
    return {"channels": [first, second]}


def _zero_off(data: _Data) -> dict:
    degrees = float(data.rng.uniform(*_ZERO_OFF_DEG) * data.rng.choice([-1.0, 1.0]))
    off = degrees * unit_factor("deg", data.channels["crank_angle"]["unit"])
    data.change("crank_angle", lambda values: values + off)
    return {"channels": ["crank_angle"], "degrees": degrees}


def _sign(data: _Data) -> None:
    data.change(data.sensor, lambda values: -values)


def _unit(data: _Data) -> dict:
    own = data.channels[data.sensor]["unit"]
    stated = data.pick([unit for unit in UNITS[CHANNELS[data.sensor]] if unit != own])
    data.channels[data.sensor]["unit"] = stated
    return {"factor": float(unit_factor(stated, own))}


def _gain(data: _Data) -> dict:
    factor = data.either_way(*_GAINS)
    data.change(data.sensor, lambda values: factor * values)
    return {"factor": factor}


def _other_run(data: _Data) -> dict:
    other = data.pick([name for name in data.frames if name != data.run])
    source = data.frames[other][data.channels[data.sensor]["column"]]
    data.change(data.sensor, lambda values: source.reindex(values.index), [data.run])
    return {"run": data.run, "other_run": other}


def _time_stretched(data: _Data) -> dict:
    factor = data.either_way(*_STRETCHES)
    data.change("time", lambda time: time.iloc[0] + factor * (time - time.iloc[0]), [data.run])
    return {"channels": ["time"], "run": data.run, "factor": factor}


def _wrong_speed(data: _Data) -> dict:
    factor = data.either_way(*_STRETCHES)
    (run,) = (run for run in data.campaign["runs"] if run["id"] == data.run)
    run["speed"] = f"{factor * float(run['speed'].removesuffix(' rpm')):.0f} rpm"
    return {"channels": ["time"], "run": data.run, "factor": factor}


def _clipped(data: _Data) -> dict:
    share, above = float(data.rng.uniform(*_CLIPPED)), data.rng.random() < 0.5

    def clip(values: pd.Series) -> pd.Series:
        level = values.quantile(1.0 - share if above else share)
        return values.clip(upper=level) if above else values.clip(lower=level)

    data.change(data.sensor, clip)
    return {"share": share}


_DAMAGES = (
    _swapped,
    _zero_off,
    _sign,
    _unit,
    _gain,
    _other_run,
    _time_stretched,
    _wrong_speed,
    _clipped,
)

# What can be wrong: two columns swapped, the zero of the encoder off, a sign, a unit or a gain
# wrong, a channel from another run's file, times stretched or the speed of a run wrong, a channel
# clipped
DAMAGES = tuple(function.__name__[1:] for function in _DAMAGES)


def damage(
    rng: np.random.Generator, what: str, campaign: dict[str, Any], frames: dict[str, pd.DataFrame]
) -> dict:
    """Damage a campaign before it is written; what was done, for the sealed truth."""
    data = _Data(rng, campaign, frames)
    return {"what": what, "channels": [data.sensor]} | (_DAMAGES[DAMAGES.index(what)](data) or {})
