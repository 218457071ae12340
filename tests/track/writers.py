"""Many processes that publish at the same moment: python -m tests.track.writers ADDRESS FOLDER NUMBER same|different

Each has a folder for temporary files of its own, as if it ran on another machine: locks of this machine keep none of
them apart. Prints why one could not publish, a line each.
"""

import multiprocessing
import sys
import tempfile
from pathlib import Path

import mlflow.store.tracking.sqlalchemy_store  # loaded before the processes part: they begin at once
import mlflow.tracking  # noqa: F401
import numpy as np

from jointgap.core.errors import InputError
from jointgap.track.publish import publish_records
from jointgap.track.run_record import Curve, Dataset, Record
from tests.track.synthetic import simulated

KINDS = ("simulate", "sweep", "campaign")


def records(kind: str, folder: Path) -> list[Record]:
    """A run of its kind, and one nested in it."""
    files = simulated(folder)
    datasets = tuple(Dataset(name, path, "result") for name, path in files.items())
    curve = Curve(np.arange(1000), 1.0 / (1 + np.arange(1000)))
    whole = Record(kind, metrics={"a": 1.0}, curves={"c": curve}, datasets=datasets, files={"note.md": b"words"})
    return [whole, Record(kind, "nested", metrics={"b": 2.0}, datasets=datasets)]


def write(number: int, address: str, folder: Path, kind: str, begin, failed) -> None:
    """What one process does."""
    tempfile.tempdir = str(folder / f"temporary_{number}")
    Path(tempfile.tempdir).mkdir()
    of, name = (KINDS[0], "same") if kind == "same" else (KINDS[number % len(KINDS)], f"writer_{number}")
    content = records(of, folder / f"results_{number}")
    begin.wait()
    said = "ended without a word"
    try:
        publish_records(name, "made up", content, address, folder / "results")
        said = None
    except InputError as error:
        said = str(error)
    finally:  # whoever waits for its word gets one
        failed.put(said)


def main(address: str, folder: Path, number: int, kind: str) -> None:
    """All of them."""
    fork = multiprocessing.get_context("fork")
    begin, failed = fork.Barrier(number), fork.Queue()
    processes = [fork.Process(target=write, args=(n, address, folder, kind, begin, failed)) for n in range(number)]
    for process in processes:
        process.start()
    told = [failed.get() for _ in processes]
    for process in processes:
        process.join()
    print("\n".join(filter(None, told)), end="")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
