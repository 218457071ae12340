"""Campaigns on files: what a configuration asks for, and the demonstration from its CSV to its verdict."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from jsonschema import validate

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.campaign import plan as preflight
from jointgap.campaign.campaign_files import campaigns
from jointgap.campaign.stages import CAMPAIGN_STAGES, measure, noise
from jointgap.campaign.state import CampaignState
from jointgap.config import load_mechanism
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.core.parquet import describe
from jointgap.rig.model import build_model

DEMONSTRATION = "config/campaigns/demonstration.yaml"


def test_the_files_of_a_campaign_are_its_plan_and_its_data():
    found = campaigns([DEMONSTRATION], (ROOT,))["demonstration"]
    assert [place.rsplit("/", 1)[1] for place in found.plan] == ["demonstration.yaml", "ideal_joints.yaml"]
    assert [place.rsplit("/", 1)[1] for place in found.data] == ["slow.csv", "mid.csv", "fast.csv"]


def test_only_fits_of_loose_joints_are_worth_a_second_process(tmp_path):
    text = (ROOT / DEMONSTRATION).read_text()
    loose = text.replace("../mechanisms/ideal_joints.yaml", str(ROOT / "config/mechanisms/erkaya2009.yaml"))
    loose = loose.replace("name: demonstration", f"name: loose\nfolder: '{ROOT / 'config/campaigns'}'")
    (tmp_path / "loose.yaml").write_text(loose)
    found = campaigns([DEMONSTRATION, "loose.yaml"], (ROOT, tmp_path))
    assert {name: files.parts for name, files in found.items()} == {"demonstration": 1, "loose": 2}
    assert {files.parts for files in campaigns([DEMONSTRATION, "loose.yaml"], (ROOT, tmp_path), 5).values()} == {5}


@pytest.mark.parametrize("parts", [0, "many", 2.5, True, 10**9])
def test_a_number_of_parts_that_is_none_is_refused(parts):
    with pytest.raises(InputError, match=r"fit_parts = .* must be a whole number of jobs from 1 to 100"):
        campaigns([DEMONSTRATION], (ROOT,), parts)


def test_stages_follow_each_other_in_one_process_on_the_same_case(tmp_path, monkeypatch):
    passed = []

    def pass_by(name):
        return lambda state, **given: passed.append((name, id(state), given))

    for name in ("decide", "regress", "confirm"):
        monkeypatch.setitem(CAMPAIGN_STAGES, name, replace(CAMPAIGN_STAGES[name], function=pass_by(name)))
    command = ["decide", str(ROOT / DEMONSTRATION), "--folder", str(tmp_path), "--parts", "2"]
    CliRunner().invoke(cli, [*command, "--then", "regress", "--then", "confirm"], catch_exceptions=False)
    names, cases, given = zip(*passed, strict=True)
    assert names == ("decide", "regress", "confirm")
    assert len(set(cases)) == 1
    assert given == ({"parts": 2}, {}, {})


@pytest.mark.parametrize(
    ("paths", "message"),
    [
        ("mine.yaml", "must be a list"),
        (["mine.yaml"], r"no file 'mine.yaml' \(looked in "),
        (["config/campaigns"], "no file 'config/campaigns' .*; give the path of a campaign file"),
        ([DEMONSTRATION, DEMONSTRATION], "both called 'demonstration'"),
    ],
)
def test_what_cannot_be_a_list_of_campaigns_is_refused_with_the_mend(paths, message):
    with pytest.raises(InputError, match=message):
        campaigns(paths, (ROOT,))


def test_a_run_whose_file_is_not_there_is_named_before_anything_runs(tmp_path):
    plan = (ROOT / DEMONSTRATION).read_text().replace("../mechanisms", str(ROOT / "config/mechanisms"))
    (tmp_path / "mine.yaml").write_text(plan)
    with pytest.raises(InputError, match=r"run slow: no file 'demonstration/slow\.csv' in .*; correct `file`"):
        campaigns(["mine.yaml"], (tmp_path,))


@pytest.mark.parametrize("folder", ["our rig's", 'a "b"', "a { b"])
def test_a_campaign_may_lie_in_any_folder(tmp_path, folder):
    mine = _copied(tmp_path / folder)
    assert campaigns([str(mine)], (ROOT,))["demonstration"].campaign == str(mine)


def test_a_path_that_snakemake_takes_for_a_pattern_is_refused(tmp_path):
    mine = _copied(tmp_path / "rig {campaign}")
    with pytest.raises(InputError, match=r"mine\.yaml: the path .*rig \{campaign\}/mine\.yaml holds braces.*rename"):
        campaigns([str(mine)], (ROOT,))


def _copied(folder: Path) -> Path:
    """The demonstration's campaign file, with its data beside it, in `folder`."""
    shutil.copytree((ROOT / DEMONSTRATION).with_suffix(""), folder / "demonstration")
    plan = (ROOT / DEMONSTRATION).read_text().replace("../mechanisms", str(ROOT / "config/mechanisms"))
    (folder / "mine.yaml").write_text(plan)
    return folder / "mine.yaml"


@pytest.mark.parametrize(
    ("command", "blocked"),
    [("analyse", "screen"), ("fit", "fit"), ("conclude", "figures"), ("preflight", "preflight")],
)
def test_a_folder_that_cannot_be_written_is_told_before_anything_is_computed(tmp_path, monkeypatch, command, blocked):
    def untouched(*given, **options):
        raise AssertionError("computed in vain")

    for name in ("measure", "fit", "conclude", "preflight"):
        monkeypatch.setitem(CAMPAIGN_STAGES, name, replace(CAMPAIGN_STAGES[name], function=untouched))
    (tmp_path / blocked).write_text("a file where a folder should be")
    with pytest.raises(InputError, match=rf"{blocked}.*cannot be written .* check permission and space"):
        CliRunner().invoke(cli, [command, str(ROOT / DEMONSTRATION), "--folder", str(tmp_path)], catch_exceptions=False)


@pytest.mark.parametrize("command", ["analyse", "measure", "augment"])
def test_a_campaign_whose_files_would_be_written_over_is_refused_and_they_stay(tmp_path, command):
    text = (ROOT / DEMONSTRATION).read_text().replace("../mechanisms/ideal_joints.yaml", "mechanism.yaml")
    (tmp_path / "mine.yaml").write_text(f"folder: '{ROOT / 'config/campaigns'}'\n{text}")
    content = (ROOT / "config/mechanisms/ideal_joints.yaml").read_text()
    (tmp_path / "mechanism.yaml").write_text(content)
    with pytest.raises(InputError, match=r"mechanism\.yaml: is read by the campaign, .* give another --folder"):
        CliRunner().invoke(
            cli, [command, str(tmp_path / "mine.yaml"), "--folder", str(tmp_path)], catch_exceptions=False
        )
    assert (tmp_path / "mechanism.yaml").read_text() == content


def test_by_default_only_the_folder_of_results_is_kept_free_of_what_is_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / DEMONSTRATION).read_text().replace("../mechanisms/ideal_joints.yaml", "mechanism.yaml")
    text = f"folder: '{ROOT / 'config/campaigns'}'\n{text}"
    for place in (tmp_path, tmp_path / "results/campaigns/demonstration"):
        place.mkdir(parents=True, exist_ok=True)
        (place / "mine.yaml").write_text(text)
        (place / "mechanism.yaml").write_text((ROOT / "config/mechanisms/ideal_joints.yaml").read_text())
    assert CampaignState(tmp_path / "mine.yaml").folder.path == Path("results/campaigns/demonstration")
    with pytest.raises(InputError, match="is read by the campaign"):
        CampaignState(tmp_path / "results/campaigns/demonstration/mine.yaml")


def test_a_preflight_counts_the_samples_and_revolutions_that_there_are(tmp_path):
    (tmp_path / "demonstration").mkdir()
    for name, rows in (("slow", 360), ("mid", 200)):
        lines = (ROOT / f"config/campaigns/demonstration/{name}.csv").read_text().splitlines()[: rows + 1]
        (tmp_path / f"demonstration/{name}.csv").write_text("\n".join(lines))
    plan = (ROOT / DEMONSTRATION).read_text().replace("../mechanisms", str(ROOT / "config/mechanisms"))
    (tmp_path / "mine.yaml").write_text(plan.replace("speed: 280 rpm, role: identify", "speed: 280 rpm, role: split"))
    campaign = load_campaign(tmp_path / "mine.yaml")
    _, recordings = preflight.recorded(campaign)
    assert set(recordings) == {"slow", "mid"}  # of the third run there is no file yet
    turns = preflight.revolutions(campaign, recordings)
    assert turns["slow"] == pytest.approx(360 * 4.1237e-3 * 150 / 60, rel=0.01)
    counts = preflight.counts(build_model(campaign), recordings)
    assert counts["slow", "crank_torque"] == counts["slow", "crank_angle"] == 360
    assert counts["mid", "crank_torque"] == pytest.approx(200 * 2 / 3, abs=1)  # the last third is held out
    assert counts["mid", "slider_acceleration"] == counts["mid", "crank_torque"] - 10  # cells of which are empty
    assert ("fast", "crank_torque") not in counts


@pytest.mark.slow
def test_the_demonstration_names_what_its_data_hide(tmp_path):
    from jointgap.campaign.analyse import analyse

    found = analyse(ROOT / DEMONSTRATION, tmp_path)
    (effect,) = found["effects"]
    assert found["verdict"] == "named"
    assert effect["name"] == "slider_coulomb_friction"
    assert effect["parameters"]["force_N"]["value"] == pytest.approx(6.0, rel=0.03)
    assert found["gap"]["confirm"]["after"] == pytest.approx(1.0, abs=0.1)
    validate(
        json.loads((tmp_path / "verdict.json").read_text()),
        json.loads((ROOT / "workflow/schemas/verdict.schema.json").read_text()),
    )
    augmented = load_mechanism(tmp_path / "mechanism.yaml")
    assert [one.name for one in augmented.effects] == ["slider_coulomb_friction"]
    for path in tmp_path.rglob("*.parquet"):
        assert (describe(path)["description"] != "").all(), path


@pytest.mark.slow
def test_the_demonstration_of_a_loose_joint_names_it_and_holds_its_clearance(tmp_path):
    from jointgap.campaign.analyse import analyse

    found = analyse(ROOT / "config/campaigns/demonstration_clearance.yaml", tmp_path)
    (effect,) = found["effects"]
    # samples of motion that hardly repeats may be met by chance; the held-out ones then leave a misfit
    assert found["verdict"] in ("named", "named_with_remaining_misfit")
    assert effect["name"] == "crank_pin_clearance"
    assert found["basis"] == "statistics"
    low, high = effect["parameters"]["clearance_m"]["interval_90"]
    assert low <= 5e-4 <= high < 1.3 * low
    assert found["held_out_test"] == "falls"
    validate(
        json.loads((tmp_path / "verdict.json").read_text()),
        json.loads((ROOT / "workflow/schemas/verdict.schema.json").read_text()),
    )


def test_noise_of_other_data_is_refused_with_the_command_that_finds_it(tmp_path):
    case = CampaignState(ROOT / DEMONSTRATION, tmp_path)
    measure(case, pictures=False)
    noise(case)
    again = CampaignState(ROOT / DEMONSTRATION, tmp_path)
    assert again.noise.keys() == case.noise.keys()
    first = case.model.series[0]
    for other in (replace(first, channel="guide_force"), replace(first, value=first.value[:-1])):
        later = CampaignState(ROOT / DEMONSTRATION, tmp_path)
        later.model = SimpleNamespace(series=[other])
        with pytest.raises(
            InputError, match=f"channel {other.channel} of run 'slow' now holds; run `jointgap noise` on it"
        ):
            _ = later.noise
