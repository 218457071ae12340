"""A clean copy of the project, to run the workflow from nothing without touching the results at hand."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
REPORT, SMOKE_REPORT = "results/report.html", "results/smoke-report.html"
MADE_BY_RUNS = shutil.ignore_patterns(
    ".git", ".venv", ".cache", ".snakemake", "results", "__pycache__", "*.egg-info", ".*_cache", ".hypothesis"
)


def copy_project(folder: Path) -> Path:
    """Copy all that belongs to the project, without anything that runs have made; `folder` must not exist yet."""
    return shutil.copytree(ROOT, folder, ignore=MADE_BY_RUNS)


def environment() -> dict[str, str]:
    """This process's environment, with the packages of the Python that runs it: it need not be .venv's."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    return {**os.environ, "PATH": path}


def in_venv(*command: str) -> list[str]:
    """The command, run with this project's packages and caches whatever the current folder."""
    return [str(ROOT / "scripts" / "in-venv"), *command]


def run(folder: Path, *command: str, **more_environment: str) -> subprocess.CompletedProcess:
    """Run a command in `folder` to its end; output as text."""
    return subprocess.run(
        in_venv(*command),
        cwd=folder,
        env=environment() | more_environment,
        capture_output=True,
        text=True,
        check=False,
    )


def workflow_command(report: str, *options: str) -> list[str]:
    """What `make run` and `make smoke` do after the set-up, as a command for `run`."""
    script = str(ROOT / "scripts" / "run-workflow")
    return [script, report, "all", "--workflow-profile", "workflow/profiles/local", *options]


def smoke_command(*options: str) -> list[str]:
    """The whole chain with the smoke configuration."""
    return workflow_command(SMOKE_REPORT, "--configfile", "config/smoke.yaml", *options)
