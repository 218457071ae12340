"""The error of the transmission angle as a function of the link lengths, equation (12)."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from jointgap.config import Mechanism
from jointgap.mechanism import transmission_angle


@dataclass(frozen=True)
class Measures:
    """Four sizes of one error; floats, or arrays of one shape for several errors."""

    rms: np.ndarray  # Root of the mean square, mean of the size, largest size [rad]
    mean_absolute: np.ndarray  # Root of the mean square, mean of the size, largest size [rad]
    peak: np.ndarray  # Root of the mean square, mean of the size, largest size [rad]
    sum_of_squares: np.ndarray  # What equation (12) minimises [rad^2]; grows with the number of samples


MEASURES = tuple(field.name for field in fields(Measures))


def measure(error: ArrayLike) -> Measures:
    """The four measures of `error` [rad], shape (..., n), over its last axis."""
    size = np.abs(error)
    squares = np.sum(size**2, axis=-1)
    return Measures(np.sqrt(squares / size.shape[-1]), np.mean(size, axis=-1), np.max(size, axis=-1), squares)


def reductions(measures: Measures, original: Measures) -> Measures:
    """By which fraction each measure lies below that of the original lengths; negative where it grew."""
    return Measures(*(1.0 - getattr(measures, name) / getattr(original, name) for name in MEASURES))


@dataclass(frozen=True)
class Objective:
    """Equation (12) with the clearance motion frozen; make it with `frozen_objective`."""

    sine: np.ndarray  # shape (n,); sin theta2 at the evaluation points
    lift: np.ndarray  # shape (n,); r1 sin gamma1 + r2 sin gamma2 - r3 sin gamma3 there, less the slide's offset [m]
    desired: np.ndarray  # shape (n,); transmission angle at the original lengths without clearance [rad]
    original: tuple[float, float]  # Original crank and rod length [m]

    def error(self, lengths: ArrayLike) -> np.ndarray:
        """mu_d - mu_a [rad], shape (..., n), for lengths (L2, L3) of shape (..., 2) [m]."""
        return self.desired - np.arccos(self._cosine(lengths))

    def measures(self, lengths: ArrayLike) -> Measures:
        """The four measures, shape (...), for lengths (L2, L3) of shape (..., 2) [m]."""
        return measure(self.error(lengths))

    def reductions(self, lengths: ArrayLike) -> Measures:
        """The four reductions against the original lengths, shape (...), for lengths of shape (..., 2) [m]."""
        return reductions(self.measures(lengths), self.measures(self.original))

    def value(self, lengths: ArrayLike) -> np.ndarray:
        """f(x), the sum of squares [rad^2], shape (...), for lengths (L2, L3) of shape (..., 2) [m]."""
        error = self.error(lengths)
        return np.einsum("...n,...n->...", error, error)

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Derivative of `value` by (L2, L3) [rad^2/m], shape (2,), for lengths of shape (2,) [m]."""
        cosine = self._cosine(lengths)
        rod_length = np.asarray(lengths)[1]
        weight = 2.0 * (self.desired - np.arccos(cosine)) / (rod_length * np.sqrt(1.0 - cosine**2))
        return np.array([weight @ self.sine, -weight @ cosine])

    def _cosine(self, lengths: ArrayLike) -> np.ndarray:
        lengths = np.asarray(lengths)[..., None]
        return (lengths[..., 0, :] * self.sine + self.lift) / lengths[..., 1, :]


def frozen_objective(mechanism: Mechanism, crank_angle: ArrayLike, lift: ArrayLike) -> Objective:
    """The objective for a clearance motion that does not answer to the lengths."""
    crank_length, rod_length, offset = mechanism.crank.length, mechanism.rod.length, mechanism.slider.offset
    transmission_angle(crank_length, rod_length, crank_angle, lift, offset)  # refuses what cannot be assembled
    return Objective(
        sine=np.sin(crank_angle),
        lift=np.asarray(lift) - offset,
        desired=transmission_angle(crank_length, rod_length, crank_angle, 0.0, offset),
        original=(crank_length, rod_length),
    )


def objective_of_motion(mechanism: Mechanism, crank_angle: ArrayLike, rod_angle: ArrayLike) -> Objective:
    """The objective on a simulated motion: what clearances add to the rod's height is read from the rod's angle."""
    # equation (10) solved for the clearances' share
    height = mechanism.crank.length * np.sin(crank_angle) + mechanism.rod.length * np.sin(rod_angle)
    return frozen_objective(mechanism, crank_angle, mechanism.slider.offset - height)


def evaluation_samples(
    crank_angle: ArrayLike, window: tuple[float, float], samples_per_revolution: int, training_points: int
) -> np.ndarray:
    """Which samples of a trajectory the objective counts: held-out ones of the first revolution inside the window."""
    stride = samples_per_revolution // (training_points - 1)
    index = np.arange(min(samples_per_revolution + 1, len(crank_angle)))
    turned = np.asarray(crank_angle)[index] - crank_angle[0]
    slack = np.pi / samples_per_revolution  # half a sample: a window's ends do not hang on rounding
    inside = (turned >= window[0] - slack) & (turned <= window[1] + slack)
    return index[inside & (index % stride != 0)]
