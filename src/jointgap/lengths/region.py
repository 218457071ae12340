"""The feasible region of the lengths."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import NonlinearConstraint

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

Function = Callable[[ArrayLike], np.ndarray]
"""A function of n lengths, shape (..., n) [m]; of a slider-crank L2 and L3."""


@dataclass(frozen=True)
class Constraint:
    """A property of the lengths and its range."""

    key: str  # In the section `optimise.constraints`
    words: str  # Label
    unit: str  # Display unit
    low: float  # Range in SI; infinite without a bound
    high: float  # Equal to `low` for an equality constraint
    value: Function  # The property, shape (...)
    slope: Function | None = None  # Its gradient, where `value` takes no complex lengths
    possible: tuple[float, float] = (-math.inf, math.inf)  # Beyond, `value` is continued

    @property
    def is_fixed(self) -> bool:
        """Whether it is an equality constraint."""
        return self.low == self.high

    @property
    def scale(self) -> float:
        """Its display unit in SI."""
        return SCALES[self.unit]

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        """Gradient with respect to the lengths, of their shape (..., n)."""
        if self.slope:
            return self.slope(lengths)
        steps = 1j * _STEP * np.eye(np.shape(lengths)[-1])
        slopes = [self.value(np.asarray(lengths) + step).imag / _STEP for step in steps]
        return np.stack(slopes, axis=-1)

    def violation(self, lengths: ArrayLike) -> np.ndarray:
        """Violation in the display unit; shape (...), for lengths (..., n) [m]."""
        value = self.value(lengths)
        return np.maximum(np.maximum(self.low - value, value - self.high), 0.0) / self.scale

    def active(self, lengths: ArrayLike) -> str:
        """Label of the limit that is active at `lengths` (n,); empty where none is and for equality
        constraints."""
        value = float(self.value(lengths))
        for limit, words in ((self.low, "lower"), (self.high, "upper")):
            if not self.is_fixed and abs(value - limit) <= 10 * FEASIBLE * self.scale:
                return f"{self.words} at its {words} limit {self.show(limit)}"
        return ""

    def range_text(self) -> str:
        """The range as text."""
        if self.is_fixed:
            return self.show(self.low)
        if math.isinf(self.low):
            return f"{self.show(self.high)} at most"
        if math.isinf(self.high):
            return f"{self.show(self.low)} at least"
        return f"{self.low / self.scale:.6g} to {self.show(self.high)}"

    def show(self, value: float) -> str:
        """A `value` of the property with its unit."""
        return f"{value / self.scale:.6g} {self.unit}"


def geometric(options: Constraints, offset: float) -> tuple[Constraint, ...]:
    """Constraints that depend on the lengths only."""

    def position(reach: np.ndarray) -> np.ndarray:
        return np.sqrt(reach**2 - offset**2)

    properties = {
        "crank_length": ("crank length", lambda crank, rod: crank),
        "stroke": ("stroke", lambda crank, rod: position(rod + crank) - position(rod - crank)),
        "outer_dead_centre": ("outer dead centre", lambda crank, rod: position(rod + crank)),
        "inner_dead_centre": ("inner dead centre", lambda crank, rod: position(rod - crank)),
        "outer_dead_centre_angle": (
            "crank angle of the outer dead centre",
            lambda crank, rod: np.arcsin(offset / (rod + crank)),
        ),
        "inner_dead_centre_angle": (
            "crank angle of the inner dead centre",
            lambda crank, rod: np.arcsin(offset / (rod - crank)) + np.pi,
        ),
        # from the crank pin's farthest point on the other side to the outer dead centre
        "length_along": (
            "length along the slide",
            lambda crank, rod: position(rod + crank) + crank,
        ),
        # the crank's circle, extended to the slide
        "length_across": (
            "length across the slide",
            lambda crank, rod: crank + np.maximum(crank, abs(offset)),
        ),
    }
    constraints = []
    for key, (words, function) in properties.items():
        if (limits := getattr(options, key)) is None:
            continue

        def value(lengths: ArrayLike, function=function) -> np.ndarray:
            return function(*np.moveaxis(np.asarray(lengths), -1, 0))

        low, high = limits if isinstance(limits, tuple) else (-math.inf, limits)
        is_angle = key.endswith("angle")
        is_constant = is_angle and offset == 0.0
        if not (is_constant and low <= value((0.0, 1.0)) <= high):
            unit = "deg" if is_angle else "mm"
            constraints.append(Constraint(key, words, unit, low, high, value))
    return tuple(constraints)


def depends_on_offset(options: Constraints) -> str:
    """Key of the first constraint of `options` that depends on the slide's offset, or ''."""
    keys = (constraint.key for constraint in geometric(options, 0.0))
    return next((key for key in keys if key != "crank_length"), "")


SAMPLES = 41  # grid points per length of a slider-crank for the feasibility check
_POINTS = 256  # in all, of another linkage
_MOST_STEPS = 60  # of Newton's method, which typically needs three or four
_LONGEST_STEP = 0.5  # [widths of the box]
NEAR = 1e-6  # [m] distance below which a bound is active: a thousandth of the paper's digits


@dataclass(frozen=True)
class Region:
    """A convex region of n lengths with constraints; of a slider-crank, (L2, L3)."""

    lower: np.ndarray  # shape (n,); bounds of the lengths [m]
    upper: np.ndarray  # shape (n,); bounds of the lengths [m]
    ratio_limit: float | None = None  # g(x) = L2 - ratio_limit L3 <= 0; 1: the crank can turn
    constraints: tuple[Constraint, ...] = ()  # They may reduce the region to a curve or a point
    names: tuple[str, ...] = ("crank_length", "rod_length")

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
        """Widths of the box, shape (n,) [m]."""
        return self.upper - self.lower

    def under(self, constraints: Iterable[Constraint], name: str = "") -> "Region":
        """The region with further `constraints`."""
        region = replace(self, constraints=(*self.constraints, *constraints))
        if region.constraints and not len(region.samples):
            raise InputError(
                f"optimise.constraints, box {name}: {region.conflict}; give wider bounds in"
                " optimise.boxes (default: 5 % around the mechanism's lengths), or another"
                " constraint"
            )
        return region

    @cached_property
    def _projected_grid(self) -> np.ndarray:
        """Points of a grid projected onto the constraints, shape (points, n) [m]."""
        count = len(self.lower)
        each = SAMPLES if self.ratio_limit is not None else max(round(_POINTS ** (1 / count)), 2)
        shares = np.linspace(0.0, 1.0, each)
        grid = np.stack(np.meshgrid(*[shares] * count, indexing="ij"), axis=-1)
        return self.project(self.unscaled(grid.reshape(-1, count)))

    @cached_property
    def samples(self) -> np.ndarray:
        """The feasible points of a projected grid, shape (points, n) [m]."""
        return self._projected_grid[self.violation(self._projected_grid) <= FEASIBLE]

    @property
    def searched(self) -> tuple[str, ...]:
        """Range of each length [mm] as text; ``fixed`` where the constraints allow one
        length only."""
        ends = np.round([1e3 * self.samples.min(axis=0), 1e3 * self.samples.max(axis=0)], 3)
        return tuple("fixed" if low == high else f"{low:g} to {high:g}" for low, high in ends.T)

    @property
    def conflict(self) -> str:
        """Which constraints cannot be satisfied together, and what is possible within the
        bounds."""
        nearest = self._projected_grid[np.argmin(self.violation(self._projected_grid))]
        within_bounds, ranges = replace(self, constraints=()).samples, []
        for limit in self.constraints:
            values = np.clip(limit.value(within_bounds), *limit.possible)
            possible = f"{limit.show(values.min())} to {limit.show(values.max())}"
            ranges.append(f"{limit.key} {limit.range_text()} (within the bounds {possible})")
        return f"no lengths satisfy {' and '.join(ranges)}; nearest: {self.words(nearest)}"

    def words(self, lengths: ArrayLike) -> str:
        """Lengths (n,) with their names."""
        return ", ".join(
            f"{name.removesuffix('_length')} {1e3 * length:.6g} mm"
            for name, length in zip(self.names, lengths, strict=True)
        )

    def violation(self, lengths: ArrayLike) -> np.ndarray:
        """Sum of the constraint violations, each over its scale; shape (...), for lengths (..., n)
        [m]."""
        none = np.zeros(np.shape(lengths)[:-1])
        return sum((constraint.violation(lengths) for constraint in self.constraints), none)

    @cached_property
    def _limits(self) -> tuple[Constraint, ...]:
        """The inequality and the constraints."""
        if self.ratio_limit is None:
            return self.constraints
        ratio = Constraint("ratio_limit", "", "mm", -np.inf, 0.0, self.inequality)
        return (ratio, *self.constraints)

    def conditions(self) -> list[NonlinearConstraint]:
        """Inequality and constraints for scipy's SLSQP, on lengths scaled to the box."""
        return [
            NonlinearConstraint(
                lambda scaled, limit=limit: limit.value(self.unscaled(scaled)) / limit.scale,
                limit.low / limit.scale,
                limit.high / limit.scale,
                jac=lambda scaled, limit=limit: self._slope(limit, self.unscaled(scaled)),
            )
            for limit in self._limits
        ]

    def _slope(self, limit: Constraint, lengths: np.ndarray) -> np.ndarray:
        """Gradient of a limit over its scale by the scaled lengths, of their shape (..., n)."""
        return limit.gradient(lengths) * self.size / limit.scale

    def unscaled(self, scaled: np.ndarray) -> np.ndarray:
        """Lengths [m] from `scaled` ones, 0 to 1 between the bounds."""
        return self.lower + scaled * self.size

    def project(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (points, n) projected onto the bounds, the inequality and the constraints [m].

        Newton's method with the shortest step, in widths of the box, that satisfies all violated
        constraints to first order. Where there is no solution, or none nearby, the result is the
        closest point found.
        """
        limits = self._limits
        if not limits:
            return self.clip(lengths)
        low, high, scale = np.transpose([(limit.low, limit.high, limit.scale) for limit in limits])
        scaled = np.clip((np.asarray(lengths) - self.lower) / self.size, 0.0, 1.0)
        for _ in range(_MOST_STEPS):
            at = self.unscaled(scaled)
            values = np.stack([limit.value(at) for limit in limits], axis=-1)
            gaps = (np.clip(values, low, high) - values) / scale
            if np.abs(gaps).max(initial=0.0) <= 0.1 * FEASIBLE:
                break
            slopes = np.stack([self._slope(limit, at) for limit in limits], axis=-2)
            violated = slopes * (gaps != 0.0)[..., None]
            steps = (np.linalg.pinv(violated) @ gaps[..., None])[..., 0]
            length = np.linalg.norm(steps, axis=-1, keepdims=True)
            shortening = np.minimum(1.0, _LONGEST_STEP / np.maximum(length, 1e-300))
            scaled = np.clip(scaled + steps * shortening, 0.0, 1.0)
        return self.unscaled(scaled)

    def nearest(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (points, n) or (n,) projected onto the constraints, as far as possible."""
        targets = np.atleast_2d(lengths)
        points = self.clip(targets)
        violated = self.violation(points) > 0.0
        if violated.any():
            points[violated] = self.project(points[violated])
        for index in np.flatnonzero(self.violation(points) > FEASIBLE):
            distances = np.linalg.norm((self.samples - targets[index]) / self.size, axis=1)
            if len(distances):
                points[index] = self.samples[np.argmin(distances)]
        return points.reshape(np.shape(lengths))

    def inequality(self, lengths: ArrayLike) -> np.ndarray:
        """g(x) [m], shape (...), for lengths of shape (..., n); at most 0 where feasible."""
        lengths = np.asarray(lengths)
        if self.ratio_limit is None:
            return np.full(lengths.shape[:-1], -np.inf)
        return lengths[..., 0] - self.ratio_limit * lengths[..., 1]

    def contains(self, lengths: ArrayLike, slack: float = 0.0) -> np.ndarray:
        """Whether lengths, shape (..., n), satisfy bounds and inequality up to `slack` [m]."""
        clipped = np.clip(lengths, self.lower - slack, self.upper + slack)
        return np.all(clipped == lengths, axis=-1) & (self.inequality(lengths) <= slack)

    def sample(self, count: int, random: np.random.Generator) -> np.ndarray:
        """`count` points spread evenly over the region, shape (count, n) [m]."""
        points = np.empty((0, len(self.lower)))
        while len(points) < count:
            drawn = self.lower + random.random((count, len(self.lower))) * self.size
            points = np.concatenate([points, drawn[self.contains(drawn)]])
        return points[:count]

    def reach(self, start: ArrayLike, step: ArrayLike) -> np.ndarray:
        """The largest feasible share, at most 1, of each step (..., n) from `start` (..., n)."""
        start, step = np.asarray(start), np.asarray(step)
        room = np.where(step > 0.0, self.upper - start, start - self.lower)
        room = np.concatenate([room, -self.inequality(start)[..., None]], axis=-1)
        speed = np.concatenate([np.abs(step), self.inequality(step)[..., None]], axis=-1)
        limits = np.divide(room, speed, out=np.ones_like(room), where=speed > 0.0)
        return np.clip(limits.min(axis=-1), 0.0, 1.0)

    def clip(self, lengths: ArrayLike) -> np.ndarray:
        """Lengths (..., n) clipped to the bounds; then the crank shortened or the rod lengthened
        for the inequality."""
        within = np.clip(lengths, self.lower, self.upper)
        if self.ratio_limit is None:
            return within
        crank, rod = np.moveaxis(within, -1, 0)
        crank = np.maximum(self.lower[0], np.minimum(crank, self.ratio_limit * rod))
        return np.stack([crank, np.maximum(rod, crank / self.ratio_limit)], axis=-1)

    def active(self, lengths: ArrayLike) -> str:
        """Labels of the bounds, inequality and constraints active at `lengths` (n,), or
        ``'none'``."""
        labels = []
        links = zip(self.names, lengths, self.lower, self.upper, strict=True)
        for name, length, *bounds in links:
            for side, bound in zip(("lower", "upper"), bounds, strict=True):
                if abs(length - bound) <= NEAR:
                    words = name.replace("_", " ")
                    labels.append(f"{words} at its {side} bound {1e3 * bound:g} mm")
        if self.inequality(lengths) >= -NEAR:
            labels.append(f"crank length at {self.ratio_limit:g} times the rod length")
        labels += [constraint.active(lengths) for constraint in self.constraints]
        return "; ".join(filter(None, labels)) or "none"


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
            if isinstance(scenario.mechanism, Mechanism):
                regions(scenario.mechanism.applied(), scenario.optimise)
        except InputError as error:
            raise InputError(f"{source}, scenario {name}: {error}") from None
