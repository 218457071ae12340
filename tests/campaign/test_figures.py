"""What the figures of a campaign owe their reader, on a small made-up campaign."""

import re

import numpy as np
import pandas as pd
import pytest

from jointgap.campaign.figures import FIGURES
from jointgap.core import parquet, plot, schema
from jointgap.core.errors import InputError
from tests.catalogue import each

RUNS = {"slow": False, "fast": False, "check": True}  # held out
CHANNELS = ("slider_acceleration", "crank_torque")
VERDICT = {
    "verdict": "named",
    "effects": [
        {"name": "slider_coulomb_friction", "site": "slider", "delta_bic": 812.4, "parameters": {}}
    ],
    "equivalent": [],
    "preflight": {"undetectable": ["crank_unbalance"], "merged": [["gravity", "slider_spring"]]},
}


def made_up():
    """Tables of a campaign whose base misses a square wave of four standard deviations in the
    torque."""
    random, angle, series = np.random.default_rng(1), np.linspace(0.0, 6.0 * np.pi, 541), []
    for run, held_out in RUNS.items():
        for channel in CHANNELS:
            missing = 4.0 * np.sign(np.sin(angle)) * (channel == "crank_torque")
            noise = random.standard_normal(angle.size)
            frame = pd.DataFrame({"run": run, "channel": channel, "sample": np.arange(angle.size)})
            frame = frame.assign(crank_angle=angle, held_out=held_out, spread=0.1, base=2.0)
            frame = frame.assign(
                measured=2.0 + 0.1 * (missing + noise), augmented=2.0 + 0.1 * missing
            )
            series.append(frame.assign(whitened_base=missing + noise, whitened_augmented=noise))
    samples = pd.concat(series, ignore_index=True)
    frames = {"residuals": samples, "channel_errors": errors_of(samples), "gaps": gaps_of(samples)}
    return frames | located(samples) | planned() | after()


def errors_of(samples):
    """Table channel_errors, the torque in N*cm."""
    rows = []
    for (run, channel, held_out), own in samples.groupby(
        ["run", "channel", "held_out"], sort=False
    ):
        unit, factor = ("N*cm", 0.01) if channel == "crank_torque" else ("m/s^2", 1.0)
        row = {
            "run": run,
            "speed": 20.0,
            "channel": channel,
            "held_out": held_out,
            "samples": len(own),
        }
        row |= {"unit": unit, "si_per_unit": factor, "noise": 0.1 / factor}
        for when, model in (("before", "base"), ("after", "augmented")):
            row[when] = np.sqrt(np.mean((own["measured"] - own[model]) ** 2)) / factor
        rows.append(row)
    return pd.DataFrame(rows, columns=schema.CHANNEL_ERRORS.names)


def located(samples):
    samples = samples[~samples["held_out"]]
    start = 10.0 * np.floor(np.degrees(samples["crank_angle"]) % 360.0 / 10.0)
    grouped = samples.groupby(["run", "channel", start.rename("start_deg")], sort=False)[
        "whitened_base"
    ]
    bins = grouped.agg(
        samples="size", mean="mean", rms=lambda values: np.sqrt((values**2).mean())
    ).reset_index()
    bins = bins.assign(
        end_deg=bins["start_deg"] + 10.0, p=0.5, p_adjusted=0.5, flagged=bins["mean"].abs() > 2.0
    )
    window = {
        "run": "slow",
        "channel": "crank_torque",
        "mean": -4.0,
        "rms": 4.1,
        "p_adjusted": 1e-9,
    }
    return {
        "map_bins": bins,
        "map_windows": pd.DataFrame([window | {"start_deg": 340.0, "end_deg": 20.0}]),
    }


def gaps_of(samples):
    rows = []
    for role in ("identify", "confirm"):
        of_role = samples[samples["held_out"] == (role == "confirm")]
        pairs = [
            (run, channel) for run in of_role["run"].unique() for channel in (*CHANNELS, "all")
        ]
        for run, channel in [*pairs, ("all", "all")]:
            own = of_role[of_role["run"].isin([run] if run != "all" else list(RUNS))]
            own = own[own["channel"].isin([channel] if channel != "all" else CHANNELS)]
            row = {"run": run, "role": role, "channel": channel}
            for when, column in (("before", "whitened_base"), ("after", "whitened_augmented")):
                gap = np.sqrt((own[column] ** 2).mean())
                row |= {when: gap, f"{when}_low": 0.95 * gap, f"{when}_high": 1.06 * gap}
            rows.append(row)
    return pd.DataFrame(rows)


def planned():
    """The ranking, and what a preflight said."""
    rows = [
        ("slider_coulomb_friction", "single", 2150.0, 6842.0, 0.998),
        ("gravity", "single", 9000.0, -8.0, 0.0),
        ("slider_coulomb_friction + sensor_bias:crank_torque", "pair", 2149.0, 6835.0, 0.999),
        (
            "discovered_slider_force[v^3] + discovered_slider_force[1]",
            "formula",
            3000.0,
            5993.0,
            0.87,
        ),
        ("rod_flexibility", "single", np.nan, np.nan, np.nan),
    ]
    fits = pd.DataFrame(
        rows, columns=["explanation", "kind", "chi2", "delta_bic", "explained_share"]
    )
    place = np.where(fits["explanation"] == "slider_coulomb_friction", "named", "")
    labels = ["gravity", "slider_spring", "crank_unbalance", "sensor_bias:crank_torque"]
    cosine = {("gravity", "slider_spring"): 0.985, ("gravity", "crank_unbalance"): 0.4}
    pairs = [
        (a, b, 1.0 if a == b else cosine.get((a, b), 0.1))
        for i, a in enumerate(labels)
        for b in labels[i:]
    ]
    sizes = {
        "gravity": (0.3, 9.8),
        "slider_spring": (5.0, 40.0),
        "sensor_bias:crank_torque": (0.005, 0.02),
    }
    sizes |= {
        "crank_unbalance": (np.nan, np.nan),
        "rod_flexibility": (150.0, 75.0),
        "gas_pressure": (np.nan, np.nan),
    }
    rows = [(label, *size) for label, size in sizes.items()]
    effects = pd.DataFrame(rows, columns=["label", "smallest_detectable", "typical"])
    effects = effects.assign(parameter="x", unit="N", detectable=effects["typical"].notna())
    effects = effects.assign(falls=effects["label"] == "rod_flexibility", failed=None)
    effects.loc[effects["label"] == "gas_pressure", "failed"] = "the slider jams"
    confusability = pd.DataFrame(pairs, columns=["first", "second", "cosine"])
    return {
        "ranking": fits.assign(place=place),
        "confusability": confusability,
        "detectable": effects,
    }


def after():
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    force = pd.DataFrame(
        {"crank_angle": angle, "slider_position": 0.15 * np.cos(angle), "crank_torque": 0.0}
    )
    speeds = {"slow": 20.0, "check": 40.0}
    runs = [
        force.assign(run=run, slider_velocity=-0.15 * w * np.sin(angle))
        for run, w in speeds.items()
    ]
    force = pd.concat(runs, ignore_index=True)
    force["slider_force"] = -21.0 * np.tanh(force["slider_velocity"] / 0.01)
    return {"missing_force": force}


@pytest.fixture(scope="module")
def tables():
    return made_up()


@pytest.fixture(scope="module")
def drawings(tables):
    return {name: FIGURES.draw(name, tables, VERDICT) for name in FIGURES}


def texts(drawing):
    return [text.get_text() for axes in drawing.figure.axes for text in axes.texts]


def test_every_figure_has_its_data_in_a_table_names_its_axes_and_explains_itself(
    drawings, tables, tmp_path
):
    def owes(name):
        drawing, caption = drawings[name], FIGURES[name].caption
        parquet.to_arrow(schema.PLOTTED, drawing.data)
        assert (
            len(drawing.data)
            and len(caption) > 100
            and caption.endswith(".")
            and "`" not in caption
        )
        recorded = set(drawing.data["series"])
        for axes in drawing.figure.axes:
            assert set(axes.get_legend_handles_labels()[1]) <= recorded
            for axis in (axes.xaxis, axes.yaxis):
                numbers = [
                    text.get_text()
                    for text in axis.get_ticklabels()
                    if text.get_visible() and text.get_text()
                ]
                words = any(
                    re.search(r"[a-z]{3}", number.replace("mathdefault", "")) for number in numbers
                )
                assert (
                    not numbers or words or re.search(r"\w+.* \[[^\]]+\]$", axis.get_label_text())
                )

    each(owes, FIGURES)
    written = plot.save(drawings["confusability"], tmp_path / "figure")
    assert sorted(path.suffix for path in written) == [".parquet", ".png", ".svg"]
    shown = parquet.read(schema.PLOTTED, tmp_path / "figure.parquet")
    assert len(shown) == len(drawings["confusability"].data)


def test_runs_stand_by_speed_in_every_figure_also_where_the_slowest_or_the_fastest_is_held_out(
    tables,
):
    for speeds in (
        {"check": 10.0, "slow": 20.0, "fast": 40.0},
        {"slow": 20.0, "fast": 40.0, "check": 60.0},
    ):
        errors = tables["channel_errors"].assign(speed=tables["channel_errors"]["run"].map(speeds))
        shown = tables | {"channel_errors": errors.sort_values("speed", kind="stable")}
        for name in ("measured_against_model", "residuals"):
            panels = FIGURES.draw(name, shown, VERDICT).figure.axes
            panels.sort(key=lambda axes: axes.get_subplotspec().colspan.start)
            titles = [run for axes in panels for run in speeds if run in axes.get_title(loc="left")]
            assert list(dict.fromkeys(titles)) == list(speeds), name


def test_a_figure_without_anything_to_show_says_so(tables):
    empty = {key: frame.head(0) for key, frame in tables.items()}
    force = {
        "missing_force": tables["missing_force"].assign(slider_force=0.0)
    }  # an effect that is no force
    for name in FIGURES:
        for given in ({}, empty, *([force] if name == "missing_force" else [])):
            drawing = FIGURES.draw(name, given, VERDICT)
            assert texts(drawing) == [FIGURES[name].nothing]
            parquet.to_arrow(schema.PLOTTED, drawing.data)
    with pytest.raises(InputError, match="did you mean 'gaps'"):
        FIGURES.draw("gap", {}, VERDICT)


def test_the_map_shows_the_mean_of_every_bin_and_outlines_a_window_across_dead_centre_at_both_ends(
    drawings, tables
):
    data = drawings["disagreement"].data
    windows = data[data["series"].str.startswith("window")]
    assert sorted(zip(windows["low"], windows["high"], strict=True)) == [
        (0.0, 20.0),
        (340.0, 360.0),
    ]
    shown = data[data["series"] == "mean residual"]
    assert np.allclose(np.sort(shown["value"].astype(float)), np.sort(tables["map_bins"]["mean"]))


def test_the_explanation_of_the_verdict_stands_first_and_merged_effects_are_neighbours(drawings):
    data = drawings["ranking"].data
    behind = data[data["panel"] == "distance to the best"].set_index("label")
    assert behind.loc["slider_coulomb_friction", ["series", "x", "y"]].tolist() == [
        "named",
        0.0,
        0.0,
    ]
    assert behind.loc["the current model", "x"] == 6842.0 and "rod_flexibility" not in behind.index
    data = drawings["confusability"].data
    merged = data[data["series"] == "indistinguishable in these runs"]
    assert set(merged["label"]) == {"gravity", "slider_spring"} and np.ptp(merged["x"]) == 1.0


def test_the_terms_of_a_force_law_are_ranked_without_the_labels_of_the_code(drawings):
    names = [
        text.get_text()
        for axes in drawings["ranking"].figure.axes
        for text in axes.get_yticklabels()
    ]
    assert "slider force: v^3, 1" in names and not any(
        "[" in name or "discovered" in name for name in names
    )


def test_a_model_that_nothing_was_added_to_has_no_after(tables):
    samples = tables["residuals"].assign(augmented=tables["residuals"]["base"])
    gaps = tables["gaps"].assign(after=tables["gaps"]["before"])
    given = {"residuals": samples, "gaps": gaps, "channel_errors": tables["channel_errors"]}
    for name in ("residuals", "gaps", "measured_against_model"):
        assert (
            not FIGURES.draw(name, given, VERDICT | {"effects": []})
            .data["series"]
            .str.contains("after")
            .any()
        )
