"""Tables of a scenario: networks read back, and trajectories of other options."""

import numpy as np
import pytest

from jointgap.config import Scenario, Surrogate, read_yaml
from jointgap.config.scenario_results import ScenarioResults, outputs_of, read_trajectory
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.motion.slider_crank import simulate
from jointgap.networks.train import train
from jointgap.scenario.trained import trained_surrogates

MOTOR = {"kind": "motor", "stall_torque": 40.0, "no_load_speed": "660 rpm", "inertia": 0.05}
QUICK = {"hidden": (2,), "training_points": 121, "iterations": 2, "seeds": (0,)}


def scenario(loose=("crank_pin", "piston_pin"), fluctuation=None, **simulate_options):
    mechanism = read_yaml("config/mechanisms/erkaya2009.yaml")
    if fluctuation:
        wave = {"name": "speed_fluctuation", "parameters": {"ratio": fluctuation, "order": 2}}
        mechanism["effects"] = [wave]
    for name, joint in mechanism["joints"].items():
        joint["loose"] = name in loose
    options = {"revolutions": 1, "samples_per_revolution": 1800} | simulate_options
    content = {"mechanism": mechanism, "simulate": options, "surrogate": QUICK, "networks": True}
    return Scenario.model_validate(content)


def test_networks_of_a_motor_driven_mechanism_are_read_back(tmp_path):
    motor = scenario(("crank_pivot",), speed="500 rpm", drive=MOTOR)
    motion = simulate(motor.mechanism, motor.simulate).samples
    results, angle = ScenarioResults(tmp_path, motor), motion["crank_angle"].to_numpy()[:100]
    trained = {}
    for output in outputs_of(motor.mechanism):
        trained[output], *_ = train(motion, output, Surrogate(**QUICK))
        results.write(schema.FIT, trained[output].weights(), output)
    networks = trained_surrogates(results)["networks"]
    assert set(networks) == {"r1", "gamma1", "gamma1_dot", "gamma1_ddot"}
    for output, function in networks.items():
        np.testing.assert_array_equal(function(angle)[0], trained[output].network.values(angle))


@pytest.mark.parametrize(
    "options, others",
    [
        ({}, [{"speed": 30.0}, {"start_angle": 1.0}, {"revolutions": 2}]),
        ({"drive": MOTOR}, [{"speed": 30.0}]),
        ({"fluctuation": 0.02}, [{"fluctuation": 0.03}, {"speed": 30.0}]),
    ],
)
def test_a_trajectory_of_other_options_is_refused(tmp_path, options, others):
    simulated, file = scenario(**options), tmp_path / "trajectory.parquet"
    samples = simulate(simulated.mechanism, simulated.simulate).samples
    parquet.write(schema.TRAJECTORY, samples, file)
    assert len(read_trajectory(file, simulated)) == 1801
    for change in others:
        with pytest.raises(InputError, match="give the options it was simulated with"):
            read_trajectory(file, scenario(**options | change))


def test_ideal_joints_leave_nothing_to_learn():
    with pytest.raises(InputError, match="all joints are ideal"):
        outputs_of(scenario(()).mechanism)
