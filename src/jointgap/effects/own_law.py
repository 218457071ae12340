"""Laws of the user's own, in a campaign file: a formula with the ranges of its parameters."""

import ast
import math
import re
from collections.abc import Collection, Iterator, Mapping
from itertools import combinations
from typing import Annotated, Any, NamedTuple

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    WithJsonSchema,
    model_validator,
)

from jointgap.core.formula import _parsed, compile_formula
from jointgap.core.section import ConfigModel, Word
from jointgap.core.sites import Sites
from jointgap.core.units import Dimension, coherent, dimension_of, format_dimension, split_quantity
from jointgap.core.words import joined


def formula_effect(sites: Sites, body: str) -> str:
    """The effect of a mechanism file that has a formula, at a body."""
    return f"discovered_{body}_{'force' if body in sites.slides else 'torque'}"


_MOST_PARAMETERS, _MOST_SHAPES = 6, 2
_UNITS = {"force": "N", "torque": "N*m"}
_VARIABLES = {"v": "m/s", "x": "m", "w": "1/s", "theta": "", "pi": ""}
_AT_A_PIVOT = {"v": "1/s", "x": ""}  # Of a body apart from the crank
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
    match = _RANGE.fullmatch(text)
    if match is None:
        raise ValueError("is not a range; write e.g. '0 to 100 N*s^3/m^3' or [0, '100 N*s^3/m^3']")
    ends = [split_quantity(end) for end in match.groups()]
    unit = next((unit for _, unit in ends[::-1] if unit), "")
    (low, low_dimension), (high, dimension) = (
        coherent(float(number), end_unit or unit) for number, end_unit in ends
    )
    if low_dimension != dimension:
        raise ValueError("has two units of different dimensions; give both ends in one unit")
    if not low < high:
        raise ValueError("is in the wrong order or empty; write the lower end first")
    return Span(low, high, dimension if unit else None)


def _as_text(value: Any) -> str:
    if isinstance(value, list | tuple) and len(value) == 2:
        value = f"{value[0]} to {value[1]}"
    span(str(value))
    return str(value)


_ENDS = {"type": "array", "items": {"type": ["number", "string"]}, "minItems": 2, "maxItems": 2}
Range = Annotated[
    str,
    BeforeValidator(_as_text),
    WithJsonSchema({"anyOf": [{"type": "string"}, _ENDS]}),
]


class OwnLaw(ConfigModel):
    """A law of your own; each further key is the range of a parameter of the formula, c: 0 to 100
    N*s^3/m^3."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Range]

    site: Word = Field(description="body on which it acts, on a slide or a pivot of the frame")
    force: str | None = Field(
        None,
        description=(
            "of a body on a slide: force along it [N], of its v and x, and w, theta of the crank:"
            " -c*v^3"
        ),
    )
    torque: str | None = Field(
        None, description="of the crank, or a body on a pivot: counter-clockwise [N m]: -m*w"
    )

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, data: Any) -> Any:
        return data  # unlike those of other sections, further keys are parameters

    @property
    def key(self) -> str:
        """``force`` or ``torque``."""
        return "force" if self.torque is None else "torque"

    @property
    def formula(self) -> str:
        """Force [N] or torque [N m]."""
        return getattr(self, self.key) or ""

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
        key = self.key
        unit = _UNITS[key]
        if (self.force is None) == (self.torque is None) or not self.formula:
            yield (
                "requires either the key force [N], of a body on a slide, or torque [N m], such as"
                " force: '-c*v'"
            )
        spans = self.spans
        if not 0 < len(spans) <= _MOST_PARAMETERS:
            yield (
                f"has {len(spans)} parameters; give one to {_MOST_PARAMETERS}, such as c: 0 to 100"
                " N*s/m"
            )
        compile_formula(self.formula, {name: span.middle for name, span in spans.items()})
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
            product = " and ".join(map("*".join, sets))
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
        dimensions = {name: span.dimension for name, span in spans.items()}
        variables = _VARIABLES
        if key == "torque" and self.site != "crank":
            variables = _VARIABLES | _AT_A_PIVOT
        dimensions |= {name: dimension_of(unit) for name, unit in variables.items()}
        dimension, required = _dimension(_parsed(self.formula), dimensions), dimension_of(unit)
        if dimension is not None and dimension != required:
            name = sets[0][0]
            correct_unit = format_dimension(dimensions[name] * required / dimension)
            yield (
                f"{where} has the unit {format_dimension(dimension)} and must have {unit}; give"
                f" {name} in {correct_unit}"
            )


def _amplitudes(formula: str, names: Collection[str]) -> list[tuple[str, ...]]:
    """All sets of parameters of which each term has exactly one as a factor; of several sets only a
    product acts."""
    tree = _parsed(formula)
    sizes = range(1, len(names) + 1)
    return [
        candidates
        for size in sizes
        for candidates in combinations(names, size)
        if _degree(tree, candidates) == 1.0
    ]


def _degree(tree: ast.expr, amplitudes: Collection[str]) -> float:
    """Degree of a polynomial in the `amplitudes`, whose terms have the same degree; NaN for other
    formulas."""
    match tree:
        case ast.Name(id=name):
            return float(name in amplitudes)
        case ast.UnaryOp(operand=operand):
            return _degree(operand, amplitudes)
        case ast.BinOp(left=left, op=op, right=right):
            left_degree, right_degree = _degree(left, amplitudes), _degree(right, amplitudes)
            if isinstance(op, ast.Mult):
                return left_degree + right_degree
            if isinstance(op, ast.Div) and right_degree == 0.0:
                return left_degree
            if isinstance(op, ast.Add | ast.Sub) and left_degree == right_degree:
                return left_degree
            return 0.0 if left_degree == right_degree == 0.0 else math.nan
        case ast.Call(args=[operand]) | ast.Set(elts=[operand]):
            return 0.0 if _degree(operand, amplitudes) == 0.0 else math.nan
    return 0.0  # a number


def _constant(tree: ast.expr) -> float | None:
    """Value of an expression of numbers; None for another one."""
    match tree:
        case ast.Constant(value=value):
            return float(value)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            value = _constant(operand)
            return None if value is None else -value
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            above, below = _constant(left), _constant(right)
            return above / below if above is not None and below else None
    return None


def _dimension(tree: ast.expr, dimensions: Mapping[str, Dimension | None]) -> Dimension | None:
    """Dimension of a formula; None where it is open, as numbers may have a unit. ValueError for a
    contradiction."""
    match tree:
        case ast.Name(id=name):
            return dimensions[name]
        case ast.UnaryOp(operand=operand) | ast.Set(elts=[operand]):
            return _dimension(operand, dimensions)
        case ast.BinOp(left=base, op=ast.Pow(), right=right):
            dimension, exponent = _dimension(base, dimensions), _constant(right)
            return None if None in (dimension, exponent) else dimension**exponent
        case ast.BinOp(left=left, op=op, right=right):
            pair = _dimension(left, dimensions), _dimension(right, dimensions)
            if isinstance(op, ast.Add | ast.Sub):
                if None not in pair and pair[0] != pair[1]:
                    units = " and ".join(map(format_dimension, pair))
                    raise ValueError(
                        f"'{ast.unparse(tree)}' adds {units}; correct the units of the parameters"
                    )
                return pair[1] if pair[0] is None else pair[0]
            if None in pair:
                return None
            return pair[0] * pair[1] if isinstance(op, ast.Mult) else pair[0] / pair[1]
        case ast.Call(func=ast.Name(id=name), args=[operand]):
            dimension, none = _dimension(operand, dimensions), dimension_of("")
            if name == "abs":
                return dimension
            if name == "sqrt":
                return None if dimension is None else dimension**0.5
            if name != "sgn" and dimension not in (None, none):
                unit = format_dimension(dimension)
                raise ValueError(
                    f"'{ast.unparse(tree)}' is of a quantity in {unit}; divide it by one in {unit}"
                )
            return none
    return None
