"""Scores of blind trials in the dashboard."""

import json

import numpy as np
import pandas as pd
import pytest
from mlflow.tracking import MlflowClient

from jointgap.app.dashboard import addresses
from jointgap.core.errors import InputError
from jointgap.core.publish import publish_records
from tests.validation.test_score import analysis, scored, truth
from validation.__main__ import collect, report, score
from validation.report import DESCRIPTION, mlflow_records, write_score
from validation.score import BASELINES, rates


def made_up(right: int, count: int = 4) -> pd.DataFrame:
    """Trials with one effect each, of which the first `right` were named right, and one with nothing hidden."""
    rows = [{"kind": "single", "hidden": "gravity", "outcome": "right" if i < right else "wrong"} for i in range(count)]
    rows.append({"kind": "nothing", "hidden": "nothing", "outcome": "right"})
    numbers = ["error", "gap_caused", "gap_before", "gap_after", "closed", "nuisances"]
    numbers += [f"{found}_{end}" for found in ("map", "names") for end in ("hit", "false", "missed")]
    numbers += [f"{name}covered_{level}" for name in ("", "nuisances_") for level in (50, 90, 99)]
    text = dict.fromkeys(("verdict", "named", "cause", "reason", *BASELINES), "-") | {"drive": "constant_speed"}
    frame = pd.DataFrame([text | dict.fromkeys(numbers, 1.0) | {"numerics_gap": np.nan} | row for row in rows])
    flags = {"told": False, "foreseen": False, "detectable": frame["kind"] == "single"}
    names = [f"trial{i}" for i in frame.index]
    return frame.assign(id=names, base="ideal", size=5.0, seconds=2.0, **flags)


def published(results, name: str, right: int) -> dict:
    folder = results / "blind" / name / "score"
    write_score(name, made_up(right), folder)
    return publish_records(name, DESCRIPTION, mlflow_records(folder), None, results)


def test_the_command_scores_the_trials_of_a_folder_and_publishes_them(tmp_path):
    folder = tmp_path / "blind" / "small"
    scored(folder, [truth(name="a", kind="nothing")], [{**analysis(verdict="no_disagreement"), "id": "a"}])
    score("small", str(folder), "a")
    assert pd.read_csv(folder / "score/trials.csv")["outcome"].tolist() == ["right"]
    assert json.loads((folder / "score/published.json").read_text())["runs"]["blind"]["run_id"]


def test_every_figure_of_a_set_is_a_metric_and_what_it_took_is_a_cost(tmp_path):
    write_score("small", made_up(3), tmp_path)
    (record,) = mlflow_records(tmp_path)
    assert record.metrics["right name/all"] == 0.75
    assert record.metrics["right name/gap 5"] == 0.75
    assert record.metrics["trials/single"] == 4
    assert record.costs == {"seconds/median/base ideal": 2.0, "seconds/of 90 percent at most/base ideal": 2.0}
    assert len(record.metrics) + len(record.costs) == len(rates(made_up(3))) + 2  # and two kinds counted
    assert set(record.files) >= {"summary.md", "trials.csv", "confusion.csv", "figures/rates.svg", "figures/curves.png"}


def test_sets_stand_side_by_side_and_a_new_score_supersedes_the_old(tmp_path):
    results = tmp_path
    runs = {name: published(results, name, right)["runs"]["blind"] for name, right in (("small", 2), ("large", 4))}
    assert published(results, "small", 2)["runs"]["blind"] == runs["small"] | {"state": "kept"}
    client = MlflowClient(tracking_uri=f"sqlite:///{results / 'mlflow.db'}")
    found = {name: client.get_run(run["run_id"]).data.metrics for name, run in runs.items()}
    assert {name: metrics["right name/all"] for name, metrics in found.items()} == {"small": 0.5, "large": 1.0}
    address = addresses(f"sqlite:///{results / 'mlflow.db'}", "http://here")["scores of all blind trials"]
    (experiment,) = {client.get_run(run["run_id"]).info.experiment_id for run in runs.values()}
    assert f"experiments=%5B%22{experiment}%22%5D" in address
    assert published(results, "small", 3)["deleted"] == 1


def test_trials_are_collected_over_several_runs_of_one_version_and_reported(tmp_path):
    table, one, other = tmp_path / "trials.csv", tmp_path / "one", tmp_path / "other"
    scored(one, [truth(name="a", kind="nothing")], [{**analysis(verdict="no_disagreement"), "id": "a"}])
    scored(other, [truth(name="b", kind="nothing")], [{**analysis(verdict="no_disagreement"), "id": "b"}])
    collect(str(one), str(table), "v1")
    collect(str(other), str(table), "v1")
    collect(str(other), str(table), "v1")
    report("made up", str(table), str(tmp_path / "score"))
    assert pd.read_csv(table)["id"].tolist() == ["a", "b"]
    rates = pd.read_csv(tmp_path / "score/rates.csv").set_index(["what", "group"])["value"]
    assert rates["nothing found, nothing hidden", "all"] == 1.0
    with pytest.raises(InputError, match=r"trials of v1"):
        collect(str(one), str(table), "v2")
    with pytest.raises(InputError, match="no such file"):
        report("made up", str(tmp_path / "absent.csv"), str(tmp_path / "score"))
    with pytest.raises(InputError, match="holds no verdicts"):
        collect(str(tmp_path / "absent"), str(tmp_path / "new.csv"), "v1")
    assert not (tmp_path / "new.csv").exists()
