"""The workflow on SLURM: same results, also after failures."""

import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import pytest

from benchmarks.project import SMOKE_REPORT
from benchmarks.services import Slurm, services
from tests.cluster.conftest import CORES, SWEEP, begun_on, dataset, run_on, workflow

pytestmark = pytest.mark.cluster

SWEPT = ("swept", "--configfile", "sweep.yaml")
# seconds until something that has to happen is given up: a machine may be busy with other things
PATIENCE = 600

Found = TypeVar("Found")


def wait_for(
    something: Callable[[], Found], run: subprocess.Popen | None = None, project: Path = Path()
) -> Found:
    """Wait until `something` returns a value, while `run` continues."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if found := something():
            return found
        assert run is None or run.poll() is None, (project / "said.txt").read_text()[-6000:]
        time.sleep(0.05)
    raise AssertionError(f"nothing within {PATIENCE} s")


def processes_with(*words: str) -> list[int]:
    """Ids of the processes whose command lines have all `words`."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            arguments = (place / "cmdline").read_bytes().decode(errors="replace")
            folder = os.readlink(place / "cwd")
        except OSError:  # ended meanwhile
            continue
        if all(word in f"{arguments}\0{folder}" for word in words):
            found.append(int(place.name))
    return found


def simulating(project: Path) -> list[int]:
    """Ids of the processes that simulate designs of a project."""
    return processes_with("sweep-designs\0", str(project))


def kill(processes: list[int]) -> None:
    """End processes at once, those that have not ended meanwhile."""
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def cancelled(slurm: Slurm) -> bool:
    """Whether a job that runs could be cancelled, the last of those that SLURM lists."""
    running = slurm.says("squeue", "--noheader", "--states=R", "--format=%i").split()
    try:
        return bool(running) and slurm.says("scancel", running[-1]) == ""
    except subprocess.CalledProcessError:  # it has ended meanwhile
        return False


def queued(slurm: Slurm) -> int:
    """Jobs that have not ended; each task of an array is one."""
    return len(slurm.says("squeue", "--noheader", "--array", "--format=%i").split())


def finished(run: subprocess.Popen, project: Path) -> str:
    """Output of a run that ended without error."""
    code = run.wait(timeout=2 * PATIENCE)
    said = (project / "said.txt").read_text()
    assert code == 0, said[-6000:]
    return said


def test_the_smoke_configuration_runs_to_the_report(slurm, project):
    done = run_on(slurm, project, SMOKE_REPORT, "all", "--configfile", "config/smoke.yaml")
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    assert (project / SMOKE_REPORT).stat().st_size > 0
    assert (project / "results/smoke/comparison.md").stat().st_size > 0


def test_a_campaign_reaches_its_verdict(slurm, project):
    campaign = 'campaigns=["config/campaigns/demonstration.yaml"]'
    done = run_on(slurm, project, "campaigned", "--config", campaign)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    verdict = json.loads((project / "results/campaigns/demonstration/verdict.json").read_text())
    assert verdict["verdict"] == "named"


def test_a_sweep_is_identical_and_runs_in_an_array(slurm, project, swept_here):
    done = run_on(slurm, project, *SWEPT)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    assert re.search(r"Submitted array job with Snakemake IDs (\d+,){3}\d+ ", done.stderr)
    assert dataset(project) == swept_here


def test_killed_and_cancelled_jobs_are_repeated(slurm, project, swept_here):
    with begun_on(slurm, project, *SWEPT) as run:
        kill(wait_for(lambda: simulating(project), run, project)[:1])
        wait_for(lambda: cancelled(slurm), run, project)
        said = finished(run, project)
    assert "Trying to restart job" in said
    assert dataset(project) == swept_here


def test_a_failed_node_repeats_its_jobs(slurm, project, swept_here):
    with begun_on(slurm, project, *SWEPT) as run:
        wait_for(lambda: simulating(project), run, project)
        kill([*processes_with(f"slurmd\0-f\0{slurm.folder}/"), *simulating(project)])
        services("start", slurm.folder)
        finished(run, project)
    assert dataset(project) == swept_here


def test_a_killed_run_resumes(slurm, project, swept_here):
    with begun_on(slurm, project, *SWEPT) as run:
        # The last two parts wait for the cores of the first.
        wait_for(lambda: dataset(project) and queued(slurm) < len(swept_here), run, project)
    slurm.says("scancel", "--user", str(os.geteuid()))
    wait_for(lambda: queued(slurm) == 0)
    assert 0 < len(dataset(project)) < len(swept_here)
    done = run_on(slurm, project, *SWEPT)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    assert dataset(project) == swept_here


def refused(environment, project, *options: str) -> str:
    """The error of a run that ends before its first job."""
    shown = {"capture_output": True, "text": True, "check": False}
    done = subprocess.run(workflow(*SWEPT, *options), cwd=project, env=environment, **shown)
    assert done.returncode == 1
    assert not dataset(project) and "Traceback" not in done.stdout + done.stderr
    (error,) = re.findall("error: .*", done.stderr)
    return error


def test_missing_slurm_commands_are_reported(without_slurm, project):
    assert "no sbatch, squeue" in (said := refused(without_slurm, project))
    assert "apt-get install slurm-client" in said


def test_a_missing_controller_is_reported(slurm, project, tmp_path):
    configuration = (slurm.folder / "slurm/slurm.conf").read_text()
    elsewhere = tmp_path / "slurm.conf"
    elsewhere.write_text(re.sub("(SlurmctldPort)=.*", r"\1=1", configuration))
    said = refused(slurm.environment | {"SLURM_CONF": str(elsewhere)}, project)
    assert "controller does not answer" in said


def test_impossible_or_too_many_jobs_are_refused(slurm, project):
    few, more = refused(slurm.environment, project, "--jobs", "3"), CORES + 1
    assert "4 jobs of sweep_designs are submitted in arrays, all at once, and jobs allows 3" in few
    said = refused(slurm.environment, project, "--set-threads", f"sweep_designs={more}")
    assert f"sweep_designs asks for {more} cores, and no node has more than {CORES}" in said
    many = SWEEP.replace("number: 30", "number: 1001").replace("per_job: 8", "per_job: 1")
    (project / "sweep.yaml").write_text(many)
    said = refused(slurm.environment, project)
    assert "1001 jobs of sweep_designs" in said and "MaxArraySize of SLURM allows 1000" in said
    assert "sweep.designs_per_job" in said
