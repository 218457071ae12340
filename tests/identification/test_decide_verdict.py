"""The verdict follows from the fits' chi2 by rules with sharp limits: each is met from both sides, with fits made up
for it.
"""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.decide_verdict import certain_effects, decide, rank, reduced_chi2, weigh
from jointgap.identification.fit import FAILED, Fit
from jointgap.identification.settings import DecisionSettings
from jointgap.identification.thresholds import Thresholds

SAMPLES = 1000
LN = np.log(SAMPLES)
LIMITS = Thresholds(rate=0.01, omnibus=1.05, max_gain_threshold=12.0, numerical_noise=4.0)


def effect(name, replaces=None, low=-np.inf):
    """An effect with one amplitude."""
    return Candidate(name, "slider", (Parameter("size", 0.0, low),), ("size",), replaces=replaces or {})


def fitted(chi2, *effects, value=1.0, nuisances=1, status="converged", reason="", slope=1e6):
    """A fit with a residual of `chi2`, its nuisances ``n0``, ``n1`` ... and one amplitude for each effect."""
    parameters = [Parameter(f"n{place}", 0.0) for place in range(nuisances)]
    parameters += [Parameter(f"{candidate.label}.size", 0.0) for candidate in effects]
    residual = np.zeros(SAMPLES)
    residual[-1] = np.sqrt(chi2)
    jacobian = np.zeros((SAMPLES, len(parameters)))
    jacobian[np.arange(len(parameters)), np.arange(len(parameters))] = slope
    values = np.array([0.0] * nuisances + [value] * len(effects))
    return Fit(effects, tuple(parameters), values, residual, jacobian, 1, status, reason)


def decided(
    base, fits, nominal=None, limits=LIMITS, similarity=None, bounds=None, within=lambda *_: False, second=0.0, **more
):
    """The decision, with nominal values that are far worse than the base where a test says nothing of them."""
    nominal = nominal or fitted(base.chi2 + 500.0, nuisances=0)
    return decide(base, nominal, fits, limits, similarity or {}, bounds or {}, within, second, **more)


COULOMB, SPRING, MASS = effect("coulomb"), effect("spring"), effect("mass", replaces={"slider_mass": "size"})
NOISE = SAMPLES - 1.0  # chi2 of the base where it leaves noise alone: one nuisance is fitted
GREAT = 2000.0  # chi2 of a base that leaves far more than noise


# Whether anything is missing


def test_nominal_values_that_leave_noise_alone_are_no_disagreement():
    found = decided(fitted(NOISE), [], nominal=fitted(NOISE + 5.0, nuisances=0))
    assert (found.verdict, found.chosen.chi2) == ("no_disagreement", pytest.approx(NOISE + 5.0))


@pytest.mark.parametrize(("behind", "verdict"), [(13.9, "no_disagreement"), (14.1, "parameters_only")])
def test_nominal_values_may_be_behind_the_fitted_ones_by_a_rivals_distance_and_the_roughness(behind, verdict):
    limits = Thresholds(rate=0.01, omnibus=1.5, max_gain_threshold=12.0, numerical_noise=4.0)
    nominal = fitted(NOISE + LN + behind, nuisances=0)  # the base has one parameter more, worth ln n
    assert decided(fitted(NOISE), [], nominal=nominal, limits=limits).verdict == verdict


@pytest.mark.parametrize(("chi2", "verdict"), [(1049.9, "no_disagreement"), (1050.1, "parameters_only")])
def test_nominal_values_have_to_leave_no_more_than_null_campaigns_do(chi2, verdict):
    assert decided(fitted(chi2 - 1.0), [], nominal=fitted(chi2, nuisances=0)).verdict == verdict


@pytest.mark.parametrize(("gap", "verdict"), [(1.0999, "parameters_only"), (1.1001, "unexplained")])
def test_a_slight_misfit_without_an_effect_is_not_called_missing(gap, verdict):
    assert decided(fitted(gap * (SAMPLES - 1)), []).verdict == verdict


def test_null_campaigns_that_leave_more_raise_what_counts_as_slight():
    limits = Thresholds(rate=0.01, omnibus=1.3, max_gain_threshold=12.0, numerical_noise=4.0)
    assert decided(fitted(1.29 * (SAMPLES - 1)), [], limits=limits).verdict == "parameters_only"
    assert decided(fitted(1.31 * (SAMPLES - 1)), [], limits=limits).verdict == "unexplained"


# What is named


def test_an_effect_that_leaves_noise_alone_is_named():
    found = decided(fitted(GREAT), [fitted(NOISE, COULOMB)])
    assert (found.verdict, found.chosen.label) == ("named", "coulomb")
    assert found.base.chi2 == pytest.approx(GREAT)
    assert found.thresholds is LIMITS
    assert found.equivalent == []


@pytest.mark.parametrize(("gain", "verdict"), [(12.1, "named"), (11.9, "parameters_only")])
def test_an_effect_has_to_gain_what_null_campaigns_gain_by_chance(gain, verdict):
    base = fitted(NOISE + 30.0)
    assert decided(base, [fitted(base.chi2 - LN - gain, COULOMB)]).verdict == verdict


@pytest.mark.parametrize(("gain", "verdict"), [(10.1, "named"), (9.9, "parameters_only")])
def test_an_effect_has_to_be_ahead_of_the_base_as_of_any_rival(gain, verdict):
    base, limits = (
        fitted(NOISE + 30.0),
        Thresholds(rate=0.01, omnibus=1.05, max_gain_threshold=2.0, numerical_noise=0.0),
    )
    assert decided(base, [fitted(base.chi2 - LN - gain, COULOMB)], limits=limits).verdict == verdict


@pytest.mark.parametrize(("gain", "label"), [(12.1, "coulomb + spring"), (11.9, "coulomb")])
def test_a_second_effect_has_to_gain_as_much_beside_the_first(gain, label):
    single, pair = fitted(NOISE, COULOMB), fitted(NOISE - LN - gain, COULOMB, SPRING)
    found = decided(fitted(GREAT), [pair, single])
    assert (found.verdict, found.chosen.label) == ("named", label)


@pytest.mark.parametrize(("gain", "label"), [(40.1, "coulomb + spring"), (39.9, "coulomb")])
def test_a_second_effect_has_to_gain_what_is_asked_of_it(gain, label):
    single, pair = fitted(NOISE, COULOMB), fitted(NOISE - LN - gain, COULOMB, SPRING)
    assert decided(fitted(GREAT), [single, pair], second=40.0).chosen.label == label


def test_a_pair_is_named_where_no_single_effect_was_fitted():
    assert decided(fitted(GREAT), [fitted(NOISE, COULOMB, SPRING)]).chosen.label == "coulomb + spring"


# What the data cannot tell apart


@pytest.mark.parametrize(("behind", "verdict"), [(13.9, "ambiguous"), (14.1, "named")])
def test_effects_within_a_rivals_distance_and_the_roughness_are_not_told_apart(behind, verdict):
    fits = [fitted(NOISE + behind, SPRING), fitted(NOISE, COULOMB)]
    found = decided(fitted(GREAT), fits)
    assert found.verdict == verdict
    assert [fit.label for fit in found.equivalent] == (["coulomb", "spring"] if verdict == "ambiguous" else [])
    assert found.chosen.label == ("" if verdict == "ambiguous" else "coulomb") or found.chosen is found.base


def test_a_special_case_of_an_effect_is_no_rival():
    fits = [fitted(NOISE, COULOMB), fitted(NOISE + 1.0, SPRING)]
    asked = []

    def within(special, general):
        asked.append((special[0].name, general[0].name))
        return True

    assert decided(fitted(GREAT), fits, within=within).verdict == "named"
    assert asked == [("coulomb", "spring")]


def test_the_same_effect_with_another_beside_it_is_no_rival():
    fits = [fitted(NOISE, COULOMB), fitted(NOISE + 1.0, COULOMB, SPRING)]
    assert decided(fitted(GREAT), fits).verdict == "named"


def test_one_effect_of_a_named_pair_is_no_rival_and_another_single_one_is():
    pair, limits = (
        fitted(NOISE - LN, COULOMB, SPRING),
        Thresholds(rate=0.01, omnibus=1.05, max_gain_threshold=0.0, numerical_noise=30.0),
    )
    single = fitted(NOISE + 20.0, COULOMB)
    assert decided(fitted(GREAT), [pair, single], limits=limits).verdict == "named"
    other = fitted(NOISE + 20.0, MASS)
    assert (
        decided(fitted(GREAT), [pair, single, other], limits=limits, bounds={"slider_mass": (1, 1, 1)}).verdict
        == "ambiguous"
    )


def test_a_pair_is_no_rival_of_a_single_effect():
    fits = [fitted(NOISE, COULOMB), fitted(NOISE, SPRING, effect("drag"))]
    assert decided(fitted(GREAT), fits).verdict == "named"


def test_rivals_that_leave_too_much_explain_nothing():
    fits = [fitted(1500.0, COULOMB), fitted(1501.0, SPRING)]
    found = decided(fitted(GREAT), fits)
    assert (found.verdict, found.equivalent) == ("unexplained", [])
    assert found.because == "several explanations are equally poor"


@pytest.mark.parametrize(("share", "verdict"), [(0.951, "ambiguous"), (0.949, "unexplained")])
def test_rivals_that_explain_nearly_all_are_told_as_such(share, verdict):
    base = fitted(101_000.0 - 1.0)  # an excess of 100 000
    left = base.chi2 - share * 1e5
    assert decided(base, [fitted(left, COULOMB), fitted(left + 1.0, SPRING)]).verdict == verdict


# What an effect leaves


@pytest.mark.parametrize(
    ("chi2", "verdict"),
    [
        (1.18**2 * SAMPLES, "unexplained"),  # explains 28 % of a gap of 1.24
        (1.02 * SAMPLES, "named"),  # 96 %
        (1.03 * SAMPLES, "unexplained"),  # 94 %
    ],
)
def test_null_campaigns_that_leave_much_are_no_reason_to_name_what_explains_little(chi2, verdict):
    """The noise is known poorly: from few cycles."""
    limits = Thresholds(rate=0.01, omnibus=1.6, max_gain_threshold=12.0, numerical_noise=0.0)
    base = fitted(1.24**2 * SAMPLES)
    strict = replace(DecisionSettings(), tolerated_reduced_chi2=1.0)
    found = decided(base, [fitted(chi2, COULOMB)], limits=limits, settings=strict)
    assert found.verdict == verdict
    assert (found.best_known is None) == (verdict != "unexplained")


@pytest.mark.parametrize(("rest", "verdict"), [(1.0999, "named"), (1.1001, "unexplained")])
def test_what_would_not_be_called_missing_need_not_be_explained(rest, verdict):
    limits = Thresholds(rate=0.01, omnibus=1.6, max_gain_threshold=12.0, numerical_noise=0.0)
    assert decided(fitted(1500.0), [fitted(rest * (SAMPLES - 2), COULOMB)], limits=limits).verdict == verdict


@pytest.mark.parametrize(
    ("share", "alike", "verdict"),
    [
        (0.97, 0.93, "named_with_remaining_misfit"),  # leaves 3 %, a rival in its place would leave 7 %
        (0.97, 0.95, "unexplained"),  # a rival would leave 5 %: more than half of that is left
        (0.951, 0.0, "named_with_remaining_misfit"),
        (0.949, 0.0, "unexplained"),
    ],
)
def test_an_effect_that_leaves_more_than_noise_is_named_if_it_explains_what_no_rival_could(share, alike, verdict):
    base = fitted(101_000.0 - 1.0)
    found = decided(base, [fitted(base.chi2 - share * 1e5, COULOMB)], similarity={"coulomb": alike})
    assert found.verdict == verdict
    assert (found.chosen.label == "coulomb") == (verdict != "unexplained")


def test_the_reason_tells_the_share_of_the_best_effect():
    base = fitted(101_000.0 - 1.0)
    poor = decided(base, [fitted(base.chi2 - 0.5e5, COULOMB)])
    assert poor.because == "the best, coulomb, explains 50.0% only"
    alike = decided(base, [fitted(base.chi2 - 0.96e5, COULOMB)], similarity={"coulomb": 0.99})
    assert alike.because == "coulomb explains 96.0%, as it also would if a similar effect were the cause"


def test_where_nothing_of_the_ranking_helps_the_reason_says_so():
    assert decided(fitted(GREAT), []).because == "no candidate explains the disagreement"


# Ranking


def test_a_rank_tells_gain_share_and_whether_noise_alone_is_left():
    base, fit = fitted(1999.0), fitted(1100.0, COULOMB)
    ranked = weigh(base, fit, LIMITS)
    assert ranked.delta_bic == pytest.approx(899.0 - LN)
    assert ranked.share == pytest.approx(899.0 / 1000.0)
    assert not ranked.passes  # 1100 / 998 is above 1.05
    assert ranked.admissible
    assert weigh(base, fitted(1047.8, COULOMB), LIMITS).passes  # 1.05 * 998 is 1047.9
    assert not weigh(base, fitted(1048.0, COULOMB), LIMITS).passes


@pytest.mark.parametrize(("excess", "known"), [(44.7, False), (44.8, True)])
def test_a_share_is_told_where_the_excess_is_above_a_standard_deviation_of_chi2(excess, known):
    share = weigh(fitted(NOISE + excess), fitted(NOISE, COULOMB), LIMITS).share
    assert np.isfinite(share) == known  # sqrt(2 * 1000) is 44.72
    assert not known or share == pytest.approx(1.0)


def test_the_ranking_puts_failed_fits_last_and_says_why():
    failed = fitted(10.0, SPRING, status=FAILED, reason="it stopped")
    ranking = rank(
        fitted(GREAT),
        [failed, fitted(1500.0, MASS, value=9.0), fitted(1100.0, COULOMB)],
        LIMITS,
        {"slider_mass": (1.0, 0.9, 1.1)},
    )
    assert [ranked.fit.label for ranked in ranking] == ["coulomb", "mass", "spring"]
    assert [ranked.admissible for ranked in ranking] == [True, True, False]
    assert ranking[-1].remark == "it stopped"


def test_chi2_is_taken_over_its_degrees_of_freedom():
    assert reduced_chi2(fitted(997.0, COULOMB, SPRING)) == pytest.approx(1.0)
    assert reduced_chi2(fitted(1.0, COULOMB, status=FAILED)) == np.inf


# Effects that are not there, and parameters within their ranges


def test_an_effect_of_no_size_is_not_admissible():
    (ranked,) = rank(fitted(GREAT), [fitted(NOISE, COULOMB, value=0.0)], LIMITS, {})
    assert (ranked.admissible, ranked.remark) == (False, "coulomb is fitted with no size")


@pytest.mark.parametrize(
    ("value", "admissible"),
    [(0.51, True), (0.49, False), (0.0001, False), (-0.09, False), (-0.11, True)],
)
def test_nominal_plus_value_is_held_against_the_range_of_the_nuisance_it_replaces(value, admissible):
    bounds = {"slider_mass": (1.0, 0.9, 1.5)}  # not symmetric: 1 - 0.49 is out, 1 + 0.49 is within
    (ranked,) = rank(fitted(GREAT), [fitted(NOISE, MASS, value=value)], LIMITS, bounds)
    assert ranked.admissible == admissible
    assert admissible or ranked.remark == "mass is slider_mass within its range: a parameter, no effect"


@pytest.mark.parametrize(("value", "admissible"), [(2.1, True), (1.9, False), (-2.1, True), (-1.9, False)])
def test_a_further_size_of_such_an_effect_counts_from_two_standard_errors_on(value, admissible):
    lengths = Candidate(
        "lengths", "rod", (Parameter("a", 0.0), Parameter("b", 0.0)), ("a", "b"), replaces={"crank_length": "a"}
    )
    parameters = (Parameter("lengths.a", 0.0), Parameter("lengths.b", 0.0))
    residual = np.zeros(SAMPLES)
    residual[-1] = np.sqrt(SAMPLES - 2.0)  # chi2 of noise: standard errors are those of the Jacobian
    jacobian = np.zeros((SAMPLES, 2))
    jacobian[[0, 1], [0, 1]] = 100.0, 1.0  # the first size is beyond doubt
    fit = Fit((lengths,), parameters, np.array([0.05, value]), residual, jacobian, 1, "converged")
    (ranked,) = rank(fitted(GREAT), [fit], LIMITS, {"crank_length": (1.0, 0.9, 1.1)})
    assert ranked.admissible == admissible


def test_an_effect_that_leaves_the_rest_of_a_shared_nuisance_to_be_fitted_is_one_within_the_range_too():
    both = Parameter("joint_friction", 0.1, 0.0, 0.2)
    friction = Candidate(
        "pin", "crank_pin", (Parameter("size", 0.0), both), ("size",), replaces={"joint_friction": "size"}
    )
    (ranked,) = rank(fitted(GREAT), [fitted(NOISE, friction, value=0.05)], LIMITS, {"joint_friction": (0.1, 0.0, 0.2)})
    assert ranked.admissible


def test_what_is_not_admissible_is_not_named():
    found = decided(fitted(GREAT), [fitted(NOISE, MASS, value=0.01)], bounds={"slider_mass": (1.0, 0.9, 1.1)})
    assert found.verdict == "unexplained"


def test_a_replaced_nuisance_still_counts_in_the_bic():
    assert fitted(100.0, MASS).bic == pytest.approx(100.0 + (2 + 1) * LN)
    assert fitted(100.0, COULOMB).bic == pytest.approx(100.0 + 2 * LN)


# What each verdict says, and hands on


def test_every_verdict_gives_its_reason_and_hands_on_the_model_that_it_rests_on():
    base, noisy = fitted(101_000.0 - 1.0), fitted(NOISE)
    single, rival = fitted(NOISE, COULOMB), fitted(NOISE + 1.0, SPRING)
    nearly = fitted(base.chi2 - 0.97e5, COULOMB)
    nominal = fitted(NOISE + 5.0, nuisances=0)
    poor = [fitted(0.5e5, COULOMB), fitted(0.5e5, SPRING)]
    reasons = [
        (decided(noisy, [], nominal=nominal), nominal, "the model as it stands leaves noise alone"),
        (decided(noisy, []), noisy, "with parameters within their ranges the model leaves noise alone"),
        (decided(base, []), base, "no candidate explains the disagreement"),
        (decided(base, [single]), single, "with it the model leaves noise alone"),
        (decided(base, [single, rival]), base, "several explanations fit the data equally well"),
        (decided(base, poor), base, "several explanations are equally poor"),
        (
            decided(base, [nearly]),
            nearly,
            "it explains nearly all, and more than it could if the nearest other effect were the cause",
        ),
    ]
    for decision, chosen, reason in reasons:
        assert decision.chosen is chosen
        assert decision.because == reason
        assert decision.thresholds is LIMITS


def test_where_what_was_fitted_is_worse_than_the_base_the_reason_says_so():
    strict = Thresholds(rate=0.01, omnibus=0.9, max_gain_threshold=12.0, numerical_noise=0.0)  # 1000 / 998 is above 0.9
    base, limits = fitted(1200.0), strict
    found = decided(base, [fitted(1300.0, COULOMB)], limits=limits)
    assert found.because == "no candidate explains the disagreement"


def test_a_pair_needs_a_rivals_distance_where_chance_gains_less():
    limits = Thresholds(rate=0.01, omnibus=1.05, max_gain_threshold=2.0, numerical_noise=0.0)
    for gain, label in ((9.9, "coulomb"), (10.1, "coulomb + spring")):
        fits = [fitted(NOISE, COULOMB), fitted(NOISE - LN - gain, COULOMB, SPRING)]
        assert decided(fitted(GREAT), fits, limits=limits).chosen.label == label


def test_of_two_effects_the_second_is_held_against_its_range_though_the_first_shares_a_nuisance():
    both = Parameter("joint_friction", 0.1, 0.0, 0.2)
    friction = Candidate(
        "pin", "crank_pin", (Parameter("size", 0.0), both), ("size",), replaces={"joint_friction": "size"}
    )
    bounds = {"joint_friction": (0.1, 0.0, 0.2), "slider_mass": (1.0, 0.9, 1.1)}
    (ranked,) = rank(fitted(GREAT), [fitted(NOISE, friction, MASS, value=0.05)], LIMITS, bounds)
    assert ranked.remark == "mass is slider_mass within its range: a parameter, no effect"


def test_an_effect_that_replaces_two_nuisances_names_both():
    names = {"crank_length": "a", "rod_length": "b"}
    lengths = Candidate("lengths", "rod", (Parameter("a", 0.0), Parameter("b", 0.0)), ("a", "b"), replaces=names)
    parameters = (Parameter("lengths.a", 0.0), Parameter("lengths.b", 0.0))
    fit = Fit((lengths,), parameters, np.array([0.05, 0.05]), np.ones(9), np.ones((9, 2)), 1, "converged")
    (ranked,) = rank(fitted(GREAT), [fit], LIMITS, dict.fromkeys(names, (1.0, 0.9, 1.1)))
    assert ranked.remark == "lengths is crank_length and rod_length within its range: a parameter, no effect"


def test_a_failed_fit_is_not_looked_into():
    failed = fitted(10.0, MASS, value=0.0, status=FAILED, reason="it stopped")
    (ranked,) = rank(fitted(GREAT), [failed], LIMITS, {})
    assert (ranked.admissible, ranked.remark) == (False, "it stopped")


def test_standard_errors_come_from_the_slope_of_the_residual():
    lengths = Candidate("lengths", "rod", (Parameter("a", 0.0), Parameter("b", 0.0)), ("a", "b"), replaces={"c": "a"})
    parameters = (Parameter("lengths.a", 0.0), Parameter("lengths.b", 0.0))
    jacobian = np.zeros((SAMPLES, 2))
    jacobian[[0, 1], [0, 1]] = 100.0, 4.0  # standard errors of 0.01 and 0.25
    for value, admissible in ((0.51, True), (0.49, False)):
        fit = Fit((lengths,), parameters, np.array([0.05, value]), np.zeros(SAMPLES), jacobian, 1, "converged")
        (ranked,) = rank(fitted(GREAT), [fit], LIMITS, {"c": (1.0, 0.9, 1.1)})
        assert ranked.admissible == admissible


def test_chi2_of_as_many_parameters_as_samples_is_taken_as_it_is():
    two = (Parameter("a", 0.0), Parameter("b", 0.0))
    assert reduced_chi2(Fit((), two, np.zeros(2), np.array([3.0, 4.0]), np.eye(2), 1, "converged")) == pytest.approx(
        25.0
    )


# A frequency of its own that is none


@pytest.mark.parametrize(("order", "verdict"), [("order 1 of the crank in run slow", "unexplained"), ("", "named")])
@pytest.mark.parametrize("beside", [(), (COULOMB,)])
def test_an_effect_that_swings_at_an_order_of_a_crank_is_not_named(beside, order, verdict):
    swinging = replace(
        effect("swing"), coordinates=(Parameter("size", 0.0), Parameter("frequency_Hz", 5.0)), steady_counterpart="push"
    )
    fit = fitted(NOISE, *beside, swinging)
    fit = replace(fit, parameters=(Parameter("swing.frequency_Hz", 5.0), *fit.parameters[1:]), values=fit.values + 5.04)
    asked = []
    found = decided(fitted(GREAT), [fit], order_in_words=lambda hertz: asked.append(hertz) or order)
    assert (found.verdict, asked) == (verdict, [5.04])
    assert not order or found.ranking[0].remark == f"swing swings at 5.04 Hz, which is {order}"


# Effects whose size is not there, or at its end


@pytest.mark.parametrize(("value", "verdict"), [(1.646, "named"), (1.644, "unexplained")])
def test_an_effect_whose_interval_holds_zero_is_not_named(value, verdict):
    # a standard error of 1: half the width of a 90 % interval is 1.645; it wins by the nuisances that came with it
    found = decided(fitted(GREAT), [fitted(NOISE, COULOMB, value=value, slope=1.0)])
    assert found.verdict == verdict
    assert found.best_known is None
    if verdict != "named":
        assert found.ranking[0].remark == "coulomb may as well be absent: the interval of its size holds 0"


def test_an_effect_whose_interval_holds_zero_is_not_called_equivalent():
    fits = [fitted(NOISE, COULOMB), fitted(NOISE + 1.0, SPRING, value=0.25, slope=1.0)]
    assert decided(fitted(GREAT), fits).verdict == "named"


def bounded(value, low, high, is_perturbation=False):
    """A fit of an effect that ended at a value within bounds, and leaves noise alone."""
    size = Parameter("size", 0.0, low, high)
    known = Candidate("length", "crank", (size,), ("size",), is_perturbation=is_perturbation)
    fit = fitted(NOISE, known, value=value)
    limited = Parameter("length.size", 0.0, low, high)
    return replace(fit, parameters=(*fit.parameters[:-1], limited))


@pytest.mark.parametrize(
    ("value", "is_perturbation", "verdict"),
    [
        (0.5, False, "unexplained"),
        (0.499, False, "named"),
        (-0.5, False, "unexplained"),
        (-0.5, True, "named"),  # nothing is left of what was known
        (0.5, True, "unexplained"),
    ],
)
def test_an_effect_drawn_to_the_bound_of_its_size_is_not_named(value, is_perturbation, verdict):
    found = decided(fitted(GREAT), [bounded(value, -0.5, 0.5, is_perturbation)])
    assert found.verdict == verdict
    if verdict != "named":
        remark = "length is drawn to the bound of size: what it explains is something else"
        assert found.ranking[0].remark == remark


# Rivals where what is left is no noise

WHOLE = 101_000.0 - 1.0  # chi2 of a base with an excess of 100 000 over the noise


def left(share, *effects):
    """A fit that leaves this share of that excess."""
    return fitted(WHOLE - (1.0 - share) * 1e5, *effects)


DRAG, BIAS = effect("drag"), effect("bias")


@pytest.mark.parametrize(("rest", "verdict"), [(0.0059, "unexplained"), (0.0061, "named_with_remaining_misfit")])
def test_where_another_far_behind_in_bic_leaves_hardly_more_of_a_rest_neither_is_named_nor_both_called_equal(
    rest, verdict
):
    fits = [left(0.003, COULOMB, DRAG), left(rest, COULOMB, BIAS)]
    assert fits[1].bic - fits[0].bic > 250.0
    found = decided(fitted(WHOLE), fits)
    assert (found.verdict, found.equivalent) == (verdict, [])
    assert (found.best_known is None) == (verdict != "unexplained")


@pytest.mark.parametrize(("apart", "verdict"), [(13.9, "ambiguous"), (14.1, "unexplained")])
def test_what_is_called_equal_is_close_also_where_more_than_noise_is_left(apart, verdict):
    best = left(0.01, COULOMB)
    found = decided(fitted(WHOLE), [best, fitted(best.chi2 + apart, SPRING)])
    assert found.verdict == verdict
    assert [fit.label for fit in found.equivalent] == (["coulomb", "spring"] if verdict == "ambiguous" else [])


@pytest.mark.parametrize(("rest", "verdict"), [(0.0099, "named_with_remaining_misfit"), (0.0101, "unexplained")])
def test_from_99_percent_on_the_fits_of_others_count_not_how_alike_signatures_look(rest, verdict):
    fits = [left(rest, COULOMB, DRAG), left(0.05, COULOMB, BIAS)]
    found = decided(fitted(WHOLE), fits, similarity={"coulomb + drag": 0.999})
    assert found.verdict == verdict
    assert (found.best_known is None) == (verdict != "unexplained")


def test_explanations_that_share_an_effect_have_it_as_certain():
    shared = [fitted(NOISE, COULOMB, BIAS), fitted(NOISE + 1.0, DRAG, COULOMB)]
    found = decided(fitted(GREAT), shared)
    assert found.verdict == "ambiguous"
    assert [candidate.label for candidate in certain_effects(found.equivalent)] == ["coulomb"]
    assert certain_effects([fitted(NOISE, COULOMB), fitted(NOISE, SPRING)]) == []
    assert certain_effects([]) == []


def test_what_an_explanation_as_near_as_those_that_are_equal_does_without_is_not_certain():
    shared = [fitted(NOISE, COULOMB, BIAS), fitted(NOISE + 1.0, COULOMB, DRAG, BIAS)]
    for close, certain in ([["coulomb", "spring", "bias"]], ["coulomb", "bias"]), ([["coulomb"]], ["coulomb"]):
        assert [candidate.label for candidate in certain_effects(shared, close)] == certain


# A base that hardly shows, and what is best but not proven


@pytest.mark.parametrize(("base", "verdict"), [(1097.0, "named_with_remaining_misfit"), (1101.0, "unexplained")])
def test_of_a_base_that_hardly_shows_the_share_does_not_decide(base, verdict):
    # 1.1 times 999 degrees of freedom is 1098.9; the effect explains about half and leaves more than 1.05
    found = decided(fitted(base), [fitted(1055.0, COULOMB)])
    assert found.verdict == verdict
    assert (found.best_known is None) == (verdict != "unexplained")


def test_the_best_that_is_not_proven_is_handed_on():
    base = fitted(WHOLE)
    poor = decided(base, [left(0.5, COULOMB), left(0.9, SPRING)])
    assert (poor.verdict, poor.chosen, poor.best_known.label) == ("unexplained", base, "coulomb")
    equal = decided(base, [left(0.5, COULOMB), fitted(left(0.5).chi2 + 1.0, SPRING)])
    assert (equal.because, equal.best_known.label) == ("several explanations are equally poor", "coulomb")
    assert decided(base, []).best_known is None
    assert decided(base, [left(0.5, COULOMB)]).proposed.label == "coulomb"
    assert decided(base, []).proposed is None


# What rings
