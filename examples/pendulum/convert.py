"""Runs of the pendulum, from the clone of its repository."""

from pathlib import Path

import numpy as np
import pandas as pd

ADDRESS = "https://github.com/dfki-ric-underactuated-lab/torque_limited_simple_pendulum"
RUNS = ("ddp", "direct_collocation", "energy_shaping", "sac")  # by their controllers
HIGHEST = np.radians(150.0)


def tables(download: Path) -> dict[str, pd.DataFrame]:
    """Time [s], torque [N m] and angle [rad] of the first swing-up of each run.

    The first time stamp can be early, by the time that the controller takes for its first command.
    Near the top the controllers change, and later some runs are disturbed by hand.
    """
    return {run: _table(path_of(download, run)) for run in RUNS}


def path_of(download: Path, run: str) -> Path:
    """The file of a run."""
    return download / "results" / f"control_method_{run}" / "data_measured.csv"


def _table(path: Path) -> pd.DataFrame:
    samples = pd.read_csv(path)[["time", "torque", "position"]].iloc[1:]
    # a reading is the torque of the interval before it
    samples["torque"] = 0.5 * (samples["torque"] + samples["torque"].shift(-1))
    high = (samples["position"].abs() > HIGHEST).to_numpy()
    return samples.iloc[: np.argmax(high) if high.any() else -1]
