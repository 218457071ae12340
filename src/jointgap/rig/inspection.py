"""Measured data before anything is fitted: cycles, speeds, gaps, and every channel over the crank angle."""

from math import tau
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from jointgap.config.campaign import CHANNELS, Campaign, CampaignRun
from jointgap.core.words import in_words, unit_in_words
from jointgap.rig.checks import cycle_scatter
from jointgap.rig.recording import Measurements, Recording

if TYPE_CHECKING:
    from jointgap.core.plot import Drawing

_FIRST, _LATER = "first cycle", "later cycles"
_DEPARTURE = "departure from steady rotation"
_MARKED_BELOW_PER_REVOLUTION = (
    100.0  # samples a revolution below which each is marked, as a line alone would hide the gaps
)


def inspect(campaign: Campaign, measurements: Measurements) -> "tuple[pd.DataFrame, dict[str, Drawing]]":
    """Numbers and figures of measured data."""
    runs = {run.id: run for run in campaign.runs}
    recordings = [(runs[recording.run], recording) for recording in measurements.runs.values()]
    numbers = [row for run, recording in recordings for row in _numbers(run, recording)]
    return pd.DataFrame(numbers), {run.id: _draw(campaign, run, recording) for run, recording in recordings}


def _turned(run: CampaignRun, recording: Recording) -> np.ndarray:
    """Crank angle (n,) [rad]: measured, gaps bridged; else from times and the nominal speed, from 0 on."""
    if not recording.has_angle:
        return run.speed * (recording.time - recording.time[0])
    angle = recording.crank_angle
    finite = np.isfinite(angle)
    if finite.all():
        return angle
    steady = _steady_rotation(recording)  # gaps at the ends are bridged by it
    departure = angle - steady
    return steady + np.interp(recording.time, recording.time[finite], departure[finite])


def _steady_rotation(recording: Recording) -> np.ndarray:
    """Crank angle (n,) [rad] if the crank turned steadily: the straight line nearest to the measured ones."""
    finite = np.isfinite(recording.crank_angle)
    time = recording.time - recording.time[0]  # times since an epoch would leave no digits
    return np.polyval(np.polyfit(time[finite], recording.crank_angle[finite], 1), time)


def _numbers(run: CampaignRun, recording: Recording) -> list[dict]:
    angle = _turned(run, recording)
    samples = angle.size
    revolutions = (angle[-1] - angle[0]) * (1.0 + 1.0 / (samples - 1)) / tau  # the last sample stands for a step too
    cycles = int(revolutions + 1e-6)
    mean = spread = np.nan
    if recording.has_time and recording.has_angle:
        mean = (angle[-1] - angle[0]) / (recording.time[-1] - recording.time[0])
        if cycles >= 2:
            spread = _speed_spread(recording.time, angle)
    rows = []
    for name, values in recording.all_channels.items():
        if name == "crank_angle" and run.direction == "clockwise":
            values = -values
        noise = recording.noise[name]
        rows.append(
            {
                "run": recording.run,
                "channel": name,
                "unit": CHANNELS[name],
                "role": run.role,
                "samples": samples,
                "gaps": int(np.count_nonzero(~np.isfinite(values))),
                "cycles": cycles,
                "samples_per_revolution": samples / revolutions,
                "mean_speed": mean,
                "speed_spread": spread,
                "low": float(np.nanmin(values)),
                "high": float(np.nanmax(values)),
                "scatter": cycle_scatter(angle, values) if name != "crank_angle" else np.nan,
                "stated_noise": np.nan if noise is None else noise,
            }
        )
    return rows


def _speed_spread(time: np.ndarray, angle: np.ndarray) -> float:
    """Standard deviation of the mean speeds [rad/s] of whole cycles, counted from the first sample."""
    passed = np.arange(angle[0], angle[-1] + 1e-9, tau)
    rising = np.maximum.accumulate(angle)  # an encoder's noise may step back
    return float(np.std(tau / np.diff(np.interp(passed, rising, time)), ddof=1)) if passed.size > 2 else np.nan


def _draw(campaign: Campaign, run: CampaignRun, recording: Recording) -> "Drawing":
    """Every channel over the crank angle, cycles on top of each other; the angle as departure from steady rotation."""
    from jointgap.core import plot
    from jointgap.core.plot import CRANK_ANGLE, DENSE_LINE, Quantity, Sheet

    angle = _turned(run, recording)
    cycle = np.floor(angle / tau).astype(int)
    within = angle - cycle * tau
    mirrored = run.direction == "clockwise" and recording.has_angle  # recordings of a clockwise crank are mirror images
    shown_angle = np.degrees(tau - within if mirrored else within)
    sparse = angle.size * tau / (angle[-1] - angle[0]) < _MARKED_BELOW_PER_REVOLUTION
    look = {"linewidth": 0.9, "rasterized": angle.size > DENSE_LINE}
    look |= {"marker": ".", "markersize": 3.0} if sparse else {}
    no_encoder = Quantity("crank angle since the first sample, at nominal speed", "deg")
    abscissa = CRANK_ANGLE if recording.has_angle else no_encoder
    panels = [
        (in_words(name), unit_in_words(unit), values / factor)
        for name, values in recording.channels.items()
        for unit, factor in [campaign.shown_unit(name)]
    ]
    if recording.has_angle and recording.has_time:
        departure = (-1.0 if mirrored else 1.0) * np.degrees(recording.crank_angle - _steady_rotation(recording))
        panels.insert(0, (_DEPARTURE, "deg", departure))
    with plot.matplotlib_style():
        sheet = Sheet(0.9 + 1.6 * len(panels), len(panels), 1)
        panel = None
        for row, (title, unit, values) in enumerate(panels):
            words = "departure" if title == _DEPARTURE else title.split()[-1]
            panel = sheet.panel((row, 0), f"{recording.run}: {title}", abscissa, Quantity(words, unit), below=panel)
            for number in np.unique(cycle):
                own, first = cycle == number, number == cycle[0]
                panel.line(
                    _FIRST if first else _LATER,
                    shown_angle[own],
                    values[own],
                    "first" if first else "settled",
                    alpha=1.0 if first else 0.5,
                    zorder=3 if first else 2,
                    **look,
                )
        panel.over_crank_angle(0.0, 360.0)
        sheet.legend()
        return sheet.drawing()
