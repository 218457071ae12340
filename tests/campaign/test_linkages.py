"""Campaigns of linkages other than the slider-crank, to the verdict."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.project import ROOT
from jointgap.app.cli import cli
from jointgap.campaign.augment import force_difference
from jointgap.campaign.labels import format_label, format_parameter, names_to_labels, unit_of
from jointgap.campaign.page import untested_clearances
from jointgap.config import read_yaml, validate
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import load_campaign, load_mechanism
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.effects.base import FitContext
from jointgap.rig.missing_effects import motion_scales, physical_candidates

FOUR_BAR = ROOT / "config/campaigns/four_bar.yaml"


def run(*command):
    return CliRunner().invoke(cli, [str(word) for word in command], catch_exceptions=False)


def candidates(name):
    mechanism = load_mechanism(name)
    scale, scales = motion_scales(mechanism, 20.0)
    context = FitContext(mechanism, scale, {}, True, 3.0, ("slow",), {"slow": 0.0}, scales)
    return {candidate.label: candidate for candidate in physical_candidates(context)}


@pytest.mark.parametrize(
    "name, count, some",
    [
        ("four_bar", 20, {"rocker_coulomb_friction", "added_coupler_mass", "B_clearance"}),
        ("quick_return", 27, {"ram_spring", "track_viscous_friction", "pin_friction:D"}),
        ("six_bar", 18, {"output_viscous_friction", "added_link_mass", "D_clearance"}),
    ],
)
def test_every_law_is_a_candidate_at_every_site_where_it_may_act(name, count, some):
    found = candidates(name)
    assert some < {*found} and len(found) == count


def test_steps_of_a_fit_follow_the_motion_of_each_body():
    found = candidates("quick_return")
    ram, rocker, crank = (
        found[f"{body}_viscous_friction"].coordinates[0].step for body in ("ram", "rocker", "crank")
    )
    _, scales = motion_scales(load_mechanism("quick_return"), 20.0)
    assert ram == pytest.approx(scales["ram"].force / scales["ram"].speed)
    torque = scales["rocker"].force * scales["rocker"].stroke
    assert rocker == pytest.approx(torque / scales["rocker"].turning)
    # the same power as that of the inertia forces, whichever body it acts on
    assert ram * scales["ram"].speed ** 2 == pytest.approx(crank * 20.0**2, rel=1e-9)


def test_effects_of_any_linkage_have_labels_and_units_by_rule():
    label = format_label("rocker_viscous_friction + added_coupler_mass + A_clearance")
    assert label == (
        "viscous friction of the rocker, a deviating coupler mass and clearance in joint A"
    )
    assert format_label("pin_friction:A") == "friction in joint A"
    assert format_label("pin_friction:crank_pin") == "friction in the crank pin"
    assert unit_of("rocker_viscous_friction", "C", "damping_N_m_s") == "N*m*s"
    assert unit_of("ram_viscous_friction", "guide", "damping_N_s_m") == "N*s/m"
    assert format_parameter("link_length_error", "coupler_m") == "deviation of the coupler length"
    text = names_to_labels("the effect rocker_coulomb_friction, the nuisance rocker_mass")
    assert text == "the effect Coulomb friction of the rocker, the nuisance rocker mass"


def test_the_missing_force_is_that_of_the_law_at_its_body():
    plain = load_campaign(FOUR_BAR).mechanism
    hidden = {"name": "rocker_viscous_friction", "parameters": {"damping_N_m_s": 0.05}}
    damped = type(plain).model_validate(plain.model_dump() | {"effects": [hidden]})
    found = force_difference(plain, damped, {"slow": 20.0})
    parquet.to_arrow(schema.MISSING_FORCE, found)
    assert {*found["body"]} == {"rocker"} and found["force"].isna().all()
    np.testing.assert_allclose(
        found["torque"].astype(float), -0.05 * found["angular_velocity"].astype(float), rtol=1e-12
    )
    behind = force_difference(plain, damped, {"slow": 20.0}, clockwise_runs=("slow",))
    np.testing.assert_allclose(
        behind["torque"].astype(float), -0.05 * behind["angular_velocity"].astype(float), rtol=1e-12
    )


def test_an_effect_of_a_linkage_is_shown_by_its_name():
    shown = run("effects", "rocker_coulomb_friction").output
    assert "torque_N_m" in shown and "rocker" in shown


def test_a_law_of_the_user_acts_at_a_body_on_a_slide_or_pivot(tmp_path):
    text = FOUR_BAR.read_text(encoding="utf-8")
    text = text.replace("../mechanisms", str(ROOT / "config/mechanisms"))
    for law, wrong in (
        ('{site: rocker, torque: "-c*v^3", c: 0 to 1 N*m*s^3}', ""),
        ('{site: rocker, force: "-c*v^3", c: 0 to 1 N*s^3/m^3}', "requires the key torque"),
        ('{site: rocker, torque: "-c*|v|^(1/2)*sgn(v)", c: 0 to 1 N*m*s}', "give c in"),
        ('{site: roker, torque: "-c*v^3", c: 0 to 1 N*m*s^3}', "did you mean 'rocker'"),
    ):
        (tmp_path / "mine.yaml").write_text(text + f"candidates: {{mine: {law}}}\n")
        try:
            load_campaign(tmp_path / "mine.yaml")
            message = ""
        except ValueError as error:
            message = str(error)
        assert bool(message) == bool(wrong) and wrong in message


def test_clearances_that_are_not_tested_are_listed_with_what_to_do():
    mechanism = load_mechanism("six_bar")
    (line,) = untested_clearances(mechanism)
    assert "clearance in O, C, E, A, B" in line and "`loose: false`" in line
    assert untested_clearances(load_campaign(FOUR_BAR).mechanism) != ()  # the drive's joint


@pytest.mark.parametrize(
    "key, value, message",
    [
        ("drive", "P", "drive 'P' is no joint of the frame with a body"),
        ("joints", {"B": "ideal"}, "a joint without an entry is ideal"),
    ],
)
def test_a_wrong_drive_and_an_ideal_joint_get_one_error(key, value, message):
    data = read_yaml(ROOT / "config/mechanisms/four_bar.yaml")
    with pytest.raises(InputError, match=message) as error:
        validate(LinkageFile, data | {key: value}, "mine.yaml")
    assert str(error.value).count("mine.yaml") == 1


@pytest.mark.integration
def test_the_clearance_of_the_four_bar_is_found_in_its_joint(tmp_path):
    result = run("analyse", FOUR_BAR, "--folder", tmp_path / "four_bar")
    assert result.exit_code == 0 and "clearance in joint B" in result.output
    verdict = json.loads((tmp_path / "four_bar/verdict.json").read_text())
    (effect,) = verdict["effects"]
    assert effect["name"] == "B_clearance"
    size = effect["parameters"]["clearance_m"]
    assert size["value"] == pytest.approx(2e-4, rel=0.02)
    assert verdict["gap"]["confirm"]["after"] < 1.1
