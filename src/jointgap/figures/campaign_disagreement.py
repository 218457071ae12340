"""The map of disagreement: run, channel and crank angle."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.patches import Rectangle

from jointgap.figures.campaign_axes import SPREADS, in_words, runs_in
from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import CRANK_ANGLE, Panel, Quantity, Sheet, round_up
from jointgap.figures.style import INK

MEAN = Quantity("mean whitened residual", SPREADS)
_FLAGGED = "window with a disagreement"
_LINEAR_TO = 6.0  # larger means are shown on a logarithmic scale of colours


def disagreement(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """Mean whitened residual of the recalibrated model by crank angle, a panel for each channel; flagged windows outlined."""
    bins, windows = tables["bins"], tables["windows"]
    channels = list(bins["channel"].unique())
    heights = [bins[bins["channel"] == channel]["run"].nunique() for channel in channels]
    shares = [0.75 + count for count in heights]
    sheet = Sheet(1.25 + 0.32 * sum(shares), len(channels), 1, height_ratios=shares)
    most = round_up(max(1.0, np.nanmax(np.abs(bins["mean"].to_numpy(dtype=float)), initial=0.0)))
    norm = Normalize(-most, most) if most <= _LINEAR_TO else SymLogNorm(1.0, vmin=-most, vmax=most)
    colours = ScalarMappable(norm, "RdBu_r")
    above = None
    for row, channel in enumerate(channels):
        panel = sheet.panel((row, 0), in_words(channel), CRANK_ANGLE, Quantity("run", ""), below=above)
        own = bins[bins["channel"] == channel]
        for place, run in enumerate(runs_in(own)):
            _row(panel, place, run, own[own["run"] == run], colours)
            _windows(panel, place, run, windows[(windows["channel"] == channel) & (windows["run"] == run)])
        panel.rows(runs_in(own), range(heights[row]))
        panel.axes.set_ylim(heights[row] - 0.4, -0.6)
        panel.axes.grid(False)
        panel.over_crank_angle(0.0, 360.0)
        above = panel
    bar = sheet.figure.colorbar(
        colours, ax=[panel.axes for panel in sheet.panels], label=MEAN.label, location="bottom", shrink=0.7, aspect=45
    )
    bar.ax.minorticks_off()
    if windows.empty:
        sheet.figure.suptitle("no window stands out of the noise", fontsize=8.5, x=0.99, ha="right")
    else:
        sheet.legend()
    return sheet.drawing()


def _row(panel: Panel, place: int, run: str, bins: pd.DataFrame, colours: ScalarMappable) -> None:
    known = bins[bins["mean"].notna()]
    start, width = known["start_deg"].to_numpy(), (known["end_deg"] - known["start_deg"]).to_numpy()
    spans = list(zip(start, width, strict=True))
    panel.axes.broken_barh(spans, (place - 0.4, 0.8), facecolors=colours.to_rgba(known["mean"].to_numpy()))
    panel.record(
        MEAN.name,
        start + width / 2.0,
        np.full(len(known), float(place)),
        low=start,
        high=known["end_deg"],
        value=known["mean"],
        label=[run] * len(known),
        value_quantity=MEAN.name,
        value_unit=MEAN.unit,
    )


def _windows(panel: Panel, place: int, run: str, windows: pd.DataFrame) -> None:
    for window in windows.itertuples():
        low, high = window.start_deg, window.end_deg
        for begin, end in [(low, high)] if low < high else [(low, 360.0), (0.0, high)]:
            frame = Rectangle((begin, place - 0.43), end - begin, 0.86, fill=False, edgecolor=INK, linewidth=1.3)
            frame.set(label=_FLAGGED, zorder=3)
            panel.axes.add_patch(frame)
            panel.record(
                _FLAGGED,
                [(begin + end) / 2.0],
                [float(place)],
                low=[begin],
                high=[end],
                value=[window.mean],
                label=[run],
                value_quantity=MEAN.name,
                value_unit=MEAN.unit,
            )
