"""Search of the lengths: genetic algorithm, then a local optimiser."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from jointgap.config import Genetic, Mechanism, Optimise, Simulate
from jointgap.core.errors import needs
from jointgap.lengths.objective import MEASURES, Objective, invariant, tolerance_effect
from jointgap.lengths.region import MET, Region
from jointgap.paper.printed import OPTIMA, departures

with needs("optimising link lengths", "learn"):
    from pymoo.algorithms.base.genetic import GeneticAlgorithm
    from pymoo.core.infill import InfillCriterion
    from pymoo.core.population import Population
    from pymoo.core.problem import Problem
    from pymoo.core.repair import Repair
    from pymoo.core.sampling import Sampling
    from pymoo.core.survival import Survival
    from pymoo.optimize import minimize as run_algorithm


def best_first(values: np.ndarray, violations: np.ndarray) -> np.ndarray:
    """Indices of individuals in their order, shape (n,): what meets the constraints first, then by values to
    minimise.
    """
    return np.lexsort((values, violations))


def rank_expectation(values: np.ndarray) -> np.ndarray:
    """How much of the next parents each individual should be, from values to minimise; shape (n,), sum 1."""
    rank = np.empty(len(values))
    rank[np.argsort(values, kind="stable")] = np.arange(1, len(values) + 1)
    weight = 1.0 / np.sqrt(rank)
    return weight / np.sum(weight)


def stochastic_uniform(expectation: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    """Indices of `count` parents, shape (count,), shuffled.

    Parent i is taken floor(count * expectation[i]) times or once more.
    """
    marks = (np.arange(count) + random.random()) / count
    edges = np.cumsum(expectation)
    edges[-1] = 1.0
    return random.permutation(np.searchsorted(edges, marks, side="right"))


def intermediate_crossover(first: np.ndarray, second: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A random point between each pair of parents, shapes (n, 2)."""
    return first + random.random((len(first), 1)) * (second - first)


def feasible_mutation(parents: np.ndarray, region: Region, random: np.random.Generator) -> np.ndarray:
    """Each parent (n, 2) moved by up to the box's width in a random direction, cut at the region's edge."""
    angle = 2.0 * np.pi * random.random(len(parents))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    moves = random.random((len(parents), 1)) * direction * region.size
    moved = [parent + region.reach(parent, move) * move for parent, move in zip(parents, moves, strict=True)]
    return np.clip(moved, region.lower, region.upper)


@dataclass(frozen=True)
class Found:
    """What one search found."""

    lengths: np.ndarray  # shape (2,); the best (L2, L3) [m]
    value: float  # Its sum of squares [rad^2]
    values: np.ndarray  # shape (evaluations,); every value in the order of evaluation, an elite's once [rad^2]
    status: str  # Why it stopped and what to make of it

    @property
    def evaluations(self) -> int:
        """Calls of the objective; those of its exact gradient are not counted."""
        return len(self.values)


@dataclass(frozen=True)
class GeneticResult(Found):
    """One run of the genetic algorithm."""

    population: pd.DataFrame  # A row per individual and generation


@dataclass(frozen=True)
class LocalResult(Found):
    """One local search."""

    path: np.ndarray  # shape (k, 2); every iterate, the start first [m]
    converged: bool  # Whether the stopping tolerance was met


class _Lengths(Problem):
    """The objective as pymoo wants it; keeps every value it gave."""

    def __init__(self, objective: Objective, region: Region):
        super().__init__(n_var=2, n_obj=1, n_ieq_constr=int(bool(region.constraints)), xl=region.lower, xu=region.upper)
        self.objective, self.region, self.values = objective, region, []

    def _evaluate(self, x, out, *args, **kwargs):
        values = self.objective.value(x)
        self.values.extend(values)
        out["F"] = values[:, None]
        if self.region.constraints:
            out["G"] = self.region.missed(x)[:, None] - MET


class _RegionSampling(Sampling):
    def _do(self, problem, n_samples, *args, random_state=None, **kwargs):
        return problem.region.sample(n_samples, random_state)


class _OntoConstraints(Repair):
    def _do(self, problem, x, **kwargs):
        return problem.region.nearest(x) if problem.region.constraints else x


class _Mating(InfillCriterion):
    """Children by crossover and by mutation, their shares fixed."""

    def __init__(self, crossover_fraction: float):
        super().__init__(repair=_OntoConstraints())
        self.crossover_fraction = crossover_fraction

    def _do(self, problem, pop, n_offsprings, random_state=None, **kwargs):
        lengths, places = pop.get("X"), np.argsort(best_first(pop.get("F")[:, 0], pop.get("CV")[:, 0]))
        crossed = round(self.crossover_fraction * n_offsprings)
        mutated = n_offsprings - crossed
        chosen = stochastic_uniform(rank_expectation(places), 2 * crossed + mutated, random_state)
        parents = lengths[chosen]
        children = np.concatenate(
            [
                intermediate_crossover(parents[:crossed], parents[crossed : 2 * crossed], random_state),
                feasible_mutation(parents[2 * crossed :], problem.region, random_state),
            ]
        )
        return Population.new(X=children, origin=["crossover"] * crossed + ["mutation"] * mutated)


class _ElitesAndChildren(Survival):
    """The next generation: the best of the old one, then all children."""

    def __init__(self, elites: int):
        super().__init__(filter_infeasible=False)
        self.elites = elites

    def _do(self, problem, pop, *args, n_survive=None, **kwargs):
        children = n_survive - self.elites
        old, new = pop[: len(pop) - children], pop[len(pop) - children :]
        best = old[best_first(old.get("F")[:, 0], old.get("CV")[:, 0])[: self.elites]]
        best.set("origin", ["elite"] * self.elites)
        return Population.merge(best, new)


def evolve(objective: Objective, region: Region, options: Genetic) -> GeneticResult:
    """Run the genetic algorithm for the configured number of generations."""
    problem = _Lengths(objective, region)
    algorithm = GeneticAlgorithm(
        pop_size=options.population,
        n_offsprings=options.population - options.elites,
        sampling=_RegionSampling(),
        repair=_OntoConstraints(),
        mating=_Mating(options.crossover_fraction),
        survival=_ElitesAndChildren(options.elites),
        eliminate_duplicates=False,
    )
    generations = []
    run_algorithm(
        problem,
        algorithm,
        ("n_gen", options.generations + 1),
        seed=options.seed,
        callback=lambda state: generations.append(_record(len(generations), state.pop, len(problem.values))),
    )
    population = pd.concat(generations, ignore_index=True)
    violations = np.maximum(region.missed(population[["crank_length", "rod_length"]].to_numpy()) - MET, 0.0)
    best = population.iloc[best_first(population["sum_of_squares"].to_numpy(), violations)[0]]
    return GeneticResult(
        lengths=best[["crank_length", "rod_length"]].to_numpy(dtype=float),
        value=float(best["sum_of_squares"]),
        values=np.array(problem.values),
        population=population,
        status=f"stopped: {options.generations} generations of {options.population} done",
    )


def _record(generation: int, pop: Population, evaluations: int) -> pd.DataFrame:
    lengths = pop.get("X")
    return pd.DataFrame(
        {
            "generation": generation,
            "individual": np.arange(len(pop)),
            "origin": ["first" if generation == 0 else origin for origin in pop.get("origin")],
            "crank_length": lengths[:, 0],
            "rod_length": lengths[:, 1],
            "sum_of_squares": pop.get("F")[:, 0],
            "evaluations": evaluations,
        }
    )


def evaluations_until(values: np.ndarray, best: float, tolerance: float) -> int | None:
    """After how many evaluations a value within `tolerance` (relative) of `best` was found; None if never."""
    close_enough = np.flatnonzero(values <= best * (1.0 + tolerance))
    return int(close_enough[0]) + 1 if len(close_enough) else None


TOLERANCES = tuple(10.0**-exponent for exponent in range(1, 13))  # swept to show what stopping early does


def starting_points(region: Region) -> np.ndarray:
    """Six points, shape (6, 2) [m]: L2 at 1/4, 3/4 of its range with L3 at 1/6, 1/2, 5/6; cranks too long are cut, and
    all are moved to the nearest lengths that meet the constraints.
    """
    shares = [(crank, rod) for rod in (1 / 6, 1 / 2, 5 / 6) for crank in (1 / 4, 3 / 4)]
    return np.array([region.nearest(region.unscaled(np.array(share))) for share in shares])


def search(objective: Objective, region: Region, start: ArrayLike, tolerance: float) -> LocalResult:
    """Follow the error downhill from `start`."""
    start = np.asarray(start, dtype=float)
    unit = float(objective.value(objective.original))
    path, values = [start], []

    def share(scaled: np.ndarray) -> float:
        values.append(float(objective.value(region.unscaled(scaled))))
        return values[-1] / unit

    result = minimize(
        share,
        (start - region.lower) / region.size,
        jac=lambda scaled: objective.gradient(region.unscaled(scaled)) * region.size / unit,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * 2,
        constraints=region.conditions(),
        callback=lambda scaled: path.append(region.unscaled(np.array(scaled))),
        options={"ftol": tolerance, "maxiter": 200},
    )
    end = np.clip(region.unscaled(result.x), region.lower, region.upper)  # bounds met up to rounding are met
    if region.missed(end) > MET:  # a loose tolerance is one of constraints too
        end = region.nearest(end)
    if result.success:
        status = f"stopped: the sum of squares changes by less than {tolerance:g} of its value at the original lengths"
    else:
        status = (
            f"not converged ({str(result.message).strip().lower()}): raise the tolerance {tolerance:g} or check the box"
        )
    if not np.array_equal(path[-1], end):
        path.append(end)
    return LocalResult(
        lengths=end,
        value=float(objective.value(end)),
        values=np.array(values),
        path=np.array(path),
        converged=bool(result.success),
        status=status,
    )


def search_from_all(objective: Objective, region: Region, tolerance: float) -> tuple[LocalResult, ...]:
    """`search` from each of the six starting points."""
    return tuple(search(objective, region, start, tolerance) for start in starting_points(region))


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
    return [
        Search(
            source,
            box,
            objective,
            region,
            evolve(objective, region, options.genetic),
            search_from_all(objective, region, options.local_tolerance),
        )
        for source, objective in objectives.items()
        for box, region in regions.items()
    ]


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
        **tolerance_effect(objective, point.lengths, tolerance),
        "invariant": float(invariant(reductions.rms, rod, "rms")),
        "evaluations": None,
        "evaluations_within_1_percent": None,
        "evaluations_within_0_1_percent": None,
        "status": None,
    }


def labelled(searches: list[Search], make: Callable[[Search], pd.DataFrame]) -> pd.DataFrame:
    """`make(search)` of every search below each other, with source and box in front."""
    frames = {(search.source, search.box): make(search) for search in searches}
    return pd.concat(frames, names=["source", "box"]).reset_index(["source", "box"]).reset_index(drop=True)


def paths(search: Search) -> pd.DataFrame:
    """Rows of the table optimise_paths."""
    frames = [
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
    ]
    return pd.concat(frames, ignore_index=True)


def tolerances(search: Search) -> pd.DataFrame:
    """Rows of the table optimise_tolerance."""
    rows = [
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
        for tolerance in TOLERANCES
        for number, result in enumerate(search_from_all(search.objective, search.region, tolerance))
    ]
    return pd.DataFrame(rows)
