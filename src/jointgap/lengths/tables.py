"""The tables optimise_... from searches and re-simulated lengths."""

from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import brentq, minimize_scalar

from jointgap.config import Optimise
from jointgap.core.schema import TABLES
from jointgap.lengths.objective import MEASURES, Objective
from jointgap.lengths.region import Region
from jointgap.lengths.resimulate import Resimulation
from jointgap.lengths.search import Point, Search, search_from_all
from jointgap.lengths.surface import SimulatedObjective
from jointgap.motion.kinematics import ideal_cycle

CRANK_LENGTHS, ROD_LENGTHS = 61, 37  # grid points: every 0.1 mm by 0.25 mm in the paper's box
_LARGEST_DEVIATION = 0.01  # examined, as a share of the rod's length
_COUNTS = ("evaluations", "evaluations_within_1_percent", "evaluations_within_0_1_percent")

Ensembles = dict[str, Resimulation]
"""By name of the point, the original lengths included."""


def by_search(
    table: str, searches: list[Search], rows: Callable[[Search], pd.DataFrame]
) -> pd.DataFrame:
    """A `table`: `rows(search)` of every search below each other, with source and box."""
    frames = [rows(search).assign(source=search.source, box=search.box) for search in searches]
    if not frames:
        return pd.DataFrame(columns=TABLES[table].names)
    return pd.concat(frames, ignore_index=True)


def local_paths(search: Search) -> pd.DataFrame:
    """Rows of the table optimise_paths."""
    frames = [result.history.assign(start=start) for start, result in enumerate(search.local)]
    return pd.concat(frames)


def local_ends(search: Search, options: Optimise) -> pd.DataFrame:
    """Rows of the table optimise_tolerance."""
    ends = {options.local_tolerance: search.local}
    for tolerance in options.further_tolerances:
        ends[tolerance] = search_from_all(search.objective, search.region, tolerance)
    rows = [
        {
            "tolerance": tolerance,
            "start": start,
            "crank_length": result.lengths[0],
            "rod_length": result.lengths[1],
            "objective": result.value,
            "rms_reduction": float(search.objective.reductions(result.lengths).rms),
            "evaluations": len(result.values),
            "converged": result.converged,
        }
        for tolerance in sorted(ends, reverse=True)
        for start, result in enumerate(ends[tolerance])
    ]
    return pd.DataFrame(rows)


# -- the objective over the lengths


def valley(objective: Objective, region: Region) -> pd.DataFrame:
    """Rows of the table optimise_valley: the objective over the box."""
    cranks, rods = map(np.linspace, region.lower, region.upper, (CRANK_LENGTHS, ROD_LENGTHS))
    frames = []
    for rod in rods:
        lengths = np.column_stack([cranks, np.full(CRANK_LENGTHS, rod)])
        columns = {
            "crank_length": cranks,
            "rod_length": rod,
            "allowed": region.contains(lengths, slack=1e-12),
            "objective": objective.value(lengths),
            "rms": objective.measures(lengths).rms,
        }
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames)


def valley_floor(objective: Objective, region: Region) -> pd.DataFrame:
    """Rows of the table optimise_floor: the best crank length for each rod length and measure.

    For the transmission angle regardless of the crank's bounds and the inequality; for another
    objective within the crank lengths that the constraints allow.
    """
    rods = np.linspace(region.lower[1], region.upper[1], ROD_LENGTHS)
    if isinstance(objective, SimulatedObjective):  # has many minima
        allowed = region.samples[:, 0]
        cranks = np.linspace(allowed.min(), allowed.max(), CRANK_LENGTHS)
        values = objective.value(np.stack(np.meshgrid(cranks, rods), axis=-1))
        best_cranks = {objective.name: cranks[np.argmin(values, axis=1)]}
    else:
        best_cranks = {
            name: np.array([_best_crank(objective, region, rod, name) for rod in rods])
            for name in MEASURES[:3]
        }
        best_cranks["sum_of_squares"] = best_cranks["rms"]  # a monotonic function of it
    frames = []
    for name, cranks in best_cranks.items():
        size = size_of(objective, name)
        values = np.array([size(lengths) for lengths in zip(cranks, rods, strict=True)])
        columns = {
            "measure": name,
            "crank_length": cranks,
            "rod_length": rods,
            "ratio": cranks / rods,
            "value": values,
            "reduction": 1.0 - values / size(objective.original),
        }
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames)


def size_of(objective: Objective, name: str) -> Callable[[ArrayLike], float]:
    """A measure, or the simulated force or torque, as a function of the lengths (2,)."""
    if name not in MEASURES:
        return lambda lengths: float(objective.value(lengths))
    return lambda lengths: float(getattr(objective.measures(lengths), name))


def _best_crank(objective: Objective, region: Region, rod_length: float, name: str) -> float:
    """Crank length with the smallest measure; a norm of an error almost affine in L2 has one
    minimum."""
    size = size_of(objective, name)
    result = minimize_scalar(
        lambda crank: size((crank, rod_length)),
        bounds=(region.lower[0] - region.size[0], region.upper[0] + region.size[0]),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return float(result.x)


# -- points


def optima(objectives: dict[str, Objective], points: list[Point]) -> pd.DataFrame:
    """The table optimise_optima: for each source its optima, and the points of no search."""
    rows, blank = [], dict.fromkeys(("active_bounds", *_COUNTS, "status"))
    for source, objective in objectives.items():
        for point in points:
            if point.source not in (None, source):
                continue
            (crank, rod), value = point.lengths, float(objective.value(point.lengths))
            reductions = objective.reductions(point.lengths)
            row = {
                "source": source,
                "point": point.name,
                "box": point.box,
                "method": point.method,
                "crank_length": crank,
                "rod_length": rod,
                "ratio": crank / rod,
                "objective": value,
                "objective_reduction": 1.0 - value / float(objective.value(objective.original)),
                "rod_deviation_allowed": allowed_deviation(objective, point.lengths),
                "invariant": (1.0 - reductions.rms) * rod,
            }
            row |= objective.measures(point.lengths)._asdict()
            row |= {f"{name}_reduction": size for name, size in reductions._asdict().items()}
            rows.append(row | blank | point.columns)
    return pd.DataFrame(rows).astype(dict.fromkeys(_COUNTS, "Int64"))


def allowed_deviation(objective: Objective, lengths: tuple[float, float]) -> float:
    """How much longer or shorter the rod may be [m] until nothing is gained."""
    crank, rod = lengths
    size = size_of(objective, getattr(objective, "name", "rms"))

    def excess(deviation: float) -> float:
        sizes = [size((crank, rod + sign * deviation)) for sign in (-1, 1)]
        return max(sizes) - size(objective.original)

    largest = _LARGEST_DEVIATION * rod
    if excess(0.0) >= 0.0:
        return 0.0
    return largest if excess(largest) <= 0.0 else brentq(excess, 0.0, largest)


# -- re-simulated points


def spread(key: str, values: ArrayLike) -> dict[str, float]:
    """Median and the 5 % and 95 % quantiles of an ensemble's values, as columns of a table."""
    low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
    return {key: float(median), f"{key}_low": float(low), f"{key}_high": float(high)}


def _lengths_of(point: str, ensemble: Resimulation) -> dict[str, object]:
    crank, rod = ensemble.lengths
    return {"point": point, "crank_length": crank, "rod_length": rod}


def resimulated(
    points: list[Point],
    ensembles: Ensembles,
    objectives: dict[str, Objective],
    frozen: dict[str, Objective],
) -> pd.DataFrame:
    """The table optimise_resimulated; `objectives` are those of the search."""
    rows, sources = [], {"window": "simulation", "settled": "simulation_settled"}
    for point in points:
        ensemble = ensembles[point.name]
        estimates = {
            (stretch, name): float(reduction)
            for stretch, source in sources.items()
            for name, reduction in frozen[source].reductions(ensemble.lengths)._asdict().items()
        }
        objective = objectives.get(point.source, next(iter(objectives.values())))
        if isinstance(objective, SimulatedObjective):
            value = size_of(objective, objective.name)
            reduction = 1.0 - value(ensemble.lengths) / value(objective.original)
            estimates["settled", objective.name] = reduction
        for (stretch, name), sizes in ensemble.sizes.items():
            original = ensembles["original"].sizes[stretch, name]
            pairs = 1.0 - np.divide.outer(sizes, original)  # each member with each original one
            rows.append(
                _lengths_of(point.name, ensemble)
                | {"stretch": stretch, "measure": name, "members": len(sizes)}
                | {"frozen_reduction": estimates[stretch, name]}
                | {"share_better": float(np.mean(pairs > 0.0))}
                | spread("original_error", original)
                | spread("error", sizes)
                | spread("reduction", pairs)
            )
    return pd.DataFrame(rows)


def loads(ensembles: Ensembles) -> pd.DataFrame:
    """The table optimise_loads."""
    rows = []
    for point, ensemble in ensembles.items():
        for joint, load in ensemble.loads.items():
            ranked = np.argsort(load["peak_force"], kind="stable")
            row = _lengths_of(point, ensemble) | {"joint": joint}
            row["peak_angle"] = load["peak_angle"][ranked[len(ranked) // 2]]
            for key in ("peak_force", "rms_force", "contact_share"):
                row |= spread(key, load[key])
            rows.append(row)
    return pd.DataFrame(rows)


def cycle_extremes(ensembles: Ensembles, offset: float) -> pd.DataFrame:
    """The table optimise_worth."""
    rows = []
    for point, ensemble in ensembles.items():
        ideal = vars(ideal_cycle(*ensemble.lengths, offset))
        for cycle, extremes in (("ideal", ideal), ("simulated", ensemble.extremes)):
            medians = {key: float(np.median(extremes[key])) for key in ensemble.extremes}
            rows.append(_lengths_of(point, ensemble) | {"cycle": cycle} | medians)
    frame = pd.DataFrame(rows)
    frame["smallest_transmission_angle"] = np.pi / 2 - frame["largest_departure"]
    frame["stroke"] = frame["outer_dead_centre"] - frame["inner_dead_centre"]
    keys = ["smallest_transmission_angle", "stroke", "outer_dead_centre", "inner_dead_centre"]
    original = frame[frame["point"] == "original"].set_index("cycle")[keys]
    changes = frame[keys] - original.loc[frame["cycle"]].to_numpy()
    return frame.join(changes.add_suffix("_change"))
