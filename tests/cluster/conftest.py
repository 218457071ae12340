"""A SLURM of one node on this machine (`make test-cluster`)."""

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from benchmarks import services
from benchmarks.project import copy_project, environment, in_venv
from benchmarks.services import Slurm

SLURM_COMMANDS = "sbatch squeue sacct scancel scontrol srun sinfo".split()
CORES = 2
"""Of the node, whatever the machine has: of the four parts of the sweep some wait while others
run."""

PROFILE = (
    "--workflow-profile",
    "workflow/profiles/slurm",
    "--slurm-init-seconds-before-status-checks",
    "2",
)
"""As PROFILE=slurm has it, but that the jobs are looked at more often."""

SWEEP = """
run: [sweep]
scenarios:
  sweep:
    description: Few and coarse designs in four parts.
    mechanism: {base: config/mechanisms/erkaya2009.yaml}
    simulate: {revolutions: 2, samples_per_revolution: 360, tolerance: 1e-8 m}
    sweep:
      number: 30
      designs_per_job: 8
      parameters:
        clearance: {distribution: log_uniform, from: 0.1 mm, to: 1 mm}
        friction: {from: 0, to: 0.2}
"""


def workflow(*asked: str) -> list[str]:
    """What `make PROFILE=slurm` does after the set-up, asked for targets and then options."""
    return in_venv("scripts/run-workflow", *asked, *PROFILE)


def run_on(slurm: Slurm, project: Path, *asked: str) -> subprocess.CompletedProcess:
    """Run the workflow on a SLURM to the end."""
    command = workflow(*asked)
    return subprocess.run(
        command, cwd=project, env=slurm.environment, capture_output=True, text=True, check=False
    )


@contextmanager
def begun_on(slurm: Slurm, project: Path, *asked: str) -> Iterator[subprocess.Popen]:
    """A workflow running on SLURM in the background; output in the project's `said.txt`."""
    with open(project / "said.txt", "w") as said:
        output = {"stdout": said, "stderr": subprocess.STDOUT, "start_new_session": True}
        run = subprocess.Popen(workflow(*asked), cwd=project, env=slurm.environment, **output)
        try:
            yield run
        finally:
            with suppress(ProcessLookupError):
                os.killpg(run.pid, signal.SIGKILL)
            run.wait()


@pytest.fixture(scope="session")
def slurm() -> Iterator[Slurm]:
    """A SLURM that takes jobs; where its packages are missing the test fails with their names."""
    try:
        with services.slurm(CORES) as started:
            yield started
    except services.ServiceError as error:
        pytest.fail(str(error), pytrace=False)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of the project in which nothing has run, in a folder with a space, with a small sweep
    in `sweep.yaml`."""
    folder = copy_project(tmp_path / "a project")
    (folder / "sweep.yaml").write_text(SWEEP)
    return folder


@pytest.fixture(scope="session")
def swept_here(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Files of the dataset of the small sweep, made on this machine without SLURM."""
    folder = copy_project(tmp_path_factory.mktemp("here") / "project")
    (folder / "sweep.yaml").write_text(SWEEP)
    command = "snakemake swept --configfile sweep.yaml --cores 2 --quiet all".split()
    subprocess.run(in_venv(*command), cwd=folder, env=environment(), check=True)
    return dataset(folder)


def dataset(project: Path) -> dict[str, bytes]:
    """Files of the dataset of a project's sweep, by name."""
    return {
        path.name: path.read_bytes()
        for path in (project / "results/sweep/sweep/designs").glob("part_*.parquet")
    }


@pytest.fixture
def without_slurm(tmp_path: Path) -> dict[str, str]:
    """An environment with all commands that this machine has but those of SLURM."""
    commands = tmp_path / "commands"
    commands.mkdir()
    for folder in ("/usr/bin", "/bin"):
        for path in Path(folder).iterdir():
            if path.name not in SLURM_COMMANDS:
                (commands / path.name).unlink(missing_ok=True)
                (commands / path.name).symlink_to(path)
    python = environment()["PATH"].split(os.pathsep)[0]
    return environment() | {"PATH": os.pathsep.join([python, str(commands)])}
