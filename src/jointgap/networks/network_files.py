"""A network as two files that anyone can read: arrays in `weights.npz`, the rest in `network.json`. No pickle.

The arrays carry the names of the state dict of ``torch.nn.Sequential(Linear, Tanh, Linear, Tanh, ..., Linear)``, so
torch loads them without jointgap::

    arrays = numpy.load("weights.npz")
    network.load_state_dict({name: torch.from_numpy(arrays[name]) for name in arrays})
"""

import io
import json

import numpy as np
import pandas as pd

from jointgap.networks.network import Network


def to_files(network: Network, output: str) -> dict[str, bytes]:
    """The `network` of one `output` (its name) as the contents of `network.json` and `weights.npz`."""
    matrices = network.layout.split(network.parameters)
    description = {
        "input": "crank_angle [rad]",
        "output": output,
        "input_range": (network.input.low, network.input.high),
        "output_range": (network.output.low, network.output.high),
        "scaling": "scaled = (value - range[0]) / (range[1] - range[0]), for input and output",
    }
    return _pack([(matrix[:, :-1], matrix[:, -1]) for matrix in matrices], description)


def clearance_to_files(fit: pd.DataFrame, joint: int) -> dict[str, bytes]:
    """The network of a joint's clearance vector as the same two files."""
    rows = fit[fit["joint"] == joint]
    neurons, bias = rows[rows["neuron"] >= 0].sort_values("neuron"), rows[rows["neuron"] < 0].iloc[0]
    slope = 1.0 / neurons["width"].to_numpy()
    layers = [
        (slope[:, np.newaxis], -neurons["centre"].to_numpy() * slope),
        (neurons[["weight_x", "weight_y"]].to_numpy().T, bias[["weight_x", "weight_y"]].to_numpy(dtype=float)),
    ]
    description = {
        "input": "crank_angle [rad]",
        "output": "clearance vector of the joint, less the factor s: w_x, w_y [m]",
        "joint": joint,
        "start_angle": float(bias["start_angle"]),
        "settling": None if pd.isna(bias["settling"]) else float(bias["settling"]),
        "speed": None if pd.isna(bias["speed"]) else float(bias["speed"]),
        "turns": int(bias["turns"]),
        "use": "s = tanh^2((crank_angle - start_angle) / settling), 1 where settling is null; r = s |w|; gamma = "
        "direction of w, unwrapped, plus turns; rates by calculus, times speed; null: the speed of the crank is not "
        "constant",
    }
    return _pack(layers, description)


def _pack(layers: list[tuple[np.ndarray, np.ndarray]], description: dict) -> dict[str, bytes]:
    """Both files: weights and biases of the layers by their names in torch, and what there is to know beside."""
    arrays = {}
    for layer, (weight, bias) in enumerate(layers):
        arrays |= {f"{2 * layer}.weight": weight, f"{2 * layer}.bias": bias}  # a Tanh takes each odd number
    packed = io.BytesIO()
    np.savez(packed, **arrays)
    shape = {
        "neurons": [layers[0][0].shape[1], *(len(bias) for _, bias in layers)],
        "hidden_activation": "tanh",
        "output_activation": "linear",
        "weights": "weights.npz, named as the state dict of torch.nn.Sequential(Linear, Tanh, ..., Linear)",
    }
    text = json.dumps(description | shape, indent=2) + "\n"
    return {"network.json": text.encode(), "weights.npz": packed.getvalue()}
