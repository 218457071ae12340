"""Sweeps and robust lengths: one run for all designs of a scenario, not one a design.

What stands before the last slash of a metric's name is the section in which the interface shows it. Units are those in
which people read, for the interface rounds to two decimals.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config import Scenario
from jointgap.config.sweep_config import Values
from jointgap.designs.design_of_experiments import designs_of
from jointgap.designs.designs_to_parquet import check_dataset
from jointgap.report.plain_words import reading_unit
from jointgap.tables import (
    ROBUST_CANDIDATES,
    ROBUST_CONSTRAINTS,
    ROBUST_FRESH_PATH,
    ROBUST_GAINS,
    ROBUST_LENGTHS,
    SENSITIVITY_INDICES,
    SENSITIVITY_SURROGATES,
    SENSITIVITY_TABLES,
    Table,
    robust_fresh,
)
from jointgap.tables.columns import Column
from jointgap.tables.sweep_tables import MEASURES
from jointgap.track.finished_tables import read_costs
from jointgap.track.run_parameters import run_parameters
from jointgap.track.run_record import Dataset, Record

DESIGNS = Path("sweep/designs")
"""Folder of the dataset in that of a scenario."""

_SENSITIVITY = {table.name: Path(table.path) for table in SENSITIVITY_TABLES}
_ROBUST = {
    table.name: Path(table.path) for table in (ROBUST_LENGTHS, ROBUST_GAINS, ROBUST_CONSTRAINTS, ROBUST_CANDIDATES)
} | {robust_fresh(()).name: Path(ROBUST_FRESH_PATH)}
_SHOWN = (".md", ".html", ".svg", ".png")
_QUANTILES = {"smallest": 0.0, "quantile_05": 0.05, "median": 0.5, "quantile_95": 0.95, "largest": 1.0}
_OF_A_PARAMETER = {"clearance": "clearance_mm", "speed": "speed_rpm"}
"""What a run's parameter is called that one of a sweep takes the place of, where the names differ."""
_LONGEST_TEXT = 500
"""Signs of a parameter's list of values; the whole list stands in the file of options."""


def sweep_record(options: Scenario, folder: Path) -> Record:
    """The run of a scenario's sweep, with what decides and with its robust lengths where the scenario asks for these.

    Parameters
    ----------
    options : Scenario
        With the section sweep, the section optimise_robust, or both.
    folder : Path
        Of the scenario's results.

    Raises
    ------
    InputError
        A table is missing or cannot be read, or the dataset is not the one that the options ask for.
    """
    params, metrics, datasets, shown = run_parameters(options), {}, [], []
    if options.sweep.parameters:
        designs = designs_of(options)
        check_dataset(designs, folder / DESIGNS)
        for key in options.sweep.parameters:
            params.pop(_OF_A_PARAMETER.get(key, key), None)
        params |= {"design": designs.kind, "seed": str(designs.seed)} | _varied("sweep", options.sweep.parameters)
        metrics |= _measured(folder / DESIGNS)
        datasets.append(Dataset("sweep_designs", folder / DESIGNS, "result"))
        shown.append("sweep")
        if options.sensitivity is not None:
            metrics |= _decides(folder)
            datasets += [Dataset(name, folder / path, "result") for name, path in _SENSITIVITY.items()]
            shown.append("sensitivity")
    if options.optimise_robust.uncertain:
        params |= _varied("uncertain", options.optimise_robust.uncertain)
        metrics |= dict(_robust(folder))
        datasets += [Dataset(name, folder / path, "result") for name, path in _ROBUST.items()]
        shown.append("optimise_robust")
    return Record(
        "sweep",
        params=params,
        metrics=metrics,
        datasets=tuple(datasets),
        files={"options.json": _options(options)} | _pages(folder, shown),
        costs=_costs(folder),
    )


def _options(options: Scenario) -> bytes:
    sections = options.model_fields_set - {"description"}
    return (options.model_dump_json(include=sections, by_alias=True, indent=2) + "\n").encode()


def _varied(what: str, parameters: Mapping[str, Any]) -> dict[str, str]:
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


def _measured(dataset: Path) -> dict[str, float]:
    """How many designs there are and failed, and of each measure mean, deviation and quantiles."""
    reasons = tables.read_columns(dataset, ["reason"])["reason"]
    failed = len(reasons) - reasons.null_count
    metrics = {"designs": len(reasons), "failed": failed, "failed_percent": 100 * failed / len(reasons)}
    for column in MEASURES:
        values = tables.read_columns(dataset, [column.name])[column.name].to_numpy()
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        name, factor = _name_and_factor(column)
        values = factor * values
        sizes = {"mean": values.mean(), "deviation": values.std(), "counted": len(values)}
        sizes |= dict(zip(_QUANTILES, np.quantile(values, tuple(_QUANTILES.values())), strict=True))
        metrics |= {f"{name}/{size}": value for size, value in sizes.items()}
    return metrics


def _name_and_factor(column: Column) -> tuple[str, float]:
    """Name of a metric, with the unit behind it, and how many of these one SI unit is."""
    unit, factor = reading_unit(column.unit)
    ending = re.sub(r"[*/]", "_", unit).replace("^", "")
    return (column.name if ending in ("1", "") else f"{column.name}_{ending}"), factor


def _decides(folder: Path) -> dict[str, float]:
    """Held-out error of each measure's surrogate, and its indices where it has some, with their intervals."""
    metrics = {}
    for row in _rows(SENSITIVITY_SURROGATES, folder):
        metrics |= {f"q2/{row['measure']}{end}": row[f"q2{end}"] for end in ("", "_low", "_high")}
    for row in _rows(SENSITIVITY_INDICES, folder):
        metrics |= {
            f"{index}/{row['measure']}/{row['parameter']}{end}": row[f"{index}{end}"]
            for index in ("first_order", "total")
            for end in ("", "_low", "_high")
        }
    return {name: value for name, value in metrics.items() if pd.notna(value)}


def _robust(folder: Path) -> Iterator[tuple[str, float]]:
    """Lengths side by side, whether a change is a gain, and how often constraints hold, with their intervals."""
    for row in _rows(ROBUST_LENGTHS, folder):
        yield from _numbers(ROBUST_LENGTHS, row, row["lengths"])
    for row in _rows(ROBUST_GAINS, folder):
        yield from _numbers(ROBUST_GAINS, row, f"{row['lengths']} beside {row['beside']}")
    for row in _rows(ROBUST_CONSTRAINTS, folder):
        yield from _numbers(ROBUST_CONSTRAINTS, row, f"{row['lengths']} keeps {row['constraint']}")


def _numbers(table: Table, row: Mapping[str, Any], section: str) -> Iterator[tuple[str, float]]:
    """The numbers of a row, shares in percent."""
    for column in table.columns:
        if column.kind == "int":
            yield f"{section}/{column.name}", row[column.name]
        elif column.kind == "float" and column.unit == "1":
            yield f"{section}/{column.name}_percent", 100 * row[column.name]
        elif column.kind == "float":
            name, factor = _name_and_factor(column)
            yield f"{section}/{name}", factor * row[column.name]


def _rows(table: Table, folder: Path) -> list[dict]:
    return tables.read(table, folder / table.path).to_dict("records")


def _pages(folder: Path, shown: Iterable[str]) -> dict[str, Path]:
    """Pages and figures, by their place in the scenario's folder."""
    found = (path for part in shown for path in sorted((folder / part).rglob("*")) if path.suffix in _SHOWN)
    return {str(path.relative_to(folder)): path for path in found}


def _costs(folder: Path) -> dict[str, float]:
    """What the search for robust lengths cost."""
    costs = read_costs([path for path in [folder / "benchmarks/optimise_robust.tsv"] if path.is_file()])
    return {f"optimise_robust_{name}": value for cost in costs.values() for name, value in cost.items()}
