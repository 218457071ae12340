"""How far the eight errors of both surrogates are from the paper's, read from the results of `make run`."""

from pathlib import Path

import pandas as pd

from benchmarks.project import ROOT
from jointgap import tables

RESULTS = ROOT / "results" / "paper"


def measure(results: Path = RESULTS) -> list[dict]:
    """Rows of the table; without results of `make run` nothing is measured."""
    files = sorted(results.glob("surrogate/*/errors.parquet"))
    errors = pd.concat([tables.read(tables.FIT_ERRORS, file) for file in files]) if files else None
    return [
        row(errors, "network", "training_mse", "training MSE, networks"),
        row(errors, "clearance", "held_out_mse", "held-out MSE, second surrogate"),
    ]


def row(errors: pd.DataFrame | None, model: str, error: str, what: str) -> dict:
    """The worst of the eight outputs, default seed, whole revolution; beside it a spline through the same points."""
    found = {"what": f"{what}: largest of the eight over the paper's", "reach": 1.0, "measured": None, "unit": "1"}
    if errors is None:
        return found | {"peers": {}}
    rows = errors[(errors["model"] == model) & (errors["region"] == "all")].drop_duplicates("output")
    largest = {name: float((rows[name] / rows["paper_mse"]).max()) for name in (error, "spline_held_out_mse")}
    complete = len(rows) == len(tables.OUTPUTS)
    peers = {"spline through the same points, held out": largest["spline_held_out_mse"]}
    return found | {"measured": largest[error] if complete else None, "peers": peers}
