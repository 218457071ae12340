"""The genetic algorithm with the paper's settings, carried by pymoo.

Generational: the elites live on unchanged, the rest of the next generation are children, of which the crossover
fraction comes from two parents and the others from one by mutation. The operators are pure functions of arrays and a
random generator. They follow the MATLAB toolbox that the paper used, in its variants for linear inequalities: what they
make of allowed parents is allowed, so pymoo has no constraint to handle.

- Fitness by rank: expectation proportional to 1/sqrt(rank).
- Stochastic uniform selection (Baker 1987): one throw, equal steps along a line on which each parent has its
  expectation's length.
- Crossover: a random point of the line between two parents (the toolbox's "intermediate"; its default "scattered" would
  swap L2 and L3 between parents and can break the inequality).
- Mutation: a step in a random direction, cut where it would leave the region. Its length is drawn evenly up to the
  width of the box in every generation. The toolbox's "adaptive feasible" mutation shrinks it after failures instead,
  and then far more runs end somewhere along the valley.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Genetic
from jointgap.errors import needs
from jointgap.link_lengths.constraints import MET
from jointgap.link_lengths.objective import Objective
from jointgap.link_lengths.region import Region

with needs("optimising link lengths", "learn"):
    from pymoo.algorithms.base.genetic import GeneticAlgorithm
    from pymoo.core.infill import InfillCriterion
    from pymoo.core.population import Population
    from pymoo.core.problem import Problem
    from pymoo.core.repair import Repair
    from pymoo.core.sampling import Sampling
    from pymoo.core.survival import Survival
    from pymoo.termination.max_gen import MaximumGenerationTermination


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
class GeneticResult:
    """One run of the genetic algorithm."""

    lengths: np.ndarray  # shape (2,); the best (L2, L3) [m]
    value: float  # Its sum of squares [rad^2]
    evaluations: int  # Calls of the objective; an elite is not evaluated again
    values: np.ndarray  # shape (evaluations,); every value in the order of evaluation [rad^2]
    population: pd.DataFrame  # A row per individual and generation
    status: str  # Why it stopped


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
    algorithm.setup(problem, seed=options.seed, termination=MaximumGenerationTermination(options.generations + 1))
    generations = []
    while algorithm.has_next():
        algorithm.next()
        generations.append(_record(len(generations), algorithm.pop, len(problem.values)))
    population = pd.concat(generations, ignore_index=True)
    violations = np.maximum(region.missed(population[["crank_length", "rod_length"]].to_numpy()) - MET, 0.0)
    best = population.iloc[best_first(population["sum_of_squares"].to_numpy(), violations)[0]]
    return GeneticResult(
        lengths=best[["crank_length", "rod_length"]].to_numpy(dtype=float),
        value=float(best["sum_of_squares"]),
        evaluations=len(problem.values),
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
