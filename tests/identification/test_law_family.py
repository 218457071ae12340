"""Intervals of the shape of a law family."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import LawFamily
from jointgap.identification import decide as decision_of_fits
from jointgap.identification import law_family
from jointgap.identification.decide import decide
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.law_family import (
    FamilyInterval,
    ShapeProfile,
    fit_shape,
    profile_shape,
    shape_interval,
    with_families,
)
from jointgap.identification.likelihood import fitted
from jointgap.identification.problem import Problem
from jointgap.identification.verdict import Decision
from tests.identification.oscillator import SPRING, linear
from tests.identification.toy import (
    FALLING_SPEED,
    RINGING,
    Toy,
    analysed,
    candidate_of,
    searched,
    stated_noise,
    toy,
)

pytestmark = pytest.mark.integration

QUADRATIC = candidate_of("quadratic")
(DRAG,) = QUADRATIC.families
RISE, RISE_90 = 6.635, 2.706  # 99 % and 90 % quantile of chi2 with one degree of freedom
ONE = {"quadratic": {"drag_N_s2_m2": 1.0}}


def drag(size: float, exponent: float):
    return lambda x, v, angle, time: -size * np.abs(v) ** exponent * np.sign(v)


def fitted_to(model: Toy, *labels: str):
    """The fit of these effects."""
    return fit_hypothesis(
        Problem(model, stated_noise(model)), tuple(map(candidate_of, labels)), refresh=True
    )


def profile(model: Toy) -> ShapeProfile:
    problem = Problem(model, stated_noise(model))
    found = fit_hypothesis(problem, (QUADRATIC,))
    return profile_shape(problem, fit_shape(problem, found, QUADRATIC, DRAG), DRAG)


def asked(model: Toy) -> tuple[Decision, tuple[FamilyInterval, ...]]:
    """The decision after the search, with its families."""
    base, sensitivities, limits = analysed(model)
    decision = decide(searched(base, sensitivities, limits))
    return with_families(base, decision, limits)


def decided(model: Toy, verdict: str, *fits) -> tuple[Decision, tuple[FamilyInterval, ...]]:
    """The decision for the first of the fits, or for all of them as equivalent."""
    base, _, limits = analysed(model)
    equal = list(fits) if verdict == "ambiguous" else []
    return with_families(
        base, Decision(verdict, base.base if equal else fits[0], base.base, equal), limits
    )


def outcome(decision):
    return decision.verdict, decision.chosen.label


# The interval of a shape


def test_the_interval_of_the_exponent_covers_the_truth():
    for exponent in (0.6, 2.0, 5.0):
        low, high = profile(toy(hidden=drag(2.0, exponent), seed=3)).interval(RISE)
        assert low <= exponent <= high < low + 1.0
    profiles = [profile(toy(hidden=drag(0.1, 3.0), seed=seed)) for seed in range(50)]
    for rise, lowest, most in ((RISE_90, 37, 50), (RISE, 46, 50)):  # 99.9 % range of 50 draws
        ends = [one.interval(rise) for one in profiles]
        assert lowest <= sum(low <= 3.0 <= high for low, high in ends) <= most


def test_with_loose_joints_each_shape_starts_from_the_states_of_the_last():
    problem = linear(hidden={"spring": {"size": 0.3, "damping": 0.1}}, candidates=(SPRING,))
    problem.model.simulate = None
    found = fitted(problem, (SPRING,), {"spring.size": 0.3, "spring.damping": 0.0})
    problem.model.filtered.clear()
    profile = profile_shape(problem, found, LawFamily(SPRING, "damping", 0.0, (0.0, 0.3), dict))
    assert problem.model.filtered == []
    error = float(np.sqrt(found.covariance()[-1, -1]))
    ends = found.mapping["spring.damping"] + np.sqrt(RISE) * error * np.array([-1.0, 1.0])
    assert profile.interval(RISE) == pytest.approx(ends, abs=0.2 * error)


# Laws of a family


@pytest.mark.parametrize(
    "size, is_linear, alone",
    [(1.0, True, True), (0.03, True, True), (0.018, False, True), (0.012, False, False)],
)
def test_a_shape_interval_is_linear_or_profiled(size, is_linear, alone, monkeypatch):
    """Both agree. If the interval excludes the other shapes the law is named, else its family."""
    model = toy({"quadratic": {"drag_N_s2_m2": size}}, seed=3, candidates=["quadratic"])
    profiled = []

    def recorded(*args):
        profiled.append(profile_shape(*args))
        return profiled[-1]

    monkeypatch.setattr(law_family, "profile_shape", recorded)
    decision, (family,) = asked(model)
    assert outcome(decision) == ("named", "quadratic")
    assert (profiled == [], family.fits, family.alone) == (is_linear, True, alone)
    low, high = shape_interval(profile(model), DRAG, 0.99)
    assert (family.low, family.high) == pytest.approx((low, high), abs=0.06 * (high - low))
    assert alone == (1.0 < low < 2.0 < high < 3.0)


@pytest.mark.parametrize("size, exponent", [(0.05, 3.0), (0.3, 5.0)])
def test_an_unlisted_law_is_named_as_its_family(size, exponent):
    decision, (family,) = asked(toy(hidden=drag(size, exponent), seed=5))
    assert outcome(decision) == ("named", "power_drag")
    assert not family.fits and not family.alone and family.low <= exponent <= family.high
    assert decision.chosen.mapping["power_drag.exponent"] == family.value
    assert decision.ranking[0].fit is decision.chosen


def test_a_family_with_its_size_at_a_bound_is_not_named(monkeypatch):
    model = toy(hidden=drag(0.05, 3.0), seed=5)

    def up_to_its_bound(*args):
        fit = fit_shape(*args)
        ends = {"power_drag.force_N": fit.mapping["power_drag.force_N"]}
        return replace(
            fit, parameters=tuple(replace(p, high=ends.get(p.key, p.high)) for p in fit.parameters)
        )

    monkeypatch.setattr(law_family, "fit_shape", up_to_its_bound)
    decision, families = decided(model, "named", fitted_to(model, "quadratic"))
    assert decision.verdict == "unexplained"
    assert families == ()
    assert decision.best_known.hypothesis[0].label == "power_drag"
    assert "bound of force_N" in decision.because and decision.chosen is decision.base


@pytest.mark.parametrize(
    "verdict, labels",
    [
        ("named", ("quadratic", "sensor_bias:torque")),  # which took up a wrong exponent
        ("named_with_remaining_misfit", ("spring", "quadratic")),
    ],
)
def test_a_family_replaces_an_explanation_without_its_law(verdict, labels):
    model = toy(hidden=drag(2.0, 3.0), seed=5)
    decision, (family,) = decided(model, verdict, fitted_to(model, *labels))
    assert outcome(decision) == ("named", "power_drag")
    assert family.low <= 3.0 <= family.high


def test_an_effect_of_two_families_gets_an_interval_in_each():
    decision, families = asked(toy({"coulomb": {"force_N": 3.0}}, seed=3))
    assert outcome(decision) == ("named", "coulomb")
    assert [family.law for family in families] == ["power_drag", "falling_friction"]
    assert all(
        family.fits and family.alone and family.low <= 0.0 <= family.high for family in families
    )


def test_a_law_of_one_of_two_families_replaces_the_common_effect():
    def hidden(x, v, angle, time):
        return -3.0 * (0.6 + 0.4 * np.exp(-np.abs(v) / FALLING_SPEED)) * np.tanh(v / 0.01)

    decision, (family,) = asked(toy(hidden=hidden, seed=3))
    assert outcome(decision) == ("named", "falling_friction")
    assert 0.0 < family.low <= 0.4 <= family.high < 1.0


def test_equivalent_laws_of_one_family_are_named_as_the_family(monkeypatch):
    model = toy(ONE, seed=3)
    quadratic, viscous, spring = (
        fitted_to(model, label) for label in ("quadratic", "viscous", "spring")
    )
    decision, (family,) = decided(model, "ambiguous", quadratic, viscous)
    assert (*outcome(decision), decision.equivalent) == ("named", "quadratic", [])
    assert family.low <= 1.0 and family.high >= 2.0 and not family.alone
    decision, families = decided(model, "ambiguous", quadratic, spring)
    assert (decision.verdict, families) == ("ambiguous", ())
    # a motion that cannot be simulated
    monkeypatch.setattr(law_family, "profile_shape", lambda *of: None)
    decision, families = decided(model, "ambiguous", quadratic, viscous)
    assert (decision.verdict, families) == ("ambiguous", ())


# Nothing asked


def test_families_are_not_fitted_without_a_named_effect(monkeypatch):
    stated = []
    monkeypatch.setattr(
        decision_of_fits,
        "with_intervals",
        lambda problem, fit, *rest: stated.append(fit.label) or fit,
    )
    for model, verdict in (
        (toy(nuisances={"slider_mass": 0.515}, seed=4), "parameters_only"),
        (
            toy(hidden=lambda x, v, angle, time: 2.0 * np.sign(np.sin(3.0 * angle)), seed=3),
            "unexplained",
        ),
    ):
        stated.clear()
        decision, families = asked(model)
        assert (decision.verdict, families) == (verdict, ())
        assert ("base" in stated) == (verdict == "parameters_only")


def test_families_are_not_fitted_with_a_nonsmooth_effect():
    model = toy(ONE, seed=3)
    found = fitted_to(model, "quadratic")
    decision, families = decided(
        model, "named", replace(found, hypothesis=(*found.hypothesis, RINGING))
    )
    assert (*outcome(decision), families) == ("named", "quadratic + ringing", ())
