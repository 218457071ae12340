"""Figures of the optimum: errors before and after (figure 16), the objective, and the gain simulated again."""

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.plot import CRANK_ANGLE, Drawing, Panel, Quantity, Sheet
from jointgap.scenario.figures_base import (
    NETWORKS,
    OPTIMUM_PART,
    Tables,
    degrees,
    figure,
    loose_joints,
    predicted,
    revolution,
)

CRANK = Quantity("crank length", "mm", "$L_2$")
ROD = Quantity("rod length", "mm", "$L_3$")
RMS = Quantity("RMS error of μ", "deg")
MEASURES = {  # with the colour of each
    "rms": ("RMS", "simulation"),
    "mean_absolute": ("mean absolute", "second surrogate"),
    "peak": ("peak", "spline"),
    "sum_of_squares": ("sum of squares", "limit"),
}
SETTLED = "simulation_settled"
PRINTED = "paper's three points"
_APART = 0.07  # that what is frozen lies above what is simulated again: the two may be equal
LENGTHS = {
    "printed_genetic": "paper, genetic",
    "printed_local": "paper, best local",
    "printed_local_other": "paper, another local",
    "networks": "networks",
    "clearance": "second surrogate",
    "simulation": "simulation",
    "simulation_settled": "simulation, settled",
}
"""Where lengths come from, by point or by the source that the genetic algorithm searched, for the eye."""


@figure(
    "figure_16",
    "Errors of the transmission angle (the paper's figure 16)",
    OPTIMUM_PART,
    ("trajectory", "predictions", "optimise_optima"),
    "First revolution: desired minus actual angle at the original lengths, and desired minus optimised at the "
    "lengths of the genetic algorithm, with the joint motion frozen; top from the networks (as in the paper), bottom "
    "from the simulation. Other lengths can add little more than a multiple of the sine of the crank angle, so they "
    "cannot remove the journals' oscillation.",
)
def transmission_errors(tables: Tables, scenario: Scenario) -> Drawing:
    """Errors of the transmission angle before and after the optimisation, clearance motion frozen (figure 16)."""
    from jointgap.dynamics.kinematics import clearance_lift, transmission_angle

    samples = revolution(tables["trajectory"], scenario, 1)
    crank_angle, angle = samples["crank_angle"].to_numpy(), degrees(samples["crank_angle"])
    coordinates = [f"{name}{number}" for number in loose_joints(scenario).values() for name in ("r", "gamma")]
    motions = {
        NETWORKS: {name: predicted(tables, name)["value"].to_numpy() for name in coordinates},
        "simulation": {name: samples[name].to_numpy() for name in coordinates},
    }
    mechanism = scenario.mechanism.applied()
    crank, rod, offset = mechanism.crank.length, mechanism.rod.length, mechanism.slider.offset
    desired = transmission_angle(crank, rod, crank_angle, 0.0, offset)
    optima = tables["optimise_optima"]
    box = next(iter(scenario.optimise.boxes))
    sheet = Sheet(5.4, 2, 1)
    above: Panel | None = None
    for row, (source, motion) in enumerate(motions.items()):
        lift = clearance_lift(motion)
        best = optima[(optima["source"] == source) & (optima["box"] == box) & (optima["method"] == "genetic")].iloc[0]
        pairs = {
            "desired − actual": (crank, rod, "simulation"),
            "desired − optimised": (best["crank_length"], best["rod_length"], "genetic"),
        }
        title = (
            f"{source}: $L_2$ = {1e3 * best['crank_length']:.3f} mm, $L_3$ = {1e3 * best['rod_length']:.3f} mm, "
            f"RMS in the window {-100 * best['rms_reduction']:+.1f} %"
        ).replace("-", "−")
        error = Quantity("error of the angle", "deg", r"$\mu$")
        panel = sheet.panel((row, 0), title, CRANK_ANGLE, error, below=above)
        for series, (crank_length, rod_length, colour) in pairs.items():
            actual = transmission_angle(crank_length, rod_length, crank_angle, lift, offset)
            panel.line(series, angle, np.degrees(desired - actual), colour, linewidth=1.0)
        panel.horizontal_line("zero", 0.0)
        for edge in np.degrees(scenario.optimise.window):
            if 0.0 < edge < 359.99:
                panel.vertical_line("edge of the window", angle[0] + edge)
        panel.over_crank_angle(angle[0], angle[-1])
        above = panel
    sheet.legend()
    return sheet.drawing()


@figure(
    "valley",
    "The valley of the objective",
    OPTIMUM_PART,
    ("optimise_valley", "optimise_floor", "optimise_paths", "optimise_population", "optimise_optima"),
    "Joint motion frozen, from the networks. Left: RMS error over both lengths in the main box, with bounds, "
    "constraint, starts and paths of the local optimiser, the best of each generation of the genetic algorithm, both "
    "optima and, for the paper's mechanism, its three points. The error depends almost only on the ratio of the "
    "lengths: one flat valley, not many minima. Right: reduction of the error along the valley's floor, each measure "
    "at its own best crank length. It rises with the rod length, so the bound on the rod length determines the "
    "optimum.",
)
def valley(tables: Tables, scenario: Scenario) -> Drawing:
    """Objective over both lengths with what the optimisers did on it; reductions along the valley's floor."""
    box, optima = next(iter(scenario.optimise.boxes)), tables["optimise_optima"]
    source = NETWORKS if NETWORKS in set(optima["source"]) else SETTLED  # where no networks were trained
    chosen = {
        name: frame[(frame["source"] == source) & (frame["box"] == box)]
        for name, frame in ((name, tables[f"optimise_{name}"]) for name in ("valley", "floor", "paths", "population"))
    }
    optima = optima[optima["source"] == source]
    sheet = Sheet(4.9, 1, 2, width_ratios=[1.35, 1.0])
    _map(sheet, chosen, optima, scenario, box)
    _floor(sheet, chosen["floor"], optima, box)
    sheet.legend(sheet.panels[:1])
    return sheet.drawing()


def _map(sheet: Sheet, chosen: dict[str, pd.DataFrame], optima: pd.DataFrame, scenario: Scenario, box: str) -> None:
    from matplotlib.colors import LogNorm

    panel = sheet.panel((0, 0), f"error over both lengths, box '{box}'", CRANK, ROD)
    grid = chosen["valley"].pivot(index="rod_length", columns="crank_length", values="rms")
    x, y, value = 1e3 * grid.columns.to_numpy(), 1e3 * grid.index.to_numpy(), np.degrees(grid.to_numpy())
    levels = np.geomspace(value.min(), value.max(), 15)
    drawn = panel.contours("objective", x, y, value, RMS, levels=levels, cmap="Blues_r", norm=LogNorm())
    bar = sheet.figure.colorbar(drawn, ax=panel.axes, label=RMS.label, location="bottom", shrink=0.9, aspect=30)
    ticks = [tick for tick in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0) if value.min() <= tick <= value.max()]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.minorticks_off()

    bounds = scenario.optimise.boxes[box]
    (left, right), (low, high) = (1e3 * np.array(edges) for edges in (bounds.crank_length, bounds.rod_length))
    panel.line("bounds", [left, right, right, left, left], [low, low, high, high, low], "ideal", linewidth=1.0)
    limit = np.array([low, high])
    if (ratio := scenario.optimise.ratio_limit) is not None:
        panel.line(f"$L_2$ = {ratio:g} $L_3$", ratio * limit, limit, "ideal", linestyle=":", linewidth=1.2)
    floor = chosen["floor"][chosen["floor"]["measure"] == "rms"]
    panel.line(
        "valley's floor", 1e3 * floor["crank_length"], 1e3 * floor["rod_length"], "second surrogate", linewidth=2.2
    )
    for number, path in chosen["paths"].groupby("start"):
        x, y = 1e3 * path["crank_length"], 1e3 * path["rod_length"]
        panel.line("local paths", x, y, "local", linewidth=0.9)
        panel.marks("starting points", x.iloc[:1], y.iloc[:1], "local", markerfacecolor="white", labels=[str(number)])
    best = chosen["population"].loc[chosen["population"].groupby("generation")["sum_of_squares"].idxmin()]
    panel.marks(
        "genetic, generations' best",
        1e3 * best["crank_length"],
        1e3 * best["rod_length"],
        "genetic",
        marker="+",
        zorder=4,
    )
    _points(panel, optima, box, "crank_length", 1e3, "rod_length", 1e3)
    margin = 0.03 * np.array([right - left, high - low])
    panel.axes.set_xlim(left - margin[0], right + margin[0])
    panel.axes.set_ylim(low - margin[1], high + margin[1])


def _floor(sheet: Sheet, floor: pd.DataFrame, optima: pd.DataFrame, box: str) -> None:
    panel = sheet.panel((0, 1), "along the valley's floor", ROD, Quantity("reduction of the error", "%"))
    for measure, (words, colour) in MEASURES.items():
        part = floor[floor["measure"] == measure]
        dashes = "--" if measure == "mean_absolute" else "-"  # it may lie on the RMS
        panel.line(words, 1e3 * part["rod_length"], 100 * part["reduction"], colour, linewidth=1.3, linestyle=dashes)
    measures = panel.axes.get_lines()
    _points(panel, optima, box, "rod_length", 1e3, "rms_reduction", 100.0)
    bottom, top = panel.axes.get_ylim()
    panel.axes.set_ylim(bottom, top + 0.5 * (top - bottom))  # room for the legend
    panel.axes.legend(handles=measures, loc="upper left")


def _points(panel: Panel, optima: pd.DataFrame, box: str, x: str, x_factor: float, y: str, y_factor: float) -> None:
    """Optima found here and the paper's, under the objective of this scenario."""
    styles = {
        "genetic": ("genetic optimum", "genetic", {"marker": "*", "markersize": 11, "markeredgecolor": "white"}),
        "local": ("local optimum", "local", {"marker": "s", "markersize": 4}),
        "printed": (PRINTED, "paper", {"marker": "D", "markersize": 5.5, "markeredgecolor": "black"}),
    }
    for method, (series, colour, style) in styles.items():
        rows = optima[(optima["method"] == method) & (optima["box"].isna() | (optima["box"] == box))]
        if rows.empty:  # the paper's points are those of its own mechanism
            continue
        panel.marks(
            series, x_factor * rows[x], y_factor * rows[y], colour, labels=list(rows["point"]), zorder=5, **style
        )


@figure(
    "resimulation",
    "Frozen and true reductions",
    OPTIMUM_PART,
    ("optimise_resimulated",),
    "Reduction of the error of the transmission angle with the lengths named on the left (from the paper, and from the "
    "genetic algorithm on each source). Open diamonds: estimate with unchanged joint motion (frozen). Dots: simulated "
    "again, median of an ensemble of perturbed starts; bars: 5 to 95 %. Left: window of the first revolution; right: a "
    "settled revolution. A bar that crosses zero means no reliable gain.",
)
def resimulation(tables: Tables, scenario: Scenario) -> Drawing:
    """Reductions with the clearance motion frozen, beside those of the mechanism simulated with the new lengths."""
    table, box = tables["optimise_resimulated"], next(iter(scenario.optimise.boxes))
    origin_of = {
        name if name.startswith("printed_") else f"{name}_{box}_genetic": words for name, words in LENGTHS.items()
    }
    wanted = [point for point in table["point"].unique() if point in origin_of]
    names = [origin_of[point] for point in wanted]
    place = np.arange(len(wanted))[::-1]
    sheet = Sheet(1.6 + 0.72 * len(wanted), 1, 2)
    left_panel: Panel | None = None
    for column, (stretch, title) in enumerate(
        (("window", "window of the first revolution"), ("settled", "whole settled revolution"))
    ):
        panel = sheet.panel((0, column), title, Quantity("reduction of the error", "%"), Quantity("lengths from", ""))
        part = table[table["stretch"] == stretch]
        for lengths in place[::2]:
            panel.axes.axhspan(lengths - 0.5, lengths + 0.5, color="#F4F4F4", zorder=0)
        for shift, measure in ((0.3, "rms"), (0.0, "mean_absolute"), (-0.3, "peak")):
            words, colour = MEASURES[measure]
            rows = part[part["measure"] == measure].set_index("point").loc[wanted]
            panel.marks(
                f"{words}, simulated again",
                100 * rows["reduction"],
                place + shift - _APART,
                colour,
                100 * rows["reduction_low"],
                100 * rows["reduction_high"],
                labels=wanted,
                along="x",
            )
            panel.marks(
                f"{words}, motion frozen",
                100 * rows["frozen_reduction"],
                place + shift + _APART,
                colour,
                labels=wanted,
                marker="D",
                markerfacecolor="white",
            )
        panel.vertical_line("no change", 0.0, named=False)
        panel.rows(names if left_panel is None else [""] * len(names), place)
        panel.axes.set_ylim(-0.5, len(names) - 0.5)
        if left_panel is not None:
            panel.axes.set_ylabel("")
        left_panel = panel
    sheet.legend()
    return sheet.drawing()
