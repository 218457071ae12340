"""Text of effects, parameters and the verdict."""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from math import floor, inf
from typing import Any

from jointgap.config.campaign import NUISANCES
from jointgap.config.channels import CHANNELS
from jointgap.core import words
from jointgap.core.words import format_name, joined, number, percent, reading_unit, rounded_gap
from jointgap.effects import EFFECTS
from jointgap.effects.base import parameters_of
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.verdict import (
    FALLS,
    RISES,
    STAYS,
    HeldOutTest,
    gap_change,
    share_closed,
)
from jointgap.rig.sensors import FAULTS

ENOUGH = ("no_disagreement", "parameters_only")
"""Verdicts without a missing effect."""

_DECISION = DEFAULT_SETTINGS.decision

Effect = Mapping[str, Any]
"""An effect as in ``verdict.json``."""


def format_effect(effect: Effect) -> str:
    """``Coulomb friction of the slider``; of a family
    ``drag of the slider (exponent 1.6 to 5, 99 % interval; quadratic drag of the slider fits)``; of
    a law of the campaign file ``my drag (-c*v^3)``. The interval of a shape that is a parameter of
    the effect is that of 90 %, as in the table of the parameters.
    """
    site = effect["site"].replace("_", " ")
    words, named = _words(effect["name"]).format(site=site), []
    words += f" ({effect['formula']})" if "formula" in effect else ""
    for family in effect.get("families", ()):
        if family["named"]:
            low, high = (f"{end:.2g}" for end in family["interval_99"])
            interval, fits = f"{low} to {high}, 99 % interval", f"; {words} fits"
            if effect["name"] == family["law"]:
                own, fits = effect["parameters"].get(family["shape"], {}), ""
                if None not in own.get("interval_90", (None,)):
                    interval = f"{estimate_row('', own, '1')[2]}, 90 % interval"
            law = _words(family["law"]).format(site=site)
            named.append(f"{law} ({family['shape'].replace('_', ' ')} {interval}{fits})")
    others = [format_effect(other) for other in effect.get("alternatives", ())]
    return " or ".join([*(named or [words]), *others])


def _words(name: str) -> str:
    template = (
        EFFECTS[name].WORDS if name in EFFECTS else FAULTS[name].words if name in FAULTS else ""
    )
    return template or name.replace("_", " ")


def format_label(label: str) -> str:
    """``a bias of the sensor of crank torque`` for ``sensor_bias:crank_torque``; of an explanation
    ``a + b`` all effects, where the terms of a force law are one effect."""
    effects: dict[str, list[str]] = {}
    for own in label.split(" + "):
        own, _, term = own.removesuffix("]").partition("[")
        effects.setdefault(own, []).extend([term] if term else [])
    return joined(_format_one(own) + _format_terms(terms) for own, terms in effects.items())


def _format_one(label: str) -> str:
    name, _, site = label.partition(":")
    return (
        format_effect({"name": name, "site": site})
        if site or "{site}" not in _words(name)
        else name
    )


def _format_terms(terms: Sequence[str]) -> str:
    return f" (term{'s' * (len(terms) > 1)} {joined(terms)})" if terms else ""


def label_of(effect: Effect) -> str:
    """The label of an effect, with its site if the effect has several."""
    name, site = effect["name"], effect["site"]
    has_site = name in FAULTS or "site" in getattr(EFFECTS.get(name), "model_fields", ())
    return f"{name}:{site}" if has_site else name


def is_fault(effect: Effect) -> bool:
    """Whether an effect is a sensor fault."""
    return effect["name"] in FAULTS


def format_explanation(effects: Sequence[Effect]) -> str:
    """The effects of one explanation with the values of their parameters."""
    parts = []
    for effect in effects:
        rows = parameter_rows([effect])
        values = ", ".join(
            f"{name} {value}" if len(rows) > 1 else value for name, value, *_ in rows
        )
        parts.append(format_effect(effect) + (f" ({values})" if values else ""))
    return joined(parts)


def headline(effects: Sequence[Effect]) -> str:
    """Each effect with its most precise parameter:
    ``Coulomb friction of the slider, 5.000 N (90 % interval ...)``."""
    return joined(format_effect(effect) + _first_number(effect) for effect in effects)


def _first_number(effect: Effect) -> str:
    own = effect["parameters"]
    if "formula" in own:
        return f": {own['formula']['value']}"
    units = {
        name: estimate_unit(effect, name)
        for name, estimate in own.items()
        if isinstance(estimate["value"], int | float)
    }
    if not units:
        return ""
    first = next(iter(units))
    alike = [name for name, unit in units.items() if unit == units[first]]
    best = max(alike, key=lambda name: abs(own[name]["value"]) / (own[name].get("sd") or inf))
    name = "" if best == first else f"{format_parameter(effect['name'], best)} "
    return f", {name}{format_estimate(*estimate_row('', own[best], units[best])[1:])}"


def format_estimate(value: str, interval: str, remark: str = "") -> str:
    """``5.93 N (90 % interval 5.89 to 5.98)``;
    ``0.8 (at its bound; 90 % interval 0.71 to 0.8)``."""
    sure = "; ".join(filter(None, (remark, "" if interval == "–" else f"90 % interval {interval}")))
    return f"{value} ({sure})" if sure else value


@cache
def _parameters(name: str) -> dict[str, tuple[str, str]]:
    """Meaning and unit of each parameter of an effect; unit None: that of the channel."""
    if name in FAULTS:
        return {key: ("", unit or None) for key, unit in FAULTS[name].parameters.items()}
    is_law = name.startswith("discovered_")  # its parameters are a formula and its coefficients
    own = parameters_of(EFFECTS[name]) if name in EFFECTS else ()
    return {p.name: ("" if is_law else p.meaning, p.unit) for p in own}


def format_parameter(effect: str, name: str) -> str:
    """``friction force`` for ``force_N``, ``zero of run slow`` for ``zero_rad@slow``."""
    key, _, run = name.partition("@")
    meaning = _parameters(effect).get(key, ("", ""))[0]
    without_unit = format_name(re.sub(r"_(?:rad|deg|[A-Z]\w*|k?g|m|s)$", "", key))
    words = re.sub(r"^\w+, ", "", re.split("; |, which ", meaning)[0]) or without_unit
    return f"{words} of run {run}" if run else words


def unit_of(name: str, site: str, parameter: str) -> str:
    """SI unit of a `parameter` of the effect `name` at `site`: ``1`` for a pure number, empty if
    unknown."""
    unit = _parameters(name).get(parameter.partition("@")[0], ("", ""))[1]
    return CHANNELS.get(site, "SI") if unit is None else unit


def estimate_unit(effect: Effect, parameter: str) -> str:
    """SI unit of a `parameter` of an effect, which states that of a law of the campaign file
    itself."""
    return effect["parameters"][parameter].get("unit") or unit_of(
        effect["name"], effect["site"], parameter
    )


def parameter_rows(effects: Sequence[Effect]) -> tuple[tuple[str, ...], ...]:
    """Rows of `estimate_row` of all parameters, prefixed by the effect if there are several."""
    rows = []
    for effect in effects:
        of_effect = f"{format_effect({**effect, 'families': ()})}: " if len(effects) > 1 else ""
        for name, estimate in effect.get("parameters", {}).items():
            unit = estimate_unit(effect, name)
            rows.append(
                estimate_row(of_effect + format_parameter(effect["name"], name), estimate, unit)
            )
    return tuple(rows)


def estimate_row(name: str, estimate: Mapping[str, Any], unit: str) -> tuple[str, str, str, str]:
    """`name`, value with unit, 90 % interval and remark of a parameter; the `estimate` of
    ``verdict.json`` is in SI."""
    ends = estimate.get("interval_90") or (None, None)
    known = [abs(own) for own in (estimate["value"], *ends) if isinstance(own, int | float)]
    unit, factor = reading_unit(unit, max(known, default=None))
    value, error, low, high = (
        factor * own if isinstance(own, int | float) else own
        for own in (estimate["value"], estimate.get("sd"), *ends)
    )
    if error is None and None not in (low, high):
        error = (high - low) / 4.0  # sets only the number of digits
    shown = ["–" if end is None else words.with_error(end, error)[0] for end in (low, high)]
    interval = "–" if shown == ["–", "–"] else " to ".join(shown)
    text = words.with_unit(words.with_error(value, error)[0], words.format_unit(unit))
    return name, text, interval, estimate.get("remark", "")


def format_detectable(row: Any) -> str:
    """Smallest detectable size of a row of table `DETECTABLE`: ``0.03 N``; ``up to 50 Hz`` if the
    effect decreases with its parameter."""
    effect = row.label.partition(":")[0]
    name = f"{format_parameter(effect, row.parameter)} " if len(_parameters(effect)) != 1 else ""
    unit, factor = reading_unit(row.unit, row.smallest_detectable)
    size = words.with_unit(number(factor * row.smallest_detectable), words.format_unit(unit))
    return f"{name}{'up to ' * row.falls}{size}"


def names_to_labels(sentence: str) -> str:
    """A `sentence` with effects, channels and nuisances in words, except between backticks."""
    parts = re.split(r"(`[^`]+`)", sentence)
    return "".join(
        part if n % 2 else _CODE_NAME.sub(_in_words, part) for n, part in enumerate(parts)
    )


def _in_words(found: re.Match) -> str:
    label = found[0]
    if re.split(r"[:\[ ]", label)[0] in {*EFFECTS, *FAULTS}:
        return format_label(label)
    name, _, site = label.partition(":")
    return (words.format_nuisance(name) if name in NUISANCES else format_name(name)) + (
        f":{site}" if site else ""
    )


def _any_of(names: Iterable[str]) -> str:
    return rf"(?:{'|'.join(sorted(names, key=len)[::-1])})(?::\w+)?(?:\[[^\]]*\])?"


_EFFECT = _any_of({*EFFECTS, *FAULTS})
_CODE_NAME = re.compile(
    rf"(?<![\w./-])(?:{_EFFECT}(?: \+ {_EFFECT})+|"
    + _any_of(name for name in {*EFFECTS, *FAULTS, *CHANNELS, *NUISANCES} if "_" in name)
    + r")(?![\w/]|\.\w)"
)
"""Explanations ``a + b``, and names with an underscore; ``gravity`` and ``speed`` are words
already."""


def answer(verdict: Mapping[str, Any]) -> str:
    """The verdict, content of ``verdict.json``, in a few sentences."""
    kind, effects, gap = verdict["verdict"], verdict["effects"], verdict["gap"]
    if effects:
        faults, missing = (
            [e for e in effects if is_fault(e)],
            [e for e in effects if not is_fault(e)],
        )
        found = f"The model lacks {joined(map(format_effect, missing))}."
        if faults:
            fault = f"The measurement has a fault: {format_explanation(faults)}."
            if any(effect.get("alternatives") for effect in faults):
                fault += " These data cannot show which of them."
            found = (
                f"{found} {fault}" if missing else f"The mechanism model lacks no effect. {fault}"
            )
        added = "these effects" if effects[1:] else "this effect"
        fit = f"With {added} the residual of the fitted data is consistent with noise."
        if gap["identify"]["after"] > _DECISION.noise_gap:
            fit = (
                f"The gap {gap_change(**gap['identify'])}; no tested effect explains the remaining"
                " residual."
            )
        return f"{found} {fit}{_held_out_misfit(verdict)}"
    if kind in ENOUGH:
        model = (
            "of the current model"
            if kind == "no_disagreement"
            else "after re-fitting the uncertain parameters"
        )
        return (
            f"No missing effect detected: the residual {model} is consistent with"
            f" noise.{_held_out_misfit(verdict)}"
        )
    certain = certain_summary(verdict)
    if kind == "ambiguous":
        text = (
            f"An effect is missing: {len(verdict['equivalent'])} explanations fit equally"
            f" well.{certain}"
        )
        return f"{text}{_left_by_all(verdict)} None was added to the model."
    if inconsistent := verdict["doubted_channels"]:
        checked = joined(map(format_name, inconsistent))
        text = f"Channels are inconsistent, so no effect can be identified: check {checked}."
    elif is_refuted(verdict):
        text = (
            "An effect is missing, but no tested effect explains the residual. With the best fit, "
        )
        text += f"{format_explanation(verdict['best_known']['effects'])}, the gap on held-out data "
        text += f"{gap_change(**gap['confirm'], most_digits=4)}."
    elif best := verdict["best_known"]:
        text = f"An effect is missing. The best candidate, {format_explanation(best['effects'])}, "
        text += f"{_explained(verdict)}, but is not confirmed"
        left = gap["confirm"]["after"] or 0.0
        text += (
            f": on the held-out data a gap of {rounded_gap(left)} remains."
            if _exceeds_noise(verdict)
            else "."
        )
    else:
        text = "An effect is missing, but no tested effect explains the residual."
    return f"{text}{certain} No effect was added to the model."


def is_refuted(verdict: Mapping[str, Any]) -> bool:
    """Whether the gap on held-out data rises with the best candidate."""
    if not verdict["best_known"]:
        return False
    before, after = verdict["gap"]["confirm"].values()
    return after is not None and (
        verdict["held_out_test"] == RISES or gap_change(before, after).startswith(RISES)
    )


def _explained(verdict: Mapping[str, Any]) -> str:
    """What the best candidate explains of the fitted data; nearly all only if the held-out gap is
    noise."""
    gap = verdict["gap"]["identify"]
    if share := share_explained(verdict):
        return f"explains {share} of the misfit of the fitted data"
    if gap["after"] <= _DECISION.noise_gap < gap["before"] and not _exceeds_noise(verdict):
        return "explains the misfit of the fitted data"
    change = gap_change(**gap)
    if change.startswith(FALLS):
        return f"reduces the gap of the fitted data{change.removeprefix(FALLS)}"
    return f"does not reduce the gap of the fitted data, which {change}"


def _exceeds_noise(verdict: Mapping[str, Any]) -> bool:
    """Whether the gap on held-out data exceeds noise with the best candidate."""
    return (verdict["gap"]["confirm"]["after"] or 0.0) > _DECISION.max_gap_of_noise


def certain_summary(verdict: Mapping[str, Any]) -> str:
    """What all near explanations share, and in what they differ; empty if they share nothing."""
    certain, best = verdict["certain"], verdict["best_known"]
    is_doubted = verdict["verdict"] == "unexplained" and bool(verdict["doubted_channels"])
    if not certain or is_doubted or is_refuted(verdict):
        return ""
    shared = {label_of(effect) for effect in certain}
    explanations = [[label_of(effect) for effect in effects] for effects in verdict["equivalent"]]
    if not explanations and best:
        rival = best["rival"]["explanation"].split(" + ") if best["rival"] else shared
        explanations = [[label_of(effect) for effect in best["effects"]]]
        explanations += [rival] if shared < {*rival} else []
    others = [
        " + ".join(label for label in labels if label not in shared) for labels in explanations
    ]
    rest = (
        f"; the rest is {' or '.join(map(format_label, others))}"
        if len(others) > 1 and all(others)
        else ""
    )
    begin = "All contain" if verdict["verdict"] == "ambiguous" else "Certain is"
    return f" {begin} {format_explanation(certain)}{rest}, of those tried."


def _left_by_all(verdict: Mapping[str, Any]) -> str:
    """What equivalent explanations leave of the gap on held-out data, if that is most of it."""
    before, after = verdict["gap"]["confirm"].values()
    if after is None or not before > _DECISION.noise_gap or after <= _DECISION.noise_gap:
        return ""
    if share_closed(before, after) >= 1.0 - _DECISION.max_share_of_wrong_misfit:
        return ""
    left = f"{rounded_gap(after)} where it was {rounded_gap(before)}"
    return f" They explain little: on held-out data the best of them leaves a gap of {left}."


_NOTHING_HELD_OUT = "No held-out data confirm it: none of their samples can be used"


def _held_out_misfit(verdict: Mapping[str, Any]) -> str:
    """Which held-out runs cannot be simulated, and the largest gap if it exceeds noise."""
    gap, when, text = verdict["gap"]["confirm"], "after" if verdict["effects"] else "before", ""
    if gap["before"] is None:
        return f" {_NOTHING_HELD_OUT}."
    gaps = [gap[when]]
    if gap[when] is None:
        text, gaps = (
            f" {_not_simulated(verdict)}.",
            [run["gap"][when] for run in verdict["held_out"]],
        )
    largest = max((gap for gap in gaps if gap is not None), default=0.0)
    if largest > _DECISION.max_gap_of_noise:
        return (
            f"{text} The model does not fit the held-out data: their gap is {rounded_gap(largest)}"
            " (1 is noise)."
        )
    return (
        f"{text} The held-out data do not confirm it."
        if verdict["held_out_test"] == STAYS
        else text
    )


def _not_simulated(verdict: Mapping[str, Any]) -> str:
    lost = [
        f"run {run['run']} ({run['not_simulated']})"
        for run in verdict["held_out"]
        if "not_simulated" in run
    ]
    return (
        f"The model with the added effects cannot be simulated in {joined(lost)}, so there it is"
        " not confirmed"
    )


def left_out_summary(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """A sentence for each run that was not used and each output that failed, and the steps that
    were not run."""
    left = [
        f"Run {one['run']} was not used: {one['because']}." for one in verdict.get("left_out", ())
    ]
    if steps := verdict.get("not_searched"):
        left.append(
            "Not searched, as the limit of simulations was reached:"
            f" {joined(map(names_to_labels, steps))}."
        )
    failed = verdict.get("failed", {})
    return (*left, *(f"{format_name(what)} failed: {why}." for what, why in failed.items()))


def share_explained(verdict: Mapping[str, Any]) -> str:
    """Share of the misfit beyond noise [%] that the best candidate explains of the fitted data;
    empty if it is unknown, all, nearly all although the held-out gap exceeds noise, or no fall of
    the gap."""
    share, gap = verdict["best_known"]["explained_share"], verdict["gap"]["identify"]
    if share is not None and share >= _DECISION.min_explained_share and _exceeds_noise(verdict):
        return ""
    is_part = (
        share is not None and 0.0 < round(share, 3) < 1.0 and gap_change(**gap).startswith(FALLS)
    )
    return percent(share) if is_part else ""


def format_gain(gain: float | None) -> str:
    """A gain in BIC: a number up to 1000, as residuals beyond noise make larger ones
    meaningless."""
    if gain is None:
        return "unknown"
    return (
        "none" if round(gain) <= 0 else "more than 1000" if gain > _LARGEST_GAIN else f"{gain:.0f}"
    )


_LARGEST_GAIN = 1000.0

_OF_TEST = {
    "stays": ", although it should fall",
    "rises": ": the added effects do not hold there",
    "cannot_tell": ": these data cannot tell whether the effects hold",
}


def held_out_summary(verdict: Mapping[str, Any]) -> str:
    """The change of the gap on held-out data, without the full stop."""
    test, gap = verdict["held_out_test"], verdict["gap"]["confirm"]
    before, after = gap["before"], gap["after"]
    if before is None:
        return _NOTHING_HELD_OUT
    if not (verdict["effects"] or verdict["best_known"] or verdict["equivalent"]):
        return f"The gap on held-out data is {rounded_gap(before)}"
    if after is None:
        return (
            f"The gap on held-out data is {rounded_gap(before)} without effects."
            f" {_not_simulated(verdict)}"
        )
    added = "With the best fit the" if verdict["best_known"] else "The"
    added = "With the first of these explanations the" if verdict["equivalent"] else added
    text = f"{added} gap on held-out data {HeldOutTest(test, before, after).summary}"
    if verdict["effects"] and test == FALLS and before > _DECISION.noise_gap:
        share = share_closed(before, after)
        explained = 100.0 if after <= 1.0 else floor(round(1000.0 * share, 6)) / 10.0
        text += f": {explained:.1f} % of the excess over noise is explained"
    return text + _OF_TEST.get(test, "")


def best_known_summary(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """The best candidate: its gaps, the next best one, and how to confirm it."""
    best = verdict["best_known"]
    if best is None:
        return ()
    lines = [
        f"On the fitted data the gap {gap_change(**verdict['gap']['identify'])}.",
        f"{held_out_summary(verdict)}.",
    ]
    if rival := best["rival"]:
        behind, other = rival["behind"], format_label(rival["explanation"])
        if round(behind) < 0:
            lines.append(
                f"Another explanation, {other}, has a BIC that is smaller by"
                f" {format_gain(-behind)}."
            )
        else:
            differs = f"larger by {format_gain(behind)}" if round(behind) else "the same"
            lines.append(f"The next best explanation is {other}; its BIC is {differs}.")
    return (*lines, *_confirmation(verdict))


def _confirmation(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """How the best candidate can be confirmed; empty if the held-out data contradict it or no
    measurement helps."""
    best, test, held_out = (
        verdict["best_known"],
        verdict["held_out_test"],
        verdict["gap"]["confirm"],
    )
    if verdict["doubted_channels"]:
        way = "check the wiring of the inconsistent channels and measure again"
    elif is_refuted(verdict) or (test == STAYS and held_out["after"] >= held_out["before"]):
        return ()
    elif is_near(best["rival"]):
        return (names_to_labels(advice),) if (advice := verdict.get("separated_by")) else ()
    elif test == "not_simulated":
        way = "hold out a run that can be simulated with it"
    elif test in ("cannot_tell", "nothing_held_out"):
        way = "measure a longer held-out run"
    else:
        way = (
            "explain the remaining residual by a further effect or wider bounds; see the map of"
            " disagreement"
        )
    return (f"To confirm it: {way}.",)


def is_near(rival: Mapping[str, Any] | None) -> bool:
    """Whether the next best explanation is equivalent to the best candidate."""
    return rival is not None and abs(rival["behind"]) < _DECISION.min_delta_bic
