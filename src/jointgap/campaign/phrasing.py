"""The verdict, effects, parameters and places in words."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from math import floor, log10
from typing import Any

from jointgap.config.channels import CHANNELS
from jointgap.effects import EFFECTS
from jointgap.effects.describe import parameters_of
from jointgap.identification.decision import SLIGHT

ENOUGH = ("no_disagreement", "parameters_only")
"""Verdicts by which the model meets the measurement with nothing added."""

_MOST_LEFT = 0.5  # of what exceeds the noise on held-out data: of an effect that leaves more it is not said that it closes the gap

_WEAK = 1.2  # a gap on held-out data of up to this is called noise: the seed of noise alone moves it by less

_WORDS = {
    "gravity": "the weight of the bodies",
    "slider_coulomb_friction": "Coulomb friction of the slider",
    "slider_viscous_friction": "viscous friction of the slider",
    "slider_quadratic_drag": "quadratic drag of the slider",
    "slider_load_friction": "friction of the slider in proportion to the load of its guide",
    "slider_constant_force": "a constant force on the slider",
    "slider_spring": "a spring on the slider",
    "gas_pressure": "the pressure of a closed gas volume on the slider",
    "harmonic_force": "a force on the slider that swings at a frequency of its own",
    "pin_friction": "friction in the {site}",
    "crank_coulomb_friction": "Coulomb friction of the crank",
    "crank_viscous_friction": "viscous friction of the crank",
    "crank_unbalance": "an unbalance of the crank",
    "added_slider_mass": "a slider mass other than nominal",
    "speed_fluctuation": "a drive whose speed fluctuates",
    "slider_offset": "an offset of the slide",
    "link_length_error": "other lengths of crank and rod",
    "crank_pivot_clearance": "clearance in the crank pivot",
    "crank_pin_clearance": "clearance in the crank pin",
    "piston_pin_clearance": "clearance in the piston pin",
    "rod_flexibility": "bending of the rod",
    "lubricated_joint": "a film of lubricant in the {site}",
    "encoder_offset": "an offset of the encoder",
    "sensor_bias": "a bias of the sensor of {site}",
    "sensor_gain": "a wrong gain of the sensor of {site}",
    "sensor_lag": "a lag of the sensor of {site}",
    "discovered_slider_force": "a force on the slider that follows a formula found by regression",
    "discovered_crank_torque": "a torque on the crank that follows a formula found by regression",
}
_OF_CHANNEL = "as the channel"
_FAULTS = {
    "encoder_offset": {"offset_rad": "rad"},
    "sensor_bias": {"bias": _OF_CHANNEL},
    "sensor_gain": {"gain_error": "1"},
    "sensor_lag": {"lag_s": "s"},
}
"""Faults of sensors, with the units of their parameters."""


def answer(verdict: Mapping[str, Any]) -> str:
    """The verdict, content of ``verdict.json``, in a sentence or two."""
    found, taken = _found(verdict["effects"])
    count, lost = len(verdict["equivalent"]), _held_out_lost(verdict)
    fitted = "the data used for fitting"
    data, them = (fitted, "them") if lost else ("these data", "the measurement")
    return {
        "no_disagreement": f"Nothing is missing that {data} could show: the model as it stands meets {them} within the noise.{lost}",
        "parameters_only": f"No effect is missing that {data} could show: with other parameters within their stated ranges the model "
        f"meets {them} within the noise.{lost}",
        "named": f"{found} With this {taken} the model meets {fitted if lost else them} within the noise.{lost}",
        "named_with_remaining_misfit": f"{found} This closes most of the gap{f' on {fitted}' if lost else ''}, but not all: a small "
        f"rest is left that none of the effects tried explains.{lost}",
        "ambiguous": f"Something is missing, but these data cannot tell what: {count} explanations fit equally well. None of them "
        "was added to the model.",
        "unexplained": "Something is missing, and it is none of the effects tried: the model and the measurement disagree by more "
        "than the noise, and no explanation holds. No effect was added to the model.",
    }[verdict["verdict"]]


def _found(effects: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
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


def _held_out_lost(verdict: Mapping[str, Any]) -> str:
    """Says that the held-out data are not met; empty where they are, or where that is not known."""
    added, gap = bool(verdict["effects"]), verdict["gap"]["confirm"]
    told, where, gaps = "", "there", [gap]
    if added and gap["after"] is None:
        told, where = f" {_not_simulated(verdict)}.", "in another run"
        gaps = [one["gap"] for one in verdict["held_out"] if one["gap"]["after"] is not None]
    unmet = [one["after" if added else "before"] for one in gaps if _is_unmet(verdict, one)]
    if not unmet:
        return told
    more = "more" if added else "something"
    return f"{told} It does not meet the held-out data: the gap {where} is {rounded(max(unmet))}, so {more} may be missing."


def _is_unmet(verdict: Mapping[str, Any], gap: Mapping[str, float | None]) -> bool:
    """Whether a gap on held-out data is more than noise, and more than the verdict owns up to."""
    left = gap["after" if verdict["effects"] else "before"]
    if left is None or left <= _WEAK:
        return False
    owned_up = verdict["verdict"] == "named_with_remaining_misfit"
    return not owned_up or left**2 - 1.0 > _MOST_LEFT * (gap["before"] ** 2 - 1.0)


def held_out_in_words(verdict: Mapping[str, Any]) -> str:
    """What the gap is on data that took no part, and what that says, without the last full stop."""
    before, after = (verdict["gap"]["confirm"][when] for when in ("before", "after"))
    if not verdict["effects"]:
        found = f"On data that took no part in fitting it is {rounded(before)}"
        if verdict["verdict"] in ENOUGH and before > _WEAK:
            found += ". That is more than noise: what the held-out data hold is not all in the model"
        return found
    found = "On data that took no part in fitting or choosing it"
    if after is None:
        return f"{found} is {rounded(before)} before anything is added. {_not_simulated(verdict)}"
    falls = after < before
    found += f" {'falls' if falls else 'does not fall: it goes'} from {rounded(before)} to {rounded(after)}"
    if falls and before**2 > SLIGHT:
        closed = 1.0 - (after**2 - 1.0) / (before**2 - 1.0)
        found += f": {percent(min(closed, 1.0))} of what exceeds the noise is gone"
    if after > _WEAK:
        found += ", so what was added does not hold there" * (not falls)
        found += ". More than noise is left there: the effect, or what else the held-out data hold, is not all known"
    return found


def _not_simulated(verdict: Mapping[str, Any]) -> str:
    """Which held-out runs cannot be simulated with what was added, and why."""
    lost = [f"run {one['run']} ({one['not_simulated']})" for one in verdict["held_out"] if "not_simulated" in one]
    return f"What was added cannot be simulated in {joined(lost)}, so it is not confirmed there"


def effect_in_words(effect: Mapping[str, Any]) -> str:
    """``Coulomb friction of the slider`` of an effect of a verdict; its name where nothing is known of it."""
    words = _WORDS.get(effect["name"], effect["name"].replace("_", " "))
    return words.format(site=effect["site"].replace("_", " "))


def label_in_words(label: str) -> str:
    """The same of a label, ``sensor_bias:crank_torque``."""
    name, _, site = label.partition(":")
    return effect_in_words({"name": name, "site": site}) if site or "{site}" not in _WORDS.get(name, "") else name


def is_fault(effect: Mapping[str, Any]) -> bool:
    """Whether an effect of a verdict is a fault of a sensor: it acts on what is read, not on the motion."""
    return effect["name"] in _FAULTS


def explanation_in_words(effects: Sequence[Mapping[str, Any]]) -> str:
    """Effects that together are one explanation, with the values of their parameters."""
    return joined(effect_in_words(effect) + _values(effect) for effect in effects)


def _values(effect: Mapping[str, Any]) -> str:
    values = [
        f"{name} {with_unit(number(one['value']), unit_of(effect['name'], effect['site'], name))}"
        for name, one in effect.get("parameters", {}).items()
    ]
    return f" ({', '.join(values)})" if values else ""


@cache
def _units(name: str) -> dict[str, str]:
    return {p.name: p.unit for p in parameters_of(EFFECTS[name])} if name in EFFECTS else _FAULTS.get(name, {})


def unit_of(name: str, site: str, parameter: str) -> str:
    """SI unit of a parameter of the effect `name`, ``1`` for a pure number; empty for text and where nothing is known of it."""
    unit = _units(name).get(parameter, "")
    return CHANNELS.get(site, "SI") if unit == _OF_CHANNEL else unit


def with_unit(value: str, unit: str) -> str:
    """A value and its unit; that of a pure number is left out."""
    return value if unit in ("", "1") else f"{value} {unit}"


def parameter_rows(effects: Sequence[Mapping[str, Any]]) -> tuple[tuple[str, ...], ...]:
    """Parameter, value with unit, standard error and 90 % interval of every effect of a verdict."""
    rows = []
    for effect in effects:
        for name, one in effect["parameters"].items():
            error = one.get("sd")
            digits, spread = with_error(one["value"], error)
            shown = with_unit(digits, unit_of(effect["name"], effect["site"], name))
            low, high = one.get("interval_90") or (None, None)
            interval = "–" if low is None else f"{with_error(low, error)[0]} to {with_error(high, error)[0]}"
            rows.append((f"{effect['name']}: {name}", shown, one.get("remark", spread), interval))
    return tuple(rows)


def size_in_words(parameter: str, value: str, unit: str, falls: bool) -> str:
    """``force_N 0.03 N``, or ``frequency_Hz up to 50 Hz`` of an effect that shrinks as the value grows."""
    return f"{parameter} {'up to ' * falls}{with_unit(value, unit)}"


def with_error(value: float | str | None, error: float | None) -> tuple[str, str]:
    """A value down to the second digit of its standard error, and that error; four digits where there is none."""
    if isinstance(value, str) or not value or not error or error != error:
        return number(value), number(error)
    digits = 2 + floor(log10(abs(value))) - floor(log10(error))
    return f"{value:#.{max(digits, 2)}g}".rstrip("."), f"{error:#.2g}".rstrip(".")


def number(value: float | str | None) -> str:
    """Four digits; a formula as it is, a dash for what is not known."""
    if isinstance(value, str):
        return value
    return "–" if value is None or value != value else f"{value:.4g}"


def rounded(value: float) -> str:
    """A gap: two digits after the point, none from 100 on."""
    return f"{value:.2f}" if value < 100 else f"{value:.0f}"


def percent(share: float) -> str:
    """A share in percent, one digit after the point."""
    return f"{100.0 * share:.1f} %"


def place_of(run: str, channel: str, start: float, end: float) -> str:
    """``run slow, crank torque, 350 to 10 deg of crank angle``; of most of a revolution, what is left out."""
    if end - start >= 360.0:
        where = "all crank angles"
    elif end < start < end + 180.0:
        where = f"all crank angles but {end:.0f} to {start:.0f} deg"
    else:
        where = f"{start:.0f} to {end:.0f} deg of crank angle"
    return f"run {run}, {channel.replace('_', ' ')}, {where}"


def joined(parts: Iterable[str]) -> str:
    """``a, b and c``."""
    parts = list(parts)
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}" if parts else ""
