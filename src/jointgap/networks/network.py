"""The paper's network: layers of tansig neurons, one linear output, one input; initialisation and
scaling.

Weights of layer l are a matrix of shape (neurons, sources + 1) whose last column is the bias: row i
gives z_i = sum_j W_ij a_j + W_i,-1. The flat vector of parameters contains all layers, row by
row."""

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

BIAS = -1  # `source` of a bias in the long form


@dataclass(frozen=True)
class Layout:
    """Sizes of a network with one input and one output."""

    hidden: tuple[int, ...]  # Neurons of each hidden layer; the paper's are (10, 10, 10, 10)

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Shape (neurons, sources + 1) of each layer's matrix."""
        return [(neurons, sources + 1) for sources, neurons in pairwise((1, *self.hidden, 1))]

    @property
    def size(self) -> int:
        """Number of parameters; 361 for the paper's network."""
        return sum(rows * columns for rows, columns in self.shapes)

    def split(self, parameters: np.ndarray) -> list[np.ndarray]:
        """Matrices of the layers as views of parameters (size,)."""
        ends = accumulate(rows * columns for rows, columns in self.shapes)
        shapes = zip(ends, self.shapes, strict=True)
        return [
            parameters[end - rows * columns : end].reshape(rows, columns)
            for end, (rows, columns) in shapes
        ]


def activations_and_outputs(
    matrices: list[np.ndarray], inputs: np.ndarray, product: Callable = np.matmul
) -> tuple[list[np.ndarray], np.ndarray]:
    """Forward propagation: the activations of every layer but the last, and the outputs (N,)."""
    activations = [inputs]
    for matrix in matrices[:-1]:
        sums = product(matrix, activations[-1])
        layer = np.ones((len(sums) + 1, sums.shape[1]))
        np.tanh(sums, out=layer[:-1])
        activations.append(layer)
    return activations, (matrices[-1] @ activations[-1])[0]


def tansig_slope(layer: np.ndarray) -> np.ndarray:
    """Derivative of tansig by its argument, (neurons, N), from a hidden layer's activations."""
    values = layer[:-1]
    return 1.0 - values * values


@dataclass(frozen=True)
class Scaling:
    """The affine map of [low, high] to [0, 1]."""

    low: float
    high: float

    @classmethod
    def of(cls, values: ArrayLike) -> "Scaling":
        """Scaling by the range of `values`."""
        low, high = float(np.min(values)), float(np.max(values))
        if not high > low:
            raise ValueError(f"all values are {low:g}: there is no range to scale by")
        return cls(low, high)

    @property
    def range(self) -> float:
        return self.high - self.low

    def shrink(self, values: ArrayLike) -> np.ndarray:
        """Physical values to [0, 1]."""
        return (np.asarray(values) - self.low) / self.range

    def expand(self, scaled: ArrayLike) -> np.ndarray:
        """[0, 1] to physical values."""
        return self.low + self.range * np.asarray(scaled)


def nguyen_widrow(layout: Layout, seed: int) -> np.ndarray:
    """Initial parameters, shape (layout.size,), by the rule of Nguyen and Widrow (IJCNN 1990), as
    MATLAB's initnw.

    Each tansig layer of S neurons with R inputs gets weight vectors of random direction and length
    beta = 0.7 S^(1/R), and biases spread evenly over [-beta, beta] with the sign of the neuron's
    first weight. The active regions of the neurons, |z| < about 1, then cover the inputs' range
    evenly with a small overlap. The rule assumes inputs in [-1, 1], the range of tansig; the first
    layer is transformed for inputs in [0, 1]. The linear output starts with weights and bias
    uniform in [-1, 1].
    """
    random = np.random.default_rng(seed)
    matrices = []
    for neurons, columns in layout.shapes[:-1]:
        sources = columns - 1
        length = 0.7 * neurons ** (1.0 / sources)
        weights = random.uniform(-1.0, 1.0, (neurons, sources))
        weights *= length / np.linalg.norm(weights, axis=1, keepdims=True)
        places = np.linspace(-1.0, 1.0, neurons) if neurons > 1 else np.zeros(1)
        biases = length * places * np.sign(weights[:, 0])
        matrices.append(np.column_stack([weights, biases]))
    matrices.append(random.uniform(-1.0, 1.0, layout.shapes[-1]))
    weights_and_biases = matrices[0]
    weights_and_biases[:, -1] -= weights_and_biases[:, 0]
    weights_and_biases[:, 0] *= 2.0
    return np.concatenate([matrix.ravel() for matrix in matrices])


@dataclass(frozen=True)
class Network:
    """A trained network from crank angle [rad] to one output in its SI unit."""

    layout: Layout
    parameters: np.ndarray  # shape (layout.size,)
    input: Scaling  # Of the crank angle
    output: Scaling

    def values(self, crank_angle: ArrayLike) -> np.ndarray:
        """The output at crank angles of any shape [rad], in its SI unit; same shape."""
        return self.values_and_slopes(crank_angle)[0]

    def values_and_slopes(self, crank_angle: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """The output and its exact derivative with respect to the crank angle [output's unit /
        rad]."""
        angle = np.asarray(crank_angle, dtype=float)
        scaled = self.input.shrink(angle.ravel())
        matrices = self.layout.split(self.parameters)
        inputs = np.stack([scaled, np.ones_like(scaled)])
        activations, outputs = activations_and_outputs(matrices, inputs)
        slope = np.ones((1, angle.size))
        for matrix, layer in zip(matrices[:-1], activations[1:], strict=True):
            slope = tansig_slope(layer) * (matrix[:, :-1] @ slope)
        ratio = self.output.range / self.input.range
        slope = ratio * (matrices[-1][:, :-1] @ slope)[0]
        return self.output.expand(outputs).reshape(angle.shape), slope.reshape(angle.shape)

    def to_frame(self, seed: int, model: str = "network") -> pd.DataFrame:
        """Long form, one row per weight: the columns of the table `fit`."""
        places = [
            (layer, neuron, source)
            for layer, (neurons, columns) in enumerate(self.layout.shapes)
            for neuron in range(neurons)
            for source in (*range(columns - 1), BIAS)
        ]
        return pd.DataFrame(places, columns=["layer", "neuron", "source"]).assign(
            seed=seed,
            model=model,
            weight=self.parameters,
            input_min=self.input.low,
            input_max=self.input.high,
            output_min=self.output.low,
            output_max=self.output.high,
        )

    @classmethod
    def from_frame(
        cls, frame: pd.DataFrame, seed: int | None = None, model: str = "network"
    ) -> "Network":
        """The network of a model and a seed (by default the first) from the long form."""
        frame = frame[frame["model"] == model]
        seed = frame["seed"].iloc[0] if seed is None else seed
        rows = frame[frame["seed"] == seed]
        *hidden, _ = rows.groupby("layer")["neuron"].max() + 1
        scale = rows.iloc[0]
        return cls(
            Layout(tuple(map(int, hidden))),
            rows["weight"].to_numpy(),
            Scaling(float(scale["input_min"]), float(scale["input_max"])),
            Scaling(float(scale["output_min"]), float(scale["output_max"])),
        )


# A network is stored as two files without pickle: arrays in `weights.npz`, the rest in
# `network.json`. The names of the arrays are those of the state dict of torch.nn.Sequential(Linear,
# Tanh, ..., Linear), for torch without jointgap: network.load_state_dict({name:
# torch.from_numpy(arrays[name]) for name in arrays}).


def to_files(network: Network, output: str) -> dict[str, bytes]:
    """The contents of `network.json` and `weights.npz` for the `network` of one `output`."""
    arrays = {}
    for layer, matrix in enumerate(network.layout.split(network.parameters)):
        place = 2 * layer  # odd numbers: Tanh
        arrays[f"{place}.weight"] = matrix[:, :-1]
        arrays[f"{place}.bias"] = matrix[:, -1]
    weights = io.BytesIO()
    np.savez(weights, **arrays)
    description = {
        "input": "crank_angle [rad]",
        "output": output,
        "input_range": (network.input.low, network.input.high),
        "output_range": (network.output.low, network.output.high),
        "scaling": "scaled = (value - range[0]) / (range[1] - range[0]), for input and output",
        "neurons": [1, *network.layout.hidden, 1],
        "hidden_activation": "tanh",
        "output_activation": "linear",
        "weights": (
            "weights.npz, named as the state dict of torch.nn.Sequential(Linear, Tanh, ..., Linear)"
        ),
    }
    return {
        "network.json": (json.dumps(description, indent=2) + "\n").encode(),
        "weights.npz": weights.getvalue(),
    }
