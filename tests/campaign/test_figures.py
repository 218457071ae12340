"""Figures of a campaign, from the tables of a small made-up one."""

import re

import numpy as np
import pandas as pd
import pytest

from jointgap.campaign.figures import FIGURES
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError

RUNS = {"slow": False, "fast": False, "check": True}  # held out
CHANNELS = ("slider_acceleration", "crank_torque")
VERDICT = {"effects": []}
ANGLE = np.linspace(0.0, 6.0 * np.pi, 541)


def residuals():
    """A square wave of four standard deviations in the torque is missing from the base."""
    random, parts = np.random.default_rng(1), []
    for run, held_out in RUNS.items():
        for channel in CHANNELS:
            missing = 4.0 * np.sign(np.sin(ANGLE)) * (channel == "crank_torque")
            noise = random.standard_normal(ANGLE.size)
            part = pd.DataFrame({"sample": np.arange(ANGLE.size), "crank_angle": ANGLE})
            part = part.assign(run=run, channel=channel, held_out=held_out, spread=0.1, base=2.0)
            measured = 2.0 + 0.1 * (missing + noise)
            parts.append(part.assign(measured=measured, augmented=2.0 + 0.1 * missing))
    return pd.concat(parts, ignore_index=True)


def bins():
    start = np.tile(10.0 * np.arange(36), 2)
    run = np.repeat(["slow", "fast"], 36)
    mean = np.where(start < 180.0, 4.0, -4.0)
    return pd.DataFrame({"start_deg": start, "end_deg": start + 10.0, "run": run, "mean": mean})


def forces():
    parts = []
    for run, speed in {"slow": 20.0, "check": 40.0}.items():
        velocity = -0.15 * speed * np.sin(ANGLE)
        part = pd.DataFrame({"crank_angle": ANGLE, "velocity": velocity, "run": run})
        part = part.assign(body="slider", position=0.15 * np.cos(ANGLE))
        part = part.assign(force=-21.0 * np.tanh(velocity / 0.01))
        parts.append(part.assign(angle=np.nan, angular_velocity=np.nan, torque=np.nan))
    return pd.concat(parts, ignore_index=True)


@pytest.fixture(scope="module")
def tables():
    runs = [(run, channel) for run in RUNS for channel in CHANNELS]
    errors = pd.DataFrame(runs, columns=["run", "channel"])
    errors = errors.assign(held_out=errors["run"].map(RUNS), unit="N*cm", si_per_unit=0.01)
    errors = errors.assign(speed=20.0, noise=10.0, before=[10.0, 40.0] * 3, after=10.0)
    gaps = errors[["run", "channel"]].assign(before=4.0, after=1.0)
    gaps = pd.concat([gaps, gaps.head(1).assign(run="all", channel="all")], ignore_index=True)
    for end, factor in {"low": 0.95, "high": 1.06}.items():
        gaps = gaps.assign(**{f"{when}_{end}": factor * gaps[when] for when in ("before", "after")})
    law = "discovered_slider_force[v^3] + discovered_slider_force[1]"
    pair = "slider_coulomb_friction + sensor_bias:crank_torque"
    ranking = [
        ("slider_coulomb_friction", "single", 6842.0, 0.998, "named"),
        ("gravity", "single", -8.0, 0.0, ""),
        (pair, "pair", 6835.0, 0.999, ""),
        (law, "formula", 5993.0, 0.87, ""),
        ("rod_flexibility", "single", np.nan, np.nan, ""),
    ]
    columns = ["explanation", "kind", "delta_bic", "explained_share", "place"]
    ranking = pd.DataFrame(ranking, columns=columns)
    detectable = [
        ("gravity", 0.3, 9.8, False, True, None),
        ("rod_flexibility", 150.0, 75.0, True, True, None),
        ("crank_unbalance", np.nan, np.nan, False, False, None),
        ("gas_pressure", np.nan, np.nan, False, False, "the slider jams"),
    ]
    columns = ["label", "smallest_detectable", "typical", "falls", "detectable", "failed"]
    detectable = pd.DataFrame(detectable, columns=columns)
    window = {"run": "slow", "channel": "crank_torque", "mean": -4.0}
    return {
        "residuals": residuals(),
        "channel_errors": errors,
        "gaps": gaps.assign(role=gaps["run"].map({"check": "confirm"}).fillna("identify")),
        "map_bins": bins().assign(channel="crank_torque"),
        "map_windows": pd.DataFrame([window | {"start_deg": 340.0, "end_deg": 20.0}]),
        "ranking": ranking,
        "detectable": detectable.assign(unit="N"),
        "missing_force": forces(),
    }


@pytest.fixture(scope="module")
def drawings(tables):
    return {name: FIGURES.draw(name, tables, VERDICT) for name in FIGURES}


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_records_its_data_and_labels_its_axes(drawings, name):
    drawing, caption = drawings[name], FIGURES[name].caption
    parquet.to_arrow(schema.PLOTTED, drawing.data)
    assert len(drawing.data) and len(caption) > 100 and caption.endswith(".")
    for axes in drawing.figure.axes:
        assert set(axes.get_legend_handles_labels()[1]) <= set(drawing.data["series"])
        for axis in (axes.xaxis, axes.yaxis):
            ticks = [text.get_text() for text in axis.get_ticklabels() if text.get_visible()]
            ticks = [tick.replace("mathdefault", "") for tick in ticks if tick]
            has_words = any(re.search(r"[a-z]{3}", tick) for tick in ticks)
            has_unit = re.search(r"\w+.* \[[^\]]+\]$", axis.get_label_text())
            assert not ticks or has_words or has_unit


def test_runs_are_ordered_by_speed_also_if_the_slowest_is_held_out(tables):
    speeds = {"check": 10.0, "slow": 20.0, "fast": 40.0}
    errors = tables["channel_errors"].assign(speed=tables["channel_errors"]["run"].map(speeds))
    by_speed = tables | {"channel_errors": errors.sort_values("speed", kind="stable")}
    panels = FIGURES.draw("measured_against_model", by_speed, VERDICT).figure.axes
    panels.sort(key=lambda axes: axes.get_subplotspec().colspan.start)
    titles = [run for axes in panels for run in speeds if run in axes.get_title(loc="left")]
    assert list(dict.fromkeys(titles)) == list(speeds)


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_without_data_says_so(tables, name):
    cases = [{}, {key: frame.head(0) for key, frame in tables.items()}]
    for case in cases:
        drawing = FIGURES.draw(name, case, VERDICT)
        texts = [text.get_text() for axes in drawing.figure.axes for text in axes.texts]
        assert texts == [FIGURES[name].nothing] and drawing.data.empty


def test_an_unknown_figure_is_refused():
    with pytest.raises(InputError, match="did you mean 'gaps'"):
        FIGURES.draw("gap", {}, VERDICT)


def test_the_map_shows_every_bin_and_outlines_a_window_across_0_at_both_ends(drawings, tables):
    data = drawings["disagreement"].data
    windows = data[data["series"].str.startswith("window")]
    spans = sorted(zip(windows["low"], windows["high"], strict=True))
    assert spans == [(0.0, 20.0), (340.0, 360.0)]
    means = data.loc[data["series"] == "mean residual", "value"].astype(float)
    np.testing.assert_allclose(np.sort(means), np.sort(tables["map_bins"]["mean"]))


def test_the_named_explanation_is_first(drawings):
    data = drawings["ranking"].data
    distance = data[data["panel"] == "distance to the best"].set_index("label")
    best = distance.loc["slider_coulomb_friction", ["series", "x", "y"]].tolist()
    assert best == ["named", 0.0, 0.0]
    assert distance.loc["the current model", "x"] == 6842.0
    assert "rod_flexibility" not in distance.index
    ticks = [axes.get_yticklabels() for axes in drawings["ranking"].figure.axes]
    names = [text.get_text() for labels in ticks for text in labels]
    assert "slider force: v^3, 1" in names


@pytest.mark.parametrize("name", ["gaps", "measured_against_model"])
def test_a_model_without_added_effects_has_no_after(tables, name):
    samples = tables["residuals"].assign(augmented=tables["residuals"]["base"])
    gaps = tables["gaps"].assign(after=tables["gaps"]["before"])
    drawing = FIGURES.draw(name, tables | {"residuals": samples, "gaps": gaps}, VERDICT)
    assert not drawing.data["series"].str.contains("after").any()
