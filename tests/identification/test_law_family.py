"""Of a law that was found, the data say which shapes of its family they allow."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.core.candidates import LawFamily
from jointgap.identification import law_family, model_selection
from jointgap.identification.fit import effect_estimates, fit_hypothesis
from jointgap.identification.law_family import (
    FamilyInterval,
    ShapeProfile,
    fit_shape,
    profile_shape,
    shape_interval,
    with_families,
)
from jointgap.identification.likelihood import fitted
from jointgap.identification.model_selection import select_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.settings import DEFAULT_SETTINGS
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
    fits = searched(base, sensitivities, limits)
    return with_families(base, select_hypothesis(base, sensitivities, fits, limits), limits)


def decided(model: Toy, verdict: str, *fits) -> tuple[Decision, tuple[FamilyInterval, ...]]:
    """The same after a decision for the first of the `fits`, or for all of them."""
    base, _, limits = analysed(model)
    equal = list(fits) if verdict == "ambiguous" else []
    return with_families(
        base, Decision(verdict, base.base if equal else fits[0], base.base, equal), limits
    )


def outcome(decision):
    return decision.verdict, decision.chosen.label


# The interval of a shape


def test_the_interval_holds_the_exponent_that_the_data_were_made_with_as_often_as_it_says():
    for exponent in (0.6, 2.0, 5.0):
        low, high = profile(toy(hidden=drag(2.0, exponent), seed=3)).interval(RISE)
        assert low <= exponent <= high < low + 1.0
    profiles = [profile(toy(hidden=drag(0.1, 3.0), seed=seed)) for seed in range(50)]
    for rise, least, most in (
        (RISE_90, 37, 50),
        (RISE, 46, 50),
    ):  # what all but 0.1 % of 50 draws at these rates do
        ends = [one.interval(rise) for one in profiles]
        assert least <= sum(low <= 3.0 <= high for low, high in ends) <= most


def test_where_joints_are_loose_each_shape_is_fitted_in_windows_from_the_states_of_the_one_before():
    problem = linear(hidden={"spring": {"size": 0.3, "damping": 0.1}}, candidates=(SPRING,))
    problem.model.simulate = None
    found = fitted(problem, (SPRING,), {"spring.size": 0.3, "spring.damping": 0.0})
    problem.model.filtered.clear()
    profile = profile_shape(problem, found, LawFamily(SPRING, "damping", 0.0, (0.0, 0.3), dict))
    assert problem.model.filtered == []
    error = float(np.sqrt(found.covariance()[-1, -1]))
    ends = found.mapping["spring.damping"] + np.sqrt(RISE) * error * np.array([-1.0, 1.0])
    assert profile.interval(RISE) == pytest.approx(ends, abs=0.2 * error)


@pytest.mark.parametrize("away, held", [(2.5, True), (2.8, True), (3.1, False)])
def test_more_excludes_the_effects_own_shape_where_something_of_the_law_is_idle_there(away, held):
    shapes = np.linspace(0.0, 6.0, 601)
    parabola = ShapeProfile(shapes, 100.0 + (shapes - 2.0 - away) ** 2)
    low, high = shape_interval(parabola, replace(DRAG, inactive_at_default=1), 0.99)
    plain = 2.0 + away - np.sqrt(RISE)
    assert high == pytest.approx(min(2.0 + away + np.sqrt(RISE), 6.0), abs=0.01)
    assert (low <= DRAG.effect_shape) == held
    assert low == pytest.approx(
        DRAG.effect_shape if held and away > np.sqrt(RISE) else plain, abs=0.01
    )
    assert shape_interval(parabola, DRAG, 0.99)[0] == pytest.approx(plain, abs=0.01)


# Laws of a family


@pytest.mark.parametrize(
    "size, is_linear, alone",
    [(1.0, True, True), (0.03, True, True), (0.018, False, True), (0.012, False, False)],
)
def test_a_listed_law_has_an_interval_by_linearisation_or_near_another_listed_shape_by_the_profile(
    size, is_linear, alone, monkeypatch
):
    """They agree. Alone the law is named, otherwise its family."""
    model, profiled = (
        toy({"quadratic": {"drag_N_s2_m2": size}}, seed=3, candidates=["quadratic"]),
        [],
    )

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
def test_a_law_off_the_list_is_named_as_its_family_which_holds_it(size, exponent):
    decision, (family,) = asked(toy(hidden=drag(size, exponent), seed=5))
    assert outcome(decision) == ("named", "power_drag")
    assert not family.fits and not family.alone and family.low <= exponent <= family.high
    assert decision.chosen.mapping["power_drag.exponent"] == family.value
    assert decision.ranking[0].fit is decision.chosen


@pytest.mark.parametrize("factor, named, count", [(0.99, "power_drag", 1), (1.01, "quadratic", 0)])
def test_a_family_whose_fit_leaves_more_than_its_member_is_ignored(
    factor, named, count, monkeypatch
):
    model = toy(hidden=drag(0.05, 3.0), seed=5)
    found = fitted_to(model, "quadratic")

    def in_another_minimum(*args):
        fit = fit_shape(*args)
        return replace(fit, residual=fit.residual * np.sqrt(factor * found.chi2 / fit.chi2))

    monkeypatch.setattr(law_family, "fit_shape", in_another_minimum)
    decision, families = decided(model, "named", found)
    assert (decision.chosen.label, len(families)) == (named, count)


def test_a_family_is_not_named_with_a_size_at_its_bound(monkeypatch):
    model = toy(hidden=drag(0.05, 3.0), seed=5)

    def up_to_its_bound(*args):
        fit = fit_shape(*args)
        ends = {"power_drag.force_N": fit.mapping["power_drag.force_N"]}
        return replace(
            fit, parameters=tuple(replace(p, high=ends.get(p.key, p.high)) for p in fit.parameters)
        )

    monkeypatch.setattr(law_family, "fit_shape", up_to_its_bound)
    decision, families = decided(model, "named", fitted_to(model, "quadratic"))
    assert (decision.verdict, families, decision.best_known.hypothesis[0].label) == (
        "unexplained",
        (),
        "power_drag",
    )
    assert "bound of force_N" in decision.because and decision.chosen is decision.base


def test_the_interval_of_a_shape_holds_those_that_are_stated_of_it_as_a_parameter(monkeypatch):
    def narrow(profile, *of):
        return (float(profile.shapes[np.argmin(profile.chi2)]),) * 2

    monkeypatch.setattr(law_family, "shape_interval", narrow)
    decision, (family,) = asked(toy(hidden=drag(0.05, 3.0), seed=5))
    stated = effect_estimates(decision.chosen, decision.chosen.hypothesis[0])["exponent"]
    (low, high), (least, most) = stated["interval_99"], stated["interval_90"]
    assert family.low <= low < least < family.value < most < high <= family.high


@pytest.mark.parametrize(
    "verdict, labels",
    [
        ("named", ("quadratic", "sensor_bias:torque")),  # which took up a wrong exponent
        ("named_with_remaining_misfit", ("spring", "quadratic")),
    ],
)
def test_what_was_found_without_the_law_of_a_family_gives_way_to_it(verdict, labels):
    model = toy(hidden=drag(2.0, 3.0), seed=5)
    decision, (family,) = decided(model, verdict, fitted_to(model, *labels))
    assert outcome(decision) == ("named", "power_drag")
    assert family.low <= 3.0 <= family.high


def test_an_effect_of_two_families_that_fits_in_both_has_what_the_data_leave_of_each():
    decision, families = asked(toy({"coulomb": {"force_N": 3.0}}, seed=3))
    assert outcome(decision) == ("named", "coulomb")
    assert [family.law for family in families] == ["power_drag", "falling_friction"]
    assert all(
        family.fits and family.alone and family.low <= 0.0 <= family.high for family in families
    )


def test_a_law_of_one_of_two_families_takes_the_place_of_the_effect_that_is_in_both():
    def hidden(x, v, angle, time):
        return -3.0 * (0.6 + 0.4 * np.exp(-np.abs(v) / FALLING_SPEED)) * np.tanh(v / 0.01)

    decision, (family,) = asked(toy(hidden=hidden, seed=3))
    assert outcome(decision) == ("named", "falling_friction")
    assert 0.0 < family.low <= 0.4 <= family.high < 1.0


@pytest.mark.parametrize(
    "ahead, named", [(30.0, ["falling_friction"]), (3.0, ["falling_friction", "power_drag"])]
)
def test_of_several_laws_that_leave_noise_alone_the_best_is_named_and_equally_good_ones_are_ambiguous(
    ahead, named, monkeypatch
):
    coulomb = candidate_of("coulomb")
    laws = {family.law.label: family for family in coulomb.families}
    bic = {"power_drag": 100.0 + ahead, "falling_friction": 100.0}

    def shaped(problem, found, member, family, differences):
        return SimpleNamespace(
            bic=bic[family.law.label], label=family.law.label, hypothesis=(family.law,)
        )

    def of_family(baseline, member, family, fit, limits):
        return fit, FamilyInterval(
            "coulomb", family.law.label, family.shape, 0.5, 0.4, 0.6, fits=False, alone=False
        )

    unproven = [(SimpleNamespace(hypothesis=(coulomb,)), coulomb, laws[label]) for label in bic]
    monkeypatch.setattr(law_family, "_unproven", lambda *args: unproven)
    monkeypatch.setattr(law_family, "fit_shape", shaped)
    monkeypatch.setattr(law_family, "_asked", of_family)
    monkeypatch.setattr(
        law_family,
        "_weighed",
        lambda *args: SimpleNamespace(passes=True, admissible=True, fit=args[2]),
    )
    base = SimpleNamespace(bic=900.0, status="converged")
    decision = Decision("unexplained", base, base)
    problem = SimpleNamespace(
        limit=lambda step: SimpleNamespace(reached=lambda: False), settings=DEFAULT_SETTINGS
    )
    decision, families = with_families(
        SimpleNamespace(problem=problem, differences=None), decision, None
    )
    found = (
        [decision.chosen, *decision.equivalent]
        if decision.verdict == "named"
        else decision.equivalent
    )
    assert [fit.label for fit in found] == named == [family.law for family in families]
    assert decision.verdict == ("named" if len(named) == 1 else "ambiguous")


def test_equals_of_one_family_are_its_name_and_others_stay_equal(monkeypatch):
    model = toy(ONE, seed=3)
    quadratic, viscous, spring = (
        fitted_to(model, label) for label in ("quadratic", "viscous", "spring")
    )
    decision, (family,) = decided(model, "ambiguous", quadratic, viscous)
    assert (*outcome(decision), decision.equivalent) == ("named", "quadratic", [])
    assert family.low <= 1.0 and family.high >= 2.0 and not family.alone
    decision, families = decided(model, "ambiguous", quadratic, spring)
    assert (decision.verdict, families) == ("ambiguous", ())
    monkeypatch.setattr(
        law_family, "profile_shape", lambda *of: None
    )  # a motion that cannot be simulated
    decision, families = decided(model, "ambiguous", quadratic, viscous)
    assert (decision.verdict, families) == ("ambiguous", ())


# Nothing asked


def test_a_family_of_which_two_laws_stand_beside_each_other_is_not_asked():
    decision, families = asked(toy({"coulomb": {"force_N": 1.0}, **ONE}, seed=3))
    assert {candidate.label for candidate in decision.chosen.hypothesis} == {"coulomb", "quadratic"}
    assert [family.law for family in families] == ["falling_friction"]


def test_nothing_is_asked_where_nothing_is_found_but_parameters_are_stated_with_all_that_intervals_ask_for(
    monkeypatch,
):
    stated = []
    monkeypatch.setattr(
        model_selection,
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


def test_no_shape_is_asked_with_an_effect_on_which_motion_depends_roughly():
    model = toy(ONE, seed=3)
    found = fitted_to(model, "quadratic")
    decision, families = decided(
        model, "named", replace(found, hypothesis=(*found.hypothesis, RINGING))
    )
    assert (*outcome(decision), families) == ("named", "quadratic + ringing", ())
