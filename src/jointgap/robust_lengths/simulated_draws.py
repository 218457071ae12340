"""Pairs of lengths simulated at each draw of what is uncertain.

The error is that of equation (12) and of `jointgap.lengths.resimulate`: the transmission angle that was designed,
which is that of the original lengths without clearance, less the angle of the simulated motion of the new lengths. What
is uncertain changes the motion and not what was designed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from jointgap.config import Mechanism, Optimise, Simulate
from jointgap.core.joints import PINS
from jointgap.dynamics.kinematics import transmission_angle
from jointgap.dynamics.parallel import Outcome, Run, rod_and_slider, simulate_runs
from jointgap.lengths.objective import measure
from jointgap.robust_lengths.uncertain_draws import Draw

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


class Responding(Protocol):
    """What answers for lengths in draws: a simulation, or a formula that stands in for it."""

    def __call__(self, lengths: np.ndarray) -> Responses:
        """What `lengths` (m, 2) [m] do in every draw."""


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
