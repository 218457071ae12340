"""Training of the networks of the outputs."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from jointgap.config import Surrogate
from jointgap.core import joints
from jointgap.core.errors import InputError, needs
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.networks.errors import NETWORK, REGULARISED, Grid, Points, Trained, error_frame, error_rows
from jointgap.networks.levenberg_marquardt import NetworkModel, Result, Settings, Status, minimise
from jointgap.networks.network import Layout, Network, Scaling, nguyen_widrow
from jointgap.paper.printed import TRAINING_MSE, reference_mse

KINDS = ("r", "gamma", "gamma_dot", "gamma_ddot", "r_dot", "r_ddot")
ORDERS = {"r": 0, "gamma": 0, "gamma_dot": 1, "gamma_ddot": 2, "r_dot": 1, "r_ddot": 2}
PER_HELD_OUT = 2  # samples kept everywhere, per sample held out
MISSED_OF_CLEARANCE = 0.3  # error of the interpolation, in errors allowed, that makes a sample be kept


def column(kind: str, joint: int) -> str:
    """Column of the trajectory: r_dot of joint 2 is r2_dot."""
    quantity, _, dots = kind.partition("_")
    return f"{quantity}{joint}{'_' * bool(dots)}{dots}"


@dataclass(frozen=True)
class Samples:
    """What a joint's network learns from, at n rising crank angles."""

    crank_angle: np.ndarray  # shape (n,)
    values: dict[str, np.ndarray]  # shape (n,); by kind: r, gamma and their derivatives by the crank angle
    simulated: dict[str, np.ndarray]  # shape (n,); the same as the simulation has them, derivatives by time
    scales: dict[str, float]  # Error allowed in each of them

    @property
    def shares(self) -> np.ndarray:
        """Share of the revolution that each sample stands for, (n,): samples are dense where the motion is quick."""
        widths = np.gradient(self.crank_angle)
        return widths / widths.sum()

    @classmethod
    def of(cls, trajectory: pd.DataFrame, fine: pd.DataFrame, joint: int, training_points: int) -> "Samples":
        """Samples of the first revolution of `fine` that are none of `trajectory`'s."""
        angle = fine["crank_angle"].to_numpy()
        angle = angle[angle - angle[0] <= 2.0 * np.pi * (1.0 + 1e-9)]
        held_out = trajectory["crank_angle"].to_numpy()
        ratio = int(np.round((held_out[1] - held_out[0]) / (angle[1] - angle[0])))
        if ratio < 2 * PER_HELD_OUT or not np.allclose(held_out[: len(angle[::ratio])], angle[::ratio], atol=1e-9):
            raise InputError(
                "the fine sampling must have a multiple of the trajectory's samples, "
                f"{2 * PER_HELD_OUT} times as many at least"
            )
        part = {name: fine[name].to_numpy()[: len(angle)] for name in ("crank_speed", "crank_acceleration")}
        speed, mean = part["crank_speed"], float(part["crank_speed"].mean())
        simulated, scales = {}, {}
        for kind in KINDS:
            name = column(kind, joint)
            simulated[kind] = fine[name].to_numpy()[: len(angle)]
            spread = Scaling.of(Grid.of(trajectory, name, training_points).training.values).range
            allowed = reference_mse(name if name in joints.outputs(JOINT_NUMBERS) else f"r{joint}")
            scales[kind] = spread * allowed**0.5 / mean ** ORDERS[kind]
        values = dict(simulated)
        for quantity in ("r", "gamma"):
            rate = simulated[f"{quantity}_dot"] / speed
            values[f"{quantity}_dot"] = rate
            values[f"{quantity}_ddot"] = (simulated[f"{quantity}_ddot"] - rate * part["crank_acceleration"]) / speed**2
        kept = _chosen(angle, values, scales, ratio)
        chosen = ({kind: row[kept] for kind, row in rows.items()} for rows in (values, simulated))
        return cls(angle[kept], *chosen, scales)


def _chosen(angle: np.ndarray, values: dict[str, np.ndarray], scales: dict[str, float], ratio: int) -> np.ndarray:
    """Indices of the samples to keep, rising."""
    table = np.column_stack([values[kind] / scale for kind, scale in scales.items()])
    usable = np.isfinite(table).all(axis=1)
    usable[::ratio] = False
    step = ratio // PER_HELD_OUT
    kept = np.arange(step // 2, len(angle), step)
    return refined(angle, table, kept[usable[kept]], usable, MISSED_OF_CLEARANCE)


def refined(angle: np.ndarray, table: np.ndarray, kept: np.ndarray, usable: np.ndarray, missed: float) -> np.ndarray:
    """Indices `kept`, and those of further samples, that interpolation between kept neighbours would miss; rising."""
    while True:
        between = (kept[:-1] + kept[1:]) // 2
        between = np.where(usable[between], between, between + 1)
        between = between[(between > kept[:-1]) & (between < kept[1:]) & usable[between]]
        errors = np.abs(CubicSpline(angle[kept], table[kept])(angle[between]) - table[between]).max(axis=1)
        if not (errors > missed).any():
            return kept
        kept = np.union1d(kept, between[errors > missed])


with needs("training networks", "learn"):
    import torch

SNAPSHOTS = tuple(sorted({round(10 ** (n / 4)) for n in range(4, 25)}))
"""Iterations after which the error at the held-out samples is recorded: it tells what further training does there."""


@dataclass(frozen=True)
class Fit:
    """The networks trained for one output, the default seed first."""

    output: str
    networks: dict[int, Network]  # By seed
    results: dict[int, Result]  # By seed: errors per iteration, status
    grid: Grid  # Training points and samples held out

    @property
    def default(self) -> Network:
        """The network of the first seed, whatever its result."""
        return next(iter(self.networks.values()))

    def weights(self) -> pd.DataFrame:
        """Frame of the table fit."""
        frames = [network.to_frame(seed, NETWORK) for seed, network in self.networks.items()]
        return pd.concat(frames, ignore_index=True)

    def history(self) -> pd.DataFrame:
        """Frame of the table fit_history."""
        frames = []
        held_out, scale = self.grid.held_out, self.default.output.range
        for seed, result in self.results.items():
            frame = pd.DataFrame(
                {"model": NETWORK, "seed": seed, "iteration": np.arange(len(result.errors)), "mse": result.errors}
            )
            kept = {
                iteration: float(
                    np.mean((self._predict(seed, held_out.crank_angle, parameters) - held_out.values) ** 2)
                )
                for iteration, parameters in (result.kept | {result.iterations: result.parameters}).items()
            }
            frames.append(frame.assign(held_out_mse=frame["iteration"].map(kept).astype(float) / scale**2))
        return pd.concat(frames, ignore_index=True)

    def errors(self) -> pd.DataFrame:
        """Frame of the table fit_errors."""
        rows = []
        for seed, network in self.networks.items():
            result = self.results[seed]
            early = result.kept.get(result.milestone)
            trained = Trained(
                NETWORK,
                seed,
                network.layout.size,
                result.iterations,
                result.status.sentence,
                result.milestone,
                None if early is None else partial(self._predict, seed, parameters=early),
            )
            rows += error_rows(self.grid, partial(self._predict, seed, parameters=result.parameters), trained)
        return error_frame(rows)

    def _predict(self, seed: int, crank_angle: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        return replace(self.networks[seed], parameters=parameters).values(crank_angle)


def train(trajectory: pd.DataFrame, output: str, options: Surrogate) -> Fit:
    """Train the network of one output from every seed."""
    torch.set_num_threads(1)  # the matrices are small, and several outputs train side by side
    grid = Grid.of(trajectory, output, options.training_points)
    layout = Layout(options.hidden)
    scale_in, scale_out = Scaling.of(grid.training.crank_angle), Scaling.of(grid.training.values)
    model = NetworkModel(layout, scale_in.shrink(grid.training.crank_angle))
    targets = scale_out.shrink(grid.training.values)
    results: dict[int, Result] = {}
    default, *others = options.seeds
    for seeds, iterations in (((default,), options.iterations), (tuple(others), options.seed_iterations)):
        if seeds:
            start = np.stack([nguyen_widrow(layout, seed) for seed in seeds])
            settings = Settings(iterations, milestone=TRAINING_MSE.get(output, 0.0), snapshots=SNAPSHOTS)
            results |= zip(seeds, minimise(model, targets, start, settings), strict=True)
    networks = {seed: Network(layout, result.parameters, scale_in, scale_out) for seed, result in results.items()}
    return Fit(output, networks, results, grid)


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

    A model of one network for `jointgap.networks.levenberg_marquardt.minimise`.
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
    """As `jointgap.networks.levenberg_marquardt.Evaluation` says, for the only member of a batch."""

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
