"""The ranking of candidates."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from jointgap.figures.campaign.parts import in_words, listed
from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import Panel, Quantity, Sheet, tick_label

SHOWN = 16
"""The best explanations that are shown; all stand in the table of fits."""

_KINDS = {"single": ("one effect", "after"), "pair": ("two effects", "pair"), "formula": ("formula", "formula")}
_EXPLANATION = Quantity("explanation", "")
_LINEAR_TO = 10.0  # of BIC: less is no evidence to speak of


def ranking(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """The best explanations by what they gain in BIC over the recalibrated model, and the share of the misfit they explain."""
    fits = tables["fits"]
    best = fits[fits["delta_bic"].notna()]
    best = best.sort_values("delta_bic", ascending=False).head(SHOWN).reset_index(drop=True)
    names = [in_words(label).replace(" + ", " +\n") for label in best["explanation"]]
    sheet = Sheet(1.35 + 0.31 * max(3, len(best)), 1, 2, width_ratios=(1.25, 1.0))
    gain = sheet.panel((0, 0), "gain over the base model", Quantity("gain in BIC", "1"), _EXPLANATION)
    share = sheet.panel((0, 1), "misfit explained", Quantity("explained share", "1"), _EXPLANATION)
    for panel, values in ((gain, best["delta_bic"]), (share, best["explained_share"].clip(-0.1, 1.1))):
        _marks(panel, best, values)
        listed(panel, names)
    gain.axes.axvline(0.0, color="#777777", linewidth=0.8)
    _symmetric(gain, best["delta_bic"].to_numpy(dtype=float))
    gain.axes.set_ylabel("")
    share.upright("all of the misfit", 1.0)
    share.axes.set_xlim(-0.12, 1.12)
    share.axes.tick_params(labelleft=False)
    share.axes.set_ylabel("")
    sheet.legend()
    return sheet.drawing()


def _marks(panel: Panel, best: pd.DataFrame, values: pd.Series) -> None:
    place = np.arange(len(best))
    for kind, (series, colour) in _KINDS.items():
        own = ((best["kind"] == kind) & (best["place"] == "")).to_numpy()
        if own.any():
            panel.marks(series, values[own], place[own], colour, labels=list(best["explanation"][own]))
    for series, words in (("named", "named"), ("equivalent", "cannot be told apart")):
        own = (best["place"] == series).to_numpy()
        if own.any():
            labels = list(best["explanation"][own])
            panel.marks(words, values[own], place[own], "named", labels=labels, marker="D", markersize=6.0)


def _symmetric(panel: Panel, values: np.ndarray) -> None:
    """An abscissa that is linear up to +-`_LINEAR_TO` and logarithmic beyond."""
    low, high = min(values.min(initial=0.0), 0.0), max(values.max(initial=0.0), _LINEAR_TO)
    decades = 10.0 ** np.arange(1, 12)
    ticks = [0.0, *decades[decades <= 1.5 * high], *-decades[decades <= -1.5 * low]]
    panel.axes.set_xscale("symlog", linthresh=_LINEAR_TO, linscale=0.7)
    panel.axes.xaxis.set_major_locator(FixedLocator(ticks[:: max(1, len(ticks) // 6)]))
    panel.axes.xaxis.set_major_formatter(FuncFormatter(tick_label))
    panel.axes.xaxis.set_minor_locator(NullLocator())
    panel.axes.set_xlim(1.6 * low - 3.0, 1.8 * high)
