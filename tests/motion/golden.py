"""Trajectories of the hand-written slider-crank: a revolution of each drive, law and mix of joints.

``python -m tests.motion.golden`` writes them; any other equations are compared with them.
"""

import itertools
import tempfile
from pathlib import Path

import numpy as np

from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.config.mechanism import Law
from jointgap.motion.slider_crank import simulate
from tests.motion.cases import ALL, MOTOR, SPEED, mechanism, options
from tests.motion.test_balance import CASES as BALANCES
from tests.motion.test_balance import LATER, PENALTY, RUB, WEIGHT

FILE = Path(__file__).with_name("golden.npz")
COLUMNS = (
    *(f"{name}{number}" for number in (2, 3, 1) for name in ("r", "gamma")),
    "crank_speed",
    "slider_position",
    "slider_velocity",
    "slider_acceleration",
    "rod_angle",
    "rod_deflection",
    "crank_torque",
    "guide_force",
    "frame_force_x",
    "frame_force_y",
)
"""Columns of the trajectories that are kept; the first six of loose joints."""

POSITIONS = [0, 2, 4, COLUMNS.index("slider_position")]
"""Columns of positions [m]."""

_LAWS = [law for law in Law.__args__ if law != "penalty"]
_MIXES = [mix for n in range(1, 4) for mix in itertools.combinations(ALL, n)]

CASES: dict[str, tuple[list, dict, dict]] = BALANCES | LATER
CASES = CASES | {f"law {law}": ([], {"law": law} | RUB, {}) for law in _LAWS}
CASES |= {f"friction {law}": ([], {"friction_law": law} | RUB, {}) for law in FRICTION_LAWS}
CASES |= {f"loose {'+'.join(mix)}": ([], {"loose": mix} | RUB | WEIGHT, {}) for mix in _MIXES}
CASES |= {
    f"motor, loose {'+'.join(mix)}": ([], {"loose": mix} | RUB, {"drive": MOTOR}) for mix in _MIXES
}
CASES |= {
    "clockwise": ([], RUB | WEIGHT, {"speed": -SPEED}),
    "published memory": ([], RUB | {"memory": "published"}, {}),
    "counterweight": ([], RUB | {"crank": {"mass_centre": -0.05, "mass_centre_across": 0.02}}, {}),
    "penalty with weight": ([], PENALTY | WEIGHT, {}),
}
"""Effects, keys of the mechanism, and keys of the simulation, by name."""


CASES |= {"measured angle": ([], RUB | WEIGHT, {"drive": None})}


def trajectory(name: str, tolerance: float = 1e-13) -> np.ndarray:
    """The columns `COLUMNS` of a case over a revolution in steps of 10 deg, (37, k)."""
    effects, keys, run = CASES[name]
    made = mechanism(*effects, **keys)
    run = {"samples_per_revolution": 36, "start_angle": 0.4, "tolerance": tolerance} | run
    with tempfile.TemporaryDirectory() as folder:
        if run.get("drive", run) is None:
            run |= {"drive": measured_drive(Path(folder) / "angle.csv"), "start_angle": 0.0}
        return simulate(made, options(**run)).samples[list(COLUMNS)].to_numpy(float)


def measured_drive(file: Path) -> dict:
    """The drive by a file with the angle of an uneven rotation."""
    times = np.linspace(0.0, 0.15, 301)
    angles = SPEED * times + 0.02 * np.sin(2 * SPEED * times)
    np.savetxt(file, np.column_stack([times, angles]), delimiter=",", header="t,theta", comments="")
    return {"kind": "measured", "file": str(file), "time": "t", "angle": "theta"}


def reproducible(name: str) -> np.ndarray:
    """The trajectory and the changes by another tolerance so far, (2, rows, k), until impacts have
    amplified these to 1e-10 m; later rounding, which depends on the processor, is amplified too."""
    found, other = trajectory(name), trajectory(name, 3e-13)
    change = np.maximum.accumulate(np.nan_to_num(np.abs(found - other)))
    too_far = np.flatnonzero(change[:, POSITIONS].max(axis=1) > 1e-10)
    return np.stack([found, change])[:, : too_far[0] if too_far.size else None]


def main() -> None:
    """Write the file."""
    np.savez_compressed(FILE, **{name: reproducible(name) for name in CASES})
    print(f"{len(CASES)} trajectories in {FILE}, {FILE.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
