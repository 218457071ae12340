"""The drive of the crank: prescribed or measured motion."""

import math
from pathlib import Path

import numpy as np
from numpy.polynomial import Legendre
from scipy.interpolate import (
    BSpline,
    CubicSpline,
    PPoly,
    make_interp_spline,
    make_smoothing_spline,
    splrep,
)
from scipy.linalg import cho_solve_banded, cholesky_banded, eigh
from scipy.optimize import brentq, minimize_scalar
from scipy.sparse.linalg import LinearOperator

from jointgap.config import Simulate
from jointgap.core.csv_files import Csv, read_columns
from jointgap.core.errors import InputError
from jointgap.core.numba_cache import compiled
from jointgap.core.units import unit_factor
from jointgap.linkage.parameters import CONSTANT, FLUCTUATING, MEASURED, MOST_KNOTS, MOTOR


@compiled
def fluctuation(ratio, anomaly):
    """Angle u of u' = n (1 + ratio cos u), with mean rate sqrt(1 - ratio^2) n, at the mean
    `anomaly`.

    From tan(u/2) = sqrt((1 + ratio) / (1 - ratio)) tan(anomaly/2), continuous over turns. The
    opposite `ratio` gives the inverse.
    """
    b = ratio / (1.0 + math.sqrt(1.0 - ratio * ratio))
    return anomaly + 2.0 * math.atan2(b * math.sin(anomaly), 1.0 - b * math.cos(anomaly))


@compiled
def crank_motion(p, time):
    """Angle [rad], speed [rad/s] and acceleration [rad/s^2] of a prescribed crank at `time` [s].

    Outside of a measured angle its first and last pieces are extrapolated.
    """
    d = p.drive
    if d.kind == CONSTANT:
        return d.start_angle + d.speed * time, d.speed, 0.0
    if d.kind == FLUCTUATING:
        begin = fluctuation(-d.ratio, d.order * d.start_angle - d.phase)
        rate = d.order * d.speed * math.sqrt(1.0 - d.ratio * d.ratio)
        u = fluctuation(d.ratio, begin + rate * time)
        speed = d.speed * (1.0 + d.ratio * math.cos(u))
        return (u + d.phase) / d.order, speed, -d.speed * d.ratio * d.order * speed * math.sin(u)
    low, high = 0, p.knots.count
    while high - low > 1:
        middle = (low + high) // 2
        if p.knots.pieces[middle, 0] <= time:
            low = middle
        else:
            high = middle
    t = time - p.knots.pieces[low, 0]
    angle = speed = bend = 0.0
    for i in range(1, 7):
        bend = bend * t + 2.0 * speed
        speed = speed * t + angle
        angle = angle * t + p.knots.pieces[low, i]
    return angle, speed, bend


@compiled
def crank_times(p, angles):
    """Times [s] at which a prescribed crank passes increasing `angles` (n,) [rad], the first at the
    start.

    `p.knots.end` for angles beyond the end of a measured angle; zeros for a motor, whose times
    result from the integration.
    """
    times = np.zeros(angles.size)
    if p.drive.kind == MOTOR:
        return times
    if p.drive.kind == CONSTANT:
        for i in range(angles.size):
            times[i] = (angles[i] - p.drive.start_angle) / p.drive.speed
        return times
    time, longest = 0.0, p.knots.end if p.drive.kind == MEASURED else math.inf
    for i in range(angles.size):
        low, high = time, longest
        for _ in range(200):
            angle, speed, _ = crank_motion(p, time)
            if angle < angles[i]:
                low = time
            else:
                high = time
            following = time - (angle - angles[i]) / speed
            if not low <= following <= high:
                following = 0.5 * (low + high)
            if abs(following - time) <= 4e-16 * abs(time) or following == time:
                break
            time = following
        times[i] = time
    return times


@compiled
def prescribed_angles(p, times):
    """Angles (n,) [rad] of a prescribed crank with the parameters `p` at `times` (n,) [s]."""
    angles = np.empty(times.size)
    for i in range(times.size):
        angles[i] = crank_motion(p, times[i])[0]
    return angles


_MIN_SAMPLES = 12  # samples required for a smooth angle
_TURN = 2 * math.pi
# Orders that repeat every two turns, as in four-stroke engines; others (gears, joints) are left to
# the spline
_ORDERS = np.arange(1, 9) / 2
_HIGHEST_ORDER = 12
# [1, of the highest resolved order] Orders up to there may matter in the acceleration of a flywheel
_BEYOND = 3
_RESOLVED = 40.0  # [1] Squared amplitude over its variance; high, as the led-in copies repeat noise
_DRIFT_TURNS = 12  # for more turns the polynomial has no more terms
_NEAR = 1e-2  # [mean distance of samples] nearer ones make divided differences inaccurate
_SITES_A_TURN = 60  # of the interpolation of the orders
_END_TURNS = 6  # from which the rotation at an end of a record is estimated
_MOST_GROWTH = 0.02  # [1/rad] of the speed beyond a record, relative: an eighth a turn
_MIN_TURNS = 0.99  # with fewer, drift and orders are indistinguishable
_MOST_ROTATIONS, _SETTLED_ROTATION = 20, 1e-4  # [1], [rad] of the iteration for the rotation
LONG_TURNS = 2.1  # with fewer, drift and half orders are indistinguishable


def read_angle(options: Simulate) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and continuous angles [rad] of a measured drive."""
    drive = options.drive
    path = Path(drive.file)
    if drive.time == drive.angle:
        raise InputError(
            f"simulate.drive: time and angle are both column '{drive.time}' of {path}; give two"
            " columns"
        )
    if drive.resolution is not None and drive.resolution > _TURN / 4:
        raise InputError(
            f"simulate.drive.resolution: {math.degrees(drive.resolution):g} deg is more than a"
            " quarter turn; give the step of the encoder, with its unit"
        )
    columns = read_columns(path, [drive.time, drive.angle], Csv())
    for column, values in columns.values.items():
        if (gaps := np.flatnonzero(np.isnan(values))).size:
            raise InputError(
                f"{path}, column {column}, row {columns.rows[gaps[0]]}: has no number; remove the"
                " row"
            )
    time = columns.values[drive.time]
    angle = columns.values[drive.angle] * unit_factor(drive.angle_unit, "rad")
    if time.size < _MIN_SAMPLES:
        raise InputError(
            f"{path}: {time.size} samples are too few for a smooth angle; give at least"
            f" {_MIN_SAMPLES}"
        )
    if (falls := np.flatnonzero(np.diff(time) <= 0)).size:
        row = int(falls[0]) + 1
        raise InputError(
            f"{path}, column {drive.time}, row {columns.rows[row]}: time {time[row]:g} s does not"
            " increase; sort the rows"
        )
    angle = unwrapped(angle)
    if angle[-1] < angle[0]:
        raise InputError(
            f"{path}, column {drive.angle}: the angle decreases from {math.degrees(angle[0]):.6g}"
            f" to {math.degrees(angle[-1]):.6g} deg: the crank turns clockwise; change the sign of"
            " the angles"
        )
    if (jumps := np.flatnonzero(np.abs(np.diff(angle)) > _TURN / 2)).size:
        row = int(jumps[0]) + 1
        raise InputError(
            f"{path}, column {drive.angle}, row {columns.rows[row]}: the angle steps by "
            f"{math.degrees(angle[row] - angle[row - 1]):.6g} deg, more than half a turn; "
            "give more samples a turn, or check simulate.drive.angle_unit"
        )
    return time - time[0], angle


def unwrapped(angle: np.ndarray) -> np.ndarray:
    """Continuous angles (n,) [rad], from angles that may jump back after one or several turns.

    Angles within one turn may cross its limit in both directions because of noise.
    """
    if np.ptp(angle) <= _TURN:
        return np.unwrap(angle)
    steps = np.diff(angle)
    back = np.where(steps < -_TURN / 2, np.round(-steps / _TURN), 0.0)
    return angle + _TURN * np.append(0.0, np.cumsum(back))


def repeated_basis(time: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A slowly drifting rotation and its first orders, as columns (n, d) and (n, m) for a linear
    fit of an angle.

    The orders refer to that rotation, a polynomial of time, instead of the crank angle, so the
    problem is linear even for unsteady rotation. No orders with too few turns or samples.
    """
    turns = (angle[-1] - angle[0]) / _TURN
    terms = max(int(1.2 * min(turns, _DRIFT_TURNS)) + 1, 3)
    drift = np.polynomial.legendre.legvander(
        2.0 * (time - time[0]) / (time[-1] - time[0]) - 1.0, terms
    )
    repeated = _ORDERS if turns > LONG_TURNS else _ORDERS[1::2]
    if turns < _MIN_TURNS or angle.size < 4 * (terms + 2 * repeated.size):
        return drift, np.empty((angle.size, 0))
    rotation = drift @ np.linalg.lstsq(drift, angle, rcond=None)[0]
    for _ in range(
        _MOST_ROTATIONS
    ):  # the first ones are distorted by the orders, the more the deeper they are
        before, orders = rotation, _waves(repeated, rotation)
        weights = np.linalg.lstsq(np.column_stack([drift, orders]), angle, rcond=None)[0]
        rotation = drift @ weights[: terms + 1]
        if np.abs(rotation - before).max() < _SETTLED_ROTATION:
            break
    step, room = repeated[0], (angle.size // 4 - terms) // 2
    every = step * np.arange(
        1, min(int(min(_HIGHEST_ORDER, angle.size / (4.0 * turns)) / step), room) + 1
    )
    if every.size <= repeated.size:
        return drift, orders
    waves = _waves(every, rotation)
    columns = np.column_stack([drift, waves])
    weights = np.linalg.lstsq(columns, angle, rcond=None)[0]
    variance = float(np.sum((angle - columns @ weights) ** 2)) / (angle.size - weights.size)
    squares = np.sum(weights[terms + 1 :].reshape(2, -1) ** 2, axis=0) * angle.size / 2.0
    kept = every <= repeated[-1]
    for own in (every % 1.0 == 0.0, every % 1.0 != 0.0):
        highest = np.max(every, where=own & (squares > _RESOLVED * variance), initial=0.0)
        kept |= own & (every <= _BEYOND * highest)
    return drift, waves[:, np.tile(kept, 2)]


def _waves(orders: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Cosines and sines (n, 2 m) of `orders` (m,) of a rotation (n,) [rad]."""
    phases = orders * rotation[:, None]
    return np.hstack([np.cos(phases), np.sin(phases)])


class SlowRotation:
    """The slowly drifting rotation of a crank at one `end` of a record (0 or -1) and beyond it.

    It is fitted as in `repeated_basis`; in records too short for orders it is the mean of the
    `cycle` [rad] at the end. Beyond the end the speed changes by the same share per angle as at the
    end.
    """

    def __init__(self, time: np.ndarray, angle: np.ndarray, cycle: float, end: int):
        near = np.flatnonzero(np.abs(angle - angle[end]) <= _END_TURNS * _TURN)
        near = np.arange(near[0], near[-1] + 1)
        drift, orders = repeated_basis(time[near], angle[near])
        if orders.size:
            weights = np.zeros((drift.shape[1], time.size))
            weights[:, near] = np.linalg.pinv(np.hstack([drift, orders]))[: drift.shape[1]]
            domain = time[near[[0, -1]]]
        else:
            domain = np.sort(
                [time[end], np.interp(angle[end] + (cycle if end == 0 else -cycle), angle, time)]
            )
            values = np.array([_interpolation(time, each) for each in domain])
            weights = np.array([[0.5, 0.5], [-0.5, 0.5]]) @ values
        self.weights = weights  # (d, n) from readings to coefficients
        self._end, self._domain = time[end], domain
        self._series = Legendre(weights @ angle, domain)
        mean = (angle[near[-1]] - angle[near[0]]) / (time[near[-1]] - time[near[0]])
        self._speed = max(float(self._series.deriv(1)(self._end)), 0.1 * mean)
        growth = (
            float(self._series.deriv(2)(self._end)) / self._speed**2
            if weights.shape[0] > 2
            else 0.0
        )
        self._growth = min(max(growth, -_MOST_GROWTH), _MOST_GROWTH) or 1e-12
        self.turned = np.full(time.size, np.nan)  # [rad] from the end, at the readings near it
        self.turned[near] = self._series(time[near]) - self._series(self._end)

    def time_at(self, turned: np.ndarray) -> np.ndarray:
        """Times [s] beyond the end at which the rotation has `turned` [rad] from it (negative:
        before the record)."""
        return self._end - np.expm1(-self._growth * turned) / (self._growth * self._speed)

    def errors(self, time: np.ndarray) -> np.ndarray:
        """Change (m, d) [rad] of the rotation at times (m,) [s] near the end or beyond it, by its
        coefficients."""
        inside, beyond = (time >= self._domain[0]) & (time <= self._domain[1]), time - self._end
        found = np.empty((time.size, len(self.weights)))
        for i in range(len(self.weights)):
            one = Legendre.basis(i, self._domain)
            slope, bend = one.deriv(1)(self._end), one.deriv(2)(self._end)
            found[:, i] = np.where(
                inside, one(time), one(self._end) + slope * beyond + 0.5 * bend * beyond**2
            )
        return found


def _interpolation(time: np.ndarray, moment: float) -> np.ndarray:
    """Weights (n,) of linear interpolation at a moment [s]."""
    after = min(max(int(np.searchsorted(time, moment)), 1), time.size - 1)
    weights, share = (
        np.zeros(time.size),
        (moment - time[after - 1]) / (time[after] - time[after - 1]),
    )
    weights[after - 1 : after + 1] = 1.0 - share, share
    return weights


def smooth_angle(
    time: np.ndarray,
    angle: np.ndarray,
    resolution: float | None,
    own: np.ndarray | slice = slice(None),
) -> PPoly:
    """Smooth spline through a measured angle.

    A slow rotation with its orders is fitted first (`repeated_basis`), a spline to the rest. With a
    known encoder step q it is the quintic with few knots whose RMS deviation is q / sqrt(12), the
    rounding error, plus three standard errors (the mean square of n rounding errors has the
    relative scatter sqrt(0.8 / n)), to avoid fitting the rounding. Otherwise it is a cubic whose
    smoothness is cross-validated by its `own` samples, as the others repeat them.

    At the ends the accelerations are about ten times less accurate, and the cubic's are those of
    the rotation. Records should begin and end some samples outside of the simulated motion.
    """
    steady = np.polyfit(time, angle, 1)
    rest, scale = angle - np.polyval(steady, time), time[-1] / (time.size - 1)
    columns = np.hstack(repeated_basis(time, angle))
    repeated = columns @ np.linalg.lstsq(columns, rest, rcond=None)[0]
    rest = rest - repeated
    if resolution is None:
        smoothness = _validated_smoothness(time[own] / scale, rest[own])
        spline = make_smoothing_spline(time / scale, rest, lam=smoothness)
    else:
        squares = time.size * resolution**2 / 12 * (1 + 3 * math.sqrt(0.8 / time.size))
        # compiled; make_splrep is 30 times slower for 8000 samples
        spline, _, status, _ = splrep(
            time / scale, rest, k=5, s=squares, full_output=True, quiet=True
        )
        if status > 0:
            raise InputError(
                f"simulate.drive.resolution: no smooth angle is within {math.degrees(resolution):g}"
                " deg of the record; give the step of the encoder, or null if it is unknown"
            )
    # by a cubic the acceleration of order 2 would be 0.4 % off at 60 samples a turn
    apart = max(int(time.size / (_SITES_A_TURN * (angle[-1] - angle[0]) / _TURN)), 1)
    sites = np.unique(np.append(np.arange(0, time.size, apart), time.size - 1))
    repeated = PPoly.from_spline(make_interp_spline(time[sites], repeated[sites], k=5))
    spline = PPoly.from_spline(spline)
    knots = np.unique(np.concatenate([scale * spline.x, repeated.x]))
    parts = [
        (spline(knots[:-1] / scale, k) / scale**k + repeated(knots[:-1], k)) / math.factorial(k)
        for k in range(6)
    ]
    parts[0] += np.polyval(steady, knots[:-1])
    parts[1] += steady[0]
    return PPoly(np.array(parts[::-1]), knots)


def _validated_smoothness(time: np.ndarray, values: np.ndarray) -> float:
    """Weight [unit of time^3] of the integral of a smoothing spline's squared second derivative, by
    generalised cross-validation (G. Wahba, Spline models for observational data, 1990, sec. 4.3).

    With the second divided differences Q'y and the integral's matrix R (P. J. Green and B. W.
    Silverman, Nonparametric regression and generalized linear models, 1994, sec. 2.1) the residual
    is Q (Q'Q + R / weight)^-1 Q'y. The trace of that matrix is a derivative of the determinant of
    Q'Q + R / weight (`make_smoothing_spline` takes ten times as long).
    """
    apart = np.append(True, np.diff(time) > _NEAR * (time[-1] - time[0]) / time.size)
    h = np.diff(time[apart])
    a, b, c = 1.0 / h[:-1], -1.0 / h[:-1] - 1.0 / h[1:], 1.0 / h[1:]
    noise, bend = np.zeros((2, 3, h.size - 1))  # Q'Q and R, upper bands
    noise[2], noise[1, 1:], noise[0, 2:] = (
        a * a + b * b + c * c,
        b[:-1] * a[1:] + c[:-1] * b[1:],
        c[:-2] * a[2:],
    )
    bend[2], bend[1, 1:] = (h[:-1] + h[1:]) / 3.0, h[1:-1] / 6.0
    differences = np.diff(np.diff(values[apart]) / h)

    def factor(log_weight: float) -> np.ndarray:
        return cholesky_banded(noise + bend * math.exp(-log_weight))

    def determinant(log_weight: float) -> float:
        return 2.0 * float(np.log(factor(log_weight)[2]).sum())

    def error(log_weight: float) -> float:
        solved = cho_solve_banded((factor(log_weight), False), differences)
        residual = np.zeros(h.size + 1)
        residual[:-2] += a * solved
        residual[1:-1] += b * solved
        residual[2:] += c * solved
        step = 1e-3
        left = differences.size + (
            determinant(log_weight + step) - determinant(log_weight - step)
        ) / (2.0 * step)
        return math.log(residual @ residual + 1e-300) - 2.0 * math.log(max(left, 1e-9))

    grid = np.linspace(-12.0, 3.5 * math.log(time.size), 40)
    best = int(np.argmin([error(each) for each in grid]))
    near = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    return math.exp(minimize_scalar(error, bounds=near, method="bounded").x)


def standstill_time(smooth: PPoly, begin: float, end: float) -> float | None:
    """Time [s] of the smallest speed of a smooth angle between `begin` and `end` [s] if it is not
    positive."""
    fine = np.linspace(begin, end, 20 * len(smooth.x))
    speed = smooth(fine, 1)
    return float(fine[np.argmin(speed)]) if speed.min() <= 0 else None


def angle_pieces(options: Simulate) -> tuple[np.ndarray, float]:
    """Pieces (k, 7) of a measured drive from its passage of the start angle, and its end [s]: see
    `knots_record`.

    The time there is zero, and the angle is shifted by whole turns to the start angle. Both ends
    are extended by the encoder's step, or by three times the smoothing's residual (at most one
    sample), so that noise does not remove a revolution from a record that begins or ends at the
    start angle.
    """
    path, resolution = options.drive.file, options.drive.resolution
    time, angle = read_angle(options)
    if angle[-1] - angle[0] < _TURN * (options.revolutions - 0.25):
        raise _too_short(options, angle[0], angle[-1])
    # at most one turn to the start angle, the revolutions, and half a turn as a margin
    needed = 1 + int(
        np.argmax(np.append(angle[:-1] > angle[0] + _TURN * (options.revolutions + 1.5), True))
    )
    time, angle = time[:needed], angle[:needed]
    if resolution is None and needed - 1 > MOST_KNOTS:
        raise _too_many_pieces(path, needed - 1)
    smooth = smooth_angle(time, angle, resolution)
    mean_speed = (angle[-1] - angle[0]) / time[-1]
    residual = math.sqrt(np.mean((smooth(time) - angle) ** 2))
    slack = resolution or min(3 * residual, mean_speed * time[-1] / (time.size - 1))
    ends = smooth.x[[0, -1]] + np.array([-1, 1]) * (slack + 1e-9) / mean_speed
    if (still := standstill_time(smooth, *ends)) is not None:
        raise InputError(
            f"{path}: the crank stands still or turns back at {still:.6g} s; give an increasing"
            " angle, or its resolution for smoothing"
        )
    first, last = (float(value) for value in smooth(ends))
    begin = _first_pass(options, first)
    if begin + _TURN * options.revolutions > last:
        raise _too_short(options, first, last)
    start = brentq(lambda t: smooth(t) - max(begin, first), *ends, xtol=1e-15 * ends[1])
    from_start = np.unique(np.append(smooth.x[smooth.x > start], start))[:-1]
    if len(from_start) > MOST_KNOTS:
        raise _too_many_pieces(path, len(from_start))
    table = np.zeros((len(from_start), 7))
    table[:, 0] = from_start - start
    for power in range(6):
        table[:, 6 - power] = smooth(from_start, power) / math.factorial(power)
    table[:, 6] -= begin - options.start_angle
    return table, float(ends[1] - start)


def _first_pass(options: Simulate, first: float) -> float:
    """The first angle [rad] from `first` on that equals the start angle up to whole turns."""
    return options.start_angle + _TURN * math.ceil((first - options.start_angle) / _TURN)


def _too_short(options: Simulate, first: float, last: float) -> InputError:
    held = max(math.floor((last - _first_pass(options, first)) / _TURN), 0)
    return InputError(
        f"{options.drive.file}: covers {math.degrees(first):.6g} to {math.degrees(last):.6g} deg;"
        f" from the start angle {math.degrees(options.start_angle):.6g} deg it contains {held}"
        f" whole revolutions, simulate.revolutions is {options.revolutions}; reduce it or give a"
        " longer record"
    )


def _too_many_pieces(path: str, count: int) -> InputError:
    return InputError(
        f"{path}: the smooth angle requires {count} pieces, more than {MOST_KNOTS}; give fewer"
        " samples or the resolution of the encoder, or reduce simulate.revolutions"
    )


_MOST_KNOTS = 400  # of the splines that approximate the smoothing spline, which has one per sample
_LEFT_OUT = 1e-3  # share of the variance of angle, speed and acceleration in neglected errors
_MOST_ERRORS = 100


class AngleErrors:
    """Independent errors of a smooth angle, each of one standard deviation.

    The smoothing leaves a residual of at least `least` [rad].
    """

    def __init__(
        self,
        time: np.ndarray,
        angle: np.ndarray,
        smooth: PPoly,
        copies: LinearOperator,
        noise: float | None,
        common: np.ndarray | None = None,
        least: float = 0.0,
    ):
        inner = time[2 : -2 : math.ceil(time.size / _MOST_KNOTS)]
        knots = np.concatenate([[time[0]] * 4, inner, [time[-1]] * 4])
        self._spline = BSpline(knots, np.eye(knots.size - 4), 3)
        columns = np.hstack(repeated_basis(time, angle))
        self._columns = CubicSpline(time, columns)
        projection = np.linalg.pinv(columns)  # their sizes, from angles
        basis, left = self._spline(time), smooth(time) - angle
        squares = max(left @ left, time.size * least**2)
        kept, shapes = _shrinkage(
            basis, self._bending(), angle - columns @ (projection @ angle), squares
        )
        spline = (shapes * kept) @ (basis @ shapes).T
        if noise is None:
            both = np.sum(
                (projection @ basis) * (spline @ columns).T
            )  # in the columns and in the spline
            noise = math.sqrt(
                left @ left / max(time.size - kept.sum() - columns.shape[1] + both, 1.0)
            )
        sizes = copies.rmatmat(
            np.vstack([spline - (spline @ columns) @ projection, projection]).T
        ).T  # from readings
        covariance = noise**2 * (sizes @ sizes.T)
        if common is not None:
            covariance += (sizes @ common) @ (sizes @ common).T
        self._weights = self._independent(time, covariance)

    @property
    def count(self) -> int:
        """Number of errors."""
        return self._weights.shape[1]

    def __call__(self, time: np.ndarray, derivative: int = 0) -> np.ndarray:
        """The errors (n, count) at times (n,) [s], or a time derivative [rad/s^derivative]."""
        return self._basis(time, derivative) @ self._weights

    def _basis(self, time: np.ndarray, derivative: int) -> np.ndarray:
        return np.hstack([self._spline(time, derivative), self._columns(time, derivative)])

    def _bending(self) -> np.ndarray:
        """Rows whose sum of squares is the integral of a spline's squared second derivative (two
        Gauss points)."""
        ends = np.unique(self._spline.t)
        half, middle = np.diff(ends) / 2, (ends[1:] + ends[:-1]) / 2
        points = np.concatenate([middle - half / math.sqrt(3), middle + half / math.sqrt(3)])
        return np.sqrt(np.tile(half, 2))[:, None] * self._spline(points, 2)

    def _independent(self, time: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """Weights of the basis for each error, sorted by their share of the variances of angle,
        speed and acceleration at all times."""
        rows = [self._basis(time, derivative) for derivative in range(3)]
        variances = [np.sum(each @ covariance * each, axis=1, keepdims=True) for each in rows]
        floors = [1e-12 * each.max() + 1e-300 for each in variances]
        scaled = zip(rows, variances, floors, strict=True)
        rows = [each / np.sqrt(np.maximum(variance, floor)) for each, variance, floor in scaled]
        squares, vectors = np.linalg.eigh(sum(each.T @ each for each in rows))
        root = (vectors * np.sqrt(np.maximum(squares, 0.0))) @ vectors.T
        squares, vectors = np.linalg.eigh(root @ covariance @ root)
        left = np.cumsum(np.maximum(squares, 0.0))
        chosen = np.flatnonzero(left > _LEFT_OUT * left[-1])[::-1][:_MOST_ERRORS]
        return covariance @ root @ (vectors[:, chosen] / np.sqrt(squares[chosen]))


def _shrinkage(basis, bending, angle, squares) -> tuple[np.ndarray, np.ndarray]:
    """Factors (k,) by which smoothing reduces the spline's independent modes, and the modes'
    weights (k, k) in the basis.

    The reduction leaves the `squares` of the smoothing's residual.
    """
    gram = basis.T @ basis
    roughness, vectors = eigh(bending.T @ bending, gram)
    roughness[:2] = 0.0  # of straight lines
    sizes = vectors.T @ (basis.T @ angle)
    unreached = angle - basis @ (vectors @ sizes)
    excess_alone = unreached @ unreached - squares

    def excess(log_smoothness: float) -> float:
        return float(excess_alone + np.sum(((1.0 - kept(log_smoothness)) * sizes) ** 2))

    def kept(log_smoothness: float) -> np.ndarray:
        return 1.0 / (1.0 + math.exp(log_smoothness) * roughness)

    smoothest, roughest = -math.log(roughness[2]) + 10.0, -math.log(roughness[-1]) - 5.0
    if excess(smoothest) <= 0.0:
        return kept(smoothest), vectors
    return (
        kept(roughest if excess(roughest) >= 0.0 else brentq(excess, roughest, smoothest)),
        vectors,
    )
