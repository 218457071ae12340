"""Training of the networks of the outputs."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd

from jointgap.config import Surrogate
from jointgap.core.errors import needs
from jointgap.networks.errors import NETWORK, REGULARISED, Grid, Points, error_frame, error_rows, refined
from jointgap.networks.levenberg_marquardt import NetworkModel, Settings, Status, minimise
from jointgap.networks.network import Layout, Network, Scaling, nguyen_widrow
from jointgap.paper.printed import TRAINING_MSE

with needs("training networks", "learn"):
    import torch

SNAPSHOTS = tuple(sorted({round(10 ** (n / 4)) for n in range(4, 25)}))
"""Iterations after which the error at the held-out samples is recorded: it tells what further training does there."""
SAMPLING = 20  # samples to choose from, as a multiple of the trajectory's
MISSED = 1e-6  # error of the interpolation, over the output's range, that asks for a sample more: far below a network's
GROUP = 3  # neighbouring samples, of which chance holds one out
WIDTH = 1.0  # of a neuron at the start, in distances to its neighbours
RIDGE = 1e-8  # relative, of the linear problem that gives the output weights to start from
ROUNDS = 5  # of training; before each the evidence sets the decay
EVIDENCE_PASSES = 5


@dataclass(frozen=True)
class TrainedNetwork:
    """A network of one output, with the course of its training."""

    model: str
    seed: int
    network: Network
    grid: Grid  # The paper's training points, whose range scales all errors, and the samples held out from this network
    training: Points  # What it learned from
    mse: np.ndarray  # shape (iterations + 1,); scaled, at the start and after every iteration
    kept: dict[int, np.ndarray]  # Parameters, shape (P,), after some numbers of iterations, the last one included
    stop: str  # Why training stopped
    iterations_to_paper: int | None = None

    def weights(self) -> pd.DataFrame:
        """Frame of the table fit."""
        return self.network.to_frame(self.seed, self.model)

    def history(self) -> pd.DataFrame:
        """Frame of the table fit_history."""
        held_out, iterations = self.grid.held_out, np.arange(len(self.mse))
        squares = {
            iteration: held_out.mean((self._values(iteration, held_out.crank_angle) - held_out.values) ** 2)
            for iteration in self.kept
        }
        frame = pd.DataFrame({"model": self.model, "seed": self.seed, "iteration": iterations, "mse": self.mse})
        missed = frame["iteration"].map(squares).astype(float)
        return frame.assign(held_out_mse=missed / self.network.output.range**2)

    def errors(self) -> pd.DataFrame:
        """Frame of the table fit_errors."""
        trained = {
            "model": self.model,
            "seed": self.seed,
            "weights": self.network.layout.size,
            "iterations": len(self.mse) - 1,
            "stop": self.stop,
            "iterations_to_paper": self.iterations_to_paper,
        }
        at_paper = None if self.iterations_to_paper is None else partial(self._values, self.iterations_to_paper)
        return error_frame(error_rows(self.grid, self.network.values, self.training, trained, at_paper))

    def _values(self, iteration: int, crank_angle: np.ndarray) -> np.ndarray:
        return replace(self.network, parameters=self.kept[iteration]).values(crank_angle)


def train(trajectory: pd.DataFrame, output: str, options: Surrogate) -> list[TrainedNetwork]:
    """Train the network of one output from every seed, the default one first."""
    torch.set_num_threads(1)  # the matrices are small, and several outputs train side by side
    grid = Grid.of(trajectory, output, options.training_points)
    layout = Layout(options.hidden)
    scale_in, scale_out = Scaling.of(grid.training.crank_angle), Scaling.of(grid.training.values)
    model = NetworkModel(layout, scale_in.shrink(grid.training.crank_angle))
    targets = scale_out.shrink(grid.training.values)
    networks = []
    default, *others = options.seeds
    for seeds, iterations in (((default,), options.iterations), (tuple(others), options.seed_iterations)):
        if not seeds:
            continue
        start = np.stack([nguyen_widrow(layout, seed) for seed in seeds])
        settings = Settings(iterations, milestone=TRAINING_MSE.get(output, 0.0), snapshots=SNAPSHOTS)
        for seed, result in zip(seeds, minimise(model, targets, start, settings), strict=True):
            network = Network(layout, result.parameters, scale_in, scale_out)
            kept = result.kept | {result.iterations: result.parameters}
            stop = result.status.sentence
            networks.append(
                TrainedNetwork(NETWORK, seed, network, grid, grid.training, result.errors, kept, stop, result.milestone)
            )
    return networks


def train_regularised(trajectory: pd.DataFrame, fine: pd.DataFrame, output: str, options: Surrogate) -> TrainedNetwork:
    """Train the regularised network of one output."""
    torch.set_num_threads(1)
    grid = Grid.of(trajectory, output, options.training_points)
    scale = Scaling.of(grid.training.values)
    training, held_out = _split(*_samples(trajectory, fine, output, MISSED * scale.range), options.seeds[0])
    model, start = _Decayed.of(training, scale, options.regularised_neurons)
    parameters, status = _trained(model, start, options.regularised_iterations)
    scale_in = Scaling.of(training.crank_angle)
    networks = [Network(model.network.layout, each, scale_in, scale) for each in parameters]
    mse = np.array([training.mean((net.values(training.crank_angle) - training.values) ** 2) for net in networks])
    return TrainedNetwork(
        REGULARISED,
        options.seeds[0],
        networks[-1],
        replace(grid, held_out=held_out),
        training,
        mse / scale.range**2,
        dict(enumerate(parameters)),
        status.sentence,
    )


def _samples(trajectory: pd.DataFrame, fine: pd.DataFrame, output: str, missed: float) -> tuple[np.ndarray, np.ndarray]:
    """Crank angles and values, (n,) each: the trajectory's first revolution, and what its samples would miss."""
    angle, values = fine["crank_angle"].to_numpy(), fine[output].to_numpy()
    step = int(np.round(np.diff(trajectory["crank_angle"].to_numpy()[:2])[0] / (angle[1] - angle[0])))
    usable = np.isfinite(values)
    first = np.arange(0, len(angle), step)
    kept = refined(angle, values[:, None] / missed, first[usable[first]], usable, 1.0)
    return angle[kept], values[kept]


def _split(angle: np.ndarray, values: np.ndarray, seed: int) -> tuple[Points, Points]:
    """Training points and samples held out: one of every three neighbours, drawn, but for the ends."""
    first = np.arange(1, len(angle) - GROUP, GROUP)
    held_out = np.zeros(len(angle), bool)
    held_out[first + np.random.default_rng(seed).integers(GROUP, size=len(first))] = True
    shares = np.gradient(angle)
    return tuple(Points(angle[part], values[part], 0, shares[part]) for part in (~held_out, held_out))


def _by_evidence(model: "_Decayed", at: np.ndarray, decay: float) -> float:
    """Weight of the decay, over that of the squared errors, at which the evidence is largest: a fixed point."""
    evaluation = replace(model, decay=0.0).evaluate(torch.from_numpy(at)[None])
    points = len(model.targets)
    jacobian, outputs = evaluation.jacobian()[0, :points].numpy(), evaluation.outputs[0, :points].numpy()
    curvatures = np.maximum(np.linalg.eigvalsh(jacobian.T @ jacobian), 0.0)
    misfit, moved = np.sum((model.targets - outputs) ** 2), np.sum((at - model.anchor) ** 2)
    for _ in range(EVIDENCE_PASSES):
        determined = np.sum(curvatures / (curvatures + decay))
        decay = determined * misfit / (max(points - determined, 1.0) * moved)
    return float(decay)


def _trained(model: "_Decayed", at: np.ndarray, iterations: int) -> tuple[list[np.ndarray], Status]:
    """The network's parameters after every iteration, and why the last round stopped."""
    path = []
    for count in np.diff(np.linspace(0, iterations, min(ROUNDS, iterations) + 1).astype(int)):
        model = replace(model, decay=_by_evidence(model, at, model.decay))
        targets = np.concatenate([model.targets, model.decay**0.5 * model.anchor])
        settings = Settings(int(count), minimum_gradient=0.0, snapshots=tuple(range(count + 1)))
        (result,) = minimise(model, targets, at, settings)
        path += [at, *(result.kept[n] for n in range(1, result.iterations))]
        at = result.parameters
    return [model.of_network(torch.from_numpy(parameters)).numpy() for parameters in [*path, at]], result.status


@dataclass(frozen=True)
class _Decayed:
    """Errors at the samples, each by the root of its share, above what the parameters have moved by.

    A model of one network for `jointgap.networks.levenberg_marquardt.minimise`. What is trained are the slope and the
    sum of each neuron in units of its own width at its own place, and the output weights: all of them of order one, and
    hardly coupled, where weights and biases on the input's scale are neither.
    """

    network: NetworkModel
    centres: torch.Tensor  # shape (H,); where the neurons start, on the input's scale
    widths: torch.Tensor
    anchor: np.ndarray  # shape (P,); the decay pulls the parameters here
    roots: torch.Tensor  # shape (N,); of the samples' shares
    targets: np.ndarray  # shape (N,); times the roots
    decay: float = RIDGE

    @classmethod
    def of(cls, training: Points, scale: Scaling, neurons: int) -> tuple["_Decayed", np.ndarray]:
        """The model and its parameters to start from: neurons half by the crank angle, half by how much the output
        changes; output weights by least squares.
        """
        x, t = Scaling.of(training.crank_angle).shrink(training.crank_angle), scale.shrink(training.values)
        roots = np.sqrt(training.shares / training.shares.mean())
        change = np.abs(np.diff(t))
        along = np.concatenate([[0.0], np.cumsum(np.diff(x) + change / change.sum())])
        centres = np.interp(np.linspace(0.0, along[-1], neurons + 2)[1:-1], along, x)
        widths = WIDTH * np.gradient(centres)
        layer = np.column_stack([np.tanh((x[:, None] - centres) / widths), np.ones_like(x)]) * roots[:, None]
        normal = layer.T @ layer
        normal[np.diag_indices(neurons + 1)] += RIDGE * np.trace(normal) / (neurons + 1)
        anchor = np.concatenate([np.tile([1.0, 0.0], neurons), np.zeros(neurons + 1)])
        start = anchor.copy()
        start[2 * neurons :] = np.linalg.solve(normal, layer.T @ (roots * t))
        tensors = (torch.from_numpy(values) for values in (centres, widths))
        return cls(NetworkModel(Layout((neurons,)), x), *tensors, anchor, torch.from_numpy(roots), roots * t), start

    @property
    def points(self) -> int:
        return self.network.points + self.size

    @property
    def size(self) -> int:
        return self.network.size

    @property
    def _slopes_and_sums(self) -> tuple[slice, slice]:
        return tuple(slice(first, 2 * len(self.centres), 2) for first in (0, 1))

    def of_network(self, parameters: torch.Tensor) -> torch.Tensor:
        """The network's weights and biases, (..., P), of what is trained (..., P)."""
        slopes, sums = self._slopes_and_sums
        weights = parameters.clone()
        weights[..., slopes] /= self.widths
        weights[..., sums] -= self.centres * weights[..., slopes]
        return weights

    def derivatives(self, by_network: torch.Tensor) -> torch.Tensor:
        """Derivatives by what is trained, of derivatives (..., P) by the network's weights and biases."""
        slopes, sums = self._slopes_and_sums
        result = by_network.clone()
        result[..., slopes] = (by_network[..., slopes] - self.centres * by_network[..., sums]) / self.widths
        return result

    def evaluate(self, parameters: torch.Tensor) -> "_DecayedEvaluation":
        return _DecayedEvaluation(self, parameters)


class _DecayedEvaluation:
    """As `jointgap.networks.levenberg_marquardt.Evaluation` says, for the only member of a batch."""

    def __init__(self, decayed: _Decayed, parameters: torch.Tensor):
        self._of, self._root = decayed, decayed.decay**0.5
        self._network = decayed.network.evaluate(decayed.of_network(parameters))
        self.outputs = torch.cat([self._network.outputs * decayed.roots, self._root * parameters], dim=1)

    def select(self, members: object) -> "_DecayedEvaluation":
        return self

    def replaced(self, other: "_DecayedEvaluation", members: object) -> "_DecayedEvaluation":
        return other

    def pull_back(self, weights: torch.Tensor) -> torch.Tensor:
        errors, moves = weights.split([self._of.network.points, self._of.size], dim=1)
        return self._of.derivatives(self._network.pull_back(errors * self._of.roots)) + self._root * moves

    def jacobian(self) -> torch.Tensor:
        errors = self._of.derivatives(self._network.jacobian() * self._of.roots[:, None])
        moves = self._root * torch.eye(self._of.size, dtype=torch.float64)[None]
        return torch.cat([errors, moves], dim=1)

    def products_of_rows(self, member: int, out: np.ndarray, work: object) -> None:
        jacobian = self.jacobian()[member].numpy()
        out[...] = jacobian @ jacobian.T

    def along(self, step: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        first, second = self._network.along(self._of.of_network(step))
        return (
            torch.cat([first * self._of.roots, self._root * step], dim=1),
            torch.cat([second * self._of.roots, torch.zeros_like(step)], dim=1),
        )
