"""Effects, parameters and places in words."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from math import floor, log10
from typing import Any

from jointgap.config.effects import EFFECTS
from jointgap.config.effects.describe import parameters_of

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
    "encoder_offset": "an offset of the encoder, which is a fault of the sensor",
    "sensor_bias": "a bias of the sensor of {site}",
    "sensor_gain": "a wrong gain of the sensor of {site}",
    "sensor_lag": "a lag of the sensor of {site}",
    "discovered_slider_force": "a force on the slider that follows a formula found by regression",
    "discovered_crank_torque": "a torque on the crank that follows a formula found by regression",
}
_SENSOR_UNITS = {"offset_rad": "rad", "bias": "SI", "gain_error": "1", "lag_s": "s"}


def effect_in_words(effect: Mapping[str, Any]) -> str:
    """``Coulomb friction of the slider`` of an effect of a verdict; its name where nothing is known of it."""
    words = _WORDS.get(effect["name"], effect["name"].replace("_", " "))
    return words.format(site=effect["site"].replace("_", " "))


def label_in_words(label: str) -> str:
    """The same of a label, ``sensor_bias:crank_torque``."""
    name, _, site = label.partition(":")
    return effect_in_words({"name": name, "site": site}) if site or "{site}" not in _WORDS.get(name, "") else name


@cache
def _units(name: str) -> dict[str, str]:
    return {p.name: p.unit for p in parameters_of(EFFECTS[name])} if name in EFFECTS else _SENSOR_UNITS


def parameter_rows(effects: Sequence[Mapping[str, Any]]) -> tuple[tuple[str, ...], ...]:
    """Parameter, value with unit, standard error and 90 % interval of every effect of a verdict."""
    rows = []
    for effect in effects:
        for name, one in effect["parameters"].items():
            unit = _units(effect["name"]).get(name, "")
            value = one["value"]
            error = one.get("sd")
            digits, spread = with_error(value, error)
            shown = f"{digits} {unit}".removesuffix(" 1").rstrip()
            low, high = one.get("interval_90") or (None, None)
            interval = "–" if low is None else f"{with_error(low, error)[0]} to {with_error(high, error)[0]}"
            rows.append((f"{effect['name']}: {name}", shown, one.get("remark", spread), interval))
    return tuple(rows)


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
