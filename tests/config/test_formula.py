"""Formulas in field terms are read by the usual rules, and their programs give what numpy gives."""

import math
import re

import numpy as np
import pytest

from jointgap.core.errors import InputError
from jointgap.core.formula import NOTHING, VARIABLES, compile_formula
from jointgap.dynamics.equations import evaluate
from tests.catalogue import each, refused

AT = {"v": -1.3, "x": 0.6, "w": 62.8, "theta": 2.1, "t": 0.05}
NUMPY = {
    name: getattr(np, name) for name in ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt", "abs")
}
NUMPY |= {"sgn": np.sign, "pi": np.pi}


def value(text: str, at=AT, **coefficients: float) -> float:
    program = compile_formula(text, coefficients)
    return evaluate(program.codes, program.numbers, *(at[name] for name in VARIABLES))


RULES = {
    "2": 2,
    ".5e1": 5,
    "-v^2": -1.69,
    "(-v)**2": 1.69,
    "2^3^2": 512,
    "2^-1": 0.5,
    "1 - 2 - 3": -4,
    "8 / 4 / 2": 1,
}
RULES |= {
    "2 + 3*4": 14,
    "- -v": -1.3,
    "2*-v": 2.6,
    "v*|v|": -1.69,
    "|v|*|x|": 0.78,
    "|v*|v - 1||": 2.99,
    "||v||": 1.3,
}
RULES |= {
    "|-|v||": 1.3,
    "sgn(v)": -1,
    "sgn(x)": 1,
    "sgn(v - v)": 0,
    "sqrt(|v|)^2": 1.3,
    "2*pi": 2 * math.pi,
}
RULES |= {"sin(theta)": math.sin(2.1), "tanh(v/0.01)": -1, "x^1.5": 0.6**1.5, "w*t": 3.14}


def test_the_usual_rules_hold():
    def holds(text, expected):
        assert value(text) == pytest.approx(expected, rel=1e-14)

    each(holds, RULES.items())
    both = value("-a*v*|v| + b_1*sin(theta)", a=1.2, b_1=3.0)
    assert both == pytest.approx(1.2 * 1.69 + 3 * math.sin(2.1), rel=1e-14)
    assert evaluate(NOTHING.codes, NOTHING.numbers, 1.0, 2.0, 3.0, 4.0, 5.0) == 0.0
    assert (
        len(compile_formula("2*pi*a*v", {"a": 3.0}).codes) == 3
    )  # parts without variables are computed once


FORMULAS = """
-(cos(theta - x^2)) + tan(t)/(2 + sin(w))
a*exp(-abs(v)) - (1 + abs(x))^-1*theta
log(1.5 + (v*w - t)^2)^0.5 - tanh(x*theta)^3
sgn(x - a)*sqrt(abs(w)) - 2^-x^2/pi
(v - w)*(x - (theta - (t - a)))/(2 + cos(v)) - -abs(v*-w)
"""


def test_formulas_give_what_numpy_gives():
    random = np.random.default_rng(2009)

    def as_numpy(text):
        for _ in range(50):
            at = {name: float(random.uniform(-2, 2)) for name in VARIABLES}
            expected = eval(text.replace("^", "**"), NUMPY | at | {"a": 0.7})
            coefficients = {"a": 0.7} if "a" in re.findall(r"\w+", text) else {}
            assert value(text, at, **coefficients) == pytest.approx(expected, rel=1e-11, abs=1e-11)

    each(as_numpy, FORMULAS.strip().splitlines())


def test_what_is_not_defined_is_not_a_number():
    assert math.isnan(value("sqrt(v)")) and math.isnan(value("sgn(log(v))"))
    assert math.isinf(value("1/(v - v)"))


UNREADABLE = [
    ("-a*vel", "unknown name 'vel' ~ known here: a, abs ~ theta"),
    ("sni(v)", "unknown name 'sni' ~ did you mean 'sin'"),
    ("", "empty"),
    ("   ", "empty"),
    *(
        (text, "cannot be read; write every operation")
        for text in ("2 v", "2 +", "(v", "|v", "v)", "(v|", "|v)")
    ),
    ("sin v", "cannot be read"),
    ("sin + v", "'sin' is a function; write sin(...)"),
    *((text, "is not supported") for text in ("v or x", "v if x else w", "v(x)")),
    *((text, "the next character is invalid") for text in ("v # x", "v; import os", "v.real")),
    ("True", "is not supported"),
    *((text, "divides by 0") for text in ("1/0", "v/(1 - 1)")),
    *((text, "not a finite number") for text in ("log(-1)", "exp(1e6)", "1e999")),
    ("v*" * 600 + "v", "1201 characters ~ more than 1000"),
    ("(" * 300 + "v" + ")" * 300, "nest it less"),
    ("v+(" * 17 + "v" + ")" * 17, "a stack of 18 numbers, more than 16"),
]


def test_a_formula_that_cannot_be_read_is_refused_with_its_place_and_the_mend():
    refused(lambda text: compile_formula(text, {"a": 1.0} if "a*" in text else {}), UNREADABLE)
    taken = [
        (name, "is a reserved or invalid name")
        for name in ("v", "theta", "sin", "pi", "two words", "1st", "|a|")
    ]
    refused(lambda name: compile_formula("v", {name: 1.0}), taken)
    with pytest.raises(InputError, match="does not use the coefficient 'b'"):
        compile_formula("a*v", {"a": 1.0, "b": 2.0})


def test_formulas_may_be_as_deep_as_the_stack_and_have_as_many_terms_as_their_length_allows():
    assert value("v+(" * 15 + "v" + ")" * 15) == pytest.approx(16 * -1.3)
    for sign, terms in (("+", 500), ("-", -498)):
        assert value(sign.join(["v"] * 500)) == pytest.approx(-1.3 * terms)
