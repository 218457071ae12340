"""Figures of what the paper did not say: numbers over all designs, the posterior of each setting, a map of two."""

import textwrap
from collections.abc import Iterator

import numpy as np
from scipy.ndimage import gaussian_filter

from jointgap.core import plot
from jointgap.core.plot import COLOURS, Drawing, Panel, Quantity, Sheet, tick_label
from jointgap.designs.design_of_experiments import Axis
from jointgap.designs.words_of_designs import parameter_quantity, value_in_words
from jointgap.paper_settings.infer_settings import (
    BINS,
    NUMBERS,
    InferredSettings,
    departures,
    edges_of,
    place_of,
)

NUMBERS_FIGURE, POSTERIOR, MAP = "printed_numbers", "posterior", "map"
"""Names of the figures."""

_IN_A_ROW = 3
_DOT = 2.0  # [points]
_SHARE = Quantity("share", "%")


def draw(found: InferredSettings) -> Iterator[tuple[str, Drawing]]:
    """All figures with their names, one at a time; no map where one setting alone varies."""
    with plot.matplotlib_style():
        yield NUMBERS_FIGURE, _numbers(found)
        yield POSTERIOR, _posterior(found)
        if len(found.varied) > 1:
            yield MAP, _map(found)


def _numbers(found: InferredSettings) -> Drawing:
    """Every design by two of its numbers, and where the paper's are."""
    reduction, ratio = NUMBERS[0], NUMBERS[-1]
    sheet = Sheet(3.4, 1, 1, width=5.2)
    panel = sheet.panel(
        (0, 0),
        "",
        Quantity("crank over rod, best lengths", "1", "$L_2/L_3$"),
        Quantity("error falls at the genetic algorithm's lengths by", "%"),
    )
    panel.axes.set_ylabel(textwrap.fill(panel.y.label, 34))
    frame = found.frame
    for series, colour, shown, size in (
        ("design", "sky", ~frame["together"].to_numpy(), _DOT),
        ("all printed numbers come out", "crank pin", frame["together"].to_numpy(), 2.0 * _DOT),
    ):
        part = frame[shown]
        values = part[ratio.column].to_numpy(), 100.0 * part[reduction.column].to_numpy()
        panel.marks(series, *values, colour, markersize=size, markeredgewidth=0.0)
    within = found.options.within
    panel.marks(
        f"printed, and {100 * within:g} % to each side",
        [ratio.printed],
        [100.0 * reduction.printed],
        "network",
        marker="s",
        fillstyle="none",
        low=[100.0 * (reduction.printed - within * reduction.scale)],
        high=[100.0 * (reduction.printed + within * reduction.scale)],
    )
    panel.axes.plot(
        ratio.printed + within * ratio.scale * np.array([-1.0, 1.0]), 2 * [100.0 * reduction.printed],
        color=COLOURS["network"],
    )  # fmt: skip
    panel.axes.ticklabel_format(axis="x", useOffset=False)
    panel.axes.set_xticks(panel.axes.get_xticks()[1:-1:2])
    for name, side in ((ratio.column, "x"), (reduction.column, "y")):
        factor = 100.0 if side == "y" else 1.0
        low, high = factor * np.quantile(frame[name], (0.002, 0.998))
        getattr(panel.axes, f"set_{side}lim")(low, high)
    sheet.legend()
    return sheet.drawing()


def _posterior(found: InferredSettings) -> Drawing:
    """Of each setting the share of its values before and after the printed numbers are known."""
    axes = found.varied
    columns = min(_IN_A_ROW, len(axes))
    rows = -(-len(axes) // columns)
    sheet = Sheet(0.5 + 1.9 * rows, rows, columns)
    ranges = found.settings["value"].isna()
    highest = {
        is_list: 105.0 * found.settings.loc[ranges != is_list, "posterior_high"].max() for is_list in (True, False)
    }
    for number, axis in enumerate(axes):
        own = found.settings[found.settings["setting"] == axis.key]
        quantity, _ = parameter_quantity(axis)
        panel = sheet.panel(divmod(number, columns), "", quantity, _SHARE)
        if number % columns:
            panel.axes.set_ylabel("")
        places = np.arange(len(own))
        prior, after, low, high = (
            100.0 * own[name].to_numpy() for name in ("prior", "posterior", "posterior_low", "posterior_high")
        )
        names = _names(axis)
        panel.axes.bar(places, after, 0.8, color=COLOURS["simulation"], alpha=0.35)
        panel.marks("posterior, 90 % interval", places, after, "simulation", low=low, high=high, labels=names)
        panel.marks("drawn", places, prior, "ideal", marker="_", markersize=13.0, labels=names)
        _ticks(panel, "x", axis)
        panel.axes.set_ylim(0.0, highest[axis.values is not None])
        panel.axes.set_xlabel(textwrap.fill(quantity.label, 30))
    sheet.legend()
    return sheet.drawing()


def _map(found: InferredSettings) -> Drawing:
    """Over the two settings of which the numbers tell most, ranges before lists, the share of designs in which they
    come out.
    """
    by_key = {axis.key: axis for axis in found.varied}
    ranked = [by_key[key] for key in found.moved.index]
    across, up = sorted(ranked, key=lambda axis: axis.values is not None)[:2]
    out = np.abs(departures(found.frame)) <= found.options.within
    comes_out = {
        f"error falls: {', '.join(f'{100.0 * one.printed:.2f}' for one in NUMBERS[:-1])} %": out[:, :-1].all(axis=1),
        f"L2/L3 = {NUMBERS[-1].shown(NUMBERS[-1].printed)}": out[:, -1],
        "all together": out.all(axis=1),
    }
    places = [place_of(axis, found.frame[axis.key].to_numpy()) for axis in (across, up)]
    sizes = [len(_names(axis)) for axis in (across, up)]
    flat = np.ravel_multi_index((places[1], places[0]), sizes[::-1])
    drawn = np.bincount(flat, minlength=np.prod(sizes))
    sheet = Sheet(2.7, 1, len(comes_out))
    quantities = [parameter_quantity(axis)[0] for axis in (across, up)]
    x, y = np.meshgrid(*(np.arange(size) for size in sizes))
    for number, (title, inside) in enumerate(comes_out.items()):
        panel = sheet.panel((0, number), title, *quantities)
        panel.axes.set_title(title, fontsize=8.0)
        with np.errstate(invalid="ignore"):
            share = 100.0 * np.bincount(flat, weights=inside, minlength=np.prod(sizes)) / drawn
        value = share.reshape(sizes[::-1])
        shown = panel.axes.pcolormesh(*(np.arange(size) for size in sizes), value, cmap="viridis", shading="nearest",
                                      vmin=0.0)  # fmt: skip
        if min(sizes) > 1 and np.nanmax(value) > 0.0:
            # Smoothed: a field holds some hundred designs, and a few of them in which a number comes out.
            counts = (np.bincount(flat, weights=which, minlength=np.prod(sizes)) for which in (inside, None))
            numerator, denominator = (
                gaussian_filter(count.reshape(sizes[::-1]).astype(float), 1.0, mode="nearest") for count in counts
            )
            smooth = numerator / denominator
            panel.axes.contour(x, y, smooth, levels=[0.5 * smooth.max()], colors="white", linewidths=1.2)
        panel.record(title, x.ravel(), y.ravel(), value=value.ravel(), value_quantity="share", value_unit="%")
        panel.axes.grid(False)
        for side, axis in zip("xy", (across, up), strict=True):
            _ticks(panel, side, axis)
        if number:
            panel.axes.set_ylabel("")
        sheet.figure.colorbar(
            shown, ax=panel.axes, label="share of designs [%]" if number == len(comes_out) - 1 else ""
        )
    return sheet.drawing()


def _names(axis: Axis) -> list[str]:
    """Of values of a list, or of bins of a range by their middle."""
    if axis.values is not None:
        return [value_in_words(axis, value) for value in axis.values]
    factor = parameter_quantity(axis)[1]
    return [f"{factor * value:.3g}" for value in axis.law.ppf((np.arange(BINS) + 0.5) / BINS)]


def _ticks(panel: Panel, side: str, axis: Axis) -> None:
    """Values of a list at 0, 1, 2, ...; of a range ends of its bins between them."""
    shown = getattr(panel.axes, f"{side}axis")
    if axis.values is not None:
        names = [textwrap.fill(value_in_words(axis, value), 9) for value in axis.values]
        shown.set_ticks(range(len(names)), names)
    else:
        factor = parameter_quantity(axis)[1]
        edges = factor * edges_of(axis)
        step = BINS // 4 if edges[-1] < 1e4 else BINS // 2  # powers of ten are wide
        edges = edges[::step]
        texts = [tick_label(float(f"{value:.3g}"), 0) for value in edges]
        shown.set_ticks(np.arange(0, BINS + 1, step) - 0.5, texts)
    shown.set_tick_params(labelsize=7)
