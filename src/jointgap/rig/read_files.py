"""Reading the runs of a campaign: columns to channels in SI, with checks of files, runs and
channels."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
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
from jointgap.config.channels import PRESSURES
from jointgap.core.csv_files import Columns, read_columns
from jointgap.core.errors import InputError, UnusableRun
from jointgap.core.units import split_share
from jointgap.core.words import number
from jointgap.motion.of_file import check_linkage
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
    contradictions: list[Contradiction] = field(default_factory=list)
    # Line of the file (from 1) of each sample; 0 for samples of the other file
    rows: np.ndarray | None = None
    second: "RunFile | None" = None  # The file of a second logger
    is_joined: bool = False  # Whether the samples have several grids of times

    @property
    def channels(self) -> list[str]:
        """The channels in this file."""
        columns = self.columns.values
        return [
            name for name, channel in self.campaign.channels.items() if channel.column in columns
        ]

    @property
    def paths(self) -> str:
        """The files of the run, for messages."""
        return f"{self.path} and {self.second.path}" if self.second else str(self.path)

    def si_factor(self, name: str) -> float:
        """SI value of one unit of a column; the crank angle of a clockwise run is mirrored."""
        if name == "time" and self.columns.began is not None:
            return 1.0
        side = self.run.side if name == "crank_angle" else 1.0
        return side * self.campaign.channels[name].sign * self.campaign.factor(name)

    def place(self, channel: str, sample: int | None = None) -> str:
        """``run.csv, column t, row 3`` for a `channel` and a `sample`."""
        is_here = channel in self.channels and (
            sample is None or channel != "time" or self.rows[sample]
        )
        if self.second is not None and not is_here:
            return self.second.place(channel, sample)
        row = "" if sample is None else f", row {self.rows[sample]}"
        return f"{self.path}, column {self.campaign.channels[channel].column}{row}"

    def remark(self, channel: str, text: str, sample: int | None = None) -> None:
        self.remarks.append(f"{self.place(channel, sample)}: {text}")

    def doubt(self, kind: str, channel: str, text: str, sample: int | None = None) -> None:
        self.remark(channel, f"{channel} {text}", sample)
        self.contradictions.append(Contradiction(self.run.id, channel, kind, f"{channel} {text}"))

    def error(self, channel: str, text: str, sample: int | None = None) -> InputError:
        return InputError(f"{self.place(channel, sample)}: {text}")

    def in_file_unit(self, channel: str, value: float) -> str:
        """A `value` [SI] of `channel` with the unit and sign of the file."""
        return f"{value / self.si_factor(channel):g} {self.campaign.channels[channel].unit}"

    def proposal(self, channel: str, fits: Mapping[str, bool]) -> str:
        """How to fix the unit of a `channel`, given whether each unit fits."""
        unit = self.campaign.channels[channel].unit
        if proposed := [name for name in fits if fits[name] and name != unit]:
            return f"channels.{channel}.unit is '{unit}': did you mean '{proposed[0]}'?"
        return f"check channels.{channel}.unit = '{unit}' and the run's speed, or measure again"

    def in_units(self, channel: str) -> dict[str, float]:
        """Factors [1] from values of `channel` in its stated unit to values read in other units."""
        base = self.campaign.unit(channel)
        return {
            unit: channel_factor(channel, base, unit) / self.campaign.factor(channel)
            for unit in PROPOSED_UNITS[channel]
        }


_IDLE = dict.fromkeys(MOTOR_LINE, "requires drive: motor") | {
    "speed": "follows from time and crank_angle",
    **dict.fromkeys(
        PRESSURE_SENSOR,
        "requires a slider_force_table of a pressure, or the channel cylinder_pressure",
    ),
}
"""Why a nuisance has no effect, if the mechanism is not the reason."""


def _idle(campaign: Campaign, key: str) -> str:
    if key == f"{campaign.mechanism.sites.crank}_inertia":
        return "requires drive: motor or measured_angle"
    return _IDLE.get(key, "has no effect in this mechanism")


def read_measurements(campaign: Campaign, compared: bool = True) -> Measurements:
    """All samples of a campaign.

    Samples without time stamp (or, without times, without crank angle) are skipped with a remark.
    """
    remarks = [
        f"nuisance {key} {_idle(campaign, key)} and is ignored" for key in campaign.idle_nuisances
    ]
    check_linkage(campaign.mechanism, f"campaign {campaign.name}, mechanism")
    files = {run.id: _open(campaign, run) for run in campaign.runs}
    runs, contradictions = {}, []
    for run, file in files.items():
        try:
            runs[run] = _recording(file)
            contradictions += file.contradictions  # not for an unusable run
        except UnusableRun as error:
            remarks.insert(0, f"run {run} is not used: {error}")
            contradictions.append(
                Contradiction(run, "crank_angle", error.kind, str(error), doubtful=False)
            )
        remarks += file.remarks
    check_runs_left(
        campaign, {item.run: item.remark for item in contradictions if item.kind in OF_A_RUN}
    )
    inconsistent = consistency_checks(campaign, runs) if compared else []
    remarks += [f"{campaign.name}, {sentence}" for sentence in sentences(inconsistent)]
    return Measurements(runs, tuple(remarks), (*contradictions, *inconsistent))


def _open(campaign: Campaign, run: CampaignRun) -> RunFile:
    """The file of a run, and of two the one with the crank angle or else the first; InputError
    unless each column is in exactly one of them.
    """
    columns = [channel.column for channel in campaign.channels.values()]
    clock = campaign.channels["time"].column if "time" in campaign.channels else ""
    is_pair = len(run.files) == 2
    files = [
        RunFile(campaign, run, path, read_columns(path, columns, campaign.csv, clock, is_pair))
        for path in (campaign.folder / name for name in run.files)
    ]
    if not is_pair:
        return files[0]
    paths = f"{files[0].path} and {files[1].path}"
    for name, channel in campaign.channels.items():
        count = sum(name in file.channels for file in files)
        if not count:
            raise InputError(
                f"{paths}: neither has the column '{channel.column}'; correct the column's name"
            )
        if count == 2 and name != "time":
            raise InputError(
                f"{paths}: both have the column '{channel.column}'; rename it in one of them"
            )
    for file in files:
        if file.channels == ["time"]:
            raise InputError(
                f"{file.path}: has no channel of the campaign besides time; remove it from 'file'"
            )
    main, second = sorted(files, key=lambda file: "crank_angle" not in file.channels)
    if apart := [name for name in PRESSURES if name in second.channels]:
        raise second.error(
            apart[0],
            "a pressure is averaged over the crank angle; record both by one logger, or give a"
            " slider_force_table",
        )
    began, second_began = main.columns.began, second.columns.began
    if (began is None) != (second_began is None):
        raise InputError(
            f"{paths}, column {clock}: one has dates and the other numbers; write both alike"
        )
    if began is not None:
        later = (second_began - began).total_seconds()
        second.columns.values[clock] = second.columns.values[clock] + later
    second = replace(second, remarks=main.remarks, contradictions=main.contradictions)
    return replace(main, second=second)


def check_runs_left(campaign: Campaign, left_out: Mapping[str, str]) -> None:
    """InputError if no run for fitting remains."""
    fitted = {run.id for run in campaign.runs if run.role != "confirm"}
    if fitted and fitted <= left_out.keys():
        raise InputError(
            f"campaign {campaign.name}: no run for fitting is usable", *left_out.values()
        )


def _recording(file: RunFile) -> Recording:
    """The samples of a run; clipped, stuck and 'no data' values are contradictions of the file."""
    campaign = file.campaign
    run = file.run
    values = _joined(file)
    absent = {name: _no_data(file, name, values[name]) for name in values if name != "time"}
    time, angle, turned = _rotation(file, values, absent.get("crank_angle", np.empty(0, int)))
    has_angle = "crank_angle" in values
    has_time = "time" in values
    channels = {}
    for name in [name for name in values if name not in ("time", "crank_angle")]:
        _check_varies(file, name, values[name])
        channels[name] = samples = values[name].copy()
        samples[absent[name]] = np.nan
        _check_samples(file, name, samples, angle if has_angle else turned)
    if has_angle and run.start == "settled":  # a crank may start at rest
        _is_stuck(file, "crank_angle", values["crank_angle"], angle, turned)
    if has_time and has_angle:
        if (places := checks.angle_outliers(time, angle)).size:
            file.remark(
                "crank_angle",
                f"the angle is far from its neighbours ({_samples(places.size)}); if the encoder"
                " misread it, leave the cell empty",
                places[0],
            )
        fluctuates = campaign.mechanism.effect("speed_fluctuation") is not None
        is_constant = campaign.drive == "constant_speed" and not fluctuates
        if is_constant and (varies := checks.unsteady(time, angle)):
            file.remarks.append(
                f"{file.paths}: the drive is constant_speed, but the speed varies {varies}; if this"
                " is no fault of the encoder, use 'drive: measured_angle' to prescribe the"
                " measured motion"
            )
    second = [] if file.second is None else file.second.channels
    return Recording(
        run.id,
        time,
        angle,
        channels,
        noise_of(campaign, run.id),
        _held_out(file, turned),
        tuple(name for name in second if name != "time"),
    )


def _no_data(file: RunFile, name: str, values: np.ndarray) -> np.ndarray:
    """Indices of samples with a value for 'no data', which is a contradiction."""
    places = checks.no_data(values)
    if places.size:
        file.doubt(
            "no_data",
            name,
            f"is {file.in_file_unit(name, values[places[0]])} in {places.size} of {values.size}"
            " samples, far from all others; if this means 'no data', leave the cells empty",
            places[0],
        )
    return places


def _check_samples(file: RunFile, name: str, samples: np.ndarray, turned: np.ndarray) -> None:
    """Report stuck, clipped and outlying samples of a channel."""
    if name in PRESSURES:
        _check_pressure(file, name, samples)
    # a pressure has plateaus, and the torque of a motor that is off is 0
    elif np.nanmax(np.abs(samples)) > 0.0 and not _is_stuck(file, name, samples, samples, turned):
        if (text := checks.clipped(samples)) is not None:
            file.doubt("clipped", name, text)
    if (places := checks.outliers(samples)).size:
        file.remark(
            name,
            f"{samples[places[0]]:g} {file.campaign.unit(name)} is far from all others"
            f" ({_samples(places.size)}); if this means 'no data', leave the cell empty",
            places[0],
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
    parts = [(part, _samples_of(part)) for part in (file, file.second) if part is not None]
    grids = []  # file, rows and samples of each grid of times
    for part, values in parts:
        counters = []
        for name in [name for name in values if part.campaign.channels[name].average]:
            if "time" in values and (gates := _gates(part, name, values)) is not None:
                ends, samples = gates
                readings = {"time": ends, name: values.pop(name)[samples]}
                counters.append((part, part.rows[samples], readings))
        grids += [(part, part.rows, values), *counters]
    if len(grids) == 1:
        return parts[0][1]
    for part, values in parts:
        _check_times(part, values)
    if len(parts) == 2:
        (begin, end), (second_begin, second_end) = (values["time"][[0, -1]] for _, values in parts)
        if min(end, second_end) - max(begin, second_begin) < tau / file.run.speed:
            raise InputError(
                f"{file.paths}: their times ({begin:.6g} to {end:.6g} s and {second_begin:.6g} to"
                f" {second_end:.6g} s) have less than a revolution in common; subtract the"
                " difference of the clocks, as only an offset of less than half a revolution is"
                " found"
            )
    time = np.unique(np.concatenate([values["time"] for *_, values in grids]))
    joined = {name: np.full(time.size, np.nan) for name in file.campaign.channels} | {"time": time}
    lines = {id(part): np.zeros(time.size, int) for part, _ in parts}
    for part, rows, values in reversed(grids):
        places = np.searchsorted(time, values["time"])
        lines[id(part)][places] = rows
        for name in values.keys() - {"time"}:
            joined[name][places] = values[name]
    for part, _ in parts:
        part.rows = lines[id(part)]
    file.is_joined = True
    return joined


def _gates(file: RunFile, name: str, values: Samples) -> tuple[np.ndarray, np.ndarray] | None:
    """Ends of the gates [s] of a counter whose reading is held until the next one, and the first
    sample with each reading; None if the reading is not held.

    A gate ends between two samples. If gates of the stated time fit between all samples, they are
    used.
    """
    time = values["time"]
    read = np.flatnonzero(np.isfinite(values[name]))
    # the gate of the first reading is unknown
    changes = read[1:][np.diff(values[name][read]) != 0.0]
    if changes.size < 2 or changes.size > read.size / 2:
        return None
    previous = time[read[np.searchsorted(read, changes) - 1]]
    gate = file.campaign.channels[name].average
    gates = gate * np.round((time[changes] - time[changes[0]]) / gate)
    low = np.max(previous - gates)
    high = np.min(time[changes] - gates)
    is_regular = low < high and np.diff(gates).min() > 0.0
    ends = 0.5 * (low + high) + gates if is_regular else 0.5 * (previous + time[changes])
    file.remark(
        name,
        f"readings are held; {changes.size} of {read.size} samples are used, at the ends of the"
        " gates",
    )
    return ends, changes


def _is_stuck(
    file: RunFile, name: str, read: np.ndarray, values: np.ndarray, turned: np.ndarray
) -> bool:
    """Whether a channel is stuck, which is a contradiction; `values` are continuous, unlike
    `read`."""
    stuck = checks.stuck(values, turned)
    if stuck is None:
        return False
    file.doubt(
        "stuck",
        name,
        f"is stuck: {stuck.stop - stuck.start} of {values.size} samples in a row are"
        f" {file.in_file_unit(name, read[stuck.start])} while the crank turns; repair the"
        " sensor, or leave these cells empty",
        stuck.start,
    )
    return True


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
        base = file.campaign.unit(name)
        unit = columns.other_unit(channel.column, file.campaign.factor(name), base)
        if unit and channel.scale is None:
            raise file.error(
                name,
                f"the row below the headings says '{unit}', but channels.{name}.unit is"
                f" '{channel.unit}'; correct one of them",
            )
    if columns.units:
        row = ", ".join(columns.units.values())
        file.remarks.append(
            f"{file.path}: the row below the headings ({row}) contains units and is skipped"
        )


def _in_si(file: RunFile) -> Samples:
    """Channels in SI, without samples that have no time (or angle)."""
    values = {}
    file.rows = file.columns.rows
    for name in file.channels:
        channel = file.campaign.channels[name]
        column = file.columns.values[channel.column]
        if split_share(channel.unit)[1] > 1.0:
            column = _without_overflow(file, name, column)
            is_whole = np.array_equal(column, np.floor(column), equal_nan=True)
            if channel.counts_per_turn and is_whole:
                column = column + 0.5  # a counter truncates: the middle of its step
        with np.errstate(over="ignore"):  # rejected below
            values[name] = file.si_factor(name) * column
        values[name][np.abs(values[name]) < 1e-150] = 0.0  # their squares underflow
        if (huge := np.flatnonzero(np.abs(values[name]) > 1e12)).size:
            raise file.error(
                name,
                f"{column[huge[0]]:g} {channel.unit} is implausibly large; correct it, or leave"
                " the cell empty",
                huge[0],
            )
    axis = "time" if "time" in values else "crank_angle"
    is_used = np.isfinite(values[axis])
    if count := np.count_nonzero(~is_used):
        lack = "1 sample has" if count == 1 else f"{count} samples have"
        file.remark(axis, f"{lack} no {axis.replace('_', ' ')}, skipped")
    file.rows = file.rows[is_used]
    return {name: samples[is_used] for name, samples in values.items()}


def _without_overflow(file: RunFile, name: str, counts: np.ndarray) -> np.ndarray:
    """Counts, continued over an overflow of the counter."""
    is_read = np.isfinite(counts)
    steps = np.abs(np.diff(counts[is_read]))
    for bits in (16, 24, 32):
        if steps.size and abs(steps.max() - 2.0**bits) <= 4.0 * max(np.median(steps), 1.0):
            file.remark(name, f"the {bits}-bit counter overflows; the counts are continued")
            counts = counts.copy()
            counts[is_read] = np.unwrap(counts[is_read], period=2.0**bits)
            break
    return counts


def _without_repeated(file: RunFile, values: Samples) -> Samples:
    """Channels without repeated samples, as `channels.time.repeated` says."""
    if "time" not in values or np.diff(values["time"]).min(initial=0.0) < 0.0:
        return values
    kept_row = file.campaign.channels["time"].repeated
    samples = pd.DataFrame({"time": values["time"]} if kept_row else values)
    is_used = ~samples.duplicated(keep=kept_row or "first").to_numpy()
    if count := np.count_nonzero(~is_used):
        rule = "rows repeat the previous row"
        if kept_row:
            rule = f"of rows with equal time the {kept_row} is kept"
        file.remark("time", f"{rule}; {_samples(count)} skipped", np.argmin(is_used))
    file.rows = file.rows[is_used]
    return {name: samples[is_used] for name, samples in values.items()}


def _samples(count: int) -> str:
    return "1 sample" if count == 1 else f"{count} samples"


def _check_varies(file: RunFile, name: str, values: np.ndarray) -> None:
    readings = values[np.isfinite(values)]
    fix = "or remove the channel from the campaign file"
    if readings.size < MIN_SAMPLES:
        raise file.error(name, f"{readings.size} values; give at least {MIN_SAMPLES}, {fix}")
    if np.ptp(readings) > 0.0:
        return
    if name != "crank_torque" or readings[0] != 0.0:
        raise file.error(name, f"all values are equal; repair the sensor, {fix}")
    campaign = file.campaign
    if campaign.drive != "measured_angle" or not campaign.channels[name].noise_of(file.run.id):
        raise file.error(
            name,
            f"all values are 0; if the motor is off, give channels.{name}.noise and 'drive:"
            f" measured_angle' (it is then compared with 0); otherwise repair the sensor, {fix}",
        )


def _check_pressure(file: RunFile, name: str, values: np.ndarray) -> None:
    """InputError for negative absolute pressures; a remark on very small ones."""
    channel = file.campaign.channels[name]
    negative = np.flatnonzero(values < 0.0)
    if negative.size and channel.pressure_behind > 0.0:
        text = "negative absolute pressure; give 'ambient_pressure: 0 bar' for gauge pressures"
        raise file.error(name, text, negative[0])
    if (largest := np.nanmax(np.abs(values))) < LEAST_PRESSURE:
        file.remark(
            name,
            f"the largest pressure is only {largest:.3g} Pa; check channels.{name}.unit ="
            f" '{channel.unit}'",
        )


# The crank's rotation


def continuous_angle(time: np.ndarray | None, angle: np.ndarray, speed: float) -> np.ndarray:
    """Unwrapped crank angles of an encoder.

    With times, the full turns of each step are those nearest to the mean speed, which tolerates
    gaps and few samples per turn. Without times, a step is less than half a turn.
    """
    read = np.flatnonzero(np.isfinite(angle))
    continuous = np.full(angle.shape, np.nan)
    if not read.size:
        return continuous
    read_steps = np.diff(angle[read])
    lapse = np.zeros(read_steps.size) if time is None else np.diff(time[read])
    steps = _nearest(read_steps, speed * lapse)
    short = (lapse > 0.0) & (speed * lapse < tau / 4)
    if short.any():  # across gaps the measured speed is better than the nominal one
        steps = _nearest(read_steps, steps[short].sum() / lapse[short].sum() * lapse)
    continuous[read] = angle[read[0]] + np.append(0.0, np.cumsum(steps))
    return continuous


def _nearest(steps: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """`steps` plus the full turns that bring them nearest to `expected`."""
    return steps + tau * np.round((expected - steps) / tau)


def _rotation(
    file: RunFile, values: Samples, no_data: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and angles of a run, each NaN if not measured, and the angle turned."""
    absent = np.full(file.rows.size, np.nan)
    speed = file.run.speed
    time, read = (values.get(name, absent) for name in ("time", "crank_angle"))
    if "time" in values and not file.is_joined:
        _check_times(file, values)
    if "crank_angle" not in values:
        _with_even_stamps(file, time, absent)
        return time, absent, speed * (time - time[0])
    if np.count_nonzero(np.isfinite(read)) < 2:
        raise file.error("crank_angle", "contains no angles; give the measurement")
    if (dead := checks.dead_zone(read)).size:
        raise file.error(
            "crank_angle",
            f"the angle is {file.in_file_unit('crank_angle', read[dead[0]])} over a part of each"
            f" turn ({_samples(dead.size)}); leave these cells empty",
            dead[0],
        )
    if "time" not in values:
        angle = continuous_angle(None, read, speed)
        _check_angle_alone(file, read, angle)
        return absent, angle, angle - angle[0]
    angle = continuous_angle(time, read, speed)
    time = _with_even_stamps(file, time, angle)
    valid = angle.copy()
    valid[no_data] = np.nan
    _check_turns_on(file, time, valid)
    mean_speed = _mean_speed(time, angle)
    _check_speed(file, time, read, mean_speed)
    turned = mean_speed * (time - time[0])
    _check_enough(file, "crank_angle", turned[-1], time.size)
    if checks.is_computed(file.campaign, file.run.id, time, angle):
        file.remark(
            "crank_angle",
            "crank_angle rises uniformly, so it seems computed: it is used as exact, and not"
            " compared. If it was measured, state its `noise` or `resolution`",
        )
    return time, angle, turned


def _with_even_stamps(file: RunFile, time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Times where every n-th that is late, but not its angle, is in the middle between its
    neighbours."""
    late = None if file.is_joined else checks.late_stamps(time, angle)
    if late is None or late[3] > 0.75:  # the samples are late too
        return time
    rows, n, share, followed = late
    direction = "late" if share > 0.0 else "early"
    text = f"every {n}th time is {direction} by {abs(share):.2g} of the sampling period"
    if not abs(followed) < 0.25:
        file.remark("time", f"{text}; check the logger", rows[0])
        return time
    even = time.copy()
    even[rows] = 0.5 * (time[rows - 1] + time[rows + 1])
    action = f"these {_samples(rows.size)} get the time in the middle of their neighbours"
    file.remark("time", f"{text}, but its crank angle is not: {action}", rows[0])
    return even


def _mean_speed(time: np.ndarray, angle: np.ndarray) -> float:
    ends = np.flatnonzero(np.isfinite(angle))[[0, -1]]
    return np.diff(angle[ends])[0] / np.diff(time[ends])[0]


def _check_times(file: RunFile, values: Samples) -> None:
    """InputError if times do not increase, or have too few revolutions or samples at nominal
    speed."""
    time = values["time"]
    steps = np.diff(time)
    if (jump := checks.clock_jump(time, values.get("crank_angle", time * np.nan))) is not None:
        row, size = jump
        way, change = ("forward", "subtract this from") if size > 0.0 else ("back", "add this to")
        raise file.error(
            "time",
            f"time steps from {time[row - 1]:.10g} to {time[row]:.10g} s: the clock was set {way}"
            f" by {abs(size):.6g} s; {change} the times from this row on, or cut the record there"
            " (make two runs of it)",
            row,
        )
    if (falls := np.flatnonzero(steps <= 0.0)).size:
        row = falls[0] + 1
        text = (
            f"falls from {time[row - 1]:.10g} to {time[row]:.10g} s; sort the rows, or give one"
            " file per record"
        )
        if steps[row - 1] == 0.0:
            text = (
                f"repeats {time[row]:.10g} s with other values ({np.count_nonzero(steps == 0.0)}"
                " rows do); write times with more digits, or give channels.time 'repeated: last'"
                " (or first) to keep one row of each time"
            )
        raise file.error("time", f"time {text}", row)
    # with an angle the crank may be faster than nominal: see `_check_speed`
    has_angle = "crank_angle" in file.campaign.channels
    fastest = SPEED_RATIOS[file.campaign.drive][1] if has_angle else 1.0
    _check_enough(file, "time", file.run.speed * (time[-1] - time[0]), time.size, fastest)


def _check_enough(
    file: RunFile, channel: str, turned: float, samples: int, fastest: float = 1.0
) -> None:
    """InputError if the record has less than a revolution or too few `samples` for the angle
    `turned` [rad]."""
    turns = turned * (1.0 + 1.0 / (samples - 1)) / tau  # the last sample counts as a step
    most = samples / MIN_SAMPLES_PER_REVOLUTION
    if not MIN_REVOLUTIONS / fastest <= turns <= most:
        fits = {
            unit: MIN_REVOLUTIONS <= factor * turns <= most
            for unit, factor in file.in_units(channel).items()
        }
        speed = f" at the nominal {_rpm(file.run.speed)}" if channel == "time" else ""
        raise file.error(
            channel,
            f"{samples} samples are {turns:.4g} revolutions{speed}; at least one revolution and"
            f" {MIN_SAMPLES_PER_REVOLUTION:g} samples per revolution are required;"
            f" {file.proposal(channel, fits)}",
        )


def _check_angle_alone(file: RunFile, read: np.ndarray, angle: np.ndarray) -> None:
    """InputError for implausible angles without times: `read` from the file, `angle` continuous."""
    steps = np.diff(angle)
    jumps = np.abs(np.diff(read)) > tau / 2
    usual = np.median(np.abs(steps))
    odd = jumps & (np.abs(steps - np.median(steps)) > max(1.0, 5.0 * usual))
    if jumps.mean() > 0.2 or odd.any():
        row = np.flatnonzero(jumps)[0] + 1
        raise file.error(
            "crank_angle",
            f"the angle steps by {file.run.side * degrees(read[row] - read[row - 1]):.4g} deg,"
            " neither less than half a turn nor back by full turns;"
            f" {file.proposal('crank_angle', {})}",
            row,
        )
    total = angle[-1] - angle[0]
    if total < -tau * MIN_REVOLUTIONS / 2:
        raise _falls(file, angle)
    _check_enough(file, "crank_angle", total, angle.size)


def _check_turns_on(file: RunFile, time: np.ndarray, angle: np.ndarray) -> None:
    """UnusableRun if the crank stands still or reverses, or its `angle` has a permanent step."""
    drive = file.campaign.drive
    speed = file.run.speed
    if drive == "constant_speed" and checks.stuck(angle, speed * time) is not None:
        return  # reported as a stuck encoder
    # a motor may start from rest
    still = None if drive == "motor" else checks.standstill(time, angle, speed)
    reverses = still is not None and still[2]
    step = checks.lasting_step(time, angle, speed) if still is None or reverses else None
    if step is not None:
        row, size = step
        raise UnusableRun(
            "step",
            f"{file.place('crank_angle', row)}: the angle has a permanent step of"
            f" {file.run.side * degrees(size):.3g} deg at {time[row]:.6g} s (lost"
            " or double-counted pulses, or a counter overflow); cut the record there, or correct"
            " the angle",
        )
    if still is None:
        return
    begin, end, _ = still
    when = f"from {begin:.6g} s to {end:.6g} s"
    part = "make two runs of it"
    if begin == time[0]:
        when = f"until {end:.6g} s"
        part = "keep the later part, and give the run 'start: unknown' if it has 'at_rest'"
    elif end >= time[-1]:
        when = f"from {begin:.6g} s on"
        part = "keep the earlier part"
    kind, verb = ("turns_back", "reverses") if reverses else ("standstill", "stands still")
    place = file.place("crank_angle", np.searchsorted(time, begin))
    raise UnusableRun(kind, f"{place}: the crank {verb} {when}; cut the record there ({part})")


def _check_speed(file: RunFile, time: np.ndarray, read: np.ndarray, speed: float) -> None:
    """InputError if the speed from angles and times differs from the run's, with the unit that
    would fit."""
    nominal, (low, high) = file.run.speed, SPEED_RATIOS[file.campaign.drive]
    ratio = speed / nominal
    if low <= ratio <= high:
        if file.campaign.drive == "constant_speed" and abs(ratio - 1.0) > REPORTED_SPEED_ERROR:
            file.remark(
                "crank_angle",
                f"with the times the mean speed is {_rpm(speed)}, but the run's speed is"
                f" {_rpm(nominal)}; the measured one is used. Correct speed",
            )
        return
    if low <= -ratio <= high:
        raise _falls(file, continuous_angle(time, read, nominal))
    parts = split_share(file.campaign.channels["crank_angle"].unit)[1]
    fits = {}
    for unit, factor in file.in_units("crank_angle").items():
        in_unit = _mean_speed(time, continuous_angle(time, factor * read, nominal))
        fits[unit] = abs(in_unit / nominal - 1.0) < 0.2
    fix = file.proposal("crank_angle", fits)
    for fold in (4.0, 2.0, 0.5, 0.25) if parts > 1.0 else ():
        if abs(ratio / fold - 1.0) < 0.1:
            fix = (
                f"counts_per_turn is {parts:g}: did you mean {fold * parts:g} (edges of the"
                " encoder's lines)?"
            )
    raise file.error(
        "crank_angle",
        f"the mean speed with column {file.campaign.channels['time'].column} is {_rpm(speed)}, but"
        f" the run's speed is {_rpm(nominal)}; {fix}",
    )


def _falls(file: RunFile, angle: np.ndarray) -> InputError:
    """The error for an `angle` [rad] that decreases, or increases in a clockwise run."""
    begin, end = file.run.side * np.degrees(angle[np.isfinite(angle)])[[0, -1]]
    text = f"falls from {begin:.6g} to {end:.6g} deg; if the crank turns clockwise, give the run"
    fix = "'direction: clockwise', otherwise"
    if file.run.side < 0.0:
        text = f"rises from {begin:.6g} to {end:.6g} deg, but run '{file.run.id}' has"
        fix = "'direction: clockwise'; remove it, or"
    return file.error("crank_angle", f"the angle {text} {fix} change the sign of the angles")


def _rpm(speed: float) -> str:
    return f"{number(speed * 60.0 / tau)} rpm"
