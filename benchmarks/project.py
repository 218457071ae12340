"""Shared by benchmarks and tests: result rows, functions in separate processes, a clean copy of the
project."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
REPORT, SMOKE_REPORT = "results/report.html", "results/smoke-report.html"
MADE_BY_RUNS = shutil.ignore_patterns(
    ".git",
    ".venv",
    ".cache",
    ".snakemake",
    "results",
    "__pycache__",
    "*.egg-info",
    ".*_cache",
    ".hypothesis",
)


def copy_project(folder: Path) -> Path:
    """Copy all that belongs to the project, without anything that runs have made; `folder` must not
    exist yet."""
    return shutil.copytree(ROOT, folder, ignore=MADE_BY_RUNS)


def environment() -> dict[str, str]:
    """This process's environment, with the packages of the Python that runs it: it need not be
    .venv's."""
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


def row(
    what: str, reach: float | None, measured: float | None, unit: str, **peers: float | None
) -> dict:
    """A row of the table."""
    return {"what": what, "reach": reach, "measured": measured, "unit": unit, "peers": peers}


def apart(module: str, function: str, *given: object) -> dict[str, float]:
    """Result of a function of a module of this folder in a new process: memory only ever grows in
    one."""
    code = (
        f"import json; from benchmarks.{module} import {function};"
        f" print(json.dumps({function}(*{given!r})))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, cwd=ROOT, env=environment(), stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def workflow_command(report: str, *options: str) -> list[str]:
    """What `make run` and `make smoke` do after the set-up, as a command for `run`."""
    script = str(ROOT / "scripts" / "run-workflow")
    return [script, report, "all", "--workflow-profile", "workflow/profiles/local", *options]


def smoke_command(*options: str) -> list[str]:
    """The whole chain with the smoke configuration."""
    return workflow_command(SMOKE_REPORT, "--configfile", "config/smoke.yaml", *options)


def peak_memory() -> float:
    """Most memory [MiB] that this process has had."""
    import resource

    unit = 1024**2 if sys.platform == "darwin" else 1024  # bytes there, kibibytes elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def exponent(numbers, seconds) -> float:
    """Power of the number that the seconds grow with: 1 is linear."""
    import numpy as np

    return float(np.polyfit(np.log(numbers), np.log(seconds), 1)[0])
