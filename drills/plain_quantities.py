"""A reading of numbers with units that shares nothing with the package's: one number with one unit, or none at all.

It reads what people write: a typographic minus is a minus, a raised 2 a power, the middle dot a product. What it cannot
read has no meaning that everybody agrees on.
"""

import math
import re
import unicodedata
from typing import NamedTuple


class Unit(NamedTuple):
    """How many SI units one unit is, and the powers of kilogram, metre, second and turn (as radians) in it."""

    factor: float
    powers: tuple[float, float, float, float]


class Reading(NamedTuple):
    """What a text says: its value in SI, or NaN where that depends on what is wanted of it, and whether it can be read.

    Attributes
    ----------
    value : float or None
        None: the text is not one number with at most one unit.
    known : bool
        False: it has the form of a number with a unit, but the unit is not in the table here.
    """

    value: float | None
    known: bool = True


_NONE = (0.0, 0.0, 0.0, 0.0)
_MASS, _LENGTH, _TIME, _ANGLE = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)
_FORCE, _PRESSURE, _ENERGY = (1.0, 1.0, -2.0, 0.0), (1.0, -1.0, -2.0, 0.0), (1.0, 2.0, -2.0, 0.0)
_RATE, _TURNING = (0.0, 0.0, -1.0, 0.0), (0.0, 0.0, -1.0, 1.0)

_PREFIXED = {
    "m": Unit(1.0, _LENGTH),
    "g": Unit(1e-3, _MASS),
    "s": Unit(1.0, _TIME),
    "rad": Unit(1.0, _ANGLE),
    "N": Unit(1.0, _FORCE),
    "Pa": Unit(1.0, _PRESSURE),
    "J": Unit(1.0, _ENERGY),
    "Hz": Unit(1.0, _RATE),
}
_PREFIXES = {"": 1.0, "G": 1e9, "M": 1e6, "k": 1e3, "c": 1e-2, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "n": 1e-9}
UNITS = {
    **{
        prefix + name: Unit(size * unit.factor, unit.powers)
        for name, unit in _PREFIXED.items()
        for prefix, size in _PREFIXES.items()
    },
    "meter": Unit(1.0, _LENGTH),
    "metre": Unit(1.0, _LENGTH),
    "millimeter": Unit(1e-3, _LENGTH),
    "inch": Unit(0.0254, _LENGTH),
    "second": Unit(1.0, _TIME),
    "min": Unit(60.0, _TIME),
    "h": Unit(3600.0, _TIME),
    "t": Unit(1e3, _MASS),
    "deg": Unit(math.pi / 180.0, _ANGLE),
    "degree": Unit(math.pi / 180.0, _ANGLE),
    "°": Unit(math.pi / 180.0, _ANGLE),
    "turn": Unit(math.tau, _ANGLE),
    "rpm": Unit(math.tau / 60.0, _TURNING),
    "bar": Unit(1e5, _PRESSURE),
    "g_n": Unit(9.80665, (0.0, 1.0, -2.0, 0.0)),
    "%": Unit(1e-2, _NONE),
    "percent": Unit(1e-2, _NONE),
}
"""Units that are written in these drills."""

_MINUS = "−"
_DOTS = str.maketrans({"·": "*", "⋅": "*"})
_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_NUMBER = re.compile(
    r"([-+−]?)(0[xX][0-9a-fA-F]+|0[oO][0-7]+|0[bB][01]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+−]?\d+)?)", re.ASCII
)
_TOKEN = re.compile(r"\s*(?:(?P<name>[^\W\d]\w*|[°%])|(?P<number>[-+]?\d+(?:\.\d+)?)|(?P<sign>\*\*|[*/^()]))")


def read(text: str, wanted: str) -> Reading:
    """What `text` says in the SI unit `wanted`, of the table here, '' for a pure number."""
    text = (
        unicodedata.normalize("NFKC", text.translate(_DOTS).replace("²", "^2").replace("³", "^3"))
        if not text.isascii()
        else text
    )
    text = _plain_digits(text.strip())
    found = _NUMBER.match(text)
    if found is None:
        return _share(text, wanted)
    number, rest = _number(found), text[found.end() :]
    if not math.isfinite(number):
        return Reading(None)
    if rest and (rest[0].isdigit() or rest[0] in "._'’"):
        return Reading(None)
    rest = rest.strip()
    if not rest:
        return Reading(number)
    try:
        unit = parse_unit(rest)
    except KeyError:
        return Reading(None, known=False)
    except ValueError:
        return Reading(None)
    return _in(number, unit, wanted)


def _share(text: str, wanted: str) -> Reading:
    """What is written as a share of a unit, such as turn/3600."""
    name, slash, number = text.rpartition("/")
    digits = number.strip()
    if not slash or not re.fullmatch(r"\d+(\.\d*)?", digits, re.ASCII) or not float(digits):
        return Reading(None)
    try:
        return _in(1.0 / float(digits), parse_unit(name), wanted)
    except KeyError:
        return Reading(None, known=False)
    except ValueError:
        return Reading(None)


def _in(number: float, unit: Unit, wanted: str) -> Reading:
    goal = parse_unit(wanted) if wanted and wanted != "1" else Unit(1.0, _NONE)
    own, goals = unit.powers, goal.powers
    # an angle is a ratio of lengths, so that N*m/rad is N*m; a rate of turns is not a rate of anything
    turns = goals[2] == -1.0 and goals[:2] == (0.0, 0.0) and own[3] != goals[3]
    if own[:3] != goals[:3] or turns:
        return Reading(None)
    return Reading(number * unit.factor / goal.factor)


def _plain_digits(text: str) -> str:
    return "".join(str(unicodedata.decimal(sign)) if sign.isdecimal() and not sign.isascii() else sign for sign in text)


def _number(found: re.Match) -> float:
    sign, digits = found.groups()
    size = float(int(digits, 0)) if digits[:2].lower() in ("0x", "0o", "0b") else float(digits.replace(_MINUS, "-"))
    return -size if sign in ("-", _MINUS) else size


def parse_unit(text: str) -> Unit:
    """The unit in `text`.

    Raises
    ------
    KeyError
        A name that is not in the table.
    ValueError
        No product or quotient of names with powers.
    """
    tokens, place, text = [], 0, text.translate(_DOTS)
    text = re.sub("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", lambda raised: "^" + raised[0].translate(_RAISED), text).strip()
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None:
            raise ValueError(f"'{text[place]}' has no meaning in a unit")
        tokens.append((match.lastgroup, match[match.lastgroup]))
        place = match.end()
    unit, left = _product(tokens)
    if left:
        raise ValueError(f"'{left[0][1]}' is left over")
    return unit


_Tokens = list[tuple[str | None, str]]


def _product(tokens: _Tokens) -> tuple[Unit, _Tokens]:
    if tokens and tokens[0] == ("sign", "/"):
        unit = Unit(1.0, _NONE)
    else:
        unit, tokens = _power(tokens)
    while tokens and tokens[0][1] != ")":
        sign = 1.0
        if tokens[0][1] in ("*", "/"):
            sign = -1.0 if tokens[0][1] == "/" else 1.0
            tokens = tokens[1:]
        factor, tokens = _power(tokens)
        unit = Unit(unit.factor * factor.factor**sign, _sum(unit.powers, factor.powers, sign))
    return unit, tokens


def _power(tokens: _Tokens) -> tuple[Unit, _Tokens]:
    if not tokens:
        raise ValueError("the unit ends too early")
    (kind, text), tokens = tokens[0], tokens[1:]
    if text == "(":
        unit, tokens = _product(tokens)
        if not tokens or tokens[0][1] != ")":
            raise ValueError("a bracket is not closed")
        tokens = tokens[1:]
    elif kind == "name":
        unit = UNITS[text]
    elif kind == "number" and float(text) == 1.0 and tokens[:1] == [("sign", "/")]:
        return Unit(1.0, _NONE), tokens
    else:
        raise ValueError(f"'{text}' is no name of a unit")
    if tokens and tokens[0][1] in ("^", "**"):
        if len(tokens) < 2 or tokens[1][0] != "number":
            raise ValueError("a power is missing")
        power = float(tokens[1][1])
        unit = Unit(unit.factor**power, tuple(power * one for one in unit.powers))
        tokens = tokens[2:]
    return unit, tokens


def _sum(powers: tuple[float, ...], others: tuple[float, ...], sign: float) -> tuple[float, ...]:
    return tuple(one + sign * other for one, other in zip(powers, others, strict=True))
