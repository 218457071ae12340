"""Stages of a campaign from the command line."""

import json
import re
from dataclasses import replace

import pandas as pd
import pytest
from click.testing import CliRunner

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.campaign import figures, identify
from jointgap.config.campaign import RESERVED_IDS
from jointgap.core.errors import InputError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import TABLES
from jointgap.effects import EFFECTS
from jointgap.rig import missing_effects

DEMONSTRATION = ROOT / "config/campaigns/demonstration.yaml"


def run(*command):
    return CliRunner().invoke(cli, [str(word) for word in command], catch_exceptions=False)


def test_the_names_of_tables_beside_the_pictures_of_runs_are_reserved():
    matches = (re.fullmatch(r"measure/(\w+)\.parquet", table.path) for table in TABLES.values())
    assert {match[1] for match in matches if match} | {"all"} == set(RESERVED_IDS)


def test_invalid_data_leave_no_folder_of_results(tmp_path):
    (tmp_path / "slow.csv").write_text("time [s],nothing\n0,1\n1,2\n")
    (tmp_path / "plan.yaml").write_text(
        "name: mine\nmechanism: ideal_joints\ndrive: constant_speed\nchannels:\n"
        "  time: {column: t, unit: s}\n  crank_torque: {column: torque, unit: N*m}\n"
        "runs: [{id: slow, file: slow.csv, speed: 90 rpm, role: split}]\n"
    )
    for command in ("measure", "analyse"):
        with pytest.raises(InputError, match="no column"):
            run(command, tmp_path / "plan.yaml", "--folder", tmp_path / "results")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.yaml", "slow.csv"]


@pytest.mark.integration
def test_an_analysis_ends_with_its_verdict_although_optional_steps_fail(tmp_path, monkeypatch):
    few = ("slider_coulomb_friction", "slider_viscous_friction")
    effects = {name: EFFECTS[name] for name in few}
    monkeypatch.setattr(missing_effects, "effects_of", lambda sites: effects)
    complete, again = tmp_path / "complete", tmp_path / "again"
    explain, identified = identify.explain, []

    def recorded(state):
        identified.append(explain(state))
        return identified[0]

    monkeypatch.setattr(identify, "explain", recorded)
    result = run("analyse", DEMONSTRATION, "--folder", complete)
    assert result.exit_code == 0 and "Coulomb friction of the slider" in result.output
    for page in ("summary.md", "summary.html"):
        assert "Coulomb friction of the slider" in (complete / page).read_text()

    def fails(*arguments, **options):
        raise ValueError("x should be ascending")

    monkeypatch.setattr(identify, "explain", lambda state: identified[0])
    monkeypatch.setattr(identify, "write_detectability", fails)
    monkeypatch.setattr(identify, "locate", fails)
    monkeypatch.setattr(identify, "write_mechanism", fails)
    monkeypatch.setitem(figures.FIGURES, "gaps", replace(figures.FIGURES["gaps"], function=fails))
    result = run("analyse", DEMONSTRATION, "--folder", again)
    assert result.exit_code == 3 and "Coulomb friction of the slider" in result.output
    verdict = json.loads((again / "verdict.json").read_text())
    assert verdict["effects"][0]["name"] == "slider_coulomb_friction"
    assert verdict["failed"].keys() == {"detectability", "locate", "augment"}
    for step in (*verdict["failed"], "gaps"):
        assert f"failed: {step}: ValueError: x should be ascending" in result.output
    assert "failed: ValueError: x should be ascending" in (again / "summary.md").read_text()
    assert ResultsFolder(again).read("map_bins").empty
    assert ResultsFolder(again).read("detectable").empty
    assert run("show", DEMONSTRATION, "--folder", again).exit_code == 3
    assert run("show", DEMONSTRATION, "--folder", again, "--go-on").exit_code == 0


def test_a_required_step_fails_also_with_go_on(tmp_path, monkeypatch):
    def fails(state):
        raise ValueError("in vain")

    run("measure", DEMONSTRATION, "--folder", tmp_path)
    monkeypatch.setattr(identify, "explain", fails)
    with pytest.raises(ValueError, match="in vain"):
        run("identify", DEMONSTRATION, "--folder", tmp_path, "--go-on")


def test_swapped_columns_stop_an_analysis_unless_anyway_is_given(tmp_path, monkeypatch):
    for file in (DEMONSTRATION.parent / "demonstration").glob("*.csv"):
        table = pd.read_csv(file, comment="#")
        table[["torque_Nm", "acc_g"]] = table[["acc_g", "torque_Nm"]].to_numpy()
        table.to_csv(tmp_path / file.name, index=False)
    text = DEMONSTRATION.read_text().replace("../mechanisms", str(ROOT / "config/mechanisms"))
    (tmp_path / "plan.yaml").write_text(text.replace("demonstration/", ""))

    class Reached(Exception):
        pass

    def fails(state):
        raise Reached

    monkeypatch.setattr(identify, "explain", fails)
    folder, words = (
        tmp_path / "results",
        r"(?s)continue with --anyway.*torque and slider_acc.* swapped",
    )
    with pytest.raises(InputError, match=words):
        run("analyse", tmp_path / "plan.yaml", "--folder", folder)
    with pytest.raises(Reached):
        run("analyse", tmp_path / "plan.yaml", "--folder", folder, "--anyway")
