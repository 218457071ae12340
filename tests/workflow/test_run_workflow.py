"""The script between make and Snakemake, with a stand-in for Snakemake that says what it was asked."""

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from benchmarks.project import ROOT, environment, run

SCRIPT = ROOT / "scripts" / "run-workflow"


def run_workflow(folder, *options: str) -> subprocess.CompletedProcess:
    stand_in = folder / "bin" / "snakemake"
    stand_in.parent.mkdir()
    stand_in.write_text("#!/bin/sh\nprintf '%s\\n' \"$@\" >> asked.txt\n")
    stand_in.chmod(0o755)
    environment = os.environ | {"PATH": f"{stand_in.parent}:{os.environ['PATH']}"}
    command = [SCRIPT, "report.html", "--nolock", *options, "--dry-run"]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def asked_of_snakemake(folder, *options: str) -> list[str]:
    assert run_workflow(folder, *options).returncode == 0
    report, *options = (folder / "asked.txt").read_text().splitlines()
    assert report == "report.html"
    return [one for one in options if one != "--nolock"]


def test_a_users_configuration_keeps_what_the_makefile_says(tmp_path):
    said = asked_of_snakemake(
        tmp_path, "campaigned", "--cores", "2", "--config", "fit_parts=4", "-k", "--config", 'campaigns=["my rig.yaml"]'
    )
    assert said == [
        "campaigned",
        "--cores",
        "2",
        "-k",
        "--dry-run",
        "--config",
        "fit_parts=4",
        'campaigns=["my rig.yaml"]',
    ]


@pytest.mark.parametrize("written", [["--config=fit_parts=4"], ["-Cfit_parts=4"], ["-C", "fit_parts=4"]])
def test_a_users_configuration_may_be_written_as_one_word(tmp_path, written):
    said = asked_of_snakemake(tmp_path, *written, "--quiet", "--config", "campaigns=[1]")
    assert said == ["--quiet", "--dry-run", "--config", "fit_parts=4", "campaigns=[1]"]


def test_what_follows_a_configuration_in_one_word_is_a_target(tmp_path):
    said = asked_of_snakemake(tmp_path, "--config=fit_parts=4", "results/x.png")
    assert said == ["results/x.png", "--dry-run", "--config", "fit_parts=4"]


def test_without_configuration_nothing_is_added(tmp_path):
    assert asked_of_snakemake(tmp_path, "--cores", "2") == ["--cores", "2", "--dry-run"]


def test_no_target_of_the_makefile_is_taken_for_a_users_configuration():
    for target, asked in (("campaign", "campaigned"), ("run", "all")):
        command = ["make", "--dry-run", target, "ARGS=--config a=b"]
        said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        assert 0 < said.index(f"report.html {asked} ") < said.index("--config a=b")


BAD_FILES = {
    "missing": None,
    "folder": None,
    "latin": "description: caf\xe9\n".encode("latin-1"),
    "day": b"description: 2024-02-30\n",
    "digits": b"simulate: {speed: " + b"9" * 5000 + b"}\n",
    "nested": b"run: " + b"[" * 500 + b"]" * 500,
    "twice": b"figures: {magnification: 1}\nfigures: {magnification: 2}\n",
}


@pytest.mark.parametrize("kind", BAD_FILES)
def test_a_configuration_that_cannot_be_read_is_refused_before_snakemake_sees_it(tmp_path, kind):
    file = tmp_path / "mine.yaml"
    if BAD_FILES[kind] is not None:
        file.write_bytes(BAD_FILES[kind])
    elif kind == "folder":
        file.mkdir()
    (tmp_path / "good.yaml").write_text("figures: {magnification: 1}\n")
    done = run_workflow(tmp_path, "--configfile", str(tmp_path / "good.yaml"), str(file), "--cores", "1")
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"jointgap: error: {file}")
    assert not (tmp_path / "asked.txt").exists()


def test_configuration_files_that_can_be_read_go_to_snakemake(tmp_path):
    (tmp_path / "mine.yaml").write_text("figures: {magnification: 1}\n")
    (tmp_path / "more.yaml").write_text("figures: {magnification: 2}\n")
    options = ["--configfile", "mine.yaml", "--cores", "2", "--configfile=more.yaml", "results/x.png"]
    said = asked_of_snakemake(tmp_path, *options)
    assert said == ["--cores", "2", "results/x.png", "--dry-run", "--configfile", "mine.yaml", "more.yaml"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("figures: {magnification: 1}\nfigures: {magnification: 2}\n", "line 2, column 1: the key 'figures' is given"),
        ("simulate: {revolutions: 010}\n", "line 1, column 25: 010 is one thing to some programs"),
    ],
)
def test_snakemake_itself_takes_no_configuration_that_is_wrong_in_silence(tmp_path, text, words):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    for more in ((), ("--snakefile", "workflow/blind/Snakefile")):
        done = run(ROOT, "snakemake", *more, "--configfile", str(file), "--dry-run", "--quiet", "--cores", "1")
        assert done.returncode == 1
        assert f"{file}, {words}" in done.stdout + done.stderr
        assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.parametrize(
    "path",
    [
        "our rig's.yaml",
        'a "b".yaml',
        r"a\b\\c.yaml",
        "a\\",
        "$HOME $(shell touch made) `touch made`; touch made",
        "a=b, c: d #e",
    ],
)
@pytest.mark.parametrize("said_by", ["environment", "make"])
def test_the_path_of_a_campaign_reaches_the_configuration_as_it_is_written(tmp_path, path, said_by):
    from snakemake.cli import parse_config

    shutil.copy(ROOT / "Makefile", tmp_path)
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    stand_in = tmp_path / ".venv" / "bin" / "snakemake"
    stand_in.parent.mkdir(parents=True)
    stand_in.write_text("#!/bin/sh\nprintf '%s\\n' \"$@\" > asked.txt\n")
    stand_in.chmod(0o755)
    given, more = (["CAMPAIGN=" + path], {}) if said_by == "make" else ([], {"CAMPAIGN": path})
    command = ["make", "--old-file=set-up", "campaign", "ARGS=--dry-run", *given]
    subprocess.run(command, cwd=tmp_path, env=os.environ | more, check=True)
    asked = (tmp_path / "asked.txt").read_text().splitlines()
    assert parse_config([one for one in asked if one.startswith("campaigns=")]) == {"campaigns": [path]}
    assert not (tmp_path / "made").exists()


BEFORE_ANY_JOB = f"include: {str(ROOT / 'workflow' / 'rules' / 'before_any_job.smk')!r}\n"


@pytest.fixture
def slow_workflow(tmp_path) -> Path:
    """A folder with a workflow of one job that goes on until there is a file `end`, and notes when it begins, ends."""
    job = "echo begins >> noted; until [ -e end ]; do sleep 0.05; done; echo ends >> noted; touch {output}"
    (tmp_path / "Snakefile").write_text(BEFORE_ANY_JOB + f"rule slow:\n    output: 'report.html'\n    shell: {job!r}\n")
    return tmp_path


def started(folder: Path, *command: str) -> subprocess.Popen:
    """A run in `folder`."""
    return subprocess.Popen(
        [*command, "--cores", "1", "--forceall", "--quiet", "all"],
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def wait_until_it_begins(folder: Path) -> None:
    deadline = time.monotonic() + 60
    while not (folder / "noted").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert (folder / "noted").exists()


BY_MAKE, BY_ITSELF = (str(SCRIPT), "report.html"), ("snakemake",)


@pytest.mark.parametrize("first", [BY_MAKE, BY_ITSELF], ids=["make", "snakemake"])
def test_snakemake_refuses_while_another_run_works_in_the_folder(slow_workflow, first):
    working = started(slow_workflow, *first)
    wait_until_it_begins(slow_workflow)
    refused = started(slow_workflow, "snakemake", "--nolock")
    said = refused.communicate(timeout=60)[0]
    assert refused.returncode == 1 and "error: another run works in this folder" in said
    assert "Traceback" not in said
    assert (slow_workflow / "noted").read_text() == "begins\n"
    (slow_workflow / "end").touch()
    working.communicate(timeout=60)
    assert (slow_workflow / "noted").read_text() == "begins\nends\n"


def test_make_waits_for_the_end_of_a_run_of_snakemake(slow_workflow):
    working = started(slow_workflow, *BY_ITSELF)
    wait_until_it_begins(slow_workflow)
    waiting = started(slow_workflow, *BY_MAKE)
    assert "waiting for the end of another run" in waiting.stdout.readline()
    (slow_workflow / "end").touch()
    working.communicate(timeout=60)
    waiting.communicate(timeout=60)
    assert working.returncode == 0
    assert (slow_workflow / "noted").read_text() == "begins\nends\n" * 2


def test_a_run_that_was_killed_holds_up_no_other(slow_workflow):
    killed = started(slow_workflow, *BY_ITSELF)
    wait_until_it_begins(slow_workflow)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.communicate(timeout=60)
    (slow_workflow / "end").touch()
    again = started(slow_workflow, *BY_MAKE)
    said = again.communicate(timeout=60)[0]
    assert "waiting" not in said and (slow_workflow / "report.html").exists(), said


@pytest.mark.parametrize("address", ["http://127.0.0.1:9", "nowhere://x"])
def test_a_store_that_does_not_answer_ends_a_run_before_its_first_job(tmp_path, address):
    (tmp_path / "Snakefile").write_text(
        BEFORE_ANY_JOB + "rule track:\n    input: 'table'\n    output: 'published'\n    resources: mlflow_store=1\n"
        "    shell: 'touch {output}'\n"
        "rule simulate:\n    output: 'table'\n    resources: mlflow_store=0\n    shell: 'touch {output}'\n"
    )
    asked = {"cwd": tmp_path, "env": environment() | {"MLFLOW_TRACKING_URI": address}, "check": False}
    refused = subprocess.run(["snakemake", "--cores", "1"], capture_output=True, text=True, **asked)
    assert refused.returncode != 0 and "jointgap: error: MLflow store" in refused.stderr
    assert "unset MLFLOW_TRACKING_URI" in refused.stderr and not (tmp_path / "table").exists()
    # who publishes nothing needs no store
    assert subprocess.run(["snakemake", "table", "--cores", "1"], capture_output=True, **asked).returncode == 0
