"""Effects, their parameters and places of disagreement in words."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from jointgap.config.channels import CHANNELS
from jointgap.effects import EFFECTS
from jointgap.effects.describe import parameters_of
from jointgap.report.plain_words import joined, number, with_error, with_unit
from jointgap.slider_crank.sensor_faults import FAULTS

_OF_CHANNEL = "as the channel"


def effect_in_words(effect: Mapping[str, Any]) -> str:
    """``Coulomb friction of the slider`` of an effect of a verdict; its name where nothing is known of it.

    Where a family of it is named: ``drag of the slider (exponent 1.6 to 5; quadratic drag of the slider fits)``.
    """
    words, named = _words(effect["name"]).format(site=effect["site"].replace("_", " ")), []
    for family in effect.get("families", ()):
        if family["named"]:
            low, high = (f"{end:.2g}" for end in family["interval_99"])
            fits = "" if effect["name"] == family["law"] else f"; {words} fits"
            named.append(f"{_words(family['law'])} ({family['shape'].replace('_', ' ')} {low} to {high}{fits})")
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
    values = [
        f"{name} {with_unit(number(estimate['value']), unit_of(effect['name'], effect['site'], name))}"
        for name, estimate in effect.get("parameters", {}).items()
    ]
    return f" ({', '.join(values)})" if values else ""


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
    """Parameter, value with unit, standard error and 90 % interval of every effect of a verdict."""
    return tuple(
        estimate_row(f"{effect['name']}: {name}", estimate, unit_of(effect["name"], effect["site"], name))
        for effect in effects
        for name, estimate in effect["parameters"].items()
    )


def estimate_row(name: str, estimate: Mapping[str, Any], unit: str) -> tuple[str, str, str, str]:
    """A parameter's `name`, value with `unit`, standard error or a remark why there is none, and 90 % interval.

    `estimate` is one of ``verdict.json``.
    """
    error = estimate.get("sd")
    digits, spread = with_error(estimate["value"], error)
    low, high = estimate.get("interval_90") or (None, None)
    ends = ["–" if end is None else with_error(end, error)[0] for end in (low, high)]
    interval = "–" if low is None and high is None else " to ".join(ends)
    return name, with_unit(digits, unit), estimate.get("remark", spread), interval


def size_in_words(parameter: str, value: str, unit: str, falls: bool) -> str:
    """``force_N 0.03 N`` of `parameter`, `value` and `unit`; ``up to`` 50 Hz where the effect shrinks as the value
    grows (`falls`).
    """
    return f"{parameter} {'up to ' * falls}{with_unit(value, unit)}"


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
