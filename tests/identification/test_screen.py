"""Screening: what sensitivities foretell of fits."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.fit import CONVERGED, FiniteDifferences, Fit, fit_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.screening import (
    Sensitivities,
    Sensitivity,
    SensitivityRegression,
    SensitivitySubspaces,
    crank_orders,
    simulate_sensitivities,
)
from tests.identification.toy import RINGING, stated_noise, toy


def screened(effects, **how):
    model = toy(effects, **how)
    problem = Problem(model, stated_noise(model))
    differences = FiniteDifferences(problem)
    base = fit_hypothesis(problem, differences=differences, refresh=True)
    return problem, differences, base, simulate_sensitivities(problem, base, differences)


def test_beside_a_fit_an_effect_brings_every_nuisance_that_it_replaces_back_to_nominal():
    """Residuals linear in two nuisances, which the fit has elsewhere than the base."""
    rng = np.random.default_rng(0)
    slopes, at_nominal = rng.standard_normal((20, 2)), rng.standard_normal(20)
    nuisances = tuple(Parameter(name, 0.0) for name in ("crank_length", "rod_length"))
    sizes = ("crank_m", "rod_m")
    replaces = {p.name: size for p, size in zip(nuisances, sizes, strict=True)}
    lengths = Candidate("lengths", "rod", tuple(Parameter(key, 0.0) for key in sizes), sizes, replaces=replaces)
    base, fitted = np.array([0.1, -0.2]), np.array([0.3, 0.4])
    sensitivity = Sensitivity(lengths, {}, slopes, at_nominal, ("slow",))
    about_base = Sensitivities(nuisances, base, slopes, at_nominal + slopes @ base, [sensitivity], {})
    fit = Fit((), nuisances, fitted, at_nominal + slopes @ fitted, slopes, 0, CONVERGED)
    (beside,) = about_base.about(fit).entries
    np.testing.assert_allclose(beside.origin, at_nominal)


@pytest.mark.parametrize(
    "effects",
    [
        {"viscous": {"damping_N_s_m": 0.1}},
        {"spring": {"stiffness_N_m": 1.0}},
        {"sensor_bias:torque": {"bias": 0.01}},
        {"sensor_lag:torque": {"lag_s": 1e-3}},
        {"harmonic_force": {"cosine_N": 0.2, "sine_N": 0.1, "frequency_Hz": 5.3}},
    ],
    ids=lambda effects: next(iter(effects)),
)
def test_the_hidden_effect_is_first(effects):
    *_, sensitivities = screened(effects, seed=1)
    assert SensitivityRegression(sensitivities).singles()[0].label == next(iter(effects))


def test_what_signatures_foretell_is_what_a_fit_finds():
    """Sizes act linearly here, so both must agree."""
    problem, differences, _, sensitivities = screened({"viscous": {"damping_N_s_m": 0.3}}, seed=2)
    first = SensitivityRegression(sensitivities).singles()[0]
    found = fit_hypothesis(
        problem, first.hypothesis, first.start, sensitivities.derivatives(first.sensitivities), differences
    )
    assert first.chi2 == pytest.approx(found.chi2, abs=0.5)
    assert first.bic == pytest.approx(found.bic, abs=0.5)
    assert found.mapping["viscous.damping_N_s_m"] == pytest.approx(first.start["viscous.damping_N_s_m"], rel=1e-2)


def test_the_signature_of_what_replaces_a_nuisance_begins_where_that_is_nominal():
    model = toy({"added_mass": {"mass_kg": 0.05}}, seed=5)
    problem = Problem(model, stated_noise(model))
    differences = FiniteDifferences(problem)
    base = fit_hypothesis(problem, differences=differences, refresh=True)
    mass = next(p for p in model.nuisances if p.name == "slider_mass")
    assert base.mapping["slider_mass"] != pytest.approx(mass.nominal, rel=1e-3)
    (one,) = simulate_sensitivities(problem, base, differences).of("added_mass")
    at = base.mapping | {"slider_mass": mass.nominal}
    np.testing.assert_allclose(one.origin, problem.residual(at), atol=1e-9)
    heavier = problem.residual(at | {"slider_mass": mass.nominal + 0.1})
    np.testing.assert_allclose(one.origin + 0.1 * one.columns[:, 0], heavier, atol=1e-6)


def test_resistance_cannot_push():
    """A force that pushes along is not explained by a negative friction."""
    *_, sensitivities = screened({"viscous": {"damping_N_s_m": -0.3}}, seed=3)
    by_label = {one.label: one for one in SensitivityRegression(sensitivities).singles()}
    assert by_label["viscous"].start["viscous.damping_N_s_m"] == 0.0
    assert by_label["viscous"].chi2 == pytest.approx(by_label["coulomb"].chi2)


def test_a_swinging_force_is_tried_at_the_frequency_that_the_residual_shows():
    *_, sensitivities = screened({"harmonic_force": {"cosine_N": 0.2, "sine_N": 0.0, "frequency_Hz": 6.37}}, seed=4)
    tried = [one.shape_parameters["frequency_Hz"] for one in sensitivities.of("harmonic_force")]
    assert min(abs(np.array(tried) - 6.37)) < 0.1


def test_beside_one_of_two_hidden_effects_the_other_is_first():
    problem, differences, _, sensitivities = screened(
        {"coulomb": {"force_N": 0.2}, "spring": {"stiffness_N_m": 5.0}}, seed=5
    )
    coulomb = next(one for one in SensitivityRegression(sensitivities).singles() if one.label == "coulomb")
    found = fit_hypothesis(
        problem, coulomb.hypothesis, coulomb.start, sensitivities.derivatives(coulomb.sensitivities), differences
    )
    partners = SensitivityRegression(sensitivities.about(found), found.hypothesis).singles()
    assert partners[0].label == "coulomb + spring"
    assert partners[0].start["spring.stiffness_N_m"] == pytest.approx(5.0, rel=0.1)
    assert "coulomb + coulomb" not in {one.label for one in partners}


def test_a_candidate_that_cannot_be_simulated_is_left_out_with_its_reason():
    model = toy(seed=0)
    problem = Problem(model, stated_noise(model))
    differences = FiniteDifferences(problem)
    base = fit_hypothesis(problem, differences=differences)
    real = model.simulate

    def failing(run, values, effects=(), numerics=0):
        if any(candidate.name == "spring" for candidate, _ in effects):
            raise problem_with_springs
        return real(run, values, effects, numerics)

    from jointgap.core.errors import SimulationError

    problem_with_springs = SimulationError("the spring breaks")
    object.__setattr__(model, "simulate", failing)
    sensitivities = simulate_sensitivities(problem, base, differences)
    assert sensitivities.failed == {"spring": "the spring breaks"}
    assert "viscous" in {one.candidate.label for one in sensitivities.entries}


def test_an_effect_that_another_contains_is_told_from_one_that_is_merely_like_it():
    *_, sensitivities = screened({}, seed=6, speeds={"one": 10.0, "fast": 24.0}, held_out=("fast",))
    spaces = SensitivitySubspaces(sensitivities)
    by_label = {one.candidate.label: (one.candidate,) for one in sensitivities.entries}
    both = (*by_label["viscous"], *by_label["coulomb"])
    assert spaces.is_special_case(by_label["viscous"], both)
    assert not spaces.is_special_case(by_label["quadratic"], both)
    assert not spaces.is_special_case(by_label["spring"], by_label["centrifugal"])  # the same, and neither can do more


def test_an_effect_that_could_not_be_simulated_about_the_base_is_like_none():
    *_, sensitivities = screened({}, seed=6)
    (first, *rest) = sensitivities.entries
    lost = (first.candidate,)
    spaces = SensitivitySubspaces(
        replace(sensitivities, entries=[one for one in rest if one.candidate.label != lost[0].label])
    )
    assert spaces.nearest(lost)[1] == 0.0
    assert not spaces.is_special_case(lost, (rest[-1].candidate,))


def test_two_effects_of_which_neither_explains_much_are_first_among_all_pairs_if_together_they_do():
    """Residuals linear in three amplitudes; the sensitivities of the first two are nearly opposite."""
    rng = np.random.default_rng(0)
    first, apart, third, noise = rng.standard_normal((4, 400, 1))
    columns = (first, 0.2 * apart - first, third)
    residual = 10.0 * (columns[0] + columns[1])[:, 0] + 0.1 * noise[:, 0]
    one = Candidate("one", "slider", (Parameter("size", 0.0),), ("size",))
    entries = [
        Sensitivity(replace(one, name=name), {}, column, residual, ("slow",))
        for name, column in zip(("one", "two", "three"), columns, strict=True)
    ]
    regression = SensitivityRegression(Sensitivities((), np.empty(0), np.empty((400, 0)), residual, entries, {}))
    assert all(single.chi2 > 0.9 * residual @ residual for single in regression.singles())
    best, *others = regression.pairs()
    assert (best.label, len(others)) == ("one + two", 2)
    assert best.chi2 < 0.01 * residual @ residual
    assert best.start == pytest.approx({"one.size": -10.0, "two.size": -10.0}, rel=0.1)


def test_no_pair_is_made_of_two_effects_that_replace_one_nuisance():
    one = Candidate("one", "slider", (Parameter("size", 0.0),), ("size",), replaces={"mass": "size"})
    column, residual = np.ones((9, 1)), np.ones(9)
    entries = [Sensitivity(replace(one, name=name), {}, column, residual, ("slow",)) for name in ("one", "two")]
    assert SensitivityRegression(Sensitivities((), np.empty(0), np.empty((9, 0)), residual, entries, {})).pairs() == []


def test_what_no_slope_leads_to_is_screened_on_request_alone():
    model = replace(toy(), candidates=(RINGING,))
    problem = Problem(model, stated_noise(model))
    differences = FiniteDifferences(problem)
    base = fit_hypothesis(problem, differences=differences)
    assert simulate_sensitivities(problem, base, differences).entries == []
    (found,) = simulate_sensitivities(problem, base, differences, model.candidates).entries
    assert found.is_secant


@pytest.mark.parametrize(
    ("frequency", "order"),
    [(5.04, "order 1 of the crank in run slow"), (7.2, "order 0.5 of the crank in run fast"), (6.1, ""), (10.2, "")],
)
def test_a_frequency_near_an_order_or_half_an_order_of_a_crank_is_that_order(frequency, order):
    model = toy(speeds={"slow": 2 * np.pi * 5.0, "fast": 2 * np.pi * 14.0}, held_out=())
    problem = Problem(model, stated_noise(model))
    assert crank_orders(problem.parts, problem.settings.screening)(frequency) == order


def test_no_effect_of_its_own_frequency_begins_at_an_order_of_a_crank():
    hidden = {"harmonic_force": {"cosine_N": 0.2, "sine_N": 0.1, "frequency_Hz": 1.01 * 16.0 / (2 * np.pi)}}
    problem, *_, sensitivities = screened(hidden, seed=4)
    order = crank_orders(problem.parts, problem.settings.screening)
    tried = [one.shape_parameters["frequency_Hz"] for one in sensitivities.of("harmonic_force")]
    assert tried and not any(map(order, tried))
