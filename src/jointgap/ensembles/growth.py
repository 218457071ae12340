"""What a small change of the start grows to: whether samples of a motion can be compared, or statistics alone."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config import Mechanism, Simulate
from jointgap.core.errors import InputError
from jointgap.dynamics.parallel import Run, simulate_runs
from jointgap.dynamics.simulate import IntegrationResult, perturbed_start

CHANGE = 1e-11
"""Size of the change of the start [m]: what two good codes differ by."""

DIRECTIONS = 5
"""Random directions of the change: enough for a median, and for the fastest to be among them."""

USEFUL = 1e-3
"""Share of the smallest clearance up to which two motions count as the same."""

_TOLERANCE_RATIO = 1000.0  # of the change to the local error of a step, so that the change alone is seen to grow
_ERROR_FLOOR = 50.0  # local errors of a step that the error of a position sums up to, before chaos
_SHORTEST_FIT = 0.1  # revolutions that an exponent needs at least
_SATURATED = 0.01  # share of the smallest clearance from which on growth ends because motions cannot differ by more


@dataclass(frozen=True)
class Growth:
    """Growth of a small change over the crank angle."""

    crank_angle: np.ndarray  # [rad]
    factors: np.ndarray
    change: float  # Size of the change at the start [m]
    useful: float  # Distance [m] up to which motions count as the same
    saturated: float  # Distance [m] from which on a fit of the exponent leaves samples out
    tolerance: float  # Local error of a step [m] that the runs were made with

    @property
    def median(self) -> np.ndarray:
        """Median over the changes, (n,)."""
        return np.median(self.factors, axis=0)

    @property
    def comparable_until(self) -> float:
        """Crank angle [rad] turned until the first of the changes exceeds `useful`; infinite where none does."""
        beyond = np.flatnonzero(self.factors.max(axis=0) * self.change > self.useful)
        return float(self.crank_angle[beyond[0]] - self.crank_angle[0]) if len(beyond) else math.inf

    @property
    def exponent(self) -> float:
        """Natural logarithm of the median growth per revolution; NaN where it cannot be fitted.

        Slope of the line fitted to all samples at which the distance is above the error of the integration and
        has not yet grown so large that it can grow no more; NaN where these span less than a tenth of a revolution.
        """
        distance, turned = self.median * self.change, (self.crank_angle - self.crank_angle[0]) / (2 * math.pi)
        beyond = np.flatnonzero(distance > self.saturated)
        chosen = (distance > _ERROR_FLOOR * self.tolerance) & (
            np.arange(turned.size) < (beyond[0] if len(beyond) else turned.size)
        )
        if not chosen.any() or np.ptp(turned[chosen]) < _SHORTEST_FIT:
            return math.nan
        return float(np.polyfit(turned[chosen], np.log(self.median[chosen]), 1)[0])

    @property
    def verdict(self) -> str:
        """One sentence for the user."""
        largest = self.factors.max()
        turned = math.degrees(self.crank_angle[-1] - self.crank_angle[0])
        growth = f"a change of {self.change:g} m at the start grows up to {largest:.2g} times within {turned:.0f} deg"
        if math.isinf(self.comparable_until):
            return f"{growth}: samples can be compared throughout"
        until = math.degrees(self.comparable_until)
        return (
            f"{growth}: samples can be compared up to {until:.0f} deg, where it passes {self.useful:.2g} m; "
            "beyond, only statistics can be compared"
        )

    def frame(self) -> pd.DataFrame:
        """The growth as the table `jointgap.tables.GROWTH`."""
        low, high = self.factors.min(axis=0), self.factors.max(axis=0)
        columns = (self.crank_angle, self.median, low, high)
        return pd.DataFrame(dict(zip((column.name for column in tables.GROWTH.columns), columns, strict=True)))


def measure_growth(
    mechanism: Mechanism,
    options: Simulate,
    change: float = CHANGE,
    directions: int = DIRECTIONS,
    seed: int = 0,
    workers: int | None = None,
) -> Growth:
    """Simulate a motion again from starts that differ by `change` in random directions.

    The local error of a step is a thousandth of the change at most, so that it is the change that is seen to grow.
    """
    applied = mechanism.applied()
    if not applied.loose:
        raise InputError(
            "growth of a small change: all joints are ideal, so the start cannot be changed; make one loose"
        )
    random_directions = perturbed_start(np.random.default_rng(seed).normal(size=(directions, 6)), applied.loose)
    random_directions /= np.linalg.norm(random_directions, axis=1, keepdims=True)
    finer = options.model_copy(update={"tolerance": min(options.tolerance, change / _TOLERANCE_RATIO)})
    starts = np.vstack([np.zeros(6), change * random_directions])
    outcomes = list(simulate_runs((Run(applied, finer, start) for start in starts), workers))
    for outcome in outcomes:
        if outcome.error is not None:
            raise outcome.error
    clearance = min(applied.clearance(joint) for joint in applied.loose)
    vectors = np.array([sampled_clearances(outcome.result) for outcome in outcomes])
    distance = np.linalg.norm(vectors[1:] - vectors[0], axis=2)
    return Growth(
        outcomes[0].crank_angle,
        distance / change,
        change,
        USEFUL * clearance,
        _SATURATED * clearance,
        finer.tolerance,
    )


def sampled_clearances(result: IntegrationResult) -> np.ndarray:
    """Clearance vectors of all joints at the samples of an integration, (n, 6) [m]."""
    return np.hstack([result.states[:, :4], result.auxiliary_states[:, :2]])
