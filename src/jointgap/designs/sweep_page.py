"""A sweep in plain words: how many designs, what failed, and how far each measure ranges."""

import math
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow.compute as pc

from jointgap import tables
from jointgap.core.page import FigureBlock, Page, Paragraph, TableBlock
from jointgap.core.words import joined, reading_unit, unit_in_words
from jointgap.designs.design_of_experiments import SOURCE, Axis, Designs
from jointgap.designs.sweep_figures import MAP, has_map
from jointgap.designs.words_of_designs import measure_in_words, parameter_in_words
from jointgap.tables.columns import Column

_KINDS = {
    "sobol": "drawn as a scrambled Sobol sequence",
    "latin_hypercube": "drawn as a Latin hypercube",
    "grid": "on a grid",
}
_NUMBER = re.compile(r"[-+]?[0-9][-+.0-9e]*")
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
    blocks = (
        Paragraph(introduction),
        TableBlock(("parameter", "unit", "smallest", "median", "largest"), _parameters(designs.axes, dataset), "llrrr"),
        *([FigureBlock(MAP, "Map of the grid")] if has_map(designs.kind, designs.axes) else ()),
        Paragraph(measured),
        TableBlock(
            ("measure", "unit", "smallest", "5 %", "median", "95 %", "largest"), _measures(designs, dataset), "llrrrrr"
        ),
        Paragraph(files),
    )
    return Page("Sweep", blocks)


def failures(dataset: Path) -> Counter[str]:
    """How many designs of a `dataset` failed, by the reason without what differs from design to design."""
    reasons = tables.read_columns(dataset, ["reason"])["reason"]
    return Counter(_kind_of(reason) for reason in reasons.drop_null().to_pylist())


def _kind_of(reason: str) -> str:
    """A reason without what differs from design to design: its values and numbers."""
    told = reason.partition(": ")[2] if reason.startswith(SOURCE) else reason
    return _NUMBER.sub("...", told).partition("; ")[0]


def _parameters(axes: tuple[Axis, ...], dataset: Path) -> tuple:
    rows = []
    for axis in axes:
        values = tables.read_columns(dataset, [axis.key])[axis.key]
        if axis.column.kind != "float":
            words = sorted(map(str, pc.unique(values).to_pylist()))
            rows.append((parameter_in_words(axis.key), "", ", ".join(words), "", ""))
            continue
        unit, factor = reading_unit(axis.unit or "1")
        rows.append(
            (parameter_in_words(axis.key), unit_in_words(unit), *_numbers(factor * values.to_numpy(), (0.0, 0.5, 1.0)))
        )
    return tuple(rows)


def _measures(designs: Designs, dataset: Path) -> tuple:
    return tuple(row for column in designs.measured if (row := _measure(column, dataset)))


def _measure(column: Column, dataset: Path) -> tuple | None:
    values = tables.read_columns(dataset, [column.name])[column.name].to_numpy()
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
