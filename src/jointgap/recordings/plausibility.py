"""Whether the samples of a channel can be right by themselves: clipped ones, and outliers."""

import numpy as np

from jointgap.recordings.limits import DEFAULT_LIMITS, RecordingLimits


def clipped(values: np.ndarray, limits: RecordingLimits = DEFAULT_LIMITS) -> str | None:
    """What is wrong with a channel many of whose samples stand at its largest or smallest value; None if nothing is.

    Parameters
    ----------
    values : (n,) array
        [SI]; NaN in gaps.
    limits : RecordingLimits
    """
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


def outliers(values: np.ndarray, limits: RecordingLimits = DEFAULT_LIMITS) -> np.ndarray:
    """Indices of values so far from all others that they may stand for something else, such as 'no data'.

    Parameters
    ----------
    values : (n,) array
        [SI]; NaN in gaps.
    limits : RecordingLimits
    """
    low, median, high = np.nanpercentile(values, (25.0, 50.0, 75.0))
    if not high > low:
        return np.empty(0, dtype=int)
    with np.errstate(invalid="ignore"):
        return np.flatnonzero(np.abs(values - median) > limits.outlier_interquartile_ranges * (high - low))


def angle_outliers(time: np.ndarray, angle: np.ndarray, limits: RecordingLimits = DEFAULT_LIMITS) -> np.ndarray:
    """Indices of crank angles far off the line between their neighbours, and farther than the scatter of all others.

    Parameters
    ----------
    time, angle : (n,) array
        [s]; [rad], continuous, NaN in gaps.
    limits : RecordingLimits
    """
    finite = np.flatnonzero(np.isfinite(angle))
    before, here, after = finite[:-2], finite[1:-1], finite[2:]
    share = (time[here] - time[before]) / (time[after] - time[before])
    away = np.abs(angle[here] - (1.0 - share) * angle[before] - share * angle[after])
    if not here.size:
        return here
    return here[away > max(limits.angle_outlier_rad, limits.angle_outlier_medians * float(np.median(away)))]
