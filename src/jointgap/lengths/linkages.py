"""Lengths of general linkages: the search for the best transmission angle, and its re-simulation.

The clearance vectors of a settled revolution at the original lengths are frozen, as for the
slider-crank. The optima are simulated again, as ensembles of slightly perturbed starts.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jointgap.config import OptimiseLinkage, Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.progress import with_progress
from jointgap.lengths.objective import (
    FrozenObjective,
    LargestOfSeveral,
    joint_forces,
    measure,
)
from jointgap.lengths.region import Constraint, Region
from jointgap.lengths.search import Search, evolve, search, search_from_all
from jointgap.lengths.tables import spread
from jointgap.linkage.assembly import signs_of
from jointgap.linkage.equations import NOTHING, Crank, Pose
from jointgap.linkage.from_file import linkage_of_file
from jointgap.linkage.topology import Dyad
from jointgap.linkage.transmission import (
    Geometry,
    clearance_vector,
    slide_of,
    transmitting,
    variables_of,
)
from jointgap.motion.linkage import linkage_model, published
from jointgap.motion.parallel import side_by_side
from jointgap.motion.simulation import crank_angles, integrate_to_angles, observed

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)  # [rad] of the constraints
_SAME = 1e-6  # [m] largest difference of equal lengths


# ---- objectives


@dataclass(frozen=True)
class AngleError(FrozenObjective):
    """Error of the transmission angle with frozen clearance vectors."""

    geometry: Geometry
    dyad: Dyad
    crank_angle: np.ndarray  # (n,) [rad]
    vectors: np.ndarray  # (2 loose joints, n)

    def angle(self, lengths: ArrayLike) -> np.ndarray:
        angle, _ = self.geometry.angle(self.dyad, lengths, self.crank_angle, self.vectors)
        return np.nan_to_num(angle)  # where it does not close, which constraints exclude

    def gradient(self, lengths: ArrayLike) -> np.ndarray:
        angle, slopes = self.geometry.angle(self.dyad, lengths, self.crank_angle, self.vectors)
        return -2.0 * np.nan_to_num(self.desired - angle) @ np.nan_to_num(slopes)


@dataclass(frozen=True)
class Departure(LargestOfSeveral):
    """Largest departure [rad] of the transmission angle from 90 deg, without clearance."""

    turn: "Turn"
    dyad: Dyad

    def value(self, lengths: ArrayLike) -> np.ndarray:
        (low, _), (high, _) = self.turn.angles(self.dyad, lengths)
        return np.nan_to_num(np.maximum(np.pi / 2 - low, high - np.pi / 2), nan=np.pi)

    def several(self, lengths: ArrayLike) -> np.ndarray:
        departure = np.nan_to_num(self.turn.angle(self.dyad, lengths)[0] - np.pi / 2)
        return np.concatenate([departure, -departure])

    def slopes(self, lengths: ArrayLike) -> np.ndarray:
        slopes = np.nan_to_num(self.turn.angle(self.dyad, lengths)[1])
        return np.concatenate([slopes, -slopes])


# ---- constraints


class Turn:
    """A revolution without clearance: extremes of angles and places, with their derivatives."""

    def __init__(self, geometry: Geometry):
        self.geometry = geometry
        self._lengths, self._found = b"", {}

    def angle(self, dyad: Dyad, lengths: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Transmission angle [rad] with its derivatives."""
        return self._once(dyad.inner.name, lengths, self.geometry.angle, dyad)

    def angles(self, dyad: Dyad, lengths: ArrayLike):
        """Smallest and largest transmission angle [rad], each with its derivatives."""
        return _extremes(*self.angle(dyad, lengths))

    def range(self, body: str, lengths: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Stroke [m] of a sliding body, or swing [rad] of another, with its derivatives."""
        found = self._once(body, lengths, self.geometry.place, body)
        (low, low_slope), (high, high_slope) = _extremes(*found)
        return high - low, high_slope - low_slope

    def _once(self, name: str, lengths: ArrayLike, function, what):
        """A function at lengths; the constraints ask several times for the last ones."""
        lengths = np.asarray(lengths, dtype=float)
        if lengths.tobytes() != self._lengths:
            self._lengths, self._found = lengths.tobytes(), {}
        if name not in self._found:
            self._found[name] = function(what, lengths, _ANGLES)
        return self._found[name]


def _extremes(values: np.ndarray, slopes: np.ndarray):
    """Smallest and largest of periodic values (..., n), between them on a parabola, with their
    derivatives (..., variables)."""
    ends = []
    for sign in (-1.0, 1.0):
        place = np.argmax(sign * values, axis=-1)[..., None] + np.arange(-1, 2)
        place %= values.shape[-1]
        near = np.take_along_axis(values, place, axis=-1)
        near_slopes = np.take_along_axis(slopes, place[..., None], axis=-2)
        (before, at, after), by = np.moveaxis(near, -1, 0), np.moveaxis(near_slopes, -2, 0)
        bend = before - 2.0 * at + after
        flat = np.abs(bend) < 1e-300
        t = np.where(flat, 0.0, 0.5 * (before - after) / np.where(flat, 1.0, bend))
        slope, curve = 0.5 * t[..., None], 0.5 * t[..., None] ** 2
        value = at + 0.5 * t * (after - before) + 0.5 * t**2 * bend
        of_value = by[1] + slope * (by[2] - by[0]) + curve * (by[0] - 2.0 * by[1] + by[2])
        ends.append((value, of_value))
    return ends


def _constraint(key: str, words: str, unit: str, low: float, high: float, function) -> Constraint:
    """A constraint on the first of what `function` gives, of which the second are the derivatives;
    satisfied where earlier bodies do not close, which has its own constraint."""

    def value(lengths: ArrayLike) -> np.ndarray:
        found = function(lengths)[0]
        return np.where(np.isnan(found), np.clip(0.0, low, high), found)

    def slope(lengths: ArrayLike) -> np.ndarray:
        return np.nan_to_num(function(lengths)[1])

    possible = (0.0, math.pi if unit == "deg" else math.inf)
    return Constraint(key, words, unit, low, high, value, slope, possible)


# ---- the problem


@dataclass(frozen=True)
class LinkageProblem:
    """Which lengths of a linkage are searched, and for what."""

    file: LinkageFile
    simulate: Simulate
    options: OptimiseLinkage

    @cached_property
    def linkage(self):
        return linkage_of_file(self.file)

    @cached_property
    def signs(self) -> tuple[float, ...]:
        return signs_of(self.linkage, self.simulate.start_angle)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the searched lengths."""
        return tuple(self.options.lengths)

    @property
    def original(self) -> tuple[float, ...]:
        """The searched lengths [m] of the file."""
        values = variables_of(self.linkage)
        return tuple(values[name] for name in self.names)

    @cached_property
    def dyad(self) -> Dyad:
        return transmitting(self.linkage, self.options.transmission)

    @cached_property
    def geometry(self) -> Geometry:
        return Geometry(self.linkage, self.signs, self.names)

    @cached_property
    def turn(self) -> Turn:
        return Turn(self.geometry)

    @property
    def settled(self) -> np.ndarray:
        """Samples of the settled revolution."""
        per_turn = self.simulate.samples_per_revolution
        return (self.options.ensemble.settled_revolution - 1) * per_turn + np.arange(per_turn)

    def check(self) -> None:
        """InputError where the options do not suit the linkage."""
        known = variables_of(self.linkage)
        for name in self.names:
            if name not in known:
                raise InputError(f"lengths.{name}: is no length; {did_you_mean(name, known)}")
        if self.geometry.is_constant(self.dyad):
            raise InputError(
                f"transmission: the angle at {self.dyad.inner.name} is 90 deg at all lengths;"
                " choose another joint"
            )
        if not self.file.loose:
            raise InputError(
                "optimise: all joints are ideal, so the optimum cannot be checked with clearance;"
                " make a joint loose"
            )
        if self.simulate.speed < 0.0:
            raise InputError(
                f"speed: {self.simulate.speed:g} rad/s is clockwise; mirror the linkage and give a"
                " positive speed"
            )
        last, turns = self.options.ensemble.settled_revolution, self.simulate.revolutions
        if last > turns:
            raise InputError(
                f"ensemble.settled_revolution {last} is more than revolutions, {turns}; reduce it"
            )
        for key, slides in (("stroke", True), ("swing", False)):
            bodies = [
                body
                for body in self.linkage.moving
                if bool(slide_of(self.linkage, body)) == slides and body != self.linkage.crank
            ]
            for name in getattr(self.options, key):
                if name not in bodies:
                    raise InputError(f"{key}.{name}: no such body; {did_you_mean(name, bodies)}")

    @cached_property
    def region(self) -> Region:
        """Bounds and constraints; InputError where no lengths satisfy them."""
        lower, upper = np.transpose([*self.options.lengths.values()])
        region = Region(lower, upper, None, tuple(self._constraints()), self.names)
        if not len(region.samples):
            raise InputError(f"optimise: {region.conflict}; give wider bounds in lengths")
        return region

    def _constraints(self) -> Iterator[Constraint]:
        options, turn = self.options, self.turn
        for dyad in self.linkage.dyads:
            if self.geometry.is_constant(dyad):
                continue
            least, name = options.dead_point_margin, dyad.inner.name
            if dyad == self.dyad:
                least = max(least, options.least_angle or 0.0)
            for place, words, ends in (
                (0, "smallest", (least, math.inf)),
                (1, "largest", (-math.inf, math.pi - least)),
            ):
                yield _constraint(
                    f"{words} angle at {name}",
                    f"{words} angle at {name}",
                    "deg",
                    *ends,
                    lambda lengths, dyad=dyad, place=place: turn.angles(dyad, lengths)[place],
                )
        for key, unit in (("stroke", "mm"), ("swing", "deg")):
            for body, ends in getattr(options, key).items():
                yield _constraint(
                    f"{key}.{body}",
                    f"{key} of {body}",
                    unit,
                    *ends,
                    lambda lengths, body=body: turn.range(body, lengths),
                )

    def objective(self, samples: Mapping[str, ArrayLike]) -> FrozenObjective:
        """The objective, with the clearance vectors of the simulated original linkage."""
        rows = self.settled
        angle = np.asarray(samples["crank_angle"])[rows]
        desired, _ = self.geometry.angle(self.dyad, self.original, angle)
        if self.options.objective == "least_transmission_angle":
            return Departure(desired, self.original, self.turn, self.dyad)
        vectors = [clearance_vector(samples, joint.name) for joint in self.linkage.loose]
        vectors = np.concatenate(vectors)[:, rows]
        return AngleError(desired, self.original, self.geometry, self.dyad, angle, vectors)

    def with_lengths(self, lengths: ArrayLike) -> LinkageFile:
        """The file with other lengths [m]: mass centres of links are scaled; stated angles become
        those at the start."""
        frame, bodies = dict(self.file.frame.points), dict(self.file.bodies)
        slides: dict[str, tuple[float, float]] = {}
        for name, value in zip(self.names, map(float, lengths), strict=True):
            body, _, key = name.partition(".")
            if body in bodies:
                link = bodies[body]
                centre = _scaled(link.mass_centre, value / link.length)
                bodies[body] = link.model_copy(update={"length": value, "mass_centre": centre})
            else:
                point, _, axis = key.partition(".")
                points = frame if point in frame else slides
                x, y = points.get(point) or self.file.slides[point].at or (0.0, 0.0)
                points[point] = (value, y) if axis == "x" else (x, value)
        joints = {
            name: joint.model_copy(update={"at": slides[name]}) if name in slides else joint
            for name, joint in self.file.joints.items()
        }
        frame = self.file.frame.model_copy(update={"points": frame})
        file = self.file.model_copy(update={"frame": frame, "bodies": bodies, "joints": joints})
        start = self.simulate.start_angle
        crank = Crank(math.cos(start), math.sin(start), 0.0)
        linkage = linkage_of_file(file)
        still = {joint.name: (NOTHING, NOTHING) for joint in linkage.loose}
        placed = Pose(linkage, self.signs, crank, still).directions
        stated = {
            name: body.model_copy(update={"angle": math.atan2(*reversed(placed[name]))})
            for name, body in bodies.items()
            if body.angle is not None
        }
        return file.model_copy(update={"bodies": bodies | stated})


def _scaled(centre: float | tuple[float, float], factor: float) -> float | tuple[float, float]:
    """A mass centre at `factor` times the distance along its link."""
    return (factor * centre[0], centre[1]) if isinstance(centre, tuple) else factor * centre


# ---- simulated again


@dataclass(frozen=True)
class LinkageEnsemble:
    """A linkage simulated from slightly perturbed starts, over a settled revolution."""

    crank_angle: np.ndarray  # (n,) [rad]
    angle: np.ndarray  # (members, n) Transmission angle [rad]
    error: np.ndarray  # (members, n) Desired minus actual [rad]
    forces: Mapping[str, np.ndarray]  # (members, n) By joint [N]

    @property
    def sizes(self) -> dict[str, np.ndarray]:
        """Norms of the error, and the largest departure from 90 deg [rad], (members,) each."""
        departure = np.abs(self.angle - np.pi / 2).max(axis=1)
        return measure(self.error)._asdict() | {"departure": departure}


def resimulate(problem: LinkageProblem, lengths: ArrayLike, desired: np.ndarray) -> LinkageEnsemble:
    """Simulate the linkage with other lengths from each perturbed start."""
    simulate, options, rows = problem.simulate, problem.options.ensemble, problem.settled
    model, angles = linkage_model(problem.with_lengths(lengths), simulate), crank_angles(simulate)
    random = np.random.default_rng(options.seed)
    starts = np.tile(model.start(), (options.members, 1))
    moved = 2 * len(problem.linkage.loose)
    starts[:, :moved] += random.normal(0.0, options.perturbation, (options.members, moved))
    joints = problem.linkage.joints

    def one(start: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        run = integrate_to_angles(model, start, angles, simulate.tolerance)
        columns = {
            name: each[rows] for name, each in published(model, observed(model, run)).items()
        }
        vectors = [clearance_vector(columns, joint.name) for joint in problem.linkage.loose]
        at = lengths, angles[rows], np.concatenate(vectors)
        return problem.geometry.angle(problem.dyad, *at)[0], joint_forces(columns, joints)

    runs = with_progress(side_by_side(one, starts), "simulated starts", len(starts))
    transmission, forces = zip(*runs, strict=True)
    by_joint = {name: np.array([each[name] for each in forces]) for name in joints}
    transmission = np.array(transmission)
    return LinkageEnsemble(angles[rows], transmission, desired - transmission, by_joint)


# ---- search and result


@dataclass(frozen=True)
class LengthsFound:
    """The best lengths, and what their search and re-simulation gave."""

    problem: LinkageProblem
    search: Search
    lengths: tuple[float, ...]  # [m]
    before: LinkageEnsemble
    after: LinkageEnsemble

    @property
    def measure(self) -> str:
        """Of the objective, in `LinkageEnsemble.sizes`."""
        return "departure" if isinstance(self.search.objective, Departure) else "rms"

    @cached_property
    def gains(self) -> pd.DataFrame:
        """Sizes before and after with their reductions, by measure: median, 5 % and 95 %."""
        rows = {}
        for name, sizes in self.after.sizes.items():
            original = self.before.sizes[name]
            pairs = 1.0 - np.divide.outer(sizes, original)
            rows[name] = (
                spread("original", original) | spread("size", sizes) | spread("reduction", pairs)
            )
        return pd.DataFrame(rows).T.rename_axis("measure")

    @property
    def loads(self) -> pd.DataFrame:
        """Largest forces [N] in each joint before and after: median, 5 % and 95 %."""
        rows = {
            name: spread("original", self.before.forces[name].max(axis=1))
            | spread("peak_force", forces.max(axis=1))
            for name, forces in self.after.forces.items()
        }
        return pd.DataFrame(rows).T.rename_axis("joint")

    @property
    def estimate(self) -> float:
        """Reduction of the objective as the search saw it."""
        objective = self.search.objective
        values = [float(objective.value(each)) for each in (self.lengths, objective.original)]
        ratio = values[0] / values[1]
        return 1.0 - (ratio if self.measure == "departure" else math.sqrt(ratio))


def find_lengths(problem: LinkageProblem, samples: Mapping[str, ArrayLike]) -> LengthsFound:
    """Search the lengths, and simulate original and optima again; the best simulated ones count."""
    problem.check()
    options, region = problem.options, problem.region
    objective = problem.objective(samples)
    genetic = evolve(objective, region, options.genetic)
    local = search_from_all(objective, region, options.local_tolerance)
    local += (search(objective, region, genetic.lengths, options.local_tolerance),)
    found = Search("simulation_settled", "own", objective, region, genetic, local)
    points = [point.lengths for point in found.optima()]
    if np.max(np.abs(np.subtract(*points))) <= _SAME:
        points = points[1:]
    measured = "departure" if isinstance(objective, Departure) else "rms"
    before = resimulate(problem, problem.original, objective.desired)
    ends = [(point, resimulate(problem, point, objective.desired)) for point in points]
    best, after = min(ends, key=lambda end: float(np.median(end[1].sizes[measured])))
    return LengthsFound(problem, found, best, before, after)
