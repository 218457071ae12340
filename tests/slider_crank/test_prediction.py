"""What the model of a slider-crank predicts is what the plain simulation gives at the samples, however these were
recorded.
"""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.config import MotorDrive
from jointgap.core.joints import PINS
from jointgap.rig.model import build_model
from jointgap.rig.recording import Measurements
from tests.slider_crank.rigs import CHANNELS, campaign, mechanism, recorded, worst


def predicted(own, measurements):
    model = build_model(own, measurements)
    expected = {run: {s.channel: s.value for s in model.series if s.run == run} for run in model.plans}
    return model, {run: model.simulate(run, model.nominal(run)) for run in model.plans}, expected


@pytest.mark.parametrize(("loose", "bound"), [((), 1e-9), (PINS, 5e-3)], ids=["ideal", "loose"])
def test_prediction_is_the_simulation_at_the_samples(loose, bound):
    own = campaign(mechanism(loose))
    _, found, expected = predicted(own, recorded(own))
    for run in expected:
        assert set(found[run]) == set(CHANNELS) - {"time"}
        assert worst(found[run], expected[run]) < bound


def test_without_times_samples_lie_at_the_angles_read():
    own = campaign(mechanism(), [name for name in CHANNELS if name != "time"])
    model, found, expected = predicted(own, recorded(own))
    assert "crank_angle" not in found["slow"]
    assert worst(found["slow"], expected["slow"]) < 1e-9
    turn = model.series[0].time[90] - model.series[0].time[0]
    assert turn == pytest.approx(2 * np.pi / 30.0)


def test_a_stated_first_angle_places_samples_that_have_times_alone():
    own = campaign(mechanism(), [name for name in CHANNELS if name != "crank_angle"], run={"first_angle": 0.0})
    model, found, expected = predicted(own, recorded(own))
    assert not model.nuisances
    assert worst(found["fast"], expected["fast"]) < 1e-9


def test_an_unknown_first_angle_is_found_and_left_to_the_fit():
    own = campaign(mechanism(), [name for name in CHANNELS if name != "crank_angle"])
    measurements = recorded(own)
    later = {
        name: replace(
            one,
            time=one.time[31:],
            crank_angle=one.crank_angle[31:],
            channels={channel: values[31:] for channel, values in one.channels.items()},
            held_out=one.held_out[31:],
        )
        for name, one in measurements.runs.items()
    }
    model = build_model(own, Measurements(later))
    first = next(p for p in model.nuisances if p.key == "first_angle@slow")
    assert first.nominal == pytest.approx(31 / 90 * 2 * np.pi, abs=0.01)
    assert first.low < first.nominal < first.high


def test_mean_speed_and_phase_come_from_times_and_noisy_angles():
    own = campaign(mechanism(), nuisance={"speed": "1 %"})
    measurements = recorded(own)
    one, noise = measurements.runs["slow"], np.random.default_rng(1).normal(0.0, 3e-3, 181)
    measurements.runs["slow"] = replace(one, time=one.time * 1.001, crank_angle=one.crank_angle + noise)
    model = build_model(own, measurements)
    bounds = {p.key: p for p in model.nuisances}
    assert bounds["speed@slow"].low < 30.0 / 1.001 < bounds["speed@slow"].high
    assert bounds["first_angle@slow"].low < 4 * np.pi < bounds["first_angle@slow"].high
    assert bounds["speed@slow"].high - bounds["speed@slow"].low < 0.3


def test_a_measured_angle_drives_the_crank():
    own = campaign(mechanism(), drive="measured_angle", sensors={"crank_angle": {"resolution": 1e-5}})
    _, found, expected = predicted(own, recorded(own))
    assert "crank_angle" not in found["slow"]
    assert worst(found["slow"], expected["slow"]) < 2e-2
    inside = slice(20, -20)  # the smooth angle is weak at the ends of the record
    assert (
        worst({k: v[inside] for k, v in found["slow"].items()}, {k: v[inside] for k, v in expected["slow"].items()})
        < 1e-3
    )


def test_a_motor_turns_the_crank_and_its_angle_is_compared():
    motor = {"stall_torque": 40.0, "no_load_speed": 50.0, "inertia": 0.02}
    own = campaign(mechanism(), drive="motor", motor=motor, speeds=(40.0, 45.0))
    drive = MotorDrive(kind="motor", **motor)
    _, found, expected = predicted(own, recorded(own, dropped=12, drive=drive))
    assert {"crank_angle", "crank_speed"} <= set(found["slow"])
    assert worst(found["slow"], expected["slow"]) < 1e-3


def test_a_run_that_starts_at_its_first_sample_drops_nothing():
    own = campaign(mechanism(PINS), run={"start": "dead_centre"})
    _, found, expected = predicted(own, recorded(own, dropped=0))
    assert worst(found["slow"], expected["slow"]) < 5e-3


def test_a_clockwise_crank_is_the_mirror_image_of_a_counter_clockwise_one():
    effects = [{"name": "gravity", "parameters": {}}]
    own = campaign(mechanism(effects=effects, slider={"mass": 0.4482, "offset": 0.02}))
    mirror = campaign(
        mechanism(effects=effects, slider={"mass": 0.4482, "offset": -0.02}, gravity_direction=np.pi / 2),
        run={"direction": "clockwise"},
    )
    turned = ("crank_speed", "rod_acceleration_y", "crank_torque", "guide_force", "frame_force_y")
    measurements = recorded(own)
    for one in measurements.runs.values():
        for channel in turned:
            one.channels[channel] *= -1.0
    _, found, expected = predicted(mirror, measurements)
    assert worst(found["slow"], expected["slow"]) < 1e-9


def test_a_formula_of_a_clockwise_crank_is_in_the_angles_and_signs_of_its_file():
    laws = [
        {"name": "discovered_slider_force", "parameters": {"formula": "20*sin(theta) + 0.1*w*v"}},
        {"name": "discovered_crank_torque", "parameters": {"formula": "0.3*cos(theta) - 0.01*w"}},
    ]
    behind = [
        {"name": "discovered_slider_force", "parameters": {"formula": "-20*sin(theta) - 0.1*w*v"}},
        {"name": "discovered_crank_torque", "parameters": {"formula": "-0.3*cos(theta) - 0.01*w"}},
    ]
    own = campaign(mechanism(effects=laws))
    mirror = campaign(mechanism(effects=behind), run={"direction": "clockwise"})
    measurements = recorded(own)
    for one in measurements.runs.values():
        for channel in ("crank_speed", "rod_acceleration_y", "crank_torque", "guide_force", "frame_force_y"):
            one.channels[channel] *= -1.0
    _, found, expected = predicted(mirror, measurements)
    assert worst(found["slow"], expected["slow"]) < 1e-9


def test_gaps_are_predicted_too():
    own = campaign(mechanism())
    measurements = recorded(own)
    one = measurements.runs["slow"]
    one.channels["crank_torque"][20:40] = np.nan
    one.crank_angle[50:60] = np.nan
    model, found, _ = predicted(own, measurements)
    assert all(np.isfinite(values).all() for values in found["slow"].values())
    torque = next(s for s in model.series if s.key == ("slow", "crank_torque"))
    assert np.isnan(torque.value).sum() == 20


def test_a_preflight_plans_samples():
    own = campaign(mechanism(), sensors={"crank_torque": {"noise": 0.02}})
    model = build_model(own)
    torque = next(s for s in model.series if s.key == ("slow", "crank_torque"))
    assert np.isnan(torque.value).all()
    assert torque.stated_noise == pytest.approx(0.02)
    assert model.simulate("slow", model.nominal("slow"))["crank_torque"].shape == torque.value.shape
