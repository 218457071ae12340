"""The stage optimise-robust: a scenario in; candidates, optima and their comparison on fresh draws out."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Optimise, Scenario, Simulate
from jointgap.core.errors import InputError
from jointgap.dynamics.kinematics import ideal_cycle
from jointgap.dynamics.parallel import Run, rod_and_slider, simulate_runs
from jointgap.lengths.objective import Objective, objective_of_motion
from jointgap.lengths.region import Region, geometric
from jointgap.lengths.search import search_from_all
from jointgap.robust_lengths.fresh_comparison import QUANTITIES, Comparison, compare
from jointgap.robust_lengths.robust_measure import RobustMeasure
from jointgap.robust_lengths.search_lengths import RobustProblem, best_of, front_of, search
from jointgap.robust_lengths.simulated_draws import Responses, SimulatedDraws
from jointgap.robust_lengths.uncertain_draws import LENGTHS, Draw, Uncertain, uncertain_of
from jointgap.tables import Table, robust_fresh
from jointgap.tables.columns import Column

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
        return robust_fresh(
            Column(axis.key, axis.column.unit, _described(axis.key), axis.column.kind) for axis in self.uncertain.axes
        )


def _described(key: str) -> str:
    return f"{key}: what is added to the nominal length" if key in LENGTHS else f"{key}, uncertain"


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
    lengths = np.array([asked.original, frozen, _lengths_of(nominal), _lengths_of(robust)])
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
        measure=RobustMeasure.of_options(options),
        constraints=optimise.constraints,
        probability=options.probability,
    )


def _lengths_of(candidates: pd.DataFrame) -> tuple[float, float]:
    """The best lengths of a search, (L2, L3) [m]."""
    best = candidates.iloc[best_of(candidates)]
    return float(best["crank_length"]), float(best["rod_length"])


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
