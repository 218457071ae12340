"""Stages of a campaign from the command line."""

import json
import re
import shutil
from dataclasses import replace

import pandas as pd
import pytest
from click.testing import CliRunner

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.campaign import conclude, figures
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.config.campaign import RESERVED_IDS
from jointgap.core.errors import InputError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import TABLES
from jointgap.effects import EFFECTS
from jointgap.rig import model

DEMONSTRATION = ROOT / "config/campaigns/demonstration.yaml"


def stand_in(monkeypatch, stage, function) -> None:
    monkeypatch.setitem(CAMPAIGN_STAGES, stage, replace(CAMPAIGN_STAGES[stage], function=function))


def run(*command):
    return CliRunner().invoke(cli, [str(word) for word in command], catch_exceptions=False)


@pytest.mark.parametrize("stage", ("fit", "pair"))
def test_a_part_must_be_below_the_number_of_parts(tmp_path, monkeypatch, stage):
    fitted = []
    stand_in(monkeypatch, stage, lambda state, **options: fitted.append(options))
    command = (stage, DEMONSTRATION, "--folder", tmp_path)
    for part, parts in ((5, 2), (2, 2), (1, 1)):
        with pytest.raises(InputError, match=f"--part {part}: must be 0 to {parts - 1}"):
            run(*command, "--part", part, "--parts", parts)
    assert fitted == list(tmp_path.iterdir()) == []
    run(*command, "--part", 1, "--parts", 2)
    assert fitted == [{"part": 1, "parts": 2}]


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
    monkeypatch.setattr(model, "EFFECTS", {name: EFFECTS[name] for name in few})
    complete, again = tmp_path / "complete", tmp_path / "again"
    result = run("analyse", DEMONSTRATION, "--folder", complete)
    assert result.exit_code == 0 and "Coulomb friction of the slider" in result.output
    for page in ("summary.md", "summary.html"):
        assert "Coulomb friction of the slider" in (complete / page).read_text()

    def fails(*arguments, **options):
        raise ValueError("x should be ascending")

    def copies(stage):
        def copied(state, **options):
            for path in CAMPAIGN_STAGES[stage].outputs(part=0):
                (again / path).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(complete / path, again / path)

        return copied

    for stage in ("recalibrate", "fit", "pair"):
        stand_in(monkeypatch, stage, copies(stage))
    stand_in(monkeypatch, "preflight", fails)
    monkeypatch.setattr(conclude, "locate", fails)
    monkeypatch.setattr(conclude, "write_mechanism", fails)
    monkeypatch.setitem(figures.FIGURES, "gaps", replace(figures.FIGURES["gaps"], function=fails))
    result = run("analyse", DEMONSTRATION, "--folder", again)
    assert result.exit_code == 3 and "Coulomb friction of the slider" in result.output
    verdict = json.loads((again / "verdict.json").read_text())
    assert verdict["effects"][0]["name"] == "slider_coulomb_friction"
    assert verdict["failed"].keys() == {"preflight", "locate", "augment", "gaps"}
    for step in verdict["failed"]:
        assert f"failed: {step}: ValueError: x should be ascending" in result.output
    assert "failed: ValueError: x should be ascending" in (again / "summary.md").read_text()
    assert ResultsFolder(again).read("map_bins").empty
    with pytest.raises(ValueError, match="ascending"):
        run("preflight", DEMONSTRATION, "--folder", again)
    run("preflight", DEMONSTRATION, "--folder", again, "--go-on")
    assert ResultsFolder(again).read("detectable").empty


def test_a_required_stage_fails_also_with_go_on(tmp_path, monkeypatch):
    def fails(state, **options):
        raise ValueError("in vain")

    stand_in(monkeypatch, "recalibrate", fails)
    with pytest.raises(ValueError, match="in vain"):
        run("recalibrate", DEMONSTRATION, "--folder", tmp_path, "--go-on")


def test_swapped_columns_stop_an_analysis_unless_anyway_is_given(tmp_path, monkeypatch):
    for file in (DEMONSTRATION.parent / "demonstration").glob("*.csv"):
        table = pd.read_csv(file, comment="#")
        table[["torque_Nm", "acc_g"]] = table[["acc_g", "torque_Nm"]].to_numpy()
        table.to_csv(tmp_path / file.name, index=False)
    text = DEMONSTRATION.read_text().replace("../mechanisms", str(ROOT / "config/mechanisms"))
    (tmp_path / "plan.yaml").write_text(text.replace("demonstration/", ""))

    class Reached(Exception):
        pass

    def fails(model, settings):
        raise Reached

    stand_in(monkeypatch, "preflight", lambda state, **given: None)
    monkeypatch.setattr("jointgap.identification.noise.noise_of_model", fails)
    folder, words = (
        tmp_path / "results",
        r"(?s)continue with --anyway.*torque and slider_acc.* swapped",
    )
    with pytest.raises(InputError, match=words):
        run("analyse", tmp_path / "plan.yaml", "--folder", folder)
    with pytest.raises(Reached):
        run("analyse", tmp_path / "plan.yaml", "--folder", folder, "--anyway")
