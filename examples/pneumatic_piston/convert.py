"""Runs of the pneumatic piston, from the clone of its repository."""

from pathlib import Path

import numpy as np
import pandas as pd

ADDRESS = "https://github.com/EvaZillen/3D-printed-pneumatic-actuator"
TESTS = Path("results_pneumatic-actuator") / "data" / "friction"
PRESSURES = range(1, 8)  # bar
SAMPLE_TIME = 0.01  # s
AVERAGED = 5  # samples whose mean is one row
FIRST_ROW = 15  # as in the authors' notebook: the rows before are from the start of the recording


def tables(download: Path) -> dict[str, pd.DataFrame]:
    """Time [s], position [m], pressure [Pa] and force [N] at each pressure, with the round O-ring
    seal."""
    return {f"{bar}bar": _table(download / TESTS / f"Circle_{bar}bar.csv") for bar in PRESSURES}


def _table(path: Path) -> pd.DataFrame:
    samples = np.loadtxt(path, ndmin=2)[FIRST_ROW:]
    recorded = samples[:, 0] / 1000.0  # s; some samples are late
    time = np.arange(recorded[0], recorded[-1], SAMPLE_TIME)
    columns = {"position": 1e-3 * samples[:, 4], "pressure": 1e5 * samples[:, 5]}
    columns["force"] = samples[:, 6]
    even = {name: np.interp(time, recorded, values) for name, values in columns.items()}
    table = pd.DataFrame({"time": time, **even})
    return table.groupby(table.index // AVERAGED).mean()
