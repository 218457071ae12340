"""The gap per run, before and after."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.ticker import LogLocator, NullLocator

from jointgap.figures.campaign_axes import in_words, listed
from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import Quantity, Sheet, tick_label

GAP = Quantity("gap", "1")
ROLES = {"confirm": "held out: took no part in fitting or choosing", "identify": "used for fitting"}


def gaps(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """Root mean squared whitened residual by run and channel, with 90 % intervals; 1 is the noise. Nothing after where nothing was added."""
    table = tables["gaps"]
    roles = [role for role in ROLES if (table["role"] == role).any()]
    counts = [int((table["role"] == role).sum()) for role in roles]
    sheet = Sheet(
        1.2 + sum(0.55 + 0.2 * count for count in counts), len(roles), 1, height_ratios=[2 + n for n in counts]
    )
    added = not np.array_equal(table["before"], table["after"])
    moments = (("before", -0.14, "before"), ("after", 0.14, "after")) if added else (("before", 0.0, "before"),)
    above = None
    for row, role in enumerate(roles):
        own = _in_order(table[table["role"] == role])
        panel = sheet.panel((row, 0), ROLES[role], GAP, Quantity("run", ""), below=above)
        place = np.arange(len(own))
        labels = [_label(each) for each in own.itertuples()]
        for series, shift, colour in moments:
            low, high = (own[f"{series}_{end}"] for end in ("low", "high"))
            panel.marks(series, own[series], place + shift, colour, low, high, labels, along="x")
        listed(panel, labels)
        panel.upright("noise alone", 1.0)
        panel.axes.set_ylabel("")
        above = panel
    _scale(sheet, table)
    sheet.legend()
    return sheet.drawing()


def _in_order(own: pd.DataFrame) -> pd.DataFrame:
    """All runs first, then each run: all channels, then one by one."""
    runs = {run: place for place, run in enumerate(("all", *(run for run in own["run"].unique() if run != "all")))}
    place = own["run"].map(runs) + (own["channel"] != "all") * 0.5
    return own.assign(place=place).sort_values("place", kind="stable").drop(columns="place").reset_index(drop=True)


def _label(row) -> str:
    if row.channel != "all":
        return in_words(row.channel)
    return "all runs and channels" if row.run == "all" else f"{row.run}: all channels"


def _scale(sheet: Sheet, table: pd.DataFrame) -> None:
    shown = table[["before", "after", "before_low", "before_high", "after_low", "after_high"]].to_numpy(dtype=float)
    low, high = np.nanmin(shown), np.nanmax(shown)
    for panel in sheet.panels:
        panel.axes.set_xscale("log")
        panel.axes.set_xlim(0.85 * min(low, 0.9), 1.2 * max(high, 1.5))
        panel.axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.axes.xaxis.set_major_formatter(tick_label)
        panel.axes.xaxis.set_minor_locator(NullLocator())
