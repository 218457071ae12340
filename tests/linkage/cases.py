"""Linkages of all dyads, with numbers in SI."""

import math
from dataclasses import replace

from jointgap.linkage.topology import Body, Joint, Linkage, Place, linkage_of

DOWN = (None, -9.80665)


def frame(**points):
    return Body("frame", points)


def link(name, begin, end, length, mass, inertia, centre, angle=None):
    """A body whose axes run from one end to the other."""
    angle = None if angle is None else math.radians(angle)
    points = {begin: (None, None), end: (length, None)}
    return Body(name, points, mass, inertia, (centre, None), angle)


def pin(name, one, other):
    return Joint(name, "revolute", Place(*one.split(".")), Place(*other.split(".")))


def slide(name, carrier, body, direction=None):
    return Joint(name, "slide", Place(*carrier.split(".")), Place(*body.split(".")), direction)


CRANK = link("crank", "O", "A", 0.1, 1.0, 8.3e-4, 0.05)


def slider_crank(direction=None, offset=None):
    bodies = [
        frame(O=(None, None), guide=(None, offset)),
        link("crank", "O", "A", 0.15, 0.3704, 1.458e-3, 0.075),
        link("rod", "A", "B", 0.564, 0.773, 2.482e-2, 0.282, 0.0),
        Body("slider", {"B": (None, None), "guide": (None, None)}, 0.4482),
    ]
    joints = [
        pin("crank_pivot", "frame.O", "crank.O"),
        pin("crank_pin", "crank.A", "rod.A"),
        pin("piston_pin", "rod.B", "slider.B"),
        slide("guide", "frame.guide", "slider.guide", direction),
    ]
    return linkage_of(bodies, joints, "crank_pivot", DOWN)


def four_bar():
    bodies = [
        frame(O=(None, None), C=(0.3, 0.0)),
        CRANK,
        link("coupler", "A", "B", 0.4, 1.0, 1.333e-2, 0.2),
        link("rocker", "C", "B", 0.25, 1.0, 5.2e-3, 0.125, 100.0),
    ]
    joints = [
        pin("O", "frame.O", "crank.O"),
        pin("A", "crank.A", "coupler.A"),
        pin("B", "coupler.B", "rocker.B"),
        pin("C", "frame.C", "rocker.C"),
    ]
    return linkage_of(bodies, joints, "O", DOWN)


def six_bar():
    """Stephenson III: the coupler has a third point."""
    coupler = {"A": (0.0, 0.0), "B": (0.4, 0.0), "D": (0.35, 0.15)}
    bodies = [
        frame(O=(0.0, 0.0), C=(0.3, 0.0), E=(0.75, 0.05)),
        CRANK,
        Body("coupler", coupler, 1.0, 1.333e-2, (0.2, 0.02)),
        link("rocker", "C", "B", 0.25, 1.0, 5.2e-3, 0.125, 100.0),
        link("link", "D", "F", 0.46, 0.6, 5e-3, 0.23),
        link("output", "E", "F", 0.30, 0.8, 4e-3, 0.15, 80.0),
    ]
    joints = [
        pin("O", "frame.O", "crank.O"),
        pin("A", "crank.A", "coupler.A"),
        pin("B", "coupler.B", "rocker.B"),
        pin("C", "frame.C", "rocker.C"),
        pin("D", "coupler.D", "link.D"),
        pin("F", "link.F", "output.F"),
        pin("E", "frame.E", "output.E"),
    ]
    return linkage_of(bodies, joints, "O", DOWN)


def quick_return(beside=None):
    """Whitworth's: a block on the crank pin slides along the rocker; `beside` its pivot."""
    rocker = {"C": (None, None), "B": (0.5, None), "track": (None, beside)}
    bodies = [
        frame(O=(None, None), C=(None, -0.3), guide=(None, 0.25)),
        CRANK,
        Body("block", {"A": (None, None), "track": (None, None)}, 0.2, 5e-5),
        Body("rocker", rocker, 2.0, 5e-2, (0.25, None)),
        link("rod", "B", "D", 0.25, 0.4, 2e-3, 0.12, 10.0),
        Body("ram", {"D": (None, None), "guide": (None, None)}, 3.0),
    ]
    joints = [
        pin("O", "frame.O", "crank.O"),
        pin("A", "crank.A", "block.A"),
        slide("track", "rocker.track", "block.track"),
        pin("C", "frame.C", "rocker.C"),
        pin("B", "rocker.B", "rod.B"),
        pin("D", "rod.D", "ram.D"),
        slide("guide", "frame.guide", "ram.guide"),
    ]
    return linkage_of(bodies, joints, "O", DOWN)


def carried_slide():
    """A four-bar whose coupler carries a slide for a further rod from the frame."""
    coupler = {"A": (0.0, 0.0), "B": (0.4, 0.0), "rail": (0.1, 0.12)}
    bodies = [
        frame(O=(None, None), C=(0.3, 0.0), E=(0.1, 0.75)),
        CRANK,
        Body("coupler", coupler, 1.0, 1.333e-2, (0.2, 0.02)),
        link("rocker", "C", "B", 0.25, 1.0, 5.2e-3, 0.125, 100.0),
        link("arm", "E", "F", 0.55, 0.6, 5e-3, 0.23, -90.0),
        Body("shoe", {"F": (0.01, 0.03), "rail": (0.0, 0.0)}, 0.3, 2e-4, (0.01, 0.0)),
    ]
    joints = [
        pin("O", "frame.O", "crank.O"),
        pin("A", "crank.A", "coupler.A"),
        pin("B", "coupler.B", "rocker.B"),
        pin("C", "frame.C", "rocker.C"),
        pin("E", "frame.E", "arm.E"),
        pin("F", "arm.F", "shoe.F"),
        slide("rail", "coupler.rail", "shoe.rail", math.radians(20.0)),
    ]
    return linkage_of(bodies, joints, "O", DOWN)


LINKAGES = {
    "slider_crank": slider_crank(),
    "tilted_slide": slider_crank(direction=0.3, offset=0.02),
    "four_bar": four_bar(),
    "six_bar": six_bar(),
    "quick_return": quick_return(),
    "quick_return_beside": quick_return(beside=0.03),
    "carried_slide": carried_slide(),
}
"""By name, all joints ideal."""


def loosened(linkage: Linkage, names) -> Linkage:
    """The linkage with other loose joints."""
    joints = [replace(joint, loose=joint.name in names) for joint in linkage.joints.values()]
    return linkage_of([*linkage.bodies.values()], joints, linkage.drive, linkage.gravity)


def with_values(linkage: Linkage, **bodies) -> Linkage:
    """The linkage with other values of its bodies, in the same form."""
    changed = {name: replace(linkage.bodies[name], **values) for name, values in bodies.items()}
    return replace(linkage, bodies={**linkage.bodies, **changed})
