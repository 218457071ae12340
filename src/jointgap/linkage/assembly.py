"""Which of its assemblies a linkage has, and whether it closes at all crank angles."""

import math
from collections.abc import Sequence

import numpy as np

from jointgap.core.errors import InputError
from jointgap.linkage.equations import Arithmetic, Crank, Pose
from jointgap.linkage.topology import Dyad, Linkage, number

ON_ARRAYS = Arithmetic(
    sqrt=np.sqrt,
    cos_sin=lambda x: (np.cos(x), np.sin(x)),
    angle=lambda direction: np.arctan2(direction[1], direction[0]),
)
"""Arithmetic of arrays."""

ANGLES = 720
"""Crank angles of a scan."""

_UNDECIDED = math.radians(12.0)
"""Least difference of a stated angle's distances to the two assemblies: 6 deg from the line between
them."""

_NEAR = math.radians(5.0)
"""Angle from a dead point below which there is a remark."""


def signs_of(linkage: Linkage, crank_angle: float) -> tuple[float, ...]:
    """The sign of each dyad at a crank angle [rad]: the assembly that is nearest to the stated
    directions of its bodies.

    Without a stated direction the body of an RRP dyad points along its slide, and the block of an
    RPR dyad is ahead of the pivot.

    Raises
    ------
    InputError
        A direction is not stated, or lies between the two assemblies, or the linkage does not close
        here.
    """
    signs: list[float] = []
    for dyad in linkage.dyads:
        both = {
            sign: _directions(linkage, (*signs, sign), crank_angle, dyad) for sign in (1.0, -1.0)
        }
        stated = [body for body in dyad.bodies if linkage.bodies[body].angle is not None]
        if not stated:
            if dyad.kind == "RRR":
                first, second = dyad.bodies
                raise InputError(
                    f"bodies {first} and {second} can be assembled in two ways; give"
                    f" {second}.angle, its rough direction at the start"
                )
            signs.append(1.0)
            continue
        if any(math.isnan(angle) for angle in both[1.0].values()):
            raise InputError(_does_not_close(linkage, (*signs, 1.0), crank_angle))
        body = stated[0]
        angle = linkage.bodies[body].angle
        distances = {sign: abs(_turn(angle, at[body])) for sign, at in both.items()}
        for other in stated[1:]:
            further = {
                sign: abs(_turn(linkage.bodies[other].angle, at[other]))
                for sign, at in both.items()
            }
            if min(further, key=further.get) != min(distances, key=distances.get):
                raise InputError(
                    f"{body}.angle and {other}.angle belong to different assemblies; give one of"
                    " them as drawn"
                )
        if abs(distances[1.0] - distances[-1.0]) < _UNDECIDED:
            ends = " - ".join(joint.other(one).point for joint, one in _outer(dyad))
            raise InputError(
                f"{body}: angle {math.degrees(angle):g} deg is within 6 deg of the line {ends} at"
                " the start, so it fits both assemblies; give the direction as drawn"
            )
        signs.append(min(distances, key=distances.get))
    return tuple(signs)


def check_turning(linkage: Linkage, signs: Sequence[float], clearances: float = 0.0) -> list[str]:
    """Whether the crank can turn fully; remarks on dead points.

    Parameters
    ----------
    linkage, signs
        Topology and assembly.
    clearances : float, optional
        Sum of all clearances [m].

    Raises
    ------
    InputError
        The linkage does not close at a crank angle; the message gives the angle, and the bodies
        with their lengths.
    """
    angles = np.linspace(0.0, 2.0 * math.pi, ANGLES, endpoint=False)
    with np.errstate(invalid="ignore", divide="ignore"):
        pose = ideal_pose(linkage, signs, angles)
        remarks = []
        for dyad in linkage.dyads:
            margin = _margin(pose, dyad)
            reach = _length(linkage, dyad.bodies[0], *_ends(dyad, 0))
            if not np.all(margin > 0.0):
                raise InputError(_does_not_close(linkage, signs, angles[np.argmin(margin > 0.0)]))
            least = int(np.argmin(margin))
            near = max(math.sin(_NEAR), math.sqrt(2.0 * clearances / reach) if reach else 0.0)
            if margin[least] < near:
                (first, second), at = dyad.bodies, math.degrees(angles[least])
                away = math.degrees(math.asin(min(margin[least], 1.0)))
                remarks.append(
                    f"at crank angle {at:.0f} deg {first} and {second} are {away:.2g} deg from a"
                    " dead point; clearances decide which way they go, so forces near it are not"
                    " valid"
                )
    return remarks


def ideal_pose(linkage: Linkage, signs: Sequence[float], angles: np.ndarray) -> Pose:
    """Poses without clearance at crank angles [rad]; NaN where the linkage does not close."""
    crank = Crank(np.cos(angles), np.sin(angles), 1.0)
    still = {joint.name: ((0.0, 0.0), (0.0, 0.0)) for joint in linkage.loose}
    return Pose(linkage, signs, crank, still, ON_ARRAYS)


def _directions(
    linkage: Linkage, signs: Sequence[float], crank_angle: float, dyad: Dyad
) -> dict[str, float]:
    """Angles [rad] of the bodies of a dyad."""
    with np.errstate(invalid="ignore", divide="ignore"):
        pose = ideal_pose(linkage, signs, np.array([crank_angle]))
    return {
        body: float(math.atan2(*(each.item() for each in np.broadcast_arrays(*reversed(vector)))))
        if np.all(np.isfinite(vector[0]))
        else math.nan
        for body in dyad.bodies
        for vector in [tuple(map(np.asarray, pose.directions[body]))]
    }


def _margin(pose: Pose, dyad: Dyad) -> np.ndarray:
    """Sine of the angle from a dead point; NaN where the dyad does not close."""
    return np.sqrt(1.0 - np.square(pose.cosines[dyad.inner.name]))


def _ends(dyad: Dyad, which: int) -> tuple[str, str]:
    """Outer and inner point of a body of a dyad."""
    body = dyad.bodies[which]
    outer = dyad.first if which == 0 else dyad.second
    return outer.place(body).point, dyad.inner.place(body).point


def _outer(dyad: Dyad):
    return zip((dyad.first, dyad.second), dyad.bodies, strict=True)


def _length(linkage: Linkage, body: str, one: str, other: str) -> float:
    points = linkage.bodies[body].points
    return math.dist(*([number(each) for each in points[name]] for name in (one, other)))


def _does_not_close(linkage: Linkage, signs: Sequence[float], crank_angle: float) -> str:
    """Error message for a crank angle [rad]."""
    at = f"at crank angle {math.degrees(crank_angle) % 360:.0f} deg"
    with np.errstate(invalid="ignore", divide="ignore"):
        for count, dyad in enumerate(linkage.dyads, start=1):
            pose = ideal_pose(linkage, signs[:count], np.array([crank_angle]))
            if np.all(_margin(pose, dyad) > 0.0):
                continue
            first, second = dyad.bodies
            ends = [np.hstack(pose.point(*joint.other(body))[0]) for joint, body in _outer(dyad)]
            lengths = [
                _length(linkage, body, *_ends(dyad, i)) for i, body in enumerate(dyad.bodies)
            ]
            if dyad.kind == "RRR":
                apart = math.dist(*ends)
                words = (
                    f"{1e3 * apart:.4g} mm apart, {1e3 * lengths[0]:g} + {1e3 * lengths[1]:g} mm"
                )
                if apart < abs(lengths[0] - lengths[1]):
                    words = words.replace(" + ", " and ")
                fix = "lengthen one of them" if apart > sum(lengths) else "change one of them"
                return (
                    f"{at} {first} and {second} do not meet: {words} long; {fix}, or let the crank"
                    " turn less"
                )
            if dyad.kind == "RRP":
                return (
                    f"{at} {first} does not reach the slide of {second}: it is"
                    f" {1e3 * lengths[0]:g} mm long; lengthen it, or let the crank turn less"
                )
            return (
                f"{at} the block {first} passes the pivot of {second}, where its direction is"
                " undetermined; move the pivot or change the crank's length"
            )
    return f"{at} the linkage does not close"


def _turn(one: float, other: float) -> float:
    """Difference of two angles [rad], from -pi to pi."""
    return math.remainder(one - other, 2.0 * math.pi)
