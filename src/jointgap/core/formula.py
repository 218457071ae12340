"""Formulas such as ``-a*v*|v| + b*sin(theta)``, compiled to programs for a stack machine.

They are Python expressions of numbers, names and functions, with ``^`` for powers and bars for
absolute values. The machine is in `jointgap.motion.equations`; each row of `Program.codes` is an
operation and an index, used by NUMBER and VARIABLE.
"""

import ast
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from jointgap.core.errors import InputError, did_you_mean

NUMBER, VARIABLE, NEGATE, ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, SQUARE = range(9)
SIN, COS, TAN, TANH, EXP, LOG, SQRT, ABS, SGN = range(9, 18)

VARIABLES = {
    "v": "velocity of the slider [m/s]",
    "x": "position of the slider [m]",
    "w": "speed of the crank [rad/s]",
    "theta": "crank angle [rad]",
    "t": "time [s]",
}
"""Variables of a formula; the position of a name is its index in a program."""

DEEPEST_STACK = 16  # fixed size of the machine's stack
LONGEST_FORMULA = 1000  # [characters]

_FUNCTIONS: dict[str, tuple[int, Callable[[float], float]]] = {
    "sin": (SIN, math.sin),
    "cos": (COS, math.cos),
    "tan": (TAN, math.tan),
    "tanh": (TANH, math.tanh),
    "exp": (EXP, math.exp),
    "log": (LOG, math.log),
    "sqrt": (SQRT, math.sqrt),
    "abs": (ABS, abs),
    "sgn": (SGN, lambda number: float((number > 0) - (number < 0))),
}
_OPERATIONS: dict[type, tuple[int, Callable[[float, float], float]]] = {
    ast.Add: (ADD, lambda a, b: a + b),
    ast.Sub: (SUBTRACT, lambda a, b: a - b),
    ast.Mult: (MULTIPLY, lambda a, b: a * b),
    ast.Div: (DIVIDE, lambda a, b: a / b),
    ast.Pow: (POWER, math.pow),
}
_RESERVED = {*VARIABLES, *_FUNCTIONS, "pi"}
_TOKEN = re.compile(
    r"\s*((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[A-Za-z_]\w*|\*\*|[-+*/^()|])", re.ASCII
)


@dataclass(frozen=True)
class Program:
    """A formula for the stack machine."""

    codes: np.ndarray  # Operations in order, each with its index; n = 0 is the formula 0
    numbers: np.ndarray  # Operands of NUMBER


NOTHING = Program(np.empty((0, 2), np.int64), np.empty(0))
"""The program of the formula 0."""


def compile_formula(text: str, coefficients: Mapping[str, float]) -> Program:
    """The program of a formula; InputError where it is invalid."""
    for name in coefficients:
        if name in _RESERVED or not (name.isascii() and name.isidentifier()):
            raise InputError(
                f"coefficient '{name}' is a reserved or invalid name; use a name of letters, digits"
                f" and '_' other than {', '.join(sorted(_RESERVED))}"
            )
    if len(text) > LONGEST_FORMULA:
        raise InputError(
            f"the formula has {len(text)} characters, more than {LONGEST_FORMULA}; shorten it"
        )
    steps, used = _Steps(text, coefficients), set(_TOKEN.findall(text))
    if unused := sorted(set(coefficients) - used):
        raise InputError(f"formula '{text}' does not use the coefficient '{unused[0]}'; remove it")
    program = steps.of(_parsed(text))
    depth = np.cumsum(
        [1 if code <= VARIABLE else -1 if ADD <= code <= POWER else 0 for code, _ in program]
    ).max()
    if depth > DEEPEST_STACK:
        raise InputError(
            f"formula '{text}' needs a stack of {depth} numbers, more than {DEEPEST_STACK}; nest it"
            " less"
        )
    numbers = [operand for code, operand in program if code == NUMBER]
    places = iter(range(len(numbers)))
    codes = [(code, next(places) if code == NUMBER else operand) for code, operand in program]
    return Program(np.array(codes, np.int64).reshape(-1, 2), np.array(numbers, float))


def _parsed(text: str) -> ast.expr:
    """The syntax tree of a formula; bars become sets, which open after an operation or an opening
    bracket."""
    if not text.strip():
        raise InputError("the formula is empty; write e.g. '-a*v*|v|'")
    python, place, end = "", 0, len(text.rstrip())
    while place < end:
        match = _TOKEN.match(text, place)
        if not match:
            raise InputError(
                f"formula '{text}', after '{text[:place]}': the next character is invalid;"
                " remove it"
            )
        token, place = match[1], match.end()
        if token == "|":
            token = "{" if not python or python[-1] in "({*+-/" else "}"
        python += f" {'**' if token == '^' else token}"
    try:
        return ast.parse(python.strip(), mode="eval").body
    except (SyntaxError, RecursionError, MemoryError) as error:
        raise InputError(
            f"formula '{text}' cannot be read; write every operation (2*v, not 2 v), close every"
            " bracket and bar, and nest it less"
        ) from error


_Step = tuple[int, float]


@dataclass(frozen=True)
class _Steps:
    """Converts a tree to operations in order of execution, each with its number or variable index;
    subexpressions without variables become one number.
    """

    text: str
    coefficients: Mapping[str, float]

    def of(self, tree: ast.expr) -> list[_Step]:
        match tree:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return self.number(float, value)
            case ast.Name(id=name):
                return self.name(name)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.of(operand)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self.operation(NEGATE, lambda number: -number, self.of(operand))
            case ast.Set(elts=[operand]):
                return self.operation(*_FUNCTIONS["abs"], self.of(operand))
            case ast.Call(func=ast.Name(id=name), args=[operand], keywords=[]):
                if name in _FUNCTIONS:
                    return self.operation(*_FUNCTIONS[name], self.of(operand))
                self.name(name)  # raises for an unknown name
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATIONS:
                base, second = self.of(left), self.of(right)
                if isinstance(op, ast.Pow) and second == [(NUMBER, 2.0)] and not _is_number(base):
                    return [*base, (SQUARE, 0)]
                if isinstance(op, ast.Div) and second == [(NUMBER, 0.0)]:
                    raise InputError(f"formula '{self.text}' divides by 0")
                return self.operation(*_OPERATIONS[type(op)], base, second)
        raise InputError(
            f"formula '{self.text}': '{ast.unparse(tree)}' is not supported; use + - * / ^ and"
            " functions"
        )

    def name(self, name: str) -> list[_Step]:
        if name in VARIABLES:
            return [(VARIABLE, list(VARIABLES).index(name))]
        if name == "pi":
            return [(NUMBER, math.pi)]
        if name in self.coefficients:
            return self.number(float, self.coefficients[name])
        if name in _FUNCTIONS:
            raise InputError(f"formula '{self.text}': '{name}' is a function; write {name}(...)")
        accepted = {*_RESERVED, *self.coefficients}
        hint = did_you_mean(name, accepted)
        listed = "" if hint.startswith("known") else f" Known here: {', '.join(sorted(accepted))}."
        raise InputError(f"formula '{self.text}': unknown name '{name}'; {hint}{listed}")

    def operation(
        self, code: int, evaluate: Callable[..., float], *operands: list[_Step]
    ) -> list[_Step]:
        if all(map(_is_number, operands)):
            return self.number(evaluate, *(operand[0][1] for operand in operands))
        return [*(step for operand in operands for step in operand), (code, 0)]

    def number(self, evaluate: Callable[..., float], *operands: float) -> list[_Step]:
        try:
            number = float(evaluate(*operands))
        except (ValueError, OverflowError):
            number = math.nan
        if not math.isfinite(number):
            raise InputError(
                f"formula '{self.text}': a part without variables is not a finite number"
            )
        return [(NUMBER, number)]


def _is_number(steps: list[_Step]) -> bool:
    return len(steps) == 1 and steps[0][0] == NUMBER
