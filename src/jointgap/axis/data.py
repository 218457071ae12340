"""The measured runs of a model of your own, in SI units."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jointgap.axis.model_file import DRIVE, POSITION, ModelFile, ModelRun, unit_of_channel
from jointgap.core.csv_files import read_columns
from jointgap.core.errors import InputError
from jointgap.rig import checks
from jointgap.rig.checks import MIN_SAMPLES
from jointgap.rig.sensors import low_pass

# [1] Largest deviation of a sampling interval from the median, where a low-pass is applied
UNEVEN = 0.01
# Periods of the corner at both ends of a run within which the filter's start disturbs accelerations
EDGE_PERIODS = 1.0
_RESPONSE_PERIODS = 6.0  # Of the corner, after which its response has faded


@dataclass(frozen=True)
class RunData:
    """The samples of one run."""

    run: ModelRun
    time: np.ndarray  # (n,) [s], from 0 on
    channels: dict[str, np.ndarray]  # (n,) [SI] by name, without time; NaN for gaps
    reduce: Callable[[np.ndarray], np.ndarray]  # Of samples (n,) to those compared (m,)
    filtered: Callable[[np.ndarray], np.ndarray]  # The low-pass of a given position, or none
    count: int  # Samples whose mean is compared
    noise_gain: float  # [1] Of white noise, from a sample to what is compared
    edge: float  # [s] At both ends, where a filtered motion is not known well enough to compare

    @property
    def interval(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def held_out(self) -> np.ndarray:
        """Compared samples (m,) that are used for neither fitting nor selection."""
        place = np.arange(self.reduce(self.time).size)
        first = {"identify": place.size, "confirm": 0, "split": 2 * place.size // 3}[self.run.role]
        return place >= first


def read_runs(model: ModelFile, needed: Sequence[str]) -> tuple[dict[str, RunData], list[str]]:
    """All runs by id, and remarks on the data; `needed` channels have no gaps.

    Raises
    ------
    InputError
        A file is missing or invalid; the message gives file, column and row.
    """
    runs, remarks = {}, []
    for run in model.runs:
        runs[run.id] = _read_run(model, run, needed, remarks)
    return runs, remarks


def _read_run(
    model: ModelFile, run: ModelRun, needed: Sequence[str], remarks: list[str]
) -> RunData:
    path = model.folder / run.file
    if not path.is_file():
        raise InputError(f"{path}: no such file; correct `file` of run {run.id}")
    clock = model.channels["time"].column
    columns = [channel.column for channel in model.channels.values()]
    read = read_columns(path, columns, model.csv, clock)
    remarks += [f"{path}: {remark}" for remark in read.remarks]
    values = {}
    for name, channel in model.channels.items():
        factor = 1.0 if name == "time" and read.began is not None else model.factor(name)
        values[name] = channel.sign * factor * read.values[channel.column]
        unit = unit_of_channel(name, channel)[0]
        if other := read.other_unit(channel.column, model.factor(name), unit):
            raise InputError(
                f"{path}, column {channel.column}: the row of units says '{other}', the model file"
                f" '{channel.unit}'; correct channels.{name}.unit"
            )
    time = values.pop("time")
    begin, end = run.span
    used = ~(time < begin) & ~(time > end)
    time, rows = time[used], read.rows[used]
    values = {name: samples[used] for name, samples in values.items()}
    if time.size < MIN_SAMPLES:
        raise InputError(
            f"{path}: run {run.id} has {time.size} samples; give at least {MIN_SAMPLES}, or correct"
            " 'from' and 'to'"
        )
    _check_times(path, clock, time, rows)
    for name, samples in values.items():
        where = f"{path}, column {model.channels[name].column}"
        is_input = name in needed and name != POSITION
        _check_samples(where, name, samples, rows, name in needed, is_input, remarks)
    time = time - time[0]
    filtered, count, noise_gain, edge = _filters(model, str(path), time)
    usable = time.size // count * count
    if usable // count < MIN_SAMPLES:
        raise InputError(
            f"{path}: means of {count} samples leave {usable // count} of run {run.id}; give at"
            f" least {MIN_SAMPLES}, or a smaller mean_of"
        )

    def reduce(samples: np.ndarray) -> np.ndarray:
        return samples[:usable].reshape(-1, count).mean(axis=1) if count > 1 else samples

    return RunData(run, time, values, reduce, filtered, count, noise_gain, edge)


def _filters(
    model: ModelFile, path: str, time: np.ndarray
) -> tuple[Callable[[np.ndarray], np.ndarray], int, float, float]:
    """The low-pass of a given position, the number of samples whose mean is compared, the gain of
    white noise by both, and the time [s] at both ends that is not compared."""
    corner = model.channels[POSITION].bandwidth if POSITION in model.channels else None
    if corner is None:
        count = model.mean_of or 1
        return (lambda samples: samples), count, count**-0.5, 0.0
    intervals = np.diff(time)
    interval = float(np.median(intervals))
    if np.abs(intervals / interval - 1.0).max() > UNEVEN:
        raise InputError(
            f"{path}: its time stamps are not evenly spaced, which channels.position.bandwidth"
            " requires; resample it, or remove bandwidth and give the column of the velocity"
        )
    if corner >= 0.45 / interval:
        raise InputError(
            f"{path}: channels.position.bandwidth = {corner:g} Hz is too high for samples every"
            f" {interval:g} s; give at most {0.4 / interval:.3g} Hz"
        )

    def filtered(samples: np.ndarray) -> np.ndarray:
        known = np.isfinite(samples)
        if not known.all():  # gaps stay gaps
            samples = np.interp(time, time[known], samples[known])
        return np.where(known, low_pass(samples, interval, corner, causal=False), np.nan)

    count = model.mean_of or max(round(0.5 / (corner * interval)), 1)
    impulse = np.zeros(2 * max(round(_RESPONSE_PERIODS / (corner * interval)), count) + 1)
    impulse[impulse.size // 2] = 1.0
    response = low_pass(impulse, interval, corner, causal=False)
    response = np.convolve(response, np.full(count, 1.0 / count))
    return filtered, count, float(np.linalg.norm(response)), EDGE_PERIODS / corner


def _check_times(path, clock: str, time: np.ndarray, rows: np.ndarray) -> None:
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        raise InputError(f"{path}, column {clock}, row {rows[bad[0]]}: no time; remove the row")
    falls = np.flatnonzero(np.diff(time) <= 0.0)
    if falls.size:
        row = rows[falls[0] + 1]
        raise InputError(
            f"{path}, column {clock}, row {row}: the time {time[falls[0] + 1]:g} s is not after"
            f" {time[falls[0]]:g} s of the row before; sort or correct the rows"
        )


def _check_samples(
    where: str,
    name: str,
    samples: np.ndarray,
    rows: np.ndarray,
    is_needed: bool,
    is_input: bool,
    remarks: list[str],
) -> None:
    """InputError for unusable samples; other doubts become remarks. 'No data' values become gaps,
    except of a drive, which may have pulses."""
    if name != DRIVE and (places := checks.no_data(samples)).size:
        value = samples[places[0]]
        remarks.append(
            f"{where}, row {rows[places[0]]}: {places.size} samples are {value:g}, which looks like"
            " 'no data'; they are not used"
        )
        samples[places] = np.nan
    finite = np.isfinite(samples)
    if is_needed and not finite.all():
        row = rows[np.flatnonzero(~finite)[0]]
        raise InputError(
            f"{where}, row {row}: no value, but {name} must be known at every sample; fill the gap,"
            " or cut the run by 'from' and 'to'"
        )
    if np.count_nonzero(finite) < MIN_SAMPLES:
        raise InputError(
            f"{where}: has {np.count_nonzero(finite)} values, fewer than {MIN_SAMPLES}; correct the"
            " column"
        )
    if not np.ptp(samples[finite]) > 0.0:
        if is_input:
            return
        raise InputError(f"{where}: all values of {name} are {samples[finite][0]:g}; correct it")
    if name != POSITION and (remark := checks.clipped(samples)):
        remarks.append(f"{where}: {name} {remark}")
    if (far := checks.outliers(samples)).size:
        remarks.append(
            f"{where}, row {rows[far[0]]}: {name} is far from all other values"
            f" ({far.size} samples); if it is no reading, leave the cell empty"
        )
