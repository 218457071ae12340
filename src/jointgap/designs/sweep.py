"""Page, figures, labels and MLflow metrics of a sweep."""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize

from jointgap.config import Scenario
from jointgap.config.designs import ALL_MEASURES
from jointgap.core import parquet, plot
from jointgap.core.page import FigureBlock, Page, Paragraph, TableBlock
from jointgap.core.plot import Drawing, Panel, Quantity, Sheet
from jointgap.core.publish import name_and_factor
from jointgap.core.words import format_name, format_unit, joined, number, reading_unit
from jointgap.designs.dataset import checked_dataset, failures
from jointgap.designs.sampling import Axis, Designs

_COLUMNS = {column.name: column for column in ALL_MEASURES}
_WORDS = {
    "speed": "crank speed",
    "window_start": "start of the window",
    "window_end": "end of the window",
    "error_measure": "error measure",
    "revolution": "revolution counted",
    "stiffness": "stiffness of the contacts",
    "rms": "RMS",
}
_UNITS = {"stiffness": "N/mⁿ"}  # depends on the exponent
_LEFT_OUT = ("mechanism", "simulate", "joints", "contact")
"""Parts of a path that its label omits."""


def format_measure(name: str) -> str:
    """``RMS of the normal force in the crank pin``."""
    return _COLUMNS[name].description.partition(";")[0]


def measure_quantity(name: str) -> tuple[Quantity, float]:
    """Axis of a measure, and its number of axis units per SI unit."""
    return _quantity(format_measure(name), _COLUMNS[name].unit)


def format_parameter(key: str) -> str:
    """``crank pin journal`` of ``mechanism.joints.crank_pin.journal``."""
    return _WORDS.get(key) or format_name(
        " ".join(part for part in key.split(".") if part not in _LEFT_OUT)
    )


def parameter_quantity(axis: Axis) -> tuple[Quantity, float]:
    """Axis of a parameter, and its number of axis units per SI unit."""
    unit = _UNITS.get(axis.key, axis.unit)
    return _quantity(format_parameter(axis.key), unit if axis.column.kind == "float" else "")


def _quantity(words: str, unit: str) -> tuple[Quantity, float]:
    shown, factor = reading_unit(unit)
    return Quantity(words, format_unit(shown)), factor


def format_value(axis: Axis, value: Any, with_unit: bool = True) -> str:
    """A formatted `value` of a parameter: ``70.1 deg``, ``rod``."""
    if isinstance(value, str | bool):
        return _WORDS.get(str(value)) or format_name(str(value))
    unit, factor = reading_unit(axis.unit)
    return (
        f"{number(factor * value, 3)} {format_unit(unit)}".strip()
        if with_unit
        else number(factor * value)
    )


_MOST_TICKS = 8  # labels of a list
_MOST_DOTS = 4000  # per panel
_GROUP, _MOST_GROUPS = 25, 20  # designs per median, and medians per parameter
_JITTER = 0.3  # over the distance between values of a list, to both sides


def places(axis: Axis, values: Any) -> np.ndarray:
    """Coordinates of parameter `values`: 0, 1, 2, ... for a list, in the axis unit for a range."""
    if axis.values is not None:
        return pd.Index(axis.values).get_indexer(values).astype(float)
    return parameter_quantity(axis)[1] * np.asarray(values, dtype=float)


def scale(panel: Panel, side: str, axis: Axis) -> None:
    """Scale and ticks of one axis: values of a list, or numbers; logarithmic for a log-uniform
    range."""
    drawn = getattr(panel.axes, f"{side}axis")
    if axis.values is not None:
        some = slice(None, None, -(-len(axis.values) // _MOST_TICKS))
        texts = [format_value(axis, value, False) for value in axis.values[some]]
        drawn.set_ticks(range(len(axis.values))[some], texts)
    elif axis.law.dist.name == "loguniform":
        getattr(panel.axes, f"set_{side}scale")("log")
        plot.label_log_ticks(drawn, *axis.law.support())
    else:
        panel.axes.locator_params(side, nbins=4)


def parameter_panels(axes: Sequence[Axis], quantity: Quantity) -> Sheet:
    """A sheet with a panel of `quantity` over each parameter."""
    columns = min(3, len(axes))
    rows = -(-len(axes) // columns)
    sheet = Sheet(0.8 + 2.1 * rows, rows, columns)
    for place, axis in enumerate(axes):
        panel = sheet.panel(divmod(place, columns), "", parameter_quantity(axis)[0], quantity)
        panel.axes.set_ylabel("" if place % columns else fill(quantity.label, 30))
        scale(panel, "x", axis)
    return sheet


def measure_over_parameters(designs: pd.DataFrame, axes: tuple[Axis, ...], name: str) -> Drawing:
    """A measure of the designs over each parameter."""
    shown = designs[np.isfinite(designs[name].to_numpy(dtype=float))]
    quantity, factor = (_MAPPED[name], 1.0) if name in _MAPPED else measure_quantity(name)
    values = factor * shown[name].to_numpy(dtype=float)
    with plot.matplotlib_style():
        sheet = parameter_panels(axes, quantity)
        for panel, axis in zip(sheet.panels, axes, strict=True):
            x = places(axis, shown[axis.key])
            if axis.values is None:
                groups = np.array_split(np.argsort(x), max(1, min(_MOST_GROUPS, len(x) // _GROUP)))
            else:
                groups = [np.flatnonzero(x == place) for place in range(len(axis.values))]
                # deterministic jitter, even in the order of the designs
                x = x + _JITTER * (2.0 * np.modf(np.arange(len(x)) * 0.6180339887)[0] - 1.0)
            some = slice(None, None, max(1, -(-len(x) // _MOST_DOTS)))
            panel.marks(
                "design",
                x[some],
                values[some],
                "simulation",
                markersize=2.2,
                alpha=0.5,
                markeredgewidth=0.0,
            )
            middles = np.array(
                [(np.median(x[group]), np.median(values[group])) for group in groups if len(group)]
            )
            panel.marks("median", *middles.reshape(-1, 2).T, "network", marker="_", markersize=12.0)
        sheet.legend()
    return sheet.drawing()


MAP, FORCES = "map", "forces"
"""Figures: of a sweep on a grid of two or three parameters, and of other sweeps."""

_MAPPED = {
    "angle_error_rms": Quantity("RMS error of the transmission angle", "deg"),
    "peak_force": Quantity("largest force in the joints", "N"),
    "noise_share": Quantity("share of the slider's acceleration above order 10", "1"),
}
_MOST_MAPS = 3  # values of the third parameter


def has_map(designs: Designs) -> bool:
    return designs.sweep.design == "grid" and len(designs.axes) in (2, 3)


def with_largest_force(designs: Designs, dataset: Path) -> pd.DataFrame:
    """All designs, with the largest force in any joint (NaN without clearance)."""
    names = [*(axis.key for axis in designs.axes), *(column.name for column in designs.measured)]
    frame = parquet.read_columns(dataset, names).to_pandas()
    return frame.assign(peak_force=frame.filter(like="_peak_force").max(axis=1).astype(float))


def draw(designs: Designs, frame: pd.DataFrame) -> Iterator[tuple[str, Drawing]]:
    """The figure of the designs in `frame`, of `with_largest_force`."""
    if has_map(designs):
        yield MAP, grid_map(frame, designs.axes)
    elif frame["peak_force"].notna().any():
        yield FORCES, measure_over_parameters(frame, designs.axes, "peak_force")


def grid_map(designs: pd.DataFrame, axes: tuple[Axis, ...]) -> Drawing:
    """Measures of the designs of a grid over the first two parameters; a column per value of the
    third."""
    across, up, *third = axes
    shown = designs.assign(angle_error_rms=np.degrees(designs["angle_error_rms"]))
    columns = {"": shown}
    if third:
        (axis,) = third
        chosen = np.unique(np.linspace(0, len(axis.values) - 1, _MOST_MAPS).round().astype(int))
        columns = {
            f"{format_parameter(axis.key)} {format_value(axis, value)}": shown[
                shown[axis.key] == value
            ]
            for value in (axis.values[place] for place in chosen)
        }
    with plot.matplotlib_style():
        sheet = Sheet(
            0.6 + len(_MAPPED) * (1.3 + 0.13 * len(up.values)), len(_MAPPED), len(columns)
        )
        for row, (name, quantity) in enumerate(_MAPPED.items()):
            low, high = shown[name].min(), shown[name].max()
            norm = LogNorm(low, high) if 0.0 < 10.0 * low < high else Normalize(low, high)
            panels = []
            for column, (title, own) in enumerate(columns.items()):
                labels = (parameter_quantity(axis)[0] for axis in (across, up))
                panel = sheet.panel((row, column), "" if row else title, *labels)
                grid = own.pivot(index=up.key, columns=across.key, values=name)
                grid = grid.reindex(index=up.values, columns=across.values).to_numpy(dtype=float)
                cells_of = range(len(across.values)), range(len(up.values))
                drawn = cells(panel, quantity.name, *cells_of, grid, quantity, norm=norm)
                scale(panel, "x", across)
                scale(panel, "y", up)
                panels.append(panel.axes)
            sheet.figure.colorbar(drawn, ax=panels, label=fill(quantity.label, 28))
    return sheet.drawing()


def cells(
    panel: Panel, series: str, x: Any, y: Any, value: np.ndarray, quantity: Quantity, **style: Any
) -> Any:
    """Coloured cells of a `value` (len(y), len(x)) around the points `x` and `y`; returns the
    colour bar's artist."""
    panel.axes.grid(False)
    columns = {"value": value.ravel(), "value_quantity": quantity.name, "value_unit": quantity.unit}
    panel.record(series, *map(np.ravel, np.meshgrid(x, y)), **columns)
    return panel.axes.pcolormesh(x, y, value, cmap="viridis", shading="nearest", **style)


_KINDS = {
    "sobol": "sampled by a scrambled Sobol sequence",
    "latin_hypercube": "sampled by a Latin hypercube",
    "grid": "on a grid",
}
_MOST_DIGITS = 8


def page(designs: Designs, dataset: Path, frame: pd.DataFrame) -> Page:
    failed, kind = failures(dataset), designs.sweep.design
    introduction = (
        f"{designs.number} designs {_KINDS[kind]}"
        + ("" if kind == "grid" else f", seed {designs.sweep.seed}")
        + f". Varied: {joined(format_parameter(axis.key) for axis in designs.axes)}; otherwise as"
        f" in the mechanism. Designs that failed: {sum(failed.values()) or 'none'}"
        + (
            "."
            if not failed
            else ": " + "; ".join(f"{count} x {why}" for why, count in failed.most_common(5)) + "."
        )
    )
    measured = (
        "Over all simulated designs: smallest, 5 %, median, 95 % and largest value. Measures refer"
        " to the last revolution unless stated otherwise."
    )
    files = (
        "All designs: the Parquet files in `designs`, one table for `pandas.read_parquet`, polars"
        " or duckdb; `jointgap describe` explains the columns."
    )
    rows = (
        _row(format_measure(c.name), c.unit, _column(dataset, c.name)) for c in designs.measured
    )
    heads = ("measure", "unit", "smallest", "5 %", "median", "95 %", "largest")
    has_force = frame["peak_force"].notna().any()
    figure = [FigureBlock(MAP, "Map of the grid")] if has_map(designs) else []
    if not figure and has_force:
        figure = [
            FigureBlock(
                FORCES, "Largest force in the joints", "One point per design; bars: medians."
            )
        ]
    blocks = (
        *([Paragraph(_extremes(designs.axes, frame), strong=True)] if has_force else ()),
        *figure,
        Paragraph(introduction),
        parameter_table(designs.axes, lambda key: _column(dataset, key)),
        Paragraph(measured),
        TableBlock(heads, tuple(filter(None, rows)), "llrrrrr"),
        Paragraph(files),
    )
    return Page("Sweep", blocks)


def _extremes(axes: tuple[Axis, ...], frame: pd.DataFrame) -> str:
    """Smallest and largest of the largest forces, with their designs."""
    force, texts = frame["peak_force"], []
    for row in (frame.loc[force.idxmin()], frame.loc[force.idxmax()]):
        where = joined(
            f"{format_parameter(axis.key)} {format_value(axis, row[axis.key])}" for axis in axes
        )
        texts.append(f"{row['peak_force']:.4g} N ({where})")
    return f"The largest force in the joints is {texts[0]} to {texts[1]}."


def parameter_table(axes: tuple[Axis, ...], values_of: Callable[[str], pd.Series]) -> TableBlock:
    """Ranges of the parameters."""
    rows = []
    for axis in axes:
        words, values = format_parameter(axis.key), values_of(axis.key)
        if axis.column.kind == "float":
            rows.append(_row(words, axis.unit, values, (0.0, 0.5, 1.0)))
        else:
            rows.append((words, "", ", ".join(sorted(map(str, values.unique()))), "", ""))
    return TableBlock(("parameter", "unit", "smallest", "median", "largest"), tuple(rows), "llrrr")


def _column(dataset: Path, name: str) -> pd.Series:
    return parquet.read_columns(dataset, [name])[name].to_pandas()


def _row(
    words: str,
    unit: str,
    values: pd.Series,
    shares: tuple[float, ...] = (0.0, 0.05, 0.5, 0.95, 1.0),
) -> tuple | None:
    """Quantiles with four digits, or with more where they hardly differ."""
    numbers = values.to_numpy(dtype=float)
    numbers = numbers[np.isfinite(numbers)]
    if not len(numbers):
        return None
    unit, factor = reading_unit(unit or "1")
    shown = np.quantile(factor * numbers, shares)
    largest, spread = np.max(np.abs(shown)), np.ptp(shown)
    digits = min(max(4, math.ceil(math.log10(largest / spread)) + 2), _MOST_DIGITS) if spread else 4
    texts = (f"{value:.0f}" if abs(value) >= 1e4 else f"{value:.{digits}g}" for value in shown)
    return words, format_unit(unit), *texts


_PUBLISHED = {
    "smallest": 0.0,
    "quantile_05": 0.05,
    "median": 0.5,
    "quantile_95": 0.95,
    "largest": 1.0,
}


def metrics(scenario: Scenario, folder: Path) -> dict[str, float]:
    """Numbers of designs and failures, and mean, deviation and quantiles of each measure, for
    MLflow."""
    dataset = folder / "sweep/designs"
    designs = checked_dataset(scenario, dataset)
    reasons = _column(dataset, "reason")
    found = {
        "designs": len(reasons),
        "failed": reasons.count(),
        "failed_percent": 100 * reasons.notna().mean(),
    }
    for column in designs.measured:
        name, factor = name_and_factor(column)
        values = factor * _column(dataset, column.name).dropna()
        if len(values):
            sizes = {"mean": values.mean(), "deviation": values.std(ddof=0), "counted": len(values)}
            sizes |= dict(zip(_PUBLISHED, values.quantile(list(_PUBLISHED.values())), strict=True))
            found |= {f"{name}/{size}": value for size, value in sizes.items()}
    return found
