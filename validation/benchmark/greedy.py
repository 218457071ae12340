"""A comparison method: the smallest BIC of the identification's fits, one effect at a time."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def answer(campaign: Path, analysis: Mapping[str, Any]) -> list[str] | None:
    """The names by the fits of an analysis; None if it is unfinished or failed."""
    return greedy_names(analysis["bic"]) if "bic" in analysis else None


def greedy_names(fits: Mapping[str, float]) -> list[str]:
    """Labels added one at a time, each with the smallest BIC, while the BIC decreases.

    `fits` has the BIC of ``base`` and of hypotheses such as ``gravity + slider_spring``.
    """
    if "base" not in fits:
        return []
    bic = {frozenset(name.split(" + ")): value for name, value in fits.items() if name != "base"}
    named, best = frozenset(), fits["base"]
    while True:
        larger = {bic[key]: key for key in bic if key > named and len(key) == len(named) + 1}
        if not larger or min(larger) >= best:
            return sorted(named)
        best = min(larger)
        named = larger[best]
