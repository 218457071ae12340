"""Six runs as a real slider-crank rig records them, from closed-form kinematics that share no code
with the package.

The crank's angle over time is a formula (it speeds up and slows down within a turn and drifts over
the record), the slider's position the exact one of a crank and a rod on an offset slide. What a rig
adds: some 50 samples a second at uneven times, stamps that are off by 0.7 ms, an encoder with
steps, a zero of its own in every run and a lag, a slider sensor with noise and a zero of its own,
rows that are missing. There is no torque.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from jointgap.config.load import load_campaign
from jointgap.core.candidates import Series


@dataclass(frozen=True)
class Rig:
    """True values of the rig; lengths [m], times [s]."""

    crank: float = 0.0506
    rod: float = 0.1492
    offset: float = 0.0032  # of the slide beside the crank's pivot
    # error of the encoder in each run
    zeros_deg: tuple[float, ...] = (-1.6, 0.4, 4.1, 2.2, -0.7, 1.3)
    position_zeros: tuple[float, ...] = (0.0121, 0.0121, 0.0118, 0.0121, 0.0119, 0.0121)
    lag: float = 6e-3  # by which the encoder reads late
    jitter: float = 0.7e-3  # standard deviation of the time stamps
    step_deg: float = 0.09  # of the encoder
    noise: float = 6e-5  # of the slider's sensor
    # of each run, the last of which is held out
    rpm: tuple[float, ...] = (55.0, 68.0, 80.0, 95.0, 110.0, 75.0)
    unsteady: float = 0.12  # amplitude of the speed within a turn, as a share of its mean
    seconds: float = 14.0
    rate: float = 50.0  # samples a second
    gaps: int = 0  # empty cells of each channel but time

    @property
    def truth(self) -> list[dict[str, float]]:
        """Nuisances of each run as they are, but for the lag."""
        own = {"slider_offset": self.offset, "crank_length": self.crank, "rod_length": self.rod}
        zeros = zip(self.zeros_deg, self.position_zeros, strict=True)
        return [
            {"encoder_zero": math.radians(one), "slider_position_zero": other} | own
            for one, other in zeros
        ]

    def angle(self, run: int, time: np.ndarray) -> np.ndarray:
        """True crank angle (n,) [rad] at times (n,)."""
        speed = self.rpm[run] * math.tau / 60.0
        # a drive that wanders a little
        phase = speed * time + 0.25 * math.sin(1.0 + run) * np.sin(0.4 * time + run)
        return (
            0.7 * run
            + phase
            + self.unsteady * (np.sin(phase + 0.3) + 0.3 * np.sin(2.0 * phase + 1.1 * run))
        )

    def position(self, angle: np.ndarray) -> np.ndarray:
        """True position (n,) [m] of the slider's pin along the slide at crank angles (n,) [rad]."""
        return self.crank * np.cos(angle) + np.sqrt(
            self.rod**2 - (self.offset - self.crank * np.sin(angle)) ** 2
        )

    def record(self, run: int, seed: int = 0) -> dict[str, np.ndarray]:
        """Columns ``t`` [s], ``theta`` [deg, within a turn] and ``x`` [mm] of one run."""
        rng = np.random.default_rng([seed, run])
        due = np.arange(int(self.seconds * self.rate)) / self.rate
        # uneven: the program has more to do
        due = due + rng.uniform(-0.2, 0.2, due.size) / self.rate
        due = np.delete(due, rng.choice(due.size, 12, replace=False)) + 0.5
        stamp = np.sort(due + self.jitter * rng.standard_normal(due.size))
        read = np.degrees(self.angle(run, due - self.lag)) + self.zeros_deg[run]
        read = self.step_deg * np.round(read / self.step_deg)
        x = (
            self.position(self.angle(run, due))
            + self.position_zeros[run]
            + self.noise * rng.standard_normal(due.size)
        )
        for values in (read, x):
            values[rng.choice(np.arange(20, due.size - 20), self.gaps, replace=False)] = np.nan
        return {"t": stamp - stamp[0], "theta": np.mod(read, 360.0), "x": 1e3 * x}


NUISANCE = {
    "encoder_zero": "6 deg",
    "slider_position_zero": "20 mm",
    "slider_offset": "8 mm",
    "crank_length": "1.5 mm",
    "rod_length": "3 mm",
}


def write(folder: Path, rig: Rig, over: dict | None = None, seed: int = 0) -> Path:
    """The campaign file of a rig and its runs; `over` replaces keys of the file."""
    runs = []
    for run, rpm in enumerate(rig.rpm):
        columns = rig.record(run, seed)
        pd.DataFrame(columns).to_csv(folder / f"r{run}.csv", index=False, float_format="%.9g")
        role = "confirm" if run == len(rig.rpm) - 1 else "identify"
        runs.append({"id": f"r{run}", "file": f"r{run}.csv", "speed": f"{rpm} rpm", "role": role})
    content = {
        "name": "recorded",
        "mechanism": {
            "crank": {"length": "50 mm", "mass": 0.3, "inertia": 1e-3, "mass_centre": 0.02},
            "rod": {"length": "150 mm", "mass": 0.2, "inertia": 5e-4, "mass_centre": 0.07},
            "slider": {"mass": 0.4, "offset": 0.0},
            "joints": {"crank_pivot": "ideal", "crank_pin": "ideal", "piston_pin": "ideal"},
        },
        "drive": "measured_angle",
        "runs": runs,
        "channels": {
            "time": {"column": "t", "unit": "s"},
            "crank_angle": {"column": "theta", "unit": "deg"},
            "slider_position": {"column": "x", "unit": "mm"},
        },
        "nuisance": NUISANCE,
    }
    path = folder / "recorded.yaml"
    path.write_text(yaml.safe_dump(content | (over or {})), encoding="utf-8")
    return path


def campaign(folder: Path, rig: Rig, over: dict | None = None, seed: int = 0):
    """`write`, loaded."""
    return load_campaign(write(folder, rig, over, seed))


def series(run: str, channel: str, unit: str, value, time, angle, jitter: float | None) -> Series:
    """One channel of a run whose noise nobody states; `jitter` as of `Series`."""
    return Series(run, channel, unit, value, time, angle, np.zeros(time.size, bool), jitter=jitter)
