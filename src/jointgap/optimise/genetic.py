"""The genetic algorithm with the paper's settings, carried by pymoo.

Generational: the elites live on unchanged, the rest of the next generation are children, of which the crossover fraction
comes from two parents and the others from one by mutation. The operators are in `jointgap.optimise.operators`; they keep
bounds and inequality, so pymoo has no constraint to handle.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from pymoo.algorithms.base.genetic import GeneticAlgorithm
from pymoo.core.infill import InfillCriterion
from pymoo.core.population import Population
from pymoo.core.problem import Problem
from pymoo.core.sampling import Sampling
from pymoo.core.survival import Survival
from pymoo.termination.max_gen import MaximumGenerationTermination

from jointgap.config import Genetic
from jointgap.optimise import operators
from jointgap.optimise.objective import Objective
from jointgap.optimise.region import Region


@dataclass(frozen=True)
class GeneticResult:
    """One run of the genetic algorithm.

    Attributes
    ----------
    lengths : ndarray, shape (2,)
        The best (L2, L3) [m].
    value : float
        Its sum of squares [rad^2].
    evaluations : int
        Calls of the objective; an elite is not evaluated again.
    values : ndarray, shape (evaluations,)
        Every value in the order of evaluation [rad^2].
    population : DataFrame
        A row per individual and generation: generation (0 = first), individual, origin (first, elite, crossover,
        mutation), crank_length, rod_length, sum_of_squares, evaluations (so far, at the generation's end).
    status : str
        Why it stopped.
    """

    lengths: np.ndarray
    value: float
    evaluations: int
    values: np.ndarray
    population: pd.DataFrame
    status: str


class _Lengths(Problem):
    """The objective as pymoo wants it; keeps every value it gave."""

    def __init__(self, objective: Objective, region: Region):
        super().__init__(n_var=2, n_obj=1, xl=region.lower, xu=region.upper)
        self.objective, self.region, self.values = objective, region, []

    def _evaluate(self, x, out, *args, **kwargs):
        values = self.objective.value(x)
        self.values.extend(values)
        out["F"] = values[:, None]


class _RegionSampling(Sampling):
    def _do(self, problem, n_samples, *args, random_state=None, **kwargs):
        return problem.region.sample(n_samples, random_state)


class _Mating(InfillCriterion):
    """Children by crossover and by mutation, their shares fixed."""

    def __init__(self, crossover_fraction: float):
        super().__init__()
        self.crossover_fraction = crossover_fraction

    def _do(self, problem, pop, n_offsprings, random_state=None, **kwargs):
        lengths, values = pop.get("X"), pop.get("F")[:, 0]
        crossed = round(self.crossover_fraction * n_offsprings)
        mutated = n_offsprings - crossed
        chosen = operators.stochastic_uniform(operators.rank_expectation(values), 2 * crossed + mutated, random_state)
        parents = lengths[chosen]
        children = np.concatenate(
            [
                operators.intermediate_crossover(parents[:crossed], parents[crossed : 2 * crossed], random_state),
                operators.feasible_mutation(parents[2 * crossed :], problem.region, random_state),
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
        best = old[np.argsort(old.get("F")[:, 0], kind="stable")[: self.elites]]
        best.set("origin", ["elite"] * self.elites)
        return Population.merge(best, new)


def evolve(objective: Objective, region: Region, options: Genetic) -> GeneticResult:
    """Run the genetic algorithm for the configured number of generations.

    Parameters
    ----------
    objective : Objective
    region : Region
    options : Genetic
        Population, generations, elites, crossover fraction, seed.

    Returns
    -------
    GeneticResult
        Bit for bit the same for the same seed.
    """
    problem = _Lengths(objective, region)
    algorithm = GeneticAlgorithm(
        pop_size=options.population,
        n_offsprings=options.population - options.elites,
        sampling=_RegionSampling(),
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
    best = population.loc[population["sum_of_squares"].idxmin()]
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
    """After how many evaluations a value within `tolerance` (relative) of `best` was found; None if never.

    Parameters
    ----------
    values : ndarray, shape (n,)
        In the order of evaluation [rad^2].
    best, tolerance : float
        [rad^2], share of it.
    """
    near = np.flatnonzero(values <= best * (1.0 + tolerance))
    return int(near[0]) + 1 if len(near) else None
