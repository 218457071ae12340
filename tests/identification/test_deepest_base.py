"""The base is fitted from several starts until a minimum recurs."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.errors import SimulationError
from jointgap.identification import baseline
from jointgap.identification.baseline import deepest_base, recalibrate
from jointgap.identification.fit import FiniteDifferences, fit_hypothesis
from jointgap.identification.problem import Problem
from tests.identification.oscillator import linear, noise_of
from tests.identification.toy import stated_noise, toy


def test_a_base_with_remaining_misfit_is_refitted_until_a_minimum_recurs(monkeypatch):
    model = toy(hidden=lambda x, v, angle, time: -0.3 * v**3, seed=1)
    problem = Problem(model, stated_noise(model))
    differences = FiniteDifferences(problem)
    base = fit_hypothesis(problem, differences=differences)

    def deepest(off, enough=0.0):
        """The base and the masses that fits start from; each leaves `off` more than the one
        before."""
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


def test_a_rig_that_cannot_be_simulated_reports_the_reason():
    problem = linear()

    def simulate(*_, **__):
        raise SimulationError("the pins are beyond their bearings")

    problem.model.simulate = simulate
    with pytest.raises(SimulationError, match=r"the pins are beyond"):
        recalibrate(problem.model, noise_of(problem))
