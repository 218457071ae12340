"""The script between make and Snakemake, with a stand-in for Snakemake that says what it was asked."""

import os
import subprocess
from pathlib import Path

import pytest

from benchmarks.project import ROOT, run

SCRIPT = Path(__file__).parents[2] / "scripts" / "run-workflow"


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
    return [one for one in (folder / "asked.txt").read_text().splitlines() if one != "--nolock"]


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
    for target, asked in (("study", "studied"), ("campaign", "campaigned")):
        command = ["make", "--dry-run", target, "ARGS=--config a=b"]
        said = subprocess.run(command, cwd=SCRIPT.parents[1], capture_output=True, text=True, check=True).stdout
        assert 0 < said.index(asked) < said.index("--config a=b")


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
    options = ["--cores", "2", "--configfile=mine.yaml", "results/x.png"]
    assert asked_of_snakemake(tmp_path, *options) == [*options, "--dry-run"]


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
