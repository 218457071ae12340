"""The verdict in sentences."""

import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from jointgap.config.campaign import CHANNELS, NUISANCES
from jointgap.core.words import (
    in_words,
    joined,
    nuisance_in_words,
    number,
    percent,
    reading_unit,
    rounded_gap,
    unit_in_words,
    with_error,
    with_unit,
)
from jointgap.effects import EFFECTS
from jointgap.effects.base import parameters_of
from jointgap.identification.confirmation import RISES, STAYS, HeldOutTest, share_closed
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.rig.sensors import FAULTS

_OF_CHANNEL = "as the channel"


def effect_in_words(effect: Mapping[str, Any]) -> str:
    """``Coulomb friction of the slider`` of an effect of a verdict; its name where nothing is known of it.

    Where a family of it is named: ``drag of the slider (exponent 1.6 to 5; quadratic drag of the slider fits)``.
    """
    site, named = effect["site"].replace("_", " "), []
    words = _words(effect["name"]).format(site=site)
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


def explanation_label_in_words(label: str) -> str:
    """The same of the labels of effects that are one explanation, ``gravity + slider_spring``."""
    return joined(map(label_in_words, label.split(" + ")))


def is_fault(effect: Mapping[str, Any]) -> bool:
    """Whether an effect of a verdict is a fault of a sensor: it acts on what is read, not on the motion."""
    return effect["name"] in FAULTS


def explanation_in_words(effects: Sequence[Mapping[str, Any]]) -> str:
    """Effects that together are one explanation, with the values of their parameters."""
    return joined(effect_in_words(effect) + _values(effect) for effect in effects)


def _values(effect: Mapping[str, Any]) -> str:
    parameters = effect.get("parameters", {})
    values = [
        f"{_named_parameter(effect, name)} {_value(effect, name)}" if len(parameters) > 1 else _value(effect, name)
        for name in parameters
    ]
    return f" ({', '.join(values)})" if values else ""


def _value(effect: Mapping[str, Any], name: str) -> str:
    """The value of a parameter with its unit."""
    return estimate_row("", effect["parameters"][name], unit_of(effect["name"], effect["site"], name))[1]


def headline(effects: Sequence[Mapping[str, Any]]) -> str:
    """Effects of a verdict, each with the number that is surest and the interval of that.

    ``Coulomb friction of the slider, 5.000 N (90 % interval 4.997 to 5.004)``; of a law its formula.
    """
    return joined(effect_in_words(effect) + _first_number(effect) for effect in effects)


def _first_number(effect: Mapping[str, Any]) -> str:
    if formula := effect["parameters"].get("formula"):
        return f": {formula['value']}"
    parameters, units = effect["parameters"], {}
    for name, own in parameters.items():
        if isinstance(own["value"], int | float):
            units[name] = unit_of(effect["name"], effect["site"], name)
    if not units:
        return ""
    first = next(iter(units))
    alike = [name for name, unit in units.items() if unit == units[first]]  # sizes of one kind: the surest leads
    leads = max(alike, key=lambda name: abs(parameters[name]["value"]) / (parameters[name].get("sd") or math.inf))
    _, value, interval, remark = estimate_row("", parameters[leads], units[leads])
    named = "" if leads == first else f"{_named_parameter(effect, leads)} "
    return f", {named}{sure_value(value, interval, remark)}"


def sure_value(value: str, interval: str, remark: str = "") -> str:
    """``5.93 N (90 % interval 5.89 to 5.98)``; ``0.8 (at its bound; 90 % interval 0.71 to 0.8)``."""
    sure = [*([remark] if remark else []), *([f"90 % interval {interval}"] if interval != "–" else [])]
    return f"{value} ({'; '.join(sure)})" if sure else value


def parameter_in_words(effect: str, name: str) -> str:
    """Words for the parameter `name` of an `effect`: ``force of friction`` for ``force_N``, ``zero of run slow`` for
    ``zero_rad@slow``.
    """
    key, _, run = name.partition("@")
    meaning = _meanings(effect).get(key, "")
    words = re.sub(r"^\w+, ", "", re.split("; |, which ", meaning)[0]) or _without_unit(key)
    return f"{words} of run {run}" if run else words


def _named_parameter(effect: Mapping[str, Any], name: str) -> str:
    return parameter_in_words(effect["name"], name)


def _without_unit(key: str) -> str:
    """``gain error`` of ``gain_error``, ``lag`` of ``lag_s``."""
    return in_words(re.sub(r"_(?:rad|deg|[A-Z]\w*|k?g|m|s)$", "", key))


@cache
def _meanings(name: str) -> dict[str, str]:
    """What parameters are; those of a law found by regression are a formula and the letters in it."""
    is_law = name.startswith("discovered_")
    return {p.name: p.meaning for p in parameters_of(EFFECTS[name])} if name in EFFECTS and not is_law else {}


@cache
def _units(name: str) -> dict[str, str]:
    if name in FAULTS:
        return {FAULTS[name].parameter: FAULTS[name].unit or _OF_CHANNEL}
    return {p.name: p.unit for p in parameters_of(EFFECTS[name])} if name in EFFECTS else {}


def unit_of(name: str, site: str, parameter: str) -> str:
    """SI unit of a `parameter` of the effect `name` at `site`: ``1`` for a pure number, empty for text and unknown
    ones.
    """
    unit = _units(name).get(parameter.partition("@")[0], "")
    return CHANNELS.get(site, "SI") if unit == _OF_CHANNEL else unit


def parameter_rows(effects: Sequence[Mapping[str, Any]]) -> tuple[tuple[str, ...], ...]:
    """Parameter, value with unit, 90 % interval and remark of every effect of a verdict; with several effects the
    parameter with its effect.
    """
    return tuple(
        estimate_row(
            f"{effect_in_words(effect | {'families': ()})}: {_named_parameter(effect, name)}"
            if len(effects) > 1
            else _named_parameter(effect, name),
            estimate,
            unit_of(effect["name"], effect["site"], name),
        )
        for effect in effects
        for name, estimate in effect["parameters"].items()
    )


def estimate_row(name: str, estimate: Mapping[str, Any], unit: str) -> tuple[str, str, str, str]:
    """A parameter's `name`, value with unit, 90 % interval, and a remark where one is due.

    `estimate` is one of ``verdict.json``, in the SI `unit`; it is shown in the one that is read best. The interval is
    the one measure of doubt that is shown: about a bound a standard error would reach beyond it.
    """
    ends = estimate.get("interval_90") or (None, None)
    known = [abs(own) for own in (estimate["value"], *ends) if isinstance(own, int | float)]
    unit, factor = reading_unit(unit, max(known, default=None))
    value, error, *ends = (
        factor * own if isinstance(own, int | float) else own for own in (estimate["value"], estimate.get("sd"), *ends)
    )
    if error is None and None not in ends:
        error = (ends[1] - ends[0]) / 4.0  # for the digits alone
    shown = ["–" if end is None else with_error(end, error)[0] for end in ends]
    interval = "–" if ends == [None, None] else " to ".join(shown)
    return name, with_unit(with_error(value, error)[0], unit_in_words(unit)), interval, estimate.get("remark", "")


def shown_size(label: str, parameter: str, size: float, unit: str, falls: bool) -> str:
    """``0.03 N``, the least `size` [SI `unit`] of the effect `label` that shows; ``up to 50 Hz`` where the effect
    shrinks as its `parameter` grows (`falls`). The parameter is named where the effect has several.
    """
    effect = label.partition(":")[0]
    name = f"{parameter_in_words(effect, parameter)} " if len(_units(effect)) > 1 else ""
    unit, factor = reading_unit(unit, size)
    return f"{name}{'up to ' * falls}{with_unit(number(factor * size), unit_in_words(unit))}"


def without_code_names(sentence: str) -> str:
    """A `sentence` with effects, channels and nuisances in words, but for what stands between backticks."""
    parts = re.split(r"(`[^`]+`)", sentence)
    return "".join(part if n % 2 else _CODE_NAME.sub(_in_words, part) for n, part in enumerate(parts))


def _in_words(found: re.Match) -> str:
    name, site = found["name"], found["site"]
    if name in EFFECTS or name in FAULTS:
        return label_in_words(f"{name}:{site}" if site else name)
    return nuisance_in_words(name) if name in NUISANCES else in_words(name)


_CODE_NAME = re.compile(
    r"(?<![\w./-])(?P<name>"
    + "|".join(sorted((name for name in {*EFFECTS, *FAULTS, *CHANNELS, *NUISANCES} if "_" in name), key=len)[::-1])
    + r")(?::(?P<site>\w+))?(?![\w/]|\.\w)"
)
"""Names with an underscore: others, such as ``gravity`` and ``speed``, are words."""


def place_of(run: str, channel: str, start: float, end: float) -> str:
    """``run slow, crank torque, 350 to 10 deg of crank angle``; of most of a revolution, what is left out.

    Window of `run` and `channel` from `start` to `end` [deg].
    """
    if end - start >= 360.0:
        where = "all crank angles"
    elif end < start < end + 180.0:
        where = f"all crank angles but {end:.0f} to {start:.0f} deg"
    else:
        where = f"{start:.0f} to {end:.0f} deg of crank angle"
    return f"run {run}, {channel.replace('_', ' ')}, {where}"


ENOUGH = ("no_disagreement", "parameters_only")
"""Verdicts by which the model meets the measurement with nothing added."""

# Share of the squared excess over the noise on held-out data. An effect that leaves more than this is not said to close
# the gap.
_MOST_LEFT = 0.5

_DECISION = DEFAULT_SETTINGS.decision
_NOISE_GAP = _DECISION.max_gap_of_noise


def answer(verdict: Mapping[str, Any]) -> str:
    """The verdict, content of ``verdict.json``, in a sentence or two."""
    named, taken = _named(verdict["effects"])
    if verdict["effects"] and is_told_by_features(verdict, verdict["effects"]):
        return (
            f"{named} With this {taken} the model meets where in the cycle impacts come and how hard they are, and "
            "nothing else that was tried does. Single samples it does not meet: impacts ring in another phase, since "
            "their instants depend on more digits than can be measured."
        )
    count, unmet = len(verdict["equivalent"]), _unmet_held_out(verdict)
    fitted = "the data used for fitting"
    data, them = (fitted, "them") if unmet else ("these data", "the measurement")
    return {
        "no_disagreement": f"Nothing is missing that {data} could show: the model as it stands meets {them} within the "
        f"noise.{unmet}",
        "parameters_only": f"No effect is missing that {data} could show: with other parameters within their stated "
        f"ranges the model meets {them} within the noise.{unmet}",
        "named": f"{named} With this {taken} the model meets {fitted if unmet else them} within the noise.{unmet}",
        "named_with_remaining_misfit": f"{named} {_closed(verdict, unmet)}{unmet}",
        "ambiguous": f"{_certain(verdict['certain'])} {count} explanations fit equally well. None of them was added to "
        "the model.",
        "unexplained": f"{_unexplained(verdict)} No effect was added to the model.",
    }[verdict["verdict"]]


def left_out_in_words(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """Which runs a verdict does not rest on, and what could not be made beside it, and why, a sentence each."""
    left = [f"Run {one['run']} is left out: {one['because']}." for one in verdict.get("left_out", ())]
    failed = verdict.get("failed", {})
    return (*left, *(f"{in_words(what)} could not be made: {why}." for what, why in failed.items()))


def is_told_by_features(verdict: Mapping[str, Any], effects: Sequence[Mapping[str, Any]]) -> bool:
    """Whether features of the cycle told the `effects` of a verdict, where motion repeats: samples count nothing for
    them.
    """
    told = bool(effects) and all(effect["delta_bic"] is None for effect in effects)
    return verdict["basis"] == "statistics" and told


def _closed(verdict: Mapping[str, Any], unmet: str) -> str:
    """How far what was named closes the gap."""
    before, after = (verdict["gap"]["identify"][when] for when in ("before", "after"))
    if after**2 <= _DECISION.tolerated_reduced_chi2 and unmet:
        return "With it the model meets the data used for fitting within the noise."
    if after**2 <= _DECISION.tolerated_reduced_chi2 and verdict["held_out_test"] == STAYS:
        return (
            "With it the model meets the data used for fitting within the noise; on the held-out data the gap falls by "
            "less than noise leaves open, so they do not confirm it."
        )
    confirmed = verdict["gap"]["confirm"]["after"]
    least = _DECISION.max_low_end_of_gap
    if after**2 <= _DECISION.tolerated_reduced_chi2 and confirmed is not None and confirmed > least:
        return (
            "With it the model meets the data used for fitting within the noise; on the held-out data a gap of "
            f"{rounded_gap(confirmed)} is left, which is more."
        )
    part = "most" if share_closed(before, after) > _MOST_LEFT else "part"
    where = " on the data used for fitting" if unmet else ""
    left = max(after, confirmed or 0.0)
    rest = "a small rest" if left < _DECISION.max_gap_held_out else f"a gap of {rounded_gap(left)}"
    return f"This closes {part} of the gap{where}, but not all: {rest} is left that none of the effects tried explains."


def _certain(certain: Sequence[Mapping[str, Any]]) -> str:
    """What all of several explanations hold, and that the rest is open, up to the number of these."""
    if not certain:
        return "Something is missing, but these data cannot tell what:"
    shared = joined(map(effect_in_words, certain))
    return f"Certain is {shared}: all explanations hold it. What acts beside it these data cannot tell:"


def _unexplained(verdict: Mapping[str, Any]) -> str:
    if doubted := verdict["doubted_channels"]:
        names = joined(channel.replace("_", " ") for channel in doubted)
        return f"These data cannot tell what is missing: {names} {'reads' if len(doubted) == 1 else 'read'} what " + (
            "contradicts other channels."
        )
    best = verdict["best_known"]
    if best is None:
        return (
            "Something is missing, and it is none of the effects tried: the model and the measurement disagree by more "
            "than the noise, and no explanation holds."
        )
    share = share_explained(best)
    part = f"{share} of what exceeds the noise" if share else "A part"
    return (
        f"Something is missing, and it is not proven what. {part} is explained by "
        f"{explanation_in_words(best['effects'])}."
    )


def share_explained(best: Mapping[str, Any]) -> str:
    """Of what exceeds the noise, the part in percent that the best explanation explains; empty where it is not known,
    or rounds to all of it."""
    share = best["explained_share"]
    return "" if share is None or round(share, 2) >= 1.0 else percent(share, 0)


def best_known_in_words(verdict: Mapping[str, Any]) -> tuple[str, ...]:
    """How far the best explanation goes that is not proven, its test on held-out data, its nearest rival, and what
    would prove it; nothing where there is none.
    """
    best = verdict["best_known"]
    if best is None:
        return ()
    gap, rival = best["gap"], best["rival"]
    before, after = (rounded_gap(gap["identify"][when]) for when in ("before", "after"))
    says = [f"With it the gap on the data used for fitting goes from {before} to {after}."]
    hardly_shows = gap["identify"]["before"] ** 2 <= _DECISION.tolerated_reduced_chi2
    if best["explained_share"] is not None and not hardly_shows:
        says[0] = says[0][:-1] + f": {percent(best['explained_share'])} of the misfit is explained."
    says.append(f"{_held_out_test(verdict, gap['confirm'])}.")
    if is_told_by_features(verdict, best["effects"]):
        says.append("On the data used for fitting it meets where in the cycle impacts come and how hard.")
    elif rival is None:
        says.append("No other explanation was fitted that could be held against it.")
    else:
        share = (
            ""
            if rival["explained_share"] is None or hardly_shows
            else f", and explains {percent(rival['explained_share'])}"
        )
        says.append(
            f"The next best that is another one, {explanation_label_in_words(rival['explanation'])}, is "
            f"{rival['behind']:.0f} of BIC behind{share}."
        )
    return (*says, _would_prove(verdict))


def _would_prove(verdict: Mapping[str, Any]) -> str:
    best, test = verdict["best_known"], verdict["held_out_test"]
    if verdict["doubted_channels"]:
        return "What would prove it: the wiring of these channels checked, and a run recorded anew."
    held_out = best["gap"]["confirm"]
    if test == RISES or (test == STAYS and not held_out["after"] < held_out["before"]):
        return "What would prove it: data that took no part, on which its gap falls. On those held out it does not."
    if best["rival"] and best["rival"]["behind"] < _DECISION.min_delta_bic:
        return "What would prove it: a speed, a load or a channel in which it differs from its rival."
    if test in ("cannot_tell", "not_simulated", "nothing_held_out"):
        return "What would prove it: a held-out run in which it shows, longer or at a speed at which it does more."
    return (
        "What would prove it: that what it leaves is explained too, by another effect or by parameters with wider "
        "bounds; the map of disagreement and the residuals show where it is."
    )


def _held_out_test(verdict: Mapping[str, Any], gap: Mapping[str, float | None]) -> str:
    """What the gap on held-out data does with an explanation, without the last full stop."""
    test, before, after = verdict["held_out_test"], gap["before"], gap["after"]
    where = "On data that took no part in fitting or choosing it"
    if after is None:
        return f"{where} is {rounded_gap(before)} before anything is added"
    features = verdict["held_out_features"]
    words = HeldOutTest(test, before, after, features and (features["before"], features["after"])).words
    if features:
        return f"{where} the gap {words.removeprefix('it ')}"
    words = words.removeprefix("it ")
    told = {
        "stays": ", though it should fall",
        "rises": ", so what was added does not hold there",
        "cannot_tell": ": these data cannot tell, the effect would hardly show there",
    }
    return f"{where} {words}{told.get(test, '')}"


def _named(effects: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """What is named, in a sentence, and what was done with it: a sensor's fault is nothing that the mechanism lacks."""
    faults = [effect for effect in effects if is_fault(effect)]
    missing = [effect for effect in effects if not is_fault(effect)]
    wrong = explanation_in_words(faults)
    if not missing:
        return f"The fault lies in the measurement, not in the mechanism: {wrong}.", "taken into account"
    lacks = f"Missing in the model {'are' if len(missing) > 1 else 'is'} {joined(map(effect_in_words, missing))}"
    if not faults:
        return f"{lacks}.", "added"
    return f"{lacks}, and the measurement has a fault: {wrong}.", "taken into account"


def _unmet_held_out(verdict: Mapping[str, Any]) -> str:
    """Says that the held-out data are not met; empty where they are, or where that is not known."""
    added, gap = bool(verdict["effects"]), verdict["gap"]["confirm"]
    reason, where, gaps = "", "there", [gap]
    if added and gap["after"] is None:
        reason, where = f" {_not_simulated(verdict)}.", "in another run"
        gaps = [run["gap"] for run in verdict["held_out"] if run["gap"]["after"] is not None]
    unmet = [gap["after" if added else "before"] for gap in gaps if _is_unmet(verdict, gap)]
    if not unmet:
        return reason
    more = "more" if added else "something"
    largest = rounded_gap(max(unmet))
    return f"{reason} It does not meet the held-out data: the gap {where} is {largest}, so {more} may be missing."


def _is_unmet(verdict: Mapping[str, Any], gap: Mapping[str, float | None]) -> bool:
    """Whether a gap on held-out data is more than noise, and more than the verdict itself admits."""
    left = gap["after" if verdict["effects"] else "before"]
    if left is None or left <= _NOISE_GAP:
        return False
    admits_misfit = verdict["verdict"] == "named_with_remaining_misfit"
    return not admits_misfit or left**2 - 1.0 > _MOST_LEFT * (gap["before"] ** 2 - 1.0)


def held_out_in_words(verdict: Mapping[str, Any]) -> str:
    """What the gap is on data that took no part, and what that says, without the last full stop."""
    before, after = (verdict["gap"]["confirm"][when] for when in ("before", "after"))
    if not verdict["effects"]:
        sentence = f"On data that took no part in fitting it is {rounded_gap(before)}"
        if verdict["verdict"] in ENOUGH and before > _NOISE_GAP:
            sentence += ". That is more than noise: what the held-out data hold is not all in the model"
        return sentence
    sentence = "On data that took no part in fitting or choosing it"
    if after is None:
        return f"{sentence} is {rounded_gap(before)} before anything is added. {_not_simulated(verdict)}"
    sentence = _held_out_test(verdict, verdict["gap"]["confirm"])
    if verdict["held_out_features"]:
        return sentence
    if verdict["held_out_test"] == "falls" and before**2 > _DECISION.tolerated_reduced_chi2:
        closed = share_closed(before, after)
        sentence += f": {percent(min(closed, 1.0))} of what exceeds the noise is gone"
    if after > _NOISE_GAP:
        sentence += ". More than noise is left there: the effect, or what else the held-out data hold, is not all known"
    return sentence


def _not_simulated(verdict: Mapping[str, Any]) -> str:
    """Which held-out runs cannot be simulated with what was added, and why."""
    lost = [f"run {run['run']} ({run['not_simulated']})" for run in verdict["held_out"] if "not_simulated" in run]
    return f"What was added cannot be simulated in {joined(lost)}, so it is not confirmed there"
