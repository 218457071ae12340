"""Which channels of a run are chaotic, and what many simulated cycles make of them."""

import math
import warnings
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from jointgap.config import Mechanism
from jointgap.config.campaign_file import Campaign
from jointgap.dynamics.parallel_runs import cores
from jointgap.dynamics.solver.initial_state import perturbed_start
from jointgap.identification.protocol import Effects
from jointgap.slider_crank.cycle_statistics import CycleStatistics, cycle_variance, persistence
from jointgap.slider_crank.run_simulation import RunPlan, channels_read
from jointgap.slider_crank.sample_grid import TURN, SampleGrid

_NEARBY = 1e-7  # [m] between two starts
_APART = 0.3  # of the noise: what they may differ by for samples to be compared
_NOISE = 0.02  # of a channel's standard deviation where the noise is not stated
_CYCLES, _LEARNT = 18, 180  # simulated every time, and once to learn how statistics scatter
_CYCLES_OF_ONE, _SETTLING = 9, 1  # cycles of one simulation, and those that it drops besides
_REMEMBERED = (
    30  # cycles of one simulation to learn from: slow changes make a record's mean less sure than its cycles' scatter
)
_DENSE = 320  # samples of a simulated revolution, at least: what lies between the record's makes a mean surer
_PRIOR = 60  # cycles that the simulated scatter counts for


@dataclass(frozen=True)
class ChaoticRun:
    """What stands for the samples of chaotic channels of one run.

    Attributes
    ----------
    plan : RunPlan
        Of one member of the simulated ensemble.
    statistics : CycleStatistics
    members : int
        Simulations of an evaluation.
    variance : (m,) array
        Of statistics from cycle to cycle, sampled as the record is.
    persistence : (m,) array
        How many times the variance of their mean is what it would be if cycles were independent.
    error : (m,) array
        Standard error of what an evaluation simulates.
    noise : mapping of str to float
        Of the samples, by channel; it is added to what is simulated.
    """

    plan: RunPlan
    statistics: CycleStatistics
    variance: np.ndarray
    persistence: np.ndarray
    members: int
    error: np.ndarray
    noise: Mapping[str, float]


def chaotic_channels(
    campaign: Campaign, plan: RunPlan, values: Mapping[str, float], noise: Mapping[str, float | None]
) -> tuple[str, ...]:
    """Channels in which two simulations from starts 0.1 um apart come out farther apart than noise would hide."""
    if not campaign.mechanism.applied().loose:
        return ()
    one = channels_read(campaign, plan, values)
    other = channels_read(
        campaign, plan, values, perturbation=_start(campaign.mechanism, np.full(3, _NEARBY), np.zeros(3))
    )
    found = []
    for channel in plan.channels:
        known = noise.get(channel) or _NOISE * float(np.std(one[channel]))
        if channel != "crank_angle" and np.sqrt(np.mean((one[channel] - other[channel]) ** 2)) > _APART * known:
            found.append(channel)
    return tuple(found)


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
    """Learn the statistics of a run's chaotic channels from its model as it stands.

    Parameters
    ----------
    campaign : Campaign
    plan : RunPlan
    channels : tuple of str
    values : mapping of str to float
        Nuisances by name.
    measured : mapping of channel to (n,) array
        NaN where nothing was measured.
    noise : mapping of channel to float or None
        As stated; where it is not, it is what the quietest bins have beyond the simulation.
    """
    recorded = max(int(plan.samples.turned / TURN) - _SETTLING, 1)
    # a measured angle ends with the record; a crank that turns by itself goes on
    cycles = _CYCLES_OF_ONE if plan.pieces is None else min(_CYCLES_OF_ONE, recorded)
    finer = math.ceil(_DENSE * plan.samples.turned / TURN / plan.samples.angle.size)

    def lasting(cycles: int) -> RunPlan:
        turned = (cycles + _SETTLING) * TURN
        samples = _lasting(plan.samples, turned) if plan.pieces is None else plan.samples
        return replace(plan, channels=channels, samples=_finer(samples.first(turned), finer))

    remembered = max(min(recorded, _REMEMBERED), cycles)
    many, members = math.ceil(_LEARNT / remembered), math.ceil(_CYCLES / cycles)
    angle, read = _members(campaign, lasting(remembered), values, (), 0, many)
    clean = CycleStatistics.of(channels, angle, list(read.values()), finer)
    known = {channel: noise.get(channel) for channel in channels}
    if any(np.isfinite(measured[channel]).any() for channel in channels):
        left = clean.noise(plan.samples.angle, [measured[channel] for channel in channels], angle, list(read.values()))
        known = {channel: left[i] if known[channel] is None else known[channel] for i, channel in enumerate(channels)}
    known = {channel: sd or 0.0 for channel, sd in known.items()}
    noisy = [_noisy(read[channel], known[channel], place) for place, channel in enumerate(channels)]
    learnt = CycleStatistics.of(channels, angle, noisy, finer)
    rows = learnt.independent(learnt.cycles(angle[::finer], [one[::finer] for one in noisy]))
    dense = learnt.independent(learnt.cycles(angle, noisy))
    error = np.sqrt(persistence(dense, cycles) * cycle_variance(dense) / (members * cycles))
    persistent = persistence(rows, len(rows) // many)
    return ChaoticRun(lasting(cycles), learnt, cycle_variance(rows), persistent, members, error, known)


def _lasting(samples: SampleGrid, turned: float) -> SampleGrid:
    """The record, going on evenly where it ends before the crank has `turned` [rad]."""
    count = samples.time.size
    more = max(math.ceil((turned / samples.turned - 1.0) * (count - 1)), 0)
    time, read, angle = (
        np.append(values, values[-1] + (values[-1] - values[0]) / (count - 1) * np.arange(1, more + 1))
        for values in (samples.time, samples.read, samples.angle)
    )
    return replace(samples, time=time, read=read, angle=angle)


def _finer(samples: SampleGrid, factor: int) -> SampleGrid:
    """The record with `factor` samples for each of its own: itself every `factor`-th."""
    own = np.arange(samples.time.size)
    at = np.arange((samples.time.size - 1) * factor + 1) / factor
    time, read, angle = (np.interp(at, own, values) for values in (samples.time, samples.read, samples.angle))
    return replace(samples, time=time, read=read, angle=angle)


def measured_statistics(
    chaotic: ChaoticRun, angle: np.ndarray, measured: Mapping[str, np.ndarray]
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Statistics of what was measured and their standard errors, those of the simulated ones included.

    Parameters
    ----------
    chaotic : ChaoticRun
    angle : (n,) array
        Crank angle of the samples [rad].
    measured : mapping of channel to (n,) array

    Returns
    -------
    dict of str to two (BINS,) arrays
        By the name of the series; NaN where there is nothing.
    """
    own = chaotic.statistics
    rows = own.cycles(angle, [measured[channel] for channel in own.channels])
    found = own.independent(rows)
    count = np.maximum(np.isfinite(found).sum(axis=0), 1)
    if not len(rows):  # yet to be measured
        count[:] = max(round(float(np.ptp(angle)) / TURN), 1)
    simulated, several = chaotic.variance, np.isfinite(found).sum(axis=0) >= 3
    variance = simulated.copy()
    if several.any():
        # few cycles tell their own scatter badly: its ratio to the simulated one, over all bins, and a bit of each bin's own
        ratio = cycle_variance(found[:, several]) / simulated[several]
        weight = count[several] / (count[several] + _PRIOR)
        variance[several] *= weight * ratio + (1.0 - weight) * np.median(ratio)
    error = np.sqrt(chaotic.persistence * variance / count + chaotic.error**2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a bin without samples
        mean = np.nanmean(found, axis=0)
    values, errors = own.split(mean), own.split(error)
    return {name: (values[name], errors[name]) for name in values}


def simulated_statistics(
    campaign: Campaign, chaotic: ChaoticRun, values: Mapping[str, float], effects: Effects, numerics: int
) -> dict[str, np.ndarray]:
    """Statistics of the chaotic channels, by the name of their series: the same for the same arguments."""
    angle, read = _members(campaign, chaotic.plan, values, effects, numerics, chaotic.members)
    own = chaotic.statistics
    values_ = [_noisy(read[channel], chaotic.noise[channel], place) for place, channel in enumerate(own.channels)]
    return own.split(np.nanmean(own.independent(own.cycles(angle, values_)), axis=0))


def _noisy(values: np.ndarray, sd: float, seed: int) -> np.ndarray:
    return values + sd * np.random.default_rng(seed).standard_normal(values.size) if sd else values


def _members(campaign, plan, values, effects, numerics, count) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Crank angles, and what is read there, of `count` simulations from starts spread over the clearances, one behind the other.

    Between members whole revolutions are left out, so that cycles stay whole.
    """
    # golden ratios spread the starts evenly, however many there are
    spread = np.mod((np.arange(count)[:, None] + 0.5) * np.array([0.6180339887, 0.7548776662, 0.5698402910]), 1.0)
    least = 0.5 * min(_clearance(campaign, values, joint) for joint in campaign.mechanism.applied().loose)

    def member(place: int) -> dict[str, np.ndarray]:
        start = _start(campaign.mechanism, least * np.sqrt(spread[place]), TURN * spread[place][::-1])
        return channels_read(campaign, plan, values, effects, numerics, start)

    with ThreadPoolExecutor(min(cores(), count)) as pool:
        found = list(pool.map(member, range(count)))
    settled = plan.samples.angle >= plan.samples.angle[0] + _SETTLING * TURN
    turns = math.ceil(plan.samples.turned / TURN) + 1
    angle = np.concatenate([plan.samples.angle[settled] + place * turns * TURN for place in range(count)])
    return angle, {channel: np.concatenate([one[channel][settled] for one in found]) for channel in plan.channels}


def _clearance(campaign: Campaign, values: Mapping[str, float], joint: str) -> float:
    return min(values.get(f"{joint}_clearance", np.inf), campaign.mechanism.applied().clearance(joint))
