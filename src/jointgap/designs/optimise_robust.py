"""Robust link lengths: optimisation over common random samples, then validation on independent
ones."""

import math
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm
from scipy.stats import binomtest, bootstrap, qmc

from jointgap.config import Constraints, DrivenMechanism, Scenario
from jointgap.config.designs import OptimiseRobust, Sweep
from jointgap.core import parquet, plot, schema
from jointgap.core.errors import InputError, needs
from jointgap.core.joints import PINS
from jointgap.core.page import FigureBlock, Heading, Page, Paragraph, TableBlock, written_today
from jointgap.core.plot import Drawing, Panel, Quantity, Sheet
from jointgap.core.progress import report_progress
from jointgap.core.publish import numbers
from jointgap.core.words import format_name, percent, reading_unit
from jointgap.designs.sampling import Designs, axes_of, values_at
from jointgap.designs.sweep import parameter_table
from jointgap.dynamics.kinematics import transmission_angle
from jointgap.dynamics.parallel import Outcome, Run, rod_and_slider, simulate_runs
from jointgap.lengths.objective import Objective, measure, objective_of_motion
from jointgap.lengths.region import FEASIBLE, Constraint, Region, depends_on_offset, geometric
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
"""The section of uncertain parameters in error messages."""

LENGTHS = ("crank_length", "rod_length")
"""Parameters whose values are added to the lengths of the search."""

_PATH_OF_A_LENGTH = re.compile(r"mechanism\.(crank|rod)\.(length|mass_centre)")
_OF_THE_COMPUTATION = {
    "simulate.revolutions",
    "simulate.samples_per_revolution",
    "simulate.tolerance",
}
_OFFSET = "mechanism.slider.offset"
_LARGEST_TOLERANCE = 0.1  # over the length; larger values are probably the length itself
_FRESH, _BOOTSTRAP = (
    1,
    2,
)  # random streams of the independent samples and of the intervals, with the seed
_CONFIDENCE = 0.95
_AT_ONCE = 4_000_000  # bootstrap values in memory
_MISSED_MOST = 1e9  # constraint violation without a simulated force; finite, unlike infinity
_FAILED = 1e6  # objectives of lengths whose simulations all failed


def uncertain_of(scenario: Scenario) -> Designs:
    """The parameters in the section `optimise_robust` of a `scenario`, sampled by a Sobol
    sequence."""
    options = scenario.optimise_robust
    if not options.uncertain:
        raise InputError(
            f"{SOURCE}: is empty; give parameters with distributions, such as friction: {{from:"
            " 0.02, to: 0.15}"
        )
    for key in options.uncertain:
        if link := _PATH_OF_A_LENGTH.fullmatch(key):
            raise InputError(
                f"{SOURCE}.{key}: lengths and mass centres are optimised; give {link[1]}_length"
                " with the tolerance to add, such as {distribution: normal, mean: 0 mm,"
                " deviation: 0.05 mm}"
            )
        if key in _OF_THE_COMPUTATION:
            raise InputError(
                f"{SOURCE}.{key}: is a solver option, not an uncertain parameter; remove it"
            )
        if key == _OFFSET and (other := depends_on_offset(scenario.optimise.constraints)):
            raise InputError(
                f"{SOURCE}.{key}: optimise.constraints.{other} is computed with the nominal offset;"
                " remove one of them"
            )
    base = DrivenMechanism(mechanism=scenario.mechanism.applied(), simulate=scenario.simulate)
    axes = axes_of(base, options.uncertain, SOURCE)
    for axis in axes:
        if not axis.varies:
            raise InputError(
                f"{SOURCE}.{axis.key}: has one value only; give several, or a distribution"
            )
        if axis.key in LENGTHS:
            shortest = min(getattr(box, axis.key)[0] for box in scenario.optimise.boxes.values())
            largest = max(map(abs, axis.at(np.array([0.001, 0.5, 0.999]))))
            if largest > _LARGEST_TOLERANCE * shortest:
                raise InputError(
                    f"{SOURCE}.{axis.key}: values up to {1e3 * largest:g} mm are too large for a"
                    f" tolerance on a length of {1e3 * shortest:g} mm; they are added to the"
                    " optimised length: give the deviation from nominal, such as mean: 0 mm"
                )
    return Designs(base, axes, Sweep(seed=options.seed), SOURCE)


def fresh_draws(uncertain: Designs, count: int) -> list[dict[str, Any]]:
    """Values by key of `count` samples, independent of each other and of those of the search."""
    chance = np.random.default_rng([uncertain.sweep.seed, _FRESH])
    return values_at(uncertain.axes, chance.random((count, len(uncertain.axes))))


def scenario_of(uncertain: Designs, values: dict[str, Any]) -> DrivenMechanism:
    """Mechanism at nominal lengths, and simulation, of a sample."""
    try:
        return uncertain.scenario(
            {key: value for key, value in values.items() if key not in LENGTHS}
        )
    except InputError as error:
        raise InputError(
            f"{error}; this sample is infeasible: truncate the distribution with from and to"
        ) from None


@dataclass(frozen=True)
class Responses:
    """Results of m pairs of lengths in n samples."""

    lengths: np.ndarray  # shape (m, 2); nominal [m]
    actual: np.ndarray  # shape (m, n, 2); with the tolerances of each sample [m]
    error: (
        np.ndarray
    )  # shape (m, n); RMS of the transmission angle [rad], NaN where the simulation failed
    force: np.ndarray  # shape (m, n); largest in a pin [N]
    stroke: np.ndarray  # shape (m, n) [m]
    reasons: np.ndarray  # shape (m, n); why the simulation failed, or None

    @property
    def failed(self) -> np.ndarray:
        """Samples whose simulation failed, shape (m,)."""
        return np.count_nonzero(np.isnan(self.error), axis=-1)


Responding = Callable[[np.ndarray], Responses]
"""Responses of lengths (m, 2) [m] in all samples: a simulation, or a formula in its place."""


class SimulatedDraws:
    """The simulation at common samples, `draws` of values by key; InputError where one is
    infeasible."""

    def __init__(
        self,
        scenario: Scenario,
        uncertain: Designs,
        draws: list[dict[str, Any]],
        workers: int | None = None,
    ):
        self.scenarios = [scenario_of(uncertain, values) for values in draws]
        # tolerances of (L2, L3) in each sample [m]
        self.tolerances = np.array([[values.get(key, 0.0) for key in LENGTHS] for values in draws])
        self.original, self.optimise, self.workers = (
            uncertain.base.mechanism,
            scenario.optimise,
            workers,
        )
        self.is_settled = scenario.optimise_robust.revolution == "settled"

    def __call__(self, lengths: np.ndarray) -> Responses:
        """Responses of `lengths` (m, 2) [m] in all samples."""
        actual = lengths[:, None, :] + self.tolerances
        runs = (
            Run(made.mechanism.with_lengths(*map(float, own)), made.simulate)
            for row in actual
            for made, own in zip(self.scenarios, row, strict=True)
        )
        found = [self._measured(outcome) for outcome in simulate_runs(runs, self.workers)]
        columns = pd.DataFrame(found, columns=["error", "force", "stroke", "reason"])
        return Responses(
            lengths,
            actual,
            *(columns[name].to_numpy().reshape(actual.shape[:2]) for name in columns),
        )

    def rod_angles(self, outcome: Outcome) -> tuple[np.ndarray, np.ndarray]:
        """Crank and rod angles [rad] at the samples of the error."""
        per_turn, result = outcome.run.options.samples_per_revolution, outcome.result
        counted = self._settled(outcome)[:-1]  # the end repeats the beginning
        if not self.is_settled:
            turned = np.arange(per_turn) * (2.0 * np.pi / per_turn)
            slack = np.pi / per_turn  # half a sample: the window's ends do not depend on rounding
            low, high = self.optimise.window
            counted = np.flatnonzero((turned >= low - slack) & (turned <= high + slack))
        angle, states = (
            outcome.crank_angle[counted],
            (result.states[counted], result.auxiliary_states[counted]),
        )
        return angle, rod_and_slider(outcome.parameters, angle, *states)[0]

    def _settled(self, outcome: Outcome) -> np.ndarray:
        per_turn = outcome.run.options.samples_per_revolution
        return (self.optimise.ensemble.settled_revolution - 1) * per_turn + np.arange(per_turn + 1)

    def _measured(self, outcome: Outcome) -> tuple[float, float, float, str | None]:
        """Error [rad], force [N] and stroke [m] of one motion; or the reason of a failure."""
        if outcome.error is not None:
            return math.nan, math.nan, math.nan, str(outcome.error)
        seen = outcome.result.part(self._settled(outcome)).observed(outcome.parameters)
        force = max(np.hypot(seen[f"{pin}_force_x"], seen[f"{pin}_force_y"]).max() for pin in PINS)
        angle, rod = self.rod_angles(outcome)
        lengths = self.original.crank.length, self.original.rod.length
        designed = transmission_angle(*lengths, angle, 0.0, self.original.slider.offset)
        error = measure(designed - np.pi / 2 - rod).rms
        return float(error), float(force), float(np.ptp(seen["slider_position"])), None

    def frozen(self) -> Objective:
        """The error over lengths with the joint motion of the original lengths frozen, as in the
        paper."""
        (outcome,) = simulate_runs([Run(self.original, self.scenarios[0].simulate)], 1)
        if outcome.error is not None:
            raise outcome.error
        return objective_of_motion(self.original, *self.rod_angles(outcome))


def minimised(options: OptimiseRobust, values: np.ndarray) -> np.ndarray:
    """The objective, shape (...), of `values` (..., n) in n samples; NaN is skipped."""
    if options.measure == "quantile":
        return np.nanquantile(values, options.quantile, axis=-1)
    return np.nanmean(values, axis=-1) + options.deviations * deviation(values)


def format_objective(options: OptimiseRobust) -> str:
    """Name of the objective."""
    if options.measure == "quantile":
        return f"{100 * options.quantile:g} % quantile"
    return f"mean plus {options.deviations:g} standard deviations" if options.deviations else "mean"


def deviation(values: np.ndarray) -> np.ndarray:
    """Standard deviation, shape (...), of `values` (..., n), from the unbiased variance; 0 for one
    value."""
    return np.nan_to_num(np.nanstd(values, ddof=1, axis=-1))


def violation_quantile(missed: np.ndarray, probability: float) -> np.ndarray:
    """Quantile of the constraint violation, shape (...).

    At most 0 where the constraint holds in a share of at least `probability` of the samples.
    """
    n = missed.shape[-1]
    place = min(math.ceil(probability * n - 1e-9), n) - 1
    return np.sort(np.where(np.isnan(missed), np.inf, missed), axis=-1)[..., place]


OBJECTIVES = ("error", "force", "stroke_change")
"""Objectives of the Pareto front, by column of the candidates."""


@dataclass(frozen=True)
class RobustProblem:
    """Region, objectives and constraints of the robust optimisation."""

    region: Region  # Of the nominal lengths, with the constraints that depend on lengths only
    original: tuple[float, float]  # Original lengths, (L2, L3) [m]
    offset: float  # Of the slide [m]
    options: OptimiseRobust
    constraints: Constraints  # Section of the configuration, for the largest pin force

    @property
    def ranges(self) -> list[Constraint]:
        """Constraints that tolerances can violate. Equality constraints refer to the nominal
        lengths only."""
        return [each for each in self.region.constraints if not each.is_fixed]

    def violation(self, responses: Responses) -> dict[str, np.ndarray]:
        """Violation by constraint, shape (m, n), negative where satisfied: in mm or deg; a force in
        % of its limit."""
        found = {}
        for each in self.ranges:
            value = each.value(responses.actual)
            found[each.key] = (
                np.maximum(each.low - value, value - each.high) / each.scale - FEASIBLE
            )
        if (most := self.constraints.largest_pin_force) is not None:
            found["largest_pin_force"] = 100.0 * (responses.force / most - 1.0)
        return found

    def stroke(self, lengths: np.ndarray) -> np.ndarray:
        crank, rod = lengths[..., 0], lengths[..., 1]
        return np.sqrt((rod + crank) ** 2 - self.offset**2) - np.sqrt(
            (rod - crank) ** 2 - self.offset**2
        )

    def assess(self, responses: Responses) -> pd.DataFrame:
        """Objectives and constraints, one row per pair of lengths."""
        lengths = responses.lengths
        missed = self.region.violation(lengths)
        missed = np.where(missed > FEASIBLE, missed, 0.0)
        for each in self.violation(responses).values():
            missed = missed + np.maximum(violation_quantile(each, self.options.probability), 0.0)
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", RuntimeWarning
            )  # numpy's, where at most one sample has a value
            return pd.DataFrame(
                {
                    "crank_length": lengths[:, 0],
                    "rod_length": lengths[:, 1],
                    "error_mean": np.nanmean(responses.error, axis=-1),
                    "error_deviation": deviation(responses.error),
                    "error": minimised(self.options, responses.error),
                    "force": minimised(self.options, responses.force),
                    "stroke_change": np.abs(
                        self.stroke(lengths) - self.stroke(np.array(self.original))
                    ),
                    "missed": np.minimum(missed, _MISSED_MOST),
                    "failed": responses.failed,
                }
            )


class _Lengths(Problem):
    """The lengths of a region as a pymoo problem; keeps the evaluated candidates, one frame per
    generation."""

    def __init__(
        self,
        task: RobustProblem,
        respond: Responding,
        objectives: tuple[str, ...],
        before: int,
        total: int,
    ):
        region = task.region
        super().__init__(
            n_var=2, n_obj=len(objectives), n_ieq_constr=2, xl=region.lower, xu=region.upper
        )
        self.task, self.respond, self.objectives, self.before, self.total = (
            task,
            respond,
            objectives,
            before,
            total,
        )
        self.generations: list[pd.DataFrame] = []

    def _evaluate(self, x, out, *args, **kwargs):
        found = self.task.assess(self.respond(x))
        self.generations.append(found)
        report_progress("generations of lengths", self.before + len(self.generations), self.total)
        out["F"] = found[list(self.objectives)].fillna(_FAILED).to_numpy()
        out["G"] = found[["missed", "failed"]].to_numpy(dtype=float)


class _OntoRegion(Repair):
    def _do(self, problem, x, **kwargs):
        return problem.task.region.nearest(x)


def search(task: RobustProblem, respond: Responding, with_front: bool = True) -> pd.DataFrame:
    """Optimise the lengths in the region, and the Pareto front."""
    region, options = task.region, task.options
    steps = {"one measure": OBJECTIVES[:1]} | ({"front": OBJECTIVES} if with_front else {})
    total = 1 + len(steps) * options.generations
    report_progress("generations of lengths", 0, total)
    cranks, rods = np.meshgrid(
        *np.linspace(region.lower, region.upper, options.grid).T, indexing="ij"
    )
    grid = np.stack([cranks.ravel(), rods.ravel()], axis=1)
    grid = grid[region.contains(grid, slack=1e-12)]
    grid = region.nearest(np.vstack([grid, region.clip(np.array(task.original))]))
    found = task.assess(respond(grid)).assign(step="grid", generation=0)
    for number, (step, objectives) in enumerate(steps.items()):
        before = 1 + number * options.generations
        report_progress("generations of lengths", before, total)
        step_problem = _Lengths(task, respond, objectives, before, total)
        given = {
            "pop_size": options.population,
            "sampling": _beginning(found, task, number),
            "repair": _OntoRegion(),
        }
        algorithm = (
            NSGA2(crossover=PCX(), **given)
            if number
            else DE(variant="DE/best/1/bin", CR=1.0, **given)
        )
        minimize(step_problem, algorithm, ("n_gen", options.generations), seed=options.seed)
        tried = [
            each.assign(step=step, generation=k) for k, each in enumerate(step_problem.generations)
        ]
        found = pd.concat([found, *tried], ignore_index=True)
    return found


def ranked(candidates: pd.DataFrame) -> np.ndarray:
    """Indices of the candidates from the best on: feasible ones by their error, then the others by
    violation."""
    return np.lexsort(
        (candidates["error"].fillna(np.inf), candidates["missed"], candidates["failed"])
    )


def best_of(candidates: pd.DataFrame) -> pd.Series:
    return candidates.iloc[ranked(candidates)[0]]


def pareto_front(candidates: pd.DataFrame) -> np.ndarray:
    """Indices of the feasible candidates that are not dominated."""
    allowed = np.flatnonzero((candidates["missed"] <= 0.0) & (candidates["failed"] == 0))
    if not len(allowed):
        return allowed
    values = candidates[list(OBJECTIVES)].to_numpy()[allowed]
    kept = allowed[np.sort(NonDominatedSorting().do(values, only_non_dominated_front=True))]
    return kept[~candidates.iloc[kept].duplicated(list(LENGTHS)).to_numpy()]


def _beginning(candidates: pd.DataFrame, task: RobustProblem, number: int) -> np.ndarray:
    """Initial population of a step: half of it the best so far, half spread over the region, shape
    (n, 2) [m]."""
    half, places = task.options.population // 2, ranked(candidates)
    if number and len(front := pareto_front(candidates)):
        # the front so far, with its ends and evenly along the error
        ordered = front[np.argsort(candidates["error"].to_numpy()[front], kind="stable")]
        places = ordered[np.unique(np.linspace(0, len(ordered) - 1, half).round().astype(int))]
    best = candidates.loc[places[:half], list(LENGTHS)].to_numpy()
    chance = np.random.default_rng([task.options.seed, number])  # different from the step before
    spread = qmc.LatinHypercube(2, rng=chance).random(task.options.population - len(best))
    return np.vstack([best, task.region.nearest(task.region.unscaled(spread))])


COMPARED = ("original", "frozen", "nominal", "robust")
"""Pairs of lengths in the comparison, each compared with those before it."""

_STATISTICS = ("mean", "deviation", "measure", "quantile_05", "median", "quantile_95")
_QUANTITIES = ("error", "force", "stroke")
_ENDS = ("", "_low", "_high")  # suffixes of a value and its interval


@dataclass(frozen=True)
class RobustOptimum:
    """The tables of the stage, and the task."""

    candidates: pd.DataFrame
    fresh: pd.DataFrame
    lengths: pd.DataFrame  # A row per pair of lengths: statistics of each quantity with intervals
    gains: pd.DataFrame  # A row per comparison: how often, and by how much, the error is smaller
    constraints: pd.DataFrame  # A row per pair of lengths and constraint
    uncertain: Designs
    task: RobustProblem

    @property
    def tables(self) -> dict[schema.Table, pd.DataFrame]:
        """The tables of the stage."""
        columns = []
        for axis in self.uncertain.axes:
            what = "tolerance added to the nominal length" if axis.key in LENGTHS else "uncertain"
            columns.append(replace(axis.column, description=f"{axis.key}: {what}"))
        return {
            schema.OPTIMISE_ROBUST_LENGTHS: self.lengths,
            schema.OPTIMISE_ROBUST_GAINS: self.gains,
            schema.OPTIMISE_ROBUST_CONSTRAINTS: self.constraints,
            schema.OPTIMISE_ROBUST_CANDIDATES: self.candidates,
            schema.OPTIMISE_ROBUST_FRESH.filled(uncertain=columns): self.fresh,
        }


def compare(
    task: RobustProblem, names: tuple[str, ...], responses: Responses
) -> dict[str, pd.DataFrame]:
    """Compare lengths: the tables `lengths`, `gains` and `constraints`."""
    options, counted = task.options, ~np.isnan(responses.error).any(axis=0)
    draws = np.count_nonzero(counted)
    if draws < 2:
        reason = next(filter(None, responses.reasons.flat))
        raise InputError(
            f"optimise_robust: fewer than two of {len(counted)} validation samples were simulated"
            f" with all lengths; the first failure: {reason}"
        )

    def statistics(values: np.ndarray, axis: int = -1) -> np.ndarray:
        quantiles = np.quantile(values, (0.05, 0.5, 0.95), axis=axis)
        return np.stack(
            [np.mean(values, axis=axis), deviation(values), minimised(options, values), *quantiles]
        )

    values = np.stack([getattr(responses, name)[:, counted] for name in _QUANTITIES])
    resampled = bootstrap(
        (values,),
        statistics,
        n_resamples=options.resamples,
        batch=max(1, _AT_ONCE // values.size),
        vectorized=True,
        axis=-1,
        method="percentile",
        rng=np.random.default_rng([options.seed, _BOOTSTRAP]),
    ).bootstrap_distribution

    def with_ends(
        statistic: Callable[[np.ndarray], np.ndarray],
    ) -> Iterator[tuple[str, np.ndarray]]:
        outside = (1.0 - _CONFIDENCE) / 2.0
        ends = np.quantile(statistic(resampled), (outside, 1.0 - outside), axis=-1)
        return zip(_ENDS, (statistic(statistics(values)), *ends), strict=True)

    lengths = {
        "lengths": names,
        "crank_length": responses.lengths[:, 0],
        "rod_length": responses.lengths[:, 1],
    }
    lengths |= {"draws": draws, "failed": responses.failed}
    for end, found in with_ends(lambda each: each):
        for statistic, by_quantity in zip(_STATISTICS, found, strict=True):
            each = zip(_QUANTITIES, by_quantity, strict=True)
            lengths |= {f"{quantity}_{statistic}{end}": own for quantity, own in each}
    gains = []
    for was, now in combinations(range(len(names)), 2):
        error = responses.error[:, counted]
        row = {"lengths": names[now], "beside": names[was], "draws": draws} | _share(
            error[now] < error[was]
        )
        for end, fall in with_ends(
            lambda each, now=now, was=was: 1.0 - each[:, 0, now] / each[:, 0, was]
        ):
            row |= {
                f"{name}_fall{end}": float(fall[_STATISTICS.index(name)])
                for name in ("mean", "measure")
            }
        gains.append(row)
    held = [
        {"lengths": name, "constraint": key, "asked": options.probability, "draws": len(row)}
        | _share(row <= 0.0)
        for key, missed in task.violation(responses).items()
        for name, row in zip(names, missed, strict=True)
    ]
    return {
        "lengths": pd.DataFrame(lengths),
        "gains": pd.DataFrame(gains),
        "constraints": pd.DataFrame(held, columns=schema.OPTIMISE_ROBUST_CONSTRAINTS.names),
    }


def _share(happened: np.ndarray) -> dict[str, float]:
    """Frequency of an event, and the exact interval of its probability."""
    times, trials = int(np.count_nonzero(happened)), len(happened)
    interval = binomtest(times, trials).proportion_ci(_CONFIDENCE, method="exact")
    return {
        "probability": times / trials,
        "probability_low": interval.low,
        "probability_high": interval.high,
    }


def optimise_robust(scenario: Scenario, workers: int | None = None) -> RobustOptimum:
    """Optimise robust lengths in the first of the scenario's boxes, and validate them on
    independent samples."""
    options, uncertain = scenario.optimise_robust, uncertain_of(scenario)
    task, draws = _task(scenario), fresh_draws(uncertain, options.fresh_draws)
    # create all samples first: infeasible ones are rejected before any simulation
    at_nominal, at_draws, at_fresh = (
        SimulatedDraws(scenario, uncertain, values, workers)
        for values in ([{}], uncertain.values(0, options.draws), draws)
    )
    nominal = search(task, at_nominal, with_front=False).assign(search="nominal", on_front=False)
    robust = search(task, at_draws).assign(search="robust", on_front=False)
    robust.loc[pareto_front(robust), "on_front"] = True
    frozen = search_from_all(at_nominal.frozen(), task.region, scenario.optimise.local_tolerance)
    best = [best_of(each)[list(LENGTHS)] for each in (nominal, robust)]
    lengths = np.array(
        [task.original, min(frozen, key=lambda each: each.value).lengths, *best], float
    )
    responses = at_fresh(lengths)
    values = pd.DataFrame(draws)
    fresh = pd.concat(
        [values.assign(draw=values.index, lengths=name) for name in COMPARED], ignore_index=True
    )
    found = {name: getattr(responses, name).ravel() for name in _QUANTITIES}
    return RobustOptimum(
        pd.concat([nominal, robust], ignore_index=True),
        fresh.assign(**found, reason=responses.reasons.ravel()),
        **compare(task, COMPARED, responses),
        uncertain=uncertain,
        task=task,
    )


def check(scenario: Scenario) -> None:
    """InputError where the section `optimise_robust` of a `scenario` is infeasible."""
    uncertain = uncertain_of(scenario)
    _task(scenario)
    SimulatedDraws(scenario, uncertain, uncertain.values(0, scenario.optimise_robust.draws))


def _task(scenario: Scenario) -> RobustProblem:
    original, optimise = scenario.mechanism.applied(), scenario.optimise
    if not original.loose:
        raise InputError(
            "optimise_robust: all joints are ideal, so the transmission angle has no error; make a"
            " joint loose"
        )
    (name, box), *_ = optimise.boxes.items()
    offset, lengths = original.slider.offset, (original.crank.length, original.rod.length)
    region = Region.of(box, optimise.ratio_limit).under(
        geometric(optimise.constraints, offset), name
    )
    return RobustProblem(region, lengths, offset, scenario.optimise_robust, optimise.constraints)


_MDEG = 1e3 * 180.0 / np.pi
"""Thousandths of a degree in a radian."""

_LOOKS = {
    "original": ("original lengths", "ideal", "o"),
    "frozen": ("frozen motion (as in the paper)", "paper", "v"),
    "nominal": ("best at nominal values", "network", "s"),
    "robust": ("robust optimum", "simulation", "D"),
}
"""Label, colour and marker of each pair of lengths."""

_NEAREST = "nearest to the constraints"
"""Label of the robust lengths where no candidate satisfies the constraints."""

_FRONT_ROWS = 9


def draw(found: RobustOptimum) -> Iterator[tuple[str, Drawing]]:
    """All figures by name; the front only where feasible lengths exist, the map only where
    candidates fill an area."""
    with plot.matplotlib_style():
        yield "robust_errors", _errors(found)
        if has_map(found):
            yield "robust_map", _map(found)
        if found.candidates["on_front"].any():
            yield "robust_front", _front(found)


def _tried(found: RobustOptimum) -> pd.DataFrame:
    return found.candidates[found.candidates["search"] == "robust"]


def has_optimum(found: RobustOptimum) -> bool:
    """Whether the best candidate satisfies the constraints and was simulated in all samples."""
    best = best_of(_tried(found))
    return bool(best["missed"] <= 0.0 and not best["failed"])


def _label(found: RobustOptimum, name: str) -> str:
    return _NEAREST if name == "robust" and not has_optimum(found) else _LOOKS[name][0]


def has_map(found: RobustOptimum) -> bool:
    """Whether the candidates fill an area; a fixed stroke leaves a curve of lengths, two fixed
    values a point."""
    return not any(each.is_fixed for each in found.task.region.constraints)


def _front(found: RobustOptimum) -> Drawing:
    """Error against force and against the change of the stroke: Pareto front and nearby
    candidates."""
    shown = _tried(found).assign(
        error=lambda own: _MDEG * own["error"], stroke_change=lambda o: 1e3 * o["stroke_change"]
    )
    allowed, front = (
        shown[(shown["missed"] <= 0.0) & (shown["failed"] == 0)],
        shown[shown["on_front"]],
    )
    best, words = front.loc[front["error"].idxmin()], format_objective(found.task.options)
    sheet = Sheet(4.2, 1, 2)
    quantities = {
        "force": Quantity(f"largest force in a pin, {words}", "N"),
        "stroke_change": Quantity("change of the stroke", "mm"),
    }
    for place, (name, quantity) in enumerate(quantities.items()):
        title = f"error and {name.partition('_')[0]}"
        panel = sheet.panel((0, place), title, quantity, Quantity(f"error, {words}", "mdeg"))
        panel.marks(
            "front of error, force and stroke", front[name], front["error"], "optimised", zorder=3
        )
        panel.axes.margins(0.06)
        limits = panel.axes.get_xlim(), panel.axes.get_ylim()  # around the front
        near = allowed[allowed[name].between(*limits[0]) & allowed["error"].between(*limits[1])]
        panel.marks(
            "other feasible candidates",
            near[name],
            near["error"],
            "other",
            markersize=2.5,
            alpha=0.6,
        )
        _mark(panel, found, "robust", [best[name]], [best["error"]])
        panel.axes.set(xlim=limits[0], ylim=limits[1])
    sheet.legend()
    return sheet.drawing()


def _mark(panel: Panel, found: RobustOptimum, name: str, x: list[float], y: list[float]) -> None:
    words, (_, colour, marker) = _label(found, name), _LOOKS[name]
    style = {
        "marker": marker,
        "markersize": 7.0,
        "markeredgecolor": "white",
        "markeredgewidth": 0.8,
        "zorder": 4,
    }
    panel.marks(words, x, y, colour, **style)


def _errors(found: RobustOptimum) -> Drawing:
    """Distribution of the error over the samples, and of its reduction per sample."""
    sheet = Sheet(4.0, 1, 2)
    share = Quantity("share of the samples", "%")
    errors = _MDEG * found.fresh.pivot(index="draw", columns="lengths", values="error").dropna()
    left = sheet.panel(
        (0, 0), "error", Quantity("RMS error of the transmission angle", "mdeg"), share
    )
    right = sheet.panel(
        (0, 1), "reduction of the error", Quantity("reduction of the error", "mdeg"), share
    )
    shares = 100.0 * np.arange(1, len(errors) + 1) / len(errors)
    for name, (_, colour, _) in _LOOKS.items():
        words = _label(found, name)
        style = {
            "linewidth": 1.8 if name == "robust" else 1.2,
            "linestyle": "--" if name == "nominal" else "-",
        }
        left.line(words, np.sort(errors[name]), shares, colour, **style)
        if name != "original":
            right.line(words, np.sort(errors["original"] - errors[name]), shares, colour, **style)
    right.vertical_line("no gain", 0.0)
    left.axes.set(xlim=(0.0, None), ylim=(0.0, 100.0))
    right.axes.set_ylim(0.0, 100.0)
    sheet.legend()
    return sheet.drawing()


def _map(found: RobustOptimum) -> Drawing:
    """The objective over both lengths, interpolated between the candidates."""
    tried = _tried(found).dropna(subset="error").drop_duplicates(list(LENGTHS))
    x, y, value = (tried[[*LENGTHS, "error"]] * [1e3, 1e3, _MDEG]).to_numpy().T
    sheet, quantity = Sheet(5.2, 1, 1), Quantity("error", "mdeg")
    lengths = Quantity("crank length", "mm", "$L_2$"), Quantity("rod length", "mm", "$L_3$")
    panel = sheet.panel((0, 0), f"error, {format_objective(found.task.options)}", *lengths)
    levels = np.geomspace(value.min(), value.max(), 15)
    drawn = panel.axes.tricontourf(x, y, value, levels=levels, cmap="Blues_r", norm=LogNorm())
    sheet.figure.colorbar(
        drawn, ax=panel.axes, label=quantity.label, aspect=30, ticks=levels[::2], format="%.3g"
    )
    panel.axes.plot(x, y, ".", color=plot.COLOURS["limit"], markersize=2.0, label="candidates")
    panel.record(
        "candidates", x, y, value=value, value_quantity=quantity.name, value_unit=quantity.unit
    )
    for row in found.lengths.itertuples():
        _mark(panel, found, row.lengths, [1e3 * row.crank_length], [1e3 * row.rod_length])
    sheet.legend()
    return sheet.drawing()


def page(found: RobustOptimum, scenario: Scenario, name: str) -> Page:
    options, region, tried = scenario.optimise_robust, found.task.region, _tried(found)
    words, draws = format_objective(options), found.lengths["draws"].iloc[0]
    settled = f"revolution {scenario.optimise.ensemble.settled_revolution}"
    compared = (
        f"{draws} validation samples, independent of the search and common to all lengths"
        f" ({options.fresh_draws - draws} more failed and are excluded). The error is the RMS over"
        f" {settled if options.revolution == 'settled' else 'the window of the first revolution'}"
        " of the transmission angle of the original lengths without clearance, minus that of the"
        f" simulated motion. The objective is its {words}. In brackets: 95 % intervals (bootstrap;"
        " exact for probabilities)."
    )
    limits = {each.key: f"{each.words} {each.range_text()}" for each in found.task.ranges}
    limits["largest_pin_force"] = (
        f"largest pin force {found.task.constraints.largest_pin_force or 0:g} N at most"
    )
    named = {} if has_optimum(found) else {"robust": _NEAREST}
    lengths, gains, held = (
        frame.replace(named) for frame in (found.lengths, found.gains, found.constraints)
    )
    held = held.assign(constraint=held["constraint"].map(limits))
    constraints = (
        Heading("Constraints"),
        _table("constraints", held, "Share of the samples that satisfy them", *_HELD),
    )
    front = tried[tried["on_front"]].sort_values("error")
    places = np.unique(np.linspace(0, max(len(front) - 1, 0), _FRONT_ROWS).round().astype(int))[
        : len(front)
    ]
    active = region.active(
        best_of(tried.dropna(subset="error"))[list(LENGTHS)].to_numpy(dtype=float)
    )
    cranks, rods = region.searched
    method = (
        f"{len(tried)} pairs of lengths (searched in mm: crank {cranks}, rod {rods}), each"
        f" simulated in the same {options.draws} samples (scrambled Sobol sequence, seed"
        f" {options.seed}). Search: a grid, then differential evolution for the error, then NSGA-II"
        f" for the front. Active limits: {active}. All numbers are in the Parquet files next to"
        " this page; `jointgap describe FILE` explains their columns."
    )
    blocks = (
        *(Paragraph(sentence, strong=True) for sentence in verdict(found)),
        Heading("Validation on independent samples"),
        Paragraph(compared),
        _table(
            "lengths", lengths, "Error of the transmission angle", "lengths", *LENGTHS, *_ERRORS
        ),
        _table("lengths", lengths, "Largest pin force, and simulated stroke", "lengths", *_PRICE),
        Heading("Improvement"),
        _table("gains", gains, _DRAW_BY_DRAW, *_GAINS),
        FigureBlock("robust_errors", "Error in the validation samples"),
        *(constraints if len(held) else ()),
        Heading("Pareto front"),
        _table(
            "candidates",
            front.iloc[places],
            f"{len(places)} of {len(front)} {_ON_FRONT}",
            *LENGTHS,
            *OBJECTIVES,
        ),
        FigureBlock("robust_front", "Trade-off against the error"),
        FigureBlock("robust_map", "Objective over both lengths"),
        Heading("Uncertain parameters"),
        parameter_table(found.uncertain.axes, lambda key: found.fresh[key]),
        Heading("Method"),
        Paragraph(method),
    )
    drawn = {"robust_front": len(front) > 0, "robust_map": has_map(found)}
    kept = tuple(block for block in blocks if drawn.get(getattr(block, "stem", ""), True))
    return Page(headline(found), kept, subject=f"{name}: robust lengths", footer=written_today())


def headline(found: RobustOptimum) -> str:
    """The result in one line."""
    best, gain = best_of(_tried(found)), _gain(found, "robust")
    lengths = f"crank {1e3 * best['crank_length']:.2f} mm, rod {1e3 * best['rod_length']:.2f} mm"
    if not has_optimum(found):
        return f"No candidate satisfies the constraints; nearest: {lengths}"
    if gain["measure_fall_low"] > 0.0:
        words, fall = format_objective(found.task.options), _cell(gain, "measure_fall")
        return f"{lengths.capitalize()}: the error ({words}) falls by {fall} %"
    return "No significant improvement: keep the original lengths"


def verdict(found: RobustOptimum) -> list[str]:
    """The result in a few sentences."""
    sentences, words, is_found = [], format_objective(found.task.options), has_optimum(found)
    if not is_found:
        sentences.append(
            "No robust optimum: widen the bounds of the lengths, or relax a constraint."
        )
    for name in ("robust", "nominal") if is_found else ():
        gain = _gain(found, name)
        sentences.append(
            f"{_LOOKS[name][0].capitalize()}: the error of the transmission angle ({words}) falls"
            f" by {_cell(gain, 'measure_fall')} %, its mean by {_cell(gain, 'mean_fall')} %. It is"
            f" smaller than with the original lengths in {_cell(gain, 'probability')} % of the"
            " samples."
        )
    gain = _gain(found, "robust")
    if is_found and gain["measure_fall_high"] <= 0.0:
        sentences.append("Keep the original lengths: the best lengths found are worse.")
    elif is_found and gain["measure_fall_low"] <= 0.0:
        sentences.append("Keep the original lengths: the improvement is not significant.")
    for row in found.constraints.query("lengths == 'robust' and probability_high < asked").to_dict(
        "records"
    ):
        sentences.append(
            f"The constraint {row['constraint']} holds in {_cell(row, 'probability')} % of the"
            f" samples; {percent(row['asked'], 0)} are required."
        )
    return sentences


def _gain(found: RobustOptimum, lengths: str) -> dict:
    """The comparison of `lengths` with the original ones."""
    return found.gains.query("lengths == @lengths and beside == 'original'").to_dict("records")[0]


_DRAW_BY_DRAW = (
    "Comparison per sample: how often the error is smaller, and by how much its mean and the"
    " objective fall"
)
_ON_FRONT = "pairs of lengths that are not dominated in error, force and stroke"
_ERRORS = ("error_mean", "error_deviation", "error_measure", "error_quantile_95")
_GAINS = ("lengths", "beside", "probability", "mean_fall", "measure_fall")
_HELD = ("lengths", "constraint", "asked", "probability")
_HEADS = {"beside": "compared with", "asked": "required", "error_measure": "objective"}
_HEADS |= {"mean_fall": "reduction of the mean", "measure_fall": "reduction of the objective"}
_PRICE = ("force_mean", "force_deviation", "stroke_mean", "stroke_deviation")


def _table(kind: str, frame: pd.DataFrame, caption: str, *names: str) -> TableBlock:
    """A table block of columns `names`: values with their intervals, shares in percent."""
    table, columns = schema.TABLES[f"optimise_robust_{kind}"], {}
    for column in (table.columns[table.names.index(name)] for name in names):
        unit, factor = {"1": ("%", 100.0), "rad": ("mdeg", _MDEG)}.get(
            column.unit, reading_unit(column.unit)
        )
        head = _HEADS.get(column.name, format_name(column.name)) + (
            f" [{unit}]" if column.kind == "float" else ""
        )
        columns[head] = [_cell(row, column.name, factor) for row in frame.to_dict("records")]
    return TableBlock(
        tuple(columns),
        tuple(zip(*columns.values(), strict=True)),
        "l".ljust(len(columns), "r"),
        caption,
    )


def _cell(row: dict, name: str, factor: float = 100.0) -> str:
    """A formatted cell; the width of the interval determines the digits."""
    if isinstance(row[name], str):
        return _LOOKS.get(row[name], (row[name],))[0]
    if f"{name}_low" not in row:
        return f"{factor * row[name]:.2f}"
    value, low, high = (factor * row[name + end] for end in _ENDS)
    least = max(
        abs(high - low), 1e-4 * abs(value), 1e-6
    )  # the interval is zero where all samples agree
    digits = max(0, 1 - int(np.floor(np.log10(least))))
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


_SECTIONS = {
    schema.OPTIMISE_ROBUST_LENGTHS: "{lengths}/",
    schema.OPTIMISE_ROBUST_GAINS: "{lengths} beside {beside}/",
    schema.OPTIMISE_ROBUST_CONSTRAINTS: "{lengths} keeps {constraint}/",
}


def metrics(scenario: Scenario, folder: Path) -> dict[str, float]:
    """Statistics, gains, and probabilities of the constraints in the validation samples, for
    MLflow."""
    found = {}
    for table, section in _SECTIONS.items():
        for row in parquet.read(table, folder / table.path).to_dict("records"):
            found |= numbers(table, row, section=section.format(**row))
    return found
