"""The campaign of a virtual rig as users have one: campaign and mechanism file, samples in various units.

Some trials have nothing wrong in the model but in the data: the files of the finished campaign are damaged.
"""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from jointgap.config import read_yaml
from jointgap.core.units import unit_factor
from validation.calibrate import Readings
from validation.rig import VirtualRig

UNITS_OF_CHANNELS = {
    "crank_angle": ("rad", ("deg", "rad", "turn")),
    "slider_position": ("m", ("m", "mm", "inch")),
    "slider_velocity": ("m/s", ("m/s", "mm/s")),
    "slider_acceleration": ("m/s^2", ("m/s^2", "g_n")),
    "rod_angle": ("rad", ("deg", "rad")),
    "rod_angular_velocity": ("rad/s", ("rad/s", "deg/s", "rpm")),
    "rod_acceleration_x": ("m/s^2", ("m/s^2", "g_n")),
    "rod_acceleration_y": ("m/s^2", ("m/s^2", "g_n")),
    "crank_torque": ("N*m", ("N*m", "lbf*ft", "N*cm")),
    "guide_force": ("N", ("N", "kN", "lbf")),
    "frame_force_x": ("N", ("N", "kN", "lbf")),
    "frame_force_y": ("N", ("N", "kN", "lbf")),
}
"""SI unit of every channel, and the units that a campaign may have it in."""

_COLUMN_PREFIXES = ("ch", "signal", "AI", "s")

_FILE_TIME = 1_577_836_800  # [s] 2020-01-01 for every file, so that times of files give nothing away


def write_campaign(rng: np.random.Generator, rig: VirtualRig, readings: Readings, folder: Path, name: str) -> None:
    """Write the campaign."""
    channels = [*(["crank_angle"] if rig.angle_noise else []), *rig.sensors]
    prefix = str(rng.choice(_COLUMN_PREFIXES))
    columns = {channels[index]: f"{prefix}{number}" for number, index in enumerate(rng.permutation(len(channels)), 1)}
    units = {channel: str(rng.choice(UNITS_OF_CHANNELS[channel][1])) for channel in channels}
    scale = {channel: 1 / unit_factor(units[channel], UNITS_OF_CHANNELS[channel][0]) for channel in channels}
    milliseconds, wrap, parquet = rng.random() < 0.3, rng.choice(["none", "up", "both"]), rng.random() < 0.3
    separator, decimal = ((",", "."), (";", ","), ("\t", "."))[rng.integers(3)]
    folder.mkdir(parents=True, exist_ok=True)
    runs = []
    for run, reading in readings.items():
        frame = pd.DataFrame({"t": (reading["time"] + rng.uniform(0, 5)) * (1e3 if milliseconds else 1.0)})
        for channel, column in columns.items():
            values = reading[channel]
            if channel == "crank_angle" and wrap != "none":
                values = values % (2 * math.pi) if wrap == "up" else (values + math.pi) % (2 * math.pi) - math.pi
            frame[column] = values * scale[channel]
        file = folder / f"{run}.{'parquet' if parquet else 'csv'}"
        if parquet:
            frame.to_parquet(file, index=False)
        else:
            frame.to_csv(file, sep=separator, decimal=decimal, index=False, float_format="%.9g")
        rpm = rig.nominal_speeds[run] * 30 / math.pi
        role = "confirm" if run == rig.confirm_run else "identify"
        runs.append({"id": run, "file": file.name, "speed": f"{rpm:g} rpm", "role": role, "start": "settled"})
    channel_entries = {"time": {"column": "t", "unit": "ms" if milliseconds else "s"}}
    for channel, column in columns.items():
        entry = {"column": column, "unit": units[channel]}
        if channel == "crank_angle":
            stated = ("resolution", rig.angle_step) if rig.angle_step else ("noise", rig.angle_noise)
            entry[stated[0]] = _rounded(stated[1] * scale[channel])
        elif rig.noise_is_stated:
            entry["noise"] = {
                run: _rounded(reading[f"{channel} sd"] * scale[channel]) for run, reading in readings.items()
            }
        channel_entries[channel] = entry
    campaign = {
        "name": name,
        "mechanism": "mechanism.yaml",
        "drive": rig.drive,
        "runs": runs,
        "channels": channel_entries,
        "nuisance": {key: _bounds_entry(rig, key) for key in rig.nuisance_bounds},
    }
    _dump(folder / "mechanism.yaml", rig.nominal)
    _dump(folder / "campaign.yaml", campaign)
    _hide_times(folder)


def _hide_times(folder: Path) -> None:
    """Give every file of `folder` the same time of change."""
    for file in folder.iterdir():
        os.utime(file, (_FILE_TIME, _FILE_TIME))


def _bounds_entry(rig: VirtualRig, key: str) -> str | list[float]:
    low, high = rig.nuisance_bounds[key]
    return f"{50 * (high - low):g}%" if key == "speed" else [_rounded(low), _rounded(high)]


def _rounded(number: float) -> float:
    return float(f"{number:.8g}")


def _dump(path: Path, content: dict) -> None:
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


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
                frame.to_parquet(path, index=False)
            else:
                frame.to_csv(path, index=False, float_format="%.9g", **self._marks[run["id"]])
        _dump(self.folder / "campaign.yaml", self.campaign)
        _hide_times(self.folder)


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


_DAMAGES = (_swapped, _zero_off, _sign, _unit, _gain, _other_run, _time_stretched, _wrong_speed, _clipped)
_BY_NAME = {function.__name__[1:]: function for function in _DAMAGES}

DAMAGES = tuple(_BY_NAME)
"""What can be wrong with the data of a campaign: two columns swapped, the zero of the encoder off, a sign, a unit or a
gain wrong, a channel from another run's file, times stretched or the speed of a run wrong, a channel clipped."""


def damage_campaign(rng: np.random.Generator, damage: str, folder: Path) -> dict:
    """Damage the written campaign in `folder`; what was done, for the sealed truth."""
    files = _Files(folder, rng)
    done = _BY_NAME[damage](files)
    files.write()
    return {"what": damage, **done}
