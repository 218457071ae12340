"""A folder of results of a scenario or of a campaign."""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.core.files import check_writable
from jointgap.core.schema import Table

Frames = dict[str, pd.DataFrame]
"""Frames of several tables, by name."""


class ResultsFolder:
    """Reads and writes the tables in one folder.

    Tables are given as such or by name; `part` is an output, or one of several stages, of a divided
    table.
    """

    def __init__(self, path: Path):
        self.path = path

    def place(self, table: Table | str, part: str = "") -> Path:
        """Path of `table` (of its `part`)."""
        return self.path / _table(table).at(part).path

    def read(self, table: Table | str, part: str = "") -> pd.DataFrame:
        """The frame of `table` (of its `part`); errors as `parquet.read`."""
        return parquet.read(_table(table), self.place(table, part))

    def write(self, table: Table | str, frame: pd.DataFrame, part: str = "") -> None:
        """Write the `frame` of `table` (of its `part`); errors as `parquet.write`."""
        parquet.write(_table(table), frame, self.place(table, part))

    def read_all(self, tables: Iterable[Table | str], part: str = "") -> Frames:
        """Frames of the tables `wanted` by name."""
        return {_table(table).name: self.read(table, part) for table in tables}

    def write_all(self, frames: Frames, part: str = "") -> None:
        """Write `frames` by the names of their tables."""
        for name, frame in frames.items():
            self.write(name, frame, part)

    def check_writable(self, *paths: str) -> None:
        """InputError, before long computations, where files of the folder cannot be written."""
        check_writable(*(self.path / path for path in paths))

    def located(self, error: InputError) -> InputError:
        """The `error` of a stage, with the file that it is in."""
        return error

    def check_apart(self, inputs: Iterable[Path | str], written: Iterable[str]) -> None:
        """InputError where a result would overwrite an input."""
        results = {(self.path / place).resolve() for place in written}
        for path in inputs:
            if Path(path).resolve() in results:
                raise InputError(
                    f"{path}: is an input of the campaign and would be overwritten by a result;"
                    " copy the file elsewhere and give the path of the copy, or give another"
                    " --folder"
                )


def _table(table: Table | str) -> Table:
    return schema.TABLES[table] if isinstance(table, str) else table
