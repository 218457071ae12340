"""Effects, their parameters and places of disagreement in words."""

import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from jointgap.config.channels import CHANNELS
from jointgap.config.nuisance_bounds import NUISANCES
from jointgap.effects import EFFECTS
from jointgap.effects.describe import parameters_of
from jointgap.report.plain_words import (
    in_words,
    joined,
    nuisance_in_words,
    number,
    reading_unit,
    unit_in_words,
    with_error,
    with_unit,
)
from jointgap.slider_crank.sensor_faults import FAULTS

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
