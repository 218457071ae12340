"""Effects are fitted from the best of many points where chi2 has many valleys."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import FAST
from jointgap.identification import baseline, hypothesis_fits
from jointgap.identification.baseline import (
    Baseline,
    fit_from_scattered_starts,
    other_numerics,
    recalibrate,
    shared_nuisances,
)
from jointgap.identification.fit import FAILED, fit_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.screening import simulate_signatures
from jointgap.identification.thresholds import thresholds
from tests.identification.knocks import Knocking, knocking
from tests.identification.toy import stated_noise, toy

FORCE = 0.4


def caught(clearance):
    """A baseline of the toy with knocks and friction, and the fit of friction that is caught in the base's valley."""
    model = knocking({"coulomb": {"force_N": FORCE}}, clearance, seed=2)
    base: Baseline = recalibrate(model, stated_noise(model))
    coulomb = next(one for one in model.candidates if one.label == "coulomb")
    start = {"clearance": 1.0, "coulomb.force_N": 0.5 * FORCE}
    return base, fit_hypothesis(base.problem, (coulomb,), start, differences=base.differences)


@pytest.mark.parametrize("clearance", [0.93, 1.07])
def test_they_lead_to_the_valley_that_descent_from_the_base_misses(clearance):
    base, fit = caught(clearance)
    assert fit.chi2 > 2.0 * base.problem.size
    found = fit_from_scattered_starts(base, fit, 1.1 * base.problem.size)
    assert found.chi2 < 1.1 * base.problem.size
    assert found.mapping["clearance"] == pytest.approx(clearance, abs=1e-3)
    assert found.mapping["coulomb.force_N"] == pytest.approx(FORCE, rel=0.05)


def test_a_fit_that_nothing_is_better_than_stays_as_it_is():
    base, fit = caught(1.07)
    best = fit_from_scattered_starts(base, fit, 1.1 * base.problem.size)
    again = fit_from_scattered_starts(base, best, 0.0)
    assert again.chi2 <= best.chi2
    assert fit_from_scattered_starts(base, best, best.chi2) is best


def test_points_are_spread_over_the_ranges_of_the_nuisances_and_sizes_about_the_fit(monkeypatch):
    base, fit = caught(1.07)
    seen, usual = [], Problem.residual

    def watched(problem, values, hypothesis=(), runs=None, out=None, numerics=0):
        if numerics == FAST and tuple(runs) == problem.runs[:1]:
            seen.append(dict(values))
        return usual(problem, values, hypothesis, runs, out, numerics)

    monkeypatch.setattr(Problem, "residual", watched)
    fit_from_scattered_starts(base, fit, 1.1 * base.problem.size)
    settings = base.problem.settings.scattered_starts
    points = seen[: 2**settings.points_log2]
    for p in shared_nuisances(base.problem, fit.hypothesis):
        shares = np.sort([(values[p.key] - p.low) / (p.high - p.low) for values in points])
        assert np.abs(shares - (np.arange(len(shares)) + 0.5) / len(shares)).max() < 1.5 / len(shares)
    factors = [values["coulomb.force_N"] / fit.mapping["coulomb.force_N"] for values in points]
    assert min(factors) == pytest.approx(1.0 / settings.size_factor, rel=0.02)
    assert max(factors) == pytest.approx(settings.size_factor, rel=0.02)


def test_fits_start_from_the_best_of_all_points(monkeypatch):
    base, fit = caught(1.07)
    seen, starts, usual = [], [], Problem.residual

    def watched(problem, values, hypothesis=(), runs=None, out=None, numerics=0):
        if numerics == FAST and tuple(runs) == problem.runs[:1]:
            seen.append(dict(values))
        return usual(problem, values, hypothesis, runs, out, numerics)

    def left(values):
        return float(np.sum(usual(base.problem, values, fit.hypothesis, numerics=FAST) ** 2))

    monkeypatch.setattr(Problem, "residual", watched)
    monkeypatch.setattr(baseline, "fit_hypothesis", lambda _, __, start, **more: starts.append(start) or fit)
    fit_from_scattered_starts(base, fit, 0.0)
    best = sorted(map(left, seen))[: base.problem.settings.scattered_starts.starts]
    assert list(map(left, starts)) == pytest.approx(best)


def test_a_point_is_left_after_the_run_that_puts_it_behind_the_best_ones(monkeypatch):
    base, fit = caught(1.07)
    simulated, usual = {run: 0 for run in base.problem.runs}, Problem.predict

    def watched(problem, run, values, hypothesis=(), numerics=0):
        simulated[run] += numerics == FAST
        return usual(problem, run, values, hypothesis, numerics)

    monkeypatch.setattr(Problem, "predict", watched)
    fit_from_scattered_starts(base, fit, 0.0)
    first, *later = simulated.values()
    settings = base.problem.settings.scattered_starts
    assert first == 2**settings.points_log2
    assert settings.starts <= max(later) < first


@pytest.mark.parametrize(
    "model", [knocking({"viscous": {"damping_N_s_m": 0.8}}), toy({"viscous": {"damping_N_s_m": 0.8}})]
)
def test_they_are_tried_where_what_nuisances_change_rings(model, monkeypatch):
    base = recalibrate(model, stated_noise(model))
    signatures = simulate_signatures(base.problem, base.base, base.differences)
    limits = thresholds(base.problem, signatures, other_numerics(base.problem, base.base))
    coulomb = next(one for one in model.candidates if one.label == "coulomb")
    fit, tried = fit_hypothesis(base.problem, (coulomb,), differences=base.differences), []
    monkeypatch.setattr(hypothesis_fits, "fit_from_scattered_starts", lambda _, one, __: tried.append(one) or one)
    assert hypothesis_fits._from_scattered_starts(base, [replace(fit, status=FAILED), fit], limits) == []
    assert tried == ([fit] if isinstance(model, Knocking) else [])
