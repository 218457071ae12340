"""The harness finds what is planted: errors that nobody expects, hangs, too much memory, processes that die."""

import json
import os
import time

import pytest

from drills.__main__ import found, gone_through, page, replay
from drills.harness import ENDS, Complaint, Drill, Failure, Row, Sitting, Sweep, keep, unclear

PLANTED = {3: "KeyError", 5: "hang", 7: "memory", 9: "dies", 11: "wrong"}


def make(random):
    return {"draw": int(random.integers(10**9))}


def judge(case, folder):
    match PLANTED.get(case["draw"] % 13):
        case "KeyError":
            raise KeyError("planted")
        case "hang":
            time.sleep(60)
        case "memory":
            bytearray(10**10)
        case "dies":
            os._exit(139)
        case "wrong":
            return {"it is right": Complaint("another number", "7")}
    return {"it is right": None}


SWEEP = Sweep("planted", 60, make, judge, limit_s=1.0, memory_mb=200)


def test_every_planted_fault_is_found_and_the_other_cases_go_on():
    sitting = Sitting(seed=1)
    rows = SWEEP.run(sitting)
    draws = [make(sitting.random("planted", index))["draw"] % 13 for index in range(60)]
    kinds = {kind: count for row in rows for kind, count in row.kinds.items()}
    assert kinds["hangs"] == draws.count(5) > 0
    assert kinds["kills its process"] == draws.count(9) > 0
    assert kinds["another number"] == draws.count(11) > 0
    assert sum(count for kind, count in kinds.items() if kind.startswith("KeyError in")) == draws.count(3) > 0
    assert sum(count for kind, count in kinds.items() if kind.startswith("MemoryError in")) == draws.count(7) > 0
    assert sum(row.count for row in rows) == 60
    assert {row.what for row in rows} >= {"planted: it is right", f"planted: {ENDS}"}


def test_the_same_seed_makes_the_same_cases_and_another_one_others():
    for drill in ("configurations", "data_files", "formulas", "names"):
        module = __import__(f"drills.{drill}", fromlist=["make"])
        once, again, other = (module.make(Sitting(seed).random(drill, 4)) for seed in (0, 0, 1))
        assert json.dumps(once) == json.dumps(again)
        assert json.dumps(once) != json.dumps(other)


def test_inputs_of_failures_are_kept_some_of_each_kind_and_judged_again(tmp_path, capsys):
    failures = [Failure("it is right", Complaint("another number", "7"), n, {"draw": 11}) for n in range(5)]
    kept = keep("planted", [Row("planted: it is right", 5, failures)], 1, tmp_path)
    files = kept["planted", "another number"]
    assert len(files) == 3
    assert all(path.is_file() for path in files)
    assert not replay(files[:1], {"planted": SWEEP.drill()})
    assert "another number: 7" in capsys.readouterr().out
    mended = Sweep("planted", 1, make, lambda case, folder: {"it is right": None})
    assert replay(files[:1], {"planted": mended.drill()})


def test_a_failure_without_an_input_says_how_to_go_through_it_again(tmp_path, capsys):
    failure = Failure("?", Complaint("a publisher fails", "?"), 0, {})
    (file,) = keep("publishers", [Row("?", 1, [failure])], 7, tmp_path)["publishers", "a publisher fails"]
    assert not replay([file], {"publishers": Drill("publishers", lambda sitting: [])})
    assert "python -m drills publishers --seed 7" in capsys.readouterr().out


def test_the_table_says_what_failed_how_often():
    failure = Failure("?", Complaint("a | b", "?"), 0, {})
    text = page([Row("one: good", 10), Row("two: bad", 4, [failure, failure], seed=3)], {})
    assert "| one: good | 10 | 0 | 0 | 0 |" in text
    assert "| two: bad | 4 | 2 | 0 | 3 |" in text
    assert r"| 2 | two: a \| b |  |" in text


def test_all_drills_are_found():
    assert {
        "configurations",
        "data_files",
        "determinism",
        "formulas",
        "full_disk",
        "kills",
        "names",
        "publishers",
    } <= found().keys()


@pytest.mark.parametrize(
    ("message", "kind"),
    [
        ("", "says nothing"),
        ("mine.yaml: wrong\nsomewhere else: wrong", "does not name its file"),
        ("mine.yaml: \x1b[31mred", "a terminal obeys"),
        ("mine.yaml: Traceback (most recent call last)", "traceback"),
        ("mine.yaml: " + "x" * 3000, "more than 2000"),
    ],
)
def test_an_error_that_is_not_clear_is_told(message, kind):
    assert kind in unclear(message, "mine.yaml").kind


def test_a_clear_error_is_one():
    assert unclear("mine.yaml: key 'speed' is missing; add it", "mine.yaml") is None


def test_a_drill_that_breaks_off_is_a_failure_and_the_others_go_on(capsys):
    def broken(sitting):
        raise RuntimeError("planted")

    (row,) = gone_through(Drill("broken", broken), Sitting())
    assert row.failures[0].complaint == ("a drill breaks off", "planted")
    assert "RuntimeError: planted" in capsys.readouterr().err
