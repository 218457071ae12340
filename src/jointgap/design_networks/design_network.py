"""A network from crank angle and design to the motion in the loose joints.

Layers of tansig neurons take the design; the output layer weighs sines and cosines of multiples of the crank angle:

    r_j / c_j = sum_h B_h(crank angle) (W a(design) + b)_jh,

with c_j the clearance of joint j. So the motion is periodic, as a settled one is, and smooth in the design.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from jointgap.design_networks.design_space import Design, DesignSpace

BIAS = -1  # `source` of a bias in the long form


def harmonics(crank_angle: np.ndarray, highest: int) -> np.ndarray:
    """1, cos, sin, cos 2, sin 2 ... of `crank_angle` (n,) [rad], shape (1 + 2 highest, n).

    Over n > 2 `highest` angles evenly apart over a revolution their rows are orthogonal, of mean square 1.
    """
    multiples = np.arange(1, highest + 1)[:, None] * crank_angle
    waves = np.sqrt(2.0) * np.stack([np.cos(multiples), np.sin(multiples)], axis=1)
    return np.concatenate([np.ones((1, len(crank_angle))), waves.reshape(-1, len(crank_angle))])


@dataclass(frozen=True)
class DesignNetwork:
    """A trained network."""

    space: DesignSpace  # Of the designs that it knows
    layers: tuple[np.ndarray, ...]  # Of each layer (neurons, sources + 1), the last column the bias

    @property
    def highest(self) -> int:
        """Highest harmonic of the crank angle."""
        return (len(self.layers[-1]) // (2 * len(self.space.joints)) - 1) // 2

    def vectors(self, design: Design, lengths: np.ndarray, crank_angle: np.ndarray) -> np.ndarray:
        """Clearance vectors of a design at other lengths, (m, points, joints, 2) [m]."""
        return self.at_angles(crank_angle)(design, lengths)

    def at_angles(self, crank_angle: np.ndarray) -> Callable[[Design, np.ndarray], np.ndarray]:
        """`vectors` at these angles, as a function of design and lengths: for many calls."""
        waves = harmonics(crank_angle, self.highest)

        def vectors(design: Design, lengths: np.ndarray) -> np.ndarray:
            coefficients = self._coefficients(self.space.inputs(design, lengths))
            clearances = np.array([design.mechanism.clearance(joint) for joint in self.space.joints])
            return np.moveaxis(coefficients @ waves, -1, 1) * clearances[:, None]

        return vectors

    def _coefficients(self, inputs: np.ndarray) -> np.ndarray:
        """Of the harmonics, in clearances, (m, joints, 2, harmonics), of inputs (m, axes)."""
        values = inputs
        for layer in self.layers[:-1]:
            values = np.tanh(values @ layer[:, :-1].T + layer[:, -1])
        values = values @ self.layers[-1][:, :-1].T + self.layers[-1][:, -1]
        return values.reshape(len(inputs), len(self.space.joints), 2, -1)

    def to_frame(self) -> pd.DataFrame:
        """Table design_networks_weights."""
        frames = []
        for number, layer in enumerate(self.layers):
            neuron, source = np.indices(layer.shape)
            source[:, -1] = BIAS
            frames.append(
                pd.DataFrame(
                    {"layer": number, "neuron": neuron.ravel(), "source": source.ravel(), "weight": layer.ravel()}
                )
            )
        return pd.concat(frames, ignore_index=True)

    @classmethod
    def from_frame(cls, space: DesignSpace, frame: pd.DataFrame) -> "DesignNetwork":
        """The network of a table design_networks_weights."""
        layers = []
        for _, rows in frame.groupby("layer"):
            shape = rows["neuron"].max() + 1, rows["source"].max() + 2
            if len(rows) != shape[0] * shape[1]:
                raise ValueError("the weights are not those of a network: rows are missing or doubled")
            layer = np.full(shape, np.nan)
            layer[rows["neuron"], rows["source"]] = rows["weight"]  # of a bias the last column, which is -1
            layers.append(layer)
        widths = [len(space.axes), *(len(layer) for layer in layers)]
        if [layer.shape[1] - 1 for layer in layers] != widths[:-1] or widths[-1] % (2 * len(space.joints)):
            raise ValueError("the weights are those of a network that knows other designs")
        return cls(space, tuple(layers))


def sizes(space: DesignSpace, hidden: tuple[int, ...], highest: int) -> list[tuple[int, int]]:
    """Shape (neurons, sources + 1) of each layer."""
    outputs = 2 * len(space.joints) * (1 + 2 * highest)
    return [(neurons, sources + 1) for sources, neurons in pairwise((len(space.axes), *hidden, outputs))]
