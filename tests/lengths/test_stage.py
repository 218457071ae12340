from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

import jointgap as jg
from jointgap.config import Ensemble, Genetic, Optimise, Scenario, Simulate
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.schema import TABLES
from jointgap.dynamics.kinematics import ideal_cycle
from jointgap.dynamics.simulation import simulate
from jointgap.lengths import optimise as stage
from jointgap.lengths.optimise import objectives, optimise
from jointgap.lengths.region import Region, Surface
from jointgap.lengths.search import Point
from jointgap.scenario.figures import draw
from jointgap.scenario.outcome import headline, outcome

SIMULATE = Simulate(revolutions=2, samples_per_revolution=720)
BOXES = {"paper": {"crank_length": (0.147, 0.153), "rod_length": (0.555, 0.564)}}
OPTIMISE = Optimise(
    boxes=BOXES,
    ratio_limit=0.27,
    genetic=Genetic(generations=2),
    ensemble=Ensemble(members=2, settled_revolution=2),
)
POINTS = 73


@pytest.fixture(scope="module")
def trajectory(mechanism):
    return simulate(mechanism, SIMULATE).samples


def fits_of(trajectory):
    """A surrogate that knows the simulation by heart."""
    first = trajectory.iloc[1:721]
    return {
        name: lambda angle, name=name: (
            np.interp(angle, first["crank_angle"], first[name]),
            np.zeros_like(angle),
        )
        for name in ("r2", "gamma2", "r3", "gamma3")
    }


@pytest.fixture(scope="module")
def found(mechanism, trajectory):
    return optimise(
        mechanism, SIMULATE, OPTIMISE, POINTS, trajectory, {"networks": fits_of(trajectory)}
    )


def test_every_table_is_what_it_is_specified_to_be(found, tmp_path):
    for field in fields(found):
        table = TABLES[f"optimise_{field.name}"]
        parquet.write(table, getattr(found, field.name), tmp_path / "table.parquet")
        read = parquet.read(table, tmp_path / "table.parquet")
        assert len(read) == len(getattr(found, field.name)) > 0


def test_a_surrogate_that_knows_the_simulation_finds_the_same(mechanism, trajectory, found):
    made = objectives(
        mechanism, SIMULATE, OPTIMISE, POINTS, trajectory, {"networks": fits_of(trajectory)}
    )
    assert list(made) == ["networks", "simulation", "simulation_settled"]
    assert made["networks"].value((0.149, 0.56)) == pytest.approx(
        made["simulation"].value((0.149, 0.56)), rel=1e-12
    )
    rows = found.optima.query("method == 'local' and box == 'paper'").set_index("source")[
        "crank_length"
    ]
    assert rows["networks"] == pytest.approx(rows["simulation"], abs=1e-9)


def test_the_simulated_objective_is_the_trajectory_s_own_error(mechanism, trajectory):
    made = objectives(mechanism, SIMULATE, OPTIMISE, POINTS, trajectory, {})
    angle, true = trajectory["crank_angle"].to_numpy(), trajectory["transmission_angle"].to_numpy()
    error = np.arccos(0.150 * np.sin(angle) / 0.564) - true
    window = np.flatnonzero(np.arange(720) % 10)
    assert made["simulation"].value(made["simulation"].original) == pytest.approx(
        np.sum(error[window] ** 2), rel=1e-9
    )
    settled = np.sum(error[720:1440] ** 2)
    assert made["simulation_settled"].value(made["simulation"].original) == pytest.approx(
        settled, rel=1e-9
    )


def test_the_optimum_lies_below_the_printed_points_and_what_a_point_is_worth_follows_from_its_lengths(
    found,
):
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


def grid_of(force):
    """In the place of the simulated grid: largest pin forces [N] of crank and rod length."""

    def surface(mechanism, simulate, optimise, region):
        cranks, rods = (
            np.linspace(*ends, 7) for ends in zip(region.lower, region.upper, strict=True)
        )
        return Surface(RectBivariateSpline(cranks, rods, force(cranks[:, None], rods[None, :])))

    return surface


def below(newtons, **boxes):
    constraints = OPTIMISE.constraints.model_copy(update={"largest_pin_force": newtons})
    return OPTIMISE.model_copy(update={"constraints": constraints, "boxes": OPTIMISE.boxes | boxes})


@pytest.fixture(scope="module")
def peak(found):
    """The largest force in a pin at the original lengths [N]."""
    loads = found.loads[found.loads["point"] == "original"].set_index("joint")["peak_force"]
    return float(loads[["crank_pin", "piston_pin"]].max())


def test_a_force_limit_that_no_lengths_keep_ends_the_search_before_it_begins_and_leaves_no_optimum(
    mechanism, trajectory, peak, monkeypatch, tmp_path
):
    limit = 100.0  # N; a tenth of the force
    monkeypatch.setattr(
        stage, "pin_force", grid_of(lambda crank, rod: peak * crank / 0.147 * (rod / 0.555) ** 2)
    )
    monkeypatch.setattr(stage, "search_all", lambda *_: pytest.fail("searched"))
    result = optimise(mechanism, SIMULATE, below(limit), POINTS, trajectory, {})
    assert set(result.optima["method"]) == {"original", "printed", "least_force"}
    least = result.optima.query("method == 'least_force'").iloc[0]
    assert (least["crank_length"], least["rod_length"]) == pytest.approx((0.147, 0.555))
    assert least["status"] == "no lengths within the bounds keep the pin force below 100 N"
    for field in fields(result):  # the tables of what was not searched are there, without rows
        parquet.write(
            TABLES[f"optimise_{field.name}"],
            getattr(result, field.name),
            tmp_path / "table.parquet",
        )
    scenario = Scenario(mechanism=mechanism, simulate=SIMULATE, optimise=below(limit))
    frames = {f"optimise_{field.name}": getattr(result, field.name) for field in fields(result)}
    assert headline(outcome(frames, scenario)).startswith(
        "No lengths within the bounds keep the pin force below"
    )
    for name in ("valley", "resimulation"):
        assert draw(name, frames, scenario).data.empty
    options = {
        "boxes": BOXES,
        "constraints": {"largest_pin_force": "100 N"},
        "ensemble": OPTIMISE.ensemble,
    }
    with pytest.raises(
        InputError, match=r"optimise: No lengths within the bounds keep .*; allow a force above"
    ):
        jg.optimise(mechanism, SIMULATE, **options)


class Searched(Exception):
    """In the place of a search, with its regions."""


def searched(objectives, boxes, options):
    raise Searched(boxes)


def test_a_box_without_an_optimum_leaves_the_others_their_search(
    mechanism, trajectory, peak, monkeypatch
):
    long = {"crank_length": (0.147, 0.153), "rod_length": (0.565, 0.574)}
    options = Optimise(**below(0.9 * peak).model_dump() | {"boxes": BOXES | {"long": long}})
    monkeypatch.setattr(
        stage,
        "pin_force",
        grid_of(lambda crank, rod: np.where(rod < 0.5645, peak, 0.5 * peak) + crank),
    )
    monkeypatch.setattr(stage, "peak_pin_force", lambda ensemble: peak)
    monkeypatch.setattr(stage, "search_all", searched)
    with pytest.raises(Searched) as found:
        optimise(mechanism, SIMULATE, options, POINTS, trajectory, {})
    assert list(found.value.args[0]) == ["long"]


def test_lengths_are_searched_where_their_simulated_force_keeps_a_limit_that_the_grid_exceeds(
    mechanism, trajectory, peak, monkeypatch
):
    monkeypatch.setattr(
        stage, "pin_force", grid_of(lambda crank, rod: 4.0 * peak * crank / 0.15 + 0.0 * rod)
    )
    monkeypatch.setattr(stage, "peak_pin_force", lambda ensemble: 1.5 * peak)
    monkeypatch.setattr(stage, "search_all", searched)
    with pytest.raises(Searched) as found:
        optimise(mechanism, SIMULATE, below(2.0 * peak), POINTS, trajectory, {})
    force = found.value.args[0]["paper"].constraints[-1]
    assert force.value((0.147, 0.56)) == pytest.approx(1.5 * peak) and force.high == 2.0 * peak


def test_lengths_of_a_search_that_keep_the_limit_are_kept_though_the_next_round_finds_none(
    mechanism, monkeypatch
):
    limit, region = 100.0, Region.of(OPTIMISE.boxes["paper"], None)
    forces = {(0.1475, 0.56): limit, (0.1476, 0.56): 1.1 * limit}  # all others: 101 N
    search = SimpleNamespace(found=[(Point("one", "genetic", lengths), None) for lengths in forces])
    monkeypatch.setattr(
        stage, "pin_force", grid_of(lambda crank, rod: limit * crank / 0.15 + 0.0 * rod)
    )
    monkeypatch.setattr(stage, "peak_pin_force", lambda point: forces.get(point.lengths, 101.0))
    monkeypatch.setattr(stage, "search_all", lambda *_: [search])
    given = (mechanism, SIMULATE, below(limit), {}, lambda point: point)
    assert stage._search_under_force(*given, ("paper", region)) == [search]
