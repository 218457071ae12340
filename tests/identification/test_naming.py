"""Naming from end to end on a mechanism in closed form: the right name, no name, or an honest doubt."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.baseline import other_numerics, recalibrate
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.hypothesis_fits import fit_pairs, fit_singles
from jointgap.identification.initial_fit import fit_screened
from jointgap.identification.model_selection import (
    nonlinearity,
    refit_and_decide,
    second_effect_gain,
    select_hypothesis,
    shortlist_singles,
    swap_one_effect,
    two_effect_thresholds,
)
from jointgap.identification.problem import Problem
from jointgap.identification.screening import SensitivityRegression, SensitivitySubspaces, simulate_sensitivities
from jointgap.identification.thresholds import screen_candidates, thresholds
from jointgap.identification.verdict import Decision
from tests.identification.oscillator import PULL, PUSH, SPRING, SWING, WOBBLE, linear
from tests.identification.toy import CANDIDATES, RINGING, Toy, stated_noise, toy


def named(effects=None, more=(), **how) -> tuple[Decision, float]:
    """The decision and the gap of the recalibrated base; `more`: further candidates."""
    model = toy(effects, **how)
    model = replace(model, candidates=(*model.candidates, *more))
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))
    fits, _ = fit_singles(base, sensitivities, limits)
    fits = [*fits, *fit_pairs(base, sensitivities, limits, fits)[0]]
    fits += swap_one_effect(base, sensitivities, fits)
    return refit_and_decide(base, sensitivities, fits, limits), base.problem.gap(base.base.residual)


HIDDEN = {
    "coulomb": {"force_N": 0.2},
    "viscous": {"damping_N_s_m": 0.15},
    "quadratic": {"drag_N_s2_m2": 0.1},
    "constant_force": {"force_N": 0.2},
    "spring": {"stiffness_N_m": 3.0},
    "centrifugal": {"mass_kg": 0.02},
    "harmonic_force": {"cosine_N": 0.15, "sine_N": 0.1, "frequency_Hz": 4.7},
    "sensor_bias:torque": {"bias": 0.02},
    "sensor_gain:acceleration": {"gain_error": 0.05},
    "sensor_lag:torque": {"lag_s": 2e-3},
}


@pytest.mark.parametrize("label", HIDDEN)
def test_each_effect_is_named(label):
    decision, gap = named({label: HIDDEN[label]}, seed=11)
    assert gap > 1.05
    assert decision.verdict == "named"
    assert decision.chosen.label == label


@pytest.mark.parametrize("size", [0.15, 0.2, 0.35])
def test_a_fit_from_a_finite_size_begins_at_the_size_that_the_secant_says(size):
    law = next(one for one in CANDIDATES if one.label == "quadratic")
    finite = replace(law, initial_guesses=({"drag_N_s2_m2": 0.2},))
    model = toy(hidden=lambda x, v, angle, time: -size * v * np.abs(v), seed=2)
    model = replace(model, candidates=(finite,))
    base = recalibrate(model, stated_noise(model))
    (found,) = SensitivityRegression(simulate_sensitivities(base.problem, base.base, base.differences)).singles()
    assert found.start["quadratic.drag_N_s2_m2"] == pytest.approx(size, rel=0.1)


@pytest.mark.parametrize("size", [-0.02, -0.01, 0.015])
def test_a_fit_may_begin_at_a_told_size_of_either_sign(size):
    bias = next(one for one in CANDIDATES if one.label == "sensor_bias:torque")
    told = replace(bias, initial_guesses=({}, {"bias": 0.8 * size}))
    model = replace(toy({"sensor_bias:torque": {"bias": size}}, seed=2), candidates=(told,))
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    assert [one.is_secant for one in sensitivities.entries] == [False, True]
    alone = replace(sensitivities, entries=[one for one in sensitivities.entries if one.is_secant])
    (found,) = SensitivityRegression(alone).singles()
    assert found.start["sensor_bias:torque.bias"] == pytest.approx(size, rel=0.1)


@pytest.mark.parametrize(
    ("sizes", "starts", "searched"),
    [
        (("a", "b"), {"a": 1.0}, ()),
        (("a",), {"a": 0.0}, ()),
        (("a",), {}, (-1.0, 1.0)),
        (("a", "b"), {}, (1.0, 1.35)),
    ],
)
def test_finite_starts_are_of_a_single_size_that_is_not_zero_and_searches_above_it(sizes, starts, searched):
    with pytest.raises(ValueError, match="single amplitude"):
        Candidate("odd", "slider", tuple(Parameter(key, 0.0) for key in sizes), sizes, (starts,), search_range=searched)


def test_what_is_told_of_the_size_of_an_effect_makes_it_no_other_effect():
    """Where a fit starts too is no further thing that a candidate can change."""
    bias = next(one for one in CANDIDATES if one.label == "sensor_bias:torque")
    model = toy(seed=2)
    spaces = []
    for told in (bias, replace(bias, initial_guesses=({}, {"bias": 0.01}))):
        own = replace(model, candidates=(told,))
        base = recalibrate(own, stated_noise(own))
        spaces.append(SensitivitySubspaces(simulate_sensitivities(base.problem, base.base, base.differences)))
    assert [len(each.of["sensor_bias:torque"]) for each in spaces] == [1, 1]


def test_the_change_of_something_known_is_searched_where_something_is_left_of_it():
    size = Parameter("change", 0.0, low=-1.0, high=2.0)
    searched = Candidate("odd", "slider", (size,), ("change",), is_perturbation=True, search_range=(-0.9, 2.0))
    assert searched.vanishing_amplitude == -1.0
    with pytest.raises(ValueError, match="above -1"):
        replace(searched, search_range=(-1.0, 2.0))


def test_the_change_of_something_known_has_finite_bounds():
    with pytest.raises(ValueError, match="finite bounds"):
        Candidate("odd", "slider", (Parameter("change", 0.0, low=-1.0),), ("change",), is_perturbation=True)


def test_another_choice_of_numerics_is_no_second_effect():
    """What changes with the width of friction at rest is about as much as a second effect may then have to gain."""
    model = toy({"coulomb": {"force_N": 30.0}}, seed=1)
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))
    fits = [
        fit_screened(base.problem, base.differences, sensitivities, one)
        for one in shortlist_singles(sensitivities, limits)
    ]
    best = min(fits, key=lambda one: one.chi2)
    assert best.label == "coulomb"
    changed = np.sum(other_numerics(base.problem, best) ** 2)
    second = two_effect_thresholds(base, fits, limits)
    assert second.omnibus == pytest.approx(limits.omnibus + second.max_gain_threshold / best.residual.size)
    assert 0.5 * changed < second.max_gain_threshold <= changed
    assert limits.max_gain_threshold < second.max_gain_threshold


def test_such_an_effect_is_not_named_where_another_is_hidden():
    decision, _ = named({"coulomb": {"force_N": 0.3}}, more=[RINGING], seed=4)
    assert decision.verdict == "named"
    assert decision.chosen.label == "coulomb"


def test_where_nothing_is_missing_hardly_anything_is_fitted():
    model = toy(seed=0)
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))
    assert len(shortlist_singles(sensitivities, limits)) <= 3


def test_a_gain_of_one_sensor_alone_hides_behind_a_length_within_its_range():
    """A crank 1 % longer reads 1 % more acceleration; the other channels say that it is the sensor."""
    decision, _ = named({"sensor_gain:acceleration": {"gain_error": 0.05}}, seed=3)
    assert decision.chosen.label == "sensor_gain:acceleration"


@pytest.mark.parametrize("seed", range(8))
def test_nothing_hidden_is_nothing_found(seed):
    decision, _ = named(seed=seed)
    assert decision.verdict == "no_disagreement"


@pytest.mark.parametrize("seed", range(4))
def test_parameters_off_nominal_within_their_ranges_are_no_effect(seed):
    decision, _ = named(nuisances={"slider_mass": 0.515}, seed=seed)
    assert decision.verdict == "parameters_only"
    assert decision.chosen.mapping["slider_mass"] == pytest.approx(0.515, abs=0.01)


def test_a_mass_beyond_its_range_is_an_effect_with_its_value_beyond_nominal():
    decision, _ = named({"added_mass": {"mass_kg": 0.1}}, seed=0)
    assert decision.verdict == "named"
    assert decision.chosen.mapping["added_mass.mass_kg"] == pytest.approx(0.1, rel=0.05)


def test_both_of_two_effects_are_named_and_no_third():
    decision, _ = named({"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}}, seed=1)
    assert decision.verdict == "named"
    assert {c.label for c in decision.chosen.hypothesis} == {"coulomb", "spring"}


def test_at_one_speed_a_spring_is_not_told_from_a_force_that_grows_with_speed():
    decision, _ = named(
        {"spring": {"stiffness_N_m": 5.0}}, seed=2, speeds={"one": 10.0, "fast": 24.0}, held_out=("fast",)
    )
    assert decision.verdict == "ambiguous"
    assert {"spring", "centrifugal"} <= {fit.label for fit in decision.equivalent}


@pytest.mark.parametrize(
    "law",
    [
        lambda x, v, angle, time: -0.3 * v**3,
        lambda x, v, angle, time: -2.5 * np.tanh(v / 0.01) * np.exp(-((v / 0.5) ** 2)),
    ],
    ids=["cubic", "stribeck"],
)
@pytest.mark.parametrize("seed", range(3))
def test_an_effect_that_is_on_no_list_gets_no_name(law, seed):
    decision, gap = named(hidden=law, seed=seed)
    assert gap > 1.5
    assert decision.verdict == "unexplained"
    assert decision.because


def test_thresholds_hold_their_rate_and_know_of_other_numerics():
    model = toy(seed=5)
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    white = thresholds(base.problem, sensitivities, np.empty((0, base.problem.size)), rate=0.05)
    loose = thresholds(base.problem, sensitivities, 0.3 * sensitivities.of("quadratic")[0].columns.T, rate=0.05)
    assert loose.max_gain_threshold > white.max_gain_threshold and loose.omnibus > white.omnibus
    generator = np.random.default_rng(9)
    dof = base.problem.size - len(base.base.parameters)
    exceeded = np.mean(generator.chisquare(dof, 20_000) / dof > white.omnibus)
    assert 0.03 < exceeded < 0.07


def test_a_pair_in_another_order_is_no_rival():
    model = toy({"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}}, seed=1)
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))
    labelled = {candidate.label: candidate for candidate in model.candidates}
    pair = labelled["coulomb"], labelled["spring"]
    decision = refit_and_decide(
        base, sensitivities, [fit_hypothesis(base.problem, pair), fit_hypothesis(base.problem, pair[::-1])], limits
    )
    assert decision.verdict == "named"
    assert len(decision.ranking) == 1


@dataclass(frozen=True)
class Stepping(Toy):
    """The toy with a torque that is larger where the slider is heavier than `limit`."""

    limit: float = 0.5
    step: float = 0.05  # of the torque's standard deviation

    def simulate(self, run, values, effects=(), numerics=0):
        """What the sensors read."""
        read = dict(super().simulate(run, values, effects, numerics))
        if values["slider_mass"] > self.limit:
            read["torque"] = read["torque"] + self.step * np.std(read["torque"])
        return read


def stepping(model: Toy, limit: float) -> Stepping:
    return Stepping(model.series, model.nuisances, model.candidates, model.speeds, limit=limit)


def test_what_residuals_to_one_side_foretell_of_the_other_holds_where_they_are_linear_and_not_across_a_jump():
    smooth = toy(seed=1)
    for model, least, most in ((smooth, 0.0, 1e-6), (stepping(smooth, 0.5), 0.9, 1.1)):
        problem = Problem(model, stated_noise(model))
        mass = next(p for p in problem.nuisances if p.name == "slider_mass")
        fitted_mass = fit_hypothesis(problem, refresh=True, vary=[mass])
        here = problem.residual({"slider_mass": 0.5})
        found = replace(fitted_mass, values=np.array([0.5]), residual=here)
        error = float(np.sqrt(found.covariance()[0, 0]))
        beyond = problem.residual({"slider_mass": 0.5 + error})
        foretold = 2.0 * here - problem.residual({"slider_mass": 0.5 - error})
        jump = float(beyond @ beyond - foretold @ foretold)
        assert least * abs(jump) <= nonlinearity(problem, found) <= most * max(abs(jump), 1.0)


def test_where_the_motion_jumps_an_effect_is_named_that_would_be_and_none_is_added():
    effects = {"viscous": {"damping_N_s_m": 0.03}}
    smooth = toy(effects, seed=11)
    problem = Problem(smooth, stated_noise(smooth))
    viscous = tuple(one for one in smooth.candidates if one.label == "viscous")
    found = fit_hypothesis(problem, viscous, refresh=True)
    place = [p.key for p in found.parameters].index("slider_mass")
    model = stepping(smooth, found.values[place] + 0.5 * np.sqrt(found.covariance()[place, place]))
    base = recalibrate(model, stated_noise(model))
    sensitivities = simulate_sensitivities(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, sensitivities, other_numerics(base.problem, base.base))
    fits, _ = fit_singles(base, sensitivities, limits)
    second = two_effect_thresholds(base, fits, limits)
    assert second_effect_gain(base.problem, fits, second) > 5.0 * limits.max_gain_threshold
    decision = refit_and_decide(base, sensitivities, [*fits, *fit_pairs(base, sensitivities, limits, fits)[0]], limits)
    assert decision.verdict == "named"
    assert decision.chosen.label == "viscous"


@pytest.mark.parametrize(
    ("hidden", "candidates", "how"),
    [
        ({}, (SWING, WOBBLE, PULL), {}),
        ({"swing": {"size": 0.03}}, (SWING, WOBBLE, PULL), {}),
        ({"swing": {"size": 0.3}}, (SWING, WOBBLE, PULL), {}),
        ({"swing": {"size": 0.3}, "wobble": {"size": 0.3}}, (SWING, WOBBLE, PULL), {}),
        ({"push": {"size": 0.3}}, (SWING, PUSH), {"drive": 0.2, "bounds": (0.0, 0.25)}),
        ({"spring": {"size": 0.3, "damping": 0.1}}, (SWING, SPRING), {}),
    ],
    ids=["nothing", "a_small_one", "a_large_one", "two", "a_nuisance_beyond_its_bounds", "a_size_that_is_searched"],
)
def test_where_joints_are_loose_all_is_named_from_windows_without_simulating_one_trajectory(hidden, candidates, how):
    problem = linear(hidden=hidden, candidates=candidates, **how)
    problem.model.simulate = None
    base = recalibrate(problem.model, {part.series.key: part.noise for part in problem.parts})
    sensitivities, limits = screen_candidates(base, 0.01)
    fits, _ = fit_singles(base, sensitivities, limits)
    fits = [*fits, *fit_pairs(base, sensitivities, limits, fits)[0]]
    decision = select_hypothesis(base, sensitivities, fits, limits)
    assert decision.verdict == ("named" if hidden else "parameters_only")
    assert {one.name for one in decision.chosen.hypothesis} == hidden.keys()
    found, errors = decision.chosen.mapping, np.sqrt(np.diag(decision.chosen.covariance()))
    errors = dict(zip(found, errors, strict=True))
    for name, true in hidden.items():
        for key, value in true.items():
            assert abs(found[f"{name}.{key}"] - value) < 4.0 * errors[f"{name}.{key}"] < 0.05
