"""Training of the networks of the outputs."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd

from jointgap.config import Surrogate
from jointgap.networks.errors import (
    NETWORK,
    REGULARISED,
    Grid,
    Points,
    error_frame,
    error_rows,
    refined,
)
from jointgap.networks.levenberg_marquardt import NetworkModel, Settings, minimise
from jointgap.networks.network import Layout, Network, Scaling, nguyen_widrow
from jointgap.paper.printed import TRAINING_MSE

SNAPSHOTS = tuple(sorted({round(10 ** (n / 4)) for n in range(4, 25)}))
"""Iterations whose error at the held-out samples is recorded."""
SAMPLING = 20  # candidate samples, as a multiple of the trajectory's
# interpolation error, over the output's range, above which a sample is added; far below a network's
MISSED = 1e-6
GROUP = 3  # neighbouring samples, of which a random one is held out
WIDTH = 1.0  # initial width of a neuron, in distances to its neighbours
RIDGE = 1e-8  # relative, of the linear problem for the initial output weights
ROUNDS = 5  # of training; the evidence sets the weight decay before each
EVIDENCE_PASSES = 5


@dataclass(frozen=True)
class TrainedNetwork:
    """A network of one output with its training history."""

    model: str
    seed: int
    network: Network
    grid: (
        Grid  # The paper's training points, whose range scales all errors, and the held-out samples
    )
    training: Points  # Training data
    mse: np.ndarray  # shape (iterations + 1,); scaled, at the start and after every iteration
    kept: dict[int, np.ndarray]  # Parameters, shape (P,), by iteration, including the last
    stop: str  # Stopping criterion
    iterations_to_paper: int | None = None

    def weights(self) -> pd.DataFrame:
        """The table fit."""
        return self.network.to_frame(self.seed, self.model)

    def history(self) -> pd.DataFrame:
        """The table fit_history."""
        held_out = self.grid.held_out
        squares = {
            iteration: held_out.square(partial(self._values, iteration)) for iteration in self.kept
        }
        iterations = np.arange(len(self.mse))
        frame = pd.DataFrame(
            {"model": self.model, "seed": self.seed, "iteration": iterations, "mse": self.mse}
        )
        missed = frame["iteration"].map(squares).astype(float)
        return frame.assign(held_out_mse=missed / self.network.output.range**2)

    def errors(self) -> pd.DataFrame:
        """The table fit_errors."""
        trained = {
            "model": self.model,
            "seed": self.seed,
            "weights": self.network.layout.size,
            "iterations": len(self.mse) - 1,
            "stop": self.stop,
            "iterations_to_paper": self.iterations_to_paper,
        }
        at_paper = (
            None
            if self.iterations_to_paper is None
            else partial(self._values, self.iterations_to_paper)
        )
        return error_frame(
            error_rows(self.grid, self.network.values, self.training, trained, at_paper)
        )

    def _values(self, iteration: int, crank_angle: np.ndarray) -> np.ndarray:
        return replace(self.network, parameters=self.kept[iteration]).values(crank_angle)


def train(trajectory: pd.DataFrame, output: str, options: Surrogate) -> list[TrainedNetwork]:
    """Train the network of one output from every seed, the default one first."""
    grid = Grid.of(trajectory, output, options.training_points)
    angle, values = grid.training.crank_angle, grid.training.values
    layout, scale_in, scale_out = Layout(options.hidden), Scaling.of(angle), Scaling.of(values)
    model, milestone = NetworkModel(layout, scale_in.shrink(angle)), TRAINING_MSE.get(output, 0.0)
    networks = []
    for seed in options.seeds:
        iterations = options.seed_iterations if networks else options.iterations
        settings = Settings(iterations, milestone=milestone, snapshots=SNAPSHOTS)
        result = minimise(model, scale_out.shrink(values), nguyen_widrow(layout, seed), settings)
        network = Network(layout, result.parameters, scale_in, scale_out)
        kept, stop = result.kept | {result.iterations: result.parameters}, result.status.sentence
        networks.append(
            TrainedNetwork(
                NETWORK,
                seed,
                network,
                grid,
                grid.training,
                result.errors,
                kept,
                stop,
                result.milestone,
            )
        )
    return networks


def train_regularised(
    trajectory: pd.DataFrame, fine: pd.DataFrame, output: str, options: Surrogate
) -> TrainedNetwork:
    grid, seed = Grid.of(trajectory, output, options.training_points), options.seeds[0]
    scale = Scaling.of(grid.training.values)
    training, held_out = _split(*_samples(trajectory, fine, output, MISSED * scale.range), seed)
    model = _Decayed(training, scale, options.regularised_neurons)
    parameters, stop = model.trained(options.regularised_iterations)
    scale_in = Scaling.of(training.crank_angle)
    networks = [Network(model.network.layout, each, scale_in, scale) for each in parameters]
    mse = np.array([training.square(network.values) for network in networks])
    grid, kept = replace(grid, held_out=held_out), dict(enumerate(parameters))
    return TrainedNetwork(
        REGULARISED, seed, networks[-1], grid, training, mse / scale.range**2, kept, stop
    )


def _samples(
    trajectory: pd.DataFrame, fine: pd.DataFrame, output: str, missed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Crank angles and values, (n,) each: samples of the first revolution, refined by the
    interpolation error."""
    angle, values = fine["crank_angle"].to_numpy(), fine[output].to_numpy()
    step = int(
        np.round(np.diff(trajectory["crank_angle"].to_numpy()[:2])[0] / (angle[1] - angle[0]))
    )
    usable = np.isfinite(values)
    first = np.arange(0, len(angle), step)
    kept = refined(angle, values[:, None] / missed, first[usable[first]], usable, 1.0)
    return angle[kept], values[kept]


def _split(angle: np.ndarray, values: np.ndarray, seed: int) -> tuple[Points, Points]:
    """Training points and held-out samples: a random one of every three neighbours, except the
    ends."""
    first = np.arange(1, len(angle) - GROUP, GROUP)
    held_out = np.zeros(len(angle), bool)
    held_out[first + np.random.default_rng(seed).integers(GROUP, size=len(first))] = True
    shares = np.gradient(angle)
    return tuple(
        Points(angle[part], values[part], shares=shares[part]) for part in (~held_out, held_out)
    )


class _Decayed:
    """Residuals weighted by the root of the samples' shares, followed by the weight decay.

    A model for `jointgap.networks.levenberg_marquardt.minimise`. The parameters are slope and sum
    of each neuron, relative to its own width and centre, and the output weights: of order one and
    weakly coupled, unlike weights and biases on the input's scale.
    """

    def __init__(self, training: Points, scale: Scaling, neurons: int):
        x, t = (
            Scaling.of(training.crank_angle).shrink(training.crank_angle),
            scale.shrink(training.values),
        )
        change = np.abs(np.diff(t))
        # half of the neurons even over the crank angle, half over the output's variation; linear
        # output weights
        along = np.concatenate([[0.0], np.cumsum(np.diff(x) + change / change.sum())])
        self.centres = np.interp(np.linspace(0.0, along[-1], neurons + 2)[1:-1], along, x)
        self.widths = WIDTH * np.gradient(self.centres)
        self.roots = np.sqrt(training.shares / training.shares.mean())
        layer = np.column_stack(
            [np.tanh((x[:, None] - self.centres) / self.widths), np.ones_like(x)]
        )
        layer *= self.roots[:, None]
        normal = layer.T @ layer
        normal[np.diag_indices(neurons + 1)] += RIDGE * np.trace(normal) / (neurons + 1)
        self.targets = self.roots * t
        self.anchor = np.concatenate(
            [np.tile([1.0, 0.0], neurons), np.zeros(neurons + 1)]
        )  # target of the decay
        self.start = self.anchor.copy()
        self.start[2 * neurons :] = np.linalg.solve(normal, layer.T @ self.targets)
        self.network, self.decay = NetworkModel(Layout((neurons,)), x), RIDGE
        self.size = self.network.size
        self.points = self.network.points + self.size
        self._slopes, self._sums = (slice(first, 2 * neurons, 2) for first in (0, 1))

    def of_network(self, parameters: np.ndarray) -> np.ndarray:
        """The network's weights and biases, (P,), from the trained parameters (P,)."""
        weights = parameters.copy()
        weights[self._slopes] /= self.widths
        weights[self._sums] -= self.centres * weights[self._slopes]
        return weights

    def derivatives(self, by_network: np.ndarray) -> np.ndarray:
        """Derivatives by the trained parameters, from those (..., P) by the network's weights and
        biases."""
        result, sums = by_network.copy(), by_network[..., self._sums]
        result[..., self._slopes] = (
            by_network[..., self._slopes] - self.centres * sums
        ) / self.widths
        return result

    def evaluate(self, parameters: np.ndarray) -> "_DecayedEvaluation":
        return _DecayedEvaluation(self, parameters)

    def by_evidence(self, at: np.ndarray) -> float:
        """Weight of the decay, relative to that of the squared errors, that maximises the evidence:
        a fixed point."""
        evaluation, points = self.network.evaluate(self.of_network(at)), len(self.targets)
        jacobian = self.derivatives(evaluation.jacobian() * self.roots[:, None])
        curvatures = np.maximum(np.linalg.eigvalsh(jacobian.T @ jacobian), 0.0)
        misfit = np.sum((self.targets - evaluation.outputs * self.roots) ** 2)
        moved, decay = np.sum((at - self.anchor) ** 2), self.decay
        for _ in range(EVIDENCE_PASSES):
            determined = np.sum(curvatures / (curvatures + decay))
            decay = determined * misfit / (max(points - determined, 1.0) * moved)
        return float(decay)

    def trained(self, iterations: int) -> tuple[list[np.ndarray], str]:
        """The network's parameters after every iteration, and the last round's stopping
        criterion."""
        path, at = [], self.start
        for count in np.diff(np.linspace(0, iterations, min(ROUNDS, iterations) + 1).astype(int)):
            self.decay = self.by_evidence(at)
            targets = np.concatenate([self.targets, self.decay**0.5 * self.anchor])
            settings = Settings(int(count), minimum_gradient=0.0, snapshots=tuple(range(count + 1)))
            result = minimise(self, targets, at, settings)
            path += [at, *(result.kept[n] for n in range(1, result.iterations))]
            at = result.parameters
        return [self.of_network(parameters) for parameters in [*path, at]], result.status.sentence


class _DecayedEvaluation:
    def __init__(self, model: _Decayed, parameters: np.ndarray):
        self._model, self._root = model, model.decay**0.5
        self._network = model.network.evaluate(model.of_network(parameters))
        self.outputs = np.concatenate(
            [self._network.outputs * model.roots, self._root * parameters]
        )

    def pull_back(self, weights: np.ndarray) -> np.ndarray:
        errors, moves = np.split(weights, [len(self._model.roots)])
        return (
            self._model.derivatives(self._network.pull_back(errors * self._model.roots))
            + self._root * moves
        )

    def jacobian(self) -> np.ndarray:
        errors = self._model.derivatives(self._network.jacobian() * self._model.roots[:, None])
        return np.concatenate([errors, self._root * np.eye(self._model.size)])

    def row_products(self, out: np.ndarray, work: object) -> None:
        jacobian = self.jacobian()
        out[...] = jacobian @ jacobian.T

    def along(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first, second = self._network.along(self._model.of_network(step))
        roots, still = self._model.roots, np.zeros_like(step)
        return np.concatenate([first * roots, self._root * step]), np.concatenate(
            [second * roots, still]
        )
