"""One run of the smoke configuration, shared by the tests of the workflow."""

import os
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from benchmarks.project import copy_project, environment, in_venv, run, smoke_command

# seconds until something that has to happen is given up: a machine may be busy with other things
PATIENCE = 600


@dataclass(frozen=True)
class SmokeRun:
    """Folder and output of a smoke run that was killed and resumed."""

    folder: Path
    left: int  # number of tables after the kill
    last: CompletedProcess


def tables(folder: Path) -> dict[str, bytes]:
    """Content of every Parquet file of the smoke scenario, by path."""
    files = [
        path
        for path in (folder / "results/smoke").rglob("*.parquet")
        if not path.name.startswith(".")
    ]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="session")
def smoke(tmp_path_factory: pytest.TempPathFactory) -> SmokeRun:
    """The chain, killed after its first table, in a folder with a space, without a writable
    HOME."""
    folder = copy_project(tmp_path_factory.mktemp("smoke") / "a project")
    command = smoke_command("--cores", "2")
    home = {"HOME": "/dev/null/home"}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    killed = subprocess.Popen(in_venv(*command), cwd=folder, env=environment() | home, **quiet)
    deadline = time.monotonic() + PATIENCE
    while not tables(folder) and killed.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait()
    left = len(tables(folder))
    last = run(folder, *command, **home)
    assert last.returncode == 0, last.stdout[-3000:] + last.stderr[-6000:]
    return SmokeRun(folder, left, last)


@pytest.fixture
def fresh_project(tmp_path: Path) -> Path:
    """A copy of the project in which nothing has run."""
    return copy_project(tmp_path / "fresh project")
