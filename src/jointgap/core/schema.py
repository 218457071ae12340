"""Tables of the stages, defined in `schemas/*.yaml` of the package.

`from jointgap.core.schema import TRAJECTORY` gives the table of that name. Fast to import.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from jointgap.core.errors import InputError, did_you_mean

SCHEMAS = Path(__file__).parents[1] / "schemas"


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    unit: str  # SI unit, 'rad', '1' for pure numbers, '' for text
    description: str
    kind: str = "float"  # float, int, text, category (one of a few texts) or bool
    nullable: bool = False  # whether the quantity can be undefined


@dataclass(frozen=True)
class Table:
    """A table of a stage: its columns in the order of the file, and its path in a folder of
    results."""

    name: str
    description: str
    columns: tuple[Column, ...]
    path: str = ""

    @property
    def names(self) -> list[str]:
        return [column.name for column in self.columns]

    def at(self, part: str) -> "Table":
        """The same table of one `part`: an output, or one of several stages."""
        return replace(self, path=re.sub(r"{\w+}", part, self.path))

    def filled(self, **groups: Iterable[Column]) -> "Table":
        """The same table with columns that depend on the configuration in place of ``{group}``."""
        column_lists = (
            [column] if column.name[0] != "{" else groups[column.name[1:-1]]
            for column in self.columns
        )
        return replace(
            self, columns=tuple(column for columns in column_lists for column in columns)
        )


def _read() -> dict[str, Table]:
    tables = {}
    for file in sorted(SCHEMAS.glob("*.yaml")):
        for name, record in yaml.load(file.read_text(encoding="utf-8"), yaml.CSafeLoader).items():
            columns = tuple(_column(key, *row) for key, row in record["columns"].items())
            tables[name] = Table(name, record["description"], columns, record.get("path", ""))
    return tables


def _column(name: str, unit: str, description: str, kind: str = "float") -> Column:
    return Column(name, unit, description, kind.removesuffix(" or null"), kind.endswith(" or null"))


TABLES = _read()
"""All tables by name."""

globals().update({name.upper(): table for name, table in TABLES.items()})


def describe(name: str) -> tuple[str, list[tuple[str, ...]]]:
    """Title, and rows below their headings, for a table or a column; InputError for another
    name."""
    if name in TABLES:
        table = TABLES[name]
        place = f" ({table.path})" if table.path else ""
        columns = [(column.name, column.unit, column.description) for column in table.columns]
        return f"{table.description}{place}", [("column", "unit", "description"), *columns]
    rows = [
        (table.name, column.unit, column.description)
        for table in TABLES.values()
        for column in table.columns
        if column.name == name
    ]
    if not rows:
        names = {*TABLES, *(column.name for table in TABLES.values() for column in table.columns)}
        hint = did_you_mean(name, names)
        if hint.startswith("known here"):
            hint = "give a Parquet file or a name of docs/reference/tables.md"
        raise InputError(f"'{name}': no such file, table or column; {hint}")
    return f"column {name}", [("table", "unit", "description"), *rows]
