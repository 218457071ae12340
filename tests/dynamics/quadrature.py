"""Integrals over a motion, as exact as the motion itself."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from jointgap.dynamics.parameters import Parameters, parameters
from jointgap.dynamics.simulate import March, run_march
from jointgap.dynamics.start import start_state
from tests.dynamics.cases import SPEED, observed

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


@dataclass(frozen=True)
class Motion:
    """A motion sampled where Gauss' rule wants it, panel by panel.

    Attributes
    ----------
    times : (panels, 16 + 2) array
        Of each panel its start, 16 nodes and its end [s].
    """

    p: Parameters
    times: np.ndarray
    weights: np.ndarray
    run: March
    seen: dict[str, np.ndarray]

    def state(self, i: int) -> np.ndarray:
        return self.run.states[:, i].reshape(self.times.shape)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.seen[name].reshape(self.times.shape)

    def integral(self, values: np.ndarray) -> np.ndarray:
        """Integral of `values` over time from the start to the end of each panel, (panels,)."""
        return np.cumsum((values[:, 1:-1] * self.weights).sum(axis=1))


def motion(mechanism, revolutions: float, tolerance=1e-14, panels_per_revolution=6000) -> Motion:
    """Simulate once for the events, again with samples at Gauss nodes between them.

    At an event forces go like a half-integer power of the time from it. With t = a + (b - a) sin^2(u) between events a
    and b all is smooth in u, and Gauss' rule converges at its full rate.
    """
    p = parameters(mechanism, SPEED, 0.0)
    end = revolutions * 2 * np.pi / SPEED
    run = run_march(p, start_state(p), np.array([0.0, end]), tolerance)
    corners = np.concatenate(([0.0], run.events[:, 0], [end]))
    times, weights = [], []
    for a, b in pairwise(corners):
        edges = np.linspace(0.0, np.pi / 2, 2 + int((b - a) / end * revolutions * panels_per_revolution))
        for u0, u1 in pairwise(edges):
            u = np.concatenate(([u0], 0.5 * (u0 + u1) + 0.5 * (u1 - u0) * NODES, [u1]))
            times.append(np.clip(a + (b - a) * np.sin(u) ** 2, a, b))
            weights.append(0.5 * (u1 - u0) * WEIGHTS * (b - a) * np.sin(2 * u[1:-1]))
    times, weights = np.array(times), np.array(weights)
    run = run_march(p, start_state(p), times.ravel(), tolerance)
    return Motion(p, times, weights, run, observed(p, run, times.ravel()))
