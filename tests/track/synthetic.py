"""Small tables of made-up numbers with the columns that the stages write."""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config import Scenario, load_mechanism
from jointgap.tables import OUTPUTS, Table

HIDDEN = (3, 2)


def scenario(**more) -> Scenario:
    """The paper's mechanism with small networks."""
    base = {
        "description": "made up",
        "mechanism": load_mechanism("config/mechanisms/erkaya2009.yaml").model_dump(),
        "surrogate": {"hidden": HIDDEN, "seeds": (7, 8)},
    }
    return Scenario.model_validate(base | more)


def numbers(table: Table, rows: int, seed: int, **given) -> pd.DataFrame:
    """`rows` rows of the table: the columns `given`, the others numbers between 0 and 1."""
    random = np.random.default_rng(seed)
    made = {"float": lambda: random.random(rows), "int": lambda: random.integers(1, 9, rows)}
    made |= {"text": lambda: ["text"] * rows, "bool": lambda: [True] * rows}
    return pd.DataFrame({c.name: given[c.name] if c.name in given else made[c.kind]() for c in table.columns})


def weights_in_long_form(seed: int, generator: np.random.Generator) -> pd.DataFrame:
    """The weights of one network."""
    sizes = (1, *HIDDEN, 1)
    rows = [
        (seed, layer, neuron, source, generator.normal())
        for layer in range(len(sizes) - 1)
        for neuron in range(sizes[layer + 1])
        for source in range(-1, sizes[layer])
    ]
    return pd.DataFrame(rows, columns=["seed", "layer", "neuron", "source", "weight"])


def benchmark(path: Path, seconds: float) -> Path:
    """A benchmark file as Snakemake writes it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"s\th:m:s\tmax_rss\tmean_load\n{seconds}\t0:00:01\t123.4\t99\n")
    return path
