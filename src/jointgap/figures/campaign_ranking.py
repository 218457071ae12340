"""The ranking of candidates."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from jointgap.figures.campaign_axes import in_words, listed
from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import Panel, Quantity, Sheet, tick_label
from jointgap.identification.settings import DEFAULT_SETTINGS

SHOWN = 8
"""The best explanations by one effect that are shown, and the best by more; all stand in the table of the ranking."""

BASE = "the model as it stands"

_KINDS = {
    "base": (BASE, "limit"),
    "single": ("one effect", "after"),
    "pair": ("two effects", "pair"),
    "formula": ("formula", "formula"),
}
_EXPLANATION = Quantity("explanation", "")

_APART = DEFAULT_SETTINGS.decision.min_delta_bic


def ranking(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """The best explanations by how far they are behind the best one in BIC, and by the share of the misfit they explain."""
    best = _shown(tables["fits"])
    names = [in_words(label).replace(" + ", " +\n") for label in best["explanation"]]
    sheet = Sheet(1.35 + 0.31 * max(3, len(best)), 1, 2, width_ratios=(1.25, 1.0))
    behind = sheet.panel((0, 0), "behind the best", Quantity("BIC above the best", "1"), _EXPLANATION)
    share = sheet.panel((0, 1), "misfit explained", Quantity("explained share", "1"), _EXPLANATION)
    distance = best["delta_bic"].max() - best["delta_bic"]
    for panel, values in ((behind, distance), (share, best["explained_share"].clip(-0.1, 1.1))):
        _marks(panel, best, values)
        listed(panel, names)
        panel.axes.set_ylabel("")
    behind.upright("told apart from here on", _APART)
    _scale(behind, distance.max())
    share.upright("all of the misfit", 1.0, named=False)
    share.axes.set_xlim(-0.12, 1.12)
    share.axes.tick_params(labelleft=False)
    sheet.legend()
    return sheet.drawing()


def _shown(fits: pd.DataFrame) -> pd.DataFrame:
    """The best of the fits, best first, and the base, which all of them are compared with."""
    fitted = fits[(fits["kind"] != "base") & fits["delta_bic"].notna()].sort_values("delta_bic", ascending=False)
    alone = fitted["kind"] == "single"
    base = {"explanation": BASE, "kind": "base", "delta_bic": 0.0, "explained_share": 0.0, "place": ""}
    rows = [fitted[alone].head(SHOWN), fitted[~alone].head(SHOWN), pd.DataFrame([base])]
    columns = list(base)
    kept = pd.concat([frame[columns] for frame in rows if len(frame)], ignore_index=True)
    return kept.sort_values("delta_bic", ascending=False, kind="stable", ignore_index=True)


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


def _scale(panel: Panel, farthest: float) -> None:
    """An abscissa that is linear up to the difference that tells two explanations apart and logarithmic beyond."""
    decades = 10.0 ** np.arange(1, 12)
    ticks = [0.0, *decades[decades <= 1.5 * max(farthest, _APART)]]
    panel.axes.set_xscale("symlog", linthresh=_APART, linscale=0.7)
    panel.axes.xaxis.set_major_locator(FixedLocator(ticks))
    panel.axes.xaxis.set_major_formatter(FuncFormatter(tick_label))
    panel.axes.xaxis.set_minor_locator(NullLocator())
    panel.axes.set_xlim(-1.5, 1.8 * max(farthest, _APART))
