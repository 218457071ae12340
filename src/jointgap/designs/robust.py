"""Draws of what is uncertain: a mechanism each, whose lengths are still to be given, and the tolerances of these."""

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm
from matplotlib.tri import Triangulation, UniformTriRefiner
from scipy.stats import binomtest, qmc

from jointgap.config import Constraints, DrivenMechanism, Mechanism, Optimise, Scenario, Simulate
from jointgap.config.designs import OptimiseRobust
from jointgap.config.variations import with_values
from jointgap.core import plot
from jointgap.core.errors import InputError, needs
from jointgap.core.joints import PINS
from jointgap.core.page import Block, FigureBlock, Heading, Page, Paragraph, TableBlock, written_today
from jointgap.core.plot import Drawing, Panel, Quantity, Sheet
from jointgap.core.progress import tell
from jointgap.core.schema import (
    OPTIMISE_ROBUST_CONSTRAINTS,
    OPTIMISE_ROBUST_FRESH,
    OPTIMISE_ROBUST_GAINS,
    Column,
    Table,
)
from jointgap.core.words import joined, percent, reading_unit, unit_in_words
from jointgap.designs.page import parameter_in_words
from jointgap.designs.sampling import Axis, axes_of
from jointgap.dynamics.kinematics import ideal_cycle, transmission_angle
from jointgap.dynamics.parallel import Outcome, Run, rod_and_slider, simulate_runs
from jointgap.lengths.objective import Objective, measure, objective_of_motion
from jointgap.lengths.region import MET, Constraint, Region, depends_on_offset, geometric
from jointgap.lengths.search import search_from_all

with needs("optimising link lengths", "learn"):
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.algorithms.soo.nonconvex.de import DE
    from pymoo.core.problem import Problem
    from pymoo.core.repair import Repair
    from pymoo.operators.crossover.pcx import PCX
    from pymoo.optimize import minimize
    from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting


SOURCE = "optimise_robust.uncertain"
"""What errors call the place where something uncertain stands."""

LENGTHS = ("crank_length", "rod_length")
"""Words whose values are added to the lengths that are searched."""

PATHS_OF_LENGTHS = {
    f"mechanism.{link}.{key}": f"{link}_length" for link in ("crank", "rod") for key in ("length", "mass_centre")
}
"""By path the word for a length whose mass centre goes with it."""

OF_THE_COMPUTATION = {"simulate.revolutions", "simulate.samples_per_revolution", "simulate.tolerance"}
"""Paths of how a motion is computed, which is no property of a mechanism."""

OFFSET = "mechanism.slider.offset"
"""Path of what constraints of the lengths are worked out with."""

_LARGEST_TOLERANCE = 0.1
"""Share of a length beyond which what is added to it is no tolerance but, in all likelihood, the length itself."""

_FRESH = 1  # beside the seed: the stream of the fresh draws, which have nothing in common with those of the search


@dataclass(frozen=True)
class Draw:
    """One way in which the uncertain may turn out."""

    values: dict[str, Any]  # By key; of lengths what is added to them [m]
    mechanism: Mechanism  # At its nominal lengths
    simulate: Simulate
    tolerance: tuple[float, float] = (0.0, 0.0)  # What is added to (L2, L3) [m]


@dataclass(frozen=True)
class Uncertain:
    """What is uncertain in a scenario; make it with `uncertain_of`."""

    base: DrivenMechanism  # Mechanism, its effects applied, and simulation, at nominal values
    axes: tuple[Axis, ...]
    seed: int

    @property
    def nominal(self) -> Draw:
        """Nothing differs from the scenario."""
        return Draw({}, self.base.mechanism, self.base.simulate)

    def for_search(self, count: int) -> tuple[Draw, ...]:
        """`count` draws that fill what may be evenly: the beginning of a scrambled Sobol sequence."""
        power = (count - 1).bit_length()  # a sequence is balanced in whole powers of two
        return self._draws(qmc.Sobol(len(self.axes), scramble=True, rng=self.seed).random_base2(power)[:count])

    def fresh(self, count: int) -> tuple[Draw, ...]:
        """`count` draws, each independent of the others and of those of the search; errors as of `for_search`."""
        return self._draws(np.random.default_rng([self.seed, _FRESH]).random((count, len(self.axes))))

    def _draws(self, quantiles: np.ndarray) -> tuple[Draw, ...]:
        columns = [axis.at(part) for axis, part in zip(self.axes, quantiles.T, strict=True)]
        keys = [axis.key for axis in self.axes]
        return tuple(self._draw(dict(zip(keys, row, strict=True))) for row in zip(*columns, strict=True))

    def _draw(self, values: dict[str, Any]) -> Draw:
        others = {key: value for key, value in values.items() if key not in LENGTHS}
        try:
            scenario = with_values(self.base, others, SOURCE)
        except InputError as error:
            raise InputError(f"{error}; a draw that is impossible: cut the distribution off with from and to") from None
        crank, rod = (values.get(key, 0.0) for key in LENGTHS)
        return Draw(values, scenario.mechanism, scenario.simulate, (crank, rod))


def uncertain_of(scenario: Scenario) -> Uncertain:
    """What the section `optimise_robust` of a `scenario` calls uncertain."""
    options = scenario.optimise_robust
    if not options.uncertain:
        raise InputError(
            f"{SOURCE}: nothing is uncertain, so there is nothing to be robust against; give parameters with "
            "distributions, such as friction: {from: 0.02, to: 0.15}"
        )
    for key, word in PATHS_OF_LENGTHS.items():
        if key in options.uncertain:
            raise InputError(
                f"{SOURCE}.{key}: lengths are searched, and mass centres go with them; give {word} with the tolerance "
                "that is added, such as {distribution: normal, mean: 0 mm, deviation: 0.05 mm}"
            )
    for key in OF_THE_COMPUTATION & options.uncertain.keys():
        raise InputError(f"{SOURCE}.{key}: is how the motion is computed, and not uncertain; leave it out")
    if OFFSET in options.uncertain and (key := depends_on_offset(scenario.optimise.constraints)):
        raise InputError(
            f"{SOURCE}.{OFFSET}: optimise.constraints.{key} is computed with the nominal offset; leave out one of them"
        )
    base = DrivenMechanism(mechanism=scenario.mechanism.applied(), simulate=scenario.simulate)
    axes = axes_of(base, options.uncertain, SOURCE)
    for axis in axes:
        if axis.values is not None and len(axis.values) < 2:
            raise InputError(f"{SOURCE}.{axis.key}: one value is not uncertain; give several, or a distribution")
        if axis.key in LENGTHS:
            _check_tolerance(axis, scenario)
    return Uncertain(base, axes, options.seed)


def _check_tolerance(axis: Axis, scenario: Scenario) -> None:
    """Whether what is added to a length is small beside it."""
    shortest = min(getattr(box, axis.key)[0] for box in scenario.optimise.boxes.values())
    largest = max(abs(value) for value in axis.at(np.array([0.001, 0.5, 0.999])))
    if largest > _LARGEST_TOLERANCE * shortest:
        raise InputError(
            f"{SOURCE}.{axis.key}: the length is searched, and what stands here is added to it; values up to "
            f"{1e3 * largest:g} mm are no tolerance of a length of {1e3 * shortest:g} mm or more: give the departure "
            "from nominal, such as mean: 0 mm"
        )


def law_in_words(axis: Axis, factor: float = 1.0) -> str:
    """How a parameter is distributed, for a table."""
    if axis.values is not None:
        shown: Sequence = [f"{factor * v:.4g}" if isinstance(v, float) else str(v) for v in axis.values]
        return f"one of {', '.join(shown)}"
    low, middle, high = (f"{factor * value:.4g}" for value in axis.at(np.array([0.025, 0.5, 0.975])))
    return f"{_LAWS[axis.law.dist.name]}: median {middle}, 95 % of it {low} to {high}"


_LAWS = {"uniform": "uniform", "loguniform": "log-uniform", "truncnorm": "normal", "triang": "triangular"}


@dataclass(frozen=True)
class RobustMeasure:
    """One number of the values that a quantity has in many draws."""

    kind: str = "mean_plus_deviations"  # mean_plus_deviations or quantile
    deviations: float = 2.0  # Standard deviations that are added to the mean
    quantile: float = 0.95  # Share of the draws below the quantile

    def of(self, values: np.ndarray) -> np.ndarray:
        """The number, shape (...), of `values` (..., n) in n draws; draws that are NaN do not count."""
        if self.kind == "quantile":
            return _without_warning(np.nanquantile, values, self.quantile)
        return mean(values) + self.deviations * deviation(values)

    @property
    def words(self) -> str:
        """Its name in a sentence."""
        if self.kind == "quantile":
            return f"{100 * self.quantile:g} % quantile"
        return f"mean plus {self.deviations:g} standard deviations" if self.deviations else "mean"


def mean(values: np.ndarray) -> np.ndarray:
    """Mean, shape (...), of `values` (..., n) without those that are NaN; NaN where all are."""
    return _without_warning(np.nanmean, values)


def deviation(values: np.ndarray) -> np.ndarray:
    """Standard deviation, shape (...), of `values` (..., n), unbiased in its square; 0 of one value."""
    return np.nan_to_num(_without_warning(np.nanstd, values, ddof=1))


def _without_warning(function: Callable, *given, **more) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # numpy's, where no draw or one alone is left
        return function(*given, axis=-1, **more)


def held_quantile(missed: np.ndarray, probability: float) -> np.ndarray:
    """By how much a constraint is missed in all but the worst draws, shape (...).

    At most 0 just where the constraint holds in a share of `probability` of the draws, or more.
    """
    n = missed.shape[-1]
    place = min(math.ceil(probability * n - 1e-9), n) - 1
    return np.sort(np.where(np.isnan(missed), np.inf, missed), axis=-1)[..., place]


_SAMPLED = ("times", "states", "auxiliary_states", "modes", "approaches", "begins", "directions")


@dataclass(frozen=True)
class Responses:
    """What m pairs of lengths do in n draws."""

    lengths: np.ndarray  # shape (m, 2); nominal [m]
    actual: np.ndarray  # shape (m, n, 2); with the tolerances of each draw [m]
    error: np.ndarray
    force: np.ndarray
    stroke: np.ndarray
    reasons: tuple[tuple[str | None, ...], ...]  # Why, m times n

    @property
    def failed(self) -> np.ndarray:
        """Draws whose simulation failed, shape (m,)."""
        return np.count_nonzero(np.isnan(self.error), axis=-1)


Responding = Callable[[np.ndarray], Responses]
"""What answers for lengths (m, 2) [m] in every draw: a simulation, or a formula that stands in for it."""


@dataclass(frozen=True)
class SimulatedDraws:
    """The simulation at some draws, the same for all lengths."""

    draws: Sequence[Draw]
    original: Mechanism  # Its effects applied and at the lengths that were designed
    optimise: Optimise  # Window and settled revolution
    revolution: str  # first or settled
    workers: int | None = None  # Threads; the result does not depend on it

    def __call__(self, lengths: np.ndarray) -> Responses:
        """What `lengths` (m, 2) [m] do in every draw."""
        lengths = np.atleast_2d(np.asarray(lengths, dtype=float))
        actual = lengths[:, None, :] + np.array([draw.tolerance for draw in self.draws])
        shape = actual.shape[:2]
        found, reasons = np.full((3, *shape), np.nan), []
        for outcome in simulate_runs(self._runs(actual), self.workers):
            place = np.unravel_index(len(reasons), shape)
            reasons.append(None if outcome.error is None else str(outcome.error))
            if outcome.error is None:
                found[(slice(None), *place)] = self._measured(outcome)
        rows = tuple(tuple(reasons[k * shape[1] : (k + 1) * shape[1]]) for k in range(shape[0]))
        return Responses(lengths, actual, *found, rows)

    def _runs(self, actual: np.ndarray) -> Iterator[Run]:
        for row in actual:
            for draw, lengths in zip(self.draws, row, strict=True):
                yield Run(draw.mechanism.with_lengths(*map(float, lengths)), draw.simulate)

    def _settled(self, simulate: Simulate) -> slice:
        per_turn = simulate.samples_per_revolution
        first = (self.optimise.ensemble.settled_revolution - 1) * per_turn
        return slice(first, first + per_turn + 1)

    def counted(self, simulate: Simulate) -> np.ndarray:
        """Samples that the error counts."""
        if self.revolution == "settled":
            settled = self._settled(simulate)
            return np.arange(settled.start, settled.stop - 1)  # its end is its beginning again
        per_turn = simulate.samples_per_revolution
        turned = np.arange(per_turn) * (2.0 * np.pi / per_turn)
        slack = np.pi / per_turn  # half a sample: the window's ends do not hang on rounding
        low, high = self.optimise.window
        return np.flatnonzero((turned >= low - slack) & (turned <= high + slack))

    def _measured(self, outcome: Outcome) -> tuple[float, float, float]:
        """Error [rad], force [N] and stroke [m] of one motion."""
        result, simulate = outcome.result, outcome.run.options
        counted, settled = self.counted(simulate), self._settled(simulate)
        angle = outcome.crank_angle[counted]
        rod, _ = rod_and_slider(outcome.parameters, angle, result.states[counted], result.auxiliary_states[counted])
        crank_length, rod_length = self.original.crank.length, self.original.rod.length
        designed = transmission_angle(crank_length, rod_length, angle, 0.0, self.original.slider.offset)
        last = replace(result, **{name: getattr(result, name)[settled] for name in _SAMPLED})
        seen = last.observed(outcome.parameters)
        force = max(np.hypot(seen[f"{pin}_force_x"], seen[f"{pin}_force_y"]).max() for pin in PINS)
        error = float(measure(designed - np.pi / 2 - rod).rms)
        return error, float(force), float(np.ptp(seen["slider_position"]))


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
            "error_mean": mean(responses.error),
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
    """The lengths of a region as pymoo wants them; keeps what it was asked, a frame a generation."""

    def __init__(self, asked: RobustProblem, respond: Responding, objectives: tuple[str, ...], told: Callable):
        region = asked.region
        super().__init__(n_var=2, n_obj=len(objectives), n_ieq_constr=2, xl=region.lower, xu=region.upper)
        self.asked, self.respond, self.objectives, self.told = asked, respond, objectives, told
        self.generations: list[pd.DataFrame] = []

    def _evaluate(self, x, out, *args, **kwargs):
        found = assess(self.asked, self.respond(x))
        self.generations.append(found)
        self.told(len(self.generations))
        out["F"] = found[list(self.objectives)].fillna(_FAILED).to_numpy()
        out["G"] = found[["missed", "failed"]].to_numpy(dtype=float)


class _OntoRegion(Repair):
    def _do(self, problem, x, **kwargs):
        return problem.asked.region.nearest(x)


def search(asked: RobustProblem, respond: Responding, options: OptimiseRobust, with_front: bool = True) -> pd.DataFrame:
    """Search the region for the best lengths, and for the front."""
    steps = {ONE: ("error",)} | ({FRONT: OBJECTIVES} if with_front else {})

    def told(done: int) -> None:
        tell("generations of lengths", done, 1 + len(steps) * options.generations)

    told(0)
    region = asked.region
    cranks, rods = np.meshgrid(*np.linspace(region.lower, region.upper, options.grid).T, indexing="ij")
    grid = np.stack([cranks.ravel(), rods.ravel()], axis=1)
    grid = grid[region.contains(grid, slack=1e-12)]
    grid = region.nearest(np.vstack([grid, region.clip(np.array(asked.original))]))
    found = [assess(asked, respond(grid)).assign(step=GRID, generation=0)]
    for number, (step, objectives) in enumerate(steps.items()):
        before = 1 + number * options.generations
        told(before)
        problem = _Lengths(asked, respond, objectives, lambda done, before=before: told(before + done))
        spread = np.random.default_rng([options.seed, number])  # not where the step before began
        begin = _beginning(pd.concat(found, ignore_index=True), region, objectives, options.population, spread)
        given = {"pop_size": options.population, "sampling": begin, "repair": _OntoRegion()}
        algorithm = DE(variant="DE/best/1/bin", CR=1.0, **given) if step == ONE else NSGA2(crossover=PCX(), **given)
        minimize(problem, algorithm, ("n_gen", options.generations), seed=options.seed)
        found += [each.assign(step=step, generation=k) for k, each in enumerate(problem.generations)]
    return pd.concat(found, ignore_index=True)


def ranked(candidates: pd.DataFrame) -> np.ndarray:
    """Places of the candidates from the best on: those that keep the constraints by their error, then the nearest."""
    return np.lexsort((candidates["error"].fillna(np.inf), candidates["missed"], candidates["failed"]))


def best_of(candidates: pd.DataFrame) -> pd.Series:
    """The best of the candidates."""
    return candidates.iloc[ranked(candidates)[0]]


def front_of(candidates: pd.DataFrame) -> np.ndarray:
    """Places of the candidates that keep the constraints and that no other one is better than in all objectives."""
    allowed = np.flatnonzero((candidates["missed"] <= 0.0) & (candidates["failed"] == 0))
    if not len(allowed):
        return allowed
    values = candidates[list(OBJECTIVES)].to_numpy()[allowed]
    first = NonDominatedSorting().do(values, only_non_dominated_front=True)
    kept = allowed[np.sort(first)]
    lengths = candidates.loc[kept, list(LENGTHS)].to_numpy()
    _, places = np.unique(lengths, axis=0, return_index=True)
    return kept[np.sort(places)]


def _beginning(
    candidates: pd.DataFrame,
    region: Region,
    objectives: tuple[str, ...],
    population: int,
    random: np.random.Generator,
) -> np.ndarray:
    """Where a step begins: half of it the best of what was tried, half spread over the region, shape (n, 2) [m]."""
    places = ranked(candidates)[: population // 2]
    if len(objectives) > 1 and len(front := front_of(candidates)):
        # the front of all that was tried, its ends and evenly along the error
        ordered = front[np.argsort(candidates["error"].to_numpy()[front], kind="stable")]
        places = ordered[np.unique(np.linspace(0, len(ordered) - 1, population // 2).round().astype(int))]
    best = candidates.loc[places, list(LENGTHS)].to_numpy()
    spread = qmc.LatinHypercube(2, rng=random).random(population - len(best))
    return np.vstack([best, region.nearest(region.unscaled(spread))])


CONFIDENCE = 0.95
QUANTITIES = ("error", "force", "stroke")
STATISTICS = ("mean", "deviation", "measure", "quantile_05", "median", "quantile_95")

_AT_ONCE = 4_000_000  # numbers of bootstrap samples in memory
_BOOTSTRAP = 2  # beside the seed: the stream of the bootstrap
_SUFFIXES = ("", "_low", "_high")  # of the columns of a value and its interval


@dataclass(frozen=True)
class Comparison:
    """What fresh draws say of some pairs of lengths; frames of the tables of the same names."""

    lengths: pd.DataFrame  # A row for each pair of lengths: each statistic of each quantity, with its interval
    gains: pd.DataFrame  # A row for each two of them: how often, and by how much, the error of one is the smaller
    constraints: pd.DataFrame  # A row for each pair of lengths and constraint
    counted: np.ndarray  # shape (n,); draws that were simulated with all lengths


def compare(
    asked: RobustProblem, names: tuple[str, ...], responses: Responses, resamples: int, seed: int
) -> Comparison:
    """Put lengths side by side."""
    counted = ~np.isnan(responses.error).any(axis=0)
    if np.count_nonzero(counted) < 2:
        reason = next(reason for row in responses.reasons for reason in row if reason)
        raise InputError(
            f"optimise_robust: of {len(counted)} fresh draws fewer than two could be simulated with all lengths that "
            f"are compared; the first that failed: {reason}"
        )
    found = {
        "lengths": names,
        "crank_length": responses.lengths[:, 0],
        "rod_length": responses.lengths[:, 1],
        "draws": np.count_nonzero(counted),
        "failed": responses.failed,
    }
    for name in QUANTITIES:
        values = getattr(responses, name)[:, counted]
        each = _with_interval(lambda one: statistics(one, asked.measure), resamples, seed, values)
        for place, statistic in enumerate(STATISTICS):
            found |= {f"{name}_{statistic}{end}": of[place] for end, of in zip(_SUFFIXES, each, strict=True)}
    gains = [
        _gain_row(
            asked.measure, names[new], names[beside], *responses.error[[new, beside]][:, counted], resamples, seed
        )
        for beside, new in combinations(range(len(names)), 2)
    ]
    held = [
        {"lengths": name, "constraint": key, "asked": asked.probability, "draws": len(row)}
        | _share(np.count_nonzero(row <= 0.0), len(row))
        for key, missed in asked.missed(responses).items()
        for name, row in zip(names, missed, strict=True)
    ]
    constraints = pd.DataFrame(held, columns=OPTIMISE_ROBUST_CONSTRAINTS.names)
    return Comparison(
        pd.DataFrame(found), pd.DataFrame(gains, columns=OPTIMISE_ROBUST_GAINS.names), constraints, counted
    )


def statistics(values: np.ndarray, measure: RobustMeasure) -> np.ndarray:
    """The numbers `STATISTICS`, (6, ...), of `values` (..., n); `measure` is one of them."""
    quantiles = np.quantile(values, (0.05, 0.5, 0.95), axis=-1)
    return np.stack([np.mean(values, axis=-1), deviation(values), measure.of(values), *quantiles])


def _share(times: int, trials: int) -> dict[str, float]:
    """How often something happened, and the exact interval of its probability."""
    interval = binomtest(int(times), int(trials)).proportion_ci(CONFIDENCE, method="exact")
    return {"probability": times / trials, "probability_low": interval.low, "probability_high": interval.high}


def _with_interval(statistic: Callable, resamples: int, seed: int, *samples: np.ndarray) -> tuple[np.ndarray, ...]:
    """A statistic of `samples` (..., n), and the ends of its interval by bootstrap over draws, the same for all."""
    random, count, found = np.random.default_rng([seed, _BOOTSTRAP]), samples[0].shape[-1], []
    for first in range(0, resamples, each := max(1, _AT_ONCE // samples[0].size)):
        places = random.integers(0, count, (min(each, resamples - first), count))
        found.append(statistic(*(sample[..., places] for sample in samples)))
    outside = (1.0 - CONFIDENCE) / 2.0
    return statistic(*samples), *np.quantile(np.concatenate(found, axis=-1), (outside, 1.0 - outside), axis=-1)


def _gain_row(
    measure: RobustMeasure, name: str, beside: str, now: np.ndarray, was: np.ndarray, resamples: int, seed: int
) -> dict[str, object]:
    """How often, and by which share, the errors `now` are smaller than they were, in the same draws (n,)."""

    def falls(now: np.ndarray, was: np.ndarray) -> np.ndarray:
        return 1.0 - np.stack([mean(now) / mean(was), measure.of(now) / measure.of(was)])

    row: dict[str, object] = {"lengths": name, "beside": beside, "draws": len(now)}
    row |= _share(np.count_nonzero(now < was), len(now))
    for end, (by_mean, by_measure) in zip(_SUFFIXES, _with_interval(falls, resamples, seed, now, was), strict=True):
        row |= {f"mean_fall{end}": float(by_mean), f"measure_fall{end}": float(by_measure)}
    return row


COMPARED = ("original", "frozen", "nominal", "robust")
"""Pairs of lengths that are put side by side, each compared with those before it."""


@dataclass(frozen=True)
class RobustOptimum:
    """What the stage finds."""

    candidates: pd.DataFrame  # Table optimise_robust_candidates
    comparison: Comparison
    fresh: pd.DataFrame  # Table of `fresh_table`
    uncertain: Uncertain
    asked: RobustProblem

    @property
    def fresh_table(self) -> Table:
        """The table of the fresh draws."""
        columns = []
        for axis in self.uncertain.axes:
            what = "what is added to the nominal length" if axis.key in LENGTHS else "uncertain"
            columns.append(Column(axis.key, axis.column.unit, f"{axis.key}: {what}", axis.column.kind))
        return OPTIMISE_ROBUST_FRESH.filled(uncertain=columns)


def optimise_robust(scenario: Scenario, workers: int | None = None) -> RobustOptimum:
    """Search robust lengths in the first of the scenario's boxes, and compare them on fresh draws."""
    options, uncertain = scenario.optimise_robust, uncertain_of(scenario)
    original = uncertain.base.mechanism
    asked = _asked(scenario, original)
    # all draws are made, and those that are impossible refused, before the first is simulated
    search_draws, fresh_draws = uncertain.for_search(options.draws), uncertain.fresh(options.fresh_draws)

    def simulated(draws: tuple[Draw, ...]) -> SimulatedDraws:
        return SimulatedDraws(draws, original, scenario.optimise, options.revolution, workers)

    nominal = search(asked, simulated((uncertain.nominal,)), options, with_front=False)
    robust = search(asked, simulated(search_draws), options)
    frozen = _frozen_optimum(simulated((uncertain.nominal,)), scenario.simulate, scenario.optimise, asked.region)
    lengths = np.array([asked.original, frozen, *(best_of(each)[list(LENGTHS)] for each in (nominal, robust))], float)
    responses = simulated(fresh_draws)(lengths)
    comparison = compare(asked, COMPARED, responses, options.resamples, options.seed)
    found = [nominal.assign(search="nominal", on_front=False), robust.assign(search="robust", on_front=False)]
    found[1].loc[front_of(robust), "on_front"] = True
    return RobustOptimum(
        pd.concat(found, ignore_index=True), comparison, _fresh_frame(fresh_draws, responses), uncertain, asked
    )


def check_robust(scenario: Scenario) -> None:
    """Whether the section `optimise_robust` of a `scenario` can be done at all; InputError as `optimise_robust`."""
    uncertain = uncertain_of(scenario)
    _asked(scenario, uncertain.base.mechanism)
    uncertain.for_search(scenario.optimise_robust.draws)


def _asked(scenario: Scenario, original: Mechanism) -> RobustProblem:
    optimise, options, offset = scenario.optimise, scenario.optimise_robust, original.slider.offset
    if not original.loose:
        raise InputError(
            "optimise_robust: all joints are ideal, so the transmission angle has no error; make a joint loose"
        )
    name, box = next(iter(optimise.boxes.items()))
    region = Region.of(box, optimise.ratio_limit).under(geometric(optimise.constraints, offset), name)

    def stroke(lengths: np.ndarray) -> np.ndarray:
        pairs = np.atleast_2d(lengths)
        cycles = [ideal_cycle(*map(float, pair), offset) for pair in pairs]
        strokes = np.array([cycle.outer_dead_centre - cycle.inner_dead_centre for cycle in cycles])
        return strokes.reshape(np.shape(lengths)[:-1])

    return RobustProblem(
        region=region,
        original=(original.crank.length, original.rod.length),
        stroke=stroke,
        measure=RobustMeasure(options.measure, options.deviations, options.quantile),
        constraints=optimise.constraints,
        probability=options.probability,
    )


def _frozen_optimum(
    nominal: SimulatedDraws, simulate: Simulate, optimise: Optimise, region: Region
) -> tuple[float, float]:
    """The paper's optimum, (L2, L3) [m]: the motion in the joints is that of the original lengths, whatever they are.

    The local search of `jointgap.lengths.search` on the simulated motion, without networks between.
    """
    objective = _frozen(nominal, simulate)
    found = min(search_from_all(objective, region, optimise.local_tolerance), key=lambda each: each.value)
    return float(found.lengths[0]), float(found.lengths[1])


def _frozen(nominal: SimulatedDraws, simulate: Simulate) -> Objective:
    mechanism = nominal.original
    (outcome,) = simulate_runs([Run(mechanism, simulate)], 1)
    if outcome.error is not None:
        raise outcome.error
    counted = nominal.counted(simulate)
    angle, result = outcome.crank_angle[counted], outcome.result
    rod, _ = rod_and_slider(outcome.parameters, angle, result.states[counted], result.auxiliary_states[counted])
    return objective_of_motion(mechanism, angle, rod)


def _fresh_frame(draws: tuple[Draw, ...], responses: Responses) -> pd.DataFrame:
    frames = []
    values = pd.DataFrame([draw.values for draw in draws])
    for number, name in enumerate(COMPARED):
        found = {quantity: getattr(responses, quantity)[number] for quantity in QUANTITIES}
        more = {"draw": np.arange(len(draws)), "lengths": name, "reason": list(responses.reasons[number])}
        frames.append(values.assign(**more, **found))
    return pd.concat(frames, ignore_index=True)


TITLES = {
    "robust_front": "What is traded against the error",
    "robust_errors": "The error on fresh draws",
    "robust_map": "The measure over both lengths",
}
"""Titles of the figures by name."""

MDEG = 1e3 * 180.0 / np.pi
"""Thousandths of a degree in a radian."""

LOOKS = {
    "original": ("original lengths", "ideal", "o"),
    "frozen": ("frozen motion (the paper's way)", "paper", "v"),
    "nominal": ("best at nominal values", "network", "s"),
    "robust": ("robust optimum", "simulation", "D"),
}
"""Words, colour and mark of each pair of lengths."""

_VIEW = 0.06  # of the front's width that is shown beyond its ends
_STATISTICS_SHOWN = {"mean": "mean", "deviation": "standard deviation", "measure": "", "quantile_95": "95 % quantile"}
_FRONT_ROWS = 9


def draw_robust(found: RobustOptimum) -> dict[str, Drawing]:
    """All figures by name; without the front where no lengths that were tried keep the constraints, and without the map
    where these leave a line of lengths, or single ones (`has_map`).
    """
    with plot.matplotlib_style():
        drawn = {"robust_errors": _errors(found)}
        if has_map(found):
            drawn["robust_map"] = _map(found)
        if found.candidates["on_front"].any():
            drawn["robust_front"] = _front(found)
        return drawn


def has_map(found: RobustOptimum) -> bool:
    """Whether the candidates fill an area; a fixed stroke leaves a line of lengths, two fixed values a point."""
    lengths = _tried(found)[:2]
    return np.linalg.matrix_rank(lengths - lengths.mean(axis=1, keepdims=True), tol=1e-2) == 2


def _front(found: RobustOptimum) -> Drawing:
    """Error against force, and against the change of the stroke: the front, and what else was tried near it."""
    robust = found.candidates[found.candidates["search"] == "robust"]
    allowed = robust[(robust["missed"] <= 0.0) & (robust["failed"] == 0)]
    front = robust[robust["on_front"]]
    words = found.asked.measure.words
    error = Quantity(f"error, {words}", "mdeg")
    shown = {
        "force": (Quantity(f"largest force in a pin, {words}", "N"), 1.0),
        "stroke_change": (Quantity("change of the stroke", "mm"), 1e3),
    }
    sheet = Sheet(4.2, 1, 2)
    best = robust.loc[front["error"].idxmin()]
    for place, (name, (quantity, factor)) in enumerate(shown.items()):
        panel = sheet.panel((0, place), f"error and {('force', 'stroke')[place]}", quantity, error)
        limits = [_around(factor * front[name]), _around(MDEG * front["error"])]
        near = allowed[(factor * allowed[name]).between(*limits[0]) & (MDEG * allowed["error"]).between(*limits[1])]
        style = {"markersize": 2.5, "alpha": 0.6}
        panel.marks("tried, constraints kept", factor * near[name], MDEG * near["error"], "other", **style)
        panel.marks("front of error, force and stroke", factor * front[name], MDEG * front["error"], "optimised")
        _mark(panel, "robust", [factor * best[name]], [MDEG * best["error"]])
        panel.axes.set_xlim(*limits[0])
        panel.axes.set_ylim(*limits[1])
    sheet.legend()
    return sheet.drawing()


def _around(values: pd.Series) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    width = (high - low) or abs(high) or 1.0
    return low - _VIEW * width, high + _VIEW * width


def _mark(panel: Panel, name: str, x: list[float], y: list[float]) -> None:
    words, colour, marker = LOOKS[name]
    panel.marks(words, x, y, colour, marker=marker, markersize=7.0, markeredgecolor="white", markeredgewidth=0.8)


def _errors(found: RobustOptimum) -> Drawing:
    """Share of the draws below an error, and what a change of the lengths gains in each draw."""
    sheet = Sheet(4.0, 1, 2)
    share = Quantity("share of the draws", "%")
    errors = found.fresh.pivot(index="draw", columns="lengths", values="error").dropna()
    left = sheet.panel((0, 0), "error", Quantity("RMS error of the transmission angle", "mdeg"), share)
    right = sheet.panel((0, 1), "fall of the error by the change", Quantity("fall of the error", "mdeg"), share)
    percent = 100.0 * np.arange(1, len(errors) + 1) / len(errors)
    for name, (words, colour, _) in LOOKS.items():
        heavy = {"linewidth": 1.8 if name == "robust" else 1.2, "linestyle": "--" if name == "nominal" else "-"}
        left.line(words, MDEG * np.sort(errors[name]), percent, colour, **heavy)
        if name != "original":
            falls = MDEG * (errors["original"] - errors[name])
            right.line(words, np.sort(falls), percent, colour, **heavy)
    right.vertical_line("no gain to the left of it", 0.0)
    for panel in (left, right):
        panel.axes.set_ylim(0.0, 100.0)
    left.axes.set_xlim(left=0.0)
    sheet.legend()
    return sheet.drawing()


def _map(found: RobustOptimum) -> Drawing:
    """What is minimised over both lengths, between the candidates by cubic interpolation."""
    x, y, value = _tried(found)
    sheet = Sheet(5.2, 1, 1)
    lengths = Quantity("crank length", "mm", "$L_2$"), Quantity("rod length", "mm", "$L_3$")
    panel = sheet.panel((0, 0), f"error, {found.asked.measure.words}", *lengths)
    quantity, levels = Quantity("error", "mdeg"), np.geomspace(value.min(), value.max(), 15)
    # The square of the measure is interpolated: about the valley's floor it is nearly a parabola.
    fine, squares = UniformTriRefiner(Triangulation(x, y)).refine_field(value**2, subdiv=3)
    shown = np.sqrt(np.clip(squares, value.min() ** 2, value.max() ** 2))
    drawn = panel.axes.tricontourf(fine, shown, levels=levels, cmap="Blues_r", norm=LogNorm())
    bar = sheet.figure.colorbar(drawn, ax=panel.axes, label=quantity.label, aspect=30)
    ticks = [tick for base in (1, 10, 100, 1000) for tick in (base, 2 * base, 5 * base)]
    ticks = [tick for tick in ticks if levels[0] <= tick <= levels[-1]]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.minorticks_off()
    panel.axes.plot(x, y, ".", color=plot.COLOURS["limit"], markersize=2.0, label="candidates")
    panel.record("candidates", x, y, value=value, value_quantity=quantity.name, value_unit=quantity.unit)
    for row in found.comparison.lengths.itertuples():
        _mark(panel, row.lengths, [1e3 * row.crank_length], [1e3 * row.rod_length])
    sheet.legend()
    return sheet.drawing()


def _of_the_search(found: RobustOptimum) -> pd.DataFrame:
    return found.candidates[found.candidates["search"] == "robust"].dropna(subset="error")


def _tried(found: RobustOptimum) -> np.ndarray:
    """Crank and rod lengths [mm] of the candidates, each once, and the measure there [mdeg], shape (3, n)."""
    robust = _of_the_search(found).drop_duplicates(list(LENGTHS))
    return (robust[[*LENGTHS, "error"]] * [1e3, 1e3, MDEG]).to_numpy().T


def page(found: RobustOptimum, scenario: Scenario, name: str) -> Page:
    """The page of robust lengths."""
    options, words, region = scenario.optimise_robust, found.asked.measure.words, found.asked.region
    lengths, gains, held = found.comparison.lengths, found.comparison.gains, found.comparison.constraints
    failed = int(np.count_nonzero(~found.comparison.counted))
    revolution = (
        f"revolution {scenario.optimise.ensemble.settled_revolution}"
        if options.revolution == "settled"
        else "the window of the first revolution"
    )
    compared = (
        f"{lengths['draws'].iloc[0]} fresh draws, independent of the search and the same for all lengths ({failed} "
        f"more failed and are left out). The error is the RMS over {revolution} of the transmission angle of the "
        "original lengths without clearance, less that of the simulated motion. In brackets: 95 % intervals "
        "(bootstrap; exact for probabilities)."
    )
    in_mm = {f"{key.partition('_')[0]} [mm]": partial(_millimetres, name=key) for key in LENGTHS}
    errors = {
        shown or words: partial(_interval, name=f"error_{key}", factor=MDEG) for key, shown in _STATISTICS_SHOWN.items()
    }
    price = {
        f"{quantity}, {_STATISTICS_SHOWN[key]} [{unit}]": partial(_interval, name=f"{quantity}_{key}", factor=factor)
        for quantity, unit, factor in (("force", "N", 1.0), ("stroke", "mm", 1e3))
        for key in ("mean", "deviation")
    }
    improved = {
        "compared with": lambda row: LOOKS[row["beside"]][0],
        "smaller error in [%]": partial(_interval, name="probability"),
        "mean falls by [%]": partial(_interval, name="mean_fall"),
        f"{words} falls by [%]": partial(_interval, name="measure_fall"),
    }
    limits = {each.key: f"{each.words} {each.asked()}" for each in found.asked.uncertain_constraints}
    limits["largest_pin_force"] = f"largest force in a pin {found.asked.constraints.largest_pin_force or 0:g} N at most"
    kept = {
        "constraint": lambda row: limits[row["constraint"]],
        "holds in [%]": partial(_interval, name="probability"),
    }
    asked = f"Share of the draws in which it holds; asked for: {percent(found.asked.probability, 0)}"
    active = region.active(best_of(_of_the_search(found))[list(LENGTHS)].to_numpy(dtype=float))
    method = (
        f"{int((found.candidates['search'] == 'robust').sum())} pairs of lengths within {1e3 * region.lower} to "
        f"{1e3 * region.upper} mm, each simulated in the same {options.draws} draws (scrambled Sobol sequence, seed "
        f"{options.seed}): a grid, then differential evolution for the error, then NSGA-II for the front. "
        f"Active limits: {active}."
    )
    files = joined(f"`{name}.parquet`" for name in ("lengths", "gains", "constraints", "candidates", "fresh"))
    blocks = (
        *(Paragraph(sentence, strong=True) for sentence in verdict(found)),
        Heading("Comparison on fresh draws"),
        Paragraph(compared),
        _table(lengths, "Error of the transmission angle [mdeg]", in_mm | errors),
        _table(lengths, "Largest force in a pin, and simulated stroke", price),
        Heading("Improvement"),
        _table(gains, "Draw by draw", improved),
        FigureBlock("robust_errors", TITLES["robust_errors"]),
        *((Heading("Constraints"), _table(held, asked, kept)) if len(held) else ()),
        Heading("Pareto front"),
        *_page_front(found),
        *((FigureBlock("robust_map", TITLES["robust_map"]),) if has_map(found) else ()),
        Heading("Uncertain parameters"),
        _uncertain(found),
        Heading("Method"),
        Paragraph(method),
        Paragraph(f"All numbers: {files} beside this page; `jointgap describe FILE` explains their columns."),
    )
    return Page(headline(found), blocks, subject=f"{name}: robust lengths", footer=written_today())


def headline(found: RobustOptimum) -> str:
    """The result in a line."""
    robust = found.candidates[found.candidates["search"] == "robust"]
    best, gain = best_of(robust), _gain(found, "robust", "original")
    lengths = f"crank {1e3 * best['crank_length']:.2f} mm, rod {1e3 * best['rod_length']:.2f} mm"
    if best["missed"] > 0.0 or best["failed"]:
        return f"No lengths that were tried keep what is asked; nearest: {lengths}"
    if gain["measure_fall_low"] > 0.0:
        fall = _interval(gain, "measure_fall")
        return f"{lengths.capitalize()}: the error ({found.asked.measure.words}) falls by {fall} %"
    return "No change of the lengths is worth it"


def verdict(found: RobustOptimum) -> tuple[str, ...]:
    """The result in a few sentences."""
    sentences, held = [], found.comparison.constraints
    for name in ("robust", "nominal"):
        gain = _gain(found, name, "original")
        sentences.append(
            f"{LOOKS[name][0].capitalize()}: the error of the transmission angle ({found.asked.measure.words}) falls "
            f"by {_interval(gain, 'measure_fall')} %, its mean by {_interval(gain, 'mean_fall')} %; it is smaller "
            f"than with the original lengths in {_interval(gain, 'probability')} % of the draws."
        )
    gain = _gain(found, "robust", "original")
    if gain["measure_fall_high"] <= 0.0:
        sentences.append("No change is worth it: the best lengths that were found are worse than the original ones.")
    elif gain["measure_fall_low"] <= 0.0:
        sentences.append("No change is worth it: the improvement is not significant.")
    for row in held[held["lengths"] == "robust"].to_dict("records"):
        if row["probability_high"] < row["asked"]:
            sentences.append(
                f"The constraint {row['constraint']} holds in {_interval(row, 'probability')} % of the draws, not in "
                f"the {percent(row['asked'], 0)} that are asked for."
            )
    return tuple(sentences)


def _table(frame: pd.DataFrame, caption: str, columns: dict[str, Callable]) -> TableBlock:
    """A row for each of a `frame`: the name of the lengths, then `columns` of texts by head."""
    rows = tuple(
        (LOOKS[row["lengths"]][0], *(text(row) for text in columns.values())) for row in frame.to_dict("records")
    )
    return TableBlock(("lengths", *columns), rows, "l" + "r" * len(columns), caption)


def _gain(found: RobustOptimum, lengths: str, beside: str) -> dict:
    gains = found.comparison.gains
    return gains[(gains["lengths"] == lengths) & (gains["beside"] == beside)].to_dict("records")[0]


def _interval(row: dict, name: str, factor: float = 100.0) -> str:
    """A value with its interval, in as many digits as its width allows; shares in percent."""
    value, low, high = (factor * row[name + suffix] for suffix in ("", "_low", "_high"))
    least = max(abs(high - low), 1e-4 * abs(value), 1e-6)  # where all draws agree there is no width to go by
    digits = max(0, 1 - int(np.floor(np.log10(least))))
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _millimetres(row: dict, name: str) -> str:
    return f"{1e3 * row[name]:.2f}"


def _page_front(found: RobustOptimum) -> tuple[Block, ...]:
    front = found.candidates[found.candidates["on_front"]].sort_values("error")
    if front.empty:
        return (Paragraph("No lengths that were tried keep the constraints, so there is no front."),)
    places = np.unique(np.linspace(0, len(front) - 1, _FRONT_ROWS).round().astype(int))
    columns = {
        "crank [mm]": partial(_millimetres, name="crank_length"),
        "rod [mm]": partial(_millimetres, name="rod_length"),
        "error [mdeg]": lambda row: f"{MDEG * row['error']:.2f}",
        "force [N]": lambda row: f"{row['force']:.0f}",
        "change of the stroke [mm]": partial(_millimetres, name="stroke_change"),
    }
    rows = tuple(tuple(text(row) for text in columns.values()) for row in front.iloc[places].to_dict("records"))
    caption = f"{len(rows)} of {len(front)} pairs of lengths that no other is better than in error, force and stroke"
    return TableBlock(tuple(columns), rows, "rrrrr", caption), FigureBlock("robust_front", TITLES["robust_front"])


def _uncertain(found: RobustOptimum) -> TableBlock:
    rows = []
    for axis in found.uncertain.axes:
        unit, factor = reading_unit(axis.unit or "1")
        what = parameter_in_words(axis.key) + (", tolerance" if axis.key in LENGTHS else "")
        rows.append((what, "" if unit == "1" else unit_in_words(unit), law_in_words(axis, factor)))
    return TableBlock(("what", "unit", "distribution"), tuple(rows), "lll")
