"""Fits against what linear algebra and other optimisers say."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.baseline import probed_differences
from jointgap.identification.fit import (
    CONVERGED,
    FAILED,
    STOPPED,
    FiniteDifferences,
    Fit,
    bounded_step,
    bounds_of,
    compress_rows,
    fit_hypothesis,
)
from jointgap.identification.problem import Problem
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.identification.knocks import knocking
from tests.identification.toy import stated_noise, toy


def problem(model):
    return Problem(model, stated_noise(model))


def candidate(model, label):
    return next(one for one in model.candidates if one.label == label)


def test_compression_keeps_all_inner_products():
    generator = np.random.default_rng(0)
    a, b = generator.standard_normal((40, 3)), generator.standard_normal(40)
    small_a, small_b = compress_rows(a, b)
    assert small_a.shape == (4, 3)
    np.testing.assert_allclose(small_a.T @ small_a, a.T @ a)
    np.testing.assert_allclose(small_a.T @ small_b, a.T @ b)


def test_a_bounded_step_is_the_best_within_the_bounds():
    generator = np.random.default_rng(1)
    a, b = generator.standard_normal((30, 2)), generator.standard_normal(30)
    low, high = np.array([-0.01, -1.0]), np.array([0.01, 1.0])
    step, left = bounded_step(a, b, low, high)
    grid = np.array([[x, y] for x in np.linspace(low[0], high[0], 41) for y in np.linspace(low[1], high[1], 401)])
    assert left <= np.sum((b[:, None] + a @ grid.T) ** 2, axis=0).min() + 1e-9
    assert left == pytest.approx(np.sum((b + a @ step) ** 2))
    assert (step >= low).all() and (step <= high).all()


def test_a_column_that_changes_nothing_takes_no_step():
    step, _ = bounded_step(
        np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([1.0, 1.0]), *(np.full(2, s) for s in (-5.0, 5.0))
    )
    np.testing.assert_allclose(step, [-1.0, 0.0])


def test_the_fit_is_where_another_optimiser_ends():
    model = toy({"viscous": {"damping_N_s_m": 0.5}}, {"slider_mass": 0.51}, seed=1)
    here, hypothesis = problem(model), (candidate(model, "viscous"),)
    found = fit_hypothesis(here, hypothesis)
    parameters = here.parameters(hypothesis)
    peer = least_squares(
        lambda x: here.residual({p.key: v for p, v in zip(parameters, x, strict=True)}, hypothesis),
        [p.nominal for p in parameters],
        bounds=bounds_of(parameters),
        x_scale=[p.step for p in parameters],
        xtol=1e-12,
    )
    assert found.status == CONVERGED
    assert found.chi2 == pytest.approx(2 * peer.cost, abs=0.05)
    assert found.simulations < peer.nfev * (1 + len(parameters))


@pytest.mark.parametrize("seed", range(5))
def test_the_true_parameters_lie_within_their_errors(seed):
    truth = {"slider_mass": 0.512, "viscous.damping_N_s_m": 0.5}
    model = toy({"viscous": {"damping_N_s_m": 0.5}}, {"slider_mass": 0.512}, seed=seed)
    found = fit_hypothesis(problem(model), (candidate(model, "viscous"),), refresh=True)
    errors = dict(zip((p.key for p in found.parameters), np.sqrt(np.diag(found.covariance())), strict=True))
    for key, value in truth.items():
        assert abs(found.mapping[key] - value) < 4 * errors[key]


def test_what_is_left_is_noise():
    model = toy({"coulomb": {"force_N": 0.4}}, seed=7)
    here = problem(model)
    found = fit_hypothesis(here, (candidate(model, "coulomb"),))
    dof = here.size - len(found.parameters)
    assert abs(found.chi2 - dof) < 4 * np.sqrt(2 * dof)
    assert here.gap(found.residual) == pytest.approx(1.0, abs=0.1)


def test_a_fit_that_cannot_be_simulated_fails_with_its_reason():
    model = toy(seed=0)
    found = fit_hypothesis(problem(model), start={"crank_length": -0.1}, vary=())
    assert found.status == FAILED and "does not turn" in found.reason
    assert found.chi2 == np.inf


def test_bounds_hold_and_a_parameter_at_its_bound_has_no_error():
    model = toy({"added_mass": {"mass_kg": 0.3}}, seed=0)
    found = fit_hypothesis(problem(model))
    low, high = bounds_of(found.parameters)
    assert (found.values >= low).all() and (found.values <= high).all()
    at = [p.key for p in found.parameters].index("slider_mass")
    assert found.values[at] == high[at]
    assert found.covariance()[at, at] == 0.0


def test_known_derivatives_save_simulations():
    model = toy({"viscous": {"damping_N_s_m": 0.5}}, seed=3)
    here = problem(model)
    differences, hypothesis = FiniteDifferences(here), (candidate(model, "viscous"),)
    first = fit_hypothesis(here, hypothesis, differences=differences, refresh=True)
    known = {p.key: column for p, column in zip(first.parameters, first.jacobian.T, strict=True)}
    again = fit_hypothesis(here, hypothesis, first.mapping, known, differences)
    assert again.simulations <= 2 * len(here.runs)
    assert again.chi2 == pytest.approx(first.chi2, abs=0.2)


def test_a_difference_is_taken_over_a_step_that_noise_could_just_hide():
    model = toy(seed=0)
    here = problem(model)
    differences = FiniteDifferences(here)
    at = {p.key: p.nominal for p in here.nuisances}
    residual = here.residual(at)
    clumsy = Parameter("slider_mass", 0.5, 0.0, 10.0, step=5.0, unit="kg")
    column = differences.column(clumsy, at, residual, ())
    fine = Parameter("slider_mass", 0.5, 0.0, 10.0, step=1e-4, unit="kg")
    np.testing.assert_allclose(column, FiniteDifferences(here).column(fine, at, residual, ()), rtol=1e-6, atol=1e-6)


def test_an_effect_takes_the_place_of_the_nuisance_that_is_its_own_parameter():
    model = toy(seed=0)
    keys = [p.key for p in problem(model).parameters((candidate(model, "added_mass"),))]
    assert "slider_mass" not in keys and "added_mass.mass_kg" in keys


def test_labels_name_the_site_where_there_is_a_choice():
    size = Parameter("bias", 0.0)
    assert Candidate("sensor_bias", "torque", (size,), ("bias",), has_site=True).label == "sensor_bias:torque"
    assert Candidate("gravity", "all", (size,), ("bias",)).label == "gravity"


def test_what_the_data_leave_open_is_as_uncertain_as_its_bounds_say():
    model = toy(seed=0, channels=("acceleration",))  # no force is read: the mass changes nothing
    found = fit_hypothesis(problem(model), refresh=True)
    at = [p.key for p in found.parameters].index("slider_mass")
    mass = found.parameters[at]
    assert np.sqrt(found.covariance()[at, at]) == pytest.approx((mass.high - mass.low) / np.sqrt(12.0))


def made_fit(residual, parameters=(), jacobian=None, values=None, hypothesis=(), status=CONVERGED) -> Fit:
    """A fit put together by hand; values in the middle of nowhere by default."""
    residual = np.asarray(residual, dtype=float)
    values = np.zeros(len(parameters)) if values is None else np.array(values)
    jacobian = np.zeros((residual.size, len(parameters))) if jacobian is None else np.array(jacobian)
    return Fit(hypothesis, tuple(parameters), values, residual, jacobian, 0, status)


@pytest.mark.parametrize(
    ("replaced", "counted"),
    [([], 3), ([{}], 3), ([{"mass": "a"}], 4), ([{"mass": "a", "offset": "a"}, {"play": "a"}], 6)],
)
def test_a_nuisance_that_an_effect_replaces_costs_as_much_as_a_parameter(replaced, counted):
    size = Parameter("a", 0.0)
    effects = tuple(
        Candidate(f"effect{i}", "slider", (size,), ("a",), replaces=names) for i, names in enumerate(replaced)
    )
    fitted = made_fit(np.full(50, 2.0), [Parameter(key, 0.0) for key in "abc"], np.eye(50)[:, :3], hypothesis=effects)
    assert fitted.chi2 == 200.0
    assert fitted.bic == pytest.approx(200.0 + counted * np.log(50), rel=1e-14)


def test_a_parameter_that_changes_nothing_does_not_count():
    """Of a, b and c: 1 over a step, 0, and as little over the whole range as rounding leaves."""
    parameters = [Parameter("a", 0.0), Parameter("b", 0.0), Parameter("c", 0.0, -1.0, 1.0)]
    fitted = made_fit(np.full(50, 2.0), parameters, np.eye(50)[:, :3] * [1.0, 0.0, 1e-9])
    assert fitted.active.tolist() == [True, False, False]
    assert fitted.bic == pytest.approx(200.0 + np.log(50), rel=1e-14)


def test_a_failed_fit_is_worse_than_any_other():
    fitted = made_fit([1.0, 2.0], status=FAILED)
    assert fitted.chi2 == fitted.bic == np.inf


@pytest.mark.parametrize(("chi2", "variance"), [(0.1, 0.25), (3.0, 0.25), (12.0, 1.0)])
def test_errors_grow_with_the_misfit_beyond_noise(chi2, variance):
    """Four samples of slope 1: a variance of 1/4, times chi2 over three degrees of freedom where that is more than
    1.
    """
    fitted = made_fit(np.full(4, np.sqrt(chi2 / 4)), [Parameter("a", 0.0)], np.ones((4, 1)))
    assert fitted.covariance() == pytest.approx(np.array([[variance]]), rel=1e-12)


@pytest.mark.parametrize(("chi2", "variance"), [(0.1, 1.0 / 7.0), (12.0, 0.25)])
def test_bounds_tell_as_much_of_a_parameter_as_a_flat_distribution(chi2, variance):
    """Between -1 and 1 a variance of 1/3, whatever the misfit; beside the data's 1/4, which grows with it."""
    fitted = made_fit(np.full(4, np.sqrt(chi2 / 4)), [Parameter("a", 0.0, -1.0, 1.0)], np.ones((4, 1)))
    assert fitted.covariance() == pytest.approx(np.array([[variance]]), rel=1e-12)


@pytest.mark.parametrize("value", [-1.0, 1.0])
def test_what_stands_at_a_bound_takes_no_part_in_the_errors_of_the_others(value):
    parameters = [Parameter("a", 0.0, -1.0, 1.0), Parameter("b", 0.0)]
    slopes = np.column_stack([np.arange(4.0), np.ones(4)])
    covariance = made_fit(np.zeros(4), parameters, slopes, [value, 0.0]).covariance()
    np.testing.assert_allclose(covariance, [[0.0, 0.0], [0.0, 0.25]], rtol=1e-12)


def test_a_fit_that_runs_out_of_steps_says_so():
    model = toy({"coulomb": {"force_N": 0.4}}, seed=7)
    few = replace(DEFAULT_SETTINGS, stopping=replace(DEFAULT_SETTINGS.stopping, max_steps=1))
    here = Problem(model, stated_noise(model), settings=few)
    found = fit_hypothesis(here, (candidate(model, "coulomb"),))
    assert (found.status, found.reason) == (STOPPED, "not converged after 1 steps")


def test_a_fit_that_another_beats_ends_early():
    model = knocking({"spring": {"stiffness_N_m": 2.0}}, clearance=1.05, seed=2)
    here, hypothesis = problem(model), (candidate(model, "spring"),)
    patient = fit_hypothesis(here, hypothesis)
    beaten = fit_hypothesis(here, hypothesis, sufficient_chi2=1.0)
    assert beaten.simulations < patient.simulations
    assert (beaten.status, beaten.reason) == (STOPPED, "poor fit, stalled")


@pytest.mark.parametrize("high", [np.inf, 0.0])
def test_the_numerical_noise_is_what_next_to_no_change_of_a_parameter_changes(high):
    """3 in one residual as soon as the parameter moves: steps are made five times as long, and chi2 is sure to 6."""
    asked = []

    def residual(values):
        asked.append(values["a"])
        return np.array([3.0 if values["a"] else 0.0, 1.0])

    differences = FiniteDifferences(SimpleNamespace(parts=[], settings=DEFAULT_SETTINGS, residual=residual))
    assert (differences.target, differences.numerical_noise_chi2) == (5.0, 0.0)
    differences.probe([Parameter("a", 0.0, high=high, step=2.0)], {"a": 0.0}, np.array([0.0, 1.0]))
    assert asked == [2e-6, 4e-6] if high else [-2e-6, -4e-6]
    assert (differences.numerical_noise, differences.target, differences.numerical_noise_chi2) == (3.0, 15.0, 6.0)


def test_a_change_that_grows_with_the_step_is_no_numerical_noise():
    """A sensor so good that a millionth of a usual step changes its residuals by 100."""
    stub = SimpleNamespace(
        parts=[], settings=DEFAULT_SETTINGS, residual=lambda values: np.array([5e7 * values["a"], 1.0])
    )
    differences = FiniteDifferences(stub)
    differences.probe([Parameter("a", 0.0, step=2.0)], {"a": 0.0}, np.array([0.0, 1.0]))
    assert differences.numerical_noise < 1e-6


@pytest.mark.parametrize("decade", range(3, 10))
def test_however_good_the_sensors_a_fit_ends_at_the_truth(decade):
    truth = {"slider_mass": 0.512, "crank_length": 0.1507, "speed@slow": 10.01, "speed@mid": 16.03}
    effects = {"viscous": {"damping_N_s_m": 0.5}}
    model = toy(effects, truth, noise=10.0**-decade, seed=1)
    here, hypothesis = problem(model), (candidate(model, "viscous"),)
    differences = probed_differences(here, {p.key: p.nominal for p in here.nuisances})
    found = fit_hypothesis(here, hypothesis, differences=differences, refresh=True)
    assert found.status == CONVERGED
    assert found.chi2 < 1.2 * here.size
    errors = dict(zip((p.key for p in found.parameters), np.sqrt(np.diag(found.covariance())), strict=True))
    for key, value in (truth | {"viscous.damping_N_s_m": 0.5}).items():
        assert abs(found.mapping[key] - value) < 4 * errors[key]
    assert found.simulations < 50  # as many as where noise is a hundredth, and a step or two


def test_a_failed_fit_has_a_criterion_though_nothing_is_known_of_its_derivatives():
    parameters = (Parameter("a", 0.0), Parameter("b", 0.0))
    lost = Fit((), parameters, np.zeros(2), np.full(9, np.nan), np.empty((9, 0)), 1, "failed", "the slider jams")
    assert lost.bic == np.inf
    assert lost.active.all()


def test_draws_are_spread_within_the_bounds_by_the_gap_of_held_out_data():
    fit = Fit((), (Parameter("a", 0.0, -2.0, 9.0),), np.zeros(1), np.ones(99), np.ones((99, 1)), 1, "converged")
    drawn = replace(fit, draws=np.array([[-1.0], [0.0], [1.0], [2.0]]))
    assert drawn.distribution.draws.tolist() == drawn.draws.tolist()
    assert replace(drawn, gap_left=3.0).distribution.draws[:, 0] == pytest.approx([-2.0, 0.0, 3.0, 6.0], rel=0.02)
