"""The search for lengths by pymoo: every candidate in the same draws, so that candidates differ by their lengths alone.

Three steps, each of which begins with the best of those before: a grid over the box, differential evolution for the
one measure of the error, and NSGA-II for the front of error, force and change of the stroke. What any of them tried
counts for the optimum and for the front.

The error hangs on the ratio of the lengths far more than on either of them (`jointgap.lengths.objective`), and its
valley runs across the box. Hence operators that no turn of the axes changes: donors of differential evolution are taken
whole (crossover rate 1), and children of NSGA-II lie around their parents (parent-centric crossover, Deb et al. 2002).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import qmc

from jointgap.config import Constraints
from jointgap.config.robust_config import OptimiseRobust
from jointgap.core.errors import needs
from jointgap.core.progress import tell
from jointgap.lengths.region import MET, Constraint, Region
from jointgap.robust_lengths.robust_measure import RobustMeasure, deviation, held_quantile
from jointgap.robust_lengths.simulated_draws import Responding, Responses

with needs("optimising link lengths", "learn"):
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.algorithms.soo.nonconvex.de import DE
    from pymoo.core.problem import Problem
    from pymoo.core.repair import Repair
    from pymoo.operators.crossover.pcx import PCX
    from pymoo.termination.max_gen import MaximumGenerationTermination
    from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

OBJECTIVES = ("error", "force", "stroke_change")
"""What the front trades against each other, by column of the candidates."""

GRID, ONE, FRONT = "grid", "one measure", "front"
"""Names of the steps."""


@dataclass(frozen=True)
class RobustProblem:
    """What lengths are asked to do."""

    region: Region  # Where they may lie; its constraints follow from the lengths alone and hold for the nominal ones
    original: tuple[float, float]  # The lengths that were designed, (L2, L3) [m]
    stroke: Callable[[np.ndarray], np.ndarray]  # From lengths (..., 2) [m] to the stroke without clearance [m]
    measure: RobustMeasure  # Of the error, and of the force on the front
    constraints: Constraints  # The section of the configuration; of it the largest force in a pin
    probability: float  # Share of the draws in which each constraint has to hold

    @property
    def uncertain_constraints(self) -> tuple[Constraint, ...]:
        """Ranges of what follows from the lengths: tolerances may lead out of them. What is fixed holds for the nominal
        lengths alone, for no length with a tolerance meets a value exactly.
        """
        return tuple(each for each in self.region.constraints if not each.is_fixed)

    def missed(self, responses: Responses) -> dict[str, np.ndarray]:
        """By constraint how far it is missed, shape (m, n), below 0 where it is met: in mm or deg, a force in % of its
        limit.
        """
        found = {}
        for each in self.uncertain_constraints:
            value = each.value(responses.actual)
            found[each.key] = np.maximum(each.low - value, value - each.high) / each.scale - MET
        if (most := self.constraints.largest_pin_force) is not None:
            found["largest_pin_force"] = 100.0 * (responses.force / most - 1.0)
        return found


def assess(asked: RobustProblem, responses: Responses) -> pd.DataFrame:
    """A row for each pair of lengths: what the search goes by."""
    lengths, failed = responses.lengths, responses.failed
    missed = asked.region.missed(lengths)
    missed = np.where(missed > MET, missed, 0.0)
    for each in asked.missed(responses).values():
        missed = missed + np.maximum(held_quantile(each, asked.probability), 0.0)
    return pd.DataFrame(
        {
            "crank_length": lengths[:, 0],
            "rod_length": lengths[:, 1],
            "error_mean": np.where(failed < responses.error.shape[1], np.nansum(responses.error, axis=1), np.nan)
            / np.maximum(responses.error.shape[1] - failed, 1),
            "error_deviation": deviation(responses.error),
            "error": asked.measure.of(responses.error),
            "force": asked.measure.of(responses.force),
            "stroke_change": np.abs(asked.stroke(lengths) - asked.stroke(np.array(asked.original))),
            "missed": np.minimum(missed, _MISSED_MOST),
            "failed": failed,
        }
    )


_MISSED_MOST = 1e9
"""What stands for infinity: a constraint on a force that no simulation gave."""

_FAILED = 1e6
"""Objectives of lengths of which no draw could be simulated: far above any, and finite, as pymoo wants them."""


class _Lengths(Problem):
    """The lengths of a region as pymoo wants them; keeps what it was asked."""

    def __init__(self, asked: RobustProblem, respond: Responding, objectives: tuple[str, ...]):
        region = asked.region
        super().__init__(n_var=2, n_obj=len(objectives), n_ieq_constr=2, xl=region.lower, xu=region.upper)
        self.asked, self.respond, self.objectives = asked, respond, objectives
        self.generations: list[pd.DataFrame] = []

    def _evaluate(self, x, out, *args, **kwargs):
        found = assess(self.asked, self.respond(x))
        self.generations.append(found)
        out["F"] = found[list(self.objectives)].fillna(_FAILED).to_numpy()
        out["G"] = found[["missed", "failed"]].to_numpy(dtype=float)


class _OntoRegion(Repair):
    def _do(self, problem, x, **kwargs):
        return problem.asked.region.nearest(x)


def search(asked: RobustProblem, respond: Responding, options: OptimiseRobust, with_front: bool = True) -> pd.DataFrame:
    """Search the region for the best lengths, and for the front."""
    steps = 1 + (2 if with_front else 1) * options.generations
    tell("generations of lengths", 0, steps)
    region = asked.region
    grid = region.nearest(np.vstack([grid_of(region, options.grid), region.clip(np.array(asked.original))]))
    found = [assess(asked, respond(grid)).assign(step=GRID, generation=0)]
    tell("generations of lengths", 1, steps)
    objectives_of = {ONE: ("error",)} | ({FRONT: OBJECTIVES} if with_front else {})
    for number, (step, objectives) in enumerate(objectives_of.items()):
        problem = _Lengths(asked, respond, objectives)
        spread = np.random.default_rng([options.seed, number])  # not where the step before began
        begin = _beginning(pd.concat(found, ignore_index=True), asked, objectives, options.population, spread)
        given = {"pop_size": options.population, "sampling": begin, "repair": _OntoRegion()}
        running = DE(variant="DE/best/1/bin", CR=1.0, **given) if step == ONE else NSGA2(crossover=PCX(), **given)
        running.setup(problem, seed=options.seed, termination=MaximumGenerationTermination(options.generations))
        while running.has_next():
            running.next()
            tell("generations of lengths", 1 + number * options.generations + len(problem.generations), steps)
        found += [each.assign(step=step, generation=k) for k, each in enumerate(problem.generations)]
    return pd.concat(found, ignore_index=True)


def grid_of(region: Region, points: int) -> np.ndarray:
    """Those of `points` x `points` pairs of lengths over the box that a `region` contains, shape (n, 2) [m]."""
    cranks, rods = np.meshgrid(*np.linspace(region.lower, region.upper, points).T, indexing="ij")
    lengths = np.stack([cranks.ravel(), rods.ravel()], axis=1)
    return lengths[region.contains(lengths, slack=1e-12)]


def best_of(candidates: pd.DataFrame) -> int:
    """Place of the candidate with the smallest error among those that keep the constraints; where none does, of the
    nearest to that.
    """
    order = np.lexsort((candidates["error"].fillna(np.inf), candidates["missed"], candidates["failed"]))
    return int(order[0])


def front_of(candidates: pd.DataFrame) -> np.ndarray:
    """Places of the candidates that keep the constraints and that no other one is better than in all objectives."""
    allowed = np.flatnonzero((candidates["missed"] <= 0.0) & (candidates["failed"] == 0))
    if not len(allowed):
        return allowed
    values = candidates[list(OBJECTIVES)].to_numpy()[allowed]
    first = NonDominatedSorting().do(values, only_non_dominated_front=True)
    kept = allowed[np.sort(first)]
    lengths = candidates.loc[kept, ["crank_length", "rod_length"]].to_numpy()
    _, places = np.unique(lengths, axis=0, return_index=True)
    return kept[np.sort(places)]


def _beginning(
    candidates: pd.DataFrame,
    asked: RobustProblem,
    objectives: tuple[str, ...],
    population: int,
    random: np.random.Generator,
) -> np.ndarray:
    """Where a step begins: half of it the best of what was tried, half spread over the region, shape (n, 2) [m]."""
    kept = population // 2
    if len(objectives) > 1 and len(front := front_of(candidates)):
        # the front of all that was tried, its ends and evenly along the error
        ordered = front[np.argsort(candidates["error"].to_numpy()[front], kind="stable")]
        places = ordered[np.unique(np.linspace(0, len(ordered) - 1, kept).round().astype(int))]
    else:
        order = np.lexsort((candidates["error"].fillna(np.inf), candidates["missed"], candidates["failed"]))
        places = order[:kept]
    best = candidates.loc[places, ["crank_length", "rod_length"]].to_numpy()
    region, missing = asked.region, population - len(best)
    spread = qmc.LatinHypercube(2, rng=random).random(missing)
    return np.vstack([best, region.nearest(region.unscaled(spread))])
