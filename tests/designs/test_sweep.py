"""A sweep draws the designs that its parameters ask for, and measures each as a simulation alone does."""

import errno
import json
import math
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from jointgap.app.cli import cli
from jointgap.config import Scenario
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.designs import run
from jointgap.designs.run import check_dataset, high_order_rms, simulate_designs, table_of, write_designs
from jointgap.designs.sampling import designs_of
from jointgap.designs.stages import sweep
from jointgap.designs.statistics import clearance_vectors
from jointgap.dynamics.simulation import crank_angles, simulate
from tests.dynamics.cases import mechanism, options

MADE = mechanism(friction=0.1)
COARSE = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8)


def scenario(parameters: dict, **more) -> Scenario:
    return Scenario(mechanism=MADE, simulate=COARSE, sweep={"parameters": parameters, **more})


def column(parameters: dict, number: int = 512, **more) -> np.ndarray:
    """Values of the one parameter."""
    (key,) = parameters
    return np.array(
        [values[key] for values in designs_of(scenario(parameters, number=number, **more)).values(0, number)]
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
    few, many = (designs_of(scenario({"friction": {"from": 0, "to": 0.2}}, number=number)) for number in (8, 64))
    assert many.values(0, 8) == few.values(0, 8)
    assert many.digest == few.digest


def test_a_uniform_range_is_filled_evenly():
    values = np.sort(column({"clearance": {"from": "0.1 mm", "to": "0.5 mm"}}))
    np.testing.assert_allclose(values, np.linspace(1e-4, 5e-4, 512), atol=0.01 * 4e-4)


def test_a_log_uniform_range_has_as_many_values_in_each_ratio():
    values = column({"clearance": {"distribution": "log_uniform", "from": "0.1 mm", "to": "1 mm"}})
    assert np.mean(values < math.sqrt(1e-4 * 1e-3)) == pytest.approx(0.5, abs=0.01)


def test_a_normal_tolerance_has_its_mean_and_deviation_and_keeps_to_its_ends():
    law = {"distribution": "normal", "mean": "150 mm", "deviation": "0.1 mm"}
    free = column({"crank_length": law})
    assert (free.mean(), free.std()) == (pytest.approx(0.150, abs=1e-6), pytest.approx(1e-4, rel=0.03))
    cut = column({"crank_length": {**law, "from": "149.9 mm", "to": "150.1 mm"}})
    assert 0.1499 <= cut.min() < cut.max() <= 0.1501


def test_a_triangular_range_has_its_mean():
    values = column({"friction": {"distribution": "triangular", "from": 0, "peak": 0.05, "to": 0.2}})
    assert values.mean() == pytest.approx(0.25 / 3, rel=0.01)


def test_each_word_of_a_list_comes_equally_often():
    values = column({"mechanism.joints.crank_pin.journal": ["crank", "rod"]})
    assert np.count_nonzero(values == "rod") == 256


def test_a_latin_hypercube_has_one_design_in_each_stratum():
    values = column({"friction": {"from": 0, "to": 0.2}}, number=50, design="latin_hypercube")
    np.testing.assert_array_equal(np.sort(np.floor(values / 0.2 * 50)), np.arange(50))


def test_a_grid_has_every_combination():
    ranges = {"friction": [0, 0.1], "speed": {"from": "300 rpm", "to": "500 rpm", "number": 3}}
    designs = designs_of(scenario(ranges, design="grid"))
    pairs = {(values["friction"], round(values["speed"] * 30 / math.pi)) for values in designs.values(0, 6)}
    assert pairs == {(f, s) for f in (0.0, 0.1) for s in (300, 400, 500)}


def test_a_length_by_its_word_keeps_the_share_of_the_mass_centre():
    changed = designs_of(scenario({"crank_length": {"from": "100 mm", "to": "160 mm"}})).scenario(
        {"crank_length": 0.12}
    )
    share = MADE.crank.mass_centre / MADE.crank.length
    assert changed.mechanism.crank.mass_centre / changed.mechanism.crank.length == pytest.approx(share)


def test_a_clearance_holds_whatever_else_of_the_joint_varies():
    values = {"clearance": 3e-4, "mechanism.joints.crank_pin.journal_radius": 6.9e-3}
    designs = designs_of(scenario({key: [value] for key, value in values.items()}))
    assert designs.scenario(values).mechanism.clearance("crank_pin") == pytest.approx(3e-4)


def test_lengths_that_are_possible_together_alone_are_swept():
    lengths = {"crank_length": {"from": "0.5 m", "to": "0.7 m"}, "rod_length": {"from": "0.9 m", "to": "1.2 m"}}
    designs = designs_of(scenario(lengths, number=4))
    assert all(designs.scenario(values) for values in designs.values(0, 4))


def test_a_crank_almost_as_long_as_its_rod_is_a_design_though_no_search_goes_so_far():
    long = {"crank_length": 0.99 * MADE.rod.length}
    assert designs_of(scenario({"crank_length": list(long.values())})).scenario(long)


def test_a_design_leaves_the_base_as_it_is_and_keeps_what_it_does_not_change():
    designs = designs_of(scenario({"clearance": [1e-4], "mechanism.crank.mass": [0.4]}))
    before = designs.base.model_dump()
    changed = designs.scenario({"clearance": 1e-4, "mechanism.crank.mass": 0.4})
    assert designs.base.model_dump() == before
    assert changed.mechanism.rod is designs.base.mechanism.rod
    assert (changed.mechanism.crank.mass, changed.mechanism.clearance("piston_pin")) == pytest.approx((0.4, 1e-4))


@pytest.fixture(scope="module")
def measured() -> tuple:
    """Designs, and what was measured of the first four."""
    ranges = {"clearance": {"from": "0.2 mm", "to": "0.8 mm"}, "friction": {"from": 0.02, "to": 0.2}}
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

    assert row["angle_error_rms"] == pytest.approx(np.sqrt(np.mean(error(last)[:-1] ** 2)), rel=1e-9)
    assert row["angle_error_peak"] == pytest.approx(np.abs(error(last)[:-1]).max(), rel=1e-9)
    window = alone.samples.iloc[60:360]
    assert row["angle_error_mean_in_window"] == pytest.approx(np.abs(error(window)).mean(), rel=1e-9)
    assert row["stroke"] == pytest.approx(np.ptp(last["slider_position"]), rel=1e-4)
    assert row["crank_pin_rms_force"] == pytest.approx(
        np.sqrt(np.mean(last["crank_pin_normal_force"][:-1] ** 2)), rel=1e-9
    )
    touching = np.mean(last["piston_pin_mode"].isin(["impact", "contact"]))
    assert row["piston_pin_contact_share"] == pytest.approx(touching, abs=2 / 360)
    impacts = alone.events[(alone.events["time"] >= last["time"].iloc[0]) & (alone.events["joint"] == "piston_pin")]
    assert row["piston_pin_impacts"] == np.count_nonzero(impacts["event"] == "impact")
    vectors = np.hstack([clearance_vectors(alone.samples, joint) for joint in ("crank_pin", "piston_pin")])
    apart = np.linalg.norm(vectors[-361:] - vectors[-721:-360], axis=1).max()
    assert row["repeat_distance"] == pytest.approx(apart / own.mechanism.clearance("crank_pin"), rel=1e-9)


def test_a_sample_that_lies_short_of_a_turn_by_rounding_counts_at_the_beginning_of_the_next():
    turned = options(revolutions=2, samples_per_revolution=360, tolerance=1e-8, start_angle=282 * 2.0 * math.pi / 360)
    assert 0.0 < 2.0 * math.pi - crank_angles(turned)[78] < 1e-14
    sweep = {"parameters": {"friction": [0.1]}, "number": 1, "window": ["0 deg", "0.5 deg"]}
    (row,) = simulate_designs(designs_of(Scenario(mechanism=MADE, simulate=turned, sweep=sweep)), 0, 1).to_dict(
        "records"
    )
    there = simulate(MADE, turned).samples.iloc[78]
    assert row["angle_error_peak_in_window"] == pytest.approx(abs(there["transmission_angle"] - math.pi / 2), rel=1e-9)


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
        assert math.sin(row["outer_dead_centre_angle"]) == pytest.approx(offset / (rod + crank), abs=1e-5)
        assert math.sin(row["inner_dead_centre_angle"]) == pytest.approx(-offset / (rod - crank), abs=1e-5)
        assert row["angle_error_peak"] == pytest.approx(0.0, abs=1e-12)
        assert math.isnan(row["crank_pin_impacts"])


def test_the_number_of_workers_does_not_change_a_byte(measured, tmp_path):
    designs, _ = measured
    for workers in (1, 3):
        write_designs(designs, 0, 4, tmp_path / f"{workers}.parquet", "code", workers)
    assert (tmp_path / "1.parquet").read_bytes() == (tmp_path / "3.parquet").read_bytes()


def test_an_impossible_design_is_a_row_with_its_reason():
    designs = designs_of(scenario({"mechanism.crank.length": {"from": "60 mm", "to": "150 mm"}}, number=8))
    frame = simulate_designs(designs, 0, 8)
    failed = frame["mechanism.crank.length"] < MADE.crank.mass_centre
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

    monkeypatch.setattr(run, "simulate_designs", recorded)
    return numbers


def dataset(folder: Path) -> dict[str, bytes]:
    return {part.name: part.read_bytes() for part in sorted((folder / "designs").iterdir())}


def test_a_grown_sweep_simulates_no_design_again_and_ends_with_the_files_of_one_that_was_never_smaller(
    simulated, tmp_path
):
    text = sweep(scenario(RANGE, number=8, designs_per_job=3), tmp_path / "at once", 1)
    assert "8 designs" in text
    assert simulated == list(range(8))
    simulated.clear()
    for number in (1, 4, 8):
        sweep(scenario(RANGE, number=number, designs_per_job=3), tmp_path / "grown", 1)
    assert simulated == list(range(8))
    assert dataset(tmp_path / "grown") == dataset(tmp_path / "at once")


def test_a_killed_sweep_goes_on_with_the_parts_that_are_missing(simulated, tmp_path):
    made = scenario(RANGE, number=6, designs_per_job=2)
    sweep(made, tmp_path, 1)
    whole = dataset(tmp_path)
    simulated.clear()
    (tmp_path / "designs/part_000001.parquet").unlink()
    (tmp_path / "designs/.part_000001-abc.parquet").write_bytes(b"PAR1")  # as if it had been killed
    sweep(made, tmp_path, 1)
    assert simulated == [2, 3]
    assert dataset(tmp_path) == whole


def test_a_full_disk_takes_a_part_and_leaves_the_others(simulated, tmp_path, monkeypatch):
    made = scenario(RANGE, number=4, designs_per_job=2)
    sweep(made, tmp_path / "with room", 1)
    replace = os.replace

    def full(source, target):
        if Path(target).name == "part_000001.parquet":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(source, target)

    with monkeypatch.context() as disk, pytest.raises(InputError, match=r"part_000001\.parquet: .*No space left"):
        disk.setattr(os, "replace", full)
        sweep(made, tmp_path / "full", 1)
    assert list(dataset(tmp_path / "full")) == ["part_000000.parquet"]
    simulated.clear()
    sweep(made, tmp_path / "full", 1)
    assert simulated == [2, 3]
    assert dataset(tmp_path / "full") == dataset(tmp_path / "with room")


def test_designs_that_other_code_measured_are_measured_again(simulated, tmp_path):
    designs = designs_of(scenario(RANGE, number=2))
    for code in ("old", "new", "new"):
        write_designs(designs, 0, 2, tmp_path / "part.parquet", code, 1)
    assert simulated == [0, 1, 0, 1]


def test_designs_of_two_versions_of_the_code_are_no_dataset(tmp_path):
    designs = designs_of(scenario(RANGE, number=2))
    for place, code in enumerate(("old", "new")):
        write_designs(designs, place, 1, tmp_path / f"part_{place}.parquet", code, 1)
    with pytest.raises(InputError, match="measured by different versions"):
        check_dataset(designs, tmp_path)


def test_a_sweep_over_another_measured_angle_is_another_sweep(tmp_path):
    file = tmp_path / "angle.csv"

    def digest(speed):
        time = np.linspace(0.0, 1.0, 200)
        pd.DataFrame({"time": time, "crank_angle": speed * time}).to_csv(file, index=False)
        made = scenario(RANGE, number=2)
        drive = {"kind": "measured", "file": str(file)}
        driven = made.simulate.model_dump() | {"drive": drive}
        return designs_of(made.model_copy(update={"simulate": type(made.simulate)(**driven)})).digest

    assert digest(60.0) == digest(60.0) != digest(30.0)


@pytest.mark.parametrize("left", [0, 200, -1])
def test_a_damaged_part_is_made_again_as_it_was(left, tmp_path):
    made = scenario({"friction": {"from": 0.05, "to": 0.2}}, number=2)
    sweep(made, tmp_path, 1)
    part = tmp_path / "designs/part_000000.parquet"
    whole = part.read_bytes()
    part.write_bytes(whole[:left])
    sweep(made, tmp_path, 1)
    assert part.read_bytes() == whole


def refused(made: Scenario, folder: Path) -> str:
    before = dataset(folder)
    with pytest.raises(InputError) as caught:
        sweep(made, folder, 1)
    assert dataset(folder) == before
    return str(caught.value)


def test_a_folder_that_holds_anything_else_is_refused_before_anything_is_simulated(simulated, tmp_path):
    sweep(scenario(RANGE, number=5, designs_per_job=2), tmp_path, 1)
    simulated.clear()
    fewer = refused(scenario(RANGE, number=3, designs_per_job=2), tmp_path)
    assert "part_000001.parquet: holds designs 2 to 3, but sweep.number asks for 3; ask for 5 or more" in fewer
    cut = refused(scenario(RANGE, number=5, designs_per_job=4), tmp_path)
    assert "part_000001.parquet: holds designs 2 to 3, which are no part of this sweep in parts of 4; set sweep." in cut
    other = refused(scenario({"friction": {"from": 0, "to": 0.2}}, number=5, designs_per_job=2), tmp_path)
    assert "part_000000.parquet: belongs to another sweep" in other
    (tmp_path / "designs/mine.parquet").write_bytes(b"")
    strange = refused(scenario(RANGE, number=5, designs_per_job=2), tmp_path)
    assert "mine.parquet: cannot be read as Parquet" in strange
    assert not simulated


def test_a_design_that_is_missing_or_there_twice_is_told(tmp_path):
    designs = designs_of(scenario({"friction": {"from": 0, "to": 0.1}}, number=2))
    write_designs(designs, 1, 1, tmp_path / "b.parquet", "code")
    with pytest.raises(InputError, match="design 0 is missing"):
        check_dataset(designs, tmp_path)
    write_designs(designs, 0, 1, tmp_path / "a.parquet", "code")
    check_dataset(designs, tmp_path)
    write_designs(designs, 0, 1, tmp_path / "c.parquet", "code")
    with pytest.raises(InputError, match=r"c\.parquet: design 0 is there twice"):
        check_dataset(designs, tmp_path)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({}, "nothing is swept"),
        ({"clearance": {"from": "1 mm", "to": "0.1 mm"}}, "clearance: from = 1 mm and to = 0.1 mm stand the wrong way"),
        ({"clearance": {"from": "1 mm", "to": "1 mm"}}, "are the same, so it does not vary"),
        ({"clearance": {"from": "1 kg", "to": "1 mm"}}, "clearance.from = '1 kg': has the unit 'kilogram'"),
        ({"cleerance": {"from": 0, "to": 1}}, "cleerance: no such word; did you mean 'clearance'"),
        ({"mechanism.slider.mas": {"from": 1, "to": 2}}, "mechanism.slider has no 'mas'; did you mean 'mass'"),
        ({"friction": {"from": 2, "to": 3}}, "must be less than or equal to 0.6"),
        ({"friction": {"distribution": "normal", "mean": 0.1, "deviation": 0}}, "deviation = 0.0: must be above zero"),
        ({"friction": {"distribution": "normal", "mean": 0.1, "deviation": 1e-300}}, "friction: is so narrow that all"),
        ({"friction": {"distribution": "normal", "mean": 0, "deviation": 0.01, "from": 0.1}}, "which never come"),
        ({"crank_length": ["150 mm", "0.15 m", "151 mm"]}, "gives one value in two ways"),
        ({"friction": {"distribution": "log_uniform", "from": 0, "to": 1}}, "a log_uniform range begins above zero"),
        ({"mechanism.joints.crank_pin.journal": {"from": 0, "to": 1}}, "is no number with a unit"),
        ({"clearance": [1e-4], "mechanism.joints.crank_pin.bearing_radius": [8e-3]}, "set the same number"),
        ({"crank_length": [0.1], "mechanism.crank.mass_centre": [0.05]}, "set the same number"),
        ({"speed": [30, 40], "simulate.speed": [30, 40]}, "speed and simulate.speed set the same number"),
    ],
)
def test_a_sweep_that_cannot_be_is_refused_before_anything_is_simulated(parameters, message):
    with pytest.raises(InputError) as caught:
        designs_of(scenario(parameters))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"number": 0}, "sweep.number = 0: must be greater than or equal to 1"),
        ({"number": 1_000_000_000}, "sweep.number = 1000000000: must be less than or equal to 10000000"),
        ({"parameters": {"friction": {"from": 0.1}}}, "key 'sweep.parameters.friction.to' is missing"),
        ({"parameters": {"friction": [0, "x"]}}, "sweep.parameters.friction = 'x': "),
        ({"parameters": {"friction": {"from": 0.2, "to": 0.1}}}, "sweep.parameters.friction: from = 0.2 and to = 0.1"),
    ],
)
def test_the_command_names_the_file_of_what_is_wrong_before_anything_is_simulated(section, message, tmp_path):
    file = tmp_path / "mine.json"
    file.write_text(json.dumps({"mechanism": "erkaya2009", "sweep": {"parameters": {"friction": [0, 0.1]}} | section}))
    options = ["--options", str(file), "--folder", str(tmp_path / "out")]
    with pytest.raises(InputError) as caught:
        CliRunner().invoke(cli, ["sweep", *options], catch_exceptions=False)
    (line,) = caught.value.args
    assert line.startswith(f"{file}: {message}")
    assert not (tmp_path / "out").exists()


def test_the_table_says_unit_and_meaning_of_each_parameter_and_measure(measured, tmp_path):
    designs, frame = measured
    parquet.write(table_of(designs), frame, path := Path(tmp_path, "designs.parquet"))
    described = parquet.describe(path).set_index("column")
    assert described.loc["clearance", "unit"] == "m"
    assert described.loc["angle_error_rms", "unit"] == "rad"
    assert (described["description"] != "").all()


def test_high_orders_are_those_above_the_tenth():
    turned = np.arange(400) * (2 * math.pi / 400)
    quiet = 7.0 + 5.0 * np.cos(turned) + 2.0 * np.sin(10 * turned)
    assert high_order_rms(quiet) < 1e-13
    assert high_order_rms(quiet + 3.0 * np.cos(11 * turned) + 4.0 * np.sin(50 * turned)) == pytest.approx(
        math.sqrt(12.5)
    )


def test_a_grid_of_two_or_three_parameters_is_drawn_as_a_map(tmp_path):
    grid = {"clearance": [2e-4, 4e-4], "friction": [0.05, 0.1], "mechanism.joints.crank_pin.journal": ["crank", "rod"]}
    made = scenario(grid, design="grid")
    sweep(made, tmp_path, workers=1)
    drawn, designs = pd.read_parquet(tmp_path / "map.parquet"), pd.read_parquet(tmp_path / "designs")
    errors = drawn[drawn["series"] == "RMS error of the transmission angle"]["value"]
    assert sorted(errors) == pytest.approx(sorted(np.degrees(designs["angle_error_rms"])))
    assert "data:image/png" in (tmp_path / "summary.html").read_text()
