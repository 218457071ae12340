"""Tables as CSV with units in the column names, for spreadsheets and other programs."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.core.errors import InputError
from jointgap.core.files import check_writable, write_atomically
from jointgap.core.parquet import batches, describe
from jointgap.core.units import unit_factor


def export(
    source: Path, to: Path | None = None, units: Sequence[str] = (), force: bool = False
) -> list[Path]:
    """Convert Parquet tables to CSV files, which are returned.

    The first line contains names with units, ``crank_angle [rad]``. Missing values are empty;
    numbers have full precision.
    """
    for unit in units:
        try:
            unit_factor(unit, unit)
        except ValueError as error:
            raise InputError(f"--unit {unit!r}: {error}") from error
    root = source if source.is_dir() else source.parent
    files = [source]
    if source.is_dir():
        files = sorted(
            path
            for path in source.rglob("[!.]*.parquet")
            if "/." not in f"/{path.relative_to(source)}"
        )
    if not files:
        raise InputError(f"{source}: contains no Parquet file; give a folder of results, or a file")
    targets = [((to or root) / path.relative_to(root)).with_suffix(".csv") for path in files]
    taken = [target for target in targets if target.exists()]
    if taken and not force:
        more = f" (and {len(taken) - 1} more)" if len(taken) > 1 else ""
        raise InputError(
            f"{taken[0]}: already exists{more}; overwrite with --force, or give --to DIR"
        )
    columns = [_columns(path, units) for path in files]  # before anything is written
    check_writable(*targets)
    for path, target, converted in zip(files, targets, columns, strict=True):
        write_atomically(target, partial(_save, path, converted))
    return targets


def _columns(path: Path, units: Sequence[str]) -> dict[str, tuple[str, float]]:
    """Name with unit, and conversion factor, of each column of a file."""
    columns = {}
    for row in describe(path).itertuples():
        unit, factor = row.unit, 1.0
        if unit not in ("", "1"):
            unit, factor = next(
                (conversion for unit_name in units if (conversion := _converted(unit, unit_name))),
                (unit, factor),
            )
        columns[row.column] = (
            f"{row.column} [{unit}]" if unit not in ("", "1") else row.column,
            factor,
        )
    return columns


def _converted(unit: str, unit_name: str) -> tuple[str, float] | None:
    """The unit `wanted` and its number per `unit`; None for another dimension."""
    try:
        unit_factor(unit, unit)  # raises for columns without a single unit
        return unit_name, 1.0 / unit_factor(unit_name, unit)
    except ValueError:
        return None


def _save(path: Path, columns: Mapping[str, tuple[str, float]], temporary: str) -> None:
    with open(temporary, "w", encoding="utf-8", newline="") as file:
        pd.DataFrame(columns=[name for name, _ in columns.values()]).to_csv(
            file, index=False, lineterminator="\n"
        )
        for frame in batches(path):
            for name, (_, factor) in columns.items():
                if factor != 1.0:
                    frame[name] = np.asarray(frame[name], dtype=float) * factor
            frame.to_csv(file, index=False, header=False, lineterminator="\n")
