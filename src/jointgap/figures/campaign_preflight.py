"""What an experiment could find: effects that look alike, and the smallest sizes that show."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.patches import Rectangle
from scipy.cluster.hierarchy import leaves_list, linkage
from scipy.spatial.distance import squareform

from jointgap.figures.campaign_axes import in_words, listed
from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import Quantity, Sheet, tick_label
from jointgap.figures.style import COLOURS

COSINE = Quantity("cosine of the signatures", "1")
_EFFECT = Quantity("effect", "")
_SIZE = Quantity("size over the one that makes a gap of 1.5", "1")
_TOLD_FROM = 0.5  # cosines that are written as numbers
_MERGED = "cannot be told apart here"


def confusability(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """Cosines between what any two effects do to the measurement once the nuisances are re-fitted; merged classes outlined."""
    pairs = tables["confusability"]
    labels = sorted({*pairs["first"], *pairs["second"]})
    number = {label: place for place, label in enumerate(labels)}
    cosine = np.eye(len(labels))
    rows, columns = pairs["first"].map(number), pairs["second"].map(number)
    cosine[rows, columns] = cosine[columns, rows] = np.nan_to_num(np.abs(pairs["cosine"].to_numpy(dtype=float)))
    np.fill_diagonal(cosine, 1.0)
    order = _alike_beside_each_other(cosine, [[number[label] for label in group] for group in _merged(verdict, number)])
    labels, cosine = [labels[i] for i in order], cosine[np.ix_(order, order)]
    number = {label: place for place, label in enumerate(labels)}
    count = len(labels)
    size = 3.6 + 0.25 * count
    sheet = Sheet(size * 0.95, 1, 1, width=size)
    panel = sheet.panel((0, 0), "how alike the effects look", _EFFECT, _EFFECT)
    drawn = panel.axes.pcolormesh(
        np.arange(count + 1) - 0.5, np.arange(count + 1) - 0.5, cosine, cmap="Blues", vmin=0, vmax=1
    )
    x, y = np.meshgrid(np.arange(count, dtype=float), np.arange(count, dtype=float))
    panel.record(
        COSINE.name,
        x.ravel(),
        y.ravel(),
        value=cosine.ravel(),
        label=[f"{first} / {second}" for first in labels for second in labels],
        value_quantity=COSINE.name,
        value_unit=COSINE.unit,
    )
    for (row, column), value in np.ndenumerate(cosine):
        if row != column and value >= _TOLD_FROM:
            ink = "white" if value > 0.6 else "black"
            panel.axes.text(column, row, _short_of_one(value), ha="center", va="center", color=ink, fontsize=6.0)
    for group in _merged(verdict, number):
        places = sorted(number[label] for label in group)
        edge = Rectangle((places[0] - 0.5, places[0] - 0.5), len(places), len(places), fill=False, linewidth=1.8)
        edge.set(edgecolor=COLOURS["before"], label=_MERGED, zorder=3)
        panel.axes.add_patch(edge)
        panel.record(_MERGED, places, places, label=[labels[place] for place in places])
    names = [in_words(label) for label in labels]
    panel.axes.set_xticks(range(count), names, rotation=90, fontsize=7.0)
    panel.axes.set_yticks(range(count), names, fontsize=7.0)
    panel.axes.set(xlabel="", ylabel="", aspect="equal")
    panel.axes.invert_yaxis()
    panel.axes.grid(False)
    sheet.figure.colorbar(drawn, ax=panel.axes, label=COSINE.label, shrink=0.6)
    if _merged(verdict, number):
        sheet.legend()
    return sheet.drawing()


def _merged(verdict: Mapping[str, Any], known: Mapping[str, int]) -> list[list[str]]:
    groups = verdict.get("preflight", {}).get("merged", ())
    return [own for group in groups if len(own := [label for label in group if label in known]) > 1]


def _alike_beside_each_other(cosine: np.ndarray, groups: list[list[int]]) -> list[int]:
    """An order in which effects that look alike are neighbours, those of one group without a stranger between them."""
    if len(cosine) < 3:
        return list(range(len(cosine)))
    near = cosine.copy()
    for group in groups:
        near[np.ix_(group, group)] = 2.0  # nearer than any other can be
    distance = 2.0 - near
    np.fill_diagonal(distance, 0.0)
    return list(leaves_list(linkage(squareform(distance, checks=False), "average", optimal_ordering=True)))


def _short_of_one(value: float) -> str:
    """Two digits after the point, three where these would be 1.00."""
    return "1" if value >= 0.9995 else f"{value:.{3 if value >= 0.995 else 2}f}".lstrip("0")


def detectable(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """The smallest size of each effect that this experiment shows, over the one that makes a gap of 1.5, with its value.

    Where the value falls as the effect grows, the ratio is turned over: to the left of the line is always what is easily seen.
    """
    effects = tables["effects"]
    ratio = (effects["smallest_detectable"] / effects["typical"]).abs()
    effects = effects.assign(ratio=ratio.where(~effects["falls"], 1.0 / ratio))
    effects = effects.sort_values("ratio", na_position="last").reset_index(drop=True)
    sheet = Sheet(1.3 + 0.21 * len(effects), 1, 1)
    panel = sheet.panel((0, 0), "what this experiment would show", _SIZE, _EFFECT)
    place, seen = np.arange(len(effects), dtype=float), effects["detectable"].to_numpy(dtype=bool)
    panel.marks(
        "smallest detectable size", effects["ratio"][seen], place[seen], "after", labels=list(effects["label"][seen])
    )
    listed(panel, [in_words(label) for label in effects["label"]])
    panel.upright("gap of 1.5", 1.0)
    panel.axes.set_xscale("log")
    low, high = effects["ratio"][seen].min(), effects["ratio"][seen].max()
    panel.axes.set_xlim(0.7 * np.fmin(low, 0.2), 2.0 * np.fmax(high, 1.0))
    panel.axes.xaxis.set_major_formatter(tick_label)
    panel.axes.set_ylabel("")
    beside = panel.axes.secondary_yaxis("right")
    beside.set_yticks(place, [_size(row) for row in effects.itertuples()])
    beside.tick_params(length=0)
    beside.spines["right"].set_visible(False)
    sheet.legend()
    return sheet.drawing()


def _size(effect) -> str:
    if pd.notna(effect.failed):
        return "not simulated"
    if not effect.detectable:
        return "no size shows"
    size = f"{effect.smallest_detectable:.2g} {effect.unit}".removesuffix(" 1").replace("**", "^")
    return f"up to {size}" if effect.falls else size
