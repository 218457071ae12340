"""Runs of the servo, from the clone of its repository."""

import json
from pathlib import Path

import pandas as pd

ADDRESS = (
    "https://github.com/Rhoban/bam, with `git checkout af22604` (later commits have no recordings)"
)
RECORDINGS = Path("bam") / "data.bak" / "raw"
RUNS = {  # the swings of growing frequency, by the gain of the position controller
    "gain_100": "10h28m32",
    "gain_200": "10h29m04",
    "gain_400": "10h29m37",
    "gain_800": "10h30m10",
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
