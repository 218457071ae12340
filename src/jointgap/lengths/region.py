"""The feasible region of the lengths."""

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
"""Display units of properties, in SI."""

FEASIBLE = 1e-4
"""Tolerance of a constraint over its scale: 0.1 um, 1e-4 deg."""

FORCE_TOLERANCE = 1.005
"""Tolerance of the force limit for the median of an ensemble."""

LEAST_FORCE = "least_force"
"""Method, in the table optimise_optima, of the lengths with the smallest pin force in a box without
an optimum."""

_STEP = 1e-30  # [m] complex step: derivatives without cancellation


@dataclass(frozen=True)
class Constraint:
    """A property of the lengths and its range."""

    key: str  # In the section `optimise.constraints`
    words: str  # Label
    unit: str  # Display unit
    low: float  # Range in SI; infinite without a bound
    high: float  # Equal to `low` for an equality constraint
    value: Callable[
        [ArrayLike], np.ndarray
    ]  # Property, shape (...), of lengths (L2, L3) of shape (..., 2) [m]
    slope: Callable[[ArrayLike], np.ndarray] | None = (
        None  # Its gradient, where `value` takes no complex lengths
    )

    @property
    def is_fixed(self) -> bool:
        """Whether it is an equality constraint."""
        return self.low == self.high

    @property
    def scale(self) -> float:
        """Its display unit in SI."""
        return SCALES[self.unit]

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Gradient with respect to the lengths, of their shape (..., 2)."""
        if self.slope:
            return self.slope(lengths)
        steps = [
            self.value(np.asarray(lengths) + step).imag / _STEP for step in 1j * _STEP * np.eye(2)
        ]
        return np.stack(steps, axis=-1)

    def violation(self, lengths: ArrayLike) -> np.ndarray:
        """Violation in the display unit; shape (...), for lengths (..., 2) [m]."""
        value = self.value(lengths)
        return np.maximum(np.maximum(self.low - value, value - self.high), 0.0) / self.scale

    def active(self, lengths: ArrayLike) -> str:
        """Label of the limit that is active at `lengths` (2,); empty where none is and for equality
        constraints."""
        value = float(self.value(lengths))
        for end, words in ((self.low, "lower"), (self.high, "upper")):
            if not self.is_fixed and abs(value - end) <= 10 * FEASIBLE * self.scale:
                return f"{self.words} at its {words} limit {self.show(end)}"
        return ""

    def range_text(self) -> str:
        """The range as text."""
        if self.is_fixed:
            return self.show(self.low)
        if math.isinf(self.low):
            return f"{self.show(self.high)} at most"
        return f"{self.low / self.scale:.6g} to {self.show(self.high)}"

    def show(self, value: float) -> str:
        """A `value` of the property with its unit."""
        return f"{value / self.scale:.6g} {self.unit}"


def geometric(options: Constraints, offset: float) -> tuple[Constraint, ...]:
    """Constraints that depend on the lengths only."""
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
        "outer_dead_centre_angle": (
            "crank angle of the outer dead centre",
            "deg",
            partial(angle, side=1.0),
        ),
        "inner_dead_centre_angle": (
            "crank angle of the inner dead centre",
            "deg",
            partial(angle, side=-1.0),
        ),
        # from the crank pin's farthest point on the other side to the outer dead centre
        "length_along": (
            "length along the slide",
            "mm",
            lambda at: dead_centre(at, 1.0) + crank(at),
        ),
        # the crank's circle, extended to the slide
        "length_across": (
            "length across the slide",
            "mm",
            lambda at: crank(at) + np.maximum(crank(at), across),
        ),
    }
    found = []
    for key, (words, unit, value) in properties.items():
        ranges = getattr(options, key)
        low, high = ranges if isinstance(ranges, tuple) else (-math.inf, ranges)
        always_met = unit == "deg" and offset == 0.0
        if ranges is not None and not (always_met and low <= value((0.0, 1.0)) <= high):
            found.append(Constraint(key, words, unit, low, high, value))
    return tuple(found)


def depends_on_offset(options: Constraints) -> str:
    """Key of the first constraint of `options` that depends on the slide's offset, or ''."""
    return next((each.key for each in geometric(options, 0.0) if each.key != "crank_length"), "")


@dataclass(frozen=True)
class Surface:
    """A quantity [SI] over a box of lengths [m], through a grid of simulations."""

    surface: RectBivariateSpline
    factor: float = 1.0  # Correction

    def value(self, lengths: ArrayLike) -> np.ndarray:
        """The quantity, shape (...), at lengths of shape (..., 2) [m]."""
        return self.factor * self.surface.ev(*np.moveaxis(np.asarray(lengths), -1, 0))

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Its gradient with respect to lengths of shape (..., 2) [m], shape (..., 2)."""
        at = np.moveaxis(np.asarray(lengths), -1, 0)
        slopes = [self.surface.ev(*at, dx=1), self.surface.ev(*at, dy=1)]
        return self.factor * np.stack(slopes, axis=-1)

    def limited(self, most: float) -> Constraint:
        """The constraint that the quantity, a pin force, is at most `most` [N]."""
        words = "largest force in a pin"
        return Constraint(
            "largest_pin_force", words, "N", -math.inf, most, self.value, self.gradient
        )


NAMES = ("crank length", "rod length")
SAMPLES = 41  # grid points per length for the feasibility check
_MOST_STEPS = 60  # of Newton's method, which typically needs three or four
_LONGEST_STEP = 0.5  # [widths of the box]
NEAR = 1e-6  # [m] distance below which a bound is active: a thousandth of the paper's digits


@dataclass(frozen=True)
class Region:
    """A convex region of lengths (L2, L3) with constraints."""

    lower: np.ndarray  # shape (2,); bounds of (L2, L3) [m]
    upper: np.ndarray  # shape (2,); bounds of (L2, L3) [m]
    ratio_limit: float  # g(x) = L2 - ratio_limit L3 <= 0; 1 by default: the crank can turn
    constraints: tuple[Constraint, ...] = ()  # They may reduce the region to a curve or a point

    @classmethod
    def of(cls, box: Box, ratio_limit: float | None) -> "Region":
        """The region of one configured box."""
        lower, upper = np.transpose([box.crank_length, box.rod_length])
        ratio_limit = 1.0 if ratio_limit is None else ratio_limit
        if lower[0] - ratio_limit * upper[1] >= 0.0:
            raise InputError(
                f"ratio_limit {ratio_limit:g} excludes the whole box: the shortest crank,"
                f" {1e3 * lower[0]:g} mm, is longer than {ratio_limit:g} times the longest rod,"
                f" {1e3 * upper[1]:g} mm; raise ratio_limit"
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
            raise InputError(under._infeasible_message(name))
        return under

    @cached_property
    def _spread(self) -> np.ndarray:
        """Points spread over the region and projected onto its constraints, shape (n, 2) [m]."""
        shares = np.linspace(0.0, 1.0, SAMPLES)
        return self.project(
            np.array([self.lower + np.array([x, y]) * self.size for x in shares for y in shares])
        )

    @cached_property
    def samples(self) -> np.ndarray:
        """The feasible ones of many points spread over the region, shape (n, 2) [m]."""
        return self._spread[self.violation(self._spread) <= FEASIBLE]

    @property
    def searched(self) -> tuple[str, str]:
        """Ranges of crank and rod length [mm] as text; ``fixed`` where the constraints allow one
        length only."""
        low, high = (f(1e3 * self.samples, axis=0).round(3) for f in (np.min, np.max))
        return tuple(
            "fixed" if a == b else f"{a:g} to {b:g}" for a, b in zip(low, high, strict=True)
        )

    def _infeasible_message(self, name: str) -> str:
        """Why the constraints are infeasible, with the nearest lengths and the possible ranges."""
        best, words = self._spread[np.argmin(self.violation(self._spread))], []
        for constraint in self.constraints:
            if not len(replace(self, constraints=(constraint,)).samples):
                reached = constraint.value(replace(self, constraints=()).samples)
                low, high = constraint.show(reached.min()), constraint.show(reached.max())
                words.append(
                    f"{constraint.key} {constraint.range_text()} is infeasible: within the bounds"
                    f" it is {low} to {high}"
                )
        if not words:
            keys = " and ".join(constraint.key for constraint in self.constraints)
            found = ", ".join(
                f"{each.key} {each.show(float(each.value(best)))}" for each in self.constraints
            )
            words.append(
                f"no lengths within the bounds satisfy {keys} together; nearest is {found}"
            )
        crank, rod = 1e3 * best
        return (
            f"optimise.constraints, box {name}: {'; '.join(words)} (nearest: crank {crank:.6g} mm,"
            f" rod {rod:.6g} mm); give wider bounds in optimise.boxes (default: 5 % around the"
            " mechanism's lengths), or another constraint"
        )

    def violation(self, lengths: ArrayLike) -> np.ndarray:
        """Sum of the constraint violations, each over its scale; shape (...), for lengths (..., 2)
        [m]."""
        lengths = np.asarray(lengths)
        return sum(
            (each.violation(lengths) for each in self.constraints), np.zeros(lengths.shape[:-1])
        )

    def conditions(self) -> list[dict]:
        """Inequality and constraints for scipy's SLSQP, on lengths scaled to the box."""
        slope = np.array([-1.0, self.ratio_limit]) * self.size / self.size[0]

        def condition(each: Constraint, kind: str, sign: float, end: float) -> dict:
            return {
                "type": kind,
                "fun": lambda scaled: sign * (each.value(self.unscaled(scaled)) - end) / each.scale,
                "jac": lambda scaled: (
                    sign * each.gradient(self.unscaled(scaled)) * self.size / each.scale
                ),
            }

        def inequality(scaled: np.ndarray) -> float:
            return -self.inequality(self.unscaled(scaled)) / self.size[0]

        conditions = [{"type": "ineq", "fun": inequality, "jac": lambda scaled: slope}]
        for each in self.constraints:
            ends = (
                [("eq", 1.0, each.low)]
                if each.is_fixed
                else [("ineq", 1.0, each.low), ("ineq", -1.0, each.high)]
            )
            conditions += [condition(each, *end) for end in ends if np.isfinite(end[2])]
        return conditions

    def unscaled(self, scaled: np.ndarray) -> np.ndarray:
        """Lengths [m] from `scaled` ones, 0 to 1 between the bounds."""
        return self.lower + scaled * self.size

    def project(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (n, 2) projected onto the bounds, the inequality and the constraints [m].

        Newton's method with the shortest step, in widths of the box, that satisfies all violated
        constraints to first order. Where there is no solution, or none nearby, the result is the
        closest point found.
        """
        ratio = Constraint("ratio_limit", "", "mm", -np.inf, 0.0, self.inequality)
        ranges = (ratio, *self.constraints)
        scaled = np.clip((np.asarray(lengths, dtype=float) - self.lower) / self.size, 0.0, 1.0)
        for _ in range(_MOST_STEPS):
            at = self.unscaled(scaled)
            values = np.stack([each.value(at) for each in ranges], axis=-1)
            low, high, scale = (
                np.array([getattr(each, key) for each in ranges])
                for key in ("low", "high", "scale")
            )
            gaps = (np.clip(values, low, high) - values) / scale
            if np.abs(gaps).max(initial=0.0) <= 0.1 * FEASIBLE:
                break
            slopes = np.stack(
                [each.gradient(at) * self.size / each.scale for each in ranges], axis=-2
            )
            steps = (np.linalg.pinv(slopes * (gaps != 0.0)[..., None]) @ gaps[..., None])[..., 0]
            length = np.linalg.norm(steps, axis=-1, keepdims=True)
            scaled = np.clip(
                scaled + steps * np.minimum(1.0, _LONGEST_STEP / np.maximum(length, 1e-300)),
                0.0,
                1.0,
            )
        return self.unscaled(scaled)

    def nearest(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (n, 2) or (2,) projected onto the constraints, as far as possible."""
        lengths = np.asarray(lengths, dtype=float)
        moved = self.clip(lengths)
        if not self.constraints:
            return moved
        points, ranges = np.atleast_2d(moved), np.atleast_2d(lengths)
        wrong = self.violation(points) > 0.0
        points[wrong] = self.project(points[wrong])
        for number in (
            np.flatnonzero(self.violation(points) > FEASIBLE) if len(self.samples) else ()
        ):
            distances = np.linalg.norm((self.samples - ranges[number]) / self.size, axis=1)
            points[number] = self.samples[np.argmin(distances)]
        return points.reshape(lengths.shape)

    def inequality(self, lengths: ArrayLike) -> np.ndarray:
        """g(x) [m], shape (...), for lengths of shape (..., 2); at most 0 where feasible."""
        lengths = np.asarray(lengths)
        return lengths[..., 0] - self.ratio_limit * lengths[..., 1]

    def contains(self, lengths: ArrayLike, slack: float = 0.0) -> np.ndarray:
        """Whether lengths, shape (..., 2), satisfy bounds and inequality up to `slack` [m]."""
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
        """The largest feasible share, at most 1, of each step (..., 2) from `start` (..., 2)."""
        start, step = np.asarray(start), np.asarray(step)
        room = np.where(step > 0.0, self.upper - start, start - self.lower)
        room = np.concatenate([room, -self.inequality(start)[..., None]], axis=-1)
        speed = np.concatenate([np.abs(step), self.inequality(step)[..., None]], axis=-1)
        limits = np.divide(room, speed, out=np.ones_like(room), where=speed > 0.0)
        return np.clip(limits.min(axis=-1), 0.0, 1.0)

    def clip(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (..., 2) clipped to the bounds; then the crank shortened or the rod lengthened
        for the inequality."""
        crank, rod = np.moveaxis(np.clip(lengths, self.lower, self.upper), -1, 0)
        crank = np.maximum(self.lower[0], np.minimum(crank, self.ratio_limit * rod))
        return np.stack([crank, np.maximum(rod, crank / self.ratio_limit)], axis=-1)

    def active(self, lengths: ArrayLike) -> str:
        """Labels of the bounds, inequality and constraints active at `lengths` (2,), or
        ``'none'``."""
        words = []
        for name, value, low, high in zip(
            NAMES, np.asarray(lengths), self.lower, self.upper, strict=True
        ):
            if value <= low + NEAR:
                words.append(f"{name} at its lower bound {1e3 * low:g} mm")
            elif value >= high - NEAR:
                words.append(f"{name} at its upper bound {1e3 * high:g} mm")
        if self.inequality(lengths) >= -NEAR:
            words.append(f"crank length at {self.ratio_limit:g} times the rod length")
        words += [text for each in self.constraints if (text := each.active(lengths))]
        return "; ".join(words) or "none"


def regions(mechanism: Mechanism, options: Optimise) -> dict[str, Region]:
    """The region of each box by name, with the constraints that depend on the lengths only."""
    constraints = geometric(options.constraints, mechanism.slider.offset)
    return {
        name: Region.of(box, options.ratio_limit).under(constraints, name)
        for name, box in options.boxes.items()
    }


def check_constraints(scenarios: Mapping[str, Scenario], source: str = "configuration") -> None:
    """InputError, before any simulation, where the constraints of a scenario are infeasible."""
    for name, scenario in scenarios.items():
        try:
            regions(scenario.mechanism.applied(), scenario.optimise)
        except InputError as error:
            raise InputError(f"{source}, scenario {name}: {error}") from None
