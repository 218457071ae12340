"""What the terminal shows at the end of a run."""

import json

import pytest

from jointgap.app import report
from jointgap.app.run_summary import optimum_lines, scenarios_without_optimum, verdict_lines
from jointgap.config import Scenario, load_mechanism
from jointgap.config.scenario_results import ScenarioResults
from jointgap.core.errors import InputError
from jointgap.core.page import to_markdown
from tests.campaign.verdicts import NAMED

SUMMARY = {
    "status": "optimal",
    "headline": "",
    "remarks": ["the crank lies at its bound"],
    "crank_length_mm": {"before": 150.0, "after": 149.0},
    "rod_length_mm": {"before": 564.0, "after": 560.1234},
    "rms_error_deg": {"before": 0.054, "after": 0.05194},
    "reduction_percent": {
        "median": 3.81,
        "5_percent": -3.8,
        "95_percent": 3.82,
        "motion_frozen": 4.0,
    },
}


def test_a_verdict_is_reported_with_size_interval_gap_and_page(tmp_path):
    with pytest.raises(InputError, match=r"verdict\.json"):
        verdict_lines(tmp_path)
    (tmp_path / "verdict.json").write_text(json.dumps(NAMED))
    answer, size, gap, page = verdict_lines(tmp_path)
    assert answer.startswith("campaign rig-a: The model lacks Coulomb friction of the slider.")
    assert (
        size
        == "  Coulomb friction of the slider: friction force 21.30 N (90 % interval 20.60 to 22.00)"
    )
    assert "falls from 8.70 to 1.05" in gap and "sample by sample" in gap
    assert page == f"  page: {tmp_path / 'summary.html'}"


def test_each_scenario_has_a_row_with_the_numbers_of_its_page_and_shared_remarks_are_reported_once(
    tmp_path,
):
    assert optimum_lines(["mine"], tmp_path) == []
    names = ("short", "a_longer_name")
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "summary.json").write_text(json.dumps(SUMMARY))
    heads, short, longer, *_, remark, short_page, _ = optimum_lines((*names, "lost"), tmp_path)
    assert short.split() == "short 149.000 560.123 0.0540 to 0.0519 -3.81 (-3.82 to +3.80)".split()
    assert longer.split()[0] == "a_longer_name" and len(heads) == len(short) == len(longer)
    assert remark == "remark on all scenarios: the crank lies at its bound"
    assert short_page == f"page of short: {tmp_path / 'short' / 'summary.html'}"


def test_a_scenario_without_an_optimum_comes_first_and_has_no_row(tmp_path):
    words = (
        "No lengths within the bounds keep the pin force below 300 N (least: 442.9 N at rod"
        " 94.52 mm)"
    )
    none = dict.fromkeys(("median", "5_percent", "95_percent", "motion_frozen"))
    forces = {
        joint: {"before": 458.1, "after": None, "after_at_deg": None}
        for joint in ("crank_pin", "piston_pin")
    }
    lengths = {key: {"before": 25.0, "after": None} for key in ("crank_length_mm", "rod_length_mm")}
    unmet = {
        "status": "infeasible",
        "headline": words,
        "remarks": ["Widen the box."],
        "reduction_percent": none,
    }
    unmet |= {"speed_rpm": 1450.0, "largest_force_N": forces, **lengths}
    even = {
        "reduction_percent": {
            "median": 24.54,
            "5_percent": 24.541,
            "95_percent": 24.539,
            "motion_frozen": 24.0,
        }
    }
    even |= {
        "speed_rpm": 1450.0,
        "largest_force_N": {joint: {"after": 450.0, "after_at_deg": 3.0} for joint in forces},
    }
    for name, own in (("limited", unmet), ("free", even)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "summary.json").write_text(json.dumps(SUMMARY | own))
    first, _, row, *_ = optimum_lines(("free", "limited"), tmp_path)
    assert first == f"limited: {words}"
    assert row.split() == "free 149.000 560.123 0.0540 to 0.0519 -24.54 (-24.54)".split()
    assert scenarios_without_optimum(("free", "limited"), tmp_path) == ["limited"]

    own = Scenario(mechanism=load_mechanism("config/mechanisms/compressor.yaml"))
    opened = {name: ScenarioResults(tmp_path / name, own) for name in ("free", "limited")}
    alone = to_markdown(report.page({"limited": opened["limited"]}, [], tmp_path))
    assert alone.startswith(f"# Results of this run: {words}")
    both = to_markdown(report.page(opened, [], tmp_path))
    assert both.startswith(f"# Results of this run: limited: {words}. In the others the RMS error")
    row = next(line for line in both.splitlines() if line.startswith("| [limited]"))
    assert "no optimum" in row and "442.9" not in row
    assert optimum_lines(("limited",), tmp_path)[:2] == [first, "remark on limited: Widen the box."]


def test_a_scenario_with_another_objective_is_reported_with_that_objective(tmp_path):
    words = "Crank 25.0 mm, rod 95.5 mm: largest pin force 4.4 % smaller"
    own = {
        "objective": "largest_pin_force",
        "headline": words,
        "largest_pin_force": {"reduction_percent": {"median": 4.4}},
    }
    forces = {joint: {"after": 450.0, "after_at_deg": 3.0} for joint in ("crank_pin", "piston_pin")}
    for name, known in (("press", own), ("angle", {"objective": "transmission_angle"})):
        (tmp_path / name).mkdir()
        known = SUMMARY | {"speed_rpm": 1450.0, "largest_force_N": forces} | known
        (tmp_path / name / "summary.json").write_text(json.dumps(known))
    first, _, row, *_ = optimum_lines(("angle", "press"), tmp_path)
    assert first == f"press: {words}" and row.split()[0] == "angle"
    scenario = Scenario(mechanism=load_mechanism("config/mechanisms/compressor.yaml"))
    opened = {name: ScenarioResults(tmp_path / name, scenario) for name in ("press", "angle")}
    text = to_markdown(report.page(opened, [], tmp_path))
    assert text.startswith(f"# Results of this run: press: {words}. In the others the RMS error")
    rows = {line.split("]")[0][3:]: line for line in text.splitlines() if line.startswith("| [")}
    assert "-4.4 (largest pin force)" in rows["press"] and "-3.8 |" in rows["angle"]
