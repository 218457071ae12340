"""Search under a limit of the pin force, which depends on the motion at the new lengths."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from jointgap.config import Mechanism, Optimise, Simulate
from jointgap.core.words import number
from jointgap.lengths.objective import Objective
from jointgap.lengths.region import FORCE_TOLERANCE, LEAST_FORCE, Region
from jointgap.lengths.search import Point, Search, search_all
from jointgap.lengths.surface import simulated_surface

ROUNDS = 4  # largest number of searches until the re-simulated lengths satisfy the limit
SLACK = 1e-3  # relative excess of the limit up to which the search is not repeated


def search_under_force_limit(
    mechanism: Mechanism,
    simulate: Simulate,
    options: Optimise,
    objectives: dict[str, Objective],
    peak_force: Callable[[Point], float],
    box: str,
    region: Region,
) -> list[Search] | Point:
    """The searches in a box; without an optimum, the lengths with the smallest force.

    Where re-simulated lengths have another force than the surface, the surface is scaled to it and
    the search repeated. `peak_force` simulates a point again.
    """
    limit, feasible = options.constraints.largest_pin_force, []
    surface = simulated_surface(mechanism, simulate, options, region, "largest_pin_force")
    for _ in range(ROUNDS):
        forces = surface.value(region.samples)
        lengths = tuple(map(float, region.samples[np.argmin(forces)]))
        least = Point(f"{LEAST_FORCE}_{box}", LEAST_FORCE, lengths, box)
        if forces.min() > limit:
            force = peak_force(least)
            if force > limit:
                reason = f"no lengths within the bounds keep the pin force below {number(limit)} N"
                break
            surface = replace(surface, factor=surface.factor * force / float(forces.min()))
        constraints = (*region.constraints, surface.limited(limit))
        searches = search_all(objectives, {box: replace(region, constraints=constraints)}, options)
        peaks = [peak_force(point) for search in searches for point in search.optima()]
        if max(peaks) <= (1.0 + SLACK) * limit:
            return searches
        if min(peaks) <= FORCE_TOLERANCE * limit:  # `outcome` chooses among those
            feasible = searches
        surface = replace(surface, factor=surface.factor * max(peaks) / limit)
    else:
        reason = (
            f"the search found no lengths that keep the pin force below {number(limit)} N in"
            f" {ROUNDS} rounds"
        )
    return feasible or replace(least, columns={"status": reason})
