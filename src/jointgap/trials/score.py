"""The score: each verdict against its sealed truth, as the table of trials."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap.campaign.sentences import is_told_by_features
from jointgap.core.errors import InputError
from jointgap.effects import EFFECTS
from jointgap.formula import compile_formula
from jointgap.identification.confirmation import share_closed
from jointgap.identification.fit import LEVELS
from jointgap.rig.sensors import ENCODER_FAULTS, FAULTS
from jointgap.tables.columns import Column, Table
from jointgap.trials.batches import read_trial_records
from jointgap.trials.causes import cause, has_idle_effect
from jointgap.trials.injected_effects import SHAPES
from jointgap.trials.make_trial import ANGLE_PIECES, formula_values
from jointgap.trials.size_calibration import GAP_TOLERANCE

WITH_SITE = {name for name, page in EFFECTS.items() if page.sites()} | (FAULTS.keys() - set(ENCODER_FAULTS))
"""Effects whose site has to be right too."""

NOTHING_NAMED = ("no_disagreement", "parameters_only")
NAMED = ("named", "named_with_remaining_misfit")

LEAST_GAP = 1.5 * (1 - 2 * GAP_TOLERANCE)
"""A trial whose effect causes less, since it cannot be larger on any rig that was drawn, counts as undetectable."""

FALSE_WINDOW_RMS = 0.1
"""Noise-free difference over the noise below which a window of the map is false: nobody could see it in the samples."""

MISSED_BIN_RMS = 0.5
"""Noise-free difference over the noise above which a bin outside of all windows counts as missed."""

SAME_FORCE_RMS = 0.1
"""RMS share by which a discovered force may differ from the true one over the visited states."""

CLOSED_FROM_GAP = 1.5
"""Gap of the held-out run from which on the share of its excess that is closed says something."""

_BIN_DEG = 10  # [deg] width of a bin of the map of disagreement

BASELINES = {
    "greedy": "greedy BIC",
    "sparse": "sparse regression",
    "statistics": "statistics alone",
    "samples": "samples alone",
}
"""Methods beside the naming, by the key of the analysis' record that holds the names they give: the least BIC, one
effect at a time, without a gate; sparse regression of the residual; of what was fitted the best features of the cycle,
without a gate; and the naming without what it decides by features (from its verdict)."""

_TEXT = {
    "id": "the campaign's name",
    "kind": "nothing, single, pair, off_list, exudyn (nothing or single, by independent code), clearance (single), or "
    "wiring (the data damaged)",
    "base": "ideal joints, loose joints with friction, or a chaotic motion",
    "drive": "of the campaign: constant_speed, or measured_angle",
    "hidden": "effects hidden; of the kind wiring: what was damaged, of which channel",
    "verdict": "verdict, or failed",
    "named": "effects named, or the verdict",
    "outcome": "right, wrong, partly, ambiguous, unexplained, missed or failed; of the kind wiring wrong where "
    "anything but a fault of a damaged sensor is named, else right where the channel is told",
    **{
        column: meaning
        for name, method in BASELINES.items()
        for column, meaning in ((name, f"outcome of {method}"), (f"{name}_named", "what that names"))
    },
    "cause": "why it is not right, as far as seal, preflight and fits tell (`jointgap.trials.causes`)",
    "reason": "why the verdict is what it is, what it leaves open if it is ambiguous, or why the analysis failed",
}
_NUMBERS = {
    "size": ("1", "whitened gap asked for"),
    "gap_caused": ("1", "whitened gap that the smallest of the effects causes after recalibration, without noise"),
    "numerics_gap": (
        "1",
        "gap that the truth leaves, simulated by usual numerics; not known of chaotic motion and from Exudyn",
    ),
    "seconds": ("s", "processor time that the analysis took"),
    "error": ("1", "relative error of the effect's size, where it is named right"),
    **{f"covered_{level}": ("1", f"share of sizes within their {level} % interval") for level in LEVELS},
    "nuisances": ("1", "nuisances for which the verdict states an interval, where it is right and not ambiguous"),
    **{f"nuisances_covered_{level}": ("1", f"of these, within their {level} % interval") for level in LEVELS},
    "gap_before": ("1", "gap of the held-out run before"),
    "gap_after": ("1", "gap of the held-out run after"),
    "closed": ("1", "share of the held-out excess closed, where the gap before is over 1.5"),
    "windows": (
        "1",
        "windows in the map whose noise-free difference is known; "
        "not those in the crank angle, unless nothing is hidden",
    ),
    "false_windows": ("1", "of these, with a noise-free difference below 0.1 of the noise"),
    "bins_off": ("1", "bins of 10 deg with a noise-free difference above half of the noise"),
    "missed_bins": ("1", "of these, in no window"),
}

TRIALS = Table(
    "blind_trials",
    "Blind trials: what was hidden, and what was found",
    (
        *(Column(name, "", meaning, "text") for name, meaning in _TEXT.items()),
        Column(
            "detectable",
            "",
            "an effect is hidden that preflight calls detectable, as large as asked for, and none is idle",
            "bool",
        ),
        Column("idle", "", "an effect is hidden that is within a stated range, or overwritten by another", "bool"),
        Column("told", "", "of the kind wiring: a remark, an error or a fault of a sensor names the channel", "bool"),
        Column("foreseen", "", "an effect is hidden that preflight calls undetectable", "bool"),
        *(Column(name, unit, meaning, nullable=True) for name, (unit, meaning) in _NUMBERS.items()),
    ),
)


def score_batches(truths: Iterable[Path], analyses: Iterable[Path]) -> pd.DataFrame:
    """The table `TRIALS` of all trials of several batches."""
    truth, analysis = (
        {record["id"]: record for path in paths for record in read_trial_records(path, option, command)}
        for paths, option, command in ((truths, "--truth", "blind-conceal"), (analyses, "--found", "blind-analyse"))
    )
    if unmatched := truth.keys() ^ analysis.keys():
        raise InputError(f"trial {min(unmatched)} has a truth or a verdict alone; give the files of the same batches")
    rows = pd.DataFrame([score_trial(truth[trial], analysis[trial]) for trial in sorted(truth)])
    columns = [column.name for column in TRIALS.columns]
    return rows.reindex(columns=columns).astype(
        dict.fromkeys(("detectable", "idle", "told", "foreseen"), bool) | dict.fromkeys(_NUMBERS, float)
    )


def effect_label(effect: Mapping[str, Any]) -> str:
    """Name of an effect, with its site where there is a choice."""
    return f"{effect['name']}:{effect['site']}" if effect["name"] in WITH_SITE else effect["name"]


def named_labels(effects: Iterable[Mapping[str, Any]], hidden: frozenset[str]) -> frozenset[str]:
    """Labels of effects of a verdict; of a named family that of the `hidden` effect that lies in it, else its law's.

    An effect lies in it where the interval of the shape holds the one at which the law is that effect.
    """

    def label(effect: Mapping[str, Any]) -> str:
        inside = {
            name for family in _families_named(effect) for name in hidden if _holds_shape_of(effect, family, name)
        }
        return min(inside, default=_name_stated(effect))

    return frozenset(map(label, effects))


def score_trial(truth: Mapping[str, Any], analysis: Mapping[str, Any]) -> dict[str, Any]:
    """One trial."""
    verdict = analysis.get("verdict")
    hidden = frozenset(effect_label(effect) for effect in truth["effects"])
    row = dict.fromkeys(_NUMBERS, math.nan) | {
        "id": truth["id"],
        "kind": truth["kind"],
        "base": truth["base"],
        "drive": truth.get("drive", "constant_speed"),
        "size": truth["size"],
        "hidden": " + ".join(sorted(hidden)) or "nothing",
        "gap_caused": min(truth["gaps"]) if truth["gaps"] else math.nan,
        "numerics_gap": math.nan if truth["numerics_gap"] is None else truth["numerics_gap"],
        "verdict": verdict["verdict"] if verdict else "failed",
        "named": "",
        "detectable": bool(hidden),
        "idle": has_idle_effect(truth),
        "told": False,
        "foreseen": False,
        "cause": "",
        "seconds": analysis.get("seconds", math.nan),
        "reason": analysis.get("error", ""),
    }
    for baseline in BASELINES:
        names = analysis.get(baseline)
        row[baseline] = _baseline_outcome(truth, hidden, names)
        row[f"{baseline}_named"] = "not asked" if names is None else " + ".join(names) or "nothing"
    if "damage" in truth:
        damaged = truth["damage"]["channels"]
        row |= {"hidden": f"{truth['damage']['what']}: {' + '.join(damaged)}", "told": _told(damaged, analysis)}
        if verdict is None and row["told"]:
            row["outcome"] = "right"  # the files were refused for what is wrong with them
            return row
    if verdict is None:
        return row | {"outcome": "failed", "cause": cause(truth, analysis, hidden, frozenset())}
    row["foreseen"] = bool(hidden & set(verdict["preflight"]["undetectable"]))
    row["detectable"] = bool(hidden) and not row["foreseen"] and not row["idle"] and min(truth["gaps"]) >= LEAST_GAP
    row["named"] = " + ".join(sorted(map(_name_stated, verdict["effects"]))) or verdict["verdict"]
    row["outcome"] = (
        _wiring_outcome(damaged, verdict, row["told"]) if "damage" in truth else _outcome(truth, verdict, hidden)
    )
    row |= _samples_alone(row, verdict, hidden)
    if row["outcome"] != "right":
        names = named_labels((*verdict["effects"], *verdict["certain"]), hidden)
        row["cause"] = cause(truth, analysis, hidden, names, _equivalent(verdict))
    left_open = sorted(" + ".join(sorted(explanation)) or "nothing" for explanation in _equivalent(verdict))
    row["reason"] = " or ".join(left_open) or verdict["because"]
    if "damage" in truth:
        return row
    sizes = _size_errors(truth, verdict) if row["outcome"] == "right" else {}
    if row["outcome"] == "right" and verdict["verdict"] != "ambiguous":
        sizes |= _nuisances_covered(truth, verdict)
    return row | sizes | _held_out_gaps(verdict) | _windows(truth, verdict)


def _families_named(effect: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [family for family in effect.get("families", ()) if family["named"]]


def _holds_shape_of(effect: Mapping[str, Any], family: Mapping[str, Any], label: str) -> bool:
    """Whether the interval of the shape of an effect's `family` holds the one at which its law is that of a `label`."""
    name, _, site = label.partition(":")
    low, high = family["interval_99"]
    return site in ("", effect["site"]) and low <= SHAPES.get((family["law"], name), math.nan) <= high


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


def _wiring_outcome(damaged: Sequence[str], verdict: Mapping, told: bool) -> str:
    """Wrong where anything but a fault of a damaged sensor is named or called certain, else right where the channel is
    told.
    """
    if not all(_is_fault_of(effect, damaged) for effect in (*verdict["effects"], *verdict["certain"])):
        return "wrong"
    return "right" if told else "ambiguous" if verdict["verdict"] == "ambiguous" else "missed"


def _baseline_outcome(truth: Mapping, hidden: frozenset[str], named: Sequence[str] | None) -> str:
    """The outcome of a baseline method, which names effects or finds nothing; None where it was not asked."""
    if named is None:
        return "not asked"
    if not named:
        return "missed" if hidden else "right"
    return "wrong" if _is_off_list(truth) else _outcome_of_names(hidden, frozenset(named))


def _samples_alone(row: Mapping, verdict: Mapping, hidden: frozenset[str]) -> dict[str, str]:
    """The outcome of the naming, and what it named, as it is without what features of the cycle decided."""
    equivalent = [effect for effects in verdict["equivalent"] for effect in effects]
    if is_told_by_features(verdict, [*verdict["effects"], *equivalent]):
        return {"samples": "missed" if hidden else "right", "samples_named": "nothing"}
    return {"samples": row["outcome"], "samples_named": row["named"]}


def _is_off_list(truth: Mapping) -> bool:
    """Whether an effect is hidden that no candidate is; some that were drawn as such have become candidates."""
    return not all(effect["listed"] for effect in truth["effects"])


def _outcome_of_names(hidden: frozenset[str], named: frozenset[str]) -> str:
    if named == hidden:
        return "right"
    return "partly" if named < hidden else "wrong"


def _outcome(truth: Mapping, verdict: Mapping, hidden: frozenset[str]) -> str:
    kind = verdict["verdict"]
    if kind in NOTHING_NAMED:
        return "missed" if hidden else "right"
    if kind == "unexplained":
        return "unexplained"
    if kind == "ambiguous":
        if not {effect_label(effect) for effect in verdict["certain"]} <= hidden:
            return "wrong"
        explanations = _equivalent(verdict)
        merged = [frozenset(group) for group in verdict["preflight"]["merged"]]
        foreseen = hidden in explanations and all(
            _inseparable(explanation, hidden, merged) for explanation in explanations
        )
        return "right" if foreseen else "ambiguous"
    named = named_labels(verdict["effects"], hidden)
    if _is_off_list(truth):
        return "right" if named == hidden or _is_the_force(truth, verdict) else "wrong"
    return _outcome_of_names(hidden, named)


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
    states = [np.array(force[key]) for key in ("v", "x", "w", "theta", "t")]
    try:
        discovered = np.array(formula_values(compile_formula(parameters["formula"]["value"], coefficients), *states))
    except InputError:
        return False
    true = np.array(force["value"])
    return float(np.sqrt(np.mean((discovered - true) ** 2))) <= SAME_FORCE_RMS * float(np.sqrt(np.mean(true**2)))


def _size_errors(truth: Mapping, verdict: Mapping) -> dict[str, float]:
    """Relative error of the sizes of effects named right, and the share of them within their intervals.

    The size of an effect is its first parameter in the seal. One whose estimate has no interval, since it came to a
    bound, is not covered.
    """
    if verdict["verdict"] not in NAMED or _is_off_list(truth):
        return {}
    named = {effect_label(effect): effect["parameters"] for effect in verdict["effects"]}
    errors: list[float] = []
    covered: dict[str, list[float]] = {f"covered_{level}": [] for level in LEVELS}
    for effect in truth["effects"]:
        key, true = next(iter(effect["parameters"].items()))
        estimate = named.get(effect_label(effect), {}).get(key)  # none where its family is named by another member
        if estimate is None or not true:
            continue
        errors.append(abs(estimate["value"] - true) / abs(true))
        for level in LEVELS:
            covered[f"covered_{level}"].append(_holds(estimate, level, true) or 0.0)
    return {key: float(np.mean(values)) for key, values in ({"error": errors} | covered).items() if values}


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


def _windows(truth: Mapping, verdict: Mapping) -> dict[str, float]:
    """Windows of the map where the noise-free difference is small, and bins without a window where it is large."""
    # Of an effect that is none the difference is what a linear recalibration left: the analyst's leaves nothing.
    if truth.get("difference") is None or has_idle_effect(truth):
        return {}
    counted, false, bins = 0, 0, set()
    for window in verdict["where"]:
        channel = window["channel"].partition(" ")[0]  # of a statistic: the channel that it is of
        difference = _difference(truth, window["run"], channel)
        if difference is None:
            continue
        inside = _pieces_between(*window["crank_angle_deg"])
        sampled = [difference[piece] for piece in inside if difference[piece] is not None]
        counted += 1
        false += bool(sampled) and math.sqrt(np.mean(np.square(sampled))) < FALSE_WINDOW_RMS
        bins |= {(window["run"], channel, piece * 360 // ANGLE_PIECES // _BIN_DEG) for piece in inside}
    off = set()
    for run, channels in truth["difference"].items():
        for channel, difference in channels.items():
            bin_of_piece = np.arange(ANGLE_PIECES) * 360 // ANGLE_PIECES // _BIN_DEG
            squares = pd.Series(difference, dtype=float).pow(2).groupby(bin_of_piece)
            rms = np.sqrt(squares.mean())
            off |= {(run, channel, int(place)) for place in rms.index[rms > MISSED_BIN_RMS]}
    return {
        "windows": float(counted),
        "false_windows": float(false),
        "bins_off": float(len(off)),
        "missed_bins": float(len(off - bins)),
    }


def _difference(truth: Mapping, run: str, channel: str) -> Sequence[float | None] | None:
    """Noise-free difference over the noise by piece of the crank angle; None where it is not known.

    That of the crank angle is not: the seal's base turns as the encoder says, but the analyst's is fitted to all
    channels and may turn off it where it cannot follow the others. Where nothing is hidden, it can.
    """
    if channel == "crank_angle":
        return None if truth["effects"] else [0.0] * ANGLE_PIECES
    return truth["difference"].get(run, {}).get(channel)


def _pieces_between(start: float, end: float) -> list[int]:
    """Pieces of the crank angle from `start` to `end` [deg], past 360 too."""
    width = 360 / ANGLE_PIECES
    first, count = round(start / width), round(((end - start) % 360 or 360) / width)
    return [(first + index) % ANGLE_PIECES for index in range(count)]
