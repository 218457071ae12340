"""What the paper's printed optima come out as on the motion of a design, counted in the ways that it leaves open."""

import pytest

from jointgap.config import Scenario
from jointgap.core.errors import InputError
from jointgap.core.schema import PRINTED_OPTIMA
from jointgap.designs.run import best_crank_length, simulate_designs, table_of
from jointgap.designs.sampling import designs_of
from jointgap.dynamics.kinematics import clearance_lift
from jointgap.dynamics.simulation import simulate
from jointgap.lengths.objective import frozen_objective
from jointgap.paper.printed import OPTIMA
from tests.dynamics.cases import mechanism, options

PAPER = mechanism(friction=0.1)
COARSE = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)
COUNTED = {
    "window_start": {"from": "0 deg", "to": "90 deg"},
    "window_end": {"from": "270 deg", "to": "360 deg"},
    "error_measure": ["rms", "peak"],
    "revolution": [1, 2],
}


def asked(parameters: dict, made=PAPER, **more) -> Scenario:
    sweep = {"parameters": parameters, "number": 4, "printed_numbers": True, **more}
    return Scenario(mechanism=made, simulate=COARSE, sweep=sweep)


@pytest.fixture(scope="module")
def motion():
    return simulate(PAPER, COARSE).samples


def objective(samples, design: dict):
    """Of a design, from the clearance vectors instead of the rod's angle."""
    first = (int(design["revolution"]) - 1) * 360
    part = samples.iloc[first : first + 360]
    turned = (part["crank_angle"] - part["crank_angle"].iloc[0]).to_numpy()
    part = part[(turned >= design["window_start"]) & (turned <= design["window_end"])]
    return frozen_objective(PAPER, part["crank_angle"].to_numpy(), clearance_lift(part))


def test_the_printed_lengths_reduce_the_error_of_a_design_as_the_objective_of_its_clearance_vectors_says(motion):
    for design in simulate_designs(designs_of(asked(COUNTED)), 0, 4, 1).to_dict("records"):
        known = objective(motion, design)
        for printed in OPTIMA:
            reductions = known.reductions((printed.crank_length, printed.rod_length))
            wanted = getattr(reductions, design["error_measure"])
            assert design[f"reduction_at_{printed.key}"] == pytest.approx(wanted, abs=1e-9)
        best = best_crank_length(known, PAPER.rod.length)
        assert design["best_ratio_in_window"] == pytest.approx(best / PAPER.rod.length, abs=1e-8)


def test_the_table_has_the_printed_numbers_where_they_are_asked_for_alone():
    names = set(PRINTED_OPTIMA.names)
    assert names <= set(table_of(designs_of(asked(COUNTED))).names)
    plain = designs_of(asked({"friction": {"from": 0, "to": 0.2}}, printed_numbers=False))
    assert not names & set(table_of(plain).names)


def test_a_stiffness_by_its_word_is_that_of_both_pins():
    designs = designs_of(asked({"stiffness": {"distribution": "log_uniform", "from": 1e9, "to": 1e10}}))
    (values,) = designs.values(2, 1)
    made = designs.scenario(values).mechanism
    assert {made.joint(name).contact.stiffness for name in made.loose} == {values["stiffness"]}


@pytest.mark.parametrize(
    ("parameters", "more", "message"),
    [
        ({"revolution": [1]}, {"printed_numbers": False}, "revolution: says how the paper's printed numbers are"),
        ({"revolution": [1, 3]}, {}, "revolution = 3: must be a whole number from 1 to simulate.revolutions, 2"),
        ({"revolution": {"from": 1, "to": 2}}, {}, "revolution: has no range; list its values"),
        ({"error_measure": ["rmse"]}, {}, "error_measure = 'rmse': no such measure"),
        ({"window_start": {"from": 0, "to": "1 mm"}}, {}, "window_start.to = '1 mm'"),
        ({"window_start": ["100 deg"], "window_end": ["50 deg"]}, {}, "the window must grow"),
        ({"clearance": {"from": "0.1 mm", "to": "0.5 mm"}}, {}, "do not speak of this mechanism"),
        ({"friction": [0.1]}, {"made": mechanism(loose=("crank_pin",))}, "do not speak of this mechanism"),
    ],
)  # fmt: skip
def test_printed_numbers_that_cannot_be_are_refused_before_anything_is_simulated(parameters, more, message):
    with pytest.raises(InputError, match="sweep") as raised:
        designs_of(asked(parameters, **more))
    assert message in str(raised.value)
