"""The benchmark: files without ground truth, and its score."""

import json
import re
import shutil
import zipfile
from collections import Counter
from pathlib import Path

import pandas as pd
import pytest

from jointgap.core.errors import InputError
from validation.benchmark.draw import answers, draw
from validation.benchmark.score import Answer, score, score_answer
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


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Two campaigns without effects."""
    folder = tmp_path_factory.mktemp("benchmark")
    sets = folder / "sets.yaml"
    sets.write_text("sets:\n  published: {seed: 5, nothing: 2}\n")
    draw(folder, 2, cores=1, sets=str(sets))
    return folder, sets


def test_benchmark_campaigns_are_plain_files_without_the_truth(drawn):
    folder, _ = drawn
    files = sorted(path for path in (folder / "campaigns").rglob("*") if path.is_file())
    runs = {"run1.csv", "run2.csv", "run3.csv"}
    assert {path.name for path in files} == {"campaign.yaml", "mechanism.yaml"} | runs
    assert len(files) == 10
    assert len({path.stat().st_mtime for path in files}) == 1
    with zipfile.ZipFile(folder / "truth.zip") as archive:
        truths = [json.loads(archive.read(name)) for name in archive.namelist()]
    assert {one["id"] for one in truths} == {path.name for path in (folder / "campaigns").iterdir()}
    assert all(one["effects"] == [] for one in truths)


def test_an_interrupted_draw_resumes_with_the_same_files(drawn):
    folder, sets = drawn
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    shutil.rmtree(next((folder / "campaigns").iterdir()))
    draw(folder, 2, cores=1, sets=str(sets))
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_the_readme_lists_kinds_and_labels():
    kinds = Counter(
        trial.kind for trial in plan_trials(read_set("config/blind.yaml", "published"), 100)
    )
    text = Path("validation/benchmark/README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \|", text, re.MULTILINE)
    assert {kind: int(count) for kind, count in rows} == kinds
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


def test_answers_are_scored_with_intervals(tmp_path):
    truths = [truth(DRAG, name="a"), truth(DRAG, name="b")]
    truths += [truth(kind="nothing", name="c"), truth(GAIN, name="d")]
    with zipfile.ZipFile(tmp_path / "truth.zip", "w") as archive:
        for one in truths:
            archive.writestr(f"{one['id']}.json", json.dumps(one))
    size = {"slider_quadratic_drag": {"drag_N_s2_m2": 2.02}}
    said = {"a": {"named": list(size), "size": size}, "b": ["gravity"], "c": ["slider_sprung"]}
    (tmp_path / "answers.json").write_text(json.dumps(said))
    text = score(tmp_path / "answers.json", tmp_path / "truth.zip", tmp_path / "score")
    assert "no labels of the list: slider_sprung" in text
    table = pd.read_csv(tmp_path / "score/rates.csv").set_index(["what", "group"])
    right = table.loc[("right", "single")]
    assert (right["count"], right["value"]) == (3, pytest.approx(1 / 3, rel=1e-4))
    wanted = {"abstained": 0.25, "false alarm, nothing hidden": 1.0, "size within 10 %": 1.0}
    wanted |= {"precision": 1 / 3, "recall": 1 / 3}
    assert {what: table.loc[(what, "all"), "value"] for what in wanted} == pytest.approx(
        wanted, rel=1e-4
    )
    assert table.loc[("right", "all"), "low"] < 0.25 < table.loc[("right", "all"), "high"]


@pytest.mark.parametrize(
    "content", ['["a"]', '{"a": "gravity"}', '{"a": {"name": []}}', '{"z": []}', "{"]
)
def test_answers_that_cannot_be_read_are_refused(tmp_path, content):
    with zipfile.ZipFile(tmp_path / "truth.zip", "w") as archive:
        archive.writestr("a.json", json.dumps(truth(DRAG)))
    (tmp_path / "answers.json").write_text(content)
    with pytest.raises(InputError):
        score(tmp_path / "answers.json", tmp_path / "truth.zip", tmp_path / "score")


def test_answers_come_from_verdicts_and_from_peers(tmp_path):
    estimate = {"drag_N_s2_m2": {"value": 2.1}}
    drag = {"name": "slider_quadratic_drag", "site": "slider", "parameters": estimate}
    family = {"named": True, "law": "slider_power_drag", "interval_99": [1.7, 2.4]}
    records = {
        "a": {"verdict": {"verdict": "named", "effects": [drag]}, "greedy": ["gravity"]},
        "b": {"verdict": {"verdict": "no_disagreement", "effects": []}, "greedy": []},
        "c": {"verdict": {"verdict": "ambiguous", "effects": []}},
        "d": {"error": "InputError"},
        "e": {"verdict": {"verdict": "named", "effects": [drag | {"families": [family]}]}},
    }
    for name, record in records.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(record))
    found = answers(tmp_path)
    size = {"slider_quadratic_drag": {"drag_N_s2_m2": 2.1}}
    assert found["a"] == {"named": ["slider_quadratic_drag"], "size": size}
    assert [found[name] for name in "bcd"] == [[], None, None]
    assert row(truth(DRAG), found["e"]["named"], **found["e"]["size"])["outcome"] == "right"
    greedy = answers(tmp_path, "greedy")
    assert [greedy[name] for name in "abcde"] == [["gravity"], [], None, None, None]
