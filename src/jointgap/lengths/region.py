"""The region of admissible lengths."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import RectBivariateSpline

from jointgap.config import Box, Constraints, Mechanism, Optimise, Scenario
from jointgap.core.errors import InputError

SCALES = {"mm": 1e-3, "deg": math.pi / 180, "N": 1.0}
"""Units that properties of lengths are shown in, in SI."""

MET = 1e-4
"""By how much, as a share of its scale, a constraint may be missed and counts as met: 0.1 um, 1e-4 deg."""

_STEP = 1e-30  # [m] along the imaginary axis: derivatives without cancellation


@dataclass(frozen=True)
class Constraint:
    """One property of the lengths and the range that it has to lie in."""

    key: str  # In the section `optimise.constraints`
    words: str  # Its name in a sentence
    unit: str  # That it is shown in; what is missed is counted in it
    low: float  # The range, in SI; infinite where there is no bound
    high: float  # Equal to `low` where a value is fixed
    value: Callable[[ArrayLike], np.ndarray]  # From lengths (L2, L3) of shape (..., 2) [m] to the property, shape (...)
    slope: Callable[[ArrayLike], np.ndarray] | None = None  # Its derivative, where `value` takes no complex lengths
    is_relaxed: bool = False  # Whether the range is wider than the one asked for, which no lengths meet

    @property
    def is_fixed(self) -> bool:
        """Whether one value is asked for."""
        return self.low == self.high

    @property
    def scale(self) -> float:
        """Its unit in SI."""
        return SCALES[self.unit]

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Derivative by the lengths, of their shape (..., 2)."""
        if self.slope:
            return self.slope(lengths)
        steps = [self.value(np.asarray(lengths) + step).imag / _STEP for step in 1j * _STEP * np.eye(2)]
        return np.stack(steps, axis=-1)

    def missed(self, lengths: ArrayLike) -> np.ndarray:
        """How far the property lies outside its range, in its unit; shape (...), for lengths (..., 2) [m]."""
        value = self.value(lengths)
        return np.maximum(np.maximum(self.low - value, value - self.high), 0.0) / self.scale

    def active(self, lengths: ArrayLike) -> str:
        """The end of the range that `lengths` (2,) lie at, in words; empty where they lie inside, of a fixed value, and
        of a range that nobody asked for.
        """
        value = float(self.value(lengths))
        for end, words in ((self.low, "lower"), (self.high, "upper")):
            if not self.is_relaxed and not self.is_fixed and abs(value - end) <= 10 * MET * self.scale:
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
    across = max(offset, 0.0) - min(offset, 0.0)

    def crank(lengths: ArrayLike) -> np.ndarray:
        return np.asarray(lengths)[..., 0]

    def reach(lengths: ArrayLike, side: float) -> np.ndarray:
        return np.asarray(lengths)[..., 1] + side * crank(lengths)

    def dead_centre(lengths: ArrayLike, side: float) -> np.ndarray:
        return np.sqrt(reach(lengths, side) ** 2 - offset**2)

    def angle(lengths: ArrayLike, side: float) -> np.ndarray:
        return np.arcsin(offset / reach(lengths, side)) + (0.0 if side > 0 else np.pi)

    properties = {
        "crank_length": ("crank length", "mm", crank),
        "stroke": ("stroke", "mm", lambda at: dead_centre(at, 1.0) - dead_centre(at, -1.0)),
        "outer_dead_centre": ("outer dead centre", "mm", partial(dead_centre, side=1.0)),
        "inner_dead_centre": ("inner dead centre", "mm", partial(dead_centre, side=-1.0)),
        "outer_dead_centre_angle": ("crank angle of the outer dead centre", "deg", partial(angle, side=1.0)),
        "inner_dead_centre_angle": ("crank angle of the inner dead centre", "deg", partial(angle, side=-1.0)),
        # from the crank pin at its farthest on the other side to the outer dead centre
        "length_along": ("length along the slide", "mm", lambda at: dead_centre(at, 1.0) + crank(at)),
        # the crank's circle, and the slide where it lies outside it
        "length_across": ("length across the slide", "mm", lambda at: crank(at) + np.maximum(crank(at), across)),
    }
    found = []
    for key, (words, unit, value) in properties.items():
        asked = getattr(options, key)
        low, high = asked if isinstance(asked, tuple) else (-math.inf, asked)
        always_met = unit == "deg" and offset == 0.0
        if asked is not None and not (always_met and low <= value((0.0, 1.0)) <= high):
            found.append(Constraint(key, words, unit, low, high, value))
    return tuple(found)


def depends_on_offset(options: Constraints) -> str:
    """Key of the first constraint of `options` that depends on the slide's offset; empty where none does."""
    return next((each.key for each in geometric(options, 0.0) if each.key != "crank_length"), "")


@dataclass(frozen=True)
class PinForce:
    """The largest force in a pin over a box of lengths [m]: a surface [N] through a grid of simulations."""

    surface: RectBivariateSpline
    factor: float = 1.0  # That it is raised by

    def value(self, lengths: ArrayLike) -> np.ndarray:
        """The force [N], shape (...), at lengths of shape (..., 2) [m]."""
        return self.factor * self.surface.ev(*np.moveaxis(np.asarray(lengths), -1, 0))

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Its derivative by lengths of shape (..., 2) [N/m], shape (..., 2)."""
        at = np.moveaxis(np.asarray(lengths), -1, 0)
        slopes = [self.surface.ev(*at, dx=1), self.surface.ev(*at, dy=1)]
        return self.factor * np.stack(slopes, axis=-1)

    def limited(self, most: float, is_relaxed: bool = False) -> Constraint:
        """The constraint that the force is `most` [N] at most, or that it `is_relaxed` to that."""
        words = "largest force in a pin"
        return Constraint("largest_pin_force", words, "N", -math.inf, most, self.value, self.gradient, is_relaxed)


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
                reached = constraint.value(replace(self, constraints=()).samples)
                low, high = constraint.show(reached.min()), constraint.show(reached.max())
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

    def missed(self, lengths: ArrayLike) -> np.ndarray:
        """How far the constraints are from met, each in its scale, added; shape (...), for lengths (..., 2) [m]."""
        lengths = np.asarray(lengths)
        return sum((each.missed(lengths) for each in self.constraints), np.zeros(lengths.shape[:-1]))

    def conditions(self) -> list[dict]:
        """Inequality and constraints as scipy's SLSQP takes them, on lengths scaled to the box."""
        slope = np.array([-1.0, self.ratio_limit]) * self.size / self.size[0]

        def condition(each: Constraint, kind: str, sign: float, end: float) -> dict:
            return {
                "type": kind,
                "fun": lambda scaled: sign * (each.value(self.unscaled(scaled)) - end) / each.scale,
                "jac": lambda scaled: sign * each.gradient(self.unscaled(scaled)) * self.size / each.scale,
            }

        def inequality(scaled: np.ndarray) -> float:
            return -self.inequality(self.unscaled(scaled)) / self.size[0]

        conditions = [{"type": "ineq", "fun": inequality, "jac": lambda scaled: slope}]
        for each in self.constraints:
            ends = [("eq", 1.0, each.low)] if each.is_fixed else [("ineq", 1.0, each.low), ("ineq", -1.0, each.high)]
            conditions += [condition(each, *end) for end in ends if np.isfinite(end[2])]
        return conditions

    def unscaled(self, scaled: np.ndarray) -> np.ndarray:
        """Lengths [m] of `scaled` ones, which are 0 to 1 between the bounds."""
        return self.lower + scaled * self.size

    def onto(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (n, 2) moved onto the bounds, the inequality and the constraints, each a short way [m].

        Newton's method with the shortest step, in widths of the box, that meets all that is missed to first order.
        Where no lengths meet all, or the way there leads over a hill, they come as near as such steps lead.
        """
        ratio = Constraint("ratio_limit", "", "mm", -np.inf, 0.0, self.inequality)
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

    def nearest(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (n, 2) or (2,) moved a short way to such as meet the constraints, or near them where none do."""
        lengths = np.asarray(lengths, dtype=float)
        moved = self.clip(lengths)
        if not self.constraints:
            return moved
        points, asked = np.atleast_2d(moved), np.atleast_2d(lengths)
        wrong = self.missed(points) > 0.0
        points[wrong] = self.onto(points[wrong])
        for number in np.flatnonzero(self.missed(points) > MET) if len(self.samples) else ():
            distances = np.linalg.norm((self.samples - asked[number]) / self.size, axis=1)
            points[number] = self.samples[np.argmin(distances)]
        return points.reshape(lengths.shape)

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

    def reach(self, start: ArrayLike, step: ArrayLike) -> np.ndarray:
        """The largest factor, at most 1, by which each step (..., 2) can be taken from `start` (..., 2)."""
        start, step = np.asarray(start), np.asarray(step)
        room = np.where(step > 0.0, self.upper - start, start - self.lower)
        room = np.concatenate([room, -self.inequality(start)[..., None]], axis=-1)
        speed = np.concatenate([np.abs(step), self.inequality(step)[..., None]], axis=-1)
        limits = np.divide(room, speed, out=np.ones_like(room), where=speed > 0.0)
        return np.clip(limits.min(axis=-1), 0.0, 1.0)

    def clip(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (..., 2) moved onto the bounds; then the crank shortened or the rod lengthened, to the inequality."""
        crank, rod = np.moveaxis(np.clip(lengths, self.lower, self.upper), -1, 0)
        crank = np.maximum(self.lower[0], np.minimum(crank, self.ratio_limit * rod))
        return np.stack([crank, np.maximum(rod, crank / self.ratio_limit)], axis=-1)

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
