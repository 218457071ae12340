"""Which channels of a run are chaotic, and what many simulated cycles make of them."""

import math
import warnings
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import tau

import numpy as np

from jointgap.config import Mechanism
from jointgap.config.campaign_file import Campaign
from jointgap.dynamics.parallel_runs import cores
from jointgap.dynamics.solver.initial_state import perturbed_start
from jointgap.identification.protocol import Effects
from jointgap.slider_crank.cycle_statistics import CycleStatistics, cycle_variance, persistence
from jointgap.slider_crank.run_simulation import RunPlan, channels_read

# fractions of multiples of the golden and the plastic ratio: they spread starts evenly, however many there are
_SPREADING = np.array([0.6180339887, 0.7548776662, 0.5698402910])


@dataclass(frozen=True)
class ChaoticRun:
    """What stands for the samples of chaotic channels of one run."""

    plan: RunPlan  # Of one member of the simulated ensemble
    statistics: CycleStatistics
    variance: np.ndarray  # Of statistics from cycle to cycle [SI^2], sampled as the record is
    persistence: np.ndarray
    members: int  # Simulations of an evaluation
    error: np.ndarray  # Standard error of what an evaluation simulates [SI]
    noise: Mapping[str, float]  # Of the samples, by channel [SI]; it is added to what is simulated


def chaotic_channels(
    campaign: Campaign, plan: RunPlan, values: Mapping[str, float], noise: Mapping[str, float | None]
) -> tuple[str, ...]:
    """Channels in which two simulations from starts that hardly differ come out farther apart than noise would hide."""
    if not campaign.mechanism.applied().loose:
        return ()
    settings, chaotic = plan.settings.chaos, []
    start = _start(campaign.mechanism, np.full(3, settings.start_distance_m), np.zeros(3))
    first = channels_read(campaign, plan, values)
    second = channels_read(campaign, plan, values, perturbation=start)
    for channel in plan.channels:
        sd = noise.get(channel) or settings.unstated_noise_share * float(np.std(first[channel]))
        departure = np.sqrt(np.mean((first[channel] - second[channel]) ** 2))
        if channel != "crank_angle" and departure > settings.max_departure_share_of_noise * sd:
            chaotic.append(channel)
    return tuple(chaotic)


def _start(mechanism: Mechanism, distance: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Start with clearance vectors of `distance` (3,) [m] and `direction` (3,) [rad], in the order of `JOINTS`."""
    vectors = np.column_stack([distance * np.cos(direction), distance * np.sin(direction)]).ravel()
    return perturbed_start(vectors, mechanism.applied().loose)


def chaotic_run(
    campaign: Campaign,
    plan: RunPlan,
    channels: tuple[str, ...],
    values: Mapping[str, float],
    measured: Mapping[str, np.ndarray],
    noise: Mapping[str, float | None],
) -> ChaoticRun:
    """Learn the statistics of a run's chaotic channels from its model as it stands."""
    settings, bins = plan.settings.chaos, plan.settings.statistics.bins
    recorded = max(int(plan.samples.turned / tau) - settings.settling_cycles, 1)
    # a measured angle ends with the record; a crank that turns by itself goes on
    cycles = settings.cycles_per_simulation
    cycles = cycles if plan.measured is None else min(cycles, recorded)
    coarser = replace(plan.settings, simulation=replace(plan.settings.simulation, tolerance_m=settings.tolerance_m))
    finer = math.ceil(settings.samples_per_revolution * plan.samples.turned / tau / plan.samples.angle.size)

    def of_length(cycles: int) -> RunPlan:
        turned = (cycles + settings.settling_cycles) * tau
        samples = plan.samples.extended(turned) if plan.measured is None else plan.samples
        return replace(plan, channels=channels, samples=samples.first(turned).refined(finer), settings=coarser)

    remembered = max(min(recorded, settings.remembered_cycles), cycles)
    many, members = math.ceil(settings.learning_cycles / remembered), math.ceil(settings.cycles / cycles)
    angle, read = _ensemble(campaign, of_length(remembered), values, (), 0, many)
    clean = CycleStatistics.of(channels, angle, list(read.values()), finer, plan.settings.statistics)
    sds = {channel: noise.get(channel) for channel in channels}
    if any(np.isfinite(measured[channel]).any() for channel in channels):
        excess = clean.noise(
            plan.samples.angle, [measured[channel] for channel in channels], angle, list(read.values())
        )
        sds = {channel: excess[i] if sds[channel] is None else sds[channel] for i, channel in enumerate(channels)}
    sds = {channel: sd or 0.0 for channel, sd in sds.items()}
    noisy = [_noisy(read[channel], sds[channel], place) for place, channel in enumerate(channels)]
    learnt = CycleStatistics.of(channels, angle, noisy, finer, plan.settings.statistics)
    rows = learnt.independent(learnt.cycles(angle[::finer], [values[::finer] for values in noisy]))
    dense = learnt.independent(learnt.cycles(angle, noisy))
    error = np.sqrt(persistence(dense, cycles, bins) * cycle_variance(dense) / (members * cycles))
    persistent = persistence(rows, len(rows) // many, bins)
    return ChaoticRun(of_length(cycles), learnt, cycle_variance(rows), persistent, members, error, sds)


def measured_statistics(
    chaotic: ChaoticRun, angle: np.ndarray, measured: Mapping[str, np.ndarray]
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Statistics of what was measured and their standard errors, those of the simulated ones included."""
    own, settings = chaotic.statistics, chaotic.plan.settings.chaos
    rows = own.independent(own.cycles(angle, [measured[channel] for channel in own.channels]))
    cycles = np.isfinite(rows).sum(axis=0)
    count = np.maximum(cycles, 1)
    if not len(rows):  # yet to be measured
        count[:] = max(round(float(np.ptp(angle)) / tau), 1)
    simulated, several = chaotic.variance, cycles >= settings.min_scatter_cycles
    variance = simulated.copy()
    if several.any():
        # few cycles tell their own scatter badly: mostly its ratio to the simulated one over all bins counts
        ratio = cycle_variance(rows[:, several]) / simulated[several]
        weight = count[several] / (count[several] + settings.prior_cycles)
        variance[several] *= weight * ratio + (1.0 - weight) * np.median(ratio)
    error = np.sqrt(chaotic.persistence * variance / count + chaotic.error**2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a bin without samples
        mean = np.nanmean(rows, axis=0)
    values, errors = own.split(mean), own.split(error)
    return {name: (values[name], errors[name]) for name in values}


def simulated_statistics(
    campaign: Campaign, chaotic: ChaoticRun, values: Mapping[str, float], effects: Effects, numerics: int
) -> dict[str, np.ndarray]:
    """Statistics (bins,) [SI] of the chaotic channels, by the name of their series: the same for the same arguments."""
    angle, read = _ensemble(campaign, chaotic.plan, values, effects, numerics, chaotic.members)
    own = chaotic.statistics
    noisy = [_noisy(read[channel], chaotic.noise[channel], place) for place, channel in enumerate(own.channels)]
    return own.split(np.nanmean(own.independent(own.cycles(angle, noisy)), axis=0))


def _noisy(values: np.ndarray, sd: float, seed: int) -> np.ndarray:
    return values + sd * np.random.default_rng(seed).standard_normal(values.size) if sd else values


def _ensemble(campaign, plan, values, effects, numerics, count) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Crank angles, and what is read there, of `count` simulations from spread starts, one behind the other.

    Between members whole revolutions are left out, so that cycles stay whole.
    """
    spread = np.mod((np.arange(count)[:, None] + 0.5) * _SPREADING, 1.0)
    mechanism = campaign.mechanism.applied()
    clearances = (
        min(values.get(f"{joint}_clearance", np.inf), mechanism.clearance(joint)) for joint in mechanism.loose
    )
    radius = 0.5 * min(clearances)

    def member(place: int) -> dict[str, np.ndarray]:
        # the square root spreads starts evenly over the disc
        start = _start(campaign.mechanism, radius * np.sqrt(spread[place]), tau * spread[place][::-1])
        return channels_read(campaign, plan, values, effects, numerics, start)

    with ThreadPoolExecutor(min(cores(), count)) as pool:
        members = list(pool.map(member, range(count)))
    own = plan.samples.angle
    settled = own >= own[0] + plan.settings.chaos.settling_cycles * tau
    turns = math.ceil(plan.samples.turned / tau) + 1
    angle = np.concatenate([own[settled] + place * turns * tau for place in range(count)])
    return angle, {channel: np.concatenate([read[channel][settled] for read in members]) for channel in plan.channels}
