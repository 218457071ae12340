"""Effects, sizes and the verdict in words."""

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
"""Verdicts by which the model fits the measurement with nothing added."""

_DECISION = DEFAULT_SETTINGS.decision

Effect = Mapping[str, Any]
"""An effect, as ``verdict.json`` has it."""


def effect_in_words(effect: Effect) -> str:
    """``Coulomb friction of the slider``; where a family of it is named
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


def label_in_words(label: str) -> str:
    """The same of a label, ``sensor_bias:crank_torque``."""
    name, _, site = label.partition(":")
    return effect_in_words({"name": name, "site": site}) if site or "{site}" not in _words(name) else name


def label_of(effect: Effect) -> str:
    """The label of an effect, which has its site where there is a choice."""
    name, site = effect["name"], effect["site"]
    return name if name in EFFECTS and "site" not in EFFECTS[name].model_fields else f"{name}:{site}"


def is_fault(effect: Effect) -> bool:
    """Whether an effect is a fault of a sensor: it acts on what is read, not on the motion."""
    return effect["name"] in FAULTS


def explanation_in_words(effects: Sequence[Effect]) -> str:
    """Effects that together are one explanation, with the values of their parameters."""
    parts = []
    for effect in effects:
        rows = parameter_rows([effect])
        values = ", ".join(f"{name} {value}" if len(rows) > 1 else value for name, value, *_ in rows)
        parts.append(effect_in_words(effect) + (f" ({values})" if values else ""))
    return joined(parts)


def headline(effects: Sequence[Effect]) -> str:
    """Effects, each with its best known size: ``Coulomb friction of the slider, 5.000 N (90 % interval ...)``."""
    return joined(effect_in_words(effect) + _first_number(effect) for effect in effects)


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
    name = "" if best == first else f"{parameter_in_words(effect['name'], best)} "
    return f", {name}{sure_value(*estimate_row('', own[best], units[best])[1:])}"


def sure_value(value: str, interval: str, remark: str = "") -> str:
    """``5.93 N (90 % interval 5.89 to 5.98)``; ``0.8 (at its bound; 90 % interval 0.71 to 0.8)``."""
    sure = "; ".join(filter(None, (remark, "" if interval == "–" else f"90 % interval {interval}")))
    return f"{value} ({sure})" if sure else value


@cache
def _parameters(name: str) -> dict[str, tuple[str, str]]:
    """Meaning and unit of each parameter of an effect; None for the unit of the channel."""
    if name in FAULTS:
        return {FAULTS[name].parameter: ("", FAULTS[name].unit or None)}
    is_law = name.startswith("discovered_")  # its parameters are a formula and the letters in it
    own = parameters_of(EFFECTS[name]) if name in EFFECTS else ()
    return {p.name: ("" if is_law else p.meaning, p.unit) for p in own}


def parameter_in_words(effect: str, name: str) -> str:
    """``force of friction`` for ``force_N``, ``zero of run slow`` for ``zero_rad@slow``."""
    key, _, run = name.partition("@")
    meaning = _parameters(effect).get(key, ("", ""))[0]
    without_unit = format_name(re.sub(r"_(?:rad|deg|[A-Z]\w*|k?g|m|s)$", "", key))
    words = re.sub(r"^\w+, ", "", re.split("; |, which ", meaning)[0]) or without_unit
    return f"{words} of run {run}" if run else words


def unit_of(name: str, site: str, parameter: str) -> str:
    """SI unit of a `parameter` of the effect `name` at `site`: ``1`` for a pure number, empty where none is known."""
    unit = _parameters(name).get(parameter.partition("@")[0], ("", ""))[1]
    return CHANNELS.get(site, "SI") if unit is None else unit


def parameter_rows(effects: Sequence[Effect]) -> tuple[tuple[str, ...], ...]:
    """Rows of `estimate_row` of all parameters, with the effect where there are several."""
    rows = []
    for effect in effects:
        of_effect = f"{effect_in_words({**effect, 'families': ()})}: " if len(effects) > 1 else ""
        for name, estimate in effect.get("parameters", {}).items():
            unit = unit_of(effect["name"], effect["site"], name)
            rows.append(estimate_row(of_effect + parameter_in_words(effect["name"], name), estimate, unit))
    return tuple(rows)


def estimate_row(name: str, estimate: Mapping[str, Any], unit: str) -> tuple[str, str, str, str]:
    """A parameter's `name`, value with unit, 90 % interval, and remark; the `estimate` of ``verdict.json`` is in SI."""
    ends = estimate.get("interval_90") or (None, None)
    known = [abs(own) for own in (estimate["value"], *ends) if isinstance(own, int | float)]
    unit, factor = reading_unit(unit, max(known, default=None))
    value, error, low, high = (
        factor * own if isinstance(own, int | float) else own for own in (estimate["value"], estimate.get("sd"), *ends)
    )
    if error is None and None not in (low, high):
        error = (high - low) / 4.0  # for the digits alone
    shown = ["–" if end is None else words.with_error(end, error)[0] for end in (low, high)]
    interval = "–" if shown == ["–", "–"] else " to ".join(shown)
    text = words.with_unit(words.with_error(value, error)[0], words.format_unit(unit))
    return name, text, interval, estimate.get("remark", "")


def shown_size(row: Any) -> str:
    """Smallest detectable size of a row of table `DETECTABLE`: ``0.03 N``, or ``up to 50 Hz`` of an effect that shrinks
    as its value grows."""
    effect = row.label.partition(":")[0]
    name = f"{parameter_in_words(effect, row.parameter)} " if len(_parameters(effect)) > 1 else ""
    unit, factor = reading_unit(row.unit, row.smallest_detectable)
    size = words.with_unit(number(factor * row.smallest_detectable), words.format_unit(unit))
    return f"{name}{'up to ' * row.falls}{size}"


def without_code_names(sentence: str) -> str:
    """A `sentence` with effects, channels and nuisances in words, but for what stands between backticks."""
    parts = re.split(r"(`[^`]+`)", sentence)
    return "".join(part if n % 2 else _CODE_NAME.sub(_in_words, part) for n, part in enumerate(parts))


def _in_words(found: re.Match) -> str:
    name, site = found["name"], found["site"]
    if name in EFFECTS or name in FAULTS:
        return label_in_words(f"{name}:{site}" if site else name)
    return words.format_nuisance(name) if name in NUISANCES else format_name(name)


_CODE_NAME = re.compile(
    r"(?<![\w./-])(?P<name>"
    + "|".join(sorted((name for name in {*EFFECTS, *FAULTS, *CHANNELS, *NUISANCES} if "_" in name), key=len)[::-1])
    + r")(?::(?P<site>\w+))?(?![\w/]|\.\w)"
)
"""Names with an underscore: others, such as ``gravity`` and ``speed``, are words."""


def place_of(run: str, channel: str, start: float, end: float) -> str:
    """A window from `start` to `end` [deg]: ``run slow, crank torque, 350 to 10 deg of crank angle``."""
    where = f"{start:.0f} to {end:.0f} deg of crank angle"
    if end - start >= 360.0:
        where = "all crank angles"
    elif end < start < end + 180.0:
        where = f"all crank angles but {end:.0f} to {start:.0f} deg"
    return f"run {run}, {format_name(channel)}, {where}"


def answer(verdict: Mapping[str, Any]) -> str:
    """The verdict, content of ``verdict.json``, in two or three sentences."""
    kind, effects, gap = verdict["verdict"], verdict["effects"], verdict["gap"]
    if effects:
        faults, missing = [e for e in effects if is_fault(e)], [e for e in effects if not is_fault(e)]
        found = f"Missing in the model {'are' if missing[1:] else 'is'} {joined(map(effect_in_words, missing))}."
        if faults:
            fault = f"The measurement has a fault: {explanation_in_words(faults)}."
            found = f"{found} {fault}" if missing else f"The mechanism lacks nothing. {fault}"
        fit = "fits the data used for fitting within the noise"
        if gap["identify"]["after"] > _DECISION.noise_gap:
            before, after = map(rounded_gap, gap["identify"].values())
            fit = f"has a gap of {after} instead of {before}; none of the effects tried explains this rest"
        return f"{found} With this the model {fit}.{_held_out_rest(verdict)}"
    if kind in ENOUGH:
        model = "the current model" if kind == "no_disagreement" else "with re-fitted parameters the model"
        what = "Nothing" if kind == "no_disagreement" else "No effect"
        said = f"{what} is missing that these data could show: {model} fits the data used for fitting within the noise."
        return said + _held_out_rest(verdict)
    if kind == "ambiguous":
        shared, count = verdict["certain"], len(verdict["equivalent"])
        certain = f" All contain {joined(map(effect_in_words, shared))}." if shared else ""
        return f"Something is missing: {count} explanations fit equally well.{certain} None was added to the model."
    if doubted := verdict["doubted_channels"]:
        said = (
            f"The data contradict each other, so nothing can be identified: check {joined(map(format_name, doubted))}."
        )
    elif best := verdict["best_known"]:
        share = f"{part} of the misfit beyond noise" if (part := share_explained(best)) else "the misfit"
        said = f"Something is missing. The best candidate, {explanation_in_words(best['effects'])}, explains {share}; "
        said += "this is not proven."
    else:
        said = "Something is missing that none of the effects tried explains."
    return f"{said} No effect was added to the model."


def _held_out_rest(verdict: Mapping[str, Any]) -> str:
    """What the answer says of held-out data: which cannot be simulated, and the largest gap beyond noise."""
    gap, when, said = verdict["gap"]["confirm"], "after" if verdict["effects"] else "before", ""
    gaps = [gap[when]]
    if gap[when] is None:
        said, gaps = f" {_not_simulated(verdict)}.", [run["gap"][when] for run in verdict["held_out"]]
    largest = max((gap for gap in gaps if gap is not None), default=0.0)
    if largest > _DECISION.max_gap_of_noise:
        return f"{said} It does not fit the held-out data: the gap there is {rounded_gap(largest)} (1 is noise)."
    return f"{said} The held-out data do not confirm it." if verdict["held_out_test"] == STAYS else said


def _not_simulated(verdict: Mapping[str, Any]) -> str:
    lost = [f"run {run['run']} ({run['not_simulated']})" for run in verdict["held_out"] if "not_simulated" in run]
    return f"What was added cannot be simulated in {joined(lost)}, so it is not confirmed there"


def left_out_in_words(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """Which runs a verdict does not rest on, and what could not be made beside it, and why, a sentence each."""
    left = [f"Run {one['run']} is left out: {one['because']}." for one in verdict.get("left_out", ())]
    failed = verdict.get("failed", {})
    return (*left, *(f"{format_name(what)} could not be made: {why}." for what, why in failed.items()))


def share_explained(best: Mapping[str, Any]) -> str:
    """Share of the misfit beyond noise [%] that an explanation explains; empty where not known or nearly all."""
    share = best["explained_share"]
    return "" if share is None or round(share, 2) >= 1.0 else percent(share, 0)


_OF_TEST = {
    "stays": ", though it should fall",
    "rises": ", so what was added does not hold there",
    "cannot_tell": ": the effect would hardly show there",
}


def held_out_in_words(verdict: Mapping[str, Any], gap: Mapping[str, float | None] | None = None) -> str:
    """What the gap on held-out data does, without the last full stop."""
    gap, test = gap or verdict["gap"]["confirm"], verdict["held_out_test"]
    before, after = gap["before"], gap["after"]
    if after is None:
        return f"On held-out data it is {rounded_gap(before)} before anything is added. {_not_simulated(verdict)}"
    if not (verdict["effects"] or verdict["best_known"]):
        return f"On held-out data it is {rounded_gap(before)}"
    said = f"On held-out data {HeldOutTest(test, before, after).words}"
    if test == "falls" and before > _DECISION.noise_gap:
        said += f": {percent(min(share_closed(before, after), 1.0))} of what exceeds the noise is gone"
    return said + _OF_TEST.get(test, "")


def best_known_in_words(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """How far the best explanation goes that is not proven, its test, its nearest rival, and what would prove it."""
    best = verdict["best_known"]
    if best is None:
        return ()
    before, after = map(rounded_gap, best["gap"]["identify"].values())
    share = f", {own} of the misfit" if (own := share_explained(best)) else ""
    says = [f"On the data used for fitting the gap goes from {before} to {after}{share}."]
    says.append(f"{held_out_in_words(verdict, best['gap']['confirm'])}.")
    if rival := best["rival"]:
        other = joined(map(label_in_words, rival["explanation"].split(" + ")))
        says.append(f"The next best is {other}, {rival['behind']:.0f} of BIC behind.")
    return (*says, f"To prove it: {_proof(verdict)}.")


def _proof(verdict: Mapping[str, Any]) -> str:
    best, test = verdict["best_known"], verdict["held_out_test"]
    held_out = best["gap"]["confirm"]
    if verdict["doubted_channels"]:
        return "check the wiring of the contradicting channels and measure again"
    if test == RISES or (test == STAYS and held_out["after"] >= held_out["before"]):
        return "measure a held-out run on which its gap falls"
    if best["rival"] and best["rival"]["behind"] < _DECISION.min_delta_bic:
        return "measure a speed, a load or a channel in which it differs from the next best"
    if test in ("cannot_tell", "not_simulated", "nothing_held_out"):
        return "measure a longer held-out run, or one at a speed at which it acts more"
    return "explain the rest too, by another effect or by wider bounds of parameters; see the map of disagreement"
