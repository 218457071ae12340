"""Waiting times: help, the small run, a run with nothing to do, the full run."""

import os
import statistics
import tempfile
import time
from pathlib import Path

from benchmarks.project import REPORT, ROOT, copy_project, row, run, smoke_command, workflow_command

# The whole run takes long enough that it is measured only when asked for:
# JOINTGAP_BENCH_WHOLE_RUN=1 make bench
WHOLE_RUN = "JOINTGAP_BENCH_WHOLE_RUN"


def seconds(action, repeats: int = 1) -> float:
    """Median wall-clock seconds of an action that returns a completed process; it must succeed."""
    taken = []
    for _ in range(repeats):
        start = time.perf_counter()
        done = action()
        taken.append(time.perf_counter() - start)
        if done.returncode != 0:
            raise RuntimeError(f"{done.args} failed:\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}")
    return statistics.median(taken)


def measure() -> list[dict]:
    def again():
        return run(ROOT, *workflow_command(REPORT))

    rows = [
        row(
            "jointgap --help",
            0.3,
            seconds(lambda: run(ROOT, "jointgap", "--help"), repeats=9),
            "s",
            python=seconds(lambda: run(ROOT, "python", "-c", "pass"), repeats=9),
            snakemake=seconds(lambda: run(ROOT, "snakemake", "--help"), repeats=3),
        )
    ]
    with tempfile.TemporaryDirectory() as folder:
        copy = copy_project(Path(folder) / "project")
        rows.append(
            row("make smoke", 60, seconds(lambda: run(copy, *smoke_command("--cores", "2"))), "s")
        )
        asked = os.environ.get(WHOLE_RUN)
        whole = (
            seconds(lambda: run(copy, *workflow_command(REPORT, "--cores", "2"))) if asked else None
        )
        rows.append(row(f"make run, 2 cores (with {WHOLE_RUN}=1)", 720, whole, "s"))
    idle = run(ROOT, "snakemake", "--dry-run", "--quiet", "--cores", "1")
    finished = (ROOT / REPORT).exists() and "Nothing to be done" in idle.stdout + idle.stderr
    rows.append(row("second make run", 10, seconds(again, repeats=3) if finished else None, "s"))
    return rows
