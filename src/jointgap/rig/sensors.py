"""Sensors and their faults."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, lfilter, sosfilt, sosfiltfilt

from jointgap.config.campaign import CHANNELS, FILTER_ORDER
from jointgap.core.candidates import Candidate, LawFamily, Parameter
from jointgap.effects.base import DETECTABLE_SHARE, Values, amplitude
from jointgap.rig.recording import Recording

# Samples per period of a low-pass filter's corner frequency: frequency warping is then above the corner
SAMPLES_PER_CORNER_PERIOD = 10.0
SAMPLES_PER_REVOLUTION = 720  # Least grid for filters and lags
PADDING_REVOLUTIONS = 0.25  # Before and after the samples, for transients of filters and lags

STANDARD_GRAVITY = 9.80665  # [m/s^2]
# Component of gravity along each acceleration
_AXES = {"slider_acceleration": math.cos, "rod_acceleration_x": math.cos, "rod_acceleration_y": math.sin}

# Channels that change their sign in the mirrored mechanism, besides the crank angle
MIRRORED = (
    "crank_speed rod_angle rod_angular_velocity rod_acceleration_y crank_torque guide_force frame_force_y".split()
)


def gravity_read(channel: str, direction: float) -> float:
    """Gravity part of an accelerometer's reading [m/s^2]; 0 for other channels."""
    return -STANDARD_GRAVITY * _AXES[channel](direction) if channel in _AXES else 0.0


def filter_times(first: float, last: float, revolution: float, corners: Iterable[float]) -> np.ndarray:
    """Uniform times [s] from `first` to `last` for filters and lags."""
    corner_steps = [1.0 / (SAMPLES_PER_CORNER_PERIOD * corner) for corner in corners]
    interval = min([revolution / SAMPLES_PER_REVOLUTION, *corner_steps])
    return np.linspace(first, last, math.ceil((last - first) / interval) + 1)


def low_pass(values: np.ndarray, interval: float, corner: float, causal: bool) -> np.ndarray:
    """Fourth-order Butterworth low-pass, forward and backward (no delay) unless causal."""
    sections = butter(FILTER_ORDER, corner, fs=1.0 / interval, output="sos")
    level = values[0]  # avoids a transient of the mean
    return level + (sosfilt(sections, values - level) if causal else sosfiltfilt(sections, values - level))


def lagged(values: np.ndarray, interval: float, lag: float) -> np.ndarray:
    """First-order lag, lag y' + y = u, exact for linear interpolation between samples."""
    share = interval / lag
    decay = math.exp(-share)
    mean_decay = -math.expm1(-share) / share  # mean of exp(-s) over an interval
    # y_n = decay y_(n-1) + (1 - mean_decay) u_n + (mean_decay - decay) u_(n-1)
    first = values[0]
    return first + lfilter([1.0 - mean_decay, mean_decay - decay], [1.0, -decay], values - first)


class Reading(NamedTuple):
    """Properties of a channel's reading that set the steps of a fit."""

    spread: float  # Standard deviation in `unit`
    unit: str
    turning: float  # Crank speed [rad/s]


@dataclass(frozen=True)
class SensorFault:
    """A sensor fault with one parameter, or one for each run."""

    name: str
    parameter: str
    unit: str  # SI; empty for the unit of the channel
    words: str  # Name in a verdict; may contain ``{site}``
    bounds: Callable[[Reading], tuple[float, float, float]]  # Step, lower and upper bound
    law: str = ""  # Reading y of the true value u
    of_each_run: bool = False  # Whether each run has its own parameter
    steady: bool = False  # Whether it is observable in a constant reading
    before_filter: Callable[[np.ndarray, float], np.ndarray] | None = None
    after_filter: Callable[[np.ndarray, float], np.ndarray] | None = None
    over_time: Callable[[np.ndarray, float, float], np.ndarray] | None = None
    delays: bool = False  # Whether its parameter [s] is a pure delay
    undone: Callable[[np.ndarray, float, np.ndarray], np.ndarray] | None = None

    def candidate(
        self, site: str, reading: Reading, replaces: Mapping[str, str] | None = None, runs: Sequence[str] = ()
    ) -> Candidate:
        """The candidate at a `site` (channel or encoder); `replaces` as in `Candidate`; `runs` of the campaign."""
        step, low, high = self.bounds(reading)
        one = amplitude(self.parameter, step, self.unit or reading.unit, low, high)
        several = tuple(replace(one, run=run) for run in runs) if self.of_each_run else (one,)
        keys, has_site = tuple(each.key for each in several), self.name not in ENCODER_FAULTS
        families = _families_of(self, site, one) if self.name in DELAY_SHARES else ()
        replaces = replaces or {}
        return Candidate(
            self.name, site, several, keys, replaces=replaces, sensor=True, has_site=has_site, families=families
        )


ENCODER_OFFSET, ENCODER_LAG, ENCODER_ZEROS = "encoder_offset", "encoder_lag", "encoder_zeros"
# Faults of the encoder, without a choice of channel
ENCODER_FAULTS = (ENCODER_OFFSET, ENCODER_ZEROS, ENCODER_LAG)

SENSOR_LAG, SENSOR_DELAY, LAG_AND_DELAY = "sensor_lag", "sensor_delay", "sensor_lag_and_delay"
# Members of the family `LAG_AND_DELAY` (first order plus dead time), and their share [1] of the delay
DELAY_SHARES = {SENSOR_LAG: 0.0, SENSOR_DELAY: 1.0}


def _late(reading: Reading) -> tuple[float, float, float]:
    """Step and bounds [s] of a lag or delay."""
    return DETECTABLE_SHARE / reading.turning, 0.0, 1.0 / reading.turning


def _families_of(fault: SensorFault, site: str, late: Parameter) -> tuple[LawFamily]:
    """The family of the lag or delay `late` of the sensor at a `site`."""
    own = DELAY_SHARES[fault.name]
    coordinates = replace(late, name=FAULTS[LAG_AND_DELAY].parameter), Parameter("delay_share", own, 0.0, 1.0, 0.1)
    law = Candidate(LAG_AND_DELAY, site, coordinates, (coordinates[0].key,), sensor=True, has_site=True)
    shares = tuple(DELAY_SHARES.values())
    return (LawFamily(law, "delay_share", own, shares, lambda values: {coordinates[0].key: values[late.key]}),)


FAULTS = {
    fault.name: fault
    for fault in (
        SensorFault(
            ENCODER_OFFSET,
            "offset_rad",
            "rad",
            "an offset of the encoder",
            bounds=lambda reading: (2e-3, -math.pi, math.pi),
            law="y = u + offset_rad",
        ),
        SensorFault(
            ENCODER_ZEROS,
            "zero_rad",
            "rad",
            "an encoder zero that differs between runs",
            bounds=lambda reading: (2e-3, -math.pi, math.pi),
            law="y = u + zero_rad, with its own value in each run",
            of_each_run=True,
        ),
        SensorFault(
            ENCODER_LAG,
            "lag_s",
            "s",
            "a delay of the encoder relative to the other sensors",
            bounds=lambda reading: (DETECTABLE_SHARE / reading.turning, -1.0 / reading.turning, 1.0 / reading.turning),
            law="y(t) = u(t - lag_s), a pure delay relative to all other channels; negative: these are late. Only with "
            "drive measured_angle; at constant speed it is equivalent to an encoder offset",
        ),
        SensorFault(
            "sensor_bias",
            "bias",
            "",
            "a bias of the sensor of {site}",
            law="y = u + bias",
            bounds=lambda reading: (DETECTABLE_SHARE * (reading.spread or 1.0), -math.inf, math.inf),
            steady=True,
            after_filter=lambda values, bias: values + bias,
            undone=lambda values, bias, times: values - bias,
        ),
        SensorFault(
            "sensor_gain",
            "gain_error",
            "1",
            "a wrong gain of the sensor of {site}",
            law="y = (1 + gain_error) u",
            bounds=lambda reading: (DETECTABLE_SHARE, -0.9, 9.0),
            before_filter=lambda values, error: (1.0 + error) * values,
            undone=lambda values, error, times: values / (1.0 + error),
        ),
        SensorFault(
            SENSOR_LAG,
            "lag_s",
            "s",
            "a lag of the sensor of {site}",
            bounds=_late,
            law="lag_s dy/dt + y = u, first order, such as of a filter: fast changes are delayed and attenuated",
            over_time=lambda values, interval, lag: lagged(values, interval, lag) if lag else values,
            undone=lambda values, lag, times: values + lag * np.gradient(values, times),
        ),
        SensorFault(
            SENSOR_DELAY,
            "delay_s",
            "s",
            "a delay of the sensor of {site}",
            bounds=_late,
            law="y(t) = u(t - delay_s), a pure delay, such as of a logger or a bus",
            delays=True,
            undone=lambda values, delay, times: np.interp(times + delay, times, values),
        ),
        SensorFault(
            LAG_AND_DELAY,
            "late_s",
            "s",
            "a lag or a delay of the sensor of {site}",
            bounds=_late,
            law="a delay of delay_share late_s and a lag of (1 - delay_share) late_s: the family of both, not a "
            "candidate itself",
        ),
    )
}
"""Every fault by its name, in the order in which a fit tries them."""


def sensor_candidates(
    spreads: Values, encoder: Sequence[str], turning: float, listed: Collection[str], runs: Sequence[str], offset=None
) -> list[Candidate]:
    """Possible sensor faults: those of the `encoder` (`offset` [rad]: start value) and those of channels whose readings
    have the standard deviations `spreads`.
    """
    found = []
    for name in encoder:
        parameter = FAULTS[name].parameter
        replaces = {name: parameter} if name in listed else {}
        candidate = FAULTS[name].candidate("sensor", Reading(0.0, "rad", turning), replaces, runs)
        if offset and name == ENCODER_OFFSET:
            candidate = replace(candidate, initial_guesses=({}, {parameter: offset}))
        found.append(candidate)
    return found + [
        fault.candidate(channel, Reading(spread, CHANNELS[channel], turning))
        for channel, spread in spreads.items()
        for fault in FAULTS.values()
        if fault.name not in (*ENCODER_FAULTS, LAG_AND_DELAY) and (fault.steady or spread > 0.0)
    ]


class Faults:
    """The sensor faults among effects and nuisances."""

    NUISANCES = ("encoder_zero", "encoder_lag", "slider_position_zero")
    """Nuisances that are sensor faults."""

    def __init__(self, effects: Iterable[tuple[Candidate, Values]], mirrored: bool, nuisances: Mapping[str, float]):
        side = -1.0 if mirrored else 1.0
        self.offset, self.lag = side * nuisances.get("encoder_zero", 0.0), nuisances.get("encoder_lag", 0.0)
        self._faults: list[tuple[SensorFault, str, float]] = []
        if position_zero := nuisances.get("slider_position_zero", 0.0):
            self._faults.append((FAULTS["sensor_bias"], "slider_position", position_zero))
        for candidate, values in effects:
            name, site = candidate.name, candidate.site
            if name == ENCODER_LAG:
                self.lag += values["lag_s"]
            elif name in ENCODER_FAULTS:
                self.offset += side * values[FAULTS[name].parameter]
            elif name == LAG_AND_DELAY:
                late, share = values[FAULTS[name].parameter], values["delay_share"]
                parts = {SENSOR_LAG: (1.0 - share) * late, SENSOR_DELAY: share * late}
                self._faults += [(FAULTS[part], site, value) for part, value in parts.items()]
            elif candidate.sensor:
                self._faults.append((FAULTS[name], site, values[candidate.amplitudes[0]]))

    def __bool__(self) -> bool:
        return bool(self.offset or self.lag or self._faults)

    def taken_out(self, recording: Recording) -> Recording:
        """The `recording` corrected for the faults."""
        angle = recording.crank_angle - self.offset
        if self.lag and recording.has_time:
            angle = angle + self.lag * np.gradient(recording.crank_angle, recording.time)
        channels = dict(recording.channels)
        # in reverse order of action
        for when in ("after_filter", "delays", "over_time", "before_filter"):
            for fault, site, value in self._faults:
                if getattr(fault, when) and fault.undone is not None and site in channels:
                    channels[site] = fault.undone(channels[site], value, recording.time)
        return replace(recording, crank_angle=angle, channels=channels)

    def delay(self, channel: str) -> float:
        """Pure delay [s] of a channel."""
        return sum(value for fault, site, value in self._faults if fault.delays and site == channel)

    def need_grid(self, channel: str) -> bool:
        """Whether a channel has a fault over time, which requires a dense grid."""
        return any(value for fault, site, value in self._faults if fault.over_time and site == channel)

    def act(self, when: str, channel: str, values: np.ndarray, *interval: float) -> np.ndarray:
        """Readings (n,) of a `channel` with the faults of kind `when` (a field of `SensorFault`)."""
        for fault, site, value in self._faults:
            if site == channel and (function := getattr(fault, when)) is not None:
                values = function(values, *interval, value)
        return values
