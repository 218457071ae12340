"""A local SLURM for benchmarks and tests, started by scripts/services."""

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from benchmarks.project import ROOT, environment


class ServiceError(RuntimeError):
    """A service that could not be started or stopped, with what scripts/services said."""


@dataclass(frozen=True)
class Slurm:
    """Where a SLURM keeps its files, and the environment of who uses it."""

    folder: Path
    environment: dict[str, str]

    def says(self, *command: str) -> str:
        """What one of SLURM's commands prints."""
        done = subprocess.run(
            command, env=self.environment, capture_output=True, text=True, check=True
        )
        return done.stdout


@contextmanager
def slurm(cores: int | None = None) -> Iterator[Slurm]:
    """A SLURM that takes jobs, on a node of so many cores, or of this machine's; it is stopped at
    the end."""
    folder = Path(tempfile.mkdtemp(prefix="slurm-"))  # a short path: sockets lie in it
    try:
        exported = services("start", folder, **({"CORES": str(cores)} if cores else {}))
        variables = subprocess.run(
            ["bash", "-c", 'eval "$1"; env --null', "bash", exported],
            env=environment(),
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        yield Slurm(folder, dict(one.split("=", 1) for one in variables.split("\0") if one))
    finally:
        services("stop", folder)
        shutil.rmtree(folder, ignore_errors=True)


def services(verb: str, folder: Path, **more_environment: str) -> str:
    """What scripts/services prints for SLURM.

    Raises
    ------
    ServiceError
        With what it said: which packages are missing, for instance.
    """
    command = [str(ROOT / "scripts/services"), verb, str(folder), "slurm"]
    done = subprocess.run(
        command, env=environment() | more_environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise ServiceError(done.stderr.strip())
    return done.stdout
