"""Figures of a set of blind trials."""

import numpy as np
import pandas as pd

from jointgap.campaign.figures import list_rows
from jointgap.core.plot import Drawing, Quantity, Sheet, matplotlib_style
from jointgap.core.words import in_words
from jointgap.trials.trials_report import class_confusion, confusion, rates

GOALS = {
    "right name": (0.95, "at least"),
    "right joint, a clearance hidden": (0.85, "at least"),
    "wrong name": (0.01, "at most"),
    "wrong name, effect off the list": (0.05, "at most"),
    "nothing found, nothing hidden": (0.99, "at least"),
    "both named and no third": (0.85, "at least"),
    "wrong name, data wired wrongly": (0.01, "at most"),
    "told which channel, data wired wrongly": (0.80, "at least"),
}
"""Rates that the trials are to reach, and from which side."""

_SHARE = Quantity("share of the trials", "1")
_TRIALS = Quantity("trials", "1")
_GROUP = Quantity("what, and of which trials", "")
_HIDDEN, _NAMED = Quantity("hidden", ""), Quantity("named, or the verdict", "")


def draw_score(trials: pd.DataFrame) -> dict[str, Drawing]:
    """Rates with their intervals beside what is asked for, and the confusion matrices, by file name."""
    with matplotlib_style():
        return {
            "rates": _rates(trials),
            "confusion": _confusion(confusion(trials)),
            "confusion_by_class": _confusion(class_confusion(trials)),
        }


def _rates(trials: pd.DataFrame) -> Drawing:
    all_rates = rates(trials)
    shown = all_rates[all_rates["what"].isin(GOALS)].reset_index(drop=True)
    goals = shown["what"].map(lambda what: GOALS[what][0]).to_numpy(float)
    least = shown["what"].map(lambda what: GOALS[what][1] == "at least").to_numpy(bool)
    met = np.where(least, shown["value"] >= goals, shown["value"] <= goals)
    names = [f"{row.what}: {row.group} ({row.count})" for row in shown.itertuples()]
    sheet = Sheet(1.2 + 0.22 * max(len(shown), 3), 1, 1)
    panel = sheet.panel((0, 0), "how often, with 95 % intervals", _SHARE, _GROUP)
    places = np.arange(len(shown))
    for words, colour, own in (("as asked for", "after", met), ("not as asked for", "before", ~met)):
        if own.any():
            part = shown[own]
            labels = [name for name, taken in zip(names, own, strict=True) if taken]
            panel.marks(words, part["value"], places[own], colour, part["low"], part["high"], labels, along="x")
    panel.marks("asked for", goals, places, "limit", labels=names, marker="|", markersize=9.0)
    list_rows(panel, names)
    panel.axes.set_xlim(-0.02, 1.02)
    panel.axes.set_ylabel("")
    sheet.legend()
    return sheet.drawing()


def _confusion(counts: pd.DataFrame) -> Drawing:
    rows, columns = counts.shape
    sheet = Sheet(2.4 + 0.2 * rows, 1, 1, width=max(6.0, 3.0 + 0.22 * columns))
    panel = sheet.panel((0, 0), "what was named, by what was hidden", _NAMED, _HIDDEN)
    values = counts.to_numpy(float)
    shares = values / values.sum(axis=1, keepdims=True)
    edges = np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5
    panel.axes.pcolormesh(*edges, shares, cmap="Blues", vmin=0, vmax=1)
    for row, column in zip(*np.nonzero(values), strict=True):
        ink = "white" if shares[row, column] > 0.6 else "black"
        panel.axes.text(column, row, f"{values[row, column]:.0f}", ha="center", va="center", color=ink, fontsize=6.5)
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    labels = [f"{hidden} / {named}" for hidden in counts.index for named in counts.columns]
    panel.record(
        "trials", x.ravel(), y.ravel(), value=values.ravel(), label=labels, value_quantity=_TRIALS.name,
        value_unit=_TRIALS.unit,
    )  # fmt: skip
    list_rows(panel, [in_words(name) for name in counts.index])
    panel.axes.set_xticks(range(columns), [in_words(name) for name in counts.columns], rotation=90)
    panel.axes.tick_params(labelsize=7)
    panel.axes.grid(False)
    return sheet.drawing()
