"""Score of answers to the benchmark: outcome by trial, and rates with 95 % intervals."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import pandas as pd
from pydantic import BaseModel, TypeAdapter

from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.files import write_text
from validation.rig import SHAPES
from validation.score import (
    NAMED,
    NOTHING_NAMED,
    effect_label,
    families_named,
    labels,
    name_stated,
    ratio_row,
    share_row,
)

PACKAGE = "jointgap"
"""Name of this package among the methods."""

OUTCOMES = ("right", "partly", "missed", "wrong", "abstained")

_TOLERANCE = 0.1  # relative, of a size, or of a shape given as a number


def score(folder: Path, trials: Sequence[str], costs: Mapping[str, Sequence[float]] = {}) -> str:
    """Score the files ``answers/{method}.json`` of a folder on its `trials`; the table as Markdown.

    Writes ``benchmark.md``, ``benchmark.csv`` with all rates, and ``benchmark_trials.csv``.
    `costs`: processor times [s] of the answers, by method.
    """
    truths = {name: read_truth(folder / "truth" / f"{name}.json") for name in trials}
    rows, trial_rows, rate_rows = [], [], []
    paths = sorted((folder / "answers").glob("*.json"), key=_package_first)
    if not paths:
        raise InputError(f"{folder}: has no answers/METHOD.json; `benchmark run` writes some")
    for path in paths:
        answers, method = read_answers(path), path.stem
        if unknown := [name for name in answers if not (folder / f"truth/{name}.json").is_file()]:
            raise InputError(
                f"{path}: {unknown[0]} is no trial; {did_you_mean(unknown[0], truths)}"
            )
        scored = pd.DataFrame(
            [score_answer(truth, answers.get(name, Answer())) for name, truth in truths.items()]
        )
        rate = rates(scored)
        rows.append(_row(method, rate, costs.get(method, ())))
        trial_rows.append(scored.assign(method=method))
        rate_rows.append(rate.assign(method=method))
    for name, frames in (("benchmark_trials", trial_rows), ("benchmark", rate_rows)):
        table = pd.concat(frames).set_index("method").reset_index()
        write_text(folder / f"{name}.csv", table.to_csv(index=False, float_format="%.6g"))
    text = f"{len(truths)} campaigns; shares with 95 % intervals\n\n{_markdown(rows)}"
    write_text(folder / "benchmark.md", text)
    return text


def _package_first(path: Path) -> tuple[bool, str]:
    return path.stem != PACKAGE, path.stem


def read_truth(path: Path) -> dict[str, Any]:
    """The ground truth of a trial."""
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}); `benchmark draw` writes it") from error


_COLUMNS = {
    **{outcome: (outcome, "all") for outcome in OUTCOMES},
    "false alarms": ("false alarm, nothing hidden", "all"),
    **{of: (of, "all") for of in ("precision", "recall", "F1")},
}


def _row(method: str, rate: pd.DataFrame, seconds: Sequence[float]) -> dict[str, str]:
    by_name = rate.set_index(["what", "group"])
    row = {"method": method}
    for column, key in _COLUMNS.items():
        row[column] = ""
        if key in by_name.index:
            found = by_name.loc[key]
            row[column] = f"{found['value']:.2f} ({found['low']:.2f} - {found['high']:.2f})"
    row["CPU-s, median"] = f"{median(seconds):.1f}" if seconds else ""
    return row


def _markdown(rows: Sequence[Mapping[str, str]]) -> str:
    head = list(rows[0])
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *(list(row.values()) for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def answer_of_verdict(verdict: Mapping[str, Any] | None) -> Any:
    """Named effects with sizes; [] if nothing is missing; None without a decision."""
    if verdict is None or verdict["verdict"] not in NAMED:
        return [] if verdict and verdict["verdict"] in NOTHING_NAMED else None
    effects = verdict["effects"]
    size = {
        effect_label(effect): {key: found["value"] for key, found in effect["parameters"].items()}
        for effect in effects
    }
    size |= {
        name_stated(effect): {"shape": family["interval_99"]}
        for effect in effects
        for family in families_named(effect)
    }
    return {"named": sorted(map(name_stated, effects)), "size": size}


class Answer(BaseModel, extra="forbid"):
    """Answer of a method for one campaign; named is None if it abstains."""

    named: list[str] | None = None
    size: dict[str, dict[str, Any]] = {}


def read_answers(path: Path) -> dict[str, Answer]:
    """Answers by trial."""
    try:
        content = TypeAdapter(dict[str, Answer | list[str] | None]).validate_json(path.read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: give a list of labels, null, or named and size by trial id: {error}"
        ) from error
    return {
        trial: own if isinstance(own, Answer) else Answer(named=own)
        for trial, own in content.items()
    }


def score_answer(truth: Mapping[str, Any], answer: Answer) -> dict[str, Any]:
    """The row of one trial."""
    hidden, listed = labels(truth["effects"]), all(effect["listed"] for effect in truth["effects"])
    labels_named, size = answer.named, answer.size
    named = frozenset(
        _hidden_shape(label, size.get(label, {}), hidden) for label in labels_named or ()
    )
    channels = truth["damage"]["channels"] if "damage" in truth else ()
    encoder = "encoder_" if "crank_angle" in channels else "-"
    # reported, not wrong
    named -= {one for one in named if one.partition(":")[2] in channels or one.startswith(encoder)}
    if labels_named is None:
        outcome = "abstained"
    elif named == hidden:
        outcome = "right"
    else:
        outcome = "missed" if not named else "partly" if named < hidden else "wrong"
    return {
        **{key: truth[key] for key in ("id", "kind", "base", "drive")},
        "hidden": " + ".join(sorted(hidden)) or "nothing",
        "named": "" if labels_named is None else " + ".join(sorted(labels_named)) or "nothing",
        "outcome": outcome,
        "names_hit": len(named & hidden),
        "names_false": len(named - hidden),
        "names_missed": len(hidden - named) if listed else 0,
        "size_error": _size_error(truth, size) if outcome == "right" and listed else math.nan,
    }


def _hidden_shape(label: str, values: Mapping[str, Any], hidden: frozenset[str]) -> str:
    """The hidden effect that a named law is at the given shape (a number or [low, high]); else the
    label."""
    shape, (law, _, site) = values.get("shape"), label.partition(":")
    if law not in SHAPES or shape is None:
        return label
    low, high = (
        shape
        if isinstance(shape, list)
        else sorted((shape * (1 - _TOLERANCE), shape * (1 + _TOLERANCE)))
    )
    members = {
        one: SHAPES[law].get(one.partition(":")[0])
        for one in hidden
        if one.partition(":")[2] == site
    }
    inside = [one for one, own in members.items() if own is not None and low <= own <= high]
    return min(inside, default=label)


def _size_error(truth: Mapping[str, Any], size: Mapping[str, Any]) -> float:
    """Largest relative error of the sizes (first parameters); NaN if none is given."""
    pairs = [
        (next(iter(one["parameters"].items())), size.get(effect_label(one), {}))
        for one in truth["effects"]
    ]
    errors = [
        abs(own[key] / true - 1)
        for (key, true), own in pairs
        if isinstance(own.get(key), int | float) and true
    ]
    return max(errors, default=math.nan)


def rates(trials: pd.DataFrame) -> pd.DataFrame:
    """Shares of outcomes by kind and base, false alarms, sizes, precision, recall and F1."""
    groups = [("all", trials), *trials.groupby("kind"), *trials.groupby("base")]
    empty = trials.query("hidden == 'nothing' and kind != 'wiring'")
    shares = {
        (what, group): (part["outcome"] == what).to_numpy()
        for group, part in groups
        for what in OUTCOMES
    }
    shares["false alarm, nothing hidden", "all"] = (empty["outcome"] == "wrong").to_numpy()
    shares["size within 10 %", "all"] = (trials["size_error"].dropna() <= _TOLERANCE).to_numpy()
    rows = [
        {"what": what, "group": group, **share_row(hits.sum(), hits.size)}
        for (what, group), hits in shares.items()
    ]
    rows += [
        {"what": of, "group": "all", **ratio_row(trials, "names", of)}
        for of in ("precision", "recall", "F1")
    ]
    return pd.DataFrame([row for row in rows if row["count"]])
