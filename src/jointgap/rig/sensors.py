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

# Samples per period of a low-pass filter's corner frequency: what the digital filter warps lies above the corner then
SAMPLES_PER_CORNER_PERIOD = 10.0
SAMPLES_PER_REVOLUTION = 720  # On which filters and lags are computed, at least: short of most impacts' ringing
PADDING_REVOLUTIONS = 0.25  # Before and after the samples, for transients of filters and lags to decay

STANDARD_GRAVITY = 9.80665  # [m/s^2] What an accelerometer that reads gravity reads at rest
# Accelerations and the component of a direction along them
_AXES = {"slider_acceleration": math.cos, "rod_acceleration_x": math.cos, "rod_acceleration_y": math.sin}

# Channels whose sign turns when the mechanism is seen from behind; the crank angle is mirrored where it is read
MIRRORED = (
    "crank_speed rod_angle rod_angular_velocity rod_acceleration_y crank_torque guide_force frame_force_y".split()
)


def gravity_read(channel: str, direction: float) -> float:
    """What gravity adds to an accelerometer's reading [m/s^2]: the opposite of free fall; 0 of other channels."""
    return -STANDARD_GRAVITY * _AXES[channel](direction) if channel in _AXES else 0.0


def filter_times(first: float, last: float, revolution: float, corners: Iterable[float]) -> np.ndarray:
    """Even times [s] from `first` to `last` on which filters and lags are computed."""
    corner_steps = [1.0 / (SAMPLES_PER_CORNER_PERIOD * corner) for corner in corners]
    interval = min([revolution / SAMPLES_PER_REVOLUTION, *corner_steps])
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


class Reading(NamedTuple):
    """What the sensor of a channel reads: standard deviation in its SI `unit`, while the crank turns at `turning`
    [rad/s].
    """

    spread: float
    unit: str
    turning: float


@dataclass(frozen=True)
class SensorFault:
    """One way in which a sensor can err, by one parameter, or one in each run."""

    name: str  # As a verdict states it
    parameter: str
    unit: str  # SI; empty for the unit of the channel
    words: str  # What a verdict calls it; they may hold ``{site}``
    bounds: Callable[[Reading], tuple[float, float, float]]
    law: str = ""  # What the sensor reads, y, of what is true, u
    of_each_run: bool = False  # Whether each run has a parameter of its own
    steady: bool = False  # Whether a reading that does not change shows it too
    before_filter: Callable[[np.ndarray, float], np.ndarray] | None = None
    after_filter: Callable[[np.ndarray, float], np.ndarray] | None = None
    over_time: Callable[[np.ndarray, float, float], np.ndarray] | None = None
    delays: bool = False  # Whether the sensor reads what was true earlier, by its parameter [s]
    undone: Callable[[np.ndarray, float, np.ndarray], np.ndarray] | None = None

    def candidate(
        self, site: str, reading: Reading, replaces: Mapping[str, str] | None = None, runs: Sequence[str] = ()
    ) -> Candidate:
        """The fault at a `site`, a channel or the encoder, whose `reading` sets the steps of a fit; `replaces` as of a
        `Candidate`; `runs` are those of the campaign.
        """
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
# Faults of the one sensor that reads the crank angle, on which the motion is laid: they have no channel to choose
ENCODER_FAULTS = (ENCODER_OFFSET, ENCODER_ZEROS, ENCODER_LAG)

SENSOR_LAG, SENSOR_DELAY, LAG_AND_DELAY = "sensor_lag", "sensor_delay", "sensor_lag_and_delay"
# Faults that are one shape of `LAG_AND_DELAY`, first order plus dead time, and the share [1] of the delay there
DELAY_SHARES = {SENSOR_LAG: 0.0, SENSOR_DELAY: 1.0}


def _late(reading: Reading) -> tuple[float, float, float]:
    """Step and bounds [s] of a time by which a sensor is late."""
    return DETECTABLE_SHARE / reading.turning, 0.0, 1.0 / reading.turning


def _families_of(fault: SensorFault, site: str, late: Parameter) -> tuple[LawFamily]:
    """The family of a fault that makes the sensor at a `site` late, as `late` says; the law has its bounds."""
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
            "a zero of the encoder that is another one in each run",
            bounds=lambda reading: (2e-3, -math.pi, math.pi),
            law="y = u + zero_rad, with its own value in each run",
            of_each_run=True,
        ),
        SensorFault(
            ENCODER_LAG,
            "lag_s",
            "s",
            "a delay of the encoder against the other sensors",
            bounds=lambda reading: (DETECTABLE_SHARE / reading.turning, -1.0 / reading.turning, 1.0 / reading.turning),
            law="y(t) = u(t - lag_s), a pure delay against all other channels; negative: these are late by the same "
            "time. A candidate with drive measured_angle; at constant speed it is an offset of the encoder",
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
            law="lag_s dy/dt + y = u, first order, as of a filter or a slow transducer: a fast change comes late and "
            "smaller",
            over_time=lambda values, interval, lag: lagged(values, interval, lag) if lag else values,
            undone=lambda values, lag, times: values + lag * np.gradient(values, times),
        ),
        SensorFault(
            SENSOR_DELAY,
            "delay_s",
            "s",
            "a delay of the sensor of {site}",
            bounds=_late,
            law="y(t) = u(t - delay_s), a pure delay, as of a logger, a bus or USB: all comes late and nothing smaller",
            delays=True,
            undone=lambda values, delay, times: np.interp(times + delay, times, values),
        ),
        SensorFault(
            LAG_AND_DELAY,
            "late_s",
            "s",
            "a lag or a delay of the sensor of {site}",
            bounds=_late,
            law="a delay of delay_share late_s and a lag of the rest, the family of the two: no candidate by itself",
        ),
    )
}
"""Every fault by its name, in the order in which a fit tries them."""


def sensor_candidates(
    spreads: Values, encoder: Sequence[str], turning: float, listed: Collection[str], runs: Sequence[str], told=None
) -> list[Candidate]:
    """Faults that the sensors could have: those named of the `encoder`, which other channels may say to be off by
    `told` [rad], and those of channels, whose readings vary by `spreads`.
    """
    found = []
    for name in encoder:
        parameter = FAULTS[name].parameter
        replaces = {name: parameter} if name in listed else {}
        candidate = FAULTS[name].candidate("sensor", Reading(0.0, "rad", turning), replaces, runs)
        if told and name == ENCODER_OFFSET:
            candidate = replace(candidate, initial_guesses=({}, {parameter: told}))
        found.append(candidate)
    return found + [
        fault.candidate(channel, Reading(spread, CHANNELS[channel], turning))
        for channel, spread in spreads.items()
        for fault in FAULTS.values()
        if fault.name not in (*ENCODER_FAULTS, LAG_AND_DELAY) and (fault.steady or spread > 0.0)
    ]


class Faults:
    """The faults of sensors among effects, by channel."""

    NUISANCES = ("encoder_zero", "encoder_lag", "slider_position_zero")
    """Names of the nuisances that are faults of sensors."""

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
        """Whether any sensor errs."""
        return bool(self.offset or self.lag or self._faults)

    def taken_out(self, recording: Recording) -> Recording:
        """The `recording` of a run as its sensors would have read without the faults."""
        angle = recording.crank_angle - self.offset
        if self.lag and recording.has_time:
            angle = angle + self.lag * np.gradient(recording.crank_angle, recording.time)
        channels = dict(recording.channels)
        # the last one to act is the first to be undone
        for when in ("after_filter", "delays", "over_time", "before_filter"):
            for fault, site, value in self._faults:
                if getattr(fault, when) and fault.undone is not None and site in channels:
                    channels[site] = fault.undone(channels[site], value, recording.time)
        return replace(recording, crank_angle=angle, channels=channels)

    def delay(self, channel: str) -> float:
        """By how much [s] a channel reads later what is true."""
        return sum(value for fault, site, value in self._faults if fault.delays and site == channel)

    def need_grid(self, channel: str) -> bool:
        """Whether readings of a channel have to be known in between."""
        return any(value for fault, site, value in self._faults if fault.over_time and site == channel)

    def act(self, when: str, channel: str, values: np.ndarray, *interval: float) -> np.ndarray:
        """Readings (n,) [unit] of a `channel` with the faults that act before or after its low-pass, or over time."""
        for fault, site, value in self._faults:
            if site == channel and (function := getattr(fault, when)) is not None:
                values = function(values, *interval, value)
        return values
