"""A SLURM of one node on this machine, shared by the tests; `make test-cluster` installs its packages."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from benchmarks.project import ROOT, copy_project, environment, in_venv

PROFILE = ("--workflow-profile", "workflow/profiles/slurm", "--slurm-init-seconds-before-status-checks", "2")
"""As PROFILE=slurm has it, but that the jobs are looked at more often."""

SWEEP = """
run: [sweep]
scenarios:
  sweep:
    description: Few and coarse designs in six parts.
    mechanism: {base: config/mechanisms/erkaya2009.yaml}
    simulate: {revolutions: 2, samples_per_revolution: 360, tolerance: 1e-8 m}
    sweep:
      number: 46
      designs_per_job: 8
      parameters:
        clearance: {distribution: log_uniform, from: 0.1 mm, to: 1 mm}
        friction: {from: 0, to: 0.2}
"""


@dataclass(frozen=True)
class Slurm:
    """Where a SLURM keeps its files, and what has to be in the environment of who uses it."""

    folder: Path
    environment: dict[str, str]

    def says(self, *command: str) -> str:
        """What one of SLURM's commands prints."""
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=True)
        return done.stdout

    def start(self) -> None:
        """Start whichever of its daemons do not run."""
        services("start", self.folder)

    def run(self, project: Path, target: str, *options: str) -> subprocess.CompletedProcess:
        """Run the workflow on it to the end."""
        return subprocess.run(
            workflow(target, *options),
            cwd=project,
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
        )

    def begin(self, project: Path, target: str, *options: str) -> subprocess.Popen:
        """Begin to run the workflow on it, and write what it says to the project's `said.txt`."""
        with open(project / "said.txt", "w") as said:
            return subprocess.Popen(
                workflow(target, *options),
                cwd=project,
                env=self.environment,
                stdout=said,
                stderr=subprocess.STDOUT,
            )


def workflow(target: str, *options: str) -> list[str]:
    """What `make PROFILE=slurm` does after the set-up."""
    return in_venv("scripts/run-workflow", target, *PROFILE, *options)


def services(verb: str, folder: Path) -> str:
    """What `scripts/services` prints for SLURM; the test fails with what it said where it could not."""
    done = subprocess.run(
        [ROOT / "scripts/services", verb, folder, "slurm"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        pytest.fail(done.stderr, pytrace=False)  # names the packages where they are missing
    return done.stdout


@pytest.fixture(scope="session")
def slurm() -> Iterator[Slurm]:
    """A SLURM that takes jobs; its folder has a short path, since sockets lie in it."""
    folder = Path(tempfile.mkdtemp(prefix="slurm-"))
    exported = 'eval "$1"; env --null'
    variables = subprocess.run(
        ["bash", "-c", exported, "bash", services("start", folder)],
        env=environment(),
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    yield Slurm(folder, dict(one.split("=", 1) for one in variables.split("\0") if one))
    services("stop", folder)
    shutil.rmtree(folder)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of the project in which nothing has run, in a folder with a space, with a small sweep in `sweep.yaml`."""
    folder = copy_project(tmp_path / "a project")
    (folder / "sweep.yaml").write_text(SWEEP)
    return folder


@pytest.fixture(scope="session")
def swept_here(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Files of the dataset of the small sweep, made on this machine without SLURM."""
    folder = copy_project(tmp_path_factory.mktemp("here") / "project")
    (folder / "sweep.yaml").write_text(SWEEP)
    subprocess.run(
        in_venv("snakemake", "swept", "--configfile", "sweep.yaml", "--cores", "2", "--quiet", "all"),
        cwd=folder,
        env=environment(),
        check=True,
    )
    return dataset(folder)


def dataset(project: Path) -> dict[str, bytes]:
    """Files of the dataset of a project's sweep, by name."""
    return {path.name: path.read_bytes() for path in (project / "results/sweep/sweep/designs").glob("*.parquet")}


@pytest.fixture
def without_slurm(tmp_path: Path) -> dict[str, str]:
    """An environment with all commands that this machine has but those of SLURM."""
    commands = tmp_path / "commands"
    commands.mkdir()
    for folder in ("/usr/bin", "/bin"):
        for path in Path(folder).iterdir():
            if path.name not in ("sbatch", "squeue", "sacct", "scancel", "scontrol", "srun", "sinfo"):
                (commands / path.name).unlink(missing_ok=True)
                (commands / path.name).symlink_to(path)
    python = environment()["PATH"].split(os.pathsep)[0]
    return environment() | {"PATH": os.pathsep.join([python, str(commands)])}
