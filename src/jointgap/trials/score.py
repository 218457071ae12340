"""A verdict against the sealed truth, trial by trial."""

import math
from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import Any

import numpy as np
import pandas as pd

from jointgap.errors import InputError
from jointgap.formula import compile_formula
from jointgap.identification.confirmation import share_closed
from jointgap.trials.make_trial import PIECES, values_of
from jointgap.trials.size_calibration import NEAR

CHOICES = ("pin_friction", "lubricated_joint", "sensor_bias", "sensor_gain", "sensor_lag")
"""Effects that are told apart by their site too."""

FOUND_NOTHING = ("no_disagreement", "parameters_only")
NAMED = ("named", "named_with_remaining_misfit")

LEAST_GAP = 1.5 * (1 - 2 * NEAR)
"""A trial whose effect causes less, since it cannot be larger on any rig that was drawn, counts as undetectable."""

QUIET, LOUD = 0.1, 0.5
"""Noise-free difference over the noise below which a window is false, and above which a bin without one is a miss."""

ALIKE = 0.1
"""RMS share by which a discovered force may differ from the true one over the visited states."""

_BIN = 10  # degrees


def label(effect: Mapping[str, Any]) -> str:
    """Name of an effect, with its site where there is a choice."""
    return f"{effect['name']}:{effect['site']}" if effect["name"] in CHOICES else effect["name"]


def scored(truth: Mapping[str, Any], told: Mapping[str, Any]) -> dict[str, Any]:
    """One trial.

    Parameters
    ----------
    truth : mapping
        The sealed truth, as `jointgap.trials.make_trial` writes it.
    told : mapping
        What `jointgap.trials.analyse_trial` keeps: the verdict or an error, and what the baselines say.

    Returns
    -------
    dict
        A row of the table of trials.
    """
    verdict = told.get("verdict")
    hidden = frozenset(label(effect) for effect in truth["effects"])
    row = {
        "id": truth["id"],
        "kind": truth["kind"],
        "base": truth["base"],
        "size": truth["size"],
        "hidden": " + ".join(sorted(hidden)) or "nothing",
        "gap_caused": min(truth["gaps"]) if truth["gaps"] else math.nan,
        "numerics_gap": math.nan if truth["numerics_gap"] is None else truth["numerics_gap"],
        "verdict": verdict["verdict"] if verdict else "failed",
        "named": "",
        "detectable": bool(hidden),
        "foreseen": False,
        "greedy": outcome_of(truth, hidden, told.get("greedy")),
        "greedy_named": " + ".join(told.get("greedy") or ()) or "nothing",
        "sparse": outcome_of(truth, hidden, told.get("sparse")),
        "sparse_named": "not asked" if told.get("sparse") is None else " + ".join(told["sparse"]) or "nothing",
        "seconds": told.get("seconds", math.nan),
        "reason": told.get("error", ""),
    }
    if verdict is None:
        return row | {"outcome": "failed", **_no_numbers()}
    row["foreseen"] = bool(hidden & set(verdict["preflight"]["undetectable"]))
    row["detectable"] = bool(hidden) and not row["foreseen"] and min(truth["gaps"]) >= LEAST_GAP
    row["named"] = " + ".join(sorted(label(effect) for effect in verdict["effects"])) or verdict["verdict"]
    row["outcome"] = _outcome(truth, verdict, hidden)
    left_open = " or ".join(sorted(" + ".join(sorted(one)) or "nothing" for one in _equivalent(verdict)))
    row["reason"] = left_open or verdict["because"]
    return row | _numbers(truth, verdict, row["outcome"]) | _windows(truth, verdict)


def outcome_of(truth: Mapping, hidden: frozenset[str], named: Sequence[str] | None) -> str:
    """What a baseline's names come to: it names, or finds nothing."""
    if named is None:
        return "not asked"
    if not named:
        return "right" if not hidden else "missed"
    if truth["kind"] == "off_list" or not hidden:
        return "wrong"
    return "right" if frozenset(named) == hidden else "partly" if frozenset(named) < hidden else "wrong"


def _outcome(truth: Mapping, verdict: Mapping, hidden: frozenset[str]) -> str:
    kind = verdict["verdict"]
    if kind in FOUND_NOTHING:
        return "right" if not hidden else "missed"
    if kind == "unexplained":
        return "unexplained"
    if kind == "ambiguous":
        explanations = _equivalent(verdict)
        merged = [frozenset(group) for group in verdict["preflight"]["merged"]]
        foreseen = hidden in explanations and all(_stand_for(one, hidden, merged) for one in explanations)
        return "right" if foreseen else "ambiguous"
    if truth["kind"] == "off_list":
        return "right" if _is_the_force(truth, verdict) else "wrong"
    named = frozenset(label(effect) for effect in verdict["effects"])
    if named == hidden:
        return "right"
    return "partly" if named < hidden else "wrong"


def _equivalent(verdict: Mapping) -> list[frozenset[str]]:
    """The explanations that an ambiguous verdict holds to be equal; of other verdicts none."""
    told = verdict["equivalent"] if verdict["verdict"] == "ambiguous" else ()
    return [frozenset(label(effect) for effect in one) for one in told]


def _stand_for(one: frozenset[str], hidden: frozenset[str], merged: Sequence[frozenset[str]]) -> bool:
    """Whether an explanation differs from the truth only by effects that preflight could not tell apart."""
    extra, absent = one - hidden, hidden - one
    return len(extra) == len(absent) and any(
        all(any({a, b} <= group for group in merged) for a, b in zip(extra, order, strict=True))
        for order in permutations(absent)
    )


def _is_the_force(truth: Mapping, verdict: Mapping) -> bool:
    """Whether the one effect named is a discovered force within `ALIKE` of the true one over the visited states."""
    force = truth["effects"][0].get("force")
    if force is None or len(verdict["effects"]) != 1 or verdict["effects"][0]["name"] != force["kind"]:
        return False
    parameters = verdict["effects"][0]["parameters"]
    numbers = {key: one["value"] for key, one in parameters.items() if key != "formula"}
    states = [np.array(force[key]) for key in ("v", "x", "w", "theta", "t")]
    try:
        found = np.array(values_of(compile_formula(parameters["formula"]["value"], numbers), *states))
    except InputError:
        return False
    true = np.array(force["value"])
    return float(np.sqrt(np.mean((found - true) ** 2))) <= ALIKE * float(np.sqrt(np.mean(true**2)))


def _no_numbers() -> dict[str, float]:
    names = (
        "error",
        "covered",
        "gap_before",
        "gap_after",
        "closed",
        "windows",
        "false_windows",
        "bins_off",
        "missed_bins",
    )
    return dict.fromkeys(names, math.nan)


def _numbers(truth: Mapping, verdict: Mapping, outcome: str) -> dict[str, float]:
    """Relative error of the effects' sizes, coverage of their intervals, gaps of the held-out run.

    The size of an effect is its first parameter in the seal. One that was found without an interval, since it came to a bound, is
    not covered; where the held-out run cannot be simulated with what was named, none of its excess is closed.
    """
    found = _no_numbers()
    if outcome == "right" and verdict["verdict"] in NAMED and truth["kind"] != "off_list":
        named = {label(effect): effect["parameters"] for effect in verdict["effects"]}
        errors, covered = [], []
        for effect in truth["effects"]:
            key, true = next(iter(effect["parameters"].items()))
            one = named[label(effect)].get(key)
            if one is None or not true:
                continue
            errors.append(abs(one["value"] - true) / abs(true))
            low, high = one["interval_90"]
            covered.append(float(low is not None and low <= true <= high))
        found["error"] = float(np.mean(errors)) if errors else math.nan
        found["covered"] = float(np.mean(covered)) if covered else math.nan
    gap = verdict["gap"].get("confirm") or {}
    before, after = (math.nan if gap.get(key) is None else gap[key] for key in ("before", "after"))
    found |= {"gap_before": before, "gap_after": after}
    if before > 1.5:
        found["closed"] = 0.0 if math.isnan(after) else share_closed(before, after)
    return found


def _windows(truth: Mapping, verdict: Mapping) -> dict[str, float]:
    """Windows of the map where the noise-free difference is small, and bins without a window where it is large."""
    if truth.get("difference") is None:
        return {}
    counted, false, bins = 0, 0, set()
    for window in verdict["where"]:
        channel = window["channel"].partition(" ")[0]  # of a statistic: the channel that it is of
        pieces = _difference(truth, window["run"], channel)
        if pieces is None:
            continue
        inside = _pieces(*window["crank_angle_deg"])
        seen = [pieces[piece] for piece in inside if pieces[piece] is not None]
        counted += 1
        false += bool(seen) and math.sqrt(np.mean(np.square(seen))) < QUIET
        bins |= {(window["run"], channel, piece * 360 // PIECES // _BIN) for piece in inside}
    off = set()
    for run, channels in truth["difference"].items():
        for channel, pieces in channels.items():
            values = pd.Series(pieces, dtype=float).groupby(np.arange(PIECES) * 360 // PIECES // _BIN)
            rms = np.sqrt(values.apply(lambda one: np.mean(one**2)))
            off |= {(run, channel, int(place)) for place in rms.index[rms > LOUD]}
    return {
        "windows": float(counted),
        "false_windows": float(false),
        "bins_off": float(len(off)),
        "missed_bins": float(len(off - bins)),
    }


def _difference(truth: Mapping, run: str, channel: str) -> Sequence[float | None] | None:
    """Noise-free difference over the noise by piece of the crank angle; None where it is not known.

    That of the crank angle is not: the seal's base turns as the encoder says, but the analyst's is fitted to all channels and may
    turn off it where it cannot follow the others. Where nothing is hidden, it can.
    """
    if channel == "crank_angle":
        return None if truth["effects"] else [0.0] * PIECES
    return truth["difference"].get(run, {}).get(channel)


def _pieces(start: float, end: float) -> list[int]:
    """Pieces of the crank angle from `start` to `end` [deg], past 360 too."""
    width = 360 / PIECES
    first, count = round(start / width), round(((end - start) % 360 or 360) / width)
    return [(first + place) % PIECES for place in range(count)]
