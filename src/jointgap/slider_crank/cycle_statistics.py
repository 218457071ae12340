"""Chaotic runs: statistics over the crank angle's cycles in place of samples.

Frictionless impacts amplify differences, so that no simulation follows a rig for more than a few revolutions. What is
compared then are means over cycles, in bins of the crank angle, of two functions of what a channel reads beside its usual
course: the deviation itself, and its size. Deviations are bent, k tanh(u / k), for rare spikes would otherwise hold nearly all of a
mean's scatter. Neighbouring bins and channels scatter together; each statistic is therefore compared with what a
linear prediction from a few others (the bins before it, the same bins and their neighbours of the channels before) lets expect, so that what is
left is independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

BINS = 24
KINDS = ("mean", "spread")
_FINE = 144  # angles of the usual course
_BENT = 3.0  # mean sizes of a deviation
_BEFORE = 2  # bins that a prediction looks back
_EDGE = 1e-6  # of a bin, within which a sample lies on its edge and counts for the bin that begins
_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class CycleStatistics:
    """Statistics of the channels of one run.

    Attributes
    ----------
    channels : tuple of str
    angles : (a,) array
        Crank angles of the usual course, growing over somewhat more than a revolution [rad].
    course : (channels, a) array
        Usual course of each channel [unit].
    bend : (channels,) array
        k [unit].
    weights : list of (places, weights)
        For every statistic, which others predict it and how.
    """

    channels: tuple[str, ...]
    angles: np.ndarray
    course: np.ndarray
    bend: np.ndarray
    weights: list[tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(
        cls, channels: Sequence[str], angle: np.ndarray, values: Sequence[np.ndarray], finer: int = 1
    ) -> "CycleStatistics":
        """Learnt from many simulated cycles.

        Parameters
        ----------
        channels : sequence of str
        angle : (n,) array
            [rad], running on.
        values : sequence of (n,) arrays
            By channel.
        finer : int
            Samples for each that is measured: the course is learnt from all, predictions from every `finer`-th.
        """
        turned = _turned(angle)
        fine = np.minimum((turned * (_FINE / _TURN)).astype(int), _FINE - 1)
        known = np.unique(fine)
        # a bin's medians belong to its samples' angle: where these keep to a few angles, that is not its middle
        angles, *course = (
            np.array([np.median(value[fine == place]) for place in known]) for value in (turned, *values)
        )
        angles = np.concatenate([[angles[-1] - _TURN], angles, [angles[0] + _TURN]])
        course = np.array([np.concatenate([one[-1:], one, one[:1]]) for one in course])
        found = cls(tuple(channels), angles, course, np.ones(len(channels)), [])
        away = [np.abs(value - one) for value, one in zip(values, found._usual(angle), strict=True)]
        bend = np.array([max(_BENT * float(np.mean(one)), 1e-300) for one in away])
        found = replace(found, bend=bend)
        rows = found.cycles(angle[::finer], [one[::finer] for one in values])
        return replace(found, weights=_predictions(rows, len(channels)))

    def _usual(self, angle: np.ndarray) -> list[np.ndarray]:
        return [np.interp(_turned(angle), self.angles, one) for one in self.course]

    def cycles(self, angle: np.ndarray, values: Sequence[np.ndarray]) -> np.ndarray:
        """Statistics of every cycle, shape (cycles, channels * 2 * BINS); NaN where a bin has no sample."""
        first = np.floor(np.min(angle) / _TURN)
        place = np.floor((angle / _TURN - first) * BINS + _EDGE).astype(int)
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
        """Standard deviation [unit] of noise: what measured channels spread beyond noise-free simulated ones.

        Bins count by how well they tell, so that the quiet ones do.
        """
        squares, variances = [], []
        for at, values in ((angle, measured), (simulated_angle, simulated)):
            rows = self.cycles(at, values).reshape(-1, len(self.channels), 2, BINS)[:, :, 1]
            mean = np.nanmean(rows, axis=0)
            squares.append(mean**2)
            variances.append(4.0 * mean**2 * cycle_variance(rows) / np.isfinite(rows).sum(axis=0))
        weight = 1.0 / (variances[0] + variances[1])
        excess = np.sum(weight * (squares[0] - squares[1]), axis=1) / np.sum(weight, axis=1)
        return np.sqrt(np.maximum(excess, 0.0) * (np.pi / 2.0))  # of a normal number's mean size

    def split(self, row: np.ndarray) -> dict[str, np.ndarray]:
        """Statistics by the name of their series, (BINS,) each."""
        parts = row.reshape(len(self.channels), 2, BINS)
        return {
            f"{channel} {kind}": parts[i, k] for i, channel in enumerate(self.channels) for k, kind in enumerate(KINDS)
        }


def _turned(angle: np.ndarray) -> np.ndarray:
    """Crank angles within a revolution [rad]; those on its edge begin one, whichever way they were rounded."""
    return np.mod(angle + _EDGE * _TURN / BINS, _TURN)


def _predictions(rows: np.ndarray, channels: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each statistic the least-squares weights of those that may predict it."""
    places = np.arange(rows.shape[1]).reshape(channels, 2, BINS)
    centred = rows - np.nanmean(rows, axis=0)
    sizes = np.maximum(np.nanstd(rows, axis=0), 1e-300)
    centred = np.nan_to_num(centred / sizes)
    found = []
    for i, kind, place in np.ndindex(places.shape):
        others = [places[i, kind, place - back] for back in range(1, _BEFORE + 1) if place >= back]
        others += [places[j, kind, (place + near) % BINS] for j in range(i) for near in (-1, 0, 1)]
        others += [places[i, 0, place]] if kind else []
        chosen, own = np.array(others, dtype=int), places[i, kind, place]
        weights = np.linalg.lstsq(centred[:, chosen], centred[:, own], rcond=1e-6)[0]
        found.append((chosen, weights * sizes[own] / sizes[chosen]))
    return found


def cycle_variance(rows: np.ndarray) -> np.ndarray:
    """Variance from cycle to cycle of statistics (cycles, m), shape (m,)."""
    return np.maximum(np.nanvar(rows, axis=0, ddof=1), 1e-300)


def persistence(rows: np.ndarray, block: int) -> np.ndarray:
    """How many times the variance of the mean of many cycles is what it would be if they were independent.

    Parameters
    ----------
    rows : (cycles, m) array
    block : int
        Cycles of one block; blocks are taken for independent.

    Returns
    -------
    (m,) array
        The same for all bins of a channel's mean, or of its spread.
    """
    blocks = np.nanmean(rows[: len(rows) // block * block].reshape(-1, block, rows.shape[1]), axis=1)
    ratio = block * np.nanvar(blocks, axis=0, ddof=1) / cycle_variance(rows)
    return np.repeat(np.maximum(np.nanmean(ratio.reshape(-1, BINS), axis=1), 1.0), BINS)
