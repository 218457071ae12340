"""Formulas in field terms, such as ``-a*v*|v| + b*sin(theta)``, and the small programs they become.

Grammar, loosest first; there is no multiplication without its sign, so that every bar can be told to open or to close:

    sum     = product (("+" | "-") product)*
    product = sign (("*" | "/") sign)*
    sign    = ("-" | "+") sign | power
    power   = atom (("^" | "**") sign)?               from the right: 2^3^2 = 2^9, and -v^2 = -(v^2)
    atom    = number | name | function "(" sum ")" | "(" sum ")" | "|" sum "|"

A program runs on a stack (`jointgap.dynamics.equations` is the machine): each row of `Program.codes` is
an operation and an index, read where the operation is NUMBER or VARIABLE.
"""

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
"""What a formula may depend on; the place of a name here is its index in a program."""

DEEPEST_STACK = 16  # numbers that the evaluator holds at once: its memory has a fixed size
LONGEST_FORMULA = 1000  # [characters] far more than a law of friction or of a spring needs
DEEPEST_NESTING = 50  # brackets in brackets: far less than Python's own limit of recursion

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
_OPERATIONS: dict[str, tuple[int, Callable[[float, float], float]]] = {
    "+": (ADD, lambda a, b: a + b),
    "-": (SUBTRACT, lambda a, b: a - b),
    "*": (MULTIPLY, lambda a, b: a * b),
    "/": (DIVIDE, lambda a, b: a / b),
    "^": (POWER, math.pow),
}
_CONSTANTS = {"pi": math.pi}
_RESERVED = {*VARIABLES, *_FUNCTIONS, *_CONSTANTS}
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)|(?P<sign>\*\*|[-+*/^()|]))",
    re.ASCII,
)


@dataclass(frozen=True)
class Program:
    """A formula for the stack machine."""

    codes: np.ndarray  # Operations in order, each with its index; n = 0 stands for the formula 0
    numbers: np.ndarray  # What the operation NUMBER refers to


NOTHING = Program(np.empty((0, 2), np.int64), np.empty(0))
"""The program of no formula: it evaluates to 0."""


def compile_formula(text: str, coefficients: Mapping[str, float]) -> Program:
    """The program of a formula."""
    for name in coefficients:
        if name in _RESERVED or not (name.isascii() and name.isidentifier()):
            raise InputError(
                f"coefficient '{name}' cannot be told from the formula's own words; use a name of letters, digits and "
                f"'_' other than {', '.join(sorted(_RESERVED))}"
            )
    if len(text) > LONGEST_FORMULA:
        raise InputError(f"the formula has {len(text)} characters, more than {LONGEST_FORMULA}; shorten it")
    reader = _Reader(text, coefficients)
    tree = reader.formula()
    if unused := sorted(set(coefficients) - reader.used):
        raise InputError(f"formula '{text}' does not use the coefficient '{unused[0]}'; leave it out")
    codes, numbers = [], []
    depth = _emit(tree, codes, numbers)
    if depth > DEEPEST_STACK:
        raise InputError(f"formula '{text}' keeps {depth} numbers at once, more than {DEEPEST_STACK}; nest it less")
    return Program(np.array(codes, np.int64).reshape(-1, 2), np.array(numbers, float))


# A tree is a number, ("variable", index) or (operation, operands...).
_Tree = float | tuple


class _Reader:
    """Reads a formula by recursive descent."""

    def __init__(self, text: str, coefficients: Mapping[str, float]):
        self.text, self.coefficients, self.used = text, coefficients, set()
        self.tokens, self.next, self.nesting = _tokens(text), 0, 0

    def formula(self) -> _Tree:
        tree = self.sum()
        if self.next < len(self.tokens):
            raise self.wrong("cannot stand here; an operation is missing before it, or a bracket was never opened")
        return tree

    def wrong(self, why: str) -> InputError:
        if self.next >= len(self.tokens):
            return InputError(f"formula '{self.text}' ends too early; add a number, a name or the closing bracket")
        _, token, place = self.tokens[self.next]
        return InputError(f"formula '{self.text}', character {place + 1}: '{token}' {why}")

    def take(self, *signs: str) -> str | None:
        """The next token if it is one of `signs`, which is then behind us."""
        if self.next < len(self.tokens) and self.tokens[self.next][1] in signs:
            self.next += 1
            return self.tokens[self.next - 1][1]
        return None

    def sum(self) -> _Tree:
        return self.chain(self.product, "+", "-")

    def product(self) -> _Tree:
        return self.chain(self.sign, "*", "/")

    def chain(self, part: Callable[[], _Tree], *signs: str) -> _Tree:
        tree = part()
        while sign := self.take(*signs):
            tree = self.operation(sign, tree, part())
        return tree

    def sign(self) -> _Tree:
        self.nesting += 1
        if self.nesting > DEEPEST_NESTING:
            raise self.wrong(f"is nested more than {DEEPEST_NESTING} deep; simplify the formula")
        if sign := self.take("-", "+"):
            tree = self.sign()
            if sign == "-":
                tree = -tree if isinstance(tree, float) else (NEGATE, tree)
        else:
            tree = self.power()
        self.nesting -= 1
        return tree

    def power(self) -> _Tree:
        base = self.atom()
        if not self.take("^", "**"):
            return base
        exponent = self.sign()
        return (SQUARE, base) if exponent == 2.0 and isinstance(base, tuple) else self.operation("^", base, exponent)

    def atom(self) -> _Tree:
        if self.take("("):
            return self.closed(")")
        if self.take("|"):
            return self.function("abs", self.closed("|"))
        kind, token, _ = self.tokens[self.next] if self.next < len(self.tokens) else ("", "", 0)
        if kind not in ("number", "name"):
            raise self.wrong("stands where a number or a name is needed")
        if kind == "name" and token not in _FUNCTIONS:
            return self.named(token)
        self.next += 1
        if kind == "number":
            return self.checked(float(token))
        if not self.take("("):
            raise InputError(f"formula '{self.text}': '{token}' is a function; write {token}(...)")
        return self.function(token, self.closed(")"))

    def closed(self, bracket: str) -> _Tree:
        tree = self.sum()
        if not self.take(bracket):
            raise self.wrong(f"stands where '{bracket}' or an operation is needed")
        return tree

    def named(self, name: str) -> _Tree:
        self.next += 1
        if name in VARIABLES:
            return ("variable", list(VARIABLES).index(name))
        if name in _CONSTANTS:
            return _CONSTANTS[name]
        if name not in self.coefficients:
            accepted = {*_RESERVED, *self.coefficients}
            hint = did_you_mean(name, accepted)
            listed = "" if hint.startswith("known") else f" Known here: {', '.join(sorted(accepted))}."
            raise InputError(f"formula '{self.text}': unknown name '{name}'; {hint}{listed}")
        self.used.add(name)
        return self.checked(float(self.coefficients[name]))

    def function(self, name: str, operand: _Tree) -> _Tree:
        code, evaluate = _FUNCTIONS[name]
        return self.folded(evaluate, operand) if isinstance(operand, float) else (code, operand)

    def operation(self, sign: str, left: _Tree, right: _Tree) -> _Tree:
        code, evaluate = _OPERATIONS["^" if sign == "**" else sign]
        if sign == "/" and right == 0.0:
            raise InputError(f"formula '{self.text}' divides by 0")
        both = isinstance(left, float) and isinstance(right, float)
        return self.folded(evaluate, left, right) if both else (code, left, right)

    def folded(self, evaluate: Callable[..., float], *operands: float) -> float:
        try:
            return self.checked(float(evaluate(*operands)))
        except (ValueError, OverflowError) as error:
            raise InputError(
                f"formula '{self.text}': a part of it that holds no variable is not a finite number"
            ) from error

    def checked(self, number: float) -> float:
        if not math.isfinite(number):
            raise InputError(f"formula '{self.text}': a part of it that holds no variable is not a finite number")
        return number


def _tokens(text: str) -> list[tuple[str, str, int]]:
    """Kind, text and place of every token."""
    tokens, place = [], 0
    end = len(text.rstrip())
    while place < end:
        match = _TOKEN.match(text, place)
        if not match:
            wrong = place + len(text[place:]) - len(text[place:].lstrip())
            raise InputError(
                f"formula '{text}', character {wrong + 1}: '{text[wrong]}' has no meaning in a formula; remove it"
            )
        tokens.append((match.lastgroup, match[match.lastgroup], match.start(match.lastgroup)))
        place = match.end()
    if not tokens:
        raise InputError("the formula is empty; write e.g. '-a*v*|v|'")
    return tokens


def _emit(tree: _Tree, codes: list, numbers: list) -> int:
    """Append the operations of `tree`; how deep the stack gets meanwhile."""
    # A sum of many terms is a tree as deep to the left as there are terms, deeper than Python may call itself; to the
    # right, `DEEPEST_NESTING` bounds it.
    pending = []
    while isinstance(tree, tuple) and tree[0] != "variable":
        pending.append(tree)
        tree = tree[1]
    if isinstance(tree, tuple):
        codes.append((VARIABLE, tree[1]))
    else:
        codes.append((NUMBER, len(numbers)))
        numbers.append(tree)
    depth = 1
    for operation, _, *others in reversed(pending):
        depth = max([depth, *(below + _emit(operand, codes, numbers) for below, operand in enumerate(others, 1))])
        codes.append((operation, 0))
    return depth
