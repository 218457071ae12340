"""A made-up rig whose samples are known exactly: the paper's mechanism without clearance at
constant speed."""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from jointgap.config.load import load_campaign
from jointgap.config.yaml_files import merge
from jointgap.motion.kinematics import Motion, linkage_motion
from jointgap.rig.read_files import read_measurements
from tests.config.mechanisms import PAPER
from tests.config.mechanisms import paper as load_paper

paper = cache(load_paper)
SPEEDS = {"slow": 200.0, "fast": 600.0}  # rpm
COLUMNS = {"time": "t", "crank_angle": "theta", "slider_position": "x", "crank_torque": "M"}
CAMPAIGN = {
    "name": "rig-a",
    "mechanism": str(PAPER),
    "runs": [
        {"id": "slow", "file": "slow.csv", "speed": "200 rpm", "role": "identify"},
        {"id": "fast", "file": "fast.csv", "speed": "600 rpm", "role": "confirm"},
    ],
    "channels": {
        "time": {"column": "t", "unit": "s"},
        "crank_angle": {"column": "theta", "unit": "deg", "noise": 0.01},
        "slider_position": {"column": "x", "unit": "mm"},
        "crank_torque": {"column": "M", "unit": "N*m", "noise": 0.02},
    },
}


def samples(
    rpm: float, count: int = 240, turns: float = 3.0, first: float = 0.3
) -> dict[str, np.ndarray]:
    """Channels in SI at `count` samples over `turns` revolutions, from the angle `first` [rad]
    on."""
    speed = rpm * math.tau / 60.0
    time = np.arange(count) * turns * math.tau / speed / count
    angle = first + speed * time
    motion = linkage_motion(paper(), Motion.of(angle, np.full(count, speed), np.zeros(count)))
    return {
        "time": time,
        "crank_angle": angle,
        "crank_speed": np.full(count, speed) + 0.01 * np.sin(angle),
        "slider_position": motion.slider_x.position,
        "slider_velocity": motion.slider_x.velocity,
        "slider_acceleration": motion.slider_x.acceleration,
        "rod_angle": motion.rod_angle.position,
        "rod_angular_velocity": motion.rod_angle.velocity,
        "crank_torque": 0.5 * np.sin(angle) + 0.2 * np.cos(2.0 * angle),
    }


def table(rpm: float, **given) -> pd.DataFrame:
    """The columns of the rig's files, in the units of `CAMPAIGN`."""
    si = samples(rpm, **given)
    return pd.DataFrame(
        {
            "t": si["time"],
            "theta": np.degrees(si["crank_angle"]) % 360.0,
            "x": 1e3 * si["slider_position"],
            "M": si["crank_torque"],
        }
    )


def write_rig(folder: Path, over: dict | None = None, **tables: pd.DataFrame) -> Path:
    """A campaign file and its runs in `folder`: `CAMPAIGN` with `over` laid on it, tables by run
    instead of the exact ones.
    """
    for run, rpm in SPEEDS.items():
        (tables[run] if run in tables else table(rpm)).to_csv(folder / f"{run}.csv", index=False)
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump(merge(CAMPAIGN, over or {})), encoding="utf-8")
    return path


def read_rig(folder: Path, over: dict | None = None, **tables: pd.DataFrame):
    """The measurements of `write_rig`."""
    return read_measurements(load_campaign(write_rig(folder, over, **tables)))
