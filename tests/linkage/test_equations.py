"""The equations of motion agree with an independent formulation in absolute coordinates."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from jointgap.linkage.equations import Crank, Dynamics, JointForce, Pose
from jointgap.linkage.joint_forces import balance
from jointgap.linkage.topology import linkage_of
from tests.linkage.absolute import absolute_of
from tests.linkage.cases import LINKAGES, loosened, slider_crank


def sets_of_loose_joints(linkage):
    """All sets; slides are loose only on the frame."""
    names = [j.name for j in linkage.joints.values() if j.kind == "revolute"]
    chosen = [set(s) for n in range(len(names) + 1) for s in itertools.combinations(names, n)]
    return chosen[:: max(len(chosen) // 40, 1)]


def state(linkage, generator, is_free):
    """A random state near the ideal one."""
    angle, speed = generator.uniform(0, 2 * math.pi), generator.uniform(5, 60)
    acceleration = None if is_free else generator.normal(0, 100)
    crank = Crank(math.cos(angle), math.sin(angle), speed, acceleration)
    clearances = {
        joint.name: (tuple(generator.normal(0, 1e-3, 2)), tuple(generator.normal(0, 0.5, 2)))
        for joint in linkage.loose
    }
    return crank, clearances


def compared(linkage, crank, clearances, generator):
    """Largest differences to the independent formulation: of rates (relative), of closure [m]."""
    pose = Pose(linkage, [1.0] * len(linkage.dyads), crank, clearances)
    forces = {
        joint.name: JointForce(*generator.normal(0, 100, 2), *generator.normal(0, 1, 2))
        for joint in linkage.loose
    }
    turning = [name for name in linkage.moving if linkage.kinds[name] != "sliding"]
    loads = {name: (tuple(generator.normal(0, 20, 2)), 0.0) for name in linkage.moving}
    loads |= {name: (loads[name][0], generator.normal(0, 2)) for name in turning}
    ideal = [j for j in linkage.joints.values() if j.kind == "revolute" and not j.loose]
    moments = {joint.name: generator.normal(0, 1) for joint in ideal}
    torque = generator.normal(0, 5)
    motion = Dynamics(pose, forces, torque, loads, moments)
    expected, turn, closed = absolute_of(pose).rates(
        crank.acceleration, torque, forces, loads, moments
    )
    size = max([np.abs(each).max() for each in expected.values()] + [abs(turn)])
    apart = [np.abs(np.subtract(motion.rates[name], expected[name])).max() for name in expected]
    return max([*apart, abs(motion.crank_acceleration - turn)]) / size, closed


@pytest.mark.parametrize("is_free", [False, True])
@pytest.mark.parametrize("name", LINKAGES)
def test_accelerations_agree_with_multipliers_for_every_set_of_loose_joints(name, is_free):
    generator = np.random.default_rng(3)
    for names in sets_of_loose_joints(LINKAGES[name]):
        linkage = loosened(LINKAGES[name], names)
        for _ in range(3):
            crank, clearances = state(linkage, generator, is_free)
            apart, closed = compared(linkage, crank, clearances, generator)
            assert apart < 1e-10 and closed < 1e-14, (names, apart, closed)


def test_a_loose_slide_has_its_offset_and_tilt():
    generator = np.random.default_rng(4)
    for names in ({"guide"}, {"guide", "piston_pin"}, {"guide", "crank_pin", "crank_pivot"}):
        linkage = loosened(with_turning_slider(), names)
        for _ in range(5):
            crank, clearances = state(linkage, generator, is_free=False)
            apart, closed = compared(linkage, crank, clearances, generator)
            assert apart < 1e-10 and closed < 1e-14


def with_turning_slider():
    """A slider-crank whose slider has an inertia and a pin off its line."""
    plain = slider_crank(direction=0.3, offset=0.02)
    slider = replace(
        plain.bodies["slider"],
        inertia=2e-4,
        centre=(0.01, 0.002),
        points={"B": (0.004, 0.003), "guide": (0.0, 0.0)},
    )
    bodies = [*(plain.bodies | {"slider": slider}).values()]
    return linkage_of(bodies, [*plain.joints.values()], plain.drive, plain.gravity)


@pytest.mark.parametrize(
    "name, body", [("slider_crank", "slider"), ("tilted_slide", "slider"), ("quick_return", "ram")]
)
def test_a_force_along_a_slide_is_a_load_and_the_force_across_it_balances_the_body(name, body):
    generator = np.random.default_rng(12)
    for names in sets_of_loose_joints(LINKAGES[name])[::3]:
        linkage = loosened(LINKAGES[name], names)
        crank, clearances = state(linkage, generator, is_free=True)
        pose = Pose(linkage, [1.0] * len(linkage.dyads), crank, clearances)
        slide = linkage.joint_with_frame(body)
        forces = {j.name: JointForce(*generator.normal(0, 100, 2)) for j in linkage.loose}
        size, (x, y) = generator.normal(0, 50), pose.line(slide)
        pushed = Dynamics(pose, forces, 3.0, along={slide.name: size})
        loaded = Dynamics(pose, forces, 3.0, {body: ((size * x, size * y), 0.0)})
        assert pushed.accelerations == pytest.approx(loaded.accelerations, rel=1e-12)
        for one in (pushed, loaded):
            across = np.dot((-y, x), balance(one, forces).forces[slide.name])
            assert one.guide_force(slide) == pytest.approx(across, rel=1e-10)


@pytest.mark.parametrize(
    "name, track",
    [("quick_return", "track"), ("quick_return_beside", "track")] + [("carried_slide", "rail")],
)
def test_a_force_along_a_moving_track_is_a_load_on_its_body_and_the_opposite_on_its_carrier(
    name, track
):
    generator = np.random.default_rng(13)
    for names in sets_of_loose_joints(LINKAGES[name])[::5]:
        linkage = loosened(LINKAGES[name], names)
        crank, clearances = state(linkage, generator, is_free=True)
        pose = Pose(linkage, [1.0] * len(linkage.dyads), crank, clearances)
        joint, size = linkage.joints[track], generator.normal(0, 50)
        forces = {j.name: JointForce(*generator.normal(0, 100, 2)) for j in linkage.loose}
        force = size * np.array(pose.turned(joint.partner.body, pose.line(joint)))
        place = np.array(pose.point(*joint.body)[0])
        loads = {}
        for body, sign in ((joint.body.body, 1.0), (joint.partner.body, -1.0)):
            arm = place - pose.point(body, None)[0]
            moment = sign * (arm[0] * force[1] - arm[1] * force[0])
            loads[body] = tuple(sign * force), moment
        pushed = Dynamics(pose, forces, 3.0, along={track: size})
        loaded = Dynamics(pose, forces, 3.0, loads)
        assert pushed.accelerations == pytest.approx(loaded.accelerations, rel=1e-9)
        for reaction in pushed.reactions:
            found, expected = pushed.reactions[reaction], loaded.reactions[reaction]
            assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    "name, pivot", [("four_bar", "C"), ("six_bar", "E"), ("quick_return", "C")]
)
def test_a_torque_at_a_pivot_is_a_moment_on_its_body(name, pivot):
    generator = np.random.default_rng(14)
    for names in sets_of_loose_joints(LINKAGES[name])[::5]:
        linkage = loosened(LINKAGES[name], names)
        crank, clearances = state(linkage, generator, is_free=True)
        pose = Pose(linkage, [1.0] * len(linkage.dyads), crank, clearances)
        forces = {j.name: JointForce(*generator.normal(0, 100, 2)) for j in linkage.loose}
        body, size = linkage.joints[pivot].other("frame").body, generator.normal(0, 5)
        pushed = Dynamics(pose, forces, 3.0, along={pivot: size})
        loaded = Dynamics(pose, forces, 3.0, {body: ((0.0, 0.0), size)})
        assert pushed.accelerations == pytest.approx(loaded.accelerations, rel=1e-12)


@pytest.mark.parametrize("name", LINKAGES)
def test_velocities_are_the_rates_of_positions(name):
    generator = np.random.default_rng(5)
    linkage = loosened(LINKAGES[name], {next(iter(LINKAGES[name].joints))})
    crank, clearances = state(linkage, generator, is_free=False)
    step, signs = 1e-6, [1.0] * len(linkage.dyads)

    def at(time):
        angle = math.atan2(crank.sine, crank.cosine) + crank.speed * time
        moved = {
            joint: (tuple(np.add(vector, np.multiply(time, rate))), rate)
            for joint, (vector, rate) in clearances.items()
        }
        return Pose(linkage, signs, Crank(math.cos(angle), math.sin(angle), crank.speed), moved)

    before, here, after = (at(time) for time in (-step, 0.0, step))
    for body in linkage.moving:
        places = [pose.point(body, None)[0] for pose in (before, after)]
        rate = np.subtract(places[1], places[0]) / (2 * step)
        assert here.point(body, None)[1] == pytest.approx(rate, abs=1e-5)
        (c0, s0), (c1, s1) = (pose.directions[body] for pose in (before, after))
        turn = math.atan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1) / (2 * step)
        assert here.speeds[body] == pytest.approx(turn, abs=1e-5)
