"""Each figure labels its axes and records its data; on a small simulated motion."""

import itertools
import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from jointgap.core import parquet, plot, schema
from jointgap.core.errors import InputError
from jointgap.core.plot import LINEAR_BAND
from jointgap.motion.slider_crank import simulate
from jointgap.scenario.figures import FIGURES, described, draw
from jointgap.scenario.stages import drawn
from tests.scenario import drawn_tables


@pytest.fixture(scope="module")
def drawings(tables, scenario):
    """Every figure, drawn once."""
    return {name: draw(name, tables, scenario) for name in FIGURES}


def panels_of(drawing):
    """Axes with data, without colour bars."""
    return {
        axes.get_title(loc="left"): axes
        for axes in drawing.figure.axes
        if axes.get_title(loc="left")
    }


def check_texts(figure):
    """No text leaves the figure, and no labels of one axis touch."""
    with plot.matplotlib_style():
        figure.draw_without_rendering()
    width, height = figure.bbox.size
    for axes in figure.axes:
        for text in (axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label):
            if text.get_text():
                box = text.get_window_extent()
                is_inside = box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width + 1
                assert is_inside and box.y1 <= height + 1, text.get_text()
        for place, (axis, low, high) in enumerate(
            ((axes.xaxis, "x0", "x1"), (axes.yaxis, "y0", "y1"))
        ):
            start, end = sorted(axis.get_view_interval())
            boxes = [
                label.get_window_extent()
                for label in axis.get_ticklabels()
                if label.get_text() and label.get_visible()
                if start <= label.get_position()[place] <= end
            ]
            boxes.sort(key=lambda box: getattr(box, low))
            for box, neighbour in itertools.pairwise(boxes):
                assert getattr(box, high) <= getattr(neighbour, low) + 1.0, axes.get_title(
                    loc="left"
                )


@pytest.mark.parametrize("name", FIGURES.still)
def test_the_recorded_data_are_those_of_the_lines(drawings, name):
    drawing, count = drawings[name], 0
    for title, axes in panels_of(drawing).items():
        panel = drawing.data[drawing.data["panel"] == title]
        for line in axes.get_lines():
            recorded = panel.loc[panel["series"] == line.get_label(), ["x", "y"]].to_numpy(float)
            if line.get_transform() != axes.transData or not len(recorded):
                continue
            shown = np.column_stack(line.get_data())
            parts = recorded.reshape(-1, *shown.shape)
            assert any(np.array_equal(part, shown, equal_nan=True) for part in parts)
            count += 1
    assert count


@pytest.mark.parametrize("name", FIGURES.still)
def test_axes_and_legend_of_a_figure_are_labelled(drawings, name):
    drawing, spec = drawings[name], FIGURES[name]
    parquet.to_arrow(schema.PLOTTED, drawing.data)
    for axes in drawing.figure.axes:
        assert set(axes.get_legend_handles_labels()[1]) <= set(drawing.data["series"])
    for axes in panels_of(drawing).values():
        for axis in (axes.xaxis, axes.yaxis):
            ticks = [text.get_text() for text in axis.get_ticklabels() if text.get_visible()]
            categories = re.search("[a-z]", "".join(ticks).replace("mathdefault", ""))
            has_unit = re.search(r"\w+.* \[[^\]]+\]$", axis.get_label_text())
            assert not any(ticks) or categories or has_unit
    if any(axes.get_yscale() == "symlog" for axes in drawing.figure.axes):
        (legend,) = drawing.figure.legends
        assert LINEAR_BAND in [text.get_text() for text in legend.get_texts()]
    assert len(spec.caption) > 100 and spec.caption.endswith(".") and "`" not in spec.caption


@pytest.mark.integration
def test_no_text_of_a_figure_leaves_it_and_no_labels_of_an_axis_touch(drawings):
    for name in FIGURES.still:
        check_texts(drawings[name].figure)


def test_the_synthetic_tables_have_the_columns_of_the_stages(tables):
    for name in set(FIGURES.needed_tables(FIGURES)) - {"predictions"}:
        frame = tables[name].drop(columns="output") if name == "fit_history" else tables[name]
        parquet.to_arrow(schema.TABLES[name], frame)


@pytest.mark.integration
@pytest.mark.parametrize("loose", [("crank_pivot",), drawn_tables.JOINTS])
def test_other_sets_of_loose_joints_are_drawn_as_well(loose):
    scenario = drawn_tables.scenario(loose)
    tables = drawn_tables.tables_of(scenario)
    for name in ("figure_05", "figure_16", "contradictions", "orbits", "contact_forces", "impacts"):
        titles = " ".join(panels_of(draw(name, tables, scenario)))
        for joint in set(drawn_tables.JOINTS) - set(loose):
            assert f"{joint.replace('_', ' ')}:" not in titles
    check_texts(draw("figure_08", tables, scenario).figure)


@pytest.mark.integration
def test_a_mechanism_without_clearance_is_animated():
    ideal = drawn_tables.scenario(())
    tables = {"trajectory": simulate(ideal.mechanism, ideal.simulate).samples}
    assert len(draw("animation", tables, ideal).frames) == ideal.figures.animation_frames


def test_a_drawing_saved_again_has_the_same_bytes(tables, scenario, tmp_path):
    paths, copies = (
        plot.save(draw("figure_15", tables, scenario), tmp_path / folder / "15")
        for folder in ("one", "two")
    )
    assert [path.name for path in paths] == ["15.png", "15.svg", "15.parquet"]
    assert [path.read_bytes() for path in paths] == [path.read_bytes() for path in copies]
    text = paths[1].read_text()
    assert "dc:date" not in text and "Matplotlib" not in text and not Image.open(paths[0]).text


def test_frames_of_the_animation_differ(drawings, scenario):
    frames = drawings["animation"].frames
    assert len(frames) == scenario.figures.animation_frames
    assert all(frame.dtype == np.uint8 and frame.shape == frames[0].shape for frame in frames)
    assert all((frame != following).any() for frame, following in itertools.pairwise(frames))


def test_an_unknown_figure_or_a_missing_table_is_an_error(tables, scenario):
    with pytest.raises(InputError, match="did you mean 'orbits'"):
        draw("orbit", tables, scenario)
    with pytest.raises(InputError, match="requires the table 'kinematics'"):
        draw("figure_09", {}, scenario)
    assert FIGURES.needed_tables(("figure_15", "contact_forces")) == ("kinematics", "trajectory")


LATER = "networks.network scenario.kinematics lengths.optimise"
LARGE = {"scenario.figures campaign.figures": {"torch", "numba", "mlflow", "matplotlib"}}


@pytest.mark.parametrize("modules, packages", (LARGE | {LATER: {"torch", "mlflow"}}).items())
def test_figures_and_later_stages_import_no_large_packages(modules, packages):
    names = ", ".join(f"jointgap.{name}" for name in modules.split())
    command = [sys.executable, "-c", f"import sys, {names}; print(*sys.modules)"]
    imported = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert not packages & set(imported)


@pytest.mark.parametrize("ratio", [1.02, 2.4, 9.9, 10.1, 500.0, 1001.0, 1e12])
def test_a_logarithmic_axis_has_at_least_three_labels(ratio):
    axes = plot.Sheet(2.0, 1, 1).figure.add_subplot()
    axes.set(xscale="log", xlim=(0.77, 0.77 * ratio))
    plot.label_log_ticks(axes.xaxis, *axes.get_xlim())
    ticks = axes.xaxis.get_majorticklocs()
    assert np.sum((ticks >= 0.77) & (ticks <= 0.77 * ratio)) >= 3


def test_captions_without_paper_and_networks_mention_neither(scenario):
    other = scenario.model_copy(update={"paper": False, "networks": False})
    for name in drawn(networks=False):
        spec = described(name, other)
        text = f"{spec.title}. {spec.caption}"
        assert not re.search(r"paper|network|\[|determines|  | \.", text) and text.endswith(".")
    assert "of the simulation" in described("valley", other).caption
    with_paper = other.model_copy(update={"paper": True})
    assert "(the paper's figure 9)" in described("figure_09", with_paper).title


def test_the_settled_orbit_shows_its_magnification_even_if_it_is_one(tables, scenario, monkeypatch):
    monkeypatch.setattr("jointgap.scenario.figures.round_number", lambda value: 1.0)
    figure = draw("orbits", tables, scenario).figure
    assert [text.get_text() for axes in figure.axes for text in axes.texts] == ["depth ×1"] * 2
