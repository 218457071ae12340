"""Sensors: filters, lags, gravity and faults by their laws."""

import math

import numpy as np
import pytest

from jointgap.rig import sensors
from jointgap.rig.model import build_model
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


def test_a_causal_low_pass_turns_its_corner_by_half_a_period_and_comes_late():
    time = np.arange(40_000) * INTERVAL
    at_corner = sensors.low_pass(np.cos(2 * math.pi * CORNER * time), INTERVAL, CORNER, causal=True)
    inside = slice(15_000, 25_000)
    assert at_corner[inside] == pytest.approx(-math.sqrt(0.5) * np.cos(2 * math.pi * CORNER * time[inside]), abs=1e-3)
    slow = np.cos(2 * math.pi * 1.0 * time)
    delay = 2.6131 / (2 * math.pi * CORNER)  # of Butterworth's polynomial of 4th order at low frequencies
    late = np.cos(2 * math.pi * 1.0 * (time - delay))
    assert sensors.low_pass(slow, INTERVAL, CORNER, causal=True)[inside] == pytest.approx(late[inside], abs=1e-3)
    assert sensors.low_pass(slow + 5.0, INTERVAL, CORNER, causal=True)[:1] == pytest.approx(
        [6.0]
    )  # without a transient


def test_a_causal_sensor_reads_late_and_one_without_delay_does_not():
    plain = read(model_of())["slider_position"]
    time = recorded(campaign(mechanism())).runs["slow"].time
    velocity = np.gradient(plain, time)
    delays = {}
    for kind in ("causal", "zero_phase"):
        own = campaign(mechanism(), sensors={"slider_position": {"bandwidth": "400 Hz", "filter": kind}})
        shift = plain - read(build_model(own, recorded(own)))["slider_position"]
        delays[kind] = float(shift[5:-5] @ velocity[5:-5]) / float(velocity[5:-5] @ velocity[5:-5])
    assert delays["causal"] == pytest.approx(2.6131 / (2 * math.pi * 400.0), rel=0.05)  # of the analogue filter
    assert delays["zero_phase"] == pytest.approx(0.0, abs=2e-6)


def test_a_gain_acts_on_gravity_too_and_a_bias_on_neither():
    own = campaign(mechanism(gravity_direction=0.0), sensors={"slider_acceleration": {"reads_gravity": True}})
    model, true = build_model(own), read(build_model(campaign(mechanism())))["slider_acceleration"]
    by_label = {candidate.label: candidate for candidate in model.candidates}
    faults = [
        (by_label["sensor_bias:slider_acceleration"], {"bias": 0.3}),
        (by_label["sensor_gain:slider_acceleration"], {"gain_error": 0.05}),
    ]
    found = model.simulate("slow", model.nominal("slow"), faults)["slider_acceleration"]
    assert found == pytest.approx(1.05 * (true - 9.80665) + 0.3, rel=1e-12)


def test_a_lag_is_exact_for_straight_lines_and_comes_late():
    time, lag = np.arange(400) * 1e-3, 0.02
    ramp = sensors.lagged(3.0 * time, 1e-3, lag)
    assert ramp == pytest.approx(3.0 * (time - lag * (1.0 - np.exp(-time / lag))), abs=1e-12)
    assert ramp[-1] == pytest.approx(3.0 * (time[-1] - lag), abs=1e-8)


def test_filters_see_ten_samples_of_a_corner_and_half_a_degree_of_the_crank():
    assert np.diff(sensors.filter_times(0.0, 1.0, 0.72, [])) == pytest.approx(np.full(1000, 1e-3), rel=1e-9)
    fine = sensors.filter_times(0.0, 1.0, 0.72, [50.0, 1000.0])
    assert np.diff(fine) == pytest.approx(np.full(10_000, 1e-4), rel=1e-9)
    assert (fine[0], fine[-1]) == (0.0, 1.0)


def test_an_encoder_may_be_late_or_ahead_also_where_the_delay_replaces_a_nuisance():
    """So that what a fit has of the nuisance is within reach of the effect."""
    keys = {"drive": "measured_angle", "sensors": {"crank_angle": {"resolution": 1e-5}}}
    bounds = {}
    for nuisance in ({}, {"encoder_lag": "2 ms"}):
        own = campaign(mechanism(), nuisance=nuisance, **keys)
        (lag,) = (one for one in build_model(own, recorded(own)).candidates if one.label == "encoder_lag")
        bounds[bool(nuisance)] = (lag.coordinates[0].low, lag.coordinates[0].high)
    assert bounds[True] == bounds[False] == (-bounds[False][1], bounds[False][1])
