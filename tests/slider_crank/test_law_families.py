"""A law that is on nobody's list is named as the family of those that are, with its shape."""

import json
import math
from pathlib import Path

import jsonschema
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.campaign.sentences import answer
from tests.slider_crank.test_library import written_campaign

pytestmark = pytest.mark.integration

SCHEMA = json.loads(Path("workflow/schemas/verdict.schema.json").read_text(encoding="utf-8"))


def analysed(folder: Path, hidden: dict) -> tuple[dict, dict]:
    """The verdict, the one effect in it and the effects of the mechanism file that comes out."""
    verdict = analyse(written_campaign(folder, hidden), folder / "results")
    written = json.loads((folder / "results" / "verdict.json").read_text(encoding="utf-8"))
    jsonschema.validate(written, SCHEMA)
    return verdict, yaml.safe_load((folder / "results" / "mechanism.yaml").read_text())["effects"]


@pytest.mark.parametrize("size", [pytest.param(0.05, marks=pytest.mark.slow), 0.5])
def test_cubic_drag_is_named_as_drag_with_an_exponent_whose_interval_holds_three(tmp_path, size):
    formula = {"formula": "-c*v^3", "coefficients": {"c": size}}
    verdict, effects = analysed(tmp_path, {"name": "discovered_slider_force", "parameters": formula})
    (found,) = verdict["effects"]
    (family,) = found["families"]
    low, high = family["interval_99"]
    assert verdict["verdict"] == "named"
    assert found["name"] == "slider_power_drag" and family["named"]
    assert 2.0 < low <= 3.0 <= high
    assert "drag of the slider (exponent" in answer(verdict) and "quadratic" not in answer(verdict)
    (written,) = effects
    assert written["parameters"]["exponent"] == pytest.approx(found["parameters"]["exponent"]["value"])


@pytest.mark.slow
def test_quadratic_drag_that_shows_well_keeps_its_name(tmp_path):
    hidden = {"name": "slider_quadratic_drag", "parameters": {"drag_N_s2_m2": 0.5}}
    verdict, effects = analysed(tmp_path, hidden)
    (found,) = verdict["effects"]
    assert (verdict["verdict"], found["name"]) == ("named", "slider_quadratic_drag")
    (family,) = found["families"]
    assert family["interval_99"][0] <= 2.0 <= family["interval_99"][1]
    assert not family["named"]
    assert answer(verdict).startswith("The model lacks quadratic drag of the slider.")
    assert [effect["name"] for effect in effects] == ["slider_quadratic_drag"]


def test_a_cubic_spring_is_named_as_a_spring_whose_cubic_share_is_one(tmp_path):
    formula = {"formula": "-s*(x-0.5)^3", "coefficients": {"s": 5e3}}
    verdict, effects = analysed(tmp_path, {"name": "discovered_slider_force", "parameters": formula})
    (found,) = verdict["effects"]
    ((low, high),) = (family["interval_99"] for family in found["families"])
    assert (verdict["verdict"], found["name"]) == ("named", "slider_nonlinear_spring")
    assert 0.5 < low <= 1.0 == high
    assert "lacks a spring on the slider (cubic share" in answer(verdict) and "linear" not in answer(verdict)
    (written,) = (effect["parameters"] for effect in effects)
    assert written["stiffness_N_m"] / written["length_m"] ** 2 == pytest.approx(5e3, rel=0.2)
    assert written["rest_position_m"] == pytest.approx(0.5, abs=0.01)


@pytest.mark.slow
def test_a_linear_spring_that_shows_well_keeps_its_name(tmp_path):
    hidden = {"name": "slider_spring", "parameters": {"stiffness_N_m": 200.0, "rest_position_m": 0.52}}
    verdict, _ = analysed(tmp_path, hidden)
    (found,) = verdict["effects"]
    (family,) = found["families"]
    low, high = family["interval_99"]
    assert (verdict["verdict"], found["name"], family["named"]) == ("named", "slider_spring", False)
    assert low <= 0.0 <= high


def test_stribeck_friction_is_named_as_dry_friction_with_the_share_that_falls_and_over_which_speed(tmp_path):
    formula = {"formula": "-f*tanh(v/0.01)*(0.3 + 0.7*exp(-|v|/0.8))", "coefficients": {"f": 40.0}}
    verdict, effects = analysed(tmp_path, {"name": "discovered_slider_force", "parameters": formula})
    (found,) = verdict["effects"]
    (family,) = found["families"]
    low, high = family["interval_99"]
    assert (verdict["verdict"], found["name"], family["named"]) == ("named", "slider_stribeck_friction", True)
    assert 0.0 < low <= 0.7 <= high < 1.0
    assert "lacks dry friction of the slider (stribeck share" in answer(verdict)
    (written,) = (effect["parameters"] for effect in effects)
    assert written["stribeck_speed_m_s"] == pytest.approx(0.8, rel=0.3)


@pytest.mark.parametrize(("place", "share"), [pytest.param(0.56, 1.0, marks=pytest.mark.slow), (0.67, 0.6)])
def test_friction_that_is_largest_at_one_place_of_the_stroke_is_named_with_the_share_that_varies_and_where(
    tmp_path, place, share
):
    wave = f"(1 + cos({math.pi / 0.15}*(x - {place})))/2"
    formula = {"formula": f"-f*tanh(v/0.01)*({1 - share} + {share}*{wave})", "coefficients": {"f": 10.0}}
    verdict, effects = analysed(tmp_path, {"name": "discovered_slider_force", "parameters": formula})
    (found,) = verdict["effects"]
    (family,) = found["families"]
    low, high = family["interval_99"]
    assert (verdict["verdict"], found["name"], family["named"]) == ("named", "slider_position_friction", True)
    assert 0.0 < low <= share <= high
    assert "lacks position-dependent dry friction of the slider (varying share" in answer(verdict)
    (written,) = (effect["parameters"] for effect in effects)
    assert (written["tightest_position_m"] - place + 0.15) % 0.3 - 0.15 == pytest.approx(0.0, abs=0.02)


def test_friction_of_the_crank_that_varies_with_its_angle_is_named_with_the_share_that_varies_and_where(tmp_path):
    hidden = {"torque_N_m": 0.5, "tightest_angle_rad": 2.0, "varying_share": 0.6}
    verdict, effects = analysed(tmp_path, {"name": "crank_angle_friction", "parameters": hidden})
    (found,) = verdict["effects"]
    (family,) = found["families"]
    low, high = family["interval_99"]
    assert (verdict["verdict"], found["name"], family["named"]) == ("named", "crank_angle_friction", True)
    assert 0.0 < low <= 0.6 <= high < 1.0
    (written,) = (effect["parameters"] for effect in effects)
    assert written["tightest_angle_rad"] == pytest.approx(2.0, abs=0.1)


def test_coulomb_friction_that_shows_well_keeps_its_name(tmp_path):
    # of 5 N a half that falls within a tenth of the usual speed would still be possible
    verdict, _ = analysed(tmp_path, {"name": "slider_coulomb_friction", "parameters": {"force_N": 10.0}})
    (found,) = verdict["effects"]
    assert (verdict["verdict"], found["name"]) == ("named", "slider_coulomb_friction")
    assert {family["law"]: family["named"] for family in found["families"]} == {
        "slider_power_drag": False,
        "slider_stribeck_friction": False,
        "slider_position_friction": False,
    }
