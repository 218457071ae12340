"""Figure of networks that know the design: their errors on held-out designs, beside those of the frozen motion."""

import numpy as np
import pandas as pd

from jointgap.core import plot
from jointgap.core.plot import Drawing, Quantity, Sheet
from jointgap.design_networks.held_out_errors import ANGLE, ERROR

TITLE = "Errors on held-out designs"
CAPTION = (
    "Median over the held-out designs, bars from the 5 % to the 95 % quantile. Left: error of the motion over a "
    "revolution. Right: error of the transmission angle over a revolution, and of its RMS error, which is what lengths "
    "are judged by."
)
NAME = "held_out_errors"
MDEG = 1e3 * 180.0 / np.pi
"""Thousandths of a degree in a radian."""

_WAYS = {"network": ("network", "network", -0.12, "o"), "frozen": ("frozen motion", "paper", 0.12, "v")}
_QUANTILES = (0.05, 0.5, 0.95)


def draw_errors(errors: pd.DataFrame) -> Drawing:
    """Errors by output."""
    with plot.matplotlib_style():
        outputs = list(dict.fromkeys(errors["output"]))
        angles = [output for output in outputs if output in (ANGLE, ERROR)]
        motions = [output for output in outputs if output not in angles]
        sheet = Sheet(4.0, 1, 2, width_ratios=(3, 2))
        shown = ((motions, Quantity("error over a revolution, RMS", "µm"), 1e6, "motion in the joints"),
                 (angles, Quantity("error", "mdeg"), MDEG, "transmission angle"))  # fmt: skip
        for place, (names, quantity, factor, title) in enumerate(shown):
            panel = sheet.panel((0, place), title, Quantity("", ""), quantity)
            for way, (words, colour, shift, marker) in _WAYS.items():
                of = [factor * np.abs(errors[errors["output"] == name][way]) for name in names]
                low, middle, high = np.array([np.quantile(values, _QUANTILES) for values in of]).T
                at = np.arange(len(names)) + shift
                panel.marks(words, at, middle, colour, low=low, high=high, labels=names, marker=marker)
            panel.categories([name.replace(" ", "\n") for name in names])
            panel.axes.set_xlim(-0.5, len(names) - 0.5)
            panel.logarithmic()
        sheet.legend()
        return sheet.drawing()
