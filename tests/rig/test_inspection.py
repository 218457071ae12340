"""Inspection of the data: cycles, speeds, gaps and scatter, and drawings over the crank angle."""

import math

import numpy as np
import pytest

from jointgap.config.load import load_campaign
from jointgap.core import parquet, schema
from jointgap.rig.inspection import inspect
from jointgap.rig.read_files import read_measurements
from tests.rig.recorded_files import CAMPAIGN, table, write_rig


def looked(folder, without=(), **given):
    campaign = load_campaign(write_rig(folder, **given))
    kept = {name: channel for name, channel in campaign.channels.items() if name not in without}
    campaign = campaign.model_copy(update={"channels": kept})
    numbers, figures = inspect(campaign, read_measurements(campaign))
    return numbers.set_index(["run", "channel"]), figures


def noisy(count=400, turns=8.0):
    frame = table(200, count=count, turns=turns)
    return frame.assign(M=frame.M + 0.02 * np.random.default_rng(2).standard_normal(count))


def test_cycles_speed_with_its_spread_gaps_and_scatter_are_found(tmp_path):
    frame = noisy()
    frame.loc[100:119, "M"] = np.nan
    numbers, _ = looked(tmp_path, slow=frame)
    row = numbers.loc[("slow", "crank_torque")]
    assert (row["cycles"], row["samples"], row["gaps"], row["role"]) == (8, 400, 20, "identify")
    assert row["samples_per_revolution"] == pytest.approx(50.0, rel=1e-9)
    assert row["mean_speed"] == pytest.approx(200 * math.tau / 60, rel=1e-9)
    assert row["speed_spread"] == pytest.approx(0.0, abs=1e-9)
    assert row["scatter"] == pytest.approx(0.02, rel=0.1) and row["stated_noise"] == 0.02
    assert numbers.loc[("slow", "slider_position"), "scatter"] < 1e-9
    # samples between those of the cycle before
    numbers, _ = looked(tmp_path, slow=noisy(count=1003))
    assert numbers.loc[("slow", "crank_torque"), "scatter"] == pytest.approx(0.02, rel=0.1)
    frame = table(200, turns=4.0, count=400)
    frame["t"] = np.interp(np.arange(400.0), [0.0, 200.0, 400.0], [0.0, 0.6, 1.2 * 0.6 + 0.6])
    numbers, _ = looked(tmp_path, slow=frame)
    speeds = math.tau / np.array([0.3, 0.3, 0.36, 0.36])
    assert numbers.loc[("slow", "crank_angle"), "speed_spread"] == pytest.approx(
        np.std(speeds[:3], ddof=1), rel=0.1
    )


def test_each_run_has_a_figure_with_every_channel_and_all_samples(tmp_path):
    frame = noisy()
    frame.loc[50:59, "x"] = np.nan
    for without in ((), ("time",), ("crank_angle",)):
        numbers, figures = looked(tmp_path, without=without, slow=frame)
        # unknown unless time and angle are measured
        assert numbers["mean_speed"].isna().all() == bool(without)
        assert list(figures) == ["slow", "fast"]
        data = figures["slow"].data
        parquet.to_arrow(schema.PLOTTED, data)  # it can be written
        panels = set(data["panel"])
        assert {"slow: crank torque", "slow: slider position"} <= panels
        assert ("slow: deviation from steady rotation" in panels) == (without == ())
        shown = data[data["panel"] == "slow: slider position"]
        assert (len(shown), shown["y"].isna().sum()) == (400, 10) and shown["x"].between(
            0.0, 360.0
        ).all()


def test_a_clockwise_run_is_drawn_at_the_angles_of_its_file(tmp_path):
    frame = noisy()
    frame.loc[0:30, "theta"] = np.nan
    torque = looked(tmp_path, slow=frame)[1]["slow"].data.query("panel == 'slow: crank torque'")
    np.testing.assert_allclose(torque["x"].to_numpy(), noisy()["theta"], atol=1e-6)
    frame = noisy().assign(theta=lambda t: 360 - t.theta)
    clockwise = {"runs": [CAMPAIGN["runs"][0] | {"direction": "clockwise"}, CAMPAIGN["runs"][1]]}
    numbers, figures = looked(tmp_path, over=clockwise, slow=frame)
    torque = figures["slow"].data.query("panel == 'slow: crank torque'")
    np.testing.assert_allclose(np.mod(torque["x"], 360.0), frame["theta"], atol=1e-6)
    np.testing.assert_allclose(torque["y"], frame["M"])
    read = numbers.loc[("slow", "crank_angle")]
    assert read["high"] == pytest.approx(np.radians(frame["theta"][0]))
    assert read["low"] == pytest.approx(read["high"] - 8 * math.tau * 399 / 400)
