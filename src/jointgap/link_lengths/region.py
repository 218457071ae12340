"""Where the link lengths may lie: bounds, and crank length at most a share of the rod length."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jointgap.config import Box
from jointgap.errors import InputError

NAMES = ("crank length", "rod length")
NEAR = 1e-6  # [m] a length this close to its bound is at it: a thousandth of the digits the paper prints


@dataclass(frozen=True)
class Region:
    """A convex region of lengths (L2, L3).

    Attributes
    ----------
    lower, upper : ndarray, shape (2,)
        Bounds of (L2, L3) [m].
    ratio_limit : float
        g(x) = L2 - ratio_limit L3 <= 0; 1 where nothing else is asked for: the crank can turn.
    """

    lower: np.ndarray
    upper: np.ndarray
    ratio_limit: float

    @classmethod
    def of(cls, box: Box, ratio_limit: float | None) -> "Region":
        """The region of one configured box.

        Parameters
        ----------
        box : Box
            Bounds [m].
        ratio_limit : float, optional
            Largest crank length over rod length.

        Raises
        ------
        InputError
            The inequality leaves nothing of the box.
        """
        lower, upper = np.transpose([box.crank_length, box.rod_length])
        ratio_limit = 1.0 if ratio_limit is None else ratio_limit
        if lower[0] - ratio_limit * upper[1] >= 0.0:
            raise InputError(
                f"ratio_limit {ratio_limit:g} leaves nothing of the box: even the shortest crank, {1e3 * lower[0]:g} "
                f"mm, is longer than {ratio_limit:g} times the longest rod, {1e3 * upper[1]:g} mm; raise ratio_limit"
            )
        return cls(lower, upper, ratio_limit)

    @property
    def size(self) -> np.ndarray:
        """Widths of the box, shape (2,) [m]."""
        return self.upper - self.lower

    def inequality(self, lengths: ArrayLike) -> np.ndarray:
        """g(x) [m], shape (...), for lengths of shape (..., 2); at most 0 where allowed."""
        lengths = np.asarray(lengths)
        return lengths[..., 0] - self.ratio_limit * lengths[..., 1]

    def contains(self, lengths: ArrayLike, slack: float = 0.0) -> np.ndarray:
        """Whether lengths, shape (..., 2), obey bounds and inequality up to `slack` [m]."""
        lengths = np.asarray(lengths)
        inside = np.all((lengths >= self.lower - slack) & (lengths <= self.upper + slack), axis=-1)
        return inside & (self.inequality(lengths) <= slack)

    def sample(self, count: int, random: np.random.Generator) -> np.ndarray:
        """`count` points spread evenly over the region, shape (count, 2) [m].

        Parameters
        ----------
        count : int
        random : Generator
        """
        points = np.empty((0, 2))
        while len(points) < count:
            drawn = self.lower + random.random((count, 2)) * self.size
            points = np.concatenate([points, drawn[self.contains(drawn)]])
        return points[:count]

    def reach(self, start: ArrayLike, step: ArrayLike) -> float:
        """The largest factor, at most 1, by which `step` (2,) can be taken from `start` (2,) without leaving.

        Parameters
        ----------
        start, step : array_like, shape (2,)
            (L2, L3) [m].
        """
        start, step = np.asarray(start), np.asarray(step)
        room = np.append(np.where(step > 0.0, self.upper - start, start - self.lower), -self.inequality(start))
        speed = np.append(np.abs(step), self.inequality(step))
        limits = [room_ / speed_ for room_, speed_ in zip(room, speed, strict=True) if speed_ > 0.0]
        return float(np.clip(min(limits, default=1.0), 0.0, 1.0))

    def clip(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (2,) moved onto the bounds; then the crank shortened or the rod lengthened, to the inequality."""
        crank, rod = np.clip(lengths, self.lower, self.upper)
        crank = max(self.lower[0], min(crank, self.ratio_limit * rod))
        return np.array([crank, max(rod, crank / self.ratio_limit)])

    def active(self, lengths: ArrayLike) -> str:
        """The bounds and the inequality that `lengths` (2,) lie at, in words; ``'none'`` where there are none."""
        words = []
        for name, value, low, high in zip(NAMES, np.asarray(lengths), self.lower, self.upper, strict=True):
            if value <= low + NEAR:
                words.append(f"{name} at its lower bound {1e3 * low:g} mm")
            elif value >= high - NEAR:
                words.append(f"{name} at its upper bound {1e3 * high:g} mm")
        if self.inequality(lengths) >= -NEAR:
            words.append(f"crank length at {self.ratio_limit:g} times the rod length")
        return "; ".join(words) or "none"
