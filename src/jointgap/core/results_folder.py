"""A folder of results, of a scenario or of a campaign: tables read from and written to their places."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd

from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.core.files import check_writable
from jointgap.core.schema import Table

Frames = dict[str, pd.DataFrame]
"""Frames of several tables, by name."""


class ResultsFolder:
    """Tables in one folder.

    A table is given as such or by its name; `part` is the output, or the one of several stages, that it belongs to.
    """

    def __init__(self, path: Path, places: Mapping[str, Path] | None = None):
        self.path = path
        self._places = dict(places or {})

    def place(self, table: Table | str, part: str = "") -> Path:
        """Where `table` lies, that of `part` where there are several."""
        table = _table(table)
        return self._places.get(table.name, self.path / table.at(part).path)

    def read(self, table: Table | str, part: str = "") -> pd.DataFrame:
        """The frame of `table`, that of `part` where there are several; errors as `parquet.read`."""
        return parquet.read(_table(table), self.place(table, part))

    def write(self, table: Table | str, frame: pd.DataFrame, part: str = "") -> None:
        """Write the `frame` of `table`, that of `part` where there are several; errors as `parquet.write`."""
        parquet.write(_table(table), frame, self.place(table, part))

    def read_all(self, wanted: Iterable[Table | str], part: str = "") -> Frames:
        """Frames of the tables `wanted` by name, those of `part` where there are several."""
        return {_table(table).name: self.read(table, part) for table in wanted}

    def write_all(self, frames: Frames, part: str = "") -> None:
        """Write `frames`, which stand by the names of their tables, as those of `part` where there are several."""
        for name, frame in frames.items():
            self.write(name, frame, part)

    def check_writable(self, *paths: str) -> None:
        """Make sure that files of the folder can be written, before hours of work; errors as
        `parquet.check_writable`.
        """
        check_writable(*(self.path / path for path in paths))

    def check_apart(self, inputs: Iterable[Path | str], written: Iterable[str]) -> None:
        """Make sure that no result is written over what it is made from."""
        results = {(self.path / place).resolve() for place in written}
        for path in inputs:
            if Path(path).resolve() in results:
                raise InputError(
                    f"{path}: is read by the campaign, and a result of it would be written there; copy the file "
                    "elsewhere and name the copy, or give another --folder"
                )


def _table(table: Table | str) -> Table:
    return schema.TABLES[table] if isinstance(table, str) else table
