"""A network as two files that anyone can read: arrays in `weights.npz`, the rest in `network.json`. No pickle.

The arrays carry the names of the state dict of ``torch.nn.Sequential(Linear, Tanh, Linear, Tanh, ..., Linear)``, so
torch loads them without jointgap::

    arrays = numpy.load("weights.npz")
    network.load_state_dict({name: torch.from_numpy(arrays[name]) for name in arrays})
"""

import io
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.errors import InputError


@dataclass(frozen=True)
class Network:
    """A fully connected network with tanh layers and a linear last one, inputs and output scaled to [0, 1].

    Attributes
    ----------
    weights : tuple of np.ndarray
        One matrix per layer, shape (neurons, inputs).
    biases : tuple of np.ndarray
        One vector per layer, shape (neurons,).
    input_range, output_range : tuple of float
        Values that are scaled to 0 and 1.
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    input_range: tuple[float, float]
    output_range: tuple[float, float]

    def __call__(self, angle: np.ndarray) -> np.ndarray:
        """The output at crank angles [rad], shape (n,), in the unit of the output; shape (n,). Equation (11)."""
        low, high = self.input_range
        signal = (np.asarray(angle, dtype=float)[:, np.newaxis] - low) / (high - low)
        last = len(self.weights) - 1
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            signal = signal @ weight.T + bias
            if layer < last:
                signal = np.tanh(signal)
        low, high = self.output_range
        return signal[:, 0] * (high - low) + low


def from_table(fit: pd.DataFrame) -> Network:
    """The network in the long form of a fit's table (one seed): a row a weight, ``source`` -1 for a bias."""
    weights, biases = [], []
    for _, rows in fit.groupby("layer", sort=True):
        matrix = rows.pivot(index="neuron", columns="source", values="weight").sort_index().sort_index(axis=1)
        biases.append(matrix[-1].to_numpy(dtype=float))
        weights.append(matrix.drop(columns=-1).to_numpy(dtype=float))
    first = fit.iloc[0]
    ranges = [(float(first[f"{end}_min"]), float(first[f"{end}_max"])) for end in ("input", "output")]
    return Network(tuple(weights), tuple(biases), *ranges)


def to_files(network: Network, output: str) -> dict[str, bytes]:
    """The network as the contents of `network.json` and `weights.npz`.

    Parameters
    ----------
    network : Network
    output : str
        Name of the output it learned.
    """
    description = {
        "input": "crank_angle [rad]",
        "output": output,
        "input_range": network.input_range,
        "output_range": network.output_range,
        "scaling": "scaled = (value - range[0]) / (range[1] - range[0]), for input and output",
    }
    return _pack(network.weights, network.biases, description)


def clearance_to_files(fit: pd.DataFrame, joint: int) -> dict[str, bytes]:
    """The network of a joint's clearance vector, from the table clearance_fit, as the same two files.

    Parameters
    ----------
    fit : DataFrame
        Table clearance_fit.
    joint : int
        1 crank pivot, 2 crank pin, 3 piston pin.
    """
    rows = fit[fit["joint"] == joint]
    neurons, bias = rows[rows["neuron"] >= 0].sort_values("neuron"), rows[rows["neuron"] < 0].iloc[0]
    slope = 1.0 / neurons["width"].to_numpy()
    weights = (slope[:, np.newaxis], neurons[["weight_x", "weight_y"]].to_numpy().T)
    biases = (-neurons["centre"].to_numpy() * slope, bias[["weight_x", "weight_y"]].to_numpy(dtype=float))
    description = {
        "input": "crank_angle [rad]",
        "output": "clearance vector of the joint, less the factor s: w_x, w_y [m]",
        "joint": joint,
        "start_angle": float(bias["start_angle"]),
        "settling": None if pd.isna(bias["settling"]) else float(bias["settling"]),
        "speed": None if pd.isna(bias["speed"]) else float(bias["speed"]),
        "turns": int(bias["turns"]),
        "use": "s = tanh^2((crank_angle - start_angle) / settling), 1 where settling is null; r = s |w|; "
        "gamma = direction of w, unwrapped, plus turns; rates by calculus, times speed; null: the speed of the crank is not constant",
    }
    return _pack(weights, biases, description)


def _pack(weights: tuple[np.ndarray, ...], biases: tuple[np.ndarray, ...], description: dict) -> dict[str, bytes]:
    """Both files: the layers' arrays by their names in torch, and what there is to know beside."""
    arrays = {}
    for layer, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        arrays |= {f"{2 * layer}.weight": weight, f"{2 * layer}.bias": bias}  # a Tanh takes each odd number
    packed = io.BytesIO()
    np.savez(packed, **arrays)
    shape = {
        "neurons": [weights[0].shape[1], *map(len, biases)],
        "hidden_activation": "tanh",
        "output_activation": "linear",
        "weights": "weights.npz, named as the state dict of torch.nn.Sequential(Linear, Tanh, ..., Linear)",
    }
    text = json.dumps(description | shape, indent=2) + "\n"
    return {"network.json": text.encode(), "weights.npz": packed.getvalue()}


def load(folder: Path | str) -> Network:
    """The network of one output in a folder that holds `network.json` and `weights.npz`.

    Raises
    ------
    InputError
        A file is missing or not what it should be.
    """
    folder = Path(folder)
    try:
        description = json.loads((folder / "network.json").read_text(encoding="utf-8"))
        with np.load(folder / "weights.npz", allow_pickle=False) as arrays:
            layers = range(len(description["neurons"]) - 1)
            weights = tuple(arrays[f"{2 * layer}.weight"] for layer in layers)
            biases = tuple(arrays[f"{2 * layer}.bias"] for layer in layers)
        return Network(weights, biases, tuple(description["input_range"]), tuple(description["output_range"]))
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"{folder}: holds no network ({error}); give a folder with network.json and weights.npz"
        ) from error
