"""Estimates of a verdict: value, standard error, intervals and remarks."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import truncnorm

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.fit import (
    AT_BOUND,
    CHANGES_NOTHING,
    HALF_WIDTHS,
    NOT_DETERMINED,
    NOT_ESTIMATED,
    BoundedNormal,
    Fit,
    determined_values,
    effect_estimates,
    estimate_with_interval,
    fit_hypothesis,
    is_taken_over,
    nuisance_estimates,
)
from jointgap.identification.problem import Problem
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.identification.toy import stated_noise, toy

NO_INTERVALS = {f"interval_{level}": [None, None] for level in HALF_WIDTHS}


def effect(name, *coordinates, states=dict):
    return Candidate(
        name, "slider", coordinates, tuple(p.name for p in coordinates), parameters=states
    )


def stretch(low, high, **states):
    """An effect that states what follows from its coordinate."""
    x = Parameter("x", 0.0, low, high, step=0.5)
    return effect(
        "stretch", x, states=lambda at: {key: state(at["x"]) for key, state in states.items()}
    )


FORCE = effect("coulomb", Parameter("force_N", 0.0, 0.0, step=0.1))


def fit_of(candidate, *values, nuisances=(), covariance=None):
    sizes = [replace(p, name=f"{candidate.label}.{p.name}") for p in candidate.coordinates]
    parameters = (*nuisances, *sizes)
    jacobian = np.zeros((9, len(parameters)))
    if covariance is not None:
        jacobian[: len(parameters)] = np.linalg.cholesky(np.linalg.inv(covariance)).T
    return Fit(
        (candidate,), parameters, np.array(values, float), np.zeros(9), jacobian, 1, "converged"
    )


def cut_off(value, sd, low, high=math.inf):
    """The normal distribution within bounds."""
    return truncnorm((low - value) / sd, (high - value) / sd, value, sd)


def test_the_interval_is_value_plus_minus_half_width_within_bounds():
    found = estimate_with_interval(10.0, 2.0, -100.0, 100.0)
    assert (found["value"], found["sd"]) == (10.0, 2.0)
    for level, half_width in HALF_WIDTHS.items():
        assert math.erf(half_width / math.sqrt(2.0)) == pytest.approx(level / 100.0, abs=1e-4)
        assert found[f"interval_{level}"] == [10.0 - 2.0 * half_width, 10.0 + 2.0 * half_width]
    assert estimate_with_interval(1.0, 2.0, 0.0, 3.0)["interval_90"] == [0.0, 3.0]
    for value, remark in ((0.0, AT_BOUND), (5.0, AT_BOUND), (2.0, NOT_ESTIMATED)):  # no error
        found = estimate_with_interval(value, 0.0, 0.0, 5.0)
        assert found == {"value": value, "sd": None, **NO_INTERVALS, "remark": remark}


def test_amplitude_and_phase_have_linearly_propagated_errors():
    def polar(values):
        return {
            "amplitude": math.hypot(values["c"], values["s"]),
            "phase": math.atan2(values["s"], values["c"]),
        }

    wave = effect("wave", Parameter("c", 0.0), Parameter("s", 0.0), states=polar)
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    found = effect_estimates(fit_of(wave, 3.0, 4.0, covariance=covariance), wave)
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6]) / 5.0
    assert found["amplitude"]["value"] == pytest.approx(5.0)
    assert found["amplitude"]["sd"] == pytest.approx(np.sqrt(along @ covariance @ along), rel=1e-6)
    assert found["phase"]["sd"] == pytest.approx(np.sqrt(across @ covariance @ across), rel=1e-6)
    assert found["phase"]["interval_90"][1] == pytest.approx(
        math.atan2(4, 3) + 1.645 * found["phase"]["sd"]
    )
    # so does a phase far from the bounds of its parts though others are cut off
    cut = Parameter("friction", 0.1, 0.1, 0.2)
    fit = fit_of(wave, 0.1, -1.0, 0.02, nuisances=(cut,), covariance=np.diag([0.01, 1e-4, 1e-4]))
    assert fit.distribution.draws is not None
    found = effect_estimates(fit, wave)["phase"]
    assert found["interval_90"] == pytest.approx([math.pi - 0.03645, math.pi - 0.00355], abs=1e-4)


def test_a_derived_value_at_a_bound_has_a_one_sided_interval():
    for value, low, high in ((0.0, 0.0, math.inf), (4.0, -math.inf, 4.0)):
        double = stretch(low, high, double=lambda x: 2.0 * x, constant=lambda x: 7.0)
        found = effect_estimates(fit_of(double, value), double)
        assert (found["double"]["remark"], found["constant"]["remark"]) == (AT_BOUND, NOT_ESTIMATED)
    double = stretch(0.0, math.inf, double=lambda x: 2.0 * x)
    found = effect_estimates(fit_of(double, 0.0, covariance=np.array([[0.04]])), double)["double"]
    assert found["sd"] is None and found["remark"] == AT_BOUND
    assert found["interval_90"] == pytest.approx(
        [0.0, 2.0 * cut_off(0.0, 0.2, 0.0).ppf(0.9)], abs=0.03
    )


def test_a_nuisance_without_influence_is_reported_as_such():
    model = toy(seed=0, channels=("acceleration",))  # no force is read: the mass changes nothing
    fit = fit_hypothesis(Problem(model, stated_noise(model)), refresh=True)
    estimates = {p.name: estimate for p, estimate in nuisance_estimates(fit)}
    without_influence = {"value": 0.5, "sd": None, "remark": CHANGES_NOTHING} | NO_INTERVALS
    assert estimates["slider_mass"] == without_influence
    assert estimates["crank_length"]["sd"] > 0.0


def test_an_undetermined_nuisance_has_no_interval():
    nuisances = (Parameter("restitution", 0.5, 0.3, 0.9),)

    def estimates(error, value=0.5):
        fit = fit_of(FORCE, value, 1.0, nuisances=nuisances, covariance=error)
        return nuisance_estimates(fit)[0][1]

    low, _ = estimates(np.diag([0.02, 0.1]) ** 2)["interval_90"]
    assert low == pytest.approx(0.5 - 0.0329, abs=1e-4)
    undetermined = {"value": 0.5, "sd": None, "remark": NOT_DETERMINED} | NO_INTERVALS
    assert estimates(np.diag([9.0, 0.1]) ** 2) == undetermined
    assert estimates(np.diag([9.0, 0.1]) ** 2, 0.9)["remark"] == AT_BOUND


# Of draws


def drawn(candidate, value, draws):
    """Estimates from a fit of one coordinate that is distributed as these draws."""
    known = BoundedNormal(np.array([[np.var(draws)]]), np.array(draws, float)[:, None])
    (p,) = candidate.coordinates
    fit = SimpleNamespace(values=np.array([value]), distribution=known, settings=DEFAULT_SETTINGS)
    fit.parameters = (replace(p, name=f"{candidate.label}.{p.name}"),)
    return effect_estimates(fit, candidate)


def test_intervals_contain_the_value_their_share_of_draws_and_lower_levels():
    force, draws = effect("force", Parameter("force_N", 0.0)), np.linspace(0.0, 1.0, 401)

    for value in [-0.01, 0.03, 0.2, 0.5, 0.8, 0.97, 1.01]:
        found, inner = drawn(force, value, draws)["force_N"], [value, value]
        for level in (50, 90, 99):
            low, high = found[f"interval_{level}"]
            assert low <= inner[0] <= inner[1] <= high and low < value < high
            assert np.mean((low <= draws) & (draws <= high)) == pytest.approx(
                level / 100.0, abs=0.005
            )
            inner = [low, high]


def test_interval_ends_are_finite():
    found = drawn(FORCE, 9.0, np.linspace(0.0, 1.0, 101))["force_N"]  # beyond all draws: symmetric
    assert found["interval_90"] == pytest.approx([0.1, 17.9])
    rod = stretch(
        0.0, 1.0, stiffness=lambda compliance: 1.0 / compliance if compliance else math.inf
    )
    found = drawn(rod, 1.0, [0.0] * 20 + [1.0] * 80)["stiffness"]
    assert (found["interval_90"], found["remark"]) == ([1.0, None], AT_BOUND)


# Adopted values


def test_only_determined_parameters_are_adopted():
    mass = Parameter("slider_mass", 0.5, 0.4, 0.6)
    restitution = Parameter("restitution", 0.5, 0.2, 0.795)
    friction = Parameter("joint_friction", 0.1, 0.05, 0.15)
    push = effect("push", Parameter("force_N", 0.0, -50.0, 50.0))
    errors = np.diag([0.002, 0.05, 0.2, 0.1]) ** 2  # of the friction anything is possible
    given = {"nuisances": (mass, restitution, friction), "covariance": errors}
    fit = fit_of(push, 0.447, 0.795, 0.12, 2.5, **given)
    values = {"slider_mass": 0.447, "push.force_N": 2.5, "restitution": 0.5, "joint_friction": 0.1}
    assert {key: determined_values(fit)[key] for key in values} == values
    estimates = {p.name: is_taken_over(estimate) for p, estimate in nuisance_estimates(fit)}
    assert estimates == {"slider_mass": True, "restitution": False, "joint_friction": False}
