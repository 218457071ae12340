"""The stage optimise: problem, search, optima, re-simulation, tables."""

from collections.abc import Mapping
from functools import cache

import pandas as pd

from jointgap.config import Mechanism, Optimise, Simulate
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.lengths import tables
from jointgap.lengths.force_limit import search_under_force_limits
from jointgap.lengths.objective import GOALS, Objective, evaluation_samples, frozen_objective
from jointgap.lengths.region import regions
from jointgap.lengths.resimulate import Resimulation, resimulate
from jointgap.lengths.search import Point, search_all
from jointgap.lengths.surface import simulated_objectives, simulated_surface
from jointgap.motion.kinematics import Fit, clearance_lift
from jointgap.paper.printed import OPTIMA, departures

DIGITS = 6  # lengths are simulated again to the micrometre; equal points once

Surrogates = Mapping[str, Mapping[str, Fit]]
"""Fits of the clearance motion, by name of the surrogate and column of the trajectory."""


def frozen_objectives(
    mechanism: Mechanism,
    samples: dict,
    trajectory: pd.DataFrame,
    surrogates: Surrogates,
) -> dict[str, Objective]:
    """Equation (12) by source of the frozen clearance motion.

    The surrogates and ``simulation`` refer to the configured window of the first revolution,
    without training points; ``simulation_settled`` to a whole settled revolution.
    """
    numbers = [JOINT_NUMBERS[joint] for joint in mechanism.loose]
    names = [f"{quantity}{number}" for number in numbers for quantity in ("r", "gamma")]
    angle = trajectory["crank_angle"].to_numpy()
    window, settled = samples["window"], samples["settled"]
    motions = {
        source: (window, {name: fits[name](angle[window])[0] for name in names})
        for source, fits in surrogates.items()
    }
    for source, rows in (("simulation", window), ("simulation_settled", settled)):
        motions[source] = rows, {name: trajectory[name].to_numpy()[rows] for name in names}
    return {
        source: frozen_objective(mechanism, angle[rows], clearance_lift(vectors))
        for source, (rows, vectors) in motions.items()
    }


def optimise(
    mechanism: Mechanism,
    simulate: Simulate,
    options: Optimise,
    training_points: int,
    trajectory: pd.DataFrame,
    surrogates: Surrogates,
) -> dict[str, pd.DataFrame]:
    """Optimise the lengths for every source in every box, and simulate the optima again.

    The result has the tables optimise_... by name.
    """
    samples = evaluation_samples(simulate, options, training_points)
    objectives = frozen = frozen_objectives(mechanism, samples, trajectory, surrogates)
    lengths = mechanism.crank.length, mechanism.rod.length
    points = [Point("original", "original", lengths)]
    if GOALS[options.objective].load is not None:
        objectives = simulated_objectives(
            mechanism, simulate, options, frozen["simulation_settled"]
        )
    elif not departures(mechanism, simulate):
        points += [
            Point(printed.key, "printed", (printed.crank_length, printed.rod_length))
            for printed in OPTIMA
        ]

    @cache
    def at_lengths(*lengths: float) -> Resimulation:
        return resimulate(mechanism, simulate, options, training_points, lengths)

    def again(point: Point) -> Resimulation:
        return at_lengths(*(round(length, DIGITS) for length in point.lengths))

    boxes, searches = regions(mechanism, options), []
    limit = options.constraints.largest_pin_force
    if limit is None:
        searches = search_all(objectives, boxes, options)
    for box, region in boxes.items() if limit else ():
        surface = simulated_surface(mechanism, simulate, options, region, "largest_pin_force")
        result = search_under_force_limits(
            [surface.limited(limit)],
            region,
            box,
            lambda limited, box=box: search_all(objectives, {box: limited}, options),
            lambda point: [again(point).peak_pin_force],
        )
        if isinstance(result, Point):
            points.append(result)
        else:
            searches += result
    points += [point for search in searches for point in search.optima()]
    ensembles = {point.name: again(point) for point in points}
    rows_of_searches = {
        "optimise_population": lambda search: search.genetic.history,
        "optimise_paths": tables.local_paths,
        "optimise_tolerance": lambda search: tables.local_ends(search, options),
        "optimise_valley": lambda search: tables.valley(search.objective, search.region),
        "optimise_floor": lambda search: tables.valley_floor(search.objective, search.region),
    }
    return {
        "optimise_optima": tables.optima(objectives, points),
        "optimise_resimulated": tables.resimulated(points, ensembles, objectives, frozen),
        "optimise_worth": tables.cycle_extremes(ensembles, mechanism.slider.offset),
        "optimise_loads": tables.loads(ensembles),
    } | {name: tables.by_search(name, searches, rows) for name, rows in rows_of_searches.items()}
