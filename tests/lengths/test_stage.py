"""The stage optimise: its tables, its sources of motion, and the search under a force limit."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

import jointgap as jg
from jointgap.config import Ensemble, Genetic, Optimise, Scenario, Simulate
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.schema import TABLES
from jointgap.lengths import optimise as stage
from jointgap.lengths.force_limit import search_under_force_limits
from jointgap.lengths.objective import evaluation_samples
from jointgap.lengths.optimise import frozen_objectives, optimise
from jointgap.lengths.region import Region
from jointgap.lengths.search import Point
from jointgap.lengths.surface import Surface
from jointgap.motion.kinematics import ideal_cycle
from jointgap.motion.slider_crank import simulate
from jointgap.scenario.chosen_lengths import choose_lengths, headline
from jointgap.scenario.figures import draw

SIMULATE = Simulate(revolutions=2, samples_per_revolution=720)
BOXES = {"paper": {"crank_length": (0.147, 0.153), "rod_length": (0.555, 0.564)}}
OPTIMISE = Optimise(
    boxes=BOXES,
    ratio_limit=0.27,
    further_tolerances=(1e-1, 1e-12),
    genetic=Genetic(generations=2),
    ensemble=Ensemble(members=2, settled_revolution=2),
)
POINTS = 73


@pytest.fixture(scope="module")
def trajectory(mechanism):
    return simulate(mechanism, SIMULATE).samples


@pytest.fixture(scope="module")
def exact_networks(trajectory):
    """A surrogate that reproduces the simulation."""
    window = trajectory.iloc[1:721]

    def fit(name):
        return lambda angle: (np.interp(angle, window["crank_angle"], window[name]), 0.0 * angle)

    return {"networks": {name: fit(name) for name in ("r2", "gamma2", "r3", "gamma3")}}


@pytest.fixture(scope="module")
def frozen(mechanism, trajectory, exact_networks):
    samples = evaluation_samples(SIMULATE, OPTIMISE, POINTS)
    return frozen_objectives(mechanism, samples, trajectory, exact_networks)


@pytest.fixture(scope="module")
def tables(mechanism, trajectory, exact_networks):
    return optimise(mechanism, SIMULATE, OPTIMISE, POINTS, trajectory, exact_networks)


def test_every_table_has_the_columns_of_its_schema(tables):
    for name, frame in tables.items():
        assert len(parquet.to_arrow(TABLES[name], frame)) == len(frame) > 0


def test_an_exact_surrogate_gives_the_optimum_of_the_simulation(frozen, tables):
    assert list(frozen) == ["networks", "simulation", "simulation_settled"]
    networks, simulation = (frozen[name].value((0.149, 0.56)) for name in list(frozen)[:2])
    assert networks == pytest.approx(simulation, rel=1e-12)
    rows = tables["optimise_optima"].query("method == 'local'").set_index("source")["crank_length"]
    assert rows["networks"] == pytest.approx(rows["simulation"], abs=1e-9)


def test_the_simulated_objective_is_the_error_of_the_trajectory(trajectory, frozen):
    angle = trajectory["crank_angle"].to_numpy()
    desired = np.arccos(0.150 * np.sin(angle) / 0.564)
    error = desired - trajectory["transmission_angle"].to_numpy()
    window = np.flatnonzero(np.arange(720) % 10)
    for source, samples in (("simulation", window), ("simulation_settled", slice(720, 1440))):
        value = frozen[source].value(frozen[source].original)
        assert value == pytest.approx(np.sum(error[samples] ** 2), rel=1e-9)


def test_the_optima_are_better_than_the_printed_points(tables):
    for source, rows in tables["optimise_optima"].groupby("source"):
        lowest = rows.groupby(rows["method"] == "printed")["sum_of_squares"].min()
        assert lowest[False] <= lowest[True] * (1 + 1e-12), source


def test_the_local_search_is_repeated_at_each_tolerance(tables):
    ends = tables["optimise_tolerance"].query("source == 'networks'")
    assert list(ends["tolerance"].unique()) == [1e-1, 1e-8, 1e-12] and len(ends) == 18
    spread = ends.groupby("tolerance")["crank_length"].agg(np.ptp)
    assert spread[1e-12] < 1e-7 < spread[1e-1]


def test_the_stroke_follows_from_the_lengths_and_two_clearances(tables):
    cycles = tables["optimise_worth"].set_index("point")
    ideal, simulated = (cycles[cycles["cycle"] == cycle] for cycle in ("ideal", "simulated"))
    for row in ideal.itertuples():
        angle = ideal_cycle(row.crank_length, row.rod_length).smallest_transmission_angle
        assert row.stroke == pytest.approx(2 * row.crank_length, rel=1e-12)
        assert row.smallest_transmission_angle == angle
        assert row.stroke_change == pytest.approx(2 * (row.crank_length - 0.150), abs=1e-12)
    # two clearances of 1 mm, out and back
    assert (simulated["stroke"] - ideal["stroke"]).between(1e-3, 5e-3).all()


# -- force limit


def grid_of(force):
    """In the place of the simulated grid: largest pin forces [N] of crank and rod length."""

    def surface(mechanism, simulate, options, region, name):
        cranks, rods = (
            np.linspace(*ends, 7) for ends in zip(region.lower, region.upper, strict=True)
        )
        return Surface(RectBivariateSpline(cranks, rods, force(cranks[:, None], rods[None, :])))

    return surface


def below(newtons):
    constraints = OPTIMISE.constraints.model_copy(update={"largest_pin_force": newtons})
    return OPTIMISE.model_copy(update={"constraints": constraints})


def limited(forces, limit, peak_force, search):
    """Searches, or the point with the smallest force, of the box of the paper."""
    region = Region.of(OPTIMISE.boxes["paper"], None)
    surface = grid_of(forces)(None, None, None, region, "")
    limits = [surface.limited(limit)]
    return search_under_force_limits(
        limits, region, "paper", search, lambda point: [peak_force(point)]
    )


def test_a_limit_that_no_lengths_keep_leaves_no_optimum(mechanism, trajectory, monkeypatch):
    limit, message = 100.0, "No lengths within the bounds keep the pin force below"  # N; a tenth
    proportional = grid_of(lambda crank, rod: 1000.0 * crank / 0.147 * (rod / 0.555) ** 2)
    monkeypatch.setattr(stage, "simulated_surface", proportional)
    monkeypatch.setattr(stage, "search_all", lambda *_: pytest.fail("searched"))
    tables = optimise(mechanism, SIMULATE, below(limit), POINTS, trajectory, {})
    optima = tables["optimise_optima"].set_index("method")
    assert set(optima.index) == {"original", "printed", "least_force"}
    smallest = optima.loc["least_force"].iloc[0]
    assert (smallest["crank_length"], smallest["rod_length"]) == pytest.approx((0.147, 0.555))
    status = "no lengths within the bounds keep the largest force in a pin below 100 N"
    assert smallest["status"] == status
    for name, frame in tables.items():  # those of the searches have no rows
        parquet.to_arrow(TABLES[name], frame)
    scenario = Scenario(mechanism=mechanism, simulate=SIMULATE, optimise=below(limit))
    assert headline(choose_lengths(tables, scenario)).startswith(message)
    for name in ("valley", "resimulation"):
        assert draw(name, tables, scenario).data.empty
    options = {"boxes": BOXES, "constraints": {"largest_pin_force": "100 N"}}
    with pytest.raises(InputError, match=rf"optimise: {message} .*; allow a force above"):
        jg.optimise(mechanism, SIMULATE, **options, ensemble=OPTIMISE.ensemble)


def test_the_surface_is_scaled_to_the_simulated_force():
    """The grid exceeds the limit everywhere, and the simulated force does not."""
    search, regions = SimpleNamespace(optima=lambda: [Point("optimum", "local", (0.15, 0.56))]), []
    assert limited(
        lambda crank, rod: 400.0 * crank / 0.15 + 0 * rod,
        200.0,
        lambda point: 150.0,
        lambda region: regions.append(region) or [search],
    ) == [search]
    force = regions[0].constraints[-1]
    assert force.value((0.147, 0.56)) == pytest.approx(150.0) and force.high == 200.0


def test_feasible_lengths_are_kept_where_a_later_round_has_none():
    forces = {(0.1475, 0.56): 100.0, (0.1476, 0.56): 110.0}  # all others: 101 N
    points = [Point("optimum", "genetic", lengths) for lengths in forces]
    search = SimpleNamespace(optima=lambda: points)
    result = limited(
        lambda crank, rod: 100.0 * crank / 0.15 + 0 * rod,
        100.0,
        lambda point: forces.get(point.lengths, 101.0),
        lambda region: [search],
    )
    assert result == [search]
