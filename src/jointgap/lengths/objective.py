"""The objectives as functions of the lengths."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import brentq, minimize_scalar

from jointgap.config import Mechanism
from jointgap.dynamics.kinematics import transmission_angle
from jointgap.lengths.region import Region, Surface


class Measures(NamedTuple):
    """Four norms of an error; floats, or arrays of one shape for several errors."""

    rms: np.ndarray  # [rad]
    mean_absolute: np.ndarray  # [rad]
    peak: np.ndarray  # [rad]
    sum_of_squares: (
        np.ndarray
    )  # Objective of equation (12) [rad^2]; grows with the number of samples


MEASURES = Measures._fields


def measure(error: ArrayLike) -> Measures:
    """The four measures of `error` [rad], shape (..., n), over its last axis."""
    size = np.abs(error)
    squares = np.sum(size**2, axis=-1)
    return Measures(
        np.sqrt(squares / size.shape[-1]), np.mean(size, axis=-1), np.max(size, axis=-1), squares
    )


@dataclass(frozen=True)
class Objective:
    """Equation (12) with frozen clearance motion; created by `frozen_objective`."""

    sine: np.ndarray  # shape (n,); sin theta2 at the evaluation points
    lift: (
        np.ndarray
    )  # shape (n,); r1 sin gamma1 + r2 sin gamma2 - r3 sin gamma3, minus the slide's offset [m]
    desired: (
        np.ndarray
    )  # shape (n,); transmission angle at the original lengths without clearance [rad]
    original: tuple[float, float]  # Original crank and rod length [m]

    def error(self, lengths: ArrayLike) -> np.ndarray:
        """mu_d - mu_a [rad], shape (..., n), for lengths (L2, L3) of shape (..., 2) [m]."""
        return self.desired - np.arccos(self._cosine(lengths))

    def measures(self, lengths: ArrayLike) -> Measures:
        """The four measures, shape (...), for lengths (L2, L3) of shape (..., 2) [m]."""
        return measure(self.error(lengths))

    def reductions(self, lengths: ArrayLike) -> Measures:
        """Relative reduction of each measure from the original lengths; shape (...), for lengths
        (..., 2)."""
        pairs = zip(self.measures(lengths), self.measures(self.original), strict=True)
        return Measures(*(1.0 - new / original for new, original in pairs))

    def sum_of_squares(self, lengths: ArrayLike) -> np.ndarray:
        """f(x) [rad^2], shape (...), for lengths (L2, L3) of shape (..., 2) [m]."""
        error = self.error(lengths)
        return np.einsum("...n,...n->...", error, error)

    def value(self, lengths: ArrayLike) -> np.ndarray:
        """The quantity to minimise, shape (...), for lengths (L2, L3) of shape (..., 2) [m]."""
        return self.sum_of_squares(lengths)

    def sizes(self, lengths: ArrayLike) -> dict[str, np.ndarray]:
        """The quantities of the table optimise_floor by name, shape (...), for lengths of shape
        (..., 2) [m]."""
        return self.measures(lengths)._asdict()

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Gradient of `value` with respect to (L2, L3) [rad^2/m], shape (2,), for lengths of shape
        (2,) [m]."""
        cosine = self._cosine(lengths)
        rod_length = np.asarray(lengths)[1]
        weight = 2.0 * (self.desired - np.arccos(cosine)) / (rod_length * np.sqrt(1.0 - cosine**2))
        return np.array([weight @ self.sine, -weight @ cosine])

    def _cosine(self, lengths: ArrayLike) -> np.ndarray:
        lengths = np.asarray(lengths)[..., None]
        return (lengths[..., 0, :] * self.sine + self.lift) / lengths[..., 1, :]


@dataclass(frozen=True)
class SimulatedObjective(Objective):
    """A force or torque of simulations; measures and reductions remain those of the transmission
    angle."""

    name: str  # Key of `GOALS`
    surface: Surface

    def value(self, lengths: ArrayLike) -> np.ndarray:
        return self.surface.value(lengths)

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        return self.surface.gradient(lengths)

    def sizes(self, lengths: ArrayLike) -> dict[str, np.ndarray]:
        return {self.name: self.value(lengths)}


@dataclass(frozen=True)
class Goal:
    """How an objective is reported."""

    words: str
    measure: str  # In the table optimise_resimulated
    unit: str  # Display unit
    definition: str  # After "over a settled revolution"

    @property
    def factor(self) -> float:
        """Display units per SI unit."""
        return np.degrees(1.0) if self.unit == "deg" else 1.0


GOALS = {
    "transmission_angle": Goal("error of the transmission angle", "rms", "deg", ""),
    "largest_pin_force": Goal(
        "largest pin force", "largest_pin_force", "N", "largest force in crank pin and piston pin"
    ),
    "torque_ripple": Goal(
        "torque ripple",
        "torque_ripple",
        "N m",
        "largest minus smallest torque of the drive on the crank",
    ),
}
"""By `optimise.objective`."""


def frozen_objective(mechanism: Mechanism, crank_angle: ArrayLike, lift: ArrayLike) -> Objective:
    """The objective for a clearance motion that is independent of the lengths."""
    crank_length, rod_length, offset = (
        mechanism.crank.length,
        mechanism.rod.length,
        mechanism.slider.offset,
    )
    transmission_angle(
        crank_length, rod_length, crank_angle, lift, offset
    )  # raises where the linkage has no solution
    return Objective(
        sine=np.sin(crank_angle),
        lift=np.asarray(lift) - offset,
        desired=transmission_angle(crank_length, rod_length, crank_angle, 0.0, offset),
        original=(crank_length, rod_length),
    )


def objective_of_motion(
    mechanism: Mechanism, crank_angle: ArrayLike, rod_angle: ArrayLike
) -> Objective:
    """The objective for a simulated motion; the rod's angle gives the contribution of the
    clearances."""
    # equation (10), solved for the clearances
    height = mechanism.crank.length * np.sin(crank_angle) + mechanism.rod.length * np.sin(rod_angle)
    return frozen_objective(mechanism, crank_angle, mechanism.slider.offset - height)


def evaluation_samples(
    crank_angle: ArrayLike,
    window: tuple[float, float],
    samples_per_revolution: int,
    training_points: int,
) -> np.ndarray:
    """Samples of a trajectory that the objective uses: held-out ones of the first revolution inside
    the window."""
    stride = samples_per_revolution // (training_points - 1)
    index = np.arange(min(samples_per_revolution + 1, len(crank_angle)))
    turned = np.asarray(crank_angle)[index] - crank_angle[0]
    slack = (
        np.pi / samples_per_revolution
    )  # half a sample: a window's ends do not depend on rounding
    inside = (turned >= window[0] - slack) & (turned <= window[1] + slack)
    return index[inside & (index % stride != 0)]


CRANK_LENGTHS, ROD_LENGTHS = 61, 37  # grid points: every 0.1 mm by 0.25 mm in the paper's box


def grid(objective: Objective, region: Region) -> pd.DataFrame:
    """The objective and the four measures over the box."""
    ends = zip(region.lower, region.upper, (CRANK_LENGTHS, ROD_LENGTHS), strict=True)
    rods, cranks = np.meshgrid(*[np.linspace(*each) for each in ends][::-1], indexing="ij")
    lengths = np.stack([cranks, rods], axis=-1)
    measures = [
        np.concatenate(rows) for rows in zip(*map(objective.measures, lengths), strict=True)
    ]
    return pd.DataFrame(
        {
            "crank_length": cranks.ravel(),
            "rod_length": rods.ravel(),
            "allowed": region.contains(lengths, slack=1e-12).ravel(),
            "objective": np.concatenate([objective.value(row) for row in lengths]),
            **dict(zip(MEASURES, measures, strict=True)),
        }
    )


def invariant(reduction: float, rod_length: float, name: str) -> float:
    """(1 - R) L3 [m], or (1 - R) L3^2 [m^2] for the sum of squares; constant along the valley's
    floor."""
    return (1.0 - reduction) * rod_length ** (2 if name == "sum_of_squares" else 1)


def best_cranks(objective: Objective, region: Region) -> pd.DataFrame:
    """The best crank length for each rod length and measure.

    For the transmission angle regardless of the crank's bounds and the inequality; for another
    objective within the crank lengths that the constraints allow.
    """
    rows, original = [], objective.sizes(objective.original)
    is_simulated = isinstance(objective, SimulatedObjective)
    allowed = (
        region.samples[:, 0] if region.constraints else np.array([region.lower[0], region.upper[0]])
    )
    cranks = np.linspace(allowed.min(), allowed.max(), CRANK_LENGTHS)
    for rod in np.linspace(region.lower[1], region.upper[1], ROD_LENGTHS):
        if is_simulated:  # has many minima
            values = objective.value(np.stack([cranks, np.full_like(cranks, rod)], axis=-1))
            best = {objective.name: float(cranks[np.argmin(values)])}
        else:
            best = {name: _best_crank(objective, region, rod, name) for name in MEASURES[:3]}
            best["sum_of_squares"] = best["rms"]  # a monotonic function of it
        for name, crank in best.items():
            found = {
                "measure": name,
                "crank_length": crank,
                "rod_length": rod,
                "ratio": crank / rod,
            }
            found["value"] = float(objective.sizes((crank, rod))[name])
            found["reduction"] = 1.0 - found["value"] / float(original[name])
            rows.append(
                found
                | {"invariant": None if is_simulated else invariant(found["reduction"], rod, name)}
            )
    return pd.DataFrame(rows)


def _best_crank(objective: Objective, region: Region, rod_length: float, name: str) -> float:
    """Crank length with the smallest measure; a norm of an error almost affine in L2 has one
    minimum."""
    result = minimize_scalar(
        lambda crank: float(getattr(objective.measures((crank, rod_length)), name)),
        bounds=(region.lower[0] - region.size[0], region.upper[0] + region.size[0]),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return float(result.x)


_MOST = 0.01
"""Largest deviation examined, as a share of the rod's length."""


def it7(length: float) -> float:
    """Width of the tolerance IT7 for a length [m]: 16 tolerance units of ISO 286-1, not rounded to
    its steps."""
    mm = 1e3 * length
    unit = 0.45 * mm ** (1 / 3) + 0.001 * mm if mm <= 500.0 else 0.004 * mm + 2.1
    return 16e-6 * unit


def tolerance_effect(
    objective: Objective, lengths: tuple[float, float], tolerance: float | None
) -> dict[str, float]:
    """Columns of the table optimise_optima about the rod's tolerance."""
    crank, rod = map(float, lengths)
    width = it7(rod) if tolerance is None else tolerance

    def rms(lengths: tuple[float, float]) -> float:
        return float(objective.measures(lengths).rms)

    size = objective.value if isinstance(objective, SimulatedObjective) else rms

    def off(deviation: float, size: Callable[[tuple[float, float]], float] = size) -> float:
        return max(float(size((crank, rod + side * deviation))) for side in (-1, 1))

    allowed, original = 0.0, float(size(objective.original))
    if off(0.0) < original:
        most = _MOST * rod
        allowed = (
            most
            if off(most) <= original
            else brentq(lambda deviation: off(deviation) - original, 0.0, most)
        )
    return {
        "rod_tolerance": width,
        "rms_rod_off": off(width / 2, rms),
        "rod_deviation_allowed": float(allowed),
    }
