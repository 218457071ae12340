"""A motor turns the crank, with a torque-speed line that is not quite the same in every run."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.campaign.analyse import analyse
from jointgap.campaign.plan import preflight_tables
from jointgap.config import Simulate, load_mechanism
from jointgap.config.campaign import MOTOR_LINE
from jointgap.config.load import load_campaign
from jointgap.config.scenario import MotorDrive
from jointgap.core.errors import InputError
from jointgap.dynamics.simulation import simulate
from jointgap.identification.noise import noise_of_model
from jointgap.identification.problem import Problem
from jointgap.rig.model import build_model
from jointgap.rig.read_files import read_measurements
from tests.slider_crank.test_library import MECHANISM

pytestmark = pytest.mark.integration

MOTOR = {"stall_torque": 30.0, "no_load_speed": 40.0, "inertia": 0.02}
LINES = {"slow": (24.0, 24.7), "mid": (31.0, 33.5), "fast": (29.5, 41.0)}  # stall torque [N m], no-load speed [rad/s]
STATED = {"slow": 24.0, "mid": 33.0, "fast": 40.0}  # rad/s
TURNS, PER_TURN, NOISE = 5, 72, 0.01
UNITS = {"crank_angle": "rad", "crank_speed": "rad/s", "guide_force": "N"}


def written(folder: Path, hidden: dict | None, lines=LINES, **keys) -> Path:
    """A campaign whose motor is stated to have one line, beside data of runs with `lines` and the effect `hidden`."""
    (folder / "base.yaml").write_text(yaml.safe_dump(MECHANISM))
    (folder / "true.yaml").write_text(yaml.safe_dump({**MECHANISM, "effects": [hidden] if hidden else []}))
    truth, rng, runs = load_mechanism(folder / "true.yaml"), np.random.default_rng(8), []
    noise = {channel: {} for channel in UNITS}
    for run, (torque, no_load) in lines.items():
        drive = MotorDrive(kind="motor", **MOTOR | {"stall_torque": torque, "no_load_speed": no_load})
        options = Simulate(speed=0.97 * no_load, revolutions=40, samples_per_revolution=PER_TURN, drive=drive)
        seen = simulate(truth, options).samples.iloc[-TURNS * PER_TURN :]
        table = pd.DataFrame({"t": seen["time"] - seen["time"].iloc[0]})
        for channel in UNITS:
            sd = 2e-3 if channel == "crank_angle" else NOISE * seen[channel].std()
            table[channel] = seen[channel] + sd * rng.standard_normal(len(seen))
            noise[channel][run] = float(sd)
        table.to_csv(folder / f"{run}.csv", index=False)
        role = "confirm" if run == "fast" else "identify"
        runs.append({"id": run, "file": f"{run}.csv", "speed": float(seen["crank_speed"].mean()), "role": role})
    channels = {name: {"column": name, "unit": unit, "noise": noise[name]} for name, unit in UNITS.items()}
    campaign = {
        "name": "motor",
        "mechanism": "base.yaml",
        "drive": "motor",
        "motor": MOTOR,
        "runs": runs,
        "channels": channels | {"time": {"column": "t", "unit": "s"}},
        "nuisance": {"slider_mass": "5%"},
    }
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign | keys))
    return folder / "campaign.yaml"


@pytest.mark.slow  # the motor's settling makes a simulation last
def test_what_is_hidden_is_found_although_each_run_has_a_line_of_its_own(tmp_path):
    hidden = {"name": "slider_coulomb_friction", "parameters": {"force_N": 8.0}}
    nuisance = {"slider_mass": "5%", "stall_torque": [20.0, 40.0], "no_load_speed": [20.0, 50.0]}
    found = analyse(written(tmp_path, hidden, nuisance=nuisance), tmp_path / "results")
    assert found["verdict"] == "named"
    (effect,) = found["effects"]
    assert effect["name"] == "slider_coulomb_friction"
    low, high = effect["parameters"]["force_N"]["interval_90"]
    assert low - 0.1 < 8.0 < high + 0.1
    for run in ("slow", "mid"):
        torque, no_load = LINES[run]
        assert found["nuisances"][f"no_load_speed@{run}"]["value"] == pytest.approx(no_load, rel=0.02)
        assert found["nuisances"][f"stall_torque@{run}"]["value"] == pytest.approx(torque, rel=0.1)
    assert found["gap"]["confirm"]["after"] < 1.3


@pytest.mark.slow
def test_gravity_is_fitted_and_offered_where_a_motor_drives(tmp_path):
    hidden = {"name": "gravity", "parameters": {"acceleration_m_s2": 9.81}}
    lines = dict.fromkeys(("slow", "mid", "fast"), (MOTOR["stall_torque"], MOTOR["no_load_speed"]))
    lines |= {"mid": (20.0, 30.0), "fast": (25.0, 35.0)}
    found = analyse(
        written(tmp_path, hidden, lines, nuisance={"stall_torque": [15.0, 40.0], "no_load_speed": [20.0, 50.0]}),
        tmp_path / "results",
    )
    assert [effect["name"] for effect in found["effects"]] == ["gravity"]


def test_the_model_leaves_noise_alone_where_nothing_is_hidden_but_the_lines_differ(tmp_path):
    nuisance = {"stall_torque": [20.0, 40.0], "no_load_speed": [20.0, 50.0]}
    campaign = load_campaign(written(tmp_path, None, nuisance=nuisance))
    model = build_model(campaign, read_measurements(campaign))
    problem = Problem(model, noise_of_model(model))
    stated = {p.key: p.nominal for p in problem.nuisances}
    own = {f"{key}@{run}": line[i] for run, line in LINES.items() for i, key in enumerate(MOTOR_LINE)}
    assert problem.gap(problem.residual(stated)) > 5.0
    assert problem.gap(problem.residual(stated | own)) == pytest.approx(1.0, abs=0.1)


def test_a_preflight_follows_the_motion_that_was_recorded_where_the_crank_does_not_turn_evenly(tmp_path):
    rng = np.random.default_rng(2)
    (tmp_path / "base.yaml").write_text(yaml.safe_dump(MECHANISM))
    for run, depth in (("even", 0.0), ("uneven", 0.6)):
        time = np.linspace(0.0, 2.0, 400)
        angle = 20.0 * time + depth * np.sin(20.0 * time)
        torque = rng.standard_normal(time.size)
        pd.DataFrame({"t": time, "crank_angle": angle, "crank_torque": torque}).to_csv(tmp_path / f"{run}.csv")
    content = {
        "name": "uneven",
        "mechanism": "base.yaml",
        "drive": "measured_angle",
        "channels": {
            "time": {"column": "t", "unit": "s"},
            "crank_angle": {"column": "crank_angle", "unit": "rad", "resolution": 1e-4},
            "crank_torque": {"column": "crank_torque", "unit": "N*m", "noise": 0.02},
        },
    }
    alike = {}
    for run in ("even", "uneven"):
        runs = [{"id": run, "file": f"{run}.csv", "speed": 20.0, "role": "split"}]
        (tmp_path / f"{run}.yaml").write_text(yaml.safe_dump(content | {"runs": runs}))
        table = preflight_tables(load_campaign(tmp_path / f"{run}.yaml"), 0.01)["confusability"]
        pair = table[(table["first"] == "crank_viscous_friction") & (table["second"] == "crank_coulomb_friction")]
        alike[run] = pair["cosine"].item()
    assert alike["even"] > 0.999  # one steady torque
    assert alike["uneven"] < 0.95


def test_a_line_is_of_each_run_for_itself(tmp_path):
    path = written(tmp_path, None, nuisance={"stall_torque": "5%", "no_load_speed": [38.0, 42.0]})
    campaign = load_campaign(path)
    keys = {p.key: (p.low, p.high) for p in build_model(campaign, read_measurements(campaign)).nuisances}
    for run in LINES:
        assert keys[f"stall_torque@{run}"] == pytest.approx((28.5, 31.5))
        assert keys[f"no_load_speed@{run}"] == (38.0, 42.0)


def test_bounds_that_leave_out_the_stated_motor_are_refused_with_both(tmp_path):
    path = written(tmp_path, None, nuisance={"stall_torque": [31.0, 40.0]})
    with pytest.raises(InputError, match=r"stall_torque is 30, outside of \[31, 40\]"):
        load_campaign(path)
