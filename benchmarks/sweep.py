"""A sweep of the paper's mechanism, four revolutions and both pins loose, to Parquet: time, memory,
growth and reading.

``python -m benchmarks.sweep --designs 100000`` measures the size that the reaches are of; by
default it is a hundredth. The ratio is of the processor time of the whole to that of the
simulations alone, each timed in its thread in the same run, so that it holds on a busy machine too;
with ``--workflow`` Snakemake's jobs, with all that they load, are held against the same
simulations, with ``--slurm`` 40 jobs on a SLURM of this machine against the sweep without. Memory
and time are those of processes of their own.
"""

import argparse
import json
import resource
import subprocess
import tempfile
import threading
import time
from pathlib import Path

import yaml

from benchmarks.project import (
    ROOT,
    apart,
    copy_project,
    exponent,
    in_venv,
    peak_memory,
    row,
    run,
)
from benchmarks.services import slurm as slurm_of_this_machine

DESIGNS, CORES = 1000, 2
OF_REACH, REACH_S = 100_000, 600.0
RATIO, MEMORY, READ_S = 1.15, 1.1, 1.0
POWER = 1.03
SLURM_JOBS, SLURM_RATIO = 40, 1.25
SUMMARY = "results/sweep/sweep/summary.md"
"""What the workflow is asked for: the sweep, and nothing that is found from it."""

FEW = 1000
"""Designs beside which memory is held, and the fewest that growth is measured with."""

READERS = {
    "pandas": (
        "frame = pandas.read_parquet({folder!r}); frame[(frame.friction > 0.1) &"
        " frame.reason.isna()]"
    ),
    "polars": (
        "polars.read_parquet({folder!r}).filter((polars.col('friction') > 0.1) &"
        " polars.col('reason').is_null())"
    ),
    "duckdb": (
        "duckdb.sql(\"select * from read_parquet('{folder}/*.parquet') where friction > 0.1 and"
        ' reason is null").arrow()'
    ),
}
"""How other programs read all columns of the designs with much friction that did not fail."""


def config(designs: int) -> dict:
    """The configuration that `make sweep` has by default, with so many designs, in jobs as they are
    by default."""
    found = yaml.safe_load((ROOT / "config/sweep.yaml").read_text(encoding="utf-8"))
    found["scenarios"]["sweep"]["sweep"] |= {"number": designs}
    del found["scenarios"]["sweep"]["sweep"]["designs_per_job"]
    return found


def swept(designs: int, cores: int, folder: str) -> dict[str, float]:
    """Wall and processor seconds of a sweep, those of its simulations alone, and peak memory
    [MiB]."""
    from jointgap.config import resolve
    from jointgap.designs.stages import write_sweep
    from jointgap.motion import parallel

    alone: dict[int, float] = {}
    simulated = parallel.integrate_to_angles

    def timed(*given):
        began = time.thread_time()
        try:
            return simulated(*given)
        finally:
            thread = threading.get_ident()
            alone[thread] = alone.get(thread, 0.0) + time.thread_time() - began

    parallel.integrate_to_angles = timed
    scenario = resolve(config(designs), (ROOT,), whole=False)["sweep"]
    with tempfile.TemporaryDirectory() as other:  # loads the compiled code
        few = scenario.sweep.model_copy(update={"number": 4})
        write_sweep(scenario.model_copy(update={"sweep": few}), Path(other), cores)
    alone.clear()
    wall, processor = time.perf_counter(), time.process_time()
    write_sweep(scenario, Path(folder), cores)
    return {
        "wall": time.perf_counter() - wall,
        "processor": time.process_time() - processor,
        "alone": sum(alone.values()),
        "mebibytes": peak_memory(),
    }


def read_and_filtered(reader: str, folder: str) -> dict[str, float]:
    """Seconds in which a program reads and filters the dataset, once it is loaded."""
    program = __import__(reader)
    code = compile(READERS[reader].format(folder=folder), reader, "exec")
    began = time.perf_counter()
    exec(code, {reader: program})
    return {"seconds": time.perf_counter() - began}


def of_workflow(designs: int, cores: int) -> dict[str, float]:
    """Wall and processor seconds of the same sweep as jobs of the workflow."""
    with tempfile.TemporaryDirectory() as folder:
        place = copy_project(Path(folder) / "project")
        (place / "sweep.json").write_text(json.dumps(config(designs)))
        profile = ("--workflow-profile", "workflow/profiles/local", "--cores", str(cores))
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = run(place, "snakemake", SUMMARY, "--configfile", "sweep.json", *profile)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise RuntimeError(done.stderr[-2000:])
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return {"wall": time.perf_counter() - began, "processor": spent}


def of_slurm(designs: int, cores: int, jobs: int = SLURM_JOBS) -> dict[str, float]:
    """Wall seconds of the same sweep as jobs of a SLURM, so many one-core jobs on a node of so many
    cores."""
    with tempfile.TemporaryDirectory() as folder, slurm_of_this_machine(cores) as slurm:
        place = copy_project(Path(folder) / "project")
        asked = config(designs)
        asked["scenarios"]["sweep"]["sweep"] |= {"designs_per_job": -(-designs // jobs)}
        (place / "sweep.json").write_text(json.dumps(asked))
        profile = ("--workflow-profile", "workflow/profiles/slurm")
        command = in_venv("snakemake", SUMMARY, "--configfile", "sweep.json", *profile)
        began = time.perf_counter()
        done = subprocess.run(
            command, cwd=place, env=slurm.environment, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise RuntimeError(done.stderr[-2000:])
        return {"wall": time.perf_counter() - began}


def measure(
    designs: int = DESIGNS, cores: int = CORES, workflow: bool = False, slurm: bool = False
) -> list[dict]:
    with tempfile.TemporaryDirectory() as folder:
        numbers = sorted(
            {min(FEW, designs // 10), round((min(FEW, designs // 10) * designs) ** 0.5), designs}
        )
        found = {
            number: apart("sweep", "swept", number, cores, f"{folder}/{number}")
            for number in numbers
        }
        most = found[designs]
        few = found.get(FEW) or apart("sweep", "swept", FEW, cores, f"{folder}/few")
        dataset = f"{folder}/{designs}/designs"
        read = {
            reader: apart("sweep", "read_and_filtered", reader, dataset)["seconds"]
            for reader in READERS
        }
    reach = REACH_S * designs / OF_REACH
    simulations = {
        "its simulations alone, processor": most["alone"],
        "all, processor": most["processor"],
    }
    grows = exponent(numbers, [found[number]["processor"] for number in numbers])
    rows = [
        row(f"sweep: {designs} designs on {cores} cores", reach, most["wall"], "s", **simulations),
        row(
            "sweep: processor time over that of its simulations",
            RATIO,
            most["processor"] / most["alone"],
            "1",
        ),
        row(
            "sweep: time x cores over its simulations",
            RATIO,
            cores * most["wall"] / most["alone"],
            "1",
        ),
        row(
            f"sweep: peak memory, {designs} designs over {FEW}",
            MEMORY,
            most["mebibytes"] / few["mebibytes"],
            "1",
            **{f"MiB of {designs}": most["mebibytes"]},
        ),
        row(
            f"sweep: growth of processor time, {numbers[0]} to {designs} designs: power",
            POWER,
            grows,
            "1",
        ),
        row(
            f"sweep: rows of {designs} designs read and filtered, slowest program",
            READ_S,
            max(read.values()),
            "s",
            **read,
        ),
    ]
    if workflow:
        jobs = of_workflow(designs, cores)
        spent = {"processor s": jobs["processor"]}
        rows.append(
            row(
                f"sweep: {designs} designs by make sweep on {cores} cores",
                reach,
                jobs["wall"],
                "s",
                **spent,
            )
        )
        rows.append(
            row(
                "sweep: make sweep, processor time over the simulations",
                RATIO,
                jobs["processor"] / most["alone"],
                "1",
            )
        )
    if slurm:
        queued = of_slurm(designs, cores)["wall"]
        seconds = {"without SLURM, s": most["wall"], "on SLURM, s": queued}
        what = (
            f"sweep: {designs} designs by {SLURM_JOBS} SLURM jobs on a node of {cores} cores, time"
            " over that without"
        )
        rows.append(row(what, SLURM_RATIO, queued / most["wall"], "1", **seconds))
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sweep", description=__doc__)
    parser.add_argument("--designs", type=int, default=DESIGNS)
    parser.add_argument("--cores", type=int, default=CORES)
    parser.add_argument(
        "--workflow", action="store_true", help="measure the jobs of the workflow too"
    )
    parser.add_argument(
        "--slurm", action="store_true", help="measure 40 jobs of a SLURM on this machine too"
    )
    for line in measure(**vars(parser.parse_args())):
        print(json.dumps(line))
