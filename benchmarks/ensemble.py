"""Many revolutions to disk: 1000 revolutions with 361 samples each as one ensemble, states and
events in Parquet.

Each measurement runs in a process of its own, for memory only ever grows in one.
"""

import sys
import tempfile
import time

import numpy as np

from benchmarks.project import apart, row

REACH_S = 3.0
CORES = 2
REVOLUTIONS = (1, 10, 100)
RUNS = (100, 1000, 4000)
PERTURBATION = 1e-7  # m


def ensemble(runs: int) -> dict[str, float]:
    """Seconds and peak memory [MiB] of `runs` revolutions from slightly different starts."""
    from benchmarks.simulate import SPEED, case
    from jointgap.config import Simulate
    from jointgap.designs.ensemble import write_ensemble
    from jointgap.dynamics.parallel import Run

    mechanism = case()
    options = Simulate(speed=SPEED, revolutions=1, samples_per_revolution=360, tolerance=1e-9)
    starts = np.random.default_rng(0).normal(0.0, PERTURBATION, (runs, 4))
    with tempfile.TemporaryDirectory() as folder:
        # loads the compiled code
        write_ensemble([Run(mechanism, options, starts[0])], folder, CORES)
        begin = time.perf_counter()
        write_ensemble((Run(mechanism, options, start) for start in starts), folder, CORES)
        return {"seconds": time.perf_counter() - begin, "mebibytes": peak_memory()}


def revolutions(number: int) -> dict[str, float]:
    """Processor seconds of one run over `number` revolutions without output."""
    from benchmarks.simulate import SPEED, case
    from jointgap.config import Simulate
    from jointgap.dynamics.compile_mechanism import parameters
    from jointgap.dynamics.simulation import integrate_to_angles, start_state

    p = parameters(case(), Simulate(speed=SPEED))
    taken = []
    for turns in (1, *[number] * 5):
        begin = time.process_time()
        integrate_to_angles(p, start_state(p), np.array([0.0, 2 * np.pi * turns]), 1e-9)
        taken.append(time.process_time() - begin)
    return {"seconds": min(taken[1:])}


def peak_memory() -> float:
    """Most memory [MiB] that this process has had."""
    import resource

    unit = 1024**2 if sys.platform == "darwin" else 1024  # bytes there, kibibytes elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def exponent(numbers, seconds) -> float:
    """Power of the number that the seconds grow with: 1 is linear."""
    return float(np.polyfit(np.log(numbers), np.log(seconds), 1)[0])


def measure() -> list[dict]:
    written = {runs: apart("ensemble", "ensemble", runs) for runs in RUNS}
    seconds = {runs: found["seconds"] for runs, found in written.items()}
    memory = {runs: found["mebibytes"] for runs, found in written.items()}
    turned = {number: apart("ensemble", "revolutions", number)["seconds"] for number in REVOLUTIONS}
    rows = [
        row(f"ensemble: 1000 revolutions to Parquet, {CORES} cores", REACH_S, seconds[1000], "s")
    ]
    for what, costs in (("revolutions", turned), ("runs", seconds)):
        peers = {f"{number} {what} [s]": cost for number, cost in costs.items()}
        words = f"ensemble: power of the number of {what} that time grows with"
        rows.append(row(words, 1.1, exponent(list(costs), list(costs.values())), "1", **peers))
    peers = {f"{runs} runs [MiB]": memory[runs] for runs in RUNS}
    share = memory[RUNS[-1]] / memory[RUNS[0]]
    return [
        *rows,
        row(
            f"ensemble: peak memory of {RUNS[-1]} runs over that of {RUNS[0]}",
            1.2,
            share,
            "1",
            **peers,
        ),
    ]
