"""Stages of a campaign from the command line: what cannot be meant is refused before anything is
computed."""

import json
import re
import shutil
from dataclasses import replace

import pandas as pd
import pytest
from click.testing import CliRunner

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.campaign import figures
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.config.campaign import RESERVED_IDS
from jointgap.core.errors import InputError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import TABLES
from jointgap.effects import EFFECTS
from jointgap.rig import model
from tests.catalogue import refused

DEMONSTRATION = ROOT / "config/campaigns/demonstration.yaml"


def stand_in(monkeypatch, stage, function) -> None:
    monkeypatch.setitem(CAMPAIGN_STAGES, stage, replace(CAMPAIGN_STAGES[stage], function=function))


def asked(*command):
    return CliRunner().invoke(cli, [str(one) for one in command], catch_exceptions=False)


def test_a_part_that_nobody_would_read_is_refused_and_every_one_there_is_can_be_fitted(
    tmp_path, monkeypatch
):
    fitted = []
    for stage in ("fit", "pair"):
        stand_in(monkeypatch, stage, lambda state, **given: fitted.append(given))
    words = "--part {}: must be 0 to {}"
    cases = [(5, 2, words.format(5, 1)), (2, 2, words.format(2, 1)), (1, 1, words.format(1, 0))]
    for stage in ("fit", "pair"):
        command = (stage, DEMONSTRATION, "--folder", tmp_path, "--part")
        refused(lambda part, parts: asked(*command, part, "--parts", parts), cases)  # noqa: B023
    assert fitted == list(tmp_path.iterdir()) == []
    for part in (0, 1):
        asked("fit", DEMONSTRATION, "--folder", tmp_path, "--part", part, "--parts", 2)
    assert fitted == [{"part": 0, "parts": 2}, {"part": 1, "parts": 2}]


def test_tables_beside_the_pictures_of_the_runs_have_names_that_no_run_may_have():
    beside = {re.fullmatch(r"measure/(\w+)\.parquet", table.path) for table in TABLES.values()} - {
        None
    }
    assert {found[1] for found in beside} | {"all"} == set(RESERVED_IDS)


def test_data_that_are_refused_leave_no_folder_of_results(tmp_path):
    (tmp_path / "slow.csv").write_text("time [s],nothing\n0,1\n1,2\n")
    (tmp_path / "plan.yaml").write_text(
        "name: mine\nmechanism: ideal_joints\ndrive: constant_speed\nchannels:\n"
        "  time: {column: t, unit: s}\n  crank_torque: {column: torque, unit: N*m}\n"
        "runs: [{id: slow, file: slow.csv, speed: 90 rpm, role: split}]\n"
    )
    for command in ("measure", "analyse"):
        with pytest.raises(InputError, match="no column"):
            asked(command, tmp_path / "plan.yaml", "--folder", tmp_path / "results")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.yaml", "slow.csv"]


@pytest.mark.integration
def test_a_whole_analysis_ends_with_its_verdict_and_what_fails_beside_it_does_not_cost_it(
    tmp_path, monkeypatch
):
    # which effects it is told from is the subject of other tests
    few = ("slider_coulomb_friction", "slider_viscous_friction")
    monkeypatch.setattr(model, "EFFECTS", {name: EFFECTS[name] for name in few})
    whole, again = tmp_path / "whole", tmp_path / "again"
    ran = asked("analyse", DEMONSTRATION, "--folder", whole)
    assert ran.exit_code == 0 and "Coulomb friction of the slider" in ran.output
    for page in ("summary.md", "summary.html"):
        assert "Coulomb friction of the slider" in (whole / page).read_text()

    def fails(*given, **options):
        raise ValueError("x should be ascending")

    def copies(stage):
        def copied(state, **options):
            for place in CAMPAIGN_STAGES[stage].outputs():
                if (whole / place).exists():
                    (again / place).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy(whole / place, again / place)

        return copied

    for stage in (
        "recalibrate",
        "screen",
        "fit",
        "pair",
    ):  # what they compute is there already
        stand_in(monkeypatch, stage, copies(stage))
    for stage in ("preflight", "locate", "augment"):
        stand_in(monkeypatch, stage, fails)
    monkeypatch.setitem(figures.FIGURES, "gaps", replace(figures.FIGURES["gaps"], function=fails))
    ran = asked("analyse", DEMONSTRATION, "--folder", again)
    assert ran.exit_code == 3 and "Coulomb friction of the slider" in ran.output
    told = json.loads((again / "verdict.json").read_text())
    assert told["verdict"] == "named" and told["effects"][0]["name"] == "slider_coulomb_friction"
    assert told["failed"].keys() == {"preflight", "locate", "augment", "gaps"}
    for what in told["failed"]:
        assert f"failed: {what}: ValueError: x should be ascending" in ran.output
    assert "failed: ValueError: x should be ascending" in (again / "summary.md").read_text()
    with pytest.raises(ValueError, match="ascending"):
        asked("locate", DEMONSTRATION, "--folder", again)
    asked("locate", DEMONSTRATION, "--folder", again, "--go-on")
    assert ResultsFolder(again).read("map_bins").empty


def test_a_stage_that_a_verdict_is_made_from_fails_though_it_is_asked_to_go_on(
    tmp_path, monkeypatch
):
    def fails(state, **given):
        raise ValueError("in vain")

    stand_in(monkeypatch, "decide", fails)
    with pytest.raises(ValueError, match="in vain"):
        asked("decide", DEMONSTRATION, "--folder", tmp_path, "--go-on")


def test_an_analysis_of_swapped_columns_stops_after_reading_them_unless_it_is_asked_to_go_on(
    tmp_path, monkeypatch
):
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
        asked("analyse", tmp_path / "plan.yaml", "--folder", folder)
    with pytest.raises(Reached):
        asked("analyse", tmp_path / "plan.yaml", "--folder", folder, "--anyway")
