"""A measured crank angle as a smooth function of time, with its derivatives."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import PPoly, make_smoothing_spline, make_splrep

from jointgap.config import Simulate
from jointgap.config.quantities import unit_factor
from jointgap.dynamics.parameters import MOST_KNOTS
from jointgap.errors import InputError, did_you_mean

_LEAST = 12  # samples that a smooth angle needs


def read_angle(options: Simulate) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and angles [rad, running on over turns] of a measured drive.

    Raises
    ------
    InputError
        No such file or column; text, gaps or times that do not rise, with their row; an angle that falls.
    """
    drive = options.drive
    path = Path(drive.file)
    try:
        table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path, comment="#")
    except (OSError, ValueError) as error:
        raise InputError(f"simulate.drive.file {path}: cannot be read as a table ({error})") from error
    values = []
    for key, column in (("time", drive.time), ("angle", drive.angle)):
        if column not in table:
            raise InputError(
                f"{path}: has no column '{column}', which simulate.drive.{key} names; {did_you_mean(column, list(table))}"
            )
        numbers = pd.to_numeric(table[column], errors="coerce").to_numpy(dtype=float)
        if not np.isfinite(numbers).all():
            row = int(np.flatnonzero(~np.isfinite(numbers))[0])
            raise InputError(f"{path}, column {column}, row {row + 1}: '{table[column][row]}' is not a finite number")
        values.append(numbers)
    time, angle = values[0], values[1] * unit_factor(drive.angle_unit, "rad")
    if time.size < _LEAST:
        raise InputError(f"{path}: {time.size} samples are too few for a smooth crank angle; give {_LEAST} at least")
    if (falls := np.flatnonzero(np.diff(time) <= 0)).size:
        row = int(falls[0]) + 2
        raise InputError(
            f"{path}, column {drive.time}, row {row}: time {time[row - 1]:g} s does not rise; sort the rows"
        )
    return time - time[0], np.unwrap(angle)


def smooth_angle(time: np.ndarray, angle: np.ndarray, resolution: float | None) -> PPoly:
    """Smooth spline through a measured angle.

    With the encoder's step q known: the quintic with the fewest knots that deviates by q / sqrt(12) RMS, the rounding of
    an encoder. Else a cubic whose smoothness cross-validation chooses (G. Wahba, Spline models for observational data,
    1990). Both are made for what is left beside a steady rotation.

    Parameters
    ----------
    time, angle : (n,) arrays
        [s, rad].
    resolution : float or None
        q [rad].
    """
    steady = np.polyfit(time, angle, 1)
    rest, scale = angle - np.polyval(steady, time), time[-1] / (time.size - 1)
    if resolution is None:
        spline = make_smoothing_spline(time / scale, rest)
    else:
        spline = make_splrep(time / scale, rest, k=5, s=time.size * resolution**2 / 12)
    found = PPoly.from_spline(spline)
    inside = np.flatnonzero(np.diff(found.x) > 0)  # the ends' repeated knots bound nothing
    degree = found.c.shape[0] - 1
    powers = scale ** np.arange(degree, -1, -1)[:, None]
    pieces = PPoly(found.c[:, inside] / powers, scale * found.x[np.append(inside, inside[-1] + 1)])
    pieces.c[-1] += np.polyval(steady, pieces.x[:-1])
    pieces.c[-2] += steady[0]
    return pieces


def angle_pieces(options: Simulate) -> np.ndarray:
    """Pieces (k, 7) of a measured drive, from where it passes the start angle: see `knots_record`.

    The time is zero there, the angle is shifted by whole turns to the start angle.

    Raises
    ------
    InputError
        As in `read_angle`; an angle that does not rise throughout, or not as far as the simulation goes.
    """
    path, turn = options.drive.file, 2 * math.pi
    smooth = smooth_angle(*read_angle(options), options.drive.resolution)
    ends = smooth.x[[0, -1]]
    fine = np.linspace(*ends, 20 * len(smooth.x))
    if (speed := smooth(fine, 1)).min() <= 0:
        raise InputError(
            f"{path}: the crank stands still or turns back at {fine[np.argmin(speed)]:.6g} s; give an angle that rises, "
            "or its resolution, for noise to be smoothed"
        )
    first, last = (float(value) for value in smooth(ends))
    begin = options.start_angle + turn * math.ceil((first - options.start_angle) / turn - 1e-12)
    end, held = begin + turn * options.revolutions, math.floor((last - begin) / turn + 1e-12)
    if end > last + 1e-9:
        raise InputError(
            f"{path}: from the start angle on it holds {max(held, 0)} whole revolutions, simulate.revolutions asks for "
            f"{options.revolutions}; ask for fewer or give a longer record"
        )
    roots = smooth.solve(begin, extrapolate=False)
    start = float(roots[0]) if len(roots) else float(ends[0])
    from_start = np.unique(np.append(smooth.x[smooth.x > start], start))[:-1]
    if len(from_start) > MOST_KNOTS:
        raise InputError(
            f"{path}: its smooth angle needs {len(from_start)} pieces, more than {MOST_KNOTS}; give fewer samples or the "
            "resolution of the encoder"
        )
    table = np.zeros((len(from_start), 7))
    table[:, 0] = from_start - start
    for power in range(6):
        table[:, 6 - power] = smooth(from_start, power) / math.factorial(power)
    table[:, 6] -= begin - options.start_angle
    return table
