"""Simulated designs that networks and surrogates are trained on, each with the CPU time at which it was there.

One pool serves every budget: a smaller budget takes the beginning of the sequence, and is charged for it as if it had
simulated it by itself.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jointgap.core.errors import InputError
from jointgap.design_networks.design_space import Design
from jointgap.design_networks.settled_motion import SettledMotion

LEAST_DESIGNS = 24
"""Designs of which something is learned at all."""

_AT_ONCE = 16  # designs between two looks at the clock


@dataclass(frozen=True)
class TrainingPool:
    """What has been simulated."""

    designs: tuple[Design, ...]  # Those that could be simulated, in their order
    vectors: np.ndarray  # Their motions, (designs, points, joints, 2) [m]
    simulations: np.ndarray  # Simulations that had been run when each was there, those that failed included, (designs,)
    cpu_time: np.ndarray  # Spent until then, (designs,) [s]

    @property
    def cost(self) -> float:
        """CPU time of a simulation, drawing the design included [s]."""
        return float(self.cpu_time[-1] / self.simulations[-1])

    def within(self, budget: float) -> "TrainingPool":
        """What was there after a `budget` [s]; `LEAST_DESIGNS` where that is fewer."""
        number = max(LEAST_DESIGNS, int(np.searchsorted(self.cpu_time, budget, side="right")))
        return TrainingPool(self.designs[:number], self.vectors[:number], self.simulations[:number],
                            self.cpu_time[:number])  # fmt: skip


def fill_pool(
    motion: SettledMotion, most: int, seed: int, budget: float, clock: Callable[[], float], workers: int | None
) -> TrainingPool:
    """Simulate designs of a Sobol sequence until a budget is spent."""
    begun, drawn = clock(), motion.space.drawn(most, seed)
    designs, vectors, simulations, times, run = [], [], [], [], 0
    while run < most and (run < 2 * LEAST_DESIGNS or clock() - begun < budget):
        before = clock() - begun
        several = [design for _, design in zip(range(_AT_ONCE), drawn, strict=False)]
        if not several:
            break
        found = list(motion.simulated(several, workers))
        each = (clock() - begun - before) / len(several)
        for number, (design, motions) in enumerate(zip(several, found, strict=True), start=1):
            if motions is not None:
                designs.append(design)
                vectors.append(motions)
                simulations.append(run + number)
                times.append(before + number * each)
        run += len(several)
    if len(designs) < LEAST_DESIGNS:
        raise InputError(
            f"compare_searches: of {run} designs {len(designs)} can be simulated, too few to learn from; give "
            "narrower ranges in design_networks.parameters"
        )
    return TrainingPool(tuple(designs), np.array(vectors), np.array(simulations), np.array(times))
