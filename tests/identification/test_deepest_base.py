"""The base is fitted from drawn nuisances too, until a minimum is found twice; where joints are loose, in windows."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import Parameter
from jointgap.core.errors import SimulationError
from jointgap.identification import baseline
from jointgap.identification.baseline import Baseline, deepest_base, recalibrate
from jointgap.identification.fit import FAILED, FiniteDifferences, fit_hypothesis
from jointgap.identification.problem import Problem
from tests.identification.oscillator import Oscillator, linear, measured
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


def recalibrated(problem: Problem) -> Baseline:
    return recalibrate(problem.model, {part.series.key: part.noise for part in problem.parts})


def test_where_joints_are_loose_base_and_nominal_are_fits_in_windows_and_no_trajectory_is_simulated():
    problem = linear(numerics=("another step",))
    problem.model.simulate = None
    found = recalibrated(problem)
    assert found.base.in_windows and found.nominal.in_windows
    assert found.base.chi2 < 1.1 * problem.size < found.nominal.chi2  # whose drive is not the true one
    assert found.base.mapping["drive"] == pytest.approx(0.3, abs=0.01)
    assert [p.key for p in found.nominal.parameters] == ["zero@slow", "zero@fast"]
    assert not found.differences.numerical_noise_chi2


def test_of_a_base_in_windows_that_leaves_much_more_than_noise_nominal_values_are_not_looked_at():
    found = recalibrated(linear(hidden={"swing": {"size": 0.3}}))
    assert found.nominal.status == FAILED and found.nominal.reason
    assert found.nominal.mapping == found.base.mapping


def test_where_runs_have_nothing_for_themselves_nothing_is_fitted_at_nominal_values():
    model = Oscillator([Parameter("drive", 0.2, 0.0, 0.6, 0.01)])
    found = recalibrated(measured(model, {"drive": 0.25}, {}))
    assert found.nominal.parameters == () and found.nominal.chi2 > found.base.chi2


def test_a_rig_that_cannot_be_simulated_in_windows_as_it_stands_says_why():
    problem = linear()

    def deviance(effects):
        raise SimulationError("the pins are beyond their bearings")

    problem.model.deviance = deviance
    with pytest.raises(
        SimulationError, match=r"oscillator: the current model cannot be simulated: the pins are beyond"
    ):
        recalibrated(problem)
