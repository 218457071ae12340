"""The campaign of a virtual rig as users have one: campaign and mechanism file, samples in various units."""

import math
import os
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from jointgap.core.parquet import write_atomically
from jointgap.quantities import unit_factor
from jointgap.tables import write_text
from jointgap.trials.size_calibration import Readings
from jointgap.trials.virtual_rig import VirtualRig

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
            write_atomically(file, lambda path, frame=frame: frame.to_parquet(path, index=False))
        else:
            text = frame.to_csv(sep=separator, decimal=decimal, index=False, float_format="%.9g")
            write_text(file, text)
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
    hide_times(folder)


def hide_times(folder: Path) -> None:
    """Give every file of `folder` the same time of change."""
    for file in folder.iterdir():
        os.utime(file, (_FILE_TIME, _FILE_TIME))


def _bounds_entry(rig: VirtualRig, key: str) -> str | list[float]:
    low, high = rig.nuisance_bounds[key]
    return f"{50 * (high - low):g}%" if key == "speed" else [_rounded(low), _rounded(high)]


def _rounded(number: float) -> float:
    return float(f"{number:.8g}")


def _dump(path: Path, content: dict) -> None:
    write_text(path, yaml.safe_dump(content, sort_keys=False))
