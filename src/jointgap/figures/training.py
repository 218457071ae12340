"""Figure 8 and the errors between the training points."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import Panel, Quantity, Sheet
from jointgap.tables import OUTPUTS

Tables = Mapping[str, pd.DataFrame]
SYMBOLS = {
    "r2": "$r_2$",
    "r3": "$r_3$",
    "gamma2": r"$\gamma_2$",
    "gamma3": r"$\gamma_3$",
    "gamma2_dot": r"$\dot\gamma_2$",
    "gamma3_dot": r"$\dot\gamma_3$",
    "gamma2_ddot": r"$\ddot\gamma_2$",
    "gamma3_ddot": r"$\ddot\gamma_3$",
}
PAPER_ITERATIONS = 20_000  # of every network in the paper
CURVE_POINTS = 300  # of a curve over thousands of iterations, evenly spaced on its logarithmic axis
ERROR = Quantity("MSE over squared range", "1")
NETWORK, CLEARANCE = "network", "clearance"  # models of the table fit_errors


def mse_curves(tables: Tables, scenario: Scenario) -> Drawing:
    """Mean square error at the training points over the iterations, a panel for each network (figure 8)."""
    history, default = tables["fit_history"], scenario.surrogate.seeds[0]
    paper = tables["fit_errors"].drop_duplicates("output").set_index("output")["paper_mse"]
    sheet = Sheet(4.6, 2, 4)
    lowest, highest = np.inf, 0.0
    first: Panel | None = None
    for place, output in enumerate(OUTPUTS):
        row, column = place % 2, place // 2
        above = sheet.panels[-1] if row else None
        panel = sheet.panel((row, column), f"network {SYMBOLS[output]}", Quantity("iteration", "1"), ERROR, below=above)
        curves = history[history["output"] == output]
        for seed in reversed(curves["seed"].unique()):
            curve = _thinned(curves[(curves["seed"] == seed) & (curves["iteration"] > 0)])
            series, look = (
                ("default start", {"linewidth": 1.4, "zorder": 3}) if seed == default else ("other starts", {})
            )
            colour = "network" if seed == default else "other"
            panel.line(series, curve["iteration"], curve["mse"], colour, **({"linewidth": 0.6} | look))
            lowest, highest = min(lowest, curve["mse"].min()), max(highest, curve["mse"].max())
        panel.marks("paper, after 20 000", [PAPER_ITERATIONS], [paper[output]], "paper", marker="D", zorder=4)
        lowest = min(lowest, paper[output])
        panel.axes.set_xscale("log")
        panel.axes.set_yscale("log")
        panel.axes.set_xlim(1, 2 * PAPER_ITERATIONS)
        if first is not None:
            panel.axes.sharey(first.axes)
        if column:
            panel.axes.set_ylabel("")
            panel.axes.tick_params(labelleft=False)
        first = first or panel
    first.axes.set_ylim(lowest / 3, 2 * highest)
    sheet.legend()
    return sheet.drawing()


def _thinned(curve: pd.DataFrame) -> pd.DataFrame:
    rows = np.unique(np.round(np.geomspace(1, len(curve), CURVE_POINTS)).astype(int)) - 1
    return curve.iloc[rows]


# Marks of the figure of held-out errors: series, model, column of fit_errors, shift, colour, marker.
MARKS = (
    ("network, training points", NETWORK, "training_mse", -0.24, "network", "s"),
    ("network, held out", NETWORK, "held_out_mse", -0.12, "network", "o"),
    ("spline through the same points, held out", NETWORK, "spline_held_out_mse", 0.0, "spline", "^"),
    ("second surrogate, held out", CLEARANCE, "held_out_mse", 0.12, "second surrogate", "o"),
    ("spline through its points, held out", CLEARANCE, "spline_held_out_mse", 0.24, "other", "^"),
)


def held_out(tables: Tables, scenario: Scenario) -> Drawing:
    """Errors at the training points and between them, networks, second surrogate and splines, beside the paper's."""
    errors = tables["fit_errors"]
    sheet = Sheet(6.6, 2, 1)
    above: Panel | None = None
    for row, (region, title) in enumerate((("all", "first revolution"), ("past_60_deg", "its part past 60 deg"))):
        panel = sheet.panel((row, 0), title, Quantity("output", ""), ERROR, below=above)
        _errors(panel, errors[errors["region"] == region], scenario.surrogate.seeds[0])
        panel.axes.set_yscale("log")
        panel.axes.minorticks_off()
        panel.categories([SYMBOLS[output] for output in OUTPUTS])
        above = panel
    drawing = sheet.drawing()
    shown = drawing.data[["y", "low", "high"]].to_numpy()
    for panel in sheet.panels:
        panel.axes.set_ylim(np.nanmin(shown) / 3, 3 * np.nanmax(shown))  # one scale, and no mark outside it
    sheet.legend()
    return drawing


def _errors(panel: Panel, errors: pd.DataFrame, default: int) -> None:
    """The default start's errors, with the range over all starts as bars."""
    place = np.arange(len(OUTPUTS))
    for series, model, column, shift, colour, marker in MARKS:
        rows = errors[errors["model"] == model]
        if rows.empty:
            continue
        lowest = highest = None
        if column in ("training_mse", "held_out_mse") and rows["seed"].nunique() > 1:
            grouped = rows.groupby("output")[column]
            lowest, highest = (grouped.agg(edge).reindex(OUTPUTS).to_numpy() for edge in ("min", "max"))
        shown = rows[rows["seed"].isna() | (rows["seed"] == default)].set_index("output")[column].reindex(OUTPUTS)
        panel.marks(
            series, place + shift, shown.to_numpy(), colour, lowest, highest, labels=list(OUTPUTS), marker=marker
        )
    paper = errors.groupby("output")["paper_mse"].first().reindex(OUTPUTS).to_numpy()
    panel.marks("paper, training points", place, paper, "paper", labels=list(OUTPUTS), marker="_", markersize=22)
