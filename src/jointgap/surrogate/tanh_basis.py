"""Wide layers of tansig neurons by the differences of neighbours: a basis that is local and well conditioned.

The functions that a layer of H tansig neurons and a bias can give are those of the H + 1 basis functions

    B_k = (tanh z_(k-1) - tanh z_k) / 2,    z_k = (x - centre_k) / width_k,    tanh z_(-1) = 1,  tanh z_H = -1,

which add up to one. Each is there only between its two neurons and a few widths around: where thousands of neurons
meet thousands of points, matrices are banded. The weights of basis functions and neurons
follow from each other (`from_tansig`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

REACH = 19.0  # widths from its centre at which tanh is 1 in double precision
BLOCK = 16  # neurons' distances per block: short enough to skip zeros, long enough for fast products
DERIVATIVES = 3


@dataclass(frozen=True)
class Block:
    """Points that see the same basis functions."""

    points: slice
    functions: slice
    values: list[np.ndarray]


@dataclass(frozen=True)
class Layer:
    """Places of the neurons."""

    centres: np.ndarray  # shape (H,); where each neuron's sum is 0, rising
    widths: np.ndarray  # shape (H,); inverse of each neuron's input weight

    @property
    def functions(self) -> int:
        """Number of basis functions, H + 1."""
        return len(self.centres) + 1

    def from_tansig(self, weights: np.ndarray, bias: complex) -> np.ndarray:
        """Weights of the basis functions from the neurons' output weights, shape (H,), and the output's bias."""
        steps = np.concatenate([[0.0], np.cumsum(2.0 * weights)])
        return bias - steps[-1] / 2.0 + steps

    @staticmethod
    def to_tansig(basis_weights: np.ndarray) -> tuple[np.ndarray, complex]:
        """The neurons' output weights, shape (H,), and the output's bias."""
        return np.diff(basis_weights) / 2.0, (basis_weights[0] + basis_weights[-1]) / 2.0

    def blocks(self, points: np.ndarray, orders: int) -> Iterator[Block]:
        """Rising points cut into blocks, each with the basis functions that are not zero there."""
        begins = np.concatenate([[-np.inf], self.centres - REACH * self.widths])
        ends = np.concatenate([self.centres + REACH * self.widths, [np.inf]])
        begins = np.minimum.accumulate(begins[::-1])[::-1]
        ends = np.maximum.accumulate(ends)
        inner = self.centres[(self.centres > points[0]) & (self.centres < points[-1])][BLOCK::BLOCK]
        cuts = np.concatenate([[0], np.searchsorted(points, inner), [len(points)]])
        for first, last in pairwise(cuts):
            if last > first:
                low = int(np.searchsorted(ends, points[first]))
                high = int(np.searchsorted(begins, points[last - 1], side="right"))
                values = self._values(points[first:last], low, high, orders)
                yield Block(slice(first, last), slice(low, high), values)

    def _values(self, points: np.ndarray, low: int, high: int, orders: int) -> list[np.ndarray]:
        neurons = slice(max(low - 1, 0), min(high, len(self.centres)))
        inverse = 1.0 / self.widths[neurons]
        t = np.tanh((points[:, None] - self.centres[neurons]) * inverse)
        f = 1.0 - t * t
        tansig = [t, f * inverse, -2.0 * t * f * inverse**2, f * (6.0 * t * t - 2.0) * inverse**3][:orders]
        differences = []
        for order, values in enumerate(tansig):
            end = np.full((len(points), 1), 0.0 if order else 1.0)
            sides = ([end] if low == 0 else []) + [values] + ([-end] if high == self.functions else [])
            values = np.concatenate(sides, axis=1) if len(sides) > 1 else values
            differences.append((values[:, :-1] - values[:, 1:]) / 2.0)
        return differences
