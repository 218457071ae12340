"""Channels in doubt are in doubt no longer where the faults of sensors that a fit holds account for
them, and only there.
"""

import math
from types import SimpleNamespace

import numpy as np

from jointgap.config.load import load_campaign
from jointgap.rig.model import build_model, remaining_inconsistencies
from jointgap.rig.read_files import read_measurements
from jointgap.rig.sensors import Faults
from tests.rig.recorded_files import write_rig
from tests.rig.rigs import chosen
from tests.rig.test_consistency_checks import OVER, measured

OFFSET = "encoder_offset.offset_rad"


def rig(folder, over=None, **changes):
    """Model and measurements of a rig whose columns are times factors, its encoder's zero off by
    `turned` degrees."""
    tables = {run: measured(rpm, **changes) for run, rpm in (("slow", 200), ("fast", 600))}
    if over:  # turns clockwise
        for run, frame in tables.items():
            turned = {
                column: -frame[column] for column in ("M", "guide_force", "rod_angular_velocity")
            }
            tables[run] = frame.assign(theta=-frame.theta % 360, **turned)
    campaign = load_campaign(write_rig(folder, OVER | (over or {}), **tables))
    measurements = read_measurements(campaign)
    return build_model(campaign, measurements), measurements


def doubts(model, measurements, *fits: dict):
    """What stays in doubt after fits whose values are `fits`."""
    result = []
    for mapping in fits:
        labels = {key.partition(".")[0] for key in mapping}
        result.append(
            SimpleNamespace(
                hypothesis=tuple(chosen(model, item) for item in labels), mapping=mapping
            )
        )
    return remaining_inconsistencies(model, measurements, result)


def test_a_matching_encoder_offset_explains_an_inconsistent_angle(tmp_path):
    own = rig(tmp_path, turned=90.0)
    right, small = ({OFFSET: math.radians(angle)} for angle in (90.0, 20.0))
    force = {"slider_constant_force.force_N": 5.0}
    assert doubts(*own, right) == ()
    for fits in ([small], [force], [right, force]):
        assert doubts(*own, *fits) == ("crank_angle",)


def test_an_offset_or_bias_does_not_explain_a_wrong_sign(tmp_path):
    own = rig(tmp_path, M=-1.0)
    for values in ({OFFSET: 0.02}, {"sensor_bias:crank_torque.bias": 1.0}):
        assert doubts(*own, values) == ("crank_torque",)


def test_a_matching_gain_explains_a_wrong_unit(tmp_path):
    own = rig(tmp_path, slider_acceleration=1 / 9.81)
    for gain, left in ((1 / 9.81 - 1.0, ()), (0.1, ("slider_acceleration",))):
        assert doubts(*own, {"sensor_gain:slider_acceleration.gain_error": gain}) == left


def test_correcting_a_fault_is_the_inverse_of_the_fault(tmp_path):
    model, measurements = rig(tmp_path)
    recording, name = measurements.runs["slow"], "slider_acceleration"
    read, interval = recording.channels[name], float(recording.time[1] - recording.time[0])
    period = math.tau / model.plans["slow"].samples.speed

    def undone(fault, key, value, allowed):
        faults = Faults([(chosen(model, f"{fault}:{name}"), {key: value})], 1.0, {})
        again = faults.corrected(recording).channels[name]
        for place, frame in (
            ("before_filter", ()),
            ("after_filter", ()),
            ("over_time", (interval, period)),
        ):
            again = faults.act(place, name, again, *frame)
        again = np.interp(recording.time - faults.delay(name), recording.time, again)
        assert np.std((again - read)[5:]) < allowed * np.std(read)

    # a derivative of noisy samples is as good as differences of neighbours, and a filter forgets
    # its beginning
    cases = [("bias", "bias", 0.3, 1e-12), ("gain", "gain_error", 0.2, 1e-12)]
    cases += [
        ("lag", "lag_s", 1e-4, 0.1),
        ("delay", "delay_s", 1e-4, 0.1),
        ("high_pass", "corner_Hz", 1.0, 0.05),
    ]
    for fault, *values in cases:
        undone(f"sensor_{fault}", *values)
    result = Faults([(chosen(model, "encoder_offset"), {"offset_rad": 0.4})], 1.0, {}).corrected(
        recording
    )
    assert np.allclose(result.crank_angle, recording.crank_angle - 0.4)
    assert np.array_equal(result.channels[name], read)
