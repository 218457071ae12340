"""Simulate and measure designs of a sweep: a file for each part of them, which together are one Parquet dataset.

A part's file names its designs' sweep and the code that measured them. What it holds is not simulated again: a part
that is there is kept, and one that is too short, because the sweep has grown since, is made longer.
"""

from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd
from pyarrow.parquet import FileMetaData

from jointgap import tables
from jointgap.config.sweep_config import MOST_DESIGNS
from jointgap.core.errors import InputError
from jointgap.core.progress import followed, parts
from jointgap.designs.best_lengths import best_lengths, counted_objective
from jointgap.designs.design_of_experiments import Designs
from jointgap.designs.measures import angles_to_measure, measures
from jointgap.designs.paper_optima import printed_optima
from jointgap.dynamics.parallel import Outcome, Run, numbers_of, side_by_side, simulate_run
from jointgap.dynamics.parameters import Parameters
from jointgap.tables import Table, sweep_designs

DIGEST = "jointgap_sweep"
"""Key of a file's metadata: the digest of the sweep that its designs belong to."""

CODE = "jointgap_code"
"""Key of a file's metadata: the digest of the code that simulated and measured them."""

_TOGETHER = 32
"""Designs that one thread first prepares, then simulates, then measures: a simulation drives what the others need out
of the processor's cache, and one by one they take a fifth more. More at once save little and hold more motions.
"""


def table_of(designs: Designs) -> Table:
    """The table of these designs."""
    return sweep_designs((axis.column for axis in designs.axes), designs.measured)


def simulate_designs(designs: Designs, first: int, count: int, workers: int | None = None) -> pd.DataFrame:
    """Simulate and measure `count` designs from number `first` on.

    A design that is impossible, or whose simulation fails, is a row with its reason.
    """
    there = MOST_DESIGNS if designs.kind == "sobol" else designs.number
    if first + count > there:
        raise InputError(
            f"sweep: designs {first} to {first + count - 1} are asked for, but there are {there}, from 0 on"
        )
    values = designs.values(first, count)
    together = [values[begin : begin + _TOGETHER] for begin in range(0, count, _TOGETHER)]
    measured = chain.from_iterable(side_by_side(lambda some: _measured(designs, some), together, workers))
    found = zip(values, followed(measured, "simulated designs", count), strict=True)
    rows = [{"design": first + place} | own | row for place, (own, row) in enumerate(found)]
    return pd.DataFrame(rows, columns=list(table_of(designs).names))


def _measured(designs: Designs, values: list[dict]) -> list[dict]:
    """What is measured of the designs that have these `values`."""
    prepared = [_prepared(designs, own) for own in values]
    outcomes = [given if isinstance(given, InputError) else simulate_run(*given) for given in prepared]
    return [_row(designs, own, outcome) for own, outcome in zip(values, outcomes, strict=True)]


def _prepared(designs: Designs, values: dict) -> tuple[Run, Parameters | InputError] | InputError:
    try:
        design = designs.scenario(values)
    except InputError as error:
        return error
    angles = None if designs.printed_numbers else angles_to_measure(design.simulate)
    run = Run(design.mechanism, design.simulate, crank_angle=angles)
    return run, numbers_of(run)


def _row(designs: Designs, values: dict, outcome: Outcome | InputError) -> dict:
    error = outcome if isinstance(outcome, InputError) else outcome.error
    if error is not None:
        return dict.fromkeys((column.name for column in designs.measured), np.nan) | {"steps": 0, "reason": str(error)}
    row = measures(outcome, designs.window) | {"steps": outcome.result.steps, "reason": None}
    if designs.best_lengths:
        counting = designs.counting(values)
        counted = counted_objective(outcome, counting)
        row |= best_lengths(outcome, counted)
        if designs.printed_numbers:
            row |= printed_optima(counted, counting.measure)
    return row


def write_designs(
    designs: Designs, first: int, count: int, path: Path | str, code: str, workers: int | None = None
) -> None:
    """Make a part of the dataset: simulate and measure those of its designs that its file does not hold yet."""
    path, table = Path(path), table_of(designs)
    for left in path.parent.glob(f".{path.stem}-*"):  # of a write that was killed; polars and duckdb would read it
        left.unlink(missing_ok=True)
    kept = _kept(designs, first, count, path, code)
    if len(kept) == count:
        return
    tables.check_writable(path)
    more = simulate_designs(designs, first + len(kept), count - len(kept), workers)
    frame = pd.concat([kept, more], ignore_index=True) if len(kept) else more
    tables.write(table, frame, path, {DIGEST: designs.digest, CODE: code})


def _kept(designs: Designs, first: int, count: int, path: Path, code: str) -> pd.DataFrame:
    """The designs of a part that its file holds; none where it is damaged, or of another sweep or code."""
    none = pd.DataFrame({name: [] for name in table_of(designs).names})
    try:
        footer = tables.read_footer(path)
    except InputError:
        return none
    told = footer.metadata or {}
    if told.get(DIGEST.encode()) != designs.digest.encode() or told.get(CODE.encode()) != code.encode():
        return none
    begin, end = _span(footer)
    return tables.read(table_of(designs), path) if begin == first and end <= first + count else none


def write_dataset(designs: Designs, folder: Path, per_job: int, code: str, workers: int | None = None) -> None:
    """Make all parts of the dataset in a `folder` that are not there."""
    check_folder(designs, folder, per_job)
    for name, (first, count) in parts(designs.number, per_job).items():
        write_designs(designs, first, count, folder / f"{name}.parquet", code, workers)
    check_dataset(designs, folder)


def check_folder(designs: Designs, folder: Path, per_job: int) -> None:
    """Whether a `folder` holds nothing but parts of the sweep `designs`, before hours of simulation.

    A part may be missing, damaged, or shorter than it is to become.
    """
    wanted, spans = parts(designs.number, per_job), {}
    for path in sorted(folder.glob("[!.]*.parquet")):
        try:
            footer = tables.read_footer(path)
        except InputError as error:
            if path.stem in wanted:
                continue  # damaged: it is made again
            raise InputError(f"{error}; or remove it, it is no part of this sweep") from error
        _check_belongs(designs, path, footer)
        spans[path] = _span(footer)
    _check_number(designs, spans)
    for path, (begin, end) in spans.items():
        first, count = wanted.get(path.stem, (-1, 0))
        if begin != first or end > first + count:
            raise InputError(
                f"{path}: holds designs {begin} to {end - 1}, which are no part of this sweep in parts of {per_job}; "
                "set sweep.designs_per_job as it was when the folder was made, or give another folder"
            )


def check_dataset(designs: Designs, folder: Path) -> None:
    """Whether the files in a `folder` are those of the sweep `designs` and hold each design once."""
    spans, codes = {}, {}
    for path in sorted(folder.glob("[!.]*.parquet")):
        footer = tables.read_footer(path)
        _check_belongs(designs, path, footer)
        spans[path] = _span(footer)
        codes[(footer.metadata or {}).get(CODE.encode())] = path
    if len(codes) > 1:
        first, second, *_ = sorted(codes.values())
        raise InputError(
            f"{first} and {second}: were measured by different versions of jointgap; start the sweep again, which "
            "measures the older ones anew"
        )
    if not spans:
        raise InputError(f"{folder}: holds no designs; simulate them first")
    _check_number(designs, spans)
    reached = 0
    for path, (begin, end) in sorted(spans.items(), key=lambda item: item[1]):
        if begin < reached:
            raise InputError(f"{path}: design {begin} is there twice; remove this file and start again")
        if begin > reached:
            break
        reached = end
    if reached < designs.number:
        raise InputError(f"{folder}: design {reached} is missing; start again, which makes its part")


def _check_number(designs: Designs, spans: dict[Path, tuple[int, int]]) -> None:
    """No file holds designs beyond those that are asked for."""
    most = max((end for _, end in spans.values()), default=0)
    if most > designs.number:
        path, (begin, end) = next(item for item in spans.items() if item[1][1] > designs.number)
        raise InputError(
            f"{path}: holds designs {begin} to {end - 1}, but sweep.number asks for {designs.number}; ask for {most} "
            "or more, for a sweep only grows, or give another folder"
        )


def _span(footer: FileMetaData) -> tuple[int, int]:
    """First design of a file, and the one after its last."""
    place = footer.schema.names.index("design")
    groups = [footer.row_group(group).column(place).statistics for group in range(footer.num_row_groups)]
    return min(group.min for group in groups), max(group.max for group in groups) + 1


def _check_belongs(designs: Designs, path: Path, footer: FileMetaData) -> None:
    of = (footer.metadata or {}).get(DIGEST.encode(), b"").decode()
    if of != designs.digest:
        fixed = "" if designs.kind == "sobol" else f"; a {designs.kind} of another size is another sweep too"
        raise InputError(
            f"{path}: belongs to another sweep (its digest is {of or 'none'}, this one's is {designs.digest}{fixed}); "
            "move the folder away, or give another one"
        )
