"""A network that knows the design: what it computes, how it learns, and how it is stored."""

import numpy as np
import pytest

from jointgap.design_networks.design_network import DesignNetwork, harmonics, sizes
from jointgap.design_networks.design_space import design_space
from jointgap.design_networks.settings import NetworkSettings
from jointgap.design_networks.settled_motion import SettledMotion
from jointgap.design_networks.train_network import train
from jointgap.dynamics.simulate import simulate
from tests.design_networks.spaces import MADE, scenario
from tests.dynamics.cases import ALL, mechanism

POINTS = 72
SMALL = NetworkSettings(points=POINTS, harmonics=3)


@pytest.fixture(scope="module")
def motion():
    return SettledMotion(design_space(scenario()), POINTS)


def made_up(motion, designs):
    """Motions that a network can know exactly: circles whose size is a linear function of the inputs."""
    angle, found = motion.crank_angle, []
    for design in designs:
        inputs = motion.space.inputs(design, np.array([design.lengths]))[0]
        clearances = [design.mechanism.clearance(joint) for joint in motion.space.joints]
        size = 0.5 + 0.2 * inputs[0] - 0.1 * inputs[-1]
        circle = np.stack([np.cos(angle), np.sin(2 * angle)], axis=-1)
        found.append(np.stack([size * clearance * circle for clearance in clearances], axis=1))
    return np.array(found)


@pytest.mark.parametrize("made", [MADE, mechanism(loose=ALL, friction=0.1, offset=0.02)], ids=["pins", "all loose"])
def test_a_simulated_motion_converts_exactly_to_the_transmission_angle_and_its_error(made):
    motion = SettledMotion(design_space(scenario(made=made)), POINTS)
    design = next(motion.space.fresh(1, [3]))
    (vectors,) = motion.simulated([design])
    alone = simulate(design.mechanism, design.simulate).samples.iloc[360:-1:5]
    angle = motion.angle(design, np.array([design.lengths]), motion.lift(vectors))[0]
    np.testing.assert_allclose(alone["crank_angle"], motion.crank_angle, rtol=1e-12)
    np.testing.assert_allclose(angle, alone["transmission_angle"], atol=1e-9)
    crank, rod = motion.space.original
    offset = made.slider.offset
    designed = np.pi / 2 + np.arcsin((offset - crank * np.sin(motion.crank_angle)) / rod)
    error = np.sqrt(np.mean((designed - alone["transmission_angle"]) ** 2))
    assert motion.error(design, np.array([design.lengths]), motion.lift(vectors))[0] == pytest.approx(error, rel=1e-6)


def test_the_original_lengths_without_clearance_have_no_error(motion):
    design = next(motion.space.fresh(1, [3]))
    assert motion.error(design, np.array([motion.space.original]), np.zeros(POINTS)) == 0.0


def test_harmonics_are_orthonormal_over_a_revolution():
    angle = 0.3 + np.arange(16) * 2 * np.pi / 16
    waves = harmonics(angle, 7)
    np.testing.assert_allclose(waves @ waves.T / 16, np.eye(15), atol=1e-12)


def test_a_network_whose_output_is_one_harmonic_moves_on_a_circle_in_clearances(motion):
    shapes = sizes(motion.space, (4,), 2)
    layers = [np.zeros(shape) for shape in shapes]
    joints, amplitude = len(motion.space.joints), 0.9 / np.sqrt(2.0)
    biases = np.zeros((joints, 2, 5))
    biases[:, 0, 1] = biases[:, 1, 2] = amplitude  # x: cos, y: sin
    layers[-1][:, -1] = biases.ravel()
    design = next(motion.space.fresh(1, [1]))
    vectors = DesignNetwork(motion.space, tuple(layers)).vectors(
        design, np.array([design.lengths, (0.15, 0.564)]), motion.crank_angle
    )
    assert vectors.shape == (2, POINTS, joints, 2)
    for place, joint in enumerate(motion.space.joints):
        expected = 0.9 * design.mechanism.clearance(joint)
        np.testing.assert_allclose(np.hypot(*vectors[0, :, place].T), expected, rtol=1e-12)
        np.testing.assert_allclose(vectors[1, :, place, 1], expected * np.sin(motion.crank_angle), atol=1e-12)


def test_training_learns_a_motion_that_a_network_can_know(motion):
    designs = list(motion.space.drawn(48, 0))
    trained = train(motion, designs, made_up(motion, designs), (8,), 0, SMALL, 150)
    fresh = list(motion.space.fresh(8, [0, 1]))
    vectors = trained.network.at_angles(motion.crank_angle)
    found = np.concatenate([vectors(each, np.array([each.lengths])) for each in fresh])
    np.testing.assert_allclose(found, made_up(motion, fresh), atol=2e-5)  # of clearances of 4e-4 m and more
    assert np.all(np.diff(trained.losses) <= 0.0)


def test_the_same_seed_gives_the_same_weights_and_another_one_others(motion):
    designs = list(motion.space.drawn(16, 0))
    vectors = made_up(motion, designs)
    first, again, other = (train(motion, designs, vectors, (5, 5), seed, SMALL, 20).network for seed in (1, 1, 2))
    assert all(np.array_equal(a, b) for a, b in zip(first.layers, again.layers, strict=True))
    assert not np.array_equal(first.layers[0], other.layers[0])


def test_training_stops_when_it_is_told_to(motion):
    designs = list(motion.space.drawn(16, 0))
    answers = iter([False, False, True])
    trained = train(motion, designs, made_up(motion, designs), (5,), 0, SMALL, 1000, lambda: next(answers))
    assert trained.steps == 2 * SMALL.steps_at_once == SMALL.steps_at_once * len(trained.losses)


def test_a_network_comes_back_from_its_table_and_not_into_another_space(motion):
    designs = list(motion.space.drawn(16, 0))
    network = train(motion, designs, made_up(motion, designs), (5,), 0, SMALL, 10).network
    frame = network.to_frame()
    again = DesignNetwork.from_frame(motion.space, frame)
    assert all(np.array_equal(a, b) for a, b in zip(network.layers, again.layers, strict=True))
    assert again.highest == 3
    with pytest.raises(ValueError, match="missing"):
        DesignNetwork.from_frame(motion.space, frame.iloc[:-1])
    other = design_space(scenario({"friction": {"from": 0.05, "to": 0.2}}))
    with pytest.raises(ValueError, match="other designs"):
        DesignNetwork.from_frame(other, frame)


def test_designs_fill_the_box_and_the_ranges_and_inputs_are_shares_of_them(motion):
    designs = list(motion.space.drawn(64, 0))
    inputs = np.concatenate([motion.space.inputs(each, np.array([each.lengths])) for each in designs])
    assert inputs.shape == (64, 4)
    np.testing.assert_allclose(np.sort(inputs, axis=0), np.linspace(-1, 1, 64)[:, None] * np.ones(4), atol=0.05)
    moved = designs[0].at((0.15, 0.564))
    assert moved.mechanism.crank.length == 0.15
    assert moved.values == designs[0].values
