"""The script between make and Snakemake, with a stub for Snakemake."""

import os
import select
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from snakemake.cli import parse_config

from benchmarks.project import ROOT, environment, run

SCRIPT, IN_VENV = ROOT / "scripts" / "run-workflow", ROOT / "scripts" / "in-venv"
RULES = ROOT / "workflow" / "rules"
BEFORE_ANY_JOB = f"include: {str(RULES / 'before_any_job.smk')!r}\n"
TERMINAL = f"include: {str(RULES / 'terminal.smk')!r}\n"
# seconds until something that has to happen is given up: a machine may be busy with other things
PATIENCE = 600


def stub(place: Path) -> None:
    place.parent.mkdir(parents=True)
    place.write_text("#!/bin/sh\nprintf '%s\\n' \"$@\" > asked.txt\n")
    place.chmod(0o755)


@pytest.fixture
def run_workflow(tmp_path):
    """Runs the script in a folder of its own."""
    stub(tmp_path / "bin/snakemake")
    path = {"PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}"}

    def called(*options: str) -> subprocess.CompletedProcess:
        command = [SCRIPT, "report.html", "--nolock", *options, "--dry-run"]
        where = {"cwd": tmp_path, "env": os.environ | path}
        return subprocess.run(command, **where, capture_output=True, text=True, check=False)

    return called


def test_user_options_are_passed_to_snakemake(run_workflow, tmp_path):
    for name in ("mine", "more"):
        (tmp_path / f"{name}.yaml").write_text("figures: {animation_frames: 1}\n")

    campaign = 'campaigns=["my rig.yaml"]'
    cores = ["--cores", "2"]
    both = ["campaigned", *cores, "--config", "anyway=true", "-k", "--config", campaign]
    files = ["--configfile", "mine.yaml", *cores, "--configfile=more.yaml", "results/x.png"]
    joined = [*cores, "results/x.png", "--dry-run", "--configfile", "mine.yaml", "more.yaml"]
    cases = [
        (cores, [*cores, "--dry-run"]),
        (both, ["campaigned", *cores, "-k", "--dry-run", "--config", "anyway=true", campaign]),
        (["--config=a=4", "results/x.png"], ["results/x.png", "--dry-run", "--config", "a=4"]),
        (files, joined),
    ]
    for words in (["--config=a=4"], ["-Ca=4"], ["-C", "a=4"]):
        more = [*words, "--quiet", "--config", "campaigns=[1]"]
        cases.append((more, ["--quiet", "--dry-run", "--config", "a=4", "campaigns=[1]"]))
    for options, wanted in cases:
        assert run_workflow(*options).returncode == 0
        report, *asked = (tmp_path / "asked.txt").read_text().splitlines()
        assert report == "report.html"
        assert [one for one in asked if one != "--nolock"] == wanted


def test_no_make_target_is_read_as_configuration():
    for target, asked in (("campaign", "campaigned"), ("run", "all")):
        command = ["make", "--dry-run", target, "ARGS=--config a=b"]
        said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        assert 0 < said.index(f"report.html {asked} ") < said.index("--config a=b")


def test_an_unreadable_configuration_is_refused_before_snakemake(run_workflow, tmp_path):
    good, file = tmp_path / "good.yaml", tmp_path / "mine.yaml"
    good.write_text("figures: {animation_frames: 1}\n")
    for content in (None, "figures: {animation_frames: 1}\nfigures: {animation_frames: 2}\n"):
        if content is not None:
            file.write_text(content)
        done = run_workflow("--configfile", str(good), str(file), "--cores", "1")
        assert (done.returncode, done.stdout) == (2, "")
        (line,) = done.stderr.splitlines()
        assert line.startswith(f"jointgap: error: {file}") and not (tmp_path / "asked.txt").exists()


@pytest.mark.integration
def test_snakemake_refuses_an_invalid_configuration(tmp_path):
    (tmp_path / "mine.yaml").write_text("simulate: {revolutions: 010}\n")
    for more in ((), ("--snakefile", "workflow/blind/Snakefile")):
        options = ["--dry-run", "--quiet", "--cores", "1", "--configfile", f"{tmp_path}/mine.yaml"]
        done = run(ROOT, "snakemake", *more, *options)
        said = done.stdout + done.stderr
        assert done.returncode == 1 and "Traceback" not in said
        assert "mine.yaml, line 1, column 25: 010 differs between YAML versions" in said


SETPRIV = (
    "setpriv --clear-groups --inh-caps=+dac_read_search --ambient-caps=+dac_read_search".split()
)
as_root = pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("setpriv") is None, reason="needs root and setpriv"
)


def as_user(
    number: int, folder: Path, *command: str | Path, **environment: str
) -> subprocess.CompletedProcess:
    """Run a command as another user number without a name."""
    own = {"HOME": "/", "PATH": os.environ["PATH"]} | environment
    given = [*SETPRIV, f"--reuid={number}", "--regid=3000", *map(str, command)]
    return subprocess.run(given, cwd=folder, env=own, capture_output=True, text=True, check=False)


def test_other_python_packages_are_ignored_and_the_user_name_kept(tmp_path):
    known = {"USER": "mine", "LOGNAME": "mine"}
    known |= dict.fromkeys(("PYTHONPATH", "PYTHONHOME"), str(tmp_path))
    done = subprocess.run(
        [IN_VENV, "env"], env=os.environ | known, capture_output=True, text=True, check=True
    )
    lines = done.stdout.splitlines()
    assert {"USER=mine", "LOGNAME=mine"} <= set(lines)
    assert not [line for line in lines if line.startswith(("PYTHONPATH=", "PYTHONHOME="))]


@as_root
def test_a_user_number_without_a_name_can_run_snakemake(tmp_path):
    (tmp_path / "Snakefile").write_text(
        BEFORE_ANY_JOB + "rule one:\n    output: 'report.html'\n    shell: 'touch {output}'\n"
    )
    os.chown(tmp_path, 12345, 3000)
    done = as_user(12345, tmp_path, IN_VENV, SCRIPT, "report.html", "--cores", "1")
    assert done.returncode == 0 and "report: report.html" in done.stdout, done.stdout + done.stderr


@as_root
def test_another_users_clone_is_refused(tmp_path):
    stub(tmp_path / "bin/snakemake")
    path = f"bin:{os.environ['PATH']}"
    for place in (".", "results", ".cache", ".cache/run.lock"):
        if place.endswith("lock"):
            (tmp_path / place).touch()
        else:
            (tmp_path / place).mkdir(exist_ok=True)
        os.chown(tmp_path / place, 12345, 3000)
        done = as_user(12346, tmp_path, SCRIPT, "report.html", PATH=path)
        (line,) = done.stderr.splitlines()
        assert (done.returncode, done.stdout) == (2, "") and not (tmp_path / "asked.txt").exists()
        assert line.startswith(f"jointgap: error: {tmp_path}") and line.endswith(
            " belongs to user number 12345 and you cannot write there; work in a clone of your own"
        )
    assert as_user(12345, tmp_path, SCRIPT, "report.html", PATH=path).returncode == 0
    assert (tmp_path / "asked.txt").exists()


PATHS = [
    "our rig's.yaml",
    'a "b".yaml',
    r"a\b\\c.yaml",
    "a\\",
    "$HOME $(shell touch made) `touch made`",
    "a=b, c: d #e",
]


def test_any_campaign_path_reaches_the_configuration(tmp_path):
    shutil.copy(ROOT / "Makefile", tmp_path)
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    stub(tmp_path / ".venv/bin/snakemake")

    for path, said_by in [(path, said_by) for path in PATHS for said_by in ("environment", "make")]:
        given, more = (["CAMPAIGN=" + path], {}) if said_by == "make" else ([], {"CAMPAIGN": path})
        command = ["make", "--old-file=set-up", "campaign", "ARGS=--dry-run", *given]
        subprocess.run(
            command, cwd=tmp_path, env=os.environ | more, check=True, capture_output=True
        )
        asked = (tmp_path / "asked.txt").read_text().splitlines()
        assert parse_config([one for one in asked if one.startswith("campaigns=")]) == {
            "campaigns": [path]
        }
        assert not (tmp_path / "made").exists()


BY_MAKE, BY_ITSELF = (str(SCRIPT), "report.html"), ("snakemake", "--nolock")


@pytest.fixture
def slow_workflow(tmp_path) -> Path:
    """A workflow of one job that reports its begin and waits, by named pipes."""
    job = "echo begins > begun; read line < proceed; echo ends >> noted; touch {output}"
    rule = f"rule slow:\n    output: 'report.html'\n    log: 'slow.log'\n    shell: {job!r}\n"
    (tmp_path / "Snakefile").write_text(BEFORE_ANY_JOB + TERMINAL + rule)
    for name in ("begun", "proceed"):
        os.mkfifo(tmp_path / name)
    return tmp_path


def started(folder: Path, *command: str, quiet: str = "all") -> subprocess.Popen:
    """A run in `folder`."""
    command = [*command, "--cores", "1", "--forceall", "--quiet", quiet]
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    where = {"cwd": folder, "env": environment(), "start_new_session": True}
    return subprocess.Popen(command, **where, **piped)


def begins(folder: Path) -> None:
    """Wait until the job of a slow workflow begins."""
    begun = os.open(folder / "begun", os.O_RDONLY | os.O_NONBLOCK)
    assert select.select([begun], [], [], PATIENCE)[0] and os.read(begun, 99) == b"begins\n"
    os.close(begun)


@pytest.mark.integration
def test_an_interrupted_run_says_how_to_resume(slow_workflow):
    (slow_workflow / "slow.log").write_text(
        "jointgap: compiling the simulation for this machine, once\n"
    )
    for stop, number in (
        (os.killpg, signal.SIGINT),
        (os.killpg, signal.SIGTERM),
        (os.kill, signal.SIGTERM),
    ):
        working = started(slow_workflow, *BY_MAKE, quiet="reason")
        begins(slow_workflow)
        time.sleep(2.0)  # while Snakemake starts a job it can fail to stop
        stop(working.pid, number)
        if stop is os.kill:  # Snakemake waits for jobs that nobody stops
            (slow_workflow / "proceed").write_text("\n")
        said = working.communicate(timeout=PATIENCE)[0]
        assert (
            working.returncode != 0 and said.count("interrupted; the same command resumes") == 1
        ), said
        assert "failed" not in said and "compiling" not in said and "report: " not in said


@pytest.mark.integration
def test_a_second_run_waits_or_is_refused(slow_workflow):
    def completes(process):
        (slow_workflow / "proceed").write_text("\n")
        said = process.communicate(timeout=PATIENCE)[0]
        assert process.returncode == 0, said
        return said

    for first in (BY_MAKE, BY_ITSELF):
        working = started(slow_workflow, *first)
        begins(slow_workflow)
        refused = started(slow_workflow, *BY_ITSELF)
        said = refused.communicate(timeout=PATIENCE)[0]
        assert refused.returncode == 1 and "error: another run works in this folder" in said
        assert "Traceback" not in said and not (slow_workflow / "noted").exists()
        if first == BY_MAKE:
            completes(working)
            (slow_workflow / "noted").unlink()
    waiting = started(slow_workflow, *BY_MAKE)
    assert "waiting for the end of another run" in waiting.stdout.readline()
    completes(working)
    begins(slow_workflow)
    os.killpg(waiting.pid, signal.SIGKILL)
    waiting.communicate(timeout=PATIENCE)
    assert (slow_workflow / "noted").read_text() == "ends\n"
    again = started(slow_workflow, *BY_MAKE)
    begins(slow_workflow)
    assert "waiting" not in completes(again) and (slow_workflow / "report.html").exists()


@pytest.mark.integration
def test_an_unreachable_store_stops_a_run_before_its_first_job(tmp_path):
    (tmp_path / "Snakefile").write_text(
        BEFORE_ANY_JOB + "rule track:\n    input: 'table'\n    output: 'published'\n    resources:"
        " mlflow_store=1\n    shell: 'touch {output}'\nrule simulate:\n    output: 'table'\n   "
        " resources: mlflow_store=0\n    shell: 'touch {output}'\n"
    )
    store = environment() | {"MLFLOW_TRACKING_URI": "nowhere://x"}
    asked = {"cwd": tmp_path, "env": store, "check": False, "capture_output": True, "text": True}
    refused = subprocess.run(["snakemake", "--cores", "1"], **asked)
    assert refused.returncode != 0 and "jointgap: error: MLflow store" in refused.stderr
    assert "unset MLFLOW_TRACKING_URI" in refused.stderr and not (tmp_path / "table").exists()
    # who publishes nothing needs no store
    assert subprocess.run(["snakemake", "table", "--cores", "1"], **asked).returncode == 0
