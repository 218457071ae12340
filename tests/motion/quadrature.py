"""Integrals over a motion, as exact as the motion itself."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from jointgap.config import Mechanism
from jointgap.motion.integrate import EVENT, Samples
from jointgap.motion.model import Model
from jointgap.motion.simulation import integrate_to_angles, observed
from jointgap.motion.slider_crank import model_of, start_state
from tests.motion.cases import options
from tests.motion.laws import faded_damping

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)
LAST = np.polynomial.legendre.legvander(NODES, 15)[:, 12:].T * (np.arange(12, 16) + 0.5)[:, None]
"""Takes values at the nodes, times weights, to their last Legendre coefficients."""

ANGLE = EVENT.index("crank_angle")
ROUNDS, SMOOTH = 6, 1e-12


@dataclass(frozen=True)
class Motion:
    """A motion sampled where Gauss' rule wants it, panel by panel."""

    made: Mechanism  # its effects applied
    model: Model
    angles: np.ndarray  # of each panel's start, 16 nodes and end [rad], (panels, 16 + 2)
    weights: np.ndarray  # of the nodes, for integrals over the time [s], (panels, 16)
    run: Samples
    seen: dict[str, np.ndarray]

    def sampled(self, values: np.ndarray) -> np.ndarray:
        return values.reshape(self.angles.shape)

    def vector(self, joint: str) -> tuple[np.ndarray, np.ndarray]:
        """Clearance vector and its rate, (2, panels, 16 + 2) each."""
        found = self.model.vector(self.run.states, joint)
        return tuple(np.array([self.sampled(each) for each in v.T]) for v in found)

    def bend(self) -> tuple[np.ndarray, np.ndarray]:
        """Deflection of the rod and its rate."""
        half = self.model.positions
        return tuple(self.sampled(self.run.states[:, i]) for i in (half - 1, 2 * half - 1))

    def mode(self, joint: str) -> np.ndarray:
        return self.sampled(self.run.modes[:, self.model.loose.index(joint)])

    def damping_factor(self, joint: str) -> np.ndarray:
        numbers, number = self.model.bearings[joint], self.model.loose.index(joint)
        since = self.run.times - self.run.begins[:, number]
        return self.sampled(faded_damping(numbers, self.run.approaches[:, number], since))

    def __getitem__(self, name: str) -> np.ndarray:
        return self.sampled(self.seen[name])

    def steps(self, values: np.ndarray) -> np.ndarray:
        """Integral of `values` over the time of each panel, (panels,)."""
        return (values[:, 1:-1] * self.weights).sum(axis=1)

    def integral(self, values: np.ndarray) -> np.ndarray:
        """Integral of `values` over time from the start to the end of each panel, (panels,)."""
        return np.cumsum(self.steps(values))


def motion(
    made: Mechanism, revolutions: float, tolerance=1e-15, panels_per_revolution=1000, **changed
) -> Motion:
    """Simulate once for the events, again with samples at Gauss nodes between them.

    At an event forces go like a half-integer power of the time from it. With the crank angle a + (b
    - a) sin^2(u) between events a and b all is smooth in u, and Gauss' rule converges at its full
      rate. Kinks of friction laws are
    elsewhere: panels in which the forces are not smooth are divided.
    """
    chosen = options(**changed)
    model = model_of(made, chosen)
    start, end = chosen.start_angle, chosen.start_angle + revolutions * 2 * np.pi
    run = integrate_to_angles(model, start_state(model), np.array([start, end]), tolerance)
    corners = np.concatenate(([start], run.events[:, ANGLE], [end]))
    panels = []
    for a, b in pairwise(corners):
        edges = np.linspace(0.0, np.pi / 2, 2 + int((b - a) / (2 * np.pi) * panels_per_revolution))
        panels += [(a, b, u0, u1) for u0, u1 in pairwise(edges)]
    for _ in range(ROUNDS):
        moved = _sampled(made, model, np.array(panels), tolerance)
        rough = _roughness(moved) > SMOOTH
        if not rough.any():
            break
        divided = []
        for panel, is_nonsmooth in zip(panels, rough, strict=True):
            edges = np.linspace(panel[2], panel[3], 5 if is_nonsmooth else 2)
            divided += [(*panel[:2], u0, u1) for u0, u1 in pairwise(edges)]
        panels = divided
    return moved


def _sampled(made: Mechanism, model: Model, panels: np.ndarray, tolerance: float) -> Motion:
    a, b, u0, u1 = panels.T[:, :, None]
    inside = 0.5 * (u0 + u1) + 0.5 * (u1 - u0) * NODES
    u = np.concatenate((u0, inside, u1), axis=1)
    angles = np.clip(a + (b - a) * np.sin(u) ** 2, a, b)
    weights = 0.5 * (u1 - u0) * WEIGHTS * (b - a) * np.sin(2 * inside)
    run = integrate_to_angles(model, start_state(model), angles.ravel(), tolerance)
    seen = observed(model, run)
    weights /= seen["crank_speed"].reshape(angles.shape)[:, 1:-1]
    return Motion(made.applied(), model, angles, weights, run, seen)


def _roughness(moved: Motion) -> np.ndarray:
    """About how much impulse a panel's quadrature misses, over the largest impulse that there is in
    half a turn."""
    missed = np.zeros(len(moved.angles))
    for name in ("crank_pin", "piston_pin", "crank_pivot"):
        for axis in "xy":
            force = moved[f"{name}_force_{axis}"]
            tail = np.abs((force[:, 1:-1] * WEIGHTS) @ LAST.T).max(axis=1) * moved.weights.sum(
                axis=1
            )
            missed = np.maximum(
                missed, tail / np.abs(moved.integral(np.abs(force))).max().clip(1e-9)
            )
    return missed
