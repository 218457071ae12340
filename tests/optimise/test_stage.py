from dataclasses import fields

import numpy as np
import pytest

from jointgap.config import Ensemble, Genetic, Optimise, Simulate
from jointgap.core import parquet
from jointgap.core.schema import TABLES
from jointgap.dynamics.kinematics import ideal_cycle
from jointgap.dynamics.simulation import simulate
from jointgap.lengths.optimise import objectives, optimise

SIMULATE = Simulate(revolutions=2, samples_per_revolution=720)
BOXES = {"paper": {"crank_length": (0.147, 0.153), "rod_length": (0.555, 0.564)}}
OPTIMISE = Optimise(
    boxes=BOXES, ratio_limit=0.27, genetic=Genetic(generations=2), ensemble=Ensemble(members=2, settled_revolution=2)
)
POINTS = 73


@pytest.fixture(scope="module")
def trajectory(mechanism):
    return simulate(mechanism, SIMULATE).samples


def fits_of(trajectory):
    """A surrogate that knows the simulation by heart."""
    first = trajectory.iloc[1:721]
    return {
        name: lambda angle, name=name: (np.interp(angle, first["crank_angle"], first[name]), np.zeros_like(angle))
        for name in ("r2", "gamma2", "r3", "gamma3")
    }


@pytest.fixture(scope="module")
def found(mechanism, trajectory):
    return optimise(mechanism, SIMULATE, OPTIMISE, POINTS, trajectory, {"networks": fits_of(trajectory)})


def test_every_table_is_what_it_is_specified_to_be(found, tmp_path):
    for field in fields(found):
        table = TABLES[f"optimise_{field.name}"]
        parquet.write(table, getattr(found, field.name), tmp_path / "table.parquet")
        read = parquet.read(table, tmp_path / "table.parquet")
        assert len(read) == len(getattr(found, field.name)) > 0


def test_a_surrogate_that_knows_the_simulation_finds_the_same(mechanism, trajectory, found):
    made = objectives(mechanism, SIMULATE, OPTIMISE, POINTS, trajectory, {"networks": fits_of(trajectory)})
    assert list(made) == ["networks", "simulation", "simulation_settled"]
    assert made["networks"].value((0.149, 0.56)) == pytest.approx(made["simulation"].value((0.149, 0.56)), rel=1e-12)
    rows = found.optima.query("method == 'local' and box == 'paper'").set_index("source")["crank_length"]
    assert rows["networks"] == pytest.approx(rows["simulation"], abs=1e-9)


def test_the_simulated_objective_is_the_trajectory_s_own_error(mechanism, trajectory):
    made = objectives(mechanism, SIMULATE, OPTIMISE, POINTS, trajectory, {})
    angle, true = trajectory["crank_angle"].to_numpy(), trajectory["transmission_angle"].to_numpy()
    error = np.arccos(0.150 * np.sin(angle) / 0.564) - true
    window = np.flatnonzero(np.arange(720) % 10)
    assert made["simulation"].value(made["simulation"].original) == pytest.approx(np.sum(error[window] ** 2), rel=1e-9)
    settled = np.sum(error[720:1440] ** 2)
    assert made["simulation_settled"].value(made["simulation"].original) == pytest.approx(settled, rel=1e-9)


def test_the_optimum_lies_below_the_printed_points_and_what_a_point_is_worth_follows_from_its_lengths(found):
    for source, rows in found.optima.groupby("source"):
        least = rows.groupby(rows["method"] == "printed")["sum_of_squares"].min()
        assert least[False] <= least[True] * (1 + 1e-12), source
    for row in found.worth.query("cycle == 'ideal'").itertuples():
        cycle = ideal_cycle(row.crank_length, row.rod_length)
        assert row.stroke == pytest.approx(2 * row.crank_length, rel=1e-12)
        assert row.smallest_transmission_angle == cycle.smallest_transmission_angle
        assert row.stroke_change == pytest.approx(2 * (row.crank_length - 0.150), abs=1e-12)
    simulated = found.worth.query("cycle == 'simulated'").set_index("point")
    ideal = found.worth.query("cycle == 'ideal'").set_index("point")
    more = simulated["stroke"] - ideal["stroke"]
    assert more.between(1e-3, 5e-3).all()  # two clearances of 1 mm, out and back
