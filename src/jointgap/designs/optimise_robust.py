"""Robust link lengths: optimisation over common random samples, then validation on independent
ones."""

import math
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest, bootstrap, qmc

from jointgap.config import Constraints, DrivenMechanism, Scenario
from jointgap.config.designs import OptimiseRobust, Sweep
from jointgap.config.variations import paths_of
from jointgap.core import schema
from jointgap.core.errors import InputError, SimulationError, needs
from jointgap.core.progress import report_progress
from jointgap.core.schema import Column
from jointgap.core.words import format_name
from jointgap.designs.measures import pose_of, position_of
from jointgap.designs.sampling import Designs, axes_of, values_at
from jointgap.lengths.linkages import LinkageProblem
from jointgap.lengths.objective import (
    GOALS,
    FrozenObjective,
    Objective,
    joint_forces,
    measure,
    objective_of_motion,
)
from jointgap.lengths.region import FEASIBLE, Constraint, Region, depends_on_offset, regions
from jointgap.lengths.search import search_from_all
from jointgap.linkage.transmission import angle_of
from jointgap.motion.kinematics import transmission_angle
from jointgap.motion.linkage import check_walls, linkage_model, simulate_linkage
from jointgap.motion.parallel import Outcome, Run, side_by_side, simulate_runs
from jointgap.motion.simulation import crank_angles, integrate_to_angles, observed
from jointgap.motion.slider_crank import rod_and_slider

with needs("optimising link lengths", "learn"):
    from pymoo.algorithms.soo.nonconvex.de import DE
    from pymoo.core.problem import Problem
    from pymoo.core.repair import Repair
    from pymoo.optimize import minimize

SOURCE = "optimise_robust.uncertain"
"""The section of uncertain parameters in error messages."""

LENGTHS = ("crank_length", "rod_length")
"""Parameters whose values are added to the lengths of the search."""

COMPARED = ("original", "frozen", "nominal", "robust")
"""Pairs of lengths in the comparison, each compared with those before it."""

_SOLVER_OPTIONS = {
    "simulate.revolutions",
    "simulate.samples_per_revolution",
    "simulate.tolerance",
}
_OFFSET = "mechanism.slider.offset"
_LARGEST_TOLERANCE = 0.1  # over the length; larger values are probably the length itself
# random streams of the independent samples and of the intervals, with the seed
_VALIDATION, _BOOTSTRAP = 1, 2
_CONFIDENCE = 0.95
_BOOTSTRAP_VALUES = 4_000_000  # in memory
_MOST_VIOLATION = 1e9  # without a simulated force; finite, unlike infinity
_FAILED = 1e6  # objective of lengths whose simulations all failed

_STATISTICS = ("mean", "deviation", "measure", "quantile_05", "median", "quantile_95")
_QUANTITIES = ("error", "force", "stroke")
_ENDS = ("", "_low", "_high")  # suffixes of a value and its interval


def _searched(scenario: Scenario) -> dict[str, tuple[str, ...]]:
    """Names of the searched lengths, with the paths that the search sets."""
    if scenario.optimise_linkage is None:
        links = zip(LENGTHS, ("crank", "rod"), strict=True)
        ends = ("length", "mass_centre")
        return {name: tuple(f"mechanism.{link}.{end}" for end in ends) for name, link in links}
    return {
        name: (f"mechanism.bodies.{name}".replace("bodies.frame.", "frame.points."),)
        for name in scenario.optimise_linkage.lengths
    }


def uncertain_of(scenario: Scenario) -> Designs:
    """The parameters in the section `optimise_robust` of a `scenario`, sampled by a Sobol
    sequence."""
    options = scenario.optimise_robust
    if not options.uncertain:
        raise InputError(
            f"{SOURCE}: is empty; give parameters with distributions, such as friction: {{from:"
            " 0.02, to: 0.15}"
        )
    base = DrivenMechanism(mechanism=scenario.mechanism.applied(), simulate=scenario.simulate)
    searched = _searched(scenario)
    for given in options.uncertain:
        key = given
        if "." in given and given not in searched:
            key = ".".join(paths_of(base, given, f"{SOURCE}.{given}")[0])
        for name, paths in searched.items():
            if key in paths:
                raise InputError(
                    f"{SOURCE}.{given}: lengths and mass centres are optimised; give {name}"
                    " with the tolerance to add, such as {distribution: normal, mean: 0 mm,"
                    " deviation: 0.05 mm}"
                )
        if key in _SOLVER_OPTIONS:
            raise InputError(
                f"{SOURCE}.{key}: is a solver option, not an uncertain parameter; remove it"
            )
        if key == _OFFSET and (constraint := depends_on_offset(scenario.optimise.constraints)):
            raise InputError(
                f"{SOURCE}.{key}: optimise.constraints.{constraint} is computed with the nominal"
                " offset; remove one of them"
            )
    axes = axes_of(base, options.uncertain, SOURCE, dict.fromkeys(searched, "m"))
    for axis in axes:
        if not axis.varies:
            raise InputError(
                f"{SOURCE}.{axis.key}: has one value only; give several, or a distribution"
            )
        if axis.key in searched and axis.key.endswith("length"):
            boxes = [dict(box) for box in scenario.optimise.boxes.values()]
            bounds = [scenario.optimise_linkage.lengths] if scenario.optimise_linkage else boxes
            shortest = min(each[axis.key][0] for each in bounds)
            largest = max(map(abs, axis.at(np.array([0.001, 0.5, 0.999]))))
            if largest > _LARGEST_TOLERANCE * shortest:
                raise InputError(
                    f"{SOURCE}.{axis.key}: values up to {1e3 * largest:g} mm are too large for a"
                    f" tolerance on a length of {1e3 * shortest:g} mm; they are added to the"
                    " optimised length: give the deviation from nominal, such as mean: 0 mm"
                )
    return Designs(base, axes, Sweep(seed=options.seed), SOURCE)


def sample_scenario(
    uncertain: Designs, values: dict[str, Any], searched: Collection[str] = LENGTHS
) -> DrivenMechanism:
    """Mechanism at nominal lengths, and simulation, of a sample; the values of the lengths
    `searched` are tolerances."""
    changes = {key: value for key, value in values.items() if key not in searched}
    try:
        return uncertain.scenario(changes)
    except InputError as error:
        raise InputError(
            f"{error}; this sample is infeasible: truncate the distribution with from and to"
        ) from None


@dataclass(frozen=True)
class Responses:
    """Results of m sets of k lengths in n samples."""

    lengths: np.ndarray  # shape (m, k); nominal [m]
    actual: np.ndarray  # shape (m, n, k); with the tolerances of each sample [m]
    # shape (m, n); RMS of the transmission angle [rad], NaN where the simulation failed
    error: np.ndarray
    force: np.ndarray  # shape (m, n); largest in a pin, of a linkage in a joint [N]
    stroke: np.ndarray  # shape (m, n) [m]; swing [rad] of a linkage whose output body turns
    reasons: np.ndarray  # shape (m, n); why the simulation failed, or None

    @property
    def failed(self) -> np.ndarray:
        """Number of samples whose simulation failed, shape (m,)."""
        return np.count_nonzero(np.isnan(self.error), axis=-1)


RespondingModel = Callable[[np.ndarray], Responses]
"""Responses of lengths (m, k) [m] in all samples: a simulation, or a formula in its place."""


Row = tuple[float, float, float, str | None]
"""Error, force and stroke of one motion, and why it failed."""


class SimulatedSamples:
    """The simulation at common `samples`, values by key; InputError where one is infeasible."""

    def __init__(
        self,
        scenario: Scenario,
        uncertain: Designs,
        samples: list[dict[str, Any]],
        workers: int | None = None,
    ):
        names = _searched(scenario)
        self.scenarios = [sample_scenario(uncertain, values, names) for values in samples]
        # tolerances of the lengths in each sample [m]
        self.tolerances = np.array([[values.get(key, 0.0) for key in names] for values in samples])
        self.original, self.workers = uncertain.base.mechanism, workers
        self.settled_revolution = scenario.optimise.ensemble.settled_revolution

    def __call__(self, lengths: np.ndarray) -> Responses:
        """Responses of `lengths` (m, k) [m] in all samples."""
        actual = lengths[:, None, :] + self.tolerances
        frame = pd.DataFrame(self._rows(actual), columns=[*_QUANTITIES, "reason"])
        columns = (frame[name].to_numpy().reshape(actual.shape[:2]) for name in frame)
        return Responses(lengths, actual, *columns)

    def _rows(self, actual: np.ndarray) -> Iterator[Row]:
        """What `_measure` gives of each set of lengths in each sample."""
        runs = (
            Run(sample.mechanism.with_lengths(*map(float, pair)), sample.simulate)
            for pairs in actual
            for sample, pair in zip(self.scenarios, pairs, strict=True)
        )
        return map(self._measure, simulate_runs(runs, self.workers))

    def rod_angles(self, outcome: Outcome) -> tuple[np.ndarray, np.ndarray]:
        """Crank and rod angles [rad] at the samples of the error."""
        samples, result = self._settled(outcome)[:-1], outcome.result  # the end is the beginning
        angle = outcome.crank_angle[samples]
        return angle, rod_and_slider(outcome.model, angle, result.states[samples])[0]

    def _settled(self, outcome: Outcome) -> np.ndarray:
        per_turn = outcome.run.options.samples_per_revolution
        return (self.settled_revolution - 1) * per_turn + np.arange(per_turn + 1)

    def _measure(self, outcome: Outcome) -> Row:
        """Error [rad], force [N] and stroke [m] of one motion; or the reason of a failure."""
        if outcome.error is not None:
            return math.nan, math.nan, math.nan, str(outcome.error)
        columns = observed(outcome.model, outcome.result.part(self._settled(outcome)))
        joints = outcome.model.linkage.joints
        force = GOALS["largest_pin_force"].load(joint_forces(columns, joints))
        angle, rod = self.rod_angles(outcome)
        lengths = self.original.crank.length, self.original.rod.length
        ideal = transmission_angle(*lengths, angle, 0.0, self.original.slider.offset)
        error = measure(ideal - np.pi / 2 - rod).rms
        return float(error), float(force), float(np.ptp(columns["slider_position"])), None

    def frozen(self) -> Objective:
        """The error over lengths with the joint motion of the original lengths frozen, as in the
        paper."""
        (outcome,) = simulate_runs([Run(self.original, self.scenarios[0].simulate)], 1)
        if outcome.error is not None:
            raise outcome.error
        return objective_of_motion(self.original, *self.rod_angles(outcome))


class SimulatedLinkages(SimulatedSamples):
    """The same of a general linkage."""

    def __init__(self, scenario: Scenario, *given: Any):
        super().__init__(scenario, *given)
        self.nominal = _linkage_problem(scenario)
        options = self.nominal.options
        self.problems = [
            LinkageProblem(sample.mechanism, sample.simulate, options) for sample in self.scenarios
        ]

    def _rows(self, actual: np.ndarray) -> Iterator[Row]:
        items = (
            (problem, lengths)
            for several in actual
            for problem, lengths in zip(self.problems, several, strict=True)
        )
        return side_by_side(lambda item: self._simulate(*item), items, self.workers)

    def _simulate(self, problem: LinkageProblem, lengths: np.ndarray) -> Row:
        options, angles = problem.simulate, crank_angles(problem.simulate)
        try:
            model = linkage_model(problem.with_lengths(lengths), options)
            result = integrate_to_angles(model, model.start(), angles, options.tolerance)
            result = result.part(problem.settled)
            seen = observed(model, result)
            check_walls(problem.file, seen)
        except (ValueError, SimulationError) as error:  # or the bodies do not meet at the start
            return math.nan, math.nan, math.nan, str(error)
        angle = angles[problem.settled]
        pose = pose_of(model, angle, result.states)
        dyad, sites = problem.dyad, problem.file.sites
        desired, _ = self.nominal.geometry.angle(dyad, self.nominal.original, angle)
        error = desired - angle_of(pose.cosines[dyad.inner.name])
        force = np.max([*joint_forces(seen, model.linkage.joints).values()])
        slide = model.linkage.joints.get(sites.slides.get(sites.output))
        stroke = np.ptp(position_of(pose, sites.output, slide))
        return float(measure(error).rms), float(force), float(stroke), None

    def frozen(self) -> FrozenObjective:
        samples = simulate_linkage(self.nominal.file, self.nominal.simulate).samples
        return self.nominal.objective(samples)


def _linkage_problem(scenario: Scenario) -> LinkageProblem:
    return LinkageProblem(
        scenario.mechanism.applied(), scenario.simulate, scenario.optimise_linkage
    )


def simulated_samples(scenario: Scenario, *given: Any) -> SimulatedSamples:
    """The samples of a scenario's mechanism."""
    kind = SimulatedSamples if scenario.optimise_linkage is None else SimulatedLinkages
    return kind(scenario, *given)


def objective_value(options: OptimiseRobust, values: np.ndarray) -> np.ndarray:
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


@dataclass(frozen=True)
class RobustProblem:
    """Region, objective and constraints of the robust optimisation."""

    region: Region  # Of the nominal lengths, with the constraints that depend on lengths only
    original: tuple[float, ...]  # Original lengths [m]
    options: OptimiseRobust
    constraints: Constraints  # Section of the configuration, for the largest pin force
    words: Mapping[str, str] = field(default_factory=dict)  # Of a linkage, in descriptions

    @classmethod
    def of(cls, scenario: Scenario) -> "RobustProblem":
        """The problem of a scenario; InputError where all joints are ideal."""
        original, optimise = scenario.mechanism.applied(), scenario.optimise
        options = scenario.optimise_robust
        if scenario.optimise_linkage:
            problem = _linkage_problem(scenario)
            problem.check()
            sites = original.sites
            motion = "stroke" if sites.output in sites.slides else "swing"
            words = {"stroke": f"{motion} of the {format_name(sites.output)}"}
            words |= {"in either pin": "in the joints"}
            return cls(problem.region, problem.original, options, Constraints(), words)
        if not original.loose:
            raise InputError(
                "optimise_robust: all joints are ideal, so the transmission angle has no error;"
                " make a joint loose"
            )
        region = next(iter(regions(original, optimise).values()))
        lengths = original.crank.length, original.rod.length
        return cls(region, lengths, options, optimise.constraints)

    @property
    def names(self) -> list[str]:
        """Names of the lengths."""
        return list(self.region.names)

    def table(self, table: schema.Table, **groups: Any) -> schema.Table:
        """A `table` with columns for the lengths, and the words of the mechanism."""
        lengths = [Column(name, "m", f"{name}, nominal") for name in self.names]
        columns = []
        for column in table.filled(lengths=lengths, **groups).columns:
            text = column.description
            for word, own in self.words.items():
                text = text.replace(word, own)
            turns = column.name.startswith("stroke") and "swing" in text
            columns.append(replace(column, description=text, unit="rad" if turns else column.unit))
        return replace(table, columns=tuple(columns))

    @property
    def ranges(self) -> list[Constraint]:
        """Constraints that tolerances can violate. Equality constraints refer to the nominal
        lengths only."""
        return [constraint for constraint in self.region.constraints if not constraint.is_fixed]

    def violation(self, responses: Responses) -> dict[str, np.ndarray]:
        """Violation by constraint, shape (m, n), negative where satisfied: in mm or deg; a force in
        % of its limit."""
        violations = {}
        for constraint in self.ranges:
            value = constraint.value(responses.actual)
            outside = np.maximum(constraint.low - value, value - constraint.high)
            violations[constraint.key] = outside / constraint.scale - FEASIBLE
        if (limit := self.constraints.largest_pin_force) is not None:
            violations["largest_pin_force"] = 100.0 * (responses.force / limit - 1.0)
        return violations

    def assess(self, responses: Responses) -> pd.DataFrame:
        """Objective and constraints, one row per pair of lengths."""
        missed = self.region.violation(responses.lengths)
        missed = np.where(missed > FEASIBLE, missed, 0.0)
        # the sample up to which a constraint must hold; NaN, of a failed one, is sorted to the end
        index = math.ceil(self.options.probability * responses.error.shape[-1] - 1e-9) - 1
        for violation in self.violation(responses).values():
            quantile = np.nan_to_num(np.sort(violation, axis=-1)[..., index], nan=np.inf)
            missed = missed + np.maximum(quantile, 0.0)
        with warnings.catch_warnings():
            # numpy's, where at most one sample has a value
            warnings.simplefilter("ignore", RuntimeWarning)
            columns = {
                "error_mean": np.nanmean(responses.error, axis=-1),
                "error_deviation": deviation(responses.error),
                "error": objective_value(self.options, responses.error),
                "force": objective_value(self.options, responses.force),
            }
        lengths = dict(zip(self.names, responses.lengths.T, strict=True))
        missed = np.minimum(missed, _MOST_VIOLATION)
        return pd.DataFrame(lengths | columns | {"missed": missed, "failed": responses.failed})


class _LengthsProblem(Problem):
    """The lengths of a region as a pymoo problem, with the `candidates` of a generation."""

    def __init__(self, region: Region, candidates: Callable[[np.ndarray], pd.DataFrame]):
        count = len(region.lower)
        super().__init__(n_var=count, n_obj=1, n_ieq_constr=2, xl=region.lower, xu=region.upper)
        self.region, self.candidates = region, candidates

    def _evaluate(self, x, out, *args, **kwargs):
        candidates = self.candidates(x)
        out["F"] = candidates["error"].fillna(_FAILED).to_numpy()
        out["G"] = candidates[["missed", "failed"]].to_numpy(dtype=float)


class _OntoRegion(Repair):
    def _do(self, problem, x, **kwargs):
        return problem.region.nearest(x)


def search(problem: RobustProblem, model: RespondingModel) -> pd.DataFrame:
    """All candidates of the search: a grid, then differential evolution."""
    region, options, frames = problem.region, problem.options, []

    def report_generation() -> None:
        report_progress("generations of lengths", len(frames), 1 + options.generations)

    def assess(lengths: np.ndarray) -> pd.DataFrame:
        frame = problem.assess(model(lengths))
        step = {"step": "one measure", "generation": len(frames) - 1}
        frames.append(frame.assign(**step if frames else {"step": "grid", "generation": 0}))
        report_generation()
        return frame

    report_generation()
    spacing = np.linspace(region.lower, region.upper, options.grid)
    each = np.meshgrid(*spacing.T, indexing="ij")
    grid = np.stack([lengths.ravel() for lengths in each], axis=1)
    grid = grid[region.contains(grid, slack=1e-12)]
    grid = region.nearest(np.vstack([grid, region.clip(np.array(problem.original))]))
    candidates, count = assess(grid), options.population
    # the first population: half of it the best so far, half spread over the region
    best = candidates.loc[ranked(candidates)[: count // 2], problem.names].to_numpy()
    random = np.random.default_rng([options.seed, 0])
    spread = qmc.LatinHypercube(len(each), rng=random).random(count - len(best))
    evolution = DE(
        variant="DE/best/1/bin",
        CR=1.0,
        pop_size=count,
        sampling=np.vstack([best, region.nearest(region.unscaled(spread))]),
        repair=_OntoRegion(),
    )
    stop = ("n_gen", options.generations)
    minimize(_LengthsProblem(region, assess), evolution, stop, seed=options.seed)
    return pd.concat(frames, ignore_index=True)


def ranked(candidates: pd.DataFrame) -> np.ndarray:
    """Indices of the candidates from the best on: feasible ones by their error, then infeasible
    ones by violation."""
    error = candidates["error"].fillna(np.inf)
    return np.lexsort((error, candidates["missed"], candidates["failed"]))


def best_of(candidates: pd.DataFrame) -> pd.Series:
    """The best candidate."""
    return candidates.iloc[ranked(candidates)[0]]


@dataclass(frozen=True)
class RobustOptimum:
    """The tables of the stage, and the problem."""

    candidates: pd.DataFrame
    fresh: pd.DataFrame
    lengths: pd.DataFrame  # A row per pair of lengths: statistics of each quantity with intervals
    gains: pd.DataFrame  # A row per comparison: how often, and by how much, the error is smaller
    constraints: pd.DataFrame  # A row per pair of lengths and constraint
    uncertain: Designs
    problem: RobustProblem

    @property
    def frames(self) -> dict[schema.Table, pd.DataFrame]:
        """The tables of the stage."""
        columns, problem = [], self.problem
        for axis in self.uncertain.axes:
            is_length = axis.key in problem.names
            role = "tolerance added to the nominal length" if is_length else "uncertain"
            columns.append(replace(axis.column, description=f"{axis.key}: {role}"))
        return {
            problem.table(schema.OPTIMISE_ROBUST_LENGTHS): self.lengths,
            schema.OPTIMISE_ROBUST_GAINS: self.gains,
            schema.OPTIMISE_ROBUST_CONSTRAINTS: self.constraints,
            problem.table(schema.OPTIMISE_ROBUST_CANDIDATES): self.candidates,
            problem.table(schema.OPTIMISE_ROBUST_FRESH, uncertain=columns): self.fresh,
        }

    @property
    def robust_candidates(self) -> pd.DataFrame:
        """Candidates of the search over all samples."""
        return self.candidates[self.candidates["search"] == "robust"]

    @property
    def is_feasible(self) -> bool:
        """Whether the best candidate satisfies the constraints and was simulated in all samples."""
        best = best_of(self.robust_candidates)
        return bool(best["missed"] <= 0.0 and not best["failed"])


def compare(
    problem: RobustProblem, names: tuple[str, ...], responses: Responses
) -> dict[str, pd.DataFrame]:
    """Compare lengths: the tables `lengths`, `gains` and `constraints`."""
    options, valid = problem.options, ~np.isnan(responses.error).any(axis=0)
    draws = np.count_nonzero(valid)
    if draws < 2:
        reason = next(filter(None, responses.reasons.flat))
        raise InputError(
            f"optimise_robust: fewer than two of {len(valid)} validation samples were simulated"
            f" with all lengths; the first failure: {reason}"
        )

    def statistics(values: np.ndarray, axis: int = -1) -> np.ndarray:
        mean, quantiles = np.mean(values, axis=axis), np.quantile(values, (0.05, 0.5, 0.95), axis)
        return np.stack([mean, deviation(values), objective_value(options, values), *quantiles])

    values = np.stack([getattr(responses, name)[:, valid] for name in _QUANTITIES])
    resampled = bootstrap(
        (values,),
        statistics,
        n_resamples=options.resamples,
        batch=max(1, _BOOTSTRAP_VALUES // values.size),
        vectorized=True,
        axis=-1,
        method="percentile",
        rng=np.random.default_rng([options.seed, _BOOTSTRAP]),
    ).bootstrap_distribution

    def with_interval(function: Callable) -> Iterator[tuple[str, np.ndarray]]:
        """A function of the statistics, and the ends of its interval, with their suffixes."""
        tail = (1.0 - _CONFIDENCE) / 2.0
        ends = np.quantile(function(resampled), (tail, 1.0 - tail), axis=-1)
        return zip(_ENDS, (function(statistics(values)), *ends), strict=True)

    lengths = {"lengths": names, **dict(zip(problem.names, responses.lengths.T, strict=True))}
    lengths |= {"draws": draws, "failed": responses.failed}
    for end, by_statistic in with_interval(lambda numbers: numbers):
        for statistic, by_quantity in zip(_STATISTICS, by_statistic, strict=True):
            for quantity, numbers in zip(_QUANTITIES, by_quantity, strict=True):
                lengths[f"{quantity}_{statistic}{end}"] = numbers
    gains, error = [], values[0]
    for reference, index in combinations(range(len(names)), 2):

        def reduction(numbers: np.ndarray, reference=reference, index=index) -> np.ndarray:
            return 1.0 - numbers[:, 0, index] / numbers[:, 0, reference]

        row = {"lengths": names[index], "beside": names[reference], "draws": draws}
        row |= _probability(error[index] < error[reference])
        for end, reductions in with_interval(reduction):
            for name in ("mean", "measure"):
                row[f"{name}_fall{end}"] = float(reductions[_STATISTICS.index(name)])
        gains.append(row)
    constraints = [
        {"lengths": name, "constraint": key, "asked": options.probability, "draws": len(violation)}
        | _probability(violation <= 0.0)
        for key, violations in problem.violation(responses).items()
        for name, violation in zip(names, violations, strict=True)
    ]
    return {
        "lengths": pd.DataFrame(lengths),
        "gains": pd.DataFrame(gains),
        "constraints": pd.DataFrame(constraints, columns=schema.OPTIMISE_ROBUST_CONSTRAINTS.names),
    }


def _probability(events: np.ndarray) -> dict[str, float]:
    """Frequency of `events` (n,), and the exact interval of their probability."""
    count, trials = int(np.count_nonzero(events)), len(events)
    interval = binomtest(count, trials).proportion_ci(_CONFIDENCE, method="exact")
    numbers = (count / trials, interval.low, interval.high)
    return {f"probability{end}": value for end, value in zip(_ENDS, numbers, strict=True)}


def optimise_robust(scenario: Scenario, workers: int | None = None) -> RobustOptimum:
    """Optimise robust lengths in the first of the scenario's boxes, and validate them on
    independent samples."""
    options, uncertain = scenario.optimise_robust, uncertain_of(scenario)
    problem = RobustProblem.of(scenario)
    random, axes = np.random.default_rng([options.seed, _VALIDATION]), uncertain.axes
    validation = values_at(axes, random.random((options.fresh_draws, len(axes))))
    # create all samples first: infeasible ones are rejected before any simulation
    at_nominal, at_samples, at_validation = (
        simulated_samples(scenario, uncertain, samples, workers)
        for samples in ([{}], uncertain.values(0, options.draws), validation)
    )
    nominal = search(problem, at_nominal).assign(search="nominal")
    robust = search(problem, at_samples).assign(search="robust")
    local_tolerance = (scenario.optimise_linkage or scenario.optimise).local_tolerance
    optima = search_from_all(at_nominal.frozen(), problem.region, local_tolerance)
    frozen = min(optima, key=lambda optimum: optimum.value).lengths
    best = [best_of(candidates)[problem.names] for candidates in (nominal, robust)]
    responses = at_validation(np.array([problem.original, frozen, *best], float))
    values = pd.DataFrame(validation)
    fresh = pd.concat(
        [values.assign(draw=values.index, lengths=name) for name in COMPARED], ignore_index=True
    )
    measured = {name: getattr(responses, name).ravel() for name in _QUANTITIES}
    return RobustOptimum(
        pd.concat([nominal, robust], ignore_index=True),
        fresh.assign(**measured, reason=responses.reasons.ravel()),
        **compare(problem, COMPARED, responses),
        uncertain=uncertain,
        problem=problem,
    )


def check(scenario: Scenario) -> None:
    """InputError where the section `optimise_robust` of a `scenario` is infeasible."""
    uncertain = uncertain_of(scenario)
    RobustProblem.of(scenario)
    simulated_samples(scenario, uncertain, uncertain.values(0, scenario.optimise_robust.draws))
