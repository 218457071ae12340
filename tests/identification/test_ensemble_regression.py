"""Intervals for chaotic motion, by regression over realisations."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import Parameter
from jointgap.core.errors import SimulationError
from jointgap.identification.baseline import (
    leading_over_ensembles,
    regressed_over_ensemble,
    with_intervals,
)
from jointgap.identification.fit import Fit
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.identification.toy import candidate_of

SIZE = 600
TRUTH = np.array([0.5, -0.3, 0.2])
PARAMETERS = (
    *(Parameter(name, 0.0, -5.0, 5.0, 0.1, "kg") for name in "abc"),
    Parameter("nothing", 1.0, 0.0, 2.0, 0.1, "kg"),
    Parameter("order", 3.0, 1.0, 9.0, 1.0, "1", integer=True),
)


class Chaotic:
    """A linear problem in which every simulation, and the data, is one realisation with large
    modes."""

    settings = DEFAULT_SETTINGS
    size = SIZE
    has_statistics = True
    nuisances = PARAMETERS

    def __init__(self, seed, loudness=5.0, fails=lambda values: False):
        rng = np.random.default_rng(seed)
        self.slopes = rng.standard_normal((SIZE, 3))
        modes = np.linalg.qr(rng.standard_normal((SIZE, 2)) + 2.0 * self.slopes[:, :2])[0]
        self.modes, self.fails, self.simulations = loudness * modes, fails, 0
        self.measured = (
            self.slopes @ TRUTH + rng.standard_normal(SIZE) + self.modes @ rng.standard_normal(2)
        )

    def residual(self, values, hypothesis=()):
        """Whitened residuals (n,); any change of the values gives another realisation."""
        at = np.array([values[name] for name in "abc"])
        if self.fails(values):
            raise SimulationError("the pin left its bearing")
        self.simulations += 1
        rng = np.random.default_rng(np.frombuffer(at.tobytes(), np.uint32))
        return self.measured - self.slopes @ at - self.modes @ rng.standard_normal(2)

    def of_mean(self, values):
        """Residuals of the mean of all realisations."""
        return self.measured - self.slopes @ values[:3]

    def fit(self, **changed):
        """A fit near the minimum."""
        values = np.array([*(TRUTH + 0.2), 1.0, 3.0])
        at = dict(zip((p.key for p in PARAMETERS), values, strict=True))
        residual = np.zeros(SIZE) if self.fails(at) else self.residual(at)
        jacobian = np.column_stack([-self.slopes, np.zeros(SIZE), np.ones(SIZE)])
        return replace(Fit((), PARAMETERS, values, residual, jacobian, 0, "stopped"), **changed)


def regressed(seed, **more):
    problem = Chaotic(seed, **more)
    return problem, regressed_over_ensemble(problem, problem.fit())


def interval(fit):
    return np.quantile(fit.draws[:, :3], [0.05, 0.95], axis=0)


def rms(away):
    return np.sqrt(np.mean(np.sum(np.square(away), axis=1)))


def test_intervals_cover_the_truth_though_realisations_scatter_more_than_noise():
    held, apart, plainly, narrow, off = 0, [], [], 0, []
    for seed in range(40):
        problem, found = regressed(seed)
        low, high = interval(found)
        held += np.sum((low <= TRUTH) & (high >= TRUTH))
        apart.append(found.values[:3] - TRUTH)
        plainly.append(np.linalg.lstsq(problem.slopes, problem.measured, rcond=None)[0] - TRUTH)
        of_noise = np.sqrt(np.diag(np.linalg.inv(problem.slopes.T @ problem.slopes)))
        narrow += np.sum(np.abs(apart[-1]) < 1.645 * of_noise)
        off.append(found.residual - problem.of_mean(found.values))
    assert 0.83 < held / 120 < 0.97
    assert narrow / 120 < 0.75  # what noise alone would say
    assert np.std(apart) < 0.9 * np.std(plainly)  # directions that realisations move count less
    assert np.all(np.abs(np.mean(apart, axis=0)) < 4.0 * np.std(apart, axis=0) / np.sqrt(40))
    assert rms(off) < 0.5 * 5.0 * np.sqrt(2.0)  # a mean of realisations scatters less than one
    assert np.array_equal(found.draws, regressed(39)[1].draws)
    assert np.array_equal(found.draws, with_intervals(problem, problem.fit()).draws)


def test_parameters_without_influence_stay_and_draws_stay_within_bounds():
    problem = Chaotic(4)
    low = Parameter("a", 0.5, 0.5, 5.0, 0.1, "kg")
    found = regressed_over_ensemble(problem, problem.fit(parameters=(low, *PARAMETERS[1:])))
    assert found.values[3:].tolist() == [1.0, 3.0]
    assert np.ptp(found.draws[:, 3:], axis=0).tolist() == [0.0, 0.0]
    assert found.draws[:, 0].min() >= 0.5 and found.values[0] >= 0.5


def test_a_fit_without_free_parameters_or_with_too_few_members_is_unchanged():
    problem = Chaotic(2)
    fit = problem.fit()
    fixed = tuple(replace(p, low=v, high=v) for p, v in zip(PARAMETERS, fit.values, strict=True))
    none = Fit((), (), np.empty(0), fit.residual, np.empty((SIZE, 0)), 0, "stopped")
    for unchanged in (replace(fit, parameters=fixed), none):
        assert regressed_over_ensemble(problem, unchanged) is unchanged
    for fails, changes in ((lambda values: values["a"] > 0.6, True), (lambda values: True, False)):
        problem = Chaotic(5, fails=fails)
        fit = problem.fit()
        assert (regressed_over_ensemble(problem, fit) is not fit) == changes


# Several explanations


def test_the_base_is_also_fitted_from_the_nuisances_of_the_best_fit():
    problem = Chaotic(7, fails=lambda values: values["a"] > 1.0)
    near = problem.fit()
    # nothing can be simulated about it
    far = replace(near, values=near.values + 2.0, residual=near.residual + 2.0)
    base, (best,) = leading_over_ensembles(problem, far, [near])
    assert base.values[:3] == pytest.approx(best.values[:3], abs=0.5)
    assert best.draws is not None


def test_the_base_stays_within_bounds_that_a_replacing_effect_exceeds():
    problem = Chaotic(7)
    mass, near = replace(candidate_of("added_mass"), replaces={"a": "mass_kg"}), problem.fit()
    beyond = replace(
        near,
        hypothesis=(mass,),
        parameters=(replace(PARAMETERS[0], name="added_mass.mass_kg"), *PARAMETERS[1:]),
        draws=np.tile(near.values, (10, 1)),  # it counts as regressed already
        residual=0.1 * near.residual,
    )
    narrow = (replace(PARAMETERS[0], low=-0.1, high=0.1), *PARAMETERS[1:])
    values = np.array([0.0, *near.values[1:]])
    base = replace(near, parameters=narrow, values=values, residual=5.0 * near.residual)
    base, _ = leading_over_ensembles(problem, base, [beyond])
    assert -0.1 <= base.values[0] <= 0.1
    assert base.draws[:, 0].min() >= -0.1 and base.draws[:, 0].max() <= 0.1
