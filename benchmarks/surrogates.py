"""How far the eight errors of both surrogates are from the paper's, read from the results of `make run`."""

from pathlib import Path

import pandas as pd

from benchmarks.project import ROOT, row
from jointgap.core import joints, parquet, schema

RESULTS = ROOT / "results" / "paper"


def measure(results: Path = RESULTS) -> list[dict]:
    """Rows of the table; without results of `make run` nothing is measured."""
    files = sorted(results.glob("surrogate/*/errors.parquet"))
    errors = pd.concat([parquet.read(schema.FIT_ERRORS, file) for file in files]) if files else None
    return [
        _worst(errors, "network", "training_mse", "training MSE, networks"),
        _worst(errors, "clearance", "held_out_mse", "held-out MSE, second surrogate"),
    ]


def _worst(errors: pd.DataFrame | None, model: str, error: str, what: str) -> dict:
    """The worst of the eight outputs, default seed, whole revolution; beside it a spline through the same points."""
    what = f"{what}: largest of the eight over the paper's"
    if errors is None:
        return row(what, 1.0, None, "1")
    rows = errors[(errors["model"] == model) & (errors["region"] == "all")].drop_duplicates("output")
    largest = {name: float((rows[name] / rows["paper_mse"]).max()) for name in (error, "spline_held_out_mse")}
    measured = largest[error] if len(rows) == len(joints.OUTPUTS) else None
    return row(what, 1.0, measured, "1", **{"spline through the same points, held out": largest["spline_held_out_mse"]})
