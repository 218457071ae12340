"""A scenario's folder gives its surrogates back, also where the crank's speed changes."""

import numpy as np
import pytest

from jointgap.config import Scenario, Surrogate, read_yaml
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.dynamics.simulation import simulate
from jointgap.networks.clearance import train_clearance
from jointgap.networks.train import train
from jointgap.scenario.results import ScenarioResults, outputs_of, read_trajectory
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


def test_rates_of_the_second_surrogate_follow_the_speed_of_a_motor(tmp_path):
    motor = scenario(
        ("crank_pivot",), speed="500 rpm", drive=MOTOR
    )  # with networks that are hardly trained
    coarse = simulate(motor.mechanism, motor.simulate).samples
    finer = motor.simulate.model_copy(update={"samples_per_revolution": 36000})
    results = ScenarioResults(tmp_path, motor)
    results.write(schema.TRAJECTORY, coarse)
    fit = train_clearance(
        coarse, simulate(motor.mechanism, finer).samples, motor.surrogate, motor.mechanism.loose
    )
    results.write(schema.CLEARANCE_FIT, fit.weights())
    for output in outputs_of(motor.mechanism):
        network, *_ = train(coarse, output, Surrogate(**QUICK))
        results.write(schema.FIT, network.weights(), output)
    assert np.ptp(coarse["crank_speed"]) > 5.0
    found = trained_surrogates(results)
    assert (
        set(found["networks"])
        == set(found["clearance"])
        == {"r1", "gamma1", "gamma1_dot", "gamma1_ddot"}
    )
    held_out = coarse.iloc[100::7]
    for output, fit in found["clearance"].items():
        error = fit(held_out["crank_angle"].to_numpy())[0] - held_out[output].to_numpy()
        assert np.sqrt(np.mean(error**2)) < 1e-3 * np.ptp(held_out[output]), output


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
