"""Stages of a campaign from the command line: what cannot be meant is refused before anything is computed."""

import json
import re
from dataclasses import replace

import pandas as pd
import pytest
from click.testing import CliRunner

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.campaign import figures
from jointgap.campaign.stages import CAMPAIGN_STAGES, measure
from jointgap.campaign.state import CampaignState
from jointgap.config.campaign import RESERVED_IDS
from jointgap.core.errors import InputError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import TABLES
from jointgap.effects import EFFECTS
from jointgap.rig import model

DEMONSTRATION = ROOT / "config/campaigns/demonstration.yaml"


def stand_in(monkeypatch, stage, function) -> None:
    monkeypatch.setitem(CAMPAIGN_STAGES, stage, replace(CAMPAIGN_STAGES[stage], function=function))


def asked(*command) -> None:
    CliRunner().invoke(cli, [str(one) for one in command], catch_exceptions=False)


@pytest.mark.parametrize("stage", ["fit", "pair"])
@pytest.mark.parametrize(("part", "parts"), [(5, 2), (2, 2), (1, 1)])
def test_a_part_that_nobody_would_read_is_refused(tmp_path, monkeypatch, stage, part, parts):
    stand_in(monkeypatch, stage, lambda state, **given: pytest.fail("computed in vain"))
    with pytest.raises(InputError, match=f"--part {part}: .*give {parts - 1} at most, or more --parts"):
        asked(stage, DEMONSTRATION, "--folder", tmp_path, "--part", part, "--parts", parts)
    assert list(tmp_path.iterdir()) == []


def test_every_part_there_is_can_be_fitted(tmp_path, monkeypatch):
    fitted = []
    stand_in(monkeypatch, "fit", lambda state, **given: fitted.append(given))
    for part in (0, 1):
        asked("fit", DEMONSTRATION, "--folder", tmp_path, "--part", part, "--parts", 2)
    assert fitted == [{"part": 0, "parts": 2}, {"part": 1, "parts": 2}]


def test_tables_beside_the_pictures_of_the_runs_have_names_that_no_run_may_have():
    beside = {re.fullmatch(r"measure/(\w+)\.parquet", table.path) for table in TABLES.values()} - {None}
    assert {found[1] for found in beside} | {"all"} == set(RESERVED_IDS)


@pytest.mark.parametrize("command", ["measure", "analyse"])
def test_data_that_are_refused_leave_no_folder_of_results(tmp_path, command):
    (tmp_path / "slow.csv").write_text("time [s],nothing\n0,1\n1,2\n")
    (tmp_path / "plan.yaml").write_text(
        "name: mine\nmechanism: ideal_joints\ndrive: constant_speed\nchannels:\n"
        "  time: {column: t, unit: s}\n  crank_torque: {column: torque, unit: N*m}\n"
        "runs: [{id: slow, file: slow.csv, speed: 90 rpm, role: split}]\n"
    )
    with pytest.raises(InputError, match="no column"):
        asked(command, tmp_path / "plan.yaml", "--folder", tmp_path / "results")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.yaml", "slow.csv"]


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """The demonstration in a folder of its own, with the data read."""
    folder = tmp_path_factory.mktemp("measured")
    text = DEMONSTRATION.read_text().replace("../mechanisms", str(ROOT / "config/mechanisms"))
    (folder / "plan.yaml").write_text(
        text.replace("name: demonstration", f"name: demonstration\nfolder: '{DEMONSTRATION.parent}'")
    )
    measure(CampaignState(folder / "plan.yaml", folder / "results"), pictures=False)
    return folder


@pytest.mark.parametrize(
    ("line", "more", "words"),
    [
        (
            "  crank_torque:",
            "  slider_velocity: {column: v, unit: m/s}\n",
            'channels.slider_velocity.column: absent then, "v" now',
        ),
        (
            "  - {id: fast,",
            "  - {id: other, file: demonstration/other.csv, speed: 90 rpm, role: identify}\n",
            'runs.other.file: absent then, "demonstration/other.csv" now',
        ),
    ],
)
def test_a_stage_after_a_change_of_the_file_says_which_key_and_to_measure_again(measured, line, more, words):
    changed = measured / "changed.yaml"
    changed.write_text((measured / "plan.yaml").read_text().replace(line, more + line))
    with pytest.raises(InputError, match="run `jointgap measure` on it again") as caught:
        asked("noise", changed, "--folder", measured / "results")
    assert words in str(caught.value)


def test_a_whole_analysis_ends_with_its_verdict_in_words_and_on_a_page(tmp_path, monkeypatch):
    # which effects it is told from is the subject of other tests
    few = ("slider_coulomb_friction", "slider_viscous_friction")
    monkeypatch.setattr(model, "EFFECTS", {name: EFFECTS[name] for name in few})
    campaign = str(ROOT / "config/campaigns/demonstration.yaml")
    ran = CliRunner().invoke(cli, ["analyse", campaign, "--folder", str(tmp_path)], catch_exceptions=False)
    assert ran.exit_code == 0 and "Coulomb friction of the slider" in ran.output
    for page in ("summary.md", "summary.html"):
        assert "Coulomb friction of the slider" in (tmp_path / page).read_text()


def test_what_fails_beside_the_verdict_does_not_cost_it_and_is_told(tmp_path, monkeypatch):
    def fails(*given, **options):
        raise ValueError("x should be ascending")

    few = ("slider_coulomb_friction", "slider_viscous_friction")
    monkeypatch.setattr(model, "EFFECTS", {name: EFFECTS[name] for name in few})
    for stage in ("preflight", "locate", "augment"):
        stand_in(monkeypatch, stage, fails)
    broken = replace(figures.FIGURES["gaps"], function=fails)
    monkeypatch.setitem(figures.FIGURES, "gaps", broken)
    ran = CliRunner().invoke(cli, ["analyse", str(DEMONSTRATION), "--folder", str(tmp_path)], catch_exceptions=False)
    assert ran.exit_code == 3 and "Coulomb friction of the slider" in ran.output
    told = json.loads((tmp_path / "verdict.json").read_text())
    assert told["verdict"] == "named" and told["effects"][0]["name"] == "slider_coulomb_friction"
    assert told["failed"].keys() == {"preflight", "locate", "augment", "gaps"}
    for what in told["failed"]:
        assert f"failed: {what}: ValueError: x should be ascending" in ran.output
    assert "could not be made: ValueError: x should be ascending" in (tmp_path / "summary.md").read_text()
    with pytest.raises(ValueError, match="ascending"):
        asked("locate", DEMONSTRATION, "--folder", tmp_path)
    asked("locate", DEMONSTRATION, "--folder", tmp_path, "--go-on")
    assert ResultsFolder(tmp_path).read("map_bins").empty


def test_a_stage_that_a_verdict_is_made_from_fails_though_it_is_asked_to_go_on(tmp_path, monkeypatch):
    def fails(state, **given):
        raise ValueError("in vain")

    stand_in(monkeypatch, "decide", fails)
    with pytest.raises(ValueError, match="in vain"):
        asked("decide", DEMONSTRATION, "--folder", tmp_path, "--go-on")


@pytest.fixture
def swapped_columns(tmp_path):
    """The demonstration with the columns of torque and acceleration exchanged in all files."""
    for file in (DEMONSTRATION.parent / "demonstration").glob("*.csv"):
        table = pd.read_csv(file, comment="#")
        torque, acceleration = "torque_Nm", "acc_g"
        table[[torque, acceleration]] = table[[acceleration, torque]].to_numpy()
        table.to_csv(tmp_path / file.name, index=False)
    text = DEMONSTRATION.read_text().replace("../mechanisms", str(ROOT / "config/mechanisms"))
    (tmp_path / "plan.yaml").write_text(text.replace("demonstration/", ""))
    return tmp_path / "plan.yaml"


def test_an_analysis_of_swapped_columns_stops_after_reading_them_unless_it_is_asked_to_go_on(
    swapped_columns, monkeypatch
):
    class Reached(Exception):
        pass

    def recalibrate(state):
        raise Reached

    stand_in(monkeypatch, "preflight", lambda state, **given: None)
    stand_in(monkeypatch, "recalibrate", recalibrate)
    folder = swapped_columns.parent / "results"
    for command in ("analyse", "noise"):
        with pytest.raises(InputError, match=r"(?s)go on all the same: --anyway.*torque and slider_acc.* swapped"):
            asked(command, swapped_columns, "--folder", folder)
    assert not [*(folder / "noise").glob("*.parquet")]
    with pytest.raises(Reached):
        asked("analyse", swapped_columns, "--folder", folder, "--anyway")
    assert [*(folder / "noise").glob("*.parquet")]
