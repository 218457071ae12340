"""A search for lengths where a network or a surrogate tells the error: smooth, and next to free.

The paper's way with its frozen motion is a local search by sequential quadratic programming from six starts
(`jointgap.lengths.search`). This is the same search, with slopes by central differences.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from jointgap.length_searches.settings import SearchSettings
from jointgap.lengths.region import Region
from jointgap.lengths.search import search_from_all, starting_points


@dataclass(frozen=True)
class LearnedObjective:
    """What is searched: 1 at the original lengths, and it changes by about 1 to the starting points."""

    squares: Callable[[np.ndarray], np.ndarray]
    region: Region
    original: tuple[float, float]  # (L2, L3) [m]
    difference: float  # Step of the central differences as a share of the box

    @cached_property
    def _scale(self) -> tuple[float, float]:
        at, *others = self.squares(np.vstack([self.original, starting_points(self.region)]))
        return float(at), float(np.mean(np.abs(np.array(others) - at))) or 1.0

    def value(self, lengths: ArrayLike) -> float:
        """At `lengths` (2,) [m]."""
        return float(self._values(np.atleast_2d(lengths))[0])

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Slope by `lengths` (2,) [1/m]."""
        steps = np.diag(self.difference * self.region.size)
        values = self._values(np.concatenate([lengths + steps, lengths - steps]))
        return (values[:2] - values[2:]) / (2.0 * np.diag(steps))

    def _values(self, lengths: np.ndarray) -> np.ndarray:
        original, scale = self._scale
        return 1.0 + (self.squares(lengths) - original) / scale


def learned_search(
    squares: Callable[[np.ndarray], np.ndarray],
    region: Region,
    original: tuple[float, float],
    settings: SearchSettings,
) -> tuple[float, float]:
    """The lengths with the smallest error, (L2, L3) [m]."""
    objective = LearnedObjective(squares, region, original, settings.difference)
    best = min(search_from_all(objective, region, settings.tolerance), key=lambda found: found.value)
    crank, rod = map(float, best.lengths)
    return crank, rod
