"""Optimisation: a run for the scenario with its main optimum, and under it one for each pair of lengths found.

What stands before the slash of a metric's name is the section in which the interface shows it. Reductions are in
percent, for the interface rounds to two decimals.
"""

import numpy as np
import pandas as pd

from jointgap.tables.optimise_tables import (
    FLOOR,
    LOADS,
    OPTIMA,
    PATHS,
    POPULATION,
    RESIMULATED,
    TOLERANCE,
    VALLEY,
    WORTH,
)
from jointgap.tables.surrogate_tables import CLEARANCE_FIT, FIT
from jointgap.track.finished_tables import FinishedTables
from jointgap.track.run_record import Curve, Record

MEASURES = ("rms", "mean_absolute", "peak", "sum_of_squares")
STRETCHES = {"window": "window", "settled": "revolution"}
ENDS = ("", "_low", "_high")
"""Of the names of gains: over what, and of its spread the median and both ends."""
_COUNTS = ("evaluations", "evaluations_within_1_percent", "evaluations_within_0_1_percent")
_ANGLES = ("smallest_transmission_angle", "largest_departure")
_WAYS = ("stroke", "outer_dead_centre", "inner_dead_centre")


def optimise_records(finished: FinishedTables) -> list[Record]:
    """The scenario's run, then its nested ones."""
    if not finished.has(OPTIMA):
        return []
    optima = finished.read(OPTIMA)
    searched = optima[[_is_of_its_source(row) for row in optima.to_dict("records")]]
    if searched.empty:
        return []
    configuration = finished.configuration("optimise")
    shared = {"params": configuration["params"], "files": configuration["files"]}
    nested = [_point(finished, row) for row in searched.to_dict("records")]
    main = nested[_main(finished, searched)]
    names = [name for table in _TABLES for name in finished.names(table)]
    scenario_run = Record(
        "optimise",
        metrics=main.metrics,
        curves=main.curves,
        datasets=finished.datasets(["trajectory", *finished.names(FIT), *finished.names(CLEARANCE_FIT)], names),
        costs=finished.cost("optimise"),
        notes=main.notes,
        **shared,
    )
    return [scenario_run, *nested]


_TABLES = (OPTIMA, RESIMULATED, WORTH, LOADS, POPULATION, PATHS, TOLERANCE, VALLEY, FLOOR)


def _is_of_its_source(row: dict) -> bool:
    """Whether the row shows a point under the source that it was found with."""
    return row["point"] == f"{row['source']}_{row['box']}_{row['method']}"


def _main(finished: FinishedTables, searched: pd.DataFrame) -> int:
    """The paper's way: networks, the main box, the genetic algorithm. Else the first."""
    box = next(iter(finished.options.optimise.boxes))
    wanted = searched["source"].str.startswith("network") & (searched["box"] == box) & (searched["method"] == "genetic")
    return int(np.argmax(wanted.to_numpy()))


def _point(finished: FinishedTables, row: dict) -> Record:
    metrics = {
        "crank_length_mm": 1e3 * row["crank_length"],
        "rod_length_mm": 1e3 * row["rod_length"],
        **_changes(finished, row),
        "ratio": row["ratio"],
        "invariant_mm": 1e3 * row["invariant"],
        **{name: row[name] for name in _COUNTS if pd.notna(row[name])},
        **{f"frozen/{measure}_reduction_percent": 100 * row[f"{measure}_reduction"] for measure in MEASURES},
        **_sizes(row),
        **_gains(finished, row["point"]),
        **_resimulated(finished, row["point"]),
        **_machine_metrics(finished, row["point"]),
    }
    notes = {name: row[name] or "" for name in ("point", "source", "box", "method", "active_bounds", "status")}
    curve = _curve(finished, row)
    return Record(
        "optimise",
        row["point"],
        metrics=metrics,
        curves={} if curve is None else {"sum_of_squares_rad2": curve},
        params=finished.configuration("optimise")["params"],
        notes=notes,
    )


def _changes(finished: FinishedTables, row: dict) -> dict[str, float]:
    """The lengths as differences from the original ones: of one part in a thousand the interface shows no digit."""
    mechanism = finished.options.mechanism.applied()
    original = {"crank": mechanism.crank.length, "rod": mechanism.rod.length}
    return {
        f"{link}_length_change_um": round(1e6 * (row[f"{link}_length"] - length), 3)
        for link, length in original.items()
    }


def _sizes(row: dict) -> dict[str, float]:
    """The errors themselves: angles in degrees, the sum of squares as equation (12) has it."""
    angles = {f"frozen/{measure}_deg": np.rad2deg(row[measure]) for measure in MEASURES[:3]}
    return angles | {"frozen/sum_of_squares_rad2": row["sum_of_squares"]}


def _gains(finished: FinishedTables, point: str) -> dict[str, float]:
    """What comes out: the reduction of the RMS error, simulated again, with its spread; the interface shows the
    beginning of a name and every digit of a number.
    """
    if not finished.has(RESIMULATED):
        return {}
    rows = finished.read(RESIMULATED)
    rows = rows[(rows["point"] == point) & (rows["measure"] == "rms")]
    return {
        f"gain_{STRETCHES[row['stretch']]}{end}_percent": round(100 * row[f"reduction{end}"], 4)
        for row in rows.to_dict("records")
        for end in ENDS
    }


def _resimulated(finished: FinishedTables, point: str) -> dict[str, float]:
    """True reductions with their spread, and errors, over both stretches."""
    if not finished.has(RESIMULATED):
        return {}
    rows = finished.read(RESIMULATED)
    metrics = {}
    for row in rows[rows["point"] == point].to_dict("records"):
        name = f"resimulated_{row['stretch']}/{row['measure']}"
        metrics |= {
            f"{name}_reduction_percent": 100 * row["reduction"],
            f"{name}_reduction_low_percent": 100 * row["reduction_low"],
            f"{name}_reduction_high_percent": 100 * row["reduction_high"],
            f"{name}_reduction_if_frozen_percent": 100 * row["frozen_reduction"],
            f"{name}_share_better": row["share_better"],
        }
        angle = row["measure"] != "sum_of_squares"
        for error in ("error", "original_error"):
            metrics[f"{name}_{error}_{'deg' if angle else 'rad2'}"] = np.rad2deg(row[error]) if angle else row[error]
    return metrics


def _machine_metrics(finished: FinishedTables, point: str) -> dict[str, float]:
    """What the lengths mean for the machine."""
    if not finished.has(WORTH):
        return {}
    rows = finished.read(WORTH)
    metrics = {}
    for row in rows[rows["point"] == point].to_dict("records"):
        metrics |= {f"{row['cycle']}_cycle/{name}_deg": np.rad2deg(row[name]) for name in _ANGLES}
        metrics |= {f"{row['cycle']}_cycle/{name}_change_mm": 1e3 * row[f"{name}_change"] for name in _WAYS}
    return metrics


def _curve(finished: FinishedTables, row: dict) -> Curve | None:
    """The objective on the way: the best of each generation, or along the path of the best start."""
    table, step = {"genetic": (POPULATION, "generation"), "local": (PATHS, "iteration")}[row["method"]]
    if not finished.has(table):
        return None
    rows = finished.read(table)
    rows = rows[(rows["source"] == row["source"]) & (rows["box"] == row["box"])]
    if row["method"] == "local":
        ends = rows.sort_values("iteration").groupby("start")["sum_of_squares"].last()
        rows = rows[rows["start"] == ends.idxmin()]
    lowest = rows.groupby(step, sort=True)["sum_of_squares"].min()
    return Curve(lowest.index.to_numpy(), lowest.to_numpy())
