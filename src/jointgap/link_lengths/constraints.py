"""What lengths have to meet besides their bounds: stroke, dead centres, space, and the largest force in a pin.

All but the force are functions of the lengths in closed form. The force is one of the simulated motion, and a rough
function of the lengths: contacts ring after each reversal of the load, and which swing meets the largest load changes
with a millimetre. So it is simulated on a fine grid over the box, and a surface through the grid stands for it in the
search (`PinForce`). What the lengths found carry in truth is simulated again afterwards.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RectBivariateSpline

from jointgap.config import Constraints

MM, DEG = 1e-3, math.pi / 180
MET = 1e-4
"""By how much, as a share of its scale, a constraint may be missed and counts as met: 0.1 um, 1e-4 deg."""


@dataclass(frozen=True)
class Constraint:
    """One property of the lengths and the range that it has to lie in."""

    key: str  # In the section `optimise.constraints`
    words: str  # Its name in a sentence
    unit: str  # That it is shown in
    scale: float  # That unit in SI; what is missed is counted in it
    low: float  # The range, in SI; infinite where there is no bound, equal where a value is fixed
    high: float  # The range, in SI; infinite where there is no bound, equal where a value is fixed
    value: Callable[[ArrayLike], np.ndarray]  # From lengths (L2, L3) of shape (..., 2) [m] to the property, shape (...)
    gradient: Callable[[ArrayLike], np.ndarray]
    is_relaxed: bool = False  # Whether the range is wider than the one asked for, which no lengths meet

    @property
    def is_fixed(self) -> bool:
        """Whether one value is asked for."""
        return self.low == self.high

    def missed(self, lengths: ArrayLike) -> np.ndarray:
        """How far the property lies outside its range, in `scale`; shape (...), for lengths (..., 2) [m]."""
        value = self.value(lengths)
        return np.maximum(np.maximum(self.low - value, value - self.high), 0.0) / self.scale

    def active(self, lengths: ArrayLike) -> str:
        """The end of the range that `lengths` (2,) lie at, in words; empty where they lie inside, of a fixed value, and
        of a range that nobody asked for.
        """
        if self.is_relaxed or self.is_fixed:
            return ""
        value = float(self.value(lengths))
        for end, words in ((self.low, "lower"), (self.high, "upper")):
            if abs(value - end) <= 10 * MET * self.scale:
                return f"{self.words} at its {words} limit {self.show(end)}"
        return ""

    def asked(self) -> str:
        """The range in words."""
        if self.is_fixed:
            return self.show(self.low)
        if math.isinf(self.low):
            return f"{self.show(self.high)} at most"
        return f"{self.low / self.scale:.6g} to {self.show(self.high)}"

    def show(self, value: float) -> str:
        """A `value` of the property with its unit."""
        return f"{value / self.scale:.6g} {self.unit}"


def geometric(options: Constraints, offset: float) -> tuple[Constraint, ...]:
    """Those that follow from the lengths alone."""
    return tuple(_geometric(options, offset))


def depends_on_offset(options: Constraints) -> str:
    """Key of the first constraint of `options` that depends on the slide's offset; empty where none does."""
    return next((each.key for each in _geometric(options, 0.0) if each.key != "crank_length"), "")


def _geometric(options: Constraints, offset: float) -> Iterator[Constraint]:
    outer, inner = _dead_centre(offset, 1.0), _dead_centre(offset, -1.0)
    properties = {
        "crank_length": ("crank length", _crank, lambda at: np.zeros(np.shape(at)) + np.array([1.0, 0.0])),
        "stroke": ("stroke", lambda at: outer[0](at) - inner[0](at), lambda at: outer[1](at) - inner[1](at)),
        "outer_dead_centre": ("outer dead centre", *outer),
        "inner_dead_centre": ("inner dead centre", *inner),
    }
    for key, (words, value, gradient) in properties.items():
        if (limits := getattr(options, key)) is not None:
            yield Constraint(key, words, "mm", MM, *limits, value, gradient)
    for side, key in ((1.0, "outer_dead_centre_angle"), (-1.0, "inner_dead_centre_angle")):
        limits = getattr(options, key)
        met_by_all = offset == 0.0 and limits is not None and limits[0] <= (0.0 if side > 0 else np.pi) <= limits[1]
        if limits is not None and not met_by_all:
            words = f"crank angle of the {key.partition('_')[0]} dead centre"
            yield Constraint(key, words, "deg", DEG, *limits, *_dead_centre_angle(offset, side))
    across = max(offset, 0.0) - min(offset, 0.0)
    most = {
        # from the crank pin at its farthest on the other side to the outer dead centre
        "length_along": (
            "length along the slide",
            lambda at: outer[0](at) + _crank(at),
            lambda at: outer[1](at) + np.array([1.0, 0.0]),
        ),
        # the crank's circle, and the slide where it lies outside it
        "length_across": (
            "length across the slide",
            lambda at: _crank(at) + np.maximum(_crank(at), across),
            lambda at: np.stack([np.where(_crank(at) > across, 2.0, 1.0), np.zeros_like(_crank(at))], axis=-1),
        ),
    }
    for key, (words, value, gradient) in most.items():
        if (limit := getattr(options, key)) is not None:
            yield Constraint(key, words, "mm", MM, -math.inf, limit, value, gradient)


def _crank(lengths: ArrayLike) -> np.ndarray:
    return np.asarray(lengths)[..., 0]


def _dead_centre(offset: float, side: float) -> tuple[Callable, Callable]:
    """Position of the slider where crank and rod lie in line, outstretched (`side` 1) or folded (-1), and gradient."""

    def value(lengths: ArrayLike) -> np.ndarray:
        lengths = np.asarray(lengths)
        return np.sqrt((lengths[..., 1] + side * lengths[..., 0]) ** 2 - offset**2)

    def gradient(lengths: ArrayLike) -> np.ndarray:
        lengths = np.asarray(lengths)
        slope = (lengths[..., 1] + side * lengths[..., 0]) / value(lengths)
        return slope[..., None] * np.array([side, 1.0])

    return value, gradient


def _dead_centre_angle(offset: float, side: float) -> tuple[Callable, Callable]:
    """Crank angle there, and its gradient."""

    def value(lengths: ArrayLike) -> np.ndarray:
        lengths = np.asarray(lengths)
        return np.arcsin(offset / (lengths[..., 1] + side * lengths[..., 0])) + (0.0 if side > 0 else np.pi)

    def gradient(lengths: ArrayLike) -> np.ndarray:
        lengths = np.asarray(lengths)
        reach = lengths[..., 1] + side * lengths[..., 0]
        slope = -offset / (reach * np.sqrt(reach**2 - offset**2))
        return slope[..., None] * np.array([side, 1.0])

    return value, gradient


class PinForce:
    """The largest force in a pin over a box of lengths: a surface of cubic splines through a grid of simulations."""

    def __init__(self, cranks: np.ndarray, rods: np.ndarray, forces: np.ndarray, factor: float = 1.0):
        self.cranks, self.rods, self.forces, self.factor = cranks, rods, forces, factor
        self._surface = RectBivariateSpline(cranks, rods, forces, kx=3, ky=3)

    def value(self, lengths: ArrayLike) -> np.ndarray:
        """The force [N], shape (...), at lengths of shape (..., 2) [m]."""
        lengths = np.asarray(lengths)
        return self.factor * self._surface.ev(lengths[..., 0], lengths[..., 1])

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Its derivative by lengths of shape (..., 2) [N/m], shape (..., 2)."""
        crank, rod = np.moveaxis(np.asarray(lengths), -1, 0)
        slopes = [self._surface.ev(crank, rod, dx=1), self._surface.ev(crank, rod, dy=1)]
        return self.factor * np.stack(slopes, axis=-1)

    def raised(self, factor: float) -> "PinForce":
        """The surface raised by a further `factor`."""
        return PinForce(self.cranks, self.rods, self.forces, self.factor * factor)

    def limited(self, most: float, is_relaxed: bool = False) -> Constraint:
        """The constraint that the force is `most` [N] at most, or that it `is_relaxed` to that."""
        words = "largest force in a pin"
        return Constraint("largest_pin_force", words, "N", 1.0, -math.inf, most, self.value, self.gradient, is_relaxed)
