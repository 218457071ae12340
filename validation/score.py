"""The score: each verdict against its sealed ground truth, one row a trial."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap.core.errors import InputError
from jointgap.core.formula import compile_formula
from jointgap.effects import EFFECTS
from jointgap.identification.confirmation import share_closed
from jointgap.identification.fit import LEVELS
from jointgap.rig.sensors import ENCODER_FAULTS, FAULTS
from validation.calibrate import GAP_TOLERANCE
from validation.effects import SHAPES
from validation.hide import formula_values

WITH_SITE = {name for name, page in EFFECTS.items() if page.sites()} | (FAULTS.keys() - set(ENCODER_FAULTS))
"""Effects whose site has to be right too."""

NOTHING_NAMED = ("no_disagreement", "parameters_only")
NAMED = ("named", "named_with_remaining_misfit")

LEAST_GAP = 1.5 * (1 - 2 * GAP_TOLERANCE)
"""A trial whose effect causes less, since it cannot be larger on any rig that was drawn, counts as undetectable."""

SAME_FORCE_RMS = 0.1
"""RMS share by which a discovered force may differ from the true one over the visited states."""

CLOSED_FROM_GAP = 1.5
"""Gap of the held-out run from which on the share of its excess that is closed says something."""

BASELINES = {"greedy": "greedy BIC", "sparse": "sparse regression"}
"""Methods beside the identification: the least BIC, one effect at a time; sparse regression of the residual."""


def score_trials(sealed: Path, verdicts: Path, trials: Iterable[str]) -> pd.DataFrame:
    """A row a trial (docs/blind.md) from the files ``{trial}.json`` of both folders."""
    return pd.DataFrame([score_trial(_read(sealed, trial), _read(verdicts, trial)) for trial in sorted(trials)])


def _read(folder: Path, trial: str) -> dict[str, Any]:
    path = folder / f"{trial}.json"
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}); run `make blind` again, which writes it") from error


def effect_label(effect: Mapping[str, Any]) -> str:
    """Name of an effect, with its site where there is a choice."""
    return f"{effect['name']}:{effect['site']}" if effect["name"] in WITH_SITE else effect["name"]


def named_labels(effects: Iterable[Mapping[str, Any]], hidden: frozenset[str]) -> frozenset[str]:
    """Labels of effects of a verdict; of a named family that of the `hidden` effect that lies in it, else its law's.

    An effect lies in it where the interval of the shape holds the one at which the law is that effect.
    """

    def holds(effect: Mapping[str, Any], family: Mapping[str, Any], label: str) -> bool:
        name, _, site = label.partition(":")
        low, high = family["interval_99"]
        return site in ("", effect["site"]) and low <= SHAPES.get((family["law"], name), math.nan) <= high

    def label(effect: Mapping[str, Any]) -> str:
        inside = {name for family in _families_named(effect) for name in hidden if holds(effect, family, name)}
        return min(inside, default=_name_stated(effect))

    return frozenset(map(label, effects))


def score_trial(truth: Mapping[str, Any], analysis: Mapping[str, Any]) -> dict[str, Any]:
    """One trial."""
    verdict, damaged = analysis.get("verdict"), truth.get("damage")
    hidden = frozenset(effect_label(effect) for effect in truth["effects"])
    idle = any(effect["idle"] for effect in truth["effects"])
    told = damaged is not None and _told(damaged["channels"], analysis)
    foreseen = verdict is not None and bool(hidden & set(verdict["preflight"]["undetectable"]))
    smallest = min(truth["gaps"], default=math.nan)
    row = {
        "id": truth["id"],
        "kind": truth["kind"],
        "base": truth["base"],
        "drive": truth.get("drive", "constant_speed"),
        "hidden": f"{damaged['what']}: {' + '.join(damaged['channels'])}" if damaged else _joined(hidden),
        "verdict": verdict["verdict"] if verdict else "failed",
        "named": "",
        "outcome": _outcome(truth, verdict, hidden, told),
        "size": truth["size"],
        "gap_caused": smallest,
        "numerics_gap": math.nan if truth["numerics_gap"] is None else truth["numerics_gap"],
        "detectable": bool(hidden) and not foreseen and not idle and not (verdict and smallest < LEAST_GAP),
        "idle": idle,
        "foreseen": foreseen,
        "told": told,
        "seconds": analysis.get("seconds", math.nan),
        "reason": analysis.get("error", ""),
    }
    for baseline in BASELINES:
        row[baseline] = _baseline_outcome(truth, hidden, analysis.get(baseline))
    numbers = ["error", *(f"covered_{level}" for level in LEVELS)]
    numbers += ["nuisances", *(f"nuisances_covered_{level}" for level in LEVELS), "gap_before", "gap_after", "closed"]
    row |= dict.fromkeys(numbers, math.nan)
    if verdict is None:
        return row
    row["named"] = " + ".join(sorted(map(_name_stated, verdict["effects"]))) or verdict["verdict"]
    row["reason"] = " or ".join(sorted(map(_joined, _equivalent(verdict)))) or verdict["because"]
    if damaged:
        return row
    if row["outcome"] == "right":
        row |= _size_errors(truth, verdict)
        if verdict["verdict"] != "ambiguous":
            row |= _nuisances_covered(truth, verdict)
    return row | _held_out_gaps(verdict)


def _joined(names: Iterable[str]) -> str:
    return " + ".join(sorted(names)) or "nothing"


def _families_named(effect: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [family for family in effect.get("families", ()) if family["named"]]


def _name_stated(effect: Mapping[str, Any]) -> str:
    """The label of an effect of a verdict, or the law of its family where one is named."""
    law = next((family["law"] for family in _families_named(effect)), effect["name"])
    return effect_label({**effect, "name": law})


def _is_fault_of(effect: Mapping, channels: Sequence[str]) -> bool:
    """Whether an effect named is a fault of the sensor of one of `channels`."""
    if effect["name"] in ENCODER_FAULTS:
        return "crank_angle" in channels
    return effect["name"] in FAULTS and effect["site"] in channels


def _told(damaged: Sequence[str], analysis: Mapping[str, Any]) -> bool:
    """Whether a damaged channel, of two swapped ones either, is told by a remark, a refusal or as a faulty sensor."""
    verdict, error = analysis.get("verdict"), analysis.get("error", "")
    doubted = {name for doubt in analysis.get("doubts", ()) for name in (doubt["channel"], doubt["other"])}
    named = [*verdict["effects"], *verdict["certain"]] if verdict else ()
    words = {word for name in damaged for word in (("time", "speed") if name == "time" else (name,))}
    refused = error.startswith("InputError") and any(word in error for word in words)
    return refused or bool(doubted & {*damaged}) or any(_is_fault_of(effect, damaged) for effect in named)


def _outcome(truth: Mapping, verdict: Mapping | None, hidden: frozenset[str], told: bool) -> str:
    """right, wrong, partly, ambiguous, unexplained, missed or failed.

    Of damaged data: wrong where anything but a fault of a damaged sensor is named or called certain, else right where
    the channel is told.
    """
    if verdict is None:
        return "right" if told else "failed"  # the files were refused for what is wrong with them
    kind, effects = verdict["verdict"], verdict["effects"]
    if "damage" in truth:
        if not all(_is_fault_of(effect, truth["damage"]["channels"]) for effect in (*effects, *verdict["certain"])):
            return "wrong"
        return "right" if told else "ambiguous" if kind == "ambiguous" else "missed"
    if kind in NOTHING_NAMED:
        return "missed" if hidden else "right"
    if kind == "unexplained":
        return "unexplained"
    if kind == "ambiguous":
        if not {effect_label(effect) for effect in verdict["certain"]} <= hidden:
            return "wrong"
        explanations = _equivalent(verdict)
        merged = [frozenset(group) for group in verdict["preflight"]["merged"]]
        foreseen = hidden in explanations and all(_inseparable(own, hidden, merged) for own in explanations)
        return "right" if foreseen else "ambiguous"
    named = named_labels(effects, hidden)
    if _is_off_list(truth):
        return "right" if named == hidden or _is_the_force(truth, verdict) else "wrong"
    return _outcome_of_names(hidden, named)


def _baseline_outcome(truth: Mapping, hidden: frozenset[str], named: Sequence[str] | None) -> str:
    """The outcome of a baseline method, which names effects or finds nothing; None where it was not asked."""
    if named is None:
        return "not asked"
    if not named:
        return "missed" if hidden else "right"
    return "wrong" if _is_off_list(truth) else _outcome_of_names(hidden, frozenset(named))


def _is_off_list(truth: Mapping) -> bool:
    """Whether an effect is hidden that no candidate is; some that were drawn as such have become candidates."""
    return not all(effect["listed"] for effect in truth["effects"])


def _outcome_of_names(hidden: frozenset[str], named: frozenset[str]) -> str:
    if named == hidden:
        return "right"
    return "partly" if named < hidden else "wrong"


def _equivalent(verdict: Mapping) -> list[frozenset[str]]:
    """The explanations that an ambiguous verdict holds to be equal; of other verdicts none."""
    explanations = verdict["equivalent"] if verdict["verdict"] == "ambiguous" else ()
    return [frozenset(effect_label(effect) for effect in explanation) for explanation in explanations]


def _inseparable(explanation: frozenset[str], hidden: frozenset[str], merged: Sequence[frozenset[str]]) -> bool:
    """Whether an explanation differs from the truth only by effects that preflight could not separate."""
    extra, absent = explanation - hidden, hidden - explanation
    return len(extra) == len(absent) and any(
        all(any({a, b} <= group for group in merged) for a, b in zip(extra, order, strict=True))
        for order in permutations(absent)
    )


def _is_the_force(truth: Mapping, verdict: Mapping) -> bool:
    """Whether the one effect named is a discovered force within `SAME_FORCE_RMS` of the true one."""
    force = truth["effects"][0].get("force")
    if force is None or len(verdict["effects"]) != 1 or verdict["effects"][0]["name"] != force["kind"]:
        return False
    parameters = verdict["effects"][0]["parameters"]
    coefficients = {key: entry["value"] for key, entry in parameters.items() if key != "formula"}
    program = compile_formula(parameters["formula"]["value"], coefficients)
    found, true = np.array(formula_values(program, list(force["states"].values()))), np.array(force["value"])
    return float(np.sqrt(np.mean((found - true) ** 2))) <= SAME_FORCE_RMS * float(np.sqrt(np.mean(true**2)))


def _size_errors(truth: Mapping, verdict: Mapping) -> dict[str, float]:
    """Relative error of the sizes of effects named right, and the share of them within their intervals.

    The size of an effect is its first parameter in the seal. One whose estimate has no interval, since it came to a
    bound, is not covered.
    """
    if verdict["verdict"] not in NAMED or _is_off_list(truth):
        return {}
    named = {effect_label(effect): effect["parameters"] for effect in verdict["effects"]}
    found: dict[str, list[float]] = {}
    for effect in truth["effects"]:
        key, true = next(iter(effect["parameters"].items()))
        estimate = named.get(effect_label(effect), {}).get(key)  # none where its family is named by another member
        if estimate is None or not true:
            continue
        found.setdefault("error", []).append(abs(estimate["value"] - true) / abs(true))
        for level in LEVELS:
            found.setdefault(f"covered_{level}", []).append(_holds(estimate, level, true) or 0.0)
    return {key: float(np.mean(values)) for key, values in found.items()}


def _nuisances_covered(truth: Mapping, verdict: Mapping) -> dict[str, float]:
    """How many nuisances have intervals, and how many true values lie in them."""
    known = truth.get("nuisances", {})
    stated = [(estimate, known[key]) for key, estimate in verdict.get("nuisances", {}).items() if key in known]
    counts = {}
    for level in LEVELS:
        inside = [held for estimate, true in stated if (held := _holds(estimate, level, true)) is not None]
        if inside:
            counts |= {"nuisances": float(len(inside)), f"nuisances_covered_{level}": sum(inside)}
    return counts


def _holds(estimate: Mapping, level: int, true: float) -> float | None:
    """Whether the interval of an estimate holds the true value, 1 or 0; None where none is stated."""
    low, high = estimate.get(f"interval_{level}") or (None, None)
    return None if low is None or high is None else float(low <= true <= high)


def _held_out_gaps(verdict: Mapping) -> dict[str, float]:
    """Gaps of the held-out run; where it cannot be simulated with what was named, none of its excess is closed."""
    gap = verdict["gap"].get("confirm") or {}
    before, after = (math.nan if gap.get(key) is None else gap[key] for key in ("before", "after"))
    closed = math.nan
    if before > CLOSED_FROM_GAP:
        closed = 0.0 if math.isnan(after) else share_closed(before, after)
    return {"gap_before": before, "gap_after": after, "closed": closed}
