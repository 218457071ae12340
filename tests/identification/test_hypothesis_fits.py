"""In which order hypotheses are fitted where no single effect is sufficient at first."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.identification import hypothesis_fits
from jointgap.identification.baseline import recalibrate
from jointgap.identification.fit import FAILED, STOPPED, fit_hypothesis
from jointgap.identification.hypothesis_fits import fit_pairs, fit_singles
from jointgap.identification.initial_fit import labels_of
from jointgap.identification.problem import Problem
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.identification.thresholds import screen_candidates
from tests.identification.oscillator import SPRING, SWING, WOBBLE, linear, noise_of
from tests.identification.toy import analysed, candidate_of, stated_noise, toy
from tests.rows import each

TWO = {"viscous": {"damping_N_s_m": 0.8}, "spring": {"stiffness_N_m": 3.0}}
DRY = {"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}}


@pytest.fixture(scope="module")
def one():
    """A hidden viscous friction, and the analysis before effects are fitted."""
    return analysed(toy({"viscous": {"damping_N_s_m": 0.8}}, seed=3))


def fit_of(base, *labels, chi2: float, status: str = STOPPED):
    """A fit of effects that leaves `chi2` for each sample."""
    hypothesis = tuple(map(candidate_of, labels))
    parameters = base.problem.parameters(hypothesis)
    values, residual = np.array([p.nominal for p in parameters]), np.full(base.problem.size, np.sqrt(chi2))
    jacobian = np.ones((base.problem.size, values.size))
    own = {"hypothesis": hypothesis, "parameters": parameters, "values": values}
    return replace(base.base, residual=residual, jacobian=jacobian, status=status, **own)


def replaced(monkeypatch, **functions):
    """Other functions of the search, which take what may come."""
    for name, function in functions.items():
        monkeypatch.setattr(hypothesis_fits, name, function)


def test_effects_that_are_never_small_are_fitted_last_for_then_a_sufficient_one_may_end_them(one, monkeypatch):
    base, signatures, limits = one
    film = replace(candidate_of("spring"), name="film", initial_guesses=({"stiffness_N_m": 2.0},))
    shortlist = [SimpleNamespace(hypothesis=(effect,)) for effect in (film, *map(candidate_of, ("spring", "coulomb")))]
    replaced(monkeypatch, shortlist_singles=lambda *_: shortlist, _fit_each=lambda _, chosen, *rest: chosen)
    fitted = fit_singles(replace(base, base=fit_of(base, chi2=30.0)), signatures, limits)
    assert [single.hypothesis[0].label for single, _ in fitted] == ["spring", "coulomb", film.label]


def test_a_search_that_has_simulated_as_much_as_it_may_begins_nothing_new(one, monkeypatch):
    base, signatures, limits = one
    alone = [fit_of(base, "spring", chi2=6.0), fit_of(base, "coulomb", chi2=8.0)]

    def simulations(most=None) -> int:
        if most is not None:
            replaced(monkeypatch, _max_simulations=lambda problem: most)
        before = base.problem.simulations
        fit_pairs(base, signatures, limits, alone)
        return base.problem.simulations - before

    model, settings = base.problem.model, DEFAULT_SETTINGS.selection
    of_statistics = replace(model, series=tuple(replace(series, statistic=True) for series in model.series))
    for data, most in ((model, settings.max_simulations), (of_statistics, settings.max_simulations_of_statistics)):
        assert hypothesis_fits._max_simulations(Problem(data, stated_noise(data))) == most
    assert simulations() > 200
    assert simulations(-1) < 100  # steps of differences are found anew, and the laws of a family are tried
    assert simulations(50) < 150  # a fit that has begun ends


@each("bias", [-0.03, 0.03])
def test_two_effects_that_mask_each_other_are_fitted_though_neither_is_sufficient_alone(bias):
    """Dry friction makes a torque with a mean, and a bias takes that away, or doubles it."""
    hidden = {"coulomb": {"force_N": 0.5}, "sensor_bias:torque": {"bias": bias}}
    base, signatures, limits = analysed(toy(hidden, seed=3, channels=("torque",)))
    alone = [fit_hypothesis(base.problem, (candidate_of("spring"),), differences=base.differences)]
    found = min(fit_pairs(base, signatures, limits, alone)[0], key=lambda fit: fit.chi2)
    assert labels_of(found.hypothesis) == hidden.keys()
    assert found.chi2 < limits.omnibus * base.problem.size


def test_only_pairs_that_would_leave_a_twentieth_of_what_can_be_simulated_are_fitted_so_and_no_more_than_three(one):
    base, signatures, limits = analysed(toy(DRY, seed=1))

    def chosen(base, *alone, signatures=signatures, limits=limits):
        return [pair.label for pair, _ in hypothesis_fits._masked_pairs(base, signatures, alone, limits)]

    assert chosen(base)[0] == "coulomb + spring"
    assert len(chosen(base)) <= DEFAULT_SETTINGS.selection.partners
    assert not any("spring" in label for label in chosen(base, fit_of(base, "spring", chi2=1.0, status=FAILED)))
    assert chosen(replace(base, base=fit_of(base, chi2=0.99))) == []
    assert chosen(one[0], signatures=one[1], limits=one[2]) == []  # a single effect would be sufficient


@each("hidden, masked", [(TWO, True), (DRY, True), (TWO, False)])
def test_two_effects_of_which_neither_is_sufficient_are_found_beside_each_other(hidden, masked, monkeypatch):
    """By pairs of the leading effects, too, where signatures about the base do not lead to them."""
    if not masked:
        replaced(monkeypatch, _masked_pairs=lambda *_: [])
    base, signatures, limits = analysed(toy(hidden, seed=3))
    alone, _ = fit_singles(base, signatures, limits)
    assert min(fit.chi2 for fit in alone) > limits.omnibus * base.problem.size
    found, seconds = fit_pairs(base, signatures, limits, alone)
    best = min(found, key=lambda fit: fit.bic)
    assert labels_of(best.hypothesis) == hidden.keys()
    assert best.chi2 < 1.1 * base.problem.size
    assert len({labels_of(fit.hypothesis) for fit in found}) == len(found) == len(seconds)


# Windows


@each("doubted", [True, False])
def test_windows_come_first_and_end_the_search_where_they_suffice_but_sizes_are_not_tried_on_doubted_data(
    one, monkeypatch, doubted
):
    base, signatures, limits = one
    viscous = fit_hypothesis(base.problem, (candidate_of("viscous"),), differences=base.differences, refresh=True)
    asked = []
    with monkeypatch.context() as patched:
        replaced(
            patched,
            search_in_windows=lambda *_, sizes=True: [viscous] if sizes else [],
            _masked_pairs=lambda *_: [],
            _pairs_of_leading=lambda *args: asked.append(args) or [],
        )
        found, _ = fit_pairs(base, signatures, limits, [fit_of(base, "spring", chi2=6.0)], doubted=doubted)
    assert any(fit is viscous for fit in found) != doubted
    assert bool(asked) == doubted
    # and for one effect that does alone what two do, where a pair is worth a fit: of one hypothesis the lowest counts
    alone, _ = fit_singles(base, signatures, limits)
    beside, pair = fit_of(base, "viscous", "spring", chi2=0.9), fit_of(base, "spring", "viscous", chi2=1.0)
    with monkeypatch.context() as patched:
        replaced(
            patched,
            _pairs_of_best=lambda *_: [("a pair", "its signatures")],
            _fit_each=lambda *_: ([pair], [2.0]),
            search_in_windows=lambda *_: [beside],
        )
        (found,), seconds = fit_pairs(base, signatures, limits, alone, doubted=doubted)
    assert found is (pair if doubted else beside) and len(seconds) == 1


def test_where_joints_are_loose_the_first_part_searches_for_all_in_windows_but_for_no_sizes_on_doubted_data():
    problem = linear(hidden={"swing": {"size": 0.3}, "wobble": {"size": 0.3}}, candidates=(SWING, WOBBLE, SPRING))
    base = recalibrate(problem.model, noise_of(problem))
    screening = screen_candidates(base, 0.01)
    limits = replace(screening.limits, omnibus=0.0)  # what leaves noise ends the search
    assert fit_singles(base, screening.signatures, limits) == ([], [])
    assert fit_pairs(base, screening.signatures, limits, [], part=1, parts=2) == ([], [])
    for doubted in (False, True):
        problem.model.filtered.clear()
        fits, seconds = fit_pairs(base, screening.signatures, limits, [], part=0, parts=2, doubted=doubted)
        assert labels_of(fits[0].hypothesis) == {"swing", "wobble"}
        assert all(fit.in_windows for fit in fits) and len(fits) == len(seconds)
        assert any("spring" in effects for _, effects, *_ in problem.model.filtered) != doubted
