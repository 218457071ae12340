"""Campaigns on files, and the demonstrations from their CSV files to their verdicts."""

import json
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from unittest.mock import patch

import pytest
import yaml
from click.testing import CliRunner
from jsonschema import validate

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.campaign import plan as preflight
from jointgap.campaign.analyse import analyse
from jointgap.campaign.campaign_files import MECHANISM, SUMMARIES, VERDICT, campaigns
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.stages import CAMPAIGN_STAGES, measure
from jointgap.campaign.state import CampaignState
from jointgap.config import load_mechanism
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.parquet import describe
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.rig.model import build_model

DEMONSTRATION = "config/campaigns/demonstration.yaml"
SCHEMA = ROOT / "workflow/schemas/verdict.schema.json"


def written(file: Path, **keys) -> Path:
    """The demonstration's campaign file with other keys, whose data lie where they are unless it
    says otherwise."""
    content = yaml.safe_load((ROOT / DEMONSTRATION).read_text())
    mechanism = str(ROOT / "config/mechanisms/ideal_joints.yaml")
    content |= {"folder": str((ROOT / DEMONSTRATION).parent), "mechanism": mechanism} | keys
    file.parent.mkdir(parents=True, exist_ok=True)
    given = {key: value for key, value in content.items() if value is not None}
    file.write_text(yaml.safe_dump(given, sort_keys=False))
    return file


def asked(*command) -> None:
    with patch("jointgap.core.plot.Drawing.save"):
        CliRunner().invoke(cli, [str(word) for word in command], catch_exceptions=False)


def stand_in(monkeypatch, function, *stages) -> None:
    for name in stages:
        monkeypatch.setitem(
            CAMPAIGN_STAGES, name, replace(CAMPAIGN_STAGES[name], function=function(name))
        )


def test_a_campaign_has_plan_and_data_files():
    found = campaigns([DEMONSTRATION], (ROOT,))
    names = {
        "plan": ["demonstration.yaml", "ideal_joints.yaml"],
        "data": ["slow.csv", "mid.csv", "fast.csv"],
    }
    for kind, files in names.items():
        assert [Path(place).name for place in getattr(found["demonstration"], kind)] == files


@pytest.mark.parametrize(
    "paths, message",
    [
        ("mine.yaml", "must be a list"),
        (["mine.yaml"], r"no file 'mine.yaml' \(looked in "),
        (["config/campaigns"], "no file 'config/campaigns'.*; give the path of a campaign file"),
        ([DEMONSTRATION, DEMONSTRATION], "same name 'demonstration'"),
    ],
)
def test_an_invalid_list_of_campaigns_is_refused_with_the_fix(paths, message):
    with pytest.raises(InputError, match=message):
        campaigns(paths, (ROOT,))


def test_missing_data_and_braces_in_paths_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # whatever the results of an earlier run are
    lost = written(tmp_path / "lost.yaml", folder=None)
    with pytest.raises(InputError, match=r"run slow: no file 'demonstration/slow.csv'.*`file`"):
        campaigns([str(lost)], (ROOT,))
    braces = written(tmp_path / "rig {campaign}/mine.yaml")
    with pytest.raises(InputError, match=r"rig {campaign}/mine.yaml contains braces.*rename"):
        campaigns([str(braces)], (ROOT,))
    for folder in ("our rig's", 'a "b"', "a { b"):
        mine = written(tmp_path / folder / "mine.yaml")
        assert campaigns([str(mine)], (ROOT,))["demonstration"].campaign == str(mine)


def test_settings_of_an_analysis_reach_its_stages(tmp_path, monkeypatch):
    given = replace(
        DEFAULT_SETTINGS, decision=replace(DEFAULT_SETTINGS.decision, min_delta_bic=20.0)
    )

    def ends(state, **options):
        raise InputError(str(state.settings.decision.min_delta_bic))

    stand_in(monkeypatch, lambda name: ends, "measure")
    with pytest.raises(InputError, match=r"^20\.0$"):
        analyse(ROOT / DEMONSTRATION, tmp_path, settings=given)


def test_input_files_are_never_overwritten(tmp_path, monkeypatch):
    content = (ROOT / "config/mechanisms/ideal_joints.yaml").read_text()
    results = tmp_path / "results/campaigns/demonstration"
    for place in (tmp_path, results):
        written(place / "mine.yaml", mechanism="mechanism.yaml")
        (place / "mechanism.yaml").write_text(content)
    with pytest.raises(
        InputError, match=r"mechanism\.yaml: is an input of the campaign .* give another --folder"
    ):
        asked("identify", tmp_path / "mine.yaml", "--folder", tmp_path)
    assert (tmp_path / "mechanism.yaml").read_text() == content
    monkeypatch.chdir(tmp_path)  # by default the folder of results alone is kept free
    assert CampaignState(tmp_path / "mine.yaml").folder.path == Path(
        "results/campaigns/demonstration"
    )
    with pytest.raises(InputError, match="is an input of the campaign"):
        CampaignState(results / "mine.yaml")


def test_a_preflight_counts_the_samples_and_revolutions_that_there_are(tmp_path):
    runs = yaml.safe_load((ROOT / DEMONSTRATION).read_text())["runs"]
    runs[1]["role"] = "split"
    for name, rows in (("slow", 360), ("mid", 200)):
        text = (ROOT / f"config/campaigns/demonstration/{name}.csv").read_text()
        lines = text.splitlines()[: rows + 1]
        (tmp_path / "demonstration").mkdir(exist_ok=True)
        (tmp_path / f"demonstration/{name}.csv").write_text("\n".join(lines))
    campaign = load_campaign(written(tmp_path / "mine.yaml", folder=None, runs=runs))
    _, recordings = preflight.recorded(campaign)
    assert set(recordings) == {"slow", "mid"}  # of the third run there is no file yet
    turns = preflight.revolutions(campaign, recordings)
    assert turns["slow"] == pytest.approx(360 * 4.1237e-3 * 150 / 60, rel=0.01)
    counts = preflight.counts(build_model(campaign), recordings)
    assert counts["slow", "crank_torque"] == counts["slow", "crank_angle"] == 360
    assert counts["mid", "crank_torque"] == pytest.approx(
        200 * 2 / 3, abs=1
    )  # the last third is held out
    assert (
        counts["mid", "slider_acceleration"] == counts["mid", "crank_torque"] - 10
    )  # cells of which are empty
    assert ("fast", "crank_torque") not in counts


@pytest.mark.slow
def test_the_demonstration_names_what_its_data_hide(tmp_path):
    found = analyse(ROOT / DEMONSTRATION, tmp_path)
    (effect,) = found["effects"]
    assert (found["verdict"], effect["name"]) == ("named", "slider_coulomb_friction")
    assert effect["parameters"]["force_N"]["value"] == pytest.approx(6.0, rel=0.03)
    assert found["gap"]["confirm"]["after"] == pytest.approx(1.0, abs=0.1)
    validate(json.loads((tmp_path / "verdict.json").read_text()), json.loads(SCHEMA.read_text()))
    augmented = load_mechanism(tmp_path / "mechanism.yaml")
    assert [one.name for one in augmented.effects] == ["slider_coulomb_friction"]
    for path in tmp_path.rglob("*.parquet"):
        assert (describe(path)["description"] != "").all(), path


@pytest.mark.slow
def test_the_demonstration_of_a_loose_joint_names_it_and_holds_its_clearance(tmp_path):
    found = analyse(ROOT / "config/campaigns/demonstration_clearance.yaml", tmp_path)
    (effect,) = found["effects"]
    # a fit to non-periodic samples may be good by chance; the held-out ones then have a misfit
    assert found["verdict"] in ("named", "named_with_remaining_misfit")
    assert effect["name"] == "crank_pin_clearance"
    assert found["basis"] == "statistics"
    assert found["held_out_test"] == "falls"
    low, high = effect["parameters"]["clearance_m"]["interval_90"]
    assert low <= 5e-4 <= high < 1.3 * low
    validate(json.loads((tmp_path / "verdict.json").read_text()), json.loads(SCHEMA.read_text()))


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A results folder in which the data of the demonstration have been read."""
    folder = tmp_path_factory.mktemp("measured")
    case = CampaignState(written(folder / "plan.yaml"), folder / "results")
    measure(case, pictures=False)
    return folder


ACCELERATION = "  slider_acceleration: {column: acc_g, unit: g_n}\n"
MID = "  - {id: mid,  file: demonstration/mid.csv,  speed: 280 rpm, role: identify}\n"
CHANGES = [
    (ACCELERATION, "", 'channels.slider_acceleration.column: "acc_g" then, absent now'),
    (
        "  crank_torque:",
        "  slider_velocity: {column: v, unit: m/s}\n  crank_torque:",
        'column: absent then, "v" now',
    ),
    (MID, "", 'runs.mid.file: "demonstration/mid.csv" then, absent now'),
    ("g_n}", "m/s^2}", 'channels.slider_acceleration.unit: "g_n" then, "m/s^2" now'),
    ("role: identify", "role: split", 'runs.slow.role: "identify" then, "split" now'),
    ("noise: 0.1}", "noise: {slow: 0.1}}", "channels.crank_angle.noise: 0.1 then, absent now"),
    ("slider_mass: 5 %, ", "", "nuisance.slider_mass: 0.05 then, absent now"),
    ("/ideal_joints.yaml", "/erkaya2009.yaml", "mechanism."),
]


@pytest.fixture
def changed(measured):
    """Measurements after a change of the campaign file's text."""
    folder, file = measured, ROOT / DEMONSTRATION
    text = file.read_text().replace("../mechanisms", str(ROOT / "config/mechanisms"))
    text += f"folder: '{file.parent}'\n"

    def change(old, new):
        assert old in text
        (folder / "changed.yaml").write_text(text.replace(old, new, 1))
        return CampaignState(folder / "changed.yaml", folder / "results").measurements

    change.text = text
    return change


@pytest.mark.parametrize("old, new, message", CHANGES)
def test_a_change_of_the_file_after_its_data_were_read_is_refused(changed, old, new, message):
    with pytest.raises(InputError) as error:
        changed(old, new)
    assert message in str(error.value)
    assert "repeat `jointgap measure` and the later stages" in str(error.value)


def test_another_order_of_the_runs_or_another_name_is_no_change(changed):
    reordered = changed.text.replace(MID, "").replace("runs:\n", f"runs:\n{MID}")
    assert list(changed(changed.text, reordered).runs) == ["slow", "mid", "fast"]  # by speed
    renamed = changed("name: demonstration", "name: another # of the same rig")
    assert set(renamed.runs) == {"slow", "mid", "fast"}


@pytest.fixture
def used_before(tmp_path):
    """A results folder with an earlier conclusion and with a file of the user."""
    names = [VERDICT, MECHANISM, *SUMMARIES, "costs.jsonl", "identify/campaign_optimum.parquet"]
    names += ["identify/missing_force.parquet", "figures/mine.png"]
    names += [f"figures/{name}.png" for name in FIGURES]
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("of another day")
    return tmp_path


def test_results_of_another_campaign_file_are_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, moved = written(tmp_path / "a/plan.yaml"), tmp_path / "moved/plan.yaml"
    results = Path("results/campaigns/demonstration")
    asked("measure", first)
    (results / "verdict.json").write_text("of the first file")
    second = written(tmp_path / "b/plan.yaml", date="2026-01-05")
    damaged = written(tmp_path / "damaged.yaml")
    damaged.write_text(
        damaged.read_text().replace("unit: ms", "unit: s").replace("t_ms", "no_such_column")
    )
    commands = [partial(asked, name) for name in ("measure", "analyse")]
    commands += [
        lambda file: analyse(file, results),
        lambda file: campaigns([str(file)], (tmp_path,)),
    ]
    message = f"{results} contains the results of another file, {first}.*give this.*delete"
    for command, file in product(commands, (second, damaged)):
        with pytest.raises(InputError, match=message):
            command(file)
    assert (results / "verdict.json").read_text() == "of the first file"

    def reached(state, **options):
        raise InputError("reached")

    # the same file by another path, changed, in a folder that was moved, or in another folder of
    # results is no other
    (tmp_path / "link.yaml").symlink_to(first)
    asked("measure", "link.yaml")
    first.write_text(first.read_text() + "# changed\n")
    asked("measure", "a/../a/plan.yaml")
    first.parent.rename(moved.parent)
    asked("measure", moved)
    written(moved, date="2026-01-06")
    assert campaigns([str(moved)], (tmp_path,))
    stand_in(monkeypatch, lambda name: reached, "measure")
    with pytest.raises(InputError, match=r"^reached$"):
        analyse(moved, results)
    with pytest.raises(InputError, match=r"^reached$"):
        analyse(second, tmp_path / "elsewhere")


def test_results_that_moved_with_their_campaign_file_are_still_of_it(tmp_path, monkeypatch):
    file = written(tmp_path / "here/plan.yaml")
    asked("measure", file, "--folder", tmp_path / "here/results")
    (tmp_path / "here").rename(tmp_path / "there")
    written(tmp_path / "there/plan.yaml", date="2026-01-05")
    asked("measure", tmp_path / "there/plan.yaml", "--folder", tmp_path / "there/results")


def test_a_failed_analysis_leaves_no_older_conclusion(used_before, monkeypatch):
    (used_before / "measure").write_text("a file where a folder should be")
    with pytest.raises(InputError, match="cannot be written"):
        analyse(ROOT / DEMONSTRATION, used_before)
    assert (used_before / "verdict.json").read_text() == "of another day"
    (used_before / "measure").unlink()

    def fails(case, **given):
        raise SimulationError("the slide flies off")

    stand_in(monkeypatch, lambda name: fails, "measure")
    with pytest.raises(SimulationError):
        analyse(ROOT / DEMONSTRATION, used_before)
    left = sorted(
        str(path.relative_to(used_before)) for path in used_before.rglob("*") if path.is_file()
    )
    assert left == ["figures/mine.png", "identify/missing_force.parquet"]
