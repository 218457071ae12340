"""Training of the networks of the outputs."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from jointgap.config import Surrogate
from jointgap.core.schema import TRAJECTORY
from jointgap.networks.errors import (
    NETWORK,
    REGIONS,
    REGULARISED,
    Function,
    Points,
    refined,
    smoothing_spline,
    split_samples,
)
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


UNITS = {column.name: column.unit for column in TRAJECTORY.columns}


@dataclass(frozen=True)
class TrainedNetwork:
    """A network of one output with its training history."""

    model: str
    seed: int
    output: str
    start_angle: float
    network: Network  # Scaled by the paper's training points, as all errors
    training: Points
    held_out: Points
    mse: np.ndarray  # shape (iterations + 1,); scaled, at the start and after every iteration
    snapshots: dict[int, np.ndarray]  # Parameters, shape (P,), by iteration, including the final
    stop: str  # Stopping criterion
    iterations_to_paper: int | None = None

    def weights(self) -> pd.DataFrame:
        """The table fit."""
        return self.network.to_frame(self.seed, self.model)

    def history(self) -> pd.DataFrame:
        """The table fit_history."""
        unit = self.network.output.range**2
        squares = {
            iteration: self.held_out.square(self._at(iteration)) / unit
            for iteration in self.snapshots
        }
        iterations = np.arange(len(self.mse))
        frame = pd.DataFrame(
            {"model": self.model, "seed": self.seed, "iteration": iterations, "mse": self.mse}
        )
        return frame.assign(held_out_mse=frame["iteration"].map(squares).astype(float))

    def _at(self, iteration: int) -> Function:
        """The network as it was after an iteration."""
        return replace(self.network, parameters=self.snapshots[iteration]).values

    def errors(self) -> pd.DataFrame:
        """The table fit_errors, a row per region."""
        scale, reached = self.network.output.range, self.iterations_to_paper
        spline = CubicSpline(self.training.crank_angle, self.training.values)
        further_fits = {
            "smoothing_spline_held_out_mse": smoothing_spline(self.training),
            "held_out_mse_at_paper": None if reached is None else self._at(reached),
        }
        rows = []
        for region, begin in REGIONS.items():
            training, held_out = self.training, self.held_out
            if begin > 0.0:
                training = training.past(self.start_angle + begin)
                held_out = held_out.past(self.start_angle + begin)
            errors = self.network.values(held_out.crank_angle) - held_out.values
            row = {
                "output": self.output,
                "unit": UNITS[self.output],
                "model": self.model,
                "seed": self.seed,
                "region": region,
                "weights": self.network.layout.size,
                "training_points": len(training.values),
                "held_out_points": len(held_out.values),
                "undefined_points": training.undefined + held_out.undefined,
                "range": scale,
                "paper_mse": TRAINING_MSE.get(self.output),
                "held_out_peak": float(np.max(np.abs(errors))) / scale,
                "iterations": len(self.mse) - 1,
                "stop": self.stop,
                "iterations_to_paper": reached,
            }
            for name, points, square in (
                ("training", training, training.square(self.network.values)),
                ("held_out", held_out, held_out.mean(errors**2)),
                ("spline_held_out", held_out, held_out.square(spline)),
            ):
                row[f"{name}_mse"] = square / scale**2
                row[f"{name}_rms"] = square**0.5
                row[f"{name}_mse_over_variance"] = square / points.variance
            for name, fit in further_fits.items():
                row[name] = fit and held_out.square(fit) / scale**2
            rows.append(row)
        numbers = dict.fromkeys(("paper_mse", *further_fits), "float64")  # null if there is none
        return pd.DataFrame(rows).astype(numbers | {"iterations_to_paper": "Int64"})


def train(trajectory: pd.DataFrame, output: str, options: Surrogate) -> list[TrainedNetwork]:
    """Train the network of one output from every seed, the default one first."""
    training, held_out = split_samples(trajectory, output, options.training_points)
    layout = Layout(options.hidden)
    input_scale, output_scale = Scaling.of(training.crank_angle), Scaling.of(training.values)
    model = NetworkModel(layout, input_scale.shrink(training.crank_angle))
    targets = output_scale.shrink(training.values)
    networks = []
    for seed in options.seeds:
        settings = Settings(
            options.seed_iterations if networks else options.iterations,
            milestone=TRAINING_MSE.get(output, 0.0),
            snapshots=SNAPSHOTS,
        )
        result = minimise(model, targets, nguyen_widrow(layout, seed), settings)
        networks.append(
            TrainedNetwork(
                NETWORK,
                seed,
                output,
                trajectory["crank_angle"].iloc[0],
                Network(layout, result.parameters, input_scale, output_scale),
                training,
                held_out,
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
    papers_points, _ = split_samples(trajectory, output, options.training_points)
    scale, seed = Scaling.of(papers_points.values), options.seeds[0]
    angle, values = fine["crank_angle"].to_numpy(), fine[output].to_numpy()
    stride = np.diff(trajectory["crank_angle"].iloc[:2])[0] / (angle[1] - angle[0])
    coarse = np.arange(0, len(angle), round(stride))
    coarse = coarse[np.isfinite(values[coarse])]
    samples = refined(angle, values, coarse, TOLERANCE * scale.range)
    training, held_out = split_at_random(angle[samples], values[samples], seed)
    model = _DecayedModel(training, scale, options.regularised_neurons)
    parameters, stop = model.train(options.regularised_iterations)
    input_scale = Scaling.of(training.crank_angle)
    networks = [Network(model.network.layout, p, input_scale, scale) for p in parameters]
    mse = np.array([training.square(network.values) for network in networks])
    return TrainedNetwork(
        REGULARISED,
        seed,
        output,
        trajectory["crank_angle"].iloc[0],
        networks[-1],
        training,
        held_out,
        mse / scale.range**2,
        dict(enumerate(parameters)),
        stop,
    )


def split_at_random(angle: np.ndarray, values: np.ndarray, seed: int) -> tuple[Points, Points]:
    """Training points and held-out samples: a random one of every three neighbours, except the
    ends."""
    groups = np.arange(1, len(angle) - GROUP, GROUP)
    is_held_out = np.zeros(len(angle), bool)
    members = np.random.default_rng(seed).integers(GROUP, size=len(groups))
    is_held_out[groups + members] = True
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
        places = np.linspace(0.0, along[-1], neurons + 2)[1:-1]
        self.centres = np.interp(places, along, x)
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
        self._slopes = slice(0, 2 * neurons, 2)
        self._sums = slice(1, 2 * neurons, 2)

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
        by_network = self._network.jacobian() * self._model.roots[:, None]
        errors = self._model.derivatives(by_network)
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
