"""A run that cannot be simulated is left out with its reason; the others make the model."""

import numpy as np
import pytest

from jointgap.core.errors import InputError
from jointgap.identification.noise import noise_of_model
from jointgap.rig.model import build_model
from tests.rig.rigs import campaign, mechanism, recorded


def measured(run):
    """Two runs along their measured angle; the crank of `run` stands still from sample 150 to
    200."""
    rig_campaign = campaign(
        mechanism(), ("time", "crank_angle", "slider_position"), drive="measured_angle"
    )
    measurements = recorded(rig_campaign, dropped=0, kept=4)
    angle = measurements.runs[run].crank_angle
    angle[:] = np.minimum(angle, angle[150]) + np.maximum(angle - angle[200], 0.0)
    return rig_campaign, measurements


def test_a_held_out_run_with_a_standstill_is_left_out_with_the_time():
    own, measurements = measured("fast")
    model = build_model(own, measurements)
    assert list(model.plans) == ["slow"] == [run.id for run in model.campaign.runs]
    assert {series.run for series in model.series} == {"slow"}
    begin, end = measurements.runs["fast"].time[[150, 200]]
    reason = model.left_out["fast"]
    assert "stands still or falls at" in reason and "cut the record there" in reason
    assert begin - 0.02 < float(reason.partition(" at ")[2].partition(" s;")[0]) < end + 0.02
    assert noise_of_model(model)


def test_without_any_run_for_fitting_there_is_one_error_with_its_reason():
    with pytest.raises(
        InputError, match=r"(?s)no run for fitting is usable.*stands still or falls at"
    ):
        build_model(*measured("slow"))


def test_a_split_run_without_values_for_fitting_is_left_out():
    channels = ("time", "crank_angle", "slider_position", "crank_torque")
    rig_campaign = campaign(mechanism(), channels, drive="measured_angle", run={"role": "split"})
    measurements = recorded(rig_campaign)
    for run in measurements.runs.values():
        run.held_out[:] = np.arange(run.time.size) > 0.67 * run.time.size
    for values in measurements.runs["slow"].channels.values():
        values[: values.size // 2] = np.nan
    assert set(build_model(rig_campaign, measurements).plans) == {"slow", "fast"}
    for values in measurements.runs["slow"].channels.values():
        values[: int(0.7 * values.size)] = np.nan
    model = build_model(rig_campaign, measurements)
    assert set(model.plans) == {"fast"} and noise_of_model(model)
    for part in ("slow.csv", "have no value of slider_position and crank_torque", "give a record"):
        assert part in model.left_out["slow"]
