"""Reading the runs of a campaign: columns to channels in SI, with checks of files, runs and
channels."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import degrees, tau
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config.campaign import (
    MOTOR_LINE,
    PRESSURE_SENSOR,
    Campaign,
    CampaignRun,
    channel_factor,
)
from jointgap.config.channels import CHANNELS, PRESSURES
from jointgap.core.csv_files import Columns, read_columns
from jointgap.core.errors import InputError, UnusableRun
from jointgap.core.units import split_share
from jointgap.core.words import number
from jointgap.rig import checks
from jointgap.rig.checks import MIN_SAMPLES, REPORTED_SPEED_ERROR, SPEED_RATIOS
from jointgap.rig.consistency_checks import consistency_checks
from jointgap.rig.recording import (
    OF_A_RUN,
    Contradiction,
    Measurements,
    Recording,
    noise_of,
    sentences,
)

MIN_REVOLUTIONS = 1.0 - 1e-3  # One, with a margin for rounding
MIN_SAMPLES_PER_REVOLUTION = 4.0  # With fewer the direction of rotation is ambiguous
LEAST_PRESSURE = 1e3  # [Pa] Largest value of a pressure below which its unit is doubted
PROPOSED_UNITS = {"time": ("s", "ms", "us", "ns", "min"), "crank_angle": ("deg", "rad", "turn")}

Samples = dict[str, np.ndarray]  # Values (n,) [SI] by channel


@dataclass
class RunFile:
    """A file of a run, with the messages and contradictions of the run."""

    campaign: Campaign
    run: CampaignRun
    path: Path
    columns: Columns
    remarks: list[str] = field(default_factory=list)
    found: list[Contradiction] = field(default_factory=list)
    rows: np.ndarray | None = (
        None  # Line of the file (from 1) of each sample; 0 for samples of the other file
    )
    other: "RunFile | None" = None  # The file of a second logger
    is_joined: bool = False  # Whether the samples have several grids of times

    @property
    def channels(self) -> list[str]:
        """The channels in this file."""
        return [
            name
            for name, one in self.campaign.channels.items()
            if one.column in self.columns.values
        ]

    @property
    def paths(self) -> str:
        """The files of the run, for messages."""
        return f"{self.path} and {self.other.path}" if self.other else str(self.path)

    def place(self, channel: str, sample: int | None = None) -> str:
        """``run.csv, column t, row 3`` for a `channel` and a `sample`."""
        is_here = channel in self.channels and (
            sample is None or channel != "time" or self.rows[sample]
        )
        if self.other is not None and not is_here:
            return self.other.place(channel, sample)
        at = "" if sample is None else f", row {self.rows[sample]}"
        return f"{self.path}, column {self.campaign.channels[channel].column}{at}"

    def remark(self, channel: str, text: str, sample: int | None = None) -> None:
        self.remarks.append(f"{self.place(channel, sample)}: {text}")

    def doubt(self, kind: str, channel: str, text: str, sample: int | None = None) -> None:
        self.remark(channel, f"{channel} {text}", sample)
        self.found.append(Contradiction(self.run.id, channel, kind, f"{channel} {text}"))

    def error(self, channel: str, text: str, sample: int | None = None) -> InputError:
        return InputError(f"{self.place(channel, sample)}: {text}")

    def in_file_unit(self, channel: str, value: float) -> str:
        """A `value` [SI] of `channel` with the unit and sign of the file."""
        stated = self.campaign.channels[channel]
        return f"{stated.sign * value / self.campaign.factor(channel):g} {stated.unit}"

    def proposal(self, channel: str, fitting: Mapping[str, bool]) -> str:
        """How to fix the unit of a `channel`, given which units would fit."""
        unit = self.campaign.channels[channel].unit
        if others := [other for other, fits in fitting.items() if fits and other != unit]:
            return f"channels.{channel}.unit is '{unit}': did you mean '{others[0]}'?"
        return f"check channels.{channel}.unit = '{unit}' and the run's speed, or measure again"

    def in_units(self, channel: str) -> dict[str, float]:
        """Factors [1] from values of `channel` in its stated unit to values read in other units."""
        return {
            unit: channel_factor(channel, unit) / self.campaign.factor(channel)
            for unit in PROPOSED_UNITS[channel]
        }


_IDLE = dict.fromkeys(MOTOR_LINE, "requires drive: motor") | {
    "speed": "follows from time and crank_angle",
    "crank_inertia": "requires drive: motor or measured_angle",
    **dict.fromkeys(
        PRESSURE_SENSOR,
        "requires a slider_force_table of a pressure, or the channel cylinder_pressure",
    ),
}
"""Why a nuisance has no effect, if the mechanism is not the reason."""


def read_measurements(campaign: Campaign, compared: bool = True) -> Measurements:
    """All samples of a campaign.

    Samples without time stamp (or, without times, without crank angle) are skipped with a remark.
    """
    remarks = [
        f"nuisance {key} {_IDLE.get(key, 'has no effect in this mechanism')} and is ignored"
        for key in campaign.idle_nuisances
    ]
    files = {run.id: _opened(campaign, run) for run in campaign.runs}
    check_copies([each for file in files.values() for each in (file, file.other) if each])
    runs, found = {}, []
    for run, file in files.items():
        try:
            runs[run] = _recording(file)
            found += file.found  # not for an unusable run
        except UnusableRun as error:
            remarks.insert(0, f"run {run} is not used: {error}")
            found.append(Contradiction(run, "crank_angle", error.kind, str(error), doubtful=False))
        remarks += file.remarks
    check_runs_left(campaign, {one.run: one.remark for one in found if one.kind in OF_A_RUN})
    others = consistency_checks(campaign, runs) if compared else []
    remarks += [f"{campaign.name}, {sentence}" for sentence in sentences(others)]
    return Measurements(runs, tuple(remarks), (*found, *others))


def _opened(campaign: Campaign, run: CampaignRun) -> RunFile:
    """The file of a run, and of two the one with the crank angle or else the first; InputError
    unless each column is in exactly one of them.
    """
    wanted = [channel.column for channel in campaign.channels.values()]
    clock = campaign.channels["time"].column if "time" in campaign.channels else ""
    paths, two = [campaign.folder / file for file in run.files], len(run.files) == 2
    files = [
        RunFile(campaign, run, path, read_columns(path, wanted, campaign.csv, clock, two))
        for path in paths
    ]
    if not two:
        return files[0]
    for name, channel in campaign.channels.items():
        owners = [file for file in files if name in file.channels]
        if not owners or (name != "time" and len(owners) == 2):
            which, fix = (
                ("both", "rename it in one of them")
                if owners
                else ("neither", "correct the column's name")
            )
            has = "have" if owners else "has"
            raise InputError(
                f"{paths[0]} and {paths[1]}: {which} {has} the column '{channel.column}'; {fix}"
            )
    for file in files:
        if file.channels == ["time"]:
            raise InputError(
                f"{file.path}: has no channel of the campaign besides time; remove it from 'file'"
            )
    main, other = sorted(files, key=lambda file: "crank_angle" not in file.channels)
    if apart := [name for name in PRESSURES if name in other.channels]:
        text = (
            "a pressure is averaged over the crank angle; record both by one logger, or give a"
            " slider_force_table"
        )
        raise other.error(apart[0], text)
    began = [file.columns.began for file in files]
    if None in began and began != [None, None]:
        raise InputError(
            f"{main.paths}, column {clock}: one has dates and the other numbers; write both alike"
        )
    if None not in began:
        later = (other.columns.began - main.columns.began).total_seconds()
        other.columns.values[clock] = other.columns.values[clock] + later
    return replace(main, other=replace(other, remarks=main.remarks, found=main.found))


def check_copies(files: Sequence[RunFile]) -> None:
    """InputError if a run is a copy of another one."""
    rows = []  # a hash for each sample
    for file in files:
        values = pd.DataFrame(
            {name: own + 0.0 for name, own in sorted(file.columns.values.items())}
        )
        rows.append(pd.util.hash_pandas_object(values, index=False).to_numpy())
    for (one, own), (other, others) in combinations(zip(files, rows, strict=True), 2):
        few, many = sorted((own, others), key=len)
        if np.unique(few).size < 0.9 * few.size:
            continue  # coarsely rounded: equal samples are no evidence of a copy
        count = int(np.isin(few, many).sum())
        if count > 0.9 * few.size:
            raise InputError(
                f"{other.path}: run '{other.run.id}' has the samples of run '{one.run.id}' in"
                f" {one.path} ({count} of {few.size} are equal); give the file of this run, or one"
                " run with role split"
            )


def check_runs_left(campaign: Campaign, left_out: Mapping[str, str]) -> None:
    """InputError if no run for fitting remains."""
    fitted = {run.id for run in campaign.runs if run.role != "confirm"}
    if fitted and fitted <= left_out.keys():
        raise InputError(
            f"campaign {campaign.name}: no run for fitting is usable", *left_out.values()
        )


def _recording(file: RunFile) -> Recording:
    """The samples of a run; clipped, stuck and 'no data' values are added to `file.found`."""
    campaign, run = file.campaign, file.run
    values, count = _joined(file), file.rows.size
    absent = {name: checks.no_data(samples) for name, samples in values.items() if name != "time"}
    for name, places in absent.items():
        if places.size:
            value = file.in_file_unit(name, values[name][places[0]])
            text = f"is {value} in {places.size} of {count} samples, far from all others"
            file.doubt(
                "no_data",
                name,
                f"{text}; if this means 'no data', leave the cells empty",
                places[0],
            )
    time, angle, turned = _rotation(file, values, absent.get("crank_angle", np.empty(0, int)))
    has_angle = "crank_angle" in values
    channels = {
        name: samples for name, samples in values.items() if name not in ("time", "crank_angle")
    }
    for name, samples in channels.items():
        _check_varies(file, name, samples)
        samples = samples.copy()
        samples[absent[name]] = np.nan
        if name in PRESSURES:
            _check_pressure(file, name, samples)
        # a pressure has plateaus, and the torque of a motor that is off stays 0
        is_steady = name in PRESSURES or not np.nanmax(np.abs(samples)) > 0.0
        if not is_steady and not _is_stuck(
            file, name, samples, samples, angle if has_angle else turned
        ):
            if (text := checks.clipped(samples)) is not None:
                file.doubt("clipped", name, text)
        if (places := checks.outliers(samples)).size:
            text = (
                f"{samples[places[0]]:g} {CHANNELS[name]} is far from all others"
                f" ({_samples(places.size)})"
            )
            file.remark(name, f"{text}; if this means 'no data', leave the cell empty", places[0])
    if has_angle and run.start == "settled":  # a crank may start at rest
        _is_stuck(file, "crank_angle", values["crank_angle"], angle, turned)
    if "time" in values and has_angle and (places := checks.angle_outliers(time, angle)).size:
        text = f"the angle is far from its neighbours ({_samples(places.size)})"
        file.remark(
            "crank_angle", f"{text}; if the encoder misread it, leave the cell empty", places[0]
        )
    listed = any(effect.name == "speed_fluctuation" for effect in campaign.mechanism.effects)
    if "time" in values and has_angle and campaign.drive == "constant_speed" and not listed:
        if varies := checks.unsteady(time, angle):
            file.remarks.append(
                f"{file.paths}: the drive is constant_speed, but the speed varies {varies}; if this"
                " is no fault of the encoder, use 'drive: measured_angle' to prescribe the"
                " measured motion"
            )
    others = (
        () if file.other is None else tuple(name for name in file.other.channels if name != "time")
    )
    return Recording(
        run.id, time, angle, channels, noise_of(campaign, run.id), _held_out(file, turned), others
    )


def _samples_of(file: RunFile) -> Samples:
    """The samples in one file of a run."""
    _check_units(file)
    file.remarks.extend(file.columns.remarks)
    values = _without_repeated(file, _in_si(file))
    if (count := file.rows.size) < MIN_SAMPLES:
        raise InputError(f"{file.path}: {count} samples; give at least {MIN_SAMPLES}")
    return values


def _joined(file: RunFile) -> Samples:
    """The samples of a run over the times of its one or two clocks and of its counters, NaN where
    there are none."""
    parts = [(file, _samples_of(file))]
    if file.other is not None:
        parts.append((file.other, _samples_of(file.other)))
    grids = []
    for each, values in parts:
        rows = each.rows
        for name in [
            name for name in values if file.campaign.channels[name].average and "time" in values
        ]:
            _check_times(each, values)
            if (held := _held(each, name, values)) is not None:
                grids.append(
                    (each, rows[held[1]], {"time": held[0], name: values.pop(name)[held[1]]})
                )
        grids.insert(0, (each, rows, values))
    if len(grids) == 1:
        return parts[0][1]
    for each, values in parts:
        _check_times(each, values)
    if len(parts) == 2:
        (one, other), turn = (values["time"] for _, values in parts), tau / file.run.speed
        if min(one[-1], other[-1]) - max(one[0], other[0]) < turn:
            raise InputError(
                f"{file.paths}: their times ({one[0]:.6g} to {one[-1]:.6g} s and {other[0]:.6g} to"
                f" {other[-1]:.6g} s) have less than a revolution in common; subtract the"
                " difference of the clocks, as only an offset of less than half a revolution is"
                " found"
            )
    time = np.unique(np.concatenate([values["time"] for *_, values in grids]))
    joined = {name: np.full(time.size, np.nan) for name in file.campaign.channels} | {"time": time}
    lines = {id(each): np.zeros(time.size, int) for each, _ in parts}
    for each, rows, values in reversed(grids):
        places = np.searchsorted(time, values["time"])
        lines[id(each)][places] = rows
        for name in values.keys() - {"time"}:
            joined[name][places] = values[name]
    for each, _ in parts:
        each.rows = lines[id(each)]
    file.is_joined = True
    return joined


def _held(file: RunFile, name: str, values: Samples) -> tuple[np.ndarray, np.ndarray] | None:
    """Ends of the gates [s] of a counter whose reading is held until the next one, and the first
    sample with each reading; None if the reading is not held.

    A gate ends between two samples. If gates of the stated time fit between all samples, they are
    used.
    """
    time, finite = values["time"], np.flatnonzero(np.isfinite(values[name]))
    first = finite[1:][
        np.diff(values[name][finite]) != 0.0
    ]  # the gate of the first reading is unknown
    if first.size < 2 or first.size > finite.size / 2:
        return None
    last = finite[np.searchsorted(finite, first) - 1]
    gate = file.campaign.channels[name].average
    gates = gate * np.round((time[first] - time[first[0]]) / gate)
    low, high = np.max(time[last] - gates), np.min(time[first] - gates)
    ends = (
        0.5 * (low + high) + gates
        if low < high and np.diff(gates).min() > 0.0
        else 0.5 * (time[last] + time[first])
    )
    file.remark(
        name,
        f"readings are held; {first.size} of {finite.size} samples are used, at the ends of the"
        " gates",
    )
    return ends, first


def _is_stuck(
    file: RunFile, name: str, written: np.ndarray, values: np.ndarray, turned: np.ndarray
) -> bool:
    """Whether a channel is stuck, which is added to `file.found`; `values` are continuous, unlike
    `written`."""
    still = checks.stuck(values, turned)
    if still is not None:
        text = (
            f"is stuck: {still.stop - still.start} of {values.size} samples in a row are"
            f" {file.in_file_unit(name, written[still.start])} while the crank turns; repair the"
            " sensor, or leave these cells empty"
        )
        file.doubt("stuck", name, text, still.start)
    return still is not None


def _held_out(file: RunFile, turned: np.ndarray) -> np.ndarray:
    """Held-out samples: all (role confirm) or the last third (split) of a run; `turned` (n,)
    [rad]."""
    if file.run.role != "split":
        return np.full(turned.size, file.run.role == "confirm")
    total = turned[-1] - turned[0]
    if total < 1.5 * tau * MIN_REVOLUTIONS:
        raise InputError(
            f"{file.paths}: {total / tau:.4g} revolutions are too few to hold out the last third of"
            f" run '{file.run.id}', as less than one remains for fitting; give a longer record, or"
            " another role than split"
        )
    return turned > turned[0] + 2.0 / 3.0 * total


def _check_units(file: RunFile) -> None:
    """InputError if a row of units in the file contradicts the campaign file."""
    columns = file.columns
    for name in file.channels:
        channel = file.campaign.channels[name]
        other = columns.other_unit(channel.column, file.campaign.factor(name), CHANNELS[name])
        if other and channel.scale is None:
            text = (
                f"the row below the headings says '{other}', but channels.{name}.unit is"
                f" '{channel.unit}'"
            )
            raise file.error(name, f"{text}; correct one of them")
    if columns.units:
        row = ", ".join(columns.units.values())
        file.remarks.append(
            f"{file.path}: the row below the headings ({row}) contains units and is skipped"
        )


def _in_si(file: RunFile) -> Samples:
    """Channels in SI, without samples that have no time (or angle)."""
    values, file.rows = {}, file.columns.rows
    for name in file.channels:
        channel = file.campaign.channels[name]
        written = file.columns.values[channel.column]
        if split_share(channel.unit)[1] > 1.0:
            written = _without_overflow(file, name, written)
            if channel.counts_per_turn and np.array_equal(
                written, np.floor(written), equal_nan=True
            ):
                written = written + 0.5  # a counter truncates: the middle of its step
        factor = (
            1.0
            if name == "time" and file.columns.began is not None
            else channel.sign * file.campaign.factor(name)
        )
        with np.errstate(over="ignore"):  # rejected below
            values[name] = factor * written
        values[name][np.abs(values[name]) < 1e-150] = 0.0  # their squares underflow
        if (huge := np.flatnonzero(np.abs(values[name]) > 1e12)).size:
            text = (
                f"{written[huge[0]]:g} {channel.unit} is implausibly large; correct it, or leave"
                " the cell empty"
            )
            raise file.error(name, text, huge[0])
    place = "time" if "time" in values else "crank_angle"
    kept = np.isfinite(values[place])
    if count := int(np.count_nonzero(~kept)):
        lack = "1 sample has" if count == 1 else f"{count} samples have"
        file.remark(place, f"{lack} no {place.replace('_', ' ')}, skipped")
    file.rows = file.rows[kept]
    return {name: samples[kept] for name, samples in values.items()}


def _without_overflow(file: RunFile, name: str, counts: np.ndarray) -> np.ndarray:
    """Counts, continued over an overflow of the counter."""
    finite = np.isfinite(counts)
    steps = np.abs(np.diff(counts[finite]))
    for bits in (16, 24, 32):
        if steps.size and abs(steps.max() - 2.0**bits) <= 4.0 * max(float(np.median(steps)), 1.0):
            file.remark(name, f"the {bits}-bit counter overflows; the counts are continued")
            counts = counts.copy()
            counts[finite] = np.unwrap(counts[finite], period=2.0**bits)
            break
    return counts


def _without_repeated(file: RunFile, values: Samples) -> Samples:
    """Channels without repeated samples, as `channels.time.repeated` says."""
    if "time" not in values or not file.rows.size:
        return values
    which = file.campaign.channels["time"].repeated
    samples = pd.DataFrame({"time": values["time"]} if which else values)
    same = (
        ((samples == samples.shift()) | (samples.isna() & samples.shift().isna()))
        .all(axis=1)
        .to_numpy(copy=True)
    )
    same[0] = False
    kept = ~np.append(same[1:], False) if which == "last" else ~same
    if count := np.count_nonzero(~kept):
        rule = (
            f"of rows with equal time the {which} is kept"
            if which
            else "rows repeat the previous row"
        )
        file.remark("time", f"{rule}; {_samples(count)} skipped", np.argmin(kept))
    file.rows = file.rows[kept]
    return {name: samples[kept] for name, samples in values.items()}


def _samples(count: int) -> str:
    return "1 sample" if count == 1 else f"{count} samples"


def _check_varies(file: RunFile, name: str, values: np.ndarray) -> None:
    finite = values[np.isfinite(values)]
    fix = "or remove the channel from the campaign file"
    if finite.size < MIN_SAMPLES:
        raise file.error(name, f"{finite.size} values; give at least {MIN_SAMPLES}, {fix}")
    if np.ptp(finite) > 0.0:
        return
    if name != "crank_torque" or finite[0] != 0.0:
        raise file.error(name, f"all values are equal; repair the sensor, {fix}")
    needed = []
    if file.campaign.drive != "measured_angle":
        needed.append("'drive: measured_angle' (there is no drive for a free crank yet)")
    if not file.campaign.channels[name].noise_of(file.run.id):
        needed.append(f"channels.{name}.noise, such as 'noise: 0.01 N*m'")
    if needed:
        give = f"If the motor is off, give {' and '.join(needed)}: it is compared with 0"
        raise file.error(name, f"all values are 0. {give}. Otherwise repair the sensor, {fix}")


def _check_pressure(file: RunFile, name: str, values: np.ndarray) -> None:
    """InputError for negative absolute pressures; a remark on very small ones."""
    if (below := np.flatnonzero(values < 0.0)).size and file.campaign.channels[
        name
    ].pressure_behind > 0.0:
        text = "negative absolute pressure; give 'ambient_pressure: 0 bar' for gauge pressures"
        raise file.error(name, text, below[0])
    if (largest := float(np.nanmax(np.abs(values)))) < LEAST_PRESSURE:
        unit = file.campaign.channels[name].unit
        file.remark(
            name,
            f"the largest pressure is only {largest:.3g} Pa; check channels.{name}.unit = '{unit}'",
        )


# The crank's rotation


def continuous_angle(time: np.ndarray | None, angle: np.ndarray, speed: float) -> np.ndarray:
    """Unwrapped crank angles of an encoder.

    With times, the full turns of each step are those nearest to the mean speed, which tolerates
    gaps and few samples per turn. Without times, a step is less than half a turn.
    """
    finite = np.flatnonzero(np.isfinite(angle))
    continuous = np.full(angle.shape, np.nan)
    if not finite.size:
        return continuous
    steps = np.diff(angle[finite])
    lapse = np.zeros(steps.size) if time is None else np.diff(time[finite])
    whole = _nearest(steps, speed * lapse)
    short = (lapse > 0.0) & (speed * lapse < tau / 4)
    if short.any():  # across gaps the measured speed is better than the nominal one
        whole = _nearest(steps, whole[short].sum() / lapse[short].sum() * lapse)
    continuous[finite] = angle[finite[0]] + np.append(0.0, np.cumsum(whole))
    return continuous


def _nearest(steps: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """`steps` plus the full turns that bring them nearest to `expected`."""
    return steps + tau * np.round((expected - steps) / tau)


def _rotation(
    file: RunFile, values: Samples, no_data: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and angles of a run, each NaN if not measured, and the angle turned."""
    absent, speed = np.full(file.rows.size, np.nan), file.run.speed
    time, angle = values.get("time", absent), values.get("crank_angle", absent)
    if file.run.direction == "clockwise":
        angle = -angle
    if "time" in values and not file.is_joined:
        _check_times(file, values)
    if "crank_angle" not in values:
        _with_even_stamps(file, time, absent)
        return time, absent, speed * (time - time[0])
    if np.count_nonzero(np.isfinite(angle)) < 2:
        raise file.error("crank_angle", "contains no angles; give the measurement")
    if (dead := checks.dead_zone(values["crank_angle"])).size:
        still = file.in_file_unit("crank_angle", values["crank_angle"][dead[0]])
        text = (
            f"the angle is {still} over a part of each turn ({_samples(dead.size)}); leave these"
            " cells empty"
        )
        raise file.error("crank_angle", text, dead[0])
    if "time" not in values:
        angle = continuous_angle(None, angle, speed)
        _check_angle_alone(file, values["crank_angle"], angle)
        return absent, angle, angle - angle[0]
    continuous = continuous_angle(time, angle, speed)
    time = _with_even_stamps(file, time, continuous)
    valid = continuous.copy()
    valid[no_data] = np.nan
    _check_turns_on(file, time, valid)
    mean_speed = _mean_speed(time, continuous)
    _check_speed(file, time, angle, mean_speed)
    _check_enough(file, "crank_angle", (time[-1] - time[0]) * mean_speed, time.size)
    if checks.is_computed(file.campaign, file.run.id, time, continuous):
        text = (
            "crank_angle rises uniformly, so it seems computed: it is used as exact, and not"
            " compared"
        )
        file.remark("crank_angle", f"{text}. If it was measured, state its `noise` or `resolution`")
    return time, continuous, mean_speed * (time - time[0])


def _with_even_stamps(file: RunFile, time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Times where every n-th that is late, but not its angle, is in the middle between its
    neighbours."""
    if (
        file.is_joined or (found := checks.late_stamps(time, angle)) is None or found[3] > 0.75
    ):  # samples late too
        return time
    rows, n, share, followed = found
    text = (
        f"every {n}th time is {'late' if share > 0.0 else 'early'} by {abs(share):.2g} of the"
        " sampling period"
    )
    if not abs(followed) < 0.25:
        file.remark("time", f"{text}; check the logger", rows[0])
        return time
    even = time.copy()
    even[rows] = 0.5 * (time[rows - 1] + time[rows + 1])
    text += (
        f", but its crank angle is not: these {_samples(rows.size)} get the time in the middle of"
        " their neighbours"
    )
    file.remark("time", text, rows[0])
    return even


def _mean_speed(time: np.ndarray, angle: np.ndarray) -> float:
    ends = np.flatnonzero(np.isfinite(angle))[[0, -1]]
    return float(np.diff(angle[ends])[0] / np.diff(time[ends])[0])


def _check_times(file: RunFile, values: Samples) -> None:
    """InputError if times do not increase, or have too few revolutions or samples at nominal
    speed."""
    time, side = values["time"], -1.0 if file.run.direction == "clockwise" else 1.0
    steps, angle = np.diff(time), side * values.get("crank_angle", np.full(time.size, np.nan))
    if (jump := checks.clock_jump(time, angle)) is not None:
        row, size = jump
        way, change = ("forward", "subtract this from") if size > 0.0 else ("back", "add this to")
        text = (
            f"time steps from {time[row - 1]:.10g} to {time[row]:.10g} s: the clock was set {way}"
            f" by {abs(size):.6g} s"
        )
        text += (
            f"; {change} the times from this row on, or cut the record there (make two runs of it)"
        )
        raise file.error("time", text, row)
    if (late := np.flatnonzero(steps <= 0.0)).size:
        before, after = time[late[0]], time[late[0] + 1]
        text = (
            f"falls from {before:.10g} to {after:.10g} s; sort the rows, or give one file per"
            " record"
        )
        if after == before:
            text = (
                f"repeats {after:.10g} s with other values ({np.count_nonzero(steps == 0.0)} rows"
                " do); write times with more digits, or give channels.time 'repeated: last' (or"
                " first) to keep one row of each time"
            )
        raise file.error("time", f"time {text}", late[0] + 1)
    # with an angle the crank may be faster than nominal: see `_check_speed`
    fastest = (
        SPEED_RATIOS[file.campaign.drive][1] if "crank_angle" in file.campaign.channels else 1.0
    )
    _check_enough(file, "time", file.run.speed * (time[-1] - time[0]), time.size, fastest)


def _check_enough(
    file: RunFile, channel: str, turned: float, samples: int, fastest: float = 1.0
) -> None:
    """InputError if the record has less than a revolution or too few `samples` for the angle
    `turned` [rad]."""
    turns = turned * (1.0 + 1.0 / (samples - 1)) / tau  # the last sample counts as a step

    def fits(turns: float, least: float = MIN_REVOLUTIONS) -> bool:
        return least <= turns <= samples / MIN_SAMPLES_PER_REVOLUTION

    if not fits(turns, MIN_REVOLUTIONS / fastest):
        fitting = {unit: fits(factor * turns) for unit, factor in file.in_units(channel).items()}
        text = f"{samples} samples are {turns:.4g} revolutions"
        text += f" at the nominal {_rpm(file.run.speed)}" if channel == "time" else ""
        text += (
            f"; at least one revolution and {MIN_SAMPLES_PER_REVOLUTION:g} samples per revolution"
            " are required"
        )
        raise file.error(channel, f"{text}; {file.proposal(channel, fitting)}")


def _check_angle_alone(file: RunFile, read: np.ndarray, angle: np.ndarray) -> None:
    """InputError for implausible angles without times: `read` from the file, `angle` continuous."""
    steps = np.diff(angle)
    jumps = np.abs(np.diff(read)) > tau / 2
    odd = jumps & (
        np.abs(steps - np.median(steps)) > max(1.0, 5.0 * float(np.median(np.abs(steps))))
    )
    if jumps.mean() > 0.2 or odd.any():
        row = int(np.flatnonzero(jumps)[0]) + 1
        text = (
            f"the angle steps by {degrees(read[row] - read[row - 1]):.4g} deg, neither less than"
            " half a turn nor"
        )
        raise file.error(
            "crank_angle", f"{text} back by full turns; {file.proposal('crank_angle', {})}", row
        )
    total = angle[-1] - angle[0]
    if total < -tau * MIN_REVOLUTIONS / 2:
        raise _falls(file, angle)
    _check_enough(file, "crank_angle", total, angle.size)


def _check_turns_on(file: RunFile, time: np.ndarray, angle: np.ndarray) -> None:
    """UnusableRun if the crank stands still or reverses, or its `angle` has a permanent step."""
    drive, speed = file.campaign.drive, file.run.speed
    if drive == "constant_speed" and checks.stuck(angle, speed * time) is not None:
        return  # reported as a stuck encoder
    # a motor may start from rest
    still = None if drive == "motor" else checks.standstill(time, angle, speed)
    turns_back = still is not None and still[2]
    if (still is None or turns_back) and (
        step := checks.lasting_step(time, angle, speed)
    ) is not None:
        row, size = step
        sign = -1.0 if file.run.direction == "clockwise" else 1.0
        place, size = file.place("crank_angle", row), sign * degrees(size)
        raise UnusableRun(
            "step",
            f"{place}: the angle has a permanent step of {size:.3g} deg at {time[row]:.6g} s (lost"
            " or double-counted pulses, or a counter overflow); cut the record there, or correct"
            " the angle",
        )
    if still is None:
        return
    begin, end, _ = still
    when, keep = f"from {begin:.6g} s to {end:.6g} s", "make two runs of it"
    if begin == time[0]:
        when, keep = f"until {end:.6g} s", "keep the later part"
        keep += ", and give the run 'start: unknown'" if file.run.start == "at_rest" else ""
    elif end >= time[-1]:
        when, keep = f"from {begin:.6g} s on", "keep the earlier part"
    what = "reverses" if turns_back else "stands still"
    place = file.place("crank_angle", int(np.searchsorted(time, begin)))
    kind = "turns_back" if turns_back else "standstill"
    raise UnusableRun(kind, f"{place}: the crank {what} {when}; cut the record there ({keep})")


def _check_speed(file: RunFile, time: np.ndarray, angle: np.ndarray, speed: float) -> None:
    """InputError if the speed from angles and times differs from the run's, with the unit that
    would fit."""
    nominal, (low, high) = file.run.speed, SPEED_RATIOS[file.campaign.drive]
    if low * nominal <= speed <= high * nominal:
        if (
            file.campaign.drive == "constant_speed"
            and abs(speed / nominal - 1.0) > REPORTED_SPEED_ERROR
        ):
            text = (
                f"with the times the mean speed is {_rpm(speed)}, but the run's speed is"
                f" {_rpm(nominal)}"
            )
            file.remark("crank_angle", f"{text}; the measured one is used. Correct speed")
        return
    if -high * nominal <= speed <= -low * nominal:
        raise _falls(file, continuous_angle(time, angle, nominal))
    fitting = {}
    for unit, factor in file.in_units("crank_angle").items():
        in_unit = _mean_speed(time, continuous_angle(time, factor * angle, nominal))
        fitting[unit] = abs(in_unit / nominal - 1.0) < 0.2
    text = (
        f"the mean speed with column {file.campaign.channels['time'].column} is {_rpm(speed)}, but"
        " the run's speed is"
    )
    fix, parts = (
        file.proposal("crank_angle", fitting),
        split_share(file.campaign.channels["crank_angle"].unit)[1],
    )
    folds = [fold for fold in (4.0, 2.0, 0.5, 0.25) if abs(speed / nominal / fold - 1.0) < 0.1]
    if parts > 1.0 and folds:
        fix = (
            f"counts_per_turn is {parts:g}: did you mean {folds[0] * parts:g} (edges of the"
            " encoder's lines)?"
        )
    raise file.error("crank_angle", f"{text} {_rpm(nominal)}; {fix}")


def _falls(file: RunFile, angle: np.ndarray) -> InputError:
    """The error for a decreasing `angle` [rad] (mirrored for a clockwise run)."""
    first, last = np.degrees(angle[np.isfinite(angle)])[[0, -1]]
    text = f"falls from {first:.6g} to {last:.6g} deg; if the crank turns clockwise, give the run"
    fix = "'direction: clockwise', otherwise"
    if file.run.direction == "clockwise":
        text = f"rises from {-first:.6g} to {-last:.6g} deg, but run '{file.run.id}' has"
        fix = "'direction: clockwise'; remove it, or"
    return file.error("crank_angle", f"the angle {text} {fix} change the sign of the angles")


def _rpm(speed: float) -> str:
    return f"{number(speed * 60.0 / tau)} rpm"
