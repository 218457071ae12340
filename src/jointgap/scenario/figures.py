"""All figures of a scenario. A further figure is a function with the decorator `figure` in a module imported here."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd

from jointgap.config import Scenario
from jointgap.core import plot
from jointgap.scenario import animation, figures_motion, figures_networks, figures_optimum  # noqa: F401  they register
from jointgap.scenario.figures_base import FIGURES

draw = FIGURES.draw


def draw_all(
    tables: Mapping[str, pd.DataFrame], scenario: Scenario, folder: Path | str, names: Iterable[str] = ()
) -> tuple[Path, ...]:
    """Draw the figures `names` (all still ones by default) and save them in `folder`; the files written."""
    drawn = ((name, draw(name, tables, scenario)) for name in names or FIGURES.still)
    return tuple(path for name, drawing in drawn for path in plot.save(drawing, Path(folder) / name))
