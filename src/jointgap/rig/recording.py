"""Measured runs in SI units."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config.campaign import Campaign

# Kinds of contradictions that are told by a channel's samples alone; no gain or zero of a sensor undoes them
OF_SAMPLES = ("clipped", "stuck", "no_data")
# Kinds for which a run is left out: its crank angle steps and stays there, or the crank does not turn on
OF_A_RUN = ("step", "standstill", "turns_back")


@dataclass(frozen=True)
class Contradiction:
    """What one channel of one run cannot be."""

    run: str
    channel: str  # ``time`` also where it may be the run's speed that is wrong
    kind: str  # sign, scale, phase, swapped, unrelated, one of `OF_SAMPLES` or of `OF_A_RUN`, time or speed
    remark: str  # In a sentence, without the place
    other: str = ""  # The channel that it is swapped with; empty where there is none
    factor: float = np.nan  # [1] Measured over expected; NaN where there is none
    phase: float = np.nan  # [rad] By how much the channel is ahead of what is expected; NaN where there is none
    doubtful: bool = True  # Whether the channel's readings are in doubt

    @property
    def stops(self) -> bool:
        """Whether it is to be corrected before an analysis, unlike the zero of an encoder, which an analysis finds."""
        return self.doubtful and (self.channel, self.kind) != ("crank_angle", "phase")


def sentences(found: Sequence[Contradiction]) -> list[str]:
    """The remarks of `found`, each once with the runs that it is of."""
    told = []
    for remark in dict.fromkeys(one.remark for one in found):
        runs = dict.fromkeys(one.run for one in found if one.remark == remark)
        told.append(f"run{'s' if len(runs) > 1 else ''} {', '.join(runs)}: {remark}")
    return told


@dataclass(frozen=True)
class Recording:
    """The samples of one run."""

    run: str
    time: np.ndarray  # As measured [s], rising; all NaN where the campaign has no channel time
    crank_angle: np.ndarray  # [rad], continuous over turns and rising on the whole
    channels: dict[str, np.ndarray]
    noise: dict[str, float | None]
    held_out: np.ndarray  # Samples that take no part in fitting or choosing

    @property
    def has_time(self) -> bool:
        """Whether times were measured."""
        return bool(np.isfinite(self.time).any())

    @property
    def has_angle(self) -> bool:
        """Whether the crank angle was measured."""
        return bool(np.isfinite(self.crank_angle).any())

    @property
    def all_channels(self) -> dict[str, np.ndarray]:
        """The channels, the crank angle first where it was measured."""
        return ({"crank_angle": self.crank_angle} if self.has_angle else {}) | self.channels


@dataclass(frozen=True)
class Measurements:
    """All runs of a campaign."""

    runs: dict[str, Recording]  # In the campaign's order; without those that cannot be used
    remarks: tuple[str, ...] = ()  # What a reader of the results should know of the data, in sentences
    contradictions: tuple[Contradiction, ...] = ()  # What channels cannot be what they are said to be

    @property
    def left_out(self) -> dict[str, str]:
        """Why a run of the campaign cannot be used, by run."""
        return {found.run: found.remark for found in self.contradictions if found.kind in OF_A_RUN}


def noise_of(campaign: Campaign, run: str) -> dict[str, float | None]:
    """`Recording.noise` of a `run` of the `campaign`."""
    stated = {name: channel.noise_of(run) for name, channel in campaign.channels.items() if name != "time"}
    return {name: None if sd is None else float(sd * campaign.factor(name)) for name, sd in stated.items()}


def to_frame(measurements: Measurements) -> pd.DataFrame:
    """Measurements as a tidy table: one row per run, channel and sample."""
    parts = [
        {"run": recording.run, "channel": channel, "sample": np.arange(values.size), "time": recording.time}
        | {"crank_angle": recording.crank_angle, "value": values, "held_out": recording.held_out}
        for recording in measurements.runs.values()
        for channel, values in recording.all_channels.items()
    ]
    return pd.concat([pd.DataFrame(part) for part in parts], ignore_index=True)


def from_frame(
    frame: pd.DataFrame, campaign: Campaign, remarks: tuple[str, ...] = (), found: tuple[Contradiction, ...] = ()
) -> Measurements:
    """The measurements in a table that `to_frame` made."""
    runs = {}
    for run, own in frame.groupby("run", sort=False, observed=True):
        parts = dict(list(own.groupby("channel", sort=False, observed=True)))
        channels = {name: part["value"].to_numpy(float) for name, part in parts.items() if name != "crank_angle"}
        samples = next(iter(parts.values()))
        time, angle = (samples[key].to_numpy(float) for key in ("time", "crank_angle"))
        held_out = samples["held_out"].to_numpy(bool)
        runs[run] = Recording(run, time, angle, channels, noise_of(campaign, run), held_out)
    return Measurements(runs, remarks, found)
