"""Many motions at once are the motions one by one, whoever simulates them; the same from the
command line."""

import itertools
import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from jointgap.app.cli import cli
from jointgap.config import Runs
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError, SimulationError
from jointgap.designs.ensemble import ensemble_runs, write_ensemble
from jointgap.designs.statistics import clearance_vectors
from jointgap.dynamics.parallel import Run, simulate_ensemble, simulate_runs
from jointgap.dynamics.simulation import simulate
from tests.catalogue import refused
from tests.dynamics.cases import ALL, MOTOR, effect, mechanism, options

COARSE = options(samples_per_revolution=90, tolerance=1e-9)


def starts(number: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(scale=1e-7, size=(number, 4))


def test_the_files_hold_what_a_simulation_alone_gives(tmp_path):
    made = mechanism(friction=0.1, loose=ALL)
    wanted = options(samples_per_revolution=90, tolerance=1e-9, drive=MOTOR)
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


def test_a_run_that_fails_says_why_and_the_others_go_on(tmp_path):
    made = mechanism(friction=0.1)
    braked = mechanism(effect("slider_constant_force", force_N=5000.0), friction=0.1)
    stalling = options(drive=MOTOR, samples_per_revolution=90, tolerance=1e-9)
    runs = [
        Run(made, COARSE),
        Run(made, COARSE, [0.1, 0, 0, 0]),
        Run(braked, stalling),
        Run(made, COARSE),
    ]
    written = write_ensemble(runs, tmp_path)
    assert "not less than its clearance" in written["reason"][1]
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


def runs_of(**keys) -> list[Run]:
    return list(ensemble_runs(mechanism(), COARSE, Runs(**keys)))


def test_every_combination_runs_from_every_start():
    runs = runs_of(vary={"speed": ["300 rpm", "600 rpm"], "friction": [0, 0.1, 0.2]}, members=2)
    assert len(runs) == 2 * 3 * 2
    assert sorted({run.options.speed for run in runs}) == pytest.approx([10 * np.pi, 20 * np.pi])
    assert [run.mechanism.joint("crank_pin").contact.friction for run in runs[:6:2]] == [
        0,
        0.1,
        0.2,
    ]
    assert not np.any(runs[0].perturbation) and np.any(runs[1].perturbation)
    np.testing.assert_array_equal(runs[1].perturbation, runs[3].perturbation)
    assert not np.any([run.perturbation[4:] for run in runs])  # the crank pivot is ideal


def test_the_clearance_of_one_joint_is_varied_by_its_path():
    (run,) = runs_of(vary={"mechanism.joints.piston_pin.clearance": ["0.3 mm"]}, members=1)
    assert run.values == {"mechanism.joints.piston_pin.clearance": pytest.approx(3e-4)}
    assert run.mechanism.clearance("piston_pin") == pytest.approx(3e-4)
    assert run.mechanism.clearance("crank_pin") == mechanism().clearance("crank_pin")


def test_an_effect_at_two_sites_is_found_by_name_and_site():
    pins = [
        effect("pin_friction", site=site, coefficient=0.1) for site in ("crank_pin", "piston_pin")
    ]
    made, end = mechanism(*pins, loose=()), "parameters.coefficient"
    key = f"mechanism.effects.pin_friction@piston_pin.{end}"
    (run,) = ensemble_runs(made, COARSE, Runs(vary={key: [0.2]}, members=1))
    assert [
        run.mechanism.effect("pin_friction", pin).coefficient for pin in ("crank_pin", "piston_pin")
    ] == [0.1, 0.2]
    with pytest.raises(InputError, match=r"did you mean .*'pin_friction@crank_pin'"):
        list(
            ensemble_runs(
                made, COARSE, Runs(vary={f"mechanism.effects.pin_friction.{end}": [0.2]}, members=1)
            )
        )


REFUSED = [
    ({"sped": [1]}, "did you mean 'speed'"),
    ({"mechanism.contacts.steel.friction": [0.1]}, "contacts are copied into the joints"),
    ({"clearance": ["1 s"]}, "ensemble.vary.clearance"),
    ({"mechanism.joints.crank_pn.clearance": ["1 mm"]}, "did you mean 'crank_pin'"),
    ({"mechanism.crank.length": [0.7]}, "the crank cannot turn"),
    ({"mechanism.effects.added_slider_mass.parameters.mass_kg": [1]}, "vary the key itself"),
]


def test_what_cannot_be_varied_is_refused_with_its_key():
    refused(lambda vary: runs_of(vary=vary), REFUSED)


SIMULATE = {"revolutions": 3, "samples_per_revolution": 360, "tolerance": 1e-9}


def sections_of(**sections) -> str:
    made = mechanism(friction=0.2).model_dump()
    return json.dumps(
        {"mechanism": made, "simulate": SIMULATE, "surrogate": {"training_points": 37}} | sections
    )


def call(*arguments):
    done = CliRunner().invoke(cli, list(map(str, arguments)), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def test_statistics_of_a_simulated_motion_are_printed_and_written(tmp_path):
    call("simulate", "--options", sections_of(), "--results", tmp_path)
    folder = tmp_path / "simulate"
    motion = ["--trajectory", folder / "trajectory.parquet", "--events", folder / "events.parquet"]
    output = call(
        "cycles",
        "--options",
        sections_of(),
        *motion,
        "--folder",
        tmp_path / "cycles",
        "--angle",
        "90 deg",
    )
    assert "from revolution 2 on: " in output and "crank_pin: flight" in output
    section = parquet.read(schema.POINCARE_SECTION, tmp_path / "cycles/section.parquet")
    assert list(section["revolution"]) == [2, 3, 2, 3]
    assert len(parquet.read(schema.JOINT_REVOLUTIONS, tmp_path / "cycles/revolutions.parquet")) > 0
