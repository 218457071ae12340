"""Score of answers to the benchmark: outcome by trial, and rates with 95 % intervals."""

import json
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from pydantic import BaseModel, TypeAdapter

from jointgap.core.errors import InputError, did_you_mean
from validation.rig import LABELS, SHAPES
from validation.score import effect_label, labels, ratio_row, share_row

OUTCOMES = ("right", "partly", "missed", "wrong", "abstained")

_TOLERANCE = 0.1  # relative, of a size, or of a shape given as a number


def score(answers_file: Path, truth_file: Path, folder: Path) -> str:
    """Write trials.csv and rates.csv to `folder`; the rates as text."""
    answers = read_answers(answers_file)
    with zipfile.ZipFile(truth_file) as archive:
        truths = {
            name.removesuffix(".json"): json.loads(archive.read(name))
            for name in archive.namelist()
        }
    if unknown := sorted(answers.keys() - truths.keys()):
        raise InputError(
            f"{answers_file}: {unknown[0]} is no trial; {did_you_mean(unknown[0], truths)}"
        )
    trials = pd.DataFrame(
        [score_answer(truth, answers.get(name, Answer())) for name, truth in sorted(truths.items())]
    )
    table = rates(trials)
    folder.mkdir(parents=True, exist_ok=True)
    for name, frame in {"trials": trials, "rates": table}.items():
        frame.to_csv(folder / f"{name}.csv", index=False, float_format="%.6g")
    labels_named = {label for answer in answers.values() for label in answer.named or ()} - {
        *LABELS
    }
    strange = {label for label in labels_named if not SHAPES.get(label.partition(":")[0])}
    note = f"\nno labels of the list: {', '.join(sorted(strange))}" if strange else ""
    return table.to_string(index=False, float_format="{:.3f}".format) + note


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
