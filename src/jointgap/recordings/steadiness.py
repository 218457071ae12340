"""Whether a crank that is said to turn at constant speed does: how far its speed varies, within a turn and over a
record."""

from math import sqrt, tau

import numpy as np

from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.recordings.limits import DEFAULT_LIMITS, RecordingLimits
from jointgap.recordings.plausibility import angle_outliers

_ORDERS, _HALF_ORDERS = np.arange(1, 4), np.arange(1, 7) / 2
_TURNS_FOR_HALF_ORDERS = 4.0
_MOST_DRIFT_TERMS = 8


def speed_variation(time: np.ndarray, angle: np.ndarray) -> tuple[float, float, float, float]:
    """How far the crank's speed varies, as shares of its mean [1].

    A four-stroke engine repeats after two turns: in records of four turns or more half orders are looked for too.
    """
    finite = np.isfinite(angle)
    time, angle = time[finite] - time[finite][0], angle[finite]
    turns = (angle[-1] - angle[0]) / tau
    period, orders = (2, _HALF_ORDERS) if turns >= _TURNS_FOR_HALF_ORDERS else (1, _ORDERS)
    terms = int(min(max(turns / period, 1), _MOST_DRIFT_TERMS)) + 1
    if time.size < 2 * (terms + 2 * orders.size):
        return np.nan, np.nan, np.nan, np.nan
    drift = np.polynomial.legendre.legvander(2.0 * time / time[-1] - 1.0, terms)
    phase = orders * angle[:, None]
    basis = np.column_stack([drift, np.cos(phase), np.sin(phase)])
    weights = np.linalg.lstsq(basis, angle, rcond=None)[0]
    sd = float(np.sqrt(np.mean((angle - basis @ weights) ** 2)))
    cosine, sine = weights[terms + 1 :].reshape(2, -1)
    places = np.linspace(0.0, period * tau, 120 * period)[:, None] * orders
    speed = (orders * (sine * np.cos(places) - cosine * np.sin(places))).sum(axis=1)
    passed = np.interp(np.arange(angle[0], angle[-1], tau), np.maximum.accumulate(angle), time)
    speeds = period * tau / (passed[period:] - passed[:-period])
    over = 0.5 * float(np.ptp(speeds) / speeds.mean()) if speeds.size > 1 else np.nan
    strongest = float(orders[np.argmax(orders * np.hypot(cosine, sine))])
    return 0.5 * float(np.ptp(speed)), over, sd * sqrt(2.0) / tau, strongest


def standstill(
    time: np.ndarray, angle: np.ndarray, speed: float, limits: RecordingLimits = DEFAULT_LIMITS
) -> tuple[float, float, bool] | None:
    """From when to when [s] a crank stands still, and whether it turns back; None where it turns on, or turns so little
    at its nominal speed that something else must be wrong.
    """
    finite = np.isfinite(angle)
    finite[angle_outliers(time, angle, limits)] = False
    time, angle = time[finite], angle[finite]
    window = limits.standstill_window_rad / speed
    begins = time[time + window <= time[-1]]
    ahead = (np.interp(begins + window, time, angle) - angle[: begins.size]) / limits.standstill_window_rad
    low, high = limits.speed_ratios["constant_speed"]
    slow = ahead < limits.standstill_share
    if not slow.any() or np.mean((ahead > low) & (ahead < high)) < limits.turning_share:
        return None
    # as far as noise would still let the smooth angle fall
    turning = np.flatnonzero(ahead > limits.turned_back_share)
    first, place = 0, int(np.argmax(slow))
    if (before := turning[turning < place]).size:
        first = int(before[-1]) + 1
    after = turning[turning > place]
    end = begins[after[0]] + window if after.size else time[-1]
    part = ahead[first : after[0] if after.size else None]
    return float(begins[first]), float(end), bool(part.min() < -limits.turned_back_share)


def unsteady(
    campaign: Campaign,
    run: CampaignRun,
    time: np.ndarray,
    angle: np.ndarray,
    limits: RecordingLimits = DEFAULT_LIMITS,
) -> str | None:
    """What is to be known of a crank that turns unsteadily under the drive constant_speed; None if it does not, or if
    the mechanism lists a fluctuation of the speed.
    """
    fluctuates = any(effect.name == "speed_fluctuation" for effect in campaign.mechanism.effects)
    if fluctuates or campaign.drive != "constant_speed" or not (np.isfinite(time).all() and np.isfinite(angle).any()):
        return None
    within, over, error, order = speed_variation(time, angle)
    half = f"within two turns (most at order {order:g}, as a four-stroke engine's does)"
    least = max(limits.unsteady_share, limits.unsteady_standard_errors * error)
    told = [
        f"by {100.0 * share:.2g} % either way {where}"
        for share, where in ((within, "within a turn" if order % 1 == 0 else half), (over, "from turn to turn"))
        if share > least
    ]
    if not told:
        return None
    return (
        f"the drive is constant_speed, but the speed varies {' and '.join(told)}; with times and crank angles, "
        "'drive: measured_angle' takes the motion as it was"
    )
