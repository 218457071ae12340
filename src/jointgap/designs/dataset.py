"""The dataset of a sweep: Parquet files with the measures of each design. An interrupted sweep
resumes."""

import re
from collections import Counter
from collections.abc import Container
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from pyarrow.parquet import FileMetaData

from jointgap.config import DrivenMechanism, Scenario
from jointgap.config.linkage_file import LinkageFile
from jointgap.core import parquet
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import JOINTS
from jointgap.core.progress import parts, with_progress
from jointgap.core.schema import EVENTS, SWEEP_DESIGNS, TRAJECTORY, Column, Table
from jointgap.designs.measures import (
    angles_to_measure,
    best_lengths,
    measures,
    printed_reductions,
)
from jointgap.designs.sampling import SOURCE, Designs, designs_of
from jointgap.motion.linkage import linkage_model, published
from jointgap.motion.model import Model
from jointgap.motion.of_file import start_state
from jointgap.motion.parallel import Outcome, Run, side_by_side
from jointgap.motion.simulation import (
    crank_angles,
    event_frame,
    integrate_to_angles,
    modes_of,
    observed,
)
from jointgap.motion.slider_crank import model_of, simulate

_CHUNK = 32
"""Designs per thread and step (prepare, simulate, measure): one at a time takes 20 % longer because
of cache misses; more hold more motions in memory."""


def table_of(designs: Designs) -> Table:
    """The table of the dataset."""
    return SWEEP_DESIGNS.filled(
        swept=[axis.column for axis in designs.axes], measured=designs.measured
    )


def simulate_designs(
    designs: Designs, begin: int, count: int, workers: int | None = None
) -> pd.DataFrame:
    """Simulate and measure `count` designs from number `begin`; infeasible or failed ones are rows
    with a reason."""
    numbered = list(enumerate(designs.values(begin, count), begin))
    chunks = [numbered[index : index + _CHUNK] for index in range(0, count, _CHUNK)]
    rows = chain.from_iterable(
        side_by_side(lambda chunk: _simulate_chunk(designs, chunk), chunks, workers)
    )
    rows = with_progress(rows, "simulated designs", count * designs.sweep.starts)
    return pd.DataFrame(rows, columns=list(table_of(designs).names))


def _simulate_chunk(designs: Designs, numbered: list[tuple[int, dict]]) -> list[dict]:
    """Rows of some designs, by number and values."""
    prepared = [_prepare(designs, values) for _, values in numbered]
    simulated = [
        [job if isinstance(job, InputError) else _simulate(*job) for job in jobs]
        for jobs in prepared
    ]
    return [
        {"design": number, "start": start} | values | _measure(designs, values, outcome)
        for (number, values), outcomes in zip(numbered, simulated, strict=True)
        for start, outcome in enumerate(outcomes)
    ]


def _prepare(designs: Designs, values: dict) -> list[tuple[Run, Model] | InputError]:
    """A run for each start of a design, or the error of an infeasible design."""
    try:
        design = designs.scenario(values)
        is_linkage = isinstance(design.mechanism, LinkageFile)
        model = (linkage_model if is_linkage else model_of)(design.mechanism, design.simulate)
    except InputError as error:
        return [error] * designs.sweep.starts
    chosen = crank_angles if designs.sweep.printed_numbers else angles_to_measure
    angles = chosen(design.simulate)
    return [
        (Run(design.mechanism, design.simulate, start, angles), model)
        for start in designs.starts(design.mechanism)
    ]


def _simulate(run: Run, model: Model) -> Outcome | InputError | SimulationError:
    """Simulate a run; its error where it fails."""
    try:
        start = start_state(model, run.perturbation)
        result = integrate_to_angles(model, start, run.crank_angle, run.options.tolerance)
    except (InputError, SimulationError) as error:
        return error
    return Outcome(run, model, run.crank_angle, result)


def _measure(
    designs: Designs, values: dict, outcome: Outcome | InputError | SimulationError
) -> dict:
    """Measures of a simulation, or the reason of its failure."""
    sweep, definition = designs.sweep, designs.error_definition(values)
    try:
        if not isinstance(outcome, Outcome):
            raise outcome
        row = measures(outcome, sweep.window) | {"steps": outcome.result.steps, "reason": None}
    except (InputError, SimulationError) as error:
        return {"steps": 0, "reason": str(error)}
    if sweep.best_lengths or sweep.printed_numbers:
        row |= best_lengths(outcome, definition)
    if sweep.printed_numbers:
        row |= printed_reductions(outcome, definition)
    return row


DIGEST, CODE = "jointgap_sweep", "jointgap_code"
"""Keys of a file's metadata: digests of the sweep and of the code."""


class _Part(NamedTuple):
    """Content of a file of the dataset."""

    begin: int  # First design
    end: int  # Last design + 1
    code: str


def write_designs(
    designs: Designs,
    begin: int,
    count: int,
    path: Path | str,
    code: str,
    workers: int | None = None,
) -> None:
    """Simulate and measure the designs of a file that it does not contain yet.

    A file that is damaged, or of another sweep or code version, is replaced.
    """
    path, table = Path(path), table_of(designs)
    # of interrupted writes; polars and duckdb would read them
    for leftover in path.parent.glob(f".{path.stem}-*"):
        leftover.unlink(missing_ok=True)
    try:
        part = _part(designs, path, parquet.read_footer(path))
    except InputError:
        part = None
    frames, completed = [], 0
    if part and part.code == code and part.begin == begin and part.end <= begin + count:
        frames, completed = [parquet.read(table, path)], part.end - begin
    if completed == count:
        return
    parquet.check_writable(path)
    frames.append(simulate_designs(designs, begin + completed, count - completed, workers))
    metadata = {DIGEST: designs.digest, CODE: code}
    parquet.write(table, pd.concat(frames, ignore_index=True), path, metadata)


def write_dataset(
    designs: Designs, folder: Path, per_job: int, code: str, workers: int | None = None
) -> None:
    """Complete all parts of the dataset in a `folder`."""
    check_folder(designs, folder, per_job)
    for name, (begin, count) in parts(designs.number, per_job).items():
        write_designs(designs, begin, count, folder / f"{name}.parquet", code, workers)
    check_dataset(designs, folder)


def check_folder(designs: Designs, folder: Path, per_job: int) -> None:
    """InputError, before any simulation, where a `folder` contains files other than parts of the
    sweep `designs`.

    Parts may be missing, damaged, or incomplete.
    """
    expected = parts(designs.number, per_job)
    for path, part in _parts(designs, folder, may_be_damaged=expected).items():
        begin, count = expected.get(path.stem, (-1, 0))
        if part.begin != begin or part.end > begin + count:
            raise InputError(
                f"{path}: contains designs {part.begin} to {part.end - 1}, which do not match parts"
                f" of {per_job}; set sweep.designs_per_job to its value when the folder was"
                " written, or give another folder"
            )


def checked_dataset(scenario: Scenario, folder: Path) -> Designs:
    """The designs of a scenario's sweep; InputError where a `folder` does not contain each of them
    once."""
    designs = designs_of(scenario)
    check_dataset(designs, folder)
    return designs


def check_dataset(designs: Designs, folder: Path) -> None:
    """InputError where the files in a `folder` do not contain each design of the sweep `designs`
    once."""
    by_path = _parts(designs, folder)
    if not by_path:
        raise InputError(f"{folder}: contains no designs; run `jointgap sweep` first")
    codes = {part.code: path for path, part in by_path.items()}
    if len(codes) > 1:
        raise InputError(
            f"{' and '.join(map(str, sorted(codes.values())[:2]))}: were measured by different"
            " versions of jointgap; run the sweep again, which replaces the older ones"
        )
    complete_to = 0
    for path, part in sorted(by_path.items(), key=lambda item: item[1]):
        if part.begin < complete_to:
            raise InputError(
                f"{path}: design {part.begin} is a duplicate; remove this file and run the sweep"
                " again"
            )
        if part.begin > complete_to:
            break
        complete_to = part.end
    if complete_to < designs.number:
        raise InputError(f"{folder}: design {complete_to} is missing; run the sweep again")


def _parts(
    designs: Designs, folder: Path, may_be_damaged: Container[str] = ()
) -> dict[Path, _Part]:
    """Content of each file in a `folder`, without damaged ones whose names are in
    `may_be_damaged`."""
    by_path = {}
    for path in sorted(folder.glob("[!.]*.parquet")):
        try:
            footer = parquet.read_footer(path)
        except InputError as error:
            if path.stem in may_be_damaged:
                continue
            raise InputError(f"{error}; or remove it, it does not belong to this sweep") from error
        by_path[path] = _part(designs, path, footer)
    number = max((part.end for part in by_path.values()), default=0)
    for path, part in by_path.items():
        if part.end > designs.number:
            raise InputError(
                f"{path}: contains designs {part.begin} to {part.end - 1}, more than sweep.number ="
                f" {designs.number}; set it to {number} or more, or give another folder"
            )
    return by_path


def _part(designs: Designs, path: Path, footer: FileMetaData) -> _Part:
    metadata = footer.metadata or {}
    digest, code = (metadata.get(key.encode(), b"").decode() for key in (DIGEST, CODE))
    if digest != designs.digest:
        kind = designs.sweep.design
        fixed = "" if kind == "sobol" else f"; a {kind} of another size is another sweep"
        raise InputError(
            f"{path}: belongs to another sweep (digest {digest or 'none'}, expected"
            f" {designs.digest}{fixed}); move the folder away, or give another one"
        )
    column = footer.schema.names.index("design")
    ranges = [
        footer.row_group(group).column(column).statistics for group in range(footer.num_row_groups)
    ]
    begin, end = min(span.min for span in ranges), max(span.max for span in ranges) + 1
    return _Part(begin, end, code)


def write_trajectories(designs: Designs, folder: Path) -> None:
    """Samples and events of the designs in `sweep.trajectories`, a folder for each start."""
    for number in designs.sweep.trajectories:
        design = designs.scenario(designs.values(number, 1)[0])
        for start, vectors in enumerate(designs.starts(design.mechanism)):
            table, samples, events = _trajectory(design, vectors)
            path = folder / f"design_{number}_start_{start}"
            parquet.write(table, samples, path / "trajectory.parquet")
            parquet.write(EVENTS, events, path / "events.parquet")


def _trajectory(
    design: DrivenMechanism, vectors: dict[str, np.ndarray]
) -> tuple[Table, pd.DataFrame, pd.DataFrame]:
    """Samples with their table, and events, of a motion from given clearance vectors."""
    mechanism, options = design.mechanism, design.simulate
    if not isinstance(mechanism, LinkageFile):
        start = np.concatenate([vectors.get(joint, np.zeros(2)) for joint in JOINTS])
        motion = simulate(mechanism, options, start)
        return TRAJECTORY, motion.samples, motion.events
    model, angles = linkage_model(mechanism, options), crank_angles(options)
    outcome = _simulate(Run(mechanism, options, vectors, angles), model)
    if not isinstance(outcome, Outcome):
        raise outcome
    found = outcome.result
    samples = published(model, observed(model, found)) | modes_of(model, found, model.pins)
    units = {name: model.units.get(name, "") for name in samples}
    columns = (
        Column(name, unit, name, "float" if name in model.units else "text", nullable=True)
        for name, unit in units.items()
    )
    table = Table("trajectory", "Samples of a linkage", tuple(columns))
    return table, pd.DataFrame(samples | {"crank_angle": angles}), event_frame(model, found)


def read_designs(designs: Designs, dataset: Path, *names: str) -> pd.DataFrame:
    """Some columns of a dataset, one row per design: of measures the median over the starts."""
    if designs.sweep.starts == 1:
        return parquet.read_columns(dataset, names).to_pandas()
    frame = parquet.read_columns(dataset, {"design", *names}).to_pandas()
    measured = {column.name for column in designs.measured}
    how = {name: "median" if name in measured else "first" for name in names if name != "design"}
    return frame.groupby("design").agg(how).reset_index()[list(names)]


_NUMBER = re.compile(r"[-+]?[0-9][-+.0-9e]*")


def failures(dataset: Path) -> Counter[str]:
    """Number of failed simulations of a `dataset` by reason, without the numbers in it."""
    reasons = parquet.read_columns(dataset, ["reason"])["reason"].drop_null().to_pylist()
    messages = (
        reason.partition(": ")[2] if reason.startswith(SOURCE) else reason for reason in reasons
    )
    return Counter(_NUMBER.sub("...", reason).partition("; ")[0] for reason in messages)
