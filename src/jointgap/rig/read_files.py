"""Reading the runs of a campaign."""

from collections.abc import Mapping
from itertools import combinations
from math import tau

import numpy as np
import pandas as pd

from jointgap.config.campaign import CHANNELS, MOTOR_LINE, Campaign
from jointgap.core.csv_files import Columns, read_columns
from jointgap.core.errors import InputError, UnusableRun
from jointgap.core.units import split_share, unit_factor
from jointgap.rig.checks import (
    MIN_REVOLUTIONS,
    MIN_SAMPLES,
    RunFile,
    angle_outliers,
    checked_rotation,
    clipped,
    no_data,
    outliers,
    stuck,
    unsteady,
)
from jointgap.rig.contradictions import contradictions
from jointgap.rig.recording import OF_A_RUN, Contradiction, Measurements, Recording, noise_of, sentences

MAX_VALUE = 1e12  # [SI] No channel has a larger value: it stands for something else, such as 'no data'
COPIED_SHARE = 0.9  # [1, of the samples of a run] So many that are another run's make it a copy


def check_copies(files: Mapping[str, tuple[RunFile, Columns]]) -> None:
    """Whether all runs were measured by themselves, whatever the names, formats and order of their files."""
    rows = {run: _marks(columns) for run, (_, columns) in files.items()}
    for one, other in combinations(files, 2):
        few, many = sorted((rows[one], rows[other]), key=len)
        if np.unique(few).size < COPIED_SHARE * few.size:
            continue  # rounded so that cycles of one run are alike: another run's may be too
        count = int(np.isin(few, many).sum())
        if count > COPIED_SHARE * few.size:
            raise InputError(
                f"{files[other][0].path}: the run '{other}' has the samples of the run '{one}' in "
                f"{files[one][0].path} ({count} of {few.size} are the same to the last digit); a copy confirms "
                "nothing: give the file that was measured in this run, or one run with role split"
            )


def _marks(columns: Columns) -> np.ndarray:
    """A number for each sample, the same for the same values in all columns that are read."""
    # zeros and gaps are each of one kind only
    values = {name: np.where(np.isnan(own), np.nan, own + 0.0) for name, own in sorted(columns.values.items())}
    return pd.util.hash_pandas_object(pd.DataFrame(values), index=False).to_numpy()


_IDLE = {
    "speed": "follows from time and crank_angle",
    **dict.fromkeys(MOTOR_LINE, "is of a motor, so it needs drive: motor,"),
}
"""Why a nuisance is idle, where it is not for want of something to act on."""


def read_measurements(campaign: Campaign, compared: bool = True) -> Measurements:
    """All samples of a campaign.

    A sample without a time stamp, where times are measured, is no datum; nor is one without a crank angle where times
    are not. They are left out, and a remark says how many.
    """
    remarks = [
        f"nuisance {key} {_IDLE.get(key, 'has nothing to act on in this mechanism')} and is left out"
        for key in campaign.idle_nuisances
    ]
    found: list[Contradiction] = []
    wanted = [channel.column for channel in campaign.channels.values()]
    clock = campaign.channels["time"].column if "time" in campaign.channels else ""
    files = {run.id: RunFile(campaign, run) for run in campaign.runs}
    read = {run: (file, read_columns(file.path, wanted, campaign.csv, clock)) for run, file in files.items()}
    check_copies(read)
    runs = {}
    for run, (file, columns) in read.items():
        own: list[Contradiction] = []  # what a run holds that is left out is no doubt of its channels
        try:
            runs[run] = _recording(file, columns, remarks, own)
            found += own
        except UnusableRun as error:
            remarks.insert(0, f"run {run} is left out: {error}")
            found.append(Contradiction(run, "crank_angle", error.kind, str(error), doubtful=False))
    check_runs_left(campaign, {one.run: one.remark for one in found if one.kind in OF_A_RUN})
    others = contradictions(campaign, runs) if compared else []
    remarks += [f"{campaign.name}, {sentence}" for sentence in sentences(others)]
    return Measurements(runs, tuple(remarks), (*found, *others))


def check_runs_left(campaign: Campaign, left_out: Mapping[str, str]) -> None:
    """Make sure that a run for fitting is left."""
    fitted = {run.id for run in campaign.runs if run.role != "confirm"}
    if fitted and fitted <= left_out.keys():
        raise InputError(f"campaign {campaign.name}: no run for fitting can be used", *left_out.values())


def _recording(file: RunFile, columns: Columns, remarks: list[str], found: list[Contradiction]) -> Recording:
    """The samples of a run; what is remarked of them is added to `remarks`, channels that are clipped, stuck or marked
    as no data to `found`.
    """

    def tell(kind: str, name: str, remark: str, row: int | None = None) -> None:
        remarks.append(f"{file.place(name, row)}: {name} {remark}")
        found.append(Contradiction(file.run.id, name, kind, f"{name} {remark}"))

    campaign, run = file.campaign, file.run
    _check_units(file, columns, remarks)
    remarks += columns.remarks
    values, rows = _without_repeated(file, *_in_si(file, columns, remarks), remarks)
    if rows.size < MIN_SAMPLES:
        raise InputError(f"{file.path}: {rows.size} samples are too few; give {MIN_SAMPLES} at least")
    absent = {name: no_data(samples) for name, samples in values.items() if name != "time"}
    for name, places in absent.items():
        if places.size:
            value = file.as_written(name, values[name][places[0]])
            many = f"is far from all else in {places.size} of {rows.size} samples, which are {value}"
            remark = f"{many}; leave the cells empty if that stands for 'no data'"
            tell("no_data", name, remark, rows[places[0]])
    time, angle, turned = checked_rotation(file, values, rows, absent.get("crank_angle", np.empty(0, int)))
    channels = {name: samples for name, samples in values.items() if name not in ("time", "crank_angle")}
    for name, samples in channels.items():
        _check_varies(file, name, samples)
        samples = samples.copy()
        samples[absent[name]] = np.nan
        if (still := stuck(samples, angle if "crank_angle" in values else turned)) is not None:
            tell("stuck", name, _stands_still(file, name, samples, still), rows[still.start])
        elif (remark := clipped(samples)) is not None:
            tell("clipped", name, remark)
        if (places := outliers(samples)).size:
            remarks.append(
                f"{file.place(name, rows[places[0]])}: {samples[places[0]]:g} {CHANNELS[name]} is far from all else "
                f"(so {_are(places.size)}); leave the cell empty if it stands for 'no data'"
            )
    # a crank that begins at rest may stand still itself
    if run.start == "settled" and "crank_angle" in values and (still := stuck(angle, turned)) is not None:
        remark = _stands_still(file, "crank_angle", values["crank_angle"], still)
        tell("stuck", "crank_angle", remark, rows[still.start])
    if "time" in values and "crank_angle" in values and (places := angle_outliers(time, angle)).size:
        remarks.append(
            f"{file.place('crank_angle', rows[places[0]])}: the angle is far off its neighbours' "
            f"(so {_are(places.size)}); leave the cell empty if the encoder misread it"
        )
    if remark := unsteady(campaign, run, time, angle):
        remarks.append(f"{file.path}: {remark}")
    return Recording(run.id, time, angle, channels, noise_of(campaign, run.id), _held_out(file, turned))


def _stands_still(file: RunFile, name: str, values: np.ndarray, still: slice) -> str:
    count, value = still.stop - still.start, file.as_written(name, values[still.start])
    return (
        f"is stuck: {count} of {values.size} samples in a row are {value} while the crank turns; mend the sensor, or "
        "leave these cells empty"
    )


def _held_out(file: RunFile, turned: np.ndarray) -> np.ndarray:
    """Samples that are held out: all of a run to confirm with, the last third of a split one; `turned` (n,) [rad]."""
    if file.run.role != "split":
        return np.full(turned.size, file.run.role == "confirm")
    total = turned[-1] - turned[0]
    if total < 1.5 * tau * MIN_REVOLUTIONS:
        raise InputError(
            f"{file.path}: {total / tau:.4g} revolutions leave less than one for fitting when the last third of the "
            f"run '{file.run.id}' is held out; give a longer record, or another role than split"
        )
    return turned > turned[0] + 2.0 / 3.0 * total


def _check_units(file: RunFile, columns: Columns, remarks: list[str]) -> None:
    """Whether a row of units in the file says what the campaign says."""
    for name, channel in file.campaign.channels.items():
        unit = columns.units.get(channel.column)
        try:
            factor = unit_factor(unit, CHANNELS[name]) if unit and channel.scale is None else None
        except Exception:  # no unit that pint knows: the campaign's is taken
            continue
        if factor is not None and not np.isclose(factor, file.campaign.factor(name), rtol=1e-6):
            raise InputError(
                f"{file.place(name)}: the row below the headings says '{unit}', but channels.{name}.unit is "
                f"'{channel.unit}'; correct one of them"
            )
    if columns.units:
        row = ", ".join(columns.units.values())
        remarks.append(f"{file.path}: the row below the headings ({row}) is taken as units and skipped")


def _in_si(file: RunFile, columns: Columns, remarks: list[str]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Channels in SI without the samples that have no time (or angle), and the rows of the file that remain."""
    values = {}
    for name, channel in file.campaign.channels.items():
        written = columns.values[channel.column]
        if split_share(channel.unit)[1] > 1.0:
            written, bits = _without_overflow(written)
            if bits:
                remarks.append(f"{file.place(name)}: the counter of {bits} bits overflows; its counts are continued")
        factor = 1.0 if name == "time" and columns.is_dated else channel.sign * file.campaign.factor(name)
        with np.errstate(over="ignore"):  # refused below
            values[name] = factor * written
        values[name][np.abs(values[name]) < 1e-150] = 0.0  # their squares underflow
        if (huge := np.flatnonzero(np.abs(values[name]) > MAX_VALUE)).size:
            raise InputError(
                f"{file.place(name, columns.rows[huge[0]])}: {written[huge[0]]:g} {channel.unit} is more than any "
                "sensor reads; correct it, or leave the cell empty where nothing was measured"
            )
    place = "time" if "time" in values else "crank_angle"
    kept = np.isfinite(values[place])
    if not kept.all():
        count = int(np.count_nonzero(~kept))
        lack = "1 sample has" if count == 1 else f"{count} samples have"
        remarks.append(f"{file.place(place)}: {lack} no {place.replace('_', ' ')}, left out")
    return {name: samples[kept] for name, samples in values.items()}, columns.rows[kept]


def _without_overflow(counts: np.ndarray) -> tuple[np.ndarray, int]:
    """Counts that run on where the counter overflowed, and the counter's bits; 0 where it did not."""
    finite = np.flatnonzero(np.isfinite(counts))
    steps = np.abs(np.diff(counts[finite]))
    for bits in (16, 24, 32):
        if steps.size and abs(steps.max() - 2.0**bits) <= 4.0 * max(float(np.median(steps)), 1.0):
            counts = counts.copy()
            counts[finite] = np.unwrap(counts[finite], period=2.0**bits)
            return counts, bits
    return counts, 0


def _without_repeated(
    file: RunFile, values: dict[str, np.ndarray], rows: np.ndarray, remarks: list[str]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Channels and rows without samples that repeat the one before, or of which the campaign keeps one a time."""
    if "time" not in values or not rows.size:
        return values, rows
    again = np.diff(values["time"]) == 0.0
    if which := file.campaign.channels["time"].repeated:
        kept = ~np.append(again, False) if which == "last" else ~np.append(False, again)
    else:
        for samples in values.values():
            again &= (samples[1:] == samples[:-1]) | (np.isnan(samples[1:]) & np.isnan(samples[:-1]))
        kept = ~np.append(False, again)
    if not kept.all():
        first, count = rows[np.flatnonzero(~kept)[0]], np.count_nonzero(~kept)
        rule = f"of rows of one time the {which} is kept" if which else "they repeat the row before them"
        remarks.append(f"{file.place('time', first)}: {rule}; so {_are(count)}, left out")
    return {name: samples[kept] for name, samples in values.items()}, rows[kept]


def _are(count: int) -> str:
    return "is 1 sample" if count == 1 else f"are {count} samples"


def _check_varies(file: RunFile, name: str, values: np.ndarray) -> None:
    finite = values[np.isfinite(values)]
    if finite.size < MIN_SAMPLES:
        what, fix = f"has {finite.size} values, too few of {MIN_SAMPLES}", "give the measurement"
    elif np.ptp(finite) == 0.0:
        what, fix = "is constant, so the sensor told nothing", "mend it"
    else:
        return
    raise InputError(f"{file.place(name)}: {what}; {fix}, or take the channel out of the campaign")
