"""Whether channels can be what they are said to be: clipped ones, and ones that contradict others."""

import math

import numpy as np

from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.config.channels import CHANNELS
from jointgap.mechanism.linkage import linkage_motion
from jointgap.mechanism.motion import Motion
from jointgap.quantities import unit_factor
from jointgap.recordings.encoder_angle import TURN
from jointgap.recordings.recording import Recording

CLIPPED_SHARE, CLIPPED_COUNT = 0.01, 5
CLIPPED_EXCESS = 6.0
"""How many times as often as the next value an extreme one occurs where it is clipped; a sine's rounded crest has 1.4."""

RATES = (
    ("slider_position", "slider_velocity"),
    ("slider_velocity", "slider_acceleration"),
    ("rod_angle", "rod_angular_velocity"),
    ("crank_angle", "crank_speed"),
)
"""Channels of which the second is the rate of the first."""

ALIKE = 0.9  # correlation from which on a factor between two channels means something
GAINS = (0.8, 1.25)  # factors that a sensor's gain may have; the analysis names these
NEAR = 0.05  # so near must a ratio of units come to be proposed
UNRELATED = 0.5
OUTLIER = 300.0
"""Interquartile ranges from the median beyond which a value is doubted; impacts come some ten times less far."""

ANGLE_OUTLIER = 0.1  # [rad] by which a crank angle may miss the line between its neighbours
SPIKY = 10.0  # kurtosis from which on samples say little of what was between them
UNITS = {
    "m": ("m", "mm", "cm", "um", "inch"),
    "m/s": ("m/s", "mm/s", "km/h"),
    "m/s^2": ("m/s^2", "g_n", "mm/s^2"),
    "rad": ("rad", "deg", "turn"),
    "rad/s": ("rad/s", "deg/s", "rpm", "turn/s"),
}


def clipped(values: np.ndarray) -> str | None:
    """What is wrong with a channel many of whose samples stand at its largest or smallest value; None if nothing is.

    Parameters
    ----------
    values : (n,) array
        NaN in gaps.
    """
    levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    for level, count, beside in ((levels[-1], counts[-1], counts[-2]), (levels[0], counts[0], counts[1])):
        if count >= max(CLIPPED_COUNT, CLIPPED_SHARE * counts.sum(), CLIPPED_EXCESS * beside):
            return (
                f"is clipped: {count} of {counts.sum()} samples are {level:.6g} in SI units, an extreme; "
                "what lies beyond was not measured, so leave these cells empty"
            )
    return None


def outliers(values: np.ndarray) -> np.ndarray:
    """Places of values so far from all others that they may stand for something else, such as 'no data'.

    Parameters
    ----------
    values : (n,) array
        NaN in gaps.
    """
    low, median, high = np.nanpercentile(values, (25.0, 50.0, 75.0))
    with np.errstate(invalid="ignore"):
        return (
            np.flatnonzero(np.abs(values - median) > OUTLIER * (high - low)) if high > low else np.empty(0, dtype=int)
        )


def angle_outliers(time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Places of crank angles far off the line between their neighbours, and farther than the scatter of all others.

    Parameters
    ----------
    time, angle : (n,) array
        [s]; [rad], running on, NaN in gaps.
    """
    known = np.flatnonzero(np.isfinite(angle))
    before, here, after = known[:-2], known[1:-1], known[2:]
    share = (time[here] - time[before]) / (time[after] - time[before])
    away = np.abs(angle[here] - (1.0 - share) * angle[before] - share * angle[after])
    return here[away > max(ANGLE_OUTLIER, 15.0 * float(np.median(away)))] if here.size else here


def inconsistent(campaign: Campaign, run: CampaignRun, recording: Recording, turned: np.ndarray) -> list[str]:
    """What channels contradict each other, or the mechanism's geometry, in sentences.

    Parameters
    ----------
    campaign : Campaign
    run : CampaignRun
    recording : Recording
    turned : (n,) array
        Angle since the first sample [rad].
    """
    remarks = []
    channels = recording.channels | ({"crank_angle": recording.crank_angle} if recording.has_angle else {})
    time = recording.time if recording.has_time else turned / run.speed
    for whole, rate in RATES:
        if whole in channels and rate in channels and not _misses_spikes(campaign, rate, channels[rate]):
            change, integral = _changes(time, turned, channels[whole], channels[rate])
            doubt = _doubt(rate, f"the rate of {whole}", change, integral, campaign)
            if doubt:
                remarks.append(doubt)
    if recording.has_angle:
        ideal = _ideal(campaign, run, recording)
        for name in sorted(channels.keys() & ideal.keys()):
            known = np.isfinite(channels[name]) & np.isfinite(ideal[name])
            doubt = _doubt(
                name, "what the mechanism makes of crank_angle", ideal[name][known], channels[name][known], campaign
            )
            if doubt:
                remarks.append(doubt)
    return remarks


def _misses_spikes(campaign: Campaign, name: str, values: np.ndarray) -> bool:
    """Whether a channel has spikes, as impacts make them, that a sum over its samples may miss."""
    known = values[np.isfinite(values)]
    away = known - known.mean()
    return campaign.channels[name].bandwidth is None and float(np.mean(away**4) / np.mean(away**2) ** 2) > SPIKY


def _changes(
    time: np.ndarray, turned: np.ndarray, whole: np.ndarray, rate: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Changes of `whole` over quarter turns, and what `rate` sums up to over them, each without its mean."""
    known = np.isfinite(whole) & np.isfinite(rate)
    turned = np.maximum.accumulate(turned)  # angles without times may step back by noise
    time, turned, whole, rate = (values[known] for values in (time, turned, whole, rate))
    sums = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)))
    later = np.searchsorted(turned, turned + TURN / 4)
    here = np.flatnonzero(later < turned.size)
    later = later[here]
    # a quarter turn with a gap in it says nothing
    here, later = (places[turned[later] - turned[here] < TURN / 3] for places in (here, later))
    return whole[later] - whole[here], sums[later] - sums[here]


def _doubt(name: str, reference: str, expected: np.ndarray, found: np.ndarray, campaign: Campaign) -> str | None:
    """What is wrong with a channel that should be about `expected` but for a constant; None if nothing is, or nobody can tell."""
    if expected.size < 8:
        return None
    if name != "crank_speed":  # of a steady rotation nothing is left beside the mean
        expected, found = expected - expected.mean(), found - found.mean()
    product = math.sqrt(float(expected @ expected) * float(found @ found))
    if not product > 0.0:
        return None
    alike = float(expected @ found) / product
    factor = float(found @ found) / product
    if alike < -ALIKE:
        return f"{name} has the opposite sign of {reference}; check the sensor's direction"
    if alike < UNRELATED:
        return f"{name} is not {reference} (correlation {alike:.2f}); check the columns, or the sensor"
    if alike < ALIKE or GAINS[0] < factor < GAINS[1]:
        return None
    unit = campaign.channels[name].unit
    own = campaign.factor(name)
    for other in UNITS[CHANNELS[name]]:
        if abs(factor * unit_factor(other, CHANNELS[name]) / own - 1.0) < NEAR:
            return (
                f"{name} is {factor:.4g} times {reference}; check the units of both: did you mean '{other}' by "
                f"channels.{name}.unit = '{unit}'?"
            )
    return f"{name} is {factor:.4g} times {reference}; check the units of both"


def _ideal(campaign: Campaign, run: CampaignRun, recording: Recording) -> dict[str, np.ndarray]:
    """Position and angle channels of the mechanism without clearance at the measured crank angles."""
    known = np.isfinite(recording.crank_angle)
    sign = -1.0 if run.direction == "clockwise" else 1.0  # angles of the file are the mirror image of the recording's
    angle = sign * recording.crank_angle[known]
    motion = linkage_motion(
        campaign.mechanism, Motion.of(angle, np.full(angle.shape, sign * run.speed), np.zeros(angle.shape))
    )
    found = {
        "slider_position": motion.slider_x.position,
        "slider_velocity": motion.slider_x.velocity,
        "rod_angle": motion.rod_angle.position,
        "rod_angular_velocity": motion.rod_angle.velocity,
    }
    spread = {}
    for name, values in found.items():
        spread[name] = np.full(known.shape, np.nan)
        spread[name][known] = values
    return spread
