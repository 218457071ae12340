"""Whether channels can be what they are said to be: clipped ones, outliers, and ones that contradict others."""

import math
from math import tau

import numpy as np

from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.config.channels import CHANNELS
from jointgap.mechanism.linkage import linkage_motion
from jointgap.mechanism.motion import Motion
from jointgap.quantities import unit_factor
from jointgap.recordings.limits import DEFAULT_LIMITS, RecordingLimits
from jointgap.recordings.recording import Recording

RATES = (
    ("slider_position", "slider_velocity"),
    ("slider_velocity", "slider_acceleration"),
    ("rod_angle", "rod_angular_velocity"),
    ("crank_angle", "crank_speed"),
)
"""Channels of which the second is the rate of the first."""

UNITS = {
    "m": ("m", "mm", "cm", "um", "inch"),
    "m/s": ("m/s", "mm/s", "km/h"),
    "m/s^2": ("m/s^2", "g_n", "mm/s^2"),
    "rad": ("rad", "deg", "turn"),
    "rad/s": ("rad/s", "deg/s", "rpm", "turn/s"),
}
"""Units, by the SI unit, that are proposed where the stated one does not fit."""


def clipped(values: np.ndarray, limits: RecordingLimits = DEFAULT_LIMITS) -> str | None:
    """What is wrong with a channel many of whose samples stand at its largest or smallest value; None if nothing is.

    Parameters
    ----------
    values : (n,) array
        [SI]; NaN in gaps.
    limits : RecordingLimits
    """
    levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
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


def inconsistent(
    campaign: Campaign,
    run: CampaignRun,
    recording: Recording,
    turned: np.ndarray,
    limits: RecordingLimits = DEFAULT_LIMITS,
) -> list[str]:
    """What channels contradict each other, or the mechanism's geometry, in sentences.

    Parameters
    ----------
    campaign : Campaign
    run : CampaignRun
    recording : Recording
    turned : (n,) array
        Angle since the first sample [rad].
    limits : RecordingLimits
    """
    doubts = []
    channels = recording.all_channels
    time = recording.time if recording.has_time else turned / run.speed
    for channel, rate in RATES:
        if channel in channels and rate in channels and not _misses_spikes(campaign, rate, channels[rate], limits):
            change, integral = _changes(time, turned, channels[channel], channels[rate])
            doubts.append(_doubt(campaign, rate, f"the rate of {channel}", change, integral, limits))
    if recording.has_angle:
        ideal = _ideal(campaign, run, recording)
        for name in sorted(channels.keys() & ideal.keys()):
            finite = np.isfinite(channels[name]) & np.isfinite(ideal[name])
            reference, values = ideal[name][finite], channels[name][finite]
            doubts.append(_doubt(campaign, name, "what the mechanism makes of crank_angle", reference, values, limits))
    return [doubt for doubt in doubts if doubt]


def _misses_spikes(campaign: Campaign, name: str, values: np.ndarray, limits: RecordingLimits) -> bool:
    """Whether a channel has spikes, as impacts make them, that a sum over its samples may miss."""
    finite = values[np.isfinite(values)]
    away = finite - finite.mean()
    kurtosis = float(np.mean(away**4) / np.mean(away**2) ** 2)
    return campaign.channels[name].bandwidth is None and kurtosis > limits.max_kurtosis


def _changes(
    time: np.ndarray, turned: np.ndarray, channel: np.ndarray, rate: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Changes of `channel` over quarter turns, and the integrals of `rate` over them."""
    finite = np.isfinite(channel) & np.isfinite(rate)
    turned = np.maximum.accumulate(turned)  # angles without times may step back by noise
    time, turned, channel, rate = (values[finite] for values in (time, turned, channel, rate))
    integral = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)))
    later = np.searchsorted(turned, turned + tau / 4)
    here = np.flatnonzero(later < turned.size)
    later = later[here]
    # a quarter turn with a gap in it says nothing
    here, later = (places[turned[later] - turned[here] < tau / 3] for places in (here, later))
    return channel[later] - channel[here], integral[later] - integral[here]


def _doubt(
    campaign: Campaign, name: str, reference: str, expected: np.ndarray, values: np.ndarray, limits: RecordingLimits
) -> str | None:
    """What is wrong with `values` that should be `expected` but for a constant; None if nothing is known to be."""
    if expected.size < 8:
        return None
    if name != "crank_speed":  # of a steady rotation nothing is left beside the mean
        expected, values = expected - expected.mean(), values - values.mean()
    product = math.sqrt(float(expected @ expected) * float(values @ values))
    if not product > 0.0:
        return None
    correlation = float(expected @ values) / product
    factor = float(values @ values) / product
    if correlation < -limits.comparable_correlation:
        return f"{name} has the opposite sign of {reference}; check the sensor's direction"
    if correlation < limits.unrelated_correlation:
        return f"{name} is not {reference} (correlation {correlation:.2f}); check the columns, or the sensor"
    if correlation < limits.comparable_correlation or limits.gains[0] < factor < limits.gains[1]:
        return None
    unit, own = campaign.channels[name].unit, campaign.factor(name)
    doubt = f"{name} is {factor:.4g} times {reference}; check the units of both"
    for other in UNITS[CHANNELS[name]]:
        if abs(factor * unit_factor(other, CHANNELS[name]) / own - 1.0) < limits.unit_tolerance:
            return f"{doubt}: did you mean '{other}' by channels.{name}.unit = '{unit}'?"
    return doubt


def _ideal(campaign: Campaign, run: CampaignRun, recording: Recording) -> dict[str, np.ndarray]:
    """Position and angle channels of the mechanism without clearance at the measured crank angles; NaN in gaps."""
    sign = -1.0 if run.direction == "clockwise" else 1.0  # angles of the file are the mirror image of the recording's
    angle = sign * recording.crank_angle
    motion = linkage_motion(
        campaign.mechanism, Motion.of(angle, np.full(angle.shape, sign * run.speed), np.zeros(angle.shape))
    )
    return {
        "slider_position": motion.slider_x.position,
        "slider_velocity": motion.slider_x.velocity,
        "rod_angle": motion.rod_angle.position,
        "rod_angular_velocity": motion.rod_angle.velocity,
    }
