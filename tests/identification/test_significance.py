"""Whether an effect is there, against what its covariance says of it."""

import numpy as np
import pytest
from scipy.stats import chi2

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.fit import chance, fit_hypothesis, wald_statistic
from jointgap.identification.problem import Problem
from tests.identification.test_fit import made_fit
from tests.identification.toy import candidate_of, stated_noise, toy


def fit_of(values, slopes, low=-np.inf, high=np.inf):
    """A fit of an effect with so many parts, and that effect."""
    parts = tuple(Parameter(f"part{place}", 0.0, low, high) for place in range(len(values)))
    effect = Candidate("effect", "crank", parts, tuple(p.name for p in parts))
    keys = [Parameter(f"effect.{p.name}", 0.0, low, high) for p in parts]
    return made_fit(np.zeros(len(slopes)), keys, slopes, values, (effect,)), effect


def test_all_parts_of_an_effect_count_together_and_errors_that_go_together_as_such():
    """Each part alone is two standard errors from 0; together their chance is that of a chi2 of 8 with 2 degrees."""
    both = fit_of([2.0, 2.0], np.eye(2))
    assert wald_statistic(*both) == pytest.approx(8.0)
    assert chance(*both) == pytest.approx(chi2.sf(8.0, 2))
    slopes, values = np.array([[1.0, 0.9], [0.0, 0.5], [0.3, -0.2]]), np.array([1.0, -2.0])
    assert wald_statistic(*fit_of(values, slopes)) == pytest.approx(values @ slopes.T @ slopes @ values)


def test_what_stands_at_a_bound_other_than_zero_counts_by_the_error_that_it_would_have_beyond():
    at_bound, inside = (wald_statistic(*fit_of([first, 0.1], np.eye(2), low=-5.0)) for first in (-5.0, -4.999))
    assert at_bound == pytest.approx(25.01) and at_bound == pytest.approx(inside, rel=1e-3)
    assert chance(*fit_of([-0.1], np.full((3, 1), 1e-3), -0.1, 0.5)) > 0.5
    none = fit_of([0.0], np.ones((3, 1)), low=0.0)  # what stands at zero is not there
    assert (wald_statistic(*none), chance(*none)) == (0.0, 1.0)


def test_the_statistic_is_what_chi2_gains_where_residuals_are_linear():
    model = toy({"constant_force": {"force_N": 0.05}}, seed=4)
    here, effect = Problem(model, stated_noise(model)), candidate_of("constant_force")
    base, found = fit_hypothesis(here, refresh=True), fit_hypothesis(here, (effect,), refresh=True)
    inflation = max(1.0, found.chi2 / (here.size - len(found.parameters)))
    assert wald_statistic(found, effect) * inflation == pytest.approx(base.chi2 - found.chi2, rel=0.02)
