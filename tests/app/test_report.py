"""The report of a run links the results of other runs in the same folder."""

import os

from jointgap.app.report import page
from jointgap.core.page import Page, to_html, write_page


def test_a_report_lists_the_pages_of_other_runs_in_the_folder_the_newest_first(tmp_path):
    places = ["mine", "campaigns/rig", "mine/sweep", "mlflow-artifacts/campaign/1/artifacts"]
    for age, place in enumerate(places):
        (tmp_path / place).mkdir(parents=True)
        write_page(tmp_path / place / "summary", Page(f"Result < {age}", (), subject=place))
        os.utime(tmp_path / place / "summary.html", (1e9 - 1e5 * age, 1e9 - 1e5 * age))
    text = to_html(page({}, [], tmp_path), tmp_path)
    found = [text.index(f"href='./{place}/summary.html'") for place in places[:3]]
    assert found == sorted(found) and "mine: Result &lt; 0</a>, written on 9 September 2001" in text
    assert "mlflow" not in text.partition("Other results in this folder")[2].partition("<footer")[0]


def test_a_report_alone_in_its_folder_lists_nothing(tmp_path):
    assert "Other results" not in to_html(page({}, [], tmp_path), tmp_path)
