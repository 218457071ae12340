"""Channels that cannot be what they are said to be are named, and noise is not taken for such."""

import numpy as np
import pytest

from jointgap.campaign.stages import measure
from jointgap.campaign.state import CampaignState
from jointgap.rig.checks import clipped, no_data, stuck
from tests.config.mechanisms import PAPER
from tests.recordings.rig import read_rig, samples, table, write_rig

UNITS = {
    "slider_velocity": "m/s",
    "slider_acceleration": "m/s^2",
    "rod_angle": "rad",
    "rod_angular_velocity": "rad/s",
    "crank_speed": "rad/s",
}
OVER = {"channels": {name: {"column": name, "unit": unit} for name, unit in UNITS.items()}}


def full(rpm, noise=0.0, count=60, **factors):
    """All channels with noise of a share of their standard deviation, some multiplied by a factor."""
    rng = np.random.default_rng(1)
    frame, si = table(rpm, count=count, turns=3.3), samples(rpm, count=count, turns=3.3)
    for name in UNITS:
        frame[name] = si[name] * factors.get(name, 1.0)
    for column in frame.columns[2:]:
        frame[column] += noise * frame[column].std() * rng.standard_normal(count)
    return frame


CHANNELS_OF_FILES = [("M", "crank_torque", "N*m"), ("x", "slider_position", "mm"), ("theta", "crank_angle", "deg")]


def noisy():
    """Six turns of the slow run with noise in its torque and position."""
    rng, frame = np.random.default_rng(0), table(200, count=600, turns=6.0)
    frame["M"] += 0.02 * rng.standard_normal(600)
    frame["x"] += 0.05 * rng.standard_normal(600)
    return frame


def remarks(folder, slow):
    return read_rig(folder, OVER, slow=slow, fast=full(600)).remarks


def test_exact_samples_in_step_with_the_crank_are_not_clipped(tmp_path):
    assert read_rig(tmp_path, slow=table(200, turns=6.0), fast=table(600, turns=6.0)).remarks == ()
    position = samples(200, turns=6.0)["slider_position"]
    assert "is clipped" in clipped(np.minimum(position, np.quantile(position, 0.7)))


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.1])
@pytest.mark.parametrize("count", [40, 300])
def test_consistent_channels_are_not_remarked_whatever_their_noise(tmp_path, noise, count):
    assert remarks(tmp_path, full(200, noise, count)) == ()


def test_gains_that_a_sensor_may_have_are_left_to_the_analysis(tmp_path):
    assert remarks(tmp_path, full(200, 0.02, slider_velocity=1.1, crank_speed=0.95)) == ()


@pytest.mark.parametrize("name", sorted(UNITS))
def test_a_channel_with_the_opposite_sign_is_named(tmp_path, name):
    found = remarks(tmp_path, full(200, 0.03, **{name: -1.0}))
    assert any("has the opposite sign" in remark and name in remark for remark in found)


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [
        ("slider_velocity", 1e3, "mm/s"),
        ("slider_acceleration", 1 / 9.80665, "g_n"),
        ("crank_speed", 60 / (2 * np.pi), "rpm"),
        ("rod_angular_velocity", 180 / np.pi, "deg/s"),
    ],
)
def test_a_wrong_unit_is_named_with_the_one_that_fits(tmp_path, name, factor, unit):
    found = remarks(tmp_path, full(200, 0.01, **{name: factor}))
    assert any(f"did you mean '{unit}' by channels.{name}.unit" in remark for remark in found)


def test_an_unexplained_factor_is_told(tmp_path):
    assert any("slider_velocity is 3 times" in remark for remark in remarks(tmp_path, full(200, slider_velocity=3.0)))


def test_a_channel_that_is_something_else_is_named(tmp_path):
    frame = full(200).assign(slider_velocity=lambda f: f.x)
    assert any(
        "slider_velocity is not what the mechanism makes of the crank" in remark for remark in remarks(tmp_path, frame)
    )


def test_a_clipped_channel_is_named_with_how_many_samples_stand_at_the_extreme(tmp_path):
    wave = np.sin(np.linspace(0.0, 40.0, 1000))
    limited = np.minimum(wave, 0.9)
    count = int((wave >= 0.9).sum())
    assert f"{count} of 1000 samples are 0.9" in clipped(limited)
    assert "are -0.9" in clipped(-limited)
    assert clipped(np.append(limited, np.nan)) == clipped(limited)
    given = table(200).assign(M=lambda t: np.maximum(t.M, -0.4))
    assert any("crank_torque is clipped" in remark for remark in read_rig(tmp_path, slow=given).remarks)


@pytest.mark.parametrize("levels", [10, 50, 1000])
def test_a_coarse_reading_is_not_taken_for_a_clipped_one(levels):
    wave = np.sin(np.linspace(0.0, 400.0, 10000))
    assert clipped(np.round(wave * levels) / levels) is None
    assert clipped(wave) is None


def test_a_value_that_stands_for_no_data_is_named_with_its_row(tmp_path):
    given = table(200)
    given.loc[[50, 60], "M"] = -9999.0
    found = read_rig(tmp_path, slow=given).remarks
    words = "column M, row 52: crank_torque is far from all else in 2 of 240 samples, which are -9999 N*m"
    assert any(words in remark for remark in found)
    given.loc[60, "M"] = -8888.0
    found = read_rig(tmp_path, slow=given).remarks
    assert any("column M, row 52: -9999 N*m is far from all else (so are 2 samples)" in remark for remark in found)


@pytest.mark.parametrize(("column", "name", "unit"), CHANNELS_OF_FILES)
@pytest.mark.parametrize("step", [2, 4, 30])
def test_a_mark_of_no_data_in_many_samples_is_told_with_how_many_and_where(tmp_path, column, name, unit, step):
    given = noisy()
    given.loc[1::step, column] = -9999.0
    words = (
        f"column {column}, row 3: {name} is far from all else in {600 // step} of 600 samples, which are -9999 {unit};"
    )
    assert any(words in remark for remark in read_rig(tmp_path, slow=given).remarks)


@pytest.mark.parametrize(("column", "name", "unit"), CHANNELS_OF_FILES)
@pytest.mark.parametrize(("first", "last", "value"), [(300, 599, None), (200, 280, None), (200, 260, 0.0)])
def test_a_sensor_that_is_stuck_is_told_with_how_long_and_where(tmp_path, column, name, unit, first, last, value):
    given = noisy()
    given.loc[first:last, column] = given[column][first] if value is None else value
    found = read_rig(tmp_path, slow=given)
    words = f"column {column}, row {first + 2}: {name} is stuck: {last - first + 1} of 600 samples in a row are "
    assert any(words in remark and f" {unit} while the crank turns" in remark for remark in found.remarks)
    assert (name, "stuck") in {(one.channel, one.kind) for one in found.contradictions}


def test_a_channel_that_stands_still_once_a_revolution_or_with_the_crank_is_not_stuck(tmp_path):
    given = noisy()
    given["M"] = np.where(given["M"] > 0.1, given["M"], 0.0)  # a force while there is contact
    assert not any("stuck" in remark for remark in read_rig(tmp_path, slow=given).remarks)
    turned = np.concatenate([np.zeros(300), np.linspace(0.0, 20.0, 300)])
    position = 0.5 + 0.1 * np.cos(turned)
    assert stuck(position, turned) is None
    assert stuck(position, np.linspace(0.0, 40.0, 600)) == slice(0, 301)


@pytest.mark.parametrize("levels", [3, 5, 12, 50])
@pytest.mark.parametrize("count", [60, 600, 6000])
def test_coarse_readings_are_not_stuck_and_lack_no_data(levels, count):
    turned = np.linspace(0.0, 6.3 * 2.0 * np.pi, count)
    for values in (np.cos(turned) + 0.27 * np.cos(2.0 * turned), np.sin(turned), np.abs(np.sin(turned))):
        coarse = np.round(levels * values) / levels
        assert stuck(coarse, turned) is None
        assert no_data(coarse).size == 0


def test_an_angle_that_the_encoder_misread_is_named_with_its_row(tmp_path):
    given = table(200)
    given["theta"] += 0.3 * np.random.default_rng(0).standard_normal(len(given))  # deg
    assert read_rig(tmp_path, slow=given).remarks == ()
    given.loc[50, "theta"] += 90.0
    assert any(
        "column theta, row" in remark and "encoder misread" in remark
        for remark in read_rig(tmp_path, slow=given).remarks
    )


def test_measure_remarks_on_data_of_the_mechanism_that_look_mistaken(tmp_path):
    mechanism = {"base": str(PAPER), "slider": {"mass": "190 kg"}, "joints": {"crank_pin": "ideal"}}
    path = write_rig(tmp_path, {"mechanism": mechanism})
    state = CampaignState(path, tmp_path / "results")
    said = measure(state, pictures=False)
    assert "Remark: mechanism, slider.mass: 190 kg" in said and "Remark: mechanism, piston_pin: the radial" in said
    later = CampaignState(path, tmp_path / "results").measurements.remarks
    told = [remark.split(":")[0] for remark in later if remark.startswith("mechanism, ")]
    assert told == ["mechanism, slider.mass", "mechanism, piston_pin"]
