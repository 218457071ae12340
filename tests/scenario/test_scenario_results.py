"""A scenario's folder gives its surrogates back, also where the crank's speed changes."""

import numpy as np
import pytest

from jointgap.config import Scenario, Surrogate, read_yaml
from jointgap.config.scenario_results import ScenarioResults, outputs_of, read_trajectory
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.dynamics.simulation import simulate
from jointgap.networks.train import train
from jointgap.scenario.trained import trained_surrogates
from tests.catalogue import each

MOTOR = {"kind": "motor", "stall_torque": 40.0, "no_load_speed": "660 rpm", "inertia": 0.05}
QUICK = {"hidden": (2,), "training_points": 121, "iterations": 2, "seeds": (0,)}


def scenario(loose=("crank_pin", "piston_pin"), fluctuation=None, **simulated):
    effect = {"name": "speed_fluctuation", "parameters": {"ratio": fluctuation, "order": 2}}
    mechanism = read_yaml("config/mechanisms/erkaya2009.yaml") | {
        "effects": [effect] if fluctuation else []
    }
    for name, joint in mechanism["joints"].items():
        joint["loose"] = name in loose
    options = {"revolutions": 1, "samples_per_revolution": 1800} | simulated
    return Scenario.model_validate(
        {"mechanism": mechanism, "simulate": options, "surrogate": QUICK, "networks": True}
    )


def test_the_networks_of_a_motor_driven_mechanism_are_read_back(tmp_path):
    motor = scenario(("crank_pivot",), speed="500 rpm", drive=MOTOR)
    motion = simulate(motor.mechanism, motor.simulate).samples
    results, angle = ScenarioResults(tmp_path, motor), motion["crank_angle"].to_numpy()[:100]
    trained = {}
    for output in outputs_of(motor.mechanism):
        trained[output], *_ = train(motion, output, Surrogate(**QUICK))
        results.write(schema.FIT, trained[output].weights(), output)
    read_back = trained_surrogates(results)["networks"]
    assert set(read_back) == {"r1", "gamma1", "gamma1_dot", "gamma1_ddot"}
    for output, fit in read_back.items():
        np.testing.assert_array_equal(fit(angle)[0], trained[output].network.values(angle))


def test_a_trajectory_is_taken_for_its_own_scenario_alone(tmp_path):
    def own_alone(given, *others):
        file = tmp_path / "trajectory.parquet"
        parquet.write(schema.TRAJECTORY, simulate(given.mechanism, given.simulate).samples, file)
        assert len(read_trajectory(file, given)) == 1801
        for other in others:
            with pytest.raises(InputError, match="give the options it was simulated with"):
                read_trajectory(file, other)

    plain = scenario(), scenario(speed=30.0), scenario(start_angle=1.0), scenario(revolutions=2)
    driven = scenario(drive=MOTOR), scenario(drive=MOTOR, speed=30.0)
    each(own_alone, [plain, driven, (scenario(fluctuation=0.1), scenario(fluctuation=0.2))])
    with pytest.raises(InputError, match="all joints are ideal"):
        outputs_of(scenario(()).mechanism)
