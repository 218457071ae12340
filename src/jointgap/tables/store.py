"""Tables to and from Parquet; the only place where jointgap reads or writes it."""

import os
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from jointgap.errors import InputError
from jointgap.tables.columns import Table


def to_arrow(table: Table, frame: pd.DataFrame) -> pa.Table:
    """`frame` as an Arrow table of exactly the columns that `table` names.

    Raises
    ------
    ValueError
        A column too many or too few, a value missing or not finite where the table allows none.
    """
    wanted = [column.name for column in table.columns]
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
        arrays.append(pa.Array.from_pandas(values, type=column.field().type))
    return pa.Table.from_arrays(arrays, schema=table.schema())


def write_whole(path: Path | str, save) -> None:
    """Let `save(temporary_path)` write a file beside `path`, then rename it: nothing half-written stays behind.

    Raises
    ------
    InputError
        The folder cannot be made or written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
        os.close(handle)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); check permission and space") from error
    try:
        save(temporary)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current


def write(table: Table, frame: pd.DataFrame, path: Path | str) -> None:
    """Write `frame` as Parquet with unit and description per column (zstd, floats split by byte)."""
    arrow = to_arrow(table, frame)
    floats = {column.name: "BYTE_STREAM_SPLIT" for column in table.columns if column.kind == "float"}
    others = [column.name for column in table.columns if column.kind != "float"]
    write_whole(
        path,
        lambda temporary: pq.write_table(
            arrow, temporary, compression="zstd", use_dictionary=others, column_encoding=floats or None
        ),
    )


def read(table: Table, path: Path | str) -> pd.DataFrame:
    """The frame in a Parquet file that `write` made; null becomes NaN (None in text).

    Raises
    ------
    InputError
        No such file, not Parquet, another table, or other columns.
    """
    try:
        arrow = pq.read_table(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; run the stage that writes table '{table.name}'") from error
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(f"{path}: cannot be read as Parquet ({error}); delete it and run its stage again") from error
    found = (arrow.schema.metadata or {}).get(b"jointgap_table", b"?").decode()
    wanted = [column.name for column in table.columns]
    if found != table.name or arrow.column_names != wanted:
        raise InputError(
            f"{path}: holds table '{found}' with columns {arrow.column_names}, not '{table.name}' with {wanted}; "
            "give the right file, or run its stage again"
        )
    return arrow.to_pandas()


def describe(path: Path | str) -> pd.DataFrame:
    """Column, unit and description of any Parquet file, one row a column (empty where it says none)."""
    schema = pq.read_schema(path)
    rows = [
        {
            "column": field.name,
            **{key: (field.metadata or {}).get(key.encode(), b"").decode() for key in ("unit", "description")},
        }
        for field in schema
    ]
    return pd.DataFrame(rows, columns=["column", "unit", "description"])
