"""Unlisted force laws are found as formulas."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.force_law import find_force_law, law_of, term_of
from jointgap.identification.problem import Problem
from jointgap.identification.verdict import Thresholds
from tests.identification.toy import Toy, candidate_of, stated_noise, toy

TERMS = {
    "1": lambda x, v, angle: np.ones_like(x),
    "v": lambda x, v, angle: v,
    "tanh(v/0.01)": lambda x, v, angle: np.tanh(v / 0.01),
    "|v|": lambda x, v, angle: np.abs(v),
    "v*|v|": lambda x, v, angle: v * np.abs(v),
    "v^3": lambda x, v, angle: v**3,
    "x": lambda x, v, angle: x,
    "x^3": lambda x, v, angle: x**3,
    "x*v": lambda x, v, angle: x * v,
    "cos(theta)": lambda x, v, angle: np.cos(angle),
    "sin(theta)": lambda x, v, angle: np.sin(angle),
}
LIMITS = Thresholds(rate=0.01, omnibus=1.1, max_gain_threshold=8.0)


def term(text: str) -> Candidate:
    coefficient = Parameter("coefficient", 0.0, step=0.1)
    return Candidate(f"discovered_slider_force[{text}]", "slider", (coefficient,), ("coefficient",))


@dataclass(frozen=True)
class WithTerms(Toy):
    """The toy with the library's terms as forces on its slide."""

    laws: dict[str, Callable] = field(default_factory=lambda: TERMS)

    def simulate(self, run, values, effects=(), numerics=0):
        found = [(self.laws[term_of(c)], at["coefficient"]) for c, at in effects if "[" in c.name]
        listed = [(c, at) for c, at in effects if "[" not in c.name]
        plain = Toy(
            *(getattr(self, name) for name in ("series", "nuisances", "candidates", "speeds"))
        )

        def hidden(x, v, angle, time):
            return sum(at * law(x, v, angle) for law, at in found)

        return replace(plain, hidden=hidden if found else None).simulate(
            run, values, listed, numerics
        )


def found(hidden, seed=1, more=None, library=TERMS, listed=()):
    """The law of a toy with a hidden force (x, v), from a library and `more` laws, with listed
    candidates."""
    laws = {**(more or {}), **TERMS}
    data = toy(hidden=lambda x, v, angle, time: hidden(x, v), seed=seed)
    candidates = tuple(map(candidate_of, listed))
    model = WithTerms(data.series, data.nuisances, candidates, data.speeds, laws=laws)
    problem = Problem(model, stated_noise(model))
    terms = tuple(map(term, [*(more or {}), *library]))
    return find_force_law(problem, fit_hypothesis(problem, refresh=True), terms, LIMITS)


def cubic(x, v):
    return -0.3 * v**3


def test_acting_terms_are_found_with_their_coefficients():

    two = (lambda x, v: -0.4 * v**3 + 2.0 * x * v), {"v^3": -0.4, "x*v": 2.0}, 1
    for hidden, truth, seed in [*((cubic, {"v^3": -0.3}, seed) for seed in (1, 2, 3)), two]:
        law = found(hidden, seed)
        assert law.accepted and not law.rivals, law.because
        assert (law.law.effect, law.law.site) == ("discovered_slider_force", "slider")
        assert {law.law.terms[name] for name in law.law.terms} == truth.keys()
        errors, keys = np.sqrt(np.diag(law.fit.covariance())), [p.key for p in law.fit.parameters]
        for name, text in law.law.terms.items():
            error = errors[keys.index(law.law.keys[name])]
            assert law.law.coefficients[name] == pytest.approx(truth[text], abs=4 * error)


def test_no_law_is_accepted_without_a_force_or_outside_the_library():
    assert "v^7" not in TERMS
    hidden = (lambda x, v: 0.0 * x), (lambda x, v: 1.5 * np.cos(70 * x)), (lambda x, v: -0.2 * v**7)
    laws = [found(each) for each in hidden]
    assert [law.accepted for law in laws] == [False] * 3
    assert "not significant" in laws[0].because and "only" in laws[2].because
    nothing = found(cubic, library=())
    assert nothing.fit is None and nothing.law is None and not nothing.accepted


def test_a_failed_term_is_reported_and_an_equal_form_is_no_rival():
    more = {"bad": lambda x, v, angle: np.full_like(x, np.nan), "v*v*v": TERMS["v^3"]}
    law = found(cubic, more=more)
    assert "discovered_slider_force[bad]" in law.failed
    assert law.accepted and not law.rivals
    assert {one.label for one in (law.fit, *law.others)} >= {
        term(text).label for text in ("v^3", "v*v*v")
    }


def test_a_formula_equal_to_a_listed_law_is_named_as_that_law():
    """A base in a wrong minimum can hide it from the search over listed effects."""
    listed = "coulomb", "viscous", "constant_force", "spring"
    for hidden, label in (
        (lambda x, v: -0.5 * np.tanh(v / 0.01), "coulomb"),
        (lambda x, v: 0.7 + 0.0 * v, "constant_force"),
        (lambda x, v: -0.5 * np.tanh(v / 0.01) - 0.4 * v, "coulomb + viscous"),
    ):
        law = found(hidden, listed=listed)
        assert law.verdict == "named"
        assert {*law.fit.label.split(" + ")} == {*label.split(" + ")}
        assert law.law is None
        assert label.partition(" ")[0] in law.reason
        size = law.fit.values[-len(law.fit.hypothesis)]
        error = np.sqrt(np.diag(law.fit.covariance()))
        assert size == pytest.approx(
            0.7 if label == "constant_force" else 0.5, abs=4 * error[-len(law.fit.hypothesis)]
        )
    assert found(cubic, listed=listed).law.terms == {"c1": "v^3"}


def test_a_law_is_written_as_formula_and_text():
    for terms, values, formula, words in (
        (("v^3", "x*v"), (-3.21, 40.0), "c1*v^3 + c2*x*v", "slider force = -3.21*v^3 + 40*x*v"),
        (("1", "x"), (2.0, -5.0), "c1 + c2*x", "slider force = 2 - 5*x"),
    ):
        pair = tuple(map(term, terms))
        keys = [f"{law.label}.coefficient" for law in pair]
        law = law_of(pair, dict(zip(keys, values, strict=True)))
        assert (law.formula, law.words) == (formula, words)
        assert law.coefficients == dict(zip(("c1", "c2"), values, strict=True))
