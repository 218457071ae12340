"""Figures 9-15: rod, piston and transmission angle, without clearance (desired) and with it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.figures.drawing import Drawing
from jointgap.figures.figure_data import degrees
from jointgap.figures.sheet import CRANK_ANGLE, Panel, Quantity, Sheet, round_up

Tables = Mapping[str, pd.DataFrame]
SIMULATION, NETWORKS, DESIRED = "with clearance: simulation", "with clearance: networks", "without clearance (desired)"
IMPACTS_DWARF = 4.0  # a curve this many times as high as the desired one gets a partly logarithmic scale


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


def rod_position(tables: Tables, scenario: Scenario) -> Drawing:
    """Rod's mass centre: position (figure 9)."""
    return _compare(tables, [axis["position"] for axis in ROD])


def rod_velocity(tables: Tables, scenario: Scenario) -> Drawing:
    """Rod's mass centre: velocity (figure 10)."""
    return _compare(tables, [axis["velocity"] for axis in ROD])


def rod_acceleration(tables: Tables, scenario: Scenario) -> Drawing:
    """Rod's mass centre: acceleration (figure 11)."""
    return _compare(tables, [axis["acceleration"] for axis in ROD])


def piston_position(tables: Tables, scenario: Scenario) -> Drawing:
    """Piston: position (figure 12)."""
    return _compare(tables, [axis["position"] for axis in PISTON])


def piston_velocity(tables: Tables, scenario: Scenario) -> Drawing:
    """Piston: velocity (figure 13)."""
    return _compare(tables, [axis["velocity"] for axis in PISTON])


def piston_acceleration(tables: Tables, scenario: Scenario) -> Drawing:
    """Piston: acceleration (figure 14)."""
    return _compare(tables, [axis["acceleration"] for axis in PISTON])


def transmission_angle(tables: Tables, scenario: Scenario) -> Drawing:
    """Transmission angle with and without clearance (figure 15)."""
    return _compare(tables, [TRANSMISSION])


def _compare(tables: Tables, curves: list[Curve]) -> Drawing:
    """Desired and actual above, their difference below, a column for each curve."""
    sources = dict(list(tables["kinematics"].groupby("source")))
    angle = degrees(sources["simulation"]["crank_angle"])
    sheet = Sheet(5.0, 2, len(curves))
    for column, curve in enumerate(curves):
        desired, simulated, networks = (
            curve.factor * sources[source][curve.column].to_numpy()
            for source in ("ideal", "simulation", "networks_paper_form")
        )
        above = sheet.panel((0, column), curve.title, CRANK_ANGLE, Quantity(curve.name, curve.unit))
        below = sheet.panel(
            (1, column), "deviation", CRANK_ANGLE, Quantity("actual − desired", curve.unit), below=above
        )
        for panel, less in ((above, 0.0), (below, desired)):
            panel.line(NETWORKS, angle, networks - less, "network", linewidth=0.8)
            panel.line(SIMULATION, angle, simulated - less, "simulation", linewidth=0.9)
            _spread_scale(panel, desired, np.concatenate([simulated - less, networks - less]))
        above.line(DESIRED, angle, desired, "ideal", linestyle="--", linewidth=1.1)
        below.over_crank_angle(angle[0], angle[-1])
    sheet.legend()
    return sheet.drawing()


def _spread_scale(panel: Panel, desired: np.ndarray, shown: np.ndarray) -> None:
    """A scale linear up to the desired motion's peak and logarithmic beyond, where impacts dwarf the motion."""
    peak = np.max(np.abs(desired))
    if np.nanmax(np.abs(shown)) > IMPACTS_DWARF * peak:
        panel.linear_then_logarithmic(round_up(peak))
