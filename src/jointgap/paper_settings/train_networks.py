"""The paper's networks trained at some of the designs: whether its training errors tell anything of the settings."""

import numpy as np
import pandas as pd

from jointgap.config import Surrogate
from jointgap.core.errors import SimulationError
from jointgap.core.progress import followed
from jointgap.dynamics.simulate import simulate
from jointgap.networks.train import train
from jointgap.paper.printed import TRAINING_MSE
from jointgap.paper_settings.infer_settings import InferredSettings
from jointgap.tables.infer_settings_tables import INFERRED_TRAINING

NEAREST, RANDOM = "nearest", "random"
"""How the designs were chosen."""


def train_networks(found: InferredSettings) -> pd.DataFrame:
    """Train the paper's eight networks at the nearest designs and at random ones.

    Each is trained on the revolution whose error the design counts, from one start.
    """
    rows = []
    chosen = _chosen(found)
    for drawn, design in followed(iter(chosen), "designs with networks", len(chosen)):
        rows += [{"design": int(design["design"]), "drawn": drawn} | row for row in _errors(found, design)]
    return pd.DataFrame(rows, columns=INFERRED_TRAINING.names)


def _chosen(found: InferredSettings) -> list[tuple[str, dict]]:
    number = min(found.options.trained, len(found.frame))
    drawn = np.random.default_rng(found.options.seed).choice(len(found.frame), number, replace=False)
    parts = {NEAREST: found.nearest.iloc[:number], RANDOM: found.frame.iloc[np.sort(drawn)]}
    return [(name, design) for name, part in parts.items() for design in part.to_dict("records")]


def _errors(found: InferredSettings, design: dict) -> list[dict]:
    """Errors of the eight networks at a design; none where its finer simulation fails."""
    made = found.designs.scenario({axis.key: design[axis.key] for axis in found.designs.axes})
    revolution = found.designs.counting(design).revolution
    options = made.simulate.model_copy(update={"revolutions": revolution})
    try:
        samples = simulate(made.mechanism, options).samples
    except SimulationError:
        return []
    per_turn = options.samples_per_revolution
    turn = samples.iloc[(revolution - 1) * per_turn : revolution * per_turn + 1].reset_index(drop=True)
    learning = Surrogate(iterations=found.options.iterations, seeds=(found.options.seed,))
    rows = []
    for output in TRAINING_MSE:
        errors = train(turn, output, learning).errors()
        row = errors[errors["region"] == "all"].iloc[0]
        rows.append(
            {"output": output, "paper_mse": TRAINING_MSE[output], "iterations": int(row["iterations"])}
            | {name: float(row[name]) for name in ("training_mse", "held_out_mse")}
        )
    return rows
