"""Data faults: the files of a campaign are wrong, not the mechanism."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config.campaign import UNITS
from jointgap.config.channels import CHANNELS
from jointgap.core.units import unit_factor

_ZERO_OFF_DEG = (20.0, 180.0)  # encoder zero, either sign; smaller ones are a listed effect
_GAINS = (1.3, 3.0)  # [1] or the inverse; smaller ones are a listed sensor fault
_STRETCHES = (1.15, 1.9)  # [1] or the inverse; larger ones are refused when read
_CLIPPED = (0.03, 0.15)  # [1] share of clipped samples, on one side


class _Data:
    """Campaign file content and samples by run, a random sensor and a random run."""

    def __init__(
        self, rng: np.random.Generator, campaign: dict[str, Any], frames: dict[str, pd.DataFrame]
    ):
        self.rng, self.campaign, self.frames = rng, campaign, frames
        self.channels = campaign["channels"]
        self.sensor = self.pick([name for name in self.channels if name not in _NO_SENSORS])
        self.run = self.pick(list(frames))

    def pick(self, names: Sequence[str]) -> str:
        return str(self.rng.choice(names))

    def factor(self, low: float, high: float) -> float:
        """A factor between the limits, or its inverse."""
        return float(self.rng.uniform(low, high) ** self.rng.choice([-1.0, 1.0]))

    def change(self, channel: str, change: Callable[[pd.Series], pd.Series], run: str = "") -> None:
        column = self.channels[channel]["column"]
        for name in [run] if run else self.frames:
            self.frames[name][column] = change(self.frames[name][column])


_NO_SENSORS = ("time", "crank_angle")


def _swapped(data: _Data) -> dict:
    """Two columns."""
    other = data.pick([name for name in data.channels if name not in (data.sensor, "time")])
    first, second = data.channels[data.sensor], data.channels[other]
    first["column"], second["column"] = second["column"], first["column"]
    return {"channels": [data.sensor, other]}


def _zero_off(data: _Data) -> dict:
    """The zero of the encoder."""
    degrees = float(data.rng.uniform(*_ZERO_OFF_DEG) * data.rng.choice([-1.0, 1.0]))
    offset = degrees * unit_factor("deg", data.channels["crank_angle"]["unit"])
    data.change("crank_angle", lambda values: values + offset)
    return {"channels": ["crank_angle"], "degrees": degrees}


def _sign(data: _Data) -> dict:
    data.change(data.sensor, lambda values: -values)
    return {}


def _unit(data: _Data) -> dict:
    """The unit in the campaign file."""
    true = data.channels[data.sensor]["unit"]
    wrong = data.pick([unit for unit in UNITS[CHANNELS[data.sensor]] if unit != true])
    data.channels[data.sensor]["unit"] = wrong
    return {"factor": float(unit_factor(wrong, true))}


def _gain(data: _Data) -> dict:
    factor = data.factor(*_GAINS)
    data.change(data.sensor, lambda values: factor * values)
    return {"factor": factor}


def _other_run(data: _Data) -> dict:
    """A channel from the file of another run."""
    other = data.pick([name for name in data.frames if name != data.run])
    source = data.frames[other][data.channels[data.sensor]["column"]]
    data.change(data.sensor, lambda values: source.reindex(values.index), data.run)
    return {"run": data.run, "other_run": other}


def _time_stretched(data: _Data) -> dict:
    factor = data.factor(*_STRETCHES)
    data.change("time", lambda time: time.iloc[0] + factor * (time - time.iloc[0]), data.run)
    return {"channels": ["time"], "run": data.run, "factor": factor}


def _wrong_speed(data: _Data) -> dict:
    """The speed of a run in the campaign file."""
    factor = data.factor(*_STRETCHES)
    (run,) = (run for run in data.campaign["runs"] if run["id"] == data.run)
    run["speed"] = f"{factor * float(run['speed'].removesuffix(' rpm')):.0f} rpm"
    return {"channels": ["time"], "run": data.run, "factor": factor}


def _clipped(data: _Data) -> dict:
    """The largest or smallest values of a channel."""
    share, above = float(data.rng.uniform(*_CLIPPED)), data.rng.random() < 0.5

    def clip(values: pd.Series) -> pd.Series:
        level = values.quantile(1.0 - share if above else share)
        return values.clip(upper=level) if above else values.clip(lower=level)

    data.change(data.sensor, clip)
    return {"share": share}


_FUNCTIONS = {
    function.__name__[1:]: function
    for function in (
        *(_swapped, _zero_off, _sign, _unit, _gain),
        *(_other_run, _time_stretched, _wrong_speed, _clipped),
    )
}
DATA_FAULTS = tuple(_FUNCTIONS)


def damage(
    rng: np.random.Generator, fault: str, campaign: dict[str, Any], frames: dict[str, pd.DataFrame]
) -> dict:
    """Apply a data fault before the campaign is written; its record for the ground truth."""
    data = _Data(rng, campaign, frames)
    return {"what": fault, "channels": [data.sensor]} | _FUNCTIONS[fault](data)
