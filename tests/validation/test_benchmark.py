"""The benchmark: files without ground truth, and its score."""

import json
import re
from collections import Counter
from functools import partial
from pathlib import Path

import pandas as pd
import pytest

from jointgap.core.errors import InputError
from validation.benchmark import greedy, optimiser, run, sparse
from validation.benchmark.score import Answer, answer_of_verdict, score, score_answer
from validation.kinds import plan_trials, read_set
from validation.rig import LABELS


def effect(name, site="slider", listed=True, **parameters) -> dict:
    return {"name": name, "site": site, "listed": listed, "parameters": parameters}


DRAG = effect("slider_quadratic_drag", drag_N_s2_m2=2.0)
GAIN = effect("sensor_gain", "crank_torque", gain=0.1)
FIFTH = effect("fifth_power_drag", listed=False, s=2.0)


def truth(*effects, kind="single", name="a", **more) -> dict:
    common = {"id": name, "kind": kind, "base": "ideal", "drive": "constant_speed"}
    return common | {"gaps": [3.0] * len(effects), "effects": list(effects)} | more


def damaged(channel) -> dict:
    return truth(kind="wiring", damage={"channels": [channel]})


def row(true, named, **size) -> dict:
    return score_answer(true, Answer(named=named, size=size))


def test_the_readme_lists_kinds_and_labels():
    plans = plan_trials(read_set(run.SETS, run.SET))
    text = Path("validation/benchmark/README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \|", text, re.MULTILINE)
    assert {kind: int(count) for kind, count in rows} == Counter(plan.kind for plan in plans)
    for label in LABELS:
        assert f"`{label.partition(':')[0] if label.startswith('sensor') else label}`" in text


@pytest.mark.parametrize(
    "true, named, outcome",
    [
        (truth(DRAG), ["slider_quadratic_drag"], "right"),
        (truth(DRAG), ["gravity"], "wrong"),
        (truth(DRAG), ["slider_quadratic_drag", "gravity"], "wrong"),
        (truth(DRAG), [], "missed"),
        (truth(DRAG), None, "abstained"),
        (truth(GAIN), ["sensor_gain:crank_torque"], "right"),
        (truth(GAIN), ["sensor_gain:guide_force"], "wrong"),
        (truth(DRAG, GAIN, kind="pair"), ["slider_quadratic_drag"], "partly"),
        (truth(kind="nothing"), [], "right"),
        (truth(kind="nothing"), ["gravity"], "wrong"),
        (truth(FIFTH, kind="off_list"), ["slider_quadratic_drag"], "wrong"),
        (truth(FIFTH, kind="off_list"), None, "abstained"),
        (damaged("crank_torque"), ["sensor_gain:crank_torque"], "right"),
        (damaged("crank_torque"), ["sensor_gain:guide_force"], "wrong"),
        (damaged("crank_angle"), ["encoder_offset"], "right"),
    ],
)
def test_outcomes_of_answers(true, named, outcome):
    assert row(true, named)["outcome"] == outcome


def test_a_law_family_is_right_at_the_shape_of_the_hidden_effect():
    fifth = truth(FIFTH, kind="off_list")
    for true, shape, outcome in (
        (truth(DRAG), 2.05, "right"),
        (truth(DRAG), [1.8, 2.1], "right"),
        (truth(DRAG), 3.0, "wrong"),
        (truth(DRAG), None, "wrong"),
        (fifth, [4.5, 5.5], "right"),
    ):
        answer = row(true, ["slider_power_drag"], slider_power_drag={"shape": shape})
        assert answer["outcome"] == outcome
    found = row(truth(DRAG), ["slider_quadratic_drag"], slider_quadratic_drag={"drag_N_s2_m2": 2.5})
    assert found["size_error"] == pytest.approx(0.25)


def write(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def write_truths(folder: Path, *truths: dict) -> list[str]:
    for known in truths:
        write(folder / "truth" / f"{known['id']}.json", known)
    return [known["id"] for known in truths]


def test_answers_are_scored_with_intervals(tmp_path):
    names = write_truths(
        tmp_path,
        *(truth(DRAG, name="a"), truth(DRAG, name="b")),
        *(truth(kind="nothing", name="c"), truth(GAIN, name="d")),
    )
    size = {"slider_quadratic_drag": {"drag_N_s2_m2": 2.02}}
    said = {"a": {"named": list(size), "size": size}, "b": ["gravity"], "c": ["slider_sprung"]}
    write(tmp_path / "answers/theirs.json", said)
    write(tmp_path / "answers/jointgap.json", {"a": ["slider_quadratic_drag"], "c": []})
    text = score(tmp_path, names, {"theirs": [3.0, 4.0, 9.0]})
    assert text == (tmp_path / "benchmark.md").read_text()
    lines = [line.split(" | ") for line in text.splitlines()[-2:]]
    assert [line[0] for line in lines] == ["| jointgap", "| theirs"]
    assert lines[1][1].startswith("0.25 (0.01 - 0.81)") and lines[1][-1] == "4.0 |"
    rates = pd.read_csv(tmp_path / "benchmark.csv").set_index(["method", "what", "group"])
    table = rates.loc["theirs"]
    right = table.loc[("right", "single")]
    assert (right["count"], right["value"]) == (3, pytest.approx(1 / 3, rel=1e-4))
    wanted = {"abstained": 0.25, "false alarm, nothing hidden": 1.0, "size within 10 %": 1.0}
    wanted |= {"precision": 1 / 3, "recall": 1 / 3}
    assert {what: table.loc[(what, "all"), "value"] for what in wanted} == pytest.approx(
        wanted, rel=1e-4
    )
    assert table.loc[("right", "all"), "low"] < 0.25 < table.loc[("right", "all"), "high"]
    assert rates.loc[("jointgap", "right", "all"), "value"] == 0.5


@pytest.mark.parametrize(
    "content", ['["a"]', '{"a": "gravity"}', '{"a": {"name": []}}', '{"z": []}', "{"]
)
def test_answers_that_cannot_be_read_are_refused(tmp_path, content):
    names = write_truths(tmp_path, truth(DRAG))
    with pytest.raises(InputError, match=r"no answers/METHOD\.json"):
        score(tmp_path, names)
    (tmp_path / "answers").mkdir()
    (tmp_path / "answers/mine.json").write_text(content)
    with pytest.raises(InputError, match=r"mine\.json"):
        score(tmp_path, names)


def test_a_verdict_is_an_answer():
    estimate = {"drag_N_s2_m2": {"value": 2.1}}
    drag = {"name": "slider_quadratic_drag", "site": "slider", "parameters": estimate}
    family = {"named": True, "law": "slider_power_drag", "interval_99": [1.7, 2.4]}
    size = {"slider_quadratic_drag": {"drag_N_s2_m2": 2.1}}
    for verdict, answer in (
        (
            {"verdict": "named", "effects": [drag]},
            {"named": ["slider_quadratic_drag"], "size": size},
        ),
        ({"verdict": "no_disagreement", "effects": []}, []),
        ({"verdict": "ambiguous", "effects": []}, None),
        (None, None),
    ):
        assert answer_of_verdict(verdict) == answer
    found = answer_of_verdict({"verdict": "named", "effects": [drag | {"families": [family]}]})
    assert row(truth(DRAG), found["named"], **found["size"])["outcome"] == "right"


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    """Two trials of a set, drawn."""
    folder = tmp_path_factory.mktemp("benchmark")
    sets = folder / "sets.yaml"
    sets.write_text("sets:\n  small: {seed: 5, nothing: 2}\n")
    return read_set(sets, "small"), plan_trials(read_set(sets, "small"))


def peer_of(name, campaign, analysis):
    return {"greedy": ["gravity"], "sparse": [], "optimiser": None, "network": []}[name]


def test_one_command_asks_all_methods_and_resumes(plans, tmp_path, monkeypatch):
    trial_set, trials = plans
    for method, name in ((greedy, "greedy"), (sparse, "sparse"), (optimiser, "optimiser")):
        monkeypatch.setattr(method, "answer", partial(peer_of, name))
    monkeypatch.setattr(run, "answer", lambda model, *rest: peer_of("network", *rest))
    write(tmp_path / "training/model.pt", {})
    write_truths(tmp_path, *(truth(kind="nothing", name=trial.id) for trial in trials))
    for trial in trials:
        (tmp_path / "campaigns" / trial.id).mkdir(parents=True)
        record = {"verdict": {"verdict": "no_disagreement", "effects": []}, "seconds": 12.0}
        write(tmp_path / f"verdicts/{trial.id}.json", {"id": trial.id, **record})
    arguments = (trials, trial_set, tmp_path, tmp_path / "training", 3, 60.0, 1)
    text = run.run(*arguments)
    lines = {line.split()[1]: line for line in text.splitlines()[4:]}
    assert list(lines) == ["jointgap", "greedy", "network", "optimiser", "sparse"]
    rates = pd.read_csv(tmp_path / "benchmark.csv").set_index(["method", "what", "group"])["value"]
    for outcome, methods in (
        ("right", ["jointgap", "sparse", "network"]),
        ("wrong", ["greedy"]),
        ("abstained", ["optimiser"]),
    ):
        assert all(rates.loc[(method, outcome, "all")] == 1.0 for method in methods)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("peers/*/*.json")}
    assert len(before) == 8
    assert run.run(*arguments) == text
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("peers/*/*.json")} == before
