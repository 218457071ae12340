"""Training of a network that knows the design: L-BFGS on the harmonics of simulated motions.

The squared error of the motion over a revolution is that of the coefficients of its harmonics (Parseval), but for what
lies beyond the highest one, which no weights change. So a step costs as much as the designs, not as designs times crank
angles. L-BFGS with a line search: Liu and Nocedal, Math. Program. 45 (1989) 503.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jointgap.core.errors import needs
from jointgap.design_networks.design_network import DesignNetwork, harmonics, sizes
from jointgap.design_networks.design_space import Design
from jointgap.design_networks.settings import NetworkSettings
from jointgap.design_networks.settled_motion import SettledMotion

with needs("training networks", "learn"):
    import torch


@dataclass(frozen=True)
class TrainedNetwork:
    """A network and how its training went."""

    network: DesignNetwork
    losses: np.ndarray  # What is minimised after each `steps_at_once` steps [clearances^2]
    steps: int  # Steps taken


def train(
    motion: SettledMotion,
    designs: Sequence[Design],
    vectors: np.ndarray,
    hidden: tuple[int, ...],
    seed: int,
    settings: NetworkSettings,
    steps: int,
    done: Callable[[], bool] = lambda: False,
) -> TrainedNetwork:
    """Train a network on one thread; bit for bit the same for the same seed and steps."""
    space, threads = motion.space, torch.get_num_threads()
    inputs = np.concatenate([space.inputs(each, np.array([each.lengths])) for each in designs])
    targets = _coefficients(motion, designs, vectors, settings.harmonics)
    torch.set_num_threads(1)  # a job has one core, and sums keep their order
    try:
        layers = [torch.tensor(layer, requires_grad=True) for layer in _first(motion, targets, hidden, seed, settings)]
        loss = _loss(motion, designs, torch.tensor(inputs), torch.tensor(targets), settings)
        losses, taken = [], 0
        optimizer = torch.optim.LBFGS(
            layers,
            max_iter=settings.steps_at_once,
            history_size=settings.history,
            line_search_fn="strong_wolfe",
            tolerance_grad=0.0,
            tolerance_change=0.0,
        )

        def closure() -> torch.Tensor:
            optimizer.zero_grad()
            value = loss(layers)
            value.backward()
            return value

        while taken < steps and not done():
            optimizer.step(closure)
            taken += settings.steps_at_once
            with torch.no_grad():
                losses.append(float(loss(layers)))
    finally:
        torch.set_num_threads(threads)
    trained = tuple(layer.detach().numpy() for layer in layers)
    return TrainedNetwork(DesignNetwork(space, trained), np.array(losses), taken)


def _coefficients(motion: SettledMotion, designs: Sequence[Design], vectors: np.ndarray, highest: int) -> np.ndarray:
    """Coefficients of the harmonics of motions, in clearances, (designs, outputs)."""
    waves = harmonics(motion.crank_angle, highest) / motion.points
    clearances = np.array([[each.mechanism.clearance(joint) for joint in motion.space.joints] for each in designs])
    shares = vectors / clearances[:, None, :, None]
    return np.einsum("dpjx,hp->djxh", shares, waves, optimize=True).reshape(len(designs), -1)


def _first(
    motion: SettledMotion, targets: np.ndarray, hidden: tuple[int, ...], seed: int, settings: NetworkSettings
) -> list[np.ndarray]:
    """First weights: even in the width that keeps a signal's size (Glorot and Bengio 2010), biases 0; those of the
    output layer small, and its biases the mean motion.
    """
    random, layers = np.random.default_rng(seed), []
    for neurons, columns in sizes(motion.space, hidden, settings.harmonics):
        width = np.sqrt(6.0 / (neurons + columns - 1))
        layer = np.zeros((neurons, columns))
        layer[:, :-1] = random.uniform(-width, width, (neurons, columns - 1))
        layers.append(layer)
    layers[-1][:, :-1] *= settings.first_outputs
    layers[-1][:, -1] = targets.mean(axis=0)
    return layers


def _loss(
    motion: SettledMotion,
    designs: Sequence[Design],
    inputs: "torch.Tensor",
    targets: "torch.Tensor",
    settings: NetworkSettings,
) -> Callable[[list], "torch.Tensor"]:
    """Mean over designs of the vectors' squared errors, each joint's in its clearances, and of the lift's, in the
    largest clearance.
    """
    joints = motion.space.joints
    clearances = np.array([[each.mechanism.clearance(joint) for joint in joints] for each in designs])
    # with unit vectors in y `lift` gives the signs
    signs = np.array(
        [motion.lift(np.eye(len(joints))[place][None, :, None] * [0.0, 1.0])[0] for place in range(len(joints))]
    )
    shares = torch.tensor(signs * clearances / clearances.max(axis=1, keepdims=True))

    def loss(layers: list) -> "torch.Tensor":
        values = inputs
        for layer in layers[:-1]:
            values = torch.tanh(values @ layer[:, :-1].T + layer[:, -1])
        values = values @ layers[-1][:, :-1].T + layers[-1][:, -1]
        missed = (values - targets).reshape(len(inputs), len(joints), 2, -1)
        lift = torch.einsum("djh,dj->dh", missed[:, :, 1], shares)
        return (missed**2).sum() / missed[..., 0].numel() + settings.lift_weight * (lift**2).sum() / len(inputs)

    return loss
