"""The transmission angle of a dyad, and the geometry of a linkage as a function of its lengths.

The transmission angle is 90 deg where the dyad drives best, and 0 or 180 deg in its dead points. Of
two bodies joined by a revolute joint it is the angle between their lines at this joint; of a body
whose end slides, that between the body and the normal of the slide; of a block on a pivoted body,
that between the slide and the velocity of the pivoted body's point at the block's pin.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jointgap.core.errors import InputError, did_you_mean
from jointgap.linkage.derivatives import derivatives
from jointgap.linkage.equations import NOTHING, Arithmetic, Crank, Dynamics, Pose, across, dot
from jointgap.linkage.joint_forces import balance
from jointgap.linkage.machine_code import Code, Graph, Number, Store, Symbol
from jointgap.linkage.topology import FRAME, ZERO, Body, Dyad, Joint, Linkage, number


def transmitting(linkage: Linkage, joint: str | None = None) -> Dyad:
    """The dyad with the inner joint of this name; by default the last one."""
    if joint is None:
        return linkage.dyads[-1]
    inner = {dyad.inner.name: dyad for dyad in linkage.dyads}
    if joint not in inner:
        raise InputError(
            f"transmission: '{joint}' does not join two bodies that are driven together;"
            f" {did_you_mean(joint, inner)}"
        )
    return inner[joint]


_AT_ONCE = 20_000
"""Numbers of an array that the processor's cache holds with those of many others."""

_NEARLY_DEAD = 0.9999
"""Cosine beyond which the angle continues linearly, also where a dyad does not close."""


def angle_of(cosine: np.ndarray) -> np.ndarray:
    """Transmission angle [rad] of its cosine; it continues below 0 and above pi where a dyad does
    not close."""
    inside = np.clip(cosine, -_NEARLY_DEAD, _NEARLY_DEAD)
    return np.arccos(inside) - (cosine - inside) / np.sqrt(1.0 - inside**2)


def _angle_slope(cosine: np.ndarray) -> np.ndarray:
    return -1.0 / np.sqrt(1.0 - np.clip(cosine, -_NEARLY_DEAD, _NEARLY_DEAD) ** 2)


def clearance_vector(columns: Mapping[str, ArrayLike], joint: str) -> np.ndarray:
    """Clearance vector [m] of a loose joint from its columns, (2, n); of a slide offset [m] and
    tilt [rad]."""
    if f"{joint}_offset" in columns:
        return np.array([columns[f"{joint}_offset"], columns[f"{joint}_tilt"]])
    length, angle = np.asarray(columns[f"r_{joint}"]), np.nan_to_num(columns[f"gamma_{joint}"])
    return np.array([length * np.cos(angle), length * np.sin(angle)])


def variables_of(linkage: Linkage) -> dict[str, float]:
    """The values [m] that can vary, by name: ``BODY.length`` of the links, ``frame.POINT.x`` and
    ``.y``."""
    values = {}
    for name, body in linkage.bodies.items():
        if name == FRAME:
            for point, place in body.points.items():
                for axis, coordinate in zip("xy", place, strict=True):
                    values[f"{FRAME}.{point}.{axis}"] = number(coordinate)
        elif _is_link(body):
            values[f"{name}.length"] = list(body.points.values())[1][0]
    return values


def _is_link(body: Body) -> bool:
    """Whether its first point is its origin and its second lies on its axis."""
    first, second, *_ = *body.points.values(), ZERO, ZERO
    return first == ZERO and second[0] is not None and second[1] is None


def varied(linkage: Linkage, values: Mapping[str, Any]) -> Linkage:
    """The linkage with other values of variables, numbers or symbols; the mass centre of a link
    moves in proportion along it."""
    points = {name: dict(body.points) for name, body in linkage.bodies.items()}
    centres = {name: body.centre for name, body in linkage.bodies.items()}
    for variable, value in values.items():
        body, _, key = variable.partition(".")
        if body == FRAME:
            point, _, axis = key.partition(".")
            x, y = points[FRAME][point]
            points[FRAME][point] = (value, y) if axis == "x" else (x, value)
        else:
            end, (along, across) = [*points[body]][1], centres[body]
            if along is not None:
                centres[body] = value * (along / points[body][end][0]), across
            points[body][end] = value, None
    bodies = {
        name: replace(body, points=points[name], centre=centres[name])
        for name, body in linkage.bodies.items()
    }
    return replace(linkage, bodies=bodies)


class Geometry:
    """Transmission angles, strokes and, with ideal joints, forces of a linkage as functions of some
    of its variables, with exact derivatives.

    The equations are traced once and run on arrays: values (..., n) for variables (..., variables)
    at n crank angles, and derivatives (..., n, variables).

    Parameters
    ----------
    linkage, signs
        Topology and assembly.
    variables : sequence of str
        Names, see `variables_of`.
    """

    def __init__(self, linkage: Linkage, signs: Sequence[float], variables: Sequence[str]):
        graph = Graph()
        self._graph, self._codes, self._sizes, self.linkage = graph, {}, {}, linkage
        self._variables = [graph.load("variables", i) for i in range(len(variables))]
        changed = varied(linkage, dict(zip(variables, self._variables, strict=True)))
        vectors = {
            joint.name: ((graph.load("vectors", 2 * i), graph.load("vectors", 2 * i + 1)), NOTHING)
            for i, joint in enumerate(linkage.loose)
        }
        crank = Crank(*(graph.load("crank", i) for i in range(4)))
        arithmetic = Arithmetic(sqrt=graph.root, cos_sin=graph.cos_sin)
        self._pose = Pose(changed, signs, crank, vectors, arithmetic)

    def is_constant(self, dyad: Dyad) -> bool:
        """Whether the transmission angle is 90 deg for any lengths."""
        return not isinstance(self._pose.cosines[dyad.inner.name], Symbol)

    def angle(self, dyad: Dyad, *at: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Transmission angle [rad] with its derivatives, `at` variables (..., variables), crank
        angles (n,) [rad] and clearance vectors (2 loose joints, n), by default none."""
        (cosine,), (slopes,) = self._evaluated((self._pose.cosines[dyad.inner.name],), *at)
        return angle_of(cosine), _angle_slope(cosine)[..., None] * slopes

    def place(self, body: str, *at: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Place [m] along its slide of a body that slides on the frame, or angle [rad] of another,
        with its derivatives; `at` as of `angle`."""
        if slide := slide_of(self.linkage, body):
            (values,), (slopes,) = self._evaluated((self._pose.travel(slide)[0],), *at)
            return values, slopes
        (c, s), (dc, ds) = self._evaluated(self._pose.directions[body], *at)
        return np.unwrap(np.arctan2(s, c)), c[..., None] * ds - s[..., None] * dc

    def forces(
        self, names: Sequence[str], variables: ArrayLike, motion: "CrankMotion"
    ) -> tuple[np.ndarray, np.ndarray]:
        """Forces in joints by name [N], of a slide across it, or the ``crank_torque`` of the drive
        [N m], (names, ..., n), with their derivatives; NaN where the linkage does not close. No
        joint is loose."""
        key = motion.pushed, len(motion.moments)
        if key not in self._sizes:
            self._sizes[key] = self._required(*key)
        results = tuple(self._sizes[key][name] for name in names)
        return tuple(map(np.array, self._run(results, variables, motion._asdict())))

    def _required(self, pushed: Sequence[str], rubbing: int) -> dict[str, Number]:
        """Forces and torque by name, with effects at joints."""
        load, root, pose = self._graph.load, self._graph.root, self._pose
        along = {name: load("along", i) for i, name in enumerate(pushed)}
        pins = zip(self.linkage.rubbing, range(rubbing), strict=False)
        moments = {joint.name: load("moments", i) for joint, i in pins}
        found = balance(Dynamics(pose, {}, 0.0, None, moments, along), {}, moments, along)
        sizes: dict[str, Number] = {"crank_torque": found.torque - load("losses", 0)}
        for name, force in found.forces.items():
            sizes[name] = root(dot(force, force))
            if (joint := self.linkage.joints[name]).kind == "slide":
                normal = across(pose.turned(joint.partner.body, pose.line(joint)))
                sizes[name] = root(dot(normal, force) * dot(normal, force))
        return sizes

    def _evaluated(
        self,
        results: tuple[Number, ...],
        variables: ArrayLike,
        crank_angle: np.ndarray,
        vectors: np.ndarray | None = None,
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Results and their derivatives for variables (..., variables), at crank angles (n,) [rad],
        with clearance vectors (2 loose joints, n), by default none."""
        vectors = np.zeros(2 * len(self.linkage.loose)) if vectors is None else vectors
        crank = [np.cos(crank_angle), np.sin(crank_angle)]
        return self._run(results, variables, {"crank": crank, "vectors": vectors})

    def _run(
        self, results: tuple[Number, ...], variables: ArrayLike, memory: dict[str, ArrayLike]
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Results and their derivatives, with the other fields of the `memory`."""
        variables = np.asarray(variables, dtype=float)
        angles, count = len(memory["crank"][0]), len(self._variables)
        shape = (*variables.shape[:-1], angles)
        code, total = self._code(results), len(results) * (1 + count)
        rows = variables.reshape(-1, count, 1)
        found = np.empty((total, len(rows), angles))
        step = max(_AT_ONCE // angles, 1)
        for first in range(0, len(rows), step):
            memory["variables"] = np.moveaxis(rows[first : first + step], 1, 0)
            memory["results"] = [None] * total
            code.run(memory)
            for each, result in zip(found, memory["results"], strict=True):
                each[first : first + step] = result
        values, slopes = np.split(found.reshape(total, *shape), [len(results)])
        return [*values], [*np.moveaxis(slopes.reshape(len(results), count, *shape), 1, -1)]

    def _code(self, results: tuple[Number, ...]) -> Code:
        """A function that writes the results, then their derivatives."""
        nodes = tuple(map(self._graph.index, results))
        if nodes not in self._codes:
            slopes = derivatives(self._graph, results, self._variables)
            every = [*nodes, *(self._graph.index(each) for row in slopes for each in row)]
            stores = tuple(Store("results", i, node) for i, node in enumerate(every))
            self._codes[nodes] = Code(self._graph, stores)
        return self._codes[nodes]


class CrankMotion(NamedTuple):
    """Motion of the crank at n angles, and forces of effects."""

    crank: np.ndarray  # (4, n) Cosine, sine, speed [rad/s], acceleration [rad/s^2]
    pushed: tuple[str, ...]  # Joints with forces of effects
    along: np.ndarray  # (pushed, n) [N, N m]
    moments: np.ndarray  # (rubbing joints, n) On their bodies [N m]; or none
    losses: np.ndarray  # (1, n) Torque on the crank [N m]


def slide_of(linkage: Linkage, body: str) -> Joint | None:
    """The slide of the frame on which a body moves, if any."""
    for joint in linkage.joints.values():
        if joint.kind == "slide" and joint.bodies == (FRAME, body):
            return joint
    return None
