"""A sweep draws the designs that its parameters ask for, and measures each as a simulation alone
does."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Scenario
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.designs import dataset as designs_dataset
from jointgap.designs.dataset import (
    check_dataset,
    read_designs,
    simulate_designs,
    write_designs,
)
from jointgap.designs.measures import high_order_rms
from jointgap.designs.sampling import designs_of
from jointgap.designs.stages import write_sweep
from jointgap.designs.statistics import clearance_vectors
from jointgap.dynamics.simulation import simulate
from tests.catalogue import refused
from tests.dynamics.cases import mechanism, options

MADE = mechanism(friction=0.1)
COARSE = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)


def scenario(parameters: dict, **more) -> Scenario:
    return Scenario(mechanism=MADE, simulate=COARSE, sweep={"parameters": parameters, **more})


def column(parameters: dict, number: int = 512, **more) -> np.ndarray:
    """Values of the one parameter."""
    (key,) = parameters
    return np.array(
        [
            values[key]
            for values in designs_of(scenario(parameters, number=number, **more)).values(0, number)
        ]
    )


@pytest.mark.parametrize("design", ["sobol", "latin_hypercube", "grid"])
def test_designs_do_not_depend_on_the_part_in_which_they_are_drawn(design):
    ranges = {
        "friction": {"from": 0, "to": 0.2, "number": 5},
        "speed": {"from": "300 rpm", "to": "600 rpm", "number": 4},
    }
    designs = designs_of(scenario(ranges, design=design, number=20))
    whole = designs.values(0, 20)
    assert designs.values(7, 6) == whole[7:13]
    assert designs.number == 20


def test_a_larger_number_of_a_sobol_sequence_only_adds_designs():
    few, many = (
        designs_of(scenario({"friction": {"from": 0, "to": 0.2}}, number=number))
        for number in (8, 64)
    )
    assert many.values(0, 8) == few.values(0, 8)
    assert many.digest == few.digest


def spread(distribution, **law) -> np.ndarray:
    return np.sort(column({"clearance": {"distribution": distribution, **law}}))


def test_values_are_distributed_as_is_asked():
    uniform = spread("uniform", **{"from": "0.1 mm", "to": "0.5 mm"})
    np.testing.assert_allclose(uniform, np.linspace(1e-4, 5e-4, 512), atol=0.01 * 4e-4)
    logarithmic = spread("log_uniform", **{"from": "0.1 mm", "to": "1 mm"})
    assert np.mean(logarithmic < math.sqrt(1e-4 * 1e-3)) == pytest.approx(0.5, abs=0.01)
    normal = {"mean": "0.5 mm", "deviation": "0.1 mm"}
    free, cut = (
        spread("normal", **normal),
        spread("normal", **normal, **{"from": "0.4 mm", "to": "0.6 mm"}),
    )
    assert (free.mean(), free.std()) == (
        pytest.approx(5e-4, rel=1e-3),
        pytest.approx(1e-4, rel=0.03),
    )
    assert 4e-4 <= cut.min() < cut.max() <= 6e-4
    triangular = spread("triangular", **{"from": "0.1 mm", "peak": "0.2 mm", "to": "0.6 mm"})
    assert triangular.mean() == pytest.approx(3e-4, rel=0.01)
    assert (
        np.count_nonzero(column({"mechanism.joints.crank_pin.journal": ["crank", "rod"]}) == "rod")
        == 256
    )
    strata = column({"friction": {"from": 0, "to": 0.2}}, number=50, design="latin_hypercube")
    np.testing.assert_array_equal(np.sort(np.floor(strata / 0.2 * 50)), np.arange(50))
    ranges = {"friction": [0, 0.1], "speed": {"from": "300 rpm", "to": "500 rpm", "number": 3}}
    pairs = designs_of(scenario(ranges, design="grid")).values(0, 6)
    assert {(pair["friction"], round(pair["speed"] * 30 / math.pi)) for pair in pairs} == {
        (f, s) for f in (0.0, 0.1) for s in (300, 400, 500)
    }


@pytest.fixture(scope="module")
def measured() -> tuple:
    """Designs, and what was measured of the first four."""
    ranges = {
        "clearance": {"from": "0.2 mm", "to": "0.8 mm"},
        "friction": {"from": 0.02, "to": 0.2},
    }
    designs = designs_of(scenario(ranges, number=4, window=["60 deg", "360 deg"]))
    return designs, simulate_designs(designs, 0, 4)


def test_a_design_is_measured_as_its_simulation_alone_says(measured):
    designs, frame = measured
    own = designs.scenario(designs.values(2, 1)[0])
    alone, row = simulate(own.mechanism, own.simulate), frame.iloc[2]
    last = alone.samples.iloc[-361:]
    crank, rod = own.mechanism.crank.length, own.mechanism.rod.length

    def error(samples: pd.DataFrame) -> np.ndarray:
        ideal = math.pi / 2 + np.arcsin(-crank * np.sin(samples["crank_angle"]) / rod)
        return (ideal - samples["transmission_angle"]).to_numpy()

    assert row["angle_error_rms"] == pytest.approx(
        np.sqrt(np.mean(error(last)[:-1] ** 2)), rel=1e-9
    )
    assert row["angle_error_peak"] == pytest.approx(np.abs(error(last)[:-1]).max(), rel=1e-9)
    window = alone.samples.iloc[60:360]
    assert row["angle_error_mean_in_window"] == pytest.approx(
        np.abs(error(window)).mean(), rel=1e-9
    )
    assert row["stroke"] == pytest.approx(np.ptp(last["slider_position"]), rel=1e-4)
    assert row["crank_pin_rms_force"] == pytest.approx(
        np.sqrt(np.mean(last["crank_pin_normal_force"][:-1] ** 2)), rel=1e-9
    )
    touching = np.mean(last["piston_pin_mode"].isin(["impact", "contact"]))
    assert row["piston_pin_contact_share"] == pytest.approx(touching, abs=2 / 360)
    impacts = alone.events[
        (alone.events["time"] >= last["time"].iloc[0]) & (alone.events["joint"] == "piston_pin")
    ]
    assert row["piston_pin_impacts"] == np.count_nonzero(impacts["event"] == "impact")
    vectors = np.hstack(
        [clearance_vectors(alone.samples, joint) for joint in ("crank_pin", "piston_pin")]
    )
    apart = np.linalg.norm(vectors[-361:] - vectors[-721:-360], axis=1).max()
    assert row["repeat_distance"] == pytest.approx(
        apart / own.mechanism.clearance("crank_pin"), rel=1e-9
    )


def test_a_mechanism_without_clearance_has_no_error_and_the_stroke_and_dead_centres_of_geometry():
    ideal = mechanism(loose=(), offset=0.03)
    one = options(revolutions=1, samples_per_revolution=720, tolerance=1e-8)
    lengths = {"number": 2, "parameters": {"crank_length": {"from": "100 mm", "to": "160 mm"}}}
    made = Scenario(mechanism=ideal, simulate=one, sweep=lengths)
    designs = designs_of(made)
    frame, rod, offset = simulate_designs(designs, 0, 2), ideal.rod.length, 0.03
    for crank, row in zip(frame["crank_length"], frame.to_dict("records"), strict=True):
        outer, inner = (math.sqrt((rod + sign * crank) ** 2 - offset**2) for sign in (1, -1))
        assert row["stroke"] == pytest.approx(outer - inner, rel=1e-7)
        assert math.sin(row["outer_dead_centre_angle"]) == pytest.approx(
            offset / (rod + crank), abs=1e-5
        )
        assert math.sin(row["inner_dead_centre_angle"]) == pytest.approx(
            -offset / (rod - crank), abs=1e-5
        )
        assert row["angle_error_peak"] == pytest.approx(0.0, abs=1e-12)
        assert math.isnan(row["crank_pin_impacts"])


def test_the_number_of_workers_does_not_change_a_byte(measured, tmp_path):
    designs, _ = measured
    for workers in (1, 3):
        write_designs(designs, 0, 4, tmp_path / f"{workers}.parquet", "code", workers)
    assert (tmp_path / "1.parquet").read_bytes() == (tmp_path / "3.parquet").read_bytes()


def test_each_start_is_a_row_and_chosen_trajectories_are_written_as_simulated_alone(tmp_path):
    asked = scenario(RANGE, number=3, starts=3, trajectories=[1], seed=7, design="latin_hypercube")
    text = write_sweep(asked, tmp_path, 1)
    rows = pd.read_parquet(tmp_path / "designs")
    assert list(rows["design"]) == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert list(rows["start"]) == [0, 1, 2] * 3
    designs = designs_of(asked)
    vectors = np.random.default_rng(7).normal(0.0, 1e-7, (3, 6))  # of an ensemble with this seed
    start = [*vectors[2][:4], 0.0, 0.0]  # the crank pivot is ideal
    design = designs.scenario(designs.values(1, 1)[0])
    alone = simulate(design.mechanism, design.simulate, start)
    assert rows["steps"][5] == alone.steps
    folder = tmp_path / "trajectories/design_1_start_2"
    samples = parquet.read(schema.TRAJECTORY, folder / "trajectory.parquet")
    np.testing.assert_array_equal(samples["r2"], alone.samples["r2"])
    events = parquet.read(schema.EVENTS, folder / "events.parquet")
    np.testing.assert_array_equal(events["time"], alone.events["time"])
    medians = read_designs(designs, tmp_path / "designs", "design", "stroke", "reason")
    assert list(medians["stroke"]) == list(rows.groupby("design")["stroke"].median())
    assert "3 designs" in text


def test_an_infeasible_design_is_a_row_with_its_reason():
    designs = designs_of(
        scenario({"mechanism.crank.mass_centre": {"from": "60 mm", "to": "200 mm"}}, number=8)
    )
    frame = simulate_designs(designs, 0, 8)
    failed = frame["mechanism.crank.mass_centre"] > MADE.crank.length
    assert 0 < failed.sum() < 8
    assert frame.loc[failed, "reason"].str.contains("mass_centre").all()
    assert frame.loc[failed, "stroke"].isna().all()
    assert frame.loc[~failed, "reason"].isna().all()


RANGE = {"friction": {"from": 0.05, "to": 0.2}}


@pytest.fixture
def simulated(monkeypatch) -> list[int]:
    """Numbers of the designs that are simulated."""
    numbers: list[int] = []

    def recorded(designs, first, count, workers=None):
        numbers.extend(range(first, first + count))
        return simulate_designs(designs, first, count, workers)

    monkeypatch.setattr(designs_dataset, "simulate_designs", recorded)
    return numbers


def dataset(folder: Path) -> dict[str, bytes]:
    return {part.name: part.read_bytes() for part in sorted((folder / "designs").iterdir())}


def test_a_grown_sweep_simulates_no_design_again_and_ends_with_the_files_of_one_that_was_never_smaller(
    simulated, tmp_path
):
    text = write_sweep(scenario(RANGE, number=8, designs_per_job=3), tmp_path / "at once", 1)
    assert "8 designs" in text
    assert simulated == list(range(8))
    simulated.clear()
    for number in (1, 4, 8):
        write_sweep(scenario(RANGE, number=number, designs_per_job=3), tmp_path / "grown", 1)
    assert simulated == list(range(8))
    assert dataset(tmp_path / "grown") == dataset(tmp_path / "at once")


@pytest.mark.parametrize("left", [None, 200])
def test_a_killed_sweep_goes_on_with_the_parts_that_are_missing_or_damaged(
    simulated, tmp_path, left
):
    made = scenario(RANGE, number=4, designs_per_job=2)
    write_sweep(made, tmp_path, 1)
    whole, part = dataset(tmp_path), tmp_path / "designs/part_000001.parquet"
    simulated.clear()
    part.unlink() if left is None else part.write_bytes(whole[part.name][:left])
    (tmp_path / "designs/.part_000001-abc.parquet").write_bytes(b"PAR1")  # as if it had been killed
    write_sweep(made, tmp_path, 1)
    assert simulated == [2, 3]
    assert dataset(tmp_path) == whole


def test_a_sweep_over_another_measured_angle_is_another_sweep(tmp_path):
    file = tmp_path / "angle.csv"

    def digest(speed):
        time = np.linspace(0.0, 1.0, 200)
        pd.DataFrame({"time": time, "crank_angle": speed * time}).to_csv(file, index=False)
        made = scenario(RANGE, number=2)
        drive = {"kind": "measured", "file": str(file)}
        driven = made.simulate.model_dump() | {"drive": drive}
        return designs_of(
            made.model_copy(update={"simulate": type(made.simulate)(**driven)})
        ).digest

    assert digest(60.0) == digest(60.0) != digest(30.0)


def test_a_folder_that_holds_anything_else_is_refused_before_anything_is_simulated(
    simulated, tmp_path
):
    write_sweep(scenario(RANGE, number=5, designs_per_job=2), tmp_path, 1)
    simulated.clear()
    before, part = dataset(tmp_path), "part_000001.parquet: contains designs 2 to 3"
    cases = [
        (RANGE, 3, 2, f"{part}, more than sweep.number = 3; set it to 5 or more"),
        (RANGE, 5, 4, f"{part}, which do not match parts of 4"),
        (
            {"friction": {"from": 0, "to": 0.2}},
            5,
            2,
            "part_000000.parquet: belongs to another sweep",
        ),
    ]
    refused(
        lambda ranges, *sizes: write_sweep(
            scenario(ranges, number=sizes[0], designs_per_job=sizes[1]), tmp_path, 1
        ),
        cases,
    )
    assert not simulated and dataset(tmp_path) == before


def test_a_design_that_is_missing_or_there_twice_is_reported(tmp_path):
    designs = designs_of(scenario({"friction": {"from": 0, "to": 0.1}}, number=2))
    write_designs(designs, 1, 1, tmp_path / "b.parquet", "code")
    with pytest.raises(InputError, match="design 0 is missing"):
        check_dataset(designs, tmp_path)
    write_designs(designs, 0, 1, tmp_path / "a.parquet", "code")
    check_dataset(designs, tmp_path)
    write_designs(designs, 0, 1, tmp_path / "c.parquet", "code")
    with pytest.raises(InputError, match=r"c\.parquet: design 0 is a duplicate"):
        check_dataset(designs, tmp_path)
    (tmp_path / "c.parquet").unlink()
    write_designs(designs, 0, 1, tmp_path / "a.parquet", "other code")
    with pytest.raises(InputError, match="measured by different versions"):
        check_dataset(designs, tmp_path)


REFUSED = [
    ({}, "sweep.parameters: is empty"),
    (
        {"clearance": {"from": "1 mm", "to": "0.1 mm"}},
        "clearance: from = 1 mm and to = 0.1 mm are in the wrong",
    ),
    ({"cleerance": {"from": 0, "to": 1}}, "cleerance: no such word; did you mean 'clearance'"),
    ({"friction": {"from": 2, "to": 3}}, "must be less than or equal to 0.6"),
    (
        {"friction": {"distribution": "normal", "mean": 0.1, "deviation": 1e-300}},
        "all values round to 0.1",
    ),
    (
        {"friction": {"distribution": "normal", "mean": 0, "deviation": 0.01, "from": 0.1}},
        "exclude all values",
    ),
    ({"crank_length": ["150 mm", "0.15 m", "151 mm"]}, "contains equal values"),
    ({"friction": {"distribution": "log_uniform", "from": 0, "to": 1}}, "must begin above zero"),
    (
        {"clearance": [1e-4], "mechanism.joints.crank_pin.bearing_radius": [8e-3]},
        "set the same value",
    ),
]


def test_a_sweep_that_cannot_be_is_refused_before_anything_is_simulated():
    refused(lambda parameters: designs_of(scenario(parameters)), REFUSED)


def test_high_orders_are_those_above_the_tenth():
    turned = np.arange(400) * (2 * math.pi / 400)
    quiet = 7.0 + 5.0 * np.cos(turned) + 2.0 * np.sin(10 * turned)
    assert high_order_rms(quiet) < 1e-13
    assert high_order_rms(
        quiet + 3.0 * np.cos(11 * turned) + 4.0 * np.sin(50 * turned)
    ) == pytest.approx(math.sqrt(12.5))


def test_a_grid_of_two_parameters_is_drawn_as_a_map(tmp_path):
    grid = {"clearance": [2e-4, 4e-4], "friction": [0.05, 0.1]}
    made = scenario(grid, design="grid")
    write_sweep(made, tmp_path, workers=1)
    drawn, designs = (
        pd.read_parquet(tmp_path / "map.parquet"),
        pd.read_parquet(tmp_path / "designs"),
    )
    errors = drawn[drawn["series"] == "RMS error of the transmission angle"]["value"]
    assert sorted(errors) == pytest.approx(sorted(np.degrees(designs["angle_error_rms"])))
    assert "data:image/png" in (tmp_path / "summary.html").read_text()
