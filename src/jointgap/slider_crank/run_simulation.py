"""What the sensors of one run read: from values of nuisances and effects over the motion to the channels."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jointgap.config import Mechanism
from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.identification.protocol import Effects
from jointgap.slider_crank import driven_run as drives
from jointgap.slider_crank import sensors
from jointgap.slider_crank.channel_kinematics import observed, tolerance_for
from jointgap.slider_crank.modified_mechanism import mirrored, simulated_effects, with_effects, with_nuisances
from jointgap.slider_crank.other_numerics import otherwise
from jointgap.slider_crank.sample_grid import TURN, SampleGrid
from jointgap.slider_crank.sensor_faults import Faults

_PAD = 0.25  # revolutions that filters and lags see before and after the samples


@dataclass(frozen=True)
class RunPlan:
    """One run: its samples and what is read there.

    Attributes
    ----------
    run : CampaignRun
    samples : SampleGrid
    channels : tuple of str
        That are compared.
    pieces : tuple or None
        Of a measured angle that drives the crank.
    """

    run: CampaignRun
    samples: SampleGrid
    channels: tuple[str, ...]
    pieces: tuple[np.ndarray, float] | None = None


def channels_read(
    campaign: Campaign,
    plan: RunPlan,
    values: Mapping[str, float],
    effects: Effects = (),
    numerics: int = 0,
    perturbation: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """What the sensors of a run read at its samples.

    Parameters
    ----------
    campaign : Campaign
    plan : RunPlan
    values : mapping of str to float
        Every nuisance that the run has, by name.
    effects : sequence of (Candidate, mapping)
    numerics : int
        As in `jointgap.slider_crank.other_numerics.otherwise`.
    perturbation : (6,) array, optional
        Clearance vectors at the start [m], as in `jointgap.dynamics.simulation`; zero by default.

    Returns
    -------
    dict of str to (n,) array
        By channel.

    Raises
    ------
    InputError, SimulationError
        These values cannot be simulated.
    """
    effects, without, share = simulated_effects(effects)
    read = _read_once(campaign, plan, values, effects, numerics, perturbation)
    if share < 1.0:
        rest = _read_once(campaign, plan, values, without, numerics, perturbation)
        read = {channel: rest[channel] + share * (read[channel] - rest[channel]) for channel in read}
    return read


def _read_once(campaign, plan, values, effects, numerics, perturbation) -> dict[str, np.ndarray]:
    faults, nuisances = Faults(effects, plan.run.direction == "clockwise"), dict(values)
    for candidate, own in effects:  # a nuisance that an effect took over in part, such as the other pin's friction
        nuisances |= {name: own[name] for name in own if name in values and name not in candidate.amplitudes}
    mechanism = with_effects(with_nuisances(campaign.mechanism, nuisances), effects).applied()
    if plan.run.direction == "clockwise":
        mechanism = mirrored(mechanism)
    finer, change = otherwise(numerics)
    tolerance = finer * tolerance_for(mechanism)
    driven = _driven_run(campaign, plan, mechanism, nuisances, faults.offset, tolerance)
    change(driven.numbers)
    harmonic = driven.numbers.effects
    harmonic.harmonic_phase += harmonic.harmonic_angular_frequency * (plan.samples.time[0] - driven.begin)
    return _read(campaign, plan, driven, faults, tolerance, perturbation)


def _driven_run(campaign, plan, mechanism: Mechanism, values, offset, tolerance) -> drives.DrivenRun:
    if plan.pieces is not None:
        return drives.measured_angle_run(mechanism, plan.samples, plan.pieces, offset, tolerance)
    if campaign.drive == "motor":
        return drives.motor_run(mechanism, campaign, plan.run, plan.samples, values, offset, tolerance)
    return drives.constant_speed_run(mechanism, plan.run, plan.samples, values, offset, tolerance)


def _read(campaign, plan, driven, faults, tolerance, perturbation) -> dict[str, np.ndarray]:
    """What the sensors make of the motion at the samples."""
    sensor = {channel: campaign.channels[channel] for channel in plan.channels}
    if sensor.keys() == {"crank_angle"}:
        return {"crank_angle": driven.angles + faults.offset}
    corners = [one.bandwidth for one in sensor.values() if one.bandwidth]
    angles, grid = driven.angles, np.empty(0)
    if corners or any(map(faults.need_grid, sensor)):
        grid = _grid(plan, driven, corners)
        angles = np.append(angles, driven.at(grid))
    seen = observed(driven.numbers, angles, tolerance, perturbation)
    count = driven.angles.size
    elapsed = seen["time"][:count] - driven.begin
    found = {}
    for channel, one in sensor.items():
        values = seen[channel]
        if channel == "crank_angle":
            found[channel] = values[:count] + faults.offset
            continue
        if plan.run.direction == "clockwise" and channel in sensors.MIRRORED:
            values = -values
        if one.reads_gravity:
            values = values + sensors.gravity_read(channel, campaign.mechanism.gravity_direction)
        values = faults.before_filter(channel, values)
        read, fine = values[:count], values[count:]
        if one.bandwidth:
            fine = sensors.low_pass(fine, grid[1] - grid[0], one.bandwidth, one.filter == "causal")
            read = sensors.at_times(elapsed, grid, fine)
        if faults.need_grid(channel):
            late = faults.over_time(channel, fine, grid[1] - grid[0]) - fine
            read = read + sensors.at_times(elapsed, grid, late)
        found[channel] = faults.after_filter(channel, read)
    return found


def _grid(plan: RunPlan, driven: drives.DrivenRun, corners: list[float]) -> np.ndarray:
    turn = TURN / plan.samples.speed
    before = min(_PAD * turn, driven.begin)
    after = 0.0 if plan.pieces is not None else _PAD * turn  # a measured angle ends with the record
    return sensors.grid(-before, plan.samples.elapsed[-1] + after, turn, corners)
