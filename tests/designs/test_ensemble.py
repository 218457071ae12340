"""Many motions at once are the motions one by one, whoever simulates them."""

import itertools

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from jointgap.config import Runs, Scenario
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError, SimulationError
from jointgap.designs.ensemble import ensemble_runs, write_ensemble
from jointgap.designs.statistics import clearance_vectors
from jointgap.dynamics.parallel import Run, simulate_ensemble, simulate_runs
from jointgap.dynamics.simulation import simulate
from tests.dynamics.cases import ALL, MOTOR, effect, mechanism, options

COARSE = options(samples_per_revolution=90, tolerance=1e-9)
FILES = ("samples.parquet", "events.parquet", "runs.parquet")


def starts(number: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(scale=1e-7, size=(number, 4))


def test_an_ensemble_holds_the_motion_of_each_of_its_starts():
    made = mechanism(friction=0.1)
    ensemble = simulate_ensemble(made, COARSE, starts(3))
    for number, start in enumerate(starts(3)):
        alone = simulate(made, COARSE, start).samples
        np.testing.assert_allclose(ensemble.slider_position[number], alone["slider_position"], rtol=1e-13)
        np.testing.assert_allclose(ensemble.transmission_angle[number], alone["transmission_angle"], rtol=1e-13)
        np.testing.assert_array_equal(ensemble.times[number], alone["time"])


@pytest.mark.parametrize(
    ("made", "wanted"),
    [
        (mechanism(friction=0.1, loose=ALL), COARSE),
        (mechanism(friction=0.1), options(samples_per_revolution=90, tolerance=1e-9, drive=MOTOR)),
    ],
    ids=["three loose joints", "motor"],
)
def test_the_files_hold_what_a_simulation_alone_gives(tmp_path, made, wanted):
    write_ensemble([Run(made, wanted), Run(made, wanted, starts(1)[0])], tmp_path)
    samples = parquet.read(schema.ENSEMBLE_SAMPLES, tmp_path / "samples.parquet")
    events = parquet.read(schema.ENSEMBLE_EVENTS, tmp_path / "events.parquet")
    for number, start in enumerate((None, starts(1)[0])):
        alone = simulate(made, wanted, start)
        own = samples[samples["run"] == number].reset_index(drop=True)
        for joint, symbol in (("crank_pin", "r2"), ("piston_pin", "r3"), ("crank_pivot", "r1")):
            vectors = clearance_vectors(alone.samples, joint)
            np.testing.assert_allclose(own[[f"{symbol}_x", f"{symbol}_y"]], vectors, atol=1e-16)
            assert list(own[f"{joint}_mode"]) == list(alone.samples[f"{joint}_mode"])
        for name in ("time", "crank_angle", "crank_speed", "rod_angle", "slider_position"):
            np.testing.assert_allclose(own[name], alone.samples[name], rtol=1e-12, atol=1e-15)
        found = events[events["run"] == number].drop(columns="run").reset_index(drop=True)
        words = {"joint": str, "event": str}
        pd.testing.assert_frame_equal(found.astype(words), alone.events.astype(words))


def test_the_files_are_the_same_for_any_number_of_workers(tmp_path):
    made = mechanism()
    for workers in (1, 3):
        write_ensemble([Run(made, COARSE, one) for one in starts(12)], tmp_path / str(workers), workers)
    for name in FILES:
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "3" / name).read_bytes()


def test_a_run_that_fails_says_why_and_the_others_go_on(tmp_path):
    made = mechanism(friction=0.1)
    braked = mechanism(effect("slider_constant_force", force_N=5000.0), friction=0.1)
    stalling = options(drive=MOTOR, samples_per_revolution=90, tolerance=1e-9)
    runs = [Run(made, COARSE), Run(made, COARSE, [0.1, 0, 0, 0]), Run(braked, stalling), Run(made, COARSE)]
    written = write_ensemble(runs, tmp_path)
    assert "not within its clearance" in written["reason"][1]
    assert "stalls" in written["reason"][2]
    told = pd.read_parquet(tmp_path / "runs.parquet")
    assert list(told["samples"]) == [91, 0, 0, 91]
    assert list(told["reason"].isna()) == [True, False, False, True]
    samples = parquet.read(schema.ENSEMBLE_SAMPLES, tmp_path / "samples.parquet")
    assert sorted(samples["run"].unique()) == [0, 3]
    with pytest.raises(SimulationError, match="stalls"):
        simulate_ensemble(braked, stalling, starts(1))


def test_an_ensemble_is_never_held_in_memory(tmp_path):
    made, taken = mechanism(friction=0.1), itertools.count()
    drawn = 0

    def endless():
        nonlocal drawn
        for _ in taken:
            drawn += 1
            yield Run(made, COARSE)

    outcomes = simulate_runs(endless(), workers=2)
    for _ in range(5):
        next(outcomes)
    outcomes.close()
    assert drawn < 40


def test_rows_are_written_in_groups_as_they_come(tmp_path, monkeypatch):
    monkeypatch.setattr("jointgap.designs.ensemble.ROWS", 200)
    write_ensemble([Run(mechanism(friction=0.1), COARSE)] * 9, tmp_path)
    file = pq.ParquetFile(tmp_path / "samples.parquet")
    assert [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)] == [273, 273, 273]


@pytest.mark.parametrize(
    ("values", "kind", "stored"),
    [
        ([1, 2.5], "double", [1.0, 2.5]),
        ([np.int64(1), 2], "int64", [1, 2]),
        ([np.float32(0.5), None], "double", [0.5, None]),
        ([3, None], "double", [3.0, None]),
        ([np.True_, False], "bool", [True, False]),
        ([1.5, "steel"], "string", ["1.5", "steel"]),
        (["steel", None], "string", ["steel", None]),
    ],
)
def test_the_column_of_a_varied_value_holds_the_values_of_all_runs(tmp_path, values, kind, stored):
    write_ensemble([Run(mechanism(friction=0.1), COARSE, values={"key": value}) for value in values], tmp_path)
    column = pq.read_table(tmp_path / "runs.parquet")["key"]
    assert (str(column.type), column.to_pylist()) == (kind, stored)


def test_where_the_table_of_runs_cannot_be_written_no_file_appears(tmp_path):
    with pytest.raises(ValueError, match="infinite"):
        write_ensemble([Run(mechanism(friction=0.1), COARSE, values={"key": np.inf})], tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_refused_before_anything_runs(tmp_path):
    (tmp_path / "samples.parquet").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        write_ensemble(iter(lambda: pytest.fail("a run was asked for"), None), tmp_path)


def runs_of(**keys) -> list[Run]:
    return list(ensemble_runs(mechanism(), COARSE, Runs(**keys)))


def test_every_combination_runs_from_every_start():
    runs = runs_of(vary={"speed": ["300 rpm", "600 rpm"], "friction": [0, 0.1, 0.2]}, members=2)
    assert len(runs) == 2 * 3 * 2
    assert sorted({run.options.speed for run in runs}) == pytest.approx([10 * np.pi, 20 * np.pi])
    assert [run.mechanism.joint("crank_pin").contact.friction for run in runs[:6:2]] == [0, 0.1, 0.2]
    assert not np.any(runs[0].perturbation) and np.any(runs[1].perturbation)
    np.testing.assert_array_equal(runs[1].perturbation, runs[3].perturbation)
    assert not np.any([run.perturbation[4:] for run in runs])  # the crank pivot is ideal


def test_words_set_every_loose_joint_and_paths_any_key(tmp_path):
    small, large = runs_of(vary={"clearance": ["0.1 mm", "0.5 mm"]}, members=1)
    for run, clearance in ((small, 1e-4), (large, 5e-4)):
        assert [run.mechanism.clearance(name) for name in ("crank_pin", "piston_pin")] == pytest.approx([clearance] * 2)
        assert run.mechanism.clearance("crank_pivot") == 0
        assert run.values["clearance"] == pytest.approx(clearance)
    path = "mechanism.joints.piston_pin.contact.restitution"
    one, other = runs_of(vary={path: [0.3, 0.8]}, members=1)
    assert (one.mechanism.joint("piston_pin").contact.restitution, one.values[path]) == (0.3, 0.3)
    assert one.mechanism.joint("crank_pin").contact == other.mechanism.joint("crank_pin").contact


def test_parameters_of_an_effect_are_found_by_its_name():
    effect = {"name": "slider_coulomb_friction", "parameters": {"force_N": 5}}
    path = "mechanism.effects.slider_coulomb_friction.parameters.force_N"
    runs = list(ensemble_runs(mechanism(effect), COARSE, Runs(vary={path: [10, 20]}, members=1)))
    assert [run.mechanism.effect("slider_coulomb_friction").force_N for run in runs] == [10, 20]


def test_an_effect_at_two_sites_is_found_by_name_and_site():
    pins = [effect("pin_friction", site=site, coefficient=0.1) for site in ("crank_pin", "piston_pin")]
    made, end = mechanism(*pins, loose=()), "parameters.coefficient"
    runs = list(
        ensemble_runs(made, COARSE, Runs(vary={f"mechanism.effects.pin_friction@piston_pin.{end}": [0.2]}, members=1))
    )
    assert [runs[0].mechanism.effect("pin_friction", site).coefficient for site in ("crank_pin", "piston_pin")] == [
        0.1,
        0.2,
    ]
    with pytest.raises(InputError, match="did you mean 'pin_friction@"):
        list(ensemble_runs(made, COARSE, Runs(vary={f"mechanism.effects.pin_friction.{end}": [0.2]}, members=1)))


@pytest.mark.parametrize(
    ("vary", "says"),
    [
        ({"sped": [1]}, "did you mean 'speed'"),
        ({"mechanism.slider.mas": [1]}, "mechanism.slider has no 'mas'; did you mean 'mass'"),
        ({"mechanism.contacts.steel.friction": [0.1]}, "contacts are copied into the joints"),
        ({"friction": [2.0]}, "friction = 2.0"),
        ({"clearance": ["1 s"]}, "ensemble.vary.clearance"),
        ({"clearance": [-1e-3]}, "is not smaller than bearing_radius"),
        ({"mechanism.crank.length": [0.7]}, "the crank cannot turn"),
        ({"mechanism.effects.added_slider_mass.parameters.mass_kg": [1]}, "folded in, so vary the key itself"),
    ],
)
def test_what_cannot_be_varied_is_refused_with_its_key(vary, says):
    with pytest.raises(InputError, match=says):
        runs_of(vary=vary)


@pytest.mark.parametrize("key", ["speed", "simulate.speed"])
def test_the_speed_of_a_measured_drive_cannot_be_varied(key):
    measured = options(drive={"kind": "measured", "file": "encoder.csv"})
    with pytest.raises(InputError, match=r"does not read simulate\.speed"):
        list(ensemble_runs(mechanism(), measured, Runs(vary={key: [50.0, 60.0]}, members=1)))


def test_values_can_be_spread_evenly_between_two_ends_with_a_unit():
    spread = Runs(vary={"speed": {"from": "200 rpm", "to": "600 rpm", "number": 3}}).vary["speed"]
    assert spread == ("200.0 rpm", "400.0 rpm", "600.0 rpm")
    assert Runs(vary={"friction": {"from": 0, "to": 0.2, "number": 3}}).vary["friction"] == (0.0, 0.1, 0.2)
    for wrong in ({"from": "1 mm", "to": "1 m", "number": 3}, {"from": 1, "to": 2}, [], 3):
        with pytest.raises(ValueError, match=r"unit|list of values"):
            Runs(vary={"clearance": wrong})


def test_what_an_ensemble_reads_survives_the_way_through_json():
    given = Scenario(mechanism=mechanism(), ensemble=Runs(vary={"speed": ["300 rpm", 70]}))
    assert Scenario.model_validate_json(given.model_dump_json()) == given


def test_a_whole_effect_is_nothing_to_vary():
    made = mechanism(effect("slider_spring", stiffness_N_m=1e3, rest_position_m=0.5))
    key = "mechanism.effects.slider_spring"
    with pytest.raises(InputError, match="names a whole effect; go on to a number"):
        list(ensemble_runs(made, options(), Runs(vary={key: [1, 2]})))
