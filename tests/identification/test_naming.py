"""Naming from end to end on a mechanism in closed form: the right name, no name, or an honest
doubt."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.baseline import recalibrate
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.model_selection import (
    refit_and_decide,
    select_hypothesis,
    swap_one_effect,
)
from jointgap.identification.screening import SensitivityRegression, SensitivitySubspaces
from jointgap.identification.thresholds import screen_candidates, thresholds
from jointgap.identification.verdict import Decision
from tests.catalogue import each, refused
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
    """The decision and the gap of the recalibrated base; `more`: further candidates."""
    model = toy(effects, **how)
    base, sensitivities, limits = analysed(replace(model, candidates=(*model.candidates, *more)))
    fits = searched(base, sensitivities, limits)
    fits += swap_one_effect(base, sensitivities, fits)
    return refit_and_decide(base, sensitivities, fits, limits), base.problem.gap(base.base.residual)


def labels(decision):
    return {one.label for one in decision.chosen.hypothesis}


# Named


def test_each_effect_is_named():
    def check(label, values):
        decision, gap = named({label: values}, seed=11)
        assert gap > 1.05
        assert (decision.verdict, decision.chosen.label) == ("named", label)
        if label == "added_mass":  # beyond its range
            assert decision.chosen.mapping["added_mass.mass_kg"] == pytest.approx(0.1, rel=0.05)

    each(
        check,
        [
            ("coulomb", {"force_N": 0.2}),
            ("viscous", {"damping_N_s_m": 0.15}),
            ("quadratic", {"drag_N_s2_m2": 0.1}),
            ("constant_force", {"force_N": 0.2}),
            ("spring", {"stiffness_N_m": 3.0}),
            ("added_mass", {"mass_kg": 0.1}),
            ("centrifugal", {"mass_kg": 0.02}),
            ("harmonic_force", {"cosine_N": 0.15, "sine_N": 0.1, "frequency_Hz": 4.7}),
            ("sensor_bias:torque", {"bias": 0.02}),
            (
                "sensor_gain:acceleration",
                {"gain_error": 0.05},
            ),  # another crank's length would read so, too
            ("sensor_lag:torque", {"lag_s": 2e-3}),
        ],
    )
    decision, _ = named(
        {"coulomb": {"force_N": 0.3}}, more=[RINGING], seed=4
    )  # which no slope leads to
    assert (decision.verdict, decision.chosen.label) == ("named", "coulomb")


def test_both_of_two_effects_are_named_and_no_third_nor_are_they_a_rival_in_another_order():
    base, sensitivities, limits = analysed(
        toy({"coulomb": {"force_N": 0.3}, "spring": {"stiffness_N_m": 5.0}}, seed=1)
    )
    decision = refit_and_decide(base, sensitivities, searched(base, sensitivities, limits), limits)
    assert (decision.verdict, labels(decision)) == ("named", {"coulomb", "spring"})
    pair = candidate_of("coulomb"), candidate_of("spring")
    fits = [fit_hypothesis(base.problem, effects) for effects in (pair, pair[::-1])]
    decision = refit_and_decide(base, sensitivities, fits, limits)
    assert (decision.verdict, len(decision.ranking)) == ("named", 1)


def test_with_windows_for_all_forces_are_named_from_whole_runs_and_a_clearance_from_windows():
    def check(hidden, candidates, how):
        problem = linear(hidden=hidden, candidates=candidates, **how)
        base = recalibrate(problem.model, noise_of(problem))
        sensitivities, limits = screen_candidates(base, 0.01)
        decision = select_hypothesis(
            base, sensitivities, searched(base, sensitivities, limits), limits
        )
        assert (decision.verdict, labels(decision)) == (
            "named" if hidden else "parameters_only",
            hidden.keys(),
        )
        assert decision.chosen.in_windows == ("spring" in hidden)
        found, errors = decision.chosen.mapping, np.sqrt(np.diag(decision.chosen.covariance()))
        errors = dict(zip(found, errors, strict=True))
        for key, value in ((f"{name}.{key}", at[key]) for name, at in hidden.items() for key in at):
            assert abs(found[key] - value) < 4.0 * errors[key] < 0.05

    each(
        check,
        [
            ({}, (SWING, WOBBLE), {}),
            ({"swing": {"size": 0.3}, "wobble": {"size": 0.3}}, (SWING, WOBBLE, PULL), {}),
            ({"push": {"size": 0.3}}, (SWING, PUSH), {"drive": 0.2, "bounds": (0.0, 0.25)}),
            ({"spring": {"size": 0.3, "damping": 0.1}}, (SWING, HIDDEN_SPRING), {}),
        ],
    )


# Not named


def test_nothing_hidden_is_nothing_found():
    assert [named(seed=seed)[0].verdict for seed in range(8)] == ["no_disagreement"] * 8


def test_parameters_off_nominal_within_their_ranges_are_no_effect():
    for seed in range(3):
        decision, _ = named(nuisances={"slider_mass": 0.515}, seed=seed)
        assert decision.verdict == "parameters_only"
        assert decision.chosen.mapping["slider_mass"] == pytest.approx(0.515, abs=0.01)


def test_at_one_speed_a_spring_is_not_distinguished_from_a_force_that_grows_with_speed():
    speeds = {"one": 10.0, "fast": 24.0}
    decision, _ = named(
        {"spring": {"stiffness_N_m": 5.0}}, seed=2, speeds=speeds, held_out=("fast",)
    )
    assert decision.verdict == "ambiguous"
    assert {"spring", "centrifugal"} <= {fit.label for fit in decision.equivalent}


def test_an_effect_that_is_on_no_list_gets_no_name():
    def check(law, seed):
        decision, gap = named(hidden=law, seed=seed)
        assert gap > 1.5
        assert decision.verdict == "unexplained" and decision.because

    def cubic(x, v, angle, time):
        return -0.3 * v**3

    def stribeck(x, v, angle, time):
        return -2.5 * np.tanh(v / 0.01) * np.exp(-((v / 0.5) ** 2))

    each(check, [(cubic, 0), (cubic, 1), (stribeck, 1), (stribeck, 2)])


def test_thresholds_hold_their_rate_and_know_of_other_numerics():
    base, sensitivities = screened(toy(seed=5))
    nothing, more = (
        np.empty((0, base.problem.size)),
        0.3 * sensitivities.of("quadratic")[0].columns.T,
    )
    white, loose = (
        thresholds(base.problem, sensitivities, changed, rate=0.05) for changed in (nothing, more)
    )
    assert loose.max_gain_threshold > white.max_gain_threshold and loose.omnibus > white.omnibus
    dof = base.problem.size - len(base.base.parameters)
    exceeded = np.mean(np.random.default_rng(9).chisquare(dof, 20_000) / dof > white.omnibus)
    assert 0.03 < exceeded < 0.07


# Where a fit begins


def test_a_fit_from_a_finite_size_begins_at_the_size_that_the_secant_says_of_either_sign():
    def check(label, key, guesses, size):
        told = replace(candidate_of(label), initial_guesses=guesses)
        _, sensitivities = screened(replace(toy({label: {key: size}}, seed=2), candidates=(told,)))
        assert [one.is_secant for one in sensitivities.entries] == [
            bool(guess) for guess in guesses
        ]
        alone = replace(
            sensitivities, entries=[one for one in sensitivities.entries if one.is_secant]
        )
        (found,) = SensitivityRegression(alone).singles()
        assert found.start[f"{label}.{key}"] == pytest.approx(size, rel=0.1)
        # where a fit starts too is no further thing that a candidate can change
        assert len(SensitivitySubspaces(sensitivities).of[label]) == 1

    each(
        check,
        [("quadratic", "drag_N_s2_m2", ({"drag_N_s2_m2": 0.2},), size) for size in (0.15, 0.35)],
    )
    each(
        check,
        [
            ("sensor_bias:torque", "bias", ({}, {"bias": 0.8 * size}), size)
            for size in (-0.02, 0.015)
        ],
    )


def test_finite_starts_are_of_a_single_size_that_is_not_zero_and_searches_above_it_within_finite_bounds():
    def effect(sizes, starts, searched, low=-np.inf, high=np.inf):
        size = tuple(Parameter(key, 0.0, low, high) for key in sizes)
        known = np.isfinite(low)  # the change of something known
        return Candidate(
            "odd", "slider", size, sizes, (starts,), search_range=searched, is_perturbation=known
        )

    refused(
        effect,
        [
            (("a", "b"), {"a": 1.0}, (), "single amplitude"),
            (("a",), {"a": 0.0}, (), "single amplitude"),
            (("a",), {}, (-1.0, 1.0), "single amplitude"),
            (("a", "b"), {}, (1.0, 1.35), "single amplitude"),
            (("a",), {}, (-1.0, 2.0), -1.0, 2.0, "above -1"),
            (("a",), {}, (), -1.0, "finite bounds"),
        ],
        ValueError,
    )
    assert effect(("a",), {}, (-0.9, 2.0), -1.0, 2.0).vanishing_amplitude == -1.0
