"""Scores: each verdict compared with its ground truth (one row a trial), and the rates of a set."""

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
from validation.rig import RECIPE, SHAPES
from validation.trial import GAP_TOLERANCE, formula_values

# Effects whose site has to be right too
WITH_SITE = {name for name, page in EFFECTS.items() if page.sites()}
WITH_SITE |= FAULTS.keys() - set(ENCODER_FAULTS)

NOTHING_NAMED = ("no_disagreement", "parameters_only")
NAMED = ("named", "named_with_remaining_misfit")

UNFINISHED = "unfinished"
"""Outcome of an analysis that reached its limit of processor time, and its error."""

# Smallest gap of a detectable effect
LEAST_GAP = 1.5 * (1 - GAP_TOLERANCE)

# RMS share by which a discovered force may differ from the true one over the visited states
SAME_FORCE_RMS = 0.1

# Smallest gap of the held-out run for which the closed share is meaningful
CLOSED_FROM_GAP = 1.5

# RMS difference over the noise in a bin of the crank angle: from the larger value the map has to
# flag it, up to the smaller it must not
SHOWS_FROM, HIDDEN_UP_TO = 0.5, 0.1

_NUMBERS = (
    "error",
    *(f"covered_{level}" for level in LEVELS),
    *(f"{counted}_{end}" for counted in ("map", "names") for end in ("hit", "false", "missed")),
    "nuisances",
    *(f"nuisances_covered_{level}" for level in LEVELS),
    *("gap_before", "gap_after", "closed"),
)


def score_trials(folder: Path, trials: Iterable[str] = ()) -> pd.DataFrame:
    """One row a trial (docs/validation.md) from ``truth/{trial}.json`` and
    ``verdicts/{trial}.json``, by default of all verdicts."""
    rows = []
    for name in sorted(trials or (path.stem for path in (folder / "verdicts").glob("*.json"))):
        truth, analysis = (_read(folder / part / f"{name}.json") for part in ("truth", "verdicts"))
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
    """The row of one trial."""
    verdict, damage = analysis.get("verdict"), truth.get("damage")
    hidden = labels(truth["effects"])
    reported = damage is not None and _is_reported(damage["channels"], analysis)
    foreseen = verdict is not None and bool(hidden & set(verdict["preflight"]["undetectable"]))
    smallest = min(truth["gaps"], default=math.nan)
    outcome = _outcome(truth, analysis, hidden, reported)
    row = {
        **{key: truth[key] for key in ("id", "kind", "base", "drive")},
        "mechanism": truth.get("mechanism", "slider_crank"),
        "hidden": f"{damage['what']}: {' + '.join(damage['channels'])}"
        if damage
        else _joined(hidden),
        "verdict": UNFINISHED if outcome == UNFINISHED else "failed",
        "named": "",
        "outcome": outcome,
        "size": truth["size"],
        "gap_caused": smallest,
        "numerics_gap": math.nan if truth["numerics_gap"] is None else truth["numerics_gap"],
        "detectable": bool(hidden) and not foreseen and not (verdict and smallest < LEAST_GAP),
        "foreseen": foreseen,
        "told": reported,
        "seconds": analysis.get("seconds", math.nan),
        "code": analysis.get("code", ""),
        "cause": "",
        "reason": analysis.get("error", ""),
    }
    row |= dict.fromkeys(_NUMBERS, math.nan)
    if verdict is None:  # abstained
        if not damage:
            missed = 0 if _is_off_list(truth) else len(hidden)
            row |= {"names_hit": 0, "names_false": 0, "names_missed": missed}
            row |= _bin_counts(truth, analysis)
        return row
    row["verdict"] = verdict["verdict"]
    row["named"] = " + ".join(sorted(map(name_stated, verdict["effects"]))) or verdict["verdict"]
    row["reason"] = " or ".join(sorted(map(_joined, _equivalent(verdict)))) or verdict["because"]
    row |= _name_counts(truth, verdict, hidden)
    if damage:
        return row
    row |= _bin_counts(truth, analysis)
    if outcome == "right":
        if verdict["verdict"] != "ambiguous":
            row |= _nuisance_coverage(truth, verdict)
        if verdict["verdict"] in NAMED and not _is_off_list(truth):
            row |= _size_errors(truth, verdict)
    elif hidden and not _is_off_list(truth):
        row["cause"] = _cause(hidden, analysis.get("bic", {}))
    return row | _held_out_gaps(verdict)


def effect_label(effect: Mapping[str, Any]) -> str:
    """Name of an effect, with its site if there are several."""
    return f"{effect['name']}:{effect['site']}" if effect["name"] in WITH_SITE else effect["name"]


def labels(effects: Iterable[Mapping[str, Any]]) -> frozenset[str]:
    return frozenset(map(effect_label, effects))


def named_labels(effects: Iterable[Mapping[str, Any]], hidden: frozenset[str]) -> frozenset[str]:
    """Labels of the effects of a verdict.

    A named family counts as the `hidden` effect in it if the interval of the shape contains that of
    the effect, a sensor fault with alternatives as the hidden one of these.
    """

    def label(effect: Mapping[str, Any]) -> str:
        if same := labels(effect.get("alternatives", ())) & hidden:
            return min(same)
        inside = []
        for family in families_named(effect):
            for hidden_label in hidden:
                name, _, site = hidden_label.partition(":")
                shape = SHAPES[family["law"]].get(name)
                if site in ("", effect["site"]) and _within(shape, family["interval_99"]):
                    inside.append(hidden_label)
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
    """The label of an effect of a verdict, or the law of its named family."""
    law = next((family["law"] for family in families_named(effect)), effect["name"])
    return effect_label({**effect, "name": law})


def _is_fault_of(effect: Mapping, channels: Sequence[str]) -> bool:
    """Whether an effect is a fault of the sensor of one of `channels`."""
    if effect["name"] in ENCODER_FAULTS:
        return "crank_angle" in channels
    return effect["name"] in FAULTS and effect["site"] in channels


def _is_reported(damaged: Sequence[str], analysis: Mapping[str, Any]) -> bool:
    """Whether one of the damaged channels is reported by a remark, an error or as a faulty
    sensor."""
    verdict, error = analysis.get("verdict"), analysis.get("error", "")
    if error.startswith("InputError"):
        words = [*damaged, *(("speed",) if "time" in damaged else ())]
        if any(word in error for word in words):
            return True
    doubts = analysis.get("doubts", ())
    if any({doubt["channel"], doubt["other"]} & {*damaged} for doubt in doubts):
        return True
    effects = [*verdict["effects"], *verdict["certain"]] if verdict else ()
    return any(_is_fault_of(effect, damaged) for effect in effects)


def _outcome(truth: Mapping, analysis: Mapping, hidden: frozenset[str], reported: bool) -> str:
    """right, wrong, partly, ambiguous, unexplained, missed, failed or unfinished."""
    verdict = analysis.get("verdict")
    if verdict is None:
        if analysis.get("error") == UNFINISHED:
            return UNFINISHED
        return "right" if reported else "failed"  # the files were refused because of the damage
    kind, effects = verdict["verdict"], verdict["effects"]
    if "damage" in truth:
        channels = truth["damage"]["channels"]
        if not all(_is_fault_of(effect, channels) for effect in (*effects, *verdict["certain"])):
            return "wrong"
        return "right" if reported else "ambiguous" if kind == "ambiguous" else "missed"
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
            _inseparable(explanation, hidden, merged) for explanation in explanations
        )
        return "right" if foreseen else "ambiguous"
    named = named_labels(effects, hidden)
    if _is_off_list(truth):
        return "right" if named == hidden or _is_the_force(truth, verdict) else "wrong"
    return "right" if named == hidden else "partly" if named < hidden else "wrong"


def _is_off_list(truth: Mapping) -> bool:
    """Whether an unlisted effect is hidden."""
    return not all(effect["listed"] for effect in truth["effects"])


def _equivalent(verdict: Mapping) -> list[frozenset[str]]:
    """The equivalent explanations of an ambiguous verdict."""
    return list(map(labels, verdict["equivalent"])) if verdict["verdict"] == "ambiguous" else []


def _inseparable(
    explanation: frozenset[str], hidden: frozenset[str], merged: Sequence[set[str]]
) -> bool:
    """Whether an explanation differs only by effects that preflight could not separate."""
    extra, absent = explanation - hidden, hidden - explanation
    return len(extra) == len(absent) and any(
        all(any({a, b} <= group for group in merged) for a, b in zip(extra, order, strict=True))
        for order in permutations(absent)
    )


def _is_the_force(truth: Mapping, verdict: Mapping) -> bool:
    """Whether the named effect is a discovered force within `SAME_FORCE_RMS` of the true one."""
    force = truth["effects"][0].get("force")
    if force is None or [effect["name"] for effect in verdict["effects"]] != [force["kind"]]:
        return False
    values = {key: entry["value"] for key, entry in verdict["effects"][0]["parameters"].items()}
    found = formula_values(values.pop("formula"), values, pd.DataFrame(force["states"]))
    true = np.array(force["value"])
    rms = np.sqrt(np.mean(true**2))
    return bool(np.sqrt(np.mean((found - true) ** 2)) <= SAME_FORCE_RMS * rms)


def _size_errors(truth: Mapping, verdict: Mapping) -> dict[str, float]:
    """Mean relative error of the sizes (first parameters), and the share within their intervals.

    A size without an interval (at a bound) is not covered.
    """
    named = {effect_label(effect): effect["parameters"] for effect in verdict["effects"]}
    rows = []
    for effect in truth["effects"]:
        key, true = next(iter(effect["parameters"].items()))
        # none if the family is named by another member
        estimate = named.get(effect_label(effect), {}).get(key)
        if estimate is not None and true:
            row = {"error": abs(estimate["value"] / true - 1)}
            for level in LEVELS:
                row[f"covered_{level}"] = _within(true, estimate.get(f"interval_{level}"))
            rows.append(row)
    return pd.DataFrame(rows).mean().to_dict()


def _nuisance_coverage(truth: Mapping, verdict: Mapping) -> dict[str, float]:
    """Number of nuisances with intervals, and of true values within these."""
    known, counts = truth.get("nuisances", {}), {}
    stated = verdict.get("nuisances", {}).items()
    pairs = [(known[key], estimate) for key, estimate in stated if key in known]
    for level in LEVELS:
        ends = [(true, estimate.get(f"interval_{level}") or (None,)) for true, estimate in pairs]
        inside = [_within(true, interval) for true, interval in ends if None not in interval]
        if inside:
            counts["nuisances"] = float(len(inside))
            counts[f"nuisances_covered_{level}"] = float(sum(inside))
    return counts


def _bin_counts(truth: Mapping, analysis: Mapping) -> dict[str, int]:
    """Bins of the crank angle that the map flags rightly, falsely and not."""
    if not truth.get("where"):
        return {}
    counts = dict.fromkeys(("map_hit", "map_false", "map_missed"), 0)
    for key, sizes in truth["where"].items():
        sizes, flagged = np.array(sizes), np.zeros(len(sizes), bool)
        flagged[analysis.get("map", {}).get(key, [])] = True
        counts["map_hit"] += int((flagged & (sizes >= SHOWS_FROM)).sum())
        counts["map_false"] += int((flagged & (sizes <= HIDDEN_UP_TO)).sum())
        counts["map_missed"] += int((~flagged & (sizes >= SHOWS_FROM)).sum())
    return counts


def _name_counts(truth: Mapping, verdict: Mapping, hidden: frozenset[str]) -> dict[str, int]:
    """Effects named rightly, falsely and not; unlisted ones cannot be missed."""
    named, missed = named_labels(verdict["effects"], hidden), 0
    if "damage" in truth:
        channels = truth["damage"]["channels"]
        hit, harmless = 0, sum(_is_fault_of(effect, channels) for effect in verdict["effects"])
    elif _is_off_list(truth):
        hit = harmless = len(named & hidden) or int(_is_the_force(truth, verdict))
    else:
        hit = harmless = len(named & hidden)
        missed = len(hidden - named)
    return {"names_hit": hit, "names_false": len(named) - harmless, "names_missed": missed}


def _cause(hidden: frozenset[str], bic: Mapping[str, float]) -> str:
    """Why the hidden effects were not named, by the BIC of all fits."""
    by_labels = {frozenset(name.split(" + ")): value for name, value in bic.items()}
    if not by_labels:
        return ""
    if hidden not in by_labels:
        return "the hidden effects were not fitted together"
    best = min(by_labels, key=by_labels.__getitem__)
    if best == hidden:
        return "the hidden effects fit best, and the decision asks for more"
    difference = by_labels[hidden] - by_labels[best]
    return f"{' + '.join(sorted(best))} fits better, BIC lower by {difference:.4g}"


def ratio_row(part: pd.DataFrame, counted: str, of: str) -> dict[str, float]:
    """Precision, recall or F1 over all trials, with a 95 % interval.

    Clopper and Pearson's interval for the number of independent items with the same scatter between
    trials (Korn and Graubard, Survey Methodology 24 (1998) 193); without scatter the number of
    trials.
    """
    columns = [f"{counted}_{end}" for end in ("hit", "false", "missed")]
    hit, false, missed = part[columns].to_numpy(float).T
    shares = {"precision": (1.0, 0.0), "recall": (0.0, 1.0), "F1": (0.5, 0.5)}
    false_share, missed_share = shares[of]
    total = hit + false_share * false + missed_share * missed
    number, value = max(np.count_nonzero(total), 1), hit.sum() / max(total.sum(), 1e-9)
    if (scatter := np.sum((hit - value * total) ** 2)) > 0.0:
        number = value * (1.0 - value) * total.sum() ** 2 * (1.0 - 1.0 / number) / scatter
    hits = value * number
    # NaN if there are no hits, or only hits
    low = np.nan_to_num(beta.ppf(0.025, hits, number - hits + 1.0), nan=0.0)
    high = np.nan_to_num(beta.ppf(0.975, hits + 1.0, number - hits), nan=1.0)
    return {"count": len(part), "value": float(value), "low": float(low), "high": float(high)}


def confusion(trials: pd.DataFrame) -> pd.DataFrame:
    """Counts of hidden and named effects (data faults by kind): hidden, named, count."""
    fault = trials["hidden"].str.split(":").str[0]
    hidden = trials["hidden"].where(trials["kind"] != "wiring", fault)
    named = trials["named"].where(trials["named"] != "", trials["verdict"])
    pairs = pd.DataFrame({"hidden": hidden, "named": named})
    return pairs.value_counts().rename("count").reset_index()


def _held_out_gaps(verdict: Mapping) -> dict[str, float]:
    """Gaps of the held-out run, and the closed share of the excess (0 if nothing was added or it
    cannot be simulated)."""
    gap = verdict["gap"].get("confirm") or {}
    if not verdict.get("effects"):
        gap = gap | {"after": gap.get("before")}
    before, after = (math.nan if gap.get(key) is None else gap[key] for key in ("before", "after"))
    closed = math.nan
    if before > CLOSED_FROM_GAP:
        closed = 0.0 if math.isnan(after) else share_closed(before, after)
    return {"gap_before": before, "gap_after": after, "closed": closed}


def rates(trials: pd.DataFrame) -> pd.DataFrame:
    """Rates and medians of a set: what, group, count, value, low, high.

    Shares have the 95 % interval of Clopper and Pearson (Biometrika 26 (1934) 404-413), medians
    that of order statistics.
    """
    one = trials["kind"].isin(["single", "exudyn", "clearance"]) & (trials["hidden"] != "nothing")
    loosened = trials["hidden"].str.fullmatch(r"\w+_clearance")
    apart = trials["kind"].isin(RECIPE["apart"])
    trials = trials.assign(one=one, loosened=loosened, apart=apart)
    parts = {name: trials.query(condition) for name, condition in RECIPE["parts"].items()}
    rows = []
    for what, rate in RECIPE["rates"].items():
        counted = parts[rate["of"]]
        if "where" in rate:
            counted = counted.query(rate["where"])
        if "is" in rate:
            counted = counted.assign(hit=counted.eval(rate["is"]))
        for group, part in _groups(counted, rate.get("by", ["all"])).items():
            if "quantile" in rate:
                row = quantile_row(part[rate["quantile"]], rate.get("share", 0.5))
            elif "ratio" in rate:
                row = ratio_row(part, *rate["ratio"])
            elif "covered" in rate:
                row = share_row(part[rate["covered"]].sum(), int(part["nuisances"].sum()))
            else:
                row = share_row(part["hit"].sum(), len(part))
            rows.append({"what": what, "group": group, **row})
    return pd.DataFrame([row for row in rows if row["count"]])


def _groups(trials: pd.DataFrame, by: Collection[str]) -> dict[str, pd.DataFrame]:
    """Trials in total, by base, drive, gap, data fault, hidden fault, and those from Exudyn."""
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
        "fault": trials["hidden"],
    }
    separate = [key for key in by if key != "drive" or trials["drive"].nunique() > 1]
    return {name: part for key in separate for name, part in trials.groupby(keys[key])}


def share_row(hits: float, count: int) -> dict[str, float]:
    """A share; a trial may count a half."""
    if not count:
        return {"count": 0}
    low, high = binomtest(round(hits), count).proportion_ci(0.95, "exact")
    return {"count": count, "value": round(hits) / count, "low": float(low), "high": float(high)}


def quantile_row(values: pd.Series, share: float) -> dict[str, float]:
    """A quantile between two of the sorted values; with few values the outermost ones."""
    known = values.dropna().to_numpy(float)
    if not known.size:
        return {"count": 0}
    low, high = quantile_test(known, p=share).confidence_interval(0.95)
    low, high = np.nan_to_num(low, nan=known.min()), np.nan_to_num(high, nan=known.max())
    value = np.quantile(known, share)
    return {"count": known.size, "value": value, "low": float(low), "high": float(high)}
