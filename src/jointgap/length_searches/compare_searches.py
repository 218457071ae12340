"""The stage compare-searches: four ways to the best lengths of several designs, at equal CPU time.

Wanted are the best lengths for each of some designs, which differ in what `design_networks.parameters` vary. A budget
is CPU time for each of these optima. A way that learns first may take the budgets of all optima for simulating what it
learns from, its training and its searches; a way that simulates each optimum by itself takes each budget for one.
Whatever lengths a way finds are simulated again.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.errors import InputError
from jointgap.core.progress import tell
from jointgap.design_networks.design_space import Design, DesignSpace
from jointgap.design_networks.held_out_errors import HeldOut, held_out
from jointgap.design_networks.settings import SETTINGS as OF_NETWORKS
from jointgap.design_networks.settled_motion import SettledMotion
from jointgap.design_networks.train_network import train
from jointgap.length_searches.check_searches import check_searches
from jointgap.length_searches.cma_search import cma_search
from jointgap.length_searches.error_surrogate import train_surrogate
from jointgap.length_searches.learned_search import learned_search
from jointgap.length_searches.settings import SETTINGS
from jointgap.length_searches.training_pool import TrainingPool, fill_pool
from jointgap.lengths.objective import frozen_objective
from jointgap.lengths.search import search_from_all

FROZEN, NETWORKS, SURROGATE, SIMULATION = "frozen", "networks", "surrogate", "simulation"
WAYS = (FROZEN, NETWORKS, SURROGATE, SIMULATION)
"""The four ways, in the order of tables and figures."""

_WANTED, _HELD_OUT = 2, 3  # beside the seed: streams of the designs wanted and of those held out
_MOST_DESIGNS = 100_000  # of a pool: memory holds some 6 kB of each
_MOST_STEPS = 10**9  # of a training that ends with its budget


@dataclass(frozen=True)
class Compared:
    """What the stage finds; frames of the tables of the same names."""

    space: DesignSpace
    searches: pd.DataFrame  # A row for each optimum of each way, budget and repetition
    predictions: pd.DataFrame  # A row for each way, budget and repetition: its error on held-out designs
    progress: pd.DataFrame  # A row for each generation of each search by simulation
    cost: float  # CPU time of a simulation, without what a search adds [s]
    wanted: tuple[Design, ...]  # Whose best lengths were searched, with the original lengths

    @property
    def wanted_frame(self) -> pd.DataFrame:
        """Table compare_searches_wanted."""
        rows = [
            (number, key, float(value))
            for number, design in enumerate(self.wanted)
            for key, value in design.values.items()
        ]
        return pd.DataFrame(rows, columns=["optimum", "parameter", "value"])


def compare_searches(
    scenario: Scenario, workers: int | None = None, clock: Callable[[], float] = time.process_time
) -> Compared:
    """Search the best lengths in four ways."""
    space, options = check_searches(scenario), scenario.compare_searches
    motion = SettledMotion(space, OF_NETWORKS.points)
    wanted = [each.at(space.original) for each in space.fresh(options.optima, [options.seed, _WANTED])]
    original = errors_at(motion, [(each, each.lengths) for each in wanted], workers)
    if np.isnan(original).any() or not wanted:
        raise InputError(
            "compare_searches: a design whose best lengths are wanted cannot be simulated with the original lengths; "
            "give narrower ranges in design_networks.parameters"
        )
    held = held_out(motion, list(space.fresh(options.held_out, [options.seed, _HELD_OUT])), workers)
    comparison = _Comparison(scenario, motion, wanted, held, workers, clock)
    tell("repetitions of the searches", 0, options.repetitions)
    for repetition in range(options.repetitions):
        comparison.repeat(repetition)
        tell("repetitions of the searches", repetition + 1, options.repetitions)
    searches = pd.DataFrame(comparison.searches)
    found = [(wanted[row.optimum], (row.crank_length, row.rod_length)) for row in searches.itertuples()]
    error = errors_at(motion, found, workers)
    before = original[searches["optimum"]]
    # lengths that cannot be simulated are no gain: the original ones stay
    searches["error"], searches["original_error"] = np.where(np.isnan(error), before, error), before
    searches["gain"] = 1.0 - searches["error"] / before
    progress = pd.DataFrame(comparison.progress)
    progress["gain"] = 1.0 - progress["error"] / original[progress["optimum"]]
    return Compared(
        space, searches, pd.DataFrame(comparison.predictions), progress, float(np.mean(comparison.costs)), tuple(wanted)
    )


def errors_at(
    motion: SettledMotion, pairs: Sequence[tuple[Design, tuple[float, float]]], workers: int | None
) -> np.ndarray:
    """Simulated RMS errors of the transmission angle (n,) [rad]; NaN where a simulation fails."""
    motions = motion.simulated((design.at(lengths) for design, lengths in pairs), workers)
    return np.array([
        np.nan if vectors is None else motion.error(design, np.array([lengths]), motion.lift(vectors))[0]
        for (design, lengths), vectors in zip(pairs, motions, strict=True)
    ])  # fmt: skip


class _Comparison:
    """The four ways, one repetition after the other; keeps rows of the tables."""

    def __init__(
        self,
        scenario: Scenario,
        motion: SettledMotion,
        wanted: list[Design],
        held: HeldOut,
        workers: int | None,
        clock: Callable[[], float],
    ):
        self.scenario, self.motion, self.space = scenario, motion, motion.space
        self.wanted, self.held, self.workers, self.clock = wanted, held, workers, clock
        self.options = scenario.compare_searches
        self.searches: list[dict] = []
        self.predictions: list[dict] = []
        self.progress: list[dict] = []
        self.costs: list[float] = []
        self._held_lengths = [np.array([each.lengths]) for each in held.designs]
        self._held_errors = self._errors_held(motion.lift(held.simulated))

    def repeat(self, repetition: int) -> None:
        """All ways with other training designs and other random numbers."""
        self._frozen(repetition)
        self._simulation(repetition)
        seed = self._seed(repetition)
        most = max(SETTINGS.simulated_for_networks, SETTINGS.simulated_for_surrogate)
        budget = most * self._to_learn(self.options.budgets[-1])
        pool = fill_pool(self.motion, _MOST_DESIGNS, seed, budget, self.clock, self.workers)
        self.costs.append(pool.cost)
        for each in self.options.budgets:
            self._networks(repetition, each, pool)
            self._surrogate(repetition, each, pool)

    def _to_learn(self, budget: float) -> float:
        """What a `budget` for each optimum leaves for simulating designs and training [s]."""
        return len(self.wanted) * (budget - min(SETTINGS.search_time, 0.5 * budget))

    def _seed(self, repetition: int) -> int:
        return int(np.random.SeedSequence([self.options.seed, repetition]).generate_state(1)[0])

    def _frozen(self, repetition: int) -> None:
        for number, design in enumerate(self.wanted):
            begun = self.clock()
            (vectors,) = self.motion.simulated([design], 1)
            lift = self.motion.lift(vectors)
            objective = frozen_objective(design.mechanism, self.motion.crank_angle, lift)
            found = search_from_all(objective, self.space.region, self.scenario.optimise.local_tolerance)
            lengths = min(found, key=lambda each: each.value).lengths
            cpu_time = self.clock() - begun
            self._row(FROZEN, repetition, np.nan, number, lengths, cpu_time, 0.0, 1)
        self._predicted(FROZEN, repetition, np.nan, self._errors_held(self.motion.lift(self.held.frozen)))

    def _simulation(self, repetition: int) -> None:
        budgets = self.options.budgets
        for number, design in enumerate(self.wanted):
            begun = self.clock()
            steps = cma_search(
                lambda lengths, design=design: errors_at(
                    self.motion, [(design, each) for each in lengths], self.workers
                ),
                self.space.region,
                np.array(self.space.original),
                self._seed(repetition) % 2**31 + number,
                SETTINGS,
                lambda begun=begun: self.clock() - begun,
                budgets[-1],
            )
            for step in steps:
                self.progress.append(
                    {
                        "repetition": repetition,
                        "optimum": number,
                        "simulations": step.evaluations,
                        "cpu_time": step.cpu_time,
                        "error": step.error,
                    }
                )
            for budget in budgets:
                step = [each for each in steps if each.cpu_time <= budget or each is steps[0]][-1]
                self._row(SIMULATION, repetition, budget, number, step.lengths, step.cpu_time, 0.0, step.evaluations)
        for budget in budgets:
            self._predicted(SIMULATION, repetition, budget, self._held_errors)

    def _networks(self, repetition: int, budget: float, pool: TrainingPool) -> None:
        to_learn = self._to_learn(budget)
        known = pool.within(SETTINGS.simulated_for_networks * to_learn)
        left = to_learn - known.cpu_time[-1]
        begun = self.clock()
        network = train(
            self.motion,
            known.designs,
            known.vectors,
            self.scenario.design_networks.hidden,
            self._seed(repetition),
            OF_NETWORKS,
            _MOST_STEPS,
            lambda: self.clock() - begun >= left,
        ).network
        learned = known.cpu_time[-1] + self.clock() - begun
        vectors = network.at_angles(self.motion.crank_angle)

        def squares(design: Design, lengths: np.ndarray) -> np.ndarray:
            return self.motion.error(design, lengths, self.motion.lift(vectors(design, lengths))) ** 2

        self._searched(NETWORKS, repetition, budget, squares, learned, known)

    def _surrogate(self, repetition: int, budget: float, pool: TrainingPool) -> None:
        known = pool.within(SETTINGS.simulated_for_surrogate * self._to_learn(budget))
        begun = self.clock()
        lifts = self.motion.lift(known.vectors)
        errors = [
            self.motion.error(design, np.array([design.lengths]), lift)[0]
            for design, lift in zip(known.designs, lifts, strict=True)
        ]
        surrogate = train_surrogate(self.space, known.designs, np.array(errors), self._seed(repetition), SETTINGS)
        learned = known.cpu_time[-1] + self.clock() - begun
        self._searched(SURROGATE, repetition, budget, surrogate.squares, learned, known)

    def _searched(
        self,
        way: str,
        repetition: int,
        budget: float,
        squares: Callable[[Design, np.ndarray], np.ndarray],
        learned: float,
        known: TrainingPool,
    ) -> None:
        """Search every optimum with what was learned, in CPU time `learned` [s]."""
        for number, design in enumerate(self.wanted):
            begun = self.clock()
            lengths = learned_search(
                lambda each, design=design: squares(design, each), self.space.region, self.space.original, SETTINGS
            )
            cpu_time = self.clock() - begun
            self._row(way, repetition, budget, number, lengths, cpu_time, learned, int(known.simulations[-1]))
        expected = [
            squares(design, lengths)[0] for design, lengths in zip(self.held.designs, self._held_lengths, strict=True)
        ]
        self._predicted(way, repetition, budget, np.sqrt(np.maximum(expected, 0.0)))

    def _errors_held(self, lifts: np.ndarray) -> np.ndarray:
        """RMS errors (designs,) [rad] of the held-out designs with `lifts` (designs, points) [m]."""
        held = zip(self.held.designs, self._held_lengths, lifts, strict=True)
        return np.array([self.motion.error(design, lengths, lift)[0] for design, lengths, lift in held])

    def _row(
        self,
        way: str,
        repetition: int,
        budget: float,
        optimum: int,
        lengths: Sequence[float],
        searched: float,
        learned: float,
        simulations: int,
    ) -> None:
        crank, rod = map(float, lengths)
        self.searches.append(
            {
                "way": way,
                "repetition": repetition,
                "budget": budget,
                "optimum": optimum,
                "crank_length": crank,
                "rod_length": rod,
                "search_time": searched,
                "learning_time": learned,
                "cpu_time": searched + learned / len(self.wanted),
                "simulations": simulations,
            }
        )

    def _predicted(self, way: str, repetition: int, budget: float, expected: np.ndarray) -> None:
        missed = np.sqrt(np.mean((expected - self._held_errors) ** 2))
        self.predictions.append(
            {"way": way, "repetition": repetition, "budget": budget, "missed": float(missed),
             "designs": len(expected)}
        )  # fmt: skip
