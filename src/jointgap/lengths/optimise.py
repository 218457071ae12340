"""The stage optimise: sources in, tables out."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Optimise, Simulate
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.dynamics.kinematics import Fit, clearance_lift, ideal_cycle
from jointgap.lengths import search as searching
from jointgap.lengths.objective import Objective, frozen_objective
from jointgap.lengths.region import PinForce, Region
from jointgap.lengths.region import regions as geometric_regions
from jointgap.lengths.resimulate import (
    Resimulation,
    Spread,
    compare,
    peak_pin_force,
    pin_force,
    resimulate,
    sample_ranges,
)
from jointgap.lengths.search import Point, Search, printed_points

FORCE_ROUNDS = 4  # searches at most until the lengths found keep the largest force of a pin once simulated again
FORCE_SLACK = 1e-3  # share of the force by which it may be exceeded

DIGITS = 6  # lengths are simulated again to the micrometre; points that agree so far are simulated once


@dataclass(frozen=True)
class Optimisation:
    """What the stage finds: a frame for each table optimise_..., columns in `jointgap.core.schema`."""

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

    The surrogates and ``simulation`` over the configured window of the first revolution, on samples that are no
    training points; ``simulation_settled`` over a whole settled revolution.
    """
    samples = sample_ranges(simulate, options, training_points)
    coordinates = [f"{name}{JOINT_NUMBERS[joint]}" for joint in mechanism.loose for name in ("r", "gamma")]
    angle = trajectory["crank_angle"].to_numpy()
    window, settled = samples["window"], samples["settled"]
    by_source = {}
    for name, fits in surrogates.items():
        lift = clearance_lift({name: fits[name](angle[window])[0] for name in coordinates})
        by_source[name] = frozen_objective(mechanism, angle[window], lift)
    lift = clearance_lift({name: trajectory[name].to_numpy() for name in coordinates})
    by_source["simulation"] = frozen_objective(mechanism, angle[window], lift[window])
    by_source["simulation_settled"] = frozen_objective(mechanism, angle[settled], lift[settled])
    return by_source


def optimise(
    mechanism: Mechanism,
    simulate: Simulate,
    options: Optimise,
    training_points: int,
    trajectory: pd.DataFrame,
    surrogates: Mapping[str, Mapping[str, Fit]],
) -> Optimisation:
    """Search the lengths for every source in every box, and simulate again what was found."""
    by_source = objectives(mechanism, simulate, options, training_points, trajectory, surrogates)
    printed = printed_points(mechanism, simulate)
    fixed = [Point("original", "original", (mechanism.crank.length, mechanism.rod.length)), *printed]
    again = _Simulations(mechanism, simulate, options, training_points)
    searches = _searched(by_source, again, options)
    valley, floor = searching.valleys(searches)
    resimulations = again.of([*fixed, *(point for search in searches for point in search.points)])
    return Optimisation(
        optima=searching.optima(by_source, searches, printed, options.rod_tolerance),
        population=searching.populations(searches),
        paths=searching.paths(searches),
        tolerance=searching.tolerances(searches),
        valley=valley,
        floor=floor,
        resimulated=_resimulated(resimulations, by_source, options.ensemble.members),
        worth=_cycle_extremes(resimulations, mechanism.slider.offset),
        loads=_loads(resimulations),
    )


class _Simulations:
    """Ensembles at pairs of lengths, each simulated once. Arguments as of `resimulate`."""

    def __init__(self, mechanism: Mechanism, simulate: Simulate, options: Optimise, training_points: int):
        self.arguments = mechanism, simulate, options, training_points
        self.by_lengths: dict[tuple[float, ...], Resimulation] = {}

    def at(self, point: Point) -> Resimulation:
        lengths = _rounded(point)
        if lengths not in self.by_lengths:
            self.by_lengths[lengths] = resimulate(*self.arguments, lengths)
        return self.by_lengths[lengths]

    def of(self, points: list[Point]) -> dict[str, Resimulation]:
        """By the points' names, in their order."""
        return {point.name: self.at(point) for point in points}


def _searched(by_source: dict[str, Objective], again: _Simulations, options: Optimise) -> list[Search]:
    """The search under all constraints.

    Where the lengths found carry more than the largest force asked for, once simulated again, the surface that stands
    for the force in the search is raised by as much, and the search is repeated.
    """
    mechanism, simulate, *_ = again.arguments
    regions = geometric_regions(mechanism, options)
    most = options.constraints.largest_pin_force
    if most is None:
        return searching.search_all(by_source, regions, options)
    surfaces = {box: pin_force(mechanism, simulate, options, region) for box, region in regions.items()}
    for _ in range(FORCE_ROUNDS):
        under = {box: _under_force(region, surfaces[box], most) for box, region in regions.items()}
        searches = searching.search_all(by_source, under, options)
        raised = False
        for box, surface in surfaces.items():
            points = [point for search in searches if search.box == box for point in search.points]
            excess = max(peak_pin_force(again.at(point)) for point in points) / most
            if 1.0 + FORCE_SLACK < excess and not under[box].constraints[-1].is_relaxed:
                surfaces[box], raised = surface.raised(excess), True
        if not raised:
            break
    return searches


def _under_force(region: Region, surface: PinForce, most: float) -> Region:
    """The region with a largest force, or with the smallest that there is where that is more."""
    constraint = surface.limited(most)
    least = float(constraint.value(region.lowest(constraint)))
    nearest = constraint if least <= most else surface.limited((1.0 + FORCE_SLACK) * least, is_relaxed=True)
    return replace(region, constraints=(*region.constraints, nearest))


def _rounded(point: Point) -> tuple[float, ...]:
    return tuple(round(length, DIGITS) for length in point.lengths)


def _resimulated(resimulations: dict[str, Resimulation], by_source: dict[str, Objective], members: int) -> pd.DataFrame:
    """Frame of the table optimise_resimulated."""
    frozen = {"window": by_source["simulation"], "settled": by_source["simulation_settled"]}
    rows = []
    for name, ensemble in resimulations.items():
        crank, rod = ensemble.lengths
        reductions = {key: objective.reductions(ensemble.lengths) for key, objective in frozen.items()}
        for row in compare(ensemble, resimulations["original"]):
            reduction = float(getattr(reductions[row["stretch"]], row["measure"]))
            keys = {"point": name, "crank_length": crank, "rod_length": rod}
            rows.append(keys | row | {"frozen_reduction": reduction, "members": members})
    return pd.DataFrame(rows)


def _loads(resimulations: dict[str, Resimulation]) -> pd.DataFrame:
    """Frame of the table optimise_loads."""
    rows = []
    for name, ensemble in resimulations.items():
        crank, rod = ensemble.lengths
        for joint, load in ensemble.loads.items():
            row = {"point": name, "crank_length": crank, "rod_length": rod, "joint": joint}
            for key, values in vars(load).items():
                spread = Spread(np.nan, np.nan, np.nan) if values is None else Spread.of(values)
                row |= {key: spread.median, f"{key}_low": spread.low, f"{key}_high": spread.high}
            rows.append(row)
    return pd.DataFrame(rows)


def _cycle_extremes(resimulations: dict[str, Resimulation], offset: float) -> pd.DataFrame:
    """Frame of the table optimise_worth."""
    rows = []
    for name, ensemble in resimulations.items():
        ideal = ideal_cycle(*ensemble.lengths, offset)
        cycles = {
            "ideal": (ideal.largest_departure, ideal.outer_dead_centre, ideal.inner_dead_centre),
            "simulated": tuple(
                float(np.median(values))
                for values in (ensemble.largest_departure, ensemble.outer_dead_centre, ensemble.inner_dead_centre)
            ),
        }
        for cycle, (departure, outer, inner) in cycles.items():
            rows.append(
                {
                    "point": name,
                    "crank_length": ensemble.lengths[0],
                    "rod_length": ensemble.lengths[1],
                    "cycle": cycle,
                    "smallest_transmission_angle": np.pi / 2 - departure,
                    "largest_departure": departure,
                    "stroke": outer - inner,
                    "outer_dead_centre": outer,
                    "inner_dead_centre": inner,
                }
            )
    frame = pd.DataFrame(rows)
    for column in ("smallest_transmission_angle", "stroke", "outer_dead_centre", "inner_dead_centre"):
        original = frame["cycle"].map(frame[frame["point"] == "original"].set_index("cycle")[column])
        frame[f"{column}_change"] = frame[column] - original
    return frame
