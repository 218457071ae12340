"""Sensors: filters, lags, gravity and faults by their laws."""

import math

import numpy as np
import pytest

from jointgap.slider_crank import build_model, sensors
from tests.slider_crank.rigs import CHANNELS, campaign, mechanism, recorded, worst

CORNER, INTERVAL = 20.0, 1e-4


def model_of(**sensor):
    own = campaign(mechanism(), sensors={"slider_acceleration": sensor})
    return build_model(own, recorded(own))


def read(model, label=None, **values):
    chosen = [(one, values) for one in model.candidates if one.label == label]
    assert label is None or chosen
    return model.simulate("slow", model.nominal("slow"), chosen)


@pytest.mark.parametrize("frequency", [2.0, 20.0, 30.0])
def test_the_low_pass_is_butterworths_of_fourth_order(frequency):
    time = np.arange(40_000) * INTERVAL
    wave = np.cos(2 * math.pi * frequency * time)
    power = 1.0 / (1.0 + (frequency / CORNER) ** 8)
    inside = slice(15_000, 25_000)
    forth_and_back = sensors.low_pass(wave, INTERVAL, CORNER, causal=False)
    assert forth_and_back[inside] == pytest.approx(power * wave[inside], abs=1e-3)  # without delay
    causal = sensors.low_pass(wave, INTERVAL, CORNER, causal=True)
    assert np.max(np.abs(causal[inside])) == pytest.approx(math.sqrt(power), rel=1e-3)


def test_a_lag_follows_its_differential_equation():
    time, lag = np.arange(4000) * 1e-3, 0.05
    found = sensors.lagged(np.cos(3.0 * time), 1e-3, lag)
    settled = time > 1.0
    gain = 1.0 / math.hypot(1.0, 3.0 * lag)
    expected = gain * np.cos(3.0 * time - math.atan(3.0 * lag))
    assert found[settled] == pytest.approx(expected[settled], abs=2e-6)


def test_bias_and_gain_act_on_their_own_channel_alone():
    model = model_of()
    plain = read(model)
    for label, values, expected in (
        ("sensor_bias:crank_torque", {"bias": 0.3}, plain["crank_torque"] + 0.3),
        ("sensor_gain:crank_torque", {"gain_error": 0.05}, 1.05 * plain["crank_torque"]),
    ):
        found = read(model, label, **values)
        assert worst(found, plain | {"crank_torque": expected}) < 1e-12


def test_a_short_lag_shifts_a_reading_in_time():
    model = model_of()
    plain, late = read(model), read(model, "sensor_lag:slider_position", lag_s=1e-4)
    own = campaign(mechanism(), list(CHANNELS))
    velocity = np.gradient(plain["slider_position"], recorded(own).runs["slow"].time)
    shift = plain["slider_position"] - late["slider_position"]
    assert shift[5:-5] == pytest.approx(1e-4 * velocity[5:-5], abs=5e-6)


def test_an_encoders_offset_is_in_the_angle_read_and_places_all_else():
    model = model_of()
    plain, offset = read(model), read(model, "encoder_offset", offset_rad=2 * math.pi / 90)
    assert offset["crank_angle"] == pytest.approx(plain["crank_angle"])
    assert offset["crank_torque"][1:] == pytest.approx(plain["crank_torque"][:-1], abs=1e-9)


def test_an_accelerometer_at_rest_reads_gravity_upwards():
    assert sensors.gravity_read("rod_acceleration_y", -math.pi / 2) == pytest.approx(9.80665)
    assert sensors.gravity_read("slider_acceleration", -math.pi / 2) == pytest.approx(0.0, abs=1e-12)
    assert sensors.gravity_read("crank_torque", -math.pi / 2) == 0.0


def test_readings_with_gravity_differ_by_it():
    own = campaign(mechanism(gravity_direction=0.0), sensors={"slider_acceleration": {"reads_gravity": True}})
    with_it, without = read(build_model(own)), read(build_model(campaign(mechanism())))
    assert with_it["slider_acceleration"] == pytest.approx(without["slider_acceleration"] - 9.80665)


def test_a_wide_band_hardly_filters_and_a_narrow_one_leaves_the_first_order():
    plain = read(model_of())
    wide = read(model_of(bandwidth="2 kHz"))
    assert worst(wide, plain) < 1e-2
    first = 30.0 / (2 * math.pi)
    narrow = read(model_of(bandwidth=f"{1.4 * first} Hz"))["slider_acceleration"]
    angle = plain["crank_angle"]
    amplitudes = [2 * abs(np.mean(plain["slider_acceleration"][:-1] * np.exp(1j * k * angle[:-1]))) for k in (1, 2)]
    expected = sum(
        amplitude / (1 + (k / 1.4) ** 8) * math.copysign(1.0, -1.0) * np.cos(k * angle)
        for k, amplitude in zip((1, 2), amplitudes, strict=True)
    )
    inside = slice(60, 120)
    assert narrow[inside] == pytest.approx(expected[inside], abs=0.05 * amplitudes[0])
