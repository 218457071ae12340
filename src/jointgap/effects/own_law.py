"""Laws of the user's own, in a campaign file: a formula with the ranges of its parameters."""

import ast
import math
import re
from collections.abc import Collection, Iterator, Mapping
from itertools import combinations
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    WithJsonSchema,
    model_validator,
)

from jointgap.core.formula import _parsed, compile_formula
from jointgap.core.section import ConfigModel
from jointgap.core.units import Dimension, coherent, dimension_of, format_dimension, split_quantity
from jointgap.core.words import joined

FORMULA_EFFECTS = {"slider": "discovered_slider_force", "crank": "discovered_crank_torque"}
"""The effect of a mechanism file that has a formula, by site."""

_MOST_PARAMETERS, _MOST_SHAPES = 6, 2
_KEYS = {"slider": ("force", "N"), "crank": ("torque", "N*m")}
_VARIABLES = {"v": "m/s", "x": "m", "w": "1/s", "theta": "", "pi": ""}
_RANGE = re.compile(r"\s*(.+?)\s+to\s+(.+?)\s*", re.DOTALL)


class Span(NamedTuple):
    """Range of a parameter."""

    low: float  # [SI]
    high: float  # [SI]
    dimension: Dimension | None  # None if no unit is given

    @property
    def middle(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def unit(self) -> str:
        """SI unit; ``1`` for a pure number or if no unit is given."""
        return "1" if self.dimension is None else format_dimension(self.dimension)


def span(text: str) -> Span:
    """The range in a text such as ``0 to 100 N*s^3/m^3``; ValueError where it is invalid."""
    found = _RANGE.fullmatch(text)
    if found is None:
        raise ValueError("is not a range; write e.g. '0 to 100 N*s^3/m^3' or [0, '100 N*s^3/m^3']")
    ends = [split_quantity(end) for end in found.groups()]
    usual = next((unit for _, unit in ends[::-1] if unit), "")
    low, high = (coherent(float(number), unit or usual) for number, unit in ends)
    if low[1] != high[1]:
        raise ValueError("has two units of different dimensions; give both ends in one unit")
    if not low[0] < high[0]:
        raise ValueError("is in the wrong order or empty; write the lower end first")
    return Span(low[0], high[0], high[1] if usual else None)


def _as_text(given: Any) -> Any:
    if isinstance(given, list | tuple) and len(given) == 2:
        given = f"{given[0]} to {given[1]}"
    return given if isinstance(given, str) else f"{given}"


def _checked(text: str) -> str:
    span(text)
    return text


_ENDS = {"type": "array", "items": {"type": ["number", "string"]}, "minItems": 2, "maxItems": 2}
Range = Annotated[
    str,
    BeforeValidator(_as_text),
    AfterValidator(_checked),
    WithJsonSchema({"anyOf": [{"type": "string"}, _ENDS]}),
]


class OwnLaw(ConfigModel):
    """A law of your own; each further key is the range of a parameter of the formula, c: 0 to 100
    N*s^3/m^3."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Range]

    site: Literal["slider", "crank"] = Field(description="body on which it acts")
    force: str | None = Field(
        None,
        description="site slider: force along +x [N], of v, x (slider), w, theta (crank): -c*v^3",
    )
    torque: str | None = Field(None, description="site crank: counter-clockwise torque [N m]: -m*w")

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, data: Any) -> Any:
        return data  # unlike those of other sections, further keys are parameters

    @property
    def formula(self) -> str:
        """Force [N] or torque [N m]."""
        return getattr(self, _KEYS[self.site][0]) or ""

    @property
    def spans(self) -> dict[str, Span]:
        """Ranges by parameter."""
        return {name: span(text) for name, text in self.__pydantic_extra__.items()}

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """Parameters in which the law is linear, and without which it is 0; the others are shape
        parameters."""
        return _amplitudes(self.formula, self.spans)[0]

    def errors(self) -> Iterator[str]:
        key, unit = _KEYS[self.site]
        other = "torque" if key == "force" else "force"
        if getattr(self, other) is not None or not self.formula:
            yield (
                f"site {self.site} requires the key {key} [{unit}], and not {other}, such as {key}:"
                " '-c*v'"
            )
        spans = self.spans
        if not 0 < len(spans) <= _MOST_PARAMETERS:
            yield (
                f"has {len(spans)} parameters; give one to {_MOST_PARAMETERS}, such as c: 0 to 100"
                " N*s/m"
            )
        compile_formula(self.formula, {name: own.middle for name, own in spans.items()})
        where = f"{key} = '{self.formula}'"
        if re.search(r"\bt\b", self.formula):
            yield (
                f"{where}: the time t differs between runs; use v, x, w and theta, or the effect"
                " harmonic_force"
            )
        sets = _amplitudes(self.formula, spans)
        if not sets:
            yield (
                f"{where} is not proportional to a parameter; multiply each of its terms by one, "
                "as c in -c*v^3, so that the law vanishes with it"
            )
        if len(sets) > 1:
            product = " and ".join("*".join(own) for own in sets)
            yield (
                f"{where}: only the product of {product} has an effect; replace one of them by a"
                " number"
            )
        shapes = [name for name in spans if name not in sets[0]]
        if len(shapes) > _MOST_SHAPES:
            yield (
                f"{where}: {joined(shapes)} are shape parameters; at most {_MOST_SHAPES} can be"
                " fitted"
            )
        for name in sets[0]:
            if not spans[name].low <= 0.0 <= spans[name].high:
                yield (
                    f"{name} = '{self.__pydantic_extra__[name]}' must include 0, where the effect"
                    " is absent"
                )
        dimensions = {name: own.dimension for name, own in spans.items()}
        dimensions |= {name: dimension_of(own) for name, own in _VARIABLES.items()}
        found, needed = _dimension(_parsed(self.formula), dimensions), dimension_of(unit)
        if found is not None and found != needed:
            first = sets[0][0]
            instead = format_dimension(dimensions[first] * needed / found)
            yield (
                f"{where} has the unit {format_dimension(found)} and must have {unit}; give {first}"
                f" in {instead}"
            )


def _amplitudes(formula: str, names: Collection[str]) -> list[tuple[str, ...]]:
    """All sets of parameters of which each term has exactly one as a factor; of several sets only a
    product acts."""
    tree = _parsed(formula)
    sets = (own for size in range(1, len(names) + 1) for own in combinations(names, size))
    return [own for own in sets if _degree(tree, own) == 1.0]


def _degree(tree: ast.expr, amplitudes: Collection[str]) -> float:
    """Degree of a polynomial in the `amplitudes`, whose terms have the same degree; NaN for other
    formulas."""
    match tree:
        case ast.Name(id=name):
            return float(name in amplitudes)
        case ast.UnaryOp(operand=operand):
            return _degree(operand, amplitudes)
        case ast.BinOp(left=left, op=op, right=right):
            first, second = _degree(left, amplitudes), _degree(right, amplitudes)
            if isinstance(op, ast.Mult):
                return first + second
            if (isinstance(op, ast.Div) and second == 0.0) or (
                isinstance(op, ast.Add | ast.Sub) and first == second
            ):
                return first
            return 0.0 if first == second == 0.0 else math.nan
        case ast.Call(args=[operand]) | ast.Set(elts=[operand]):
            return 0.0 if _degree(operand, amplitudes) == 0.0 else math.nan
    return 0.0  # a number


def _dimension(tree: ast.expr, known: Mapping[str, Dimension | None]) -> Dimension | None:
    """Dimension of a formula; None where it is open, as numbers may have a unit. ValueError for a
    contradiction."""
    match tree:
        case ast.Name(id=name):
            return known[name]
        case ast.UnaryOp(operand=operand) | ast.Set(elts=[operand]):
            return _dimension(operand, known)
        case ast.BinOp(left=base, op=ast.Pow(), right=ast.Constant(value=exponent)):
            own = _dimension(base, known)
            return None if own is None else own**exponent
        case ast.BinOp(left=left, op=op, right=right):
            first, second = _dimension(left, known), _dimension(right, known)
            if isinstance(op, ast.Add | ast.Sub):
                if None not in (first, second) and first != second:
                    units = f"{format_dimension(first)} and {format_dimension(second)}"
                    raise ValueError(
                        f"'{ast.unparse(tree)}' adds {units}; correct the units of the parameters"
                    )
                return second if first is None else first
            if first is None or second is None or isinstance(op, ast.Pow):
                return None
            return first * second if isinstance(op, ast.Mult) else first / second
        case ast.Call(func=ast.Name(id=name), args=[operand]):
            own = _dimension(operand, known)
            if name in ("abs", "sqrt"):
                return own if name == "abs" or own is None else own**0.5
            if name != "sgn" and own not in (None, dimension_of("")):
                unit = format_dimension(own)
                raise ValueError(
                    f"'{ast.unparse(tree)}' is of a quantity in {unit}; divide it by one in {unit}"
                )
            return dimension_of("")
    return None
