"""Machine code agrees with the plain equations, and its form depends on no value."""

import math
import os

import numpy as np
import pytest

from jointgap.linkage.compiled import build_variant, parameters_of, variant_of
from jointgap.linkage.equations import Crank, Dynamics, JointForce, Pose
from tests.linkage.cases import LINKAGES, loosened, with_values
from tests.linkage.test_equations import sets_of_loose_joints, state, with_turning_slider


def differences(linkage, is_free, generator, loaded=()):
    """Largest relative difference of machine code and plain equations at random states."""
    variant = variant_of(linkage, [1.0] * len(linkage.dyads), is_free, loaded)
    memory = variant.memory(linkage)
    fields, worst = variant.fields(memory), 0.0
    for _ in range(3):
        crank, clearances = state(linkage, generator, is_free)
        forces = {
            joint.name: JointForce(*generator.normal(0, 100, 2), *generator.normal(0, 1, 2))
            for joint in linkage.loose
        }
        loads = {body: (tuple(generator.normal(0, 9, 2)), generator.normal()) for body in loaded}
        torque = generator.normal(0, 5)
        pose = Pose(linkage, variant.signs, crank, clearances)
        motion = Dynamics(pose, forces, torque, loads)
        vectors, rates = ([x for pair in clearances.values() for x in pair[i]] for i in (0, 1))
        angle = [math.atan2(crank.sine, crank.cosine)] * is_free
        fields["state"][:] = [*vectors, *angle, *rates, *[crank.speed] * is_free]
        fields["crank"][:] = [crank.cosine, crank.sine, crank.speed, crank.acceleration or 0.0]
        fields["forces"][:] = [*(x for force in forces.values() for x in force), torque]
        fields["loads"][:] = [x for (fx, fy), moment in loads.values() for x in (fx, fy, moment)]
        variant.run("pose", memory)
        for n, joint in enumerate(linkage.loose):
            turning = [pose.speeds[place.body] for place in (joint.body, joint.partner)]
            assert fields["turning"][2 * n : 2 * n + 2] == pytest.approx(turning, rel=1e-12)
        variant.run("dynamics", memory)
        expected = [x for joint in linkage.loose for x in motion.rates[joint.name]]
        expected += [motion.crank_acceleration] * is_free
        size = np.abs(expected).max(initial=1e-300)
        worst = max(worst, np.abs(np.subtract(fields["rates"], expected)).max(initial=0.0) / size)
    return worst


@pytest.mark.parametrize("is_free", [False, True])
@pytest.mark.parametrize("name", LINKAGES)
def test_machine_code_agrees_with_the_plain_equations(name, is_free):
    generator = np.random.default_rng(6)
    for names in sets_of_loose_joints(LINKAGES[name])[1::7]:
        linkage = loosened(LINKAGES[name], names)
        assert differences(linkage, is_free, generator, loaded=linkage.moving) < 1e-11
    slide = loosened(with_turning_slider(), {"guide", "piston_pin"})
    assert differences(slide, is_free, generator) < 1e-11


def test_without_machine_code_the_same_operations_run_in_python(monkeypatch):
    linkage = loosened(LINKAGES["quick_return_beside"], {"D", "O"})
    machine = differences(linkage, True, np.random.default_rng(7))
    monkeypatch.setitem(os.environ, "NUMBA_DISABLE_JIT", "1")
    assert differences(linkage, True, np.random.default_rng(7)) < 1e-11 > machine


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
    codes = [build_variant(each, (1.0,), True) for each in (linkage, other)]
    assert codes[0].names == codes[1].names and codes[0].sizes == codes[1].sizes
    for name in ("pose", "dynamics"):
        one, two = (code.codes[name] for code in codes)
        assert one.graph.nodes == two.graph.nodes and one.stores == two.stores
    assert variant_of(linkage, (1.0,), True) is variant_of(other, (1.0,), True)
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
