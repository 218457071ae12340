"""Numbers with units in configuration files; SI floats once read.

A plain number is taken as SI. Text is a number with a unit (``7 mm``, ``600 rpm``, ``207 GPa``) or a number that YAML
reads as text (``6e9``).
"""

import math
from functools import cache, lru_cache
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, WithJsonSchema


@cache
def _registry():
    import pint  # 0.3 s: only where a file really carries units

    return pint.UnitRegistry()


def to_si(value: Any, unit: str) -> float:
    """Convert a number or a text such as ``'7 mm'`` to a float in `unit`.

    Parameters
    ----------
    value : int, float or str
        Plain numbers are already in `unit`.
    unit : str
        SI unit by its pint name, e.g. ``'m'`` or ``'rad/s'``; ``''`` for pure numbers.

    Returns
    -------
    float
        The value in `unit`.

    Raises
    ------
    ValueError
        Not a number, not finite, with a decimal comma, or a unit of another dimension.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"must be a number{f' in {unit}' if unit else ''} or text like '1.5 {unit}'")
    try:
        number = _read(value, unit) if isinstance(value, str) else float(value)
    except OverflowError as error:
        raise ValueError("is too large for a number; 1.8e308 is the largest") from error
    if not math.isfinite(number):
        raise ValueError("must be finite")
    return number


def _read(text: str, unit: str) -> float:
    refuse_comma(text)
    try:
        return float(text)
    except ValueError:
        return _convert(text, unit)


def refuse_comma(text: str) -> None:
    """ValueError where `text` has a comma: pint drops it, and 7,5 mm would be 75 mm."""
    if "," in text:
        raise ValueError(f"has a comma; write {text.replace(',', '.')}, and thousands without any mark")


@lru_cache(4096)  # defaults with units are read at each of a fit's thousands of simulations
def _convert(text: str, unit: str) -> float:
    import pint

    try:
        quantity = _registry().Quantity(text)
    except OverflowError:
        raise
    except Exception as error:  # pint raises a dozen kinds, tokenizer errors among them
        raise ValueError(f"is not a number with a unit (a unit of '{unit or 'no dimension'}' is needed)") from error
    try:
        converted = quantity.to(unit or "dimensionless")
    except pint.DimensionalityError as error:
        raise ValueError(f"has the unit '{quantity.units}', which is not a '{unit or 'pure number'}'") from error
    if unit in _RATES and quantity.to_root_units().units != converted.to_root_units().units:
        raise ValueError(f"has the unit '{quantity.units}', which may or may not mean turns; write {_RATES[unit]}")
    return float(converted.magnitude)


_RATES = {"rad/s": "rpm, turn/s or rad/s", "Hz": "Hz or 1/s", "rad": "deg, turn or rad"}
"""Units with an angle and without one: pint takes a radian for 1, and 10 Hz for 10 rad/s."""


def unit_factor(unit: str, base: str) -> float:
    """How many `base` one `unit` is.

    Raises
    ------
    ValueError
        No such unit, or one of another dimension.
    """
    return to_si(f"1 {unit}", base)


def quantity(unit: str, **limits: float) -> Any:
    """Type of a quantity in `unit` (a pint name, '' for pure numbers) within `limits` (gt, ge, lt, le)."""
    names = {"gt": "exclusiveMinimum", "ge": "minimum", "lt": "exclusiveMaximum", "le": "maximum"}
    number = {"type": "number", **{names[key]: limit for key, limit in limits.items()}}
    schema = {
        "anyOf": [number, {"type": "string", "description": f"number with a unit that converts to {unit or '1'}"}]
    }
    return Annotated[
        float,
        Field(**limits),
        BeforeValidator(lambda value: to_si(value, unit)),
        WithJsonSchema(schema | {"unit": unit or "1"}),
    ]


PositiveLength = quantity("m", gt=0)
Length = quantity("m")
NonNegativeLength = quantity("m", ge=0)
PositiveMass = quantity("kg", gt=0)
PositiveInertia = quantity("kg*m^2", gt=0)
PositiveSpeed = quantity("m/s", gt=0)
PositiveAngularSpeed = quantity("rad/s", gt=0)
Angle = quantity("rad")
PositiveAngle = quantity("rad", gt=0)
Fraction = quantity("", ge=0, le=1)
OpenFraction = quantity("", gt=0, lt=1)
PositiveTime = quantity("s", gt=0)
PositiveNumber = quantity("", gt=0)
NonNegativeNumber = quantity("", ge=0)
FrictionCoefficient = quantity("", ge=0, le=0.6)
PoissonRatio = quantity("", ge=0, lt=0.5)
