"""A law that is on nobody's list is named as the family of those that are, with its shape."""

import json
import math
from pathlib import Path

import jsonschema
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.campaign.sentences import answer
from tests.slider_crank.campaigns import law, with_hidden

pytestmark = pytest.mark.integration
slow = pytest.mark.slow

SCHEMA = json.loads(Path("workflow/schemas/verdict.schema.json").read_text(encoding="utf-8"))
STRIBECK = law("-f*tanh(v/0.01)*(0.3 + 0.7*exp(-|v|/0.8))", f=40.0)
CRANK = {"torque_N_m": 0.5, "tightest_angle_rad": 2.0, "varying_share": 0.6}
DRAG, SPRING = "drag of the slider (exponent", "lacks a spring on the slider (cubic share"
PLACED = "lacks position-dependent dry friction of the slider (varying share"


def hidden(name, **parameters):
    return {"name": name, "parameters": parameters}


def placed(place, share):
    """Dry friction that is largest at one place of the stroke."""
    return law(f"-f*tanh(v/0.01)*({1 - share} + {share}*(1 + cos({math.pi / 0.15}*(x - {place})))/2)", f=10.0)


def analysed(folder: Path, effect: dict) -> tuple[dict, dict, dict]:
    """The verdict, the one effect in it and the parameters of the one in the mechanism file."""
    verdict = analyse(with_hidden(folder, effect), folder / "results")
    jsonschema.validate(json.loads((folder / "results" / "verdict.json").read_text(encoding="utf-8")), SCHEMA)
    (written,) = yaml.safe_load((folder / "results" / "mechanism.yaml").read_text())["effects"]
    (found,) = verdict["effects"]
    assert (verdict["verdict"], written["name"]) == ("named", found["name"])
    return verdict, found, written["parameters"]


@pytest.mark.parametrize(
    ("effect", "name", "shape", "words", "size"),
    [
        pytest.param(law("-c*v^3", c=0.05), "slider_power_drag", (2, 3, 99), DRAG, None, marks=slow),
        (law("-c*v^3", c=0.5), "slider_power_drag", (2, 3, 99), DRAG, None),
        (
            law("-s*(x-0.5)^3", s=5e3),
            "slider_nonlinear_spring",
            (0.5, 1, 2),
            SPRING,
            lambda p: (p["stiffness_N_m"] / p["length_m"] ** 2 / 5e3 - 1, 0.2, p["rest_position_m"] - 0.5, 0.01),
        ),
        (
            STRIBECK,
            "slider_stribeck_friction",
            (0, 0.7, 1),
            "lacks dry friction of the slider (stribeck share",
            lambda p: (p["stribeck_speed_m_s"] / 0.8 - 1, 0.3),
        ),
        *(
            pytest.param(
                placed(place, share),
                "slider_position_friction",
                (0, share, 2),
                PLACED,
                lambda p, place=place: ((p["tightest_position_m"] - place + 0.15) % 0.3 - 0.15, 0.02),
                marks=marks,
            )
            for place, share, marks in ((0.56, 1.0, slow), (0.67, 0.6, ()))
        ),
        (
            hidden("crank_angle_friction", **CRANK),
            "crank_angle_friction",
            (0, 0.6, 1),
            "",
            lambda p: (p["tightest_angle_rad"] - 2.0, 0.1),
        ),
    ],
)
def test_a_law_is_named_as_its_family_with_its_shape(tmp_path, effect, name, shape, words, size):
    verdict, found, written = analysed(tmp_path, effect)
    (family,) = found["families"]
    (low, high), (least, true, most) = family["interval_99"], shape
    assert found["name"] == name and family["named"]
    assert least < low <= true <= high < most
    assert words in answer(verdict) and "quadratic" not in answer(verdict) and "linear" not in answer(verdict)
    away = size(written) if size else ()
    assert all(abs(off) < allowed for off, allowed in zip(away[::2], away[1::2], strict=True)), away


@pytest.mark.parametrize(
    ("effect", "shapes"),
    [
        pytest.param(hidden("slider_quadratic_drag", drag_N_s2_m2=0.5), {"slider_power_drag": 2.0}, marks=slow),
        pytest.param(
            hidden("slider_spring", stiffness_N_m=200.0, rest_position_m=0.52),
            {"slider_nonlinear_spring": 0.0},
            marks=slow,
        ),
        (  # of 5 N a half that falls within a tenth of the usual speed would still be possible
            hidden("slider_coulomb_friction", force_N=10.0),
            {"slider_power_drag": 0.0, "slider_stribeck_friction": 0.0, "slider_position_friction": 0.0},
        ),
    ],
)
def test_a_law_of_the_list_that_shows_well_keeps_its_name(tmp_path, effect, shapes):
    verdict, found, _ = analysed(tmp_path, effect)
    assert found["name"] == effect["name"]
    assert {family["law"]: family["named"] for family in found["families"]} == dict.fromkeys(shapes, False)
    for family in found["families"]:
        low, high = family["interval_99"]
        assert low <= shapes[family["law"]] <= high
    assert "(" not in answer(verdict).partition(".")[0]
