"""The figure of a trend: sizes over dates, with their intervals and the line through them."""

import numpy as np
import pandas as pd
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num

from jointgap.figures.sheet import Quantity, Sheet
from jointgap.figures.style import Drawing
from jointgap.report.plain_words import in_words

SHOWN_UNITS = {"m": (1e6, "µm")}
"""Units in which sizes are shown, by SI unit, and how many of them that is."""

_DATE = Quantity("date", "d since 1970-01-01")


def trend_figure(sizes: pd.DataFrame, growth: pd.DataFrame) -> Drawing:
    """Sizes over dates, a panel for each: 90 % intervals, and the line where one was fitted."""
    sheet = Sheet(0.8 + 2.4 * len(growth), len(growth), 1)
    above = None
    days = date2num(pd.to_datetime(sizes["date"]).to_numpy())
    for place, line in enumerate(growth.to_dict("records")):
        factor, unit = SHOWN_UNITS.get(line["unit"], (1.0, line["unit"]))
        of_line = (sizes["label"] == line["label"]).to_numpy()
        own, when = sizes[of_line], days[of_line]
        panel = sheet.panel((place, 0), in_words(line["label"]), _DATE, Quantity("size", unit), below=above)
        panel.axes.set_xlabel("date")
        above = panel
        counts, stated = own["counts"].to_numpy(), own["value"].notna().to_numpy()
        for kept, series, colour, style in (
            (counts, "size with 90 % interval", "settled", {}),
            (stated & ~counts, "does not count in the line", "limit", {"markerfacecolor": "white"}),
        ):
            if kept.any():
                shown = factor * own.loc[kept, ["value", "low_90", "high_90"]].to_numpy(float)
                value, low, high = shown.T
                ends = [np.where(np.isnan(end), value, end) for end in (low, high)]
                panel.marks(series, when[kept], value, colour, *ends, **style)
        smallest = factor * own["smallest_detectable"].to_numpy(float)
        known, unknown = (~stated & (np.isnan(smallest) == lost) for lost in (False, True))
        if known.any():
            panel.marks("not found; would show from here on", when[known], smallest[known], "other", marker="v")
        for order, day in enumerate(when[unknown]):
            panel.vertical_line("not found; no size known", day, named=order == 0)
        if pd.notna(line["rate"]):
            span = np.array([when[counts].min(), when[counts].max()])
            ends = factor * (line["first_value"] + line["rate"] * (span - when.min()))
            panel.line("straight line", span, ends, "before")
        locator = AutoDateLocator(minticks=3, maxticks=8)
        panel.axes.xaxis.set_major_locator(locator)
        panel.axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
        panel.axes.margins(x=0.05)
    sheet.legend()
    return sheet.drawing()
