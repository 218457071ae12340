"""Residuals by crank angle, before and after."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.ticker import MultipleLocator

from jointgap.figures.campaign_axes import in_words, runs_in
from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import CRANK_ANGLE, Panel, Quantity, Sheet
from jointgap.figures.style import WIDTH

BAND = 2.0
"""Half of the noise band in standard deviations: 95 % of the samples of a true model lie inside."""

_SHOWN = 1500  # dots in a panel
_MEANS = 72  # crank angles at which a mean is drawn
_FULLEST = 12.0  # residuals beyond are shown on a logarithmic scale
_NOISE = f"noise: {BAND:g} standard deviations"
_SAMPLE = Quantity("sample", "1")


def residuals(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """Measured less predicted over the noise's spread, by crank angle: a row for each channel, a column for each run."""
    samples = tables["residuals"]
    before, after = ((samples["measured"] - samples[model]) / samples["spread"] for model in ("base", "augmented"))
    moments = ("before", "after") if (before != after).any() else ("before",)  # nothing was added
    samples = samples.assign(before=before, after=after)
    runs, channels = runs_in(samples), list(samples["channel"].unique())
    sheet = Sheet(0.8 + 1.75 * len(channels), len(channels), len(runs), width=max(WIDTH, 2.9 * len(runs)))
    for row, channel in enumerate(channels):
        largest = np.nanmax(samples.loc[samples["channel"] == channel, list(moments)].abs().to_numpy())
        for column, run in enumerate(runs):
            own = samples[(samples["run"] == run) & (samples["channel"] == channel)]
            if own.empty:
                continue
            angular = own["crank_angle"].notna().any()
            held_out = ", held out" if own["held_out"].all() else ""
            title = f"{run}{held_out}: {in_words(channel)}"
            x = CRANK_ANGLE if angular else _SAMPLE
            panel = sheet.panel((row, column), title, x, Quantity("residual", "noise sd"))
            _fill(panel, own[own["crank_angle"].notna()] if angular else own, moments, angular)
            _scale(panel, largest)
            if channel != samples.loc[samples["run"] == run, "channel"].iloc[-1]:  # the scale stands below the lowest
                panel.axes.set_xlabel("")
                panel.axes.tick_params(labelbottom=False)
            if column:
                panel.axes.set_ylabel("")
                panel.axes.tick_params(labelleft=False)
    sheet.legend()
    return sheet.drawing()


def _fill(panel: Panel, samples: pd.DataFrame, moments: tuple[str, ...], angular: bool) -> None:
    x = (np.degrees(samples["crank_angle"]) % 360.0 if angular else samples["sample"]).to_numpy(dtype=float)
    few = np.unique(np.linspace(0, len(x) - 1, min(_SHOWN, len(x))).astype(int))
    for moment in moments:
        values = samples[moment].to_numpy(dtype=float)
        look = {"marker": ".", "markersize": 2.0, "alpha": 0.3, "markeredgewidth": 0.0, "rasterized": True}
        panel.marks(f"{moment}, samples", x[few], values[few], moment, **look)
        panel.axes.lines[-1].set_label("")  # dots as small as these cannot be seen in a legend
        panel.line(f"{moment}, mean", *_means(x, values), moment, linewidth=1.3, zorder=3)
    panel.axes.axhspan(-BAND, BAND, color="#E9E9E9", zorder=0, label=_NOISE)
    panel.record(_NOISE, [np.nan], [0.0], low=[-BAND], high=[BAND])
    if angular:
        panel.over_crank_angle(0.0, 360.0)
        panel.axes.xaxis.set_major_locator(MultipleLocator(90))


def _scale(panel: Panel, largest: float) -> None:
    """The same scale for all runs of a channel."""
    if largest > _FULLEST:
        panel.linear_then_logarithmic(BAND)
        panel.axes.set_ylim(-1.5 * largest, 1.5 * largest)
    else:
        panel.axes.set_ylim(-1.08 * largest, 1.08 * largest)


def _means(x: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of `values` in equal intervals of `x`; NaN where there is none, so that the curve breaks."""
    edges = np.linspace(x.min(), x.max(), _MEANS + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _MEANS - 1)
    count = np.bincount(place, minlength=_MEANS)
    total = np.bincount(place, values, _MEANS)
    return (edges[1:] + edges[:-1]) / 2.0, np.divide(total, count, out=np.full(_MEANS, np.nan), where=count > 0)
