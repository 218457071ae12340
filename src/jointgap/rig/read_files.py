"""Reading the runs of a campaign: columns to channels in SI, and what makes a file, a run or a channel unusable."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from math import degrees, tau
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config.campaign import CHANNELS, MOTOR_LINE, Campaign, CampaignRun, channel_factor
from jointgap.core.csv_files import Columns, read_columns
from jointgap.core.errors import InputError, UnusableRun
from jointgap.core.units import split_share, unit_factor
from jointgap.rig import checks
from jointgap.rig.checks import MIN_SAMPLES, SPEED_RATIOS
from jointgap.rig.contradictions import contradictions
from jointgap.rig.recording import OF_A_RUN, Contradiction, Measurements, Recording, noise_of, sentences

MIN_REVOLUTIONS = 1.0 - 1e-3  # One, less what rounding takes off
MIN_SAMPLES_PER_REVOLUTION = 4.0  # Fewer cannot tell whether the angle rises or falls
# Units that are proposed where the stated one does not fit
PROPOSED_UNITS = {"time": ("s", "ms", "us", "ns", "min"), "crank_angle": ("deg", "rad", "turn")}

Samples = dict[str, np.ndarray]  # Values (n,) [SI] by channel


@dataclass
class RunFile:
    """The file of a run, how messages name its places, and what is found in it."""

    campaign: Campaign
    run: CampaignRun
    remarks: list[str] = field(default_factory=list)
    found: list[Contradiction] = field(default_factory=list)
    rows: np.ndarray | None = None  # Line of the file (from 1) of each sample

    @property
    def path(self) -> Path:
        return self.campaign.folder / self.run.file

    def place(self, channel: str, sample: int | None = None) -> str:
        """The column of `channel`, and the line of a `sample`: ``run.csv, column t, row 3``."""
        at = "" if sample is None else f", row {self.rows[sample]}"
        return f"{self.path}, column {self.campaign.channels[channel].column}{at}"

    def remark(self, channel: str, text: str, sample: int | None = None) -> None:
        self.remarks.append(f"{self.place(channel, sample)}: {text}")

    def doubt(self, kind: str, channel: str, text: str, sample: int | None = None) -> None:
        self.remark(channel, f"{channel} {text}", sample)
        self.found.append(Contradiction(self.run.id, channel, kind, f"{channel} {text}"))

    def error(self, channel: str, text: str, sample: int | None = None) -> InputError:
        return InputError(f"{self.place(channel, sample)}: {text}")

    def as_written(self, channel: str, value: float) -> str:
        """A `value` [SI] of `channel` as it stands in the file, with the stated unit."""
        stated = self.campaign.channels[channel]
        return f"{stated.sign * value / self.campaign.factor(channel):g} {stated.unit}"

    def proposal(self, channel: str, fitting: Mapping[str, bool]) -> str:
        """What to do about the unit of a `channel`, given which units would fit."""
        unit = self.campaign.channels[channel].unit
        if others := [other for other, fits in fitting.items() if fits and other != unit]:
            return f"channels.{channel}.unit is '{unit}': did you mean '{others[0]}'?"
        return f"check channels.{channel}.unit = '{unit}' and the run's speed, or measure again"

    def in_units(self, channel: str) -> dict[str, float]:
        """Factors [1] that turn values of `channel`, read in its stated unit, into those read in others."""
        return {unit: channel_factor(channel, unit) / self.campaign.factor(channel) for unit in PROPOSED_UNITS[channel]}


# Why a nuisance is idle, where it is not for want of something to act on
_IDLE = dict.fromkeys(MOTOR_LINE, "is of a motor, so it needs drive: motor,") | {
    "speed": "follows from time and crank_angle"
}


def read_measurements(campaign: Campaign, compared: bool = True) -> Measurements:
    """All samples of a campaign.

    A sample without a time stamp, where times are measured, is no datum; nor is one without a crank angle where times
    are not. They are left out, and a remark says how many.
    """
    remarks = [
        f"nuisance {key} {_IDLE.get(key, 'has nothing to act on in this mechanism')} and is left out"
        for key in campaign.idle_nuisances
    ]
    wanted = [channel.column for channel in campaign.channels.values()]
    clock = campaign.channels["time"].column if "time" in campaign.channels else ""
    files = [RunFile(campaign, run) for run in campaign.runs]
    read = {file.run.id: (file, read_columns(file.path, wanted, campaign.csv, clock)) for file in files}
    check_copies(read)
    runs, found = {}, []
    for run, (file, columns) in read.items():
        try:
            runs[run] = _recording(file, columns)
            found += file.found  # what a run holds that is left out is no doubt of its channels
        except UnusableRun as error:
            remarks.insert(0, f"run {run} is left out: {error}")
            found.append(Contradiction(run, "crank_angle", error.kind, str(error), doubtful=False))
        remarks += file.remarks
    check_runs_left(campaign, {one.run: one.remark for one in found if one.kind in OF_A_RUN})
    others = contradictions(campaign, runs) if compared else []
    remarks += [f"{campaign.name}, {sentence}" for sentence in sentences(others)]
    return Measurements(runs, tuple(remarks), (*found, *others))


def check_copies(files: Mapping[str, tuple[RunFile, Columns]]) -> None:
    """Whether all runs were measured by themselves, whatever the names, formats and order of their files."""
    rows = {}  # a number for each sample, the same for the same values; zeros and gaps are each of one kind only
    for run, (_, columns) in files.items():
        values = pd.DataFrame({name: own + 0.0 for name, own in sorted(columns.values.items())})
        rows[run] = pd.util.hash_pandas_object(values, index=False).to_numpy()
    for one, other in combinations(files, 2):
        few, many = sorted((rows[one], rows[other]), key=len)
        if np.unique(few).size < 0.9 * few.size:
            continue  # rounded so that cycles of one run are alike: another run's may be too
        count = int(np.isin(few, many).sum())
        if count > 0.9 * few.size:
            raise InputError(
                f"{files[other][0].path}: the run '{other}' has the samples of the run '{one}' in {files[one][0].path} "
                f"({count} of {few.size} are equal); a copy confirms nothing: give the file that was measured in this "
                "run, or one run with role split"
            )


def check_runs_left(campaign: Campaign, left_out: Mapping[str, str]) -> None:
    """Make sure that a run for fitting is left."""
    fitted = {run.id for run in campaign.runs if run.role != "confirm"}
    if fitted and fitted <= left_out.keys():
        raise InputError(f"campaign {campaign.name}: no run for fitting can be used", *left_out.values())


def _recording(file: RunFile, columns: Columns) -> Recording:
    """The samples of a run, with channels that are clipped, stuck or marked as no data among what is found."""
    campaign, run = file.campaign, file.run
    _check_units(file, columns)
    file.remarks += columns.remarks
    values = _without_repeated(file, _in_si(file, columns))
    if (count := file.rows.size) < MIN_SAMPLES:
        raise InputError(f"{file.path}: {count} samples are too few; give {MIN_SAMPLES} at least")
    absent = {name: checks.no_data(samples) for name, samples in values.items() if name != "time"}
    for name, places in absent.items():
        if places.size:
            value = file.as_written(name, values[name][places[0]])
            text = f"is far from all else in {places.size} of {count} samples, which are {value}"
            file.doubt("no_data", name, f"{text}; leave the cells empty if that stands for 'no data'", places[0])
    time, angle, turned = _rotation(file, values, absent.get("crank_angle", np.empty(0, int)))
    has_angle = "crank_angle" in values
    channels = {name: samples for name, samples in values.items() if name not in ("time", "crank_angle")}
    for name, samples in channels.items():
        _check_varies(file, name, samples)
        samples = samples.copy()
        samples[absent[name]] = np.nan
        if not _is_stuck(file, name, samples, samples, angle if has_angle else turned):
            if (text := checks.clipped(samples)) is not None:
                file.doubt("clipped", name, text)
        if (places := checks.outliers(samples)).size:
            text = f"{samples[places[0]]:g} {CHANNELS[name]} is far from all else (so {_are(places.size)})"
            file.remark(name, f"{text}; leave the cell empty if it stands for 'no data'", places[0])
    if has_angle and run.start == "settled":  # a crank that begins at rest may stand still itself
        _is_stuck(file, "crank_angle", values["crank_angle"], angle, turned)
    if "time" in values and has_angle and (places := checks.angle_outliers(time, angle)).size:
        text = f"the angle is far off its neighbours' (so {_are(places.size)}); leave the cell empty if the encoder"
        file.remark("crank_angle", f"{text} misread it", places[0])
    listed = any(effect.name == "speed_fluctuation" for effect in campaign.mechanism.effects)
    if "time" in values and has_angle and campaign.drive == "constant_speed" and not listed:
        if varies := checks.unsteady(time, angle):
            file.remarks.append(
                f"{file.path}: the drive is constant_speed, but the speed varies {varies}; with times and crank "
                "angles, 'drive: measured_angle' takes the motion as it was"
            )
    return Recording(run.id, time, angle, channels, noise_of(campaign, run.id), _held_out(file, turned))


def _is_stuck(file: RunFile, name: str, written: np.ndarray, values: np.ndarray, turned: np.ndarray) -> bool:
    """Whether a channel is stuck, which is added to what is found; its `values` are continuous, unlike as `written`."""
    still = checks.stuck(values, turned)
    if still is not None:
        text = (
            f"is stuck: {still.stop - still.start} of {values.size} samples in a row are "
            f"{file.as_written(name, written[still.start])} while the crank turns; repair the sensor, or leave these "
            "cells empty"
        )
        file.doubt("stuck", name, text, still.start)
    return still is not None


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


def _check_units(file: RunFile, columns: Columns) -> None:
    """Whether a row of units in the file says what the campaign says."""
    for name, channel in file.campaign.channels.items():
        unit = columns.units.get(channel.column)
        try:
            factor = unit_factor(unit, CHANNELS[name]) if unit and channel.scale is None else None
        except Exception:  # no unit that pint knows: the campaign's is taken
            continue
        if factor is not None and not np.isclose(factor, file.campaign.factor(name), rtol=1e-6):
            text = f"the row below the headings says '{unit}', but channels.{name}.unit is '{channel.unit}'"
            raise file.error(name, f"{text}; correct one of them")
    if columns.units:
        row = ", ".join(columns.units.values())
        file.remarks.append(f"{file.path}: the row below the headings ({row}) is taken as units and skipped")


def _in_si(file: RunFile, columns: Columns) -> Samples:
    """Channels in SI without the samples that have no time (or angle)."""
    values, file.rows = {}, columns.rows
    for name, channel in file.campaign.channels.items():
        written = columns.values[channel.column]
        if split_share(channel.unit)[1] > 1.0:
            written = _without_overflow(file, name, written)
        factor = 1.0 if name == "time" and columns.is_dated else channel.sign * file.campaign.factor(name)
        with np.errstate(over="ignore"):  # refused below
            values[name] = factor * written
        values[name][np.abs(values[name]) < 1e-150] = 0.0  # their squares underflow
        if (huge := np.flatnonzero(np.abs(values[name]) > 1e12)).size:
            text = f"{written[huge[0]]:g} {channel.unit} is more than any sensor reads; correct it, or leave the cell"
            raise file.error(name, f"{text} empty where nothing was measured", huge[0])
    place = "time" if "time" in values else "crank_angle"
    kept = np.isfinite(values[place])
    if count := int(np.count_nonzero(~kept)):
        lack = "1 sample has" if count == 1 else f"{count} samples have"
        file.remark(place, f"{lack} no {place.replace('_', ' ')}, left out")
    file.rows = file.rows[kept]
    return {name: samples[kept] for name, samples in values.items()}


def _without_overflow(file: RunFile, name: str, counts: np.ndarray) -> np.ndarray:
    """Counts that run on where the counter overflowed."""
    finite = np.isfinite(counts)
    steps = np.abs(np.diff(counts[finite]))
    for bits in (16, 24, 32):
        if steps.size and abs(steps.max() - 2.0**bits) <= 4.0 * max(float(np.median(steps)), 1.0):
            file.remark(name, f"the counter of {bits} bits overflows; its counts are continued")
            counts = counts.copy()
            counts[finite] = np.unwrap(counts[finite], period=2.0**bits)
            break
    return counts


def _without_repeated(file: RunFile, values: Samples) -> Samples:
    """Channels without samples that repeat the one before, or of which the campaign keeps one a time."""
    if "time" not in values or not file.rows.size:
        return values
    which = file.campaign.channels["time"].repeated
    samples = pd.DataFrame({"time": values["time"]} if which else values)
    same = ((samples == samples.shift()) | (samples.isna() & samples.shift().isna())).all(axis=1).to_numpy(copy=True)
    same[0] = False
    kept = ~np.append(same[1:], False) if which == "last" else ~same
    if count := np.count_nonzero(~kept):
        rule = f"of rows of one time the {which} is kept" if which else "they repeat the row before them"
        file.remark("time", f"{rule}; so {_are(count)}, left out", np.argmin(kept))
    file.rows = file.rows[kept]
    return {name: samples[kept] for name, samples in values.items()}


def _are(count: int) -> str:
    return "is 1 sample" if count == 1 else f"are {count} samples"


def _check_varies(file: RunFile, name: str, values: np.ndarray) -> None:
    finite = values[np.isfinite(values)]
    fix = "or take the channel out of the campaign"
    if finite.size < MIN_SAMPLES:
        raise file.error(name, f"has {finite.size} values, too few of {MIN_SAMPLES}; give the measurement, {fix}")
    if np.ptp(finite) == 0.0:
        raise file.error(name, f"is constant, so the sensor measured nothing; repair it, {fix}")


# The crank's rotation


def continuous_angle(time: np.ndarray | None, angle: np.ndarray, speed: float) -> np.ndarray:
    """Continuous crank angles from an encoder's, which fall back after one turn or several, or are continuous already.

    Every step is known but for whole turns. With times, the number of turns is the one nearest to what the mean speed
    lets expect, so that gaps and few samples a turn do no harm. Without, a step is taken as less than half a turn.
    """
    finite = np.flatnonzero(np.isfinite(angle))
    continuous = np.full(angle.shape, np.nan)
    if not finite.size:
        return continuous
    steps = np.diff(angle[finite])
    lapse = np.zeros(steps.size) if time is None else np.diff(time[finite])
    whole = _nearest(steps, speed * lapse)
    short = (lapse > 0.0) & (speed * lapse < tau / 4)
    if short.any():  # across gaps the speed as measured is a better guide than the nominal one
        whole = _nearest(steps, whole[short].sum() / lapse[short].sum() * lapse)
    continuous[finite] = angle[finite[0]] + np.append(0.0, np.cumsum(whole))
    return continuous


def _nearest(steps: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """`steps` and as many whole turns as bring them nearest to what is `expected`."""
    return steps + tau * np.round((expected - steps) / tau)


def _rotation(file: RunFile, values: Samples, no_data: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and angles of a run, each all NaN where not measured, and how far the crank has turned."""
    absent, speed = np.full(file.rows.size, np.nan), file.run.speed
    time, angle = values.get("time", absent), values.get("crank_angle", absent)
    if file.run.direction == "clockwise":
        angle = -angle
    if "time" in values:
        _check_times(file, time)
    if "crank_angle" not in values:
        return time, absent, speed * (time - time[0])
    if np.count_nonzero(np.isfinite(angle)) < 2:
        raise file.error("crank_angle", "holds no angles; give the measurement")
    if "time" not in values:
        angle = continuous_angle(None, angle, speed)
        _check_angle_alone(file, values["crank_angle"], angle)
        return absent, angle, angle - angle[0]
    continuous = continuous_angle(time, angle, speed)
    told = continuous.copy()
    told[no_data] = np.nan
    _check_turns_on(file, time, told)
    mean_speed = _mean_speed(time, continuous)
    _check_speed(file, time, angle, mean_speed)
    _check_enough(file, "crank_angle", (time[-1] - time[0]) * mean_speed, time.size)
    return time, continuous, mean_speed * (time - time[0])


def _mean_speed(time: np.ndarray, angle: np.ndarray) -> float:
    ends = np.flatnonzero(np.isfinite(angle))[[0, -1]]
    return float(np.diff(angle[ends])[0] / np.diff(time[ends])[0])


def _check_times(file: RunFile, time: np.ndarray) -> None:
    """Whether times rise, and make a revolution, and enough samples in each, at the nominal speed."""
    steps = np.diff(time)
    if (late := np.flatnonzero(steps <= 0.0)).size:
        before, after = time[late[0]], time[late[0] + 1]
        text = f"falls from {before:.10g} to {after:.10g} s; sort the rows, or give one file per record"
        if after == before:
            text = (
                f"repeats {after:.10g} s with other values ({np.count_nonzero(steps == 0.0)} rows do); write times "
                "with more digits, or give channels.time 'repeated: last' to keep the last row of each time, or 'first'"
            )
        raise file.error("time", f"time {text}", late[0] + 1)
    # with an angle the record may turn faster than nominal: `_check_speed` says more
    fastest = SPEED_RATIOS[file.campaign.drive][1] if "crank_angle" in file.campaign.channels else 1.0
    _check_enough(file, "time", file.run.speed * (time[-1] - time[0]), time.size, fastest)


def _check_enough(file: RunFile, channel: str, turned: float, samples: int, fastest: float = 1.0) -> None:
    """Whether `samples` while the crank has `turned` [rad] by a `channel` hold a revolution, and enough in each."""
    turns = turned * (1.0 + 1.0 / (samples - 1)) / tau  # the last sample stands for a step too

    def fits(turns: float, least: float = MIN_REVOLUTIONS) -> bool:
        return least <= turns <= samples / MIN_SAMPLES_PER_REVOLUTION

    if not fits(turns, MIN_REVOLUTIONS / fastest):
        fitting = {unit: fits(factor * turns) for unit, factor in file.in_units(channel).items()}
        text = f"{samples} samples are {turns:.4g} revolutions"
        text += f" at the nominal {_rpm(file.run.speed)}" if channel == "time" else ""
        text += f"; at least one revolution and {MIN_SAMPLES_PER_REVOLUTION:g} samples in each are needed"
        raise file.error(channel, f"{text}; {file.proposal(channel, fitting)}")


def _check_angle_alone(file: RunFile, read: np.ndarray, angle: np.ndarray) -> None:
    """Whether angles without times make sense as they are: `read` from the file, `angle` continuous."""
    steps = np.diff(angle)
    jumps = np.abs(np.diff(read)) > tau / 2
    odd = jumps & (np.abs(steps - np.median(steps)) > max(1.0, 5.0 * float(np.median(np.abs(steps)))))
    if jumps.mean() > 0.2 or odd.any():
        row = int(np.flatnonzero(jumps)[0]) + 1
        text = f"the angle steps by {degrees(read[row] - read[row - 1]):.4g} deg, neither less than half a turn nor a"
        raise file.error("crank_angle", f"{text} fall by whole turns; {file.proposal('crank_angle', {})}", row)
    total = angle[-1] - angle[0]
    if total < -tau * MIN_REVOLUTIONS / 2:
        raise _falls(file, angle)
    _check_enough(file, "crank_angle", total, angle.size)


def _check_turns_on(file: RunFile, time: np.ndarray, angle: np.ndarray) -> None:
    """Whether the crank neither stands still nor turns back, and no step of its `angle` stays."""
    drive, speed = file.campaign.drive, file.run.speed
    if drive == "constant_speed" and checks.stuck(angle, speed * time) is not None:
        return  # an encoder that is stuck, of which more is said
    # a motor may start from rest, which is simulated
    still = None if drive == "motor" else checks.standstill(time, angle, speed)
    turns_back = still is not None and still[2]
    if (still is None or turns_back) and (step := checks.lasting_step(time, angle, speed)) is not None:
        row, size = step
        sign = -1.0 if file.run.direction == "clockwise" else 1.0
        place, size = file.place("crank_angle", row), sign * degrees(size)
        raise UnusableRun(
            "step",
            f"{place}: the angle steps by {size:.3g} deg at {time[row]:.6g} s and stays there: pulses that were lost "
            "or counted twice, or a counter that overflowed; cut the record there, or correct the angle",
        )
    if still is None:
        return
    begin, end, _ = still
    when, keep = f"from {begin:.6g} s to {end:.6g} s", "make two runs of it"
    if begin == time[0]:
        when, keep = f"until {end:.6g} s", "keep what comes after"
        keep += ", and give the run 'start: unknown'" if file.run.start == "at_rest" else ""
    elif end >= time[-1]:
        when, keep = f"from {begin:.6g} s on", "keep what comes before"
    what = "turns back" if turns_back else "stands still"
    place = file.place("crank_angle", int(np.searchsorted(time, begin)))
    kind = "turns_back" if turns_back else "standstill"
    raise UnusableRun(kind, f"{place}: the crank {what} {when}; cut the record there ({keep})")


def _check_speed(file: RunFile, time: np.ndarray, angle: np.ndarray, speed: float) -> None:
    """Whether angles and times make about the run's speed; if not, in which other units they would."""
    nominal, (low, high) = file.run.speed, SPEED_RATIOS[file.campaign.drive]
    if low * nominal <= speed <= high * nominal:
        return
    if -high * nominal <= speed <= -low * nominal:
        raise _falls(file, continuous_angle(time, angle, nominal))
    fitting = {}
    for unit, factor in file.in_units("crank_angle").items():
        in_unit = _mean_speed(time, continuous_angle(time, factor * angle, nominal))
        fitting[unit] = abs(in_unit / nominal - 1.0) < 0.2
    text = f"with the column {file.campaign.channels['time'].column} it makes a mean speed of {_rpm(speed)}, but the"
    raise file.error("crank_angle", f"{text} run's is {_rpm(nominal)}; {file.proposal('crank_angle', fitting)}")


def _falls(file: RunFile, angle: np.ndarray) -> InputError:
    """The error of an `angle` [rad], mirrored where the run is clockwise, that falls on the whole."""
    first, last = np.degrees(angle[np.isfinite(angle)])[[0, -1]]
    text = f"falls from {first:.6g} to {last:.6g} deg; if the crank turns clockwise, give the run"
    fix = "'direction: clockwise', else"
    if file.run.direction == "clockwise":
        text = f"rises from {-first:.6g} to {-last:.6g} deg, but run '{file.run.id}' has"
        fix = "'direction: clockwise'; remove it, or"
    return file.error("crank_angle", f"the angle {text} {fix} change the sign of the angles")


def _rpm(speed: float) -> str:
    return f"{speed * 60.0 / tau:.4g} rpm"
