"""The slider-crank of a campaign as a model for the naming of effects."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jointgap.config.campaign import CHANNELS, Campaign, CampaignRun
from jointgap.discrepancy.protocol import Candidate, Effects, Parameter, Series
from jointgap.rig import drives, sensors
from jointgap.rig.candidates import Scale, physical_candidates
from jointgap.rig.changes import mirrored, softened, with_effects, with_nuisances
from jointgap.rig.clock import TURN, Clock
from jointgap.rig.faults import Faults, sensor_candidates
from jointgap.rig.motion import observed, tolerance_for
from jointgap.rig.nuisances import of_run, shared
from jointgap.rig.numerics import NUMERICS, otherwise

_PAD = 0.25  # revolutions that filters and lags see before and after the samples


@dataclass(frozen=True)
class RunPlan:
    """One run: its samples and what was read there.

    Attributes
    ----------
    run : CampaignRun
    clock : Clock
    channels : tuple of str
        That are compared.
    pieces : tuple or None
        Of a measured angle that drives the crank.
    """

    run: CampaignRun
    clock: Clock
    channels: tuple[str, ...]
    pieces: tuple[np.ndarray, float] | None


class RigModel:
    """A `jointgap.discrepancy.protocol.Model` of a slider-crank.

    Parameters
    ----------
    campaign : Campaign
    plans : mapping of str to RunPlan
        By run.
    measured : mapping of (run, channel) to (values, stated noise or None)
        Values NaN where nothing was measured.
    held_out : mapping of run to (n,) bool array
    first_angles_searched : bool
        Whether first angles were found by a search, so that a fit has to go on with it.
    """

    def __init__(self, campaign: Campaign, plans, measured, held_out, first_angles_searched: frozenset[str]):
        self.campaign, self.plans = campaign, plans
        self.name = campaign.name
        own = [
            p
            for name, plan in plans.items()
            for p in of_run(campaign, plan.run, plan.clock, name in first_angles_searched)
        ]
        self.nuisances: tuple[Parameter, ...] = (*shared(campaign), *own)
        self.numerics = NUMERICS
        self.series = tuple(
            self._series(name, channel, *measured[name, channel], held_out[name])
            for name, plan in plans.items()
            for channel in plan.channels
        )

    def _series(self, run: str, channel: str, value, noise, held_out) -> Series:
        plan = self.plans[run]
        stated = None if noise is None else np.full(value.size, noise)
        return Series(run, channel, CHANNELS[channel], value, plan.clock.time, plan.clock.angle, held_out, stated)

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """Every effect and every fault of a sensor that could be missing."""
        first = next(iter(self.plans.values()))
        turning = float(np.mean([plan.clock.speed for plan in self.plans.values()]))
        read = self.simulate(first.run.id, self._nominal(first.run.id))
        spreads = {
            channel: (float(np.std(read[channel])), CHANNELS[channel])
            for channel in first.channels
            if channel != "crank_angle"
        }
        scale = Scale.of(self.campaign.mechanism, turning)
        nuisances = {p.name: p for p in self.nuisances if p.run is None}
        constant = self.campaign.drive == "constant_speed"
        physical = physical_candidates(self.campaign.mechanism, scale, nuisances, constant, 1.37 * turning / TURN)
        return (*physical, *sensor_candidates(spreads, "crank_angle" in self.campaign.channels, turning))

    def _nominal(self, run: str) -> dict[str, float]:
        return {p.name: p.nominal for p in self.nuisances if p.run in (None, run)}

    def simulate(
        self, run: str, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> dict[str, np.ndarray]:
        """As `jointgap.discrepancy.protocol.Model.simulate` says."""
        effects, share = softened(effects)
        read = self._simulate(run, values, effects, numerics)
        if share < 1.0:
            rigid = self._simulate(run, values, [one for one in effects if one[0].name != "rod_flexibility"], numerics)
            read = {channel: rigid[channel] + share * (read[channel] - rigid[channel]) for channel in read}
        return read

    def _simulate(self, run, values, effects, numerics) -> dict[str, np.ndarray]:
        plan, faults = self.plans[run], Faults(effects)
        nuisances = dict(values)
        for candidate, own in effects:  # a nuisance that an effect took over in part, such as the other pin's friction
            nuisances |= {name: own[name] for name in own if name in values and name not in candidate.sizes}
        mechanism = with_effects(with_nuisances(self.campaign.mechanism, nuisances), effects).applied()
        if plan.run.direction == "clockwise":
            mechanism = mirrored(mechanism)
        finer, change = otherwise(numerics)
        tolerance = finer * tolerance_for(mechanism)
        passage = self._passage(plan, mechanism, nuisances, faults.offset, tolerance)
        change(passage.numbers)
        harmonic = passage.numbers.effects
        harmonic.harmonic_phase += harmonic.harmonic_pulsation * (plan.clock.time[0] - passage.begin)
        return self._read(plan, mechanism, passage, faults, tolerance)

    def _passage(self, plan, mechanism, values, offset, tolerance) -> drives.Passage:
        if plan.pieces is not None:
            return drives.measured_passage(mechanism, plan.clock, plan.pieces, offset, tolerance)
        if self.campaign.drive == "motor":
            return drives.motor_passage(mechanism, self.campaign, plan.run, plan.clock, values, offset, tolerance)
        return drives.constant_passage(mechanism, plan.run, plan.clock, values, offset, tolerance)

    def _read(self, plan, mechanism, passage, faults, tolerance) -> dict[str, np.ndarray]:
        """What the sensors make of the motion at the samples."""
        sensor = {channel: self.campaign.channels[channel] for channel in plan.channels}
        corners = [one.bandwidth for one in sensor.values() if one.bandwidth]
        angles, grid = passage.angles, np.empty(0)
        if corners or any(faults.lag(channel) for channel in sensor):
            grid = self._grid(plan, passage, corners)
            angles = np.append(angles, passage.at(grid))
        seen = observed(passage.numbers, angles, tolerance)
        count = passage.angles.size
        elapsed = seen["time"][:count] - passage.begin
        found = {}
        for channel, one in sensor.items():
            values = seen[channel]
            if channel == "crank_angle":
                found[channel] = values[:count] + faults.offset
                continue
            if plan.run.direction == "clockwise" and channel in sensors.MIRRORED:
                values = -values
            if one.reads_gravity:
                values = values + sensors.gravity_read(channel, self.campaign.mechanism.gravity_direction)
            values = faults.gain(channel) * values
            read, fine, lag = values[:count], values[count:], faults.lag(channel)
            if one.bandwidth:
                fine = sensors.low_pass(fine, grid[1] - grid[0], one.bandwidth, one.filter == "causal")
                read = sensors.at_times(elapsed, grid, fine)
            if lag:
                late = sensors.lagged(fine, grid[1] - grid[0], lag) - fine
                read = read + sensors.at_times(elapsed, grid, late)
            found[channel] = read + faults.bias(channel)
        return found

    def _grid(self, plan: RunPlan, passage: drives.Passage, corners: list[float]) -> np.ndarray:
        turn = TURN / plan.clock.speed
        before = min(_PAD * turn, passage.begin)
        after = 0.0 if plan.pieces is not None else _PAD * turn  # a measured angle ends with the record
        return sensors.grid(-before, plan.clock.elapsed[-1] + after, turn, corners)
