"""Training of the regularised network of one output: a recipe whose errors hold between its training points.

It departs from the paper's in four things. The samples are as dense as the contact needs: those of the trajectory, and
where interpolation between them would miss something, as in impacts, those of a finer one. A third of them is held out
and takes no part in the training. There is one wide layer, whose neurons start where the output changes. And a decay
draws the weights to where they started; the evidence sets its strength (MacKay, Bayesian interpolation, 1992) by how
many weights the data determine.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from jointgap.config import Surrogate
from jointgap.errors import needs
from jointgap.surrogate.fit_errors import REGULARISED, Grid, Points, Trained, error_frame, error_rows
from jointgap.surrogate.levenberg_marquardt import Settings, Status, minimise
from jointgap.surrogate.network import Layout, Network, Scaling
from jointgap.surrogate.network_batch import NetworkModel
from jointgap.surrogate.training_samples import refined

with needs("training networks", "learn"):
    import torch

SAMPLING = 20  # samples to choose from, as a multiple of the trajectory's
MISSED = 1e-6  # error of the interpolation, over the output's range, that asks for a sample more: far below a network's
GROUP = 3  # neighbouring samples, of which chance holds one out
WIDTH = 1.0  # of a neuron at the start, in distances to its neighbours
RIDGE = 1e-8  # relative, of the linear problem that gives the output weights to start from
ROUNDS = 5  # of training; before each the evidence sets the decay
EVIDENCE_PASSES = 5


@dataclass(frozen=True)
class RegularisedFit:
    """The regularised network of one output."""

    seed: int  # The default one; it decides which samples are held out
    network: Network
    grid: Grid  # The paper's training points, whose range scales all errors, and the samples held out from this network
    training: Points
    parameters: list[np.ndarray]  # shape (P,); of the network, at the start and after every iteration
    stop: str  # Why training stopped

    def weights(self) -> pd.DataFrame:
        """Frame of the table fit."""
        return self.network.to_frame(self.seed, REGULARISED)

    def history(self) -> pd.DataFrame:
        """Frame of the table fit_history."""
        networks = [replace(self.network, parameters=parameters) for parameters in self.parameters]
        mse, held_out = (
            [points.mean((net.values(points.crank_angle) - points.values) ** 2) for net in networks]
            for points in (self.training, self.grid.held_out)
        )
        frame = pd.DataFrame({"iteration": np.arange(len(networks)), "mse": mse, "held_out_mse": held_out})
        frame[["mse", "held_out_mse"]] /= self.network.output.range**2
        return frame.assign(model=REGULARISED, seed=self.seed)

    def errors(self) -> pd.DataFrame:
        """Frame of the table fit_errors."""
        trained = Trained(REGULARISED, self.seed, self.network.layout.size, len(self.parameters) - 1, self.stop)
        return error_frame(error_rows(self.grid, self.network.values, trained, self.training))


def train_regularised(trajectory: pd.DataFrame, fine: pd.DataFrame, output: str, options: Surrogate) -> RegularisedFit:
    """Train the regularised network of one output."""
    torch.set_num_threads(1)
    grid = Grid.of(trajectory, output, options.training_points)
    scale = Scaling.of(grid.training.values)
    training, held_out = _split(*_samples(trajectory, fine, output, MISSED * scale.range), options.seeds[0])
    start = _Start.of(training, scale, options.regularised_neurons)
    parameters, status = _trained(start, training, options.regularised_iterations)
    network = Network(start.layout, parameters[-1], start.input, scale)
    return RegularisedFit(
        options.seeds[0], network, replace(grid, held_out=held_out), training, parameters, status.sentence
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


@dataclass(frozen=True)
class _Start:
    """Where the neurons start.

    What is trained are the slope and the sum of each neuron in units of its own width at its own place, and the output
    weights: all of them of order one, and hardly coupled, where weights and biases on the input's scale are neither.
    """

    layout: Layout
    input: Scaling
    centres: np.ndarray
    widths: np.ndarray
    parameters: np.ndarray
    anchor: np.ndarray
    inputs: np.ndarray
    targets: np.ndarray
    roots: np.ndarray

    @classmethod
    def of(cls, training: Points, scale: Scaling, neurons: int) -> "_Start":
        """Neurons half by the crank angle, half by how much the output changes; output weights by least squares."""
        scale_in = Scaling.of(training.crank_angle)
        x, t = scale_in.shrink(training.crank_angle), scale.shrink(training.values)
        roots = np.sqrt(training.shares / training.shares.mean())
        change = np.abs(np.diff(t))
        along = np.concatenate([[0.0], np.cumsum(np.diff(x) + change / change.sum())])
        centres = np.interp(np.linspace(0.0, along[-1], neurons + 2)[1:-1], along, x)
        widths = WIDTH * np.gradient(centres)
        layer = np.column_stack([np.tanh((x[:, None] - centres) / widths), np.ones_like(x)]) * roots[:, None]
        normal = layer.T @ layer
        normal[np.diag_indices(neurons + 1)] += RIDGE * np.trace(normal) / (neurons + 1)
        anchor = np.concatenate([np.tile([1.0, 0.0], neurons), np.zeros(neurons + 1)])
        parameters = anchor.copy()
        parameters[2 * neurons :] = np.linalg.solve(normal, layer.T @ (roots * t))
        return cls(Layout((neurons,)), scale_in, centres, widths, parameters, anchor, x, t, roots)


def _trained(start: _Start, training: Points, iterations: int) -> tuple[list[np.ndarray], Status]:
    """The network's parameters after every iteration, and why the last round stopped."""
    model = NetworkModel(start.layout, start.inputs)
    at, decay, path = start.parameters, RIDGE, []
    for count in np.diff(np.linspace(0, iterations, min(ROUNDS, iterations) + 1).astype(int)):
        decay = _by_evidence(_Decayed(model, start, 0.0), at, start, decay)
        decayed = _Decayed(model, start, decay)
        targets = np.concatenate([start.roots * start.targets, decay**0.5 * start.anchor])
        settings = Settings(int(count), minimum_gradient=0.0, snapshots=tuple(range(count + 1)))
        (result,) = minimise(decayed, targets, at, settings)
        path += [at, *(result.kept[n] for n in range(1, result.iterations))]
        at = result.parameters
    return [decayed.of_network(torch.from_numpy(p)).numpy() for p in [*path, at]], result.status


def _by_evidence(model: "_Decayed", at: np.ndarray, start: _Start, decay: float) -> float:
    """Weight of the decay, over that of the squared errors, at which the evidence is largest: a fixed point."""
    evaluation = model.evaluate(torch.from_numpy(at)[None])
    points = len(start.inputs)
    jacobian, outputs = evaluation.jacobian()[0, :points].numpy(), evaluation.outputs[0, :points].numpy()
    curvatures = np.maximum(np.linalg.eigvalsh(jacobian.T @ jacobian), 0.0)
    misfit, moved = np.sum((start.roots * start.targets - outputs) ** 2), np.sum((at - start.anchor) ** 2)
    for _ in range(EVIDENCE_PASSES):
        determined = np.sum(curvatures / (curvatures + decay))
        decay = determined * misfit / (max(points - determined, 1.0) * moved)
    return float(decay)


class _Decayed:
    """Errors at the samples, each by the root of its share, above what the parameters have moved by.

    A model of one network for `jointgap.surrogate.levenberg_marquardt.minimise`.
    """

    def __init__(self, model: NetworkModel, start: _Start, decay: float):
        self.model = model
        self.roots = torch.from_numpy(start.roots)
        self.root = decay**0.5
        self._centres, self._widths = torch.from_numpy(start.centres), torch.from_numpy(start.widths)
        self._slopes, self._sums = (slice(first, 2 * len(start.centres), 2) for first in (0, 1))

    @property
    def points(self) -> int:
        return self.model.points + self.model.size

    @property
    def size(self) -> int:
        return self.model.size

    def of_network(self, parameters: torch.Tensor) -> torch.Tensor:
        """The network's weights and biases, (..., P), of what is trained (..., P)."""
        weights = parameters.clone()
        weights[..., self._slopes] /= self._widths
        weights[..., self._sums] -= self._centres * weights[..., self._slopes]
        return weights

    def derivatives(self, by_network: torch.Tensor) -> torch.Tensor:
        """Derivatives by what is trained, of derivatives (..., P) by the network's weights and biases."""
        result = by_network.clone()
        slopes = by_network[..., self._slopes] - self._centres * by_network[..., self._sums]
        result[..., self._slopes] = slopes / self._widths
        return result

    def evaluate(self, parameters: torch.Tensor) -> "_DecayedEvaluation":
        return _DecayedEvaluation(self, parameters)


class _DecayedEvaluation:
    """As `jointgap.surrogate.network_batch.Evaluation` says, for the only member of a batch."""

    def __init__(self, decayed: _Decayed, parameters: torch.Tensor):
        self._of = decayed
        self._network = decayed.model.evaluate(decayed.of_network(parameters))
        self.outputs = torch.cat([self._network.outputs * decayed.roots, decayed.root * parameters], dim=1)

    def select(self, members: object) -> "_DecayedEvaluation":
        return self

    def replaced(self, other: "_DecayedEvaluation", members: object) -> "_DecayedEvaluation":
        return other

    def pull_back(self, weights: torch.Tensor) -> torch.Tensor:
        errors, moves = weights.split([self._of.model.points, self._of.size], dim=1)
        return self._of.derivatives(self._network.pull_back(errors * self._of.roots)) + self._of.root * moves

    def jacobian(self) -> torch.Tensor:
        errors = self._of.derivatives(self._network.jacobian() * self._of.roots[:, None])
        moves = self._of.root * torch.eye(self._of.size, dtype=torch.float64)[None]
        return torch.cat([errors, moves], dim=1)

    def products_of_rows(self, member: int, out: np.ndarray, work: object) -> None:
        jacobian = self.jacobian()[member].numpy()
        out[...] = jacobian @ jacobian.T

    def along(self, step: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        first, second = self._network.along(self._of.of_network(step))
        return (
            torch.cat([first * self._of.roots, self._of.root * step], dim=1),
            torch.cat([second * self._of.roots, torch.zeros_like(step)], dim=1),
        )
