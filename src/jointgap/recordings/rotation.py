"""Times and crank angles of a run: whether they rise, and whether their units make the run's speed."""

import math
from dataclasses import dataclass
from math import tau
from pathlib import Path

import numpy as np

from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.config.channels import channel_factor
from jointgap.errors import InputError, UnusableRun
from jointgap.recordings.limits import RecordingLimits
from jointgap.recordings.plausibility import lasting_step, stuck
from jointgap.recordings.steadiness import standstill

UNITS = {"time": ("s", "ms", "us", "ns", "min"), "crank_angle": ("deg", "rad", "turn")}
"""Units that are proposed where the stated one does not fit."""


@dataclass(frozen=True)
class RunFile:
    """The file of a run with what is checked of it, and how messages name its places."""

    campaign: Campaign
    run: CampaignRun
    limits: RecordingLimits

    @property
    def path(self) -> Path:
        return self.campaign.folder / self.run.file

    def place(self, channel: str, row: int | None = None) -> str:
        """The column of `channel`, and the line `row` of the file (from 1): ``run.csv, column t, row 3``."""
        at = "" if row is None else f", row {row}"
        return f"{self.path}, column {self.campaign.channels[channel].column}{at}"

    def as_written(self, channel: str, value: float) -> str:
        """A `value` [SI] of `channel` as it stands in the file, with the stated unit."""
        stated = self.campaign.channels[channel]
        return f"{stated.sign * value / self.campaign.factor(channel):g} {stated.unit}"

    def in_unit(self, channel: str, unit: str) -> float:
        """Factor [1] that turns values of `channel`, read in its stated unit, into those read in `unit`."""
        return channel_factor(channel, unit) / self.campaign.factor(channel)


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
    if time is None:
        full_steps = _nearest(steps, np.zeros(steps.size))
    else:
        lapse = np.diff(time[finite])
        full_steps = _nearest(steps, speed * lapse)
        short = speed * lapse < tau / 4
        if short.any():  # across gaps the speed as measured is a better guide than the nominal one
            full_steps = _nearest(steps, full_steps[short].sum() / lapse[short].sum() * lapse)
    continuous[finite] = angle[finite[0]] + np.append(0.0, np.cumsum(full_steps))
    return continuous


def _nearest(steps: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """`steps` and as many whole turns as bring them nearest to what is `expected`."""
    return steps + tau * np.round((expected - steps) / tau)


def checked_rotation(
    file: RunFile, values: dict[str, np.ndarray], rows: np.ndarray, no_data: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and angles of a run, each all NaN where not measured, and how far the crank has turned."""
    absent, speed = np.full(rows.size, np.nan), file.run.speed
    time = values.get("time", absent)
    angle = values.get("crank_angle", absent)
    if file.run.direction == "clockwise":
        angle = -angle
    if "time" in values:
        _check_rising(file, time, rows)
        # with an angle the record may turn faster than nominal: `_check_speed` says more
        fastest = file.limits.speed_ratios[file.campaign.drive][1] if "crank_angle" in values else 1.0
        _check_time_alone(file, time, file.limits.min_revolutions / fastest)
    if "crank_angle" not in values:
        return time, absent, speed * (time - time[0])
    if np.count_nonzero(np.isfinite(angle)) < 2:
        raise InputError(f"{file.place('crank_angle')}: holds no angles; give the measurement")
    if "time" not in values:
        angle = continuous_angle(None, angle, speed)
        _check_angle_alone(file, values["crank_angle"], angle, rows)
        return absent, angle, angle - angle[0]
    continuous = continuous_angle(time, angle, speed)
    told = continuous.copy()
    told[no_data] = np.nan
    _check_turns_on(file, time, told, rows)
    mean_speed = _mean_speed(time, continuous)
    _check_speed(file, time, angle, mean_speed)
    _check_enough(file, (time[-1] - time[0]) * mean_speed, time.size)
    return time, continuous, mean_speed * (time - time[0])


def _mean_speed(time: np.ndarray, angle: np.ndarray) -> float:
    finite = np.flatnonzero(np.isfinite(angle))
    first, last = finite[0], finite[-1]
    return float((angle[last] - angle[first]) / (time[last] - time[first]))


def _check_rising(file: RunFile, time: np.ndarray, rows: np.ndarray) -> None:
    if (late := np.flatnonzero(np.diff(time) <= 0.0)).size:
        before, after = time[late[0]], time[late[0] + 1]
        what = f"repeats {after:.10g} s" if after == before else f"falls from {before:.10g} to {after:.10g} s"
        fix = "sort the rows, or give one file per record"
        if after == before:
            fix = (
                f"with other values ({np.count_nonzero(np.diff(time) == 0.0)} rows do); write times with more digits, "
                "or give channels.time 'repeated: last' to keep the last row of each time, or 'first'"
            )
        raise InputError(f"{file.place('time', rows[late[0] + 1])}: time {what}{' ' if after == before else '; '}{fix}")


def _check_time_alone(file: RunFile, time: np.ndarray, least: float) -> None:
    """Whether times make the `least` revolutions, and enough samples in each, at the nominal speed."""
    span, limits = time[-1] - time[0], file.limits
    turns = file.run.speed * span * time.size / (time.size - 1) / tau  # the last sample stands for a step too

    def fits(factor: float, least: float = limits.min_revolutions) -> bool:
        return least <= factor * turns <= time.size / limits.min_samples_per_revolution

    if not fits(1.0, least):
        fitting = [unit for unit in UNITS["time"] if fits(file.in_unit("time", unit))]
        raise InputError(
            f"{file.place('time')}: {time.size} samples over {span:.4g} s are {turns:.4g} revolutions at the nominal "
            f"{_rpm(file.run.speed)}; at least one revolution and {limits.min_samples_per_revolution:g} samples in "
            f"each are needed; {_proposal(file, 'time', fitting)}"
        )


def _check_angle_alone(file: RunFile, read: np.ndarray, angle: np.ndarray, rows: np.ndarray) -> None:
    """Whether angles without times make sense as they are: `read` from the file, `angle` continuous."""
    steps = np.diff(angle)
    jumps = np.abs(np.diff(read)) > tau / 2
    odd = jumps & (np.abs(steps - np.median(steps)) > max(1.0, 5.0 * float(np.median(np.abs(steps)))))
    if jumps.mean() > 0.2 or odd.any():
        row = int(np.flatnonzero(jumps)[0]) + 1
        step = math.degrees(read[row] - read[row - 1])
        raise InputError(
            f"{file.place('crank_angle', rows[row])}: the angle steps by {step:.4g} deg, neither "
            f"less than half a turn nor a fall by whole turns; {_proposal(file, 'crank_angle', ())}"
        )
    total = angle[-1] - angle[0]
    if total < -tau * file.limits.min_revolutions / 2:
        raise _turns_back(file, angle)
    _check_enough(file, total, angle.size)


def _check_turns_on(file: RunFile, time: np.ndarray, angle: np.ndarray, rows: np.ndarray) -> None:
    """Whether the crank neither stands still nor turns back, and no step of its `angle` stays."""
    campaign, speed = file.campaign, file.run.speed
    if campaign.drive == "constant_speed" and stuck(angle, speed * time, file.limits) is not None:
        return  # an encoder that is stuck, of which more is said
    # a motor may start from rest, which is simulated
    still = None if campaign.drive == "motor" else standstill(time, angle, speed, file.limits)
    turns_back = still is not None and still[2]
    step = lasting_step(time, angle, speed, file.limits) if still is None or turns_back else None
    if step is not None:
        place, size = step
        sign = -1.0 if file.run.direction == "clockwise" else 1.0
        raise UnusableRun(
            "step",
            f"{file.place('crank_angle', rows[place])}: the angle steps by {sign * math.degrees(size):.3g} deg at "
            f"{time[place]:.6g} s and stays there: pulses that were lost or counted twice, or a counter that "
            "overflowed; cut the record there, or mend the angle",
        )
    if still is None:
        return
    begin, end, _ = still
    at_first, at_last = begin == time[0], end >= time[-1]
    when = f"until {end:.6g} s" if at_first else f"from {begin:.6g} s " + ("on" if at_last else f"to {end:.6g} s")
    keep = "keep what comes after" if at_first else "keep what comes before" if at_last else "make two runs of it"
    rested = ", and give the run 'start: unknown'" if at_first and file.run.start == "at_rest" else ""
    raise UnusableRun(
        "turns_back" if turns_back else "standstill",
        f"{file.place('crank_angle', rows[int(np.searchsorted(time, begin))])}: the crank "
        f"{'turns back' if turns_back else 'stands still'} {when}; cut the record there ({keep}{rested})",
    )


def _check_speed(file: RunFile, time: np.ndarray, angle: np.ndarray, speed: float) -> None:
    """Whether angles and times make about the run's speed; if not, in which other units they would."""
    nominal = file.run.speed
    low, high = file.limits.speed_ratios[file.campaign.drive]
    if low * nominal <= speed <= high * nominal:
        return
    if -high * nominal <= speed <= -low * nominal:
        raise _turns_back(file, continuous_angle(time, angle, nominal))
    fitting = []
    for unit in UNITS["crank_angle"]:
        angles = file.in_unit("crank_angle", unit) * angle
        in_unit = _mean_speed(time, continuous_angle(time, angles, nominal))
        if abs(in_unit / nominal - 1.0) < file.limits.speed_tolerance:
            fitting.append(unit)
    raise InputError(
        f"{file.place('crank_angle')}: with the column {file.campaign.channels['time'].column} it makes a mean "
        f"speed of {_rpm(speed)}, but the run's is {_rpm(nominal)}; {_proposal(file, 'crank_angle', fitting)}"
    )


def _check_enough(file: RunFile, total: float, samples: int) -> None:
    """Whether `samples` over an angle of `total` [rad] hold a revolution, and enough samples in each."""
    turns = total * (1.0 + 1.0 / (samples - 1)) / tau  # the last sample stands for a step too
    if turns < file.limits.min_revolutions:
        what, fix = (
            f"the crank turns by {math.degrees(total):.4g} deg, less than one revolution",
            "give a longer record",
        )
    elif samples / turns < (least := file.limits.min_samples_per_revolution):
        what, fix = (
            f"{samples} samples in {turns:.4g} revolutions are fewer than {least:g} a revolution",
            "sample faster",
        )
    else:
        return
    raise InputError(f"{file.place('crank_angle')}: {what}; {fix}, or correct the unit of the channel crank_angle")


def _turns_back(file: RunFile, angle: np.ndarray) -> InputError:
    """The error of an `angle` [rad], mirrored where the run is clockwise, that falls on the whole."""
    finite = np.degrees(angle[np.isfinite(angle)])
    if file.run.direction == "clockwise":
        return InputError(
            f"{file.place('crank_angle')}: the angle rises from {-finite[0]:.6g} to {-finite[-1]:.6g} deg, but run "
            f"'{file.run.id}' has 'direction: clockwise'; remove it, or change the sign of the angles"
        )
    return InputError(
        f"{file.place('crank_angle')}: the angle falls from {finite[0]:.6g} to {finite[-1]:.6g} deg; if the crank "
        "turns clockwise, give the run 'direction: clockwise', else change the sign of the angles"
    )


def _proposal(file: RunFile, channel: str, fitting) -> str:
    """What to do about the unit of a channel, given those that would fit."""
    unit = file.campaign.channels[channel].unit
    if others := [other for other in fitting if other != unit]:
        return f"channels.{channel}.unit is '{unit}': did you mean '{others[0]}'?"
    return f"check channels.{channel}.unit = '{unit}' and the run's speed, or measure again"


def _rpm(speed: float) -> str:
    return f"{speed * 60.0 / tau:.4g} rpm"
