"""The script between make and Snakemake, with a stand-in for Snakemake that says what it was asked."""

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "run-workflow"


def asked_of_snakemake(folder, *options: str) -> list[str]:
    stand_in = folder / "bin" / "snakemake"
    stand_in.parent.mkdir()
    stand_in.write_text("#!/bin/sh\nprintf '%s\\n' \"$@\" >> asked.txt\n")
    stand_in.chmod(0o755)
    environment = {"PATH": f"{stand_in.parent}:{os.environ['PATH']}"}
    subprocess.run([SCRIPT, "report.html", "--nolock", *options, "--dry-run"], cwd=folder, env=environment, check=True)
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
