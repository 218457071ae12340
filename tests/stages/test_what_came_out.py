"""What the terminal shows at the end of a run."""

import json

import pytest

from jointgap.app.report import optimum_lines, verdict_lines
from jointgap.core.errors import InputError
from tests.campaign.verdicts import NAMED

SUMMARY = {
    "headline": "",
    "remarks": ["the crank lies at its bound"],
    "crank_length_mm": {"before": 150.0, "after": 149.0},
    "rod_length_mm": {"before": 564.0, "after": 560.1234},
    "rms_error_deg": {"before": 0.054, "after": 0.05194},
    "reduction_percent": {"median": 3.81, "5_percent": -3.8, "95_percent": 3.82, "motion_frozen": 4.0},
}


def test_a_verdict_is_reported_with_size_interval_gap_and_page(tmp_path):
    with pytest.raises(InputError, match=r"verdict\.json"):
        verdict_lines(tmp_path)
    (tmp_path / "verdict.json").write_text(json.dumps(NAMED))
    answer, size, gap, page = verdict_lines(tmp_path)
    assert answer.startswith("campaign rig-a: The model lacks Coulomb friction of the slider.")
    assert size == "  Coulomb friction of the slider: friction force 21.30 N (90 % interval 20.60 to 22.00)"
    assert "falls from 8.70 to 1.05" in gap and "sample by sample" in gap
    assert page == f"  page: {tmp_path / 'summary.html'}"


def test_each_scenario_has_a_row_with_the_numbers_of_its_page_and_shared_remarks_are_reported_once(tmp_path):
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
