"""Many processes publish at once into a store that is not there yet: all succeed, no run is lost or there twice."""

import sqlite3
import time
from collections import Counter
from pathlib import Path

from drills.harness import Complaint, Drill, Failure, Row, Sitting
from drills.project import clean_folder, start

PROCESSES, ROUNDS = 16, 2
_TWINS = 2  # of the processes publish the same
_LIMIT_S = 400

_PUBLISH = """
import sys
from pathlib import Path
from jointgap.track.publish import publish_records
from jointgap.track.run_record import Record
name = sys.argv[1]
records = [
    Record("simulate", params={"speed": name}, metrics={"peak": 1.0}),
    Record("optimise", params={"speed": name}, files={"a.txt": name.encode()}),
    Record("optimise", "nested", metrics={"worth": 2.0}),
]
publish_records(name, "a drill", records, None, Path(sys.argv[2]))
"""


def drill(sitting: Sitting) -> list[Row]:
    """Rounds of `PROCESSES` processes, each into a store of its own."""
    began, row = (
        time.monotonic(),
        Row(f"publishers: {PROCESSES} processes publish into one new store", seed=sitting.seed),
    )
    for number in range(sitting.of(ROUNDS)):
        with clean_folder(project=False) as folder:
            complaint = _round(folder)
        row.count += 1
        if complaint is not None:
            row.failures.append(Failure(row.what, complaint, number, {"processes": PROCESSES}))
    row.seconds = time.monotonic() - began
    return [row]


def _round(folder: Path) -> Complaint | None:
    names = [f"scenario{max(0, number - _TWINS + 1)}" for number in range(PROCESSES)]
    processes = [start(folder, "python", "-c", _PUBLISH, name, "results") for name in names]
    deadline = time.monotonic() + _LIMIT_S
    said = []
    for process in processes:
        try:
            said.append(process.communicate(timeout=max(1.0, deadline - time.monotonic())))
        except Exception:
            process.kill()
            said.append(process.communicate())
    failed = [words[1][-500:] for process, words in zip(processes, said, strict=True) if process.returncode]
    if failed:
        return Complaint("a publisher fails", f"{len(failed)} of {PROCESSES}: {failed[0]}")
    return lost_or_twice(folder / "results/mlflow.db", set(names))


def lost_or_twice(store: Path, names: set[str]) -> Complaint | None:
    """Whether the store holds each of three runs of every name exactly once, finished."""
    with sqlite3.connect(store) as database:
        rows = database.execute(
            "select r.name, e.name, r.status from runs r join experiments e using (experiment_id) "
            "where r.lifecycle_stage = 'active'"
        ).fetchall()
    database.close()
    found = Counter(rows)
    for name in names:
        for run, stage in ((name, "simulate"), (name, "optimise"), (f"{name} nested", "optimise")):
            times = found.pop((run, f"jointgap-{stage}", "FINISHED"), 0)
            if times != 1:
                return Complaint(
                    "a run is lost" if times == 0 else "a run is there twice", f"{run} of {stage}, {times} times"
                )
    return Complaint("there are runs that nobody published", str(list(found)[:3])) if found else None


DRILL = Drill("publishers", drill)
