"""Tables to and from Parquet, files written whole or not at all."""

import hashlib
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.files import check_writable, write_atomically, write_text  # noqa: F401  written from here too
from jointgap.core.schema import Table

_KEY, _LENGTH = "jointgap_sha256", 64
_CHUNK = 1 << 20  # [bytes]
_TAIL = 8  # [bytes], the length of the footer and Parquet's mark, which end a file
_ENTRY = re.compile(_KEY.encode() + rb"..(.{%d})" % _LENGTH, re.DOTALL)
"""The entry in the footer: between key and value stand the value's type and length, a byte each."""

BLANK = {_KEY: "0" * _LENGTH}
"""Metadata that a file needs before `write_digest` can fill it in; a value of the same length for any content."""


def write_digest(path: Path | str) -> None:
    """Fill the digest of all other bytes in, in a file that holds `BLANK`."""
    with open(path, "r+b") as file:
        place, _ = _entry(file)
        digest = _digest(file, place)
        file.seek(place)
        file.write(digest)


def is_as_written(path: Path | str) -> bool | None:
    """Whether all bytes of a file are those that were written; None where no digest is found in it."""
    with open(path, "rb") as file:
        entry = _entry(file)
        return _digest(file, entry[0]) == entry[1] if entry else None


def _entry(file: BinaryIO) -> tuple[int, bytes] | None:
    """Place of the digest in the file, and the digest."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - _TAIL, 0))
    start = max(size - _TAIL - int.from_bytes(file.read(4), "little"), 0)
    file.seek(start)
    found = list(_ENTRY.finditer(file.read()))
    return (start + found[-1].start(1), found[-1][1]) if found else None


def _digest(file: BinaryIO, place: int) -> bytes:
    """Digest of the file but for the digest at `place`."""
    digest = hashlib.sha256()
    file.seek(0)
    while file.tell() < place:
        digest.update(file.read(min(_CHUNK, place - file.tell())))
    file.seek(place + _LENGTH)
    digest.update(file.read())
    return digest.hexdigest().encode()


_TYPES = {
    "float": pa.float64(),
    "int": pa.int64(),
    "text": pa.string(),
    "category": pa.dictionary(pa.int8(), pa.string()),
    "bool": pa.bool_(),
}


def schema(table: Table) -> pa.Schema:
    """The Arrow schema of a table: unit and description stand at each column, the table's name and description at the
    whole.
    """
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
        {"jointgap_table": table.name, "description": table.description},
    )


def to_arrow(table: Table, frame: pd.DataFrame) -> pa.Table:
    """`frame` as an Arrow table of exactly the columns that `table` names."""
    wanted = table.names
    if sorted(frame.columns) != sorted(wanted):
        missing, extra = sorted(set(wanted) - set(frame.columns)), sorted(set(frame.columns) - set(wanted))
        raise ValueError(f"table {table.name}: missing columns {missing}, unknown columns {extra}")
    arrays = []
    for column in table.columns:
        values = frame[column.name]
        absent = values.isna().to_numpy()
        if column.kind == "float" and np.isinf(values.to_numpy(dtype=float, na_value=np.nan)).any():
            raise ValueError(f"table {table.name}: column {column.name} holds an infinite value")
        if absent.any() and not column.nullable:
            row = int(np.flatnonzero(absent)[0])
            raise ValueError(f"table {table.name}: column {column.name} has no value in row {row}")
        arrays.append(pa.Array.from_pandas(values, type=_TYPES[column.kind]))
    return pa.Table.from_arrays(arrays, schema=schema(table))


def write(table: Table, frame: pd.DataFrame, path: Path | str, told: Mapping[str, str] | None = None) -> None:
    """Write `frame`, which holds the columns of `table`, to `path`: Parquet with unit and description at each
    column, and with the digest of the file.
    """
    arrow = to_arrow(table, frame)
    arrow = arrow.replace_schema_metadata({**arrow.schema.metadata, **(told or {})})
    floats = {column.name: "BYTE_STREAM_SPLIT" for column in table.columns if column.kind == "float"}
    others = [column.name for column in table.columns if column.kind != "float"]

    def save(temporary: str) -> None:
        with writer(
            temporary, arrow.schema, compression="zstd", use_dictionary=others, column_encoding=floats or None
        ) as file:
            file.write_table(arrow)

    write_atomically(path, save)


@contextmanager
def writer(path: str, schema: pa.Schema, **options: Any) -> Iterator[pq.ParquetWriter]:
    """A Parquet file of a table, to be filled; it gets its digest when it is closed."""
    with pq.ParquetWriter(path, schema, **options) as file:
        yield file
        file.add_key_value_metadata(BLANK)
    write_digest(path)


def read(table: Table, path: Path | str) -> pd.DataFrame:
    """The frame in the file `path` that `write` made of a `table`; null becomes NaN (None in text)."""
    arrow, has_digest = _open(pq.read_table, path, f"run the stage that writes table '{table.name}'")
    held = _word((arrow.schema.metadata or {}).get(b"jointgap_table", b"?"))
    wanted = table.names
    if held != table.name:
        raise InputError(
            f"{path}: holds table '{held}', not '{table.name}'; give the right file, or run its stage again"
        )
    if arrow.column_names != wanted:
        missing, extra = (
            sorted(set(a) - set(b)) for a, b in ((wanted, arrow.column_names), (arrow.column_names, wanted))
        )
        raise InputError(
            f"{path}: table '{held}' lacks the columns {missing} and has the unknown columns {extra}; another version "
            "wrote it, so run its stage again"
        )
    if not has_digest:
        raise InputError(f"{path}: has no digest of its bytes; another version wrote it, so run its stage again")
    for field, wanted_field in zip(arrow.schema, schema(table), strict=True):
        if field.type != wanted_field.type:
            raise InputError(
                f"{path}: column {field.name} holds {field.type}, not {wanted_field.type}; run its stage again"
            )
    return arrow.to_pandas()


def _open(reader: Callable[[Path | str], Any], path: Path | str, fix: str) -> tuple[Any, bool]:
    """`reader(path)` and whether the file has a digest, with one clear error where there is no such file, it is not
    Parquet, or it is damaged.
    """
    try:
        as_written = is_as_written(path)
        read = None if as_written is False else reader(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; {fix}") from error
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read as Parquet ({error}); give a Parquet file, or run its stage again"
        ) from error
    if as_written is False:
        raise InputError(
            f"{path}: is damaged, its bytes are not those that were written; start `make` again, which makes it anew, "
            "or run its stage again"
        )
    return read, as_written is not None


def read_table(path: Path | str) -> pd.DataFrame:
    """The frame in a Parquet file that jointgap wrote, or in another one, with the units of its columns.

    Parameters
    ----------
    path : Path or str
        A file such as ``results/paper/simulate/trajectory.parquet``.

    Returns
    -------
    pandas.DataFrame
        In SI units, which ``frame.attrs["units"]`` holds by column (empty where the file says none); null is NaN, None
        in text.

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
    arrow, _ = _open(pq.read_table, path, "check the path")
    frame = arrow.to_pandas()
    frame.attrs["units"] = {field.name: _word((field.metadata or {}).get(b"unit", b"")) for field in arrow.schema}
    return frame


def with_units(table: Table, frame: pd.DataFrame) -> pd.DataFrame:
    """A `frame` of `table` with the units of its columns in ``attrs["units"]``, as `read_table` gives them."""
    frame.attrs["units"] = {column.name: column.unit for column in table.columns}
    return frame


def unit_in(units: Mapping[str, str], column: str) -> str:
    """The unit of a `column` in `units` by column; InputError where there is none."""
    if column not in units:
        raise InputError(f"no column '{column}'; {did_you_mean(column, units)}")
    return units[column]


def read_footer(path: Path | str) -> pq.FileMetaData:
    """What a Parquet file says of itself: schema, number of rows; errors as `describe`."""
    return _open(pq.read_metadata, path, "check the path")[0]


def batches(path: Path | str) -> Iterator[pd.DataFrame]:
    """The rows of any Parquet file, so many at a time that memory holds them; errors as `describe`."""
    file = _open(pq.ParquetFile, path, "check the path")[0]
    with file:
        for batch in file.iter_batches():
            yield batch.to_pandas()


def read_columns(path: Path | str, columns: Sequence[str]) -> pa.Table:
    """Some `columns` of the file `path`; or of all files in that folder, whose digests are not looked at.

    Errors as `describe`.
    """
    if Path(path).is_dir():
        return pq.read_table(path, columns=list(columns))
    return _open(lambda file: pq.read_table(file, columns=list(columns)), path, "check the path")[0]


def describe(path: Path | str) -> pd.DataFrame:
    """Column, unit and description of any Parquet file, one row a column (empty where it says none)."""
    return _open(_columns, path, "check the path")[0]


def _columns(path: Path | str) -> pd.DataFrame:
    rows = [
        {
            "column": field.name,
            **{key: _word((field.metadata or {}).get(key.encode(), b"")) for key in ("unit", "description")},
        }
        for field in pq.read_schema(path)
    ]
    return pd.DataFrame(rows, columns=["column", "unit", "description"])


def _word(metadata: bytes) -> str:
    return metadata.decode(errors="replace")  # another program's may be in another encoding
