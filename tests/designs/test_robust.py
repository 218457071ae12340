"""Robust lengths: errors, simulated responses, the search, and the comparison of lengths."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from jointgap.config import Constraints, Scenario
from jointgap.core.errors import InputError
from jointgap.core.page import to_markdown
from jointgap.designs.optimise_robust import (
    SimulatedSamples,
    best_of,
    check,
    compare,
    optimise_robust,
    sample_scenario,
    search,
    uncertain_of,
)
from jointgap.designs.robust_study import robust_study
from jointgap.lengths.region import Region, geometric
from jointgap.motion.slider_crank import simulate
from tests.designs.standin import BOX, NOMINAL, ROD, STEADY, Formula, problem, standard_samples
from tests.motion.cases import mechanism, options

MADE = mechanism(friction=0.1)
COARSE = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)
TOLERANCE = {"distribution": "normal", "mean": "0 mm", "deviation": "0.05 mm"}
FRICTION = {"from": 0.05, "to": 0.2}
SMALL = {
    "draws": 4,
    "grid": 3,
    "population": 4,
    "generations": 2,
    "fresh_draws": 16,
    "resamples": 100,
}
BOUNDS = {"crank_length": ["148 mm", "152 mm"], "rod_length": ["560 mm", "568 mm"]}
PAIR = np.array([[0.15, 0.564], [0.151, 0.564]])


def scenario(uncertain: dict, **options) -> Scenario:
    optimise = {"boxes": {"near": BOUNDS}, "ensemble": {"settled_revolution": 2}}
    robust = SMALL | {"uncertain": uncertain} | options
    return Scenario(mechanism=MADE, simulate=COARSE, optimise=optimise, optimise_robust=robust)


@pytest.mark.parametrize(
    "uncertain, options, message",
    [
        ({}, {}, "optimise_robust.uncertain: is empty"),
        ({"frictoin": FRICTION}, {}, "did you mean 'friction'"),
        ({"friction": [0.1]}, {}, "friction: has one value only"),
        ({"friction": FRICTION}, {"probability": 1.5}, "probability"),
        (
            {"mechanism.crank.length": {"from": "149 mm", "to": "151 mm"}},
            {},
            "give crank_length with the tolerance",
        ),
        ({"crank.length": FRICTION}, {}, "give crank_length with the tolerance"),
        (
            {"friction": {"distribution": "normal", "mean": 0.05, "deviation": 0.1}},
            {},
            "truncate the distribution",
        ),
        (
            {"friction": FRICTION, "mechanism.joints.crank_pin.contact.friction": FRICTION},
            {},
            "set the same value",
        ),
        ({"simulate.revolutions": [2, 3]}, {}, "not an uncertain parameter"),
    ],
)
def test_an_infeasible_section_is_an_error_before_any_simulation(
    uncertain, options, message, monkeypatch
):
    monkeypatch.setattr("jointgap.designs.optimise_robust.simulate_runs", None)
    with pytest.raises(InputError) as error:
        check(scenario(uncertain, **options))
    assert message in str(error.value)
    assert "optimise_robust" in str(error.value) or "OptimiseRobust" in str(error.value)


def test_the_error_is_the_ideal_angle_of_the_original_lengths_minus_the_simulated_one():
    made = scenario({"friction": FRICTION, "crank_length": TOLERANCE, "rod_length": TOLERANCE})
    uncertain = uncertain_of(made)
    samples = uncertain.values(0, 2)
    responses = SimulatedSamples(made, uncertain, samples)(np.array([[0.151, 0.566]]))
    (crank, rod), sample = responses.actual[0, 1], sample_scenario(uncertain, samples[1])
    assert crank - 0.151 == pytest.approx(samples[1]["crank_length"])
    assert rod - 0.566 == pytest.approx(samples[1]["rod_length"])
    simulated = simulate(sample.mechanism.with_lengths(crank, rod), sample.simulate)
    turn = simulated.samples.iloc[-361:]
    ideal_sine = -MADE.crank.length * np.sin(turn["crank_angle"]) / MADE.rod.length
    ideal = math.pi / 2 + np.arcsin(ideal_sine)
    error = (ideal - turn["transmission_angle"]).to_numpy()[:-1]
    forces = [
        np.hypot(turn[f"{pin}_force_x"], turn[f"{pin}_force_y"]).max()
        for pin in ("crank_pin", "piston_pin")
    ]
    assert responses.error[0, 1] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
    assert responses.stroke[0, 1] == pytest.approx(np.ptp(turn["slider_position"]), rel=1e-9)
    assert responses.force[0, 1] == pytest.approx(max(forces), rel=1e-9)


def test_the_frozen_motion_at_the_original_lengths_has_the_simulated_error():
    made = scenario({"friction": FRICTION})
    nominal = SimulatedSamples(made, uncertain_of(made), [{}])
    lengths = MADE.crank.length, MADE.rod.length
    frozen = nominal.frozen().measures(lengths).rms
    assert frozen == pytest.approx(nominal(np.array([lengths])).error[0, 0], rel=1e-6)


def test_the_page_compares_all_lengths_and_advises_against_an_insignificant_change():
    made = scenario({"friction": FRICTION, "crank_length": TOLERANCE})
    optimum = optimise_robust(made, 1)
    study = robust_study(optimum, made, "mine")
    text = to_markdown(study.page)
    for label in ("original lengths", "frozen motion", "best at nominal", "16 validation"):
        assert label in text
    assert [figure.stem for figure in study.figures] == ["robust_errors"]
    for low, high, advice in (
        (-0.01, 0.02, "not significant"),
        (-0.02, -0.01, "lengths found are worse"),
    ):
        interval = {"measure_fall_low": low, "measure_fall_high": high}
        gains = optimum.gains.assign(measure_fall=(low + high) / 2, **interval)
        study = robust_study(replace(optimum, gains=gains), made, "mine")
        assert study.title == "No significant improvement: keep the original lengths"
        assert advice in to_markdown(study.page)
    candidates = optimum.candidates.assign(missed=1.0)
    study = robust_study(replace(optimum, candidates=candidates), made, "mine")
    text = to_markdown(study.page)
    assert study.title.startswith("No candidate satisfies the constraints")
    assert "No robust optimum" in text
    assert "falls by" not in text and "| robust optimum |" not in text


def test_a_gain_that_is_equal_in_all_samples_has_no_spread():
    z = standard_samples(200)
    error = 10.0 + z + np.array([[0.0], [-1.0]])
    responses = replace(Formula(z)(PAIR), error=error)
    tables = compare(problem(deviations=2.0, resamples=200), ("original", "robust"), responses)
    gain, original = tables["gains"].iloc[0], tables["lengths"].iloc[0]
    assert gain["mean_fall"] == pytest.approx(0.1)
    assert gain["mean_fall_high"] - gain["mean_fall_low"] < 0.01  # unpaired it would be 0.04
    assert (gain["probability"], gain["probability_high"]) == (1.0, 1.0)
    assert gain["probability_low"] == pytest.approx(0.025 ** (1 / 200))
    assert original["error_measure"] == pytest.approx(12.0)
    half_width = (original["error_mean_high"] - original["error_mean_low"]) / 2.0
    assert half_width == pytest.approx(stats.norm.ppf(0.975) / math.sqrt(200), rel=0.25)


def test_a_failed_sample_violates_each_constraint():
    responses = Formula(standard_samples(100), lambda lengths, z: 1.0 + 0.0 * z)(PAIR)
    error, force = responses.error.copy(), responses.force.copy()
    error[1, :40] = force[1, :40] = np.nan
    limited = problem(Constraints(largest_pin_force=2.0))
    responses = replace(responses, error=error, force=force)
    tables = compare(limited, ("original", "robust"), responses)
    probability = tables["constraints"].set_index("lengths")["probability"]
    assert probability.to_dict() == {"original": 1.0, "robust": 0.6}
    exact = 0.025 ** (1 / 100)
    assert tables["constraints"]["probability_low"][0] == pytest.approx(exact)
    assert tables["lengths"]["draws"].eq(60).all()


WITHIN = 1e-4  # [m] half a percent of the box


def best_lengths(robust_problem, formula) -> np.ndarray:
    candidates = search(robust_problem, formula)
    return best_of(candidates)[["crank_length", "rod_length"]].to_numpy(dtype=float)


@pytest.mark.parametrize(
    "weight, options",
    [
        (0.0, {"deviations": 0.0}),
        (3.0, {"deviations": 3.0}),
        (np.quantile(standard_samples(), 0.9), {"measure": "quantile", "quantile": 0.9}),
    ],
)
def test_the_search_finds_the_minimum_of_each_objective(weight, options):
    # d/dL of (L - nominal)^2 + weight (L - steady)^2 is zero at their weighted mean
    lengths = best_lengths(problem(**options), Formula(standard_samples()))
    crank = (NOMINAL + weight * STEADY) / (1.0 + weight)
    np.testing.assert_allclose(lengths, [crank, ROD], atol=WITHIN)


def test_an_uncertain_force_satisfies_its_limit_in_the_required_share_of_the_samples():
    # the force grows with the crank, so that the limit in 9 of 10 samples excludes better lengths
    z = standard_samples(40)
    limited = problem(Constraints(largest_pin_force=1000.0), probability=0.9)
    formula = Formula(
        z, force=lambda lengths, z: 1000.0 * (lengths[:, :1] / 0.150) * (1.0 + 0.01 * z)
    )
    crank, _ = best_lengths(limited, formula)
    quantile = np.sort(z)[int(0.9 * len(z)) - 1]  # of the sample in which 36 of 40 satisfy it
    assert crank == pytest.approx(0.150 / (1.0 + 0.01 * quantile), abs=WITHIN)
    assert crank <= 0.150 / (1.0 + 0.01 * quantile)


def test_lengths_that_fail_in_a_sample_are_no_optimum():
    def model(lengths):
        responses = Formula(standard_samples())(lengths)
        responses.error[responses.lengths[:, 0] > 0.150, 3] = np.nan
        return responses

    candidates = search(problem(deviations=3.0), model)
    assert best_of(candidates)["crank_length"] <= 0.150
    assert candidates["failed"].max() == 1


def test_a_range_holds_with_the_tolerances_of_the_lengths():
    region = Region.of(BOX, None).under(geometric(Constraints(stroke=(0.280, 0.304)), 0.0))
    responses = Formula(standard_samples(10))(np.array([[0.1519, 0.57], [0.1515, 0.57]]))
    # two of ten samples lead beyond 152 mm from 151.9, none from 151.5
    responses.actual[:, :2, 0] += 3e-4
    candidates = problem(region=region, probability=0.9).assess(responses)
    assert list(candidates["missed"] > 0.0) == [True, False]
