"""What the figures of a campaign share."""

from collections.abc import Sequence

import pandas as pd

from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import Panel, Quantity, Sheet

SPREADS = "standard deviations of the noise"


def nothing(title: str, sentence: str) -> Drawing:
    """A sheet that says in a sentence why there is nothing to draw."""
    sheet = Sheet(1.2, 1, 1)
    panel = sheet.panel((0, 0), title, Quantity("", ""), Quantity("", ""))
    panel.axes.set_axis_off()
    panel.axes.text(0.5, 0.4, sentence, ha="center", va="center", transform=panel.axes.transAxes)
    panel.record(sentence, [], [])
    return sheet.drawing()


def in_words(name: str) -> str:
    """``sensor bias: crank torque`` of ``sensor_bias:crank_torque``."""
    return name.replace("_", " ").replace(":", ": ")


def runs_in(frame: pd.DataFrame) -> list[str]:
    """Runs of a table in its order."""
    return list(frame["run"].unique())


def listed(panel: Panel, names: Sequence[str]) -> None:
    """Names down the ordinate, the first on top."""
    panel.rows(names, range(len(names)))
    panel.axes.set_ylim(len(names) - 0.4, -0.6)
    panel.axes.grid(True, axis="y", alpha=0.5)
