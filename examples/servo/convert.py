"""Runs of the servo, from the clone of its repository."""

import json
from pathlib import Path

import pandas as pd

ADDRESS = (
    "https://github.com/Rhoban/bam, with `git checkout af22604` (later commits have no recordings)"
)
RECORDINGS = Path("bam") / "data.bak" / "raw"
RUNS = {  # by trajectory and gain of the position controller
    "sweep_100": "10h28m32",
    "sines_200": "10h28m42",
    "sweep_200": "10h29m04",
    "lift_200": "10h28m57",
    "sines_400": "10h29m14",
    "sweep_400": "10h29m37",
}
FULL_DUTY = 885  # count of the duty cycle that applies the whole supply voltage
COUNTS = 65536  # of the unsigned register; the upper half is negative


def tables(download: Path) -> dict[str, pd.DataFrame]:
    """Time [s], voltage of the motor [V] and angle of the arm [rad] of each run."""
    return {
        run: _table(download / RECORDINGS / f"2026-01-15_{file}.json") for run, file in RUNS.items()
    }


def _table(path: Path) -> pd.DataFrame:
    samples = pd.DataFrame(json.loads(path.read_text(encoding="utf-8"))["entries"])
    counts = samples["load"].where(samples["load"] < COUNTS // 2, samples["load"] - COUNTS)
    return pd.DataFrame(
        {
            "time": samples["timestamp"],
            "voltage": counts / FULL_DUTY * samples["input_volts"],
            "angle": samples["position"],
        }
    )
