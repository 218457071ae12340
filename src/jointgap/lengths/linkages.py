"""Lengths of general linkages: the search for the best transmission angle, force or torque, and its
re-simulation.

For the error of the angle the clearance vectors of a settled revolution at the original lengths are
frozen, as for the slider-crank. Forces and torques are those of ideal joints, with the motion of
the crank and the forces of effects at the original lengths. The optima are simulated again, as
ensembles of slightly perturbed starts.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jointgap.config import OptimiseLinkage, Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.progress import with_progress
from jointgap.core.words import format_name, joined
from jointgap.lengths.force_limit import scaled, search_under_force_limits
from jointgap.lengths.objective import (
    TORQUE_RIPPLE,
    FrozenObjective,
    Goal,
    LargestOfSeveral,
    Load,
    joint_forces,
    measure,
)
from jointgap.lengths.region import FORCE_TOLERANCE, Constraint, Region
from jointgap.lengths.search import Point, Search, evolve, search, search_from_all
from jointgap.lengths.tables import spread
from jointgap.linkage.assembly import signs_of
from jointgap.linkage.equations import NOTHING, Crank, Pose
from jointgap.linkage.from_file import linkage_of_file
from jointgap.linkage.topology import FRAME, Dyad, Linkage
from jointgap.linkage.transmission import (
    CrankMotion,
    Geometry,
    clearance_vector,
    slide_of,
    transmitting,
    variables_of,
)
from jointgap.motion.linkage import linkage_model, published
from jointgap.motion.parallel import side_by_side
from jointgap.motion.rates import torque_on_crank
from jointgap.motion.sampling import take_row
from jointgap.motion.simulation import crank_angles, integrate_to_angles, observed

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)  # [rad] of the constraints
_SAME = 1e-6  # [m] largest difference of equal lengths
DEPARTURE = "departure"  # Measure of the least transmission angle


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


_AT = 360  # crank angles of forces and torques in a revolution
_PARTS = 12  # of a revolution: the largest value of each counts, so that a step sees every peak
_OPEN = 1e12  # [N, N m] where the linkage does not close, which constraints exclude


Forces = Callable[[Sequence[str], ArrayLike], tuple[np.ndarray, np.ndarray]]
"""`Geometry.forces` of names at lengths."""


@dataclass(frozen=True)
class RequiredLoad(LargestOfSeveral):
    """A force [N] or torque [N m] with ideal joints."""

    load: Load
    forces: Forces

    def value(self, lengths: ArrayLike) -> np.ndarray:
        return self.load(dict(zip(self.load.names, self._found(lengths)[0], strict=True)))

    def several(self, lengths: np.ndarray) -> np.ndarray:
        return self._ends(lengths)[0]

    def slopes(self, lengths: np.ndarray) -> np.ndarray:
        return self._ends(lengths)[1]

    def _found(self, lengths: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Forces or torque (names, ..., n) with their derivatives."""
        values, slopes = self.forces(self.load.names, lengths)
        return np.nan_to_num(values, nan=_OPEN, posinf=_OPEN, neginf=-_OPEN), np.nan_to_num(slopes)

    def _ends(self, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, slopes = (each.reshape(-1, *each.shape[2:]) for each in self._found(lengths))
        if self.load.kind == "rms":
            rms = np.sqrt(np.mean(values**2))
            return np.array([rms]), (values @ slopes / (values.size * rms))[None]
        parts = values.reshape(-1, _AT // _PARTS)
        rows = parts.shape[1] * np.arange(len(parts))
        high, low = rows + parts.argmax(axis=1), rows + parts.argmin(axis=1)
        if self.load.kind == "ripple":
            high, low = (each.ravel() for each in np.meshgrid(high, low))
            return values[high] - values[low], slopes[high] - slopes[low]
        ends = np.concatenate([values[high], -values[low]])
        return ends, np.concatenate([slopes[high], -slopes[low]])


def goals_of(linkage: Linkage) -> dict[str, Goal]:
    """What can be minimised, by `objective`."""
    torque = {"crank_torque": "torque of the drive"}
    joints = {name: f"force in {format_name(name)}" for name in linkage.joints}
    pins = tuple(
        name
        for name, joint in linkage.joints.items()
        if joint.kind == "revolute" and FRAME not in joint.bodies
    )
    goals = {
        "transmission_angle": Goal("RMS error of the transmission angle", "rms", "deg"),
        "least_transmission_angle": Goal(
            "departure of the transmission angle from 90 deg", DEPARTURE, "deg"
        ),
        "torque_ripple": TORQUE_RIPPLE,
    }
    if pins:
        words, load = f"peak force in the pins {joined(pins)}", Load(pins, "peak")
        goals["largest_pin_force"] = Goal(words, "largest_pin_force", "N", "", load)
    for name, words in (torque | joints).items():
        for kind, how in (("peak", "peak"), ("rms", "RMS")):
            key = f"{kind}_torque" if name in torque else f"{name}_{kind}_force"
            unit, load = "N m" if name in torque else "N", Load((name,), kind)
            goals[key] = Goal(f"{how} {words}", key, unit, "", load)
    return goals


# ---- constraints


class Turn:
    """A revolution without clearance: extremes of angles and places, with their derivatives."""

    def __init__(self, geometry: Geometry):
        self.geometry = geometry
        self._lengths, self._found = None, {}

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
        known = (lengths.shape, lengths.tobytes())
        if known != self._lengths:
            self._lengths, self._found = known, {}
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
    def goal(self) -> Goal:
        """What is minimised; InputError if the linkage has no such quantity."""
        name, known = self.options.objective, goals_of(self.linkage)
        if name not in known:
            raise InputError(f"objective: '{name}' is not known; {did_you_mean(name, known)}")
        return known[name]

    @cached_property
    def forces(self) -> Forces:
        """Of ideal joints, with the motion of the crank and the forces of effects at the original
        lengths."""
        model = linkage_model(self.file.with_ideal_joints(), self.simulate)
        angles = crank_angles(self.simulate)
        rows = self.settled[np.arange(_AT) * len(self.settled) // _AT]
        run = integrate_to_angles(model, model.start(), angles, self.simulate.tolerance).part(rows)
        columns = observed(model, run)
        speed, acceleration = columns["crank_speed"], columns["crank_acceleration"]
        along, moments, losses, k = [], [], [], model.workspace().k
        for row in range(_AT):
            take_row(model.p, k, run, row)
            along.append(k.along[: k.pushed].copy())
            moments.append(k.moments[: k.rubbing].copy())
            inertia = model.drive.rotor_inertia * acceleration[row]
            losses.append([torque_on_crank(model.p, k) + inertia])
        crank = np.array([np.cos(angles[rows]), np.sin(angles[rows]), speed, acceleration])
        effects = map(np.transpose, (along, moments, losses))
        motion = CrankMotion(crank, model.variant.kind.pushed, *effects)
        geometry = Geometry(model.linkage, model.variant.signs, self.names)
        return partial(geometry.forces, motion=motion)

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
        is_of_angle = self.goal.load is None or self.options.least_angle is not None
        if is_of_angle and self.geometry.is_constant(self.dyad):
            raise InputError(
                f"transmission: the angle at {self.dyad.inner.name} is 90 deg at all lengths;"
                " choose another joint"
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
        for name in self.options.largest_force:
            if name not in self.linkage.joints:
                fix = did_you_mean(name, self.linkage.joints)
                raise InputError(f"largest_force.{name}: no such joint; {fix}")
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
        if load := self.goal.load:
            objective = RequiredLoad(desired, self.original, load, self.forces)
            if not objective.value(self.original) > 0.0:
                raise InputError(f"objective: {self.goal.measure} is 0; choose another one")
            return objective
        if self.options.objective == "least_transmission_angle":
            return Departure(desired, self.original, self.turn, self.dyad)
        if not self.file.loose:
            raise InputError(
                "optimise: all joints are ideal, so the transmission angle has no error; make a"
                " joint loose, or choose another objective"
            )
        vectors = [clearance_vector(samples, joint.name) for joint in self.linkage.loose]
        vectors = np.concatenate(vectors)[:, rows]
        return AngleError(desired, self.original, self.geometry, self.dyad, angle, vectors)

    def limited_forces(self, before: "LinkageEnsemble") -> Iterator[Constraint]:
        """The limited forces: those with ideal joints, scaled to those `before` with clearance."""
        for name, limit in self.options.largest_force.items():

            def peak(lengths: ArrayLike, name: str = name) -> tuple[np.ndarray, np.ndarray]:
                (sizes,), (slopes,) = self.forces([name], lengths)
                return _extremes(sizes, slopes)[1]

            words = f"largest force in {format_name(name)}"
            force = _constraint(f"largest_force.{name}", words, "N", -math.inf, limit, peak)
            ideal = float(force.value(self.original))
            yield scaled(force, before.peak_forces[name] / ideal if ideal else 1.0)

    def excess(self, ensemble: "LinkageEnsemble") -> float:
        """The largest force over its limit; 0 without limits."""
        peaks = ensemble.peak_forces
        limits = self.options.largest_force.items()
        return max((peaks[name] / limit for name, limit in limits), default=0.0)

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
    torque: np.ndarray  # (members, n) Of the drive [N m]
    goal: Goal

    @property
    def sizes(self) -> dict[str, np.ndarray]:
        """Norms of the error and the largest departure from 90 deg [rad], and the load of the goal,
        (members,) each."""
        sizes = measure(self.error)._asdict()
        sizes[DEPARTURE] = np.abs(self.angle - np.pi / 2).max(axis=1)
        if self.goal.load:
            settled = {**self.forces, "crank_torque": self.torque}
            sizes[self.goal.measure] = self.goal.load(settled)
        return sizes

    @property
    def peak_forces(self) -> dict[str, float]:
        """Largest force in each joint [N], median of the members."""
        return {name: float(np.median(each.max(axis=1))) for name, each in self.forces.items()}


def resimulate(problem: LinkageProblem, lengths: ArrayLike, desired: np.ndarray) -> LinkageEnsemble:
    """Simulate the linkage with other lengths from each perturbed start; once without clearance."""
    simulate, options, rows = problem.simulate, problem.options.ensemble, problem.settled
    model, angles = linkage_model(problem.with_lengths(lengths), simulate), crank_angles(simulate)
    random = np.random.default_rng(options.seed)
    moved = 2 * len(problem.linkage.loose)
    members = options.members if moved else 1
    starts = np.tile(model.start(), (members, 1))
    starts[:, :moved] += random.normal(0.0, options.perturbation, (members, moved))
    joints = problem.linkage.joints

    def one(start: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
        run = integrate_to_angles(model, start, angles, simulate.tolerance)
        columns = {
            name: each[rows] for name, each in published(model, observed(model, run)).items()
        }
        vectors = [clearance_vector(columns, joint.name) for joint in problem.linkage.loose]
        at = lengths, angles[rows], np.reshape(vectors, (-1, len(rows)))
        angle, _ = problem.geometry.angle(problem.dyad, *at)
        return angle, joint_forces(columns, joints), columns["crank_torque"]

    runs = with_progress(side_by_side(one, starts), "simulated starts", len(starts))
    angle, forces, torque = zip(*runs, strict=True)
    by_joint = {name: np.array([each[name] for each in forces]) for name in joints}
    angle = np.array(angle)
    found = angle, desired - angle, by_joint, np.array(torque)
    return LinkageEnsemble(angles[rows], *found, problem.goal)


# ---- search and result


@dataclass(frozen=True)
class LengthsFound:
    """The best lengths, and what their search and re-simulation gave."""

    problem: LinkageProblem
    search: Search
    lengths: tuple[float, ...]  # [m]
    before: LinkageEnsemble
    after: LinkageEnsemble

    @cached_property
    def gains(self) -> pd.DataFrame:
        """Sizes before and after with their reductions, by measure: median, 5 % and 95 %."""
        rows = {}
        for name, sizes in self.after.sizes.items():
            original = self.before.sizes[name]
            pairs = 1.0 - np.divide.outer(sizes, np.where(original > 0.0, original, np.nan))
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
        return 1.0 - (math.sqrt(ratio) if isinstance(objective, AngleError) else ratio)


def find_lengths(problem: LinkageProblem, samples: Mapping[str, ArrayLike]) -> LengthsFound:
    """Search the lengths, and simulate original and optima again; the best simulated ones within
    the limits of the forces count."""
    problem.check()
    options, region = problem.options, problem.region
    objective = problem.objective(samples)

    @cache
    def at_lengths(*lengths: float) -> LinkageEnsemble:
        return resimulate(problem, lengths, objective.desired)

    def search_in(region: Region) -> list[Search]:
        genetic = evolve(objective, region, options.genetic)
        local = search_from_all(objective, region, options.local_tolerance)
        local += (search(objective, region, genetic.lengths, options.local_tolerance),)
        return [Search("simulation_settled", "own", objective, region, genetic, local)]

    def peaks(point: Point) -> list[float]:
        found = at_lengths(*point.lengths).peak_forces
        return [found[name] for name in options.largest_force]

    before = at_lengths(*problem.original)
    if options.largest_force:
        forces = [*problem.limited_forces(before)]
        result = search_under_force_limits(forces, region, "own", search_in, peaks)
        if isinstance(result, Point):
            least = zip(options.largest_force, peaks(result), strict=True)
            words = joined(f"{force:.4g} N in {name}" for name, force in least)
            raise InputError(
                f"largest_force: {result.columns['status']}; the least is {words} at"
                f" {region.words(result.lengths)}; allow larger forces, give wider bounds in"
                " lengths, or a larger search in genetic"
            )
    else:
        result = search_in(region)
    points = [point.lengths for point in result[0].optima()]
    if not options.largest_force and np.max(np.abs(np.subtract(*points))) <= _SAME:
        points = points[1:]
    ends = [(point, at_lengths(*point)) for point in points]
    ends = [end for end in ends if problem.excess(end[1]) <= FORCE_TOLERANCE]
    goal = problem.goal.measure
    best, after = min(ends, key=lambda end: float(np.median(end[1].sizes[goal])))
    return LengthsFound(problem, result[0], best, before, after)
