"""Designs of a sweep, simulated and measured, as a dataset of Parquet files of which finished parts are kept."""

import math
import re
from collections import Counter
from collections.abc import Container
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd
from pyarrow.parquet import FileMetaData
from scipy.optimize import newton

from jointgap.config import Mechanism, Simulate
from jointgap.config.designs import MOST_DESIGNS
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINTS
from jointgap.core.progress import followed, parts
from jointgap.core.schema import SWEEP_DESIGNS, Table
from jointgap.designs.sampling import SOURCE, Designs, ErrorCounting
from jointgap.dynamics.parallel import Outcome, Run, numbers_of, rod_and_slider, side_by_side, simulate_run
from jointgap.dynamics.parameters import Parameters
from jointgap.dynamics.sampling import ROUNDING, angle_errors, contact_sums, largest_change, slider_and_forces
from jointgap.dynamics.simulation import IntegrationResult, crank_angles
from jointgap.lengths.objective import Objective, objective_of_motion
from jointgap.paper.printed import OPTIMA

_NO_ERROR = 1e-12
"""RMS [rad] below which an error is rounding, of which no share is told."""

_NEAR = 1e-4
"""Share of the crank's length between the first two lengths that are tried: less than what clearances ask for."""

_CLOSE = 1e-9
"""Share of the crank's length to which the best one is found: a tenth of a nanometre."""


def best_lengths(outcome: Outcome, counted: Objective | None) -> dict[str, float]:
    """The numbers `BEST_LENGTHS` of a run that did not fail; NaN where undefined."""
    per_turn = outcome.run.options.samples_per_revolution
    last = _objective(outcome, slice(-per_turn - 1, -1))  # the revolution's end is its beginning again
    return _best("", last) | _best("_in_window", counted)


def printed_optima(counted: Objective | None, measure: str) -> dict[str, float]:
    """The numbers `PRINTED_OPTIMA` of a run that did not fail; NaN without samples."""
    names = [f"reduction_at_{printed.key}" for printed in OPTIMA]
    if counted is None:
        return dict.fromkeys(names, math.nan)
    lengths = np.array([(printed.crank_length, printed.rod_length) for printed in OPTIMA])
    return dict(zip(names, getattr(counted.reductions(lengths), measure), strict=True))


def counted_objective(outcome: Outcome, counting: ErrorCounting) -> Objective | None:
    """The error of a run as a function of the lengths, in the window that counts; None where no sample lies in it."""
    per_turn = outcome.run.options.samples_per_revolution
    turn = slice((counting.revolution - 1) * per_turn, counting.revolution * per_turn)
    return _objective(outcome, turn, counting.window)


def _objective(outcome: Outcome, turn: slice, window: tuple[float, float] = (0.0, 2.0 * math.pi)) -> Objective | None:
    angle, result = outcome.crank_angle[turn], outcome.result
    # A sample at the beginning of a later revolution may lie short of it by rounding.
    place = (angle + ROUNDING) % (2.0 * math.pi)
    inside = (place >= window[0]) & (place <= window[1] + 2.0 * ROUNDING)
    if not inside.any():
        return None
    rod, _ = rod_and_slider(outcome.parameters, angle, result.states[turn], result.auxiliary_states[turn])
    return objective_of_motion(outcome.run.mechanism, angle[inside], rod[inside])


def _best(suffix: str, objective: Objective | None) -> dict[str, float]:
    crank = reduction = ratio = math.nan
    if objective is not None:
        rod = objective.original[1]
        crank = best_crank_length(objective, rod)
        ratio = crank / rod
        before, after = objective.value(objective.original), objective.value((crank, rod))
        if before > len(objective.sine) * _NO_ERROR**2:
            reduction = 1.0 - math.sqrt(after / before)  # of the RMS, for as many samples
    return {
        f"best_crank_length{suffix}": crank,
        f"best_ratio{suffix}": ratio,
        f"reduction_at_best{suffix}": reduction,
    }


def best_crank_length(objective: Objective, rod_length: float) -> float:
    """Crank length [m] of the least sum of squares, equation (12), on a rod of one length; NaN where none is found.

    The error is nearly affine in it, and so the derivative of the sum of squares too: secants find where it is zero.
    """
    crank = objective.original[0]
    with np.errstate(invalid="ignore"):  # lengths at which the rod does not reach the slide have no error
        found, state = newton(
            lambda length: objective.gradient((length, rod_length))[0],
            crank,
            x1=(1.0 + _NEAR) * crank,
            tol=_CLOSE * crank,
            full_output=True,
            disp=False,
        )
    return float(found) if state.converged else math.nan


_SAMPLED = ("times", "states", "auxiliary_states", "modes", "approaches", "begins")
_ERRORS = tuple(f"angle_error_{size}{span}" for span in ("", "_in_window") for size in ("rms", "mean", "peak"))


def angles_to_measure(options: Simulate) -> np.ndarray:
    """Crank angles [rad] of the samples that `measures` reads: the first revolution, and the last two."""
    angles, per_turn = crank_angles(options), options.samples_per_revolution
    return np.concatenate((angles[:per_turn], angles[max(per_turn, len(angles) - 2 * per_turn - 1) :]))


def measures(outcome: Outcome, window: tuple[float, float]) -> dict[str, float]:
    """The numbers `MEASURES` of a run that did not fail [SI]; NaN where undefined."""
    result, mechanism, p = outcome.result, outcome.run.mechanism, outcome.parameters
    per_turn = outcome.run.options.samples_per_revolution
    last = slice(-per_turn - 1, None)
    position, acceleration, peaks, sizes = slider_and_forces(p, *(getattr(result, name)[last] for name in _SAMPLED))

    def errors_of(samples: slice, counted: tuple[float, float]) -> tuple[float, ...]:
        states = result.states[samples], result.auxiliary_states[samples]
        return angle_errors(p, outcome.crank_angle[samples], *states, *counted)

    # The last revolution's end is its beginning again.
    *errors, least = errors_of(slice(-per_turn - 1, -1), (-math.inf, math.inf))
    *errors_in_window, _ = errors_of(slice(0, per_turn), window)
    found = dict(zip(_ERRORS, (*errors, *errors_in_window), strict=True))
    found |= {"least_transmission_angle": least}
    found |= _travel(position[:-1], outcome.crank_angle[last][:-1])
    rms = math.sqrt(np.mean(acceleration[:-1] ** 2))
    noise = high_order_rms(acceleration[:-1]) / rms if rms else math.nan
    found |= {"acceleration_rms": rms, "noise_share": noise}
    found |= {"repeat_distance": _repeat_distance(result, mechanism, per_turn)}
    begin, end = float(result.times[last.start]), float(result.times[-1])
    touching, impacts, peaks_of_contacts = contact_sums(result.events, begin, end)
    loose = mechanism.loose
    for number, joint in enumerate(JOINTS):
        moves = joint in loose
        found |= {
            f"{joint}_contact_share": float(touching[number]) / (end - begin) if moves else math.nan,
            f"{joint}_impacts": float(impacts[number]) if moves else math.nan,
            # A sample may miss the peak of a short contact.
            f"{joint}_peak_force": float(max(peaks[number], peaks_of_contacts[number])),
            f"{joint}_rms_force": float(sizes[number]),
        }
    return found


def high_order_rms(values: np.ndarray) -> float:
    """RMS of what one revolution of `values` holds above order `NOISE_ORDER`."""
    spectrum = np.fft.rfft(values)
    spectrum[: NOISE_ORDER + 1] = 0.0
    squares = 2.0 * np.sum(spectrum.real**2 + spectrum.imag**2)  # Parseval: each order counts for its mirror image too
    if len(values) % 2 == 0:
        squares -= abs(spectrum[-1]) ** 2  # but the highest is its own
    return math.sqrt(squares) / len(values)


def _travel(position: np.ndarray, angle: np.ndarray) -> dict[str, float]:
    """Stroke [m] and crank angles of the dead centres [rad], between samples by a parabola."""
    outer, outer_angle = _extreme(position, angle)
    inner, inner_angle = _extreme(-position, angle)
    # Around 0 and around pi, where they lie without an offset: so that a mean over designs means something.
    outer_angle = (outer_angle + math.pi) % (2.0 * math.pi) - math.pi
    return {
        "stroke": outer + inner,
        "outer_dead_centre_angle": outer_angle,
        "inner_dead_centre_angle": inner_angle,
    }


def _extreme(values: np.ndarray, angle: np.ndarray) -> tuple[float, float]:
    """Largest of periodic samples and the angle [0, 2 pi) where it lies."""
    top = int(np.argmax(values))
    before, here, after = values[top - 1], values[top], values[(top + 1) % len(values)]
    curvature = before - 2.0 * here + after
    shift = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    place = angle[top] + shift * 2.0 * math.pi / len(values)
    return float(here - 0.25 * (before - after) * shift), float(place % (2.0 * math.pi))


def _repeat_distance(result: IntegrationResult, mechanism: Mechanism, per_turn: int) -> float:
    """Largest distance of the clearance vectors over the last revolution from those of the one before, as a share of
    the smallest clearance; NaN with one revolution, or without clearance.
    """
    loose = mechanism.loose
    if len(result.times) < 2 * per_turn + 1 or not loose:
        return math.nan
    two = slice(-2 * per_turn - 1, None)
    smallest = min(mechanism.clearance(joint) for joint in loose)
    return largest_change(result.states[two], result.auxiliary_states[two], per_turn) / smallest


DIGEST = "jointgap_sweep"
"""Key of a file's metadata: the digest of the sweep that its designs belong to."""

CODE = "jointgap_code"
"""Key of a file's metadata: the digest of the code that simulated and measured them."""

NOISE_ORDER = 10  # order of the crank above which acceleration counts as noise

_TOGETHER = 32
"""Designs that one thread first prepares, then simulates, then measures: a simulation drives what the others need out
of the processor's cache, and one by one they take a fifth more. More at once save little and hold more motions.
"""


def table_of(designs: Designs) -> Table:
    """The table of these designs."""
    return SWEEP_DESIGNS.filled(swept=[axis.column for axis in designs.axes], measured=designs.measured)


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
    parquet.check_writable(path)
    more = simulate_designs(designs, first + len(kept), count - len(kept), workers)
    frame = pd.concat([kept, more], ignore_index=True) if len(kept) else more
    parquet.write(table, frame, path, {DIGEST: designs.digest, CODE: code})


def _kept(designs: Designs, first: int, count: int, path: Path, code: str) -> pd.DataFrame:
    """The designs of a part that its file holds; none where it is damaged, or of another sweep or code."""
    none = pd.DataFrame({name: [] for name in table_of(designs).names})
    try:
        footer = parquet.read_footer(path)
    except InputError:
        return none
    told = footer.metadata or {}
    if told.get(DIGEST.encode()) != designs.digest.encode() or told.get(CODE.encode()) != code.encode():
        return none
    begin, end = _span(footer)
    return parquet.read(table_of(designs), path) if begin == first and end <= first + count else none


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
    wanted = parts(designs.number, per_job)
    for path, (begin, end, _) in _held(designs, folder, remade=wanted).items():
        first, count = wanted.get(path.stem, (-1, 0))
        if begin != first or end > first + count:
            raise InputError(
                f"{path}: holds designs {begin} to {end - 1}, which are no part of this sweep in parts of {per_job}; "
                "set sweep.designs_per_job as it was when the folder was made, or give another folder"
            )


def check_dataset(designs: Designs, folder: Path) -> None:
    """Whether the files in a `folder` are those of the sweep `designs` and hold each design once."""
    held = _held(designs, folder)
    if not held:
        raise InputError(f"{folder}: holds no designs; simulate them first")
    codes = {code: path for path, (*_, code) in held.items()}
    if len(codes) > 1:
        first, second, *_ = sorted(codes.values())
        raise InputError(
            f"{first} and {second}: were measured by different versions of jointgap; start the sweep again, which "
            "measures the older ones anew"
        )
    reached = 0
    for path, (begin, end, _) in sorted(held.items(), key=lambda item: item[1][:2]):
        if begin < reached:
            raise InputError(f"{path}: design {begin} is there twice; remove this file and start again")
        if begin > reached:
            break
        reached = end
    if reached < designs.number:
        raise InputError(f"{folder}: design {reached} is missing; start again, which makes its part")


def _held(designs: Designs, folder: Path, remade: Container[str] = ()) -> dict[Path, tuple[int, int, bytes | None]]:
    """Of each file in a `folder` its first design, the one after its last, and the digest of its code.

    Damaged files whose names are in `remade` are left out, for they are made again.
    """
    held = {}
    for path in sorted(folder.glob("[!.]*.parquet")):
        try:
            footer = parquet.read_footer(path)
        except InputError as error:
            if path.stem in remade:
                continue
            raise InputError(f"{error}; or remove it, it is no part of this sweep") from error
        told = footer.metadata or {}
        if (of := told.get(DIGEST.encode(), b"").decode()) != designs.digest:
            fixed = "" if designs.kind == "sobol" else f"; a {designs.kind} of another size is another sweep too"
            raise InputError(
                f"{path}: belongs to another sweep (its digest is {of or 'none'}, this one's is {designs.digest}"
                f"{fixed}); move the folder away, or give another one"
            )
        held[path] = (*_span(footer), told.get(CODE.encode()))
    most = max((end for _, end, _ in held.values()), default=0)
    for path, (begin, end, _) in held.items():
        if end > designs.number:
            raise InputError(
                f"{path}: holds designs {begin} to {end - 1}, but sweep.number asks for {designs.number}; ask for "
                f"{most} or more, for a sweep only grows, or give another folder"
            )
    return held


def _span(footer: FileMetaData) -> tuple[int, int]:
    """First design of a file, and the one after its last."""
    place = footer.schema.names.index("design")
    groups = [footer.row_group(group).column(place).statistics for group in range(footer.num_row_groups)]
    return min(group.min for group in groups), max(group.max for group in groups) + 1


_NUMBER = re.compile(r"[-+]?[0-9][-+.0-9e]*")


def failures(dataset: Path) -> Counter[str]:
    """How many designs of a `dataset` failed, by the reason without what differs from design to design."""
    reasons = parquet.read_columns(dataset, ["reason"])["reason"].drop_null().to_pylist()
    told = (reason.partition(": ")[2] if reason.startswith(SOURCE) else reason for reason in reasons)
    return Counter(_NUMBER.sub("...", reason).partition("; ")[0] for reason in told)
