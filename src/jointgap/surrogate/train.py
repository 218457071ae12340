"""Training of the paper's network for one output."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd

from jointgap.config import Surrogate
from jointgap.errors import needs
from jointgap.paper.printed import TRAINING_MSE
from jointgap.surrogate.fit_errors import NETWORK, Grid, Trained, error_frame, error_rows
from jointgap.surrogate.levenberg_marquardt import Result, Settings, minimise
from jointgap.surrogate.network import Layout, Network, Scaling, nguyen_widrow
from jointgap.surrogate.network_batch import NetworkModel

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
