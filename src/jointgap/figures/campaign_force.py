"""The missing force over position and speed of the slider."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from jointgap.figures.campaign_axes import nothing, runs_in
from jointgap.figures.campaign_catalogue import CATALOGUE, NOTHING
from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import CRANK_ANGLE, Quantity, Sheet

POSITION = Quantity("slider position", "mm", "$x$")
SPEED = Quantity("slider velocity", "m/s", "$v$")
FORCES = {"slider_force": Quantity("force on the slider", "N"), "crank_torque": Quantity("torque on the crank", "N·m")}
_COLOURS = ("simulation", "network", "second surrogate", "paper", "spline", "first", "other")


def missing_force(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """What the named effects push the slider with (or turn the crank) along each run: over x, over v, and over both."""
    samples = tables["force"]
    shown = [name for name in FORCES if samples[name].abs().max() > 0.0]
    if not shown:
        return nothing(CATALOGUE["missing_force"].title, NOTHING["missing_force"])
    across = [("slider_velocity", SPEED, 1.0), ("slider_position", POSITION, 1e3)]
    sheet = Sheet(0.5 + 2.7 * len(shown), len(shown), 3, width=10.5)
    for row, name in enumerate(shown):
        force = FORCES[name]
        if name == "crank_torque":
            across = [across[0], ("crank_angle", CRANK_ANGLE, 180.0 / np.pi)]
        for column, (key, quantity, factor) in enumerate(across):
            panel = sheet.panel((row, column), f"{force.name} over {quantity.name}", quantity, force)
            for number, run in enumerate(runs_in(samples)):
                own = samples[samples["run"] == run]
                colour = _COLOURS[number % len(_COLOURS)]
                panel.line(f"run {run}", factor * own[key].to_numpy(), own[name].to_numpy(), colour)
            panel.axes.axhline(0.0, color="#777777", linewidth=0.8)
            if quantity is CRANK_ANGLE:
                panel.over_crank_angle(0.0, 360.0)
        _plane(sheet, row, samples, name)
    sheet.legend()
    return sheet.drawing()


def _plane(sheet: Sheet, row: int, samples: pd.DataFrame, name: str) -> None:
    """Colour of the force along the runs in the plane of position and speed."""
    force = FORCES[name]
    panel = sheet.panel((row, 2), f"{force.name}: colour", POSITION, SPEED)
    x, y, value = 1e3 * samples["slider_position"], samples["slider_velocity"], samples[name]
    most = value.abs().max()
    colours = ScalarMappable(Normalize(-most, most), "RdBu_r")
    panel.axes.scatter(x, y, c=value, cmap=colours.cmap, norm=colours.norm, s=9.0, linewidths=0.0)
    panel.record(force.name, x, y, value=value, value_quantity=force.name, value_unit=force.unit)
    sheet.figure.colorbar(colours, ax=panel.axes, label=force.label)
