"""How far independently learned outputs contradict each other, and what that does to the piston."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.figures.drawing import Drawing
from jointgap.figures.figure_data import NETWORKS, degrees, in_words, loose_joints, predicted
from jointgap.figures.output_figures import spread_scale
from jointgap.figures.sheet import CRANK_ANGLE, Quantity, Sheet, width_for
from jointgap.figures.training_figures import symbol

EACH = "each output from its own network"
OTHER = "one output derived from another's network"
DIFFERENCE = "derivative of one network − the other network"


def contradictions(tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """Rates of the directions learned and derived; errors of the piston's motion that follow from either."""
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
        spread_scale(panel, difference)
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
        spread_scale(panel, np.concatenate(errors))
    sheet.legend()
    return sheet.drawing()
