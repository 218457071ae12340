"""Campaign files with simulated recordings of the slider-crank with ideal joints."""

from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from jointgap.config import Mechanism, Simulate
from jointgap.config.channels import CHANNELS as UNITS
from jointgap.config.load import load_campaign
from jointgap.motion.slider_crank import simulate
from jointgap.rig.model import LinkageModel, build_model
from jointgap.rig.read_files import read_measurements
from tests.motion.cases import BODIES

MECHANISM = BODIES | {"joints": {"crank_pin": "ideal", "piston_pin": "ideal"}}


def samples(*hidden: dict, mechanism=MECHANISM, **options) -> pd.DataFrame:
    """Simulated samples of a mechanism with hidden effects."""
    return simulate(
        Mechanism.model_validate({**mechanism, "effects": list(hidden)}), Simulate(**options)
    ).samples


def written(folder: Path, runs: dict, mechanism=MECHANISM, noise=None, **keys) -> Path:
    """A campaign file of a mechanism and its `runs`: of each the speed [rad/s] and a table with
    the columns of its channels, the last one held out. `noise` is the stated one of each channel
    and run.
    """
    listed = []
    for run, (speed, table) in runs.items():
        table.assign(time=table["time"] - table["time"].iloc[0]).to_csv(
            folder / f"{run}.csv", index=False
        )
        role = "split" if len(runs) == 1 else "confirm" if run == [*runs][-1] else "identify"
        listed.append({"id": run, "file": f"{run}.csv", "speed": float(speed), "role": role})
    channels = {name: {"column": name, "unit": UNITS[name]} for name in table}
    for name, sd in (noise or {}).items():
        channels[name]["noise"] = {run: float(value) for run, value in sd.items()}
    content = {"name": "rig", "mechanism": mechanism, "runs": listed, "channels": channels}
    path = folder / "campaign.yaml"
    path.write_text(
        yaml.safe_dump({**content, "nuisance": {"slider_mass": "5%"}, **keys}), encoding="utf-8"
    )
    return path


def with_hidden(folder: Path, *hidden: dict, noise: float = 0.02, **keys) -> Path:
    """A campaign of three runs, whose channels have 2 % of noise, of a mechanism with `hidden`
    effects."""
    rng, runs = np.random.default_rng(5), {}
    for run, rpm in {"slow": 200.0, "mid": 350.0, "fast": 500.0}.items():
        speed = rpm * np.pi / 30
        seen = samples(*hidden, speed=speed, revolutions=5, samples_per_revolution=72).iloc[
            2 * 72 :
        ]
        table = seen[["time", "crank_angle", "slider_acceleration", "crank_torque"]].copy()
        for channel in ("slider_acceleration", "crank_torque"):
            table[channel] += noise * table[channel].std() * rng.standard_normal(len(table))
        runs[run] = speed, table
    return written(folder, runs, **keys)


def law(formula: str, **coefficients: float) -> dict:
    """A hidden force on the slider by a formula."""
    return {
        "name": "discovered_slider_force",
        "parameters": {"formula": formula, "coefficients": coefficients},
    }


def model_of(path: Path) -> LinkageModel:
    """The model of a campaign file with its recordings."""
    own = load_campaign(path)
    return build_model(own, read_measurements(own))
