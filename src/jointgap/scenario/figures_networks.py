"""Figures of the networks: what they learn (figures 5-8), their errors between the training points, and whether they
agree with each other."""

from functools import partial

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.joints import number_of, outputs
from jointgap.core.plot import CRANK_ANGLE, Drawing, Panel, Quantity, Sheet, width_for
from jointgap.core.words import in_words
from jointgap.scenario.figures_base import (
    FIGURES,
    NETWORKS,
    NETWORKS_PART,
    Tables,
    by_source,
    degrees,
    figure,
    loose_joints,
    predicted,
    revolution,
)

EVERYWHERE, AT_POINTS = "network − simulation, all samples", "network − simulation, training points"
DEGREES = 180.0 / np.pi
QUANTITIES = {  # by kind of output: name, unit, factor, unit and factor of its error, symbol
    "r": ("clearance", "mm", 1e3, "µm", 1e6, "r_{}"),
    "gamma": ("direction", "deg", DEGREES, "deg", DEGREES, r"\gamma_{}"),
    "gamma_dot": ("rate", "rad/s", 1.0, "rad/s", 1.0, r"\dot\gamma_{}"),
    "gamma_ddot": ("acceleration", "rad/s²", 1.0, "rad/s²", 1.0, r"\ddot\gamma_{}"),
}


def symbol(output: str) -> str:
    """An output as mathtext."""
    number = str(number_of(output))
    return f"${QUANTITIES[output.replace(number, '')][-1].format(number)}$"


def _values_and_errors(kinds: tuple[str, ...], tables: Tables, scenario: Scenario) -> Drawing:
    """Values above their errors, a column for each joint, a pair of rows for each kind of output."""
    samples = revolution(tables["trajectory"], scenario, 1)
    angle = degrees(samples["crank_angle"])
    points = slice(None, None, scenario.simulate.samples_per_revolution // (scenario.surrogate.training_points - 1))
    joints = loose_joints(scenario)
    sheet = Sheet(0.6 + 4.2 * len(kinds), 2 * len(kinds), len(joints), width=width_for(len(joints)))
    for column, (joint, number) in enumerate(joints.items()):
        name = in_words(joint)
        for row, kind in enumerate(kinds):
            output = kind.replace(kind.partition("_")[0], f"{kind.partition('_')[0]}{number}")
            words, unit, factor, error_unit, error_factor, _ = QUANTITIES[kind]
            simulated = samples[output].to_numpy()
            network = predicted(tables, output)["value"].to_numpy()
            value = Quantity(words, unit, symbol(output))
            above = sheet.panel((2 * row, column), f"{name}: {words} {symbol(output)}", CRANK_ANGLE, value)
            above.line("simulation", angle, factor * simulated, "simulation", linewidth=1.0)
            above.line("network", angle, factor * network, "network", linewidth=0.8, linestyle=(0, (4, 2)))
            if output == "gamma2":
                above.line("crank angle", angle, angle, "limit", linewidth=0.9, linestyle=":")
            above.spread_scale(factor * np.concatenate([simulated, network]))
            error, place = error_factor * (network - simulated), (2 * row + 1, column)
            below = sheet.panel(place, f"{name}: error", CRANK_ANGLE, Quantity("error", error_unit), below=above)
            below.line(EVERYWHERE, angle, error, "network", linewidth=0.7)
            below.marks(AT_POINTS, angle[points], error[points], "ideal", markersize=1.6)
            below.over_crank_angle(angle[0], angle[-1])
            below.spread_scale(error)
    sheet.legend()
    return sheet.drawing()


for _number, _call, _title, _kinds, _caption in (
    (5, "clearances", "Clearances", ("r",), "Top: distance of the centres in each loose joint."),
    (
        6,
        "directions",
        "Directions",
        ("gamma",),
        "Top: direction of the clearance, unwrapped; dotted: the crank angle. The direction does not follow the crank: "
        "it turns at load reversals and oscillates around the journal's equilibrium.",
    ),
    (
        7,
        "derivatives",
        "Derivatives",
        ("gamma_dot", "gamma_ddot"),
        "Top of each pair: rate or acceleration of the direction. Steel contacts oscillate at some kHz, about once per "
        "degree at 600 rpm; one training point per degree cannot resolve this.",
    ),
):
    FIGURES.figure(
        f"figure_{_number:02}",
        f"{_title} (the paper's figure {_number})",
        NETWORKS_PART,
        ("trajectory", "predictions"),
        f"First revolution, simulation and network. {_caption} Bottom: network minus simulation, at the training "
        "points (black) and at all samples. A small error at the training points says nothing about the error "
        "between them.",
        call=_call,
    )(partial(_values_and_errors, _kinds))


PAPER_ITERATIONS = 20_000  # of every network in the paper
SHAPES = {4: (2.9, 1, 4), 8: (4.6, 2, 4), 12: (6.4, 3, 4)}  # height, rows and columns by the number of outputs
CURVE_POINTS = 300  # of a curve over thousands of iterations, evenly spaced on its logarithmic axis
ERROR = Quantity("MSE over squared range", "1")
NETWORK, REGULARISED, CLEARANCE = "network", "regularised", "clearance"  # models of the table fit_errors


@figure(
    "figure_08",
    "Mean square error over the training (the paper's figure 8)",
    NETWORKS_PART,
    ("fit_history", "fit_errors"),
    "Mean square error at the training points over the squared range of the output, after each Levenberg-Marquardt "
    "iteration. Thick: default start; thin: the other starts. Diamonds: printed in the paper, after 20 000 iterations. "
    "A curve that ends below its diamond reaches the paper's training error; the test error is another figure.",
)
def mse_curves(tables: Tables, scenario: Scenario) -> Drawing:
    """Mean square error at the training points over the iterations, a panel for each network (figure 8)."""
    history, default = tables["fit_history"], scenario.surrogate.seeds[0]
    history = history[history["model"] == NETWORK]
    paper = tables["fit_errors"].drop_duplicates("output").set_index("output")["paper_mse"]
    learned = outputs(scenario.mechanism.applied().loose)
    sheet = Sheet(*SHAPES[len(learned)])
    rows = SHAPES[len(learned)][1]
    lowest, highest = np.inf, 0.0
    first: Panel | None = None
    for place, output in enumerate(learned):
        column, row = divmod(place, rows)
        above = sheet.panels[-1] if row else None
        panel = sheet.panel((row, column), f"network {symbol(output)}", Quantity("iteration", "1"), ERROR, below=above)
        curves = history[(history["output"] == output) & (history["iteration"] > 0)]
        for seed in reversed(curves["seed"].unique()):
            curve = _thinned(curves[curves["seed"] == seed])
            if seed == default:
                look = {"series": "default start", "colour": "network", "linewidth": 1.4, "zorder": 3}
            else:
                look = {"series": "other starts", "colour": "other", "linewidth": 0.6}
            panel.line(x=curve["iteration"], y=curve["mse"], **look)
            lowest, highest = min(lowest, curve["mse"].min()), max(highest, curve["mse"].max())
        if paper[output] > 0:  # the paper prints one
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


@figure(
    "held_out",
    "Errors between the training points",
    NETWORKS_PART,
    ("fit_errors",),
    "Mean square errors over the squared range of each output, for the first revolution and for its part past 60 deg: "
    "the paper's networks, the regularised networks and the second surrogate at training points and at held-out "
    "samples, each with a spline through the same points, and the paper's printed training errors (horizontal marks). "
    "Marks: default start; bars: range over all starts. A circle far above its square shows overfitting; a triangle "
    "below a circle shows that a spline does better than the network.",
)
def held_out(tables: Tables, scenario: Scenario) -> Drawing:
    """Errors at the training points and between them: networks, second surrogate, splines, and the paper's."""
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
    place, labels = np.arange(len(learned)), list(learned)
    for series, model, column, shift, colour, marker in _MARKS:
        rows = errors[errors["model"] == model]
        if rows.empty:
            continue
        lowest = highest = None
        if column in ("training_mse", "held_out_mse") and rows["seed"].nunique() > 1:
            grouped = rows.groupby("output")[column]
            lowest, highest = (grouped.agg(edge).reindex(learned).to_numpy() for edge in ("min", "max"))
        shown = rows[rows["seed"].isna() | (rows["seed"] == default)].set_index("output")[column].reindex(learned)
        panel.marks(series, place + shift, shown.to_numpy(), colour, lowest, highest, labels, marker=marker)
    paper = errors.groupby("output")["paper_mse"].first().reindex(learned).to_numpy()
    if np.isfinite(paper).any():
        panel.marks("paper, training points", place, paper, "paper", labels=labels, marker="_", markersize=22)


@figure(
    "contradictions",
    "Networks that contradict each other",
    NETWORKS_PART,
    ("trajectory", "predictions", "kinematics"),
    "First revolution. Top: derivative of the network of the direction minus the network of its rate; zero if they "
    "agree. Bottom: resulting error of the piston's motion, with each output from its own network (as in the paper) "
    "and with one output derived from another's network: position from integrated rates, acceleration from "
    "differentiated directions. Independent fits do not describe one motion.",
)
def contradictions(tables: Tables, scenario: Scenario) -> Drawing:
    """Rates of the directions learned and derived; errors of the piston's motion that follow from either."""
    joints = loose_joints(scenario)
    shares = 2 * len(joints)  # the piston's two panels take half of the width each, those of the joints a share each
    sheet = Sheet(5.6, 2, shares, width=width_for(len(joints)))
    for place, (joint, number) in enumerate(joints.items()):
        name = f"gamma{number}"
        own, learned = predicted(tables, name), predicted(tables, f"{name}_dot")
        angle = degrees(own["crank_angle"])
        title = f"{in_words(joint)}: d{symbol(name)}/dt − {symbol(f'{name}_dot')}"
        columns = slice(2 * place, 2 * place + 2)
        panel = sheet.panel((0, columns), title, CRANK_ANGLE, Quantity("contradiction", "rad/s"))
        difference = own["rate"].to_numpy() - learned["value"].to_numpy()
        panel.line("derivative of one network − the other network", angle, difference, "ideal", linewidth=0.8)
        panel.over_crank_angle(angle[0], angle[-1])
        panel.spread_scale(difference)
    sources = by_source(tables)
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
        for series, source, colour in (
            ("one output derived from another's network", form, "spline"),
            ("each output from its own network", "paper_form", "network"),
        ):
            errors.append(factor * (sources[f"{NETWORKS}_{source}"][quantity].to_numpy() - true))
            panel.line(series, angle, errors[-1], colour, linewidth=0.9)
        panel.over_crank_angle(angle[0], angle[-1])
        panel.spread_scale(np.concatenate(errors))
    sheet.legend()
    return sheet.drawing()
