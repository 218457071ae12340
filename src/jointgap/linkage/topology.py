"""Bodies and joints of a linkage, and the order in which they are placed.

A linkage has one degree of freedom while all joints are ideal. From frame and crank on, two bodies
at a time are placed: a dyad, each of whose bodies has one joint with a placed body, and which are
joined to each other.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

from jointgap.core.errors import InputError, did_you_mean

FRAME = "frame"

Coordinate = float | None
"""A number in SI; None where it is zero by the form of the file. No value makes other code."""

Vector = tuple[Coordinate, Coordinate]

ZERO: Vector = (None, None)


class Place(NamedTuple):
    """A point of a body."""

    body: str
    point: str


class Bending(NamedTuple):
    """First bending mode of a body that is a uniform beam between its two joints."""

    angular_frequency: float  # [rad/s]
    damping_ratio: float


@dataclass(frozen=True)
class Body:
    """A rigid body; all vectors are in its own axes."""

    name: str
    points: Mapping[str, Vector]  # [m]
    mass: float = 0.0  # [kg]
    inertia: float = 0.0  # [kg m^2] About the mass centre
    centre: Vector = ZERO  # [m] Mass centre
    angle: float | None = None  # [rad] Rough direction at the start; chooses between two assemblies
    bending: Bending | None = None


@dataclass(frozen=True)
class Joint:
    """A revolute joint, or a slide.

    The clearance vector of a revolute joint points from its place on the `partner` to that on the
    `body`. In a slide the `body` keeps the direction of the `partner`, and its point runs on a line
    through the partner's point.
    """

    name: str
    kind: Literal["revolute", "slide"]
    partner: Place
    body: Place
    direction: Coordinate = None  # [rad] Of the line of a slide, in the partner's axes
    loose: bool = False

    def place(self, body: str) -> Place:
        """The point of one of its two bodies."""
        return self.partner if self.partner.body == body else self.body

    def other(self, body: str) -> Place:
        """The point of the other body."""
        return self.body if self.partner.body == body else self.partner

    @property
    def bodies(self) -> tuple[str, str]:
        return self.partner.body, self.body.body


@dataclass(frozen=True)
class Dyad:
    """Two bodies that are placed together.

    Kinds by the joints along `first`, `inner`, `second`, where R is a revolute joint and P a slide:
    RRR; RRP, whose second body slides on a placed one; RPR, whose first body is a block that slides
    on the second.
    """

    kind: Literal["RRR", "RRP", "RPR"]
    bodies: tuple[str, str]
    first: Joint  # Of the first body with a placed one
    inner: Joint
    second: Joint  # Of the second body with a placed one


@dataclass(frozen=True)
class Linkage:
    """Topology of a linkage of one degree of freedom."""

    bodies: Mapping[str, Body]  # With the frame, which is the first
    joints: Mapping[str, Joint]
    drive: str  # Joint of crank and frame
    gravity: Vector = ZERO  # [m/s^2]
    crank: str = ""
    dyads: tuple[Dyad, ...] = ()
    kinds: Mapping[str, str] = field(default_factory=dict)  # Of the bodies, see `body_kinds`

    @property
    def loose(self) -> tuple[Joint, ...]:
        """The loose joints, in the order of the states: slides last."""
        loose = (joint for joint in self.joints.values() if joint.loose)
        return tuple(sorted(loose, key=lambda joint: joint.kind == "slide"))

    @property
    def rubbing(self) -> tuple[Joint, ...]:
        """The ideal revolute joints of two moving bodies, whose friction depends on their
        reactions."""
        return tuple(
            joint
            for joint in self.joints.values()
            if joint.kind == "revolute" and not joint.loose and FRAME not in joint.bodies
        )

    @property
    def bending(self) -> tuple[str, ...]:
        """Names of the bodies that bend."""
        return tuple(name for name in self.moving if self.bodies[name].bending is not None)

    @property
    def moving(self) -> tuple[str, ...]:
        """Names of all bodies but the frame."""
        return tuple(name for name in self.bodies if name != FRAME)

    @property
    def form(self) -> tuple:
        """All that determines its equations, apart from numbers."""

        def zeros(vector: Vector) -> tuple[bool, ...]:
            return tuple(coordinate is None for coordinate in vector)

        bodies = tuple(
            (
                body.name,
                zeros(body.centre),
                body.bending is None,
                tuple((name, zeros(point)) for name, point in body.points.items()),
            )
            for body in self.bodies.values()
        )
        joints = tuple(
            (
                joint.name,
                joint.kind,
                joint.partner,
                joint.body,
                joint.direction is None,
                joint.loose,
            )
            for joint in self.joints.values()
        )
        return bodies, joints, self.drive, zeros(self.gravity)

    def with_inertia(self, body: str, inertia: float) -> "Linkage":
        """The same with a further moment of inertia [kg m^2] of a body."""
        part = self.bodies[body]
        heavier = replace(part, inertia=part.inertia + inertia)
        return replace(self, bodies={**self.bodies, body: heavier})

    def joint_with_frame(self, body: str) -> Joint | None:
        """The ideal joint of a body with the frame, if any."""
        for joint in self.joints.values():
            if not joint.loose and {*joint.bodies} == {FRAME, body}:
                return joint
        return None


def linkage_of(
    bodies: Sequence[Body], joints: Sequence[Joint], drive: str, gravity: Vector = ZERO
) -> Linkage:
    """A linkage with its crank and dyads.

    Parameters
    ----------
    bodies : sequence of Body
        With the body ``frame``.
    joints : sequence of Joint
        Partner and body of revolute joints in any order; they are ordered from the driven side.
    drive : str
        Name of the joint of frame and crank.
    gravity : Vector, optional
        Gravitational acceleration [m/s^2].

    Raises
    ------
    InputError
        The linkage cannot be built; the message names bodies and joints.
    """
    by_name = {body.name: body for body in bodies}
    by_name = {FRAME: by_name[FRAME]} | by_name
    _check_mobility(by_name, joints)
    crank = _crank(joints, drive)
    dyads = _dyads(by_name, joints, drive, crank)
    if dyads is None:
        raise InputError(_together(by_name, joints, drive, crank))
    ordered = {joint.name: joint for joint in _oriented(joints, drive, dyads)}
    dyads = tuple(
        Dyad(
            each.kind,
            each.bodies,
            *(ordered[j.name] for j in (each.first, each.inner, each.second)),
        )
        for each in dyads
    )
    linkage = Linkage(by_name, ordered, drive, gravity, crank, dyads)
    return Linkage(by_name, ordered, drive, gravity, crank, dyads, body_kinds(linkage))


def body_kinds(linkage: Linkage) -> dict[str, str]:
    """How each moving body is held: ``pivoted`` or ``sliding`` by an ideal joint with the frame, or
    ``free``, or free and ``bending``."""
    kinds = {}
    for name in linkage.moving:
        joint = linkage.joint_with_frame(name)
        held = joint and ("pivoted" if joint.kind == "revolute" else "sliding")
        kinds[name] = held or ("bending" if linkage.bodies[name].bending else "free")
    return kinds


def _check_mobility(bodies: Mapping[str, Body], joints: Sequence[Joint]) -> None:
    """InputError unless the linkage has one degree of freedom without clearance (Grübler)."""
    moving = [name for name in bodies if name != FRAME]
    counts = {name: sum(name in joint.bodies for joint in joints) for name in moving}
    freedom = 3 * len(moving) - 2 * len(joints)
    if freedom == 1:
        return
    once = [name for name, count in counts.items() if count < 2]
    what = (
        f"{len(moving)} moving bodies with {len(joints)} joints have {freedom} degrees of freedom"
    )
    if freedom > 1:
        fix = "join a body once more"
        if once:
            times = "no joint" if not counts[once[0]] else "one joint only"
            fix = f"body {once[0]} has {times}, join its other end"
    else:
        fix = "it cannot move: remove a joint, or add a body"
    raise InputError(f"{what} without clearance; a linkage has 1: {fix}")


def _crank(joints: Sequence[Joint], drive: str) -> str:
    """The driven body."""
    by_name = {joint.name: joint for joint in joints}
    pivots = [j.name for j in joints if FRAME in j.bodies and j.kind == "revolute"]
    if drive not in by_name:
        raise InputError(f"drive: there is no joint '{drive}'; {did_you_mean(drive, by_name)}")
    joint = by_name[drive]
    if FRAME not in joint.bodies or joint.kind == "slide":
        first, second = joint.bodies
        does = "is a slide of" if joint.kind == "slide" else "joins"
        raise InputError(
            f"drive: {drive} {does} {first} and {second}; the drive turns a body against the frame:"
            f" {' or '.join(pivots)}"
        )
    return joint.other(FRAME).body


def _dyads(
    bodies: Mapping[str, Body], joints: Sequence[Joint], drive: str, crank: str
) -> tuple[Dyad, ...] | None:
    """The dyads in the order in which they are placed; None if more than two bodies can only be
    placed together."""
    order, left, dyads = [FRAME, crank], [j for j in joints if j.name != drive], []
    while len(order) < len(bodies):
        dyad = next(_placeable(left, order), None)
        if dyad is None:
            return None
        dyads.append(dyad)
        order += dyad.bodies
        left = [j for j in left if j not in (dyad.first, dyad.inner, dyad.second)]
    return tuple(dyads)


def _placeable(left: Sequence[Joint], order: Sequence[str]) -> Iterator[Dyad]:
    """The dyads whose outer joints are with bodies that are placed, in this `order`."""
    for inner in left:
        if order and {*inner.bodies} & {*order}:
            continue
        outer = []
        for body in inner.bodies:
            with_placed = [j for j in left if body in j.bodies and j.other(body).body in order]
            outer.append((body, with_placed))
        if all(len(found) == 1 for _, found in outer):
            yield _dyad(inner, [(body, found[0]) for body, found in outer], order)


def _dyad(inner: Joint, outer: list[tuple[str, Joint]], order: Sequence[str]) -> Dyad:
    """A dyad from its inner joint and the outer joint of each body; the first body is on the driven
    side."""
    letter = {"revolute": "R", "slide": "P"}
    # nearer to the crank first: its partner was placed last
    outer = sorted(outer, key=lambda each: -order.index(each[1].other(each[0]).body))
    if letter[outer[0][1].kind] == "P" and letter[outer[1][1].kind] == "R":
        outer.reverse()
    if inner.kind == "slide" and outer[0][0] == inner.partner.body:
        outer.reverse()  # the second body carries the slide
    (first, one), (second, two) = outer
    kind = "".join(letter[joint.kind] for joint in (one, inner, two))
    if kind not in ("RRR", "RRP", "RPR"):
        raise InputError(
            f"bodies {first} and {second}: a group with the joints {one.name}, {inner.name},"
            f" {two.name} ({kind}) is not supported; give one of the slides another place"
        )
    if kind == "RRP" and two.partner.body == second:
        raise InputError(
            f"{two.name}: {second} carries the slide of {two.body.body}, which is placed before it;"
            f" write slide: [{two.body.body}, {second}]"
        )
    return Dyad(kind, (first, second), one, inner, two)


def _oriented(joints: Sequence[Joint], drive: str, dyads: Sequence[Dyad]) -> Iterator[Joint]:
    """The joints in the order in which they are placed, with partner and body from the driven side:
    outwards, and at the inner joint of a dyad from the second body to the first."""
    bodies: dict[str, str | None] = {drive: None}
    for dyad in dyads:
        bodies |= {dyad.first.name: dyad.bodies[0], dyad.inner.name: dyad.bodies[0]}
        bodies[dyad.second.name] = dyad.bodies[1]
    by_name = {joint.name: joint for joint in joints}
    for joint in map(by_name.get, bodies):
        body = bodies[joint.name] or joint.other(FRAME).body
        if joint.kind == "slide" or joint.body.body == body:
            yield joint
        else:
            yield Joint(joint.name, joint.kind, joint.body, joint.partner, None, joint.loose)


def _together(bodies: Mapping[str, Body], joints: Sequence[Joint], drive: str, crank: str) -> str:
    """Error message where more than two bodies can only be placed together."""
    placed = {FRAME, crank}
    left = [j for j in joints if j.name != drive]
    while dyad := next(_placeable(left, list(placed)), None):
        placed |= {*dyad.bodies}
        left = [j for j in left if j not in (dyad.first, dyad.inner, dyad.second)]
    group = ", ".join(name for name in bodies if name not in placed)
    others = []
    for joint in joints:
        if joint.name != drive and joint.kind == "revolute" and FRAME in joint.bodies:
            if _dyads(bodies, joints, joint.name, joint.other(FRAME).body) is not None:
                others.append(joint.name)
    fix = f"drive {' or '.join(others)} instead" if others else "no other joint of the frame helps"
    return f"with the drive at {drive} the bodies {group} can only be placed together; {fix}"


def number(coordinate: Coordinate) -> float:
    """The value of a coordinate."""
    return 0.0 if coordinate is None else coordinate
