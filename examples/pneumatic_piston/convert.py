"""Runs of the pneumatic piston, from the clone of its repository."""

from pathlib import Path

import numpy as np
import pandas as pd

ADDRESS = "https://github.com/EvaZillen/3D-printed-pneumatic-actuator"
TESTS = Path("results_pneumatic-actuator") / "data" / "friction"
PRESSURES = range(1, 8)  # bar
FIRST_ROW = 15  # as in the authors' notebook: the rows before are from the start of the recording


def tables(download: Path) -> dict[str, pd.DataFrame]:
    """Time [s], position [m], pressure [Pa] and force [N] at each pressure, with the round O-ring
    seal."""
    return {f"{bar}bar": _table(download / TESTS / f"Circle_{bar}bar.csv") for bar in PRESSURES}


def _table(path: Path) -> pd.DataFrame:
    # ms; V, V, V; mm, bar, N
    time, _, _, _, position, pressure, force = np.loadtxt(path, ndmin=2)[FIRST_ROW:].T
    return pd.DataFrame(
        {
            "time": time / 1000.0,
            "position": position / 1000.0,
            "pressure": 1e5 * pressure,
            "force": force,
        }
    )
