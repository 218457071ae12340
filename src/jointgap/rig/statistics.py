"""Chaotic runs: statistics over the crank angle's cycles in place of samples.

Frictionless impacts amplify differences, so that no simulation follows a rig for more than a few revolutions. What is
compared then are means over cycles, in bins of the crank angle, of two functions of what a channel reads beside its usual
course: the deviation itself, and its size. Deviations are bent, k tanh(u / k), for rare spikes would otherwise hold nearly all of a
mean's scatter. Neighbouring bins and channels scatter together; each statistic is therefore compared with what a
linear prediction from a few that come before it (the same bin of the other channels, the bins before) lets expect, so that what is
left is independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

BINS = 24
KINDS = ("mean", "spread")
_FINE = 240  # angles of the usual course
_BENT = 3.0  # robust standard deviations
_BEFORE = 2  # bins that a prediction looks back
_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class CycleStatistics:
    """Statistics of the channels of one run.

    Attributes
    ----------
    channels : tuple of str
    course : (channels, 240) array
        Usual course of each channel over a revolution [unit].
    bend : (channels,) array
        k [unit].
    weights : list of (places, weights)
        For every statistic, which others predict it and how.
    """

    channels: tuple[str, ...]
    course: np.ndarray
    bend: np.ndarray
    weights: list[tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(cls, channels: Sequence[str], angle: np.ndarray, values: Sequence[np.ndarray]) -> "CycleStatistics":
        """Learnt from many simulated cycles.

        Parameters
        ----------
        channels : sequence of str
        angle : (n,) array
            [rad], running on.
        values : sequence of (n,) arrays
            By channel.
        """
        fine = (np.floor(angle / _TURN * _FINE).astype(int)) % _FINE
        course = np.array([[np.median(value[fine == place]) for place in range(_FINE)] for value in values])
        found = cls(tuple(channels), course, np.ones(len(channels)), [])
        away = [np.abs(value - one) for value, one in zip(values, found._usual(angle), strict=True)]
        bend = np.array(
            [
                max(_BENT * 1.4826 * float(np.median(one)), 1e-12 + 0.05 * float(np.std(value)))
                for one, value in zip(away, values, strict=True)
            ]
        )
        found = cls(tuple(channels), course, bend, [])
        return cls(tuple(channels), course, bend, _predictions(found.cycles(angle, values), len(channels)))

    def _usual(self, angle: np.ndarray) -> list[np.ndarray]:
        middles = (np.arange(-1, _FINE + 1) + 0.5) * (_TURN / _FINE)
        turned = np.mod(angle, _TURN)
        return [np.interp(turned, middles, np.append(np.append(one[-1], one), one[0])) for one in self.course]

    def cycles(self, angle: np.ndarray, values: Sequence[np.ndarray]) -> np.ndarray:
        """Statistics of every cycle, shape (cycles, channels * 2 * BINS); NaN where a bin has no sample."""
        first = np.floor(np.min(angle) / _TURN)
        place = np.floor((angle / _TURN - first) * BINS).astype(int)
        count = int(place.max()) // BINS + 1
        rows = np.full((count, len(self.channels), 2, BINS), np.nan)
        for i, (value, usual) in enumerate(zip(values, self._usual(angle), strict=True)):
            used = np.isfinite(value)
            bent = self.bend[i] * np.tanh((value[used] - usual[used]) / self.bend[i])
            at = place[used]
            number = np.bincount(at, minlength=count * BINS)
            with np.errstate(invalid="ignore"):
                for kind, deviation in enumerate((bent, np.abs(bent))):
                    sums = np.bincount(at, deviation, minlength=count * BINS)
                    rows[:, i, kind, :] = (sums / number).reshape(count, BINS)
        rows = rows.reshape(count, -1)
        return rows[np.isfinite(rows).any(axis=1)]

    def independent(self, rows: np.ndarray) -> np.ndarray:
        """Statistics less what those before them let expect, of one row or several, shape as `rows`."""
        found = rows.copy()
        for place, (others, weights) in enumerate(self.weights):
            if others.size:
                found[..., place] = rows[..., place] - rows[..., others] @ weights
        return found

    def noise(self, angle, measured, simulated_angle, simulated) -> np.ndarray:
        """Standard deviation [unit] of what the quietest bins of measured channels have beyond noise-free simulated ones."""
        shape = (len(self.channels), 2, BINS)
        with np.errstate(invalid="ignore"):
            found, clean = (
                np.nanmean(self.cycles(at, values), axis=0).reshape(shape)[:, 1]
                for at, values in ((angle, measured), (simulated_angle, simulated))
            )
        quiet = np.argsort(clean, axis=1)[:, : BINS // 4]
        excess = np.take_along_axis(found**2 - clean**2, quiet, axis=1)
        return np.sqrt(np.maximum(np.median(excess, axis=1), 0.0) * (np.pi / 2.0))  # mean size of a normal number

    def split(self, row: np.ndarray) -> dict[str, np.ndarray]:
        """Statistics by the name of their series, (BINS,) each."""
        parts = row.reshape(len(self.channels), 2, BINS)
        return {
            f"{channel} {kind}": parts[i, k] for i, channel in enumerate(self.channels) for k, kind in enumerate(KINDS)
        }


def _predictions(rows: np.ndarray, channels: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each statistic the least-squares weights of those that may predict it."""
    places = np.arange(rows.shape[1]).reshape(channels, 2, BINS)
    centred = rows - np.nanmean(rows, axis=0)
    sizes = np.maximum(np.nanstd(rows, axis=0), 1e-300)
    centred = np.nan_to_num(centred / sizes)
    found = []
    for i, kind, place in np.ndindex(places.shape):
        others = [places[i, kind, place - back] for back in range(1, _BEFORE + 1) if place >= back]
        others += [places[j, kind, place] for j in range(i)]
        others += [places[i, 0, place]] if kind else []
        chosen, own = np.array(others, dtype=int), places[i, kind, place]
        weights = np.linalg.lstsq(centred[:, chosen], centred[:, own], rcond=1e-6)[0]
        found.append((chosen, weights * sizes[own] / sizes[chosen]))
    return found


def scatter(rows: np.ndarray) -> np.ndarray:
    """Standard deviation from cycle to cycle, such that its square over the number of cycles is the variance of their mean.

    Chaotic cycles that follow each other are not quite independent: blocks of three say by how much, on average.
    """
    single = np.nanvar(rows, axis=0, ddof=1)
    blocks = rows[: len(rows) // 3 * 3].reshape(-1, 3, rows.shape[1]).mean(axis=1)
    if len(blocks) >= 8:
        ratio = np.nanmedian(3.0 * np.nanvar(blocks, axis=0, ddof=1) / np.maximum(single, 1e-300))
        single = single * np.clip(ratio, 1.0, 3.0)
    return np.sqrt(np.maximum(single, 1e-300))
