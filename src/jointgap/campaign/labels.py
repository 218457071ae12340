"""Labels of effects, parameters and explanations, and their estimates as text."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import inf
from typing import Any

from jointgap.config.campaign import NUISANCE_RULES, NUISANCES
from jointgap.config.channels import CHANNEL_RULES, CHANNELS
from jointgap.core import words
from jointgap.core.facts import Fact
from jointgap.core.sites import SLIDER_CRANK
from jointgap.core.words import format_name, format_run, joined, number, reading_unit
from jointgap.effects import EFFECTS
from jointgap.effects.axis_laws import AXIS_LAWS, axis_parameters
from jointgap.effects.base import effects_named, name_rules, parameters_of
from jointgap.effects.bodies import LinkLengthError
from jointgap.rig.sensors import FAULTS

LENGTHS = LinkLengthError.LAW_NAME

Effect = Mapping[str, Any]
"""An effect as in ``verdict.json``."""


def label_of(effect: Effect) -> str:
    """The label of an effect, with its site if the effect has several."""
    name, site = effect["name"], effect["site"]
    has_site = name in FAULTS or any("site" in each.model_fields for each in _effects(name))
    return f"{name}:{site}" if has_site else name


def is_fault(effect: Effect) -> bool:
    """Whether an effect is a sensor fault."""
    return effect["name"] in FAULTS


def format_effect(effect: Effect) -> str:
    """``Coulomb friction of the slider``; of a family
    ``drag of the slider (exponent 1.6 to 5, 99 % interval; quadratic drag of the slider fits)``; of
    a law of the campaign file ``my drag (-c*v^3)``. The interval of a shape that is a parameter of
    the effect is that of 90 %, as in the table of the parameters.
    """
    site, template = effect["site"].replace("_", " "), _template(effect["name"])
    if any("site" in each.model_fields for each in _effects(effect["name"])):
        if effect["site"] not in SLIDER_CRANK.revolutes:
            template = template.replace("the {site}", f"joint {site}")
    if effect["name"] == LENGTHS and effect["site"]:
        template = f"deviating lengths of {joined(effect['site'].split(', '))}"
    label = template.format(site=site)
    if "formula" in effect:
        label += f" ({effect['formula']})"
    families = []
    for family in effect.get("families", ()):
        if not family["named"]:
            continue
        low, high = (f"{end:.2g}" for end in family["interval_99"])
        interval, member = f"{low} to {high}, 99 % interval", f"; {label} fits"
        if effect["name"] == family["law"]:
            shape, member = effect["parameters"].get(family["shape"], {}), ""
            if None not in shape.get("interval_90", (None,)):
                interval = f"{Estimate.of('', shape, '1').interval}, 90 % interval"
        law = _template(family["law"]).format(site=site)
        families.append(f"{law} ({family['shape'].replace('_', ' ')} {interval}{member})")
    alternatives = map(format_effect, effect.get("alternatives", ()))
    return " or ".join([*(families or [label]), *alternatives])


def _effects(name: str) -> tuple[type, ...]:
    """The effects of mechanism files with a name."""
    if name in EFFECTS:
        return (EFFECTS[name],)
    return () if name in FAULTS or name in AXIS_LAWS else effects_named(name)


def _template(name: str) -> str:
    template = ""
    if name == LENGTHS:  # of which links, its site says
        return "deviating lengths of links"
    if effects := _effects(name):
        template = effects[0].WORDS
    elif name in FAULTS:
        template = FAULTS[name].words
    elif name in AXIS_LAWS:
        template = AXIS_LAWS[name].words
    return template or name.replace("_", " ")


def format_label(label: str) -> str:
    """``a bias of the sensor of crank torque`` for ``sensor_bias:crank_torque``; of an explanation
    ``a + b`` all effects, where the terms of a force law are one effect."""
    terms_of: dict[str, list[str]] = {}
    for part in label.split(" + "):
        effect, _, term = part.removesuffix("]").partition("[")
        terms_of.setdefault(effect, []).extend([term] if term else [])
    parts = []
    for effect, terms in terms_of.items():
        name, _, site = effect.partition(":")
        text = effect
        if site or "{site}" not in _template(name):
            text = format_effect({"name": name, "site": site})
        if terms:
            text += f" (term{'s' * (len(terms) > 1)} {joined(terms)})"
        parts.append(text)
    return joined(parts)


@cache
def _parameters(name: str) -> dict[str, tuple[str, str | None]]:
    """Meaning and unit of each parameter of an effect; unit None: that of the channel."""
    if name in FAULTS:
        return {key: ("", unit or None) for key, unit in FAULTS[name].parameters.items()}
    if name in AXIS_LAWS and name not in EFFECTS:
        return {p.name: (p.meaning, p.unit) for p in axis_parameters(name)}
    is_law = name.startswith("discovered_")  # its parameters are a formula and its coefficients
    parameters = [parameter for effect in _effects(name) for parameter in parameters_of(effect)]
    return {p.name: ("" if is_law else p.meaning, p.unit) for p in parameters}


def _parameter(name: str, key: str) -> tuple[str, str | None]:
    """Meaning and unit of a parameter of an effect."""
    if name == LENGTHS and key.endswith("_m"):  # one of each link
        return f"a, deviation of the {format_name(key.removesuffix('_m'))} length", "m"
    return _parameters(name).get(key, ("", ""))


def format_parameter(effect: str, name: str) -> str:
    """``friction force`` for ``force_N``, ``zero of run slow`` for ``zero_rad@slow``."""
    key, _, run = name.partition("@")
    meaning = _parameter(effect, key)[0]
    label = re.sub(r"^\w+, ", "", re.split("; |, which ", meaning)[0])
    if not label:  # the name without its unit
        label = format_name(re.sub(r"_(?:rad|deg|[A-Z]\w*|k?g|m|s)$", "", key))
    return f"{label} of {format_run(run)}" if run else label


def unit_of(name: str, site: str, parameter: str) -> str:
    """SI unit of a `parameter` of the effect `name` at `site`: ``1`` for a pure number, empty if
    unknown."""
    unit = _parameter(name, parameter.partition("@")[0])[1]
    return CHANNELS.get(site, "SI") if unit is None else unit


@dataclass(frozen=True)
class Estimate(Fact):
    """A fitted parameter in SI, with its 90 % interval."""

    sd: float | None = None
    remark: str = ""
    has_interval: bool = False  # whose ends may be open

    @classmethod
    def of(cls, label: str, estimate: Mapping[str, Any], unit: str, name: str = "") -> "Estimate":
        """From an `estimate` of ``verdict.json``."""
        low, high = estimate.get("interval_90") or (None, None)
        return cls(
            name,
            estimate["value"],
            unit,
            label,
            low,
            high,
            sd=estimate.get("sd"),
            remark=estimate.get("remark", ""),
            has_interval=bool(estimate.get("interval_90")),
        )

    @property
    def is_number(self) -> bool:
        """Not the formula of a law."""
        return isinstance(self.value, int | float)

    @property
    def _shown(self) -> tuple[str, str]:
        """Value with its unit, and interval."""
        numbers = (self.value, self.low, self.high)
        sizes = [abs(value) for value in numbers if isinstance(value, int | float)]
        unit, factor = reading_unit(self.unit, max(sizes, default=None))
        value, low, high, error = (
            factor * quantity if isinstance(quantity, int | float) else quantity
            for quantity in (*numbers, self.sd)
        )
        if error is None and None not in (low, high):
            error = (high - low) / 4.0  # sets only the number of digits
        ends = ["–" if end is None else words.with_error(end, error)[0] for end in (low, high)]
        text = words.with_unit(words.with_error(value, error)[0], words.format_unit(unit))
        return text, "–" if ends == ["–", "–"] else " to ".join(ends)

    @property
    def interval(self) -> str:
        """The 90 % interval."""
        return self._shown[1]

    @property
    def row(self) -> tuple[str, str, str, str]:
        """Label, value with unit, 90 % interval and remark."""
        return (self.label, *self._shown, self.remark)

    @property
    def text(self) -> str:
        """``5.93 N (90 % interval 5.89 to 5.98)``;
        ``0.8 (at its bound; 90 % interval 0.71 to 0.8)``."""
        value, interval = self._shown
        notes = [self.remark, "" if interval == "–" else f"90 % interval {interval}"]
        note = "; ".join(filter(None, notes))
        return f"{value} ({note})" if note else value


def estimates(effects: Sequence[Effect]) -> list[Estimate]:
    """The parameters of `effects`; their labels begin with the effect if there are several."""
    parameters = []
    for effect in effects:
        prefix = f"{format_effect({**effect, 'families': ()})}: " if len(effects) > 1 else ""
        for name, estimate in effect.get("parameters", {}).items():
            label = prefix + format_parameter(effect["name"], name)
            # the parameter of a law of the campaign file has its unit
            unit = estimate.get("unit") or unit_of(effect["name"], effect["site"], name)
            parameters.append(Estimate.of(label, estimate, unit, name))
    return parameters


def format_explanation(effects: Sequence[Effect]) -> str:
    """The effects of one explanation with the values of their parameters."""
    parts = []
    for effect in effects:
        rows = [estimate.row for estimate in estimates([effect])]
        values = [f"{label} {value}" if len(rows) > 1 else value for label, value, *_ in rows]
        parts.append(format_effect(effect) + (f" ({', '.join(values)})" if values else ""))
    return joined(parts)


def headline(effects: Sequence[Effect]) -> str:
    """Each effect with its most precise parameter:
    ``Coulomb friction of the slider, 5.000 N (90 % interval ...)``."""
    return joined(format_effect(effect) + _most_precise(effect) for effect in effects)


def _most_precise(effect: Effect) -> str:
    """The formula of a law; else the most precise of the parameters with the unit of the first
    one."""
    if formula := effect["parameters"].get("formula"):
        return f": {formula['value']}"
    parameters = [estimate for estimate in estimates([effect]) if estimate.is_number]
    if not parameters:
        return ""
    alike = [estimate for estimate in parameters if estimate.unit == parameters[0].unit]
    best = max(alike, key=lambda estimate: abs(estimate.value) / (estimate.sd or inf))
    label = "" if best is parameters[0] else f"{best.label} "
    return f", {label}{best.text}"


def format_detectable(row: Any) -> str:
    """Smallest detectable size of a row of table `DETECTABLE`: ``0.03 N``; ``up to 50 Hz`` if the
    effect decreases with its parameter."""
    effect = row.label.partition(":")[0]
    name = f"{format_parameter(effect, row.parameter)} " if len(_parameters(effect)) != 1 else ""
    unit, factor = reading_unit(row.unit, row.smallest_detectable)
    size = words.with_unit(number(factor * row.smallest_detectable), words.format_unit(unit))
    return f"{name}{'up to ' * row.falls}{size}"


def names_to_labels(sentence: str) -> str:
    """A `sentence` with labels of effects, channels and nuisances, except between backticks."""
    parts = re.split(r"(`[^`]+`)", sentence)
    return "".join(
        part if index % 2 else _CODE_NAME.sub(_label_of_match, part)
        for index, part in enumerate(parts)
    )


def _label_of_match(match: re.Match) -> str:
    label = match[0]
    effect = re.split(r"[:\[ ]", label)[0]
    if effect in {*FAULTS, *AXIS_LAWS} or _effects(effect):
        return format_label(label)
    name, _, site = label.partition(":")
    is_nuisance = name in NUISANCES or re.fullmatch(_BY_RULE[1], name)
    text = words.format_nuisance(name) if is_nuisance else format_name(name)
    return f"{text}:{site}" if site else text


def _any_of(names: Iterable[str]) -> str:
    longest_first = [*sorted(names, key=len)[::-1], *_EFFECT_RULES]
    return rf"(?:{'|'.join(longest_first)})(?::\w+)?(?:\[[^\]]*\])?"


_EFFECT_RULES = [rule.replace("{site}", r"[a-zA-Z]\w*") for rule in name_rules()]
"""Effects of any mechanism."""

_BY_RULE = tuple(
    "|".join(rule.replace("{part}", r"[a-zA-Z]\w*") for rule in rules)
    for rules in (CHANNEL_RULES, NUISANCE_RULES)
)
"""Channels and nuisances of any mechanism."""

_EFFECT = _any_of({*EFFECTS, *FAULTS, *AXIS_LAWS})
_CODE_NAME = re.compile(
    rf"(?<![\w./-])(?:{_EFFECT}(?: \+ {_EFFECT})+|"
    + _any_of(
        name for name in {*EFFECTS, *FAULTS, *AXIS_LAWS, *CHANNELS, *NUISANCES} if "_" in name
    )
    + rf"|{'|'.join(_BY_RULE)}"
    + r")(?![\w/]|\.\w)"
)
"""Explanations ``a + b``, and names with an underscore; ``gravity`` and ``speed`` are words."""
