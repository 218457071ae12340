"""What a measure does over each parameter of a sweep: every design a dot, and the median of those side by side."""

import numpy as np
import pandas as pd

from jointgap.designs.design_of_experiments import Axis
from jointgap.designs.words_of_designs import parameter_quantity
from jointgap.figures import style
from jointgap.figures.sheet import Panel, Quantity, Sheet
from jointgap.figures.style import Drawing
from jointgap.report.plain_words import reading_unit
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
    with style.matplotlib_style():
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
