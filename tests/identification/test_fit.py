"""Fits compared with linear algebra and scipy."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2 as chi2_distribution

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.baseline import probed_differences
from jointgap.identification.fit import (
    CONVERGED,
    FAILED,
    NEEDS_DERIVATIVES,
    STOPPED,
    FiniteDifferences,
    Fit,
    bounded_step,
    bounds_of,
    chance,
    fit_hypothesis,
    wald_statistic,
)
from jointgap.identification.problem import Problem
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.identification.oscillator import SPEEDS, SPRING, SWING, Oscillator, measured
from tests.identification.toy import candidate_of, stated_noise, toy

VISCOUS, SIZE = (candidate_of("viscous"),), {"viscous": {"damping_N_s_m": 0.5}}
FRICTION = {"coulomb": {"force_N": 0.4}}
WIDE = np.full(1, -np.inf), np.full(1, np.inf)


def problem(model, **more):
    return Problem(model, stated_noise(model), **more)


def free_oscillator(frequency=1.5, **hidden):
    """An oscillator of uncertain frequency: residuals are far from linear in it."""
    own = Parameter("drive", 0.2, 0.0, 0.6, 0.01), Parameter("frequency", 1.4, 1.2, 1.6, 0.01)
    zeros = (Parameter("zero", 0.0, -0.5, 0.5, 0.01, run=run) for run in SPEEDS)
    truth, effects = {"drive": 0.3, "zero": 0.1, "frequency": frequency}, {}
    for name, size in hidden.items():
        effects[name] = {"size": size} | ({"damping": 0.0} if name == "spring" else {})
    return measured(Oscillator([*own, *zeros]), truth, effects)


def place_of(fit, key):
    return [p.key for p in fit.parameters].index(key)


def test_a_bounded_step_is_optimal_within_the_bounds():
    generator = np.random.default_rng(1)
    a, b = generator.standard_normal((30, 2)), generator.standard_normal(30)
    low, high = np.array([-0.01, -1.0]), np.array([0.01, 1.0])
    step, left = bounded_step(a, b, low, high)
    axes = np.linspace(low[0], high[0], 41), np.linspace(low[1], high[1], 401)
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    assert left <= np.sum((b[:, None] + a @ grid.T) ** 2, axis=0).min() + 1e-9
    assert left == pytest.approx(np.sum((b + a @ step) ** 2))
    assert (step >= low).all() and (step <= high).all()


def test_the_fit_agrees_with_scipy_least_squares():
    here = problem(toy(SIZE, {"slider_mass": 0.51}, seed=1))
    found, parameters = fit_hypothesis(here, VISCOUS), here.parameters(VISCOUS)
    keys = [p.key for p in parameters]
    peer = least_squares(
        lambda x: here.residual(dict(zip(keys, x, strict=True)), VISCOUS),
        [p.nominal for p in parameters],
        bounds=bounds_of(parameters),
        x_scale=[p.step for p in parameters],
        xtol=1e-12,
    )
    assert found.status == CONVERGED
    assert found.chi2 == pytest.approx(2 * peer.cost, abs=0.05)
    assert found.simulations < peer.nfev * (1 + len(parameters))


def test_a_fit_reaches_the_truth_at_any_sensor_accuracy():
    truth = {"slider_mass": 0.512, "crank_length": 0.1507, "speed@slow": 10.01, "speed@mid": 16.03}

    for noise, seed in (
        (0.02, 0),
        (0.02, 1),
        (0.02, 2),
        (1e-3, 1),
        (1e-5, 1),
        (1e-7, 1),
        (1e-9, 1),
    ):
        here = problem(toy(SIZE, truth, noise=noise, seed=seed))
        differences = probed_differences(here, {p.key: p.nominal for p in here.nuisances})
        found = fit_hypothesis(here, VISCOUS, differences=differences, refresh=True)
        dof = here.size - len(found.parameters)
        assert found.status == CONVERGED and abs(found.chi2 - dof) < 4 * np.sqrt(2 * dof)
        assert here.gap(found.residual) == pytest.approx(1.0, abs=0.1)
        errors = dict(zip(found.mapping, np.sqrt(np.diag(found.covariance())), strict=True))
        for key, value in (truth | {"viscous.damping_N_s_m": 0.5}).items():
            assert abs(found.mapping[key] - value) < 4 * errors[key]
        assert found.simulations < 50  # as many as where noise is a hundredth, and a step or two


def test_a_fit_that_cannot_be_simulated_fails_with_its_reason():
    found = fit_hypothesis(problem(toy(seed=0)), start={"crank_length": -0.1}, vary=())
    assert found.status == FAILED and "does not turn" in found.reason
    assert found.chi2 == found.bic == np.inf
    parameters = (Parameter("a", 0.0), Parameter("b", 0.0))  # nothing is known of their derivatives
    nothing = np.zeros(2), np.full(9, np.nan), np.empty((9, 0))
    lost = Fit((), parameters, *nothing, 1, "failed", "the slider jams")
    assert lost.chi2 == lost.bic == np.inf and lost.active.all()


def test_a_parameter_at_its_bound_has_no_error_and_one_without_influence_that_of_its_bounds():
    for model, error in (
        (toy({"added_mass": {"mass_kg": 0.3}}, seed=0), 0.0),
        (toy(channels=("acceleration",)), 1.0),
    ):
        found = fit_hypothesis(problem(model), refresh=True)
        (low, high), at = bounds_of(found.parameters), place_of(found, "slider_mass")
        assert (found.values >= low).all() and (found.values <= high).all()
        flat = (high[at] - low[at]) / np.sqrt(12.0)
        assert np.sqrt(found.covariance()[at, at]) == pytest.approx(error * flat)
        assert (found.values[at] == high[at]) == (error == 0.0)


def made_fit(
    residual, parameters=(), jacobian=None, values=None, hypothesis=(), status=CONVERGED
) -> Fit:
    """A fit with the given residual and Jacobian."""
    residual = np.asarray(residual, dtype=float)
    values = np.zeros(len(parameters)) if values is None else np.array(values)
    jacobian = (
        np.zeros((residual.size, len(parameters))) if jacobian is None else np.array(jacobian)
    )
    return Fit(hypothesis, tuple(parameters), values, residual, jacobian, 0, status)


def test_the_bic_counts_active_parameters_and_replaced_nuisances():
    size, eye = Parameter("a", 0.0), np.eye(50)[:, :3]
    effect = Candidate("effect", "slider", (size,), ("a",))
    several = [{"mass": "a", "offset": "a"}, {"play": "a"}]
    for replaced, counted in (([], 3), ([{}], 3), ([{"mass": "a"}], 4), (several, 6)):
        effects = tuple(replace(effect, name=f"{i}", replaces=at) for i, at in enumerate(replaced))
        parameters = [Parameter(key, 0.0) for key in "abc"]
        fitted = made_fit(np.full(50, 2.0), parameters, eye, hypothesis=effects)
        assert fitted.chi2 == 200.0
        assert fitted.bic == pytest.approx(200.0 + counted * np.log(50), rel=1e-14)
    # effect of one step: 1, 0, and rounding over the range
    parameters = [Parameter("a", 0.0), Parameter("b", 0.0), Parameter("c", 0.0, -1.0, 1.0)]
    fitted = made_fit(np.full(50, 2.0), parameters, eye * [1.0, 0.0, 1e-9])
    assert fitted.active.tolist() == [True, False, False]
    assert fitted.bic == pytest.approx(200.0 + np.log(50), rel=1e-14)


def test_errors_grow_with_the_misfit_and_bounds_act_as_a_uniform_prior():
    """Four samples of slope 1: variance 1/4, scaled by chi2 / 3 above 1; bounds at -1 and 1 add
    1/3."""
    free = {(0.1, np.inf): 1 / 4, (3.0, np.inf): 1 / 4, (12.0, np.inf): 1.0}
    for (chi2, bound), variance in (free | {(0.1, 1.0): 1 / 7, (12.0, 1.0): 1 / 4}).items():
        size = [Parameter("a", 0.0, -bound, bound)]
        fitted = made_fit(np.full(4, np.sqrt(chi2 / 4)), size, np.ones((4, 1)))
        assert fitted.covariance() == pytest.approx(np.array([[variance]]), rel=1e-12)
    parameters = [Parameter("a", 0.0, -1.0, 1.0), Parameter("b", 0.0)]
    slopes = np.column_stack([np.arange(4.0), np.ones(4)])
    for at_bound in (-1.0, 1.0):  # takes no part in the errors of the others
        covariance = made_fit(np.zeros(4), parameters, slopes, [at_bound, 0.0]).covariance()
        np.testing.assert_allclose(covariance, [[0.0, 0.0], [0.0, 0.25]], rtol=1e-12)


def test_a_fit_without_steps_left_or_dominated_stops_with_a_reason():
    few = replace(DEFAULT_SETTINGS, stopping=replace(DEFAULT_SETTINGS.stopping, max_steps=1))
    found = fit_hypothesis(problem(toy(FRICTION, seed=7), settings=few), (candidate_of("coulomb"),))
    assert found.status == STOPPED and "1 steps" in found.reason
    here = free_oscillator(1.4, spring=0.3)
    dominated, slow = (
        fit_hypothesis(here, (SPRING,), sufficient_chi2=chi2) for chi2 in (300.0, np.inf)
    )
    assert dominated.simulations < slow.simulations
    assert dominated.status == STOPPED and "poor" in dominated.reason


def probed(residual, **parameter):
    """Finite differences probed at 0 for a problem with one parameter."""
    problem = SimpleNamespace(parts=[], settings=DEFAULT_SETTINGS, residual=residual)
    differences, size = FiniteDifferences(problem), Parameter("a", 0.0, step=2.0, **parameter)
    differences.probe([size], {"a": 0.0}, np.array([0.0, 1.0]))
    return differences


def test_numerical_noise_is_the_change_by_a_minimal_step():
    """A residual changes by 3 for any step: steps grow fivefold and chi2 is known to 6."""
    for high, sign in ((np.inf, 1.0), (0.0, -1.0)):
        asked = []

        def residual(values, asked=asked):
            asked.append(values["a"])
            return np.array([3.0 if values["a"] else 0.0, 1.0])

        found = probed(residual, high=high)
        assert asked == [sign * 2e-6, sign * 4e-6]
        assert (found.numerical_noise, found.target, found.numerical_noise_chi2) == (3.0, 15.0, 6.0)
    # a sensor so good that a millionth of a usual step changes its residuals by 100 has none
    assert probed(lambda values: np.array([5e7 * values["a"], 1.0])).numerical_noise < 1e-6


def test_draws_are_widened_by_the_held_out_gap_within_bounds():
    parameters = (Parameter("a", 0.0, -2.0, 9.0),)
    fit = Fit((), parameters, np.zeros(1), np.ones(99), np.ones((99, 1)), 1, "converged")
    drawn = replace(fit, draws=np.array([[-1.0], [0.0], [1.0], [2.0]]))
    assert drawn.distribution.draws.tolist() == drawn.draws.tolist()
    assert replace(drawn, gap_left=3.0).distribution.draws[:, 0] == pytest.approx(
        [-2.0, 0.0, 3.0, 6.0], rel=0.02
    )


# Bounded steps and early stopping


def test_a_dominated_fit_stops_early_and_the_true_one_does_not():
    here = free_oscillator(swing=0.3)
    true = fit_hypothesis(here, (SWING,))
    again = fit_hypothesis(here, (SWING,), sufficient_chi2=true.chi2)
    assert (again.status, again.chi2, again.simulations) == (CONVERGED, true.chi2, true.simulations)
    wrong, ended = (
        fit_hypothesis(here, (SPRING,), sufficient_chi2=chi2) for chi2 in (np.inf, true.chi2)
    )
    assert (ended.status, ended.reason) == (STOPPED, "another effect fits far better")
    assert ended.simulations < 0.7 * wrong.simulations
    assert ended.chi2 > wrong.chi2 > 10.0 * true.chi2


def test_a_slow_true_fit_is_not_stopped():
    here = free_oscillator()
    start = {"frequency": 1.3}
    slow = fit_hypothesis(here, start=start)
    assert slow.chi2 < here.size
    assert fit_hypothesis(here, start=start, sufficient_chi2=slow.chi2).chi2 == pytest.approx(
        slow.chi2, abs=1.0
    )


# Significance of an effect


def effect_fit(values, slopes, low=-np.inf, high=np.inf):
    """A fit of an effect with several amplitudes, and the effect."""
    parts = tuple(Parameter(f"part{place}", 0.0, low, high) for place in range(len(values)))
    effect = Candidate("effect", "crank", parts, tuple(p.name for p in parts))
    keys = [Parameter(f"effect.{p.name}", 0.0, low, high) for p in parts]
    return made_fit(np.zeros(len(slopes)), keys, slopes, values, (effect,)), effect


def test_all_parts_of_an_effect_count_together_with_their_covariance():
    """Each part is two standard errors from 0; together chi2 is 8 with 2 degrees of freedom."""
    both = effect_fit([2.0, 2.0], np.eye(2))
    assert wald_statistic(*both) == pytest.approx(8.0)
    assert chance(*both) == pytest.approx(chi2_distribution.sf(8.0, 2))
    slopes, values = np.array([[1.0, 0.9], [0.0, 0.5], [0.3, -0.2]]), np.array([1.0, -2.0])
    assert wald_statistic(*effect_fit(values, slopes)) == pytest.approx(
        values @ slopes.T @ slopes @ values
    )


def test_a_size_at_a_nonzero_bound_counts_with_its_unbounded_error():
    at_bound, inside = (
        wald_statistic(*effect_fit([first, 0.1], np.eye(2), low=-5.0)) for first in (-5.0, -4.999)
    )
    assert at_bound == pytest.approx(25.01) and at_bound == pytest.approx(inside, rel=1e-3)
    assert chance(*effect_fit([-0.1], np.full((3, 1), 1e-3), -0.1, 0.5)) > 0.5
    none = effect_fit([0.0], np.ones((3, 1)), low=0.0)  # absent
    assert (wald_statistic(*none), chance(*none)) == (0.0, 1.0)


def test_the_wald_statistic_is_the_gain_in_chi2_for_linear_residuals():
    model = toy({"constant_force": {"force_N": 0.05}}, seed=4)
    here, effect = Problem(model, stated_noise(model)), candidate_of("constant_force")
    base, found = fit_hypothesis(here, refresh=True), fit_hypothesis(here, (effect,), refresh=True)
    inflation = max(1.0, found.chi2 / (here.size - len(found.parameters)))
    assert wald_statistic(found, effect) * inflation == pytest.approx(
        base.chi2 - found.chi2, rel=0.02
    )


class OneRunLinearised:
    """A model of which the first run is linearised."""

    def __init__(self, model):
        self._model, self.linearised = model, model.series[0].run

    def __getattr__(self, name):
        return getattr(self._model, name)

    def changes(self, run, values, effects, variations):
        if run != self.linearised:
            return None
        base = self.simulate(run, values, effects)
        there = [self.simulate(run, *variation) for variation in variations]
        return [{name: one[name] - base[name] for name in base} for one in there]


def test_runs_that_a_model_linearises_need_no_differences():
    model = toy(FRICTION, seed=5)
    here = problem(model)
    start = {p.key: p.nominal for p in here.parameters(VISCOUS)}
    residual = here.residual(start, VISCOUS)
    by_differences = FiniteDifferences(here).jacobian(
        here.parameters(VISCOUS), start, residual, VISCOUS
    )
    here = problem(OneRunLinearised(model))
    linearised, simulated = here.model.linearised, []
    here.predict = lambda run, *more: simulated.append(run) or Problem.predict(here, run, *more)
    found = FiniteDifferences(here).jacobian(here.parameters(VISCOUS), start, residual, VISCOUS)
    assert simulated and linearised not in simulated
    scale = np.linalg.norm(by_differences, axis=0)
    np.testing.assert_allclose(found / scale, by_differences / scale, atol=1e-2)


def test_a_provisional_fit_stops_where_it_needs_new_derivatives_and_can_be_continued():
    model = free_oscillator(frequency=1.5)
    whole, begun = fit_hypothesis(model), fit_hypothesis(model, vary=())
    known = dict(zip((p.key for p in whole.parameters), whole.jacobian.T, strict=True))
    provisional = fit_hypothesis(model, known_derivatives=known, provisional=True)
    assert (provisional.status, provisional.reason) == (STOPPED, NEEDS_DERIVATIVES)
    assert provisional.simulations < whole.simulations and provisional.chi2 < begun.chi2
    continued = fit_hypothesis(model, start=provisional.mapping)
    assert continued.chi2 == pytest.approx(whole.chi2, abs=1.0)
