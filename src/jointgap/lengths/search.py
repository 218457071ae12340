"""Optimisation of the lengths: genetic algorithm and local optimiser."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from jointgap.config import Genetic, Mechanism, Optimise, Simulate
from jointgap.core.errors import needs
from jointgap.core.schema import TABLES
from jointgap.lengths.objective import Objective, invariant, tolerance_effect
from jointgap.lengths.region import FEASIBLE, Region
from jointgap.paper.printed import OPTIMA, departures

with needs("optimising link lengths", "learn"):
    from pymoo.core.algorithm import Algorithm
    from pymoo.core.population import Population
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize as run_algorithm


def best_first(pop: "Population") -> np.ndarray:
    """Indices of individuals, (n,), sorted by feasibility, then by the objective."""
    return np.lexsort((pop.get("F")[:, 0], pop.get("CV")[:, 0]))


def rank_expectation(values: np.ndarray) -> np.ndarray:
    """Expected share of each individual among the parents, by rank; shape (n,), sum 1."""
    rank = np.empty(len(values))
    rank[np.argsort(values, kind="stable")] = np.arange(1, len(values) + 1)
    weight = 1.0 / np.sqrt(rank)
    return weight / np.sum(weight)


def stochastic_uniform(
    expectation: np.ndarray, count: int, random: np.random.Generator
) -> np.ndarray:
    """Indices of `count` parents, shape (count,), shuffled.

    Parent i is chosen floor(count * expectation[i]) times or once more.
    """
    marks = (np.arange(count) + random.random()) / count
    edges = np.cumsum(expectation)
    edges[-1] = 1.0
    return random.permutation(np.searchsorted(edges, marks, side="right"))


def intermediate_crossover(
    first: np.ndarray, second: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """A random point between each pair of parents, shapes (n, 2)."""
    return first + random.random((len(first), 1)) * (second - first)


def feasible_mutation(
    parents: np.ndarray, region: Region, random: np.random.Generator
) -> np.ndarray:
    """Each parent (n, 2) moved by up to the box's width in a random direction, limited to the
    region."""
    angle = 2.0 * np.pi * random.random(len(parents))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    moves = random.random((len(parents), 1)) * direction * region.size
    return np.clip(
        parents + region.reach(parents, moves)[:, None] * moves, region.lower, region.upper
    )


ELITES, CROSSOVER_FRACTION = 2, 0.8
"""The paper's settings: best individuals that are kept unchanged, and the share of the other
children made by crossover; the rest mutate."""


@dataclass(frozen=True)
class Found:
    """Result of one search."""

    lengths: np.ndarray  # shape (2,); the best (L2, L3) [m]
    value: float  # The objective there [SI]
    values: (
        np.ndarray
    )  # shape (evaluations,); all values in order of evaluation, an elite's once [SI]
    status: str  # Stopping criterion
    population: pd.DataFrame | None = (
        None  # Of the genetic algorithm: a row per individual and generation
    )
    path: np.ndarray | None = None  # shape (k, 2); of a local search: iterates, from the start [m]
    converged: bool = True  # Whether the stopping tolerance was reached

    @property
    def evaluations(self) -> int:
        """Evaluations of the objective, without its gradient."""
        return len(self.values)


class _Lengths(Problem):
    """The objective as a pymoo problem; records all values."""

    def __init__(self, objective: Objective, region: Region):
        super().__init__(
            n_var=2,
            n_obj=1,
            n_ieq_constr=int(bool(region.constraints)),
            xl=region.lower,
            xu=region.upper,
        )
        self.objective, self.region, self.values = objective, region, []

    def _evaluate(self, x, out, *args, **kwargs):
        values = self.objective.value(x)
        self.values.extend(values)
        out["F"] = values[:, None]
        if self.region.constraints:
            out["G"] = self.region.violation(x)[:, None] - FEASIBLE


class _Evolution(Algorithm):
    """Next generation: the elite, then children by crossover and by mutation, in fixed shares."""

    def __init__(self, options: Genetic):
        super().__init__()
        self.options = options

    def _initialize_infill(self):
        count = self.options.population
        return self._individuals(
            self.problem.region.sample(count, self.random_state), ["first"] * count
        )

    def _infill(self):
        lengths, places = self.pop.get("X"), np.argsort(best_first(self.pop))
        count, random = self.options.population - ELITES, self.random_state
        crossed = round(CROSSOVER_FRACTION * count)
        parents = lengths[stochastic_uniform(rank_expectation(places), crossed + count, random)]
        children = intermediate_crossover(parents[:crossed], parents[crossed : 2 * crossed], random)
        mutants = feasible_mutation(parents[2 * crossed :], self.problem.region, random)
        origins = ["crossover"] * len(children) + ["mutation"] * len(mutants)
        return self._individuals(np.concatenate([children, mutants]), origins)

    def _individuals(self, lengths: np.ndarray, origins: list[str]) -> Population:
        region = self.problem.region
        return Population.new(
            X=region.nearest(lengths) if region.constraints else lengths, origin=origins
        )

    def _advance(self, infills=None, **kwargs):
        best = self.pop[best_first(self.pop)[:ELITES]]
        best.set("origin", ["elite"] * len(best))
        self.pop = Population.merge(best, infills)


def evolve(objective: Objective, region: Region, options: Genetic) -> Found:
    problem, generations = _Lengths(objective, region), []

    def record(state: Algorithm) -> None:
        crank, rod = state.pop.get("X").T
        generation = {
            "generation": len(generations),
            "individual": np.arange(len(state.pop)),
            "origin": state.pop.get("origin"),
            "crank_length": crank,
            "rod_length": rod,
            "objective": state.pop.get("F")[:, 0],
            "sum_of_squares": objective.sum_of_squares(state.pop.get("X")),
            "evaluations": len(problem.values),
        }
        generations.append(pd.DataFrame(generation))

    count = options.generations
    run_algorithm(
        problem, _Evolution(options), ("n_gen", count + 1), seed=options.seed, callback=record
    )
    population = pd.concat(generations, ignore_index=True)
    violations = np.maximum(
        region.violation(population[["crank_length", "rod_length"]].to_numpy()) - FEASIBLE, 0.0
    )
    best = population.iloc[np.lexsort((population["objective"], violations))[0]]
    return Found(
        lengths=best[["crank_length", "rod_length"]].to_numpy(dtype=float),
        value=float(best["objective"]),
        values=np.array(problem.values),
        status=f"stopped after {count} generations of {options.population}",
        population=population,
    )


def evaluations_until(values: np.ndarray, best: float, tolerance: float) -> int | None:
    """Number of evaluations until a value within `tolerance` (relative) of `best`; None if
    never."""
    close_enough = np.flatnonzero(values <= best * (1.0 + tolerance))
    return int(close_enough[0]) + 1 if len(close_enough) else None


def starting_points(region: Region) -> np.ndarray:
    """Six points, shape (6, 2) [m]: L2 at 1/4, 3/4 of its range with L3 at 1/6, 1/2, 5/6, projected
    onto the region."""
    shares = [(crank, rod) for rod in (1 / 6, 1 / 2, 5 / 6) for crank in (1 / 4, 3 / 4)]
    return region.nearest(region.unscaled(np.array(shares)))


def search(objective: Objective, region: Region, start: ArrayLike, tolerance: float) -> Found:
    """Local optimisation (SLSQP) from `start`."""
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
    end = np.clip(
        region.unscaled(result.x), region.lower, region.upper
    )  # exact bounds despite rounding
    if region.violation(end) > FEASIBLE:  # the tolerance also applies to constraints
        end = region.nearest(end)
    status = (
        f"stopped: the objective changes by less than {tolerance:g} of its value at the original"
        " lengths"
    )
    if not result.success:
        reason = str(result.message).strip().lower()
        status = f"not converged ({reason}): raise the tolerance {tolerance:g} or check the box"
    if not np.array_equal(path[-1], end):
        path.append(end)
    return Found(
        lengths=end,
        value=float(objective.value(end)),
        values=np.array(values),
        path=np.array(path),
        converged=bool(result.success),
        status=status,
    )


def search_from_all(objective: Objective, region: Region, tolerance: float) -> tuple[Found, ...]:
    """`search` from each of the six starting points."""
    return tuple(search(objective, region, start, tolerance) for start in starting_points(region))


@dataclass(frozen=True)
class Point:
    """A pair of lengths with a name."""

    name: str  # In the table optimise_optima
    method: str
    lengths: tuple[float, float]  # (L2, L3) [m]
    box: str | None = None  # Of the search; None for printed points
    status: str | None = None  # Why there is no optimum in the box


def printed_points(mechanism: Mechanism, simulate: Simulate) -> list[Point]:
    """The optima printed in the paper; empty for other mechanisms."""
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
    genetic: Found
    local: tuple[Found, ...]  # From the six starting points, at the configured tolerance

    @property
    def found(self) -> list[tuple[Point, Found]]:
        """Optima of the genetic and of the local optimiser."""
        best = min(self.local, key=lambda result: result.value)
        return [
            (
                Point(
                    f"{self.source}_{self.box}_{method}",
                    method,
                    tuple(map(float, result.lengths)),
                    self.box,
                ),
                result,
            )
            for method, result in (("genetic", self.genetic), ("local", best))
        ]


def search_all(
    objectives: dict[str, Objective], regions: dict[str, Region], options: Optimise
) -> list[Search]:
    """Run both optimisers for every objective (by source) in every configured box."""
    searches = []
    for source, objective in objectives.items():
        for box, region in regions.items():
            genetic = evolve(objective, region, options.genetic)
            local = search_from_all(objective, region, options.local_tolerance)
            searches.append(Search(source, box, objective, region, genetic, local))
    return searches


def optima(
    objectives: dict[str, Objective],
    searches: list[Search],
    fixed: list[Point],
    tolerance: float | None,
) -> pd.DataFrame:
    """The table optimise_optima: for each source the `fixed` points and the optima found."""
    rows = []
    for source, objective in objectives.items():
        rows += [_optimum(source, objective, point, tolerance) for point in fixed]
        for search in searches:
            lowest = min(result.value for _, result in search.found)
            rows += [
                _optimum(source, objective, point, tolerance)
                | {
                    "active_bounds": search.region.active(result.lengths),
                    "evaluations": result.evaluations,
                    "evaluations_within_1_percent": evaluations_until(result.values, lowest, 1e-2),
                    "evaluations_within_0_1_percent": evaluations_until(
                        result.values, lowest, 1e-3
                    ),
                    "status": result.status,
                }
                for point, result in search.found
                if search.source == source
            ]
    return pd.DataFrame(rows).astype(dict.fromkeys(_COUNTS, "Int64"))


_COUNTS = ("evaluations", "evaluations_within_1_percent", "evaluations_within_0_1_percent")


def _optimum(
    source: str, objective: Objective, point: Point, tolerance: float | None
) -> dict[str, object]:
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
        "objective": (value := float(objective.value(point.lengths))),
        "objective_reduction": 1.0 - value / float(objective.value(objective.original)),
        **{name: float(value) for name, value in measures._asdict().items()},
        **{f"{name}_reduction": float(value) for name, value in reductions._asdict().items()},
        **tolerance_effect(objective, point.lengths, tolerance),
        "invariant": float(invariant(reductions.rms, rod, "rms")),
        **dict.fromkeys(("active_bounds", *_COUNTS)),
        "status": point.status,
    }


def labelled(
    table: str, searches: list[Search], make: Callable[[Search], pd.DataFrame]
) -> pd.DataFrame:
    """A `table`: `make(search)` of every search below each other, with source and box in front."""
    frames = {(search.source, search.box): make(search) for search in searches}
    if not frames:
        return pd.DataFrame(columns=TABLES[f"optimise_{table}"].names)
    return (
        pd.concat(frames, names=["source", "box"])
        .reset_index(["source", "box"])
        .reset_index(drop=True)
    )


def paths(search: Search) -> pd.DataFrame:
    """Rows of the table optimise_paths."""
    columns = ["crank_length", "rod_length"]
    frames = {
        start: pd.DataFrame(result.path, columns=columns)
        for start, result in enumerate(search.local)
    }
    lengths = np.concatenate([result.path for result in search.local])
    values = {
        "objective": search.objective.value(lengths),
        "sum_of_squares": search.objective.sum_of_squares(lengths),
    }
    return pd.concat(frames, names=["start", "iteration"]).reset_index().assign(**values)


def tolerances(search: Search, options: Optimise) -> pd.DataFrame:
    """Rows of the table optimise_tolerance."""
    ends = {options.local_tolerance: search.local}
    for tolerance in options.further_tolerances:
        ends[tolerance] = search_from_all(search.objective, search.region, tolerance)
    rows = [
        {
            "tolerance": tolerance,
            "start": number,
            "crank_length": result.lengths[0],
            "rod_length": result.lengths[1],
            "objective": result.value,
            "sum_of_squares": float(search.objective.sum_of_squares(result.lengths)),
            "rms_reduction": float(search.objective.reductions(result.lengths).rms),
            "evaluations": result.evaluations,
            "converged": result.converged,
            "active_bounds": search.region.active(result.lengths),
        }
        for tolerance in sorted(ends, reverse=True)
        for number, result in enumerate(ends[tolerance])
    ]
    return pd.DataFrame(rows)
