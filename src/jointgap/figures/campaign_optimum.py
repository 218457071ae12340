"""The optimum before and after the missing effect was added."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from jointgap.figures.campaign_axes import in_words, nothing
from jointgap.figures.drawing import Drawing
from jointgap.figures.sheet import Panel, Quantity, Sheet

MODELS = {"base": ("before", "before", "o"), "augmented": ("after", "after", "D")}
_MEASURES = {"reduction": "motion frozen", "resimulated": "simulated again"}


def optimum(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """Optimal link lengths and what they gain, of the model as it stood and with the effect added."""
    optima = tables["optimum"].dropna(subset=["crank_length"])
    if optima.empty:
        return nothing("Optimum before and after", "the model could not be optimised again: see the summary")
    sheet = Sheet(3.3, 1, 2)
    lengths = sheet.panel(
        (0, 0), "optimal lengths", Quantity("crank length", "mm", "$L_2$"), Quantity("rod length", "mm", "$L_3$")
    )
    gain = sheet.panel((0, 1), "RMS error of the transmission angle", Quantity("", ""), Quantity("error falls by", "%"))
    place = np.arange(len(_MEASURES))
    for model, (series, colour, marker) in MODELS.items():
        own = optima[optima["model"] == model]
        if own.empty:
            continue
        names = [in_words(source) for source in own["source"]]
        lengths.marks(series, 1e3 * own["crank_length"], 1e3 * own["rod_length"], colour, labels=names, marker=marker)
        for row in own.itertuples():
            values = [100.0 * getattr(row, measure) for measure in _MEASURES]
            gain.marks(series, place, values, colour, labels=list(_MEASURES.values()), marker=marker)
    gain.categories(list(_MEASURES.values()))
    gain.axes.set_xlim(-0.6, len(_MEASURES) - 0.4)
    gain.axes.axhline(0.0, color="#777777", linewidth=0.8)
    _apart(lengths, 1e3 * optima["crank_length"].to_numpy(), 1e3 * optima["rod_length"].to_numpy())
    sheet.legend()
    return sheet.drawing()


def _apart(panel: Panel, x: np.ndarray, y: np.ndarray) -> None:
    """Scales on which a change of a thousandth of a length looks small."""
    for axis, values in (("x", x), ("y", y)):
        middle = (values.min() + values.max()) / 2.0
        half = max(0.6 * (values.max() - values.min()), 0.005 * middle)
        getattr(panel.axes, f"set_{axis}lim")(middle - half, middle + half)
        panel.axes.locator_params(axis=axis, nbins=5)
