"""Sensors: filters, lags, gravity and faults by their laws."""

import math

import numpy as np
import pytest

from jointgap.rig import sensors
from jointgap.rig.model import build_model
from tests.rig.rigs import campaign, mechanism, read, recorded, rig, seen, worst

CORNER, INTERVAL = 20.0, 1e-4
TIME = np.arange(40_000) * INTERVAL
INSIDE = slice(15_000, 25_000)
# delay of the polynomial of 4th order at low frequencies, times the corner's angular frequency
BUTTERWORTH = 2.6131
GRAVITY = 9.80665


def wave(frequency, delay=0.0):
    return np.cos(math.tau * frequency * (TIME - delay))


@pytest.fixture(scope="module")
def plain():
    """The model of sensors without filters, and their readings."""
    model = rig()
    return model, read(model)


@pytest.mark.parametrize("frequency", [2.0, 20.0, 30.0])
def test_the_low_pass_is_butterworths_of_fourth_order(frequency):
    power = 1.0 / (1.0 + (frequency / CORNER) ** 8)
    forth_and_back = sensors.low_pass(wave(frequency), INTERVAL, CORNER, causal=False)
    # without delay
    assert forth_and_back[INSIDE] == pytest.approx(power * wave(frequency)[INSIDE], abs=1e-3)
    causal = sensors.low_pass(wave(frequency), INTERVAL, CORNER, causal=True)
    assert np.max(np.abs(causal[INSIDE])) == pytest.approx(math.sqrt(power), rel=1e-3)


def test_a_causal_low_pass_delays_its_corner_by_half_a_period():
    at_corner, slow, lifted = (
        sensors.low_pass(item, INTERVAL, CORNER, causal=True)
        for item in (wave(CORNER), wave(1.0), wave(1.0) + 5.0)
    )
    assert at_corner[INSIDE] == pytest.approx(-math.sqrt(0.5) * wave(CORNER)[INSIDE], abs=1e-3)
    assert slow[INSIDE] == pytest.approx(
        wave(1.0, BUTTERWORTH / (math.tau * CORNER))[INSIDE], abs=1e-3
    )
    assert lifted[0] == pytest.approx(6.0)  # without a transient


def test_a_lag_follows_its_differential_equation_and_is_exact_for_straight_lines():
    time, lag = np.arange(4000) * 1e-3, 0.05
    result, settled = sensors.lagged(np.cos(3.0 * time), 1e-3, lag), time > 1.0
    expected = np.cos(3.0 * time - math.atan(3.0 * lag)) / math.hypot(1.0, 3.0 * lag)
    assert result[settled] == pytest.approx(expected[settled], abs=2e-6)
    ramp = sensors.lagged(3.0 * time, 1e-3, lag)
    assert ramp == pytest.approx(3.0 * (time - lag * (1.0 - np.exp(-time / lag))), abs=1e-11)


def test_bias_and_gain_act_on_their_own_channel_alone(plain):
    model, true = plain
    torque = true["crank_torque"]
    for fault, values, expected in (
        ("bias", {"bias": 0.3}, torque + 0.3),
        ("gain", {"gain_error": 0.05}, 1.05 * torque),
    ):
        result = read(model, (f"sensor_{fault}:crank_torque", values))
        assert worst(result, true | {"crank_torque": expected}) < 1e-12


def test_an_encoder_offset_shifts_the_other_channels(plain):
    model, true = plain
    offset = read(model, ("encoder_offset", {"offset_rad": math.tau / 90}))
    assert offset["crank_angle"] == pytest.approx(true["crank_angle"])
    assert offset["crank_torque"][1:] == pytest.approx(true["crank_torque"][:-1], abs=1e-9)


def test_an_accelerometer_reads_gravity_upwards_with_its_gain_and_without_its_bias():
    name, own = "slider_acceleration", campaign(mechanism())
    reading = campaign(mechanism(gravity_direction=0.0), sensors={name: {"reads_gravity": True}})
    model, true = build_model(reading), read(build_model(own))[name]
    assert read(model)[name] == pytest.approx(true - GRAVITY)
    result = read(
        model, (f"sensor_bias:{name}", {"bias": 0.3}), (f"sensor_gain:{name}", {"gain_error": 0.05})
    )
    assert result[name] == pytest.approx(1.05 * (true - GRAVITY) + 0.3, rel=1e-12)


@pytest.mark.parametrize(
    "fault, sensor, delay",
    [
        (("sensor_lag:slider_position", {"lag_s": 1e-4}), {}, 1e-4),
        (None, {"bandwidth": "400 Hz", "filter": "causal"}, BUTTERWORTH / (math.tau * 400.0)),
        (None, {"bandwidth": "400 Hz", "filter": "zero_phase"}, 0.0),
    ],
)
def test_a_sensor_with_a_lag_or_a_causal_filter_reads_late_and_one_without_delay_does_not(
    plain, fault, sensor, delay
):
    true, model = plain[1]["slider_position"], rig(sensors={"slider_position": sensor})
    velocity = np.gradient(true, model.series[0].time)[5:-5]
    shift = (true - read(model, *([fault] if fault else []))["slider_position"])[5:-5]
    assert shift @ velocity / (velocity @ velocity) == pytest.approx(delay, rel=0.05, abs=2e-6)


def test_a_computed_crank_angle_is_exact_and_not_compared():
    rig_campaign = campaign(mechanism())
    model = build_model(rig_campaign, recorded(rig_campaign))
    assert "crank_angle" not in seen(model) and {*seen(model)} | {"time", "crank_angle"} == {
        *rig_campaign.channels
    }
    assert not {"speed", "first_angle"} & {p.name for p in model.nuisances}
