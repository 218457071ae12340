"""Robust lengths of linkages other than the slider-crank."""

import numpy as np
import pytest

import jointgap as jg
from jointgap.config import Scenario
from jointgap.core.errors import InputError
from jointgap.core.page import to_markdown
from jointgap.designs.optimise_robust import (
    SimulatedLinkages,
    check,
    optimise_robust,
    sample_scenario,
    uncertain_of,
)
from jointgap.designs.robust_study import robust_study

FOUR_BAR = jg.load_mechanism("four_bar")
COARSE = {"speed": "120 rpm", "revolutions": 2, "samples_per_revolution": 180}
COARSE = jg.Simulate(**COARSE, tolerance="1e-9 m")
TOLERANCE = {"distribution": "normal", "mean": "0 mm", "deviation": "0.05 mm"}
UNCERTAIN = {"clearance": {"from": "0.04 mm", "to": "0.08 mm"}, "rocker.length": TOLERANCE}
ONLY = {"clearance": UNCERTAIN["clearance"]}
BOUNDS = {"rocker.length": ["249.8 mm", "250.2 mm"], "frame.C.x": ["299.9 mm", "300.1 mm"]}
SMALL = {"draws": 4, "grid": 3, "population": 4, "generations": 2}
SMALL |= {"fresh_draws": 16, "resamples": 100}


def scenario(uncertain: dict = UNCERTAIN, **keys) -> Scenario:
    lengths = {"lengths": BOUNDS, "ensemble": {"settled_revolution": 2}} | keys
    robust = SMALL | {"uncertain": uncertain}
    return Scenario(
        mechanism=FOUR_BAR, simulate=COARSE, optimise_linkage=lengths, optimise_robust=robust
    )


def test_the_responses_are_those_of_the_simulation_with_the_tolerances_of_each_sample():
    made = scenario()
    uncertain = uncertain_of(made)
    samples = uncertain.values(0, 2)
    responses = SimulatedLinkages(made, uncertain, samples)(np.array([[0.2501, 0.3]]))
    rocker, ground = responses.actual[0, 1]
    assert (rocker - 0.2501, ground) == pytest.approx((samples[1]["rocker.length"], 0.3))
    sample = sample_scenario(uncertain, samples[1], BOUNDS)
    changed = jg.change(sample.mechanism, {"bodies.rocker.length": rocker})
    turn = jg.simulate(changed, sample.simulate).samples.iloc[180:-1]
    still = jg.change(FOUR_BAR, {f"joints.{joint}.loose": False for joint in "ABC"})
    ideal = jg.simulate(still, COARSE).samples.iloc[180:-1]
    actual, desired = (each["rocker_angle"] - each["coupler_angle"] for each in (turn, ideal))
    error = np.sqrt(np.mean((desired - actual) ** 2))
    assert responses.error[0, 1] == pytest.approx(error, rel=1e-6)
    forces = [np.hypot(turn[f"{joint}_force_x"], turn[f"{joint}_force_y"]) for joint in "OABC"]
    assert responses.force[0, 1] == pytest.approx(np.max(forces), rel=1e-6)
    assert responses.stroke[0, 1] == pytest.approx(np.ptp(turn["rocker_angle"]), rel=1e-9)


def test_the_frozen_motion_at_the_original_lengths_has_the_simulated_error():
    made = scenario()
    nominal = SimulatedLinkages(made, uncertain_of(made), [{}])
    frozen, lengths = nominal.frozen(), np.array(nominal.nominal.original)
    rms = np.sqrt(frozen.value(lengths) / COARSE.samples_per_revolution)
    assert rms == pytest.approx(nominal(lengths[None]).error[0, 0], rel=1e-6)


def test_the_page_has_the_lengths_and_the_swing_of_the_output_body():
    made = scenario(swing={"rocker": ("60 deg", "70 deg")})
    optimum = optimise_robust(made, 1)
    text = to_markdown(robust_study(optimum, made, "mine").page)
    for words in ("rocker.length [mm]", "simulated swing of the rocker", "swing mean [deg]"):
        assert words in text
    tables = {table.name: table for table in optimum.frames}
    columns = {column.name: column for column in tables["optimise_robust_lengths"].columns}
    assert columns["stroke_mean"].unit == "rad" and columns["frame.C.x"].unit == "m"
    assert set(optimum.constraints["constraint"]) >= {"swing.rocker", "smallest angle at B"}
    assert len(optimum.candidates) > 9


@pytest.mark.parametrize(
    "uncertain, keys, message",
    [
        ({"bodies.rocker.length": [0.25, 0.26]}, {}, "give rocker.length with the tolerance"),
        ({"frame.points.C.x": [0.3, 0.31]}, {}, "give frame.C.x with the tolerance"),
        ({"rocker.length": {"from": 0.2, "to": 0.3}}, {}, "too large for a tolerance"),
        ({"coupler.length": [0.4, 0.41]}, {}, "mechanism has no 'coupler'"),
        (ONLY, {"lengths": {"roker.length": ["0.2 m", "0.3 m"]}}, "did you mean 'rocker."),
        (UNCERTAIN, {"swing": {"rocker": ("80 deg", "90 deg")}}, "no lengths satisfy"),
        (UNCERTAIN, {"objective": "least_transmission_angle"}, "must be transmission_angle"),
        (UNCERTAIN, {"largest_force": {"B": "1 N"}}, "largest_force is not for optimise_robust"),
    ],
)
def test_an_infeasible_section_is_an_error_before_any_simulation(uncertain, keys, message):
    with pytest.raises(InputError) as error:
        check(scenario(uncertain, **keys))
    assert message in str(error.value)
