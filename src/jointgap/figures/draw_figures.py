"""The stage figures: from the tables of a scenario to files."""

from collections.abc import Iterable, Mapping
from importlib import import_module
from pathlib import Path

import pandas as pd

from jointgap.config import Scenario
from jointgap.errors import InputError, did_you_mean
from jointgap.figures import style
from jointgap.figures.catalogue import ANIMATION, CATALOGUE, FigureSpec
from jointgap.figures.drawing import Drawing

SPECS = CATALOGUE | {"animation": ANIMATION}


def _spec(name: str) -> FigureSpec:
    if name not in SPECS:
        raise InputError(f"no figure '{name}'; {did_you_mean(name, SPECS)}")
    return SPECS[name]


def needed_tables(names: Iterable[str]) -> tuple[str, ...]:
    """Names of the tables that the figures `names` need, sorted."""
    return tuple(sorted({table for name in names for table in _spec(name).tables}))


def draw(name: str, tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """Draw one figure.

    Parameters
    ----------
    name : str
        One of `jointgap.figures.catalogue.CATALOGUE`, or ``'animation'``.
    tables : mapping of str to DataFrame
        The tables that the figure needs, by their names; more are left alone.
    scenario : Scenario
        What the tables were made from.

    Raises
    ------
    InputError
        No such figure, or a table it needs is not given.
    """
    spec = _spec(name)
    for table in spec.tables:
        if table not in tables:
            raise InputError(f"figure {name} needs the table '{table}'; give it (needed: {', '.join(spec.tables)})")
    module, function = spec.function.split(":")
    with style.look():
        return getattr(import_module(f"jointgap.figures.{module}"), function)(tables, scenario)


def draw_all(
    tables: Mapping[str, pd.DataFrame], scenario: Scenario, folder: Path | str, names: Iterable[str] = tuple(CATALOGUE)
) -> tuple[Path, ...]:
    """Draw the figures `names` (all still ones by default) and save them in `folder`; the files written.

    Raises
    ------
    InputError
        As `draw`, or the folder cannot be written.
    """
    return tuple(path for name in names for path in style.save(draw(name, tables, scenario), Path(folder) / name))
