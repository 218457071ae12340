"""The stage optimise: from the sources of the motion to its tables."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Optimise, Simulate
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.words import number
from jointgap.dynamics.kinematics import Fit, clearance_lift, ideal_cycle
from jointgap.lengths.objective import (
    Objective,
    SimulatedObjective,
    best_cranks,
    frozen_objective,
    grid,
)
from jointgap.lengths.region import FORCE_TOLERANCE, LEAST_FORCE, Region, regions
from jointgap.lengths.resimulate import (
    SIZES,
    Resimulation,
    compare,
    peak_pin_force,
    pin_force,
    resimulate,
    sample_ranges,
    spread,
    surface,
)
from jointgap.lengths.search import (
    Point,
    Search,
    labelled,
    optima,
    paths,
    printed_points,
    search_all,
    tolerances,
)

FORCE_ROUNDS = (
    4  # largest number of searches until the re-simulated lengths satisfy the force limit
)
FORCE_SLACK = 1e-3  # relative excess of the force limit up to which the search is not repeated

DIGITS = 6  # lengths are simulated again to the micrometre; equal points once


@dataclass(frozen=True)
class Optimisation:
    """Results of the stage: a frame for each table optimise_..., columns in
    `jointgap.core.schema`."""

    optima: pd.DataFrame
    population: pd.DataFrame
    paths: pd.DataFrame
    tolerance: pd.DataFrame
    valley: pd.DataFrame
    floor: pd.DataFrame
    resimulated: pd.DataFrame
    worth: pd.DataFrame
    loads: pd.DataFrame


def objectives(
    mechanism: Mechanism,
    simulate: Simulate,
    options: Optimise,
    training_points: int,
    trajectory: pd.DataFrame,
    surrogates: Mapping[str, Mapping[str, Fit]],
) -> dict[str, Objective]:
    """Equation (12) by source of the frozen clearance motion.

    The surrogates and ``simulation`` refer to the configured window of the first revolution,
    without training points; ``simulation_settled`` to a whole settled revolution.
    """
    window, settled = sample_ranges(simulate, options, training_points).values()
    names = [
        f"{name}{JOINT_NUMBERS[joint]}" for joint in mechanism.loose for name in ("r", "gamma")
    ]
    angle, motion = (
        trajectory["crank_angle"].to_numpy(),
        {name: trajectory[name].to_numpy() for name in names},
    )
    lift = clearance_lift(motion)
    lifts = {
        source: (window, clearance_lift({name: fits[name](angle[window])[0] for name in names}))
        for source, fits in surrogates.items()
    }
    lifts |= {"simulation": (window, lift[window]), "simulation_settled": (settled, lift[settled])}
    return {
        source: frozen_objective(mechanism, angle[samples], own)
        for source, (samples, own) in lifts.items()
    }


def optimise(
    mechanism: Mechanism,
    simulate: Simulate,
    options: Optimise,
    training_points: int,
    trajectory: pd.DataFrame,
    surrogates: Mapping[str, Mapping[str, Fit]],
) -> Optimisation:
    """Optimise the lengths for every source in every box, and simulate the optima again."""
    frozen = objectives(mechanism, simulate, options, training_points, trajectory, surrogates)
    original, by_source = (
        Point("original", "original", (mechanism.crank.length, mechanism.rod.length)),
        frozen,
    )
    fixed = [original, *printed_points(mechanism, simulate)]
    if options.objective in SIZES:
        fixed = [original]
        by_source = simulated_objectives(mechanism, simulate, options, frozen["simulation_settled"])

    @cache
    def at_lengths(lengths: tuple[float, ...]) -> Resimulation:
        return resimulate(mechanism, simulate, options, training_points, lengths)

    def again(point: Point) -> Resimulation:
        return at_lengths(tuple(round(length, DIGITS) for length in point.lengths))

    searches, unmet = _searched(mechanism, simulate, options, by_source, again)
    fixed += unmet
    points = [*fixed, *(point for search in searches for point, _ in search.found)]
    simulated = {point.name: again(point) for point in points}
    used = dict.fromkeys((point.name for point in fixed), next(iter(by_source.values())))
    used |= {point.name: search.objective for search in searches for point, _ in search.found}
    return Optimisation(
        optima=optima(by_source, searches, fixed, options.rod_tolerance),
        population=labelled("population", searches, lambda search: search.genetic.population),
        paths=labelled("paths", searches, paths),
        tolerance=labelled("tolerance", searches, lambda search: tolerances(search, options)),
        valley=labelled("valley", searches, lambda search: grid(search.objective, search.region)),
        floor=labelled(
            "floor", searches, lambda search: best_cranks(search.objective, search.region)
        ),
        resimulated=_resimulated(simulated, frozen, used, options.ensemble.members),
        worth=_cycle_extremes(simulated, mechanism.slider.offset),
        loads=_loads(simulated),
    )


def simulated_objectives(
    mechanism: Mechanism, simulate: Simulate, options: Optimise, angle: Objective
) -> dict[str, Objective]:
    """The configured force or torque over all boxes, with ideal joints and with clearance, by
    source.

    `angle` is the error of the transmission angle.
    """
    joints = {
        name: mechanism.joint(name).model_copy(update={"loose": False}) for name in mechanism.loose
    }
    ideal = mechanism.model_copy(update={"joints": mechanism.joints.model_copy(update=joints)})
    boxes = regions(mechanism, options).values()
    lower, upper = (
        np.min([box.lower for box in boxes], axis=0),
        np.max([box.upper for box in boxes], axis=0),
    )
    if upper[0] + abs(mechanism.slider.offset) >= lower[1]:
        raise InputError(
            f"optimise.boxes: {options.objective} is simulated over all boxes together, where a"
            f" crank of {1e3 * upper[0]:g} mm cannot turn with a rod of {1e3 * lower[1]:g} mm;"
            " optimise in one box at a time"
        )
    given = simulate, options, Region(lower, upper, 1.0), SIZES[options.objective]
    surfaces = {
        "ideal_joints": surface(ideal, *given),
        "with_clearance": surface(mechanism, *given),
    }
    return {
        source: SimulatedObjective(**vars(angle), name=options.objective, surface=found)
        for source, found in surfaces.items()
    }


def _searched(
    mechanism: Mechanism,
    simulate: Simulate,
    options: Optimise,
    by_source: dict[str, Objective],
    again: Callable[[Point], Resimulation],
) -> tuple[list[Search], list[Point]]:
    """The searches under all constraints, and for each box without an optimum the lengths with the
    smallest force."""
    boxes, searches, unmet = regions(mechanism, options), [], []
    if options.constraints.largest_pin_force is None:
        return search_all(by_source, boxes, options), []
    for box, region in boxes.items():
        found = _search_under_force(mechanism, simulate, options, by_source, again, (box, region))
        if isinstance(found, Point):
            unmet.append(found)
        else:
            searches += found
    return searches, unmet


def _search_under_force(
    mechanism: Mechanism,
    simulate: Simulate,
    options: Optimise,
    by_source: dict[str, Objective],
    again: Callable[[Point], Resimulation],
    where: tuple[str, Region],
) -> list[Search] | Point:
    """The searches in a box under the force limit; without a search, the lengths with the smallest
    force where these exceed it.

    Where re-simulated lengths have another force than the surface, the surface is scaled to it and
    the search repeated.
    """
    (box, region), most = where, options.constraints.largest_pin_force
    surface, within = pin_force(mechanism, simulate, options, region), []
    for _ in range(FORCE_ROUNDS):
        forces = surface.value(region.samples)
        crank, rod = map(float, region.samples[np.argmin(forces)])
        nearest = Point(f"{LEAST_FORCE}_{box}", LEAST_FORCE, (crank, rod), box)
        if (least := float(forces.min())) > most:
            force = peak_pin_force(again(nearest))
            if force > most:
                status = f"no lengths within the bounds keep the pin force below {number(most)} N"
                return within or replace(nearest, status=status)
            surface = replace(surface, factor=surface.factor * force / least)
        limited = replace(region, constraints=(*region.constraints, surface.limited(most)))
        searches = search_all(by_source, {box: limited}, options)
        peaks = [peak_pin_force(again(point)) for search in searches for point, _ in search.found]
        if max(peaks) <= (1.0 + FORCE_SLACK) * most:
            return searches
        if min(peaks) <= FORCE_TOLERANCE * most:  # `outcome` chooses among those
            within = searches
        surface = replace(surface, factor=surface.factor * max(peaks) / most)
    if within:
        return within
    status = (
        f"the search found no lengths that keep the pin force below {number(most)} N in"
        f" {FORCE_ROUNDS} rounds"
    )
    return replace(nearest, status=status)


def _resimulated(
    simulated: dict[str, Resimulation],
    frozen: dict[str, Objective],
    used: dict[str, Objective],
    members: int,
) -> pd.DataFrame:
    """The table optimise_resimulated; `used` has the objective that a point was found with."""
    sources = {"window": frozen["simulation"], "settled": frozen["simulation_settled"]}
    rows = []
    for name, ensemble in simulated.items():
        estimates = {
            key: objective.reductions(ensemble.lengths)._asdict()
            for key, objective in sources.items()
        }
        if isinstance(own := used[name], SimulatedObjective):
            estimates["settled"][own.name] = 1.0 - own.value(ensemble.lengths) / own.value(
                own.original
            )
        for row in compare(ensemble, simulated["original"]):
            estimate = {"frozen_reduction": float(estimates[row["stretch"]][row["measure"]])}
            rows.append(_point(name, ensemble) | row | estimate | {"members": members})
    return pd.DataFrame(rows)


def _point(name: str, ensemble: Resimulation) -> dict[str, object]:
    return {"point": name, "crank_length": ensemble.lengths[0], "rod_length": ensemble.lengths[1]}


def _loads(simulated: dict[str, Resimulation]) -> pd.DataFrame:
    """The table optimise_loads."""
    rows = []
    for name, ensemble in simulated.items():
        for joint, load in ensemble.loads.items():
            row = _point(name, ensemble) | {"joint": joint}
            middle = np.argsort(load["peak_force"], kind="stable")[len(load["peak_force"]) // 2]
            for key, values in load.items():
                row |= {key: float(values[middle])} if key == "peak_angle" else spread(key, values)
            rows.append(row)
    return pd.DataFrame(rows)


def _cycle_extremes(simulated: dict[str, Resimulation], offset: float) -> pd.DataFrame:
    """The table optimise_worth."""
    rows = []
    keys = ("largest_departure", "outer_dead_centre", "inner_dead_centre")
    for name, ensemble in simulated.items():
        ideal = ideal_cycle(*ensemble.lengths, offset)
        for cycle, source in (("ideal", ideal), ("simulated", ensemble)):
            extremes = {key: float(np.median(getattr(source, key))) for key in keys}
            rows.append(_point(name, ensemble) | {"cycle": cycle} | extremes)
    frame = pd.DataFrame(rows)
    frame["smallest_transmission_angle"] = np.pi / 2 - frame["largest_departure"]
    frame["stroke"] = frame["outer_dead_centre"] - frame["inner_dead_centre"]
    for column in (
        "smallest_transmission_angle",
        "stroke",
        "outer_dead_centre",
        "inner_dead_centre",
    ):
        original = frame["cycle"].map(
            frame[frame["point"] == "original"].set_index("cycle")[column]
        )
        frame[f"{column}_change"] = frame[column] - original
    return frame
