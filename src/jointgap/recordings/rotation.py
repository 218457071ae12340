"""Times and crank angles of a run: whether they rise, and whether their units make the run's speed."""

import math
from pathlib import Path

import numpy as np

from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.config.channels import channel_factor
from jointgap.errors import InputError
from jointgap.recordings.encoder_angle import TURN, running_on

UNITS = {"time": ("s", "ms", "us", "ns", "min"), "crank_angle": ("deg", "rad", "turn")}
SPEED_RATIOS = {"constant_speed": (0.5, 1.5), "measured_angle": (0.5, 1.5), "motor": (0.2, 5.0)}
"""Mean speed over nominal speed beyond which something other than the speed is wrong; a motor may start from rest."""

NEAR = 0.2  # of the nominal speed: so near must another unit come to be proposed
LEAST_PER_TURN = 4.0  # samples that a revolution needs
LEAST_TURNS = 1.0 - 1e-3


def checked_rotation(
    path: Path, campaign: Campaign, run: CampaignRun, values: dict[str, np.ndarray], rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and angles of a run, each all NaN where not measured, and how far the crank has turned.

    Parameters
    ----------
    path : Path
        For messages.
    campaign : Campaign
    run : CampaignRun
    values : dict of str to (n,) array
        Channels in SI; those of time finite, those of crank_angle too where there is no time.
    rows : (n,) array of int
        Rows of the file, for messages.

    Returns
    -------
    time : (n,) array
        [s].
    crank_angle : (n,) array
        [rad], running on; mirrored where the crank turns clockwise.
    turned : (n,) array
        Angle since the first sample [rad], rising on the whole, without gaps: from the angles where there are no times, else from
        times and the mean speed.

    Raises
    ------
    InputError
        Times that do not rise, an angle that falls, less than a revolution, a speed far from nominal, too few samples.
    """
    absent = np.full(rows.size, np.nan)
    time = values.get("time", absent)
    angle = values.get("crank_angle", absent)
    if run.direction == "clockwise":
        angle = -angle
    if "time" in values:
        _check_rising(path, campaign.channels["time"].column, time, rows)
        most = SPEED_RATIOS[campaign.drive][1] if "crank_angle" in values else 1.0  # the angle says more, below
        _check_time_alone(path, campaign, run, time, LEAST_TURNS / most)
    if "crank_angle" not in values:
        return time, absent, run.speed * (time - time[0])
    if np.count_nonzero(np.isfinite(angle)) < 2:
        raise InputError(
            f"{path}, column {campaign.channels['crank_angle'].column}: holds no angles; give the measurement"
        )
    if "time" not in values:
        angle = running_on(None, angle, run.speed)
        _check_angle_alone(path, campaign, run, values["crank_angle"], angle, rows)
        return absent, angle, angle - angle[0]
    whole = running_on(time, angle, run.speed)
    speed = _mean_speed(time, whole)
    _check_speed(path, campaign, run, time, angle, speed)
    _check_enough(path, campaign, (time[-1] - time[0]) * speed, time.size)
    return time, whole, speed * (time - time[0])


def _mean_speed(time: np.ndarray, angle: np.ndarray) -> float:
    known = np.flatnonzero(np.isfinite(angle))
    first, last = known[0], known[-1]
    return float((angle[last] - angle[first]) / (time[last] - time[first]))


def _check_rising(path: Path, column: str, time: np.ndarray, rows: np.ndarray) -> None:
    if (late := np.flatnonzero(np.diff(time) <= 0.0)).size:
        before, after = time[late[0]], time[late[0] + 1]
        what = f"repeats {after:.10g} s" if after == before else f"falls from {before:.10g} to {after:.10g} s"
        mend = "write times with more digits" if after == before else "sort the rows, or give one file per record"
        raise InputError(f"{path}, column {column}, row {rows[late[0] + 1]}: time {what}; {mend}")


def _check_time_alone(path: Path, campaign: Campaign, run: CampaignRun, time: np.ndarray, least: float) -> None:
    """Whether times make the `least` revolutions, and enough samples in each, at the nominal speed."""

    span = time[-1] - time[0]
    turns = run.speed * span * time.size / (time.size - 1) / TURN  # the last sample stands for a step too

    def fits(factor: float, least: float = LEAST_TURNS) -> bool:
        return least <= factor * turns <= time.size / LEAST_PER_TURN

    if fits(1.0, least):
        return
    channel = campaign.channels["time"]
    known = [unit for unit in UNITS["time"] if fits(channel_factor("time", unit) / campaign.factor("time"))]
    raise InputError(
        f"{path}, column {channel.column}: {time.size} samples over {span:.4g} s are {turns:.4g} revolutions at the "
        f"nominal {_rpm(run.speed)}; at least one revolution and {LEAST_PER_TURN:g} samples in each are needed; "
        f"{_proposal('time', channel.unit, known)}"
    )


def _check_angle_alone(
    path: Path, campaign: Campaign, run: CampaignRun, read: np.ndarray, angle: np.ndarray, rows: np.ndarray
) -> None:
    """Whether angles without times make sense as they are: `read` from the file, `angle` running on."""
    channel = campaign.channels["crank_angle"]
    where = f"{path}, column {channel.column}"
    steps = np.diff(angle)
    jumps = np.abs(np.diff(read)) > TURN / 2
    odd = jumps & (np.abs(steps - np.median(steps)) > max(1.0, 5.0 * float(np.median(np.abs(steps)))))
    if jumps.mean() > 0.2 or odd.any():
        row = int(np.flatnonzero(jumps)[0]) + 1
        raise InputError(
            f"{where}, row {rows[row]}: the angle steps by {math.degrees(read[row] - read[row - 1]):.4g} deg, neither less than half a "
            f"turn nor a fall by whole turns; {_proposal('crank_angle', channel.unit, ())}"
        )
    total = angle[-1] - angle[0]
    if total < -TURN * LEAST_TURNS / 2:
        raise _turns_back(where, run, angle)
    _check_enough(path, campaign, total, angle.size)


def _check_speed(
    path: Path, campaign: Campaign, run: CampaignRun, time: np.ndarray, angle: np.ndarray, speed: float
) -> None:
    """Whether angles and times make about the run's speed; if not, in which other units they would."""
    low, high = SPEED_RATIOS[campaign.drive]
    if low * run.speed <= speed <= high * run.speed:
        return
    where = f"{path}, column {campaign.channels['crank_angle'].column}"
    if -high * run.speed <= speed <= -low * run.speed:
        raise _turns_back(where, run, running_on(time, angle, run.speed))
    others = []
    for unit in UNITS["crank_angle"]:
        angles = channel_factor("crank_angle", unit) / campaign.factor("crank_angle") * angle
        if abs(_mean_speed(time, running_on(time, angles, run.speed)) / run.speed - 1.0) < NEAR:
            others.append(unit)
    raise InputError(
        f"{where}: with the column {campaign.channels['time'].column} it makes a mean speed of {_rpm(speed)}, but the run's is "
        f"{_rpm(run.speed)}; {_proposal('crank_angle', campaign.channels['crank_angle'].unit, others)}"
    )


def _check_enough(path: Path, campaign: Campaign, total: float, samples: int) -> None:
    """Whether `samples` over an angle of `total` [rad] hold a revolution, and enough samples in each."""
    channel = campaign.channels["crank_angle"]
    where = f"{path}, column {channel.column}"
    turns = total * (1.0 + 1.0 / (samples - 1)) / TURN  # the last sample stands for a step too
    if turns < LEAST_TURNS:
        raise InputError(
            f"{where}: the crank turns by {math.degrees(total):.4g} deg, less than one revolution; give a longer record, or "
            "correct the unit of the channel crank_angle"
        )
    if samples / turns < LEAST_PER_TURN:
        raise InputError(
            f"{where}: {samples} samples in {turns:.4g} revolutions are fewer than {LEAST_PER_TURN:g} a revolution; sample faster, or "
            "correct the unit of the channel crank_angle"
        )


def _turns_back(where: str, run: CampaignRun, angle: np.ndarray) -> InputError:
    """The complaint of an `angle`, mirrored where the run is clockwise, that falls on the whole."""
    known = np.degrees(angle[np.isfinite(angle)])
    if run.direction == "clockwise":
        return InputError(
            f"{where}: the angle rises from {-known[0]:.6g} to {-known[-1]:.6g} deg, but run '{run.id}' has 'direction: clockwise'; "
            "remove it, or change the sign of the angles"
        )
    return InputError(
        f"{where}: the angle falls from {known[0]:.6g} to {known[-1]:.6g} deg; if the crank turns clockwise, give the run "
        "'direction: clockwise', else change the sign of the angles"
    )


def _proposal(name: str, unit: str, others) -> str:
    """What to do about a unit, given the others that would fit."""
    others = [other for other in others if other != unit]
    if others:
        return f"channels.{name}.unit is '{unit}': did you mean '{others[0]}'?"
    return f"check channels.{name}.unit = '{unit}' and the run's speed, or measure again"


def _rpm(speed: float) -> str:
    return f"{speed * 60.0 / TURN:.4g} rpm"
