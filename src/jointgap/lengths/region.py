"""The region of admissible lengths."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RectBivariateSpline

from jointgap.config import Box, Constraints, Mechanism, Optimise, Scenario
from jointgap.core.errors import InputError

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


NAMES = ("crank length", "rod length")
SAMPLES = 41  # points along each length by which it is told whether any lengths meet the constraints
_MOST_STEPS = 60  # of Newton's method onto the constraints, which takes three or four where it converges
_LONGEST_STEP = 0.5  # [widths of the box]
NEAR = 1e-6  # [m] a length this close to its bound is at it: a thousandth of the digits the paper prints


@dataclass(frozen=True)
class Region:
    """A convex region of lengths (L2, L3), and in it the constraints that these have to meet."""

    lower: np.ndarray  # shape (2,); bounds of (L2, L3) [m]
    upper: np.ndarray  # shape (2,); bounds of (L2, L3) [m]
    ratio_limit: float  # g(x) = L2 - ratio_limit L3 <= 0; 1 where nothing else is asked for: the crank can turn
    constraints: tuple[Constraint, ...] = ()  # They may leave a curve or a point of the region

    @classmethod
    def of(cls, box: Box, ratio_limit: float | None) -> "Region":
        """The region of one configured box."""
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

    def under(self, constraints: Iterable[Constraint], name: str = "") -> "Region":
        """The region with further `constraints`."""
        under = replace(self, constraints=(*self.constraints, *constraints))
        if under.constraints and not len(under.samples):
            raise InputError(under._unmet(name))
        return under

    @cached_property
    def _spread(self) -> np.ndarray:
        """Points all over the region, moved onto its constraints as far as these can be met, shape (n, 2) [m]."""
        shares = np.linspace(0.0, 1.0, SAMPLES)
        return self.onto(np.array([self.lower + np.array([x, y]) * self.size for x in shares for y in shares]))

    @cached_property
    def samples(self) -> np.ndarray:
        """Those of many points all over the region that meet the constraints, shape (n, 2) [m]."""
        return self._spread[self.missed(self._spread) <= MET]

    def _unmet(self, name: str) -> str:
        """That the constraints cannot be met, by how much the nearest lengths miss them, and what can be reached."""
        best, words = self._spread[np.argmin(self.missed(self._spread))], []
        for constraint in self.constraints:
            if not len(replace(self, constraints=(constraint,)).samples):
                reached = [float(constraint.value(point)) for point in self._corners()]
                low, high = (constraint.show(end) for end in (min(reached), max(reached)))
                words.append(
                    f"{constraint.key} {constraint.asked()} cannot be reached: within the bounds it is {low} to {high}"
                )
        if not words:
            keys = " and ".join(constraint.key for constraint in self.constraints)
            found = ", ".join(f"{each.key} {each.show(float(each.value(best)))}" for each in self.constraints)
            words.append(f"no lengths within the bounds meet {keys} together; nearest is {found}")
        crank, rod = 1e3 * best
        return (
            f"optimise.constraints, box {name}: {'; '.join(words)} (nearest: crank {crank:.6g} mm, rod {rod:.6g} mm); "
            "give wider bounds in optimise.boxes (without any they are 5 % about the mechanism's lengths), or another "
            "constraint"
        )

    def _corners(self) -> np.ndarray:
        """The region's corners, between which every geometric property is monotone [m]."""
        (low, high), (short, long) = zip(self.lower, self.upper, strict=True)
        box = [(crank, rod) for crank in (low, high) for rod in (short, long)]
        cut = [(crank, crank / self.ratio_limit) for crank in (low, high)]
        cut += [(self.ratio_limit * rod, rod) for rod in (short, long)]
        points = np.array([*box, *cut])
        return points[self.contains(points, slack=1e-12)]

    def missed(self, lengths: ArrayLike) -> np.ndarray:
        """How far the constraints are from met, each in its scale, added; shape (...), for lengths (..., 2) [m]."""
        lengths = np.asarray(lengths)
        return sum((each.missed(lengths) for each in self.constraints), np.zeros(lengths.shape[:-1]))

    def conditions(self) -> list[dict]:
        """Inequality and constraints as scipy's SLSQP takes them, on lengths scaled to the box."""
        slope = -self._slope * self.size / self.size[0]
        conditions = [
            {
                "type": "ineq",
                "fun": lambda scaled: -self.inequality(self.unscaled(scaled)) / self.size[0],
                "jac": lambda scaled: slope,
            }
        ]
        for each in self.constraints:
            ends = [("eq", 1.0, each.low)] if each.is_fixed else [("ineq", 1.0, each.low), ("ineq", -1.0, each.high)]
            conditions += [self._condition(each, *end) for end in ends if np.isfinite(end[2])]
        return conditions

    def _condition(self, constraint: Constraint, kind: str, sign: float, end: float) -> dict:
        return {
            "type": kind,
            "fun": lambda scaled: sign * (constraint.value(self.unscaled(scaled)) - end) / constraint.scale,
            "jac": lambda scaled: sign * constraint.gradient(self.unscaled(scaled)) * self.size / constraint.scale,
        }

    def unscaled(self, scaled: np.ndarray) -> np.ndarray:
        """Lengths [m] of `scaled` ones, which are 0 to 1 between the bounds."""
        return self.lower + scaled * self.size

    def onto(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (n, 2) moved onto the bounds, the inequality and the constraints, each a short way [m].

        Newton's method with the shortest step, in widths of the box, that meets all that is missed to first order.
        Where no lengths meet all, or the way there leads over a hill, they come as near as such steps lead.
        """
        ratio = Constraint(
            "ratio_limit", "", "", self.size[0], -np.inf, 0.0, self.inequality, lambda at: at * 0.0 + self._slope
        )
        asked = (ratio, *self.constraints)
        scaled = np.clip((np.asarray(lengths, dtype=float) - self.lower) / self.size, 0.0, 1.0)
        for _ in range(_MOST_STEPS):
            at = self.unscaled(scaled)
            values = np.stack([each.value(at) for each in asked], axis=-1)
            low, high, scale = (np.array([getattr(each, key) for each in asked]) for key in ("low", "high", "scale"))
            gaps = (np.clip(values, low, high) - values) / scale
            if np.abs(gaps).max(initial=0.0) <= 0.1 * MET:
                break
            slopes = np.stack([each.gradient(at) * self.size / each.scale for each in asked], axis=-2)
            steps = (np.linalg.pinv(slopes * (gaps != 0.0)[..., None]) @ gaps[..., None])[..., 0]
            length = np.linalg.norm(steps, axis=-1, keepdims=True)
            scaled = np.clip(scaled + steps * np.minimum(1.0, _LONGEST_STEP / np.maximum(length, 1e-300)), 0.0, 1.0)
        return self.unscaled(scaled)

    @property
    def _slope(self) -> np.ndarray:
        """Derivative of the inequality by the lengths, shape (2,)."""
        return np.array([1.0, -self.ratio_limit])

    def nearest(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (n, 2) or (2,) moved a short way to such as meet the constraints, or near them where none do."""
        lengths = np.asarray(lengths, dtype=float)
        if lengths.ndim == 1:
            return self.nearest(lengths[None])[0]
        moved = np.array([self.clip(each) for each in lengths])
        if not self.constraints:
            return moved
        wrong = self.missed(moved) > 0.0
        moved[wrong] = self.onto(moved[wrong])
        for number in np.flatnonzero(self.missed(moved) > MET) if len(self.samples) else ():
            distances = np.linalg.norm((self.samples - lengths[number]) / self.size, axis=1)
            moved[number] = self.samples[np.argmin(distances)]
        return moved

    def lowest(self, constraint: Constraint) -> np.ndarray:
        """The lengths (2,) that meet all, of many, at which the property of a further `constraint` is smallest."""
        return self.samples[np.argmin(constraint.value(self.samples))]

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
        """`count` points spread evenly over the region, shape (count, 2) [m]."""
        points = np.empty((0, 2))
        while len(points) < count:
            drawn = self.lower + random.random((count, 2)) * self.size
            points = np.concatenate([points, drawn[self.contains(drawn)]])
        return points[:count]

    def reach(self, start: ArrayLike, step: ArrayLike) -> float:
        """The largest factor, at most 1, by which `step` (2,) can be taken from `start` (2,) without leaving."""
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
        """The bounds, inequality and constraints that `lengths` (2,) lie at, in words; ``'none'`` if none."""
        words = []
        for name, value, low, high in zip(NAMES, np.asarray(lengths), self.lower, self.upper, strict=True):
            if value <= low + NEAR:
                words.append(f"{name} at its lower bound {1e3 * low:g} mm")
            elif value >= high - NEAR:
                words.append(f"{name} at its upper bound {1e3 * high:g} mm")
        if self.inequality(lengths) >= -NEAR:
            words.append(f"crank length at {self.ratio_limit:g} times the rod length")
        words += [text for each in self.constraints if (text := each.active(lengths))]
        return "; ".join(words) or "none"


def regions(mechanism: Mechanism, options: Optimise) -> dict[str, Region]:
    """Where the lengths may lie in each box, by its name, under the constraints that follow from the lengths alone."""
    constraints = geometric(options.constraints, mechanism.slider.offset)
    return {name: Region.of(box, options.ratio_limit).under(constraints, name) for name, box in options.boxes.items()}


def check_constraints(scenarios: Mapping[str, Scenario], source: str = "configuration") -> None:
    """Whether the constraints of each scenario leave lengths to search, before hours are spent."""
    for name, scenario in scenarios.items():
        try:
            regions(scenario.mechanism.applied(), scenario.optimise)
        except InputError as error:
            raise InputError(f"{source}, scenario {name}: {error}") from None
