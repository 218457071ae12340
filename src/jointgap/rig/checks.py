"""Checks of measured samples: outliers, clipping, steady speed, direction of rotation."""

import math
from dataclasses import dataclass
from math import pi, sqrt, tau
from pathlib import Path

import numpy as np

from jointgap.config.campaign import Campaign, CampaignRun, channel_factor
from jointgap.core.errors import InputError, UnusableRun

# Limits that noise, steps of an encoder and impacts stay within, and mistaken units and columns do not
MIN_SAMPLES = 12  # A run and each of its channels need this many values
MIN_REVOLUTIONS = 1.0 - 1e-3  # One, less what rounding takes off
MIN_SAMPLES_PER_REVOLUTION = 4.0  # Fewer cannot tell whether the angle rises or falls
# [1] Mean speed over nominal speed beyond which something other than the speed is wrong, by drive
SPEED_RATIOS = {"constant_speed": (0.5, 1.5), "measured_angle": (0.5, 1.5), "motor": (0.2, 5.0)}
SPEED_TOLERANCE = 0.2  # [1] So near to the run's speed does the unit come that is proposed
CLIPPED_COUNT, CLIPPED_SHARE = 5, 0.01  # [samples], [1] An extreme value that occurs less often may be chance
CLIPPED_EXCESS = 6.0  # [1] So often as the value next to it
NO_DATA_RANGES = 10.0  # [1, range of all others] So far from them does a value stand for 'no data'
STUCK_COUNT, STUCK_EXCESS = 10, 8.0  # [samples], [1, of the longest other row of equal values]
STUCK_TURN = 0.1  # [rad] So far has the crank to turn meanwhile: with the crank at rest all stands still
OUTLIER_INTERQUARTILE_RANGES = 300.0  # [1] A value farther from the median is doubted
ANGLE_OUTLIER = 0.1  # [rad] A crank angle that misses the line between its neighbours by more is doubted
ANGLE_OUTLIER_MEDIANS = 15.0  # [1, median distances] It has to miss by this much more than usual too
UNSTEADY_SHARE, UNSTEADY_STANDARD_ERRORS = 0.01, 5.0  # [1] From such a variation of the speed on it is remarked
STANDSTILL_WINDOW = 0.25 * pi  # [rad] In the time of so much at nominal speed a crank that stands still turns
STANDSTILL_SHARE = 0.02  # [1] less than this share of it
TURNED_BACK_SHARE = 0.1  # [1, of the nominal speed] So fast it turns again, or back
TURNING_SHARE = 0.1  # [1, of the record] At least so long the crank turns at about its nominal speed


def clipped(values: np.ndarray) -> str | None:
    """What is wrong with a channel many of whose samples stand at its largest or smallest value; None if nothing is."""
    ordered = np.sort(values[np.isfinite(values)])
    starts = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > 1e-9 * np.ptp(ordered))
    levels, counts = ordered[starts], np.diff(starts, append=ordered.size)
    for level, count, next_count in ((levels[-1], counts[-1], counts[-2]), (levels[0], counts[0], counts[1])):
        share = CLIPPED_SHARE * counts.sum()
        if count >= max(CLIPPED_COUNT, share, CLIPPED_EXCESS * next_count):
            return (
                f"is clipped: {count} of {counts.sum()} samples are {level:.6g} in SI units, an extreme; "
                "what lies beyond was not measured, so leave these cells empty"
            )
    return None


def no_data(values: np.ndarray) -> np.ndarray:
    """Indices of samples that all have one extreme value far from the others, such as -9999 for 'no data'."""
    finite = values[np.isfinite(values)]
    for level in (finite.min(), finite.max()) if finite.size else ():
        others = finite[finite != level]
        if finite.size - others.size < 2 or others.size < MIN_SAMPLES:
            continue
        if np.abs(others - level).min() > NO_DATA_RANGES * np.ptp(others) > 0.0:
            return np.flatnonzero(values == level)
    return np.empty(0, dtype=int)


def stuck(values: np.ndarray, turned: np.ndarray) -> slice | None:
    """The samples in a row at which a channel stands still while the crank turns; None where it does not.

    Where it stands still once a revolution that is the motion's doing, or the channel is clipped.
    """
    starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)  # a gap, too, differs from its neighbours
    lengths = np.diff(starts, append=values.size)
    longest = int(np.argmax(lengths))
    first, length = int(starts[longest]), int(lengths[longest])
    here = values[starts] == values[first]
    usual = int(lengths[~here].max(initial=0))
    if length < max(STUCK_COUNT, STUCK_EXCESS * usual):
        return None
    meanwhile = _range(turned[first : first + length])
    times = np.count_nonzero(here & (lengths > length / 2))
    recurs = times >= max(2.0, _range(turned) / tau / 2.0) and meanwhile < tau
    return None if recurs or meanwhile < STUCK_TURN else slice(first, first + length)


def _range(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else 0.0


def outliers(values: np.ndarray) -> np.ndarray:
    """Indices of values so far from all others that they may stand for something else, such as 'no data'."""
    low, median, high = np.nanpercentile(values, (25.0, 50.0, 75.0))
    if not high > low:
        return np.empty(0, dtype=int)
    with np.errstate(invalid="ignore"):
        return np.flatnonzero(np.abs(values - median) > OUTLIER_INTERQUARTILE_RANGES * (high - low))


def angle_outliers(time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Indices of crank angles far off the line between their neighbours, and farther than the scatter of all others."""
    finite = np.flatnonzero(np.isfinite(angle))
    before, here, after = finite[:-2], finite[1:-1], finite[2:]
    share = (time[here] - time[before]) / (time[after] - time[before])
    away = np.abs(angle[here] - (1.0 - share) * angle[before] - share * angle[after])
    if not here.size:
        return here
    return here[away > max(ANGLE_OUTLIER, ANGLE_OUTLIER_MEDIANS * float(np.median(away)))]


def lasting_step(time: np.ndarray, angle: np.ndarray, speed: float) -> tuple[int, float] | None:
    """The first sample after a step of the angle that stays, and its size [rad]; None where there is none."""
    odd = angle_outliers(time, angle)
    if not odd.size:
        return None
    finite = np.flatnonzero(np.isfinite(angle))
    t, a, places = time[finite], angle[finite], np.searchsorted(finite, odd)
    usual = float(np.median(np.diff(t)))
    speeds = np.diff(a) / np.diff(t)
    low, high = (ratio * speed for ratio in SPEED_RATIOS["motor"])
    for group in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1):
        before, after = group[0] - 1, group[-1] + 1
        # a step has two sides; the neighbours of a wrong sample may be odd too, by half of it
        if len(group) != 2 or before < 2 or after > t.size - 3 or t[after] - t[before] > 5 * usual:
            continue
        beside = np.append(speeds[max(before - 4, 0) : before], speeds[after : after + 4])
        if not low < np.median(beside) < high:
            continue
        lapse = t[after] - t[before]
        step = a[after] - a[before] - float(np.median(beside)) * lapse
        if abs(step) > 2.0 * max(ANGLE_OUTLIER, float(np.ptp(beside)) * lapse):
            largest = before + int(np.argmax(np.abs(speeds[before:after] - np.median(beside))))
            return int(finite[largest + 1]), float(step)
    return None


_ORDERS, _HALF_ORDERS = np.arange(1, 4), np.arange(1, 7) / 2
_TURNS_FOR_HALF_ORDERS = 4.0
_MOST_DRIFT_TERMS = 8


def speed_variation(time: np.ndarray, angle: np.ndarray) -> tuple[float, float, float, float]:
    """How far the crank's speed varies, as shares of its mean [1].

    A four-stroke engine repeats after two turns: in records of four turns or more half orders are looked for too.
    """
    finite = np.isfinite(angle)
    time, angle = time[finite] - time[finite][0], angle[finite]
    turns = (angle[-1] - angle[0]) / tau
    period, orders = (2, _HALF_ORDERS) if turns >= _TURNS_FOR_HALF_ORDERS else (1, _ORDERS)
    terms = int(min(max(turns / period, 1), _MOST_DRIFT_TERMS)) + 1
    if time.size < 2 * (terms + 2 * orders.size):
        return np.nan, np.nan, np.nan, np.nan
    drift = np.polynomial.legendre.legvander(2.0 * time / time[-1] - 1.0, terms)
    phase = orders * angle[:, None]
    basis = np.column_stack([drift, np.cos(phase), np.sin(phase)])
    weights = np.linalg.lstsq(basis, angle, rcond=None)[0]
    sd = float(np.sqrt(np.mean((angle - basis @ weights) ** 2)))
    cosine, sine = weights[terms + 1 :].reshape(2, -1)
    places = np.linspace(0.0, period * tau, 120 * period)[:, None] * orders
    speed = (orders * (sine * np.cos(places) - cosine * np.sin(places))).sum(axis=1)
    passed = np.interp(np.arange(angle[0], angle[-1], tau), np.maximum.accumulate(angle), time)
    speeds = period * tau / (passed[period:] - passed[:-period])
    over = 0.5 * float(np.ptp(speeds) / speeds.mean()) if speeds.size > 1 else np.nan
    strongest = float(orders[np.argmax(orders * np.hypot(cosine, sine))])
    return 0.5 * float(np.ptp(speed)), over, sd * sqrt(2.0) / tau, strongest


def cycle_scatter(angle: np.ndarray, values: np.ndarray) -> float:
    """Standard deviation of a channel from its value a revolution later, over sqrt(2); NaN of less than two cycles."""
    rising = np.maximum.accumulate(angle)
    after = np.searchsorted(rising, rising + tau * (1.0 - 1e-9))
    here = np.flatnonzero((after > 0) & (after < rising.size))
    after = after[here]
    step = rising[after] - rising[after - 1]
    share = np.divide(rising[here] + tau - rising[after - 1], step, out=np.ones(step.shape), where=step > 0.0)
    share = np.clip(share, 0.0, 1.0)
    later = np.where(share < 1.0, (1.0 - share) * values[after - 1], 0.0) + share * values[after]
    squares = (values[here] - later) ** 2 / (1.0 + share**2 + (1.0 - share) ** 2)  # interpolated noise is smaller
    squares = squares[np.isfinite(squares)]
    return float(np.sqrt(squares.mean())) if squares.size >= 8 else np.nan


def standstill(time: np.ndarray, angle: np.ndarray, speed: float) -> tuple[float, float, bool] | None:
    """From when to when [s] a crank stands still, and whether it turns back; None where it turns on, or turns so little
    at its nominal speed that something else must be wrong.
    """
    finite = np.isfinite(angle)
    finite[angle_outliers(time, angle)] = False
    time, angle = time[finite], angle[finite]
    window = STANDSTILL_WINDOW / speed
    begins = time[time + window <= time[-1]]
    ahead = (np.interp(begins + window, time, angle) - angle[: begins.size]) / STANDSTILL_WINDOW
    low, high = SPEED_RATIOS["constant_speed"]
    slow = ahead < STANDSTILL_SHARE
    if not slow.any() or np.mean((ahead > low) & (ahead < high)) < TURNING_SHARE:
        return None
    # as far as noise would still let the smooth angle fall
    turning = np.flatnonzero(ahead > TURNED_BACK_SHARE)
    first, place = 0, int(np.argmax(slow))
    if (before := turning[turning < place]).size:
        first = int(before[-1]) + 1
    after = turning[turning > place]
    end = begins[after[0]] + window if after.size else time[-1]
    part = ahead[first : after[0] if after.size else None]
    return float(begins[first]), float(end), bool(part.min() < -TURNED_BACK_SHARE)


def unsteady(
    campaign: Campaign,
    run: CampaignRun,
    time: np.ndarray,
    angle: np.ndarray,
) -> str | None:
    """What is to be known of a crank that turns unsteadily under the drive constant_speed; None if it does not, or if
    the mechanism lists a fluctuation of the speed.
    """
    fluctuates = any(effect.name == "speed_fluctuation" for effect in campaign.mechanism.effects)
    if fluctuates or campaign.drive != "constant_speed" or not (np.isfinite(time).all() and np.isfinite(angle).any()):
        return None
    within, over, error, order = speed_variation(time, angle)
    half = f"within two turns (most at order {order:g}, as a four-stroke engine's does)"
    least = max(UNSTEADY_SHARE, UNSTEADY_STANDARD_ERRORS * error)
    told = [
        f"by {100.0 * share:.2g} % either way {where}"
        for share, where in ((within, "within a turn" if order % 1 == 0 else half), (over, "from turn to turn"))
        if share > least
    ]
    if not told:
        return None
    return (
        f"the drive is constant_speed, but the speed varies {' and '.join(told)}; with times and crank angles, "
        "'drive: measured_angle' takes the motion as it was"
    )


UNITS = {"time": ("s", "ms", "us", "ns", "min"), "crank_angle": ("deg", "rad", "turn")}
"""Units that are proposed where the stated one does not fit."""


@dataclass(frozen=True)
class RunFile:
    """The file of a run with what is checked of it, and how messages name its places."""

    campaign: Campaign
    run: CampaignRun

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
        fastest = SPEED_RATIOS[file.campaign.drive][1] if "crank_angle" in values else 1.0
        _check_time_alone(file, time, MIN_REVOLUTIONS / fastest)
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
    steps = np.diff(time)
    if not (late := np.flatnonzero(steps <= 0.0)).size:
        return
    before, after = time[late[0]], time[late[0] + 1]
    what = f"falls from {before:.10g} to {after:.10g} s; sort the rows, or give one file per record"
    if after == before:
        what = (
            f"repeats {after:.10g} s with other values ({np.count_nonzero(steps == 0.0)} rows do); write times with "
            "more digits, or give channels.time 'repeated: last' to keep the last row of each time, or 'first'"
        )
    raise InputError(f"{file.place('time', rows[late[0] + 1])}: time {what}")


def _check_time_alone(file: RunFile, time: np.ndarray, least: float) -> None:
    """Whether times make the `least` revolutions, and enough samples in each, at the nominal speed."""
    span = time[-1] - time[0]
    turns = file.run.speed * span * time.size / (time.size - 1) / tau  # the last sample stands for a step too

    def fits(factor: float, least: float = MIN_REVOLUTIONS) -> bool:
        return least <= factor * turns <= time.size / MIN_SAMPLES_PER_REVOLUTION

    if not fits(1.0, least):
        fitting = [unit for unit in UNITS["time"] if fits(file.in_unit("time", unit))]
        raise InputError(
            f"{file.place('time')}: {time.size} samples over {span:.4g} s are {turns:.4g} revolutions at the nominal "
            f"{_rpm(file.run.speed)}; at least one revolution and {MIN_SAMPLES_PER_REVOLUTION:g} samples in "
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
    if total < -tau * MIN_REVOLUTIONS / 2:
        raise _turns_back(file, angle)
    _check_enough(file, total, angle.size)


def _check_turns_on(file: RunFile, time: np.ndarray, angle: np.ndarray, rows: np.ndarray) -> None:
    """Whether the crank neither stands still nor turns back, and no step of its `angle` stays."""
    campaign, speed = file.campaign, file.run.speed
    if campaign.drive == "constant_speed" and stuck(angle, speed * time) is not None:
        return  # an encoder that is stuck, of which more is said
    # a motor may start from rest, which is simulated
    still = None if campaign.drive == "motor" else standstill(time, angle, speed)
    turns_back = still is not None and still[2]
    step = lasting_step(time, angle, speed) if still is None or turns_back else None
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
    low, high = SPEED_RATIOS[file.campaign.drive]
    if low * nominal <= speed <= high * nominal:
        return
    if -high * nominal <= speed <= -low * nominal:
        raise _turns_back(file, continuous_angle(time, angle, nominal))
    fitting = []
    for unit in UNITS["crank_angle"]:
        angles = file.in_unit("crank_angle", unit) * angle
        in_unit = _mean_speed(time, continuous_angle(time, angles, nominal))
        if abs(in_unit / nominal - 1.0) < SPEED_TOLERANCE:
            fitting.append(unit)
    raise InputError(
        f"{file.place('crank_angle')}: with the column {file.campaign.channels['time'].column} it makes a mean "
        f"speed of {_rpm(speed)}, but the run's is {_rpm(nominal)}; {_proposal(file, 'crank_angle', fitting)}"
    )


def _check_enough(file: RunFile, total: float, samples: int) -> None:
    """Whether `samples` over an angle of `total` [rad] hold a revolution, and enough samples in each."""
    turns = total * (1.0 + 1.0 / (samples - 1)) / tau  # the last sample stands for a step too
    what = ""
    if turns < MIN_REVOLUTIONS:
        what = f"the crank turns by {math.degrees(total):.4g} deg, less than one revolution; give a longer record"
    elif samples / turns < (least := MIN_SAMPLES_PER_REVOLUTION):
        what = f"{samples} samples in {turns:.4g} revolutions are fewer than {least:g} a revolution; sample faster"
    if what:
        raise InputError(f"{file.place('crank_angle')}: {what}, or correct the unit of the channel crank_angle")


def _turns_back(file: RunFile, angle: np.ndarray) -> InputError:
    """The error of an `angle` [rad], mirrored where the run is clockwise, that falls on the whole."""
    first, last = np.degrees(angle[np.isfinite(angle)])[[0, -1]]
    what = f"falls from {first:.6g} to {last:.6g} deg; if the crank turns clockwise, give the run"
    fix = "'direction: clockwise', else"
    if file.run.direction == "clockwise":
        what = f"rises from {-first:.6g} to {-last:.6g} deg, but run '{file.run.id}' has"
        fix = "'direction: clockwise'; remove it, or"
    return InputError(f"{file.place('crank_angle')}: the angle {what} {fix} change the sign of the angles")


def _proposal(file: RunFile, channel: str, fitting) -> str:
    """What to do about the unit of a channel, given those that would fit."""
    unit = file.campaign.channels[channel].unit
    if others := [other for other in fitting if other != unit]:
        return f"channels.{channel}.unit is '{unit}': did you mean '{others[0]}'?"
    return f"check channels.{channel}.unit = '{unit}' and the run's speed, or measure again"


def _rpm(speed: float) -> str:
    return f"{speed * 60.0 / tau:.4g} rpm"
