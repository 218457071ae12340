"""The stage figures: from the tables of a scenario to files."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd

from jointgap.config import Scenario
from jointgap.errors import InputError
from jointgap.figures import style
from jointgap.figures.catalogue import FIGURES, spec_of
from jointgap.figures.style import Drawing


def draw(name: str, tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """Draw one figure."""
    spec = spec_of(name)
    for table in spec.tables:
        if table not in tables:
            raise InputError(f"figure {name} needs the table '{table}'; give it (needed: {', '.join(spec.tables)})")
    with style.matplotlib_style():
        return spec.load()(tables, scenario)


def draw_all(
    tables: Mapping[str, pd.DataFrame], scenario: Scenario, folder: Path | str, names: Iterable[str] = FIGURES
) -> tuple[Path, ...]:
    """Draw the figures `names` (all still ones by default) and save them in `folder`; the files written.

    `tables` and `scenario` as in `draw`.
    """
    return tuple(path for name in names for path in style.save(draw(name, tables, scenario), Path(folder) / name))
