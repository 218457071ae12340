"""The base is fitted from several starts until a minimum recurs."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.errors import SimulationError
from jointgap.identification import baseline
from jointgap.identification.baseline import deepest_base, recalibrate
from jointgap.identification.fit import FiniteDifferences, fit_hypothesis
from jointgap.identification.hypothesis_fits import fit_singles
from jointgap.identification.model_selection import select_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.thresholds import screen_candidates
from tests.identification.oscillator import SWING, WOBBLE, linear, noise_of
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


def test_with_loose_joints_base_and_forces_are_fitted_to_whole_runs():
    """The model offers windows for everything. Only a hidden clearance uses them."""
    problem = linear(
        hidden={"swing": {"size": 0.1}}, candidates=(SWING, WOBBLE), numerics=("another step",)
    )
    found = recalibrate(problem.model, noise_of(problem))
    assert not found.base.in_windows and not found.nominal.in_windows
    assert [p.key for p in found.nominal.parameters] == ["zero@slow", "zero@fast"]
    assert problem.size < found.base.chi2 < found.nominal.chi2  # whose drive is not the true one
    screening = screen_candidates(found, 0.01)
    fits, _ = fit_singles(found, screening.sensitivities, screening.limits)
    named = select_hypothesis(found, screening.sensitivities, fits, screening.limits)
    assert (named.verdict, named.chosen.label) == ("named", "swing")
    assert not named.chosen.in_windows and problem.model.filtered == []
    assert named.chosen.mapping["swing.size"] == pytest.approx(0.1, abs=0.01)
    assert named.chosen.mapping["drive"] == pytest.approx(0.3, abs=0.01)


def test_a_rig_that_cannot_be_simulated_reports_the_reason():
    problem = linear()

    def simulate(*_, **__):
        raise SimulationError("the pins are beyond their bearings")

    problem.model.simulate = simulate
    with pytest.raises(SimulationError, match=r"the pins are beyond"):
        recalibrate(problem.model, noise_of(problem))
