"""Predictions of the model of a slider-crank are those of the plain simulation at the samples,
however these were recorded.
"""

import numpy as np
import pytest

from jointgap.config import MotorDrive
from jointgap.config.channels import CHANNELS as UNITS
from jointgap.config.channels import PRESSURES
from jointgap.core.joints import PINS
from jointgap.rig.model import build_model
from tests.rig.rigs import CHANNELS, campaign, mechanism, read, recorded, seen, worst

EXACT = {"sensors": {"crank_angle": {"resolution": 1e-5}}}
TURNED = ("crank_speed", "rod_acceleration_y", "crank_torque", "guide_force", "frame_force_y")
MOTOR = {"stall_torque": 40.0, "no_load_speed": 50.0, "inertia": 0.02}


def without(channel):
    return [name for name in CHANNELS if name != channel]


@pytest.mark.parametrize(
    "keys, simulated, unread, bound",
    [
        (
            {"channels": [name for name in UNITS if name not in PRESSURES]} | EXACT,
            {},
            {"time"},
            1e-9,
        ),
        ({"content": mechanism(PINS)} | EXACT, {}, {"time"}, 5e-3),
        (
            {"content": mechanism(PINS), "run": {"start": "dead_centre"}} | EXACT,
            {"dropped": 0},
            {"time"},
            5e-3,
        ),
        ({"channels": without("time")}, {}, {"time", "crank_angle"}, 1e-9),
        (
            {"channels": without("crank_angle"), "run": {"first_angle": 0.0}},
            {},
            {"time", "crank_angle"},
            1e-9,
        ),
        ({"drive": "measured_angle"} | EXACT, {}, {"time", "crank_angle"}, 2e-2),
        (
            {"drive": "motor", "motor": MOTOR, "speeds": (40.0, 45.0)},
            {"dropped": 12, "drive": MotorDrive(kind="motor", **MOTOR)},
            {"time"},
            1e-3,
        ),
    ],
)
def test_prediction_is_the_simulation_at_the_samples(keys, simulated, unread, bound):
    rig_campaign = campaign(**{"content": mechanism()} | keys)
    model = build_model(rig_campaign, recorded(rig_campaign, **simulated))
    for run in model.plans:
        result, expected = read(model, run=run), seen(model, run)
        assert result.keys() == expected.keys() == set(rig_campaign.channels) - unread
        assert worst(result, expected) < bound
    if keys.get("drive") == "measured_angle":  # the smooth angle is weak at the ends of the record
        inside = [
            {name: value[20:-20] for name, value in item.items()} for item in (result, expected)
        ]
        assert worst(*inside) < 1e-3


def force(formula, torque):
    """Effects by formulas for the force on the slider and the torque on the crank."""
    laws = {"discovered_slider_force": formula, "discovered_crank_torque": torque}
    return [{"name": name, "parameters": {"formula": law}} for name, law in laws.items()]


WEIGHT = [{"name": "gravity", "parameters": {}}]


@pytest.mark.parametrize(
    "front, behind",
    [
        (
            {"effects": WEIGHT, "slider": {"mass": 0.4482, "offset": 0.02}},
            {
                "effects": WEIGHT,
                "slider": {"mass": 0.4482, "offset": -0.02},
                "gravity_direction": np.pi / 2,
            },
        ),
        (  # formulas are in the angles and signs of their file
            {"effects": force("20*sin(theta) + 0.1*w*v", "0.3*cos(theta) - 0.01*w")},
            {"effects": force("-20*sin(theta) - 0.1*w*v", "-0.3*cos(theta) - 0.01*w")},
        ),
    ],
)
def test_a_clockwise_crank_is_the_mirror_image_of_a_counter_clockwise_one(front, behind):
    measurements = recorded(campaign(mechanism(**front)))
    for item in measurements.runs.values():
        for channel in TURNED:
            item.channels[channel] *= -1.0
    model = build_model(campaign(mechanism(**behind), run={"direction": "clockwise"}), measurements)
    assert worst(read(model), seen(model)) < 1e-9


def test_gaps_are_predicted_too():
    rig_campaign = campaign(mechanism())
    measurements = recorded(rig_campaign)
    item = measurements.runs["slow"]
    item.channels["crank_torque"][20:40] = np.nan
    item.crank_angle[50:60] = np.nan
    model = build_model(rig_campaign, measurements)
    assert all(np.isfinite(values).all() for values in read(model).values())
    assert np.isnan(seen(model)["crank_torque"]).sum() == 20


def test_a_preflight_plans_samples():
    model = build_model(campaign(mechanism(), sensors={"crank_torque": {"noise": 0.02}}))
    torque = next(s for s in model.series if s.key == ("slow", "crank_torque"))
    assert np.isnan(torque.value).all()
    assert torque.stated_noise == pytest.approx(0.02)
    assert read(model)["crank_torque"].shape == torque.value.shape
