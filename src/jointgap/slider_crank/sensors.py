"""What sensors make of a motion: gravity in accelerometers, a low-pass, and faults: bias, gain, lag."""

import math

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, sosfilt, sosfiltfilt

STANDARD_GRAVITY = 9.80665
"""[m/s^2] What an accelerometer that reads gravity reads at rest."""

_AXES = {"slider_acceleration": math.cos, "rod_acceleration_x": math.cos, "rod_acceleration_y": math.sin}
"""Accelerations and the component of a direction along them."""

MIRRORED = (
    "crank_speed",
    "rod_angle",
    "rod_angular_velocity",
    "rod_acceleration_y",
    "crank_torque",
    "guide_force",
    "frame_force_y",
)
"""Channels whose sign turns when the mechanism is seen from behind; the crank angle is mirrored where it is read."""

_ORDER = 4
_FINEST = 10.0  # samples of the grid per period of a filter's corner
_PER_TURN = 720  # samples of the grid per revolution, at least


def gravity_read(channel: str, direction: float) -> float:
    """What gravity in `direction` [rad] adds to an accelerometer's reading [m/s^2]: the opposite of free fall."""
    return -STANDARD_GRAVITY * _AXES[channel](direction) if channel in _AXES else 0.0


def grid(first: float, last: float, turn: float, bandwidths: list[float]) -> np.ndarray:
    """Even times [s] from `first` to `last` on which filters and lags are computed.

    Parameters
    ----------
    first, last : float
        [s].
    turn : float
        Duration of a revolution [s].
    bandwidths : list of float
        Corners of the filters [Hz].
    """
    interval = min([turn / _PER_TURN, *(1.0 / (_FINEST * corner) for corner in bandwidths)])
    return np.linspace(first, last, math.ceil((last - first) / interval) + 1)


def low_pass(values: np.ndarray, interval: float, corner: float, causal: bool) -> np.ndarray:
    """Butterworth's low-pass of 4th order; run forth and back, without delay, unless it is causal.

    Parameters
    ----------
    values : (n,) array
        At even times.
    interval : float
        Between samples [s].
    corner : float
        Frequency at which one run halves the power [Hz].
    causal : bool
    """
    sections = butter(_ORDER, corner, fs=1.0 / interval, output="sos")
    level = values[0]
    return level + (sosfilt(sections, values - level) if causal else sosfiltfilt(sections, values - level))


def lagged(values: np.ndarray, interval: float, lag: float) -> np.ndarray:
    """First-order lag, lag y' + y = u, of samples (n,) at even times with straight lines between them: exact for these."""
    share = interval / lag
    decay = math.exp(-share)
    behind = -math.expm1(-share) / share  # mean of exp(-s) over an interval
    # y_n = decay y_(n-1) + (1 - behind) u_n + (behind - decay) u_(n-1)
    first = values[0]
    return first + lfilter([1.0 - behind, behind - decay], [1.0, -decay], values - first)


def at_times(times: np.ndarray, grid_times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Smooth interpolation of values on a grid."""
    return CubicSpline(grid_times, values)(times)
