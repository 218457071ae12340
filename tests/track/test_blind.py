"""Scores of blind trials in the dashboard."""

import json

import pandas as pd
import pytest
from click.testing import CliRunner

from jointgap import tables
from jointgap.app.cli import cli
from jointgap.core.errors import InputError
from jointgap.track.dashboard import addresses
from jointgap.trials.score import TRIALS
from jointgap.trials.trials_report import mlflow_records, rates


def made_up(right: int, count: int = 4) -> pd.DataFrame:
    """Trials with one effect each, of which the first `right` were named right, and one with nothing hidden."""
    rows = [{"kind": "single", "hidden": "gravity", "outcome": "right" if i < right else "wrong"} for i in range(count)]
    rows.append({"kind": "nothing", "hidden": "nothing", "outcome": "right"})
    numbers = {column.name: 1.0 for column in TRIALS.columns if column.kind == "float"}  # every figure is known
    text = {column.name: "-" for column in TRIALS.columns if column.kind == "text"}
    frame = pd.DataFrame([text | numbers | {"base": "ideal", "size": 5.0, "seconds": 2.0} | row for row in rows])
    return frame.assign(
        detectable=frame["kind"] == "single",
        told=False,
        foreseen=False,
        idle=False,
        id=[f"trial{i}" for i in frame.index],
    )


def scored(folder, trials: pd.DataFrame):
    """What the scoring leaves behind."""
    tables.write(TRIALS, trials, folder / "trials.parquet")
    (folder / "summary.md").write_text("in words")
    (folder / "rates.svg").write_text("<svg/>")
    return folder


def published(results, name: str, right: int) -> dict:
    folder = results / "blind" / name / "score"
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "published.json"
    given = ["--set", name, "--folder", scored(folder, made_up(right)), "--store", results, "--published", file]
    CliRunner().invoke(cli, ["blind-track", *map(str, given)], catch_exceptions=False)
    return json.loads(file.read_text())


def test_every_figure_of_a_set_is_a_metric_and_what_it_took_is_a_cost(tmp_path):
    (record,) = mlflow_records(scored(tmp_path, made_up(3)))
    assert record.metrics["right name/all"] == 0.75
    assert record.metrics["right name/gap 5"] == 0.75
    assert record.metrics["trials/single"] == 4
    assert record.costs == {"seconds/median/base ideal": 2.0, "seconds/of 90 percent at most/base ideal": 2.0}
    assert len(record.metrics) + len(record.costs) == len(rates(made_up(3))) + 2  # and two kinds counted
    assert set(record.files) == {"summary.md", "figures/rates.svg"}


def test_sets_stand_side_by_side_and_a_new_score_supersedes_the_old(results, client):
    runs = {name: published(results, name, right)["runs"]["blind"] for name, right in (("small", 2), ("large", 4))}
    assert published(results, "small", 2)["runs"]["blind"] == runs["small"] | {"state": "kept"}
    found = {name: client.get_run(run["run_id"]).data.metrics for name, run in runs.items()}
    assert {name: metrics["right name/all"] for name, metrics in found.items()} == {"small": 0.5, "large": 1.0}
    address = addresses(f"sqlite:///{results / 'mlflow.db'}", "http://here")["scores of all blind trials"]
    (experiment,) = {client.get_run(run["run_id"]).info.experiment_id for run in runs.values()}
    assert f"experiments/{experiment}/" in address
    assert published(results, "small", 3)["deleted"] == 1


def test_a_set_that_was_not_scored_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"trials\.parquet"):
        mlflow_records(tmp_path)
