"""Values and derivatives of a trained network in plain numpy: what the later stages call."""

import numpy as np
from numpy.typing import ArrayLike

from jointgap.surrogate.network import Network


def values(network: Network, crank_angle: ArrayLike) -> np.ndarray:
    """The output at crank angles of any shape [rad], in its SI unit; same shape.

    Parameters
    ----------
    network : Network
    crank_angle : array_like
        [rad].
    """
    return _propagate(network, crank_angle)[0]


def values_and_slopes(network: Network, crank_angle: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """The output and its exact derivative with respect to the crank angle [output's unit / rad].

    Times the crank's speed the derivative is the time derivative: d(gamma)/dt of one network can be held against the
    network of gamma_dot.

    Parameters
    ----------
    network : Network
    crank_angle : array_like
        [rad].
    """
    return _propagate(network, crank_angle)


def _propagate(network: Network, crank_angle: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    angle = np.asarray(crank_angle, dtype=float)
    value = network.input.shrink(angle.reshape(1, -1))
    slope = np.ones_like(value)
    matrices = network.layout.split(network.parameters)
    for depth, matrix in enumerate(matrices):
        value = matrix[:, :-1] @ value + matrix[:, -1:]
        slope = matrix[:, :-1] @ slope
        if depth < len(matrices) - 1:
            value = np.tanh(value)
            slope *= 1.0 - value**2
    scale = network.output.range / network.input.range
    return network.output.expand(value[0]).reshape(angle.shape), (scale * slope[0]).reshape(angle.shape)
