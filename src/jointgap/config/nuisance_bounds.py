"""Nuisances of a campaign: quantities of the mechanism and of its sensors that are known within bounds only."""

import math
from collections.abc import Mapping
from decimal import Decimal
from typing import Any, NamedTuple

from jointgap.config.mechanism_config import Mechanism
from jointgap.core.errors import did_you_mean
from jointgap.core.joints import PINS
from jointgap.core.units import split_quantity, to_si
from jointgap.effects.clearance import LEAST_CLEARANCE


class _Range(NamedTuple):
    """Unit of a nuisance, and what it can be in a simulation: the least, the most, and both in words."""

    unit: str
    least: float
    most: float
    words: str


def _above_0(unit: str) -> _Range:
    return _Range(unit, math.nextafter(0.0, 1.0), math.inf, f"more than 0 {unit}")


_CLEARANCE = _Range("m", LEAST_CLEARANCE, math.inf, f"{LEAST_CLEARANCE:g} m or more")

SHARED = {
    "joint_friction": _Range("", 0.0, 0.6, "0 to 0.6"),
    "restitution": _Range("", 1e-3, math.nextafter(1.0, 0.0), "0.001 to below 1"),
}
"""Quantities that both pins share unless they are listed for each."""

MOTOR_LINE = ("stall_torque", "no_load_speed")
"""The torque-speed line of a motor: supply and winding are not alike in all runs."""

RUN_NUISANCES = ("speed", "encoder_zero", "slider_position_zero", *MOTOR_LINE)
"""Quantities that every run has for itself."""

NEEDED_CHANNELS = {
    "encoder_zero": ("crank_angle",),
    "slider_position_zero": ("slider_position",),
    "encoder_lag": ("time", "crank_angle"),
}
"""Channels without which a nuisance of a sensor has nothing to act on."""

_RANGES = {
    "slider_mass": _above_0("kg"),
    "rod_mass": _above_0("kg"),
    "rod_inertia": _above_0("kg*m^2"),
    "crank_length": _above_0("m"),
    "rod_length": _above_0("m"),
    "crank_pin_clearance": _CLEARANCE,
    "piston_pin_clearance": _CLEARANCE,
    **SHARED,
    **{f"{key}_{pin}": own for key, own in SHARED.items() for pin in PINS},
    "speed": _above_0("rad/s"),
    "stall_torque": _above_0("N*m"),
    "no_load_speed": _above_0("rad/s"),
    "slider_offset": _Range("m", -math.inf, math.inf, "any length"),
    "encoder_zero": _Range("rad", -math.tau, math.tau, "a turn either way"),
    "encoder_lag": _Range("s", -math.inf, math.inf, "any time"),
    "slider_position_zero": _Range("m", -math.inf, math.inf, "any length"),
}

NUISANCES = {key: limits.unit for key, limits in _RANGES.items()}
"""SI unit of every quantity that may be listed under ``nuisance``; ``''`` for pure numbers."""


NOMINALLY_0 = ("encoder_zero", "encoder_lag", "slider_position_zero")
"""Of sensors: 0 where the bounds do not say otherwise."""

_AMOUNTS = {"m": "'1 mm'", "rad": "'5 deg'", "s": "'5 ms'"}
"""By which a quantity of the unit may differ from nominal either way, for example."""


def share_or_bounds(key: str, value: Any, nominals: tuple[float, ...] = ()) -> float | tuple[float, float]:
    """The `value` of the nuisance `key` in a campaign file: a share of its nominal value, or its bounds [SI]."""
    unit = NUISANCES[key]
    if isinstance(value, str) and (amount := _amount(value, unit)) is not None:
        if len(set(nominals)) != 1 or not amount > 0:
            raise ValueError(
                f"{key} = '{value}' must be more than 0 {unit} either way of one nominal value; write bounds such as "
                "[low, high]"
            )
        low, high = nominals[0] - amount, nominals[0] + amount
        check_possible(key, low, high, f"{key} = '{value}'")
        return low, high
    if isinstance(value, str):
        share = _percent(key, value)
        if not 0 < share < 1:
            raise ValueError(f"{key} = '{value}' must be more than 0 % and less than 100 %")
        return share
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ValueError(f"{key} = {value!r} must be a percentage such as '5 %' or bounds such as [low, high]")
    try:
        low, high = (to_si(bound, unit) for bound in value)
    except ValueError as error:
        raise ValueError(f"{key} = {list(value)!r} {error}") from error
    if low >= high:
        raise ValueError(f"{key} = {list(value)!r} is upside down or empty; write the lower bound first")
    check_possible(key, low, high, f"{key} = {list(value)!r}")
    return low, high


def check_possible(key: str, low: float, high: float, source: str) -> None:
    """ValueError, beginning with the `source`, where `low` or `high` [SI] of the nuisance `key` cannot be simulated."""
    _, least, most, words = _RANGES[key]
    if low < least or high > most:
        raise ValueError(f"{source} reaches from {low:g} to {high:g} and leaves what is possible, {words}; narrow it")


def _amount(text: str, unit: str) -> float | None:
    """A length, angle or time with a unit of its own as a number in `unit`; None of any other text."""
    try:
        return to_si(text, unit) if unit in _AMOUNTS and split_quantity(text)[1] else None
    except ValueError:
        return None


def _percent(key: str, text: str) -> float:
    try:
        number, own = split_quantity(text.strip().removeprefix("+-"))
    except ValueError as error:
        own, mistake = "", f" {error};"
    else:
        mistake = ""
    if own in ("%", "percent"):
        return float(Decimal(number) / 100)
    unit = NUISANCES[key]
    # of what is nominally 0 a percentage is no range
    instead = [] if key in NOMINALLY_0 else ["a percentage such as '5 %'"]
    instead += [f"an amount such as {_AMOUNTS[unit]}"] if unit in _AMOUNTS else []
    raise ValueError(f"{key} = '{text}'{mistake} must be {' or '.join(instead)}, or bounds such as [low, high]")


def as_written(value: float | tuple[float, float]) -> str | list[float]:
    """What `share_or_bounds` reads as `value`, to the last digit."""
    return list(value) if isinstance(value, tuple) else f"{Decimal(repr(value)) * 100} %"


def check_keys(given: Mapping[str, Any]) -> None:
    """ValueError on unknown keys, and on a quantity given for both pins and for one."""
    for key in given:
        if key not in _RANGES:
            raise ValueError(f"unknown key 'nuisance.{key}'; {did_you_mean(key, _RANGES)}")
    for shared in SHARED:
        own = [f"{shared}_{pin}" for pin in PINS if f"{shared}_{pin}" in given]
        if shared in given and own:
            raise ValueError(f"{shared} of both pins and {own[0]} are listed; give one of them")


def nominal_values(mechanism: Mechanism, key: str) -> tuple[float, ...]:
    """Values [SI] of the nuisance `key` in a `mechanism`, one or one per pin; () where it has nothing to act on.

    Not of the speed, which the runs have, and not of a motor. Zeros and lags of sensors are nominally 0.
    """
    plain = dict.fromkeys(NEEDED_CHANNELS, 0.0) | {
        "slider_offset": mechanism.slider.offset,
        "slider_mass": mechanism.slider.mass,
        "rod_mass": mechanism.rod.mass,
        "rod_inertia": mechanism.rod.inertia,
        "crank_length": mechanism.crank.length,
        "rod_length": mechanism.rod.length,
    }
    if key in plain:
        return (plain[key],)
    pins = [pin for pin in PINS if pin in key] or PINS
    if key.endswith("clearance"):
        return tuple(mechanism.clearance(pin) for pin in pins if pin in mechanism.loose)
    contacts = [mechanism.joint(pin).contact for pin in pins if pin in mechanism.loose]
    if key.startswith("joint_friction"):
        return tuple(contact.friction for contact in contacts)
    return tuple(contact.restitution for contact in contacts if contact.restitution is not None)
