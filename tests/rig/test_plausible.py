"""Channels that cannot be what they are said to be are named, and noise is not taken for such."""

import numpy as np

from jointgap.campaign.stages import measure
from jointgap.campaign.state import CampaignState
from jointgap.rig.checks import clipped, no_data, stuck
from tests.catalogue import each
from tests.config.mechanisms import PAPER
from tests.rig.recorded_files import CAMPAIGN, read_rig, samples, table, write_rig

UNITS = {"slider_velocity": "m/s", "slider_acceleration": "m/s^2", "rod_angle": "rad"}
UNITS |= {"rod_angular_velocity": "rad/s", "crank_speed": "rad/s"}
OVER = {"channels": {name: {"column": name, "unit": unit} for name, unit in UNITS.items()}}
CHANNELS_OF_FILES = [
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


def test_consistent_channels_are_not_remarked_whatever_their_noise(tmp_path):
    def silent(slow, fast, over):
        assert read_rig(tmp_path, over, slow=slow, fast=fast).remarks == ()

    gains = full(
        200, 0.02, slider_velocity=1.1, crank_speed=0.95
    )  # that a sensor may have: left to the analysis
    cases = [full(200, noise, count) for noise in (0.0, 0.1) for count in (40, 300)]
    each(silent, [(slow, full(600), OVER) for slow in (*cases, gains)])
    silent(
        table(200, turns=6.0), table(600, turns=6.0), {}
    )  # exact samples in step with the crank are not clipped


def test_a_channel_with_another_sign_unit_or_meaning_is_named(tmp_path):
    def named(slow, words):
        found = read_rig(tmp_path, OVER, slow=slow, fast=full(600)).remarks
        assert any(all(word in remark for word in words.split(" ~ ")) for remark in found), found

    wrong = {"slider_velocity": (1e3, "mm/s"), "crank_speed": (30 / np.pi, "rpm")}
    cases = [(full(200, 0.03, **{name: -1.0}), f"has the opposite sign ~ {name}") for name in UNITS]
    cases += [
        (
            full(200, 0.01, **{name: factor}),
            f"did you mean '{unit}' instead of channels.{name}.unit",
        )
        for name, (factor, unit) in wrong.items()
    ]
    cases += [(full(200, slider_velocity=3.0), "slider_velocity is 3 times")]
    other = full(200).assign(slider_velocity=lambda f: f.x)
    each(named, [*cases, (other, "slider_velocity does not match")])


def test_a_clipped_channel_is_named_with_how_many_samples_stand_at_the_extreme_and_a_coarse_one_is_not(
    tmp_path,
):
    wave = np.sin(np.linspace(0.0, 40.0, 1000))
    limited = np.minimum(wave, 0.9)
    assert f"{int((wave >= 0.9).sum())} of 1000 samples are at the limit 0.9" in clipped(limited)
    assert "limit -0.9" in clipped(-limited)
    assert clipped(np.append(limited, np.nan)) == clipped(limited)
    position = samples(200, turns=6.0)["slider_position"]
    assert "is clipped" in clipped(np.minimum(position, np.quantile(position, 0.7)))
    given = table(200).assign(M=lambda t: np.maximum(t.M, -0.4))
    assert any(
        "crank_torque is clipped" in remark for remark in read_rig(tmp_path, slow=given).remarks
    )
    wave = np.sin(np.linspace(0.0, 400.0, 10000))
    assert not any(clipped(np.round(wave * levels) / levels) for levels in (10, 50, 1000, 1e9))


def test_a_mark_of_no_data_is_reported_with_how_many_and_where(tmp_path):
    def told(column, name, unit, step):
        given = noisy()
        given.loc[1::step, column] = -9999.0
        words = f"column {column}, row 3: {name} is -9999 {unit} in {600 // step} of 600 samples"
        assert any(words in remark for remark in read_rig(tmp_path, slow=given).remarks)

    each(told, [(*channel, step) for channel in CHANNELS_OF_FILES for step in (2, 30)])


def test_a_sensor_that_is_stuck_is_reported_with_how_long_and_where(tmp_path):
    def told(column, name, unit, first, last, value):
        given = noisy()
        given.loc[first:last, column] = given[column][first] if value is None else value
        found = read_rig(tmp_path, slow=given)
        words = (
            f"column {column}, row {first + 2}: {name} is stuck: {last - first + 1} of 600 samples"
            " in a row are "
        )
        assert any(
            words in remark and f" {unit} while the crank turns" in remark
            for remark in found.remarks
        )
        assert (name, "stuck") in {(one.channel, one.kind) for one in found.contradictions}

    spans = [(300, 599, None), (200, 260, 0.0)]
    each(told, [(*channel, *span) for channel in CHANNELS_OF_FILES for span in spans])


def test_what_stands_still_with_the_crank_or_is_coarse_is_not_stuck_and_lacks_no_data(tmp_path):
    given = noisy()
    given["M"] = np.where(given["M"] > 0.1, given["M"], 0.0)  # a force while there is contact
    assert not any("stuck" in remark for remark in read_rig(tmp_path, slow=given).remarks)
    turned = np.concatenate([np.zeros(300), np.linspace(0.0, 20.0, 300)])
    position = 0.5 + 0.1 * np.cos(turned)
    assert stuck(position, turned) is None
    assert stuck(position, np.linspace(0.0, 40.0, 600)) == slice(0, 301)

    def is_sound(levels, count):
        turned = np.linspace(0.0, 6.3 * 2.0 * np.pi, count)
        for values in (
            np.cos(turned) + 0.27 * np.cos(2.0 * turned),
            np.sin(turned),
            np.abs(np.sin(turned)),
        ):
            coarse = np.round(levels * values) / levels
            assert stuck(coarse, turned) is None and no_data(coarse).size == 0

    each(is_sound, [(levels, count) for levels in (3, 5, 12, 50) for count in (60, 600, 6000)])


def test_measure_remarks_on_data_of_the_mechanism_that_look_mistaken(tmp_path):
    mechanism = {"base": str(PAPER), "slider": {"mass": "190 kg"}, "joints": {"crank_pin": "ideal"}}
    runs = [
        run | {"speed": run["speed"] if run["id"] == "slow" else 62.83} for run in CAMPAIGN["runs"]
    ]
    path = write_rig(tmp_path, {"mechanism": mechanism, "runs": runs})
    said = measure(CampaignState(path, tmp_path / "results"), pictures=False)
    assert (
        "Remark: mechanism, slider.mass: 190 kg" in said
        and "Remark: mechanism, piston_pin: the radial" in said
    )
    later = CampaignState(path, tmp_path / "results").measurements.remarks
    told = [remark.split(":")[0] for remark in later if remark.startswith("mechanism, ")]
    assert told == ["mechanism, slider.mass", "mechanism, piston_pin"]
    (plain,) = (remark for remark in later if "no unit" in remark)
    assert plain.startswith(f"{path}: runs.fast.speed = 62.83 ") and "599.98 rpm" in plain
