"""Which hypotheses are fitted, and what a second effect has to gain: limits met from both sides by
made-up fits."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import SimulationError
from jointgap.identification import hypothesis_fits, model_selection
from jointgap.identification.baseline import recalibrate
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.hypothesis_fits import fit_pairs, fit_singles
from jointgap.identification.initial_fit import labels_of
from jointgap.identification.model_selection import (
    best_sufficient,
    fit_confusable_effects,
    fits_beyond_bounds,
    nonlinearity,
    select_hypothesis,
    shortlist_singles,
    swap_one_effect,
    two_effect_thresholds,
    with_other_ends,
    without_repetitions,
)
from jointgap.identification.problem import Problem
from jointgap.identification.screening import Sensitivities, Sensitivity
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.thresholds import screen_candidates
from jointgap.identification.verdict import Thresholds
from tests.identification.oscillator import HIDDEN_SPRING, SWING, WOBBLE, linear, noise_of, windows
from tests.identification.toy import (
    RINGING,
    Toy,
    analysed,
    candidate_of,
    ringing,
    screened,
    stated_noise,
    toy,
)

SAMPLES = 200
LN = float(np.log(SAMPLES))
DOF = SAMPLES - 1  # one nuisance
LIMITS = Thresholds(rate=0.01, omnibus=1.5, max_gain_threshold=12.0)
WANTED = 0.5 * 12.0  # half of the gain that is called an effect


def effect(name):
    """An effect with one amplitude."""
    return Candidate(name, "slider", (Parameter("size", 0.0),), ("size",))


def shortlisted(rest, gains):
    """Labels of sensitivities ``e0``, ``e1`` ... that each explain so much of chi2, of which `rest`
    is left if all are there."""
    residual, unit = np.zeros(SAMPLES), np.eye(SAMPLES)
    residual[1 : len(gains) + 1], residual[-1] = np.sqrt(gains), np.sqrt(rest)
    entries = [
        Sensitivity(effect(f"e{place}"), {}, unit[:, [place + 1]], residual, ("slow",))
        for place in range(len(gains))
    ]
    sensitivities = Sensitivities(
        (Parameter("mass", 1.0),), np.array([1.0]), unit[:, :1], residual, entries, {}
    )
    return [one.label for one in shortlist_singles(sensitivities, LIMITS)]


def fitted(chi2, *effects, status="converged"):
    parameters = (Parameter("mass", 1.0), *(Parameter(f"{c.label}.size", 0.0) for c in effects))
    residual, jacobian = np.zeros(SAMPLES), np.eye(SAMPLES)[:, : len(parameters)]
    residual[-1] = chi2**0.5
    return Fit(effects, parameters, np.ones(len(parameters)), residual, jacobian, 1, status)


TWO = {"viscous": {"damping_N_s_m": 0.8}, "spring": {"stiffness_N_m": 3.0}}
DRY = {"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}}
COULOMB, SPRING = effect("coulomb"), effect("spring")


# Single effects


def test_where_the_base_leaves_more_than_noise_the_eight_best_are_fitted_else_those_that_promise_half_of_an_effect():
    assert shortlisted(10.0, [float(100 + place) for place in range(10)]) == [
        f"e{place}" for place in range(9, 1, -1)
    ]
    for more, count in ((0.01, 4), (-0.01, 3)):  # three in any case
        gain = LN + WANTED + more
        assert len(shortlisted(100.0, [gain, gain + 1.0, gain + 2.0, gain + 3.0, 0.5])) == count
    assert len(shortlisted(100.0, [0.1, 0.2, 0.3, 0.4])) == 3
    assert len(shortlisted(10.0, [12.0 + 0.1 * place for place in range(10)])) == 8
    assert shortlisted(100.0, []) == []
    for more, count in ((-0.1, 3), (0.1, 4)):  # it leaves noise alone up to what null campaigns do
        assert len(shortlisted(1.5 * DOF + more - 4.0, [1.0, 1.0, 1.0, 1.0])) == count


# A second effect


def test_an_effect_is_sufficient_that_leaves_no_more_than_null_campaigns_and_beats_the_base():
    base = SimpleNamespace(base=fitted(900.0))
    just, more = (fitted(share * (SAMPLES - 2), COULOMB) for share in (1.4999, 1.5001))
    assert (
        best_sufficient(base, [just], LIMITS) is just
        and best_sufficient(base, [more], LIMITS) is None
    )
    fits = [fitted(200.0, COULOMB), fitted(190.0, SPRING), fitted(189.0, COULOMB, SPRING)]
    assert best_sufficient(base, fits, LIMITS) is fits[1]
    assert best_sufficient(SimpleNamespace(base=fitted(190.0)), fits, LIMITS) is None


def singles(chi2):
    """Fits of two single effects and of a pair; the better single one leaves `chi2`."""
    return [fitted(chi2 + 1.0, SPRING), fitted(chi2, COULOMB), fitted(1.0, SPRING, COULOMB)]


def test_what_other_numerics_change_raises_both_thresholds_of_a_second_effect(monkeypatch):
    """Up to a small part of what the single one explains, 5 % of 800, and if it is more than the
    threshold of one."""

    def second(changed, fits):
        row = np.zeros(SAMPLES)
        row[0], row[5] = 99.0, changed**0.5  # the nuisance takes up the first
        monkeypatch.setattr(
            model_selection, "other_numerics", lambda *_: np.array([0.1 * row, row])
        )
        baseline = SimpleNamespace(
            base=fitted(1000.0), problem=SimpleNamespace(settings=DEFAULT_SETTINGS)
        )
        return two_effect_thresholds(baseline, fits, LIMITS)

    changes = [second(changed, singles(200.0)) for changed in (30.0, 50.0)]
    assert [one.max_gain_threshold for one in changes] == pytest.approx([30.0, 40.0])
    assert [one.omnibus for one in changes] == pytest.approx([1.5 + 30.0 / SAMPLES, 1.5])
    assert second(11.0, singles(200.0)) == LIMITS
    for no_single in ([], [fitted(200.0, COULOMB, status=FAILED), fitted(1.0, SPRING, COULOMB)]):
        assert second(30.0, no_single) is LIMITS


def test_a_jump_is_what_chi2_has_beyond_what_the_other_side_predicts():
    """Residuals depend on one parameter linearly, but for a jump of one sample above the fit."""

    def found(jump, at):
        def residual(values, hypothesis):
            change = np.zeros(SAMPLES)
            change[0], change[at] = values["mass"] - 1.0, jump * (values["mass"] > 1.0)
            return fitted(100.0).residual + change

        return nonlinearity(SimpleNamespace(residual=residual), fitted(100.0))

    assert [found(0.0, 5), found(2.0, 5), found(2.0, -1)] == pytest.approx(
        [0.0, 4.0, 12.0**2 - 10.0**2], abs=1e-9
    )

    def fails(*_):
        raise SimulationError("too far")

    assert nonlinearity(SimpleNamespace(residual=fails), fitted(100.0)) == 0.0


# Fits once more


def test_beside_what_rings_another_effect_is_sought_in_the_valley_of_the_pair():
    """A fit of the ringing alone ended elsewhere. The hidden drag is found in place of friction."""
    model = toy(seed=6, hidden=lambda x, v, angle, _: ringing(0.31, angle) - 0.5 * v)
    base, sensitivities = screened(replace(model, candidates=(*model.candidates, RINGING)))
    start = {"ringing.size": 0.31, "coulomb.force_N": 0.3}
    pair = fit_hypothesis(base.problem, (candidate_of("coulomb"), RINGING), start, refresh=True)
    lost = replace(
        fit_hypothesis(base.problem, (RINGING,), {"ringing.size": 0.5}), status="stopped"
    )
    swapped = {fit.label: fit for fit in swap_one_effect(base, sensitivities, [lost, pair])}
    assert swapped["ringing + viscous"].chi2 < 1.1 * base.problem.size < pair.chi2


@pytest.fixture(scope="module")
def heavier():
    """A dry friction and a mass that is beyond its range are hidden; friction and the gain of a
    sensor were fitted."""
    base, *found = analysed(
        toy({"coulomb": {"force_N": 0.2}, "added_mass": {"mass_kg": 0.1}}, seed=4)
    )
    pair = tuple(candidate_of(label) for label in ("coulomb", "sensor_gain:acceleration"))
    return base, fit_hypothesis(base.problem, pair, differences=base.differences), *found


def test_an_effect_that_takes_a_nuisance_beyond_its_bound_is_tried_in_place_of_each_other_one(
    heavier,
):
    base, pair, sensitivities, limits = heavier
    mass = next(p for p in pair.parameters if p.name == "slider_mass")
    assert pair.mapping["slider_mass"] == mass.high
    first, second = fits_beyond_bounds(base, [base.base, pair])
    assert (first.label, second.label) == (
        "sensor_gain:acceleration + added_mass",
        "coulomb + added_mass",
    )
    assert second.bic < pair.bic - 10.0
    assert second.mapping["added_mass.mass_kg"] == pytest.approx(0.1, abs=0.03)
    assert select_hypothesis(base, sensitivities, [pair], limits).chosen.label == second.label
    lost = [replace(fit, status=FAILED) for fit in (first, second)]
    inside = replace(pair, values=np.array([p.nominal for p in pair.parameters]))
    for given in ([pair, *lost], [inside], [base.base]):
        assert fits_beyond_bounds(base, given) == []
    assert (
        fits_beyond_bounds(replace(base, base=replace(pair, hypothesis=())), [pair]) == []
    )  # nothing is missing
    model, settings = base.problem.model, base.problem.settings
    few = replace(settings, selection=replace(settings.selection, partners=1))
    assert (
        len(
            fits_beyond_bounds(
                replace(base, problem=Problem(model, stated_noise(model), settings=few)), [pair]
            )
        )
        == 1
    )


# Explanations that are one


def test_a_limit_that_predicts_the_same_stands_for_both():
    """A soft spring that differs from a constant force by less than the data can decide is that
    force."""
    force, spring = (
        fitted(300.0, effect("force")),
        fitted(300.0, effect("soft spring"), effect("preload")),
    )
    for apart, is_limit, count in ((9.9, True, 1), (10.1, True, 2), (0.0, False, 2)):
        spring = replace(
            spring, hypothesis=(effect("soft spring"),), residual=force.residual.copy()
        )
        spring.residual[0] += np.sqrt(apart)
        best = {frozenset([fit.label]): fit for fit in (spring, force)}
        found = without_repetitions(
            best,
            lambda special, _, is_limit=is_limit: is_limit and special == (effect("force"),),
            10.0,
        )
        assert sorted(fit.label for fit in found.values()) == ["force", "soft spring"][:count]


# Before a name


def test_what_looks_like_the_explanation_that_would_be_named_is_fitted_before():
    """The true one was never fitted: quadratic drag is hidden, and viscous friction would be
    named."""
    base, found, limits = analysed(
        toy({"quadratic": {"drag_N_s2_m2": 0.04}}, {"slider_mass": 0.51}, seed=4)
    )
    viscous = fit_hypothesis(
        base.problem, (candidate_of("viscous"),), differences=base.differences, refresh=True
    )
    assert viscous.chi2 < limits.omnibus * base.problem.size  # it leaves noise alone
    alike = {fit.label for fit in fit_confusable_effects(base, found, viscous)}
    assert {"coulomb", "quadratic"} <= alike and "constant_force" not in alike
    assert select_hypothesis(base, found, [viscous], limits).chosen.label == "quadratic"


# Other ends


def test_where_more_than_noise_is_left_errors_hold_another_end_that_is_as_good():
    noise = SAMPLES - 2.0
    for left, factor, is_wider in ((2.0, 1.9, True), (2.0, 2.1, False), (1.05, 1.0, False)):
        fit = fitted(noise * left, COULOMB)
        end = replace(
            fitted(noise * (1.0 + factor * (left - 1.0)), COULOMB), values=fit.values + [0.0, 9.0]
        )
        near = replace(end, values=fit.values + [0.0, 0.5])
        other = replace(fitted(noise, SPRING), values=fit.values + [0.0, 99.0])
        wider = with_other_ends(fit, [near, end, fit, other])
        before, after = (np.sqrt(np.diag(one.distribution.covariance)) for one in (fit, wider))
        assert after == pytest.approx([before[0], np.hypot(before[1], 9.0 if is_wider else 0.0)])
    fit = fitted(400.0, COULOMB)
    drawn = replace(fit, draws=np.random.default_rng(1).standard_normal((4000, 2)) + fit.values)
    wider = with_other_ends(drawn, [replace(fit, values=fit.values + [0.0, 9.0])])
    assert np.std(wider.distribution.draws, axis=0) == pytest.approx(
        [1.0, np.hypot(1.0, 9.0)], rel=0.05
    )


# The order of a search


@pytest.mark.parametrize("bias", [-0.03, 0.03])
def test_two_effects_that_mask_each_other_are_fitted_though_neither_is_sufficient_alone(bias):
    """Dry friction makes a torque with a mean, and a bias takes that away, or doubles it."""
    hidden = {"coulomb": {"force_N": 0.5}, "sensor_bias:torque": {"bias": bias}}
    base, sensitivities, limits = analysed(toy(hidden, seed=3, channels=("torque",)))
    alone = [fit_hypothesis(base.problem, (candidate_of("spring"),), differences=base.differences)]
    found = min(fit_pairs(base, sensitivities, limits, alone)[0], key=lambda fit: fit.chi2)
    assert labels_of(found.hypothesis) == hidden.keys()
    assert found.chi2 < limits.omnibus * base.problem.size


@pytest.mark.parametrize("hidden", [TWO, DRY])
def test_two_effects_of_which_neither_is_sufficient_are_found_together(hidden):
    base, sensitivities, limits = analysed(toy(hidden, seed=3))
    alone, _ = fit_singles(base, sensitivities, limits)
    assert min(fit.chi2 for fit in alone) > limits.omnibus * base.problem.size
    found, seconds = fit_pairs(base, sensitivities, limits, alone)
    best = min(found, key=lambda fit: fit.bic)
    assert labels_of(best.hypothesis) == hidden.keys()
    assert best.chi2 < 1.1 * base.problem.size
    assert len({labels_of(fit.hypothesis) for fit in found}) == len(found) == len(seconds)


def test_a_search_that_has_simulated_as_much_as_it_may_begins_nothing_new_and_no_pair_holds_what_failed_alone():
    base, sensitivities, limits = analysed(toy(TWO, seed=3))
    alone, _ = fit_singles(base, sensitivities, limits)
    lost = [replace(fit, status=FAILED) if fit.label == "spring" else fit for fit in alone]

    def search(alone, **changed):
        """Labels of the effects that are found, and how many runs that took."""
        settings = replace(
            DEFAULT_SETTINGS, selection=replace(DEFAULT_SETTINGS.selection, **changed)
        )
        problem = Problem(base.problem.model, stated_noise(base.problem.model), settings=settings)
        found, _ = fit_pairs(replace(base, problem=problem), sensitivities, limits, alone)
        return {label for fit in found for label in labels_of(fit.hypothesis)}, problem.simulations

    (labels, usual), (_, few) = search(alone), search(alone, max_simulations=0)
    assert "spring" in labels and "spring" not in search(lost)[0]
    assert few < usual


@dataclass(frozen=True)
class Listening(Toy):
    """A toy that records which effects are simulated together."""

    heard: set = field(default_factory=set)

    def simulate(self, run, values, effects=(), numerics=0):
        self.heard.add(frozenset(candidate.label for candidate, _ in effects))
        return super().simulate(run, values, effects, numerics)


def test_a_leading_effect_is_linearised_with_those_partners_alone_that_rank_first_about_the_base(
    monkeypatch,
):
    monkeypatch.setattr(hypothesis_fits, "_masked_pairs", lambda *_: [])
    monkeypatch.setattr(hypothesis_fits, "swap_one_effect", lambda *_: [])
    plain = toy(TWO, seed=3)
    model = Listening(plain.series, plain.nuisances, plain.candidates, plain.speeds)
    base, sensitivities, limits = analysed(model)
    first, *_ = alone = sorted(
        fit_singles(base, sensitivities, limits)[0], key=lambda fit: fit.chi2
    )
    assert first.label in TWO
    few = replace(DEFAULT_SETTINGS.selection, linearised_partners=2, partners=1)
    settings = replace(DEFAULT_SETTINGS, selection=few)
    model.heard.clear()
    problem = Problem(model, stated_noise(model), settings=settings)
    pair, *_ = fit_pairs(replace(base, problem=problem), sensitivities, limits, alone)[0]
    assert labels_of(pair.hypothesis) == TWO.keys()
    partners = {
        label for both in model.heard if len(both) == 2 and first.label in both for label in both
    }
    assert len(partners - {first.label}) == 2 and TWO.keys() <= partners


@pytest.mark.parametrize("families, ends", [(True, True), (False, False)])
def test_pairs_with_the_leading_effects_are_fitted_before_a_family_whose_law_suffices_ends_the_search(
    families, ends
):
    """The exponent of a drag is none of those listed."""
    base, sensitivities, limits = analysed(
        toy(hidden=lambda x, v, *_: -0.05 * np.abs(v) ** 3 * np.sign(v), seed=5)
    )
    alone, _ = fit_singles(base, sensitivities, limits)
    if not families:
        bare = [tuple(replace(one, families=()) for one in fit.hypothesis) for fit in alone]
        alone = [
            replace(fit, hypothesis=hypothesis) for fit, hypothesis in zip(alone, bare, strict=True)
        ]
    swapped = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hypothesis_fits, "_is_sufficient", lambda *_: False)  # no pair ends it
        patch.setattr(hypothesis_fits, "_insufficient", lambda *_: True)
        patch.setattr(hypothesis_fits, "swap_one_effect", lambda *_: swapped.append(True) or [])
        fits, _ = fit_pairs(base, sensitivities, limits, alone)
    assert any(len(fit.hypothesis) == 2 for fit in fits) and (not swapped) == ends


STIFFER = {"spring": {"size": 0.3, "damping": 0.0}}
SWINGING, BOTH = {"swing": {"size": 0.3}}, {"swing": {"size": 0.3}, "wobble": {"size": 0.3}}
LESSER = SWINGING | {"wobble": {"size": 0.02}}


@pytest.mark.parametrize(
    "hidden, least, doubted, clearances, best",
    [
        (BOTH, 4.9, False, "fitted", BOTH),  # a likely one is fitted before pairs
        (BOTH, 5.1, False, "tried", BOTH),
        (STIFFER, 4.9, False, "fitted", STIFFER),
        (STIFFER, 5.1, False, "tried", None),
        (STIFFER, 4.9, True, "", None),
        (SWINGING, 0.0, False, "", None),  # one force suffices, and no second one gains
        (
            LESSER,
            4.9,
            False,
            "fitted",
            LESSER,
        ),  # it suffices and a second one gains: one clearance may do as two
        (LESSER, 5.1, False, "tried", LESSER),
        (LESSER, 4.9, True, "", LESSER),
    ],
)
def test_clearances_are_fitted_before_pairs_if_the_filter_finds_one_likely(
    hidden, least, doubted, clearances, best
):
    def deviance(effects):
        return least + 10.0 * max(abs(effects["spring"]["size"] - 0.3) - 0.05, 0.0)

    few = windows(jumps=(1.0, 0.3, 0.03, 0.001), fitted_sizes=1)
    problem = linear(
        hidden=hidden, candidates=(SWING, WOBBLE, HIDDEN_SPRING), deviance=deviance, settings=few
    )
    base = recalibrate(problem.model, noise_of(problem), few)
    screening = screen_candidates(base, 0.01)
    alone, _ = fit_singles(base, *screening)
    fits, seconds = fit_pairs(base, *screening, alone, inconsistent=doubted)
    assert len(fits) == len(seconds)
    turns = {turns for *_, turns in problem.model.filtered}
    assert turns == {"fitted": {1.0, np.inf}, "tried": {1.0}, "": set()}[clearances]
    if best:
        found = min(fits, key=lambda fit: fit.chi2)
        assert (labels_of(found.hypothesis), found.in_windows) == (best.keys(), "spring" in best)
    assert fit_pairs(base, *screening, alone, part=1, parts=2) == ([], [])
