"""The slider-crank of a campaign as a model for the naming of effects."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from math import tau
from types import MappingProxyType

import numpy as np

from jointgap.config.campaign_file import Campaign
from jointgap.config.channels import CHANNELS
from jointgap.effects.base import FitContext, MotionScale
from jointgap.identification.protocol import Candidate, Effects, Parameter, Series
from jointgap.slider_crank.candidates import physical_candidates
from jointgap.slider_crank.chaotic_channels import (
    chaotic_channels,
    chaotic_run,
    measured_statistics,
    simulated_statistics,
)
from jointgap.slider_crank.nuisances import run_nuisances, shared_nuisances
from jointgap.slider_crank.run_simulation import RunPlan, channels_read, numerics_for, unknown_starts
from jointgap.slider_crank.sample_grid import own_rows
from jointgap.slider_crank.sensor_faults import sensor_candidates
from jointgap.slider_crank.settings import DEFAULT_SETTINGS, SliderCrankSettings

POSITIONS = ("crank_angle", "slider_position", "rod_angle")
"""Channels smooth enough for what grows with their rate to be the time stamps' doing."""


class SliderCrankModel:
    """A `jointgap.identification.protocol.Model` of a slider-crank."""

    def __init__(
        self,
        campaign: Campaign,
        plans: Mapping[str, RunPlan],
        measured: Mapping[str, Mapping[str, np.ndarray]],
        noise: Mapping[str, Mapping[str, float | None]],
        held_out: Mapping[str, np.ndarray],
        searched: frozenset[str] = frozenset(),
        settings: SliderCrankSettings = DEFAULT_SETTINGS,
        told_encoder_offset: float | None = None,
        left_out: Mapping[str, str] = MappingProxyType({}),
    ):
        self.left_out = left_out
        self.told_encoder_offset = told_encoder_offset
        self.campaign, self.plans, self.name, self.settings = campaign, plans, campaign.name, settings
        own = [
            p
            for run, plan in plans.items()
            for p in run_nuisances(campaign, plan.run, plan.samples, run in searched, settings.nuisances)
        ]
        self.nuisances: tuple[Parameter, ...] = (*shared_nuisances(campaign, settings.nuisances), *own)
        self.numerics = numerics_for(campaign)
        self._chaotic = {}
        for run, plan in plans.items():
            values = self.nominal(run)
            if channels := chaotic_channels(campaign, plan, values, noise[run]):
                kept = ~held_out[run] | held_out[run].all()
                fitted = {channel: np.where(kept, measured[run][channel], np.nan) for channel in channels}
                self._chaotic[run] = chaotic_run(campaign, plan, channels, values, fitted, noise[run])
        self._rows = {
            (run, channel): own_rows(plan.samples.elapsed, measured[run][channel])
            for run, plan in plans.items()
            for channel in plan.channels
        }
        self.series = tuple(
            series for run in plans for series in self._all_series(run, measured[run], noise[run], held_out[run])
        )

    def nominal(self, run: str) -> dict[str, float]:
        """Nominal values [SI] of every nuisance that a run has, by name."""
        return {p.name: p.nominal for p in self.nuisances if p.run in (None, run)}

    def chaotic(self, run: str) -> tuple[str, ...]:
        """Channels of a run that are compared by statistics over cycles."""
        return self._chaotic[run].statistics.channels if run in self._chaotic else ()

    def _all_series(self, run: str, measured, noise, held_out) -> list[Series]:
        samples, series = self.plans[run].samples, []
        for channel in self.plans[run].channels:
            if channel not in self.chaotic(run):
                rows = self._rows[run, channel]
                value, sd = measured[channel][rows], noise.get(channel)
                stated = None if sd is None else np.full(value.size, sd)
                unit = CHANNELS[channel]
                step = (self.campaign.channels[channel].resolution or 0.0) * self.campaign.factor(channel)
                jitter = self.campaign.jitter
                if jitter is None and not (samples.timed and channel in POSITIONS):
                    jitter = 0.0  # what impacts do not repeat in velocities and accelerations is a motion
                series.append(
                    Series(
                        run,
                        channel,
                        unit,
                        value,
                        samples.time[rows],
                        samples.angle[rows],
                        held_out[rows],
                        stated,
                        resolution=step,
                        jitter=jitter,
                    )
                )
        return series + (self._statistics(run, measured, held_out) if run in self._chaotic else [])

    def _statistics(self, run: str, measured, held_out) -> list[Series]:
        """Series of the chaotic channels: statistics of the samples for fitting, then of those held out."""
        chaotic, angle, bins = self._chaotic[run], self.plans[run].samples.angle, self.settings.statistics.bins
        groups = [part for part in (False, True) if (held_out == part).any()]
        parts = [
            measured_statistics(chaotic, angle[held_out == part], {c: v[held_out == part] for c, v in measured.items()})
            for part in groups
        ]
        middles = np.tile((np.arange(bins) + 0.5) * (tau / bins), len(groups))
        return [
            Series(
                run,
                name,
                CHANNELS[name.partition(" ")[0]],
                np.concatenate([part[name][0] for part in parts]),
                np.full(middles.size, np.nan),
                middles,
                np.repeat(groups, bins),
                np.concatenate([part[name][1] for part in parts]),
                statistic=True,
            )
            for name in parts[0]
        ]

    def drive_errors(self, run: str, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Parameters as of `jointgap.identification.protocol.Driven.drive_errors`."""
        plan = self.plans[run]
        plan = replace(plan, channels=tuple(channel for channel in plan.channels if channel not in self.chaotic(run)))
        if plan.measured is None or not plan.channels:
            return {}
        usual = self._read(plan, values)
        moved = [self._read(replace(plan, measured=each), values) for each in plan.measured.moved]
        return {
            channel: np.array([each[channel] - usual[channel] for each in moved]).reshape(-1, usual[channel].size).T
            for channel in usual
        }

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """Every effect and every fault of a sensor that could be missing."""
        run, plan = next(iter(self.plans.items()))
        speed = float(np.mean([plan.samples.speed for plan in self.plans.values()]))
        read = channels_read(self.campaign, plan, self.nominal(run))
        spreads = {
            name: (float(np.ptp(values) and np.std(values)), CHANNELS[name])
            for name, values in read.items()
            if name != "crank_angle"
        }
        context = FitContext(
            self.campaign.mechanism,
            MotionScale.of(self.campaign.mechanism, speed),
            {p.name: p for p in self.nuisances if p.run is None},
            self.campaign.drive == "constant_speed",
            self.settings.sample_grid.planned_force_order * speed / tau,
            tuple(self.plans),
            unknown_starts(self.campaign, self.settings.simulation),
        )
        encoder = "crank_angle" in self.campaign.channels
        # in a single run for fitting a zero of its own is the offset that all runs have
        several = sum(plan.run.role != "confirm" for plan in self.plans.values()) > 1
        drives = self.campaign.drive == "measured_angle"
        return (
            *physical_candidates(context),
            *sensor_candidates(
                spreads,
                encoder,
                speed,
                drives,
                {p.name for p in self.nuisances},
                tuple(self.plans) if several else (),
                self.told_encoder_offset,
            ),
        )

    def simulate(
        self, run: str, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> dict[str, np.ndarray]:
        """Parameters as of `jointgap.identification.protocol.Model.simulate`."""
        plan, chaotic = self.plans[run], self._chaotic.get(run)
        sampled = tuple(channel for channel in plan.channels if channel not in self.chaotic(run))
        read = {}
        if sampled:
            read = self._read(replace(plan, channels=sampled), values, effects, numerics)
        if chaotic is not None:
            statistics = simulated_statistics(self.campaign, chaotic, values, effects, numerics)
            sizes = {series.channel: series.value.size for series in self.series if series.run == run}
            # the same for the samples for fitting and for those held out
            read |= {name: np.tile(bins, sizes[name] // bins.size) for name, bins in statistics.items()}
        return read

    def _read(
        self, plan: RunPlan, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> dict[str, np.ndarray]:
        """What the sensors read, each at its own rows."""
        read = channels_read(self.campaign, plan, values, effects, numerics)
        return {channel: value[self._rows[plan.run.id, channel]] for channel, value in read.items()}
