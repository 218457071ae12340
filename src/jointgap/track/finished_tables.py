"""What a scenario's stages left to publish (tables, costs), and the questions that every stage asks of it."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap import tables
from jointgap.config import Scenario
from jointgap.core.errors import InputError
from jointgap.tables import Table
from jointgap.track.run_parameters import run_parameters
from jointgap.track.run_record import Dataset

TablePaths = Mapping[str, Path]
"""Parquet files by ``table`` or ``table/output``."""


@dataclass(frozen=True)
class FinishedTables:
    """One scenario's options, tables and costs."""

    options: Scenario
    sections: Mapping[str, Sequence[str]]  # The sections of a scenario that each stage reads
    tables: dict[str, Path]  # Parquet files by ``table`` or ``table/output``
    costs: dict[str, dict[str, float]]  # As `read_costs` gives them

    def has(self, table: Table) -> bool:
        """Whether any file of the table was given."""
        return bool(self.names(table))

    def names(self, table: Table) -> list[str]:
        """Names of the files of a table: its own, or one per output."""
        return [name for name in self.tables if name.partition("/")[0] == table.name]

    def read(self, table: Table) -> pd.DataFrame:
        """All files of a table, behind each other."""
        return pd.concat([tables.read(table, self.tables[name]) for name in self.names(table)], ignore_index=True)

    def datasets(self, inputs: list[str], results: list[str]) -> tuple[Dataset, ...]:
        """Those files that were given, by name, as what a run read (`inputs`) and what it wrote (`results`)."""
        return tuple(
            Dataset(name, self.tables[name], context)
            for context, names in (("input", inputs), ("result", results))
            for name in names
            if name in self.tables
        )

    def configuration(self, stage: str) -> dict[str, Any]:
        """Parameters, and the file of all options that the stage reads, as arguments of a record."""
        # the sections that tracking is not told of would show their defaults, not what was used
        sections = set(self.sections[stage]) & set(self.sections["track"]) - {"description"}
        text = self.options.model_dump_json(include=sections, indent=2) + "\n"
        parameters = run_parameters(self.options, window="optimise" in sections)
        return {"params": parameters, "files": {"options.json": text.encode()}}

    def cost(self, *names: str) -> dict[str, float]:
        """Cost of the jobs whose names start with one of `names`: seconds added up, largest peak of memory."""
        costs = [cost for job, cost in self.costs.items() if any(job == n or job.startswith(f"{n}/") for n in names)]
        total = {}
        for name, join in (("seconds", sum), ("peak_memory_mb", max)):
            values = [cost[name] for cost in costs if name in cost]
            if values:
                total[name] = join(values)
        return total


def read_costs(benchmarks: Sequence[Path]) -> dict[str, dict[str, float]]:
    """Seconds and peak memory by what was measured."""
    return {_job(path): _read_cost(path) for path in benchmarks}


def _job(path: Path) -> str:
    parts = path.with_suffix("").parts
    start = max((place + 1 for place, part in enumerate(parts) if part == "benchmarks"), default=len(parts) - 1)
    return "/".join(parts[start:])


def _read_cost(path: Path) -> dict[str, float]:
    try:
        with open(path, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file, delimiter="\t"))
        columns = {"seconds": "s", "peak_memory_mb": "max_rss"}
        measured = {name: [_measured(row[column]) for row in rows] for name, column in columns.items()}
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: is not a benchmark file of Snakemake ({error!r}); run its stage again") from error
    present = {name: [value for value in values if value is not None] for name, values in measured.items()}
    return {name: sum(values) / len(values) for name, values in present.items() if values}


def _measured(text: str) -> float | None:
    return None if text in ("NA", "-") else float(text)  # memory is not measured for jobs shorter than its interval
