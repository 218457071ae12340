"""Runs become samples in SI, with gaps, turns, held-out parts and what is odd about them; what cannot be used is
refused.
"""

import math

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.rig.read_files import read_measurements
from jointgap.rig.recording import from_frame, to_frame
from tests.recordings.rig import CAMPAIGN, SPEEDS, read_rig, samples, table, write_rig

SLOW, FAST = SPEEDS["slow"], SPEEDS["fast"]


def rig(folder, over=None, without=(), **tables):
    """Measurements of a campaign that lacks the channels `without`."""
    path = write_rig(folder, over, **tables)
    campaign = load_campaign(path)
    kept = {name: channel for name, channel in campaign.channels.items() if name not in without}
    return read_measurements(campaign.model_copy(update={"channels": kept}))


def run_with(**keys):
    return {"runs": [CAMPAIGN["runs"][0] | keys, CAMPAIGN["runs"][1]]}


def test_a_good_campaign_is_read_exactly_and_without_remarks(tmp_path):
    measurements = read_rig(tmp_path)
    assert measurements.remarks == ()
    assert list(measurements.runs) == ["slow", "fast"]
    for run, rpm in SPEEDS.items():
        recording, true = measurements.runs[run], samples(rpm)
        np.testing.assert_allclose(recording.time, true["time"], rtol=1e-14)
        np.testing.assert_allclose(recording.crank_angle, true["crank_angle"], rtol=1e-13)
        np.testing.assert_allclose(recording.channels["slider_position"], true["slider_position"], rtol=1e-14)
        np.testing.assert_allclose(recording.channels["crank_torque"], true["crank_torque"], rtol=1e-14)
        assert recording.noise == {"crank_angle": None, "slider_position": None, "crank_torque": 0.02}


def test_a_changed_byte_in_a_parquet_file_with_checksums_is_refused(tmp_path):
    path = write_rig(tmp_path, run_with(file="slow.parquet"))
    table(SLOW).to_parquet(
        tmp_path / "slow.parquet", write_page_checksum=True, compression="none", use_dictionary=False
    )
    content = bytearray((tmp_path / "slow.parquet").read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "slow.parquet").write_bytes(content)
    with pytest.raises(InputError, match=r"slow\.parquet: cannot be read as Parquet .*write the file again"):
        read_measurements(load_campaign(path))


def test_csv_and_parquet_are_the_same_data(tmp_path):
    from_csv = read_rig(tmp_path).runs["slow"]
    table(SLOW).to_parquet(tmp_path / "slow.parquet")
    from_parquet = read_rig(tmp_path, run_with(file="slow.parquet")).runs["slow"]
    np.testing.assert_array_equal(from_csv.channels["crank_torque"], from_parquet.channels["crank_torque"])


def test_stated_noise_and_steps_become_si(tmp_path):
    over = {"channels": {"crank_angle": {"resolution": 0.1}, "slider_position": {"noise": {"slow": 2}}}}
    noise = read_rig(tmp_path, over).runs["slow"].noise
    assert noise["crank_angle"] is None  # rounding is a noise beside the encoder's own
    assert noise["slider_position"] == pytest.approx(2e-3, rel=1e-12)
    assert read_rig(tmp_path, over).runs["fast"].noise["slider_position"] is None


@pytest.mark.parametrize(
    "wrapped", [lambda a: a, lambda a: (a + 180) % 360 - 180, lambda a: a % 1440, lambda a: a - 5000]
)
def test_an_angle_runs_on_however_it_wraps(tmp_path, wrapped):
    true = samples(SLOW, turns=7.0)["crank_angle"]
    given = table(SLOW, turns=7.0).assign(theta=wrapped(np.degrees(true)))
    for without in ((), ("time",)):
        found = rig(tmp_path, without=without, slow=given).runs["slow"].crank_angle
        assert np.ptp(found - true) < 1e-9
        assert abs(math.remainder(found[0] - true[0], math.tau)) < 1e-9 or given.theta[0] < -1000


def test_an_angle_that_wraps_with_noise_at_its_bound_runs_on(tmp_path):
    noise = 2.0 * np.random.default_rng(0).standard_normal(240)  # deg
    given = table(SLOW).assign(theta=lambda t: (t.theta + noise) % 360)
    for without in ((), ("time",)):
        found = rig(tmp_path, without=without, slow=given).runs["slow"].crank_angle
        away = np.degrees(found - samples(SLOW)["crank_angle"]) - noise
        assert np.ptp(away) < 1e-9


def test_an_angle_runs_on_across_gaps_of_several_turns(tmp_path):
    given = table(SLOW, turns=20.0, count=800)
    given.loc[100:500, "theta"] = np.nan
    given["t"] *= 1.05  # the speed is 5 % off nominal
    recording = read_rig(tmp_path, slow=given).runs["slow"]
    assert np.isnan(recording.crank_angle[100:501]).all()
    known = np.isfinite(recording.crank_angle)
    true = samples(SLOW, turns=20.0, count=800)["crank_angle"]
    np.testing.assert_allclose(recording.crank_angle[known], true[known], rtol=1e-12)


def test_a_clockwise_angle_is_mirrored_and_other_channels_are_left(tmp_path):
    given = table(SLOW).assign(theta=lambda t: 360 - t.theta)
    recording = read_rig(tmp_path, run_with(direction="clockwise"), slow=given).runs["slow"]
    assert np.ptp(recording.crank_angle - samples(SLOW)["crank_angle"]) < 1e-9
    np.testing.assert_allclose(recording.channels["crank_torque"], samples(SLOW)["crank_torque"], rtol=1e-14)


@pytest.mark.parametrize("without", [(), ("time",)])
def test_a_falling_angle_is_refused_unless_the_run_is_clockwise(tmp_path, without):
    with pytest.raises(InputError, match=r"slow\.csv, column theta: the angle falls .* 'direction: clockwise'"):
        rig(tmp_path, without=without, slow=table(SLOW).assign(theta=lambda t: -t.theta))


@pytest.mark.parametrize("without", [(), ("time",)])
def test_a_rising_angle_of_a_clockwise_run_is_refused_with_the_angles_of_the_file(tmp_path, without):
    with pytest.raises(
        InputError, match=r"the angle rises from .* but run 'slow' has 'direction: clockwise'; remove it"
    ) as caught:
        rig(tmp_path, run_with(direction="clockwise"), without=without)
    first, last = table(SLOW).theta.iloc[[0, -1]]
    words = str(caught.value)
    assert f"from {first:.6g} to" in words
    assert float(words.split(" to ")[1].split(" deg")[0]) > last  # running on over the turns


def test_signals_counts_and_sample_numbers_become_si(tmp_path):
    """Current of the motor, counts of an encoder whose counter has 16 bits, sample numbers instead of times."""
    true = samples(SLOW)
    step = true["time"][1]
    counts = np.round(4000 * true["crank_angle"] / math.tau) + 30000
    given = pd.DataFrame(
        {
            "n": np.arange(240) + 17,
            "counts": (counts + 2**15) % 2**16 - 2**15,
            "x": 1e3 * true["slider_position"],
            "I": true["crank_torque"] / 0.35,
        }
    )
    path = write_rig(tmp_path, {"runs": [CAMPAIGN["runs"][0] | {"file": "raw.csv"}, CAMPAIGN["runs"][1]]})
    given.to_csv(tmp_path / "raw.csv", index=False)
    fast = samples(FAST)
    pd.DataFrame({"n": fast["time"] / step, "counts": 4000 * fast["crank_angle"] / math.tau}).assign(
        x=1e3 * fast["slider_position"], I=fast["crank_torque"] / 0.35
    ).to_csv(tmp_path / "fast.csv", index=False)
    data = CAMPAIGN | {"runs": [CAMPAIGN["runs"][0] | {"file": "raw.csv"}, CAMPAIGN["runs"][1]]}
    data |= {
        "channels": {
            "time": {"column": "n", "rate": f"{1 / step} Hz"},
            "crank_angle": {"column": "counts", "counts_per_turn": 4000},
            "slider_position": {"column": "x", "unit": "V", "scale": "1 mm/V"},
            "crank_torque": {"column": "I", "unit": "A", "scale": "0.35 N*m/A", "noise": 0.1},
        }
    }
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    measurements = read_measurements(load_campaign(path), compared=False)
    recording = measurements.runs["slow"]
    np.testing.assert_allclose(np.diff(recording.time), step, rtol=1e-9)
    assert np.ptp(recording.crank_angle - true["crank_angle"]) < 1.01 * math.tau / 4000
    np.testing.assert_allclose(recording.channels["slider_position"], true["slider_position"], rtol=1e-12)
    np.testing.assert_allclose(recording.channels["crank_torque"], true["crank_torque"], rtol=1e-12, atol=1e-15)
    assert recording.noise["crank_torque"] == pytest.approx(0.035, rel=1e-12)
    assert [remark for remark in measurements.remarks if "16 bits" in remark] == list(measurements.remarks)
    assert len(measurements.remarks) == 1


def test_times_may_be_dates(tmp_path):
    stamps = pd.Timestamp("2026-03-01T23:59:59") + pd.to_timedelta(table(SLOW).t, unit="s")
    given = table(SLOW).assign(t=stamps.map(lambda stamp: stamp.isoformat()))
    for unit in ("s", "ms"):  # dates have no unit
        measurements = rig(tmp_path, {"channels": {"time": {"unit": unit}}}, slow=given, fast=_in(unit))
        np.testing.assert_allclose(measurements.runs["slow"].time, samples(SLOW)["time"], atol=2e-6)


def _in(unit):
    return table(FAST).assign(t=lambda t: t.t * {"s": 1.0, "ms": 1e3}[unit])


def test_a_row_that_is_written_twice_is_one_sample(tmp_path):
    given = table(SLOW)
    given.loc[9, "M"] = np.nan
    given = given.iloc[[*range(10), 9, 9, *range(10, 240), 239]]
    measurements = read_rig(tmp_path, slow=given)
    np.testing.assert_allclose(measurements.runs["slow"].time, samples(SLOW)["time"], rtol=1e-14)
    assert measurements.remarks == (
        f"{tmp_path}/slow.csv, column t, row 12: they repeat the row before them; so are 3 samples, left out",
    )


def test_of_rows_at_one_time_the_campaign_says_which_is_kept(tmp_path):
    """A solver writes the state before and after an event at the same time."""
    before = table(SLOW)
    after = before.iloc[[50]].assign(M=7.0)
    given = pd.concat([before.iloc[:51], after, before.iloc[51:]])
    with pytest.raises(InputError, match=r"row 53: time repeats .*1 rows do.*'repeated: last'"):
        read_rig(tmp_path, slow=given)
    for which, value in (("first", before.M[50]), ("last", 7.0)):
        measurements = read_rig(tmp_path, {"channels": {"time": {"repeated": which}}}, slow=given)
        assert measurements.runs["slow"].channels["crank_torque"][50] == value
        assert measurements.runs["slow"].time.size == 240
        assert f"the {which} is kept" in measurements.remarks[0]


def test_gaps_are_no_data(tmp_path):
    given = table(SLOW)
    given.loc[5:9, "M"] = np.nan
    given.loc[20:22, "t"] = np.nan
    measurements = read_rig(tmp_path, slow=given)
    recording = measurements.runs["slow"]
    assert recording.time.size == 237
    assert np.isnan(recording.channels["crank_torque"]).sum() == 5
    np.testing.assert_allclose(recording.crank_angle, np.delete(samples(SLOW)["crank_angle"], [20, 21, 22]), rtol=1e-12)
    assert measurements.remarks == (f"{tmp_path}/slow.csv, column t: 3 samples have no time, left out",)


def test_samples_without_an_angle_are_left_out_where_no_times_are_measured(tmp_path):
    given = table(SLOW)
    given.loc[20, "theta"] = np.nan
    measurements = rig(tmp_path, without=("time",), slow=given)
    assert measurements.runs["slow"].crank_angle.size == 239
    assert not measurements.runs["slow"].has_time
    assert "1 sample has no crank angle" in measurements.remarks[0]


@pytest.mark.parametrize("without", [(), ("time",), ("crank_angle",)])
def test_a_split_run_holds_its_last_third_out(tmp_path, without):
    runs = rig(tmp_path, run_with(role="split"), without=without).runs
    held_out = runs["slow"].held_out
    assert runs["fast"].held_out.all()
    assert held_out.sum() == 80  # of 240
    assert held_out[-80:].all()


def test_non_uniform_times_split_by_time_not_by_count(tmp_path):
    given = table(SLOW).drop(index=range(1, 100, 2))
    assert read_rig(tmp_path, run_with(role="split"), slow=given).runs["slow"].held_out.sum() == 80


def test_measurements_survive_the_tidy_table(tmp_path):
    given = table(SLOW)
    given.loc[5:9, "M"] = np.nan
    measurements = read_rig(tmp_path, slow=given)
    frame = to_frame(measurements)
    assert list(frame.columns) == ["run", "channel", "sample", "time", "crank_angle", "value", "held_out"]
    assert set(frame["channel"]) == {"crank_angle", "slider_position", "crank_torque"}
    back = from_frame(frame, load_campaign(tmp_path / "rig.yaml"))
    for run, recording in measurements.runs.items():
        for name in ("time", "crank_angle", "held_out"):
            np.testing.assert_array_equal(getattr(back.runs[run], name), getattr(recording, name))
        assert back.runs[run].channels.keys() == recording.channels.keys()
        for name, values in recording.channels.items():
            np.testing.assert_array_equal(back.runs[run].channels[name], values)
        assert back.runs[run].noise == recording.noise


def changed(column, row, value):
    frame = table(SLOW).astype(object)
    frame.loc[row, column] = value
    return frame


@pytest.mark.parametrize(
    ("given", "over", "words"),
    [
        (changed("M", 7, "n.a."), {}, ["column M, row 9", "'n.a.' is not a number", "leave the cell empty"]),
        (changed("M", 7, "inf"), {}, ["column M, row 9", "infinite"]),
        (changed("M", 7, 1e300), {}, ["column M, row 9", "1e+300 N*m is more than any sensor reads"]),
        (changed("t", 7, 0.0), {}, ["column t, row 9", "time falls from", "sort the rows"]),
        (changed("t", 7, table(SLOW).t[6]), {}, ["column t, row 9", "time repeats", "more digits"]),
        (table(SLOW).assign(M=3.0), {}, ["column M: is constant"]),
        (table(SLOW).assign(M=np.nan), {}, ["column M: has 0 values", "take the channel out"]),
        (table(SLOW).assign(theta=np.nan), {}, ["column theta: holds no angles"]),
        (table(SLOW).head(11), {}, ["11 samples are too few; give 12"]),
        (table(SLOW).head(70), {}, ["70 samples are 0.875 revolutions; at least one revolution", "measure again"]),
        (table(SLOW).iloc[::30], {}, ["8 samples are too few"]),
        (
            table(SLOW, turns=30).iloc[::4],
            {},
            ["60 samples are 30 revolutions", "4 samples in each", "check channels.time.unit"],
        ),
        (table(SLOW).drop(columns="M"), {}, ["no column 'M'", "known here: t, theta, x"]),
        (
            table(SLOW),
            {"channels": {"time": {"unit": "ms"}}},
            ["0.003 revolutions at the nominal 200 rpm", "did you mean 's'?"],
        ),
        (
            table(SLOW),
            {"channels": {"time": {"unit": "min"}}},
            ["240 samples are 180 revolutions", "did you mean 's'?"],
        ),
        (table(SLOW), {"channels": {"crank_angle": {"unit": "rad"}}}, ["column theta", "did you mean 'deg'?"]),
        (table(SLOW).assign(theta=lambda t: np.radians(t.theta)), {}, ["column theta", "did you mean 'rad'?"]),
        (table(SLOW, turns=1.4), run_with(role="split"), ["1.394 revolutions leave less than one for fitting"]),
        (table(SLOW), run_with(speed="90 rpm"), ["mean speed of 200 rpm, but the run's is 90 rpm", "the run's speed"]),
    ],
)
def test_samples_that_cannot_be_used_are_refused_with_the_place_and_the_mend(tmp_path, given, over, words):
    with pytest.raises(InputError) as caught:
        read_rig(tmp_path, over, slow=given)
    assert str(caught.value).startswith(f"{tmp_path}/slow.csv")
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("unit", "without", "given", "words"),
    [
        ({"time": {"unit": "ms"}}, "crank_angle", table(SLOW), ["0.003 revolutions", "did you mean 's'?"]),
        ({"time": {"unit": "min"}}, "crank_angle", table(SLOW), ["180 revolutions", "did you mean 's'?"]),
        ({"time": {"unit": "s"}}, "crank_angle", table(SLOW).head(70), ["0.875 revolutions", "measure again"]),
        ({"crank_angle": {"unit": "rad"}}, "time", table(SLOW), ["row 3", "check channels.crank_angle.unit = 'rad'"]),
        ({"crank_angle": {"unit": "rad"}}, "time", table(SLOW, count=2400), ["channels.crank_angle.unit = 'rad'"]),
        ({"crank_angle": {"unit": "deg"}}, "time", table(SLOW).head(70), ["0.875 revolutions", "measure again"]),
        (
            {"crank_angle": {"unit": "deg"}},
            "time",
            table(SLOW).assign(theta=lambda t: np.radians(t.theta)),
            ["at least one revolution", "check channels.crank_angle.unit = 'deg'"],
        ),
    ],
)
def test_times_alone_or_angles_alone_in_a_wrong_unit_are_refused(tmp_path, unit, without, given, words):
    with pytest.raises(InputError) as caught:
        rig(tmp_path, {"channels": unit}, without=(without,), slow=given)
    for word in words:
        assert word in str(caught.value)


def test_a_row_of_units_must_say_what_the_campaign_says(tmp_path):
    path = write_rig(tmp_path)
    text = (tmp_path / "slow.csv").read_text(encoding="utf-8")
    for units, fits in (("s,deg,mm,N*m", True), ("[s],[°],[mm],[Nm]", True), ("s,rad,mm,N*m", False)):
        (tmp_path / "slow.csv").write_text(text.replace("t,theta,x,M\n", f"t,theta,x,M\n{units}\n"), encoding="utf-8")
        if fits:
            measurements = read_measurements(load_campaign(path))
            assert "taken as units and skipped" in measurements.remarks[0]
        else:
            with pytest.raises(InputError, match=r"column theta: the row below the headings says 'rad'.* is 'deg'"):
                read_measurements(load_campaign(path))


def test_nuisances_without_a_use_are_remarked(tmp_path):
    joints = {"joints": {"crank_pin": "ideal", "piston_pin": "ideal"}}
    from jointgap.config import read_yaml
    from tests.config.mechanisms import PAPER

    over = {"mechanism": read_yaml(PAPER) | joints, "nuisance": {"restitution": [0.3, 0.9]}}
    assert read_rig(tmp_path, over).remarks == (
        "nuisance restitution has nothing to act on in this mechanism and is left out",
    )


def test_the_table_has_one_row_a_sample_and_channel(tmp_path):
    frame = to_frame(read_rig(tmp_path))
    assert len(frame) == 2 * 3 * 240
    assert isinstance(frame, pd.DataFrame)
    assert frame.groupby(["run", "channel"])["sample"].max().eq(239).all()
