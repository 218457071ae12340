"""Whether the samples of a channel can be right by themselves: clipped or stuck ones, marks of no data, outliers."""

from math import tau

import numpy as np

from jointgap.recordings.limits import DEFAULT_LIMITS, RecordingLimits


def clipped(values: np.ndarray, limits: RecordingLimits = DEFAULT_LIMITS) -> str | None:
    """What is wrong with a channel many of whose samples stand at its largest or smallest value; None if nothing is."""
    ordered = np.sort(values[np.isfinite(values)])
    starts = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > limits.clipped_width * np.ptp(ordered))
    levels, counts = ordered[starts], np.diff(starts, append=ordered.size)
    for level, count, next_count in ((levels[-1], counts[-1], counts[-2]), (levels[0], counts[0], counts[1])):
        share = limits.clipped_share * counts.sum()
        if count >= max(limits.clipped_count, share, limits.clipped_excess * next_count):
            return (
                f"is clipped: {count} of {counts.sum()} samples are {level:.6g} in SI units, an extreme; "
                "what lies beyond was not measured, so leave these cells empty"
            )
    return None


def no_data(values: np.ndarray, limits: RecordingLimits = DEFAULT_LIMITS) -> np.ndarray:
    """Indices of samples that all have one extreme value far from the others, such as -9999 for 'no data'."""
    finite = values[np.isfinite(values)]
    for level in (finite.min(), finite.max()) if finite.size else ():
        others = finite[finite != level]
        if finite.size - others.size < limits.no_data_count or others.size < limits.min_samples:
            continue
        if np.abs(others - level).min() > limits.no_data_ranges * np.ptp(others) > 0.0:
            return np.flatnonzero(values == level)
    return np.empty(0, dtype=int)


def stuck(values: np.ndarray, turned: np.ndarray, limits: RecordingLimits = DEFAULT_LIMITS) -> slice | None:
    """The samples in a row at which a channel stands still while the crank turns; None where it does not.

    Where it stands still once a revolution that is the motion's doing, or the channel is clipped.
    """
    starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)  # a gap, too, differs from its neighbours
    lengths = np.diff(starts, append=values.size)
    longest = int(np.argmax(lengths))
    first, length = int(starts[longest]), int(lengths[longest])
    here = values[starts] == values[first]
    usual = int(lengths[~here].max(initial=0))
    if length < max(limits.stuck_count, limits.stuck_excess * usual):
        return None
    meanwhile = _range(turned[first : first + length])
    times = np.count_nonzero(here & (lengths > length / 2))
    recurs = times >= max(2.0, _range(turned) / tau / 2.0) and meanwhile < tau
    return None if recurs or meanwhile < limits.stuck_turn_rad else slice(first, first + length)


def _range(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else 0.0


def outliers(values: np.ndarray, limits: RecordingLimits = DEFAULT_LIMITS) -> np.ndarray:
    """Indices of values so far from all others that they may stand for something else, such as 'no data'."""
    low, median, high = np.nanpercentile(values, (25.0, 50.0, 75.0))
    if not high > low:
        return np.empty(0, dtype=int)
    with np.errstate(invalid="ignore"):
        return np.flatnonzero(np.abs(values - median) > limits.outlier_interquartile_ranges * (high - low))


def angle_outliers(time: np.ndarray, angle: np.ndarray, limits: RecordingLimits = DEFAULT_LIMITS) -> np.ndarray:
    """Indices of crank angles far off the line between their neighbours, and farther than the scatter of all others."""
    finite = np.flatnonzero(np.isfinite(angle))
    before, here, after = finite[:-2], finite[1:-1], finite[2:]
    share = (time[here] - time[before]) / (time[after] - time[before])
    away = np.abs(angle[here] - (1.0 - share) * angle[before] - share * angle[after])
    if not here.size:
        return here
    return here[away > _odd(away, limits)]


def _odd(away: np.ndarray, limits: RecordingLimits) -> float:
    """How far [rad] a crank angle has to be off the line between its neighbours, by how far (n,) [rad] all are."""
    return max(limits.angle_outlier_rad, limits.angle_outlier_medians * float(np.median(away)))


def lasting_step(
    time: np.ndarray, angle: np.ndarray, speed: float, limits: RecordingLimits = DEFAULT_LIMITS
) -> tuple[int, float] | None:
    """The first sample after a step of the angle that stays, and its size [rad]; None where there is none."""
    odd = angle_outliers(time, angle, limits)
    if not odd.size:
        return None
    finite = np.flatnonzero(np.isfinite(angle))
    t, a, places = time[finite], angle[finite], np.searchsorted(finite, odd)
    usual = float(np.median(np.diff(t)))
    speeds = np.diff(a) / np.diff(t)
    low, high = (ratio * speed for ratio in limits.speed_ratios["motor"])
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
        if abs(step) > 2.0 * max(limits.angle_outlier_rad, float(np.ptp(beside)) * lapse):
            largest = before + int(np.argmax(np.abs(speeds[before:after] - np.median(beside))))
            return int(finite[largest + 1]), float(step)
    return None
