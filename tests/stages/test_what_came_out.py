"""What the terminal shows at the end of a run."""

import json

import pytest

from jointgap.errors import InputError
from jointgap.stages.what_came_out import optimum_lines, verdict_lines
from jointgap.tables.optimise_tables import OPTIMA, RESIMULATED
from jointgap.tables.results_folder import ResultsFolder
from tests.campaign.verdicts import NAMED
from tests.track.synthetic import numbers, scenario


def test_a_verdict_is_told_with_size_interval_gap_and_page(tmp_path):
    (tmp_path / "verdict.json").write_text(json.dumps(NAMED))
    answer, size, gap, page = verdict_lines(tmp_path)
    assert answer.startswith("campaign rig-a: Missing in the model is Coulomb friction of the slider.")
    assert size == "  Coulomb friction of the slider: force 21.30 N (90 % interval 20.60 to 22.00)"
    assert "falls from 8.70 to 1.05" in gap and "sample by sample" in gap
    assert page == f"  page: {tmp_path / 'summary.html'}"


def test_a_campaign_without_a_verdict_is_an_error(tmp_path):
    with pytest.raises(InputError, match=r"verdict\.json"):
        verdict_lines(tmp_path)


def test_each_scenario_with_an_optimum_has_a_row_and_shared_remarks_are_told_once(tmp_path):
    for name in ("short", "a_longer_name"):
        folder = ResultsFolder(tmp_path / name)
        point = ["networks_paper_genetic"] * 2
        folder.write(OPTIMA, numbers(OPTIMA, 2, point=point, crank_length=[0.149, 0.149]))
        given = {"stretch": ["window", "settled"], "measure": ["rms"] * 2, "reduction": [0.0381, 0.05]}
        given |= {"reduction_low": [0.038, 0.04], "reduction_high": [0.0382, 0.06]}
        folder.write(RESIMULATED, numbers(RESIMULATED, 2, point=point, **given))
        (folder.path / "summary.json").write_text('{"remarks": ["the crank lies at its bound"]}')
    lines = optimum_lines(dict.fromkeys(("short", "a_longer_name", "not_run"), scenario()), tmp_path)
    heads, short, longer, *_, remark, short_page, _ = lines
    assert short.split()[:2] == ["short", "149.000"] and longer.split()[0] == "a_longer_name"
    assert short.split()[-8:] == "3.81 (3.80 to 3.82) 5.00 (4.00 to 6.00)".split()
    assert len(heads) == len(short) == len(longer)
    assert remark == "remark on all scenarios: the crank lies at its bound"
    assert short_page == f"page of short: {tmp_path / 'short' / 'summary.html'}"


def test_nothing_is_said_where_nothing_was_optimised(tmp_path):
    assert optimum_lines({"mine": scenario()}, tmp_path) == []
