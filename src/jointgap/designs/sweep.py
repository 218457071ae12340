"""The study of a sweep: ranges of the measures, and a figure over the parameters."""

from pathlib import Path

import pandas as pd

from jointgap.core.facts import Fact
from jointgap.core.page import FigureBlock
from jointgap.core.publish import name_and_factor
from jointgap.core.schema import Column
from jointgap.core.words import joined
from jointgap.designs.dataset import failures, read_designs
from jointgap.designs.figures import (
    PEAK_FORCE,
    format_measure,
    format_parameter,
    format_value,
    grid_map,
    measure_over_parameters,
    parameter_table,
)
from jointgap.designs.sampling import Designs
from jointgap.designs.study import Figures, Study, fact_table, metric

_DESIGN_KINDS = {
    "sobol": "sampled by a scrambled Sobol sequence",
    "latin_hypercube": "sampled by a Latin hypercube",
    "grid": "on a grid",
}
_QUANTILES = {
    "smallest": 0.0,
    "quantile_05": 0.05,
    "median": 0.5,
    "quantile_95": 0.95,
    "largest": 1.0,
}
_HEADS = {"quantile_05": "5 %", "quantile_95": "95 %"}


def sweep_study(designs: Designs, dataset: Path) -> Study:
    """The study of all designs in a `dataset`."""
    measures = [column.name for column in designs.measured]
    keys = [axis.key for axis in designs.axes]
    frame = read_designs(designs, dataset, *keys, *measures, "reason")
    # NaN without clearance
    peak_force = frame.filter(like="_peak_force").max(axis=1).astype(float)
    frame = frame.assign(**{PEAK_FORCE.name: peak_force})
    failed = int(frame["reason"].count())
    facts = [
        Fact("designs", len(frame), sentence=_extreme_forces(designs, frame)),
        Fact("failed", failed),
        Fact("failed_percent", 100.0 * failed / len(frame), "%"),
    ]
    cells = []
    for column in designs.measured:
        of_measure = _measure_facts(column, frame[column.name].dropna().astype(float))
        facts += of_measure.values()
        for quantile in _QUANTILES if of_measure else ():
            fact = of_measure[quantile]
            label = f"{fact.label} [{fact.unit}]" if fact.unit else fact.label
            cells.append((label, _HEADS.get(quantile, quantile), fact))
    caption = "Measures of all simulated designs, of the last revolution unless stated otherwise"
    return Study(
        "Sweep",
        facts,
        _introduction(designs, dataset, failed),
        (parameter_table(designs.axes, frame), fact_table(cells, caption)),
        "All designs: the Parquet files in `designs`, one table for `pandas.read_parquet`, polars"
        " or duckdb; `jointgap describe` explains the columns.",
        _figures(designs, frame),
    )


def _measure_facts(column: Column, values: pd.Series) -> dict[str, Fact]:
    """Mean, deviation and quantiles of a measure; none without values."""
    if not len(values):
        return {}
    name, factor = name_and_factor(column)
    unit = "" if column.unit == "1" else metric(column)[2]
    values = factor * values
    numbers = {"mean": values.mean(), "deviation": values.std(ddof=0)}
    numbers |= dict(zip(_QUANTILES, values.quantile(list(_QUANTILES.values())), strict=True))
    label = format_measure(column)
    facts = {
        statistic: Fact(f"{name}/{statistic}", float(value), unit, label)
        for statistic, value in numbers.items()
    }
    return facts | {"counted": Fact(f"{name}/counted", len(values))}


def _introduction(designs: Designs, dataset: Path, failed: int) -> str:
    sweep = designs.sweep
    seed = "" if sweep.design == "grid" else f", seed {sweep.seed}"
    starts = f", {sweep.starts} starts each (medians over the starts)" if sweep.starts > 1 else ""
    varied = joined(format_parameter(axis.key) for axis in designs.axes)
    reasons = [f"{count} x {why}" for why, count in failures(dataset).most_common(5)]
    return (
        f"{designs.number} designs {_DESIGN_KINDS[sweep.design]}{seed}{starts}. Varied: {varied};"
        f" otherwise as in the mechanism. Designs that failed: {failed or 'none'}"
        f"{': ' if reasons else ''}{'; '.join(reasons)}."
    )


def _extreme_forces(designs: Designs, frame: pd.DataFrame) -> str:
    """Smallest and largest of the largest forces, with their designs."""
    force = frame[PEAK_FORCE.name]
    if not force.notna().any():
        return ""
    texts = []
    for row in (frame.loc[force.idxmin()], frame.loc[force.idxmax()]):
        values = joined(
            f"{format_parameter(axis.key)} {format_value(axis, row[axis.key])}"
            for axis in designs.axes
        )
        texts.append(f"{row[PEAK_FORCE.name]:.4g} N ({values})")
    return f"The largest force in the joints is {texts[0]} to {texts[1]}."


def _figures(designs: Designs, frame: pd.DataFrame) -> Figures:
    axes = designs.axes
    if designs.sweep.design == "grid" and len(axes) in (2, 3):
        block = FigureBlock("map", "Map of the grid")
        return {block: lambda: grid_map(frame, axes, designs.measured)}
    if frame[PEAK_FORCE.name].isna().all():
        return {}
    title, caption = "Largest force in the joints", "One point per design; bars: medians."
    block = FigureBlock("forces", title, caption)
    return {block: lambda: measure_over_parameters(frame, axes, PEAK_FORCE)}
