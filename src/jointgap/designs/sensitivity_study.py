"""The study of the sensitivities of a sweep: tables, figures and facts."""

from collections import Counter
from functools import partial
from textwrap import fill

import numpy as np
import pandas as pd

from jointgap.core import plot
from jointgap.core.facts import Fact
from jointgap.core.page import FigureBlock, TableBlock
from jointgap.core.plot import COLOURS, Drawing, Quantity, Sheet
from jointgap.core.schema import (
    SENSITIVITY_EFFECTS,
    SENSITIVITY_INDICES,
    SENSITIVITY_SURROGATES,
)
from jointgap.core.words import joined
from jointgap.designs.figures import (
    format_measure,
    format_parameter,
    format_value,
    measure_quantity,
    parameter_panels,
    positions,
)
from jointgap.designs.sensitivity import ENDS, MIN_Q2, SensitivityResult, curve_values
from jointgap.designs.study import Figures, Study, fact_table

FIGURES = "figures"
"""Folder of the figures, in that of the study."""

_MIN_SHARE = 0.01  # smallest total index whose main effect is drawn
_COLUMNS = 3  # panels in a row
_BARS = {
    "first_order": ("alone (first order)", "simulation", 0.2),
    "total": ("with others (total)", "sky", -0.2),
}
"""By index: label, colour and vertical offset."""

_METHOD = (
    "Surrogate of each measure: polynomial chaos expansion (OpenTURNS), tested on randomly"
    " held-out designs. Q2 is 1 minus the mean squared test error over the variance; below"
    f" {MIN_Q2:g} no indices are given. First order: share of the variance due to a parameter"
    " alone; total: including interactions. Intervals: 90 %, including the surrogate's error. Main"
    f" effects: mean for a fixed parameter, for parameters with a total index of {_MIN_SHARE:g} or"
    " more. All numbers: `indices.parquet`, `surrogates.parquet` and `main_effects.parquet`;"
    " `jointgap describe` explains their columns."
)
_WITHOUT_INDICES = (
    " For more indices simulate more designs (a larger `sweep.number` keeps existing ones), or use"
    " narrower ranges. If this does not help, the motion is not reproducible: set `sweep.starts` to"
    " 15, so that medians over the starts are compared."
)


def sensitivity_study(result: SensitivityResult) -> Study:
    """The study of the sensitivities."""
    measures = list(dict.fromkeys(result.indices["measure"]))
    facts = _facts(result)
    cells = []
    for measure in measures:
        label, ranked = format_measure(result.columns[measure]), result.ranked(measure)
        for parameter in (axis.key for axis in result.axes):
            fact = facts[f"total/{measure} by {parameter}"]
            cells.append((label, format_parameter(parameter), fact))
        order = "significant" if _is_significant(ranked) else "not significant"
        cells += [(label, "order", order), (label, "Q2", facts[f"q2/{measure}"])]
    # measures without any value, such as impacts of an ideal joint, are omitted
    missing = result.surrogates.dropna(subset=["reason", "mean"])
    tables = [fact_table(cells, "Total indices of the parameters, and Q2", digits=2)]
    if len(missing):
        labels = (format_measure(result.columns[measure]) for measure in missing["measure"])
        rows = zip(labels, missing["reason"], strict=True)
        tables.append(TableBlock(("measure", "reason"), tuple(rows), "ll", "No indices"))
    headline = Fact("measures_with_indices", len(measures), sentence=_headline(result, measures))
    return Study(
        "Sensitivity",
        [headline, *facts.values()],
        f"From {result.number} designs of the sweep, of which {result.failed or 'none'} failed.",
        tuple(tables if measures else tables[1:]),
        _METHOD + (_WITHOUT_INDICES if len(missing) else ""),
        _figures(result, measures),
        {
            SENSITIVITY_SURROGATES: result.surrogates,
            SENSITIVITY_INDICES: result.indices,
            SENSITIVITY_EFFECTS: result.effects,
        },
    )


def _facts(result: SensitivityResult) -> dict[str, Fact]:
    """Q2 of each surrogate and indices, and the ends of their intervals, by name."""
    by_name = {f"q2/{row['measure']}": (row, "q2") for row in result.surrogates.to_dict("records")}
    for row in result.indices.to_dict("records"):
        for index in _BARS:
            by_name[f"{index}/{row['measure']} by {row['parameter']}"] = (row, index)
    facts = {}
    for name, (row, key) in by_name.items():
        if pd.notna(row[key]):
            value, low, high = (float(row[key + end]) for end in ENDS)
            facts[name] = Fact(name, value, low=low, high=high)
            for end, bound in (("_low", low), ("_high", high)):
                facts[name + end] = Fact(name + end, bound)
    return facts


def _is_significant(ranked: pd.DataFrame) -> bool:
    """Whether the interval of the largest total index lies above that of the second."""
    return len(ranked) < 2 or ranked["total_low"].iloc[0] > ranked["total_high"].iloc[1]


def _headline(result: SensitivityResult, measures: list[str]) -> str:
    number = int(result.surrogates["mean"].notna().sum())
    if not measures:
        return f"No indices: none of the {number} measures has an accurate surrogate."
    ranked = [result.ranked(measure) for measure in measures]
    counts = Counter(format_parameter(rows["parameter"].iloc[0]) for rows in ranked)
    (parameter, most), *further = counts.most_common()
    further_counts = joined(f"{words} for {count}" for words, count in further)
    missing = number - len(measures)
    return (
        f"{parameter[0].upper()}{parameter[1:]} has the largest total index for {most} of"
        f" {len(measures)} measures{', ' if further else ''}{further_counts}; significant for"
        f" {sum(map(_is_significant, ranked))}."
        + (f" {missing} measures have no indices." if missing else "")
    )


def _figures(result: SensitivityResult, measures: list[str]) -> Figures:
    if not measures:
        return {}
    indices = FigureBlock(f"{FIGURES}/indices", "Sobol indices of all measures")
    figures = {indices: partial(_draw_indices, result, measures)}
    for measure in measures:
        title = f"Main effects: {format_measure(result.columns[measure])}"
        block = FigureBlock(f"{FIGURES}/main_effects_{measure}", title)
        figures[block] = partial(_draw_main_effects, result, measure)
    return figures


def _draw_indices(result: SensitivityResult, measures: list[str]) -> Drawing:
    """Bars of both indices with their intervals: a panel per measure, a row per parameter."""
    titles = [fill(format_measure(result.columns[measure]), 31) for measure in measures]
    keys = [axis.key for axis in result.axes]
    labels = [format_parameter(key) for key in keys]
    columns = min(_COLUMNS, len(measures))
    rows, lines = -(-len(measures) // columns), max(title.count("\n") + 1 for title in titles)
    sheet = Sheet(0.8 + rows * (0.25 + 0.15 * lines + 0.24 * len(keys)), rows, columns)
    y, share = np.arange(len(keys))[::-1], Quantity("share of the variance", "1")
    for number, (measure, title) in enumerate(zip(measures, titles, strict=True)):
        panel = sheet.panel(divmod(number, columns), title, share, Quantity("", ""))
        panel.axes.set_title(title, fontsize=8.0)
        of_measure = result.indices[result.indices["measure"] == measure]
        for index, (words, colour, offset) in _BARS.items():
            values, low, high = (of_measure[index + end].to_numpy() for end in ENDS)
            panel.axes.barh(y + offset, values, 0.38, color=COLOURS[colour], label=words)
            panel.axes.hlines(y + offset, low, high, color=plot.INK, linewidth=0.9)
            panel.record(words, values, y + offset, low=low, high=high, label=keys)
        panel.rows(labels if number % columns == 0 else [""] * len(keys), y)
        panel.axes.set_xlim(0.0, 1.0)
        panel.axes.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
        if number + columns < len(measures):
            panel.axes.set_xlabel("")
    sheet.legend()
    return sheet.drawing()


def _draw_main_effects(result: SensitivityResult, measure: str) -> Drawing:
    """Mean of a measure over each relevant parameter, on a common scale."""
    ranked = result.ranked(measure)
    quantity, factor = measure_quantity(result.columns[measure])
    by_key = {axis.key: axis for axis in result.axes}
    axes = [by_key[key] for key in ranked["parameter"][ranked["total"] >= _MIN_SHARE]]
    curves = result.effects[result.effects["measure"] == measure]
    sheet = parameter_panels(axes, quantity)
    for panel, axis in zip(sheet.panels, axes, strict=True):
        curve, x = curves[curves["parameter"] == axis.key], positions(axis, curve_values(axis))
        effect, low, high = (factor * curve[f"effect{end}"].to_numpy() for end in ENDS)
        if axis.values is not None:
            labels = [format_value(axis, value, with_unit=False) for value in axis.values]
            panel.marks("mean", x, effect, "simulation", low=low, high=high, labels=labels)
        else:
            panel.line("mean", x, effect, "simulation")
            colour = COLOURS["simulation"]
            panel.axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0.0)
            panel.record("interval", x, effect, low=low, high=high)
    limits = [panel.axes.get_ylim() for panel in sheet.panels]
    for panel in sheet.panels:
        panel.axes.set_ylim(np.min(limits), np.max(limits))
    return sheet.drawing()
