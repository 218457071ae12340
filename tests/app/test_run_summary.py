"""Lines of the terminal and headline of the report at the end of a run."""

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


def test_a_verdict_has_answer_size_gap_and_page(tmp_path):
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


def test_each_scenario_has_a_row_and_shared_remarks_are_printed_once(
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


UNKNOWN = dict.fromkeys(("median", "5_percent", "95_percent", "motion_frozen"))
FORCES = {joint: {"after": 450.0, "after_at_deg": 3.0} for joint in ("crank_pin", "piston_pin")}
LENGTHS = {key: {"before": 25.0, "after": None} for key in ("crank_length_mm", "rod_length_mm")}
TOO_LARGE = "No lengths within the bounds keep the pin force below 300 N (least: 442.9 N)"
INFEASIBLE = {
    "status": "infeasible",
    "headline": TOO_LARGE,
    "remarks": ["Widen the box."],
    "reduction_percent": UNKNOWN,
    **LENGTHS,
}


def summaries(folder, **changes):
    """Write summaries of scenarios; their results."""
    scenario = Scenario(mechanism=load_mechanism("config/mechanisms/compressor.yaml"))
    for name, keys in changes.items():
        (folder / name).mkdir()
        summary = SUMMARY | {"speed_rpm": 1450.0, "largest_force_N": FORCES} | keys
        (folder / name / "summary.json").write_text(json.dumps(summary))
    return {name: ScenarioResults(folder / name, scenario) for name in changes}


def test_a_scenario_without_an_optimum_comes_before_the_table(tmp_path):
    results = summaries(tmp_path, free={}, limited=INFEASIBLE)
    headline, _, row, *_ = optimum_lines(results, tmp_path)
    assert headline == f"limited: {TOO_LARGE}" and row.split()[0] == "free"
    assert scenarios_without_optimum(results, tmp_path) == ["limited"]
    lines = optimum_lines(("limited",), tmp_path)
    assert lines[:2] == [headline, "remark on limited: Widen the box."]
    page = to_markdown(report.page({"limited": results["limited"]}, [], tmp_path))
    assert page.startswith(f"# Results of this run: {TOO_LARGE}")
    page = to_markdown(report.page(results, [], tmp_path))
    headline = f"# Results of this run: limited: {TOO_LARGE}. In the others the RMS error"
    assert page.startswith(headline)
    row = next(line for line in page.splitlines() if line.startswith("| [limited]"))
    assert "no optimum" in row and "442.9" not in row


def test_a_scenario_with_another_objective_is_reported_with_it(tmp_path):
    headline = "Crank 25.0 mm, rod 95.5 mm: largest pin force 4.4 % smaller"
    press = {"objective": "largest_pin_force", "headline": headline}
    press["largest_pin_force"] = {"reduction_percent": {"median": 4.4}}
    results = summaries(tmp_path, press=press, angle={"objective": "transmission_angle"})
    line, _, row, *_ = optimum_lines(("angle", "press"), tmp_path)
    assert line == f"press: {headline}" and row.split()[0] == "angle"
    text = to_markdown(report.page(results, [], tmp_path))
    assert text.startswith(f"# Results of this run: press: {headline}. In the others the RMS error")
    rows = {line.split("]")[0][3:]: line for line in text.splitlines() if line.startswith("| [")}
    assert "-4.4 (largest pin force)" in rows["press"] and "-3.8 |" in rows["angle"]
