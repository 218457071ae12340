"""Whether an effect is there, against what its covariance says of it."""

import numpy as np
import pytest
from scipy.stats import chi2

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.fit import chance, fit_hypothesis, wald_statistic
from jointgap.identification.problem import Problem
from tests.identification.test_fit import made_fit
from tests.identification.toy import candidate_of, stated_noise, toy

TORQUE = Candidate(
    "torque", "crank", (Parameter("cosine", 0.0, low=-5.0), Parameter("sine", 0.0, low=-5.0)), ("cosine", "sine")
)
PARTS = [Parameter("torque.cosine", 0.0, low=-5.0), Parameter("torque.sine", 0.0, low=-5.0)]


def torque(values, slopes):
    return made_fit(np.zeros(len(slopes)), PARTS, slopes, values, (TORQUE,))


def test_both_parts_of_a_torque_count_together():
    """Each part alone is two standard errors from 0; together their chance is that of a chi2 of 8 with 2 degrees."""
    fitted = torque([2.0, 2.0], np.eye(2))
    assert wald_statistic(fitted, TORQUE) == pytest.approx(8.0)
    assert chance(fitted, TORQUE) == pytest.approx(chi2.sf(8.0, 2))


def test_errors_that_go_together_count_as_such():
    slopes = np.array([[1.0, 0.9], [0.0, 0.5], [0.3, -0.2]])
    fitted = torque([1.0, -2.0], slopes)
    expected = fitted.values @ slopes.T @ slopes @ fitted.values
    assert wald_statistic(fitted, TORQUE) == pytest.approx(expected)


def test_what_stands_at_a_bound_other_than_zero_counts_by_the_error_that_it_would_have_beyond():
    at_bound, inside = torque([-5.0, 0.1], np.eye(2)), torque([-4.999, 0.1], np.eye(2))
    assert wald_statistic(at_bound, TORQUE) == pytest.approx(25.01)
    assert wald_statistic(at_bound, TORQUE) == pytest.approx(wald_statistic(inside, TORQUE), rel=1e-3)
    friction = Candidate("friction", "slider", (Parameter("change", 0.0, -0.1, 0.5),), ("change",))
    size = [Parameter("friction.change", 0.0, -0.1, 0.5)]
    unknown = made_fit(np.zeros(3), size, np.full((3, 1), 1e-3), [-0.1], (friction,))
    assert chance(unknown, friction) > 0.5


def test_what_stands_at_zero_is_not_there():
    friction = Candidate("friction", "slider", (Parameter("size", 0.0, low=0.0),), ("size",))
    none = made_fit(np.zeros(3), [Parameter("friction.size", 0.0, low=0.0)], np.ones((3, 1)), [0.0], (friction,))
    assert (wald_statistic(none, friction), chance(none, friction)) == (0.0, 1.0)


def test_the_statistic_is_what_chi2_gains_where_residuals_are_linear():
    model = toy({"constant_force": {"force_N": 0.05}}, seed=4)
    here, effect = Problem(model, stated_noise(model)), candidate_of("constant_force")
    base, found = fit_hypothesis(here, refresh=True), fit_hypothesis(here, (effect,), refresh=True)
    inflation = max(1.0, found.chi2 / (here.size - len(found.parameters)))
    assert wald_statistic(found, effect) * inflation == pytest.approx(base.chi2 - found.chi2, rel=0.02)
