"""Runs become samples in SI, with gaps, turns, held-out parts and what is odd about them; what
cannot be used is refused.
"""

import math

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.config import read_yaml
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.rig.read_files import read_measurements
from jointgap.rig.recording import from_frame, to_frame
from tests.config.mechanisms import PAPER
from tests.rig.recorded_files import CAMPAIGN, SPEEDS, read_rig, samples, table, write_rig

SLOW = SPEEDS["slow"]


def rig(folder, over=None, without=(), **tables):
    """Measurements of a campaign that lacks the channels `without`."""
    campaign = load_campaign(write_rig(folder, over, **tables))
    kept = {name: channel for name, channel in campaign.channels.items() if name not in without}
    return read_measurements(campaign.model_copy(update={"channels": kept}))


def run_with(**keys):
    return {"runs": [CAMPAIGN["runs"][0] | keys, CAMPAIGN["runs"][1]]}


def test_a_good_campaign_is_read_exactly_and_without_remarks_from_csv_and_parquet(tmp_path):
    measurements = read_rig(tmp_path)
    assert measurements.remarks == () and list(measurements.runs) == ["slow", "fast"]
    for run, rpm in SPEEDS.items():
        recording, true = measurements.runs[run], samples(rpm)
        read = recording.channels | {"time": recording.time, "crank_angle": recording.crank_angle}
        for name in ("time", "crank_angle", "slider_position", "crank_torque"):
            np.testing.assert_allclose(read[name], true[name], rtol=1e-13)
        assert recording.noise == {
            "crank_angle": math.radians(0.01),
            "slider_position": None,
            "crank_torque": 0.02,
        }
    table(SLOW).to_parquet(tmp_path / "slow.parquet")
    from_csv, from_parquet = (
        measurements.runs["slow"],
        read_rig(tmp_path, run_with(file="slow.parquet")).runs["slow"],
    )
    np.testing.assert_array_equal(
        from_csv.channels["crank_torque"], from_parquet.channels["crank_torque"]
    )


def test_a_changed_byte_in_a_parquet_file_with_checksums_is_refused(tmp_path):
    path, file = write_rig(tmp_path, run_with(file="slow.parquet")), tmp_path / "slow.parquet"
    table(SLOW).to_parquet(file, write_page_checksum=True, compression="none", use_dictionary=False)
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    with pytest.raises(
        InputError, match=r"slow\.parquet: cannot be read as Parquet .*write the file again"
    ):
        read_measurements(load_campaign(path))


def test_wrapped_angles_become_continuous(tmp_path):
    true = samples(SLOW, turns=7.0)["crank_angle"]
    noise = 2.0 * np.random.default_rng(0).standard_normal(240)  # deg, at its bound

    def runs_on(wrapped, added=0.0):
        frame = table(SLOW, turns=7.0).assign(theta=wrapped(np.degrees(true) + added))
        for without in ((), ("time",)):
            result = rig(tmp_path, without=without, slow=frame).runs["slow"].crank_angle
            assert np.ptp(result - true - np.radians(added)) < 1e-9
            assert abs(math.remainder(result[0] - np.radians(frame.theta[0]), math.tau)) < 1e-9

    for wrap in (lambda a: a, lambda a: (a + 180) % 360 - 180, lambda a: a % 1440):
        runs_on(wrap)
    runs_on(lambda a: a % 360, noise)
    frame = table(SLOW, turns=20.0, count=800)
    frame.loc[100:500, "theta"] = np.nan  # a gap of several turns
    frame["t"] *= 1.05  # the speed is 5 % off nominal
    angle = read_rig(tmp_path, slow=frame).runs["slow"].crank_angle
    known = np.isfinite(angle)
    assert not known[100:501].any()
    np.testing.assert_allclose(
        angle[known], samples(SLOW, turns=20.0, count=800)["crank_angle"][known], rtol=1e-12
    )


def test_a_clockwise_angle_is_mirrored_and_one_that_turns_the_other_way_is_refused(tmp_path):
    given = table(SLOW).assign(theta=lambda t: 360 - t.theta)
    recording = read_rig(tmp_path, run_with(direction="clockwise"), slow=given).runs["slow"]
    assert np.ptp(recording.crank_angle - samples(SLOW)["crank_angle"]) < 1e-9
    np.testing.assert_allclose(
        recording.channels["crank_torque"], samples(SLOW)["crank_torque"], rtol=1e-14
    )
    backward = table(SLOW).assign(theta=lambda frame: -frame.theta)
    for without in ((), ("time",)):
        with pytest.raises(InputError, match=r"the angle falls .* 'direction: clockwise'"):
            rig(tmp_path, without=without, slow=backward)
        with pytest.raises(InputError, match=r"the angle rises .* 'direction: clockwise'; remove"):
            rig(tmp_path, run_with(direction="clockwise"), without=without)


def test_signals_counts_and_sample_numbers_become_si(tmp_path):
    """Current of the motor, counts of an encoder whose counter has 16-bit, sample numbers instead
    of times."""
    path, step = write_rig(tmp_path), samples(SLOW)["time"][1]
    for run, rpm in SPEEDS.items():
        true = samples(rpm)
        counts = np.floor(4000 * true["crank_angle"] / math.tau) + 30000 * (run == "slow")
        if run == "slow":
            counts = (counts + 2**15) % 2**16 - 2**15
        frame = pd.DataFrame(
            {"n": true["time"] / step + 17, "counts": counts, "x": 1e3 * true["slider_position"]}
        )
        frame.assign(I=true["crank_torque"] / 0.35).to_csv(tmp_path / f"{run}.csv", index=False)
    channels = {
        "time": {"column": "n", "rate": f"{1 / step} Hz"},
        "crank_angle": {"column": "counts", "counts_per_turn": 4000},
        "slider_position": {"column": "x", "unit": "V", "scale": "1 mm/V"},
        "crank_torque": {"column": "I", "unit": "A", "scale": "0.35 N*m/A", "noise": 0.1},
    }
    path.write_text(yaml.safe_dump(CAMPAIGN | {"channels": channels}), encoding="utf-8")
    measurements = read_measurements(load_campaign(path), compared=False)
    recording, true = measurements.runs["slow"], samples(SLOW)
    np.testing.assert_allclose(np.diff(recording.time), step, rtol=1e-9)
    # half a turn, and the rounding
    error = (recording.crank_angle - true["crank_angle"]) * 4000 / math.tau
    # the middle of each step, as a counter truncates
    assert error % 4000 == pytest.approx(2000, abs=0.501)
    for name in ("slider_position", "crank_torque"):
        np.testing.assert_allclose(recording.channels[name], true[name], rtol=1e-12, atol=1e-15)
    assert recording.noise["crank_torque"] == pytest.approx(0.035, rel=1e-12)
    (remark,) = measurements.remarks
    assert "16-bit" in remark


def test_repeated_rows_and_times_are_kept_once(tmp_path):
    """A solver writes the state before and after an event at the same time."""
    before = table(SLOW)
    frame = pd.concat([before.iloc[:51], before.iloc[[50]].assign(M=7.0), before.iloc[51:]])
    with pytest.raises(InputError, match=r"row 53: time repeats .*1 rows do.*'repeated: last'"):
        read_rig(tmp_path, slow=frame)
    for which, value in (("first", before.M[50]), ("last", 7.0)):
        measurements = read_rig(tmp_path, {"channels": {"time": {"repeated": which}}}, slow=frame)
        assert measurements.runs["slow"].channels["crank_torque"][50] == value
        assert (
            measurements.runs["slow"].time.size == 240
            and f"the {which} is kept" in measurements.remarks[0]
        )
    before.loc[9, "M"] = np.nan
    measurements = read_rig(tmp_path, slow=before.iloc[[*range(10), 9, 9, *range(10, 240), 239]])
    np.testing.assert_allclose(measurements.runs["slow"].time, samples(SLOW)["time"], rtol=1e-14)
    (remark,) = measurements.remarks
    assert (
        remark.startswith(f"{tmp_path}/slow.csv, column t, row 12:")
        and "3 samples skipped" in remark
    )


def test_gaps_are_no_data(tmp_path):
    frame = table(SLOW)
    frame.loc[5:9, "M"], frame.loc[20:22, "t"] = np.nan, np.nan
    measurements = read_rig(tmp_path, slow=frame)
    recording = measurements.runs["slow"]
    assert np.isnan(recording.channels["crank_torque"]).sum() == 5
    np.testing.assert_allclose(
        recording.crank_angle, np.delete(samples(SLOW)["crank_angle"], [20, 21, 22]), rtol=1e-12
    )
    assert measurements.remarks == (
        f"{tmp_path}/slow.csv, column t: 3 samples have no time, skipped",
    )
    frame = table(SLOW)
    frame.loc[20, "theta"] = np.nan  # and no times are measured
    measurements = rig(tmp_path, without=("time",), slow=frame)
    assert (
        measurements.runs["slow"].crank_angle.size == 239 and not measurements.runs["slow"].has_time
    )
    assert "1 sample has no crank angle" in measurements.remarks[0]


def test_a_split_run_holds_its_last_third_out_by_time_and_not_by_count(tmp_path):
    split, thinned = run_with(role="split"), table(SLOW).drop(index=range(1, 100, 2))
    for without in ((), ("time",), ("crank_angle",)):
        runs = rig(tmp_path, split, without=without).runs
        assert runs["fast"].held_out.all()
        assert np.flatnonzero(runs["slow"].held_out).tolist() == list(range(160, 240))
    assert read_rig(tmp_path, split, slow=thinned).runs["slow"].held_out.sum() == 80


def test_measurements_survive_the_tidy_table(tmp_path):
    given = table(SLOW)
    given.loc[5:9, "M"] = np.nan
    measurements = read_rig(tmp_path, slow=given)
    frame = to_frame(measurements)
    assert len(frame) == 2 * 3 * 240
    back = from_frame(frame, load_campaign(tmp_path / "rig.yaml"))
    for run, recording in measurements.runs.items():
        again = back.runs[run]
        assert again.channels.keys() == recording.channels.keys() and again.noise == recording.noise
        for name in ("time", "crank_angle", "held_out"):
            np.testing.assert_array_equal(getattr(again, name), getattr(recording, name))
        for name, values in recording.channels.items():
            np.testing.assert_array_equal(again.channels[name], values)


def cell(column, value):
    """The slow run with another value in the eighth sample."""
    frame = table(SLOW).astype(object)
    frame.loc[7, column] = value
    return frame


def unit(**units):
    return {"channels": {channel: {"unit": name} for channel, name in units.items()}}


RADIANS = table(SLOW).assign(theta=lambda frame: np.radians(frame.theta))
SPARSE = table(SLOW, turns=30).iloc[::4]


@pytest.mark.parametrize(
    "frame, over, without, words",
    [
        (cell("M", "n.a."), {}, "", "M, row 9.*'n.a.' is not a number.*leave the cell empty"),
        (cell("M", 1e300), {}, "", r"M, row 9: 1e\+300 N\*m is implausibly large"),
        (cell("t", 0.0), {}, "", "t, row 9: time falls from.*sort the rows"),
        (cell("t", table(SLOW).t[6]), {}, "", "t, row 9: time repeats.*more digits"),
        (table(SLOW).assign(M=3.0), {}, "", "M: all values are equal"),
        (table(SLOW).assign(theta=np.nan), {}, "", "theta: contains no angles"),
        (table(SLOW).head(70), {}, "", "70 samples are 0.875 revolutions.*measure again"),
        (SPARSE, {}, "", "60 samples are 30 revolutions.*4 samples per revolution"),
        (table(SLOW), unit(time="ms"), "", "0.003 revolutions at the nominal 200 rpm.*'s'?"),
        (table(SLOW), unit(crank_angle="rad"), "", "theta.*did you mean 'deg'?"),
        (RADIANS, {}, "", "theta.*did you mean 'rad'?"),
        (table(SLOW, turns=1.4), run_with(role="split"), "", "1.394 revolutions are too few"),
        (table(SLOW), run_with(speed="90 rpm"), "", "200 rpm, but the run's speed is 90 rpm"),
        (table(SLOW), unit(time="ms"), "crank_angle", "0.003 revolutions.*did you mean 's'?"),
        (table(SLOW), unit(crank_angle="rad"), "time", "row 3.*check channels.crank_angle.unit"),
        (table(SLOW).head(70), {}, "time", "0.875 revolutions.*measure again"),
    ],
)
def test_unusable_samples_are_refused_with_file_column_row_and_fix(
    tmp_path, frame, over, without, words
):
    with pytest.raises(InputError, match=rf"(?s)slow\.csv.*{words}"):
        rig(tmp_path, over, without=(without,), slow=frame)


def test_a_row_of_units_must_agree_with_the_campaign(tmp_path):
    path, file = write_rig(tmp_path), tmp_path / "slow.csv"
    text = file.read_text(encoding="utf-8")
    for units in ("s,deg,mm,N*m", "[s],[°],[mm],[Nm]", "[Sec],[CAD],[MM],[N-m]"):
        file.write_text(text.replace("t,theta,x,M\n", f"t,theta,x,M\n{units}\n"), encoding="utf-8")
        assert "contains units and is skipped" in read_measurements(load_campaign(path)).remarks[0]
    for unit in ("rad", "rev"):
        file.write_text(
            text.replace("t,theta,x,M\n", f"t,theta,x,M\ns,{unit},mm,N*m\n"), encoding="utf-8"
        )
        with pytest.raises(
            InputError, match=rf"column theta: the row below the headings says '{unit}'.* is 'deg'"
        ):
            read_measurements(load_campaign(path))


def test_nuisances_without_effect_are_reported(tmp_path):
    ideal = read_yaml(PAPER) | {"joints": {"crank_pin": "ideal", "piston_pin": "ideal"}}
    (remark,) = read_rig(
        tmp_path, {"mechanism": ideal, "nuisance": {"restitution": [0.3, 0.9]}}
    ).remarks
    assert remark.startswith("nuisance restitution has no effect in this mechanism")
