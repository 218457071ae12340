"""Both optimisers in every box for every source of the frozen clearance motion."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Optimise, Simulate
from jointgap.link_lengths import local, rod_tolerance, valley
from jointgap.link_lengths.genetic import GeneticResult, evaluations_until, evolve
from jointgap.link_lengths.local import LocalResult
from jointgap.link_lengths.objective import MEASURES, Objective
from jointgap.link_lengths.region import Region
from jointgap.paper.printed import OPTIMA, departures


@dataclass(frozen=True)
class Point:
    """A pair of lengths with a name, and the search that found it."""

    name: str  # As in the table optimise_optima
    method: str  # As in the table optimise_optima
    lengths: tuple[float, float]  # (L2, L3) [m]
    source: str | None = None  # Of the search; None where no search here found the point
    box: str | None = None  # Of the search; None where no search here found the point


def printed_points(mechanism: Mechanism, simulate: Simulate) -> list[Point]:
    """What the paper prints as its optima; none for a mechanism that is not the paper's."""
    if departures(mechanism, simulate):
        return []
    return [Point(point.key, "printed", (point.crank_length, point.rod_length)) for point in OPTIMA]


@dataclass(frozen=True)
class Search:
    """Both optimisers for one source in one box."""

    source: str
    box: str
    objective: Objective
    region: Region
    genetic: GeneticResult
    local: tuple[LocalResult, ...]  # From the six starting points, at the configured tolerance

    @property
    def best_local(self) -> LocalResult:
        """The local search that ended lowest."""
        return min(self.local, key=lambda result: result.value)

    @property
    def points(self) -> tuple[Point, Point]:
        """What the genetic and the local optimiser found."""
        results = {"genetic": self.genetic, "local": self.best_local}
        return tuple(
            Point(
                f"{self.source}_{self.box}_{method}", method, tuple(map(float, result.lengths)), self.source, self.box
            )
            for method, result in results.items()
        )


def search_all(objectives: dict[str, Objective], regions: dict[str, Region], options: Optimise) -> list[Search]:
    """Run both optimisers for every objective (by source) in every configured box."""
    searches = []
    for source, objective in objectives.items():
        for box, region in regions.items():
            local_results = local.search_from_all(objective, region, options.local_tolerance)
            searches.append(
                Search(source, box, objective, region, evolve(objective, region, options.genetic), local_results)
            )
    return searches


def optima(
    objectives: dict[str, Objective], searches: list[Search], printed: list[Point], tolerance: float | None
) -> pd.DataFrame:
    """Frame of the table optimise_optima; with the points `printed` beside those found."""
    rows = []
    for source, objective in objectives.items():
        fixed = [Point("original", "original", objective.original), *printed]
        rows += [_optimum(source, objective, point, tolerance) for point in fixed]
        for search in (search for search in searches if search.source == source):
            lowest = min(search.genetic.value, search.best_local.value)
            for point, result in zip(search.points, (search.genetic, search.best_local), strict=True):
                rows.append(
                    _optimum(source, objective, point, tolerance)
                    | {
                        "active_bounds": search.region.active(result.lengths),
                        "evaluations": result.evaluations,
                        "evaluations_within_1_percent": evaluations_until(result.values, lowest, 1e-2),
                        "evaluations_within_0_1_percent": evaluations_until(result.values, lowest, 1e-3),
                        "status": result.status,
                    }
                )
    counts = [name for name in rows[0] if name.startswith("evaluations")]
    return pd.DataFrame(rows).astype(dict.fromkeys(counts, "Int64"))


def _optimum(source: str, objective: Objective, point: Point, tolerance: float | None) -> dict[str, object]:
    measures, reductions = objective.measures(point.lengths), objective.reductions(point.lengths)
    crank, rod = point.lengths
    return {
        "source": source,
        "point": point.name,
        "box": point.box,
        "method": point.method,
        "crank_length": crank,
        "rod_length": rod,
        "ratio": crank / rod,
        "active_bounds": None,
        **{name: float(getattr(measures, name)) for name in MEASURES},
        **{f"{name}_reduction": float(getattr(reductions, name)) for name in MEASURES},
        **rod_tolerance.effect(objective, point.lengths, tolerance),
        "invariant": float(valley.invariant(reductions.rms, rod, "rms")),
        "evaluations": None,
        "evaluations_within_1_percent": None,
        "evaluations_within_0_1_percent": None,
        "status": None,
    }


def _labelled(searches: Iterable[Search], make) -> pd.DataFrame:
    """`make(search)` of every search below each other, with source and box in front."""
    frames = []
    for search in searches:
        frame = make(search)
        frame.insert(0, "source", search.source)
        frame.insert(1, "box", search.box)
        frames.append(frame)
    return pd.concat(frames, ignore_index=True)


def populations(searches: list[Search]) -> pd.DataFrame:
    """Frame of the table optimise_population."""
    return _labelled(searches, lambda search: search.genetic.population.copy())


def paths(searches: list[Search]) -> pd.DataFrame:
    """Frame of the table optimise_paths."""

    def of(search: Search) -> pd.DataFrame:
        return pd.concat(
            [
                pd.DataFrame(
                    {
                        "start": number,
                        "iteration": np.arange(len(result.path)),
                        "crank_length": result.path[:, 0],
                        "rod_length": result.path[:, 1],
                        "sum_of_squares": search.objective.value(result.path),
                    }
                )
                for number, result in enumerate(search.local)
            ],
            ignore_index=True,
        )

    return _labelled(searches, of)


def tolerances(searches: list[Search]) -> pd.DataFrame:
    """Frame of the table optimise_tolerance."""

    def of(search: Search) -> pd.DataFrame:
        rows = []
        for tolerance in local.TOLERANCES:
            ends = local.search_from_all(search.objective, search.region, tolerance)
            for number, result in enumerate(ends):
                rows.append(
                    {
                        "tolerance": tolerance,
                        "start": number,
                        "crank_length": result.lengths[0],
                        "rod_length": result.lengths[1],
                        "sum_of_squares": result.value,
                        "rms_reduction": float(search.objective.reductions(result.lengths).rms),
                        "evaluations": result.evaluations,
                        "converged": result.converged,
                        "active_bounds": search.region.active(result.lengths),
                    }
                )
        return pd.DataFrame(rows)

    return _labelled(searches, of)


def valleys(searches: list[Search]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Frames of the tables optimise_valley and optimise_floor."""
    return (
        _labelled(searches, lambda search: valley.grid(search.objective, search.region)),
        _labelled(searches, lambda search: valley.best_cranks(search.objective, search.region)),
    )
