"""A clean copy of the project, to run the workflow from nothing without touching the results at hand."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MADE_BY_RUNS = shutil.ignore_patterns(
    ".git", ".venv", ".cache", ".snakemake", "results", "__pycache__", "*.egg-info", ".*_cache", ".hypothesis"
)


def copy_project(folder: Path) -> Path:
    """Copy all that belongs to the project, without anything that runs have made; `folder` must not exist yet."""
    return shutil.copytree(ROOT, folder, ignore=MADE_BY_RUNS)


def run(folder: Path, *command: str, **options) -> subprocess.CompletedProcess:
    """Run a command in `folder` with this project's packages and caches, output as text.

    The packages are those of the Python that runs this, so it works outside of .venv too.
    """
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    environment = {**os.environ, "PATH": path, **options.pop("env", {})}
    return subprocess.run(
        [str(ROOT / "scripts" / "in-venv"), *command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        **options,
    )


def run_workflow(folder: Path, report: str, *options: str, **more) -> subprocess.CompletedProcess:
    """What `make run` and `make smoke` do after the set-up."""
    script = str(ROOT / "scripts" / "run-workflow")
    return run(folder, script, report, "--workflow-profile", "workflow/profiles/local", *options, **more)
