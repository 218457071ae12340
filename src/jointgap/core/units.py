"""Numbers with units in files and commands, converted to SI floats. Numbers without a unit are SI.

Text is one number and one unit: ``7 mm``, ``600 rpm``, ``2 N*m/rad``, ``turn/3600``. Pint
interprets the unit; because it would evaluate whole formulas, only text in the form of a unit is
passed on.
"""

import math
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from decimal import Decimal
from functools import cache, lru_cache
from numbers import Real
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, WithJsonSchema

from jointgap.core.errors import InputError
from jointgap.core.files import package_data

_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*(.*?)\s*", re.DOTALL)
_SHARE = re.compile(
    rf"\s*(.*[^*/\s])\s*/\s*({_NUMBER})\s*", re.DOTALL
)  # turn/3600: a line of an encoder
_UNIT = re.compile(
    r"(?!.*//)(?:1?\s*/)?(?:[^\W\d]\w*+|(?:\^|\*\*)\s*\(?\s*[-+]?[0-9](?:\.[0-9]+)?|[°%‰()*/\s])++"
)
_LONGEST = 100  # [characters] of a number with its unit
_SIGNS = str.maketrans({"\N{MINUS SIGN}": "-", "\N{MIDDLE DOT}": "*", "\N{DOT OPERATOR}": "*"})
_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_PLAIN_POWER = re.compile(
    r"(?<=[A-Za-z])([234])(?![\w.^])"
)  # m/s2, kg m2: no unit of pint ends in such a digit
# Nm, kNm, Nmm, in brackets after a stroke: pint reads Nm as a unit of yarn
_TORQUE = re.compile(r"(/ ?)?\b([kmM]?N)([mc]?m)\b((?:\^|\*\*)-?\d)?")

_COMMA = re.compile(
    r"\s*([-+]?[0-9]*),([0-9]+)((?:[eE][-+]?[0-9]+)?(?:\s*[^\s\d.,].*)?)", re.DOTALL
)

_NO_QUANTITY = (
    "is not a number with a unit; write one number, with a decimal point, and one unit, such as"
    " 1.5 mm"
)


@cache
def _registry():
    import pint  # slow to load

    # scripts/set-up creates the folder; then pint need not parse its definitions again
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""), f"pint-{pint.__version__}")
    return pint.UnitRegistry(cache_folder=cache if cache.is_dir() else None)


def to_si(value: Any, unit: str) -> float:
    """A number or a text such as ``'7 mm'`` as a float in `unit`; ValueError where it is
    invalid."""
    if type(value) is float and math.isfinite(value):  # fast path: a design of a sweep has dozens
        return value
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(
            f"must be a number{f' in {unit}' if unit else ''} or text like '1.5 {unit}'"
        )
    try:
        number = _read(value, unit) if isinstance(value, str) else float(value)
    except OverflowError as error:
        raise ValueError("is too large for a number; 1.8e308 is the largest") from error
    if not math.isfinite(number):
        raise ValueError("must be finite")
    return number


def option_in_si(option: str, text: str, unit: str) -> float:
    """The `text` of a command's `option` as a float in `unit`."""
    try:
        return to_si(text, unit)
    except ValueError as error:
        raise InputError(f"{option} {text!r}: {error}") from error


def plain_numbers(value: Any) -> Any:
    """`value` with Python's numbers and lists in place of those of NumPy, pandas, `decimal` and
    `fractions`.

    Also inside mappings and lists.
    """
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: plain_numbers(item) for key, item in value.items()}
    if isinstance(value, list | tuple | range):
        return [plain_numbers(item) for item in value]
    if isinstance(value, Real | Decimal) and not isinstance(value, int | float):
        try:
            return float(value)
        except (OverflowError, ValueError):  # a number that no float can hold
            return math.inf
    return value


@lru_cache(4096)  # defaults with units are read at each of a fit's thousands of simulations
def _read(text: str, unit: str) -> float:
    with _suggesting(*_parts(text), unit):
        number, source_unit = _split(text)
        return _converted(float(number), source_unit, unit) if source_unit else float(number)


def split_quantity(text: str) -> tuple[str, str]:
    """The number in `text`, as digits for `float`, and its unit for pint, or ''."""
    with _suggesting(*_parts(text)):
        return _split(text)


def _parts(text: str) -> tuple[str, str]:
    """The number in `text` with the space after it, and the rest."""
    number = re.match(rf"\s*{_NUMBER}\s*|", text)[0]
    return number, text[len(number) :]


def _split(text: str) -> tuple[str, str]:
    plain = text.translate(_SIGNS) if len(text) <= _LONGEST else ""
    if match := _QUANTITY.fullmatch(plain):
        number, unit = match.groups()
    else:
        unit, parts = split_share(plain)
        number = repr(1.0 / parts) if parts != 1.0 else ""
    pint_unit = _unit_for_pint(unit)
    if not number or (unit and not pint_unit):
        raise ValueError(
            _with_point(*comma.groups()) if (comma := _COMMA.fullmatch(plain)) else _NO_QUANTITY
        )
    return number, pint_unit


def _with_point(whole: str, decimals: str, exponent: str) -> str:
    thousands = (
        f" (or '{whole}{decimals}{exponent}')" if whole.strip("-+0") and len(decimals) == 3 else ""
    )
    return f"has a decimal comma; write '{whole or 0}.{decimals}{exponent}'{thousands}"


def split_share(unit: str) -> tuple[str, float]:
    """The whole unit and the number of parts: turn and 4000 for ``turn/4000``; 1 for a whole
    unit."""
    share = _SHARE.fullmatch(unit) if len(unit) <= _LONGEST else None
    return (share[1], float(share[2])) if share and float(share[2]) > 0 else (unit, 1.0)


_LINES = (100, 128, 180, 200, 250, 256, 300, 360, 400, 500, 512, 600, 720)
_LINES += (1000, 1080, 1250, 1500, 1800, 2500, 3600)
_COUNTS = sorted({lines * 2**doubled for lines in _LINES for doubled in range(12)})
"""Usual counts of encoders a turn: lines, with double and fourfold evaluation."""


def counts_near(counts: float) -> int | None:
    """The usual counts a turn of an encoder within 0.4 % of `counts`; None if there are none."""
    nearest = min(_COUNTS, key=lambda usual: abs(usual / counts - 1.0))
    return nearest if abs(nearest / counts - 1.0) < 0.004 else None


def _unit_for_pint(unit: str) -> str:
    """`unit` for pint; '' where it does not have the form of a unit."""
    unit = re.sub(
        "[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", lambda raised: "^" + raised[0].translate(_RAISED), unit.translate(_SIGNS)
    )
    unit = _TORQUE.sub(_torque_for_pint, _PLAIN_POWER.sub(r"^\1", " ".join(unit.split())))
    if len(unit) > _LONGEST or _UNIT.fullmatch(unit) is None:
        return ""
    return f"1{unit}" if unit.startswith("/") else unit


def _torque_for_pint(match: re.Match[str]) -> str:
    stroke, force, lever, power = (part or "" for part in match.groups())
    return f"/({force}*{lever}{power})" if stroke else f"{force}*{lever}{power}"


def _converted(number: float, source_unit: str, unit: str) -> float:
    """A `number` of the unit `own`, for pint, in `unit`."""
    import pint

    try:
        quantity = _registry().Quantity(number, source_unit)
    except Exception as error:  # pint raises a dozen kinds, tokenizer errors among them
        raise ValueError(
            f"is not a number with a unit (of dimension '{unit or '1'}'): there is no unit"
            f" '{source_unit}'"
        ) from error
    try:
        converted = quantity.to(_unit_for_pint(unit) or "dimensionless")
    except pint.DimensionalityError as error:
        wanted = f"{unit} or a unit that converts to it" if unit else "a pure number"
        raise ValueError(f"has the unit '{quantity.units}' and requires {wanted}") from error
    if unit in _RATES and quantity.to_root_units().units != converted.to_root_units().units:
        raise ValueError(
            f"has the unit '{quantity.units}', which is ambiguous for turns; write {_RATES[unit]}"
        )
    return float(converted.magnitude)


_RATES = {"rad/s": "rpm, turn/s or rad/s", "Hz": "Hz or 1/s", "rad": "deg, turn or rad"}
"""Units with an angle: pint reads a radian as 1, and 10 Hz as 10 rad/s."""


@lru_cache
def unit_factor(unit: str, base: str) -> float:
    """Number of `base` per `unit`."""
    with _suggesting("", unit, base if base != unit else None):
        return _factor(unit, base)


def _factor(unit: str, base: str) -> float:
    unit_name, parts = split_share(unit)
    return _converted(1.0 / parts, _checked_unit(unit_name, base), base)


@lru_cache
def scaled_unit_factor(scale: str, unit: str, base: str) -> float:
    """Number of `base` per `unit` of a signal that a `scale` such as ``0.35 N*m/A`` converts."""
    number, scale_unit = split_quantity(scale)
    signal = _checked_unit(unit, base)
    with _suggesting("", scale_unit, f"{base}/({signal})"):
        return _converted(
            float(number), f"({scale_unit}) * ({signal})" if scale_unit else signal, base
        )


def _checked_unit(unit: str, base: str) -> str:
    if pint_unit := _unit_for_pint(unit):
        return pint_unit
    raise ValueError(f"is {'not a unit' if unit.strip() else 'empty'}; write a unit such as {base}")


UNIT_SPELLINGS = {
    spelling: unit
    for unit, spellings in package_data("core/unit_spellings.yaml").items()
    for spelling in spellings.split()
}
"""Unit for pint by spelling, see `respelled`."""


def respelled(unit: str, base: str | None = None) -> str:
    """`unit` in a spelling that pint knows, such as N*m for ``N-m``; '' where that does not convert
    to `base`."""
    text = re.sub(r"(?<=[^\W\d])(?=-[0-9])", "^", " ".join(unit.translate(_SIGNS).split()))  # min-1
    text = re.sub(r"(?<=[^\W\d]) ?[-. ] ?(?=[^\W\d])", "*", text)
    words = re.sub(r"[^\W\d_]+", lambda word: UNIT_SPELLINGS.get(word[0].lower(), word[0]), text)
    for candidate in (UNIT_SPELLINGS.get(text.lower(), ""), words, text.lower()):
        try:
            _factor(candidate, candidate if base is None else base)
        except ValueError:
            continue
        return candidate
    return ""


@contextmanager
def _suggesting(number: str, unit: str, base: str | None = None) -> Iterator[None]:
    """Context in which an error about the `unit` of a `number` suggests another spelling, which
    converts to `base`."""
    try:
        yield
    except ValueError as error:
        spelling = respelled(unit, base) if len(unit) <= _LONGEST else ""
        if spelling in ("", unit):
            raise
        raise ValueError(
            f"{str(error).partition(';')[0]}; did you mean '{number}{spelling}'?"
        ) from error


Dimension = Any
"""Pint's dimension of a unit: powers of mass, length, time and others."""


def coherent(number: float, unit: str) -> tuple[float, Dimension]:
    """SI value and dimension of a `number` of any `unit` for pint, '' for a pure number."""
    with _suggesting(f"{number:g} ", unit):
        try:
            converted = _registry().Quantity(number, unit).to_base_units()
        except Exception as error:  # pint raises a dozen kinds
            raise ValueError(f"is not a number with a unit: there is no unit '{unit}'") from error
    return float(converted.magnitude), converted.dimensionality


@lru_cache
def dimension_of(unit: str) -> Dimension:
    """Dimension of a `unit` for pint."""
    return coherent(1.0, unit)[1]


_BASE = {"[mass]": "kg", "[length]": "m", "[time]": "s", "[current]": "A", "[temperature]": "K"}


def format_dimension(dimension: Dimension) -> str:
    """SI unit of a `dimension` with newtons instead of kilograms: ``N*s^3/m^3``; ``1`` for none."""
    powers = {_BASE.get(name, name.strip("[]")): power for name, power in dimension.items()}
    if mass := powers.pop("kg", 0):
        lengths, times = powers.pop("m", 0) - mass, powers.pop("s", 0) + 2 * mass
        powers = {"N": mass, "m": lengths, "s": times} | powers
    parts = [(name, abs(power), power > 0) for name, power in powers.items() if power]
    words = [(name if size == 1 else f"{name}^{size:g}", above) for name, size, above in parts]
    top = "*".join(word for word, above in words if above) or "1"
    return "/".join([top, *(word for word, above in words if not above)])


def quotient(unit: str, by: str) -> str:
    """Unit of a quantity in `unit` over one in `by`; '' is the unit of pure numbers."""
    if not by:
        return unit
    return "1" if unit == by else f"{unit or 1}/{by if by.isalpha() else f'({by})'}"


_LIMITS = {"gt": "exclusiveMinimum", "ge": "minimum", "lt": "exclusiveMaximum", "le": "maximum"}
"""Keywords of JSON schemas for pydantic's limits."""


def quantity(unit: str, **limits: float) -> Any:
    """Type of a quantity in `unit` (a pint name, '' for pure numbers) within `limits` (gt, ge, lt,
    le, multiple_of)."""
    number = {
        "type": "number",
        **{_LIMITS.get(key, "multipleOf"): limit for key, limit in limits.items()},
    }
    text = {"type": "string", "description": f"number with a unit that converts to {unit or '1'}"}
    return Annotated[
        float,
        Field(**limits),
        BeforeValidator(lambda value: to_si(value, unit)),
        WithJsonSchema({"anyOf": [number, text], "unit": unit or "1"}),
    ]


PositiveLength = quantity("m", gt=0)
Length = quantity("m")
PositiveMass = quantity("kg", gt=0)
PositiveSpeed = quantity("m/s", gt=0)
Angle = quantity("rad")
OpenFraction = quantity("", gt=0, lt=1)
PositiveNumber = quantity("", gt=0)
FrictionCoefficient = quantity("", ge=0, le=0.6)
