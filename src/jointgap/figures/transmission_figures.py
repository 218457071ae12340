"""Figure 16: what the optimised lengths leave of the transmission angle's error."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.figures.drawing import Drawing
from jointgap.figures.figure_data import NETWORKS, degrees, loose_joints, predicted, revolution
from jointgap.figures.sheet import CRANK_ANGLE, Panel, Quantity, Sheet
from jointgap.mechanism import clearance_lift, transmission_angle

ACTUAL, OPTIMISED = "desired − actual", "desired − optimised"


def transmission_errors(tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """Errors of the transmission angle before and after the optimisation, clearance motion frozen (figure 16)."""
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
        error = Quantity("error of $\\mu$", "deg")
        panel = sheet.panel((row, 0), title, CRANK_ANGLE, error, below=above)
        for series, (crank_length, rod_length, colour) in pairs.items():
            actual = transmission_angle(crank_length, rod_length, crank_angle, lift, offset)
            panel.line(series, angle, np.degrees(desired - actual), colour, linewidth=1.0)
        panel.level("zero", 0.0)
        for edge in np.degrees(scenario.optimise.window):
            if 0.0 < edge < 359.99:
                panel.upright("edge of the window", angle[0] + edge)
        panel.over_crank_angle(angle[0], angle[-1])
        above = panel
    sheet.legend()
    return sheet.drawing()
