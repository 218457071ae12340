"""Checks of measured samples without a model: clipping, stuck sensors, outliers, standstill of the
crank."""

from math import pi, sqrt, tau

import numpy as np

from jointgap.config.campaign import Campaign
from jointgap.core.outliers import off_the_line

MIN_SAMPLES = 12  # Of a run and of each channel
SPEED_RATIOS = {
    "constant_speed": (0.5, 1.5),
    "measured_angle": (0.5, 1.5),
    "motor": (0.2, 5.0),
    "free": (0.2, 5.0),
}
"""Plausible range of mean speed over nominal speed [1], by drive."""
# [1] Of the stated speed, over the mean one; measured speeds scatter by less
REPORTED_SPEED_ERROR = 0.03
# [rad] Largest plausible distance of a crank angle from the line between its neighbours
ANGLE_OUTLIER = 0.1
LEAST_STEP = 0.02  # [rad] Half of the smallest reported permanent step of the angle
# [rad] Largest distance of computed angles from a line over time; no crank turns so evenly
COMPUTED_ANGLE = 1e-5

# The limits tolerate noise, encoder steps and impacts, but not wrong units and columns


def is_computed(campaign: Campaign, run: str, time: np.ndarray, angle: np.ndarray) -> bool:
    """Whether the crank angle of a run was computed from its times, and so contains no measurement
    of the motion."""
    encoder = campaign.channels["crank_angle"]
    alone = campaign.channels.keys() == {"time", "crank_angle"}
    if campaign.drive != "constant_speed" or alone or encoder.resolution or encoder.noise_of(run):
        return False
    elapsed, angle = (values[np.isfinite(angle)] for values in (time - time[0], angle))
    if angle.size < 3:
        return False
    away = angle - np.polyval(np.polyfit(elapsed, angle, 1), elapsed)
    return bool(np.abs(away).max() < COMPUTED_ANGLE)


def clipped(values: np.ndarray) -> str | None:
    """A remark if many samples equal the largest or smallest value, else None."""
    ordered = np.sort(values[np.isfinite(values)])
    starts = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > 1e-9 * np.ptp(ordered))
    counts = np.diff(starts, append=ordered.size)
    for end, next_to in ((-1, -2), (0, 1)):
        if counts[end] >= max(5, 0.01 * ordered.size, 6.0 * counts[next_to]):
            return (
                f"is clipped: {counts[end]} of {ordered.size} samples are at the limit"
                f" {ordered[starts[end]]:.6g} (SI); leave these cells empty"
            )
    return None


def no_data(values: np.ndarray) -> np.ndarray:
    """Indices of samples that share one extreme value far from the others, such as -9999 for 'no
    data'."""
    finite = values[np.isfinite(values)]
    for level in (finite.min(), finite.max()) if finite.size else ():
        usual = finite[finite != level]
        several = finite.size - usual.size >= 2 and usual.size >= MIN_SAMPLES
        if several and np.abs(usual - level).min() > 10.0 * np.ptp(usual) > 0.0:
            return np.flatnonzero(values == level)
    return np.empty(0, dtype=int)


def stuck(values: np.ndarray, turned: np.ndarray) -> slice | None:
    """Consecutive samples at which a channel is constant while the crank turns; None if it recurs
    every revolution (due to the motion or clipping) or there are none.
    """
    # NaN differs from its neighbours
    starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    lengths = np.diff(starts, append=values.size)
    longest = np.argmax(lengths)
    begin = starts[longest]
    length = lengths[longest]
    recurring = values[starts] == values[begin]
    if length < max(10, 8.0 * lengths[~recurring].max(initial=0)):
        return None
    meanwhile = _range(turned[begin : begin + length])
    total = _range(turned)
    recurs = (
        np.count_nonzero(recurring & (lengths > length / 2)) >= max(2.0, total / tau / 2.0)
        and meanwhile < tau
    )
    return None if recurs or meanwhile < 0.1 else slice(begin, begin + length)


def _range(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return np.ptp(finite) if finite.size else 0.0


def outliers(values: np.ndarray) -> np.ndarray:
    """Indices of values that are implausibly far from the others."""
    low, median, high = np.nanpercentile(values, (25.0, 50.0, 75.0))
    far = np.abs(values - median) > 300.0 * (high - low)
    return np.flatnonzero(far & (high > low))


def angle_outliers(time: np.ndarray, angle: np.ndarray, least: float = ANGLE_OUTLIER) -> np.ndarray:
    """Indices of crank angles at least `least` [rad] from the line between their neighbours, and
    far compared with the scatter.
    """
    finite = np.flatnonzero(np.isfinite(angle))
    places = finite[1:-1]
    away = off_the_line(time[finite], angle[finite])
    usual = np.median(away) if places.size else 0.0
    return places[away > max(least, 15.0 * usual)]


def lasting_step(time: np.ndarray, angle: np.ndarray, speed: float) -> tuple[int, float] | None:
    """The first sample after a permanent step of the angle, and its size [rad]; None if there is
    none."""
    finite = np.flatnonzero(np.isfinite(angle))
    t = time[finite]
    a = angle[finite]
    # at least the step of a coarse encoder, which is usual
    apart = np.diff(np.sort(np.mod(a, tau)))
    least = max(LEAST_STEP, 1.5 * apart[apart > 1e-6].min(initial=ANGLE_OUTLIER))
    odd = np.searchsorted(finite, angle_outliers(time, angle, least))
    if not odd.size or odd.size > (a[-1] - a[0]) / tau + 2:  # the motion
        return None
    speeds = np.diff(a) / np.diff(t)
    usual = np.median(np.diff(t))
    low, high = (ratio * speed for ratio in SPEED_RATIOS["motor"])
    for group in np.split(odd, np.flatnonzero(np.diff(odd) > 1) + 1):
        # both sides of a step are outliers; so can be the neighbours of a wrong sample
        if len(group) != 2 or group[0] < 3 or group[-1] > t.size - 4:
            continue
        left_side = group[0] - 1
        right = group[-1] + 1
        next_to = np.append(speeds[max(left_side - 4, 0) : left_side], speeds[right : right + 4])
        mean = np.median(next_to)
        lapse = t[right] - t[left_side]
        step = a[right] - a[left_side] - mean * lapse
        steady = low < mean < high and lapse <= 5 * usual
        if steady and abs(step) > 2.0 * max(least, np.ptp(next_to) * lapse):
            largest = left_side + np.argmax(np.abs(speeds[left_side:right] - mean))
            return int(finite[largest + 1]), float(step)
    return None


def late_stamps(time: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, int, float, float] | None:
    """Samples whose time is off the middle between its neighbours, every n-th by the same share of
    the period.

    Their indices, n, that share [1], and the part of it [1] that the angle follows (0: it is even;
    NaN: unknown).
    """
    period = np.median(np.diff(time))
    offset = np.zeros(time.size)
    offset[1:-1] = (time[1:-1] - 0.5 * (time[:-2] + time[2:])) / period
    size = np.abs(offset)
    neighbours = np.maximum(np.append(size[1:], 0.0), np.append(0.0, size[:-1]))
    is_odd = (size > max(0.1, 8.0 * np.median(size))) & (size > 1.5 * neighbours)
    rows = np.flatnonzero(is_odd)
    if rows.size < 5:
        return None
    distances = np.diff(rows)
    n = int(np.median(distances))
    share = np.median(offset[rows])
    is_pattern = distances.min() >= 3 and np.mean(distances == n) >= 0.9
    if not is_pattern or np.abs(offset[rows] - share).max() > 0.3 * abs(share):
        return None
    rise = 0.5 * (angle[rows + 1] - angle[rows - 1])
    followed = (angle[rows] - 0.5 * (angle[rows - 1] + angle[rows + 1])) / (rise * share)
    return rows, n, share, np.nanmedian(followed) if np.isfinite(followed).any() else np.nan


def clock_jump(time: np.ndarray, angle: np.ndarray) -> tuple[int, float] | None:
    """The first sample after the clock was set back or forward, and by how much [s]; None if there
    is none.

    A pause of the record is none: after it the crank has turned on by its speed. Without angles, or
    after a pause too long for its speed, a jump forward counts if it is longer than the rest of the
    record.
    """
    lapse = np.diff(time)
    usual = np.median(lapse)
    for row in np.flatnonzero(lapse < 0.0)[:1]:
        # a single wrong time leaves those beside it in order
        beside = slice(max(row - 1, 0), row + 3)
        is_single = (
            abs(time[beside][-1] - time[beside][0] - usual * (time[beside].size - 1)) < 0.5 * usual
        )
        restarts = np.count_nonzero(lapse < 0.0) > 3 or abs(time[row + 1] - time[0]) < 2.0 * usual
        return (
            None
            if is_single or restarts or usual <= 0.0
            else (int(row) + 1, float(lapse[row]) - usual)
        )
    steps = _nearest_turn(np.diff(angle))
    near = (lapse > 0.0) & (lapse < 2.0 * usual) & np.isfinite(steps)
    speed, spread = np.nan, np.inf
    if near.sum() > 2 * MIN_SAMPLES:
        speeds = np.convolve(steps[near] / lapse[near], np.full(8, 1.0 / 8.0), "valid")
        speed = np.median(speeds)
        spread = max(np.ptp(np.percentile(speeds, (10.0, 90.0))), 1e-3 * abs(speed))
    for row in np.flatnonzero(lapse > 5.0 * usual):
        off = abs(_nearest_turn(steps[row] - speed * lapse[row]))
        slack = 0.03 * tau + spread * lapse[row]
        remaining = time[-1] - time[0] - lapse[row]
        if off > slack if slack < pi / 2.0 else lapse[row] > remaining:
            return row + 1, lapse[row] - usual
    return None


def _nearest_turn(angle: np.ndarray) -> np.ndarray:
    """Angles [rad] between half a turn back and forward."""
    return np.remainder(angle + pi, tau) - pi


def dead_zone(angle: np.ndarray) -> np.ndarray:
    """Indices of samples at which an encoder reads one angle over a part of most turns; `angle` as
    written."""
    places = np.flatnonzero(np.isfinite(angle))
    read = angle[places]
    if read.size < MIN_SAMPLES:
        return places[:0]
    starts = np.flatnonzero(np.diff(read, prepend=np.nan) != 0.0)
    ends = np.append(starts[1:], read.size)
    steps = np.abs(_nearest_turn(np.diff(read[starts])))
    inner = np.flatnonzero((ends - starts >= 3) & (starts > 0) & (ends < read.size))
    # a slow crank or a coarse encoder goes on by a usual step
    skipped = np.abs(_nearest_turn(read[ends[inner]] - read[starts[inner] - 1]))
    inner = inner[skipped > 3.0 * np.median(steps)] if steps.size else inner
    levels, counts = np.unique(read[starts[inner]], return_counts=True)
    turns = np.abs(_nearest_turn(np.diff(read[starts]))).sum() / tau
    if not counts.size or counts.max() < max(2.0, 0.5 * turns):
        return places[:0]
    level = levels[np.argmax(counts)]
    return np.concatenate([places[starts[i] : ends[i]] for i in inner if read[starts[i]] == level])


def speed_variation(time: np.ndarray, angle: np.ndarray) -> tuple[float, float, float, float]:
    """Variation of the crank speed within and from turn to turn, its error (shares of the mean
    [1]), and the strongest order; with four turns or more including half orders (four-stroke
    engines).
    """
    finite = np.isfinite(angle)
    time = time[finite] - time[finite][0]
    angle = angle[finite]
    turns = (angle[-1] - angle[0]) / tau
    period, orders = (2, np.arange(1, 7) / 2) if turns >= 4.0 else (1, np.arange(1, 4))
    terms = int(min(max(turns / period, 1), 8)) + 1
    if time.size < 2 * (terms + 2 * orders.size):
        return np.nan, np.nan, np.nan, np.nan
    drift = np.polynomial.legendre.legvander(2.0 * time / time[-1] - 1.0, terms)
    phase = orders * angle[:, None]
    basis = np.column_stack([drift, np.cos(phase), np.sin(phase)])
    weights = np.linalg.lstsq(basis, angle, rcond=None)[0]
    sd = np.sqrt(np.mean((angle - basis @ weights) ** 2))
    cosine, sine = weights[terms + 1 :].reshape(2, -1)
    places = np.linspace(0.0, period * tau, 120 * period)[:, None] * orders
    speed = (orders * (sine * np.cos(places) - cosine * np.sin(places))).sum(axis=1)
    passed = np.interp(np.arange(angle[0], angle[-1], tau), np.maximum.accumulate(angle), time)
    speeds = period * tau / (passed[period:] - passed[:-period])
    over = 0.5 * (np.ptp(speeds) / speeds.mean()) if speeds.size > 1 else np.nan
    strongest = orders[np.argmax(orders * np.hypot(cosine, sine))]
    return 0.5 * np.ptp(speed), over, sd * sqrt(2.0) / tau, strongest


def unsteady(time: np.ndarray, angle: np.ndarray) -> str:
    """The significant variation of the crank speed as text; empty if there is none."""
    within, over, error, order = speed_variation(time, angle)
    half = f"within two turns (strongest order {order:g}, as of a four-stroke engine)"
    parts = {"within a turn" if order % 1 == 0 else half: within, "from turn to turn": over}
    least = max(0.01, 5.0 * error)
    return " and ".join(
        f"by ±{100 * share:.2g} % {where}" for where, share in parts.items() if share > least
    )


def cycle_scatter(angle: np.ndarray, values: np.ndarray) -> float:
    """Standard deviation of the difference of a channel over one revolution, over sqrt(2); NaN for
    less than two cycles."""
    rising = np.maximum.accumulate(angle)
    later_rows = np.searchsorted(rising, rising + tau * (1.0 - 1e-9))
    rows = np.flatnonzero((later_rows > 0) & (later_rows < rising.size))
    later_rows = later_rows[rows]
    step = rising[later_rows] - rising[later_rows - 1]
    share = np.divide(
        rising[rows] + tau - rising[later_rows - 1], step, out=np.ones(step.shape), where=step > 0.0
    )
    share = np.clip(share, 0.0, 1.0)
    later = (
        np.where(share < 1.0, (1.0 - share) * values[later_rows - 1], 0.0)
        + share * values[later_rows]
    )
    # interpolation reduces noise
    squares = (values[rows] - later) ** 2 / (1.0 + share**2 + (1.0 - share) ** 2)
    squares = squares[np.isfinite(squares)]
    return np.sqrt(squares.mean()) if squares.size >= 8 else np.nan


def standstill(
    time: np.ndarray, angle: np.ndarray, speed: float
) -> tuple[float, float, bool] | None:
    """Begin and end [s] of a standstill of the crank, and whether it reverses; None if there is
    none, or if the crank is hardly ever near its nominal speed.
    """
    finite = np.isfinite(angle)
    finite[angle_outliers(time, angle)] = False
    time = time[finite]
    angle = angle[finite]
    window = 0.25 * pi / speed  # [s] An eighth of a turn at nominal speed
    begins = time[time + window <= time[-1]]
    ahead = (np.interp(begins + window, time, angle) - angle[: begins.size]) / (0.25 * pi)
    low, high = SPEED_RATIOS["constant_speed"]
    slow = ahead < 0.02
    if not slow.any() or np.mean((ahead > low) & (ahead < high)) < 0.1:
        return None
    turning = np.flatnonzero(ahead > 0.1)
    place = np.argmax(slow)
    low_row = turning[turning < place].max(initial=-1) + 1
    high_row = turning[turning > place].min(initial=begins.size)
    end = begins[high_row] + window if high_row < begins.size else time[-1]
    return begins[low_row], end, ahead[low_row:high_row].min() < -0.1
