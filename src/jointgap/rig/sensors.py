"""Sensors and their faults."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.linalg.blas import dtbsv

from jointgap.config.campaign import FILTER_ORDER, POSITION_ZERO, Campaign, Channel
from jointgap.core.candidates import Candidate, LawFamily, Parameter
from jointgap.core.errors import MEANINGS
from jointgap.effects.base import DETECTABLE_SHARE, Values, amplitude, size_and_angle
from jointgap.rig.drives import SETTLING_REVOLUTIONS
from jointgap.rig.recording import Recording

# Samples per period of a low-pass filter's corner frequency: frequency warping is then above the
# corner
SAMPLES_PER_CORNER_PERIOD = 10.0
SAMPLES_PER_REVOLUTION = 720  # Least grid for filters and lags
PADDING_REVOLUTIONS = 0.25  # Before and after the samples, for transients of filters and lags

STANDARD_GRAVITY = 9.80665  # [m/s^2]


def at_sensor(campaign: Campaign, side: float, channel: str, values: np.ndarray) -> np.ndarray:
    """What acts on the sensor of a `channel` with the `values` of a simulated motion, which is
    mirrored on the `side` -1: signs of the file, and gravity of an accelerometer that reads it."""
    kind = campaign.channel_kinds[channel]
    if kind.mirrored:
        values = side * values
    if campaign.channels[channel].reads_gravity:
        x, y = {"x": (1.0, 0.0), "y": (0.0, 1.0)}.get(kind.axis) or _along(campaign, kind.part)
        down = campaign.mechanism.gravity_direction
        values = values - STANDARD_GRAVITY * (x * math.cos(down) + y * math.sin(down))
    return values


def _along(campaign: Campaign, body: str) -> tuple[float, float]:
    """Direction of the slide of a `body`."""
    mechanism = campaign.mechanism
    direction = mechanism.slide_direction(mechanism.sites.slides[body])
    return math.cos(direction), math.sin(direction)


def remembered_time(channels: Iterable[Channel], revolution: float) -> float:
    """Time [s] before the samples that filters and lags need for their transients."""
    longest = max((channel.average for channel in channels if channel.average), default=0.0)
    return max(PADDING_REVOLUTIONS * revolution, min(longest, SETTLING_REVOLUTIONS * revolution))


def filter_times(
    begin: float, end: float, revolution: float, corners: Iterable[float]
) -> np.ndarray:
    """Uniform times [s] from `first` to `last` for filters and lags."""
    corner_steps = [1.0 / (SAMPLES_PER_CORNER_PERIOD * corner) for corner in corners]
    interval = min([revolution / SAMPLES_PER_REVOLUTION, *corner_steps])
    return np.linspace(begin, end, math.ceil((end - begin) / interval) + 1)


def low_pass(values: np.ndarray, interval: float, corner: float, causal: bool) -> np.ndarray:
    """Fourth-order Butterworth low-pass, forward and backward (no delay) unless causal."""
    from scipy.signal import butter, sosfilt, sosfiltfilt  # slow to load

    sections = butter(FILTER_ORDER, corner, fs=1.0 / interval, output="sos")
    level = values[0]  # avoids a transient of the mean
    filtered = sosfilt if causal else sosfiltfilt
    return level + filtered(sections, values - level)


def lagged(values: np.ndarray, interval: float, lag: float) -> np.ndarray:
    """First-order lag, lag y' + y = u, exact for linear interpolation between samples."""
    share = interval / lag
    decay = math.exp(-share)
    mean_decay = -math.expm1(-share) / share  # mean of exp(-s) over an interval
    # y_n = decay y_(n-1) + (1 - mean_decay) u_n + (mean_decay - decay) u_(n-1)
    change = values - values[0]
    driven = (1.0 - mean_decay) * change
    driven[1:] += (mean_decay - decay) * change[:-1]
    band = np.ones((2, change.size))
    band[1] = -decay
    return values[0] + dtbsv(1, band, driven, lower=1, diag=1)


def high_passed(values: np.ndarray, interval: float, cycle: float, corner: float) -> np.ndarray:
    """First-order high-pass of `corner` [Hz]: the values without their lag.

    The filter is in the periodic steady state of a motion that repeats after `cycle` [s]; 0: it
    starts at rest.
    """
    lag = 1.0 / (math.tau * corner)
    times = interval * np.arange(values.size)
    slow = lagged(values, interval, lag)
    if cycle:
        change = (np.interp(cycle, times, slow) - values[0]) / -math.expm1(-cycle / lag)
        slow += change * np.exp(-times / lag)
    return values - slow


def averaged(values: np.ndarray, interval: float, cycle: float, time: float) -> np.ndarray:
    """Mean over the last `time` [s], such as of a counter's gate.

    Values before the first one repeat with the `cycle` [s] of the motion; 0: all are equal to the
    first one.
    """
    times = interval * np.arange(values.size)
    integral = CubicSpline(times, values).antiderivative()
    begin = times - time
    early = np.minimum(begin, 0.0)
    back = np.floor(early / cycle) if cycle else 0.0
    earlier = back * integral(cycle) if cycle else values[0] * early
    return (
        integral(times) - integral(begin - back * cycle if cycle else begin - early) - earlier
    ) / time


class Reading(NamedTuple):
    """Properties of a channel's reading that set the steps of a fit."""

    spread: float  # Standard deviation in `unit`
    unit: str
    turning: float  # Crank speed [rad/s]
    torque: float = 1.0  # Typical torque on the crank [N m]


@dataclass(frozen=True)
class SensorFault:
    """A sensor fault with one parameter, one for each run, or an amplitude with a phase."""

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
    over_time: Callable[[np.ndarray, float, float, float], np.ndarray] | None = None
    # [1, of one per revolution] Start values where readings do not depend on it linearly from 0 on
    guesses: tuple[float, ...] = ()
    regress_with: str = ""  # Fault of the same channel as of `Candidate.regress_with`
    delays: bool = False  # Whether its parameter [s] is a pure delay
    undone: Callable[[np.ndarray, float, np.ndarray], np.ndarray] | None = None
    # Error [rad] of the encoder, from the true crank angle (n,) [rad], the torque on the crank (n,)
    # [N m] and the values of the fit's coordinates
    encoder: Callable[[np.ndarray, np.ndarray, Values], np.ndarray | float] | None = None
    phase: str = (
        ""  # Parameter that is the phase [rad] of `parameter`; a fit varies ``cosine`` and ``sine``
    )
    inverse: str = ""  # What a fit varies in place of `parameter`: its inverse, 0 without the fault

    @property
    def parameters(self) -> dict[str, str]:
        """Units of the stated parameters; empty for that of the channel."""
        return {self.parameter: self.unit} | ({self.phase: "rad"} if self.phase else {})

    def stated(self, values: Values) -> dict[str, float]:
        """Parameters for the verdict, from the values of a fit's coordinates."""
        if self.phase:
            return size_and_angle(values, self.parameter, self.phase)
        if self.inverse:
            return {self.parameter: 1.0 / max(values[self.inverse], 1e-300)}
        return dict(values)

    def candidate(
        self,
        site: str,
        reading: Reading,
        replaces: Mapping[str, str] | None = None,
        runs: Sequence[str] = (),
    ) -> Candidate:
        """The candidate at a `site` (channel or encoder); `replaces` as in `Candidate`; `runs` of
        the campaign."""
        step, low, high = self.bounds(reading)
        unit = f"1/({self.unit})" if self.inverse else self.unit or reading.unit
        names = ("cosine", "sine") if self.phase else (self.inverse or self.parameter,)
        coordinates = tuple(amplitude(name, step, unit, low, high) for name in names)
        parameter = coordinates[0]
        if self.of_each_run:
            coordinates = tuple(replace(parameter, run=run) for run in runs)
        keys = tuple(coordinate.key for coordinate in coordinates)
        has_site = self.name not in ENCODER_FAULTS
        families = _families_of(self, site, parameter) if self.name in DELAY_SHARES else ()
        guesses = tuple(
            {parameter.key: share * reading.turning / math.tau} for share in self.guesses
        ) or ({},)
        return Candidate(
            self.name,
            site,
            coordinates,
            keys,
            guesses,
            self.stated,
            sensor=True,
            replaces=replaces or {},
            has_site=has_site,
            families=families,
            regress_with=f"{self.regress_with}:{site}" if self.regress_with else "",
        )


ENCODER_OFFSET, ENCODER_LAG, ENCODER_ZEROS = "encoder_offset", "encoder_lag", "encoder_zeros"
ENCODER_ECCENTRICITY = "encoder_eccentricity"
# Faults of the encoder that follow the torque on the crank
ENCODER_COUPLING = ENCODER_WINDUP, ENCODER_BACKLASH = "encoder_windup", "encoder_backlash"
# Faults of the encoder, without a choice of channel
ENCODER_FAULTS = (
    ENCODER_OFFSET,
    ENCODER_ZEROS,
    ENCODER_LAG,
    *ENCODER_COUPLING,
    ENCODER_ECCENTRICITY,
)

# [1, of its standard deviation] Torque within which a loose coupling changes sides: less than
# between two samples
SIDES_CHANGE = 1e-3
# Of the fixed point for the true angle; each leaves the slope of the encoder's error, < 0.1
TRUE_ANGLE_PASSES = 3

SENSOR_LAG, SENSOR_DELAY, LAG_AND_DELAY = "sensor_lag", "sensor_delay", "sensor_lag_and_delay"
# Members of the family `LAG_AND_DELAY` (first order plus dead time), and their share [1] of the
# delay
DELAY_SHARES = {SENSOR_LAG: 0.0, SENSOR_DELAY: 1.0}


def _side(torque: np.ndarray) -> np.ndarray:
    """Sign (n,) of a torque (n,), smooth at zero."""
    return np.tanh(torque / max(SIDES_CHANGE * np.nanstd(torque), 1e-300))


def _late(reading: Reading) -> tuple[float, float, float]:
    """Step and bounds [s] of a lag or delay."""
    return DETECTABLE_SHARE / reading.turning, 0.0, 1.0 / reading.turning


def _families_of(fault: SensorFault, site: str, late: Parameter) -> tuple[LawFamily]:
    """The family of the lag or delay `late` of the sensor at a `site`."""
    delay_share = DELAY_SHARES[fault.name]
    name = FAULTS[LAG_AND_DELAY].parameter
    coordinates = replace(late, name=name), Parameter("delay_share", delay_share, 0.0, 1.0, 0.1)
    law = Candidate(LAG_AND_DELAY, site, coordinates, (name,), sensor=True, has_site=True)
    shares = tuple(DELAY_SHARES.values())
    member = "delay_share", delay_share, shares
    return (LawFamily(law, *member, lambda values: {name: values[late.key]}),)


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
            encoder=lambda angle, torque, values: values["offset_rad"],
        ),
        SensorFault(
            ENCODER_ZEROS,
            "zero_rad",
            "rad",
            "an encoder zero that differs between runs",
            bounds=lambda reading: (2e-3, -math.pi, math.pi),
            law="y = u + zero_rad, with its own value in each run",
            of_each_run=True,
            encoder=lambda angle, torque, values: values["zero_rad"],
        ),
        SensorFault(
            ENCODER_LAG,
            "lag_s",
            "s",
            "a delay of the encoder relative to the other sensors",
            bounds=lambda reading: tuple(
                share / reading.turning for share in (DETECTABLE_SHARE, -1.0, 1.0)
            ),
            law=(
                "y(t) = u(t - lag_s), a pure delay relative to all other channels; negative: these"
                " are late. Only with drive measured_angle; at constant speed it is equivalent to"
                " an encoder offset"
            ),
        ),
        SensorFault(
            ENCODER_WINDUP,
            "stiffness_N_m_rad",
            "N*m/rad",
            "a wind-up of the encoder's coupling",
            bounds=lambda reading: (2e-3 / reading.torque, 0.0, 0.5 / reading.torque),
            law=(
                "y = u + M / stiffness_N_m_rad, with the driving torque M on the crank. Not with"
                " drive measured_angle, nor where the motion is chaotic"
            ),
            encoder=lambda angle, torque, values: values["compliance_rad_N_m"] * torque,
            inverse="compliance_rad_N_m",
        ),
        SensorFault(
            ENCODER_BACKLASH,
            "play_rad",
            "rad",
            "a play of the encoder's coupling",
            bounds=lambda reading: (2e-3, 0.0, 0.5),
            law=(
                "y = u + play_rad / 2 sgn M, with the driving torque M on the crank, sgn M ="
                f" tanh(M / ({SIDES_CHANGE:g} of its standard deviation)). Not with drive"
                " measured_angle, which would jump, nor where the motion is chaotic"
            ),
            encoder=lambda angle, torque, values: 0.5 * values["play_rad"] * _side(torque),
        ),
        SensorFault(
            ENCODER_ECCENTRICITY,
            "amplitude_rad",
            "rad",
            "an eccentricity of the encoder's disc",
            bounds=lambda reading: (2e-3, -0.1, 0.1),
            law=(
                "y = u + amplitude_rad cos(u - phase_rad): reads most too much at the crank angle"
                " phase_rad"
            ),
            encoder=lambda angle, torque, values: (
                values["cosine"] * np.cos(angle) + values["sine"] * np.sin(angle)
            ),
            phase="phase_rad",
        ),
        SensorFault(
            "sensor_bias",
            "bias",
            "",
            "a bias of the sensor of {site}",
            law="y = u + bias",
            bounds=lambda reading: (
                DETECTABLE_SHARE * (reading.spread or 1.0),
                -math.inf,
                math.inf,
            ),
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
            law=(
                "lag_s dy/dt + y = u, first order, such as of a filter: fast changes are delayed"
                " and attenuated"
            ),
            over_time=lambda values, interval, cycle, lag: (
                lagged(values, interval, lag) if lag else values
            ),
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
            "sensor_high_pass",
            "corner_Hz",
            "Hz",
            "a high-pass of the sensor of {site}",
            bounds=lambda reading: tuple(
                share * reading.turning / math.tau for share in (DETECTABLE_SHARE, 0.0, 2.0)
            ),
            law=(
                "dy/dt + 2 pi corner_Hz y = du/dt, first order, such as of an AC-coupled sensor:"
                " the mean is removed"
            ),
            over_time=lambda values, interval, cycle, corner: (
                high_passed(values, interval, cycle, corner) if corner else values
            ),
            undone=lambda values, corner, times: (
                values
                + math.tau
                * corner
                * cumulative_trapezoid(values - np.mean(values), times, initial=0.0)
            ),
            guesses=(0.03, 0.12),
            regress_with="sensor_bias",
        ),
        SensorFault(
            LAG_AND_DELAY,
            "late_s",
            "s",
            "a lag or a delay of the sensor of {site}",
            bounds=_late,
            law=(
                "a delay of delay_share late_s and a lag of (1 - delay_share) late_s: the family of"
                " both, not a candidate itself"
            ),
        ),
    )
}
"""Every fault by its name, in the order in which a fit tries them."""

MEANINGS.update((name, f"{fault.words} {fault.law}") for name, fault in FAULTS.items())


def sensor_candidates(
    spreads: Values,
    encoder: Sequence[str],
    turning: float,
    torque: float,
    listed: Collection[str],
    runs: Sequence[str],
    units: Mapping[str, str],
    offset=None,
) -> list[Candidate]:
    """Possible sensor faults: those of the `encoder` (`offset` [rad]: start value) and those of
    channels whose readings have the standard deviations `spreads` and the `units`.
    """
    candidates = []
    for name in encoder:
        parameter = FAULTS[name].parameter
        replaces = {name: parameter} if name in listed else {}
        candidate = FAULTS[name].candidate(
            "sensor", Reading(0.0, "rad", turning, torque), replaces, runs
        )
        if offset and name == ENCODER_OFFSET:
            candidate = replace(candidate, initial_guesses=({}, {parameter: offset}))
        candidates.append(candidate)
    readings = {
        channel: Reading(spread, units[channel], turning) for channel, spread in spreads.items()
    }
    return candidates + channel_faults(readings)


def channel_faults(readings: Mapping[str, Reading]) -> list[Candidate]:
    """Possible faults of the sensors of channels, from their `readings`."""
    return [
        fault.candidate(channel, reading)
        for channel, reading in readings.items()
        for fault in FAULTS.values()
        if fault.name not in (*ENCODER_FAULTS, LAG_AND_DELAY)
        and (fault.steady or reading.spread > 0.0)
    ]


class Faults:
    """The sensor faults among effects and nuisances."""

    @staticmethod
    def has(nuisance: str) -> bool:
        """Whether a nuisance is a sensor fault."""
        others = ("encoder_zero", "encoder_lag", "clock_offset")
        return nuisance in others or nuisance.endswith(POSITION_ZERO)

    def __init__(
        self,
        effects: Iterable[tuple[Candidate, Values]],
        side: float,
        nuisances: Mapping[str, float],
        second_clock: Iterable[str] = (),
    ):
        self._side, self.lag = side, nuisances.get("encoder_lag", 0.0)
        self._encoder: list[tuple[SensorFault, Values]] = []
        if zero := nuisances.get("encoder_zero", 0.0):
            self._encoder.append((FAULTS[ENCODER_OFFSET], {"offset_rad": zero}))
        offset = nuisances.get("clock_offset", 0.0)
        self._faults = [
            (FAULTS[SENSOR_DELAY], channel, offset) for channel in second_clock if offset
        ]
        for name, value in nuisances.items():
            if name.endswith(POSITION_ZERO) and value:
                channel = name.removesuffix("_zero")
                self._faults.append((FAULTS["sensor_bias"], channel, value))
        for candidate, values in effects:
            name, site = candidate.name, candidate.site
            if name == ENCODER_LAG:
                self.lag += values["lag_s"]
            elif name in ENCODER_FAULTS:
                self._encoder.append((FAULTS[name], values))
            elif name == LAG_AND_DELAY:
                late = values[FAULTS[name].parameter]
                share = values["delay_share"]
                parts = {SENSOR_LAG: (1.0 - share) * late, SENSOR_DELAY: share * late}
                self._faults += [(FAULTS[part], site, value) for part, value in parts.items()]
            elif candidate.sensor:
                self._faults.append((FAULTS[name], site, values[candidate.amplitudes[0]]))

    def __bool__(self) -> bool:
        return bool(self._encoder or self.lag or self._faults)

    @property
    def follow_torque(self) -> bool:
        """Whether the encoder's error follows the torque on the crank."""
        return any(fault.name in ENCODER_COUPLING for fault, _ in self._encoder)

    def of_encoder(self, angle: np.ndarray, torque: np.ndarray | float = 0.0) -> np.ndarray | float:
        """Error (n,) [rad] of the encoder at true crank angles (n,) [rad] and torques (n,) [N m],
        both mirrored as simulated; a number if it is constant.
        """
        side = self._side
        return side * sum(
            fault.encoder(side * angle, side * torque, values) for fault, values in self._encoder
        )

    def of_reading(self, read: np.ndarray, torque: np.ndarray | float = 0.0) -> np.ndarray | float:
        """`of_encoder` at the angles (n,) [rad] that the encoder reads."""
        error = 0.0
        for _ in range(TRUE_ANGLE_PASSES):
            error = self.of_encoder(read - error, torque)
        return error

    def corrected(self, recording: Recording) -> Recording:
        """The `recording` corrected for the faults."""
        channels = dict(recording.channels)
        for site in channels:
            is_read = np.isfinite(channels[site])
            readings = self.undo(site, channels[site][is_read], recording.time[is_read])
            channels[site] = channels[site].copy()
            channels[site][is_read] = readings
        # without a measured torque the encoder's coupling is left as it is
        torque = np.nan_to_num(
            self._side * channels.get("crank_torque", np.zeros(recording.time.size))
        )
        angle = recording.crank_angle - self.of_reading(recording.crank_angle, torque)
        if self.lag and recording.has_time:
            angle = angle + self.lag * np.gradient(recording.crank_angle, recording.time)
        return replace(recording, crank_angle=angle, channels=channels)

    def undo(self, channel: str, readings: np.ndarray, times: np.ndarray) -> np.ndarray:
        """The `readings` (n,) of a `channel` at `times` (n,) [s] without its faults."""
        # in reverse order of action
        for when in ("after_filter", "delays", "over_time", "before_filter"):
            for fault, site, value in self._faults:
                if site == channel and getattr(fault, when) and fault.undone is not None:
                    readings = fault.undone(readings, value, times)
        return readings

    def delay(self, channel: str) -> float:
        """Pure delay [s] of a channel."""
        return sum(value for fault, site, value in self._faults if fault.delays and site == channel)

    def need_grid(self, channel: str) -> bool:
        """Whether a channel has a fault over time, which requires a dense grid."""
        return any(
            value for fault, site, value in self._faults if fault.over_time and site == channel
        )

    def act(self, when: str, channel: str, values: np.ndarray, *times: float) -> np.ndarray:
        """Readings (n,) of a `channel` with the faults of kind `when` (a field of `SensorFault`).

        `times` of faults over time: the interval of the values and the period of the motion, as of
        `high_passed` [s].
        """
        for fault, site, value in self._faults:
            if site == channel and (function := getattr(fault, when)) is not None:
                values = function(values, *times, value)
        return values
