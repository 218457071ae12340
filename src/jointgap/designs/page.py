"""Page, figures and words of a sweep."""

import math
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.compute as pc
from matplotlib.colors import LogNorm, Normalize

from jointgap.config.designs import ALL_MEASURES
from jointgap.core import parquet, plot
from jointgap.core.page import FigureBlock, Page, Paragraph, TableBlock
from jointgap.core.plot import Drawing, Panel, Quantity, Sheet
from jointgap.core.schema import Column
from jointgap.core.words import in_words, joined, reading_unit, unit_in_words
from jointgap.designs.run import failures
from jointgap.designs.sampling import Axis, Designs

_COLUMNS = {column.name: column for column in ALL_MEASURES}
_SHORTER = {
    "repeat_distance": "distance from repeating, over the smallest clearance",
    "outer_dead_centre_angle": "outer dead centre: crank angle",
    "inner_dead_centre_angle": "inner dead centre: crank angle",
    **{
        f"{name}{suffix}": f"{words}, {span}"
        for suffix, span in {"": "last revolution", "_in_window": "window of the first revolution"}.items()
        for name, words in {
            "best_crank_length": "best crank length by the paper's method",
            "best_ratio": "best ratio of crank to rod by the paper's method",
            "reduction_at_best": "share by which the error's RMS falls at the best lengths",
        }.items()
    },
    "noise_share": "noise share of the slider's acceleration",
}
_WORDS = {
    "speed": "crank speed",
    "window_start": "start of the window",
    "window_end": "end of the window",
    "error_measure": "measure of the error",
    "revolution": "revolution counted",
    "stiffness": "stiffness of the contacts",
}
_VALUES = {"rms": "RMS"}
_UNITS = {"stiffness": "N/mⁿ"}  # it has no SI unit of its own: that depends on the exponent
_LEFT_OUT = ("mechanism", "simulate", "joints", "contact")
"""Parts of a path that say nothing that its other parts do not."""


def measure_in_words(name: str) -> str:
    """``RMS of the normal force in the crank pin``."""
    words = _SHORTER.get(name) or _COLUMNS[name].description.partition(";")[0]
    return words.replace(" (ideal less simulated)", "")


def measure_quantity(name: str) -> tuple[Quantity, float]:
    """What an axis of a measure shows, and how many of its units one SI unit is."""
    return _quantity(measure_in_words(name), _COLUMNS[name].unit)


def parameter_in_words(key: str) -> str:
    """``crank pin journal`` of ``mechanism.joints.crank_pin.journal``."""
    return _WORDS.get(key) or in_words(" ".join(part for part in key.split(".") if part not in _LEFT_OUT))


def parameter_quantity(axis: Axis) -> tuple[Quantity, float]:
    """What an axis of a parameter shows, and how many of its units one SI unit is."""
    unit = _UNITS.get(axis.key, axis.unit)
    return _quantity(parameter_in_words(axis.key), unit if axis.column.kind == "float" else "")


def value_in_words(axis: Axis, value: Any) -> str:
    """A `value` of a parameter of `axis` as people read it: ``70.1 deg``, ``rod``."""
    if isinstance(value, str | bool):
        return _VALUES.get(str(value)) or in_words(str(value))
    unit, factor = reading_unit(axis.unit)
    number = f"{factor * value:.3g}".replace("e+0", "e").replace("e+", "e")
    return f"{number} {unit_in_words(unit)}".strip()


def _quantity(words: str, unit: str) -> tuple[Quantity, float]:
    shown, factor = reading_unit(unit)
    return Quantity(words, unit_in_words(shown)), factor


_COLUMNS_SWEEP = 3
_MOST_DOTS = 4000  # in a panel: more are a blot
_GROUP, _MOST_GROUPS = 25, 20  # designs of a median, and medians of a line
_DOT = 2.2  # [points]
_JITTER = 0.3  # of the distance between categories, to both sides


def measure_over_parameters(designs: pd.DataFrame, axes: tuple[Axis, ...], measure: Column) -> Drawing:
    """A panel for each parameter: a `measure` of the designs over it."""
    shown = designs[np.isfinite(designs[measure.name].to_numpy(dtype=float))]
    unit, factor = reading_unit(measure.unit)
    values = factor * shown[measure.name].to_numpy(dtype=float)
    columns = min(_COLUMNS_SWEEP, len(axes))
    rows = -(-len(axes) // columns)
    with plot.matplotlib_style():
        sheet = Sheet(0.8 + 2.2 * rows, rows, columns)
        for place, axis in enumerate(axes):
            of_row = place % columns == 0
            panel = sheet.panel(divmod(place, columns), "", parameter_quantity(axis)[0], Quantity("", unit or "1"))
            panel.axes.set_ylabel(f"[{panel.y.unit if panel.y.unit != '1' else '–'}]" if of_row else "")
            _draw(panel, axis, shown[axis.key], values)
        sheet.figure.suptitle(measure.description.partition(";")[0], fontsize=9.5, x=0.01, ha="left")
        first = sheet.panels[0].axes
        sheet.figure.legend(*first.get_legend_handles_labels(), loc="outside lower right", ncols=2, markerscale=2.0)
    return sheet.drawing()


def _draw(panel: Panel, axis: Axis, own: pd.Series, values: np.ndarray) -> None:
    if axis.column.kind != "float":
        names = sorted(own.astype(str).unique())
        group = np.searchsorted(names, own.astype(str).to_numpy())
        # spread evenly in the order of the designs, the same each time
        spread = _JITTER * (2.0 * np.modf(np.arange(len(group)) * 0.6180339887)[0] - 1.0)
        _dots(panel, group + spread, values)
        panel.categories(names)
        middles = np.array([np.median(values[group == number]) for number in range(len(names))])
        panel.marks("median", np.arange(len(names)), middles, "network", marker="_", markersize=24.0)
        return
    x = reading_unit(axis.unit)[1] * own.to_numpy(dtype=float)
    _dots(panel, x, values)
    order = np.argsort(x, kind="stable")
    groups = np.array_split(order, max(1, min(_MOST_GROUPS, len(order) // _GROUP)))
    middles = [(np.median(x[group]), np.median(values[group])) for group in groups if len(group)]
    panel.line("median", *np.array(middles).reshape(-1, 2).T, "network", linewidth=1.6)


def _dots(panel: Panel, x: np.ndarray, values: np.ndarray) -> None:
    some = slice(None, None, max(1, -(-len(x) // _MOST_DOTS)))
    panel.marks("design", x[some], values[some], "simulation", markersize=_DOT, alpha=0.5, markeredgewidth=0.0)


MAP = "map"
"""Name of the figure of a sweep whose design is a grid of two or three parameters."""

_MAPPED = {
    "angle_error_rms": ("RMS error of the transmission angle", "rad"),
    "peak_force": ("largest force in the joints", "N"),
    "noise_share": ("share of the slider's acceleration above order 10", "1"),
}
_MOST_MAPS = 3  # values of the third parameter that are shown
_MOST_TICKS = 8  # labels of an axis


def has_map(kind: str, axes: tuple[Axis, ...]) -> bool:
    """Whether a sweep is drawn as a map."""
    return kind == "grid" and len(axes) in (2, 3)


def grid_map(designs: pd.DataFrame, axes: tuple[Axis, ...]) -> Drawing:
    """Measures of the designs of a grid over the first two parameters; a column for values of the third."""
    across, up, *third = axes
    forces = [name for name in designs if name.endswith("_peak_force")]
    designs = designs.assign(peak_force=designs[forces].max(axis=1))
    parts = [("", designs)]
    if third:
        axis, words = third[0], parameter_quantity(third[0])[0]
        shown = np.unique(np.linspace(0, len(axis.values) - 1, _MOST_MAPS).round().astype(int))
        parts = [
            (f"{words.name} {_text(axis, value)} {words.unit.strip('1')}".strip(), designs[designs[axis.key] == value])
            for value in (axis.values[place] for place in shown)
        ]
    with plot.matplotlib_style():
        sheet = Sheet(0.6 + len(_MAPPED) * (1.3 + 0.13 * len(up.values)), len(_MAPPED), len(parts))
        for row, (name, (words, unit)) in enumerate(_MAPPED.items()):
            unit, factor = reading_unit(unit)
            quantity, finite = Quantity(words, unit), factor * designs[name].dropna()
            low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 1.0)
            norm = LogNorm(low, high) if 0.0 < 10.0 * low < high else Normalize(low, high)
            panels = []
            for column, (title, own) in enumerate(parts):
                labels = (parameter_quantity(axis)[0] for axis in (across, up))
                panels.append(sheet.panel((row, column), title if row == 0 else "", *labels))
                grid = factor * own.pivot(index=up.key, columns=across.key, values=name)
                grid = grid.reindex(index=up.values, columns=across.values).to_numpy(dtype=float)
                drawn = _colours(panels[-1], across, up, quantity, grid, norm)
            sheet.figure.colorbar(drawn, ax=[panel.axes for panel in panels], label=fill(quantity.label, 28))
    return sheet.drawing()


def _colours(panel: Panel, across: Axis, up: Axis, quantity: Quantity, grid: np.ndarray, norm: Normalize):
    """Cells of a `grid` (up, across); gives what a colour bar needs."""
    panel.axes.grid(False)
    for side, axis in (("x", across), ("y", up)):
        step = -(-len(axis.values) // _MOST_TICKS)
        getattr(panel.axes, f"set_{side}ticks")(
            np.arange(len(axis.values))[::step] + 0.5, [_text(axis, value) for value in axis.values][::step]
        )
    x, y = np.meshgrid(range(grid.shape[1]), range(grid.shape[0]))
    panel.record(
        quantity.name, x.ravel(), y.ravel(), value=grid.ravel(), value_quantity=quantity.name, value_unit=quantity.unit
    )
    return panel.axes.pcolormesh(grid, cmap="viridis", norm=norm)


def _text(axis: Axis, value) -> str:
    return f"{parameter_quantity(axis)[1] * value:.4g}" if axis.column.kind == "float" else in_words(str(value))


_KINDS = {
    "sobol": "drawn as a scrambled Sobol sequence",
    "latin_hypercube": "drawn as a Latin hypercube",
    "grid": "on a grid",
}
_MOST_DIGITS = 8
_QUANTILES = (0.0, 0.05, 0.5, 0.95, 1.0)


def page(designs: Designs, dataset: Path) -> Page:
    """The page of a sweep."""
    failed = failures(dataset)
    introduction = (
        f"{designs.number} designs {_KINDS[designs.kind]}"
        + ("" if designs.kind == "grid" else f", seed {designs.seed}")
        + f". Varied: {joined(parameter_in_words(axis.key) for axis in designs.axes)}; all else as in the mechanism. "
        f"Designs that failed: {sum(failed.values()) or 'none'}"
        + ("." if not failed else ": " + "; ".join(f"{count} x {why}" for why, count in failed.most_common(5)) + ".")
    )
    measured = (
        "Over all designs that were simulated: smallest, 5 %, median, 95 % and largest value. Unless it says "
        "otherwise, a measure is of the last revolution."
    )
    files = (
        "All designs: the Parquet files in `designs`, one table for `pandas.read_parquet`, polars or duckdb; "
        "`jointgap describe` explains the columns of any of them."
    )
    rows = tuple(row for column in designs.measured if (row := _measure(column, dataset)))
    blocks = (
        Paragraph(introduction),
        TableBlock(("parameter", "unit", "smallest", "median", "largest"), _parameters(designs.axes, dataset), "llrrr"),
        *([FigureBlock(MAP, "Map of the grid")] if has_map(designs.kind, designs.axes) else ()),
        Paragraph(measured),
        TableBlock(("measure", "unit", "smallest", "5 %", "median", "95 %", "largest"), rows, "llrrrrr"),
        Paragraph(files),
    )
    return Page("Sweep", blocks)


def _parameters(axes: tuple[Axis, ...], dataset: Path) -> tuple:
    rows = []
    for axis in axes:
        values = parquet.read_columns(dataset, [axis.key])[axis.key]
        if axis.column.kind != "float":
            words = sorted(map(str, pc.unique(values).to_pylist()))
            rows.append((parameter_in_words(axis.key), "", ", ".join(words), "", ""))
            continue
        unit, factor = reading_unit(axis.unit or "1")
        numbers = _numbers(factor * values.to_numpy(), (0.0, 0.5, 1.0))
        rows.append((parameter_in_words(axis.key), unit_in_words(unit), *numbers))
    return tuple(rows)


def _measure(column: Column, dataset: Path) -> tuple | None:
    values = parquet.read_columns(dataset, [column.name])[column.name].to_numpy()
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    unit, factor = reading_unit(column.unit)
    return (measure_in_words(column.name), unit_in_words(unit), *_numbers(factor * values, _QUANTILES))


def _numbers(values: np.ndarray, shares: tuple[float, ...]) -> tuple[str, ...]:
    """Quantiles with four digits, or with more where they hardly differ: enough to tell them apart."""
    shown = np.quantile(values, shares)
    largest, spread = np.max(np.abs(shown)), np.ptp(shown)
    digits = min(max(4, math.ceil(math.log10(largest / spread)) + 2), _MOST_DIGITS) if spread else 4
    return tuple(f"{value:.0f}" if abs(value) >= 1e4 else f"{value:.{digits}g}" for value in shown)
