"""Mobility, dyads and assemblies; every linkage that cannot be built is refused with a way out."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.errors import InputError
from jointgap.linkage.assembly import check_turning, signs_of
from jointgap.linkage.equations import Arithmetic, Crank, Pose
from jointgap.linkage.topology import Body, linkage_of
from tests.linkage.cases import LINKAGES, four_bar, frame, link, pin, six_bar, slide, slider_crank


def rebuilt(linkage, bodies=(), joints=None, drive=None):
    """The linkage with other bodies, joints or drive."""
    changed = dict(linkage.bodies) | {body.name: body for body in bodies}
    joints = [*linkage.joints.values()] if joints is None else joints
    return linkage_of([*changed.values()], joints, drive or linkage.drive, linkage.gravity)


@pytest.mark.parametrize(
    "name, kinds",
    [
        ("slider_crank", ["RRP"]),
        ("four_bar", ["RRR"]),
        ("six_bar", ["RRR", "RRR"]),
        ("quick_return", ["RPR", "RRP"]),
        ("carried_slide", ["RRR", "RRP"]),
    ],
)
def test_a_linkage_is_placed_by_dyads_from_the_crank(name, kinds):
    linkage = LINKAGES[name]
    assert [dyad.kind for dyad in linkage.dyads] == kinds and linkage.crank == "crank"
    assert linkage.joints["O" if "O" in linkage.joints else "crank_pivot"].partner.body == "frame"


def test_clearance_vectors_of_a_slider_crank_begin_at_frame_crank_and_slider():
    joints = slider_crank().joints
    ends = {name: joint.bodies for name, joint in joints.items()}
    assert ends["crank_pivot"] == ("frame", "crank") and ends["crank_pin"] == ("crank", "rod")
    assert ends["piston_pin"] == ("slider", "rod")


def test_other_mobilities_are_refused_with_the_body_that_is_loose_or_the_joint_too_many():
    linkage = four_bar()
    joints = [*linkage.joints.values()]
    with pytest.raises(InputError, match="3 moving bodies with 3 joints have 3 degrees of freedom"):
        rebuilt(linkage, joints=joints[:-1])
    with pytest.raises(InputError, match="body rocker has one joint only, join its other end"):
        rebuilt(linkage, joints=joints[:-1])
    link_e = link("extra", "P", "Q", 0.3, 1.0, 1e-2, 0.1)
    with pytest.raises(InputError, match="body extra has no joint, join its other end"):
        rebuilt(linkage, [link_e])
    with pytest.raises(InputError, match=r"-1 degrees of freedom.*it cannot move: remove a joint"):
        rebuilt(linkage, joints=[*joints, pin("X", "frame.C", "coupler.B")])


def test_the_drive_must_be_a_pivot_of_the_frame():
    with pytest.raises(InputError, match=r"drive: A joins crank and coupler.*frame: O or C"):
        rebuilt(four_bar(), drive="A")
    with pytest.raises(InputError, match="there is no joint 'OO'"):
        rebuilt(four_bar(), drive="OO")
    with pytest.raises(InputError, match="guide is a slide of frame and slider"):
        rebuilt(slider_crank(), drive="guide")


def test_a_group_that_can_only_be_placed_together_names_the_joint_to_drive_instead():
    """Stephenson III driven at its output pivot side: the four other bodies form one group."""
    linkage = six_bar()
    assert [d.kind for d in rebuilt(linkage, drive="C").dyads] == ["RRR", "RRR"]
    with pytest.raises(InputError, match="can only be placed together; drive O or C instead"):
        rebuilt(linkage, drive="E")


def test_a_group_with_two_slides_is_refused():
    bodies = [
        frame(O=(None, None), x=(None, None), y=(0.2, None)),
        link("crank", "O", "A", 0.1, 1.0, 1e-3, 0.05),
        Body("cross", {"A": (None, None), "y": (None, 0.1)}, 1.0, 1e-3),
        Body("ram", {"y": (None, None), "x": (None, None)}, 1.0),
    ]
    joints = [
        pin("O", "frame.O", "crank.O"),
        pin("A", "crank.A", "cross.A"),
        slide("inner", "ram.y", "cross.y", math.pi / 2),
        slide("outer", "frame.x", "ram.x"),
    ]
    with pytest.raises(InputError, match=r"A, inner, outer \(RPP\) is not supported"):
        linkage_of(bodies, joints, "O")


@pytest.mark.parametrize("name", LINKAGES)
def test_all_linkages_close_over_a_whole_turn(name):
    signs = signs_of(LINKAGES[name], 0.3)
    assert check_turning(LINKAGES[name], signs) == []


def test_the_assembly_is_that_of_the_stated_direction():
    linkage = four_bar()
    rocker = linkage.bodies["rocker"]
    assert signs_of(linkage, 0.0) == (1.0,)
    assert signs_of(rebuilt(linkage, [replace(rocker, angle=math.radians(-100))]), 0.0) == (-1.0,)
    with pytest.raises(InputError, match=r"can be assembled in two ways; give rocker.angle"):
        signs_of(rebuilt(linkage, [replace(rocker, angle=None)]), 0.0)
    with pytest.raises(InputError, match="rocker: angle 5 deg is within 6 deg of the line"):
        signs_of(rebuilt(linkage, [replace(rocker, angle=math.radians(5))]), 0.0)


def test_a_linkage_that_does_not_close_says_where_and_how_long_its_bodies_are():
    linkage = rebuilt(four_bar(), [link("rocker", "C", "B", 0.13, 1.0, 5.2e-3, 0.05, 100.0)])
    with pytest.raises(InputError, match="angle 0 deg coupler and rocker do not meet: 200 mm"):
        check_turning(linkage, (1.0,))
    short = rebuilt(slider_crank(), [link("rod", "A", "B", 0.14, 0.7, 2e-2, 0.07, 0.0)])
    with pytest.raises(InputError, match="rod does not reach the slide of slider: it is 140 mm"):
        check_turning(short, (1.0,))


def test_a_dead_point_is_a_remark():
    rocker = link("rocker", "C", "B", 0.2001, 1.0, 5.2e-3, 0.125, 100.0)
    linkage = rebuilt(four_bar(), [rocker])
    (remark,) = check_turning(linkage, signs_of(linkage, 1.0))
    assert "deg from a dead point" in remark and "coupler and rocker" in remark


@pytest.mark.parametrize(
    "angle, directions, speeds, accelerations",
    [
        (120.0, (88.84, 117.29), (-5.991, -3.992), (26.08, 53.33)),
        (-144.0, (-115.21, -143.66), (-0.662, -2.662), (77.92, 50.67)),
    ],
    ids=["open", "crossed"],
)
def test_the_four_bar_of_norton_has_the_printed_angles_speeds_and_accelerations(
    angle, directions, speeds, accelerations
):
    """R. L. Norton, Design of Machinery: lengths 6 (ground), 2, 7, 9 at 30 deg and 10 rad/s."""
    bodies = [
        frame(O=(None, None), C=(6.0, None)),
        link("crank", "O", "A", 2.0, 1.0, 1.0, 1.0),
        link("coupler", "A", "B", 7.0, 1.0, 1.0, 3.5),
        link("rocker", "C", "B", 9.0, 1.0, 1.0, 4.5, angle),
    ]
    joints = [
        pin("O", "frame.O", "crank.O"),
        pin("A", "crank.A", "coupler.A"),
        pin("B", "coupler.B", "rocker.B"),
        pin("C", "frame.C", "rocker.C"),
    ]
    linkage = linkage_of(bodies, joints, "O")
    start, step = math.radians(30.0), 1e-5
    signs = signs_of(linkage, start)
    poses = [
        Pose(linkage, signs, Crank(math.cos(a), math.sin(a), 10.0), {})
        for a in (start - step, start, start + step)
    ]
    for i, body in enumerate(("coupler", "rocker")):
        cosine, sine = poses[1].directions[body]
        assert math.degrees(math.atan2(sine, cosine)) == pytest.approx(directions[i], abs=5e-3)
        assert poses[1].speeds[body] == pytest.approx(speeds[i], abs=5e-4)
        turn = 10.0 * (poses[2].speeds[body] - poses[0].speeds[body]) / (2 * step)
        assert turn == pytest.approx(accelerations[i], abs=5e-3)


def test_poses_of_many_angles_at_once_are_those_of_each():
    linkage, angles = LINKAGES["six_bar"], np.linspace(0.0, 6.0, 7)
    signs = signs_of(linkage, 0.3)
    together = Pose(
        linkage, signs, Crank(np.cos(angles), np.sin(angles), 2.0), {}, Arithmetic(sqrt=np.sqrt)
    )
    for i, angle in enumerate(angles):
        one = Pose(linkage, signs, Crank(math.cos(angle), math.sin(angle), 2.0), {})
        place, speed = one.point("output", None)
        found = together.point("output", None)
        assert [each[i] for each in found[0]] == pytest.approx(place, rel=1e-14)
        assert [each[i] for each in found[1]] == pytest.approx(speed, rel=1e-12)
