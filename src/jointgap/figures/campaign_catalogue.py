"""Figures of a campaign: where model and measurement disagree, what is missing, and what adding it brings.

Tables and the verdict in, drawings out; `jointgap.figures.style.save` saves them. Importing this package does not import
matplotlib.
"""

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

import pandas as pd

from jointgap.errors import InputError, did_you_mean
from jointgap.figures.catalogue import FigureSpec

if TYPE_CHECKING:
    from jointgap.figures.drawing import Drawing

_WHERE, _WHAT, _BETTER, _PLAN = "Where", "What is missing", "What it brings", "What could be found"

CATALOGUE = {
    "disagreement": FigureSpec(
        "Map of disagreement", _WHERE, "campaign_disagreement:disagreement", ("bins", "windows")
    ),
    "residuals": FigureSpec("Residuals before and after", _WHERE, "campaign_residuals:residuals", ("residuals",)),
    "ranking": FigureSpec("Candidates ranked", _WHAT, "campaign_ranking:ranking", ("fits",)),
    "missing_force": FigureSpec("The missing force", _WHAT, "campaign_force:missing_force", ("force",)),
    "gaps": FigureSpec("Gap before and after", _BETTER, "campaign_gaps:gaps", ("gaps",)),
    "optimum": FigureSpec("Optimum before and after", _BETTER, "campaign_optimum:optimum", ("optimum",)),
    "confusability": FigureSpec(
        "Effects that look alike", _PLAN, "campaign_preflight:confusability", ("confusability",)
    ),
    "detectable": FigureSpec("Smallest detectable sizes", _PLAN, "campaign_preflight:detectable", ("effects",)),
}
"""Every figure of a campaign: title, section of the report, ``module:function`` in here, and the tables it needs."""


def draw(name: str, tables: Mapping[str, pd.DataFrame | None], verdict: Mapping[str, Any]) -> "Drawing":
    """Draw one figure of a campaign.

    Parameters
    ----------
    name : str
        One of `CATALOGUE`.
    tables : mapping of str to DataFrame
        Tables by the names in `CATALOGUE`: ``bins`` and ``windows`` of the map, ``fits`` the ranking, ``force`` the missing force,
        ``effects`` those that are detectable, and ``residuals``, ``gaps``, ``optimum``, ``confusability``. One that is absent, None or empty gives a figure that says so:
        without a named effect there is no force to show, without loose joints no optimum.
    verdict : mapping
        Content of ``verdict.json``; of a preflight the key ``preflight`` is enough.

    Raises
    ------
    InputError
        No such figure.
    """
    if name not in CATALOGUE:
        raise InputError(f"no figure '{name}' of a campaign; {did_you_mean(name, CATALOGUE)}")
    from jointgap.figures import style
    from jointgap.figures.campaign_axes import nothing

    spec = CATALOGUE[name]
    with style.look():
        if any(tables.get(table) is None for table in spec.tables) or tables[spec.tables[0]].empty:
            return nothing(spec.title, NOTHING[name])
        module, function = spec.function.split(":")
        return getattr(import_module(f"jointgap.figures.{module}"), function)(tables, verdict)


NOTHING = {
    "disagreement": "no sample could be compared with the model",
    "residuals": "no sample could be compared with the model",
    "ranking": "no candidate was fitted: nothing is there to be explained",
    "missing_force": "no force or torque was named, so none is shown",
    "gaps": "no gap was taken",
    "optimum": "the model was not optimised again: no effect was added, or no joint is loose",
    "confusability": "there are no candidates to compare",
    "detectable": "there are no candidates to detect",
}
"""What a figure says where there is nothing to draw."""
