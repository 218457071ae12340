"""Channels whose samples cannot be right are reported; noise is not."""

import numpy as np
import pytest

from jointgap.campaign.stages import measure
from jointgap.campaign.state import CampaignState
from jointgap.rig.checks import clipped, no_data, stuck
from tests.config.mechanisms import PAPER
from tests.rig.recorded_files import CAMPAIGN, read_rig, samples, table, write_rig

UNITS = {"slider_velocity": "m/s", "slider_acceleration": "m/s^2", "rod_angle": "rad"}
UNITS |= {"rod_angular_velocity": "rad/s", "crank_speed": "rad/s"}
OVER = {"channels": {name: {"column": name, "unit": unit} for name, unit in UNITS.items()}}
COLUMNS = [
    ("M", "crank_torque", "N*m"),
    ("x", "slider_position", "mm"),
    ("theta", "crank_angle", "deg"),
]


def full(rpm, noise=0.0, count=60, **factors):
    """All channels with noise of a share of their standard deviation, some multiplied by a
    factor."""
    rng = np.random.default_rng(1)
    frame, si = table(rpm, count=count, turns=3.3), samples(rpm, count=count, turns=3.3)
    for name in UNITS:
        frame[name] = si[name] * factors.get(name, 1.0)
    for column in frame.columns[2:]:
        frame[column] += noise * frame[column].std() * rng.standard_normal(count)
    return frame


def noisy():
    """Six turns of the slow run with noise in its torque and position."""
    rng, frame = np.random.default_rng(0), table(200, count=600, turns=6.0)
    frame["M"] += 0.02 * rng.standard_normal(600)
    frame["x"] += 0.05 * rng.standard_normal(600)
    return frame


@pytest.mark.parametrize(
    "slow",
    [
        full(200, 0.0, 40),
        full(200, 0.1, 300),
        full(200, 0.02, slider_velocity=1.1, crank_speed=0.95),  # gains are found by the analysis
    ],
)
def test_consistent_channels_have_no_remark(tmp_path, slow):
    assert read_rig(tmp_path, OVER, slow=slow, fast=full(600)).remarks == ()


@pytest.mark.parametrize(
    "slow, words",
    [
        *(
            (full(200, 0.03, **{name: -1.0}), [f"{name} has the opposite sign"])
            for name in ("slider_velocity", "rod_angle", "crank_speed")
        ),
        (full(200, slider_velocity=1e3), ["'mm/s' instead of channels.slider_velocity.unit"]),
        (full(200, crank_speed=30 / np.pi), ["'rpm' instead of channels.crank_speed.unit"]),
        (full(200, slider_velocity=3.0), ["slider_velocity is 3 times"]),
        (
            full(200).assign(slider_velocity=table(200, count=60, turns=3.3).x),
            ["slider_velocity does not match"],
        ),
    ],
)
def test_a_channel_with_another_sign_unit_or_meaning_is_reported(tmp_path, slow, words):
    remarks = "\n".join(read_rig(tmp_path, OVER, slow=slow, fast=full(600)).remarks)
    assert all(word in remarks for word in words)


def test_a_clipped_channel_is_reported_and_a_coarse_one_is_not(tmp_path):
    wave = np.sin(np.linspace(0.0, 40.0, 1000))
    limited = np.minimum(wave, 0.9)
    assert f"{int((wave >= 0.9).sum())} of 1000 samples are at the limit 0.9" in clipped(limited)
    assert "limit -0.9" in clipped(-limited)
    assert clipped(np.append(limited, np.nan)) == clipped(limited)
    clipped_torque = table(200).assign(M=lambda frame: np.maximum(frame.M, -0.4))
    remarks = read_rig(tmp_path, slow=clipped_torque).remarks
    assert any("crank_torque is clipped" in remark for remark in remarks)
    wave = np.sin(np.linspace(0.0, 400.0, 10000))
    assert not any(clipped(np.round(wave * levels) / levels) for levels in (10, 50, 1000, 1e9))


@pytest.mark.parametrize("column, name, unit", COLUMNS)
def test_a_value_for_no_data_is_reported_with_its_count_and_row(tmp_path, column, name, unit):
    frame = noisy()
    frame.loc[1::30, column] = -9999.0
    text = f"column {column}, row 3: {name} is -9999 {unit} in 20 of 600 samples"
    assert any(text in remark for remark in read_rig(tmp_path, slow=frame).remarks)


@pytest.mark.parametrize("column, name, unit", COLUMNS)
@pytest.mark.parametrize("first, last, value", [(300, 599, None), (200, 260, 0.0)])
def test_a_stuck_sensor_is_reported_with_its_duration_and_row(
    tmp_path, column, name, unit, first, last, value
):
    frame = noisy()
    frame.loc[first:last, column] = frame[column][first] if value is None else value
    measurements = read_rig(tmp_path, slow=frame)
    text = f"row {first + 2}: {name} is stuck: {last - first + 1} of 600 samples in a row are "
    (remark,) = (remark for remark in measurements.remarks if text in remark)
    assert f" {unit} while the crank turns" in remark
    assert (name, "stuck") in {(item.channel, item.kind) for item in measurements.contradictions}


def test_a_channel_that_is_constant_while_the_crank_stands_still_or_every_turn_is_not_stuck(
    tmp_path,
):
    frame = noisy()
    frame["M"] = np.where(frame["M"] > 0.1, frame["M"], 0.0)  # a force while there is contact
    assert not any("stuck" in remark for remark in read_rig(tmp_path, slow=frame).remarks)
    turned = np.concatenate([np.zeros(300), np.linspace(0.0, 20.0, 300)])
    position = 0.5 + 0.1 * np.cos(turned)
    assert stuck(position, turned) is None
    assert stuck(position, np.linspace(0.0, 40.0, 600)) == slice(0, 301)


@pytest.mark.parametrize("levels", [3, 12, 50])
@pytest.mark.parametrize("count", [60, 6000])
def test_a_coarse_channel_is_neither_stuck_nor_without_data(levels, count):
    turned = np.linspace(0.0, 6.3 * 2.0 * np.pi, count)
    for values in (np.cos(turned) + 0.27 * np.cos(2.0 * turned), np.abs(np.sin(turned))):
        coarse = np.round(levels * values) / levels
        assert stuck(coarse, turned) is None and no_data(coarse).size == 0


def test_measure_remarks_on_implausible_data_of_the_mechanism(tmp_path):
    mechanism = {"base": str(PAPER), "slider": {"mass": "190 kg"}, "joints": {"crank_pin": "ideal"}}
    slow, fast = CAMPAIGN["runs"]
    path = write_rig(tmp_path, {"mechanism": mechanism, "runs": [slow, fast | {"speed": 62.83}]})
    output = measure(CampaignState(path, tmp_path / "results"), pictures=False)
    assert "Remark: mechanism, slider.mass: 190 kg" in output
    assert "Remark: mechanism, piston_pin: the radial" in output
    (remark,) = (
        remark
        for remark in CampaignState(path, tmp_path / "results").measurements.remarks
        if "no unit" in remark
    )
    assert remark.startswith(f"{path}: runs.fast.speed = 62.83 ") and "599.98 rpm" in remark
