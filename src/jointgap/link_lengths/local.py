"""The local optimiser: sequential quadratic programming from six starting points.

scipy's SLSQP (Kraft 1988) with the exact gradient. It works on lengths scaled to the box and on the error relative to
that of the original lengths, so its stopping tolerance is a relative change of the error's sum of squares.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from jointgap.link_lengths.constraints import MET
from jointgap.link_lengths.objective import Objective
from jointgap.link_lengths.region import Region

TOLERANCES = tuple(10.0**-exponent for exponent in range(1, 13))  # swept to show what stopping early does


@dataclass(frozen=True)
class LocalResult:
    """One local search."""

    start: np.ndarray  # shape (2,); where it started and ended, (L2, L3) [m]
    lengths: np.ndarray  # shape (2,); where it started and ended, (L2, L3) [m]
    value: float  # Sum of squares at the end [rad^2]
    evaluations: int  # Calls of the objective; those of its exact gradient are not counted
    values: np.ndarray  # shape (evaluations,); every value in the order of evaluation [rad^2]
    path: np.ndarray  # shape (k, 2); every iterate, the start first [m]
    converged: bool  # Whether the stopping tolerance was met
    status: str  # Why it stopped and what to make of it


def starting_points(region: Region) -> np.ndarray:
    """Six points, shape (6, 2) [m]: L2 at 1/4, 3/4 of its range with L3 at 1/6, 1/2, 5/6; cranks too long are cut, and
    all are moved to the nearest lengths that meet the constraints.
    """
    shares = [(crank, rod) for rod in (1 / 6, 1 / 2, 5 / 6) for crank in (1 / 4, 3 / 4)]
    return np.array([region.nearest(region.unscaled(np.array(share))) for share in shares])


def search(objective: Objective, region: Region, start: ArrayLike, tolerance: float) -> LocalResult:
    """Follow the error downhill from `start`."""
    start = np.asarray(start, dtype=float)
    unit = float(objective.value(objective.original))
    path, values = [start], []

    def share(scaled: np.ndarray) -> float:
        values.append(float(objective.value(region.unscaled(scaled))))
        return values[-1] / unit

    result = minimize(
        share,
        (start - region.lower) / region.size,
        jac=lambda scaled: objective.gradient(region.unscaled(scaled)) * region.size / unit,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * 2,
        constraints=region.conditions(),
        callback=lambda scaled: path.append(region.unscaled(np.array(scaled))),
        options={"ftol": tolerance, "maxiter": 200},
    )
    end = np.clip(region.unscaled(result.x), region.lower, region.upper)  # bounds met up to rounding are met
    if region.missed(end) > MET:  # a loose tolerance is one of constraints too
        end = region.nearest(end)
    if result.success:
        status = f"stopped: the sum of squares changes by less than {tolerance:g} of its value at the original lengths"
    else:
        status = (
            f"not converged ({str(result.message).strip().lower()}): raise the tolerance {tolerance:g} or check the box"
        )
    if not np.array_equal(path[-1], end):
        path.append(end)
    return LocalResult(
        start=start,
        lengths=end,
        value=float(objective.value(end)),
        evaluations=len(values),
        values=np.array(values),
        path=np.array(path),
        converged=bool(result.success),
        status=status,
    )


def search_from_all(objective: Objective, region: Region, tolerance: float) -> tuple[LocalResult, ...]:
    """`search` from each of the six starting points."""
    return tuple(search(objective, region, start, tolerance) for start in starting_points(region))
