"""Figures 9-16: rod, piston and transmission angle without clearance (desired) and with it, and what other lengths
leave of the error.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.figures.figure_data import NETWORKS, degrees, loose_joints, predicted, revolution
from jointgap.figures.sheet import CRANK_ANGLE, IMPACTS_DWARF, Panel, Quantity, Sheet, round_up
from jointgap.figures.style import Drawing
from jointgap.mechanism import clearance_lift, transmission_angle

Tables = Mapping[str, pd.DataFrame]
_SIMULATED, _PREDICTED, _DESIRED = (
    "with clearance: simulation",
    "with clearance: networks",
    "without clearance (desired)",
)


_NETWORKS = "networks_paper_form"
"""Source of what the networks say, which is not there where none were trained."""


@dataclass(frozen=True)
class Curve:
    """A column of the table kinematics as figures show it."""

    column: str
    title: str
    name: str
    unit: str
    factor: float = 1.0


def _orders(body: str, axis: str, words: str) -> dict[str, Curve]:
    shown = (("position", "mm", 1e3), ("velocity", "m/s", 1.0), ("acceleration", "m/s²", 1.0))
    return {order: Curve(f"{body}_{order}{axis}", words, order, unit, factor) for order, unit, factor in shown}


ROD = [_orders("rod", f"_{axis}", f"rod's mass centre, {axis}") for axis in "xy"]
PISTON = [_orders("slider", "", "piston")]
TRANSMISSION = Curve("transmission_angle", "transmission angle", "transmission angle", "deg", 180.0 / np.pi)


def _compare(curves: list[Curve], tables: Tables, scenario: Scenario) -> Drawing:
    """Desired and actual above, their difference below, a column for each curve."""
    sources = dict(list(tables["kinematics"].groupby("source")))
    angle = degrees(sources["simulation"]["crank_angle"])
    sheet = Sheet(5.0, 2, len(curves))
    for column, curve in enumerate(curves):
        desired, simulated = (
            curve.factor * sources[source][curve.column].to_numpy() for source in ("ideal", "simulation")
        )
        actual = {_SIMULATED: (simulated, "simulation", 0.9)}
        if _NETWORKS in sources:  # below the simulation's
            networks = curve.factor * sources[_NETWORKS][curve.column].to_numpy()
            actual = {_PREDICTED: (networks, "network", 0.8)} | actual
        above = sheet.panel((0, column), curve.title, CRANK_ANGLE, Quantity(curve.name, curve.unit))
        below = sheet.panel(
            (1, column), "deviation", CRANK_ANGLE, Quantity("actual − desired", curve.unit), below=above
        )
        for panel, less in ((above, 0.0), (below, desired)):
            for series, (values, colour, width) in actual.items():
                panel.line(series, angle, values - less, colour, linewidth=width)
            _spread_scale(panel, desired, np.concatenate([values - less for values, _, _ in actual.values()]))
        above.line(_DESIRED, angle, desired, "ideal", linestyle="--", linewidth=1.1)
        below.over_crank_angle(angle[0], angle[-1])
    sheet.legend()
    return sheet.drawing()


def _spread_scale(panel: Panel, desired: np.ndarray, shown: np.ndarray) -> None:
    """A scale linear up to the desired motion's peak and logarithmic beyond, where impacts dwarf the motion."""
    peak = np.max(np.abs(desired))
    if np.nanmax(np.abs(shown)) > IMPACTS_DWARF * peak:
        panel.linear_then_logarithmic(round_up(peak))


rod_position, rod_velocity, rod_acceleration = (
    partial(_compare, [axis[order] for axis in ROD]) for order in ("position", "velocity", "acceleration")
)
"""Rod's mass centre, figures 9-11: both axes."""

piston_position, piston_velocity, piston_acceleration = (
    partial(_compare, [axis[order] for axis in PISTON]) for order in ("position", "velocity", "acceleration")
)
"""Piston, figures 12-14."""

transmission_angles = partial(_compare, [TRANSMISSION])
"""Transmission angle with and without clearance, figure 15."""


ACTUAL, OPTIMISED = "desired − actual", "desired − optimised"


def transmission_errors(tables: Tables, scenario: Scenario) -> Drawing:
    """Errors of the transmission angle before and after the optimisation, clearance motion frozen (figure 16).

    Arguments as in `draw`.
    """
    samples = revolution(tables["trajectory"], scenario, 1)
    crank_angle, angle = samples["crank_angle"].to_numpy(), degrees(samples["crank_angle"])
    coordinates = [f"{name}{number}" for number in loose_joints(scenario).values() for name in ("r", "gamma")]
    motions = {
        NETWORKS: {name: predicted(tables, NETWORKS, name)["value"].to_numpy() for name in coordinates},
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
            ACTUAL: (crank, rod, "simulation"),
            OPTIMISED: (best["crank_length"], best["rod_length"], "genetic"),
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
