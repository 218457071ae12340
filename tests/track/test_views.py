"""How MLflow's pages show a stage: a description and a view that is kept as a tag of the experiment."""

import base64
import json
import zlib

import pytest

from jointgap.track.experiment_views import KEY, NOTE, TAG, VIEWS
from jointgap.track.mlflow_store import default_address, opened
from tests.track.conftest import client_of, not_held

ROOM = 5000  # [characters] that MLflow keeps of a tag


def state(text: str) -> dict:
    kind, _, packed = text.partition(";")
    assert kind == "deflate"
    return json.loads(zlib.decompress(base64.b64decode(packed)))


@pytest.mark.parametrize("stage", VIEWS)
def test_a_view_fits_into_a_tag_and_each_chart_stands_in_a_section(stage):
    text = VIEWS[stage].state()
    assert len(text) <= ROOM
    view = state(text)
    sections = {section["uuid"] for section in view["compareRunSections"]}
    assert {chart["metricSectionId"] for chart in view["compareRunCharts"]} <= sections
    names = [chart["uuid"] for chart in view["compareRunCharts"]]
    assert len(set(names)) == len(names)


def test_columns_and_charts_of_a_view_are_what_runs_hold(two_scenarios):
    client = client_of(two_scenarios["paper"]["given"]["results_folder"])
    shown = {stage: run for stage, run in two_scenarios["paper"]["runs"].items() if stage in VIEWS}
    assert {"simulate", "surrogate", "optimise"} <= shown.keys()
    for stage, run in shown.items():
        missing = not_held(VIEWS[stage], client.get_run(run["run_id"]))
        assert {name for name in missing if "crank_pivot" not in name and not name.endswith(_OF_PIVOT)} == set()


_OF_PIVOT = ("r1", "gamma1", "r1_dot", "gamma1_dot", "r1_ddot", "gamma1_ddot")  # ideal in these scenarios


def test_an_experiment_carries_view_and_description_and_a_note_of_ones_own_stays(two_scenarios, new_results):
    client = client_of(two_scenarios["paper"]["given"]["results_folder"])
    tags = client.get_experiment_by_name("jointgap-optimise").tags
    assert tags[TAG] == VIEWS["optimise"].state() and tags[NOTE] == VIEWS["optimise"].note
    assert TAG.endswith(KEY)
    results = new_results()
    with opened(default_address(results), results) as store:
        experiment = store.experiment("optimise")
        store.describe(experiment, {"view": "new"}, {NOTE: "ours"})
        store.describe(experiment, {"view": "newer"}, {NOTE: "another"})
    tags = client_of(results).get_experiment(experiment).tags
    assert tags["view"] == "newer" and tags[NOTE] == "ours"
