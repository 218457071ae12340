"""What sensors make of a motion: gravity in accelerometers, a low-pass, a lag."""

import math
from collections.abc import Iterable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, sosfilt, sosfiltfilt

from jointgap.config.channels import FILTER_ORDER
from jointgap.slider_crank.settings import DEFAULT_SETTINGS, SensorSettings

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


def gravity_read(channel: str, direction: float) -> float:
    """What gravity adds to an accelerometer's reading [m/s^2]: the opposite of free fall; 0 of other channels."""
    return -STANDARD_GRAVITY * _AXES[channel](direction) if channel in _AXES else 0.0


def filter_times(
    first: float,
    last: float,
    revolution: float,
    corners: Iterable[float],
    settings: SensorSettings = DEFAULT_SETTINGS.sensors,
) -> np.ndarray:
    """Even times [s] from `first` to `last` on which filters and lags are computed."""
    corner_steps = [1.0 / (settings.samples_per_corner_period * corner) for corner in corners]
    interval = min([revolution / settings.samples_per_revolution, *corner_steps])
    return np.linspace(first, last, math.ceil((last - first) / interval) + 1)


def low_pass(values: np.ndarray, interval: float, corner: float, causal: bool) -> np.ndarray:
    """Butterworth's low-pass of 4th order; run forth and back, without delay, unless it is causal."""
    sections = butter(FILTER_ORDER, corner, fs=1.0 / interval, output="sos")
    level = values[0]  # the filter starts at rest there, without a transient of the mean
    return level + (sosfilt(sections, values - level) if causal else sosfiltfilt(sections, values - level))


def lagged(values: np.ndarray, interval: float, lag: float) -> np.ndarray:
    """First-order lag, lag y' + y = u, of samples with straight lines between them: exact for these."""
    share = interval / lag
    decay = math.exp(-share)
    mean_decay = -math.expm1(-share) / share  # mean of exp(-s) over an interval
    # y_n = decay y_(n-1) + (1 - mean_decay) u_n + (mean_decay - decay) u_(n-1)
    first = values[0]
    return first + lfilter([1.0 - mean_decay, mean_decay - decay], [1.0, -decay], values - first)


def at_times(times: np.ndarray, grid: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Smooth interpolation at `times` (m,) [s] of `values` (n,) [SI] at the times `grid` (n,) [s]."""
    return CubicSpline(grid, values)(times)
