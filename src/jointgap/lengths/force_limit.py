"""Search under limits of forces, which depend on the motion at the new lengths."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from jointgap.core.words import joined, number
from jointgap.lengths.region import FORCE_TOLERANCE, LEAST_FORCE, Constraint, Region
from jointgap.lengths.search import Point, Search

ROUNDS = 4  # largest number of searches until the re-simulated lengths satisfy the limits
SLACK = 1e-3  # relative excess of a limit up to which the search is not repeated


def scaled(force: Constraint, factor: float) -> Constraint:
    """A limited force times a factor."""
    return replace(
        force,
        value=lambda lengths: factor * force.value(lengths),
        slope=lambda lengths: factor * force.gradient(lengths),
    )


def search_under_force_limits(
    forces: Sequence[Constraint],
    region: Region,
    box: str,
    search: Callable[[Region], list[Search]],
    peak_forces: Callable[[Point], Sequence[float]],
) -> list[Search] | Point:
    """The searches in a region; without an optimum, the lengths with the smallest forces.

    Where re-simulated lengths have other forces than the functions, these are scaled to them and
    the search repeated. `peak_forces` simulates a point again.
    """
    limits, feasible = np.array([force.high for force in forces]), []
    words = joined(f"the {each.words} below {number(each.high)} N" for each in forces)
    for _ in range(ROUNDS):
        values = np.array([force.value(region.samples) for force in forces])
        excess = (values / limits[:, None]).max(axis=0)
        lengths = tuple(map(float, region.samples[np.argmin(excess)]))
        least = Point(f"{LEAST_FORCE}_{box}", LEAST_FORCE, lengths, box)
        if excess.min() > 1.0:
            peaks = np.array(peak_forces(least))
            if (peaks > limits).any():
                reason = f"no lengths within the bounds keep {words}"
                break
            smallest = values[:, np.argmin(excess)]
            ratios = np.where(smallest > limits, peaks / smallest, 1.0)
            forces = list(map(scaled, forces, ratios))
        searches = search(replace(region, constraints=(*region.constraints, *forces)))
        points = [point for each in searches for point in each.optima()]
        found = np.array([peak_forces(point) for point in points]) / limits  # (points, forces)
        if found.max() <= 1.0 + SLACK:
            return searches
        if found.max(axis=1).min() <= FORCE_TOLERANCE:  # the caller chooses among those
            feasible = searches
        forces = list(map(scaled, forces, np.maximum(found.max(axis=0), 1.0)))
    else:
        reason = f"the search found no optimum that keeps {words} in {ROUNDS} rounds"
    return feasible or replace(least, columns={"status": reason})
