"""Journals in their bearings, and the forces between them."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from jointgap.config import Joint, Scenario
from jointgap.figures.drawing import Drawing
from jointgap.figures.samples import degrees, revolution, settled_revolution
from jointgap.figures.sheet import CRANK_ANGLE, Panel, Quantity, Sheet
from jointgap.figures.style import COLOURS

JOINTS = {"crank_pin": 2, "piston_pin": 3}  # with the paper's numbers
DEPTH_MAGNIFIED = 20.0  # times that penetrations of the settled orbit are drawn
INNERMOST = 10.0  # [um] the gap to the wall is shown linearly up to here, logarithmically beyond
SMALLEST_FORCE = 1.0  # [N] where the axis of forces begins


def eccentricity(samples: pd.DataFrame, number: int, joint: Joint | None) -> tuple[np.ndarray, np.ndarray]:
    """Journal's centre seen from its bearing's centre, components along the fixed x and y [m].

    The table's vector points from the crank's (slider's) pin to the rod's end, so it is turned round where the rod
    carries the bearing. Undefined directions (centres coincide, as always in an ideal joint) give nan.
    """
    sign = 1.0 if joint is not None and joint.journal == "rod" else -1.0
    r, gamma = (samples[f"{name}{number}"].to_numpy() for name in ("r", "gamma"))
    return sign * r * np.cos(gamma), sign * r * np.sin(gamma)


def orbits(tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """Orbit of each journal's centre in its bearing, and how far it goes beyond the clearance."""
    trajectory, number_settled = tables["trajectory"], scenario.optimise.ensemble.settled_revolution
    mechanism = scenario.mechanism.applied()
    drawn = {name: number for name, number in JOINTS.items() if name in mechanism.loose}
    shown = (
        ("first revolution", "first", revolution(trajectory, scenario, 1), 1.0),
        (
            f"settled revolution ({number_settled})",
            "settled",
            settled_revolution(trajectory, scenario),
            DEPTH_MAGNIFIED,
        ),
    )
    sheet = Sheet(2.9 * len(drawn), len(drawn), 3, width_ratios=[1.0, 1.0, 1.25])
    circle = np.linspace(0.0, 2.0 * np.pi, 181)
    for row, (name, number) in enumerate(drawn.items()):
        joint: Joint = mechanism.joint(name)
        words, radius = name.replace("_", " "), 1e3 * joint.clearance
        depth = sheet.panel((row, 2), f"{words}: depth", CRANK_ANGLE, Quantity("beyond clearance", "µm", "$r - r_c$"))
        for column, (series, colour, samples, magnified) in enumerate(shown):
            panel = sheet.panel(
                (row, column), f"{words}, {colour}", Quantity("journal, x", "mm"), Quantity("journal, y", "mm")
            )
            distance = samples[f"r{number}"].to_numpy()
            beyond = np.clip(distance - joint.clearance, 0.0, None)
            stretch = 1.0 + (magnified - 1.0) * beyond / np.maximum(distance, joint.clearance)
            x, y = eccentricity(samples, number, joint)
            panel.line("clearance circle", radius * np.cos(circle), radius * np.sin(circle), "limit", linewidth=0.8)
            panel.line(series, 1e3 * stretch * x, 1e3 * stretch * y, colour, linewidth=0.9)
            panel.square(1.4 * radius)
            if magnified != 1.0:
                panel.axes.text(0, 0, f"depth ×{magnified:g}", ha="center", va="center", color=COLOURS["limit"])
            angle = degrees(samples["crank_angle"])
            depth.line(series, angle, 1e6 * (distance - joint.clearance), colour, linewidth=0.8)
            depth.over_crank_angle(angle[0], angle[-1])
        depth.linear_then_logarithmic(INNERMOST)
    sheet.legend()
    return sheet.drawing()


def contact_forces(tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """Normal force in both joints over the crank angle, first and settled revolution."""
    settled = scenario.optimise.ensemble.settled_revolution
    parts = {"first revolution": 1, f"settled revolution ({settled})": settled}
    sheet = Sheet(4.8, 2, 1)
    above: Panel | None = None
    largest = max(tables["trajectory"][f"{name}_normal_force"].max() for name in JOINTS)
    for row, (title, number) in enumerate(parts.items()):
        samples = revolution(tables["trajectory"], scenario, number)
        angle = degrees(samples["crank_angle"])
        panel = sheet.panel((row, 0), title, CRANK_ANGLE, Quantity("normal force", "N"), below=above)
        for name in JOINTS:
            force = samples[f"{name}_normal_force"].to_numpy()
            words = name.replace("_", " ")
            panel.line(words, angle, np.where(force > 0.0, force, np.nan), words, linewidth=0.7, alpha=0.85)
        panel.axes.set_yscale("log")
        panel.axes.set_ylim(SMALLEST_FORCE, 2.0 * max(largest, SMALLEST_FORCE))
        panel.over_crank_angle(angle[0], angle[-1])
        above = panel
    sheet.legend()
    return sheet.drawing()
