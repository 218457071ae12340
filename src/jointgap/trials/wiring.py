"""Trials with nothing wrong in the model but in the data: the files of a finished campaign are damaged."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from jointgap.config import read_yaml
from jointgap.core.parquet import write_atomically
from jointgap.quantities import unit_factor
from jointgap.tables import write_text
from jointgap.trials.campaign_writer import UNITS_OF_CHANNELS, hide_times

NEED_ENCODER = ("zero_off",)
"""Damages for which the crank angle has to be measured."""

ZERO_OFF_DEG = (20.0, 180.0)
"""[deg] How far an encoder's zero is off, to either side: less is an effect of the list, which trials hide too."""

GAINS = (1.3, 3.0)
"""[1] Factor of a wrong gain, or one over it: less is a fault of the list."""

STRETCHES = (1.15, 1.9)
"""[1] Factor by which times, or a stated speed, are wrong, or one over it: what files are not refused for."""

CLIPPED_SHARES = (0.03, 0.15)
"""[1] Share of the samples beyond the range of an amplifier, on one side."""


class _Files:
    """The files of a written campaign, read and written in the form that they have."""

    def __init__(self, folder: Path, rng: np.random.Generator):
        self.folder, self.rng = folder, rng
        self.campaign: dict[str, Any] = read_yaml(folder / "campaign.yaml")
        self.frames, self._marks = {}, {}
        for run in self.campaign["runs"]:
            path = folder / run["file"]
            if path.suffix == ".parquet":
                self.frames[run["id"]] = pd.read_parquet(path)
                continue
            heading, first = path.read_text(encoding="utf-8").splitlines()[:2]
            separator = next(mark for mark in ";\t," if mark in heading)
            decimal = "," if separator == ";" and "," in first else "."
            self._marks[run["id"]] = {"sep": separator, "decimal": decimal}
            self.frames[run["id"]] = pd.read_csv(path, **self._marks[run["id"]])

    @property
    def sensors(self) -> list[str]:
        """Channels but for the time and the crank angle."""
        return [name for name in self.campaign["channels"] if name not in ("time", "crank_angle")]

    def pick(self, names) -> str:
        """One of `names` at random."""
        names = list(names)
        return names[int(self.rng.integers(len(names)))]

    def factor(self, limits: tuple[float, float]) -> float:
        """A factor within `limits`, or one over it, at random."""
        return float(np.exp(self.rng.uniform(*np.log(limits)) * self.rng.choice([-1.0, 1.0])))

    def column(self, channel: str) -> str:
        """Heading of a channel's column."""
        return self.campaign["channels"][channel]["column"]

    def change(self, channel: str, changed: Callable[[np.ndarray], np.ndarray]) -> None:
        """Change a channel in all runs."""
        for frame in self.frames.values():
            frame[self.column(channel)] = changed(frame[self.column(channel)].to_numpy(float))

    def write(self) -> None:
        """Write all files again."""
        for run in self.campaign["runs"]:
            path, frame = self.folder / run["file"], self.frames[run["id"]]
            if path.suffix == ".parquet":
                write_atomically(path, lambda place, frame=frame: frame.to_parquet(place, index=False))
            else:
                write_text(path, frame.to_csv(index=False, float_format="%.9g", **self._marks[run["id"]]))
        write_text(self.folder / "campaign.yaml", yaml.safe_dump(self.campaign, sort_keys=False))
        hide_times(self.folder)


def _swapped(files: _Files) -> dict:
    channels = files.campaign["channels"]
    first = files.pick(files.sensors)
    second = files.pick(name for name in channels if name not in (first, "time"))
    channels[first]["column"], channels[second]["column"] = files.column(second), files.column(first)
    return {"channels": [first, second]}


def _zero_off(files: _Files) -> dict:
    degrees = files.rng.uniform(*ZERO_OFF_DEG) * files.rng.choice([-1.0, 1.0])
    unit = files.campaign["channels"]["crank_angle"]["unit"]
    files.change("crank_angle", lambda values: values + degrees * unit_factor("deg", unit))
    return {"channels": ["crank_angle"], "degrees": float(degrees)}


def _sign(files: _Files) -> dict:
    channel = files.pick(files.sensors)
    files.change(channel, lambda values: -values)
    return {"channels": [channel]}


def _unit(files: _Files) -> dict:
    channels = files.campaign["channels"]
    with_choice = [name for name in files.sensors if len(UNITS_OF_CHANNELS[name][1]) > 1]
    channel = files.pick(with_choice)
    own = channels[channel]["unit"]
    channels[channel]["unit"] = files.pick(unit for unit in UNITS_OF_CHANNELS[channel][1] if unit != own)
    return {"channels": [channel], "factor": float(unit_factor(channels[channel]["unit"], own))}


def _gain(files: _Files) -> dict:
    channel, factor = files.pick(files.sensors), files.factor(GAINS)
    files.change(channel, lambda values: factor * values)
    return {"channels": [channel], "factor": factor}


def _other_run(files: _Files) -> dict:
    channel, run = files.pick(files.sensors), files.pick(files.frames)
    other = files.pick(name for name in files.frames if name != run)
    column, frame = files.column(channel), files.frames[run]
    frame[column] = files.frames[other][column].reindex(frame.index)
    return {"channels": [channel], "run": run, "other_run": other}


def _time_stretched(files: _Files) -> dict:
    run, factor = files.pick(files.frames), files.factor(STRETCHES)
    time = files.frames[run][files.column("time")]
    files.frames[run][files.column("time")] = time.iloc[0] + factor * (time - time.iloc[0])
    return {"channels": ["time"], "run": run, "factor": factor}


def _wrong_speed(files: _Files) -> dict:
    run, factor = files.campaign["runs"][int(files.rng.integers(len(files.campaign["runs"])))], files.factor(STRETCHES)
    run["speed"] = f"{factor * float(run['speed'].removesuffix(' rpm')):.0f} rpm"
    return {"channels": ["time"], "run": run["id"], "factor": factor}


def _clipped(files: _Files) -> dict:
    channel, share = files.pick(files.sensors), float(files.rng.uniform(*CLIPPED_SHARES))
    above = bool(files.rng.random() < 0.5)

    def clip(values: np.ndarray) -> np.ndarray:
        level = np.nanquantile(values, 1.0 - share if above else share)
        return np.minimum(values, level) if above else np.maximum(values, level)

    files.change(channel, clip)
    return {"channels": [channel], "share": share}


_BY_NAME = {
    "swapped": _swapped,
    "zero_off": _zero_off,
    "sign": _sign,
    "unit": _unit,
    "gain": _gain,
    "other_run": _other_run,
    "time_stretched": _time_stretched,
    "wrong_speed": _wrong_speed,
    "clipped": _clipped,
}

DAMAGES = tuple(_BY_NAME)
"""What can be wrong with the data of a campaign: two columns swapped, the zero of the encoder off, a sign, a unit or a
gain wrong, a channel from another run's file, times stretched or the speed of a run wrong, a channel clipped."""


def damage_campaign(rng: np.random.Generator, damage: str, folder: Path) -> dict:
    """Damage the written campaign in `folder`; what was done, for the sealed truth."""
    files = _Files(folder, rng)
    done = _BY_NAME[damage](files)
    files.write()
    return {"what": damage, **done}
