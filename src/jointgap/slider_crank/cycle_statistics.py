"""Chaotic runs: statistics over the crank angle's cycles in place of samples.

Frictionless impacts amplify differences, so that no simulation follows a test rig for more than a few revolutions. What
is compared then are means over cycles, in bins of the crank angle, of two functions of a channel's deviation from its
median course: the deviation itself, and its size. Deviations u are compressed, k tanh(u / k), for rare spikes would
otherwise hold nearly all of a mean's scatter. Neighbouring bins and channels scatter together; each statistic is
therefore compared with what a linear prediction from a few others (the bins before it, the same bins and their
neighbours of the channels before) lets expect, so that what is left is independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import tau

import numpy as np

from jointgap.slider_crank.settings import DEFAULT_SETTINGS, CycleStatisticsSettings

KINDS = ("mean", "spread")


@dataclass(frozen=True)
class CycleStatistics:
    """Statistics of the channels of one run.

    A row of statistics, shape (m,), holds the bins of the first channel's mean, of its spread, of the second channel's
    mean, and so on.
    """

    channels: tuple[str, ...]
    angles: np.ndarray  # Crank angles of the median course, growing over somewhat more than a revolution [rad]
    median_curves: np.ndarray  # Median course of each channel [SI]
    compression: np.ndarray  # k [SI]
    weights: list[tuple[np.ndarray, np.ndarray]]  # For every statistic, which others predict it and how
    settings: CycleStatisticsSettings = DEFAULT_SETTINGS.statistics

    @classmethod
    def of(
        cls,
        channels: Sequence[str],
        angle: np.ndarray,
        values: Sequence[np.ndarray],
        finer: int = 1,
        settings: CycleStatisticsSettings = DEFAULT_SETTINGS.statistics,
    ) -> "CycleStatistics":
        """Learnt from many simulated cycles."""
        within = _within_revolution(angle, settings)
        count = settings.median_angles
        fine = np.minimum((within * (count / tau)).astype(int), count - 1)
        # a bin's medians belong to its samples' angle: where these keep to a few angles, that is not its middle
        angles, *median_curves = (
            np.array([np.median(value[fine == place]) for place in np.unique(fine)]) for value in (within, *values)
        )
        angles = np.concatenate([[angles[-1] - tau], angles, [angles[0] + tau]])
        median_curves = np.array([np.concatenate([medians[-1:], medians, medians[:1]]) for medians in median_curves])
        learnt = cls(tuple(channels), angles, median_curves, np.ones(len(channels)), [], settings)
        sizes = [np.abs(value - median) for value, median in zip(values, learnt._medians(angle), strict=True)]
        compression = np.array([max(settings.compression_mean_sizes * float(np.mean(size)), 1e-300) for size in sizes])
        learnt = replace(learnt, compression=compression)
        rows = learnt.cycles(angle[::finer], [value[::finer] for value in values])
        return replace(learnt, weights=_predictions(rows, len(channels), settings))

    def _medians(self, angle: np.ndarray) -> list[np.ndarray]:
        return [np.interp(_within_revolution(angle, self.settings), self.angles, curve) for curve in self.median_curves]

    def cycles(self, angle: np.ndarray, values: Sequence[np.ndarray]) -> np.ndarray:
        """Statistics of every cycle, shape (cycles, m); NaN where a bin has no sample."""
        bins = self.settings.bins
        first = np.floor(np.min(angle) / tau)
        place = np.floor((angle / tau - first) * bins + self.settings.edge_share_of_bin).astype(int)
        count = int(place.max()) // bins + 1
        rows = np.full((count, len(self.channels), len(KINDS), bins), np.nan)
        for i, (value, median, k) in enumerate(zip(values, self._medians(angle), self.compression, strict=True)):
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
        """Statistics `rows` (..., m) less what those before them let expect, of the same shape."""
        independent = rows.copy()
        for place, (others, weights) in enumerate(self.weights):
            if others.size:
                independent[..., place] = rows[..., place] - rows[..., others] @ weights
        return independent

    def noise(
        self,
        angle: np.ndarray,
        measured: Sequence[np.ndarray],
        simulated_angle: np.ndarray,
        simulated: Sequence[np.ndarray],
    ) -> np.ndarray:
        """Standard deviation (channels,) [SI] of noise: what measured channels spread beyond noise-free simulated ones.

        Bins count by how well they tell, so that the quiet ones do.
        """
        squares, variances = [], []
        for angles, values in ((angle, measured), (simulated_angle, simulated)):
            rows = self.cycles(angles, values).reshape(-1, len(self.channels), len(KINDS), self.settings.bins)[:, :, 1]
            mean = np.nanmean(rows, axis=0)
            squares.append(mean**2)
            variances.append(4.0 * mean**2 * cycle_variance(rows) / np.isfinite(rows).sum(axis=0))
        weight = 1.0 / (variances[0] + variances[1])
        excess = np.sum(weight * (squares[0] - squares[1]), axis=1) / np.sum(weight, axis=1)
        return np.sqrt(np.maximum(excess, 0.0) * (np.pi / 2.0))  # of a normal number's mean size

    def split(self, row: np.ndarray) -> dict[str, np.ndarray]:
        """Statistics `row` (m,) by the name of their series, (bins,) each."""
        parts = row.reshape(len(self.channels), len(KINDS), self.settings.bins)
        return {
            f"{channel} {kind}": parts[i, k] for i, channel in enumerate(self.channels) for k, kind in enumerate(KINDS)
        }


def _within_revolution(angle: np.ndarray, settings: CycleStatisticsSettings) -> np.ndarray:
    """Crank angles within a revolution [rad]; those on its edge begin one, whichever way they were rounded."""
    return np.mod(angle + settings.edge_share_of_bin * tau / settings.bins, tau)


def _predictions(
    rows: np.ndarray, channels: int, settings: CycleStatisticsSettings
) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each statistic the least-squares weights of those that may predict it."""
    bins = settings.bins
    places = np.arange(rows.shape[1]).reshape(channels, len(KINDS), bins)
    centred = rows - np.nanmean(rows, axis=0)
    sizes = np.maximum(np.nanstd(rows, axis=0), 1e-300)
    centred = np.nan_to_num(centred / sizes)
    predictions = []
    for i, kind, place in np.ndindex(places.shape):
        others = [places[i, kind, place - back] for back in range(1, settings.predicting_bins + 1) if place >= back]
        others += [places[j, kind, (place + near) % bins] for j in range(i) for near in (-1, 0, 1)]
        others += [places[i, 0, place]] if kind else []
        chosen, own = np.array(others, dtype=int), places[i, kind, place]
        weights = np.linalg.lstsq(centred[:, chosen], centred[:, own], rcond=1e-6)[0]
        predictions.append((chosen, weights * sizes[own] / sizes[chosen]))
    return predictions


def cycle_variance(rows: np.ndarray) -> np.ndarray:
    """Variance (m,) from cycle to cycle of statistics `rows` (cycles, m)."""
    return np.maximum(np.nanvar(rows, axis=0, ddof=1), 1e-300)


def persistence(rows: np.ndarray, block: int, bins: int = DEFAULT_SETTINGS.statistics.bins) -> np.ndarray:
    """How many times the variance of the mean of many cycles is what it would be if they were independent."""
    blocks = np.nanmean(rows[: len(rows) // block * block].reshape(-1, block, rows.shape[1]), axis=1)
    ratio = block * np.nanvar(blocks, axis=0, ddof=1) / cycle_variance(rows)
    return np.repeat(np.maximum(np.nanmean(ratio.reshape(-1, bins), axis=1), 1.0), bins)
