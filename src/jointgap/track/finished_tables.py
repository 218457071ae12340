"""What was given to publish, and the questions that every stage asks of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap import tables
from jointgap.config import Scenario
from jointgap.config.scenario import SECTIONS
from jointgap.tables import Table
from jointgap.track.run_record import Dataset, flatten

Tables = Mapping[str, Path]


@dataclass(frozen=True)
class Given:
    """One scenario's options, tables and costs.

    Attributes
    ----------
    options : Scenario
    tables : dict of str to Path
        Parquet files by ``table`` or ``table/output``.
    costs : dict of str to dict of str to float
        As `read_costs` gives them.
    """

    options: Scenario
    tables: dict[str, Path]
    costs: dict[str, dict[str, float]]

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
        """The named files, those that were given, as what a run read and what it wrote."""
        return tuple(
            Dataset(name, self.tables[name], context)
            for context, names in (("input", inputs), ("result", results))
            for name in names
            if name in self.tables
        )

    def configuration(self, stage: str) -> dict[str, Any]:
        """Parameters and the file of the options that the stage reads, as arguments of a record."""
        # the sections that tracking is not told of would show their defaults, not what was used
        sections = set(SECTIONS[stage]) & set(SECTIONS["track"]) - {"description"}
        read = self.options.model_dump(mode="json", include=sections)
        # each joint carries its contact; listed by name they would give every scenario parameters of its own
        read["mechanism"].pop("contacts", None)
        text = self.options.model_dump_json(include=sections, indent=2) + "\n"
        return {"params": flatten(read), "files": {"options.json": text.encode()}}

    def cost(self, *names: str) -> dict[str, float]:
        """Cost of the jobs whose names start with one of `names`: seconds added up, largest peak of memory."""
        costs = [cost for job, cost in self.costs.items() if any(job == n or job.startswith(f"{n}/") for n in names)]
        total = {}
        for name, join in (("seconds", sum), ("peak_memory_mb", max)):
            values = [cost[name] for cost in costs if name in cost]
            if values:
                total[name] = join(values)
        return total
