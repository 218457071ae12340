"""Figures of the four ways: gain over CPU time, and from which cost of a simulation on it pays to learn."""

import numpy as np
import pandas as pd
from matplotlib.ticker import FuncFormatter

from jointgap.core import plot
from jointgap.core.plot import Drawing, Panel, Quantity, Sheet, tick_label
from jointgap.length_searches.compare_searches import FROZEN, NETWORKS, SIMULATION, SURROGATE

GAIN, BREAK_EVEN = "gain_over_cpu_time", "when_learning_pays"
TITLES = {
    GAIN: "Gain over CPU time",
    BREAK_EVEN: "From which cost of a simulation on it pays to learn",
}
"""Titles of the figures by name."""

CAPTIONS = {
    GAIN: "Left: fall of the error, simulated again, mean over the designs whose best lengths are wanted. Right: what "
    "is missing of the largest gain that any way found. Marks: mean over the repetitions, bars from the smallest to "
    "the largest. What was learned is shared among all optima.",
    BREAK_EVEN: "Below a line the other way is the cheaper one to the same gain, above it learning is; bands from the "
    "smallest to the largest of the repetitions. In brackets the gain. Where a line is missing it does not pay in "
    "every repetition, whatever a simulation costs.",
}
"""Captions by name."""

LOOKS = {
    FROZEN: ("frozen motion", "paper", "v"),
    NETWORKS: ("networks", "network", "o"),
    SURROGATE: ("surrogate of the error", "second surrogate", "s"),
    SIMULATION: ("simulation (CMA-ES)", "simulation", "D"),
}
"""Words, colour and mark of each way."""

_LINES = ("-", "--", ":", "-.")
_LEAST_MISSING = 1e-5  # of the gain: what is less is drawn there
_LEAST_COST = 1e-2  # [ms] what is less is drawn there
_TIMES = 200  # points of the curve of the searches by simulation


def draw_searches(
    summary: pd.DataFrame, progress: pd.DataFrame, break_even: pd.DataFrame, cost: float
) -> dict[str, Drawing]:
    """All figures by name."""
    with plot.matplotlib_style():
        return {GAIN: _gain(summary, progress), BREAK_EVEN: _break_even(break_even, cost)}


def _gain(summary: pd.DataFrame, progress: pd.DataFrame) -> Drawing:
    sheet = Sheet(4.0, 1, 2)
    time = Quantity("CPU time for each optimum", "s")
    left = sheet.panel((0, 0), "gain", time, Quantity("fall of the error", "%"))
    right = sheet.panel((0, 1), "what is missing", time, Quantity("missing of the largest gain", "%"))
    times, gains = _over_time(progress)
    left.line("simulation, on its way", times, 100.0 * gains, LOOKS[SIMULATION][1], linewidth=0.8, alpha=0.7)
    for way, (words, colour, marker) in LOOKS.items():
        rows = summary[summary["way"] == way]
        at = rows["cpu_time"].to_numpy()
        look = {"marker": marker, "markersize": 5.0}
        ends = (100.0 * rows[f"gain{end}"].to_numpy() for end in ("", "_low", "_high"))
        middle, low, high = ends
        left.marks(words, at, middle, colour, low=low, high=high, **look)
        missing = (100.0 * np.maximum(1.0 - rows[f"share{end}"], _LEAST_MISSING) for end in ("", "_high", "_low"))
        middle, low, high = missing
        right.marks(words, at, middle, colour, low=low, high=high, **look)
    right.logarithmic()
    for panel in (left, right):
        _plain_logarithmic(panel)
    left.axes.set_ylim(bottom=min(0.0, 105.0 * float(summary["gain_low"].min())))
    sheet.legend()
    return sheet.drawing()


def _plain_logarithmic(panel: Panel) -> None:
    """A logarithmic abscissa with plain numbers at it."""
    panel.axes.set_xscale("log")
    panel.axes.xaxis.set_major_formatter(FuncFormatter(tick_label))


def _over_time(progress: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Mean gain of the searches by simulation over the CPU time spent on each: times (n,) [s] and gains (n,)."""
    each = [rows for _, rows in progress.groupby(["repetition", "optimum"])]
    times = np.geomspace(min(rows["cpu_time"].min() for rows in each), progress["cpu_time"].max(), _TIMES)
    places = [np.searchsorted(rows["cpu_time"].to_numpy(), times, side="right") - 1 for rows in each]
    gains = [
        np.where(place >= 0, rows["gain"].to_numpy()[place], 0.0) for rows, place in zip(each, places, strict=True)
    ]
    return times, np.maximum(np.mean(gains, axis=0), 0.0)


def _break_even(frame: pd.DataFrame, cost: float) -> Drawing:
    sheet = Sheet(4.4, 1, 2)
    number = Quantity("optima that share what is learned", "")
    quantity = Quantity("cost of a simulation", "ms")
    panels = {
        against: sheet.panel((0, place), f"against the {LOOKS[against][0]}", number, quantity)
        for place, against in enumerate((SIMULATION, FROZEN))
    }
    for against, panel in panels.items():
        for way in (NETWORKS, SURROGATE):
            rows = frame[(frame["against"] == against) & (frame["way"] == way)]
            for place, (budget, of) in enumerate(rows.groupby("budget")):
                words = f"{LOOKS[way][0]}, {budget:g} s ({100 * of['gain'].mean():.1f} %)"
                _line(panel, words, of, LOOKS[way][1], _LINES[place % len(_LINES)])
        panel.horizontal_line("a simulation takes", 1e3 * cost)
        panel.axes.annotate(
            f"measured: {1e3 * cost:.1f} ms", (1.0, 1e3 * cost), xycoords=("axes fraction", "data"), ha="right",
            va="bottom", fontsize=8.0, color=plot.COLOURS["limit"],
        )  # fmt: skip
        if not panel.axes.get_legend_handles_labels()[0]:
            panel.axes.text(0.5, 0.75, "pays at no cost of a simulation", transform=panel.axes.transAxes, ha="center")
        panel.logarithmic()
        _plain_logarithmic(panel)
        panel.axes.set_xlim(frame["optima"].min(), frame["optima"].max())
    sheet.legend()
    return sheet.drawing()


def _line(panel: Panel, words: str, rows: pd.DataFrame, colour: str, line: str) -> None:
    """Mean over the repetitions where all pay, and the band between their ends."""
    costs = 1e3 * rows.pivot_table(index="optima", columns="repetition", values="cost", dropna=False)
    costs = costs.dropna().clip(lower=_LEAST_COST)
    if costs.empty:
        return
    at, low, high = costs.index.to_numpy(), costs.min(axis=1).to_numpy(), costs.max(axis=1).to_numpy()
    panel.line(words, at, costs.mean(axis=1).to_numpy(), colour, linestyle=line)
    panel.axes.fill_between(at, low, high, color=plot.COLOURS[colour], alpha=0.15, linewidth=0.0)
    panel.record(f"{words}, from smallest to largest", at, np.full(len(at), np.nan), low=low, high=high)
