"""A motor turns the crank, with a torque-speed line that is not quite the same in every run."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jointgap.campaign.analyse import analyse
from jointgap.campaign.plan import preflight_tables
from jointgap.config.campaign import MOTOR_LINE
from jointgap.config.load import load_campaign
from jointgap.config.scenario import MotorDrive
from jointgap.identification.noise import noise_of_model
from jointgap.identification.problem import Problem
from tests.rig.campaigns import model_of, samples, written

pytestmark = pytest.mark.integration

MOTOR = {"stall_torque": 30.0, "no_load_speed": 40.0, "inertia": 0.02}
# stall torque [N m], no-load speed [rad/s]
LINES = {"slow": (24.0, 24.7), "mid": (31.0, 33.5), "fast": (29.5, 41.0)}
TURNS, PER_TURN, NOISE = 5, 72, 0.01
READ = ("crank_angle", "crank_speed", "guide_force")
WIDE = {"stall_torque": [20.0, 40.0], "no_load_speed": [20.0, 50.0]}


def rig(folder: Path, *hidden: dict, **nuisance) -> Path:
    """A campaign whose motor is stated to have one line, beside data of runs with `LINES` and
    `hidden` effects."""
    rng, runs, noise = np.random.default_rng(8), {}, {channel: {} for channel in READ}
    for run, (torque, no_load) in LINES.items():
        drive = MotorDrive(
            kind="motor", **MOTOR | {"stall_torque": torque, "no_load_speed": no_load}
        )
        options = {"revolutions": 40, "samples_per_revolution": PER_TURN, "drive": drive}
        table = (
            samples(*hidden, speed=0.97 * no_load, **options)
            .iloc[-TURNS * PER_TURN :][["time", *READ]]
            .copy()
        )
        speed = table["crank_speed"].mean()
        for channel in READ:
            noise[channel][run] = sd = (
                2e-3 if channel == "crank_angle" else NOISE * table[channel].std()
            )
            table[channel] += sd * rng.standard_normal(len(table))
        runs[run] = speed, table
    return written(folder, runs, noise=noise, drive="motor", motor=MOTOR, nuisance=nuisance)


@pytest.mark.slow  # the motor's settling makes a simulation last
def test_friction_is_identified_with_a_motor_line_for_each_run(tmp_path):
    hidden = {"name": "slider_coulomb_friction", "parameters": {"force_N": 8.0}}
    result = analyse(rig(tmp_path, hidden, slider_mass="5%", **WIDE), tmp_path / "results")
    (effect,) = result["effects"]
    assert (result["verdict"], effect["name"]) == ("named", "slider_coulomb_friction")
    low, high = effect["parameters"]["force_N"]["interval_90"]
    assert low - 0.1 < 8.0 < high + 0.1
    for run in ("slow", "mid"):
        torque, no_load = LINES[run]
        assert result["nuisances"][f"no_load_speed@{run}"]["value"] == pytest.approx(
            no_load, rel=0.02
        )
        assert result["nuisances"][f"stall_torque@{run}"]["value"] == pytest.approx(torque, rel=0.1)
    assert result["gap"]["confirm"]["after"] < 1.3


def test_different_motor_lines_leave_only_noise(tmp_path):
    model = model_of(rig(tmp_path, **WIDE))
    problem = Problem(model, noise_of_model(model))
    stated = {p.key: p.nominal for p in problem.nuisances}
    own = {
        f"{key}@{run}": line[i] for run, line in LINES.items() for i, key in enumerate(MOTOR_LINE)
    }
    assert problem.gap(problem.residual(stated)) > 5.0
    assert problem.gap(problem.residual(stated | own)) == pytest.approx(1.0, abs=0.1)


def test_a_preflight_uses_the_recorded_unsteady_motion(tmp_path):
    rng, alike = np.random.default_rng(2), []
    for depth in (0.0, 0.6):
        time = np.linspace(0.0, 2.0, 400)
        angle = 20.0 * time + depth * np.sin(20.0 * time)
        columns = {
            "time": time,
            "crank_angle": angle,
            "crank_torque": rng.standard_normal(time.size),
        }
        noise = {"crank_angle": {"run": 3e-5}, "crank_torque": {"run": 0.02}}
        runs = {"run": (20.0, pd.DataFrame(columns))}
        path = written(tmp_path, runs, noise=noise, drive="measured_angle", nuisance={})
        table = preflight_tables(load_campaign(path), 0.01)["confusability"]
        pair = table[
            (table["first"] == "crank_viscous_friction")
            & (table["second"] == "crank_coulomb_friction")
        ]
        alike.append(pair["cosine"].item())
    assert alike[0] > 0.999  # one steady torque
    assert alike[1] < 0.95
