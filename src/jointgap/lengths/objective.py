"""The objectives as functions of the lengths."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jointgap.config import Mechanism, Optimise, Simulate
from jointgap.core.joints import PINS
from jointgap.linkage.topology import Joint
from jointgap.motion.kinematics import transmission_angle


class Measures(NamedTuple):
    """Four norms of an error; floats, or arrays of one shape for several errors."""

    rms: np.ndarray  # [rad]
    mean_absolute: np.ndarray  # [rad]
    peak: np.ndarray  # [rad]
    sum_of_squares: np.ndarray  # Equation (12) [rad^2]; grows with the number of samples


MEASURES = Measures._fields


def measure(error: ArrayLike) -> Measures:
    """The four measures of `error` [rad], shape (..., n), over its last axis."""
    size = np.abs(error)
    squares = np.sum(size**2, axis=-1)
    return Measures(
        np.sqrt(squares / size.shape[-1]), np.mean(size, axis=-1), np.max(size, axis=-1), squares
    )


@dataclass(frozen=True)
class FrozenObjective:
    """Equation (12) with frozen clearance motion. Lengths are arrays (..., lengths) [m]."""

    # shape (n,); transmission angle at the original lengths without clearance [rad]
    desired: np.ndarray
    original: tuple[float, ...]  # Original lengths [m]

    def angle(self, lengths: ArrayLike) -> np.ndarray:
        """mu_a [rad], shape (..., n)."""
        raise NotImplementedError

    def error(self, lengths: ArrayLike) -> np.ndarray:
        """mu_d - mu_a [rad], shape (..., n)."""
        return self.desired - self.angle(lengths)

    def measures(self, lengths: ArrayLike) -> Measures:
        """The four measures, shape (...)."""
        return measure(self.error(lengths))

    def reductions(self, lengths: ArrayLike) -> Measures:
        """Relative reduction of each measure from the original lengths, shape (...)."""
        pairs = zip(self.measures(lengths), self.measures(self.original), strict=True)
        return Measures(*(1.0 - size / original for size, original in pairs))

    def value(self, lengths: ArrayLike) -> np.ndarray:
        """The quantity to minimise, f(x) [rad^2], shape (...)."""
        error = self.error(lengths)
        return np.einsum("...n,...n->...", error, error)

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Gradient of `value`, shape (lengths,), for lengths of that shape."""
        raise NotImplementedError


class LargestOfSeveral(FrozenObjective):
    """An objective that is the largest of several values, each with its slopes."""

    def several(self, lengths: np.ndarray) -> np.ndarray:
        """The values, for lengths of shape (lengths,)."""
        raise NotImplementedError

    def slopes(self, lengths: np.ndarray) -> np.ndarray:
        """Their gradients, shape (values, lengths)."""
        raise NotImplementedError


@dataclass(frozen=True)
class Objective(FrozenObjective):
    """That of a slider-crank, with L2 and L3; created by `frozen_objective`."""

    sine: np.ndarray  # shape (n,); sin theta2 at the evaluation points
    # shape (n,); r1 sin gamma1 + r2 sin gamma2 - r3 sin gamma3, minus the slide's offset [m]
    lift: np.ndarray

    def angle(self, lengths: ArrayLike) -> np.ndarray:
        return np.arccos(self._cosine(lengths))

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        cosine = self._cosine(lengths)
        error = self.desired - np.arccos(cosine)
        slope = np.asarray(lengths)[1] * np.sqrt(1.0 - cosine**2)
        weight = 2.0 * error / slope
        return np.array([weight @ self.sine, -weight @ cosine])

    def _cosine(self, lengths: ArrayLike) -> np.ndarray:
        lengths = np.asarray(lengths)[..., None]
        return (lengths[..., 0, :] * self.sine + self.lift) / lengths[..., 1, :]


Settled = Mapping[str, np.ndarray]
"""Torque of the drive [N m] (``crank_torque``) and forces in the joints [N] by name over a settled
revolution, shape (..., n) each."""


def joint_forces(
    columns: Mapping[str, np.ndarray], joints: Mapping[str, Joint]
) -> dict[str, np.ndarray]:
    """Sizes (n,) of the force in each joint [N], of a slide across it."""
    return {
        name: np.abs(columns[f"{name}_force"])
        if joint.kind == "slide"
        else np.hypot(columns[f"{name}_force_x"], columns[f"{name}_force_y"])
        for name, joint in joints.items()
    }


class Load(NamedTuple):
    """One number of forces, or of the torque, over a settled revolution."""

    names: tuple[str, ...]  # Joints, or crank_torque; the largest of several counts
    kind: Literal["peak", "rms", "ripple"]

    def __call__(self, settled: Settled) -> np.ndarray:
        """The number [N, N m], shape (...)."""
        values = np.stack([settled[name] for name in self.names])
        if self.kind == "ripple":
            return np.ptp(values, axis=-1).max(axis=0)
        if self.kind == "rms":
            return np.sqrt(np.mean(values**2, axis=-1)).max(axis=0)
        return np.abs(values).max(axis=-1).max(axis=0)


@dataclass(frozen=True)
class Goal:
    """A quantity that can be minimised, and how it is reported."""

    words: str
    measure: str  # In the table optimise_resimulated
    unit: str  # Display unit
    definition: str = ""  # After "over a settled revolution"
    load: Load | None = None  # The force or torque

    @property
    def factor(self) -> float:
        """Display units per SI unit."""
        return np.degrees(1.0) if self.unit == "deg" else 1.0


TORQUE_RIPPLE = Goal(
    "torque ripple",
    "torque_ripple",
    "N m",
    "largest minus smallest torque of the drive on the crank",
    Load(("crank_torque",), "ripple"),
)

GOALS = {
    "transmission_angle": Goal("error of the transmission angle", "rms", "deg"),
    "largest_pin_force": Goal(
        "largest pin force",
        "largest_pin_force",
        "N",
        "largest force in crank pin and piston pin",
        Load(PINS, "peak"),
    ),
    "torque_ripple": TORQUE_RIPPLE,
}
"""Of a slider-crank, by `optimise.objective`."""


def frozen_objective(mechanism: Mechanism, crank_angle: ArrayLike, lift: ArrayLike) -> Objective:
    """The objective for a clearance motion that is independent of the lengths."""
    original, offset = (mechanism.crank.length, mechanism.rod.length), mechanism.slider.offset
    transmission_angle(*original, crank_angle, lift, offset)  # raises where it has no solution
    return Objective(
        sine=np.sin(crank_angle),
        lift=np.asarray(lift) - offset,
        desired=transmission_angle(*original, crank_angle, 0.0, offset),
        original=original,
    )


def objective_of_motion(
    mechanism: Mechanism, crank_angle: ArrayLike, rod_angle: ArrayLike
) -> Objective:
    """The objective for a simulated motion; the rod's angle gives the contribution of the
    clearances."""
    # equation (10), solved for the clearances
    crank_height = mechanism.crank.length * np.sin(crank_angle)
    height = crank_height + mechanism.rod.length * np.sin(rod_angle)
    return frozen_objective(mechanism, crank_angle, mechanism.slider.offset - height)


def evaluation_samples(
    simulate: Simulate, options: Optimise, training_points: int
) -> dict[str, np.ndarray]:
    """Samples of a trajectory at which the error counts: ``window``, those of the first revolution
    in the window that no network is trained at, and ``settled``, a whole settled revolution."""
    per_turn, (begin, end) = simulate.samples_per_revolution, options.window
    index = np.arange(per_turn + 1)
    turned = index * (2.0 * np.pi / per_turn)
    half = np.pi / per_turn  # of a sample: a window's ends do not depend on rounding
    inside = (turned >= begin - half) & (turned <= end + half)
    is_held_out = index % (per_turn // (training_points - 1)) != 0
    settled = (options.ensemble.settled_revolution - 1) * per_turn
    return {"window": index[inside & is_held_out], "settled": settled + np.arange(per_turn)}
