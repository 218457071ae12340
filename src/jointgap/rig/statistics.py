"""Statistics of non-periodic motion."""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import tau

import numpy as np

from jointgap.config.campaign import Campaign
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.candidates import Effects
from jointgap.core.joints import JOINTS
from jointgap.motion.of_file import Vectors
from jointgap.motion.parallel import cores
from jointgap.rig.drives import RunPlan, Values
from jointgap.rig.simulate_run import UNSTATED_NOISE_SHARE, channels_read

Columns = Sequence[np.ndarray]  # Values (n,) [SI] of each channel

BINS = 24  # Of the crank angle: 15 deg, about the duration of contact ringing (experience)
MEDIAN_ANGLES = 144  # Of the median curve: six in a bin
# [1, mean absolute deviations] Scale k of k tanh(u / k), which limits rare spikes
COMPRESSION_MEAN_SIZES = 3.0
PREDICTING_BINS = 2  # Previous bins that predict one: duration of contact ringing (experience)
EDGE_SHARE_OF_BIN = 1e-6  # Nearer to an edge a sample counts for the bin that begins there
# [m] Between the two starts whose motions are compared: far below any clearance
START_DISTANCE = 1e-7
# [1] Largest difference of the two motions, over the noise, for a comparison by samples; it adds 4
# % to the standard deviation
MAX_DEPARTURE_SHARE_OF_NOISE = 0.3
# [m] Local error of a step: statistics do not depend on it from 1e-11 to 1e-7
STATISTICS_TOLERANCE = 1e-9
CYCLES = 18  # Simulated in every evaluation
LEARNING_CYCLES = 180  # Simulated once to estimate variances within 10 % (experience)
CYCLES_PER_SIMULATION = 9  # Several short simulations run in parallel
SETTLING_CYCLES = 1  # Additional, not counted
# Of one learning simulation: slow changes increase the variance of a record's mean
REMEMBERED_CYCLES = 30
SAMPLES_PER_REVOLUTION = 320  # Least number of simulated samples
PRIOR_CYCLES = 60  # Weight of the simulated variance in measured cycles (experience)
MIN_SCATTER_CYCLES = 3  # Least number of measured cycles for their own variance

KINDS = ("mean", "spread")


@dataclass(frozen=True)
class CycleStatistics:
    """Statistics of the channels of one run.

    A row of statistics (m,) contains the bins of the first channel's mean, of its spread, of the
    second channel's mean, and so on.
    """

    channels: tuple[str, ...]
    angles: np.ndarray  # Crank angles of the median curves, slightly more than a revolution [rad]
    median_curves: np.ndarray  # For each channel [SI]
    compression: np.ndarray  # k [SI]
    # For each statistic: predicting statistics and weights
    weights: list[tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(
        cls,
        channels: Sequence[str],
        angle: np.ndarray,
        values: Sequence[np.ndarray],
        finer: int = 1,
    ) -> "CycleStatistics":
        """Estimated from many simulated cycles."""
        within = _within_revolution(angle)
        fine = np.minimum((within * (MEDIAN_ANGLES / tau)).astype(int), MEDIAN_ANGLES - 1)
        # a bin's median belongs to the median angle of its samples, not to its middle
        angles, *median_curves = (
            np.array([np.median(value[fine == place]) for place in np.unique(fine)])
            for value in (within, *values)
        )
        angles = np.concatenate([[angles[-1] - tau], angles, [angles[0] + tau]])
        median_curves = np.array(
            [np.concatenate([medians[-1:], medians, medians[:1]]) for medians in median_curves]
        )
        learnt = cls(tuple(channels), angles, median_curves, np.ones(len(channels)), [])
        sizes = [
            np.abs(value - median)
            for value, median in zip(values, learnt._medians(angle), strict=True)
        ]
        compression = np.array(
            [max(COMPRESSION_MEAN_SIZES * np.mean(size), 1e-300) for size in sizes]
        )
        learnt = replace(learnt, compression=compression)
        rows = learnt.cycles(angle[::finer], [value[::finer] for value in values])
        return replace(learnt, weights=_predictions(rows, len(channels)))

    def _medians(self, angle: np.ndarray) -> list[np.ndarray]:
        return [
            np.interp(_within_revolution(angle), self.angles, curve) for curve in self.median_curves
        ]

    def cycles(self, angle: np.ndarray, values: Sequence[np.ndarray]) -> np.ndarray:
        """Statistics of every cycle (cycles, m); NaN for a bin without samples."""
        first_turn = np.floor(np.min(angle) / tau)
        bins = BINS
        place = np.floor((angle / tau - first_turn) * bins + EDGE_SHARE_OF_BIN).astype(int)
        count = place.max() // bins + 1
        rows = np.full((count, len(self.channels), len(KINDS), bins), np.nan)
        for i, (value, median, k) in enumerate(
            zip(values, self._medians(angle), self.compression, strict=True)
        ):
            used = np.isfinite(value)
            compressed = k * np.tanh((value[used] - median[used]) / k)
            number = np.bincount(place[used], minlength=count * bins)
            with np.errstate(invalid="ignore"):
                for kind, deviation in enumerate((compressed, np.abs(compressed))):
                    sums = np.bincount(place[used], deviation, minlength=count * bins)
                    rows[:, i, kind, :] = (sums / number).reshape(count, bins)
        rows = rows.reshape(count, -1)
        return rows[np.isfinite(rows).any(axis=1)]

    def independent(self, rows: np.ndarray) -> np.ndarray:
        """Statistics `rows` (..., m) minus their prediction from others, of the same shape."""
        independent = rows.copy()
        for place, (predictors, weights) in enumerate(self.weights):
            if predictors.size:
                independent[..., place] = rows[..., place] - rows[..., predictors] @ weights
        return independent

    def noise(
        self, angle: np.ndarray, measured: Columns, simulated_angle: np.ndarray, simulated: Columns
    ) -> np.ndarray:
        """Standard deviation (channels,) [SI] of noise: excess spread of measured over noise-free
        simulated channels, averaged over bins by inverse variance.
        """
        clean, rows = (
            self.cycles(angles, values).reshape(-1, len(self.channels), len(KINDS), BINS)[:, :, 1]
            for angles, values in ((simulated_angle, simulated), (angle, measured))
        )
        cycles, simulated_cycles = (
            np.isfinite(statistics).sum(axis=0) for statistics in (rows, clean)
        )
        square = np.nan_to_num(cycle_mean(rows)) ** 2
        simulated_square = cycle_mean(clean) ** 2
        variance = simulated_square * cycle_variance(clean)
        # few scatter as simulated ones
        several, scatter = (cycles >= MIN_SCATTER_CYCLES, variance.copy())
        scatter[several] = square[several] * cycle_variance(rows[:, several])
        weight = (cycles > 0) / (variance / simulated_cycles + scatter / np.maximum(cycles, 1))
        excess = np.sum(weight * (square - simulated_square), axis=1) / np.maximum(
            np.sum(weight, axis=1), 1e-300
        )
        # from mean absolute to standard deviation
        return np.sqrt(np.maximum(excess, 0.0) * (np.pi / 2.0))

    def split(self, row: np.ndarray) -> dict[str, np.ndarray]:
        """Statistics `row` (m,) by the name of their series, (bins,) each."""
        names = (f"{channel} {kind}" for channel in self.channels for kind in KINDS)
        return dict(zip(names, row.reshape(-1, BINS), strict=True))


def _within_revolution(angle: np.ndarray) -> np.ndarray:
    """Crank angles within a revolution [rad], tolerant of rounding at its begin."""
    return np.mod(angle + EDGE_SHARE_OF_BIN * tau / BINS, tau)


def _predictions(rows: np.ndarray, channels: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Least-squares weights of the predicting statistics, for each statistic."""
    places = np.arange(rows.shape[1]).reshape(channels, len(KINDS), BINS)
    centred = rows - cycle_mean(rows)
    sizes = np.maximum(np.nanstd(rows, axis=0), 1e-300)
    centred = np.nan_to_num(centred / sizes)
    predictions = []
    for i, kind, place in np.ndindex(places.shape):
        predictors = [
            places[i, kind, place - back] for back in range(1, PREDICTING_BINS + 1) if place >= back
        ]
        predictors += [
            places[j, kind, (place + near) % BINS] for j in range(i) for near in (-1, 0, 1)
        ]
        predictors += [places[i, 0, place]] if kind else []
        places_used = np.array(predictors, dtype=int)
        target = places[i, kind, place]
        weights = np.linalg.lstsq(centred[:, places_used], centred[:, target], rcond=1e-6)[0]
        predictions.append((places_used, weights * sizes[target] / sizes[places_used]))
    return predictions


def cycle_mean(rows: np.ndarray, axis: int = 0) -> np.ndarray:
    """Mean of statistics over cycles; NaN for a bin without samples."""
    with np.errstate(invalid="ignore"):
        return np.nansum(rows, axis) / np.isfinite(rows).sum(axis)


def cycle_variance(rows: np.ndarray) -> np.ndarray:
    """Variance (m,) from cycle to cycle of statistics `rows` (cycles, m); NaN for a bin of less
    than two cycles."""
    free = np.isfinite(rows).sum(axis=0) - 1.0
    squares = np.nansum((rows - cycle_mean(rows)) ** 2, axis=0)
    return np.maximum(squares / np.where(free > 0.0, free, np.nan), 1e-300)


def persistence(rows: np.ndarray, block: int) -> np.ndarray:
    """Variance of the mean of many cycles over that of independent cycles."""
    blocks = cycle_mean(
        rows[: len(rows) // block * block].reshape(-1, block, rows.shape[1]), axis=1
    )
    ratio = block * cycle_variance(blocks) / cycle_variance(rows)
    return np.repeat(np.fmax(cycle_mean(ratio.reshape(-1, BINS), axis=1), 1.0), BINS)


# quasi-random sequence: multiples of the golden and the plastic ratio, then of roots of primes
_SPREADING = np.array(
    [0.6180339887, 0.7548776662, 0.5698402910, *np.sqrt([2, 3, 5, 7, 11, 13, 17, 19, 23]) % 1.0]
)


@dataclass(frozen=True)
class ChaoticRun:
    """Statistics that replace the samples of the chaotic channels of a run."""

    plan: RunPlan  # Of one member of the simulated ensemble
    statistics: CycleStatistics
    variance: np.ndarray  # Of statistics from cycle to cycle [SI^2], at the samples of the record
    persistence: np.ndarray
    members: int  # Simulations of an evaluation
    error: np.ndarray  # Standard error of simulated statistics [SI]
    noise: Mapping[str, float]  # Of the samples, by channel [SI]; added to simulated channels


def chaotic_channels(
    campaign: Campaign, plan: RunPlan, values: Values, noise: Mapping[str, float | None]
) -> tuple[str, ...]:
    """Channels in which two simulations from nearly equal starts differ significantly compared with
    noise."""
    if not campaign.mechanism.applied().loose or campaign.drive == "free":  # no cycles repeat
        return ()
    count = len(_start_joints(campaign))
    start = _start(campaign, np.full(count, START_DISTANCE), np.zeros(count))
    nominal, perturbed = (
        channels_read(campaign, plan, values, perturbation=perturbation)
        for perturbation in (None, start)
    )

    def is_chaotic(channel: str) -> bool:
        sd = noise.get(channel) or UNSTATED_NOISE_SHARE * np.std(nominal[channel])
        departure = np.sqrt(np.mean((nominal[channel] - perturbed[channel]) ** 2))
        return channel != "crank_angle" and departure > MAX_DEPARTURE_SHARE_OF_NOISE * sd

    return tuple(filter(is_chaotic, plan.channels))


def _start_joints(campaign: Campaign) -> tuple[str, ...]:
    """Joints in whose clearances starts are distributed: loose ones, of a slider-crank with places
    for the others."""
    mechanism = campaign.mechanism
    return mechanism.loose if isinstance(mechanism, LinkageFile) else JOINTS


def _start(campaign: Campaign, distance: np.ndarray, direction: np.ndarray) -> Vectors:
    """Start with clearance vectors of `distance` (n,) [m] and `direction` (n,) [rad], in the order
    of `_start_joints`."""
    vectors = np.column_stack([distance * np.cos(direction), distance * np.sin(direction)])
    named = zip(_start_joints(campaign), vectors, strict=True)
    loose = campaign.mechanism.applied().loose
    return {name: vector for name, vector in named if name in loose}


def chaotic_run(
    campaign: Campaign,
    plan: RunPlan,
    channels: tuple[str, ...],
    values: Values,
    measured: Mapping,
    noise: Mapping,
) -> ChaoticRun:
    """Estimate the statistics of a run's chaotic channels from the current model."""
    recorded = max(int(plan.samples.turned / tau) - SETTLING_CYCLES, 1)
    # a measured angle ends with the record
    cycles = (
        CYCLES_PER_SIMULATION if plan.measured is None else min(CYCLES_PER_SIMULATION, recorded)
    )
    finer = math.ceil(SAMPLES_PER_REVOLUTION * plan.samples.turned / tau / plan.samples.angle.size)

    def of_length(cycles: int) -> RunPlan:
        turned = (cycles + SETTLING_CYCLES) * tau
        samples = plan.samples.extended(turned) if plan.measured is None else plan.samples
        samples = samples.first(turned).refined(finer)
        return replace(plan, channels=channels, samples=samples, tolerance=STATISTICS_TOLERANCE)

    remembered = max(min(recorded, REMEMBERED_CYCLES), cycles)
    many = math.ceil(LEARNING_CYCLES / remembered)
    members = math.ceil(CYCLES / cycles)
    angle, read = _ensemble(campaign, of_length(remembered), values, (), 0, many)
    clean = list(read.values())
    seen = [measured[channel] for channel in channels]
    excess = np.zeros(len(channels))
    if any(np.isfinite(value).any() for value in seen):
        excess = CycleStatistics.of(channels, angle, clean, finer).noise(
            plan.samples.angle, seen, angle, clean
        )
    sds = {
        channel: excess[i] if noise.get(channel) is None else noise[channel]
        for i, channel in enumerate(channels)
    }
    noisy = [_noisy(read[channel], sds[channel], place) for place, channel in enumerate(channels)]
    learnt = CycleStatistics.of(channels, angle, noisy, finer)
    rows = learnt.independent(learnt.cycles(angle[::finer], [values[::finer] for values in noisy]))
    dense = learnt.independent(learnt.cycles(angle, noisy))
    error = np.sqrt(persistence(dense, cycles) * cycle_variance(dense) / (members * cycles))
    persistent = persistence(rows, len(rows) // many)
    variance = cycle_variance(rows)
    # bins that the samples hardly fill
    variance = np.where(np.isfinite(variance), variance, cycle_variance(dense))
    return ChaoticRun(of_length(cycles), learnt, variance, persistent, members, error, sds)


def measured_statistics(
    chaotic: ChaoticRun, angle: np.ndarray, measured: Mapping[str, np.ndarray]
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Measured statistics and their standard errors, including those of the simulation."""
    statistics = chaotic.statistics
    rows = statistics.independent(
        statistics.cycles(angle, [measured[channel] for channel in statistics.channels])
    )
    cycles = np.isfinite(rows).sum(axis=0)
    count = np.maximum(cycles, 1)
    if not len(rows):  # planned
        count[:] = max(round(np.ptp(angle) / tau), 1)
    simulated = chaotic.variance
    several = cycles >= MIN_SCATTER_CYCLES
    variance = simulated.copy()
    if several.any():
        # the variance of few cycles is uncertain: combine it with the median ratio to the simulated
        # one
        ratio = cycle_variance(rows[:, several]) / simulated[several]
        weight = count[several] / (count[several] + PRIOR_CYCLES)
        variance[several] *= weight * ratio + (1.0 - weight) * np.median(ratio)
    error = np.sqrt(chaotic.persistence * variance / count + chaotic.error**2)
    values = statistics.split(cycle_mean(rows))
    errors = statistics.split(error)
    return {name: (values[name], errors[name]) for name in values}


def simulated_statistics(
    campaign: Campaign, chaotic: ChaoticRun, values: Values, effects: Effects, numerics: int
) -> dict[str, np.ndarray]:
    """Statistics (bins,) [SI] of the chaotic channels by series name; deterministic."""
    angle, read = _ensemble(campaign, chaotic.plan, values, effects, numerics, chaotic.members)
    statistics = chaotic.statistics
    noisy = [
        _noisy(read[channel], chaotic.noise[channel], place)
        for place, channel in enumerate(statistics.channels)
    ]
    return statistics.split(cycle_mean(statistics.independent(statistics.cycles(angle, noisy))))


def _noisy(values: np.ndarray, sd: float, seed: int) -> np.ndarray:
    return values + sd * np.random.default_rng(seed).standard_normal(values.size) if sd else values


def _ensemble(
    campaign, plan, values, effects, numerics, count
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Crank angles and readings of `count` simulations from distributed starts, concatenated with a
    distance of full revolutions.
    """
    spread = np.mod(
        (np.arange(count)[:, None] + 0.5) * _SPREADING[: len(_start_joints(campaign))], 1.0
    )
    mechanism = campaign.mechanism.applied()
    radius = 0.5 * min(
        min(values.get(f"{joint}_clearance", np.inf), mechanism.clearance(joint))
        for joint in mechanism.loose
    )

    def member(place: int) -> dict[str, np.ndarray]:
        # the square root distributes starts uniformly over the disc
        start = _start(campaign, radius * np.sqrt(spread[place]), tau * spread[place][::-1])
        return channels_read(campaign, plan, values, effects, numerics, start)

    with ThreadPoolExecutor(min(cores(), count)) as pool:
        members = list(pool.map(member, range(count)))
    crank_angle = plan.samples.angle
    settled = crank_angle >= crank_angle[0] + SETTLING_CYCLES * tau
    turns = math.ceil(plan.samples.turned / tau) + 1
    angle = np.concatenate([crank_angle[settled] + place * turns * tau for place in range(count)])
    return angle, {
        channel: np.concatenate([read[channel][settled] for read in members])
        for channel in plan.channels
    }
