"""Cost of one revolution over its accuracy, compared with Exudyn and general integrators.

The case: the paper's mechanism, Lankarani-Nikravesh as published with e = 0.46, no friction, no
gravity, first revolution, no output. Errors are those of the rod's mass centre and of the slider at
90 degrees, before chaos, against independent code in 80-bit numbers. Every code runs at all its
tolerances. Our cost of an error bound is the time at the loosest tolerance from which on it is
kept; the others' is their shortest time at any tolerance that keeps it. The table is written to
results/work_precision.parquet; `python -m benchmarks.draw_work_precision` draws it.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.extended import Extended
from benchmarks.integrators import Code, codes
from benchmarks.project import ROOT, row
from jointgap.config import Mechanism, Simulate, load_mechanism
from jointgap.motion.slider_crank import model_of

SPEED = 20 * np.pi
REVOLUTION, QUARTER = 2 * np.pi / SPEED, 0.5 * np.pi / SPEED
# Error [m] -> milliseconds to reach; 4e-11 is about the least that LSODA reaches.
TARGETS = {1e-9: 1.4, 4e-11: None, 1e-11: 2.3, 1e-13: 4.0}
EXUDYN, SCIPY = 1 / 40, 1 / 60  # our time over theirs
TABLE = ROOT / "results" / "work_precision.parquet"

# Name -> exponents of the tolerances [m], how often a revolution is timed at each
SCANS = {
    "jointgap": (np.arange(-16, -6.9, 0.25), 51),
    "compiled LSODA": (np.arange(-15.5, -6.9, 0.5), 21),
    "Exudyn": (np.arange(-14, -4.9, 0.5), 3),
    "scipy DOP853": (np.arange(-14.5, -6.9, 0.5), 3),
    "scipy LSODA": (np.arange(-15, -6.9, 0.5), 3),
}


def case() -> Mechanism:
    """The paper's mechanism without friction."""
    paper = load_mechanism(ROOT / "config/mechanisms/erkaya2009.yaml")
    contact = paper.joint("crank_pin").contact.model_copy(
        update={
            "law": "lankarani_nikravesh",
            "restitution": 0.46,
            "friction": 0.0,
            "memory": "published",
        }
    )
    joints = {
        name: paper.joint(name).model_copy(update={"contact": contact})
        for name in ("crank_pin", "piston_pin")
    }
    return paper.model_copy(
        update={"joints": paper.joints.model_copy(update=joints), "effects": ()}
    )


def exact_positions(mechanism: Mechanism, tolerance: float) -> np.ndarray:
    """Rod's mass centre x, y and slider's position [m] at 90 degrees by 80-bit numbers."""
    bearings = model_of(mechanism, Simulate(speed=SPEED)).bearings
    joints = (bearings["crank_pin"], bearings["piston_pin"])
    extended = Extended(
        mechanism, SPEED, [one.stiffness for one in joints], [one.damping for one in joints]
    )
    return extended.state_at(QUARTER, tolerance)[[0, 1, 3]]


def distance(one, other) -> float:
    return float(np.abs(np.asarray(one - other, float)).max())


def scan(name: str, code: Code, exact: np.ndarray) -> list[dict]:
    """Error [m] at 90 degrees and milliseconds of a revolution at all tolerances of a code; the
    tightest first."""
    exponents, repeats = SCANS[name]
    code(QUARTER, 1e-8)  # whatever is done once
    rows = []
    for tolerance in 10.0**exponents:
        with contextlib.suppress(RuntimeError):  # too tight for this code
            error = distance(code(QUARTER, tolerance)[0], exact)
            milliseconds = 1e3 * min(code(REVOLUTION, tolerance)[1] for _ in range(repeats))
            rows.append(
                {
                    "code": name,
                    "tolerance_m": tolerance,
                    "error_m": error,
                    "ms_per_revolution": milliseconds,
                }
            )
    return rows


def cost(table: pd.DataFrame, name: str, target: float) -> float | None:
    """Milliseconds of a revolution with an error of at most `target` [m]: ours reliably, the
    others' at their best."""
    rows = table[table["code"] == name].sort_values("tolerance_m")
    good = rows["error_m"] <= target
    if name == "jointgap":
        good = good.cumprod().astype(bool)
    return float(rows["ms_per_revolution"][good].min()) if good.any() else None


def first_and_later_call() -> tuple[float, float]:
    """Seconds of a simulation in a new process, with an empty cache of compiled code and with a
    full one."""
    code = (
        "import time; from benchmarks.simulate import case; from jointgap.config import Simulate;"
        "from jointgap.motion import simulate; mechanism = case(); begin = time.perf_counter();"
        "simulate(mechanism, Simulate(revolutions=1)); print(time.perf_counter() - begin)"
    )
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
        command = [sys.executable, "-c", code]
        first, later = (
            float(
                subprocess.run(
                    command, env=environment, cwd=ROOT, stdout=subprocess.PIPE, check=True
                ).stdout
            )
            for _ in range(2)
        )
    return first, later


def work_precision(
    mechanism: Mechanism, exact: np.ndarray, path: Path = TABLE
) -> tuple[pd.DataFrame, list[str]]:
    """Scan of all codes, written to `path` as well, and the names of those that are not
    installed."""
    found = codes(mechanism, SPEED)
    rows = [row for name, code in found.items() if code for row in scan(name, code, exact)]
    table = pd.DataFrame(rows)
    path.parent.mkdir(exist_ok=True)
    table.to_parquet(path)
    return table, [name for name, code in found.items() if code is None]


def measure() -> list[dict]:
    """Rows of what, reach, measured, unit and peers."""
    mechanism = case()
    exact = exact_positions(mechanism, 1e-17)
    table, absent = work_precision(mechanism, exact)
    itself = distance(exact_positions(mechanism, 1e-18), exact)
    least = float(table.loc[table["code"] == "jointgap", "error_m"].min())
    peers = {"80-bit code against itself at a tighter tolerance": itself}
    rows = [row("simulate: least error at 90 deg", None, least, "m", **peers)]
    for target, reach in TARGETS.items():
        costs = {name: cost(table, name, target) for name in SCANS if name not in absent}
        measured = costs.pop("jointgap")
        peers = {name if value else f"{name} (never)": value for name, value in costs.items()}
        peers |= {f"{name} (not installed)": None for name in absent}
        what = f"simulate: one revolution, error at most {target:g} m at 90 deg"
        rows.append(row(what, reach, measured, "ms", **peers))
        for peer, bound in (("Exudyn", EXUDYN), ("scipy", SCIPY), ("compiled LSODA", None)):
            times = [value for name, value in costs.items() if name.startswith(peer) and value]
            share = measured / min(times) if times and measured else None
            what = f"simulate: our time over {peer}'s, error at most {target:g} m"
            rows.append(row(what, bound, share, "1"))
    first, later = first_and_later_call()
    for what, reach, seconds in (("first", 30.0, first), ("later", 1.0, later)):
        rows.append(row(f"simulate: {what} call after installation", reach, seconds, "s"))
    return rows
