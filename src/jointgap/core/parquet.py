"""Tables in Parquet files."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.files import (  # noqa: F401 re-exported
    check_writable,
    write_atomically,
    write_text,
)
from jointgap.core.schema import Table

_TYPES = {
    "float": pa.float64(),
    "int": pa.int64(),
    "text": pa.string(),
    "category": pa.dictionary(pa.int8(), pa.string()),
    "bool": pa.bool_(),
}


_PANDAS = "PANDAS_ATTRS"  # where pandas writes the attrs of a frame


def schema(table: Table) -> pa.Schema:
    """The Arrow schema of a table, with unit and description of each column, and name and
    description of the table.

    The units are also stored where ``pandas.read_parquet`` finds them.
    """
    units = json.dumps({"units": {column.name: column.unit for column in table.columns}})
    return pa.schema(
        [
            pa.field(
                column.name,
                _TYPES[column.kind],
                column.nullable,
                {"unit": column.unit, "description": column.description},
            )
            for column in table.columns
        ],
        {"jointgap_table": table.name, "description": table.description, _PANDAS: units},
    )


writer = partial(pq.ParquetWriter, write_page_checksum=True)
"""A writer of a Parquet file of a schema."""

_read_checked = partial(pq.read_table, page_checksum_verification=True)


def to_arrow(table: Table, frame: pd.DataFrame) -> pa.Table:
    """`frame` as an Arrow table with exactly the columns of `table`."""
    names = table.names
    if sorted(frame.columns) != sorted(names):
        missing, extra = sorted({*names} - {*frame}), sorted({*frame} - {*names})
        raise ValueError(f"table {table.name}: missing columns {missing}, unknown columns {extra}")
    for column in table.columns:
        if (
            column.kind == "float"
            and np.isinf(frame[column.name].to_numpy(dtype=float, na_value=np.nan)).any()
        ):
            raise ValueError(f"table {table.name}: column {column.name} contains an infinite value")
    columns = schema(table)
    arrow = pa.Table.from_pandas(frame[names], columns, preserve_index=False)
    return arrow.replace_schema_metadata(columns.metadata)


def write(
    table: Table, frame: pd.DataFrame, path: Path | str, metadata: Mapping[str, str] | None = None
) -> None:
    """Write `frame` with the columns of `table` to `path`, with unit and description of each
    column.

    `metadata` is additional metadata.
    """
    arrow = to_arrow(table, frame)
    arrow = arrow.replace_schema_metadata({**arrow.schema.metadata, **(metadata or {})})
    floats = [column.name for column in table.columns if column.kind == "float"]
    options = {
        "compression": "zstd",
        "use_dictionary": [name for name in table.names if name not in floats],
        "use_byte_stream_split": floats,
        "write_page_checksum": True,
    }
    write_atomically(path, lambda file: pq.write_table(arrow, file, **options))


def read(table: Table, path: Path | str) -> pd.DataFrame:
    """The frame in a file that `write` made of a `table`; null becomes NaN (None in text)."""
    arrow = _open(_read_checked, path, f"run the stage that writes table '{table.name}'")
    held = _word((arrow.schema.metadata or {}).get(b"jointgap_table", b"?"))
    if held != table.name:
        raise InputError(
            f"{path}: contains table '{held}', not '{table.name}'; give the right file, or run its"
            " stage again"
        )
    stored = [(field.name, field.type) for field in arrow.schema]
    expected = [(field.name, field.type) for field in schema(table)]
    if stored != expected:
        differ = sorted({f"{name} ({kind})" for name, kind in set(stored) ^ set(expected)})
        raise InputError(
            f"{path}: table '{held}' has other columns than in this version"
            f" ({', '.join(differ) or 'order'}); run its stage again"
        )
    return arrow.to_pandas()


def _open(
    reader: Callable[[Path | str], Any], path: Path | str, fix: str = "check the path"
) -> Any:
    """`reader(path)`; InputError where the file is missing, not Parquet, or damaged."""
    try:
        return reader(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; {fix}") from error
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read as Parquet ({error}); give a Parquet file, or run its stage"
            " again"
        ) from error


def read_table(path: Path | str) -> pd.DataFrame:
    """Read a Parquet file, of jointgap or another program, with the units of its columns.

    Parameters
    ----------
    path : Path or str
        A file such as ``results/paper/simulate/trajectory.parquet``.

    Returns
    -------
    pandas.DataFrame
        In SI units (``frame.attrs["units"]`` by column, empty if the file has none); null is NaN,
        None in text.

    Raises
    ------
    InputError
        No such file, not Parquet, or damaged.

    Examples
    --------
    >>> import jointgap as jg
    >>> runs = jg.read_table("results/sweep/runs.parquet")
    >>> runs.attrs["units"]["clearance"]
    'm'
    """
    arrow = _open(_read_checked, path)
    frame = arrow.to_pandas()
    frame.attrs["units"] = _units(arrow.schema)
    return frame


def _units(arrow: pa.Schema) -> dict[str, str]:
    """Units by column, also of a file that pandas wrote."""
    try:
        pandas_units = dict(json.loads((arrow.metadata or {})[_PANDAS.encode()])["units"])
    except (KeyError, TypeError, ValueError):  # not there, or of another program
        pandas_units = {}
    return {
        field.name: _word((field.metadata or {}).get(b"unit", b""))
        or str(pandas_units.get(field.name, ""))
        for field in arrow
    }


def with_units(table: Table, frame: pd.DataFrame) -> pd.DataFrame:
    """A `frame` of `table` with the units of its columns in ``attrs["units"]``, as `read_table`."""
    frame.attrs["units"] = {column.name: column.unit for column in table.columns}
    return frame


def unit_in(units: Mapping[str, str], column: str) -> str:
    """The unit of a `column` in `units` by column; InputError for an unknown column."""
    if column not in units:
        raise InputError(f"no column '{column}'; {did_you_mean(column, units)}")
    return units[column]


def read_footer(path: Path | str) -> pq.FileMetaData:
    """Metadata of a Parquet file: schema and number of rows; errors as `describe`."""
    return _open(pq.read_metadata, path)


def batches(path: Path | str) -> Iterator[pd.DataFrame]:
    """The rows of any Parquet file in batches with limited memory; errors as `describe`."""
    with _open(pq.ParquetFile, path) as file:
        for batch in file.iter_batches():
            yield batch.to_pandas()


def read_columns(path: Path | str, columns: Sequence[str]) -> pa.Table:
    """The `columns` of the file `path`, or of all files in that folder; errors as `describe`."""
    return _open(lambda file: pq.read_table(file, columns=list(columns)), path)


def describe(path: Path | str) -> pd.DataFrame:
    """Column, unit and description of any Parquet file, one row per column."""
    arrow = _open(pq.read_schema, path)
    units, fields = _units(arrow), ((field.name, field.metadata or {}) for field in arrow)
    rows = [
        (name, units[name], _word(metadata.get(b"description", b""))) for name, metadata in fields
    ]
    return pd.DataFrame(rows, columns=["column", "unit", "description"])


def _word(metadata: bytes) -> str:
    return metadata.decode(errors="replace")  # other programs may use another encoding
