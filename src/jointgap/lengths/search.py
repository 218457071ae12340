"""Search of the lengths: genetic algorithm and local optimiser."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import NonlinearConstraint, brentq, minimize

from jointgap.config import Genetic, Optimise
from jointgap.core.errors import needs
from jointgap.lengths.objective import LargestOfSeveral, Objective
from jointgap.lengths.region import FEASIBLE, Region

with needs("optimising link lengths", "learn"):
    from pymoo.core.algorithm import Algorithm
    from pymoo.core.population import Population
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize as run_algorithm


@dataclass(frozen=True)
class SearchResult:
    """Result of one search."""

    lengths: np.ndarray  # shape (n,); the best [m]
    value: float  # The objective there [SI]
    values: np.ndarray  # shape (evaluations,); in order of evaluation, an elite's once [SI]
    status: str  # Stopping criterion
    history: pd.DataFrame  # Every individual of every generation, or every iterate from the start
    converged: bool = True  # Whether the stopping tolerance was reached


# -- genetic algorithm


def best_first(pop: "Population") -> np.ndarray:
    """Indices of individuals, (n,), sorted by feasibility, then by the objective."""
    return np.lexsort((pop.get("F")[:, 0], pop.get("CV")[:, 0]))


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


def feasible_mutation(
    parents: np.ndarray, region: Region, random: np.random.Generator
) -> np.ndarray:
    """Each parent (parents, n) moved by up to the box's width in a random direction, limited to the
    region."""
    if len(region.lower) == 2:
        angle = 2.0 * np.pi * random.random(len(parents))
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    else:
        direction = random.normal(size=parents.shape)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    moves = random.random((len(parents), 1)) * direction * region.size
    mutants = parents + region.reach(parents, moves)[:, None] * moves
    return np.clip(mutants, region.lower, region.upper)


ELITES, CROSSOVER_FRACTION = 2, 0.8
"""The paper's settings: best individuals that are kept unchanged, and the share of the other
children made by crossover; the rest mutate."""


class _LengthProblem(Problem):
    """The objective as a pymoo problem; records all values."""

    def __init__(self, objective: Objective, region: Region):
        count = int(bool(region.constraints))
        bounds = {"xl": region.lower, "xu": region.upper}
        super().__init__(n_var=len(region.lower), n_obj=1, n_ieq_constr=count, **bounds)
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
        lengths = self.problem.region.sample(count, self.random_state)
        return self._individuals(lengths, ["first"] * count)

    def _infill(self):
        # expected share among the parents, by rank
        weights = 1.0 / np.sqrt(1 + np.argsort(best_first(self.pop)))
        count, random = self.options.population - ELITES, self.random_state
        crossed = round(CROSSOVER_FRACTION * count)
        indices = stochastic_uniform(weights / weights.sum(), crossed + count, random)
        parents = self.pop.get("X")[indices]
        mothers, fathers = parents[:crossed], parents[crossed : 2 * crossed]
        children = mothers + random.random((crossed, 1)) * (fathers - mothers)
        mutants = feasible_mutation(parents[2 * crossed :], self.problem.region, random)
        origins = ["crossover"] * len(children) + ["mutation"] * len(mutants)
        return self._individuals(np.concatenate([children, mutants]), origins)

    def _individuals(self, lengths: np.ndarray, origins: list[str]) -> Population:
        region = self.problem.region
        lengths = region.nearest(lengths) if region.constraints else lengths
        return Population.new(X=lengths, origin=origins)

    def _advance(self, infills=None, **kwargs):
        elite = self.pop[best_first(self.pop)[:ELITES]]
        elite.set("origin", ["elite"] * len(elite))
        self.pop = Population.merge(elite, infills)


def evolve(objective: Objective, region: Region, options: Genetic) -> SearchResult:
    """Genetic algorithm in a region."""
    problem, generations = _LengthProblem(objective, region), []

    def record(state: Algorithm) -> None:
        lengths = state.pop.get("X")
        generation = {
            "generation": len(generations),
            "individual": np.arange(len(lengths)),
            "origin": state.pop.get("origin"),
            **dict(zip(region.names, lengths.T, strict=True)),
            "objective": state.pop.get("F")[:, 0],
        }
        generations.append(pd.DataFrame(generation))

    count, stop = options.generations, ("n_gen", options.generations + 1)
    evolution = _Evolution(options)
    pop = run_algorithm(problem, evolution, stop, seed=options.seed, callback=record).pop
    best = pop[best_first(pop)[0]]  # the elite is the best of all generations
    return SearchResult(
        lengths=best.X,
        value=float(best.F[0]),
        values=np.array(problem.values),
        status=f"stopped after {count} generations of {options.population}",
        history=pd.concat(generations, ignore_index=True),
    )


# -- local optimiser


def search(
    objective: Objective, region: Region, start: ArrayLike, tolerance: float
) -> SearchResult:
    """Local optimisation (SLSQP) from `start`.

    An objective that is the largest of several values is minimised as a bound of all of them, a
    further variable.
    """
    start, count = np.asarray(start, dtype=float), len(region.lower)
    # a start that is worse by far would swamp the steps
    values = [float(objective.value(lengths)) for lengths in (objective.original, start)]
    unit = max(values[0], 1e-3 * values[1])
    path, values = [start], []
    conditions, bounds = region.conditions(), [(0.0, 1.0)] * count

    def at(variables: np.ndarray) -> np.ndarray:
        return region.unscaled(np.array(variables[:count]))

    def relative_value(variables: np.ndarray) -> float:
        values.append(float(objective.value(at(variables))))
        return values[-1] / unit if len(variables) == count else variables[-1]

    def slope(variables: np.ndarray) -> np.ndarray:
        if len(variables) == count:
            return objective.gradient(at(variables)) * region.size / unit
        return np.eye(count + 1)[-1]

    first = (start - region.lower) / region.size
    if isinstance(objective, LargestOfSeveral):
        first = np.append(first, objective.value(start) / unit)
        bounds.append((0.0, np.inf))
        conditions = [*map(_with_bound, conditions), _bounded(objective, region, unit)]
    result = minimize(
        relative_value,
        first,
        jac=slope,
        method="SLSQP",
        bounds=bounds,
        constraints=conditions,
        callback=lambda variables: path.append(at(variables)),
        options={"ftol": tolerance, "maxiter": 200},
    )
    # exact bounds despite rounding
    end = np.clip(at(result.x), region.lower, region.upper)
    if region.violation(end) > FEASIBLE:  # the tolerance also applies to constraints
        end = region.nearest(end)
    if not np.array_equal(path[-1], end):
        path.append(end)
    status = (
        f"stopped: the objective changes by less than {tolerance:g} of its value at the original"
        " lengths"
    )
    if not result.success:
        reason = str(result.message).strip().lower()
        status = f"not converged ({reason}): raise the tolerance {tolerance:g} or check the box"
    history = pd.DataFrame(path, columns=region.names)
    history = history.assign(iteration=range(len(path)), objective=objective.value(path))
    return SearchResult(
        end, history["objective"].iloc[-1], np.array(values), status, history, bool(result.success)
    )


def _with_bound(condition: NonlinearConstraint) -> NonlinearConstraint:
    """A condition on the variables without the last one."""
    return NonlinearConstraint(
        lambda variables: condition.fun(variables[:-1]),
        condition.lb,
        condition.ub,
        jac=lambda variables: np.append(condition.jac(variables[:-1]), 0.0),
    )


def _bounded(objective: LargestOfSeveral, region: Region, unit: float) -> NonlinearConstraint:
    """No value of the objective is above the last variable."""

    def rooms(variables: np.ndarray) -> np.ndarray:
        return variables[-1] - objective.several(region.unscaled(variables[:-1])) / unit

    def slopes(variables: np.ndarray) -> np.ndarray:
        each = objective.slopes(region.unscaled(variables[:-1])) * region.size / unit
        return np.column_stack([-each, np.ones(len(each))])

    return NonlinearConstraint(rooms, 0.0, np.inf, jac=slopes)


def _starts(count: int) -> np.ndarray:
    """Six starting points, shares of the ranges of `count` lengths: of two lengths L2 at 1/4, 3/4
    with L3 at 1/6, 1/2, 5/6; of others spread evenly."""
    if count == 2:
        return np.array([(crank, rod) for rod in (1 / 6, 1 / 2, 5 / 6) for crank in (1 / 4, 3 / 4)])
    root = brentq(lambda x: x ** (count + 1) - x - 1.0, 1.0, 2.0)  # the golden ratio of n lengths
    return (0.5 + np.outer(np.arange(6), root ** -np.arange(1.0, count + 1))) % 1.0


def search_from_all(
    objective: Objective, region: Region, tolerance: float
) -> tuple[SearchResult, ...]:
    """`search` from six points, projected onto the region."""
    starts = region.nearest(region.unscaled(_starts(len(region.lower))))
    return tuple(search(objective, region, start, tolerance) for start in starts)


@dataclass(frozen=True)
class Point:
    """Lengths with a name."""

    name: str  # In the table optimise_optima
    method: str
    lengths: tuple[float, ...]  # [m]
    box: str | None = None  # Of the search; None for printed points
    source: str | None = None  # Of the search; None for points of no search
    columns: dict[str, Any] = field(default_factory=dict)  # Further ones of optimise_optima


@dataclass(frozen=True)
class Search:
    """Both optimisers for one source in one box."""

    source: str
    box: str
    objective: Objective
    region: Region
    genetic: SearchResult
    local: tuple[SearchResult, ...]  # From the six starting points, at the configured tolerance

    def optima(self) -> list[Point]:
        """Optima of the genetic algorithm and of the local optimiser."""
        best = {"genetic": self.genetic, "local": min(self.local, key=lambda end: end.value)}
        lowest, points = min(result.value for result in best.values()), []
        for method, result in best.items():
            columns = {
                "active_bounds": self.region.active(result.lengths),
                "evaluations": len(result.values),
                "status": result.status,
            }
            for percent, factor in (("1", 1.01), ("0_1", 1.001)):
                within = np.flatnonzero(result.values <= lowest * factor)
                evaluations = int(within[0]) + 1 if len(within) else None
                columns[f"evaluations_within_{percent}_percent"] = evaluations
            name, lengths = f"{self.source}_{self.box}_{method}", tuple(result.lengths.tolist())
            points.append(Point(name, method, lengths, self.box, self.source, columns))
        return points


def search_all(
    objectives: dict[str, Objective], regions: dict[str, Region], options: Optimise
) -> list[Search]:
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
