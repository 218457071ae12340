"""Formulas: usual rules, and the values of numpy."""

import math
import re

import numpy as np
import pytest

from jointgap.core.errors import InputError
from jointgap.core.formula import NOTHING, VARIABLES, compile_formula
from jointgap.linkage.laws import evaluate

AT = {"v": -1.3, "x": 0.6, "w": 62.8, "theta": 2.1, "t": 0.05}
FUNCTIONS = ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt", "abs")
NUMPY = {name: getattr(np, name) for name in FUNCTIONS} | {"sgn": np.sign, "pi": np.pi}


def value(text: str, at=AT, **coefficients: float) -> float:
    program = compile_formula(text, coefficients)
    return evaluate(program.codes, program.numbers, *(at[name] for name in VARIABLES))


RULES = {
    **{".5e1": 5, "-v^2": -1.69, "(-v)**2": 1.69, "2^3^2": 512, "2^-1": 0.5, "1 - 2 - 3": -4},
    **{"8 / 4 / 2": 1, "2 + 3*4": 14, "- -v": -1.3, "2*-v": 2.6, "v*|v|": -1.69, "|v|*|x|": 0.78},
    **{"|v*|v - 1||": 2.99, "||v||": 1.3, "|-|v||": 1.3, "sgn(v)": -1, "sgn(v - v)": 0},
    **{"sqrt(|v|)^2": 1.3, "2*pi": 2 * math.pi, "sin(theta)": math.sin(2.1), "x^1.5": 0.6**1.5},
}


@pytest.mark.parametrize("text, expected", RULES.items())
def test_the_usual_rules_hold(text, expected):
    assert value(text) == pytest.approx(expected, rel=1e-14)


def test_constant_parts_are_computed_once_and_no_formula_is_zero():
    assert evaluate(NOTHING.codes, NOTHING.numbers, 1.0, 2.0, 3.0, 4.0, 5.0) == 0.0
    assert len(compile_formula("2*pi*a*v", {"a": 3.0}).codes) == 3


@pytest.mark.parametrize(
    "text",
    [
        "-(cos(theta - x^2)) + tan(t)/(2 + sin(w))",
        "a*exp(-abs(v)) - (1 + abs(x))^-1*theta",
        "log(1.5 + (v*w - t)^2)^0.5 - tanh(x*theta)^3",
        "sgn(x - a)*sqrt(abs(w)) - 2^-x^2/pi",
        "(v - w)*(x - (theta - (t - a)))/(2 + cos(v)) - -abs(v*-w)",
    ],
)
def test_formulas_give_the_values_of_numpy(text):
    random = np.random.default_rng(2009)
    coefficients = {"a": 0.7} if "a" in re.findall(r"\w+", text) else {}
    for _ in range(50):
        at = {name: float(random.uniform(-2, 2)) for name in VARIABLES}
        expected = eval(text.replace("^", "**"), NUMPY | at | {"a": 0.7})
        assert value(text, at, **coefficients) == pytest.approx(expected, rel=1e-11, abs=1e-11)


def test_an_undefined_value_is_not_a_number():
    assert math.isnan(value("sqrt(v)")) and math.isnan(value("sgn(log(v))"))
    assert math.isinf(value("1/(v - v)"))


UNREADABLE = {
    "-a*vel": "unknown name 'vel'.*known here: a, abs.*theta",
    "sni(v)": "unknown name 'sni'.*did you mean 'sin'",
    "   ": "empty",
    **dict.fromkeys(("2 v", "2 +", "(v", "|v", "v)", "(v|", "sin v"), "cannot be read"),
    "sin + v": r"'sin' is a function; write sin\(...\)",
    **dict.fromkeys(("v or x", "v if x else w", "v(x)", "True"), "is not supported"),
    **dict.fromkeys(("v # x", "v; import os", "v.real"), "the next character is invalid"),
    **dict.fromkeys(("1/0", "v/(1 - 1)"), "divides by 0"),
    **dict.fromkeys(("log(-1)", "exp(1e6)", "1e999"), "not a finite number"),
    "v*" * 600 + "v": "1201 characters.*more than 1000",
    "(" * 300 + "v" + ")" * 300: "nest it less",
    "v+(" * 17 + "v" + ")" * 17: "a stack of 18 numbers, more than 16",
}


@pytest.mark.parametrize("text, words", UNREADABLE.items())
def test_an_unreadable_formula_is_an_error(text, words):
    with pytest.raises(InputError, match=words):
        compile_formula(text, {"a": 1.0} if "a*" in text else {})


def test_coefficients_need_a_free_name_and_a_place_in_the_formula():
    for name in ("v", "theta", "sin", "pi", "two words", "1st", "|a|"):
        with pytest.raises(InputError, match="is a reserved or invalid name"):
            compile_formula("v", {name: 1.0})
    with pytest.raises(InputError, match="does not use the coefficient 'b'"):
        compile_formula("a*v", {"a": 1.0, "b": 2.0})


def test_depth_and_length_are_limited_by_the_stack_and_the_longest_text():
    assert value("v+(" * 15 + "v" + ")" * 15) == pytest.approx(16 * -1.3)
    for sign, terms in (("+", 500), ("-", -498)):
        assert value(sign.join(["v"] * 500)) == pytest.approx(-1.3 * terms)
