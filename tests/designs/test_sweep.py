"""Sweeps: values of the designs, measures, starts, and the dataset on disk."""

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
from jointgap.motion.slider_crank import simulate
from tests.motion.cases import mechanism, options

MADE = mechanism(friction=0.1)
COARSE = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)
FRICTION = {"friction": {"from": 0.05, "to": 0.2}}


def scenario(parameters: dict = FRICTION, **keys) -> Scenario:
    return Scenario(mechanism=MADE, simulate=COARSE, sweep={"parameters": parameters, **keys})


def column(parameters: dict, number: int = 512, **keys) -> np.ndarray:
    """Values of the only parameter, sorted."""
    (key,) = parameters
    designs = designs_of(scenario(parameters, number=number, **keys))
    return np.sort([values[key] for values in designs.values(0, number)])


@pytest.mark.parametrize("design", ["sobol", "latin_hypercube", "grid"])
def test_designs_are_independent_of_the_part_in_which_they_are_drawn(design):
    ranges = {
        "friction": {"from": 0, "to": 0.2, "number": 5},
        "speed": {"from": "300 rpm", "to": "600 rpm", "number": 4},
    }
    designs = designs_of(scenario(ranges, design=design, number=20))
    assert designs.number == 20
    assert designs.values(7, 6) == designs.values(0, 20)[7:13]


def test_a_larger_number_of_a_sobol_sequence_only_adds_designs():
    few, many = (designs_of(scenario(number=number)) for number in (8, 64))
    assert many.values(0, 8) == few.values(0, 8)
    assert many.digest == few.digest


def clearances(distribution: str, **law) -> np.ndarray:
    return column({"clearance": {"distribution": distribution, **law}})


def test_values_have_the_distribution_of_their_range():
    uniform = clearances("uniform", **{"from": "0.1 mm", "to": "0.5 mm"})
    np.testing.assert_allclose(uniform, np.linspace(1e-4, 5e-4, 512), atol=0.01 * 4e-4)
    logarithmic = clearances("log_uniform", **{"from": "0.1 mm", "to": "1 mm"})
    assert np.mean(logarithmic < math.sqrt(1e-4 * 1e-3)) == pytest.approx(0.5, abs=0.01)
    law = {"mean": "0.5 mm", "deviation": "0.1 mm"}
    normal = clearances("normal", **law)
    assert normal.mean() == pytest.approx(5e-4, rel=1e-3)
    assert normal.std() == pytest.approx(1e-4, rel=0.03)
    truncated = clearances("normal", **law, **{"from": "0.4 mm", "to": "0.6 mm"})
    assert 4e-4 <= truncated.min() < truncated.max() <= 6e-4
    triangular = clearances("triangular", **{"from": "0.1 mm", "peak": "0.2 mm", "to": "0.6 mm"})
    assert triangular.mean() == pytest.approx(3e-4, rel=0.01)
    words = column({"mechanism.joints.crank_pin.journal": ["crank", "rod"]})
    assert np.count_nonzero(words == "rod") == 256
    strata = column({"friction": {"from": 0, "to": 0.2}}, number=50, design="latin_hypercube")
    np.testing.assert_array_equal(np.floor(strata / 0.2 * 50), np.arange(50))
    ranges = {"friction": [0, 0.1], "speed": {"from": "300 rpm", "to": "500 rpm", "number": 3}}
    pairs = designs_of(scenario(ranges, design="grid")).values(0, 6)
    rpm = 30 / math.pi
    assert {(pair["friction"], round(rpm * pair["speed"])) for pair in pairs} == {
        (friction, speed) for friction in (0.0, 0.1) for speed in (300, 400, 500)
    }


def test_a_design_has_the_measures_of_its_simulation():
    ranges = {"clearance": {"from": "0.2 mm", "to": "0.8 mm"}, **FRICTION}
    designs = designs_of(scenario(ranges, number=4, window=["60 deg", "360 deg"]))
    row = simulate_designs(designs, 0, 4).iloc[2]
    design = designs.scenario(designs.values(2, 1)[0])
    alone = simulate(design.mechanism, design.simulate)
    last = alone.samples.iloc[-361:]
    crank, rod = design.mechanism.crank.length, design.mechanism.rod.length

    def error(samples: pd.DataFrame) -> np.ndarray:
        ideal = math.pi / 2 + np.arcsin(-crank * np.sin(samples["crank_angle"]) / rod)
        return np.abs(ideal - samples["transmission_angle"]).to_numpy()

    vectors = np.hstack([clearance_vectors(alone.samples, pin) for pin in design.mechanism.loose])
    distance = np.linalg.norm(vectors[-361:] - vectors[-721:-360], axis=1).max()
    expected = {
        "angle_error_rms": np.sqrt(np.mean(error(last)[:-1] ** 2)),
        "angle_error_peak": error(last)[:-1].max(),
        "angle_error_mean_in_window": error(alone.samples.iloc[60:360]).mean(),
        "crank_pin_rms_force": np.sqrt(np.mean(last["crank_pin_normal_force"][:-1] ** 2)),
        "repeat_distance": distance / design.mechanism.clearance("crank_pin"),
    }
    assert dict(row[list(expected)]) == pytest.approx(expected, rel=1e-9)
    assert row["stroke"] == pytest.approx(np.ptp(last["slider_position"]), rel=1e-4)
    in_contact = np.mean(last["piston_pin_mode"].isin(["impact", "contact"]))
    assert row["piston_pin_contact_share"] == pytest.approx(in_contact, abs=2 / 360)
    events = alone.events[alone.events["time"] >= last["time"].iloc[0]]
    impacts = events.query("joint == 'piston_pin' and event == 'impact'")
    assert row["piston_pin_impacts"] == len(impacts)


def test_without_clearance_stroke_and_dead_centres_are_geometric_and_the_error_is_zero():
    ideal, offset = mechanism(loose=(), offset=0.03), 0.03
    one_turn = options(revolutions=1, samples_per_revolution=720, tolerance=1e-8)
    lengths = {"number": 2, "parameters": {"crank_length": {"from": "100 mm", "to": "160 mm"}}}
    made = Scenario(mechanism=ideal, simulate=one_turn, sweep=lengths)
    frame, rod = simulate_designs(designs_of(made), 0, 2), ideal.rod.length
    crank = frame["crank_length"]
    outer, inner = (np.sqrt((rod + sign * crank) ** 2 - offset**2) for sign in (1, -1))
    np.testing.assert_allclose(frame["stroke"], outer - inner, rtol=1e-7)
    for angle, sine in (("outer", offset / (rod + crank)), ("inner", -offset / (rod - crank))):
        np.testing.assert_allclose(np.sin(frame[f"{angle}_dead_centre_angle"]), sine, atol=1e-5)
    np.testing.assert_allclose(frame["angle_error_peak"], 0.0, atol=1e-12)
    assert frame["crank_pin_impacts"].isna().all()


def test_the_file_is_independent_of_the_number_of_workers(tmp_path):
    designs = designs_of(scenario(number=4))
    for workers in (1, 3):
        write_designs(designs, 0, 4, tmp_path / f"{workers}.parquet", "code", workers)
    assert (tmp_path / "1.parquet").read_bytes() == (tmp_path / "3.parquet").read_bytes()


def test_each_start_is_a_row_and_chosen_trajectories_are_written(tmp_path):
    made = scenario(number=3, starts=3, trajectories=[1], seed=7, design="latin_hypercube")
    assert "3 designs" in write_sweep(made, tmp_path, 1)
    rows = pd.read_parquet(tmp_path / "designs")
    assert list(zip(rows["design"], rows["start"], strict=True)) == [
        (design, start) for design in range(3) for start in range(3)
    ]
    designs = designs_of(made)
    vectors = np.random.default_rng(7).normal(0.0, 1e-7, (3, 6))
    start = [*vectors[2][:4], 0.0, 0.0]  # the crank pivot is ideal
    design = designs.scenario(designs.values(1, 1)[0])
    alone = simulate(design.mechanism, design.simulate, start)
    assert rows["steps"][5] == alone.steps
    folder = tmp_path / "trajectories/design_1_start_2"
    samples = parquet.read(schema.TRAJECTORY, folder / "trajectory.parquet")
    events = parquet.read(schema.EVENTS, folder / "events.parquet")
    np.testing.assert_array_equal(samples["r2"], alone.samples["r2"])
    np.testing.assert_array_equal(events["time"], alone.events["time"])
    medians = read_designs(designs, tmp_path / "designs", "design", "stroke", "reason")
    assert list(medians["stroke"]) == list(rows.groupby("design")["stroke"].median())


def test_an_infeasible_design_is_a_row_with_its_reason():
    ranges = {"mechanism.crank.mass_centre": {"from": "60 mm", "to": "200 mm"}}
    frame = simulate_designs(designs_of(scenario(ranges, number=8)), 0, 8)
    failed = frame["mechanism.crank.mass_centre"] > MADE.crank.length
    assert 0 < failed.sum() < 8
    assert frame.loc[failed, "reason"].str.contains("mass_centre").all()
    assert frame.loc[failed, "stroke"].isna().all()
    assert frame.loc[~failed, "reason"].isna().all()


@pytest.fixture
def simulated(monkeypatch) -> list[int]:
    """Numbers of the designs that are simulated."""
    numbers: list[int] = []

    def recorded(designs, first, count, workers=None):
        numbers.extend(range(first, first + count))
        return simulate_designs(designs, first, count, workers)

    monkeypatch.setattr(designs_dataset, "simulate_designs", recorded)
    return numbers


def contents(folder: Path) -> dict[str, bytes]:
    return {part.name: part.read_bytes() for part in sorted((folder / "designs").iterdir())}


def test_an_enlarged_sweep_simulates_only_new_designs_and_has_the_same_files(simulated, tmp_path):
    write_sweep(scenario(number=8, designs_per_job=3), tmp_path / "at once", 1)
    simulated.clear()
    for number in (1, 4, 8):
        write_sweep(scenario(number=number, designs_per_job=3), tmp_path / "enlarged", 1)
    assert simulated == list(range(8))
    assert contents(tmp_path / "enlarged") == contents(tmp_path / "at once")


@pytest.mark.parametrize("remaining", [None, 200])
def test_an_interrupted_sweep_resumes_with_missing_or_damaged_parts(simulated, tmp_path, remaining):
    made = scenario(number=4, designs_per_job=2)
    write_sweep(made, tmp_path, 1)
    complete, part = contents(tmp_path), tmp_path / "designs/part_000001.parquet"
    simulated.clear()
    part.unlink()
    if remaining:
        part.write_bytes(complete[part.name][:remaining])
    (tmp_path / "designs/.part_000001-abc.parquet").write_bytes(b"PAR1")  # of an interrupted write
    write_sweep(made, tmp_path, 1)
    assert simulated == [2, 3]
    assert contents(tmp_path) == complete


def test_the_digest_depends_on_the_measured_angle(tmp_path):
    file = tmp_path / "angle.csv"

    def digest(speed: float) -> str:
        time = np.linspace(0.0, 1.0, 200)
        pd.DataFrame({"time": time, "crank_angle": speed * time}).to_csv(file, index=False)
        drive = {"kind": "measured", "file": str(file)}
        driven = type(COARSE)(**COARSE.model_dump() | {"drive": drive})
        return designs_of(scenario().model_copy(update={"simulate": driven})).digest

    assert digest(60.0) == digest(60.0) != digest(30.0)


def test_a_folder_with_other_designs_is_an_error_before_any_simulation(simulated, tmp_path):
    write_sweep(scenario(number=5, designs_per_job=2), tmp_path, 1)
    simulated.clear()
    unchanged, part = contents(tmp_path), "part_000001.parquet: contains designs 2 to 3"
    for keys, message in (
        ({"number": 3}, f"{part}, more than sweep.number = 3; set it to 5 or more"),
        ({"designs_per_job": 4}, f"{part}, which do not match parts of 4"),
        ({"seed": 1}, "part_000000.parquet: belongs to another sweep"),
    ):
        with pytest.raises(InputError) as error:
            write_sweep(scenario(**{"number": 5, "designs_per_job": 2} | keys), tmp_path, 1)
        assert message in str(error.value)
    assert not simulated and contents(tmp_path) == unchanged


def test_missing_and_duplicate_designs_are_errors(tmp_path):
    designs = designs_of(scenario(number=2))
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


NORMAL = {"distribution": "normal", "mean": 0.1}


@pytest.mark.parametrize(
    "parameters, message",
    [
        ({}, "sweep.parameters: is empty"),
        (
            {"clearance": {"from": "1 mm", "to": "0.1 mm"}},
            "clearance: from = 1 mm and to = 0.1 mm are in the wrong",
        ),
        ({"cleerance": {"from": 0, "to": 1}}, "no such word; did you mean 'clearance'"),
        ({"friction": {"from": 2, "to": 3}}, "must be less than or equal to 0.6"),
        ({"friction": NORMAL | {"deviation": 1e-300}}, "all values round to 0.1"),
        ({"friction": NORMAL | {"deviation": 0.01, "from": 0.2}}, "exclude all values"),
        ({"crank_length": ["150 mm", "0.15 m", "151 mm"]}, "contains equal values"),
        (
            {"friction": {"distribution": "log_uniform", "from": 0, "to": 1}},
            "must begin above zero",
        ),
        (
            {"clearance": [1e-4], "mechanism.joints.crank_pin.bearing_radius": [8e-3]},
            "set the same value",
        ),
    ],
)
def test_invalid_parameters_are_errors(parameters, message):
    with pytest.raises(InputError) as error:
        designs_of(scenario(parameters))
    assert message in str(error.value)


def test_noise_is_the_acceleration_above_order_ten():
    angle = np.arange(400) * (2 * math.pi / 400)
    low_orders = 7.0 + 5.0 * np.cos(angle) + 2.0 * np.sin(10 * angle)
    high_orders = 3.0 * np.cos(11 * angle) + 4.0 * np.sin(50 * angle)
    assert high_order_rms(low_orders) < 1e-13
    assert high_order_rms(low_orders + high_orders) == pytest.approx(math.sqrt(12.5))


def test_a_grid_of_two_parameters_is_drawn_as_a_map(tmp_path):
    grid = {"clearance": [2e-4, 4e-4], "friction": [0.05, 0.1]}
    write_sweep(scenario(grid, design="grid"), tmp_path, workers=1)
    drawn = pd.read_parquet(tmp_path / "map.parquet")
    errors = drawn[drawn["series"].str.startswith("error of the transmission angle")]["value"]
    designs = pd.read_parquet(tmp_path / "designs")
    assert sorted(errors) == pytest.approx(sorted(np.degrees(designs["angle_error_rms"])))
    assert "data:image/png" in (tmp_path / "summary.html").read_text()
