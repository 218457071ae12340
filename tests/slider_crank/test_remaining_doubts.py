"""Channels in doubt are in doubt no longer where the faults of sensors that a fit holds account for them, and only
there.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.config.load import load_campaign
from jointgap.rig.model import build_model, remaining_inconsistencies
from jointgap.rig.read_files import read_measurements
from jointgap.rig.sensors import Faults
from tests.recordings.rig import write_rig
from tests.recordings.test_contradictions import OVER, measured


def rig(folder, offset_deg=0.0, over=None, **factors):
    """Model and measurements of a rig whose encoder reads `offset_deg` too much, columns times `factors`."""
    slow, fast = (
        frame.assign(theta=(frame.theta + offset_deg) % 360)
        for frame in (measured(200, **factors), measured(600, **factors))
    )
    campaign = load_campaign(write_rig(folder, over or OVER, slow=slow, fast=fast))
    measurements = read_measurements(campaign)
    return build_model(campaign, measurements), measurements


def fit(model, **values):
    """A fit with the candidates that `values`, keys of amplitudes, are of."""
    mapping = {key.replace("__", ":").replace("_at_", "."): value for key, value in values.items()}
    labels = {key.partition(".")[0] for key in mapping if "." in key}
    hypothesis = tuple(candidate for candidate in model.candidates if candidate.label in labels)
    assert len(hypothesis) == len(labels)
    return SimpleNamespace(hypothesis=hypothesis, mapping=mapping)


def test_an_encoder_offset_accounts_for_the_crank_angle_if_it_is_as_large_as_the_channels_say(tmp_path):
    model, measurements = rig(tmp_path, offset_deg=90.0)
    right, small = (fit(model, encoder_offset_at_offset_rad=math.radians(angle)) for angle in (90.0, 20.0))
    force = fit(model, slider_constant_force_at_force_N=5.0)
    assert remaining_inconsistencies(model, measurements, [right]) == ()
    assert remaining_inconsistencies(model, measurements, [small]) == ("crank_angle",)
    assert remaining_inconsistencies(model, measurements, [force]) == ("crank_angle",)
    assert remaining_inconsistencies(model, measurements, [right, force]) == ("crank_angle",)


def test_a_turned_sign_of_the_torque_is_not_accounted_for_by_an_encoder_offset_or_a_bias(tmp_path):
    model, measurements = rig(tmp_path, M=-1.0)
    for own in ({"encoder_offset_at_offset_rad": 0.02}, {"sensor_bias__crank_torque_at_bias": 1.0}):
        assert remaining_inconsistencies(model, measurements, [fit(model, **own)]) == ("crank_torque",)


def test_a_gain_accounts_for_a_wrong_unit_if_it_is_that_gain(tmp_path):
    model, measurements = rig(tmp_path, slider_acceleration=1 / 9.81)
    right = fit(model, sensor_gain__slider_acceleration_at_gain_error=1 / 9.81 - 1.0)
    wrong = fit(model, sensor_gain__slider_acceleration_at_gain_error=0.1)
    assert remaining_inconsistencies(model, measurements, [right]) == ()
    assert remaining_inconsistencies(model, measurements, [wrong]) == ("slider_acceleration",)


def test_the_fit_of_an_encoder_offset_begins_where_the_other_channels_say_too(tmp_path):
    model, _ = rig(tmp_path, offset_deg=-60.0)
    (offset,) = (candidate for candidate in model.candidates if candidate.label == "encoder_offset")
    assert offset.initial_guesses[0] == {}
    assert math.degrees(offset.initial_guesses[1]["offset_rad"]) == pytest.approx(-60.0, abs=2.0)
    sound, _ = rig(tmp_path)
    (offset,) = (candidate for candidate in sound.candidates if candidate.label == "encoder_offset")
    assert offset.initial_guesses == ({},)


@pytest.mark.parametrize(
    ("label", "name", "value"),
    [
        ("sensor_bias:slider_acceleration", "bias", 0.3),
        ("sensor_gain:slider_acceleration", "gain_error", 0.2),
        ("sensor_lag:slider_acceleration", "lag_s", 1e-4),
        ("sensor_delay:slider_acceleration", "delay_s", 1e-4),
        ("encoder_offset", "offset_rad", 0.4),
    ],
)
def test_taking_a_fault_out_is_the_inverse_of_putting_it_in(tmp_path, label, name, value):
    model, measurements = rig(tmp_path)
    (candidate,) = (one for one in model.candidates if one.label == label)
    recording = measurements.runs["slow"]
    faults = Faults([(candidate, {name: value})], False, {})
    read = recording.channels["slider_acceleration"]
    if candidate.site == "slider_acceleration":
        true = faults.taken_out(recording).channels["slider_acceleration"]
        interval = float(recording.time[1] - recording.time[0])
        again = faults.act("before_filter", candidate.site, true)
        again = faults.act("after_filter", candidate.site, again)
        again = faults.act("over_time", candidate.site, again, interval)
        again = np.interp(recording.time - faults.delay(candidate.site), recording.time, again)
        # a derivative of noisy samples is as good as differences of neighbours, and a filter forgets its beginning
        allowed = 0.1 if candidate.name in ("sensor_lag", "sensor_delay") else 1e-12
        assert np.std((again - read)[5:]) < allowed * np.std(read)
    else:
        assert np.allclose(faults.taken_out(recording).crank_angle, recording.crank_angle - value)
        assert np.array_equal(faults.taken_out(recording).channels["slider_acceleration"], read)


def test_of_a_clockwise_crank_the_offset_is_that_of_the_angle_as_it_is_read(tmp_path):
    tables = {}
    for run, rpm in (("slow", 200), ("fast", 600)):
        frame = measured(rpm)
        turned = {column: -frame[column] for column in ("M", "guide_force", "rod_angular_velocity")}
        tables[run] = frame.assign(theta=(90.0 - frame.theta) % 360, **turned)
    runs = [
        {"id": run, "file": f"{run}.csv", "speed": f"{rpm} rpm", "role": role, "direction": "clockwise"}
        for run, rpm, role in (("slow", 200, "identify"), ("fast", 600, "confirm"))
    ]
    campaign = load_campaign(write_rig(tmp_path, OVER | {"runs": runs}, **tables))
    measurements = read_measurements(campaign)
    model = build_model(campaign, measurements)
    (offset,) = (candidate for candidate in model.candidates if candidate.label == "encoder_offset")
    told = offset.initial_guesses[1]["offset_rad"]
    assert math.degrees(told) == pytest.approx(90.0, abs=2.0)
    assert remaining_inconsistencies(model, measurements, [fit(model, encoder_offset_at_offset_rad=told)]) == ()
    assert remaining_inconsistencies(model, measurements, [fit(model, encoder_offset_at_offset_rad=-told)]) == (
        "crank_angle",
    )
