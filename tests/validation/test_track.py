"""Scores of blind trials in MLflow."""

import json

import numpy as np
import pandas as pd
import pytest

from jointgap.core.errors import InputError
from tests.validation.test_score import analysis, scored, truth
from validation.__main__ import collect, report, score
from validation.report import mlflow_records, write_score
from validation.score import rates


def made_up(right: int, count: int = 4) -> pd.DataFrame:
    """Trials with one effect each (the first `right` named right), and one without."""
    rows = [
        {"kind": "single", "hidden": "gravity", "outcome": "right" if i < right else "wrong"}
        for i in range(count)
    ]
    rows.append({"kind": "nothing", "hidden": "nothing", "outcome": "right"})
    numbers = ["error", "gap_caused", "gap_before", "gap_after", "closed", "nuisances"]
    numbers += [
        f"{found}_{end}" for found in ("map", "names") for end in ("hit", "false", "missed")
    ]
    numbers += [f"{name}covered_{level}" for name in ("", "nuisances_") for level in (50, 90, 99)]
    text = dict.fromkeys(("verdict", "named", "cause", "reason"), "-") | {"drive": "constant_speed"}
    frame = pd.DataFrame(
        [text | dict.fromkeys(numbers, 1.0) | {"numerics_gap": np.nan} | row for row in rows]
    )
    flags = {"told": False, "foreseen": False, "detectable": frame["kind"] == "single"}
    names = [f"trial{i}" for i in frame.index]
    return frame.assign(id=names, base="ideal", size=5.0, seconds=2.0, **flags)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Score of a set with three of four named right."""
    place = tmp_path_factory.mktemp("score")
    write_score("small", made_up(3), place)
    return place


def test_every_rate_is_a_metric_and_time_is_a_cost(folder):
    (record,) = mlflow_records(folder)
    assert record.metrics["right name/all"] == record.metrics["right name/gap 5"] == 0.75
    assert record.metrics["trials/single"] == 4
    costs = ("median", "of 90 percent at most")
    groups = ("all", "base ideal")
    assert record.costs == {f"seconds/{cost}/{group}": 2.0 for cost in costs for group in groups}
    # and two kinds counted
    assert len(record.metrics) + len(record.costs) == len(rates(made_up(3))) + 2
    files = {"summary.md", "trials.csv", "confusion.csv"}
    assert set(record.files) >= files | {"figures/rates.svg", "figures/curves.png"}


def test_a_set_without_goals_has_a_page(tmp_path):
    trials = made_up(3).assign(kind="counter", hidden="nothing")
    text = write_score("counters", trials, tmp_path)
    assert "| wrong name, truncating counter | all | 5 | 0.2 |" in text


def test_trials_are_scored_published_collected_and_reported(tmp_path):
    table, one, other = tmp_path / "trials.csv", tmp_path / "blind/one", tmp_path / "blind/other"
    for name, folder in (("a", one), ("b", other)):
        found = analysis(verdict="no_disagreement") | {"id": name, "code": "v1"}
        scored(folder, [truth(name=name, kind="nothing")], [found])
    for folder in (one, other, other):
        collect(str(folder), str(table))
    score("one", str(one), "a")
    assert pd.read_csv(one / "score/trials.csv")["outcome"].tolist() == ["right"]
    assert json.loads((one / "score/published.json").read_text())["runs"]["blind"]["run_id"]
    report("made up", str(table), str(tmp_path / "score"))
    assert pd.read_csv(table)["id"].tolist() == ["a", "b"]
    rates = pd.read_csv(tmp_path / "score/rates.csv").set_index(["what", "group"])["value"]
    assert rates["nothing found, nothing hidden", "all"] == 1.0
    newer = analysis(verdict="no_disagreement") | {"id": "a", "code": "v2"}
    scored(tmp_path / "newer", [truth(name="a", kind="nothing")], [newer])
    with pytest.raises(InputError, match=r"trials of v1 and v2"):
        collect(str(tmp_path / "newer"), str(table))
    with pytest.raises(InputError, match="no such file"):
        report("made up", str(tmp_path / "absent.csv"), str(tmp_path / "score"))
    with pytest.raises(InputError, match="holds no verdicts"):
        collect(str(tmp_path / "absent"), str(tmp_path / "new.csv"))
    assert not (tmp_path / "new.csv").exists()
