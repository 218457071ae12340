"""Figures of what decides: indices, main effects, and the map of the two parameters that decide most."""

import textwrap
from collections.abc import Iterator

import numpy as np
import pandas as pd
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from jointgap.core import plot
from jointgap.core.plot import COLOURS, Drawing, Panel, Quantity, Sheet, tick_label
from jointgap.designs.sensitivity_indices import SensitivityResult, conditional_terms
from jointgap.designs.sensitivity_inputs import Input
from jointgap.designs.sensitivity_settings import SETTINGS
from jointgap.designs.words_of_designs import (
    measure_in_words,
    measure_quantity,
    parameter_in_words,
    parameter_quantity,
)

INDICES, EFFECTS, MAP = "indices", "main_effects", "map"
"""Names of the figures; those of a measure are ``main_effects_<measure>`` and ``map_<measure>``."""

_IN_A_ROW = 3
_BARS = {"first_order": ("alone (first order)", "simulation", 0.2), "total": ("with others (total)", "sky", -0.2)}
"""By index: its words, colour and place beside the parameter's name."""

_STEPS = (1, 2, 5, 10)
_ROUND_STEPS = MaxNLocator(12, steps=_STEPS)


def draw(found: SensitivityResult) -> Iterator[tuple[str, Drawing]]:
    """All figures with their names, one at a time; none where no measure has indices."""
    if not found.good:
        return
    with plot.matplotlib_style():
        yield INDICES, _indices(found)
        for measure in found.good:
            yield f"{EFFECTS}_{measure}", _main_effects(found, measure)
            if len(found.inputs.each) > 1:
                yield f"{MAP}_{measure}", _map(found, measure)


def of_measure(found: SensitivityResult, measure: str) -> pd.DataFrame:
    """Rows of `measure` in the table of indices, those of the largest total index first."""
    own = found.indices[found.indices["measure"] == measure]
    return own.sort_values("total", ascending=False, kind="stable")


def _indices(found: SensitivityResult) -> Drawing:
    """Bars of both indices with their intervals, a panel a measure, a row a parameter."""
    measures = list(found.good)
    keys = [one.axis.key for one in found.inputs.each]
    columns = min(_IN_A_ROW, len(measures))
    rows = -(-len(measures) // columns)
    titles = [textwrap.fill(measure_in_words(measure), 31) for measure in measures]
    lines = max(title.count("\n") + 1 for title in titles)
    sheet = Sheet(0.8 + rows * (0.25 + 0.15 * lines + 0.24 * len(keys)), rows, columns)
    places = np.arange(len(keys))[::-1]
    share = Quantity("share of the variance", "1")
    for number, (measure, title) in enumerate(zip(measures, titles, strict=True)):
        panel = sheet.panel(divmod(number, columns), title, share, Quantity("", ""))
        panel.axes.set_title(title, fontsize=8.0)
        own = found.indices[found.indices["measure"] == measure].set_index("parameter").loc[keys]
        for index, (words, colour, beside) in _BARS.items():
            values, low, high = (own[index + end].to_numpy() for end in ("", "_low", "_high"))
            at = places + beside
            panel.axes.barh(at, values, 0.38, color=COLOURS[colour], label=words)
            panel.axes.hlines(at, low, high, color=plot.INK, linewidth=0.9)
            panel.record(words, values, at, low=low, high=high, label=keys)
        shown = number % columns == 0
        panel.rows([parameter_in_words(key) if shown else "" for key in keys], places)
        panel.axes.set_xlim(0.0, 1.0)
        panel.axes.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
        if number + columns < len(measures):
            panel.axes.set_xlabel("")
    sheet.legend()
    return sheet.drawing()


def _main_effects(found: SensitivityResult, measure: str) -> Drawing:
    """Mean of a measure over each parameter that takes part, on one scale."""
    ranked = of_measure(found, measure)
    keys = list(ranked["parameter"][ranked["total"] >= SETTINGS.shown_share])
    by_key = {one.axis.key: one for one in found.inputs.each}
    columns = min(_IN_A_ROW, len(keys))
    rows = -(-len(keys) // columns)
    quantity, factor = measure_quantity(measure)
    sheet = Sheet(0.5 + 2.1 * rows, rows, columns)
    label = textwrap.fill(quantity.label, 30)
    curves = found.effects[found.effects["measure"] == measure]
    shown = curves[curves["parameter"].isin(keys)]
    low, high = factor * shown["effect_low"].min(), factor * shown["effect_high"].max()
    for number, key in enumerate(keys):
        one, own = by_key[key], curves[curves["parameter"] == key]
        panel = sheet.panel(divmod(number, columns), parameter_in_words(key), parameter_quantity(one.axis)[0], quantity)
        effect, lower, upper = (factor * own[f"effect{end}"].to_numpy() for end in ("", "_low", "_high"))
        if one.axis.values is not None:
            places = np.arange(len(own))
            panel.marks("mean", places, effect, "simulation", low=lower, high=upper, labels=_texts(one))
            _listed(panel.axes.xaxis, one)
            panel.axes.set_xlim(-0.5, len(own) - 0.5)
        else:
            values = parameter_quantity(one.axis)[1] * own["value"].to_numpy()
            panel.line("mean", values, effect, "simulation")
            panel.axes.fill_between(values, lower, upper, color=COLOURS["simulation"], alpha=0.2, linewidth=0.0)
            panel.record("interval", values, effect, low=lower, high=upper)
            _ranged(panel, "x", one, values)
        panel.axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
        panel.axes.yaxis.set_major_locator(MaxNLocator(5, steps=_STEPS))
        panel.axes.set_ylabel(label if number % columns == 0 else "")
    return sheet.drawing()


def _map(found: SensitivityResult, measure: str) -> Drawing:
    """Mean of a measure over the two parameters of the largest total indices."""
    keys = list(of_measure(found, measure)["parameter"][:2])
    by_key = {one.axis.key: place for place, one in enumerate(found.inputs.each)}
    places = [by_key[key] for key in keys]
    across, up = (found.inputs.each[place] for place in places)
    quantity, factor = measure_quantity(measure)
    curves = [one.curve(SETTINGS.curve_points) for one in (across, up)]
    grid = np.meshgrid(across.standard(curves[0]), up.standard(curves[1]))
    surrogate = found.good[measure]
    means = conditional_terms(found.inputs, surrogate.terms, dict(zip(places, map(np.ravel, grid), strict=True)))
    value = factor * surrogate.mean(means).reshape(grid[0].shape)
    axes = [_axis_values(one, curve) for one, curve in zip((across, up), curves, strict=True)]
    quantities = [parameter_quantity(one.axis)[0] for one in (across, up)]
    sheet = Sheet(3.6, 1, 1, width=4.6)
    panel = sheet.panel((0, 0), "", *quantities)
    if across.axis.values is None and up.axis.values is None:
        drawn = panel.contours(
            "mean", *axes, value, quantity, levels=_ROUND_STEPS.tick_values(value.min(), value.max()), cmap="viridis"
        )
    else:
        drawn = panel.axes.pcolormesh(*axes, value, cmap="viridis", shading="nearest")
        x, y = np.meshgrid(*axes)
        panel.record("mean", x.ravel(), y.ravel(), value=value.ravel(), value_quantity=quantity.name,
                     value_unit=quantity.unit)  # fmt: skip
    panel.axes.grid(False)
    for side, one, values in zip("xy", (across, up), axes, strict=True):
        if one.axis.values is not None:
            _listed(getattr(panel.axes, f"{side}axis"), one)
        else:
            _ranged(panel, side, one, values)
    sheet.figure.colorbar(
        drawn, ax=panel.axes, label=textwrap.fill(quantity.label, 40), ticks=MaxNLocator(6, steps=_STEPS)
    )
    return sheet.drawing()


def _axis_values(one: Input, curve: np.ndarray) -> np.ndarray:
    """Where the values of a `curve` stand on an axis: places of a list, a range in its unit."""
    return np.arange(len(curve)) if one.axis.values is not None else parameter_quantity(one.axis)[1] * curve


def _texts(one: Input) -> list[str]:
    factor = parameter_quantity(one.axis)[1]
    return [f"{factor * v:.4g}" if one.axis.column.kind == "float" else str(v) for v in one.axis.values]


def _listed(axis, one: Input) -> None:
    """The values of a list at 0, 1, 2, ..., or some of them where they are many."""
    texts = _texts(one)
    step = -(-len(texts) // 8)
    axis.set_ticks(range(0, len(texts), step), texts[::step])


def _ranged(panel: Panel, side: str, one: Input, values: np.ndarray) -> None:
    """Ends and ticks of a range, logarithmic where it is drawn so."""
    axis = getattr(panel.axes, f"{side}axis")
    getattr(panel.axes, f"set_{side}lim")(values[0], values[-1])
    if one.axis.law.dist.name == "loguniform":
        getattr(panel.axes, f"set_{side}scale")("log")
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if values[-1] < 100 * values[0] else (1.0,)))
        axis.set_major_formatter(FuncFormatter(tick_label))
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_locator(MaxNLocator(4, steps=_STEPS))
