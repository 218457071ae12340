"""Laws stated in a campaign file are candidates."""

import json
from pathlib import Path

import jsonschema
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.campaign.labels import format_detectable
from jointgap.campaign.plan import preflight_tables
from jointgap.campaign.sentences import answer
from jointgap.config import Simulate, load_mechanism
from jointgap.core.errors import InputError
from jointgap.motion.slider_crank import simulate
from tests.rig.campaigns import law, with_hidden
from tests.rig.rigs import campaign, chosen, mechanism, read, rig, worst

SCHEMA = json.loads(Path("workflow/schemas/verdict.schema.json").read_text(encoding="utf-8"))
COULOMB = {"name": "slider_coulomb_friction", "parameters": {"force_N": 4.0}}
DRAG = {"site": "slider", "force": "-c*v^3", "c": "0 to 100 N*s^3/m^3"}
CAM = {"site": "crank", "torque": "-m*|sin(theta)|", "m": "0 to 10 N*m"}
SEAL = {
    "site": "slider",
    "force": "-c*v*exp(-((x - x0)/0.05)^2)",
    "c": "0 to 200 N*s/m",
    "x0": "0.4 to 0.7 m",
}


def test_a_law_that_is_not_finite_is_refused_with_its_parameters():
    power = {"site": "slider", "force": "-c*v^n", "c": "0 to 9", "n": "1 to 3"}
    with pytest.raises(
        InputError, match=r"candidates\.my_power: with c = 1, n = 1\.33333 .* write \|v\|\^n"
    ):
        chosen(rig(candidates={"my_power": power}), "my_power")


def on_crank(formula: str, **coefficients: float) -> dict:
    return law(formula, **coefficients) | {"name": "discovered_crank_torque"}


BOTH = {"my_drag": DRAG, "my_cam": CAM}


@pytest.mark.parametrize("direction", ["counter_clockwise", "clockwise"])
def test_a_law_of_the_campaign_file_acts_as_its_formula_in_the_mechanism_file(direction):
    keys = {"run": {"direction": direction}, "sensors": {"crank_angle": {"noise": 1e-6}}}
    listed = rig(mechanism(), candidates=BOTH | {"my_seal": SEAL}, **keys)
    frame = rig(
        mechanism(effects=[law("-c*v^3", c=0.1), on_crank("-m*|sin(theta)|", m=2.0)]), **keys
    )
    acting = read(listed, ("my_drag", {"c": 0.1}), ("my_cam", {"m": 2.0}))
    assert worst(acting, read(frame)) < 1e-9 < worst(acting, read(listed))
    # two laws on one body add up
    both = read(listed, ("my_drag", {"c": 0.1}), ("my_seal", {"c": 5.0, "x0": 0.6}))
    first, second = (
        read(listed, ("my_drag", {"c": 0.1})),
        read(listed, ("my_seal", {"c": 5.0, "x0": 0.6})),
    )
    nothing = read(listed)
    assert worst({name: first[name] + second[name] - nothing[name] for name in both}, both) < 1e-6


def test_amplitudes_and_shapes_follow_from_the_formula():
    mixed = {
        "site": "slider",
        "force": "-(a*v + b*v^3)",
        "a": "-5 to 5 N*s/m",
        "b": "0 to 100 N*s^3/m^3",
    }
    model = rig(candidates=BOTH | {"my_seal": SEAL, "my_mix": mixed})
    assert chosen(model, "my_mix").amplitudes == ("a", "b")
    drag, seal = chosen(model, "my_drag"), chosen(model, "my_seal")
    assert (drag.amplitudes, drag.initial_guesses) == (("c",), ({},))
    assert seal.amplitudes == ("c",) and [
        guess["x0"] for guess in seal.initial_guesses
    ] == pytest.approx([0.45, 0.55, 0.65])
    assert {p.key: (p.nominal, p.low, p.high, p.unit) for p in seal.coordinates} == {
        "c": (0.0, 0.0, 200.0, "N*s/m"),
        "x0": (pytest.approx(0.55), 0.4, 0.7, "m"),
    }


def test_a_law_that_the_mechanism_has_is_no_candidate():
    has = law("-c*v^3", c=0.1) | {"label": "my_drag"}
    labels = [
        candidate.label for candidate in rig(mechanism(effects=[has]), candidates=BOTH).candidates
    ]
    assert "my_cam" in labels and "my_drag" not in labels


def test_a_preflight_reports_the_smallest_detectable_size_of_a_law():
    rows = preflight_tables(campaign(mechanism(), candidates=BOTH), 0.01)["detectable"].itertuples()
    row = next(row for row in rows if row.label == "my_drag")
    assert row.detectable and row.unit == "N*s^3/m^3" and 0.0 < row.smallest_detectable < 1.0
    assert format_detectable(row).startswith("c ") and format_detectable(row).endswith(" N s³/m³")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("own", "hidden"),
    [
        (CAM, on_crank("-m*|sin(theta)|", m=2.0)),
        (SEAL, law("-c*v*exp(-((x - x0)/0.05)^2)", c=5.0, x0=0.6)),
    ],
)
def test_a_law_of_the_campaign_file_and_friction_are_named(tmp_path, own, hidden):
    path = with_hidden(tmp_path, COULOMB, hidden, noise=0.01, candidates={"my_law": own})
    verdict = analyse(path, tmp_path / "results")
    jsonschema.validate(
        json.loads((tmp_path / "results" / "verdict.json").read_text(encoding="utf-8")), SCHEMA
    )
    assert verdict["verdict"] == "named", verdict["because"]
    result = {effect["name"]: effect for effect in verdict["effects"]}
    assert set(result) == {"slider_coulomb_friction", "my_law"}
    for name, size in hidden["parameters"]["coefficients"].items():
        estimate = result["my_law"]["parameters"][name]
        low, high = estimate["interval_90"]
        assert estimate["value"] == pytest.approx(size, rel=0.05)
        assert low < size < high
        assert own[name].endswith(estimate["unit"])
    assert 0.9 < verdict["gap"]["confirm"]["after"] < 1.1
    assert f"my law ({result['my_law']['formula']})" in answer(verdict)

    # the augmented file runs and has the hidden effect
    file = tmp_path / "results" / "mechanism.yaml"
    entries = yaml.safe_load(file.read_text())["effects"]
    (written,) = (entry for entry in entries if entry.get("label") == "my_law")
    assert (
        written["name"] == hidden["name"]
        and written["parameters"]["formula"] == result["my_law"]["formula"]
    )
    assert (
        simulate(load_mechanism(file), Simulate(speed=30.0, revolutions=1))
        .samples["crank_torque"]
        .notna()
        .all()
    )
