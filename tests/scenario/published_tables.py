"""Small tables of made-up numbers with the columns that the stages write."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config import Scenario, load_mechanism
from jointgap.core import parquet, schema
from jointgap.core.joints import OUTPUTS
from jointgap.core.schema import TABLES, Table
from jointgap.scenario.stages import SCENARIO_STAGES

HIDDEN = (3, 2)
SEEDS = (7, 8)
ITERATIONS = 2000
MEASURES = ("rms", "mean_absolute", "peak", "sum_of_squares")
POINTS = {("networks", "paper"): 0.149, ("simulation", "wide"): 0.148}
"""Crank length [m] by source and box."""


BOXES = {
    "paper": {"crank_length": (0.147, 0.153), "rod_length": (0.555, 0.564)},
    "wide": {"crank_length": (0.147, 0.153), "rod_length": (0.55272, 0.57528)},
}


SECTIONS = {stage.name: stage.sections for stage in SCENARIO_STAGES.values()}
"""Sections of a scenario that each stage reads."""


def scenario(**more) -> Scenario:
    """The paper's mechanism with small networks."""
    base = {
        "description": "made up",
        "mechanism": load_mechanism("config/mechanisms/erkaya2009.yaml").model_dump(),
        "surrogate": {"hidden": HIDDEN, "seeds": SEEDS, "seed_iterations": 100},
    }
    base["surrogate"]["iterations"] = ITERATIONS
    given = base | more
    return Scenario.model_validate(
        given | {"optimise": {"boxes": BOXES, **given.get("optimise", {})}}
    )


def numbers(table: Table, rows: int, salt: int = 0, **given) -> pd.DataFrame:
    """`rows` rows of the table: the columns `given`, the others numbers between 0 and 1."""
    random = np.random.default_rng(salt)
    made = {"float": lambda: random.random(rows), "int": lambda: random.integers(1, 9, rows)}
    made |= {kind: lambda: ["text"] * rows for kind in ("text", "category")}
    made |= {"bool": lambda: [True] * rows}
    return pd.DataFrame(
        {c.name: given[c.name] if c.name in given else made[c.kind]() for c in table.columns}
    )


def fit(salt: int) -> pd.DataFrame:
    """The networks of one output, one for each seed."""
    random = np.random.default_rng(salt)
    sizes = (1, *HIDDEN, 1)
    rows = [
        (model, start, layer, neuron, source, random.normal(), 0.0, 2 * np.pi, -3.0, 5.0)
        for model, start in (*(("network", seed) for seed in SEEDS), ("regularised", SEEDS[0]))
        for layer in range(len(sizes) - 1)
        for neuron in range(sizes[layer + 1])
        for source in (*range(sizes[layer]), -1)
    ]
    return pd.DataFrame(rows, columns=[column.name for column in schema.FIT.columns])


def simulated(folder: Path, salt: int = 0) -> dict[str, Path]:
    """Tables of the stage simulate."""
    events = {
        "joint": ["crank_pin"] * 3 + ["piston_pin"],
        "event": ["impact", "separation", "impact", "impact"],
    }
    motion, events = numbers(schema.TRAJECTORY, 50, salt), numbers(schema.EVENTS, 4, salt, **events)
    return _write(folder, {"trajectory": motion, "events": events})


def learned(folder: Path, salt: int = 0, outputs: Sequence[str] = ("r2", "r3")) -> dict[str, Path]:
    """Tables of the stages simulate and surrogate."""
    frames = {}
    for place, output in enumerate(outputs):
        # of the paper's two starts and of the regularised network
        lengths = [1 + (150 if place else ITERATIONS), 101, 51]
        steps, seeds = np.concatenate([np.arange(length) for length in lengths]), (*SEEDS, SEEDS[0])
        models = np.array(["network", "network", "regularised"])
        history = {"iteration": steps, "mse": 0.1 / (1.0 + steps)}
        history |= {"seed": np.repeat(seeds, lengths), "model": np.repeat(models, lengths)}
        judged = (history["model"] == "regularised") | np.isin(steps, (10, 100))
        history["held_out_mse"] = np.where(judged, 0.2 / (1.0 + steps), np.nan)
        errors = {"output": [output] * 6, "region": ["all", "past_60_deg"] * 3}
        errors |= {"model": np.repeat(models, 2), "seed": np.repeat(seeds, 2)}
        frames |= {
            f"fit/{output}": fit(salt + place),
            f"fit_history/{output}": numbers(schema.FIT_HISTORY, len(steps), **history),
            f"fit_errors/{output}": numbers(schema.FIT_ERRORS, 6, salt + place, **errors),
        }
    return simulated(folder, salt) | _write(folder, frames)


def finished(folder: Path, salt: int = 0) -> dict[str, Path]:
    """Tables of all stages."""
    frames, regions = {}, ["first_revolution", "past_60_deg"]
    for name, count in (("errors", 2), ("contradictions", 1)):
        table = TABLES[f"kinematics_{name}"]
        frames[f"kinematics_{name}"] = numbers(table, count, salt, region=regions[:count])
    verdicts = {"kind": ["number", "claim", "claim"], "verdict": ["agrees", "holds", "holds"]}
    items = {"item": ["rod's gain: real, at 5 %", "second", "third"]}
    frames["comparison"] = numbers(schema.COMPARISON, 3, salt, **verdicts, **items)
    files = learned(folder, salt, OUTPUTS) | _write(folder, frames | _optimised(salt))
    (folder / "comparison.md").write_text("in words")
    return files


def _optimised(salt: int) -> dict[str, pd.DataFrame]:
    keys = [(source, box, method) for source, box in POINTS for method in ("genetic", "local")]
    source, box, method = map(list, zip(*keys, strict=True))
    points = ["_".join(key) for key in keys]
    again = list(product(points, ("window", "settled"), MEASURES))
    point, stretch, measure = map(list, zip(*again, strict=True))
    place = {"source": source, "box": box}
    lengths = [POINTS[key[:2]] for key in keys]
    columns = {
        "optima": {"point": points, "method": method, "crank_length": lengths} | place,
        "population": {"generation": [0, 0, 1, 1]} | place,
        "paths": {"start": [0, 1, 0, 1], "iteration": [0, 0, 0, 0]} | place,
        "resimulated": {"point": point, "stretch": stretch, "measure": measure},
        "worth": {"point": points * 2, "cycle": ["ideal"] * 4 + ["simulated"] * 4},
    }
    counts = {"resimulated": len(again), "worth": 8}
    return {
        f"optimise_{name}": numbers(TABLES[f"optimise_{name}"], counts.get(name, 4), salt, **given)
        for name, given in columns.items()
    }


def _write(folder: Path, frames: dict[str, pd.DataFrame]) -> dict[str, Path]:
    files = {name: folder / f"{name}.parquet" for name in frames}
    for name, frame in frames.items():
        parquet.write(TABLES[name.partition("/")[0]], frame, files[name])
    return files


def benchmark(path: Path, seconds: float) -> Path:
    """A benchmark file as Snakemake writes it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"s\th:m:s\tmax_rss\tmean_load\n{seconds}\t0:00:01\t123.4\t99\n")
    return path
