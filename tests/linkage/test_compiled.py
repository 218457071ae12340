"""Machine code agrees with the plain equations, and its form depends on no value."""

import math
import os
from dataclasses import replace

import numpy as np
import pytest

from jointgap.config import Mechanism
from jointgap.linkage.compiled import Kind, build_variant, channels_of, parameters_of, variant_of
from jointgap.linkage.equations import Crank, Dynamics, JointForce, Pose, across, dot
from jointgap.linkage.from_file import linkage_of_slider_crank
from jointgap.linkage.topology import Bending, body_kinds
from tests.linkage.cases import LINKAGES, loosened, with_values
from tests.linkage.test_equations import sets_of_loose_joints, state, with_turning_slider

PUSHED = {
    "slider_crank": ("guide",),
    "tilted_slide": ("guide",),
    "quick_return": ("guide", "track", "C"),
    "quick_return_beside": ("track", "C"),
    "four_bar": ("C",),
    "six_bar": ("C", "E"),
    "carried_slide": ("rail", "C", "E"),
}
"""Slides, tracks and pivots of the frame, by linkage."""


def drawn(linkage, kind, generator):
    """A random state with the forces on it: plain `Dynamics`, and what a variant's memory holds."""
    crank, clearances = state(linkage, generator, kind.is_free)
    bends = {
        body: (generator.normal(0, 2e-3), generator.normal(0, 0.5)) for body in linkage.bending
    }
    forces = {
        joint.name: JointForce(*generator.normal(0, 100, 2), *generator.normal(0, 1, 2))
        for joint in linkage.loose
    }
    torque, along = generator.normal(0, 5), {name: generator.normal(0, 30) for name in kind.pushed}
    rubbing = linkage.rubbing if kind.rubs else ()
    moments = {joint.name: generator.normal() for joint in rubbing}
    pose = Pose(linkage, [1.0] * len(linkage.dyads), crank, clearances, bends=bends)
    motion = Dynamics(pose, forces, torque, None, moments, along)
    vectors, rates = ([x for pair in clearances.values() for x in pair[i]] for i in (0, 1))
    angle = [math.atan2(crank.sine, crank.cosine)] * kind.is_free
    places, speeds = ([pair[i] for pair in bends.values()] for i in (0, 1))
    given = {
        "state": [*vectors, *angle, *places, *rates, *[crank.speed] * kind.is_free, *speeds],
        "crank": [crank.cosine, crank.sine, crank.speed, crank.acceleration or 0.0],
        "forces": [*(x for j in linkage.loose for x in in_memory(pose, j, forces[j.name])), torque],
        "along": [*along.values()],
        "moments": [*moments.values()],
    }
    return motion, forces, moments, along, given


def in_memory(pose, joint, force):
    """A force as machine code reads it: in a slide along and across it."""
    if joint.kind == "revolute":
        return force
    line = pose.line(joint)
    vector = force.fx, force.fy
    return dot(line, vector), dot(across(line), vector), force.on_body, 0.0


def relative(found, expected):
    """Largest difference over the largest value."""
    size = np.abs(expected).max(initial=1e-300)
    return np.abs(np.subtract(found, expected)).max(initial=0.0) / size


def turning_in(pose, joint):
    """Angular velocities of body and partner; in a slide of the frame its speed in place of the
    latter."""
    speeds = [pose.speeds[place.body] for place in (joint.body, joint.partner)]
    return speeds if joint.kind == "revolute" else [speeds[0], pose.slips[joint.name]]


def differences(linkage, kind, generator):
    """Largest relative differences of machine code and plain equations at random states: of rates,
    of reactions."""
    variant = variant_of(linkage, [1.0] * len(linkage.dyads), kind)
    memory = variant.memory(linkage)
    fields, worst = variant.fields(memory), np.zeros(2)
    for _ in range(3):
        motion, _, moments, _, given = drawn(linkage, kind, generator)
        pose = motion.pose
        for name, values in given.items():
            fields[name][:] = values
        variant.run("pose", memory)
        rubbing = [linkage.joints[name] for name in moments]
        joints = [*linkage.loose, *rubbing]
        turning = [x for joint in joints for x in turning_in(pose, joint)]
        assert fields["turning"] == pytest.approx(turning, rel=1e-12)
        pushed = [linkage.joints[name] for name in kind.pushed]
        sites = [x for joint in pushed for x in pose.travel(joint)]
        assert fields["sites"] == pytest.approx(sites, rel=1e-12)
        variant.run("dynamics", memory)
        expected = [x for joint in linkage.loose for x in motion.rates[joint.name]]
        expected += [motion.crank_acceleration] * kind.is_free
        expected += [*motion.bend_accelerations.values()]
        reactions = [x for joint in rubbing for x in motion.reactions[joint.name]]
        reactions += [motion.guide_force(joint) for joint in pushed if kind.rubs]
        apart = [
            relative(fields["rates"], expected),
            relative(fields["reactions"], reactions),
        ]
        worst = np.maximum(worst, apart)
    return worst


@pytest.mark.parametrize("is_free", [False, True])
@pytest.mark.parametrize("name", LINKAGES)
def test_machine_code_agrees_with_the_plain_equations(name, is_free):
    generator = np.random.default_rng(6)
    for names in sets_of_loose_joints(LINKAGES[name])[1::7]:
        linkage = loosened(LINKAGES[name], names)
        assert (differences(linkage, Kind(is_free), generator) < 1e-11).all()
    slide = loosened(with_turning_slider(), {"guide", "piston_pin"})
    assert (differences(slide, Kind(is_free), generator) < 1e-11).all()
    assert sampled_apart(slide, slide, Kind(is_free), generator) < 1e-11


@pytest.mark.parametrize("is_free", [False, True])
@pytest.mark.parametrize("name, pushed", PUSHED.items())
def test_forces_at_slides_and_pivots_and_friction_of_pins_agree_with_the_plain_equations(
    name, pushed, is_free
):
    """Also the reactions on which that friction depends."""
    generator, kind = np.random.default_rng(8), Kind(is_free, pushed, True)
    for names in sets_of_loose_joints(LINKAGES[name])[::5]:
        linkage = loosened(LINKAGES[name], names)
        assert (differences(linkage, kind, generator) < 1e-11).all()


@pytest.mark.parametrize("is_free", [False, True])
@pytest.mark.parametrize("loose", [(), ("crank_pin",), ("crank_pivot", "crank_pin", "piston_pin")])
def test_machine_code_of_a_bending_rod_agrees_with_the_plain_equations(loose, is_free):
    linkage, generator = bending_rod(loose), np.random.default_rng(9)
    for kind in (Kind(is_free), Kind(is_free, ("guide",), True)):
        assert (differences(linkage, kind, generator) < 1e-11).all()
        assert sampled_apart(linkage, linkage, kind, generator) < 1e-11


def bending_rod(loose, **values):
    """A slider-crank whose rod bends."""
    linkage = loosened(LINKAGES["slider_crank"], loose)
    linkage = with_values(linkage, rod={"bending": Bending(1500.0, 0.02)} | values)
    return replace(linkage, kinds=body_kinds(linkage))


def sampled_apart(first, linkage, kind, generator):
    """Largest difference of the quantities of a `linkage` by the machine code made for the `first`
    of its form from the plain ones, relative to the largest of the unit."""
    variant = build_variant(first, [1.0] * len(first.dyads), kind)
    memory = variant.memory(linkage)
    fields, worst = variant.fields(memory), 0.0
    for _ in range(3):
        motion, forces, moments, along, given = drawn(linkage, kind, generator)
        for name, values in given.items():
            fields[name][:] = values
        for name in ("pose", "dynamics", "sample"):
            variant.run(name, memory)
        expected = channels_of(motion, forces, moments, along)
        assert variant.channels == {name: unit for name, (_, unit) in expected.items()}
        for unit in {*variant.channels.values()}:
            own = [i for i, each in enumerate(variant.channels.values()) if each == unit]
            values = [value for value, each in expected.values() if each == unit]
            worst = max(worst, relative(fields["channels"][own], values))
    return worst


def rescaled(linkage, generator):
    """The linkage with other masses, inertias, mass centres and, by up to 1 %, lengths."""

    def near(vector, share):
        factor = 1.0 + share * generator.uniform(-1.0, 1.0)
        return tuple(None if each is None else factor * each for each in vector)

    bodies = {
        name: {
            "mass": body.mass * generator.uniform(0.5, 2.0),
            "inertia": body.inertia * generator.uniform(0.5, 2.0),
            "centre": near(body.centre, 0.5),
            "points": {point: near(place, 0.01) for point, place in body.points.items()},
        }
        for name, body in linkage.bodies.items()
    }
    other = with_values(linkage, **bodies)
    return replace(other, gravity=near(linkage.gravity, 0.5))


@pytest.mark.parametrize("is_free", [False, True])
@pytest.mark.parametrize("name", LINKAGES)
def test_sampled_quantities_agree_with_the_plain_ones_for_each_linkage_of_a_form(name, is_free):
    """Numbers of the linkage for which machine code was made do not remain in it."""
    generator = np.random.default_rng(10)
    kind = Kind(is_free, PUSHED.get(name, ()), name in PUSHED)
    for names in sets_of_loose_joints(LINKAGES[name])[::9]:
        linkage = loosened(LINKAGES[name], names)
        other = rescaled(linkage, generator)
        assert other.form == linkage.form
        assert sampled_apart(linkage, linkage, kind, generator) < 1e-11
        assert sampled_apart(linkage, other, kind, generator) < 1e-11


def test_sampled_quantities_of_another_bending_rod_agree_with_the_plain_ones():
    generator, first = np.random.default_rng(11), bending_rod(("crank_pin",))
    other = bending_rod(("crank_pin",), mass=1.1, inertia=4e-2, bending=Bending(900.0, 0.1))
    assert sampled_apart(first, other, Kind(), generator) < 1e-11


def test_without_machine_code_the_same_operations_run_in_python(monkeypatch):
    linkage = loosened(LINKAGES["quick_return_beside"], {"D", "O"})
    kind = Kind(True, ("guide", "track", "C"), True)
    machine = differences(linkage, kind, np.random.default_rng(7))
    monkeypatch.setitem(os.environ, "NUMBA_DISABLE_JIT", "1")
    python = differences(linkage, kind, np.random.default_rng(7))
    assert (python < 1e-11).all() and (machine < 1e-11).all()


@pytest.mark.parametrize(
    "body, values",
    [
        ("rod", {"points": {"A": (None, None), "B": (1.0, None)}}),  # a length of exactly 1 m
        ("rod", {"centre": (0.0, None)}),
        ("slider", {"mass": 1.0}),
        ("frame", {"points": {"O": (None, None), "guide": (None, 0.0)}}),  # an offset fitted to 0
    ],
)
def test_no_value_changes_the_code(body, values):
    linkage = loosened(LINKAGES["tilted_slide"], {"crank_pin", "piston_pin"})
    other = with_values(linkage, **{body: values})
    codes = [build_variant(each, (1.0,), Kind(True)) for each in (linkage, other)]
    assert codes[0].names == codes[1].names and codes[0].sizes == codes[1].sizes
    for name in ("pose", "dynamics", "sample"):
        one, two = (code.codes[name] for code in codes)
        assert one.graph.nodes == two.graph.nodes and one.stores == two.stores
    assert variant_of(linkage, (1.0,), Kind(True)) is variant_of(other, (1.0,), Kind(True))
    assert parameters_of(codes[0], other) == pytest.approx(
        parameters_of(codes[1], other), rel=1e-15
    )


def test_an_impossible_pose_gives_nan():
    linkage = loosened(LINKAGES["four_bar"], {"A"})
    linkage = with_values(linkage, rocker={"points": {"C": (None, None), "B": (0.05, None)}})
    variant = variant_of(linkage, (1.0,))
    memory = variant.memory(linkage)
    variant.fields(memory)["crank"][:] = [1.0, 0.0, 10.0, 0.0]
    for name in ("pose", "dynamics"):
        variant.run(name, memory)
    assert np.isnan(variant.fields(memory)["rates"]).all()


def test_form_of_the_file_takes_zeros_out_of_the_code():
    linkages = [
        loosened(LINKAGES[name], {"crank_pin", "piston_pin"})
        for name in ("slider_crank", "tilted_slide")
    ]
    short, general = (variant_of(linkage, (1.0,)) for linkage in linkages)
    assert short is not general
    count = [sum(len(c.graph.nodes) for c in each.codes.values()) for each in (short, general)]
    assert count[0] < count[1]
    crank = Crank(1.0, 0.0, 1.0)
    assert Pose(linkages[0], (1.0,), crank, {}).directions["slider"] == (1.0, 0.0)


def test_parameters_are_those_of_the_linkage_where_their_numbers_would_divide_by_zero():
    links = {
        "crank": {"length": 0.0225, "mass": 20.0, "inertia": 0.0214, "mass_centre": 0.0},
        "rod": {
            "length": 23769783.75304356,
            "mass": 0.42,
            "inertia": 0.00125,
            "mass_centre": 9507913.501217423,
        },
    }
    joints = {"crank_pin": "ideal", "piston_pin": "ideal"}
    content = links | {"slider": {"mass": 0.62}, "joints": joints}
    linkage = linkage_of_slider_crank(Mechanism.model_validate(content))
    variant = variant_of(linkage, (1.0,), Kind(is_free=True))
    found = dict(zip(variant.names, parameters_of(variant, linkage), strict=True))
    assert (found["rod.mass"], found["crank.inertia"]) == (0.42, 0.0214)
