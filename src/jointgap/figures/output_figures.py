"""Figures 5-7: what the networks learn, simulation against network, at the training points and between them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.figures.drawing import Drawing
from jointgap.figures.figure_data import NETWORKS, degrees, in_words, loose_joints, predicted, revolution, training_rows
from jointgap.figures.sheet import CRANK_ANGLE, Panel, Quantity, Sheet, round_up, width_for

Tables = Mapping[str, pd.DataFrame]
SIMULATION, NETWORK, EVERYWHERE, AT_POINTS = (
    "simulation",
    "network",
    "network − simulation, all samples",
    "network − simulation, training points",
)
BULK = 95.0  # [%] of the samples lie in the linear part of a scale that is logarithmic beyond
IMPACTS_DWARF = 4.0  # times beyond the bulk at which a scale becomes logarithmic


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


def clearances(tables: Tables, scenario: Scenario) -> Drawing:
    """Equivalent clearances and convergence errors (figure 5)."""
    return _compare(tables, scenario, (_lengths,))


def directions(tables: Tables, scenario: Scenario) -> Drawing:
    """Directions of the clearances and convergence errors (figure 6)."""
    return _compare(tables, scenario, (_directions,))


def derivatives(tables: Tables, scenario: Scenario) -> Drawing:
    """Time derivatives of the directions and convergence errors (figure 7)."""
    return _compare(tables, scenario, (_rates, _accelerations))


def _compare(tables: Tables, scenario: Scenario, kinds: tuple) -> Drawing:
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
            above.line(NETWORK, angle, output.factor * network, "network", linewidth=0.8, linestyle=(0, (4, 2)))
            if output.column == "gamma2":
                above.line("crank angle", angle, angle, "limit", linewidth=0.9, linestyle=":")
            spread_scale(above, output.factor * np.concatenate([simulated, network]))
            error = output.error_factor * (network - simulated)
            below = sheet.panel((2 * row + 1, column), f"{name}: error", CRANK_ANGLE, output.error, below=above)
            below.line(EVERYWHERE, angle, error, "network", linewidth=0.7)
            below.marks(AT_POINTS, angle[points], error[points], "ideal", markersize=1.6)
            below.over_crank_angle(angle[0], angle[-1])
            spread_scale(below, error)
    sheet.legend()
    return sheet.drawing()


def spread_scale(panel: Panel, shown: np.ndarray) -> None:
    """A scale linear for the bulk of the samples and logarithmic beyond, where the first impacts dwarf the rest."""
    size = np.abs(shown[np.isfinite(shown)])
    bulk = np.percentile(size, BULK)
    if size.max() > IMPACTS_DWARF * bulk > 0.0:
        panel.linear_then_logarithmic(round_up(bulk))
