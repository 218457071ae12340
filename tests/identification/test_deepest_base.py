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
from tests.identification.oscillator import Oscillator, linear, measured, noise_of
from tests.identification.toy import stated_noise, toy


def test_a_base_that_leaves_more_than_noise_is_fitted_again_until_a_minimum_is_found_twice(monkeypatch):
    model = toy(hidden=lambda x, v, angle, time: -0.3 * v**3, seed=1)
    problem = Problem(model, stated_noise(model))
    differences = FiniteDifferences(problem)
    base = fit_hypothesis(problem, differences=differences)

    def deepest(off, enough=0.0):
        """The base and the masses that fits start from; each leaves `off` more than the one before."""
        starts = []

        def counted(*args, start, **options):
            starts.append(start["slider_mass"])
            fit = fit_hypothesis(*args, start=start, **options)
            return replace(fit, residual=fit.residual * np.sqrt(1.0 + off * len(starts)))

        monkeypatch.setattr(baseline, "fit_hypothesis", counted)
        return deepest_base(problem, base, differences, enough), starts

    found, (drawn,) = deepest(0.0)
    assert found.chi2 == pytest.approx(base.chi2, rel=1e-3)
    mass = next(p for p in problem.nuisances if p.key == "slider_mass")
    assert mass.low < drawn < mass.high and drawn != mass.nominal
    found, starts = deepest(0.1)  # others are found: the best counts
    assert found is base and len(set(starts)) == 2
    assert deepest(0.0, enough=2.0 * base.chi2) == (base, [])


def recalibrated(problem: Problem) -> Baseline:
    return recalibrate(problem.model, noise_of(problem))


def test_where_joints_are_loose_base_and_nominal_are_fits_in_windows_and_no_trajectory_is_simulated():
    problem = linear(numerics=("another step",))
    problem.model.simulate = None
    found = recalibrated(problem)
    assert found.base.in_windows and found.nominal.in_windows
    assert found.base.chi2 < 1.1 * problem.size < found.nominal.chi2  # whose drive is not the true one
    assert found.base.mapping["drive"] == pytest.approx(0.3, abs=0.01)
    assert [p.key for p in found.nominal.parameters] == ["zero@slow", "zero@fast"]
    assert not found.differences.numerical_noise_chi2


def test_nominal_values_are_not_looked_at_beside_a_poor_base_nor_fitted_where_runs_have_nothing_for_themselves():
    found = recalibrated(linear(hidden={"swing": {"size": 0.3}}))
    assert found.nominal.status == FAILED and found.nominal.reason
    assert found.nominal.mapping == found.base.mapping
    model = Oscillator([Parameter("drive", 0.2, 0.0, 0.6, 0.01)])
    found = recalibrated(measured(model, {"drive": 0.25}, {}))
    assert found.nominal.parameters == () and found.nominal.chi2 > found.base.chi2


def test_a_rig_that_cannot_be_simulated_in_windows_as_it_stands_says_why():
    def deviance(effects):
        raise SimulationError("the pins are beyond their bearings")

    with pytest.raises(SimulationError, match=r"oscillator: .*: the pins are beyond"):
        recalibrated(linear(deviance=deviance))
