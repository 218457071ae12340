"""Runs of the band brake, from the clone of its repository."""

import json
from pathlib import Path

import pandas as pd

ADDRESS = "https://github.com/ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash"
TESTS = Path("data") / "dataset-2" / "characterization datasets"
RUNS = {  # files of the tests with a band tension of 30 lb; amplitudes in inches
    "slow_short": "0.25Hz30lbtension0.5amplitude",
    "slow": "0.25Hz30lbtension1amplitude",
    "slow_long": "0.25Hz30lbtension1.5amplitude",
    "short": "0.5Hz30lbtension0.5amplitude",
    "medium": "0.5Hz30lbtension1amplitude",
    "long": "0.5Hz30lbtension1.5amplitude",
}
AVERAGED = 16  # samples at 1024 Hz whose mean is one row
INCH = 0.0254  # m
KIP = 4448.2216  # N


def tables(download: Path) -> dict[str, pd.DataFrame]:
    """Time [s], position [m] and force [N] of each run."""
    return {run: _table(download / TESTS / f"{file}.json") for run, file in RUNS.items()}


def _table(path: Path) -> pd.DataFrame:
    samples = pd.DataFrame(json.loads(path.read_text(encoding="utf-8"))["data"])
    means = samples.groupby(samples.index // AVERAGED).mean()
    return pd.DataFrame({"time": means[0], "position": INCH * means[1], "force": KIP * means[2]})
