"""Measured runs in SI units."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config.campaign import Campaign

# Kinds of contradictions in the samples of one channel, which no gain or zero corrects
OF_SAMPLES = ("clipped", "stuck", "no_data")
# Kinds that make a run unusable
OF_A_RUN = ("step", "standstill", "turns_back")


@dataclass(frozen=True)
class Contradiction:
    """An inconsistency of one channel in one run."""

    run: str
    channel: str  # ``time`` also if the run's speed may be wrong
    # sign, scale, phase, swapped, unrelated, one of `OF_SAMPLES` or of `OF_A_RUN`, time, speed,
    # clock, held
    kind: str
    remark: str  # A sentence without run and file
    other: str = ""  # The swapped channel
    factor: float = np.nan  # [1] Measured over expected
    phase: float = np.nan  # [rad] Lead of the channel
    doubtful: bool = True  # Whether the channel's readings may be wrong

    @property
    def is_encoder_zero(self) -> bool:
        return (self.channel, self.kind) == ("crank_angle", "phase")

    @property
    def stops(self) -> bool:
        """Whether it prevents an analysis; an encoder zero does not, as the analysis identifies
        it."""
        return self.doubtful and not self.is_encoder_zero


def sentences(contradictions: Sequence[Contradiction]) -> list[str]:
    """Each remark of `found` once, with its runs."""
    lines = []
    for remark in dict.fromkeys(contradiction.remark for contradiction in contradictions):
        runs = dict.fromkeys(
            contradiction.run for contradiction in contradictions if contradiction.remark == remark
        )
        lines.append(f"run{'s' if len(runs) > 1 else ''} {', '.join(runs)}: {remark}")
    return lines


@dataclass(frozen=True)
class Recording:
    """The samples of one run."""

    run: str
    time: np.ndarray  # As measured [s], increasing; all NaN without the channel time
    crank_angle: np.ndarray  # [rad], continuous over turns
    channels: dict[str, np.ndarray]
    noise: dict[str, float | None]
    held_out: np.ndarray  # Samples not used for fitting and selection
    second_clock: tuple[
        str, ...
    ] = ()  # Channels of a second logger, by whose clock their samples are stamped

    @property
    def has_time(self) -> bool:
        return np.isfinite(self.time).any()

    @property
    def has_angle(self) -> bool:
        return np.isfinite(self.crank_angle).any()

    @property
    def all_channels(self) -> dict[str, np.ndarray]:
        """The channels, with the crank angle first if it was measured."""
        return ({"crank_angle": self.crank_angle} if self.has_angle else {}) | self.channels


@dataclass(frozen=True)
class Measurements:
    """All runs of a campaign."""

    runs: dict[str, Recording]  # In the campaign's order, without unusable runs
    remarks: tuple[str, ...] = ()  # For the summary page
    contradictions: tuple[Contradiction, ...] = ()

    @property
    def left_out(self) -> dict[str, str]:
        """The reason for each unusable run."""
        return {
            contradiction.run: contradiction.remark
            for contradiction in self.contradictions
            if contradiction.kind in OF_A_RUN
        }


def noise_of(campaign: Campaign, run: str) -> dict[str, float | None]:
    """`Recording.noise` of a `run` of the `campaign`."""
    noise = {}
    for name, channel in campaign.channels.items():
        if name != "time":
            sd = channel.noise_of(run)
            noise[name] = None if sd is None else float(sd * campaign.factor(name))
    return noise


def to_frame(measurements: Measurements) -> pd.DataFrame:
    """Table `MEASURED`: one row per run, channel and sample."""
    parts = [
        {
            "run": recording.run,
            "channel": channel,
            "sample": np.arange(values.size),
            "time": recording.time,
            "crank_angle": recording.crank_angle,
            "value": values,
            "held_out": recording.held_out,
            "second_clock": channel in recording.second_clock,
        }
        for recording in measurements.runs.values()
        for channel, values in recording.all_channels.items()
    ]
    return pd.concat([pd.DataFrame(part) for part in parts], ignore_index=True)


def from_frame(
    frame: pd.DataFrame,
    campaign: Campaign,
    remarks: tuple[str, ...] = (),
    contradictions: tuple[Contradiction, ...] = (),
) -> Measurements:
    """Inverse of `to_frame`."""
    runs = {}
    for run, run_frame in frame.groupby("run", sort=False, observed=True):
        parts = dict(list(run_frame.groupby("channel", sort=False, observed=True)))
        channels = {
            name: part["value"].to_numpy(float)
            for name, part in parts.items()
            if name != "crank_angle"
        }
        samples = next(iter(parts.values()))
        time, angle = (samples[key].to_numpy(float) for key in ("time", "crank_angle"))
        held_out = samples["held_out"].to_numpy(bool)
        second_clock = tuple(name for name, part in parts.items() if part["second_clock"].all())
        runs[run] = Recording(
            run, time, angle, channels, noise_of(campaign, run), held_out, second_clock
        )
    return Measurements(runs, remarks, contradictions)
