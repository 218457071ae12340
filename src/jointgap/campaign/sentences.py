"""Text of effects, parameters and the verdict."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from math import inf
from typing import Any

from jointgap.config.campaign import CHANNELS, NUISANCES
from jointgap.core import words
from jointgap.core.words import format_name, joined, number, percent, reading_unit, rounded_gap
from jointgap.effects import EFFECTS
from jointgap.effects.base import parameters_of
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.verdict import RISES, STAYS, HeldOutTest, share_closed
from jointgap.rig.sensors import FAULTS

ENOUGH = ("no_disagreement", "parameters_only")
"""Verdicts without a missing effect."""

_DECISION = DEFAULT_SETTINGS.decision

Effect = Mapping[str, Any]
"""An effect as in ``verdict.json``."""


def format_effect(effect: Effect) -> str:
    """``Coulomb friction of the slider``; of a family
    ``drag of the slider (exponent 1.6 to 5; quadratic drag of the slider fits)``.
    """
    site = effect["site"].replace("_", " ")
    words, named = _words(effect["name"]).format(site=site), []
    for family in effect.get("families", ()):
        if family["named"]:
            low, high = (f"{end:.2g}" for end in family["interval_99"])
            fits = "" if effect["name"] == family["law"] else f"; {words} fits"
            law = _words(family["law"]).format(site=site)
            named.append(f"{law} ({family['shape'].replace('_', ' ')} {low} to {high}{fits})")
    return " or ".join(named) or words


def _words(name: str) -> str:
    template = EFFECTS[name].WORDS if name in EFFECTS else FAULTS[name].words if name in FAULTS else ""
    return template or name.replace("_", " ")


def format_label(label: str) -> str:
    """``a bias of the sensor of crank torque`` for ``sensor_bias:crank_torque``."""
    name, _, site = label.partition(":")
    return format_effect({"name": name, "site": site}) if site or "{site}" not in _words(name) else name


def label_of(effect: Effect) -> str:
    """The label of an effect, with its site if the effect has several."""
    name, site = effect["name"], effect["site"]
    return name if name in EFFECTS and "site" not in EFFECTS[name].model_fields else f"{name}:{site}"


def is_fault(effect: Effect) -> bool:
    """Whether an effect is a sensor fault."""
    return effect["name"] in FAULTS


def format_explanation(effects: Sequence[Effect]) -> str:
    """The effects of one explanation with the values of their parameters."""
    parts = []
    for effect in effects:
        rows = parameter_rows([effect])
        values = ", ".join(f"{name} {value}" if len(rows) > 1 else value for name, value, *_ in rows)
        parts.append(format_effect(effect) + (f" ({values})" if values else ""))
    return joined(parts)


def headline(effects: Sequence[Effect]) -> str:
    """Each effect with its most precise parameter: ``Coulomb friction of the slider, 5.000 N (90 % interval ...)``."""
    return joined(format_effect(effect) + _first_number(effect) for effect in effects)


def _first_number(effect: Effect) -> str:
    own = effect["parameters"]
    if "formula" in own:
        return f": {own['formula']['value']}"
    units = {
        name: unit_of(effect["name"], effect["site"], name)
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
    """``5.93 N (90 % interval 5.89 to 5.98)``; ``0.8 (at its bound; 90 % interval 0.71 to 0.8)``."""
    sure = "; ".join(filter(None, (remark, "" if interval == "–" else f"90 % interval {interval}")))
    return f"{value} ({sure})" if sure else value


@cache
def _parameters(name: str) -> dict[str, tuple[str, str]]:
    """Meaning and unit of each parameter of an effect; unit None: that of the channel."""
    if name in FAULTS:
        return {FAULTS[name].parameter: ("", FAULTS[name].unit or None)}
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
    """SI unit of a `parameter` of the effect `name` at `site`: ``1`` for a pure number, empty if unknown."""
    unit = _parameters(name).get(parameter.partition("@")[0], ("", ""))[1]
    return CHANNELS.get(site, "SI") if unit is None else unit


def parameter_rows(effects: Sequence[Effect]) -> tuple[tuple[str, ...], ...]:
    """Rows of `estimate_row` of all parameters, prefixed by the effect if there are several."""
    rows = []
    for effect in effects:
        of_effect = f"{format_effect({**effect, 'families': ()})}: " if len(effects) > 1 else ""
        for name, estimate in effect.get("parameters", {}).items():
            unit = unit_of(effect["name"], effect["site"], name)
            rows.append(estimate_row(of_effect + format_parameter(effect["name"], name), estimate, unit))
    return tuple(rows)


def estimate_row(name: str, estimate: Mapping[str, Any], unit: str) -> tuple[str, str, str, str]:
    """`name`, value with unit, 90 % interval and remark of a parameter; the `estimate` of ``verdict.json`` is in SI."""
    ends = estimate.get("interval_90") or (None, None)
    known = [abs(own) for own in (estimate["value"], *ends) if isinstance(own, int | float)]
    unit, factor = reading_unit(unit, max(known, default=None))
    value, error, low, high = (
        factor * own if isinstance(own, int | float) else own for own in (estimate["value"], estimate.get("sd"), *ends)
    )
    if error is None and None not in (low, high):
        error = (high - low) / 4.0  # sets only the number of digits
    shown = ["–" if end is None else words.with_error(end, error)[0] for end in (low, high)]
    interval = "–" if shown == ["–", "–"] else " to ".join(shown)
    text = words.with_unit(words.with_error(value, error)[0], words.format_unit(unit))
    return name, text, interval, estimate.get("remark", "")


def format_detectable(row: Any) -> str:
    """Smallest detectable size of a row of table `DETECTABLE`: ``0.03 N``; ``up to 50 Hz`` if the effect decreases with
    its parameter."""
    effect = row.label.partition(":")[0]
    name = f"{format_parameter(effect, row.parameter)} " if len(_parameters(effect)) > 1 else ""
    unit, factor = reading_unit(row.unit, row.smallest_detectable)
    size = words.with_unit(number(factor * row.smallest_detectable), words.format_unit(unit))
    return f"{name}{'up to ' * row.falls}{size}"


def names_to_labels(sentence: str) -> str:
    """A `sentence` with effects, channels and nuisances in words, except between backticks."""
    parts = re.split(r"(`[^`]+`)", sentence)
    return "".join(part if n % 2 else _CODE_NAME.sub(_in_words, part) for n, part in enumerate(parts))


def _in_words(found: re.Match) -> str:
    name, site = found["name"], found["site"]
    if name in EFFECTS or name in FAULTS:
        return format_label(f"{name}:{site}" if site else name)
    return words.format_nuisance(name) if name in NUISANCES else format_name(name)


_CODE_NAME = re.compile(
    r"(?<![\w./-])(?P<name>"
    + "|".join(sorted((name for name in {*EFFECTS, *FAULTS, *CHANNELS, *NUISANCES} if "_" in name), key=len)[::-1])
    + r")(?::(?P<site>\w+))?(?![\w/]|\.\w)"
)
"""Names with an underscore; ``gravity`` and ``speed`` are words already."""


def answer(verdict: Mapping[str, Any]) -> str:
    """The verdict, content of ``verdict.json``, in two or three sentences."""
    kind, effects, gap = verdict["verdict"], verdict["effects"], verdict["gap"]
    if effects:
        faults, missing = [e for e in effects if is_fault(e)], [e for e in effects if not is_fault(e)]
        found = f"The model lacks {joined(map(format_effect, missing))}."
        if faults:
            fault = f"The measurement has a fault: {format_explanation(faults)}."
            found = f"{found} {fault}" if missing else f"The mechanism model lacks no effect. {fault}"
        added = "these effects" if effects[1:] else "this effect"
        fit = f"With {added} the residual of the fitted data is consistent with noise."
        if gap["identify"]["after"] > _DECISION.noise_gap:
            before, after = map(rounded_gap, gap["identify"].values())
            fit = f"The gap falls from {before} to {after}; no tested effect explains the remaining residual."
        return f"{found} {fit}{_held_out_misfit(verdict)}"
    if kind in ENOUGH:
        model = "of the current model" if kind == "no_disagreement" else "after re-fitting the uncertain parameters"
        return f"No missing effect detected: the residual {model} is consistent with noise.{_held_out_misfit(verdict)}"
    if kind == "ambiguous":
        shared, count = verdict["certain"], len(verdict["equivalent"])
        certain = f" All contain {joined(map(format_effect, shared))}." if shared else ""
        return f"An effect is missing: {count} explanations fit equally well.{certain} None was added to the model."
    if inconsistent := verdict["doubted_channels"]:
        checked = joined(map(format_name, inconsistent))
        text = f"Channels are inconsistent, so no effect can be identified: check {checked}."
    elif best := verdict["best_known"]:
        share = f"{part} of the misfit beyond noise" if (part := share_explained(best)) else "the misfit"
        text = f"An effect is missing. The best candidate, {format_explanation(best['effects'])}, explains {share}, "
        text += "but is not confirmed."
    else:
        text = "An effect is missing, but no tested effect explains the residual."
    return f"{text} No effect was added to the model."


_NOTHING_HELD_OUT = "No held-out data confirm it: none of their samples can be used"


def _held_out_misfit(verdict: Mapping[str, Any]) -> str:
    """Which held-out runs cannot be simulated, and the largest gap if it exceeds noise."""
    gap, when, text = verdict["gap"]["confirm"], "after" if verdict["effects"] else "before", ""
    if gap["before"] is None:
        return f" {_NOTHING_HELD_OUT}."
    gaps = [gap[when]]
    if gap[when] is None:
        text, gaps = f" {_not_simulated(verdict)}.", [run["gap"][when] for run in verdict["held_out"]]
    largest = max((gap for gap in gaps if gap is not None), default=0.0)
    if largest > _DECISION.max_gap_of_noise:
        return f"{text} The model does not fit the held-out data: their gap is {rounded_gap(largest)} (1 is noise)."
    return f"{text} The held-out data do not confirm it." if verdict["held_out_test"] == STAYS else text


def _not_simulated(verdict: Mapping[str, Any]) -> str:
    lost = [f"run {run['run']} ({run['not_simulated']})" for run in verdict["held_out"] if "not_simulated" in run]
    return f"The model with the added effects cannot be simulated in {joined(lost)}, so there it is not confirmed"


def left_out_summary(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """A sentence for each run that was not used and for each output that failed."""
    left = [f"Run {one['run']} was not used: {one['because']}." for one in verdict.get("left_out", ())]
    failed = verdict.get("failed", {})
    return (*left, *(f"{format_name(what)} failed: {why}." for what, why in failed.items()))


def share_explained(best: Mapping[str, Any]) -> str:
    """Share of the misfit beyond noise [%] that an explanation explains; empty if unknown or nearly all."""
    share = best["explained_share"]
    return "" if share is None or round(share, 2) >= 1.0 else percent(share, 0)


_OF_TEST = {
    "stays": ", although it should fall",
    "rises": ": the added effects do not hold there",
    "cannot_tell": ": the effects have too little influence there",
}


def held_out_summary(verdict: Mapping[str, Any], gap: Mapping[str, float | None] | None = None) -> str:
    """The change of the gap on held-out data, without the full stop."""
    shown = verdict if verdict["effects"] else verdict["best_known"] or verdict
    gap, test = gap or shown["gap"]["confirm"], verdict["held_out_test"]
    before, after = gap["before"], gap["after"]
    if before is None:
        return _NOTHING_HELD_OUT
    if after is None:
        return f"The gap on held-out data is {rounded_gap(before)} without effects. {_not_simulated(verdict)}"
    if not (verdict["effects"] or verdict["best_known"]):
        return f"The gap on held-out data is {rounded_gap(before)}"
    text = f"The gap on held-out data {HeldOutTest(test, before, after).summary}"
    if test == "falls" and before > _DECISION.noise_gap:
        text += f": {percent(min(share_closed(before, after), 1.0))} of the excess over noise is explained"
    return text + _OF_TEST.get(test, "")


def best_known_summary(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """The best explanation that is not confirmed: its gaps, the next best, and how to confirm it."""
    best = verdict["best_known"]
    if best is None:
        return ()
    before, after = map(rounded_gap, best["gap"]["identify"].values())
    share = f"; the candidate explains {own} of the misfit" if (own := share_explained(best)) else ""
    lines = [f"On the fitted data the gap changes from {before} to {after}{share}."]
    lines.append(f"{held_out_summary(verdict, best['gap']['confirm'])}.")
    if rival := best["rival"]:
        other = joined(map(format_label, rival["explanation"].split(" + ")))
        lines.append(f"The next best explanation is {other}; its BIC is larger by {rival['behind']:.0f}.")
    return (*lines, f"To confirm it: {_confirmation(verdict)}.")


def _confirmation(verdict: Mapping[str, Any]) -> str:
    best, test = verdict["best_known"], verdict["held_out_test"]
    held_out = best["gap"]["confirm"]
    if verdict["doubted_channels"]:
        return "check the wiring of the inconsistent channels and measure again"
    if test == RISES or (test == STAYS and held_out["after"] >= held_out["before"]):
        return "measure a held-out run on which its gap falls"
    if best["rival"] and best["rival"]["behind"] < _DECISION.min_delta_bic:
        return "measure a speed, a load or a channel in which it differs from the next best explanation"
    if test in ("cannot_tell", "not_simulated", "nothing_held_out"):
        return "measure a longer held-out run, or one at a speed at which the effect is larger"
    return "explain the remaining residual by a further effect or wider parameter bounds; see the map of disagreement"
