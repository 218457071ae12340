"""Labels and axes of parameters and measures, and figures of measures over parameters."""

import re
from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize

from jointgap.core import plot
from jointgap.core.joints import JOINTS
from jointgap.core.page import TableBlock
from jointgap.core.plot import Drawing, Panel, Quantity, Sheet
from jointgap.core.schema import Column
from jointgap.core.words import format_name, format_unit, number, reading_unit
from jointgap.designs.sampling import Axis

_LABELS = {
    "speed": "crank speed",
    "window_start": "start of the window",
    "window_end": "end of the window",
    "error_measure": "error measure",
    "revolution": "revolution counted",
    "stiffness": "stiffness of the contacts",
    "rms": "RMS",
}
_UNITS = {"stiffness": "N/mⁿ"}  # depends on the exponent
_OMITTED = {"mechanism", "simulate", "bodies", "points", "contacts", "contact"}  # in labels

PEAK_FORCE = Column("peak_force", "N", "largest force in the joints")
"""The largest force in any joint, computed from the measures of the joints."""

_MOST_TICKS = 8  # labels of a list
_MOST_DOTS = 4000  # per panel
_GROUP_SIZE, _MOST_GROUPS = 25, 20  # designs per median, and medians per parameter
_JITTER = 0.3  # [distance between values of a list] to both sides
_MAPPED = ("angle_error_rms", PEAK_FORCE.name, "noise_share")
_MOST_MAPS = 3  # values of the third parameter


def format_measure(measure: Column) -> str:
    """``RMS of the normal force in the crank pin``."""
    return measure.description.partition(";")[0]


def measure_quantity(measure: Column) -> tuple[Quantity, float]:
    """Axis of a measure, and its number of axis units per SI unit."""
    return _quantity(format_measure(measure), measure.unit)


def format_parameter(key: str) -> str:
    """``crank pin journal`` of ``mechanism.joints.crank_pin.journal``, ``joint B clearance``."""
    key = re.sub(rf"joints\.(?={'|'.join(JOINTS)})", "", key).replace("joints.", "joint ")
    parts = [part for part in key.split(".") if part not in _OMITTED]
    return _LABELS.get(key) or format_name(" ".join(parts))


def parameter_quantity(axis: Axis) -> tuple[Quantity, float]:
    """Axis of a parameter, and its number of axis units per SI unit."""
    unit = _UNITS.get(axis.key, axis.unit) if axis.column.kind == "float" else ""
    return _quantity(format_parameter(axis.key), unit)


def _quantity(label: str, unit: str) -> tuple[Quantity, float]:
    unit, factor = reading_unit(unit)
    return Quantity(label, format_unit(unit)), factor


def format_value(axis: Axis, value: Any, with_unit: bool = True) -> str:
    """A formatted `value` of a parameter: ``70.1 deg``, ``rod``."""
    if isinstance(value, str | bool):
        return _LABELS.get(str(value)) or format_name(str(value))
    unit, factor = reading_unit(axis.unit)
    digits = number(factor * value, 3 if with_unit else 4)
    return f"{digits} {format_unit(unit)}".strip() if with_unit else digits


def parameter_table(axes: tuple[Axis, ...], frame: pd.DataFrame) -> TableBlock:
    """Smallest, median and largest value of the parameters of designs, or their words."""
    rows = []
    for axis in axes:
        values = frame[axis.key]
        if axis.column.kind == "float":
            spread = values.min(), values.median(), values.max()
            cells = tuple(format_value(axis, value) for value in spread)
        else:
            words = ", ".join(sorted(format_value(axis, value) for value in values.unique()))
            cells = (words, "", "")
        rows.append((format_parameter(axis.key), *cells))
    heads = ("parameter", "smallest", "median", "largest")
    return TableBlock(heads, tuple(rows), "lrrr", "Parameters")


def positions(axis: Axis, values: Any) -> np.ndarray:
    """Coordinates of parameter `values`: 0, 1, 2, ... for a list, in the axis unit for a range."""
    if axis.values is not None:
        return pd.Index(axis.values).get_indexer(values).astype(float)
    return parameter_quantity(axis)[1] * np.asarray(values, dtype=float)


def set_scale(panel: Panel, side: str, axis: Axis) -> None:
    """Scale and ticks of one side: values of a list, or numbers; logarithmic for a log-uniform
    range."""
    drawn_axis = getattr(panel.axes, f"{side}axis")
    if axis.values is not None:
        step = -(-len(axis.values) // _MOST_TICKS)
        labels = [format_value(axis, value, False) for value in axis.values[::step]]
        drawn_axis.set_ticks(range(0, len(axis.values), step), labels)
    elif axis.is_logarithmic:
        getattr(panel.axes, f"set_{side}scale")("log")
        plot.label_log_ticks(drawn_axis, *axis.law.support())
    else:
        panel.axes.locator_params(side, nbins=4)


def parameter_panels(axes: Sequence[Axis], quantity: Quantity) -> Sheet:
    """A sheet with a panel of `quantity` over each parameter."""
    columns = min(3, len(axes))
    rows = -(-len(axes) // columns)
    sheet = Sheet(0.8 + 2.1 * rows, rows, columns)
    for index, axis in enumerate(axes):
        panel = sheet.panel(divmod(index, columns), "", parameter_quantity(axis)[0], quantity)
        panel.axes.set_ylabel("" if index % columns else fill(quantity.label, 30))
        set_scale(panel, "x", axis)
    return sheet


def measure_over_parameters(
    designs: pd.DataFrame, axes: tuple[Axis, ...], measure: Column
) -> Drawing:
    """A measure of the designs over each parameter."""
    designs = designs[np.isfinite(designs[measure.name].to_numpy(dtype=float))]
    quantity, factor = measure_quantity(measure)
    values = factor * designs[measure.name].to_numpy(dtype=float)
    with plot.matplotlib_style():
        sheet = parameter_panels(axes, quantity)
        for panel, axis in zip(sheet.panels, axes, strict=True):
            x = positions(axis, designs[axis.key])
            if axis.values is None:
                count = max(1, min(_MOST_GROUPS, len(x) // _GROUP_SIZE))
                groups = np.array_split(np.argsort(x), count)
            else:
                groups = [np.flatnonzero(x == index) for index in range(len(axis.values))]
                # deterministic jitter, even in the order of the designs
                x = x + _JITTER * (2.0 * np.modf(np.arange(len(x)) * 0.6180339887)[0] - 1.0)
            dots = slice(None, None, max(1, -(-len(x) // _MOST_DOTS)))
            style = {"markersize": 2.2, "alpha": 0.5, "markeredgewidth": 0.0}
            panel.marks("design", x[dots], values[dots], "simulation", **style)
            medians = [
                (np.median(x[group]), np.median(values[group])) for group in groups if len(group)
            ]
            middle_x, middle_y = np.reshape(medians, (-1, 2)).T
            panel.marks("median", middle_x, middle_y, "network", marker="_", markersize=12.0)
        sheet.legend()
    return sheet.drawing()


def grid_map(
    designs: pd.DataFrame, axes: tuple[Axis, ...], measured: tuple[Column, ...]
) -> Drawing:
    """Some measures of the designs of a grid over the first two parameters; a column per value of
    the third."""
    by_name = {column.name: column for column in (*measured, PEAK_FORCE)}
    across, up, *third = axes
    columns = {} if third else {"": designs}
    for axis in third:
        count = min(_MOST_MAPS, len(axis.values))
        for index in np.linspace(0, len(axis.values) - 1, count).round().astype(int):
            title = f"{format_parameter(axis.key)} {format_value(axis, axis.values[index])}"
            columns[title] = designs[designs[axis.key] == axis.values[index]]
    height = 0.6 + len(_MAPPED) * (1.3 + 0.13 * len(up.values))
    with plot.matplotlib_style():
        sheet = Sheet(height, len(_MAPPED), len(columns))
        for row, name in enumerate(_MAPPED):
            quantity, factor = measure_quantity(by_name[name])
            low, high = factor * designs[name].min(), factor * designs[name].max()
            norm = LogNorm(low, high) if 0.0 < 10.0 * low < high else Normalize(low, high)
            panels = []
            for column, (title, part) in enumerate(columns.items()):
                labels = (parameter_quantity(axis)[0] for axis in (across, up))
                panel = sheet.panel((row, column), "" if row else title, *labels)
                grid = part.pivot(index=up.key, columns=across.key, values=name)
                grid = grid.reindex(index=up.values, columns=across.values).to_numpy(dtype=float)
                panel.axes.grid(False)
                y, x = np.indices(grid.shape)
                drawn = panel.axes.pcolormesh(x, y, factor * grid, norm=norm, cmap="viridis")
                unit = {"value_quantity": quantity.name, "value_unit": quantity.unit}
                values = factor * grid.ravel()
                panel.record(quantity.name, x.ravel(), y.ravel(), value=values, **unit)
                set_scale(panel, "x", across)
                set_scale(panel, "y", up)
                panels.append(panel.axes)
            sheet.figure.colorbar(drawn, ax=panels, label=fill(quantity.label, 28))
    return sheet.drawing()
