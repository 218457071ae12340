"""Training of the networks of the outputs."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd

from jointgap.config import Surrogate
from jointgap.networks.errors import NETWORK, REGULARISED, Grid, Points, error_frame, refined
from jointgap.networks.levenberg_marquardt import NetworkModel, Settings, minimise
from jointgap.networks.network import Layout, Network, Scaling, nguyen_widrow
from jointgap.paper.printed import TRAINING_MSE

SNAPSHOTS = tuple(sorted({round(10 ** (n / 4)) for n in range(4, 25)}))
"""Iterations whose error at the held-out samples is recorded."""
SAMPLING = 20  # candidate samples, as a multiple of the trajectory's
# interpolation error, over the output's range, above which a sample is added; far below a network's
TOLERANCE = 1e-6
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
    grid: Grid  # The paper's training points scale all errors; the held-out samples
    training: Points
    mse: np.ndarray  # shape (iterations + 1,); scaled, at the start and after every iteration
    snapshots: dict[int, np.ndarray]  # Parameters, shape (P,), by iteration, including the final
    stop: str  # Stopping criterion
    iterations_to_paper: int | None = None

    def weights(self) -> pd.DataFrame:
        """The table fit."""
        return self.network.to_frame(self.seed, self.model)

    def history(self) -> pd.DataFrame:
        """The table fit_history."""
        held_out, unit = self.grid.held_out, self.network.output.range**2
        squares = {n: held_out.square(partial(self._values, n)) / unit for n in self.snapshots}
        iterations = np.arange(len(self.mse))
        frame = pd.DataFrame(
            {"model": self.model, "seed": self.seed, "iteration": iterations, "mse": self.mse}
        )
        return frame.assign(held_out_mse=frame["iteration"].map(squares).astype(float))

    def errors(self) -> pd.DataFrame:
        """The table fit_errors."""
        columns = {
            "model": self.model,
            "seed": self.seed,
            "weights": self.network.layout.size,
            "iterations": len(self.mse) - 1,
            "stop": self.stop,
            "iterations_to_paper": self.iterations_to_paper,
        }
        reached = self.iterations_to_paper
        at_paper = None if reached is None else partial(self._values, reached)
        return error_frame(self.grid, self.network.values, self.training, columns, at_paper)

    def _values(self, iteration: int, crank_angle: np.ndarray) -> np.ndarray:
        return replace(self.network, parameters=self.snapshots[iteration]).values(crank_angle)


def train(trajectory: pd.DataFrame, output: str, options: Surrogate) -> list[TrainedNetwork]:
    """Train the network of one output from every seed, the default one first."""
    grid = Grid.of(trajectory, output, options.training_points)
    angle, values = grid.training.crank_angle, grid.training.values
    layout, input_scale, output_scale = (
        Layout(options.hidden),
        Scaling.of(angle),
        Scaling.of(values),
    )
    model = NetworkModel(layout, input_scale.shrink(angle))
    networks = []
    for seed in options.seeds:
        settings = Settings(
            options.seed_iterations if networks else options.iterations,
            milestone=TRAINING_MSE.get(output, 0.0),
            snapshots=SNAPSHOTS,
        )
        start = nguyen_widrow(layout, seed)
        result = minimise(model, output_scale.shrink(values), start, settings)
        networks.append(
            TrainedNetwork(
                NETWORK,
                seed,
                Network(layout, result.parameters, input_scale, output_scale),
                grid,
                grid.training,
                result.errors,
                result.snapshots | {result.iterations: result.parameters},
                result.status.sentence,
                result.milestone,
            )
        )
    return networks


def train_regularised(
    trajectory: pd.DataFrame, fine: pd.DataFrame, output: str, options: Surrogate
) -> TrainedNetwork:
    """Train the regularised network of one output, at samples of the `fine` first revolution."""
    grid, seed = Grid.of(trajectory, output, options.training_points), options.seeds[0]
    scale = Scaling.of(grid.training.values)
    ratio = (
        np.diff(trajectory["crank_angle"].iloc[:2])[0] / np.diff(fine["crank_angle"].iloc[:2])[0]
    )
    angle, values = fine["crank_angle"].to_numpy(), fine[output].to_numpy()
    coarse = np.arange(0, len(angle), round(ratio))
    coarse = coarse[np.isfinite(values[coarse])]
    samples = refined(angle, values, coarse, TOLERANCE * scale.range)
    training, held_out = split(angle[samples], values[samples], seed)
    model = _DecayedModel(training, scale, options.regularised_neurons)
    parameters, stop = model.train(options.regularised_iterations)
    input_scale = Scaling.of(training.crank_angle)
    networks = [Network(model.network.layout, p, input_scale, scale) for p in parameters]
    mse = np.array([training.square(network.values) for network in networks])
    return TrainedNetwork(
        REGULARISED,
        seed,
        networks[-1],
        replace(grid, held_out=held_out),
        training,
        mse / scale.range**2,
        dict(enumerate(parameters)),
        stop,
    )


def split(angle: np.ndarray, values: np.ndarray, seed: int) -> tuple[Points, Points]:
    """Training points and held-out samples: a random one of every three neighbours, except the
    ends."""
    groups = np.arange(1, len(angle) - GROUP, GROUP)
    is_held_out = np.zeros(len(angle), bool)
    is_held_out[groups + np.random.default_rng(seed).integers(GROUP, size=len(groups))] = True
    shares = np.gradient(angle)
    return tuple(
        Points(angle[part], values[part], shares=shares[part])
        for part in (~is_held_out, is_held_out)
    )


class _DecayedModel:
    """Residuals weighted by the root of the samples' shares, followed by the weight decay.

    A model for `jointgap.networks.levenberg_marquardt.minimise`. The parameters are slope and sum
    of each neuron, relative to its own width and centre, and the output weights: of order one and
    weakly coupled, unlike weights and biases on the input's scale.
    """

    def __init__(self, training: Points, scale: Scaling, neurons: int):
        x = Scaling.of(training.crank_angle).shrink(training.crank_angle)
        values = scale.shrink(training.values)
        # half of the neurons even over the crank angle, half over the output's variation
        change = np.abs(np.diff(values))
        along = np.concatenate([[0.0], np.cumsum(np.diff(x) + change / change.sum())])
        self.centres = np.interp(np.linspace(0.0, along[-1], neurons + 2)[1:-1], along, x)
        self.widths = WIDTH * np.gradient(self.centres)
        self.roots = np.sqrt(training.shares / training.shares.mean())
        self.targets = self.roots * values
        tansig = np.tanh((x[:, None] - self.centres) / self.widths)
        layer = np.column_stack([tansig, np.ones_like(x)]) * self.roots[:, None]
        normal = layer.T @ layer
        normal[np.diag_indices(neurons + 1)] += RIDGE * np.trace(normal) / (neurons + 1)
        # towards which the weights decay; the start has linear output weights
        self.anchor = np.concatenate([np.tile([1.0, 0.0], neurons), np.zeros(neurons + 1)])
        self.start = self.anchor.copy()
        self.start[2 * neurons :] = np.linalg.solve(normal, layer.T @ self.targets)
        self.network, self.decay = NetworkModel(Layout((neurons,)), x), RIDGE
        self.size = self.network.size
        self.points = self.network.points + self.size
        self._slopes, self._sums = slice(0, 2 * neurons, 2), slice(1, 2 * neurons, 2)

    def of_network(self, parameters: np.ndarray) -> np.ndarray:
        """The network's weights and biases, (P,), from the trained parameters (P,)."""
        weights = parameters.copy()
        weights[self._slopes] /= self.widths
        weights[self._sums] -= self.centres * weights[self._slopes]
        return weights

    def derivatives(self, by_network: np.ndarray) -> np.ndarray:
        """Derivatives by the trained parameters, from those (..., P) by the network's weights and
        biases."""
        result = by_network.copy()
        slopes = by_network[..., self._slopes] - self.centres * by_network[..., self._sums]
        result[..., self._slopes] = slopes / self.widths
        return result

    def evaluate(self, parameters: np.ndarray) -> "_DecayedEvaluation":
        return _DecayedEvaluation(self, parameters)

    def by_evidence(self, parameters: np.ndarray) -> float:
        """Weight of the decay, relative to that of the squared errors, that maximises the evidence:
        a fixed point."""
        evaluation, points = self.network.evaluate(self.of_network(parameters)), len(self.targets)
        jacobian = self.derivatives(evaluation.jacobian() * self.roots[:, None])
        curvatures = np.maximum(np.linalg.eigvalsh(jacobian.T @ jacobian), 0.0)
        misfit = np.sum((self.targets - evaluation.outputs * self.roots) ** 2)
        distance, decay = np.sum((parameters - self.anchor) ** 2), self.decay
        for _ in range(EVIDENCE_PASSES):
            determined = np.sum(curvatures / (curvatures + decay))
            decay = determined * misfit / (max(points - determined, 1.0) * distance)
        return float(decay)

    def train(self, iterations: int) -> tuple[list[np.ndarray], str]:
        """The network's parameters after every iteration, and the final round's stopping
        criterion."""
        path, parameters = [], self.start
        rounds = np.linspace(0, iterations, min(ROUNDS, iterations) + 1).astype(int)
        for count in np.diff(rounds):
            self.decay = self.by_evidence(parameters)
            targets = np.concatenate([self.targets, self.decay**0.5 * self.anchor])
            settings = Settings(int(count), minimum_gradient=0.0, snapshots=tuple(range(count + 1)))
            result = minimise(self, targets, parameters, settings)
            path += [parameters, *(result.snapshots[n] for n in range(1, result.iterations))]
            parameters = result.parameters
        return [self.of_network(p) for p in [*path, parameters]], result.status.sentence


class _DecayedEvaluation:
    def __init__(self, model: _DecayedModel, parameters: np.ndarray):
        self._model, self._root = model, model.decay**0.5
        self._network = model.network.evaluate(model.of_network(parameters))
        self.outputs = np.concatenate(
            [self._network.outputs * model.roots, self._root * parameters]
        )

    def pull_back(self, weights: np.ndarray) -> np.ndarray:
        errors, decays = np.split(weights, [len(self._model.roots)])
        by_network = self._network.pull_back(errors * self._model.roots)
        return self._model.derivatives(by_network) + self._root * decays

    def jacobian(self) -> np.ndarray:
        errors = self._model.derivatives(self._network.jacobian() * self._model.roots[:, None])
        return np.concatenate([errors, self._root * np.eye(self._model.size)])

    def row_products(self, out: np.ndarray, work: object) -> None:
        jacobian = self.jacobian()
        out[...] = jacobian @ jacobian.T

    def along(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope, curvature = self._network.along(self._model.of_network(step))
        roots = self._model.roots
        return (
            np.concatenate([slope * roots, self._root * step]),
            np.concatenate([curvature * roots, np.zeros_like(step)]),
        )
