"""Nuisances of a campaign: quantities of the mechanism that are known within bounds only."""

from collections.abc import Mapping
from decimal import Decimal, InvalidOperation
from typing import Any

from jointgap.config.mechanism import Mechanism
from jointgap.config.quantities import refuse_comma, to_si
from jointgap.errors import did_you_mean

PINS = ("crank_pin", "piston_pin")

SHARED = {"joint_friction": ("", 0.0, 0.6), "restitution": ("", 1e-3, 1.0)}
"""Quantities that both pins share unless they are listed for each: unit and limits."""

_LIMITS = {
    "slider_mass": ("kg", 0.0, None),
    "rod_mass": ("kg", 0.0, None),
    "rod_inertia": ("kg*m^2", 0.0, None),
    "crank_length": ("m", 0.0, None),
    "rod_length": ("m", 0.0, None),
    "crank_pin_clearance": ("m", 0.0, None),
    "piston_pin_clearance": ("m", 0.0, None),
    **SHARED,
    **{f"{key}_{pin}": limits for key, limits in SHARED.items() for pin in PINS},
    "speed": ("rad/s", 0.0, None),
}
"""SI unit and the limits of what is possible."""

NUISANCES = {key: unit for key, (unit, _, _) in _LIMITS.items()}
"""SI unit of every quantity that may be listed under ``nuisance``; ``''`` for pure numbers."""


def share_or_bounds(key: str, value: Any) -> float | tuple[float, float]:
    """What a campaign says of a nuisance: a share of its nominal value, or its lowest and highest value [SI].

    Raises
    ------
    ValueError
        Neither a percentage nor two numbers, bounds upside down, or values that are not possible.
    """
    unit, least, most = _LIMITS[key]
    if isinstance(value, str):
        share = _percent(value)
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
    if low < least or (most is not None and high > most):
        reach = f"{least:g} to {most:g}" if most is not None else f"{least:g} or more"
        raise ValueError(f"{key} = {list(value)!r} leaves what is possible, {reach}{f' {unit}' if unit else ''}")
    return low, high


def _percent(text: str) -> float:
    refuse_comma(text)
    number = text.strip()
    for sign in ("%", "percent"):
        if number.endswith(sign):
            try:
                return float(Decimal(number.removesuffix(sign).strip().removeprefix("+-")) / 100)
            except InvalidOperation:
                break
    raise ValueError(f"'{text}' is not a percentage; write one such as '5 %', or bounds such as [low, high]")


def as_written(value: float | tuple[float, float]) -> str | list[float]:
    """What `share_or_bounds` reads as `value`, to the last digit."""
    return list(value) if isinstance(value, tuple) else f"{Decimal(repr(value)) * 100} %"


def check_keys(given: Mapping[str, Any]) -> None:
    """ValueError on unknown keys, and on a quantity given for both pins and for one."""
    for key in given:
        if key not in _LIMITS:
            raise ValueError(f"unknown key 'nuisance.{key}'; {did_you_mean(str(key), _LIMITS)}")
    for shared in SHARED:
        own = [f"{shared}_{pin}" for pin in PINS if f"{shared}_{pin}" in given]
        if shared in given and own:
            raise ValueError(f"{shared} of both pins and {own[0]} are listed; give one of them")


def nominal_values(mechanism: Mechanism, key: str) -> tuple[float, ...]:
    """What the mechanism says of a nuisance but the speed, one value or one per pin; () where it has nothing to act on."""
    plain = {
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
