"""The base is fitted from drawn nuisances too, until a minimum is found twice."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.identification import baseline
from jointgap.identification.baseline import deepest_base
from jointgap.identification.fit import FiniteDifferences, fit_hypothesis
from jointgap.identification.problem import Problem
from tests.identification.toy import stated_noise, toy


@pytest.fixture
def poor():
    """A problem whose base leaves more than noise, its fit and the differences."""
    model = toy(hidden=lambda x, v, angle, time: -0.3 * v**3, seed=1)
    problem = Problem(model, stated_noise(model))
    differences = FiniteDifferences(problem)
    return problem, fit_hypothesis(problem, differences=differences), differences


def starts_of(monkeypatch, off=0.0):
    """The masses that fits start from; each fit leaves `off` more than the one before."""
    starts = []

    def counted(*args, start, **options):
        starts.append(start["slider_mass"])
        fit = fit_hypothesis(*args, start=start, **options)
        return replace(fit, residual=fit.residual * np.sqrt(1.0 + off * len(starts)))

    monkeypatch.setattr(baseline, "fit_hypothesis", counted)
    return starts


def test_a_minimum_that_is_found_twice_ends_the_search(poor, monkeypatch):
    problem, base, differences = poor
    starts = starts_of(monkeypatch)
    assert deepest_base(problem, base, differences, 0.0).chi2 == pytest.approx(base.chi2, rel=1e-3)
    (drawn,) = starts
    mass = next(p for p in problem.nuisances if p.key == "slider_mass")
    assert mass.low < drawn < mass.high and drawn != mass.nominal


def test_all_starts_are_tried_while_others_are_found_and_the_best_counts(poor, monkeypatch):
    problem, base, differences = poor
    starts = starts_of(monkeypatch, off=0.1)
    assert deepest_base(problem, base, differences, 0.0) is base
    assert len(set(starts)) == 2


def test_a_base_that_leaves_little_enough_is_not_fitted_again(poor, monkeypatch):
    problem, base, differences = poor
    starts = starts_of(monkeypatch)
    assert deepest_base(problem, base, differences, enough=2.0 * base.chi2) is base
    assert starts == []
