"""A force law that is on nobody's list is found as a formula, or nothing is claimed."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.force_law import find_force_law, law_of, term_of
from jointgap.identification.problem import Problem
from jointgap.identification.verdict import Thresholds
from tests.identification.toy import Toy, stated_noise, toy

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


LIBRARY = tuple(term(text) for text in TERMS)


@dataclass(frozen=True)
class WithTerms(Toy):
    """The toy with the library's terms as forces on its slide."""

    laws: dict[str, Callable] = field(default_factory=lambda: TERMS)

    def simulate(self, run, values, effects=(), numerics=0):
        found = [(self.laws[term_of(c)], at["coefficient"]) for c, at in effects]
        plain = Toy(*(getattr(self, name) for name in ("series", "nuisances", "candidates", "speeds")))

        def hidden(x, v, angle, time):
            return sum(at * law(x, v, angle) for law, at in found)

        return replace(plain, hidden=hidden if found else None).simulate(run, values, (), numerics)


def measured(hidden, seed=1, **changed):
    """Problem and fitted base of a toy in which the force `hidden` (x, v, angle) acts."""
    data = toy(hidden=lambda x, v, angle, time: hidden(x, v, angle), seed=seed, **changed)
    model = WithTerms(data.series, data.nuisances, data.candidates, data.speeds)
    problem = Problem(model, stated_noise(model))
    return problem, fit_hypothesis(problem, refresh=True)


def coefficient_errors(found) -> dict[str, float]:
    covariance = found.fit.covariance()
    keys = [p.key for p in found.fit.parameters]
    return {name: covariance[keys.index(key), keys.index(key)] ** 0.5 for name, key in found.law.keys.items()}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_cubic_resistance_is_found_and_told_from_a_quadratic_one(seed):
    problem, base = measured(lambda x, v, angle: -0.3 * v**3, seed)
    found = find_force_law(problem, base, LIBRARY, LIMITS)
    assert found.accepted, found.because
    assert (found.law.effect, found.law.site, found.law.formula) == ("discovered_slider_force", "slider", "c1*v^3")
    assert found.law.coefficients["c1"] == pytest.approx(-0.3, abs=4 * coefficient_errors(found)["c1"])
    assert not found.rivals


def test_two_terms_are_found_where_two_act():
    problem, base = measured(lambda x, v, angle: -0.4 * v**3 + 2.0 * x * v)
    found = find_force_law(problem, base, LIBRARY, LIMITS)
    assert found.accepted, found.because
    assert {term_of(c) for c in found.fit.hypothesis} == {"v^3", "x*v"}
    truth = {"v^3": -0.4, "x*v": 2.0}
    errors = coefficient_errors(found)
    for name, text in found.law.terms.items():
        assert found.law.coefficients[name] == pytest.approx(truth[text], abs=4 * errors[name])


def test_where_nothing_is_hidden_no_law_is_accepted():
    problem, base = measured(lambda x, v, angle: 0.0 * x)
    found = find_force_law(problem, base, LIBRARY, LIMITS)
    assert not found.accepted
    assert "not significant" in found.because


def test_a_force_that_no_sum_of_two_terms_comes_near_is_not_put_into_a_formula():
    problem, base = measured(lambda x, v, angle: 1.5 * np.cos(7 * angle))
    found = find_force_law(problem, base, LIBRARY, LIMITS)
    assert not found.accepted
    assert "only" in found.because or "not significant" in found.because


def test_a_law_that_only_comes_near_is_not_accepted():
    problem, base = measured(lambda x, v, angle: -0.2 * v**7)
    assert "v^7" not in TERMS
    found = find_force_law(problem, base, LIBRARY, LIMITS)
    assert not found.accepted
    assert "only" in found.because


def test_a_term_that_cannot_be_simulated_is_reported_and_the_others_go_on():
    problem, base = measured(lambda x, v, angle: -0.3 * v**3)
    laws = {**TERMS, "bad": lambda x, v, angle: np.full_like(x, np.nan)}
    problem = Problem(replace(problem.model, laws=laws), stated_noise(problem.model))
    found = find_force_law(problem, base, (term("bad"), *LIBRARY), LIMITS)
    assert "discovered_slider_force[bad]" in found.failed
    assert found.law.formula == "c1*v^3"


def test_without_any_term_that_can_be_simulated_there_is_no_law():
    problem, base = measured(lambda x, v, angle: -0.3 * v**3)
    found = find_force_law(problem, base, (), LIMITS)
    assert found.fit is None and found.law is None and not found.accepted


def test_a_law_reads_as_a_formula_and_in_words():
    pair = (term("v^3"), term("x*v"))
    values = {f"{pair[0].label}.coefficient": -3.21, f"{pair[1].label}.coefficient": 40.0}
    law = law_of(pair, values)
    assert law.formula == "c1*v^3 + c2*x*v"
    assert law.words == "slider force = -3.21*v^3 + 40*x*v"
    assert law.coefficients == {"c1": -3.21, "c2": 40.0}


def test_a_steady_force_and_a_falling_term_read_as_people_write_them():
    pair = (term("1"), term("x"))
    law = law_of(pair, {f"{pair[0].label}.coefficient": 2.0, f"{pair[1].label}.coefficient": -5.0})
    assert law.formula == "c1 + c2*x"
    assert law.words == "slider force = 2 - 5*x"


def test_the_same_force_in_another_form_is_no_rival():
    problem, base = measured(lambda x, v, angle: -0.3 * v**3)
    laws = {**TERMS, "v*v*v": TERMS["v^3"]}
    problem = Problem(replace(problem.model, laws=laws), stated_noise(problem.model))
    found = find_force_law(problem, base, (*LIBRARY, term("v*v*v")), LIMITS)
    assert found.accepted and not found.rivals
    assert {one.label for one in (found.fit, *found.others)} >= {term(text).label for text in ("v^3", "v*v*v")}
