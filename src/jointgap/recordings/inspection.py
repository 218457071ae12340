"""A look at measured data before anything is fitted: cycles, speeds, gaps, and every channel over the crank angle."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from jointgap.config.campaign_file import Campaign
from jointgap.config.channels import CHANNELS
from jointgap.recordings.encoder_angle import TURN
from jointgap.recordings.recording import Measurements, Recording

if TYPE_CHECKING:
    from jointgap.figures.drawing import Drawing

_FIRST, _LATER = "first cycle", "later cycles"
_DOTTED = 100.0  # samples a revolution below which each is marked


def inspect(campaign: Campaign, measurements: Measurements) -> "tuple[pd.DataFrame, dict[str, Drawing]]":
    """What the data are like.

    Returns
    -------
    numbers : DataFrame
        One row per run and channel: run, channel, unit (SI), role, samples, gaps (samples without a value), cycles (whole
        revolutions), samples_per_revolution, mean_speed and speed_spread (standard deviation of the cycles' speeds) [rad/s; NaN unless
        both time and crank angle were measured, and of less than two cycles], low, high (extremes), scatter (standard deviation of a
        cycle from the one before, over sqrt(2): noise, and whatever does not repeat; NaN of less than two cycles), stated_noise [SI of
        the channel; NaN where none is stated].
    figures : dict of str to Drawing
        By run: every channel over the crank angle, cycles on top of each other.

    Crank angles, and extremes of a crank angle, are those of the file also where the crank turns clockwise.
    """
    numbers = [row for recording in measurements.runs.values() for row in _numbers(campaign, recording)]
    return pd.DataFrame(numbers), {run: draw(campaign, recording) for run, recording in measurements.runs.items()}


def turned(campaign: Campaign, recording: Recording) -> np.ndarray:
    """Crank angle [rad] of every sample, shape (n,): measured, gaps bridged; else from times and the nominal speed, from 0 on."""
    if not recording.has_angle:
        speed = next(run.speed for run in campaign.runs if run.id == recording.run)
        return speed * (recording.time - recording.time[0])
    angle = recording.crank_angle
    known = np.isfinite(angle)
    if known.all():
        return angle
    steady = steady_rotation(recording)  # gaps at the ends are bridged by it
    departure = angle - steady
    return steady + np.interp(recording.time, recording.time[known], departure[known])


def steady_rotation(recording: Recording) -> np.ndarray:
    """Crank angle [rad] of every sample, shape (n,), if the crank turned steadily: the straight line nearest to what was measured."""
    known = np.isfinite(recording.crank_angle)
    time = recording.time - recording.time[0]  # times since an epoch would leave no digits
    return np.polyval(np.polyfit(time[known], recording.crank_angle[known], 1), time)


def _numbers(campaign: Campaign, recording: Recording) -> list[dict]:
    angle = turned(campaign, recording)
    revolutions = (
        (angle[-1] - angle[0]) * (1.0 + 1.0 / (angle.size - 1)) / TURN
    )  # the last sample stands for a step too
    cycles = int(revolutions + 1e-6)
    mean = spread = np.nan
    if recording.has_time and recording.has_angle:
        mean = (angle[-1] - angle[0]) / (recording.time[-1] - recording.time[0])
        if cycles >= 2:
            spread = _speed_spread(recording.time, angle)
    run = next(run for run in campaign.runs if run.id == recording.run)
    rows = []
    for name, values in _shown(recording).items():
        if name == "crank_angle" and run.direction == "clockwise":
            values = -values
        noise = recording.noise[name]
        rows.append(
            {
                "run": recording.run,
                "channel": name,
                "unit": CHANNELS[name],
                "role": run.role,
                "samples": values.size,
                "gaps": int(np.count_nonzero(~np.isfinite(values))),
                "cycles": cycles,
                "samples_per_revolution": values.size / revolutions,
                "mean_speed": mean,
                "speed_spread": spread,
                "low": float(np.nanmin(values)),
                "high": float(np.nanmax(values)),
                "scatter": _scatter(angle, values) if name != "crank_angle" else np.nan,
                "stated_noise": np.nan if noise is None else noise,
            }
        )
    return rows


def _shown(recording: Recording) -> dict[str, np.ndarray]:
    return ({"crank_angle": recording.crank_angle} if recording.has_angle else {}) | recording.channels


def _speed_spread(time: np.ndarray, angle: np.ndarray) -> float:
    """Standard deviation of the mean speeds [rad/s] of whole cycles, counted from the first sample."""
    passed = np.arange(angle[0], angle[-1] + 1e-9, TURN)
    rising = np.maximum.accumulate(angle)  # an encoder's noise may step back
    return float(np.std(TURN / np.diff(np.interp(passed, rising, time)), ddof=1)) if passed.size > 2 else np.nan


def _scatter(angle: np.ndarray, values: np.ndarray) -> float:
    """Standard deviation of a channel from its value a revolution later, over sqrt(2), shape-free; NaN of less than two cycles."""
    rising = np.maximum.accumulate(angle)
    after = np.searchsorted(rising, rising + TURN * (1.0 - 1e-9))
    here = np.flatnonzero((after > 0) & (after < rising.size))
    after = after[here]
    step = rising[after] - rising[after - 1]
    share = np.divide(rising[here] + TURN - rising[after - 1], step, out=np.ones(step.shape), where=step > 0.0)
    share = np.clip(share, 0.0, 1.0)
    later = np.where(share < 1.0, (1.0 - share) * values[after - 1], 0.0) + share * values[after]
    away = (values[here] - later) ** 2 / (1.0 + share**2 + (1.0 - share) ** 2)  # interpolated noise is smaller
    away = away[np.isfinite(away)]
    return float(np.sqrt(away.mean())) if away.size >= 8 else np.nan


def draw(campaign: Campaign, recording: Recording) -> "Drawing":
    """Every channel of a run over the crank angle, cycles on top of each other; a crank angle as its departure from steady speed."""
    from jointgap.figures.sheet import CRANK_ANGLE, Quantity, Sheet
    from jointgap.figures.style import look as in_the_one_look

    angle = turned(campaign, recording)
    cycle = np.floor(angle / TURN).astype(int)
    within = angle - cycle * TURN
    clockwise = next(run.direction == "clockwise" for run in campaign.runs if run.id == recording.run)
    sign = -1.0 if clockwise and recording.has_angle else 1.0  # recordings of a clockwise crank are mirror images
    seen = within if sign > 0.0 else TURN - within
    dotted = {"marker": ".", "markersize": 3.0} if angle.size * TURN / (angle[-1] - angle[0]) < _DOTTED else {}
    abscissa = (
        CRANK_ANGLE if recording.has_angle else Quantity("crank angle since the first sample, at nominal speed", "deg")
    )
    shown = dict(recording.channels)
    if recording.has_angle and recording.has_time:
        shown = {"crank_angle": sign * np.degrees(recording.crank_angle - steady_rotation(recording))} | shown
    with in_the_one_look():
        sheet = Sheet(0.9 + 1.6 * len(shown), len(shown), 1)
        above = None
        for row, (name, values) in enumerate(shown.items()):
            words, unit = name.replace("_", " "), CHANNELS[name].replace("*", " ").replace("^2", "²")
            if name == "crank_angle":
                words, unit = "departure from steady rotation", "deg"
            panel = sheet.panel((row, 0), f"{recording.run}: {words}", abscissa, Quantity("", unit), below=above)
            for number in np.unique(cycle):
                own = cycle == number
                first = number == cycle[0]
                panel.line(
                    _FIRST if first else _LATER,
                    np.degrees(seen[own]),
                    values[own],
                    "first" if first else "settled",
                    alpha=1.0 if first else 0.5,
                    linewidth=0.9,
                    **dotted,
                )
            above = panel
        panel.over_crank_angle(0.0, 360.0)
        sheet.legend()
        return sheet.drawing()
