"""What every figure owes its reader, on a small made-up motion. Each figure is drawn once for all tests."""

import itertools
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from jointgap.core import parquet, plot, schema
from jointgap.core.errors import InputError
from jointgap.core.plot import LINEAR_BAND, Quantity, Sheet
from jointgap.scenario.figures import FIGURES, draw

every_still_figure = pytest.mark.parametrize("name", FIGURES.still)


@pytest.fixture(scope="module")
def drawings(tables, scenario):
    return {name: draw(name, tables, scenario) for name in FIGURES}


def test_the_synthetic_tables_are_what_the_stages_write(tables):
    for name in set(FIGURES.needed_tables(FIGURES)) - {"predictions"}:
        frame = tables[name].drop(columns="output") if name == "fit_history" else tables[name]
        parquet.to_arrow(schema.TABLES[name], frame)


def panels_of(drawing):
    """Axes that hold data, colour bars left out."""
    return [axes for axes in drawing.figure.axes if axes.get_title(loc="left")]


@every_still_figure
def test_every_axis_names_its_quantity_and_unit(name, drawings):
    """Apart from axes of categories, and axes whose numbers stand at a neighbour."""
    for axes in panels_of(drawings[name]):
        for axis in (axes.xaxis, axes.yaxis):
            numbers = [text.get_text() for text in axis.get_ticklabels() if text.get_visible() and text.get_text()]
            categories = any(re.search(r"[a-z]", number.replace("mathdefault", "")) for number in numbers)
            if numbers and not categories:
                assert re.search(r"\w+.* \[[^\]]+\]$", axis.get_label_text()), axes.get_title(loc="left")


@every_still_figure
def test_the_saved_data_is_what_the_lines_show(name, drawings):
    drawing = drawings[name]
    checked = 0
    for axes in panels_of(drawing):
        panel = drawing.data[drawing.data["panel"] == axes.get_title(loc="left")]
        for line in axes.get_lines():
            rows = panel[panel["series"] == line.get_label()]
            if line.get_transform() != axes.transData or not len(rows):
                continue
            shown = np.column_stack(line.get_data())
            recorded = rows[["x", "y"]].to_numpy(dtype=float)
            assert len(recorded) % len(shown) == 0
            starts = range(0, len(recorded), len(shown))
            assert any(np.array_equal(recorded[i : i + len(shown)], shown, equal_nan=True) for i in starts)
            checked += 1
    assert checked


@every_still_figure
def test_every_series_in_a_legend_has_its_data(name, drawings):
    drawing = drawings[name]
    recorded = set(drawing.data["series"])
    for axes in drawing.figure.axes:
        assert set(axes.get_legend_handles_labels()[1]) <= recorded


@every_still_figure
def test_no_text_leaves_the_figure_and_no_labels_of_one_axis_touch(name, drawings):
    check_texts(drawings[name].figure)


def test_other_sets_of_loose_joints_are_drawn_as_well(another):
    scenario, tables = another
    ideal = {"crank_pivot", "crank_pin", "piston_pin"} - set(scenario.mechanism.loose)
    for name in ("figure_05", "figure_08", "figure_16", "contradictions", "orbits", "contact_forces", "impacts"):
        drawing = draw(name, tables, scenario)
        titles = " ".join(axes.get_title(loc="left") for axes in panels_of(drawing))
        assert not any(f"{joint.replace('_', ' ')}:" in titles for joint in ideal)
        if name == "figure_08":  # the fullest one
            check_texts(drawing.figure)


def test_a_mechanism_without_clearance_is_animated(without_clearance):
    scenario, tables = without_clearance
    assert len(draw("animation", tables, scenario).frames) == scenario.figures.animation_frames


def check_texts(figure):
    """No text leaves the figure, and no labels of one axis touch."""
    with plot.matplotlib_style():
        figure.draw_without_rendering()
    width, height = figure.bbox.size
    for axes in figure.axes:
        texts = [axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label]
        for text in [text for text in texts if text.get_text()]:
            box = text.get_window_extent()
            assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width + 1 and box.y1 <= height + 1, text.get_text()
        for axis, low, high in ((axes.xaxis, "x0", "x1"), (axes.yaxis, "y0", "y1")):
            shown = [label for label in axis.get_ticklabels() if label.get_text() and label.get_visible()]
            limits = sorted(axis.get_view_interval())
            inside = [
                label.get_window_extent()
                for label in shown
                if limits[0] <= (label.get_position()[0] if low == "x0" else label.get_position()[1]) <= limits[1]
            ]
            inside.sort(key=lambda box: getattr(box, low))
            for before, after in itertools.pairwise(inside):
                assert getattr(before, high) <= getattr(after, low) + 1.0, (axes.get_title(loc="left"), axis.axis_name)


def test_the_data_fits_its_table(drawings):
    for drawing in drawings.values():
        parquet.to_arrow(schema.PLOTTED, drawing.data)


@pytest.mark.parametrize("name", ["figure_15", "animation"])
def test_saving_the_same_drawing_anew_gives_the_same_bytes(name, tables, scenario, tmp_path):
    one, two = (plot.save(draw(name, tables, scenario), tmp_path / run / name) for run in ("one", "two"))
    suffixes = [".gif", ".parquet"] if name == "animation" else [".png", ".svg", ".parquet"]
    assert [path.suffix for path in one] == suffixes
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]
    if name != "animation":
        png, svg, _ = one
        text = svg.read_text()
        assert "dc:date" not in text and "Matplotlib" not in text and not Image.open(png).text


def test_every_figure_has_a_caption_in_sentences():
    for spec in FIGURES.values():
        assert len(spec.caption) > 100 and spec.caption.endswith(".") and "`" not in spec.caption


def test_marks_far_below_all_others_are_not_cut_off(tables, scenario):
    torn = tables["fit_errors"].copy()
    row = torn.index[(torn["region"] == "past_60_deg") & (torn["output"] == "gamma2") & (torn["model"] == "network")]
    torn.loc[row, "spline_held_out_mse"] = 1e-14
    drawing = draw("held_out", dict(tables, fit_errors=torn), scenario)
    with plot.matplotlib_style():
        drawing.figure.draw_without_rendering()
    for axes in panels_of(drawing):
        bottom, top = axes.get_ylim()
        assert bottom < 1e-14 and top > np.nanmax(drawing.data["y"])


def test_undefined_directions_leave_a_gap(tables, scenario):
    torn = tables["trajectory"].copy()
    torn.loc[20:22, ["gamma2", "gamma2_dot", "gamma2_ddot"]] = np.nan
    data = draw("orbits", dict(tables, trajectory=torn), scenario).data
    orbit = data[(data["panel"] == "crank pin, first") & data["series"].str.startswith("first")]
    assert list(np.flatnonzero(orbit["y"].isna())) == [0, 20, 21, 22]


def test_the_animation_has_the_frames_asked_for_and_shows_different_things(drawings, scenario):
    drawing = drawings["animation"]
    assert len(drawing.frames) == scenario.figures.animation_frames
    assert all(frame.dtype == np.uint8 and frame.shape == drawing.frames[0].shape for frame in drawing.frames)
    assert all((one != two).any() for one, two in itertools.pairwise(drawing.frames))


def test_a_box_whose_name_ends_like_that_of_the_main_one_stays_out_of_the_re_simulated_reductions(tables, scenario):
    more = tables["optimise_resimulated"].query("point == 'networks_paper_genetic'")
    more = more.assign(point="networks_my_paper_genetic")
    both = pd.concat([tables["optimise_resimulated"], more], ignore_index=True)
    shown = draw("resimulation", dict(tables, optimise_resimulated=both), scenario).data["label"]
    assert "networks_paper_genetic" in set(shown) and "networks_my_paper_genetic" not in set(shown)


@every_still_figure
def test_a_scale_that_is_not_linear_throughout_is_explained_in_the_legend(name, drawings):
    drawing = drawings[name]
    if any(axes.get_yscale() == "symlog" for axes in drawing.figure.axes):
        (legend,) = drawing.figure.legends
        assert LINEAR_BAND in [text.get_text() for text in legend.get_texts()]


def test_curves_and_marks_of_thousands_of_points_are_drawn_as_pixels():
    sheet = Sheet(3.0, 1, 1)
    panel = sheet.panel((0, 0), "dense", Quantity("x", "m"), Quantity("y", "m"))
    for count in (100, 6000):
        panel.line("line", np.arange(count), np.arange(count), "ideal")
        panel.marks("marks", np.arange(count), np.arange(count), "ideal")
    assert [line.get_rasterized() for line in panel.axes.get_lines()] == [False, False, True, True]


def test_a_constant_speed_is_called_so(drawings):
    speed = drawings["drive_and_guide"].figure.axes[0]
    assert [text.get_text() for text in speed.texts] == ["constant"]
    assert [label.get_text() for label in speed.get_yticklabels()] == ["600"]


def test_an_unknown_figure_is_refused_with_a_hint(tables, scenario):
    with pytest.raises(InputError, match="did you mean 'orbits'"):
        draw("orbit", tables, scenario)


def test_a_missing_table_is_named(scenario):
    with pytest.raises(InputError, match="needs the table 'kinematics'"):
        draw("figure_09", {}, scenario)


def test_figures_are_saved_by_name(tables, scenario, tmp_path):
    assert FIGURES.needed_tables(("figure_15", "contact_forces")) == ("kinematics", "trajectory")
    written = plot.save(draw("figure_15", tables, scenario), tmp_path / "a folder/figure_15")
    assert [path.name for path in written] == ["figure_15.png", "figure_15.svg", "figure_15.parquet"]


def test_the_registry_loads_no_matplotlib():
    code = "import sys, jointgap.scenario.figures, jointgap.campaign.figures; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"torch", "numba", "mlflow", "matplotlib"} & set(loaded)
