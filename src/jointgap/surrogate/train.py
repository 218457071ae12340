"""Training of the paper's network for one output."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch

from jointgap.config import Surrogate
from jointgap.surrogate.errors import Grid, Trained, error_rows
from jointgap.surrogate.evaluate import values
from jointgap.surrogate.levenberg_marquardt import Result, Settings, minimise
from jointgap.surrogate.model import NetworkModel
from jointgap.surrogate.network import Layout, Network, Scaling, nguyen_widrow


@dataclass(frozen=True)
class Fit:
    """The networks trained for one output, the default seed first.

    Attributes
    ----------
    output : str
    networks : dict of int to Network
        By seed.
    results : dict of int to Result
        By seed: errors per iteration, status.
    grid : Grid
        Training points and samples held out.
    """

    output: str
    networks: dict[int, Network]
    results: dict[int, Result]
    grid: Grid

    @property
    def default(self) -> Network:
        """The network of the first seed, whatever its result."""
        return next(iter(self.networks.values()))

    def weights(self) -> pd.DataFrame:
        """Frame of the table fit."""
        frames = [network.to_frame(seed) for seed, network in self.networks.items()]
        return pd.concat(frames, ignore_index=True)

    def history(self) -> pd.DataFrame:
        """Frame of the table fit_history."""
        frames = [
            pd.DataFrame({"seed": seed, "iteration": np.arange(len(result.errors)), "mse": result.errors})
            for seed, result in self.results.items()
        ]
        return pd.concat(frames, ignore_index=True)

    def errors(self) -> pd.DataFrame:
        """Frame of the table fit_errors."""
        rows = []
        for seed, network in self.networks.items():
            result = self.results[seed]
            trained = Trained("network", seed, network.layout.size, result.iterations, result.status.sentence)
            rows += error_rows(self.grid, lambda angle, network=network: values(network, angle), trained)
        return pd.DataFrame(rows).astype({"seed": "Int64"})


def train(trajectory: pd.DataFrame, output: str, options: Surrogate) -> Fit:
    """Train the network of one output from every seed.

    Parameters
    ----------
    trajectory : DataFrame
        Columns crank_angle [rad], evenly spaced over at least one revolution, and `output`; undefined values are NaN,
        left out and counted.
    output : str
        One of `jointgap.tables.OUTPUTS`.
    options : Surrogate
        Layers, training points, seeds and iterations.

    Returns
    -------
    Fit
        The same to the last bit for the same input and versions of the numerical libraries.

    Raises
    ------
    InputError
        The training points are not among the samples.
    """
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
            results |= zip(seeds, minimise(model, targets, start, Settings(iterations=iterations)), strict=True)
    networks = {seed: Network(layout, result.parameters, scale_in, scale_out) for seed, result in results.items()}
    return Fit(output, networks, results, grid)
