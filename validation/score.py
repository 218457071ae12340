"""The score: each verdict against its sealed ground truth, one row a trial, and the rates of a
set."""

import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import beta, binomtest, quantile_test

from jointgap.core.errors import InputError
from jointgap.effects import EFFECTS
from jointgap.identification.confirmation import share_closed
from jointgap.identification.fit import LEVELS
from jointgap.rig.sensors import ENCODER_FAULTS, FAULTS
from validation.kinds import CLEARANCES
from validation.rig import RECIPE, SHAPES
from validation.trial import GAP_TOLERANCE, formula_values

# Effects whose site has to be right too
WITH_SITE = {name for name, page in EFFECTS.items() if page.sites()} | (
    FAULTS.keys() - set(ENCODER_FAULTS)
)

NOTHING_NAMED = ("no_disagreement", "parameters_only")
NAMED = ("named", "named_with_remaining_misfit")

# A trial whose effect causes less, since it cannot be larger on any rig that was drawn, counts as
# undetectable
LEAST_GAP = 1.5 * (1 - GAP_TOLERANCE)

# RMS share by which a discovered force may differ from the true one over the visited states
SAME_FORCE_RMS = 0.1

# Gap of the held-out run from which on the share of its excess that is closed says something
CLOSED_FROM_GAP = 1.5

# Root mean square of a difference over the noise, in a bin of the crank angle: from the larger on
# the map has to flag it, up to the smaller it must not; between them either is right
SHOWS_FROM, HIDDEN_UP_TO = 0.5, 0.1

# Methods beside the identification: the least BIC of its fits, one effect at a time; sparse
# regression of the residual; the least BIC by a global optimiser; a network classifier
BASELINES = ("greedy", "sparse", "optimiser", "network")

_NUMBERS = (
    "error",
    *(f"covered_{level}" for level in LEVELS),
    "map_hit",
    "map_false",
    "map_missed",
    "names_hit",
    "names_false",
    "names_missed",
    "nuisances",
    *(f"nuisances_covered_{level}" for level in LEVELS),
    "gap_before",
    "gap_after",
    "closed",
)


def score_trials(folder: Path, trials: Iterable[str] = ()) -> pd.DataFrame:
    """A row a trial (docs/validation.md) from the files ``sealed/{trial}.json`` and
    ``verdicts/{trial}.json``, by default of all that have a verdict."""
    names = sorted(trials or (path.stem for path in (folder / "verdicts").glob("*.json")))
    rows = []
    for name in names:
        truth, analysis = (_read(folder / part / f"{name}.json") for part in ("sealed", "verdicts"))
        # other methods that were asked one by one
        for path in (folder / "peers").glob(f"*/{name}.json"):
            analysis = {**analysis, path.parent.name: _read(path)[path.parent.name]}
        rows.append(score_trial(truth, analysis))
    return pd.DataFrame(rows)


def _read(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read ({error}); run `make blind` again, which writes it"
        ) from error


def score_trial(truth: Mapping[str, Any], analysis: Mapping[str, Any]) -> dict[str, Any]:
    """One trial."""
    verdict, damaged = analysis.get("verdict"), truth.get("damage")
    hidden = labels(truth["effects"])
    told = damaged is not None and _told(damaged["channels"], analysis)
    foreseen = verdict is not None and bool(hidden & set(verdict["preflight"]["undetectable"]))
    smallest = min(truth["gaps"], default=math.nan)
    outcome = _outcome(truth, verdict, hidden, told)
    row = {
        "id": truth["id"],
        "kind": truth["kind"],
        "base": truth["base"],
        "drive": truth["drive"],
        "hidden": (
            f"{damaged['what']}: {' + '.join(damaged['channels'])}" if damaged else _joined(hidden)
        ),
        "verdict": "failed",
        "named": "",
        "outcome": outcome,
        "size": truth["size"],
        "gap_caused": smallest,
        "numerics_gap": math.nan if truth["numerics_gap"] is None else truth["numerics_gap"],
        "detectable": bool(hidden) and not foreseen and not (verdict and smallest < LEAST_GAP),
        "foreseen": foreseen,
        "told": told,
        "seconds": analysis.get("seconds", math.nan),
        "cause": "",
        "reason": analysis.get("error", ""),
    }
    row |= {one: _baseline_outcome(truth, hidden, analysis.get(one)) for one in BASELINES}
    row |= dict.fromkeys(_NUMBERS, math.nan)
    if verdict is None:
        return row
    row["verdict"] = verdict["verdict"]
    row["named"] = " + ".join(sorted(map(name_stated, verdict["effects"]))) or verdict["verdict"]
    row["reason"] = " or ".join(sorted(map(_joined, _equivalent(verdict)))) or verdict["because"]
    row |= _names_found(truth, verdict, hidden)
    if damaged:
        return row
    if outcome != "right" and hidden and not _is_off_list(truth):
        row["cause"] = _cause(hidden, analysis.get("bic", {}))
    row |= _bins_found(truth, analysis)
    if outcome == "right" and verdict["verdict"] != "ambiguous":
        row |= _nuisances_covered(truth, verdict)
    if outcome == "right" and verdict["verdict"] in NAMED and not _is_off_list(truth):
        row |= _size_errors(truth, verdict)
    return row | _held_out_gaps(verdict)


def effect_label(effect: Mapping[str, Any]) -> str:
    """Name of an effect, with its site where there is a choice."""
    return f"{effect['name']}:{effect['site']}" if effect["name"] in WITH_SITE else effect["name"]


def labels(effects: Iterable[Mapping[str, Any]]) -> frozenset[str]:
    """Labels of several effects."""
    return frozenset(map(effect_label, effects))


def named_labels(effects: Iterable[Mapping[str, Any]], hidden: frozenset[str]) -> frozenset[str]:
    """Labels of effects of a verdict; of a named family that of the `hidden` effect that lies in
    it, else its law's.

    An effect lies in it where the interval of the shape holds the one at which the law is that
    effect. Of a sensor fault with alternatives that of the hidden one among them.
    """

    def label(effect: Mapping[str, Any]) -> str:
        same = {effect_label(other) for other in effect.get("alternatives", ())} & hidden
        if same:
            return min(same)
        inside = [
            one
            for family in families_named(effect)
            for one, (name, _, site) in ((one, one.partition(":")) for one in hidden)
            if site in ("", effect["site"])
            and _within(SHAPES[family["law"]].get(name), family["interval_99"])
        ]
        return min(inside, default=name_stated(effect))

    return frozenset(map(label, effects))


def _within(value: float | None, interval: Sequence[float | None] | None) -> bool:
    low, high = interval or (None, None)
    return None not in (value, low, high) and low <= value <= high


def _joined(names: Iterable[str]) -> str:
    return " + ".join(sorted(names)) or "nothing"


def families_named(effect: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [family for family in effect.get("families", ()) if family["named"]]


def name_stated(effect: Mapping[str, Any]) -> str:
    """The label of an effect of a verdict, or the law of its family where one is named."""
    law = next((family["law"] for family in families_named(effect)), effect["name"])
    return effect_label({**effect, "name": law})


def _is_fault_of(effect: Mapping, channels: Sequence[str]) -> bool:
    """Whether an effect named is a fault of the sensor of one of `channels`."""
    if effect["name"] in ENCODER_FAULTS:
        return "crank_angle" in channels
    return effect["name"] in FAULTS and effect["site"] in channels


def _told(damaged: Sequence[str], analysis: Mapping[str, Any]) -> bool:
    """Whether a damaged channel, of two swapped ones either, is told by a remark, a refusal or as a
    faulty sensor."""
    verdict, error = analysis.get("verdict"), analysis.get("error", "")
    doubted = {
        name for doubt in analysis.get("doubts", ()) for name in (doubt["channel"], doubt["other"])
    }
    named = [*verdict["effects"], *verdict["certain"]] if verdict else ()
    words = [*damaged, *(("speed",) if "time" in damaged else ())]
    refused = error.startswith("InputError") and any(word in error for word in words)
    return (
        refused
        or bool(doubted & {*damaged})
        or any(_is_fault_of(effect, damaged) for effect in named)
    )


def _outcome(truth: Mapping, verdict: Mapping | None, hidden: frozenset[str], told: bool) -> str:
    """right, wrong, partly, ambiguous, unexplained, missed or failed.

    Of damaged data: wrong where anything but a fault of a damaged sensor is named or called
    certain, else right where the channel is told.
    """
    if verdict is None:
        return "right" if told else "failed"  # the files were refused for what is wrong with them
    kind, effects = verdict["verdict"], verdict["effects"]
    if "damage" in truth:
        if not all(
            _is_fault_of(effect, truth["damage"]["channels"])
            for effect in (*effects, *verdict["certain"])
        ):
            return "wrong"
        return "right" if told else "ambiguous" if kind == "ambiguous" else "missed"
    if kind in NOTHING_NAMED:
        return "missed" if hidden else "right"
    if kind == "unexplained":
        return "unexplained"
    if kind == "ambiguous":
        if not labels(verdict["certain"]) <= hidden:
            return "wrong"
        explanations = _equivalent(verdict)
        merged = [set(group) for group in verdict["preflight"]["merged"]]
        foreseen = hidden in explanations and all(
            _inseparable(own, hidden, merged) for own in explanations
        )
        return "right" if foreseen else "ambiguous"
    named = named_labels(effects, hidden)
    if _is_off_list(truth):
        return "right" if named == hidden or _is_the_force(truth, verdict) else "wrong"
    return _outcome_of_names(hidden, named)


def _baseline_outcome(truth: Mapping, hidden: frozenset[str], named: Collection[str] | None) -> str:
    """The outcome of a baseline method, which names effects or finds nothing; None where it was not
    asked."""
    if named is None:
        return "not asked"
    if not named:
        return "missed" if hidden else "right"
    return "wrong" if _is_off_list(truth) else _outcome_of_names(hidden, frozenset(named))


def _is_off_list(truth: Mapping) -> bool:
    """Whether an effect is hidden that no candidate is."""
    return not all(effect["listed"] for effect in truth["effects"])


def _outcome_of_names(hidden: frozenset[str], named: frozenset[str]) -> str:
    return "right" if named == hidden else "partly" if named < hidden else "wrong"


def _equivalent(verdict: Mapping) -> list[frozenset[str]]:
    """The explanations that an ambiguous verdict holds to be equal; of other verdicts none."""
    return [
        labels(explanation)
        for explanation in verdict["equivalent"]
        if verdict["verdict"] == "ambiguous"
    ]


def _inseparable(
    explanation: frozenset[str], hidden: frozenset[str], merged: Sequence[set[str]]
) -> bool:
    """Whether an explanation differs from the truth only by effects that preflight could not
    separate."""
    extra, absent = explanation - hidden, hidden - explanation
    return len(extra) == len(absent) and any(
        all(any({a, b} <= group for group in merged) for a, b in zip(extra, order, strict=True))
        for order in permutations(absent)
    )


def _is_the_force(truth: Mapping, verdict: Mapping) -> bool:
    """Whether the one effect named is a discovered force within `SAME_FORCE_RMS` of the true
    one."""
    force = truth["effects"][0].get("force")
    if force is None or [effect["name"] for effect in verdict["effects"]] != [force["kind"]]:
        return False
    values = {key: entry["value"] for key, entry in verdict["effects"][0]["parameters"].items()}
    found, true = (
        formula_values(values.pop("formula"), values, pd.DataFrame(force["states"])),
        np.array(force["value"]),
    )
    return float(np.sqrt(np.mean((found - true) ** 2))) <= SAME_FORCE_RMS * float(
        np.sqrt(np.mean(true**2))
    )


def _size_errors(truth: Mapping, verdict: Mapping) -> dict[str, float]:
    """Relative error of the sizes of effects named right, and the share of them within their
    intervals.

    The size of an effect is its first parameter in the seal. One whose estimate has no interval,
    since it came to a bound, is not covered.
    """
    named = {effect_label(effect): effect["parameters"] for effect in verdict["effects"]}
    rows = []
    for effect in truth["effects"]:
        key, true = next(iter(effect["parameters"].items()))
        estimate = named.get(effect_label(effect), {}).get(
            key
        )  # none where its family is named by another member
        if estimate is not None and true:
            covered = {
                f"covered_{level}": _within(true, estimate.get(f"interval_{level}"))
                for level in LEVELS
            }
            rows.append({"error": abs(estimate["value"] / true - 1), **covered})
    return pd.DataFrame(rows).mean().to_dict()


def _nuisances_covered(truth: Mapping, verdict: Mapping) -> dict[str, float]:
    """How many nuisances have intervals, and how many true values lie in them."""
    known, counts = truth.get("nuisances", {}), {}
    stated = [
        (known[key], estimate)
        for key, estimate in verdict.get("nuisances", {}).items()
        if key in known
    ]
    for level in LEVELS:
        ends = [(true, estimate.get(f"interval_{level}") or (None,)) for true, estimate in stated]
        inside = [_within(true, interval) for true, interval in ends if None not in interval]
        if inside:
            counts |= {
                "nuisances": float(len(inside)),
                f"nuisances_covered_{level}": float(sum(inside)),
            }
    return counts


def _bins_found(truth: Mapping, analysis: Mapping) -> dict[str, int]:
    """Bins of the crank angle, of all channels and runs for fitting, that the map flags rightly,
    falsely and not."""
    if not truth.get("where") or "map" not in analysis:
        return {}
    hit = false = missed = 0
    for key, sizes in truth["where"].items():
        sizes, flagged = np.array(sizes), np.zeros(len(sizes), bool)
        flagged[analysis["map"].get(key, [])] = True
        hit += int((flagged & (sizes >= SHOWS_FROM)).sum())
        false += int((flagged & (sizes <= HIDDEN_UP_TO)).sum())
        missed += int((~flagged & (sizes >= SHOWS_FROM)).sum())
    return {"map_hit": hit, "map_false": false, "map_missed": missed}


def _names_found(truth: Mapping, verdict: Mapping, hidden: frozenset[str]) -> dict[str, int]:
    """How many effects are named rightly, falsely and not; one that is not on the list cannot be
    missed."""
    named = named_labels(verdict["effects"], hidden)
    if _is_off_list(truth):
        own = len(named & hidden) or int(_is_the_force(truth, verdict))
        return {"names_hit": own, "names_false": len(named) - own, "names_missed": 0}
    if "damage" in truth:
        faults = sum(
            _is_fault_of(effect, truth["damage"]["channels"]) for effect in verdict["effects"]
        )
        return {"names_hit": 0, "names_false": len(named) - faults, "names_missed": 0}
    return {
        "names_hit": len(named & hidden),
        "names_false": len(named - hidden),
        "names_missed": len(hidden - named),
    }


def _cause(hidden: frozenset[str], bic: Mapping[str, float]) -> str:
    """Why what is hidden was not named, as the BIC of all fits say."""
    by_labels = {frozenset(name.split(" + ")): value for name, value in bic.items()}
    if not by_labels:
        return ""
    if hidden not in by_labels:
        return "the hidden effects were not fitted together"
    best = min(by_labels, key=by_labels.__getitem__)
    if best == hidden:
        return "the hidden effects fit best, and the decision asks for more"
    return (
        f"{' + '.join(sorted(best))} fits better, BIC lower by"
        f" {by_labels[hidden] - by_labels[best]:.4g}"
    )


def ratio_row(part: pd.DataFrame, counted: str, of: str) -> dict[str, float]:
    """Precision, recall or F1 of what was found in all trials, with the 95 % interval of Clopper
    and Pearson for the number of independent finds that scatters as much between trials (Korn and
    Graubard, Survey Methodology 24 (1998) 193); the number of trials where they do not differ.
    """
    hit, false, missed = (
        part[[f"{counted}_{end}" for end in ("hit", "false", "missed")]].to_numpy(float).T
    )
    false_share, missed_share = {"precision": (1.0, 0.0), "recall": (0.0, 1.0), "F1": (0.5, 0.5)}[
        of
    ]
    asked = hit + false_share * false + missed_share * missed
    number, value = max(np.count_nonzero(asked), 1), hit.sum() / max(asked.sum(), 1e-9)
    if (scatter := np.sum((hit - value * asked) ** 2)) > 0.0:
        number = value * (1.0 - value) * asked.sum() ** 2 * (1.0 - 1.0 / number) / scatter
    found = value * number
    low, high = (
        beta.ppf(0.025, found, number - found + 1.0),
        beta.ppf(0.975, found + 1.0, number - found),
    )
    low, high = np.nan_to_num(low, nan=0.0), np.nan_to_num(high, nan=1.0)  # nothing found, or all
    return {"count": len(part), "value": float(value), "low": float(low), "high": float(high)}


def confusion(trials: pd.DataFrame) -> pd.DataFrame:
    """How often what was named where what was hidden: hidden, named, count; data wired wrongly by
    what is wrong."""
    hidden = trials["hidden"].where(
        trials["kind"] != "wiring", trials["hidden"].str.split(":").str[0]
    )
    named = trials["named"].where(trials["named"] != "", trials["verdict"])
    return (
        pd.DataFrame({"hidden": hidden, "named": named})
        .value_counts()
        .rename("count")
        .reset_index()
    )


def _held_out_gaps(verdict: Mapping) -> dict[str, float]:
    """Gaps of the held-out run; without a named effect, or if it cannot be simulated, none of the
    excess is closed."""
    gap = verdict["gap"].get("confirm") or {}
    if not verdict.get("effects"):  # nothing was added
        gap = gap | {"after": gap.get("before")}
    before, after = (math.nan if gap.get(key) is None else gap[key] for key in ("before", "after"))
    closed = math.nan
    if before > CLOSED_FROM_GAP:
        closed = 0.0 if math.isnan(after) else share_closed(before, after)
    return {"gap_before": before, "gap_after": after, "closed": closed}


def rates(trials: pd.DataFrame) -> pd.DataFrame:
    """The rates and medians of a set, one a row: what, group, count, value, low, high.

    Shares have the 95 % interval of Clopper and Pearson (Biometrika 26 (1934) 404-413), medians
    that of order statistics.
    """
    one = trials["kind"].isin(["single", "exudyn", "clearance"]) & (trials["hidden"] != "nothing")
    trials = trials.assign(one=one, loosened=trials["hidden"].isin(CLEARANCES))
    rows = []
    for what, rate in RECIPE["rates"].items():
        for group, part in _groups(
            trials.query(RECIPE["parts"][rate["of"]]), rate.get("by", ["all"])
        ).items():
            part = part.query(rate.get("where", "index == index"))
            if "quantile" in rate:
                row = _quantile(part[rate["quantile"]], rate.get("share", 0.5))
            elif "ratio" in rate:
                row = ratio_row(part, *rate["ratio"]) if len(part) else {"count": 0}
            elif "covered" in rate:
                row = share_row(part[rate["covered"]].sum(), int(part["nuisances"].sum()))
            else:
                row = share_row(part.eval(rate["is"]).sum(), len(part))
            rows.append({"what": what, "group": group, **row})
    return pd.DataFrame([row for row in rows if row["count"]])


def _groups(trials: pd.DataFrame, by: Collection[str]) -> dict[str, pd.DataFrame]:
    """All, by base, by drive, by gap, those from Exudyn, and by what was damaged."""
    if trials.empty:
        return {}
    larger = trials["gap_caused"] > (1 + GAP_TOLERANCE) * trials["size"]
    gap = "gap " + trials["size"].map("{:g}".format)
    gap = gap.mask(larger, "gap larger than asked for").where(trials["size"] > 0)
    loose = ((trials["base"] == "loose") | trials["loosened"]).map({True: "loose", False: "ideal"})
    keys = {
        "all": trials["kind"].where(trials["kind"].isna(), "all"),
        "base": "base " + trials["base"],
        "drive": "drive " + trials["drive"],
        "gap": gap,
        "simulator": ("from Exudyn, joints " + loose).where(trials["kind"] == "exudyn"),
        "damage": trials["hidden"].str.split(":").str[0].where(trials["kind"] == "wiring"),
    }
    told_apart = [key for key in by if key != "drive" or trials["drive"].nunique() > 1]
    return {name: part for key in told_apart for name, part in trials.groupby(keys[key])}


def share_row(hits: float, count: int) -> dict[str, float]:
    """A share, of which a trial may count a half."""
    if not count:
        return {"count": 0}
    low, high = binomtest(round(hits), count).proportion_ci(0.95, "exact")
    return {"count": count, "value": round(hits) / count, "low": float(low), "high": float(high)}


def _quantile(values: pd.Series, share: float) -> dict[str, float]:
    """The value below which a share of all lies, between two of the sorted values; the outermost
    where few are."""
    known = values.dropna().to_numpy(float)
    if not known.size:
        return {"count": 0}
    low, high = quantile_test(known, p=share).confidence_interval(0.95)
    low, high = np.nan_to_num(low, nan=known.min()), np.nan_to_num(high, nan=known.max())
    return {
        "count": known.size,
        "value": np.quantile(known, share),
        "low": float(low),
        "high": float(high),
    }
