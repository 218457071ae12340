"""Campaigns on files: what a configuration asks for, and the demonstration from its CSV to its verdict."""

import json

import pytest
from jsonschema import validate

from benchmarks.project import ROOT
from jointgap.campaign.files import campaigns
from jointgap.config import load_mechanism
from jointgap.errors import InputError
from jointgap.tables import describe

DEMONSTRATION = "config/campaigns/demonstration.yaml"


def test_the_files_of_a_campaign_are_its_plan_and_its_data():
    found = campaigns([DEMONSTRATION], (ROOT,))["demonstration"]
    assert [place.rsplit("/", 1)[1] for place in found.plan] == ["demonstration.yaml", "ideal_joints.yaml"]
    assert [place.rsplit("/", 1)[1] for place in found.data] == ["slow.csv", "mid.csv", "fast.csv"]


@pytest.mark.parametrize(
    ("paths", "message"),
    [
        ("mine.yaml", "must be a list"),
        (["mine.yaml"], "no file 'mine.yaml'"),
        ([DEMONSTRATION, DEMONSTRATION], "both called 'demonstration'"),
    ],
)
def test_what_cannot_be_a_list_of_campaigns_is_refused_with_the_mend(paths, message):
    with pytest.raises(InputError, match=message):
        campaigns(paths, (ROOT,))


@pytest.mark.slow
def test_the_demonstration_names_what_its_data_hide(tmp_path):
    from jointgap.campaign import analyse

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
