"""Figures 5-8, errors between the training points, contradictions: what the networks learn, and where they miss."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.joints import number_of, outputs
from jointgap.core.plot import CRANK_ANGLE, Drawing, Panel, Quantity, Sheet, width_for
from jointgap.core.words import in_words
from jointgap.scenario.figures import NETWORKS, degrees, loose_joints, predicted, revolution, training_rows

Tables = Mapping[str, pd.DataFrame]
SIMULATION, LEARNED, EVERYWHERE, AT_POINTS = (
    "simulation",
    "network",
    "network − simulation, all samples",
    "network − simulation, training points",
)


@dataclass(frozen=True)
class Output:
    """One learned output as figures show it; `joint` is its number."""

    column: str
    title: str
    value: Quantity
    factor: float
    error: Quantity
    error_factor: float


def _lengths(joint: int, name: str) -> Output:
    value = Quantity("clearance", "mm", f"$r_{joint}$")
    return Output(f"r{joint}", f"{name}: clearance $r_{joint}$", value, 1e3, Quantity("error", "µm"), 1e6)


def _directions(joint: int, name: str) -> Output:
    value = Quantity("direction", "deg", rf"$\gamma_{joint}$")
    factor = 180.0 / np.pi
    return Output(
        f"gamma{joint}", rf"{name}: direction $\gamma_{joint}$", value, factor, Quantity("error", "deg"), factor
    )


def _rates(joint: int, name: str) -> Output:
    symbol = rf"$\dot\gamma_{joint}$"
    value, error = Quantity("rate", "rad/s", symbol), Quantity("error", "rad/s")
    return Output(f"gamma{joint}_dot", f"{name}: rate {symbol}", value, 1.0, error, 1.0)


def _accelerations(joint: int, name: str) -> Output:
    symbol = rf"$\ddot\gamma_{joint}$"
    value, error = Quantity("acceleration", "rad/s²", symbol), Quantity("error", "rad/s²")
    return Output(f"gamma{joint}_ddot", f"{name}: acceleration {symbol}", value, 1.0, error, 1.0)


def _values_and_errors(kinds: tuple, tables: Tables, scenario: Scenario) -> Drawing:
    """Values above their errors, a column for each joint, a pair of rows for each kind of output."""
    samples = revolution(tables["trajectory"], scenario, 1)
    angle = degrees(samples["crank_angle"])
    points = training_rows(scenario)
    joints = loose_joints(scenario)
    sheet = Sheet(0.6 + 4.2 * len(kinds), 2 * len(kinds), len(joints), width=width_for(len(joints)))
    for column, (joint, number) in enumerate(joints.items()):
        name = in_words(joint)
        for row, kind in enumerate(kinds):
            output = kind(number, name)
            simulated = samples[output.column].to_numpy()
            network = predicted(tables, NETWORKS, output.column)["value"].to_numpy()
            above = sheet.panel((2 * row, column), output.title, CRANK_ANGLE, output.value)
            above.line(SIMULATION, angle, output.factor * simulated, "simulation", linewidth=1.0)
            above.line(LEARNED, angle, output.factor * network, "network", linewidth=0.8, linestyle=(0, (4, 2)))
            if output.column == "gamma2":
                above.line("crank angle", angle, angle, "limit", linewidth=0.9, linestyle=":")
            above.spread_scale(output.factor * np.concatenate([simulated, network]))
            error = output.error_factor * (network - simulated)
            below = sheet.panel((2 * row + 1, column), f"{name}: error", CRANK_ANGLE, output.error, below=above)
            below.line(EVERYWHERE, angle, error, "network", linewidth=0.7)
            below.marks(AT_POINTS, angle[points], error[points], "ideal", markersize=1.6)
            below.over_crank_angle(angle[0], angle[-1])
            below.spread_scale(error)
    sheet.legend()
    return sheet.drawing()


clearances = partial(_values_and_errors, (_lengths,))
"""Equivalent clearances and convergence errors, figure 5."""

directions = partial(_values_and_errors, (_directions,))
"""Directions of the clearances and convergence errors, figure 6."""

derivatives = partial(_values_and_errors, (_rates, _accelerations))
"""Time derivatives of the directions and convergence errors, figure 7."""


_SYMBOLS = {"r": "r", "gamma": r"\gamma", "gamma_dot": r"\dot\gamma", "gamma_ddot": r"\ddot\gamma"}
PAPER_ITERATIONS = 20_000  # of every network in the paper
SHAPES = {4: (2.9, 1, 4), 8: (4.6, 2, 4), 12: (6.4, 3, 4)}  # height, rows and columns by the number of outputs
CURVE_POINTS = 300  # of a curve over thousands of iterations, evenly spaced on its logarithmic axis
ERROR = Quantity("MSE over squared range", "1")
NETWORK, REGULARISED, CLEARANCE = "network", "regularised", "clearance"  # models of the table fit_errors


def symbol(output: str) -> str:
    """An output as mathtext."""
    number = str(number_of(output))
    return f"${_SYMBOLS[output.replace(number, '')]}_{number}$"


def mse_curves(tables: Tables, scenario: Scenario) -> Drawing:
    """Mean square error at the training points over the iterations, a panel for each network (figure 8).

    Arguments as in `draw`.
    """
    history, default = tables["fit_history"], scenario.surrogate.seeds[0]
    history = history[history["model"] == NETWORK]
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
            series, style = (
                ("default start", {"linewidth": 1.4, "zorder": 3}) if seed == default else ("other starts", {})
            )
            colour = "network" if seed == default else "other"
            panel.line(series, curve["iteration"], curve["mse"], colour, **({"linewidth": 0.6} | style))
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
_MARKS = (
    ("network, training points", NETWORK, "training_mse", -0.32, "network", "s"),
    ("network, held out", NETWORK, "held_out_mse", -0.24, "network", "o"),
    ("spline through the same points, held out", NETWORK, "spline_held_out_mse", -0.16, "spline", "^"),
    ("regularised network, training points", REGULARISED, "training_mse", -0.06, "local", "s"),
    ("regularised network, held out", REGULARISED, "held_out_mse", 0.02, "local", "o"),
    ("smoothing spline of its points, held out", REGULARISED, "smoothing_spline_held_out_mse", 0.10, "spline", "v"),
    ("second surrogate, held out", CLEARANCE, "held_out_mse", 0.22, "second surrogate", "o"),
    ("spline through its points, held out", CLEARANCE, "spline_held_out_mse", 0.32, "other", "^"),
)


def held_out(tables: Tables, scenario: Scenario) -> Drawing:
    """Errors at the training points and between them, networks, second surrogate and splines, beside the paper's.

    Arguments as in `draw`.
    """
    errors, learned = tables["fit_errors"], outputs(scenario.mechanism.applied().loose)
    sheet = Sheet(6.6, 2, 1)
    above: Panel | None = None
    for row, (region, title) in enumerate((("all", "first revolution"), ("past_60_deg", "its part past 60 deg"))):
        panel = sheet.panel((row, 0), title, Quantity("output", ""), ERROR, below=above)
        _error_marks(panel, errors[errors["region"] == region], scenario.surrogate.seeds[0], learned)
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


def _error_marks(panel: Panel, errors: pd.DataFrame, default: int, learned: tuple[str, ...]) -> None:
    """The default start's errors, with the range over all starts as bars."""
    place = np.arange(len(learned))
    for series, model, column, shift, colour, marker in _MARKS:
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


EACH = "each output from its own network"
OTHER = "one output derived from another's network"
DIFFERENCE = "derivative of one network − the other network"


def contradictions(tables: Tables, scenario: Scenario) -> Drawing:
    """Rates of the directions learned and derived; errors of the piston's motion that follow from either.

    Arguments as in `draw`.
    """
    joints = loose_joints(scenario)
    shares = 2 * len(joints)  # the piston's two panels take half of the width each, those of the joints a share each
    sheet = Sheet(5.6, 2, shares, width=width_for(len(joints)))
    for place, (joint, number) in enumerate(joints.items()):
        name, words = f"gamma{number}", in_words(joint)
        own, learned = predicted(tables, NETWORKS, name), predicted(tables, NETWORKS, f"{name}_dot")
        angle = degrees(own["crank_angle"])
        title = f"{words}: d{symbol(name)}/dt − {symbol(f'{name}_dot')}"
        columns = slice(2 * place, 2 * place + 2)
        panel = sheet.panel((0, columns), title, CRANK_ANGLE, Quantity("contradiction", "rad/s"))
        difference = own["rate"].to_numpy() - learned["value"].to_numpy()
        panel.line(DIFFERENCE, angle, difference, "ideal", linewidth=0.8)
        panel.over_crank_angle(angle[0], angle[-1])
        panel.spread_scale(difference)
    sources = dict(list(tables["kinematics"].groupby("source")))
    angle = degrees(sources["simulation"]["crank_angle"])
    for column, (quantity, title, unit, factor, form) in enumerate(
        (
            ("slider_position", r"piston: position, $\gamma$ integrated", "mm", 1e3, "integrated"),
            ("slider_acceleration", r"piston: acceleration, $\gamma$ differentiated", "m/s²", 1.0, "own_rates"),
        )
    ):
        true = sources["simulation"][quantity].to_numpy()
        columns = slice(column * shares // 2, (column + 1) * shares // 2)
        panel = sheet.panel((1, columns), title, CRANK_ANGLE, Quantity("networks − simulation", unit))
        errors = []
        for series, source, colour in ((OTHER, form, "spline"), (EACH, "paper_form", "network")):
            error = factor * (sources[f"{NETWORKS}_{source}"][quantity].to_numpy() - true)
            panel.line(series, angle, error, colour, linewidth=0.9)
            errors.append(error)
        panel.over_crank_angle(angle[0], angle[-1])
        panel.spread_scale(np.concatenate(errors))
    sheet.legend()
    return sheet.drawing()
