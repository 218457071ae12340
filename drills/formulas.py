"""Random formulas: read or refused with one clear error, and worth what an evaluation of our own says."""

import ast
import math
import re
from pathlib import Path

import numpy as np

from drills.harness import Answers, Case, Complaint, Sweep, crashed, unclear

_CLEAR = "ends in a clear error or a program"
_READ = "what the grammar allows is read"
_VALUE = "a program has the value of an independent evaluation"

POINTS = {
    "v": (-1.3, 0.7, 0.0),
    "x": (0.41, -0.2, 0.6),
    "w": (62.8, -3.0, 1.0),
    "theta": (0.3, 2.9, -7.1),
    "t": (0.0, 0.013, 2.5),
}
"""Where formulas are evaluated."""

_NOISE = 2.0**-50
_NOISY = 8  # evaluations in which every operation is a little off: their spread is what rounding may do
_FUNCTIONS = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sgn": np.sign,
}
_OPERATIONS = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
_EXCUSES = ("not a finite number", "divides by 0", "characters, more than", "numbers at once", "nested more than")


def prepare() -> None:
    """Load and compile the evaluator."""
    from jointgap.dynamics.equations import evaluate
    from jointgap.formula import compile_formula

    program = compile_formula("v", {})
    evaluate(program.codes, program.numbers, 1.0, 1.0, 1.0, 1.0, 1.0)


class _Author:
    """Writes a formula twice: in the package's grammar, and in Python's."""

    def __init__(self, random: np.random.Generator):
        self.random, self.coefficients = random, {}

    def one_of(self, choices):
        return choices[int(self.random.integers(len(choices)))]

    def sum(self, depth: int) -> tuple[str, str]:
        return self.chain(self.product, depth, "+-")

    def product(self, depth: int) -> tuple[str, str]:
        return self.chain(self.sign, depth, "*/")

    def chain(self, part, depth: int, signs: str) -> tuple[str, str]:
        ours, python = part(depth)
        while self.random.random() < 0.35:
            sign, (more, again) = self.one_of(signs), part(depth)
            space = self.one_of(["", " "])
            ours, python = f"{ours}{space}{sign}{space}{more}", f"{python} {sign} {again}"
        return ours, python

    def sign(self, depth: int) -> tuple[str, str]:
        if self.random.random() < 0.15:
            sign, (ours, python) = self.one_of("+-"), self.sign(depth)
            return sign + ours, sign + python
        return self.power(depth)

    def power(self, depth: int) -> tuple[str, str]:
        ours, python = self.atom(depth)
        if self.random.random() < 0.15:
            more, again = self.sign(depth - 1) if self.random.random() < 0.5 else ("2", "2")
            return f"{ours}{self.one_of(['^', '**', ' ^ '])}{more}", f"{python} ** {again}"
        return ours, python

    def atom(self, depth: int) -> tuple[str, str]:
        choice = self.random.random() if depth > 0 else 0.0
        if choice < 0.35:
            name = self.one_of([*POINTS, *POINTS, "pi", "a", "b", "k_1"])
            if name in ("a", "b", "k_1"):
                self.coefficients[name] = float(f"{self.random.normal() * 10.0 ** self.random.integers(-3, 4):.6g}")
            return name, name
        if choice < 0.55:
            number = self.one_of(
                [
                    "0",
                    "1",
                    "2",
                    "0.5",
                    "3.",
                    ".25",
                    "1e3",
                    "2.5E-2",
                    "7",
                    f"{self.random.random():.5f}",
                    "1e-300",
                    "1e300",
                ]
            )
            return number, number
        inner, again = self.sum(depth - 1)
        if choice < 0.7:
            return f"({inner})", f"({again})"
        if choice < 0.8:
            return f"|{inner}|", f"abs({again})"
        name = self.one_of(list(_FUNCTIONS))
        return f"{name}{self.one_of(['', ' '])}({inner})", f"{name}({again})"


_JUNK = [
    *"+-*/^()|.,;:=<>!?@#$%&_~\\'\"[]{} \t\n\0", "**", "//", "^^", "||", "e", "E", "1e", "1e999", "0x10", "1_000",
    "j", "1j", "nan", "inf", "v", "vv", "import os", "__import__('os')", "lambda", "π", "θ", "×", "·", "−", "²", "٣",
    "１", "\u202e", "😀", "abs", "sin", "max(", "if", "2v", ")(", "9^9^9^9", "exp(exp(exp(9)))", "1/0", "log(0)",
    "0^-1", "sqrt(-1)",
]  # fmt: skip


def make(random: np.random.Generator) -> Case:
    """A formula with its coefficients; two in five are damaged, some are deep or long."""
    author = _Author(random)
    ours, python = author.sum(int(random.integers(0, 6)))
    kind = random.random()
    if kind < 0.05:
        depth, (opened, closed) = (
            int(random.integers(2, 80)),
            author.one_of([("(", ")"), ("-", ""), ("sin(", ")"), ("2^", ""), ("1-(v*", ")")]),
        )
        ours, python = opened * depth + ours + closed * depth, None
    elif kind < 0.07:
        ours, python = author.one_of(["+", "*", "|", "("]).join([ours] * int(random.integers(2, 200))), None
    elif kind < 0.4:
        for _ in range(int(random.integers(1, 4))):
            at = int(random.integers(len(ours) + 1))
            ours = ours[:at] + author.one_of([*_JUNK, ""]) + ours[at + int(random.integers(0, 2)) :]
        python = None
    coefficients = dict(author.coefficients)
    if random.random() < 0.03:
        coefficients[author.one_of(["spare", "v", "sin", "a b", "", "1", "é", "x\n"])] = author.one_of(
            [1.0, 0.0, 1e308]
        )
    return {"formula": ours, "python": python, "coefficients": coefficients}


def judge(case: Case, folder: Path) -> Answers:
    """Read a formula, evaluate it, and hold the value against that of Python's own syntax tree."""
    from jointgap.core.errors import InputError
    from jointgap.dynamics.equations import evaluate
    from jointgap.formula import compile_formula

    text, coefficients = case["formula"], case["coefficients"]
    python = case["python"] or _as_python(text)
    try:
        program = compile_formula(text, coefficients)
    except InputError as error:
        return {_CLEAR: unclear(str(error), "'" if "coefficient" in str(error) else "formula")} | _refused(
            case, str(error)
        )
    except Exception as error:
        return {_CLEAR: crashed(error)}
    answers: Answers = {_CLEAR: None}
    if case["python"]:
        answers[_READ] = None
    if python is not None:
        ours = np.array(
            [evaluate(program.codes, program.numbers, *map(float, at)) for at in zip(*POINTS.values(), strict=True)]
        )
        answers[_VALUE] = _other_value(ours, python, coefficients)
    return answers


def _refused(case: Case, message: str) -> Answers:
    """Whether a formula that the grammar allows was refused without a reason."""
    used = set(re.findall(r"[^\W\d]\w*", case["python"] or "")) - {*POINTS, *_FUNCTIONS}
    if case["python"] is None or not case["coefficients"].keys() <= used:
        return {}
    if any(excuse in message for excuse in _EXCUSES):
        return {_READ: None}
    return {_READ: Complaint("a formula of the grammar is refused", f"{case['formula']!r}: {message[:300]}")}


def _as_python(text: str) -> str | None:
    """A formula without bars in Python's syntax; None of one with bars, which Python takes for something else."""
    if "|" in text:
        return None
    return re.sub(r"(?<![\w.])0+(?=\d)", "", text.strip().replace("^", "**").replace("\n", " "))


def _other_value(ours: np.ndarray, python: str, coefficients: dict[str, float]) -> Complaint | None:
    """Whether values differ by more than rounding, of (n,) values `ours` and those of a formula in `python`."""
    random = np.random.default_rng(0)
    noise = np.hstack([np.zeros((ours.size, 1)), np.full((ours.size, _NOISY), _NOISE)])
    names = {name: np.array(values, float)[:, None] for name, values in POINTS.items()}
    names |= {"pi": np.float64(math.pi)} | {name: np.float64(value) for name, value in coefficients.items()}
    try:
        tree = ast.parse(python, mode="eval").body
        with np.errstate(all="ignore"):
            theirs = np.broadcast_to(
                value_of(tree, names, lambda: 1.0 + noise * random.uniform(-1, 1, noise.shape)), noise.shape
            )
            exact, spread = theirs[:, 0], np.max(np.abs(theirs[:, 1:] - theirs[:, :1]), axis=1)
            spread = np.where(np.isfinite(theirs).all(axis=1), spread, np.inf)
            near = np.abs(ours - exact) <= 30.0 * spread + 1e-13 * np.abs(exact) + 1e-300
            sure = np.isnan(theirs).all(axis=1) | (theirs == theirs[:, :1]).all(axis=1)  # noise changes nothing
            torn = ~np.isfinite(theirs).all(axis=1) & ~sure  # it is noise that tells whether there is a number at all
    except (SyntaxError, ValueError, KeyError, RecursionError) as error:
        return Complaint("what Python cannot read is accepted", f"{python!r}: {error}")
    # where powers are beyond all numbers, rounding tells an infinity from what is not a number
    alike = near | torn | (ours == exact) | (~np.isfinite(ours) & ~np.isfinite(exact))
    if alike.all():
        return None
    at = int(np.flatnonzero(~alike)[0])
    return Complaint("a formula has another value", f"{python!r}: {ours[at]!r}, not {exact[at]!r}")


def value_of(tree: ast.expr, names: dict, noise) -> np.ndarray:
    """Value of a Python expression; every operation is multiplied by `noise()`.

    Raises
    ------
    KeyError, ValueError
        A name or a part of Python that formulas do not have.
    """
    if isinstance(tree, ast.Constant) and type(tree.value) in (int, float):
        return np.float64(tree.value)
    if isinstance(tree, ast.Name):
        return names[tree.id]
    if isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.USub | ast.UAdd):
        value = value_of(tree.operand, names, noise)
        return -value if isinstance(tree.op, ast.USub) else value
    if isinstance(tree, ast.BinOp):
        operands = value_of(tree.left, names, noise), value_of(tree.right, names, noise)
        return _OPERATIONS[type(tree.op)](*operands) * noise()
    if isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name) and len(tree.args) == 1 and not tree.keywords:
        return _FUNCTIONS[tree.func.id](value_of(tree.args[0], names, noise)) * noise()
    raise ValueError(f"{ast.dump(tree)[:100]} is no part of a formula")


SWEEP = Sweep("formulas", 100_000, make, judge, prepare, limit_s=10.0)
DRILL = SWEEP.drill()
