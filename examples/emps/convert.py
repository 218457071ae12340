"""Runs of the EMPS axis, from the folder with its files."""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.io import loadmat

ADDRESS = "nonlinearbenchmark.org"
RUNS = {"reference": "DATA_EMPS.mat", "pulses": "DATA_EMPS_PULSES.mat"}
SAMPLE_TIME = 1e-3  # s


def tables(download: Path) -> dict[str, pd.DataFrame]:
    """Time [s], position [m] and force of the drive [N] of each run."""
    return {run: _table(download / file) for run, file in RUNS.items()}


def _table(path: Path) -> pd.DataFrame:
    samples = loadmat(path)
    position = samples["qm"].ravel()
    force = samples["gtau"].item() * samples["vir"].ravel()
    time = SAMPLE_TIME * np.arange(position.size)
    return pd.DataFrame({"time": time, "position": position, "force": force})
