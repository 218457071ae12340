"""What each stage of many designs adds to the run of its scenario: a function per stage, None where it asks for none.

What stands before the last slash of a metric's name is the section in which the interface shows it. Units are those in
which people read, for the interface rounds to two decimals.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config import Scenario
from jointgap.config.sweep_config import Values
from jointgap.designs.run import check_dataset
from jointgap.designs.sampling import Designs, designs_of
from jointgap.tables import (
    COMPARE_SEARCHES_BREAK_EVEN,
    COMPARE_SEARCHES_OPTIMA,
    COMPARE_SEARCHES_PROGRESS,
    COMPARE_SEARCHES_SUMMARY,
    COMPARE_SEARCHES_WANTED,
    DESIGN_NETWORKS_COSTS,
    DESIGN_NETWORKS_ERRORS,
    DESIGN_NETWORKS_TRAINING,
    DESIGN_NETWORKS_WEIGHTS,
    INFERRED_DESIGNS_PATH,
    INFERRED_SETTINGS,
    ROBUST_CANDIDATES,
    ROBUST_CONSTRAINTS,
    ROBUST_FRESH_PATH,
    ROBUST_GAINS,
    ROBUST_LENGTHS,
    SENSITIVITY_INDICES,
    SENSITIVITY_SURROGATES,
    SENSITIVITY_TABLES,
    Table,
    inferred_designs,
    robust_fresh,
)
from jointgap.track.metric_names import MDEG, name_and_factor

DESIGNS = Path("sweep/designs")
"""Folder of the dataset in that of a scenario."""

_QUANTILES = {"smallest": 0.0, "quantile_05": 0.05, "median": 0.5, "quantile_95": 0.95, "largest": 1.0}
_ENDS = ("", "_low", "_high")
_LONGEST_TEXT = 500
"""Signs of a parameter's list of values; the whole list stands in the file of options."""


@dataclass(frozen=True)
class Part:
    """What a stage adds to the run."""

    tables: Mapping[str, Path]  # Its tables by name, with their places in the scenario's folder
    metrics: Mapping[str, float]  # Its main numbers, as its page names them
    params: Mapping[str, str] = field(default_factory=dict)  # What it was asked
    varied: Iterable[str] = ()  # Parameters that it gives many values


def _of_sweep(options: Scenario, folder: Path) -> Part | None:
    """How many designs there are and failed, and of each measure mean, deviation and quantiles."""
    asked = options.sweep.parameters
    if not asked:
        return None
    designs = designs_of(options)
    check_dataset(designs, folder / DESIGNS)
    params = {"design": designs.kind, "seed": str(designs.seed)} | _laws("sweep", asked)
    return Part({"sweep_designs": DESIGNS}, _measured(designs, folder / DESIGNS), params, asked)


def _of_sensitivity(options: Scenario, folder: Path) -> Part | None:
    """Held-out quality of each measure's surrogate, and its indices where it has some, with their intervals."""
    if options.sensitivity is None or not options.sweep.parameters:
        return None
    metrics = {}
    for row in _rows(SENSITIVITY_SURROGATES, folder):
        metrics |= {f"q2/{row['measure']}{end}": row[f"q2{end}"] for end in _ENDS}
    for row in _rows(SENSITIVITY_INDICES, folder):
        metrics |= {
            f"{index}/{row['measure']} by {row['parameter']}{end}": row[f"{index}{end}"]
            for index in ("first_order", "total")
            for end in _ENDS
        }
    return Part(_places(*SENSITIVITY_TABLES), {name: value for name, value in metrics.items() if pd.notna(value)})


def _of_infer_settings(options: Scenario, folder: Path) -> Part | None:
    """For how many designs the paper's printed numbers come out, alone and together, and how near."""
    asked = options.infer_settings
    if asked is None:
        return None
    from jointgap.designs.infer_settings import NUMBERS, departures

    names = ["together", "farthest", *(one.column for one in NUMBERS)]
    designs = tables.read_columns(folder / INFERRED_DESIGNS_PATH, names).to_pandas()
    metrics = {
        "printed/together_percent": 100 * designs["together"].mean(),
        "printed/farthest_off_in_nearest_percent": 100 * designs["farthest"].min(),
    }
    shares = (departures(designs) <= asked.within).mean(axis=0)
    metrics |= {f"printed/{one.column}_percent": 100 * share for one, share in zip(NUMBERS, shares, strict=True)}
    places = _places(INFERRED_SETTINGS) | {inferred_designs(()).name: Path(INFERRED_DESIGNS_PATH)}
    return Part(places, metrics, {"infer_settings/within_percent": f"{100 * asked.within:g}"})


def _of_optimise_robust(options: Scenario, folder: Path) -> Part | None:
    """Lengths side by side, whether a change is a gain, and how often constraints hold, with their intervals."""
    uncertain = options.optimise_robust.uncertain
    if not uncertain:
        return None
    metrics = {}
    for row in _rows(ROBUST_LENGTHS, folder):
        metrics |= _numbers(ROBUST_LENGTHS, row, row["lengths"])
    for row in _rows(ROBUST_GAINS, folder):
        metrics |= _numbers(ROBUST_GAINS, row, f"{row['lengths']} beside {row['beside']}")
    for row in _rows(ROBUST_CONSTRAINTS, folder):
        metrics |= _numbers(ROBUST_CONSTRAINTS, row, f"{row['lengths']} keeps {row['constraint']}")
    places = _places(ROBUST_LENGTHS, ROBUST_GAINS, ROBUST_CONSTRAINTS, ROBUST_CANDIDATES)
    places[robust_fresh(()).name] = Path(ROBUST_FRESH_PATH)
    return Part(places, metrics, _laws("uncertain", uncertain))


def _of_design_networks(options: Scenario, folder: Path) -> Part | None:
    """What network and frozen motion miss of each output on held-out designs (RMS), and what the network cost."""
    asked = options.design_networks.parameters
    if not asked:
        return None
    from jointgap.design_networks.held_out_errors import ERROR

    metrics = {}
    errors = pd.DataFrame(_rows(DESIGN_NETWORKS_ERRORS, folder))
    for (output, unit), rows in errors.groupby(["output", "unit"]):
        ending, factor = {"m": ("um", 1e6), "rad": ("mdeg", MDEG)}[unit]
        for way, words in {"network": "network", "frozen": "frozen motion"}.items():
            name = f"{words} misses/{output.replace(' ', '_')}_{ending}"
            metrics[name] = factor * np.sqrt(np.mean(rows[way] ** 2))
    rows = errors[errors["output"] == ERROR]
    nearer = 100 * (rows["network"].abs() < rows["frozen"].abs()).mean()
    metrics["network beside frozen motion/nearer_in_designs_percent"] = nearer
    for row in _rows(DESIGN_NETWORKS_COSTS, folder):
        metrics[f"network/{row['step']}_cpu_time_s"] = row["cpu_time"]
    places = _places(DESIGN_NETWORKS_ERRORS, DESIGN_NETWORKS_COSTS, DESIGN_NETWORKS_TRAINING, DESIGN_NETWORKS_WEIGHTS)
    return Part(places, metrics, _laws("design_networks", asked), asked)


def _of_compare_searches(options: Scenario, folder: Path) -> Part | None:
    """Gain, CPU time and missed error of each way at each budget, and from which cost of a simulation on it pays to
    learn first.
    """
    asked = options.compare_searches
    if asked is None:
        return None
    from jointgap.length_searches.break_even import pays_from
    from jointgap.length_searches.compare_searches import FROZEN, NETWORKS, SIMULATION, SURROGATE

    metrics = {}
    for row in _rows(COMPARE_SEARCHES_SUMMARY, folder):
        way = row["way"] if pd.isna(row["budget"]) else f"{row['way']}_{row['budget']:g}s"
        metrics |= {f"gain_percent{end}/{way}": 100 * row[f"gain{end}"] for end in _ENDS}
        metrics[f"cpu_time_s/{way}"] = row["cpu_time"]
        metrics[f"missed_mdeg/{way}"] = MDEG * row["missed"]
    break_even = pd.DataFrame(_rows(COMPARE_SEARCHES_BREAK_EVEN, folder))
    for way in (NETWORKS, SURROGATE):
        for against in (SIMULATION, FROZEN):
            costs = pays_from(break_even, way, against, asked.optima)
            if costs is not None:
                name = f"pays_from_ms_of_a_simulation/{way}_against_{against}"
                metrics[name] = 1e3 * costs.mean()
    params = {
        "compare_searches/optima": str(asked.optima),
        "compare_searches/budgets_s": ", ".join(f"{budget:g}" for budget in asked.budgets),
        "compare_searches/repetitions": str(asked.repetitions),
    }
    places = _places(
        COMPARE_SEARCHES_SUMMARY,
        COMPARE_SEARCHES_OPTIMA,
        COMPARE_SEARCHES_WANTED,
        COMPARE_SEARCHES_PROGRESS,
        COMPARE_SEARCHES_BREAK_EVEN,
    )
    return Part(places, metrics, params)


PARTS: dict[str, Callable[[Scenario, Path], Part | None]] = {
    "sweep": _of_sweep,
    "sensitivity": _of_sensitivity,
    "infer_settings": _of_infer_settings,
    "optimise_robust": _of_optimise_robust,
    "design_networks": _of_design_networks,
    "compare_searches": _of_compare_searches,
}
"""By the folder in which a stage's pages and figures lie: what it adds, of a scenario and the folder of its results;
errors as of `jointgap.tables.read`, or that the dataset is not the one that the scenario asks for.
"""


def _laws(what: str, parameters: Mapping[str, Any]) -> dict[str, str]:
    """Each parameter with its distribution, as ``sweep/friction``: ``uniform, from 0, to 0.2``."""
    texts = {}
    for key, law in parameters.items():
        given = law.model_dump(by_alias=True, exclude_none=True)
        if isinstance(law, Values):
            text = ", ".join(map(str, law.values))
        else:
            text = ", ".join([given.pop("distribution"), *(f"{name} {value}" for name, value in given.items())])
        texts[f"{what}/{key}"] = text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]} ..."
    return texts


def _measured(designs: Designs, dataset: Path) -> dict[str, float]:
    reasons = tables.read_columns(dataset, ["reason"])["reason"]
    failed = len(reasons) - reasons.null_count
    metrics = {"designs": len(reasons), "failed": failed, "failed_percent": 100 * failed / len(reasons)}
    for column in designs.measured:
        values = tables.read_columns(dataset, [column.name])[column.name].to_numpy()
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        name, factor = name_and_factor(column)
        values = factor * values
        sizes = {"mean": values.mean(), "deviation": values.std(), "counted": len(values)}
        sizes |= dict(zip(_QUANTILES, np.quantile(values, tuple(_QUANTILES.values())), strict=True))
        metrics |= {f"{name}/{size}": value for size, value in sizes.items()}
    return metrics


def _numbers(table: Table, row: Mapping[str, Any], section: str) -> Iterator[tuple[str, float]]:
    """The numbers of a row, shares in percent."""
    for column in table.columns:
        if column.kind == "int":
            yield f"{section}/{column.name}", row[column.name]
        elif column.kind == "float" and column.unit == "1":
            yield f"{section}/{column.name}_percent", 100 * row[column.name]
        elif column.kind == "float":
            name, factor = name_and_factor(column)
            yield f"{section}/{name}", factor * row[column.name]


def _rows(table: Table, folder: Path) -> list[dict]:
    return tables.read(table, folder / table.path).to_dict("records")


def _places(*of: Table) -> dict[str, Path]:
    return {table.name: Path(table.path) for table in of}
