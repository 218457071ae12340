"""What the sensors of one run read: from values of nuisances and effects over the motion to the channels."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import tau

import numpy as np

from jointgap.config import Mechanism
from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.dynamics.model.parameters import Parameters
from jointgap.effects.joint_clearance import START
from jointgap.errors import InputError
from jointgap.identification.protocol import FAST, Effects
from jointgap.joints import JOINTS
from jointgap.recordings.recording import noise_of
from jointgap.slider_crank import driven_run as drives
from jointgap.slider_crank import sensors
from jointgap.slider_crank.channel_kinematics import Columns, channels_at, tolerance_for
from jointgap.slider_crank.modified_mechanism import simulated_effects, with_effects, with_nuisances
from jointgap.slider_crank.sample_grid import SampleGrid
from jointgap.slider_crank.sensor_faults import Faults
from jointgap.slider_crank.settings import DEFAULT_SETTINGS, SimulationSettings, SliderCrankSettings

NUMERICS = (
    "friction regularised by Threlfall's law",
    "a tenth of the tolerance",
    "another start",
)
"""Other numerics that are as good as the usual ones, in words: what they change in a prediction is no disagreement. The
last one is for joints that are loose and a start that nobody knows."""


def numerics_for(campaign: Campaign) -> tuple[str, ...]:
    """Those of `NUMERICS` that can change anything in a campaign."""
    return NUMERICS if _free_runs(campaign) and campaign.mechanism.applied().loose else NUMERICS[:-1]


def _free_runs(campaign: Campaign) -> list[str]:
    """Runs of which nobody knows where their motion began."""
    return [run.id for run in campaign.runs if campaign.drive != "measured_angle" and drives.began_anywhere(run)]


def unknown_starts(campaign: Campaign, settings: SimulationSettings = DEFAULT_SETTINGS.simulation) -> dict[str, int]:
    """From how many starts the motion may have come with a joint that became loose, by run of which nobody knows where
    it began; none where joints are loose already: of these another start is one of the `NUMERICS`.
    """
    return {} if campaign.mechanism.applied().loose else dict.fromkeys(_free_runs(campaign), settings.starts)


@dataclass(frozen=True)
class RunPlan:
    """One run: its samples and what is read there."""

    run: CampaignRun
    samples: SampleGrid
    channels: tuple[str, ...]  # That are compared
    measured: drives.MeasuredDrive | None = None  # A measured angle that drives the crank
    settings: SliderCrankSettings = DEFAULT_SETTINGS


def channels_read(
    campaign: Campaign,
    plan: RunPlan,
    values: Mapping[str, float],
    effects: Effects = (),
    numerics: int = 0,
    perturbation: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """What the sensors of a run read at its samples."""
    effects, without, share = simulated_effects(effects)
    read = _read_at_limit(campaign, plan, values, effects, numerics, perturbation)
    if share < 1.0:
        rest = _read_at_limit(campaign, plan, values, without, numerics, perturbation)
        read = {channel: rest[channel] + share * (read[channel] - rest[channel]) for channel in read}
    return read


def _read_at_limit(campaign, plan, values, effects, numerics, perturbation) -> dict[str, np.ndarray]:
    """`channels_read` of a rod that is no stiffer than can be simulated."""
    clockwise = plan.run.direction == "clockwise"
    faults, nuisances = Faults(effects, clockwise, values), dict(values)
    for candidate, own in effects:  # a nuisance that an effect took over in part, such as the other pin's friction
        nuisances |= {name: own[name] for name in own if name in values and name not in candidate.amplitudes}
    mechanism = with_effects(with_nuisances(campaign.mechanism, nuisances), effects).applied()
    if clockwise:
        mechanism = mechanism.mirrored()
    finer, change = other_numerics(numerics)
    tolerance = finer * tolerance_for(mechanism, plan.settings.simulation, numerics == FAST)
    start = sum(round(own.get(START, 0.0)) for _, own in effects)  # of two joints it is one of the same starts
    if numerics == len(NUMERICS) and drives.began_anywhere(plan.run):
        start += 1
    earlier = _turned_earlier(start % plan.settings.simulation.starts, plan.settings.simulation)
    driven = _driven_run(campaign, plan, mechanism, nuisances, faults, tolerance, earlier)
    change(driven.numbers)
    harmonic = driven.numbers.effects
    # phases of forces count from the record's time 0, that of the simulation is earlier
    harmonic.harmonic_phase += harmonic.harmonic_angular_frequency * (plan.samples.time[0] - driven.begin)
    return _read(campaign, plan, driven, faults, tolerance, perturbation, numerics == FAST)


def _turned_earlier(start: int, settings: SimulationSettings) -> float:
    """How much earlier [rad] the motion begins for another `start`, counted from 0, the usual one."""
    return math.fmod(start * settings.other_start_revolutions, settings.most_start_revolutions) * tau


def other_numerics(numerics: int) -> tuple[float, Callable[[Parameters], None]]:
    """Factor of the tolerance, and what changes the numbers of a simulation, for `numerics` of `channels_read`."""
    if numerics == 1:
        return 1.0, _threlfall
    return (0.1 if numerics == 2 else 1.0), lambda p: None


def _threlfall(p: Parameters) -> None:
    usual, other = FRICTION_LAWS["coulomb"], FRICTION_LAWS["threlfall"]
    for name in JOINTS:
        joint = getattr(p, name)
        if joint.friction_law == usual.code:
            joint.friction_law = other.code
            joint.friction_speed *= other.slope_at_zero / usual.slope_at_zero  # the same slope at zero speed


def _driven_run(
    campaign, plan, mechanism: Mechanism, values, faults: Faults, tolerance, earlier: float
) -> drives.DrivenRun:
    driven = _driven(campaign, plan, mechanism, values, faults, tolerance, earlier)
    effects = driven.numbers.effects
    if effects.table_over == 2:  # a load over time: that of the record, which begins later than the simulation
        if not plan.samples.timed:
            raise InputError("slider_force_table: a load over time needs the channel time; add it, or give its angle")
        effects.table_begin += driven.begin - plan.samples.time[0]
    return driven


def _driven(
    campaign, plan, mechanism: Mechanism, values, faults: Faults, tolerance, earlier: float
) -> drives.DrivenRun:
    settings = plan.settings.simulation
    if plan.measured is not None:
        return drives.measured_angle_run(mechanism, plan.samples, plan.measured, faults.offset, faults.lag, tolerance)
    offset = faults.offset - faults.lag * values.get("speed", plan.samples.speed)  # an encoder that lags reads less
    if campaign.drive == "motor":
        return drives.motor_run(
            mechanism, campaign, plan.run, plan.samples, values, offset, tolerance, settings, earlier
        )
    return drives.constant_speed_run(mechanism, plan.run, plan.samples, values, offset, tolerance, settings, earlier)


def _read(campaign, plan, driven, faults, tolerance, perturbation, fast: bool) -> dict[str, np.ndarray]:
    """What the sensors make of the motion at the samples."""
    channels = {name: campaign.channels[name] for name in plan.channels}
    late = driven.at(plan.samples.elapsed - faults.lag) if faults.lag and plan.measured is None else driven.angles
    if channels.keys() == {"crank_angle"}:
        return {"crank_angle": late + faults.offset}
    corners = [channel.bandwidth for channel in channels.values() if channel.bandwidth]
    grid, count = np.empty(0), driven.angles.size
    if corners or any(map(faults.need_grid, channels)):
        grid = _filter_times(plan, driven, corners)
    # the motion is simulated at the times that a late sensor reads: impacts stay as sharp as they are
    delays = list(dict.fromkeys([0.0, *map(faults.delay, channels)]))
    earlier = [driven.at(np.maximum(plan.samples.elapsed - delay, -driven.begin)) for delay in delays[1:]]
    angles = np.concatenate([driven.angles, *earlier, driven.at(grid)])
    change = _change_over_noise(campaign, plan, count, fast) if drives.began_anywhere(plan.run) else None
    true = channels_at(driven.numbers, angles, tolerance, perturbation, plan.settings.simulation, change, count, fast)
    elapsed = true["time"][:count] - driven.begin
    readings = {}
    for name, channel in channels.items():
        values = true[name]
        if name == "crank_angle":
            readings[name] = late + faults.offset
            continue
        if plan.run.direction == "clockwise" and name in sensors.MIRRORED:
            values = -values
        if channel.reads_gravity:
            values = values + sensors.gravity_read(name, campaign.mechanism.gravity_direction)
        values = faults.before_filter(name, values)
        delay = faults.delay(name)
        first, times = count * delays.index(delay), elapsed - delay
        read, fine = values[first : first + count], values[count * len(delays) :]
        if channel.bandwidth:
            fine = sensors.low_pass(fine, grid[1] - grid[0], channel.bandwidth, channel.filter == "causal")
            read = sensors.at_times(times, grid, fine)
        if faults.need_grid(name):
            # the lag's change is interpolated, not the reading: without a filter impacts stay as sharp as they are
            change = faults.over_time(name, fine, grid[1] - grid[0]) - fine
            read = read + sensors.at_times(times, grid, change)
        readings[name] = faults.after_filter(name, read)
    return readings


def _change_over_noise(
    campaign: Campaign, plan: RunPlan, count: int, fast: bool
) -> Callable[[Columns, Columns], float]:
    """Length of the change of what is read at `count` samples, over its noise, by those that are compared; if `fast`,
    over what a search need not see of each sample.

    Where the noise is not stated, it is taken for a share of what the channel varies by. Filters and faults are left
    out: they make it no larger.
    """
    stated, share = noise_of(campaign, plan.run.id), plan.settings.chaos.unstated_noise_share
    channels = [name for name in plan.channels if name != "crank_angle"]

    def change(one: Columns, other: Columns) -> float:
        squares = 0.0
        for name in channels:
            sd = stated.get(name) or share * float(np.std(other[name])) or 1e-300
            squares += float(np.mean(((one[name] - other[name]) / sd) ** 2))
        if fast:
            return math.sqrt(squares / len(channels)) / plan.settings.simulation.fast_settled
        return math.sqrt(count * squares)

    return change


def _filter_times(plan: RunPlan, driven: drives.DrivenRun, corners: list[float]) -> np.ndarray:
    settings, revolution = plan.settings.sensors, tau / plan.samples.speed
    padding = settings.padding_revolutions * revolution
    after = 0.0 if plan.measured is not None else padding  # a measured angle ends with the record
    first, last = -min(padding, driven.begin), plan.samples.elapsed[-1] + after
    return sensors.filter_times(first, last, revolution, corners, settings)
