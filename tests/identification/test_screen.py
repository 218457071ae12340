"""Screening: fits predicted by sensitivities."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.fit import FiniteDifferences, fit_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.screening import (
    Sensitivities,
    Sensitivity,
    SensitivityRegression,
    SensitivitySubspaces,
    crank_orders,
    likely_frequencies,
    simulate_sensitivities,
)
from tests.identification.toy import stated_noise, toy

NO_NUISANCES = (), np.empty(0)


def based(model):
    problem = Problem(model, stated_noise(model))
    differences = FiniteDifferences(problem)
    return problem, differences, fit_hypothesis(problem, differences=differences, refresh=True)


def screened(effects, **how):
    problem, differences, base = based(toy(effects, **how))
    return problem, differences, base, simulate_sensitivities(problem, base, differences)


def singles(sensitivities, *fixed):
    return SensitivityRegression(sensitivities, *fixed).singles()


def fit_of(problem, differences, sensitivities, screened):
    derivatives = sensitivities.derivatives(screened.sensitivities)
    return fit_hypothesis(problem, screened.hypothesis, screened.start, derivatives, differences)


def made_up(residual, columns, **more):
    """A regression on sensitivities ``one``, ``two`` ... without nuisances."""
    one = Candidate("one", "slider", (Parameter("size", 0.0),), ("size",), **more)
    entries = [
        Sensitivity(replace(one, name=name), {}, column, residual, ("slow",))
        for name, column in zip(("one", "two", "three"), columns, strict=False)
    ]
    return SensitivityRegression(
        Sensitivities(*NO_NUISANCES, np.empty((residual.size, 0)), residual, entries, {})
    )


@pytest.mark.parametrize(
    "label, key, size",
    [
        ("viscous", "damping_N_s_m", 0.1),
        ("spring", "stiffness_N_m", 1.0),
        ("sensor_bias:torque", "bias", 0.01),
        ("sensor_lag:torque", "lag_s", 1e-3),
    ],
)
def test_the_hidden_effect_ranks_first_and_the_prediction_matches_the_fit(label, key, size):
    """Sizes act linearly here."""
    problem, differences, _, sensitivities = screened({label: {key: size}}, seed=1)
    first = singles(sensitivities)[0]
    assert first.label == label
    found = fit_of(problem, differences, sensitivities, first)
    assert (first.chi2, first.bic) == pytest.approx((found.chi2, found.bic), abs=0.5)
    assert first.start[f"{label}.{key}"] == pytest.approx(found.mapping[f"{label}.{key}"], rel=1e-2)


def test_harmonic_forces_are_tried_at_residual_frequencies_off_the_crank_orders():
    for frequency, off_order in ((6.37, True), (1.01 * 16.0 / (2 * np.pi), False)):
        effect = {"harmonic_force": {"cosine_N": 0.2, "sine_N": 0.1, "frequency_Hz": frequency}}
        problem, *_, sensitivities = screened(effect, seed=4)
        tried = np.array(
            [one.shape_parameters["frequency_Hz"] for one in sensitivities.of("harmonic_force")]
        )
        assert (min(abs(tried - frequency)) < 0.1) == off_order
        assert not off_order or singles(sensitivities)[0].label == "harmonic_force"
        assert tried.size
        assert not any(map(crank_orders(problem.parts, problem.settings.screening), tried))
    model = toy(speeds={"slow": 2 * np.pi * 5.0, "fast": 2 * np.pi * 14.0}, held_out=())
    problem = Problem(model, stated_noise(model))
    order = crank_orders(problem.parts, problem.settings.screening)
    near = {5.04: "order 1 of the crank in run slow", 7.2: "order 0.5 of the crank in run fast"}
    near |= {6.1: "", 10.2: ""}
    assert {frequency: order(frequency) for frequency in near} == near
    order = crank_orders(problem.parts, problem.settings.screening, in_all_runs=True)
    both = "order 14 of the crank in run slow and order 5 of the crank in run fast"
    near = {5.04: "", 7.0: "", 70.05: both}
    assert {frequency: order(frequency) for frequency in near} == near


def test_likely_frequencies_explain_most_by_least_squares_with_the_nuisances():
    """One cosine and sine in each run, as the phases differ."""
    effect = {"harmonic_force": {"cosine_N": 0.2, "sine_N": 0.1, "frequency_Hz": 6.37}}
    problem, _, base, sensitivities = screened(effect, seed=4)
    (carrier,) = sensitivities.of("constant_force")[0].columns.T
    time, runs = np.zeros(problem.size), np.empty(problem.size, dtype=object)
    for part in problem.parts:
        time[part.place], runs[part.place] = part.series.time[part.used], part.series.run

    def left(frequency):
        wave = carrier * np.exp(2j * np.pi * frequency * time)
        waves = [part * (runs == run) for run in problem.runs for part in (wave.real, wave.imag)]
        columns = np.column_stack([base.jacobian, *waves])
        return np.linalg.lstsq(columns, base.residual)[1][0]

    swing = next(one for one in problem.model.candidates if one.label == "harmonic_force")
    (own,) = (p for p in swing.coordinates if p.name == "frequency_Hz")
    settings = problem.settings.screening
    found = likely_frequencies(problem.parts, base.residual, base.jacobian, carrier, own, settings)
    assert len(found) == settings.max_frequencies
    assert [left(one) for one in found] == sorted(left(one) for one in found)
    others = np.linspace(own.low, own.high, 300)
    order = crank_orders(problem.parts, settings)
    assert left(found[0]) <= 1.01 * min(left(one) for one in others if not order(one))


def test_the_sensitivity_of_a_replacing_effect_starts_at_the_nominal_nuisance():
    model = toy({"added_mass": {"mass_kg": 0.05}}, seed=5)
    problem, differences, base = based(model)
    mass = next(p for p in model.nuisances if p.name == "slider_mass")
    assert base.mapping["slider_mass"] != pytest.approx(mass.nominal, rel=1e-3)
    (one,) = simulate_sensitivities(problem, base, differences).of("added_mass")
    at = base.mapping | {"slider_mass": mass.nominal}
    np.testing.assert_allclose(one.origin, problem.residual(at), atol=1e-9)
    heavier = problem.residual(at | {"slider_mass": mass.nominal + 0.1})
    np.testing.assert_allclose(one.origin + 0.1 * one.columns[:, 0], heavier, atol=1e-6)


def test_friction_cannot_push():
    *_, sensitivities = screened({"viscous": {"damping_N_s_m": -0.3}}, seed=3)
    by_label = {one.label: one for one in singles(sensitivities)}
    assert by_label["viscous"].start["viscous.damping_N_s_m"] == 0.0
    assert by_label["viscous"].chi2 == pytest.approx(by_label["coulomb"].chi2)


# Several effects


def test_a_special_case_is_distinguished_from_a_similar_effect():
    *_, sensitivities = screened({}, seed=6, speeds={"one": 10.0, "fast": 24.0}, held_out=("fast",))
    by_label = {one.candidate.label: (one.candidate,) for one in sensitivities.entries}
    both, spaces = (*by_label["viscous"], *by_label["coulomb"]), SensitivitySubspaces(sensitivities)
    assert spaces.is_special_case(by_label["viscous"], both)
    assert not spaces.is_special_case(by_label["quadratic"], both)
    # the same, and neither can do more
    assert not spaces.is_special_case(by_label["spring"], by_label["centrifugal"])
    # what could not be simulated about the base is like none
    lost = by_label["viscous"]
    entries = [one for one in sensitivities.entries if one.candidate is not lost[0]]
    spaces = SensitivitySubspaces(replace(sensitivities, entries=entries))
    assert spaces.nearest(lost)[1] == 0.0
    assert not spaces.is_special_case(lost, by_label["spring"])


def test_a_pair_that_explains_only_together_ranks_first():
    """The sensitivities of the first two effects are nearly opposite."""
    first, apart, third, noise = np.random.default_rng(0).standard_normal((4, 400, 1))
    columns = (first, 0.2 * apart - first, third)
    residual = 10.0 * (columns[0] + columns[1])[:, 0] + 0.1 * noise[:, 0]
    regression = made_up(residual, columns)
    assert all(single.chi2 > 0.9 * residual @ residual for single in regression.singles())
    best, *others = regression.pairs()
    assert (best.label, len(others)) == ("one + two", 2)
    assert best.chi2 < 0.01 * residual @ residual
    assert best.start == pytest.approx({"one.size": -10.0, "two.size": -10.0}, rel=0.1)
    limits = best.chi2, others[0].chi2, np.inf
    counts = [len(regression.pairs(1.001 * most)) for most in limits]
    assert counts == [1, 2, 3] and regression.pairs(0.999 * best.chi2) == []
    # no pair is made of two effects that replace one nuisance
    assert made_up(np.ones(9), [np.ones((9, 1))] * 2, replaces={"mass": "size"}).pairs() == []


def test_candidates_without_influence_are_dropped():
    """No force changes the acceleration of a slide that a crank drives evenly."""
    *_, sensitivities = screened(
        {"sensor_gain:acceleration": {"gain_error": 0.02}}, channels=("acceleration",)
    )
    assert {one.candidate.label for one in sensitivities.entries} == {"sensor_gain:acceleration"}
    assert sensitivities.failed == {}
