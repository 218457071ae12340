"""An unlisted law is named as the family of listed laws, with its shape."""

import json
import math
from pathlib import Path

import jsonschema
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.campaign.sentences import answer
from tests.rig.campaigns import law, with_hidden

pytestmark = pytest.mark.integration

SCHEMA = json.loads(Path("workflow/schemas/verdict.schema.json").read_text(encoding="utf-8"))
STRIBECK = law("-f*tanh(v/0.01)*(0.3 + 0.7*exp(-|v|/0.8))", f=40.0)
PLACED = law(f"-f*tanh(v/0.01)*(0.4 + 0.6*(1 + cos({math.pi / 0.15}*(x - 0.67)))/2)", f=10.0)


def analysed(folder: Path, effect: dict) -> tuple[dict, dict, dict]:
    """The verdict, the one effect in it and the parameters of the one in the mechanism file."""
    verdict = analyse(with_hidden(folder, effect), folder / "results")
    jsonschema.validate(
        json.loads((folder / "results" / "verdict.json").read_text(encoding="utf-8")), SCHEMA
    )
    (written,) = yaml.safe_load((folder / "results" / "mechanism.yaml").read_text())["effects"]
    (result,) = verdict["effects"]
    assert (verdict["verdict"], written["name"]) == ("named", result["name"])
    return verdict, result, written["parameters"]


@pytest.mark.parametrize(
    ("effect", "name", "shape", "words", "size", "true", "off"),
    [
        (
            law("-c*v^3", c=0.5),
            "slider_power_drag",
            (2, 3, 99),
            "drag of the slider (exponent",
            "exponent",
            3,
            0.2,
        ),
        (
            STRIBECK,
            "slider_stribeck_friction",
            (0, 0.7, 1),
            "dry friction of the slider (stribeck share",
            "stribeck_speed_m_s",
            0.8,
            0.24,
        ),
        (
            PLACED,
            "slider_position_friction",
            (0, 0.6, 2),
            "position-dependent dry friction of the slider (varying share",
            "tightest_position_m",
            0.67,
            0.02,
        ),
    ],
)
def test_a_law_is_named_as_its_family_with_its_shape(
    tmp_path, effect, name, shape, words, size, true, off
):
    verdict, result, written = analysed(tmp_path, effect)
    (family,) = result["families"]
    (low, high), (lowest, exact, highest) = family["interval_99"], shape
    assert result["name"] == name and family["named"]
    assert lowest < low <= exact <= high < highest
    assert (
        words in answer(verdict)
        and "quadratic" not in answer(verdict)
        and "linear" not in answer(verdict)
    )
    period = 0.3 if size == "tightest_position_m" else math.inf  # m
    assert abs(math.remainder(written[size] - true, period)) < off


def test_a_clear_listed_law_is_not_replaced_by_its_family(tmp_path):
    # of 5 N a half that falls within a tenth of the usual speed would still be possible
    verdict, result, _ = analysed(
        tmp_path, {"name": "slider_coulomb_friction", "parameters": {"force_N": 10.0}}
    )
    assert result["name"] == "slider_coulomb_friction"
    families = {family["law"]: family for family in result["families"]}
    assert families.keys() == {
        "slider_power_drag",
        "slider_stribeck_friction",
        "slider_position_friction",
    }
    for family in families.values():
        low, high = family["interval_99"]
        assert not family["named"] and low <= 0.0 <= high
    assert "(" not in answer(verdict).partition(".")[0]
