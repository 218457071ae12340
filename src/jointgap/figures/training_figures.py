"""Figure 8 and the errors between the training points."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import Panel, Quantity, Sheet
from jointgap.tables import number_of, outputs

Tables = Mapping[str, pd.DataFrame]
_SYMBOLS = {"r": "r", "gamma": r"\gamma", "gamma_dot": r"\dot\gamma", "gamma_ddot": r"\ddot\gamma"}
PAPER_ITERATIONS = 20_000  # of every network in the paper
SHAPES = {4: (2.9, 1, 4), 8: (4.6, 2, 4), 12: (6.4, 3, 4)}  # height, rows and columns by the number of outputs
CURVE_POINTS = 300  # of a curve over thousands of iterations, evenly spaced on its logarithmic axis
ERROR = Quantity("MSE over squared range", "1")
NETWORK, CLEARANCE = "network", "clearance"  # models of the table fit_errors


def symbol(output: str) -> str:
    """An output as mathtext."""
    number = str(number_of(output))
    return f"${_SYMBOLS[output.replace(number, '')]}_{number}$"


def mse_curves(tables: Tables, scenario: Scenario) -> Drawing:
    """Mean square error at the training points over the iterations, a panel for each network (figure 8)."""
    history, default = tables["fit_history"], scenario.surrogate.seeds[0]
    paper = tables["fit_errors"].drop_duplicates("output").set_index("output")["paper_mse"]
    learned = outputs(scenario.mechanism.applied().loose)
    sheet = Sheet(*SHAPES[len(learned)])
    rows = SHAPES[len(learned)][1]
    lowest, highest = np.inf, 0.0
    first: Panel | None = None
    for place, output in enumerate(learned):
        row, column = place % rows, place // rows
        above = sheet.panels[-1] if row else None
        panel = sheet.panel((row, column), f"network {symbol(output)}", Quantity("iteration", "1"), ERROR, below=above)
        curves = history[history["output"] == output]
        for seed in reversed(curves["seed"].unique()):
            curve = _thinned(curves[(curves["seed"] == seed) & (curves["iteration"] > 0)])
            series, look = (
                ("default start", {"linewidth": 1.4, "zorder": 3}) if seed == default else ("other starts", {})
            )
            colour = "network" if seed == default else "other"
            panel.line(series, curve["iteration"], curve["mse"], colour, **({"linewidth": 0.6} | look))
            lowest, highest = min(lowest, curve["mse"].min()), max(highest, curve["mse"].max())
        if paper[output] > 0:  # there is one
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
    errors, learned = tables["fit_errors"], outputs(scenario.mechanism.applied().loose)
    sheet = Sheet(6.6, 2, 1)
    above: Panel | None = None
    for row, (region, title) in enumerate((("all", "first revolution"), ("past_60_deg", "its part past 60 deg"))):
        panel = sheet.panel((row, 0), title, Quantity("output", ""), ERROR, below=above)
        _errors(panel, errors[errors["region"] == region], scenario.surrogate.seeds[0], learned)
        panel.axes.set_yscale("log")
        panel.axes.minorticks_off()
        panel.categories([symbol(output) for output in learned])
        above = panel
    drawing = sheet.drawing()
    shown = drawing.data[["y", "low", "high"]].to_numpy()
    for panel in sheet.panels:
        panel.axes.set_ylim(np.nanmin(shown) / 3, 3 * np.nanmax(shown))  # one scale, and no mark outside it
    sheet.legend()
    return drawing


def _errors(panel: Panel, errors: pd.DataFrame, default: int, learned: tuple[str, ...]) -> None:
    """The default start's errors, with the range over all starts as bars."""
    place = np.arange(len(learned))
    for series, model, column, shift, colour, marker in MARKS:
        rows = errors[errors["model"] == model]
        if rows.empty:
            continue
        lowest = highest = None
        if column in ("training_mse", "held_out_mse") and rows["seed"].nunique() > 1:
            grouped = rows.groupby("output")[column]
            lowest, highest = (grouped.agg(edge).reindex(learned).to_numpy() for edge in ("min", "max"))
        shown = rows[rows["seed"].isna() | (rows["seed"] == default)].set_index("output")[column].reindex(learned)
        panel.marks(
            series, place + shift, shown.to_numpy(), colour, lowest, highest, labels=list(learned), marker=marker
        )
    paper = errors.groupby("output")["paper_mse"].first().reindex(learned).to_numpy()
    if np.isfinite(paper).any():
        panel.marks("paper, training points", place, paper, "paper", labels=list(learned), marker="_", markersize=22)
