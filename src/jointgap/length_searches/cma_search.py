"""A search for lengths by CMA-ES, for an error that is simulated: rough, and without a slope.

pymoo's CMA-ES (Hansen, The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772) works on lengths scaled to the box.
Candidates beyond the region are moved to the nearest lengths in it, and their error is raised by the way.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jointgap.core.errors import needs
from jointgap.length_searches.settings import SearchSettings
from jointgap.lengths.region import Region

with needs("optimising link lengths", "learn"):
    from pymoo.algorithms.soo.nonconvex.cmaes import CMAES
    from pymoo.core.problem import Problem

_FAILED = 1e6
"""Error of lengths whose simulation failed: far above any, and finite, as pymoo wants it."""


@dataclass(frozen=True)
class Generation:
    """Where a search stands after a generation."""

    evaluations: int  # Lengths tried so far
    cpu_time: float  # Spent so far [s]
    lengths: tuple[float, float]  # Best so far, (L2, L3) [m]
    error: float  # Of these [rad]


class _Lengths(Problem):
    """The lengths of a region as pymoo wants them; keeps the best."""

    def __init__(self, region: Region, error: Callable[[np.ndarray], np.ndarray]):
        super().__init__(n_var=2, n_obj=1, xl=np.zeros(2), xu=np.ones(2))
        self.region, self.error = region, error
        self.evaluations, self.best = 0, (np.inf, np.full(2, np.nan))

    def _evaluate(self, x, out, *args, **kwargs):
        wanted = self.region.unscaled(x)
        lengths = self.region.nearest(wanted)
        errors = np.nan_to_num(self.error(lengths), nan=_FAILED)
        self.evaluations += len(x)
        place = int(np.argmin(errors))
        if errors[place] < self.best[0]:
            self.best = float(errors[place]), lengths[place]
        moved = np.sum(((wanted - lengths) / self.region.size) ** 2, axis=1)
        out["F"] = errors * (1.0 + moved)


def cma_search(
    error: Callable[[np.ndarray], np.ndarray],
    region: Region,
    start: np.ndarray,
    seed: int,
    settings: SearchSettings,
    spent: Callable[[], float],
    budget: float,
) -> tuple[Generation, ...]:
    """Search lengths with a small error until a budget is spent."""
    problem = _Lengths(region, error)
    scaled = np.clip((np.asarray(start) - region.lower) / region.size, 0.0, 1.0)
    algorithm = CMAES(x0=scaled, sigma=settings.first_width, normalize=False, restarts=settings.restarts)
    algorithm.setup(problem, seed=seed)
    generations: list[Generation] = []
    while algorithm.has_next() and not (generations and spent() >= budget):
        algorithm.next()
        best, lengths = problem.best
        generations.append(Generation(problem.evaluations, spent(), tuple(map(float, lengths)), best))
    return tuple(generations)
