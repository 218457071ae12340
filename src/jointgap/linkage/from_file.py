"""Linkages from their files: the general form, and the short form of a slider-crank."""

from collections.abc import Iterator

from jointgap.config.linkage_file import BodyPart, LinkageFile, Slide
from jointgap.config.mechanism import Link, Mechanism
from jointgap.core.errors import InputError
from jointgap.linkage.topology import (
    FRAME,
    ZERO,
    Body,
    Joint,
    Linkage,
    Place,
    Vector,
    linkage_of,
    number,
)


def linkage_of_file(file: LinkageFile) -> Linkage:
    """The linkage of a file.

    Raises
    ------
    InputError
        It cannot be built; the message names bodies and joints.
    """
    bodies = [Body(FRAME, dict(file.frame.points)), *(_body(*each) for each in file.bodies.items())]
    places = {body.name: dict(body.points) for body in bodies}
    joints = [
        Joint(name, "revolute", Place(one, name), Place(other, name), None, _is_loose(file, name))
        for name, (one, other) in file.shared_by_two.items()
    ]
    for name, joint in file.joints.items():
        if isinstance(joint, Slide):
            carrier, body = joint.slide
            places[carrier][name], places[body][name] = joint.at or ZERO, ZERO
            ends = Place(carrier, name), Place(body, name)
            joints.append(Joint(name, "slide", *ends, joint.direction, joint.loose))
    bodies = [Body(b.name, places[b.name], b.mass, b.inertia, b.centre, b.angle) for b in bodies]
    linkage = linkage_of(bodies, joints, file.drive, _gravity(file))
    for body, one, other in _levers(linkage):
        points = linkage.bodies[body].points
        if all(number(a) == number(b) for a, b in zip(points[one], points[other], strict=True)):
            raise InputError(
                f"bodies.{body}: {one} and {other} are at the same place; give them a distance"
            )
    for name in linkage.moving:
        if linkage.kinds[name] != "sliding" and not linkage.bodies[name].inertia:
            raise InputError(f"bodies.{name}: it turns; give its inertia")
    return linkage


def _levers(linkage: Linkage) -> Iterator[tuple[str, str, str]]:
    """Bodies with two points whose distance is a length of the linkage."""
    for joint in linkage.joints.values():
        if joint.name != linkage.drive and linkage.crank in joint.bodies:
            if joint.kind == "revolute":
                yield linkage.crank, linkage.drive, joint.name
    for dyad in linkage.dyads:
        if dyad.kind != "RPR":
            yield dyad.bodies[0], dyad.first.name, dyad.inner.name
        if dyad.kind == "RRR":
            yield dyad.bodies[1], dyad.second.name, dyad.inner.name


def _body(name: str, part: BodyPart) -> Body:
    centre = part.mass_centre
    points: dict[str, Vector] = dict(part.points or {})
    if part.ends:
        points = {part.ends[0]: ZERO, part.ends[1]: (part.length, None)}
    if not isinstance(centre, tuple):
        centre = (centre, None)
    return Body(name, points, part.mass, part.inertia or 0.0, centre, part.angle)


def _is_loose(file: LinkageFile, name: str) -> bool:
    joint = file.joints.get(name)
    return joint is not None and joint.loose


def _gravity(file: LinkageFile | Mechanism) -> Vector:
    """Gravitational acceleration; zero by the form of the file without the effect."""
    return tuple(map(float, file.gravity)) if file.effect("gravity") else ZERO


def linkage_of_slider_crank(mechanism: Mechanism) -> Linkage:
    """The linkage of the short form: crank, rod and slider, whose slide is the line y = offset."""
    bodies = [
        Body(FRAME, {"crank_pivot": ZERO, "guide": (None, mechanism.slider.offset)}),
        _link("crank", mechanism.crank, "crank_pivot", "crank_pin"),
        _link("rod", mechanism.rod, "crank_pin", "piston_pin"),
        Body("slider", {"piston_pin": ZERO, "guide": ZERO}, mechanism.slider.mass),
    ]
    return linkage_of(bodies, [*_joints(mechanism)], "crank_pivot", _gravity(mechanism))


def _link(name: str, link: Link, begin: str, end: str) -> Body:
    across = link.mass_centre_across if name == "crank" else None
    points = {begin: ZERO, end: (link.length, None)}
    return Body(name, points, link.mass, link.inertia, (link.mass_centre, across))


def _joints(mechanism: Mechanism) -> Iterator[Joint]:
    for name, *ends in (
        ("crank_pin", "crank", "rod"),
        ("piston_pin", "slider", "rod"),
        ("crank_pivot", FRAME, "crank"),
    ):
        places = [Place(body, name) for body in ends]
        yield Joint(name, "revolute", *places, None, name in mechanism.loose)
    yield Joint("guide", "slide", Place(FRAME, "guide"), Place("slider", "guide"))
