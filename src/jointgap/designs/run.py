"""Simulates and measures the designs of a sweep; the dataset of Parquet files resumes from finished
parts."""

import math
import re
from collections import Counter
from collections.abc import Container
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from pyarrow.parquet import FileMetaData
from scipy.optimize import newton

from jointgap.config import Mechanism, Scenario, Simulate
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINTS
from jointgap.core.progress import parts, with_progress
from jointgap.core.schema import BEST_LENGTHS, SWEEP_DESIGNS, Table
from jointgap.designs.sampling import SOURCE, Designs, designs_of
from jointgap.dynamics.parallel import (
    Outcome,
    Run,
    numbers_of,
    rod_and_slider,
    side_by_side,
    simulate_run,
)
from jointgap.dynamics.parameters import Parameters
from jointgap.dynamics.sampling import (
    ROUNDING,
    angle_errors,
    contact_sums,
    largest_change,
    slider_and_forces,
)
from jointgap.dynamics.simulation import IntegrationResult, crank_angles
from jointgap.lengths.objective import Objective, objective_of_motion
from jointgap.paper.printed import OPTIMA

NOISE_ORDER = 10  # order of the crank above which acceleration counts as noise
_NO_ERROR = 1e-12  # RMS [rad] of rounding errors, without a relative reduction
# distance of the first two trial lengths, over the crank length; less than the correction for
# clearances
_NEAR = 1e-4
_CLOSE = 1e-9  # tolerance of the best crank length, over the crank length (0.1 nm)
_ERRORS = tuple(
    f"angle_error_{size}{span}" for span in ("", "_in_window") for size in ("rms", "mean", "peak")
)


def angles_to_measure(options: Simulate) -> np.ndarray:
    """Crank angles [rad] that `measures` reads: the first revolution, and the last two."""
    angles, per_turn = crank_angles(options), options.samples_per_revolution
    return np.concatenate(
        (angles[:per_turn], angles[max(per_turn, len(angles) - 2 * per_turn - 1) :])
    )


def measures(outcome: Outcome, window: tuple[float, float]) -> dict[str, float]:
    """The numbers `MEASURES` of a successful run [SI]; NaN where undefined."""
    result, mechanism, p = outcome.result, outcome.run.mechanism, outcome.parameters
    per_turn = outcome.run.options.samples_per_revolution
    last = slice(-per_turn - 1, None)
    position, acceleration, peaks, sizes = slider_and_forces(p, result.part(last))

    def errors_of(samples: slice, counted: tuple[float, float]) -> tuple[float, ...]:
        states = result.states[samples], result.auxiliary_states[samples]
        return angle_errors(p, outcome.crank_angle[samples], *states, *counted)

    # the end of the last revolution repeats its beginning
    *errors, least = errors_of(slice(-per_turn - 1, -1), (-math.inf, math.inf))
    *errors_in_window, _ = errors_of(slice(0, per_turn), window)
    outer, outer_angle = _extreme(position[:-1], outcome.crank_angle[last][:-1])
    inner, inner_angle = _extreme(-position[:-1], outcome.crank_angle[last][:-1])
    rms = math.sqrt(np.mean(acceleration[:-1] ** 2))
    found = dict(zip(_ERRORS, (*errors, *errors_in_window), strict=True)) | {
        "least_transmission_angle": least,
        "stroke": outer + inner,
        # dead centres without offset lie at 0 and pi: ranges around these give meaningful means
        # over designs
        "outer_dead_centre_angle": (outer_angle + math.pi) % (2.0 * math.pi) - math.pi,
        "inner_dead_centre_angle": inner_angle,
        "acceleration_rms": rms,
        "noise_share": high_order_rms(acceleration[:-1]) / rms if rms else math.nan,
        "repeat_distance": _repeat_distance(result, mechanism, per_turn),
    }
    begin, end = float(result.times[last.start]), float(result.times[-1])
    touching, impacts, peaks_of_contacts = contact_sums(result.events, begin, end)
    for number, joint in enumerate(JOINTS):
        moves = joint in mechanism.loose
        found |= {
            f"{joint}_contact_share": (
                float(touching[number]) / (end - begin) if moves else math.nan
            ),
            f"{joint}_impacts": float(impacts[number]) if moves else math.nan,
            # the samples may miss the peak of a short contact
            f"{joint}_peak_force": float(max(peaks[number], peaks_of_contacts[number])),
            f"{joint}_rms_force": float(sizes[number]),
        }
    return found


def high_order_rms(values: np.ndarray) -> float:
    """RMS of one revolution of `values` above order `NOISE_ORDER`."""
    spectrum = np.fft.rfft(values)
    spectrum[: NOISE_ORDER + 1] = 0.0
    return math.sqrt(np.mean(np.fft.irfft(spectrum, len(values)) ** 2))


def _extreme(values: np.ndarray, angle: np.ndarray) -> tuple[float, float]:
    """Maximum of periodic samples, by parabolic interpolation, and its angle in [0, 2 pi)."""
    top = int(np.argmax(values))
    before, here, after = values[top - 1], values[top], values[(top + 1) % len(values)]
    curvature = before - 2.0 * here + after
    shift = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    place = angle[top] + shift * 2.0 * math.pi / len(values)
    return float(here - 0.25 * (before - after) * shift), float(place % (2.0 * math.pi))


def _repeat_distance(result: IntegrationResult, mechanism: Mechanism, per_turn: int) -> float:
    """Largest distance of the clearance vectors between the last two revolutions, over the smallest
    clearance; NaN with one revolution, or without clearance.
    """
    if len(result.times) < 2 * per_turn + 1 or not mechanism.loose:
        return math.nan
    two = slice(-2 * per_turn - 1, None)
    smallest = min(mechanism.clearance(joint) for joint in mechanism.loose)
    return largest_change(result.states[two], result.auxiliary_states[two], per_turn) / smallest


def _lengths(outcome: Outcome, designs: Designs, values: dict) -> dict[str, float]:
    """The numbers `BEST_LENGTHS` of a successful run, and `PRINTED_OPTIMA` if requested; NaN where
    undefined."""
    per_turn, counting = outcome.run.options.samples_per_revolution, designs.counting(values)
    turn = slice((counting.revolution - 1) * per_turn, counting.revolution * per_turn)
    counted = _objective(outcome, turn, counting.window)
    found = (*_best(_objective(outcome, slice(-per_turn - 1, -1))), *_best(counted))
    row = dict(zip(BEST_LENGTHS.names, found, strict=True))
    if designs.sweep.printed_numbers:
        lengths = np.array([(printed.crank_length, printed.rod_length) for printed in OPTIMA])
        shares = (
            getattr(counted.reductions(lengths), counting.measure)
            if counted
            else [math.nan] * len(OPTIMA)
        )
        row |= {
            f"reduction_at_{printed.key}": share
            for printed, share in zip(OPTIMA, shares, strict=True)
        }
    return row


def _objective(
    outcome: Outcome, turn: slice, window: tuple[float, float] = (0.0, 2.0 * math.pi)
) -> Objective | None:
    """The error of a run as a function of the lengths, in a window; None where the window has no
    samples."""
    angle, result = outcome.crank_angle[turn], outcome.result
    # rounding may put the first sample of a later revolution before its beginning
    place = (angle + ROUNDING) % (2.0 * math.pi)
    inside = (place >= window[0]) & (place <= window[1] + 2.0 * ROUNDING)
    if not inside.any():
        return None
    rod, _ = rod_and_slider(
        outcome.parameters, angle, result.states[turn], result.auxiliary_states[turn]
    )
    return objective_of_motion(outcome.run.mechanism, angle[inside], rod[inside])


def _best(objective: Objective | None) -> tuple[float, float, float]:
    """Best crank length [m] for the original rod, the ratio of the lengths, and the relative
    reduction of the RMS."""
    if objective is None:
        return math.nan, math.nan, math.nan
    rod = objective.original[1]
    crank = best_crank_length(objective, rod)
    before, after = objective.value(objective.original), objective.value((crank, rod))
    is_told = before > len(objective.sine) * _NO_ERROR**2
    return crank, crank / rod, 1.0 - math.sqrt(after / before) if is_told else math.nan


def best_crank_length(objective: Objective, rod_length: float) -> float:
    """Crank length [m] of the smallest sum of squares, equation (12), for a given rod length; NaN
    where none is found.

    The error is almost affine in the crank length, so the secant method converges on the
    derivative's zero.
    """
    crank = objective.original[0]
    with np.errstate(
        invalid="ignore"
    ):  # the error is undefined where the rod does not reach the slide
        found, state = newton(
            lambda length: objective.gradient((length, rod_length))[0],
            crank,
            x1=(1.0 + _NEAR) * crank,
            tol=_CLOSE * crank,
            full_output=True,
            disp=False,
        )
    return float(found) if state.converged else math.nan


_TOGETHER = 32
"""Designs per thread and step (prepare, simulate, measure): one at a time takes 20 % longer because
of cache misses; more hold more motions in memory.
"""


def table_of(designs: Designs) -> Table:
    return SWEEP_DESIGNS.filled(
        swept=[axis.column for axis in designs.axes], measured=designs.measured
    )


def simulate_designs(
    designs: Designs, first: int, count: int, workers: int | None = None
) -> pd.DataFrame:
    """Simulate and measure `count` designs from number `first`; infeasible or failed ones are rows
    with a reason."""
    values = designs.values(first, count)
    together = [values[begin : begin + _TOGETHER] for begin in range(0, count, _TOGETHER)]
    measured = chain.from_iterable(
        side_by_side(lambda some: _measured(designs, some), together, workers)
    )
    found = zip(values, with_progress(measured, "simulated designs", count), strict=True)
    rows = [{"design": first + place} | own | row for place, (own, row) in enumerate(found)]
    return pd.DataFrame(rows, columns=list(table_of(designs).names))


def _measured(designs: Designs, values: list[dict]) -> list[dict]:
    """Rows of the designs with these `values`."""
    prepared = [_prepared(designs, own) for own in values]
    outcomes = [
        given if isinstance(given, InputError) else simulate_run(*given) for given in prepared
    ]
    return [_row(designs, own, outcome) for own, outcome in zip(values, outcomes, strict=True)]


def _prepared(designs: Designs, values: dict) -> tuple[Run, Parameters | InputError] | InputError:
    try:
        design = designs.scenario(values)
    except InputError as error:
        return error
    angles = None if designs.sweep.printed_numbers else angles_to_measure(design.simulate)
    run = Run(design.mechanism, design.simulate, crank_angle=angles)
    return run, numbers_of(run)


def _row(designs: Designs, values: dict, outcome: Outcome | InputError) -> dict:
    error = outcome if isinstance(outcome, InputError) else outcome.error
    if error is not None:
        return {"steps": 0, "reason": str(error)}
    row = measures(outcome, designs.sweep.window) | {"steps": outcome.result.steps, "reason": None}
    with_lengths = designs.sweep.best_lengths or designs.sweep.printed_numbers
    return row | _lengths(outcome, designs, values) if with_lengths else row


DIGEST, CODE = "jointgap_sweep", "jointgap_code"
"""Keys of a file's metadata: digests of the sweep and of the code."""


class _Part(NamedTuple):
    """Content of a file of the dataset."""

    first: int  # First design
    end: int  # Last design + 1
    code: str


def write_designs(
    designs: Designs,
    first: int,
    count: int,
    path: Path | str,
    code: str,
    workers: int | None = None,
) -> None:
    """Simulate and measure the designs of a file that it does not contain yet.

    A file that is damaged, or of another sweep or code version, is replaced.
    """
    path, table, done, kept = Path(path), table_of(designs), 0, []
    for left in path.parent.glob(
        f".{path.stem}-*"
    ):  # of interrupted writes; polars and duckdb would read them
        left.unlink(missing_ok=True)
    try:
        part = _part(designs, path, parquet.read_footer(path))
    except InputError:
        part = None
    if part and part.code == code and part.first == first and part.end <= first + count:
        done, kept = part.end - first, [parquet.read(table, path)]
    if done == count:
        return
    parquet.check_writable(path)
    frame = pd.concat(
        [*kept, simulate_designs(designs, first + done, count - done, workers)], ignore_index=True
    )
    parquet.write(table, frame, path, {DIGEST: designs.digest, CODE: code})


def write_dataset(
    designs: Designs, folder: Path, per_job: int, code: str, workers: int | None = None
) -> None:
    """Complete all parts of the dataset in a `folder`."""
    check_folder(designs, folder, per_job)
    for name, (first, count) in parts(designs.number, per_job).items():
        write_designs(designs, first, count, folder / f"{name}.parquet", code, workers)
    check_dataset(designs, folder)


def check_folder(designs: Designs, folder: Path, per_job: int) -> None:
    """InputError, before any simulation, where a `folder` contains files other than parts of the
    sweep `designs`.

    Parts may be missing, damaged, or incomplete.
    """
    wanted = parts(designs.number, per_job)
    for path, part in _parts(designs, folder, remade=wanted).items():
        first, count = wanted.get(path.stem, (-1, 0))
        if part.first != first or part.end > first + count:
            raise InputError(
                f"{path}: contains designs {part.first} to {part.end - 1}, which do not match parts"
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
    held = _parts(designs, folder)
    if not held:
        raise InputError(f"{folder}: contains no designs; run `jointgap sweep` first")
    codes = {part.code: path for path, part in held.items()}
    if len(codes) > 1:
        raise InputError(
            f"{' and '.join(map(str, sorted(codes.values())[:2]))}: were measured by different"
            " versions of jointgap; run the sweep again, which replaces the older ones"
        )
    reached = 0
    for path, part in sorted(held.items(), key=lambda item: item[1]):
        if part.first < reached:
            raise InputError(
                f"{path}: design {part.first} is a duplicate; remove this file and run the sweep"
                " again"
            )
        if part.first > reached:
            break
        reached = part.end
    if reached < designs.number:
        raise InputError(f"{folder}: design {reached} is missing; run the sweep again")


def _parts(designs: Designs, folder: Path, remade: Container[str] = ()) -> dict[Path, _Part]:
    """Content of each file in a `folder`, without damaged ones whose names are in `remade`."""
    held = {}
    for path in sorted(folder.glob("[!.]*.parquet")):
        try:
            footer = parquet.read_footer(path)
        except InputError as error:
            if path.stem in remade:
                continue
            raise InputError(f"{error}; or remove it, it does not belong to this sweep") from error
        held[path] = _part(designs, path, footer)
    most = max((part.end for part in held.values()), default=0)
    if most > designs.number:
        path, part = next((path, part) for path, part in held.items() if part.end > designs.number)
        raise InputError(
            f"{path}: contains designs {part.first} to {part.end - 1}, more than sweep.number ="
            f" {designs.number}; set it to {most} or more, or give another folder"
        )
    return held


def _part(designs: Designs, path: Path, footer: FileMetaData) -> _Part:
    of, code = ((footer.metadata or {}).get(key.encode(), b"").decode() for key in (DIGEST, CODE))
    if of != designs.digest:
        kind = designs.sweep.design
        fixed = "" if kind == "sobol" else f"; a {kind} of another size is another sweep"
        raise InputError(
            f"{path}: belongs to another sweep (digest {of or 'none'}, expected"
            f" {designs.digest}{fixed}); move the folder away, or give another one"
        )
    place = footer.schema.names.index("design")
    groups = [
        footer.row_group(group).column(place).statistics for group in range(footer.num_row_groups)
    ]
    return _Part(min(group.min for group in groups), max(group.max for group in groups) + 1, code)


_NUMBER = re.compile(r"[-+]?[0-9][-+.0-9e]*")


def failures(dataset: Path) -> Counter[str]:
    """Number of failed designs of a `dataset` by reason, without the numbers in it."""
    reasons = parquet.read_columns(dataset, ["reason"])["reason"].drop_null().to_pylist()
    messages = (
        reason.partition(": ")[2] if reason.startswith(SOURCE) else reason for reason in reasons
    )
    return Counter(_NUMBER.sub("...", reason).partition("; ")[0] for reason in messages)
