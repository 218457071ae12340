"""The best lengths of a design by the paper's method, and reductions at the printed optima."""

import math

import numpy as np
import pytest

from jointgap.config import Scenario
from jointgap.core.errors import InputError
from jointgap.designs.dataset import simulate_designs
from jointgap.designs.measures import best_crank_length
from jointgap.designs.sampling import designs_of
from jointgap.lengths.objective import frozen_objective, objective_of_motion
from jointgap.motion.kinematics import clearance_lift
from jointgap.motion.slider_crank import simulate
from jointgap.paper.printed import OPTIMA
from tests.motion.cases import mechanism, options

MADE = mechanism(friction=0.1)
CRANK, ROD = MADE.crank.length, MADE.rod.length
COARSE = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)
ANGLE = np.linspace(0.0, 2.0 * math.pi, 90, endpoint=False)


def asked(parameters: dict, made=MADE, simulated=COARSE, **more) -> Scenario:
    sweep = {"parameters": parameters, "number": 2, "best_lengths": True, **more}
    return Scenario(mechanism=made, simulate=simulated, sweep=sweep)


def measured(scenario: Scenario) -> list[dict]:
    return simulate_designs(designs_of(scenario), 0, scenario.sweep.designs, 1).to_dict("records")


@pytest.mark.parametrize("longer", [-5e-3, -1e-4, 1e-4, 5e-3])
def test_clearances_that_act_as_a_longer_crank_are_compensated_by_a_shorter_one(longer):
    known = frozen_objective(MADE, ANGLE, longer * np.sin(ANGLE))
    best = best_crank_length(known, ROD)
    assert best == pytest.approx(CRANK - longer, abs=1e-9)
    assert known.reductions((best, ROD)).rms == pytest.approx(1.0, abs=1e-6)


def test_without_clearance_the_original_lengths_are_the_best_and_there_is_no_reduction():
    rod = -np.arcsin(CRANK * np.sin(ANGLE) / ROD)
    assert best_crank_length(objective_of_motion(MADE, ANGLE, rod), ROD) == pytest.approx(
        CRANK, abs=1e-9
    )
    for design in measured(asked({"speed": ["300 rpm", "600 rpm"]}, mechanism(loose=()))):
        assert design["best_crank_length"] == pytest.approx(CRANK, abs=1e-9)
        assert math.isnan(design["reduction_at_best"])


def test_the_best_lengths_minimise_the_objective_of_the_clearance_vectors():
    window = (math.radians(60), math.radians(300))
    design, _ = measured(asked({"friction": [0.1, 0.2]}, window=window, design="grid"))
    samples = simulate(MADE, COARSE).samples
    turned = samples["crank_angle"].to_numpy()
    parts = {
        "": slice(360, 720),
        "_in_window": (turned >= window[0] - 1e-9) & (turned <= window[1] + 1e-9),
    }
    for suffix, part in parts.items():
        own = samples[part]
        known = frozen_objective(MADE, own["crank_angle"].to_numpy(), clearance_lift(own))
        cranks = np.linspace(CRANK - 1e-3, CRANK + 1e-3, 2001)
        sums = known.value(np.column_stack([cranks, np.full(2001, ROD)]))
        best = cranks[np.argmin(sums)]
        assert design[f"best_crank_length{suffix}"] == pytest.approx(best, abs=1e-6)
        assert design[f"best_ratio{suffix}"] == pytest.approx(best / ROD, abs=2e-6)
        reduction = known.reductions((best, ROD)).rms
        assert design[f"reduction_at_best{suffix}"] == pytest.approx(reduction, abs=1e-5)
        assert design[f"reduction_at_best{suffix}"] > 0.0


@pytest.mark.parametrize(
    "measure, key",
    [("best_ratio", "best_lengths"), ("reduction_at_printed_local", "printed_numbers")],
)
def test_sensitivity_requires_computed_measures(measure, key):
    given = asked({"friction": [0.1, 0.2]}, best_lengths=False).model_dump(
        by_alias=True, exclude_unset=True
    )
    with pytest.raises(ValueError, match=f"{measure} is not computed; set sweep.{key} to true"):
        Scenario(**given | {"sensitivity": {"measures": [measure]}})
    Scenario(
        **given | {"sweep": given["sweep"] | {key: True}, "sensitivity": {"measures": [measure]}}
    )


COUNTED = {
    "window_start": {"from": "0 deg", "to": "90 deg"},
    "window_end": {"from": "270 deg", "to": "360 deg"},
    "error_measure": ["rms", "peak"],
    "revolution": [1, 2],
}


def printed_of(parameters: dict, made=MADE, **more) -> Scenario:
    sweep = {"parameters": parameters, "number": 4, "printed_numbers": True, **more}
    return Scenario(mechanism=made, simulate=COARSE, sweep=sweep)


@pytest.fixture(scope="module")
def motion():
    return simulate(MADE, COARSE).samples


def objective(samples, design: dict):
    """Of a design, from the clearance vectors instead of the rod's angle."""
    first = (int(design["revolution"]) - 1) * 360
    part = samples.iloc[first : first + 360]
    turned = (part["crank_angle"] - part["crank_angle"].iloc[0]).to_numpy()
    part = part[(turned >= design["window_start"]) & (turned <= design["window_end"])]
    return frozen_objective(MADE, part["crank_angle"].to_numpy(), clearance_lift(part))


def test_reductions_at_the_printed_lengths_are_those_of_the_clearance_vectors(motion):
    for design in simulate_designs(designs_of(printed_of(COUNTED)), 0, 4, 1).to_dict("records"):
        known = objective(motion, design)
        for printed in OPTIMA:
            reductions = known.reductions((printed.crank_length, printed.rod_length))
            wanted = getattr(reductions, design["error_measure"])
            assert design[f"reduction_at_{printed.key}"] == pytest.approx(wanted, abs=1e-9)
        best = best_crank_length(known, MADE.rod.length)
        assert design["best_ratio_in_window"] == pytest.approx(best / MADE.rod.length, abs=1e-8)


@pytest.mark.parametrize(
    "parameters, keys, message",
    [
        ({"revolution": [1]}, {"printed_numbers": False}, "revolution: defines the error"),
        (
            {"revolution": [1, 3]},
            {},
            "revolution = 3: must be an integer from 1 to simulate.revolutions, 2",
        ),
        ({"error_measure": ["rmse"]}, {}, "error_measure = 'rmse': no such measure"),
        (
            {"window_start": ["100 deg"], "window_end": ["50 deg"]},
            {},
            "window_start = 1.74533, window_end = 0.872665",
        ),
        ({"clearance": {"from": "0.1 mm", "to": "0.5 mm"}}, {}, "do not apply to this mechanism"),
    ],
)
def test_an_invalid_definition_of_the_printed_numbers_is_an_error(parameters, keys, message):
    with pytest.raises(InputError) as error:
        designs_of(printed_of(parameters, **keys))
    assert message in str(error.value)
