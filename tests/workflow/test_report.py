"""The report of a run: one page in one file, whose text can be searched."""

import re

import pytest

from benchmarks.project import SMOKE_REPORT
from jointgap.app import report as report_page
from jointgap.config import resolve
from jointgap.config.yaml_files import read_yaml
from jointgap.core.page import to_html
from jointgap.scenario.figures import FIGURES
from jointgap.scenario.results import ScenarioResults

pytestmark = pytest.mark.integration

STILL = [FIGURES[name] for name in FIGURES.still]


def text_of(page: str) -> str:
    """What a browser's search finds on a page."""
    return " ".join(re.sub("<[^>]*>", "", page.partition("</style>")[2]).replace("&#39;", "'").split())


def test_the_report_is_one_small_file_with_what_came_out_and_every_figure_in_the_order_of_its_category(smoke):
    report = (smoke.folder / SMOKE_REPORT).read_text(encoding="utf-8")
    assert len(report) < 10e6 and "name='viewport'" in report  # fits a phone
    assert not re.search(r"<(script|link|iframe)\b", report)
    assert set(re.findall(r"<img [^>]*src='([^:]*:)", report)) == {"data:"}
    headline = report.partition("<h1>")[2].partition("</h1>")[0]
    assert re.match(r"Crank [\d.]+\smm, rod [\d.]+\smm: error of the transmission angle [\d.]+\s% smaller$", headline)
    assert report.index("<h1>") < report.index("<img") < report.index("<h2")
    text = text_of(report)
    places = [text.index(f". {spec.title}. {spec.caption}") for spec in STILL]
    order = list(dict.fromkeys(spec.category for spec in STILL))
    by_category = sorted(zip([order.index(spec.category) for spec in STILL], places, strict=True))
    assert [place for _, place in by_category] == sorted(places)


def test_a_report_that_would_be_too_large_shows_some_figures_and_links_the_others(smoke, monkeypatch):
    config = read_yaml(smoke.folder / "config/config.yaml") | read_yaml(smoke.folder / "config/smoke.yaml")
    scenario = resolve(config, (smoke.folder,))["smoke"]
    folder = smoke.folder / "results"
    monkeypatch.setattr(report_page, "MOST_BYTES", 0)
    page = to_html(report_page.page({"smoke": ScenarioResults(folder / "smoke", scenario)}, [], folder), folder)
    assert page.count("<img") == 5
    linked = set(re.findall(r"href='\./(smoke/figures/[^']*\.png)'", page))
    assert len(linked) == len(FIGURES.still) - 4 and all((folder / path).is_file() for path in linked)
    assert all(spec.caption in text_of(page) for spec in STILL)
