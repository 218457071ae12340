"""Figures and numbers of the measured data: cycles, speeds, gaps, channels over the crank angle."""

from math import tau
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from jointgap.config.campaign import Campaign, CampaignRun
from jointgap.core.words import format_name, format_unit
from jointgap.rig.checks import cycle_scatter
from jointgap.rig.recording import Measurements, Recording

if TYPE_CHECKING:
    from jointgap.core.plot import Drawing

# [samples per revolution] Below, samples are marked, as a line alone would hide gaps
MARKED_BELOW = 100.0


def inspect(
    campaign: Campaign, measurements: Measurements
) -> "tuple[pd.DataFrame, dict[str, Drawing]]":
    """Table `LOOK` and a figure for each run."""
    recordings = [
        (run, measurements.runs[run.id]) for run in campaign.runs if run.id in measurements.runs
    ]
    numbers = [row for run, recording in recordings for row in _numbers(campaign, run, recording)]
    return pd.DataFrame(numbers), {
        run.id: _draw(campaign, run, recording) for run, recording in recordings
    }


def _turned(run: CampaignRun, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Crank angle (n,) [rad], measured with gaps interpolated, or from times and nominal speed; and
    its deviation from steady rotation, NaN in gaps.
    """
    angle = recording.crank_angle
    is_read = np.isfinite(recording.crank_angle)
    if not recording.has_angle:
        return run.speed * (recording.time - recording.time[0]), angle
    if not recording.has_time:
        return angle, np.full(angle.size, np.nan)
    time = recording.time - recording.time[0]  # keeps the digits of times since an epoch
    steady = np.polyval(np.polyfit(time[is_read], angle[is_read], 1), time)
    deviation = angle - steady
    return (
        np.where(is_read, angle, steady + np.interp(time, time[is_read], deviation[is_read])),
        deviation,
    )


def _numbers(campaign: Campaign, run: CampaignRun, recording: Recording) -> list[dict]:
    angle, _ = _turned(run, recording)
    total = angle[-1] - angle[0]
    samples = angle.size
    revolutions = total * (1.0 + 1.0 / (samples - 1)) / tau  # the last sample counts as a step
    mean = spread = np.nan
    if recording.has_time and recording.has_angle:
        mean = total / (recording.time[-1] - recording.time[0])
        rising = np.maximum.accumulate(angle)  # noise of an encoder can decrease
        passed = np.interp(np.arange(angle[0], angle[-1] + 1e-9, tau), rising, recording.time)
        spread = np.std(tau / np.diff(passed), ddof=1) if passed.size > 2 else np.nan
    rows = []
    for name, values in recording.all_channels.items():
        is_encoder = name == "crank_angle"
        side = run.side if is_encoder else 1.0
        noise = recording.noise[name]
        low, high = sorted([side * np.nanmin(values), side * np.nanmax(values)])
        rows.append(
            {
                "run": run.id,
                "channel": name,
                "unit": campaign.unit(name),
                "role": run.role,
                "samples": samples,
                "gaps": np.count_nonzero(~np.isfinite(values)),
                "cycles": int(revolutions + 1e-6),
                "samples_per_revolution": samples / revolutions,
                "mean_speed": mean,
                "speed_spread": spread,
                "low": low,
                "high": high,
                "scatter": np.nan if is_encoder else cycle_scatter(angle, values),
                "stated_noise": np.nan if noise is None else noise,
            }
        )
    return rows


def _draw(campaign: Campaign, run: CampaignRun, recording: Recording) -> "Drawing":
    """All channels over the crank angle with superposed cycles; the angle as deviation from steady
    rotation."""
    from jointgap.core import plot
    from jointgap.core.plot import CRANK_ANGLE, DENSE_LINE, Quantity, Sheet

    angle, deviation = _turned(run, recording)
    cycle = np.floor(angle / tau).astype(int)
    within = angle - cycle * tau
    side = run.side if recording.has_angle else 1.0
    shown = np.degrees(within if side > 0.0 else tau - within)
    look = {"linewidth": 0.9, "rasterized": angle.size > DENSE_LINE}
    if angle.size * tau / (angle[-1] - angle[0]) < MARKED_BELOW:
        look |= {"marker": ".", "markersize": 3.0}
    abscissa = CRANK_ANGLE
    if not recording.has_angle:
        abscissa = Quantity("crank angle from the first sample, at nominal speed", "deg")
    panels = []
    if recording.has_angle and recording.has_time:
        degrees = side * np.degrees(deviation)
        panels.append(("deviation from steady rotation", Quantity("deviation", "deg"), degrees))
    for name, values in recording.channels.items():
        unit, factor = campaign.shown_unit(name)
        title = format_name(name)
        panels.append((title, Quantity(title.split()[-1], format_unit(unit)), values / factor))
    with plot.matplotlib_style():
        sheet = Sheet(0.9 + 1.6 * len(panels), len(panels), 1)
        panel = None
        for row, (title, quantity, values) in enumerate(panels):
            panel = sheet.panel((row, 0), f"{run.id}: {title}", abscissa, quantity, below=panel)
            sampled = _sampled(values)
            for number in np.unique(cycle):
                rows = sampled[cycle[sampled] == number]
                is_first = number == cycle[0]
                name, colour = ("first cycle", "first") if is_first else ("later cycles", "settled")
                above = {"alpha": 1.0, "zorder": 3} if is_first else {"alpha": 0.5, "zorder": 2}
                panel.line(name, shown[rows], values[rows], colour, **above, **look)
        panel.over_crank_angle(0.0, 360.0)
        sheet.legend()
        return sheet.drawing()


def _sampled(values: np.ndarray) -> np.ndarray:
    """Rows to draw as a line: the samples, and the gaps that are longer than twice the channel's
    own interval."""
    rows = np.flatnonzero(np.isfinite(values))
    steps = np.diff(rows)
    drawn = np.isfinite(values)
    drawn[rows[0] : rows[-1]] |= np.repeat(steps > 2 * np.median(steps), steps)
    return np.flatnonzero(drawn)
