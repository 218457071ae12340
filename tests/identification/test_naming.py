"""Identification from end to end on a closed-form mechanism."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.baseline import recalibrate
from jointgap.identification.decide import decide, verdict_of
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.screening import SensitivityRegression, SensitivitySubspaces
from jointgap.identification.thresholds import screen_candidates, thresholds
from jointgap.identification.verdict import Decision
from tests.identification.oscillator import (
    HIDDEN_SPRING,
    PULL,
    PUSH,
    SWING,
    WOBBLE,
    linear,
    noise_of,
)
from tests.identification.toy import RINGING, analysed, candidate_of, screened, searched, toy


def named(effects=None, more=(), **how) -> tuple[Decision, float]:
    """The decision and the gap of the base; `more`: further candidates."""
    model = toy(effects, **how)
    base, sensitivities, limits = analysed(replace(model, candidates=(*model.candidates, *more)))
    return decide(searched(base, sensitivities, limits)), base.problem.gap(base.base.residual)


def labels(decision):
    return {one.label for one in decision.chosen.hypothesis}


# Named


HIDDEN = {
    "coulomb": {"force_N": 0.2},
    "viscous": {"damping_N_s_m": 0.15},
    "quadratic": {"drag_N_s2_m2": 0.1},
    "constant_force": {"force_N": 0.2},
    "spring": {"stiffness_N_m": 3.0},
    "added_mass": {"mass_kg": 0.1},
    "centrifugal": {"mass_kg": 0.02},
    "harmonic_force": {"cosine_N": 0.15, "sine_N": 0.1, "frequency_Hz": 4.7},
    "sensor_bias:torque": {"bias": 0.02},
    # another crank's length would read so, too
    "sensor_gain:acceleration": {"gain_error": 0.05},
    "sensor_lag:torque": {"lag_s": 2e-3},
}
QUICK = ("quadratic", "added_mass", "harmonic_force", "sensor_lag:torque")


def integration_unless(quick, cases):
    """Parameters of which only the quick ones are in the fast suite."""
    marks = [pytest.mark.integration]
    return [case if case in quick else pytest.param(case, marks=marks) for case in cases]


@pytest.mark.parametrize("label", integration_unless(QUICK, HIDDEN))
def test_each_effect_is_named(label):
    decision, gap = named({label: HIDDEN[label]}, seed=11)
    assert gap > 1.05
    assert (decision.verdict, decision.chosen.label) == ("named", label)
    if label == "added_mass":  # beyond its range
        assert decision.chosen.mapping["added_mass.mass_kg"] == pytest.approx(0.1, rel=0.05)


def test_an_effect_is_named_next_to_a_nonsmooth_candidate():
    decision, _ = named({"coulomb": {"force_N": 0.3}}, more=[RINGING], seed=4)
    assert (decision.verdict, decision.chosen.label) == ("named", "coulomb")


def test_two_effects_are_named_without_a_third():
    base, sensitivities, limits = analysed(
        toy({"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}}, seed=1)
    )
    decision = decide(searched(base, sensitivities, limits))
    assert (decision.verdict, labels(decision)) == ("named", {"coulomb", "spring"})
    pair = candidate_of("coulomb"), candidate_of("spring")
    fits = [fit_hypothesis(base.problem, effects) for effects in (pair, pair[::-1])]
    decision = verdict_of(base, base.base, fits[:1], sensitivities, limits)
    assert (decision.verdict, len(decision.ranking)) == ("named", 1)


@pytest.mark.parametrize(
    "hidden, candidates, how",
    [
        ({}, (SWING, WOBBLE), {}),
        ({"swing": {"size": 0.3}, "wobble": {"size": 0.3}}, (SWING, WOBBLE, PULL), {}),
        ({"push": {"size": 0.3}}, (SWING, PUSH), {"drive": 0.2, "bounds": (0.0, 0.25)}),
        ({"spring": {"size": 0.3, "damping": 0.1}}, (SWING, HIDDEN_SPRING), {}),
    ],
)
def test_forces_are_named_from_whole_runs_and_a_clearance_from_windows(hidden, candidates, how):
    problem = linear(
        hidden=hidden,
        candidates=candidates,
        deviance=lambda effects: 0.0 if effects else 1.0,
        **how,
    )
    base = recalibrate(problem.model, noise_of(problem))
    sensitivities, limits = screen_candidates(base, 0.01)
    decision = decide(searched(base, sensitivities, limits))
    assert decision.verdict == ("named" if hidden else "parameters_only")
    assert labels(decision) == hidden.keys()
    assert decision.chosen.in_windows == ("spring" in hidden)
    assert not base.base.in_windows and not base.nominal.in_windows
    assert [p.key for p in base.nominal.parameters] == ["zero@slow", "zero@fast"]
    assert base.base.chi2 < base.nominal.chi2
    found, errors = decision.chosen.mapping, np.sqrt(np.diag(decision.chosen.covariance()))
    errors = dict(zip(found, errors, strict=True))
    for key, value in ((f"{name}.{key}", at[key]) for name, at in hidden.items() for key in at):
        assert abs(found[key] - value) < 4.0 * errors[key] < 0.05


# Not named


@pytest.mark.parametrize("seed", integration_unless([0], range(4)))
def test_nothing_is_found_in_null_campaigns(seed):
    assert named(seed=seed)[0].verdict == "no_disagreement"


@pytest.mark.parametrize("seed", integration_unless([0], range(3)))
def test_parameters_within_their_ranges_are_no_effect(seed):
    decision, _ = named(nuisances={"slider_mass": 0.515}, seed=seed)
    assert decision.verdict == "parameters_only"
    assert decision.chosen.mapping["slider_mass"] == pytest.approx(0.515, abs=0.01)


def test_at_one_speed_a_spring_and_a_centrifugal_force_are_ambiguous():
    speeds = {"one": 10.0, "fast": 24.0}
    decision, _ = named(
        {"spring": {"stiffness_N_m": 5.0}}, seed=2, speeds=speeds, held_out=("fast",)
    )
    assert decision.verdict == "ambiguous"
    assert {"spring", "centrifugal"} <= {fit.label for fit in decision.equivalent}


def cubic(x, v, angle, time):
    return -0.3 * v**3


def stribeck(x, v, angle, time):
    return -2.5 * np.tanh(v / 0.01) * np.exp(-((v / 0.5) ** 2))


@pytest.mark.parametrize(
    "law, seed", [(cubic, 0), pytest.param(stribeck, 1, marks=pytest.mark.integration)]
)
def test_an_unlisted_effect_is_not_named(law, seed):
    decision, gap = named(hidden=law, seed=seed)
    assert gap > 1.5
    assert decision.verdict == "unexplained" and decision.because


def test_thresholds_have_their_rate_and_include_numerical_differences():
    base, sensitivities = screened(toy(seed=5))
    nothing = np.empty((0, base.problem.size))
    more = 0.3 * sensitivities.of("quadratic")[0].columns.T
    white, loose = (
        thresholds(base.problem, sensitivities, changed, rate=0.05) for changed in (nothing, more)
    )
    assert loose.max_gain_threshold > white.max_gain_threshold and loose.omnibus > white.omnibus
    dof = base.problem.size - len(base.base.parameters)
    exceeded = np.mean(np.random.default_rng(9).chisquare(dof, 20_000) / dof > white.omnibus)
    assert 0.03 < exceeded < 0.07


# Where a fit begins


@pytest.mark.parametrize(
    "label, key, guesses, size",
    [
        ("quadratic", "drag_N_s2_m2", ({"drag_N_s2_m2": 0.2},), 0.15),
        ("quadratic", "drag_N_s2_m2", ({"drag_N_s2_m2": 0.2},), 0.35),
        ("sensor_bias:torque", "bias", ({}, {"bias": -0.016}), -0.02),
        ("sensor_bias:torque", "bias", ({}, {"bias": 0.012}), 0.015),
    ],
)
def test_a_fit_from_a_finite_size_starts_at_the_secant_estimate(label, key, guesses, size):
    guessed = replace(candidate_of(label), initial_guesses=guesses)
    _, sensitivities = screened(replace(toy({label: {key: size}}, seed=2), candidates=(guessed,)))
    secants = [entry for entry in sensitivities.entries if entry.is_secant]
    assert [entry.is_secant for entry in sensitivities.entries] == [
        bool(guess) for guess in guesses
    ]
    (single,) = SensitivityRegression(replace(sensitivities, entries=secants)).singles()
    assert single.start[f"{label}.{key}"] == pytest.approx(size, rel=0.1)
    # a start adds no direction to the candidate's sensitivity subspace
    assert len(SensitivitySubspaces(sensitivities).of[label]) == 1


@pytest.mark.parametrize(
    "amplitudes, start, searched, bounds, message",
    [
        (("a", "b"), {"a": 1.0}, (), (), "single amplitude"),
        (("a",), {"a": 0.0}, (), (), "single amplitude"),
        (("a",), {}, (-1.0, 1.0), (), "single amplitude"),
        (("a", "b"), {}, (1.0, 1.35), (), "single amplitude"),
        (("a",), {}, (-1.0, 2.0), (-1.0, 2.0), "above -1"),
        (("a",), {}, (), (-1.0,), "finite bounds"),
    ],
)
def test_a_search_range_needs_one_amplitude(amplitudes, start, searched, bounds, message):
    with pytest.raises(ValueError, match=message):
        searched_effect(amplitudes, start, searched, *bounds)


def searched_effect(amplitudes, start, searched, low=-np.inf, high=np.inf):
    coordinates = tuple(Parameter(key, 0.0, low, high) for key in amplitudes)
    keys = {"search_range": searched, "is_perturbation": bool(np.isfinite(low))}
    return Candidate("odd", "slider", coordinates, amplitudes, (start,), **keys)


def test_a_searched_perturbation_vanishes_at_its_lower_bound():
    assert searched_effect(("a",), {}, (-0.9, 2.0), -1.0, 2.0).vanishing_amplitude == -1.0
