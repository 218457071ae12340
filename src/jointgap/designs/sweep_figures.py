"""Figures of a sweep: a measure over each parameter, and a map of the designs of a grid."""

from textwrap import fill

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize

from jointgap.core import plot
from jointgap.core.plot import Drawing, Panel, Quantity, Sheet
from jointgap.core.words import in_words, reading_unit
from jointgap.designs.design_of_experiments import Axis
from jointgap.designs.words_of_designs import parameter_quantity
from jointgap.tables.columns import Column

_COLUMNS = 3
_MOST_DOTS = 4000  # in a panel: more are a blot
_GROUP, _MOST_GROUPS = 25, 20  # designs of a median, and medians of a line
_DOT = 2.2  # [points]
_JITTER = 0.3  # of the distance between categories, to both sides


def measure_over_parameters(designs: pd.DataFrame, axes: tuple[Axis, ...], measure: Column) -> Drawing:
    """A panel for each parameter: a `measure` of the designs over it."""
    shown = designs[np.isfinite(designs[measure.name].to_numpy(dtype=float))]
    unit, factor = reading_unit(measure.unit)
    values = factor * shown[measure.name].to_numpy(dtype=float)
    columns = min(_COLUMNS, len(axes))
    rows = -(-len(axes) // columns)
    with plot.matplotlib_style():
        sheet = Sheet(0.8 + 2.2 * rows, rows, columns)
        for place, axis in enumerate(axes):
            of_row = place % columns == 0
            panel = _panel(sheet, divmod(place, columns), axis, Quantity("", unit or "1"))
            panel.axes.set_ylabel(f"[{panel.y.unit if panel.y.unit != '1' else '–'}]" if of_row else "")
            _draw(panel, axis, shown[axis.key], values)
        sheet.figure.suptitle(measure.description.partition(";")[0], fontsize=9.5, x=0.01, ha="left")
        first = sheet.panels[0].axes
        sheet.figure.legend(*first.get_legend_handles_labels(), loc="outside lower right", ncols=2, markerscale=2.0)
    return sheet.drawing()


def _panel(sheet: Sheet, place: tuple[int, int], axis: Axis, y: Quantity) -> Panel:
    return sheet.panel(place, "", parameter_quantity(axis)[0], y)


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
