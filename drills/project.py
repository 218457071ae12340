"""Clean copies of the project, commands in them, and what a run of them leaves."""

import hashlib
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow.parquet as pq

from benchmarks.project import ROOT, copy_project, environment, in_venv

_TIMED = ("benchmarks", "logs", "track")
"""Folders of results that hold nothing but times, or where these were published."""

LIMIT_S = 900
"""No command of a drill takes longer."""


@contextmanager
def clean_folder(project: bool = True) -> Iterator[Path]:
    """A folder of its own, with a copy of what a run of the workflow needs in it, removed at the end."""
    with tempfile.TemporaryDirectory(prefix="drill-") as folder:
        place = Path(folder) / "project"
        if project:
            copy_project(place)
        else:
            place.mkdir()
        yield place


def _environment() -> dict[str, str]:
    """This process's environment with this checkout's package, wherever another one is installed."""
    paths = [str(ROOT / "src"), *filter(None, [os.environ.get("PYTHONPATH")])]
    return environment() | {"PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "200"}


def start(folder: Path, *command: str, **more) -> subprocess.Popen:
    """Start a command in a process group of its own; output as text."""
    return subprocess.Popen(
        in_venv(*command),
        cwd=folder,
        env=_environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
        errors="replace",
        start_new_session=True,
        **more,
    )


def run(folder: Path, *command: str, **more) -> subprocess.CompletedProcess:
    """Run a command in `folder` to its end."""
    process = start(folder, *command, **more)
    try:
        out, err = process.communicate(timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        out, err = process.communicate()
        err += f"\nno end within {LIMIT_S} s"
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def jointgap(folder: Path, *words: str) -> subprocess.CompletedProcess:
    """Run a subcommand."""
    return run(folder, "jointgap", *words)


def snakemake_command(*options: str, cores: int = 1) -> list[str]:
    """The workflow as `make run` runs it, without its report."""
    profile = ["--workflow-profile", "workflow/profiles/local", "--nolock"]
    return ["snakemake", *profile, "--cores", str(cores), *options]


def snakemake(folder: Path, *options: str, cores: int = 1) -> subprocess.CompletedProcess:
    """Run the workflow in a copy of the project."""
    return run(folder, *snakemake_command(*options, cores=cores))


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file below `folder` but for what holds times; of hidden ones too, which nothing should leave."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {
        path.relative_to(folder).as_posix(): _digest(path)
        for path in files
        if not set(path.relative_to(folder).parts) & set(_TIMED) and not path.name.startswith("mlflow.db")
    }


def _digest(path: Path) -> str:
    """Of a file's content without the seconds that it took, which stand in a column, or under a key, of that name."""
    content = path.read_bytes()
    if path.suffix == ".parquet" and not path.name.startswith("."):
        table = pq.read_table(path)
        if "seconds" in table.column_names:
            content = str(table.drop_columns(["seconds"]).to_pydict()).encode()
    elif path.name == "verdict.json":
        content = json.dumps({key: value for key, value in json.loads(content).items() if key != "seconds"}).encode()
    return hashlib.sha256(content).hexdigest()


def emptied(folder: Path) -> Path:
    """`folder`, made anew without anything in it."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder
