"""Cycles of the cycloidal gear, from the clone of its repository.

The time stamps of the recording advance only every 16 ms; several samples share a stamp. The times
are therefore spread evenly over each cycle.
"""

from pathlib import Path

import numpy as np
import pandas as pd

ADDRESS = (
    "https://github.com/JelmerV/Anti-Backlash-Cycloidal-Actuator, with `git checkout a5fe58d`"
    " (later commits have no test data)"
)
FILE = Path("Code") / "test_data" / "2024-07-17__12-24-38__torqueramp__base910 reamed1.csv"
CYCLES = (2, 3, 4)  # torque ramps up to 4 N m; in cycles 0 and 1 the rotor stops half-way


def tables(download: Path) -> dict[str, pd.DataFrame]:
    """Time [s], commanded torque [N m] and angle of the rotor [rad], both at the output, of each
    cycle."""
    samples = pd.read_csv(download / FILE)
    return {f"cycle{cycle}": _table(samples[samples["test_nr"] == cycle]) for cycle in CYCLES}


def _table(cycle: pd.DataFrame) -> pd.DataFrame:
    stamps = cycle["TIME"].to_numpy()
    return pd.DataFrame(
        {
            "time": np.linspace(stamps[0], stamps[-1], stamps.size),
            "torque": cycle["CONTROL_TORQUE"].to_numpy(),
            "angle": 2.0 * np.pi * cycle["POSITION"].to_numpy(),
        }
    )
