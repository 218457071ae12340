"""Estimates as a verdict states them: value, standard error, 90 % interval, and a remark where there is none."""

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


def fit_of(candidate, *values, nuisances=(), covariance=None):
    parameters = (
        *nuisances,
        *(Parameter(f"{candidate.label}.{p.name}", p.nominal, p.low, p.high) for p in candidate.coordinates),
    )
    jacobian = np.zeros((9, len(parameters)))
    if covariance is not None:
        jacobian[: len(parameters)] = np.linalg.cholesky(np.linalg.inv(covariance)).T
    return Fit((candidate,), parameters, np.array(values, float), np.zeros(9), jacobian, 1, "converged")


def test_half_widths_are_those_of_the_normal_distribution():
    for level, half_width in HALF_WIDTHS.items():
        assert math.erf(half_width / math.sqrt(2.0)) == pytest.approx(level / 100.0, abs=1e-4)


def test_the_interval_is_the_value_and_its_half_width_to_either_side():
    found = estimate_with_interval(10.0, 2.0, -100.0, 100.0)
    assert (found["value"], found["sd"]) == (10.0, 2.0)
    for level, half_width in HALF_WIDTHS.items():
        assert found[f"interval_{level}"] == [10.0 - 2.0 * half_width, 10.0 + 2.0 * half_width]


def test_the_interval_ends_at_the_bounds():
    assert estimate_with_interval(1.0, 2.0, 0.0, 3.0)["interval_90"] == [0.0, 3.0]


@pytest.mark.parametrize(("value", "remark"), [(0.0, AT_BOUND), (5.0, AT_BOUND), (2.0, NOT_ESTIMATED)])
def test_without_an_error_there_is_no_interval_but_a_remark(value, remark):
    found = estimate_with_interval(value, 0.0, 0.0, 5.0)
    assert found == {"value": value, "sd": None, **NO_INTERVALS, "remark": remark}


def test_a_coordinate_that_is_stated_as_it_is_keeps_its_error_and_its_bounds():
    force = Candidate("coulomb", "slider", (Parameter("force_N", 0.0, 0.0, step=0.1),), ("force_N",))
    mass = Parameter("mass", 1.0)
    found = effect_estimates(fit_of(force, 1.0, 0.1, nuisances=(mass,), covariance=np.diag([9.0, 0.04])), force)
    exact = truncnorm(-0.5, math.inf, 0.1, 0.2)
    assert found["force_N"]["sd"] == pytest.approx(exact.std(), rel=0.03)
    assert found["force_N"]["interval_90"] == pytest.approx(exact.ppf([0.05, 0.95]), abs=0.01)


def test_amplitude_and_phase_take_their_errors_from_cosine_and_sine_linearly():
    def polar(values):
        return {"amplitude": math.hypot(values["c"], values["s"]), "phase": math.atan2(values["s"], values["c"])}

    wave = Candidate("wave", "slider", (Parameter("c", 0.0), Parameter("s", 0.0)), ("c", "s"), parameters=polar)
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    found = effect_estimates(fit_of(wave, 3.0, 4.0, covariance=covariance), wave)
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6]) / 5.0
    assert found["amplitude"]["value"] == pytest.approx(5.0)
    assert found["amplitude"]["sd"] == pytest.approx(np.sqrt(along @ covariance @ along), rel=1e-6)
    assert found["phase"]["sd"] == pytest.approx(np.sqrt(across @ covariance @ across), rel=1e-6)
    assert found["phase"]["interval_90"][1] == pytest.approx(math.atan2(4, 3) + 1.645 * found["phase"]["sd"])


def test_what_no_fit_varies_is_not_estimated():
    film = Candidate(
        "film", "pin", (Parameter("viscosity", 0.0, 0.0, step=0.1),), ("viscosity",),
        parameters=lambda values: {"viscosity": values["viscosity"], "length": 0.01},
    )  # fmt: skip
    found = effect_estimates(fit_of(film, 0.2, covariance=np.array([[0.01]])), film)
    assert found["length"] == {"value": 0.01, "sd": None, **NO_INTERVALS, "remark": NOT_ESTIMATED}
    assert "remark" not in found["viscosity"]


@pytest.mark.parametrize(("value", "low", "high"), [(0.0, 0.0, math.inf), (4.0, -math.inf, 4.0)])
def test_what_follows_from_a_coordinate_at_its_bound_is_at_its_bound_too(value, low, high):
    stretch = Candidate(
        "stretch", "rod", (Parameter("x", 0.0, low, high, step=0.5),), ("x",),
        parameters=lambda values: {"double": 2.0 * values["x"], "constant": 7.0},
    )  # fmt: skip
    found = effect_estimates(fit_of(stretch, value), stretch)
    assert found["double"]["remark"] == AT_BOUND
    assert found["constant"]["remark"] == NOT_ESTIMATED


def test_nuisances_are_those_parameters_that_belong_to_no_effect():
    force = Candidate("coulomb", "slider", (Parameter("force_N", 0.0, 0.0, step=0.1),), ("force_N",))
    mass, own = Parameter("mass", 1.0, 0.5, 1.2), Parameter("own", 0.0, run="slow")
    found = nuisance_estimates(
        fit_of(force, 1.1, -2.0, 4.0, nuisances=(mass, own), covariance=np.diag([0.01, 0.25, 0.09]))
    )
    assert [p for p, _ in found] == [mass, own]
    assert found[0][1]["interval_90"] == pytest.approx(truncnorm(-6.0, 1.0, 1.1, 0.1).ppf([0.05, 0.95]), abs=0.003)
    assert found[1][1]["interval_90"] == pytest.approx([-2.0 - 0.8225, -2.0 + 0.8225], abs=0.04)


def test_a_nuisance_that_changes_nothing_is_told_as_that_and_not_as_fitted():
    model = toy(seed=0, channels=("acceleration",))  # no force is read: the mass changes nothing
    fit = fit_hypothesis(Problem(model, stated_noise(model)), refresh=True)
    told = {p.name: estimate for p, estimate in nuisance_estimates(fit)}
    assert told["slider_mass"] == {"value": 0.5, "sd": None, **NO_INTERVALS, "remark": CHANGES_NOTHING}
    assert told["crank_length"]["sd"] > 0.0


def test_what_follows_from_a_coordinate_at_its_bound_has_an_interval_to_one_side():
    stretch = Candidate(
        "stretch", "rod", (Parameter("x", 0.0, 0.0, step=0.5),), ("x",),
        parameters=lambda values: {"double": 2.0 * values["x"]},
    )  # fmt: skip
    found = effect_estimates(fit_of(stretch, 0.0, covariance=np.array([[0.04]])), stretch)["double"]
    assert found["sd"] is None and found["remark"] == AT_BOUND
    assert found["interval_90"] == pytest.approx([0.0, 2.0 * truncnorm(0.0, math.inf, 0.0, 0.2).ppf(0.9)], abs=0.03)


def drawn(candidate, value, draws):
    """A fit of one coordinate that is distributed as these draws."""
    known = BoundedNormal(np.array([[np.var(draws)]]), np.array(draws, float)[:, None])
    (p,) = candidate.coordinates
    parameter = Parameter(f"{candidate.label}.{p.name}", p.nominal, p.low, p.high)
    return SimpleNamespace(
        parameters=(parameter,), values=np.array([value]), distribution=known, settings=DEFAULT_SETTINGS
    )


@pytest.mark.parametrize("value", [-0.01, 0.03, 0.2, 0.5, 0.8, 0.97, 1.01])
def test_intervals_hold_the_value_their_share_and_those_of_lower_levels(value):
    force, draws = Candidate("force", "slider", (Parameter("force_N", 0.0),), ("force_N",)), np.linspace(0.0, 1.0, 401)
    found = effect_estimates(drawn(force, value, draws), force)["force_N"]
    inner = [value, value]
    for level in (50, 90, 99):
        low, high = found[f"interval_{level}"]
        assert low <= inner[0] <= inner[1] <= high
        assert np.mean((low <= draws) & (draws <= high)) == pytest.approx(level / 100.0, abs=0.005)
        inner = [low, high]


def test_no_end_of_an_interval_is_infinite():
    force = Candidate("force", "slider", (Parameter("force_N", 0.0, 0.0, step=0.1),), ("force_N",))
    found = effect_estimates(drawn(force, 9.0, np.linspace(0.0, 1.0, 101)), force)["force_N"]  # beyond all draws
    assert found["interval_90"] == pytest.approx([0.1, 9.0])

    def stiffness(values):
        return {"stiffness": 1.0 / values["compliance"] if values["compliance"] else math.inf}

    soft = Parameter("compliance", 0.0, 0.0, 1.0, step=0.1)
    rod = Candidate("rod", "rod", (soft,), ("compliance",), parameters=stiffness)
    found = effect_estimates(drawn(rod, 1.0, [0.0] * 20 + [1.0] * 80), rod)["stiffness"]
    assert found["interval_90"] == [1.0, None]
    assert found["remark"] == AT_BOUND


def coefficient(change_low, change_high, nominal=0.1):
    """An effect that states a whole coefficient and is fitted as its change."""
    return Candidate(
        "friction",
        "pin",
        (Parameter("change", 0.0, change_low, change_high, step=0.01),),
        ("change",),
        parameters=lambda values: {"coefficient": nominal + values["change"]},
    )


@pytest.mark.parametrize(("change", "end"), [(-0.095, 0.0), (0.495, 0.6)])
def test_the_interval_of_what_follows_from_a_coordinate_stays_within_what_that_allows(change, end):
    candidate = coefficient(-0.1, 0.5)
    found = effect_estimates(fit_of(candidate, change, covariance=np.array([[0.02**2]])), candidate)["coefficient"]
    low, high = found["interval_90"]
    exact = truncnorm((-0.1 - change) / 0.02, (0.5 - change) / 0.02, 0.1 + change, 0.02)
    assert 0.0 <= low < found["value"] < high <= 0.6
    assert (low, high) == pytest.approx(tuple(exact.ppf([0.05, 0.95])), abs=2e-3)
    assert found["sd"] > 0.0
    assert abs(found["value"] - end) < 0.01


@pytest.mark.parametrize("change", [-0.1, 0.5])
def test_at_a_bound_the_interval_of_what_follows_holds_its_own_value(change):
    candidate = coefficient(-0.1, 0.5)
    found = effect_estimates(fit_of(candidate, change, covariance=np.array([[0.02**2]])), candidate)["coefficient"]
    assert found["remark"] == AT_BOUND
    assert found["interval_90"][0] <= found["value"] <= found["interval_90"][1]


def test_a_phase_far_from_the_bounds_of_its_parts_takes_its_error_linearly_though_others_are_cut_off():
    torque = Candidate(
        "torque",
        "crank",
        (Parameter("cosine", 0.0), Parameter("sine", 0.0)),
        ("cosine", "sine"),
        parameters=lambda values: {"phase": math.atan2(values["sine"], values["cosine"])},
    )
    cut = Parameter("friction", 0.1, 0.1, 0.2)
    fit = fit_of(torque, 0.1, -1.0, 0.02, nuisances=(cut,), covariance=np.diag([0.01, 1e-4, 1e-4]))
    assert fit.distribution.draws is not None
    found = effect_estimates(fit, torque)["phase"]
    assert found["interval_90"] == pytest.approx([math.pi - 0.03645, math.pi - 0.00355], abs=1e-4)


def test_the_settings_of_a_problem_reach_its_intervals():
    """Where any bound counts as far, none cuts an interval off."""
    candidate = coefficient(-0.1, 0.5)
    cut_off = fit_of(candidate, -0.095, covariance=np.array([[0.02**2]]))
    settings = replace(DEFAULT_SETTINGS, intervals=replace(DEFAULT_SETTINGS.intervals, far_standard_deviations=0.0))
    assert effect_estimates(cut_off, candidate)["coefficient"]["interval_90"][0] >= 0.0
    assert effect_estimates(replace(cut_off, settings=settings), candidate)["coefficient"]["interval_90"][0] < 0.0
    model = toy(seed=1)
    assert fit_hypothesis(Problem(model, stated_noise(model), settings=settings)).settings is settings


def test_only_parameters_that_the_data_determine_are_taken_over():
    mass = Parameter("slider_mass", 0.5, 0.4, 0.6)
    restitution = Parameter("restitution", 0.5, 0.2, 0.795)
    friction = Parameter("joint_friction", 0.1, 0.05, 0.15)
    force = Candidate("push", "slider", (Parameter("force_N", 0.0, -50.0, 50.0),), ("force_N",))
    errors = np.diag([0.002, 0.05, 0.2, 0.1]) ** 2  # of the friction anything is possible
    fit = fit_of(force, 0.447, 0.795, 0.12, 2.5, nuisances=(mass, restitution, friction), covariance=errors)
    values = determined_values(fit)
    assert values["slider_mass"] == 0.447 and values["push.force_N"] == 2.5
    assert values["restitution"] == 0.5 and values["joint_friction"] == 0.1
    told = {p.name: is_taken_over(p, estimate) for p, estimate in nuisance_estimates(fit)}
    assert told == {"slider_mass": True, "restitution": False, "joint_friction": False}
