"""What every figure owes its reader, on a small made-up motion. Each figure is drawn once for all
tests."""

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
from jointgap.dynamics.simulation import simulate
from jointgap.scenario.figures import FIGURES, described, draw
from jointgap.scenario.stages import drawn
from tests.catalogue import each
from tests.scenario import drawn_tables as synthetic


@pytest.fixture(scope="module")
def drawings(tables, scenario):
    return {name: draw(name, tables, scenario) for name in FIGURES}


def panels_of(drawing):
    """Axes that hold data, colour bars left out."""
    return [axes for axes in drawing.figure.axes if axes.get_title(loc="left")]


def check_texts(figure):
    """No text leaves the figure, and no labels of one axis touch."""
    with plot.matplotlib_style():
        figure.draw_without_rendering()
    width, height = figure.bbox.size
    for axes in figure.axes:
        texts = [axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label]
        for text in [text for text in texts if text.get_text()]:
            box = text.get_window_extent()
            assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width + 1 and box.y1 <= height + 1, (
                text.get_text()
            )
        for place, (axis, low, high) in enumerate(
            ((axes.xaxis, "x0", "x1"), (axes.yaxis, "y0", "y1"))
        ):
            shown = [
                label for label in axis.get_ticklabels() if label.get_text() and label.get_visible()
            ]
            first, last = sorted(axis.get_view_interval())
            inside = [
                one.get_window_extent()
                for one in shown
                if first <= one.get_position()[place] <= last
            ]
            inside.sort(key=lambda box: getattr(box, low))
            for before, after in itertools.pairwise(inside):
                assert getattr(before, high) <= getattr(after, low) + 1.0, (
                    axes.get_title(loc="left"),
                    axis.axis_name,
                )


def check_lines(drawing):
    """The saved data is what the lines show."""
    checked = 0
    for axes in panels_of(drawing):
        panel = drawing.data[drawing.data["panel"] == axes.get_title(loc="left")]
        for line in axes.get_lines():
            rows = panel[panel["series"] == line.get_label()]
            if line.get_transform() != axes.transData or not len(rows):
                continue
            shown, recorded = (
                np.column_stack(line.get_data()),
                rows[["x", "y"]].to_numpy(dtype=float),
            )
            assert len(recorded) % len(shown) == 0
            starts = range(0, len(recorded), len(shown))
            assert any(
                np.array_equal(recorded[i : i + len(shown)], shown, equal_nan=True) for i in starts
            )
            checked += 1
    assert checked


def test_every_figure_names_its_axes_and_records_its_data(drawings):
    def owes(name):
        drawing = drawings[name]
        check_lines(drawing)
        recorded = set(drawing.data["series"])
        for axes in drawing.figure.axes:
            assert set(axes.get_legend_handles_labels()[1]) <= recorded
        for axes in panels_of(drawing):
            for axis in (
                axes.xaxis,
                axes.yaxis,
            ):  # but those of categories, and whose numbers stand at a neighbour
                numbers = [
                    text.get_text()
                    for text in axis.get_ticklabels()
                    if text.get_visible() and text.get_text()
                ]
                categories = any(
                    re.search(r"[a-z]", number.replace("mathdefault", "")) for number in numbers
                )
                assert (
                    not numbers
                    or categories
                    or re.search(r"\w+.* \[[^\]]+\]$", axis.get_label_text())
                )
        if any(axes.get_yscale() == "symlog" for axes in drawing.figure.axes):
            (legend,) = drawing.figure.legends
            assert LINEAR_BAND in [text.get_text() for text in legend.get_texts()]

    each(owes, FIGURES.still)
    for name, spec in FIGURES.items():
        parquet.to_arrow(schema.PLOTTED, drawings[name].data)
        assert len(spec.caption) > 100 and spec.caption.endswith(".") and "`" not in spec.caption


@pytest.mark.integration
def test_no_text_of_a_figure_leaves_it_and_no_labels_of_an_axis_touch(drawings):
    each(lambda name: check_texts(drawings[name].figure), FIGURES.still)


def test_the_synthetic_tables_are_what_the_stages_write(tables):
    for name in set(FIGURES.needed_tables(FIGURES)) - {"predictions"}:
        frame = tables[name].drop(columns="output") if name == "fit_history" else tables[name]
        parquet.to_arrow(schema.TABLES[name], frame)


@pytest.mark.integration
def test_other_sets_of_loose_joints_are_drawn_as_well_and_one_without_clearance_is_animated():
    for loose in (("crank_pivot",), synthetic.JOINTS):
        scenario = synthetic.scenario(loose)
        tables = synthetic.tables_of(scenario)
        for name in (
            "figure_05",
            "figure_16",
            "contradictions",
            "orbits",
            "contact_forces",
            "impacts",
        ):
            titles = " ".join(
                axes.get_title(loc="left") for axes in panels_of(draw(name, tables, scenario))
            )
            assert not any(
                f"{joint.replace('_', ' ')}:" in titles
                for joint in set(synthetic.JOINTS) - set(loose)
            )
    check_texts(draw("figure_08", tables, scenario).figure)  # the fullest one
    ideal = synthetic.scenario(())
    tables = {"trajectory": simulate(ideal.mechanism, ideal.simulate).samples}
    assert len(draw("animation", tables, ideal).frames) == ideal.figures.animation_frames


def test_saving_the_same_drawing_anew_gives_the_same_bytes(tables, scenario, tmp_path):
    one, two = (
        plot.save(draw("figure_15", tables, scenario), tmp_path / run / "15")
        for run in ("one", "two")
    )
    assert [path.name for path in one] == ["15.png", "15.svg", "15.parquet"]
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]
    text = one[1].read_text()
    assert "dc:date" not in text and "Matplotlib" not in text and not Image.open(one[0]).text


def test_the_animation_has_the_frames_asked_for_and_shows_different_things(drawings, scenario):
    frames = drawings["animation"].frames
    assert len(frames) == scenario.figures.animation_frames
    assert all(frame.dtype == np.uint8 and frame.shape == frames[0].shape for frame in frames)
    assert all((one != two).any() for one, two in itertools.pairwise(frames))


def test_figures_go_by_their_names_and_tables_and_the_registry_loads_no_matplotlib(
    tables, scenario
):
    with pytest.raises(InputError, match="did you mean 'orbits'"):
        draw("orbit", tables, scenario)
    with pytest.raises(InputError, match="requires the table 'kinematics'"):
        draw("figure_09", {}, scenario)
    assert FIGURES.needed_tables(("figure_15", "contact_forces")) == ("kinematics", "trajectory")
    code = "import sys, jointgap.scenario.figures, jointgap.campaign.figures; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not {"torch", "numba", "mlflow", "matplotlib"} & set(loaded)


@pytest.mark.parametrize("ratio", [1.02, 2.4, 9.9, 10.1, 500.0, 1001.0, 1e12])
def test_a_logarithmic_axis_has_at_least_three_labels_however_wide_or_narrow(ratio):
    axes = plot.Sheet(2.0, 1, 1).figure.add_subplot()
    axes.set(xscale="log", xlim=(0.77, 0.77 * ratio))
    plot.label_log_ticks(axes.xaxis, *axes.get_xlim())
    ticks = axes.xaxis.get_majorticklocs()
    assert np.sum((ticks >= 0.77) & (ticks <= 0.77 * ratio)) >= 3


def test_captions_of_an_own_mechanism_say_nothing_of_the_paper_or_of_networks_that_did_not_run(
    scenario,
):
    own = scenario.model_copy(update={"paper": False, "networks": False})
    shown = {name: described(name, own) for name in drawn(networks=False)}
    told = {name: f"{spec.title}. {spec.caption}" for name, spec in shown.items()}
    assert {
        name
        for name, text in told.items()
        if re.search(r"paper|network|\[|determines|  | \.", text)
    } == set()
    assert all(
        "of the simulation" in told["valley"] and text.endswith(".") for text in told.values()
    )
    assert (
        "(the paper's figure 9)"
        in described("figure_09", own.model_copy(update={"paper": True})).title
    )


def test_the_settled_orbit_shows_the_factor_that_its_caption_speaks_of_also_where_it_is_one(
    tables, scenario, monkeypatch
):
    monkeypatch.setattr("jointgap.scenario.figures.round_number", lambda value: 1.0)
    texts = [
        text.get_text()
        for axes in draw("orbits", tables, scenario).figure.axes
        for text in axes.texts
    ]
    assert texts == ["depth ×1", "depth ×1"]
