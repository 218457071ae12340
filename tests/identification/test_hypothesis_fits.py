"""In which order hypotheses are fitted where no single effect is sufficient at first."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.identification import hypothesis_fits
from jointgap.identification.baseline import other_numerics, recalibrate
from jointgap.identification.fit import CONVERGED, FAILED, MATCHED, STOPPED, fit_hypothesis
from jointgap.identification.hypothesis_fits import fit_pairs
from jointgap.identification.initial_fit import labels_of
from jointgap.identification.problem import Problem
from jointgap.identification.screening import simulate_signatures
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.thresholds import thresholds
from tests.identification.knocks import LOOSER, knocking
from tests.identification.toy import candidate_of, stated_noise, toy


@pytest.fixture(scope="module")
def analysed():
    """A hidden viscous friction, and the analysis up to the fits of single effects."""
    model = toy({"viscous": {"damping_N_s_m": 0.8}}, seed=3)
    base = recalibrate(model, stated_noise(model))
    signatures = simulate_signatures(base.problem, base.base, base.differences)
    return base, signatures, thresholds(base.problem, signatures, other_numerics(base.problem, base.base))


def fit_of(base, *labels, chi2: float, status: str = STOPPED):
    """A fit of effects that leaves `chi2` for each sample."""
    hypothesis = tuple(map(candidate_of, labels))
    parameters = base.problem.parameters(hypothesis)
    size, values = base.problem.size, np.array([p.nominal for p in parameters])
    return replace(
        base.base,
        hypothesis=hypothesis,
        parameters=parameters,
        values=values,
        residual=np.full(size, np.sqrt(chi2)),
        jacobian=np.ones((size, values.size)),
        status=status,
    )


def test_pairs_of_a_single_effect_that_is_found_late_are_fitted_though_other_pairs_were(analysed, monkeypatch):
    base, signatures, limits = analysed
    viscous = fit_hypothesis(base.problem, (candidate_of("viscous"),), differences=base.differences, refresh=True)
    pairs, asked = [fit_of(base, "spring", "coulomb", chi2=5.0)], []
    monkeypatch.setattr(hypothesis_fits, "search_pairs", lambda *args: pairs)
    monkeypatch.setattr(hypothesis_fits, "_search_far", lambda *args: ([viscous], []))
    monkeypatch.setattr(hypothesis_fits, "_pairs_of_best", lambda *args: asked.append(args[-1]) or [])
    found, _ = fit_pairs(base, signatures, limits, [fit_of(base, "spring", chi2=6.0, status=CONVERGED)])
    assert any(fit.label == "viscous" for fit in asked[0])
    assert {"viscous", "spring + coulomb"} <= {fit.label for fit in found}


def moved_to(monkeypatch, base, **levels):
    """Fits that start from another's nuisances end at these levels of chi2 a sample; returned is what was tried."""
    tried = []

    def moved(problem, differences, fit, to, sufficient_chi2=np.inf):
        tried.append((fit.label, to.label, sufficient_chi2 < np.inf))
        return (
            fit_of(base, *(one.name for one in fit.hypothesis), chi2=levels[fit.label]) if fit.label in levels else fit
        )

    monkeypatch.setattr(hypothesis_fits, "moved", moved)
    return tried


def test_fits_that_ended_early_start_again_from_each_new_best_one_until_one_is_sufficient(analysed, monkeypatch):
    base, _, limits = analysed
    tried = moved_to(monkeypatch, base, spring=4.0, coulomb=1.0)
    alone = [
        fit_of(base, "viscous", chi2=10.0, status=CONVERGED),
        fit_of(base, "coulomb", chi2=20.0),
        fit_of(base, "spring", chi2=30.0),
        fit_of(base, "quadratic", chi2=40.0),
        fit_of(base, "added_mass", chi2=50.0, status=FAILED),
    ]
    found = hypothesis_fits._from_nuisances_of_best(base, alone, limits)
    assert {fit.label for fit in found} == {"coulomb", "spring"}
    # the rivals of a sufficient one get another start too, but give up early
    assert tried == [("coulomb", "viscous", False), ("spring", "viscous", True), ("quadratic", "viscous", True)]


def with_film(base, chi2: float):
    """A base that leaves 30 for each sample, and a film, which is never small, that leaves `chi2`."""
    film = replace(candidate_of("spring"), name="film", initial_guesses=({"stiffness_N_m": 2.0},))
    return replace(base, base=fit_of(base, chi2=30.0)), replace(fit_of(base, "spring", chi2=chi2), hypothesis=(film,))


def test_effects_that_are_never_small_start_again_last_and_not_at_all_once_one_is_sufficient(analysed, monkeypatch):
    base, film = with_film(analysed[0], chi2=11.0)
    limits = analysed[-1]
    alone = [fit_of(base, "viscous", chi2=10.0, status=CONVERGED), film, fit_of(base, "coulomb", chi2=20.0)]
    tried = moved_to(monkeypatch, base, coulomb=5.0)
    hypothesis_fits._from_nuisances_of_best(base, alone, limits)
    assert [label for label, *_ in tried] == ["coulomb", film.label]
    tried = moved_to(monkeypatch, base, coulomb=1.0)
    hypothesis_fits._from_nuisances_of_best(base, alone, limits)
    assert [label for label, *_ in tried] == ["coulomb"]


def test_effects_that_are_never_small_are_fitted_last_for_then_a_sufficient_one_may_end_them(analysed, monkeypatch):
    base, film = with_film(analysed[0], chi2=25.0)
    hypotheses = [film.hypothesis, *((candidate_of(label),) for label in ("spring", "coulomb"))]
    shortlist = [SimpleNamespace(hypothesis=hypothesis) for hypothesis in hypotheses]
    monkeypatch.setattr(hypothesis_fits, "shortlist_singles", lambda *args: shortlist)
    monkeypatch.setattr(hypothesis_fits, "_fit_each", lambda _, __, chosen, *rest: chosen)
    fitted = [single.hypothesis[0].label for single, _ in hypothesis_fits.fit_singles(base, *analysed[1:])]
    assert fitted == ["spring", "coulomb", film.label]


def test_effects_that_are_never_small_do_not_start_again_where_they_explain_little(analysed, monkeypatch):
    base, film = with_film(analysed[0], chi2=25.0)
    alone = [fit_of(base, "viscous", chi2=10.0, status=CONVERGED), film, fit_of(base, "coulomb", chi2=20.0)]
    tried = moved_to(monkeypatch, base, coulomb=9.99)
    hypothesis_fits._from_nuisances_of_best(base, alone, analysed[-1])
    assert [label for label, *_ in tried] == ["coulomb"]


@pytest.mark.parametrize(("left", "is_beside"), [(0.89, True), (0.91, False)])
def test_a_joint_is_searched_beside_an_effect_that_explains_a_tenth_of_the_misfit(analysed, left, is_beside):
    base = replace(analysed[0], base=fit_of(analysed[0], chi2=30.0))
    best = fit_of(base, "coulomb", chi2=1.0 + left * 29.0)
    alone = [fit_of(base, "spring", chi2=29.9), best, fit_of(base, "viscous", chi2=2.0, status=FAILED)]
    assert hypothesis_fits._origins(base, alone) == ([base.base, best] if is_beside else [base.base])


def changed_clearance(least_share, **changed):
    """A baseline of knocks by a clearance that has grown by half; what the first points have to explain is given."""
    model = knocking(clearance=1.5, seed=2)
    model = replace(model, candidates=(*model.candidates, LOOSER))
    settings = replace(DEFAULT_SETTINGS.rough_search, least_share_of_perturbations=least_share, **changed)
    return recalibrate(model, stated_noise(model), replace(DEFAULT_SETTINGS, rough_search=settings))


def test_changes_of_what_motion_depends_on_roughly_are_searched_if_the_first_points_explain_enough():
    base = changed_clearance(0.2)
    limits = SimpleNamespace(omnibus=1.1)
    (found,) = hypothesis_fits._search_perturbations(base, limits, np.inf)
    assert found.label == "looser" and found.chi2 < 1.1 * base.problem.size
    assert found.mapping["looser.change_mm"] == pytest.approx(0.5, rel=0.01)
    base = changed_clearance(0.9, reached_share=1.1)  # no point lies in a valley
    before = base.problem.simulations
    assert hypothesis_fits._search_perturbations(base, limits, np.inf) == []
    points = 2**DEFAULT_SETTINGS.rough_search.first_points_log2
    derivatives = 2 * len(base.base.parameters)  # simulations at most
    assert base.problem.simulations - before <= len(base.problem.runs) * (points + derivatives)


def test_a_first_point_in_a_valley_is_fitted_though_features_explain_little():
    base = changed_clearance(0.9)
    (found,) = hypothesis_fits._search_perturbations(base, SimpleNamespace(omnibus=1.1), np.inf)
    assert found.chi2 < 1.1 * base.problem.size


@pytest.mark.parametrize("doubted", [True, False])
def test_changes_are_searched_before_scattered_starts_but_not_of_doubted_data(analysed, monkeypatch, doubted):
    base, signatures, limits = analysed
    order = []
    monkeypatch.setattr(hypothesis_fits, "_search_perturbations", lambda *args: order.append("changes") or [])
    monkeypatch.setattr(hypothesis_fits, "_from_scattered_starts", lambda *args: order.append("scattered") or [])
    monkeypatch.setattr(hypothesis_fits, "_search_far", lambda *args: ([], []))
    fit_pairs(base, signatures, limits, [fit_of(base, "spring", chi2=6.0)], doubted=doubted)
    assert order == ([] if doubted else ["changes", "scattered"])


def test_what_features_lead_to_stands_for_what_samples_made_of_the_same_effects(analysed, monkeypatch):
    base, signatures, limits = analysed
    matched = fit_of(base, "spring", "coulomb", chi2=5.0, status=MATCHED)
    monkeypatch.setattr(hypothesis_fits, "search_pairs", lambda *args: [fit_of(base, "coulomb", "spring", chi2=4.0)])
    monkeypatch.setattr(hypothesis_fits, "_search_far", lambda *args: ([], [matched]))
    found, seconds = fit_pairs(base, signatures, limits, [fit_of(base, "quadratic", chi2=6.0)])
    assert [fit.status for fit in found if labels_of(fit.hypothesis) == {"spring", "coulomb"}] == [MATCHED]
    assert len(found) == len(seconds)


def test_a_search_over_statistics_simulates_fewer_runs_for_each_takes_longer():
    model = toy()
    of_statistics = replace(model, series=tuple(replace(one, statistic=True) for one in model.series))
    settings = DEFAULT_SETTINGS.selection
    for one, most in ((model, settings.max_simulations), (of_statistics, settings.max_simulations_of_statistics)):
        assert hypothesis_fits._max_simulations(Problem(one, stated_noise(one))) == most


@pytest.mark.parametrize(
    ("statistic", "doubted", "order"),
    [
        (False, False, ["pairs", "singles", "pairs"]),
        (True, False, ["singles", "pairs"]),
        (False, True, ["pairs"]),
        (True, True, ["pairs"]),
    ],
)
def test_pairs_come_first_beside_what_explains_half_but_last_where_motion_never_repeats_unless_data_are_doubted(
    monkeypatch, statistic, doubted, order
):
    model = toy({"viscous": {"damping_N_s_m": 0.8}}, seed=3)
    model = replace(model, series=tuple(replace(one, statistic=statistic) for one in model.series))
    base = recalibrate(model, stated_noise(model))
    signatures = simulate_signatures(base.problem, base.base, base.differences)
    limits, searched = thresholds(base.problem, signatures, other_numerics(base.problem, base.base)), []
    for name in ("singles", "pairs"):
        monkeypatch.setattr(hypothesis_fits, f"search_{name}", lambda *args, name=name: searched.append(name) or [])
    monkeypatch.setattr(hypothesis_fits, "is_law_of_family", lambda *args: False)
    half = fit_of(base, "spring", chi2=0.3 * base.base.chi2 / base.problem.size, status=CONVERGED)
    fit_pairs(base, signatures, limits, [half], doubted=doubted)
    assert searched == order


@pytest.mark.parametrize("doubted", [True, False])
def test_doubted_data_are_not_searched_beyond_what_derivatives_lead_to(analysed, monkeypatch, doubted):
    base, signatures, limits = analysed
    searched = []
    monkeypatch.setattr(hypothesis_fits, "_search_far", lambda *args: searched.append(args) or ([], []))
    monkeypatch.setattr(hypothesis_fits, "search_pairs", lambda *args: [])
    monkeypatch.setattr(hypothesis_fits, "is_law_of_family", lambda *args: False)
    fit_pairs(base, signatures, limits, [fit_of(base, "spring", chi2=6.0)], doubted=doubted)
    assert bool(searched) != doubted


def test_a_search_that_has_simulated_as_much_as_it_may_begins_nothing_new(analysed, monkeypatch):
    base, signatures, limits = analysed
    alone = [fit_of(base, "spring", chi2=6.0), fit_of(base, "coulomb", chi2=8.0)]

    def simulations() -> int:
        before = base.problem.simulations
        fit_pairs(base, signatures, limits, alone)
        return base.problem.simulations - before

    assert simulations() > 200
    monkeypatch.setattr(hypothesis_fits, "_max_simulations", lambda problem: -1)
    assert simulations() < 100  # steps of differences are found anew, and the laws of a family are tried
    monkeypatch.setattr(hypothesis_fits, "_max_simulations", lambda problem: 50)
    assert simulations() < 150  # a fit that has begun ends


@pytest.mark.parametrize("bias", [-0.03, 0.03])
def test_two_effects_that_mask_each_other_are_fitted_though_neither_is_sufficient_alone(bias):
    """Dry friction makes a torque with a mean, and a bias takes that away, or doubles it."""
    hidden = {"coulomb": {"force_N": 0.5}, "sensor_bias:torque": {"bias": bias}}
    model = toy(hidden, seed=3, channels=("torque",))
    base = recalibrate(model, stated_noise(model))
    signatures = simulate_signatures(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, signatures, other_numerics(base.problem, base.base))
    alone = [fit_hypothesis(base.problem, (candidate_of("spring"),), differences=base.differences)]
    found = min(fit_pairs(base, signatures, limits, alone)[0], key=lambda fit: fit.chi2)
    assert labels_of(found.hypothesis) == hidden.keys()
    assert found.chi2 < limits.omnibus * base.problem.size


def test_only_pairs_that_would_leave_a_twentieth_of_what_can_be_simulated_are_fitted_so_and_no_more_than_three():
    model = toy({"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}}, seed=1)
    base = recalibrate(model, stated_noise(model))
    signatures = simulate_signatures(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, signatures, other_numerics(base.problem, base.base))

    def chosen(base, *alone):
        return [pair.label for pair, _ in hypothesis_fits._masked_pairs(base, signatures, alone, limits)]

    assert chosen(base)[0] == "coulomb + spring"
    assert len(chosen(base)) <= DEFAULT_SETTINGS.selection.partners
    assert not any("spring" in label for label in chosen(base, fit_of(base, "spring", chi2=1.0, status=FAILED)))
    assert chosen(replace(base, base=fit_of(base, chi2=0.99))) == []


def test_where_a_single_effect_would_be_sufficient_no_pair_is_fitted_so(analysed):
    base, signatures, limits = analysed
    assert hypothesis_fits._masked_pairs(base, signatures, [], limits) == []
