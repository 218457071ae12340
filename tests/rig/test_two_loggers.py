"""Runs of two loggers, each with its own file and clock, and counters that hold their readings."""

import math

import numpy as np
import pandas as pd
import pytest

from jointgap.core.errors import InputError
from jointgap.rig.recording import from_frame, to_frame
from tests.rig.recorded_files import read_rig, samples, table

LATE = 0.0123  # s
TWO = {
    "runs": [
        {"id": "slow", "file": ["slow_ni.csv", "slow.csv"], "speed": "200 rpm", "role": "identify"},
        {"id": "fast", "file": "fast.csv", "speed": "600 rpm", "role": "confirm"},
    ]
}


def two(folder, **torques) -> None:
    """The torque of the slow run, sampled otherwise and by a clock that is late."""
    true = samples(200.0, count=701, turns=2.9)
    frame = pd.DataFrame({"t": true["time"] + LATE, "M": true["crank_torque"]})
    frame.assign(**torques).to_csv(folder / "slow_ni.csv", index=False)


def test_two_files_of_a_run_are_read_each_by_its_own_clock(tmp_path):
    two(tmp_path)
    given = table(200.0).drop(columns="M")
    measurements = read_rig(tmp_path, TWO, slow=given)
    recording = measurements.runs["slow"]
    torque, angle = recording.channels["crank_torque"], recording.crank_angle
    assert recording.second_clock == ("crank_torque",)
    assert (np.isfinite(torque).sum(), np.isfinite(angle).sum()) == (701, 240)
    assert np.all(np.diff(recording.time) > 0.0)
    here = recording.time[np.isfinite(torque)]
    assert here == pytest.approx(samples(200.0, count=701, turns=2.9)["time"] + LATE)
    again = from_frame(to_frame(measurements), load(tmp_path)).runs["slow"]
    assert again.second_clock == ("crank_torque",)
    dated = [
        (given, "slow.csv", 0.0),
        (pd.read_csv(tmp_path / "slow_ni.csv"), "slow_ni.csv", 3600.0),
    ]
    for frame, name, hours in dated:  # time zones do not matter
        stamps = pd.Timestamp("2026-03-01T12:00:00", tz="UTC") + pd.to_timedelta(
            frame["t"] + hours, unit="s"
        )
        zone = "+01:00" if hours else "Z"
        text = stamps.dt.strftime("%Y-%m-%dT%H:%M:%S.%f") + zone
        frame.assign(t=text).to_csv(tmp_path / name, index=False)
    by_date = read_rig(tmp_path, TWO, slow=pd.read_csv(tmp_path / "slow.csv")).runs["slow"]
    assert by_date.time == pytest.approx(recording.time, abs=2e-6)


def load(folder):
    from jointgap.config.load import load_campaign

    return load_campaign(folder / "rig.yaml")


THREE = {"runs": [TWO["runs"][0] | {"file": ["a.csv", "b.csv", "c.csv"]}, TWO["runs"][1]]}


@pytest.mark.parametrize(
    "columns, dropped, over, words",
    [
        ({"x": 1.0}, ["M"], TWO, "both have the column 'x'; rename it"),
        ({}, ["M", "x"], TWO, "neither has the column 'x'; correct"),
        ({"t": 1e4 + np.arange(701) * 1e-3}, ["M"], TWO, "less than a revolution in common"),
        ({}, ["M"], THREE, "of two"),
    ],
)
def test_each_column_is_in_one_of_two_files_and_their_times_overlap(
    tmp_path, columns, dropped, over, words
):
    two(tmp_path, **columns)
    with pytest.raises(InputError, match=words):
        read_rig(tmp_path, over, slow=table(200.0).drop(columns=dropped))


def test_a_second_file_must_have_a_channel_besides_time(tmp_path):
    pd.DataFrame({"t": np.arange(99.0), "other": 1.0}).to_csv(tmp_path / "slow_ni.csv")
    with pytest.raises(InputError, match=r"slow_ni\.csv: has no channel of the campaign besides"):
        read_rig(tmp_path, TWO)


def varying(gate: float | None = 0.05, factor: float = 1.0):
    """A run whose crank speed swings by 10 %, read as it is or as means over a counter's gate,
    held."""
    mean, share, rate = 200.0 * math.tau / 60.0, 0.1, 11.0
    time = np.arange(1200) * 2.5e-3

    def angle(t):
        return 0.3 + mean * (t - share / rate * np.cos(rate * t))

    speed = mean * (1.0 + share * np.sin(rate * time))
    if gate:
        ends = 0.0113 + gate * np.floor((time - 0.0113) / gate)
        speed = (angle(ends) - angle(ends - gate)) / gate
    frame = pd.DataFrame(
        {"t": time, "theta": np.degrees(angle(time)) % 360.0, "w": np.round(speed, 3)}
    )
    return frame.assign(x=factor + np.arange(1200.0) % 7, M=1.0 + np.arange(1200.0) % 5), angle


def with_speed(**key):
    runs = [
        {"id": run, "file": f"{run}.csv", "speed": "200 rpm", "role": role}
        for run, role in (("slow", "identify"), ("fast", "confirm"))
    ]
    return {
        "drive": "measured_angle",
        "runs": runs,
        "channels": {"crank_speed": {"column": "w", "unit": "rad/s", **key}},
    }


@pytest.mark.parametrize("gate, is_reported", [(0.05, True), (None, False)])
def test_a_held_speed_is_reported_with_its_gate(tmp_path, gate, is_reported):
    tables = {"slow": varying(gate)[0], "fast": varying(None, 2.0)[0]}
    contradictions = read_rig(tmp_path, with_speed(), **tables).contradictions
    remarks = [item.remark for item in contradictions if item.kind == "held"]
    assert [("held for 50 ms" in text, "'average: 50 ms'" in text) for text in remarks] == (
        [(True, True)] * is_reported
    )


def test_held_means_are_placed_at_the_ends_of_their_gates(tmp_path):
    frame, angle = varying()
    tables = {"slow": frame, "fast": varying(0.05, 2.0)[0]}
    recording = read_rig(tmp_path, with_speed(average="50 ms"), **tables).runs["slow"]
    read = np.isfinite(recording.channels["crank_speed"])
    ends = recording.time[read]
    assert np.diff(ends) == pytest.approx(0.05)
    assert ends[0] % 0.05 == pytest.approx(0.0113, abs=1.3e-3)  # half a sample
    mean = (angle(ends) - angle(ends - 0.05)) / 0.05
    assert recording.channels["crank_speed"][read] == pytest.approx(mean, rel=2e-3)
