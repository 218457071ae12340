"""In which order hypotheses are fitted where no single effect is sufficient at first."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.identification import hypothesis_fits
from jointgap.identification.baseline import other_numerics, recalibrate
from jointgap.identification.fit import FAILED, STOPPED, fit_hypothesis
from jointgap.identification.hypothesis_fits import fit_pairs, fit_singles
from jointgap.identification.initial_fit import labels_of
from jointgap.identification.problem import Problem
from jointgap.identification.screening import simulate_sensitivities
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.thresholds import screen_candidates, thresholds
from tests.identification.oscillator import SPRING, SWING, WOBBLE, linear
from tests.identification.toy import candidate_of, stated_noise, toy


@pytest.fixture(scope="module")
def analysed():
    """A hidden viscous friction, and the analysis up to the fits of single effects."""
    model = toy({"viscous": {"damping_N_s_m": 0.8}}, seed=3)
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    return base, sensitivities, thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))


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


def with_film(base, chi2: float):
    """A base that leaves 30 for each sample, and a film, which is never small, that leaves `chi2`."""
    film = replace(candidate_of("spring"), name="film", initial_guesses=({"stiffness_N_m": 2.0},))
    return replace(base, base=fit_of(base, chi2=30.0)), replace(fit_of(base, "spring", chi2=chi2), hypothesis=(film,))


def test_effects_that_are_never_small_are_fitted_last_for_then_a_sufficient_one_may_end_them(analysed, monkeypatch):
    base, film = with_film(analysed[0], chi2=25.0)
    hypotheses = [film.hypothesis, *((candidate_of(label),) for label in ("spring", "coulomb"))]
    shortlist = [SimpleNamespace(hypothesis=hypothesis) for hypothesis in hypotheses]
    monkeypatch.setattr(hypothesis_fits, "shortlist_singles", lambda *args: shortlist)
    monkeypatch.setattr(hypothesis_fits, "_fit_each", lambda _, chosen, *rest: chosen)
    fitted = [single.hypothesis[0].label for single, _ in hypothesis_fits.fit_singles(base, *analysed[1:])]
    assert fitted == ["spring", "coulomb", film.label]


def test_a_search_over_statistics_simulates_fewer_runs_for_each_takes_longer():
    model = toy()
    of_statistics = replace(model, series=tuple(replace(one, statistic=True) for one in model.series))
    settings = DEFAULT_SETTINGS.selection
    for one, most in ((model, settings.max_simulations), (of_statistics, settings.max_simulations_of_statistics)):
        assert hypothesis_fits._max_simulations(Problem(one, stated_noise(one))) == most


def test_a_search_that_has_simulated_as_much_as_it_may_begins_nothing_new(analysed, monkeypatch):
    base, sensitivities, limits = analysed
    alone = [fit_of(base, "spring", chi2=6.0), fit_of(base, "coulomb", chi2=8.0)]

    def simulations() -> int:
        before = base.problem.simulations
        fit_pairs(base, sensitivities, limits, alone)
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
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))
    alone = [fit_hypothesis(base.problem, (candidate_of("spring"),), differences=base.differences)]
    found = min(fit_pairs(base, sensitivities, limits, alone)[0], key=lambda fit: fit.chi2)
    assert labels_of(found.hypothesis) == hidden.keys()
    assert found.chi2 < limits.omnibus * base.problem.size


def test_only_pairs_that_would_leave_a_twentieth_of_what_can_be_simulated_are_fitted_so_and_no_more_than_three():
    model = toy({"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}}, seed=1)
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))

    def chosen(base, *alone):
        return [pair.label for pair, _ in hypothesis_fits._masked_pairs(base, sensitivities, alone, limits)]

    assert chosen(base)[0] == "coulomb + spring"
    assert len(chosen(base)) <= DEFAULT_SETTINGS.selection.partners
    assert not any("spring" in label for label in chosen(base, fit_of(base, "spring", chi2=1.0, status=FAILED)))
    assert chosen(replace(base, base=fit_of(base, chi2=0.99))) == []


def test_where_a_single_effect_would_be_sufficient_no_pair_is_fitted_so(analysed):
    base, sensitivities, limits = analysed
    assert hypothesis_fits._masked_pairs(base, sensitivities, [], limits) == []


@pytest.mark.parametrize(
    "hidden",
    [
        {"viscous": {"damping_N_s_m": 0.8}, "spring": {"stiffness_N_m": 3.0}},
        {"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}},
    ],
)
def test_two_effects_of_which_neither_is_sufficient_are_found_beside_each_other(hidden):
    model = toy(hidden, seed=3)
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))
    alone, _ = fit_singles(base, sensitivities, limits)
    assert min(fit.chi2 for fit in alone) > limits.omnibus * base.problem.size
    found, seconds = fit_pairs(base, sensitivities, limits, alone)
    best = min(found, key=lambda fit: fit.bic)
    assert {candidate.label for candidate in best.hypothesis} == hidden.keys()
    assert best.chi2 < 1.1 * base.problem.size
    assert len({labels_of(fit.hypothesis) for fit in found}) == len(found) == len(seconds)


def test_pairs_of_the_leading_effects_find_what_signatures_about_the_base_do_not(analysed, monkeypatch):
    model = toy({"viscous": {"damping_N_s_m": 0.8}, "spring": {"stiffness_N_m": 3.0}}, seed=3)
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    monkeypatch.setattr(hypothesis_fits, "_masked_pairs", lambda *args: [])
    alone, _ = fit_singles(base, sensitivities, analysed[-1])
    found, _ = fit_pairs(base, sensitivities, analysed[-1], alone)
    best = min(found, key=lambda fit: fit.bic)
    assert {candidate.label for candidate in best.hypothesis} == {"viscous", "spring"}


@pytest.mark.parametrize("doubted", [True, False])
def test_windows_come_first_and_end_the_search_where_they_suffice_but_sizes_are_not_tried_on_doubted_data(
    analysed, monkeypatch, doubted
):
    base, sensitivities, limits = analysed
    viscous = fit_hypothesis(base.problem, (candidate_of("viscous"),), differences=base.differences, refresh=True)
    monkeypatch.setattr(hypothesis_fits, "search_in_windows", lambda *args, sizes=True: [viscous] if sizes else [])
    monkeypatch.setattr(hypothesis_fits, "_masked_pairs", lambda *args: [])
    asked = []
    monkeypatch.setattr(hypothesis_fits, "_pairs_of_leading", lambda *args: asked.append(args) or [])
    found, _ = fit_pairs(base, sensitivities, limits, [fit_of(base, "spring", chi2=6.0)], inconsistent=doubted)
    assert any(fit is viscous for fit in found) != doubted
    assert bool(asked) == doubted


@pytest.mark.parametrize("doubted", [True, False])
def test_where_a_pair_is_worth_a_fit_windows_are_asked_for_one_effect_that_does_alone_what_two_do(
    analysed, monkeypatch, doubted
):
    base, sensitivities, limits = analysed
    alone, _ = fit_singles(base, sensitivities, limits)
    beside = fit_of(base, "viscous", "spring", chi2=0.9)
    monkeypatch.setattr(hypothesis_fits, "_pairs_of_best", lambda *args: [("a pair", "its signatures")])
    pair = fit_of(base, "spring", "viscous", chi2=1.0)
    monkeypatch.setattr(hypothesis_fits, "_fit_each", lambda *args: ([pair], [2.0]))
    monkeypatch.setattr(hypothesis_fits, "search_in_windows", lambda *args: [beside])
    (found,), seconds = fit_pairs(base, sensitivities, limits, alone, inconsistent=doubted)
    assert found is (pair if doubted else beside)  # of one hypothesis the lowest fit
    assert len(seconds) == 1


def test_where_joints_are_loose_the_first_part_searches_for_all_in_windows_but_for_no_sizes_on_doubted_data():
    problem = linear(hidden={"swing": {"size": 0.3}, "wobble": {"size": 0.3}}, candidates=(SWING, WOBBLE, SPRING))
    base = recalibrate(problem.model, {part.series.key: part.noise for part in problem.parts})
    screening = screen_candidates(base, 0.01)
    # what leaves noise ends the search
    limits = replace(screening.limits, omnibus=0.0)
    assert fit_singles(base, screening.sensitivities, limits) == ([], [])
    assert fit_pairs(base, screening.sensitivities, limits, [], part=1, parts=2) == ([], [])
    for doubted in (False, True):
        problem.model.filtered.clear()
        fits, seconds = fit_pairs(base, screening.sensitivities, limits, [], part=0, parts=2, inconsistent=doubted)
        assert labels_of(fits[0].hypothesis) == {"swing", "wobble"}
        assert all(fit.in_windows for fit in fits) and len(fits) == len(seconds)
        assert any("spring" in effects for _, effects, *_ in problem.model.filtered) != doubted
