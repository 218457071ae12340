"""Simulate and measure designs of a sweep: a file for each part of them, which together are one Parquet dataset."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from pyarrow.parquet import FileMetaData

from jointgap import tables
from jointgap.config.varied_values import with_values
from jointgap.designs.design_of_experiments import SOURCE, Designs
from jointgap.designs.measures import measures
from jointgap.dynamics.parallel_runs import Run, simulate_runs
from jointgap.errors import InputError
from jointgap.progress import followed
from jointgap.tables import Table, sweep_designs
from jointgap.tables.sweep_tables import MEASURES

DIGEST = "jointgap_sweep"
"""Key of a file's metadata: the digest of the sweep that its designs belong to."""


def table_of(designs: Designs) -> Table:
    """The table of these designs."""
    return sweep_designs(axis.column for axis in designs.axes)


def simulate_designs(designs: Designs, first: int, count: int, workers: int | None = None) -> pd.DataFrame:
    """Simulate and measure `count` designs from number `first` on.

    A design that is impossible, or whose simulation fails, is a row with its reason.

    Parameters
    ----------
    designs : Designs
    first, count : int
    workers : int, optional
        See `jointgap.dynamics.parallel_runs.simulate_runs`; the result does not depend on it.

    Returns
    -------
    DataFrame
        The table `jointgap.tables.sweep_designs`, `count` rows.

    Raises
    ------
    InputError
        Numbers beyond the last design; a Sobol sequence has none.
    """
    if designs.kind != "sobol" and first + count > designs.number:
        raise InputError(
            f"sweep: designs {first} to {first + count - 1} are asked for, but there are {designs.number}, from 0 on"
        )
    values = designs.values(first, count)
    errors: dict[int, InputError] = {}
    outcomes = simulate_runs(_possible_runs(designs, values, errors), workers)
    rows = []
    for place, own in enumerate(values):
        row = {"design": first + place} | own | dict.fromkeys((column.name for column in MEASURES), np.nan)
        rows.append(row | {"steps": 0, "reason": None})
    for outcome in followed(outcomes, "simulated designs", count):
        row = rows[outcome.run.values["place"]]
        if outcome.error is not None:
            row["reason"] = str(outcome.error)
            continue
        row |= measures(outcome, designs.window) | {"steps": outcome.result.steps}
    for place, error in errors.items():
        rows[place]["reason"] = str(error)
    return pd.DataFrame(rows, columns=list(table_of(designs).names))


def _possible_runs(designs: Designs, values: list[dict], errors: dict[int, InputError]) -> Iterator[Run]:
    for place, own in enumerate(values):
        try:
            scenario = with_values(designs.base, own, SOURCE)
        except InputError as error:
            errors[place] = error
            continue
        yield Run(scenario.mechanism, scenario.simulate, values={"place": place})


def write_designs(designs: Designs, first: int, count: int, path: Path | str, workers: int | None = None) -> None:
    """Simulate and measure designs, and write their table to `path`; other parameters as of `simulate_designs`, and its
    errors.
    """
    tables.check_writable(path)
    frame = simulate_designs(designs, first, count, workers)
    tables.write(table_of(designs), frame, path, {DIGEST: designs.digest})


def is_done(designs: Designs, first: int, count: int, path: Path) -> bool:
    """Whether a part of the dataset is there; one whose bytes are not those that were written is not.

    Parameters
    ----------
    designs : Designs
    first, count : int
        First design and number of designs that the part holds.
    path : Path
        Its file.

    Raises
    ------
    InputError
        It belongs to another sweep.
    """
    if not path.exists():
        return False
    try:
        footer = tables.read_footer(path)
    except InputError:
        return False
    _check_belongs(designs, path, footer)
    return footer.num_rows == count and _numbers(path)[0] == first


def check_dataset(designs: Designs, folder: Path) -> None:
    """Whether the files in a `folder` are those of the sweep `designs` and hold each design once.

    Raises
    ------
    InputError
        A file of another sweep, a design that is missing, there twice, or more than are asked for.
    """
    files = sorted(folder.glob("*.parquet"))
    if not files:
        raise InputError(f"{folder}: holds no designs; simulate them first")
    for path in files:
        _check_belongs(designs, path, tables.read_footer(path))
    numbers = np.sort(np.concatenate([_numbers(path) for path in files]))
    if numbers[-1] >= designs.number:
        beyond = next(path for path in files if _numbers(path).max() >= designs.number)
        raise InputError(
            f"{beyond}: holds design {numbers[-1]}, but sweep.number asks for {designs.number}; remove it, or ask for "
            "more designs"
        )
    if not np.array_equal(numbers, np.arange(designs.number)):
        missing = np.setdiff1d(np.arange(designs.number), numbers)
        what = f"design {missing[0]} is missing" if len(missing) else "a design is there twice"
        raise InputError(f"{folder}: {what}; remove the files of its part and start again")


def _numbers(path: Path) -> np.ndarray:
    return tables.read_columns(path, ["design"])["design"].to_numpy()


def _check_belongs(designs: Designs, path: Path, footer: FileMetaData) -> None:
    of = (footer.metadata or {}).get(DIGEST.encode(), b"").decode()
    if of != designs.digest:
        raise InputError(
            f"{path}: belongs to another sweep (its digest is {of or 'none'}, this one's is {designs.digest}); move it "
            "away, or give another folder"
        )
