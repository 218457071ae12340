"""A law that is on nobody's list is named as the family of those that are, with its shape."""

import json
from pathlib import Path

import jsonschema
import pytest
import yaml

from jointgap.campaign import analyse
from jointgap.campaign.verdict_sentences import answer
from tests.slider_crank.test_library import written_campaign

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
    low, high = found["family"]["interval_99"]
    assert verdict["verdict"] == "named"
    assert found["name"] == "slider_power_drag" and found["family"]["named"]
    assert 2.0 < low <= 3.0 <= high
    assert "drag of the slider (exponent" in answer(verdict) and "quadratic" not in answer(verdict)
    (written,) = effects
    assert written["parameters"]["exponent"] == pytest.approx(found["parameters"]["exponent"]["value"])


def test_quadratic_drag_that_shows_well_keeps_its_name(tmp_path):
    hidden = {"name": "slider_quadratic_drag", "parameters": {"drag_N_s2_m2": 0.5}}
    verdict, effects = analysed(tmp_path, hidden)
    (found,) = verdict["effects"]
    assert (verdict["verdict"], found["name"]) == ("named", "slider_quadratic_drag")
    assert found["family"]["interval_99"][0] <= 2.0 <= found["family"]["interval_99"][1]
    assert not found["family"]["named"]
    assert answer(verdict).startswith("Missing in the model is quadratic drag of the slider.")
    assert [effect["name"] for effect in effects] == ["slider_quadratic_drag"]


def test_a_cubic_spring_is_named_as_a_spring_whose_cubic_share_is_one(tmp_path):
    formula = {"formula": "-s*(x-0.5)^3", "coefficients": {"s": 5e3}}
    verdict, effects = analysed(tmp_path, {"name": "discovered_slider_force", "parameters": formula})
    (found,) = verdict["effects"]
    low, high = found["family"]["interval_99"]
    assert (verdict["verdict"], found["name"]) == ("named", "slider_nonlinear_spring")
    assert 0.5 < low <= 1.0 == high
    assert "is a spring on the slider (cubic share" in answer(verdict) and "linear" not in answer(verdict)
    (written,) = (effect["parameters"] for effect in effects)
    assert written["stiffness_N_m"] / written["length_m"] ** 2 == pytest.approx(5e3, rel=0.2)
    assert written["rest_position_m"] == pytest.approx(0.5, abs=0.01)


def test_a_linear_spring_that_shows_well_keeps_its_name(tmp_path):
    hidden = {"name": "slider_spring", "parameters": {"stiffness_N_m": 200.0, "rest_position_m": 0.52}}
    verdict, _ = analysed(tmp_path, hidden)
    (found,) = verdict["effects"]
    low, high = found["family"]["interval_99"]
    assert (verdict["verdict"], found["name"], found["family"]["named"]) == ("named", "slider_spring", False)
    assert low <= 0.0 <= high
