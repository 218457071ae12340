"""What is published of many designs: one run for all that a scenario asks of them, not one a design."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.core.publish import Dataset, Record, configuration, costs, name_and_factor, numbers
from jointgap.designs.infer_settings import NUMBERS, departures
from jointgap.designs.run import check_dataset
from jointgap.designs.sampling import designs_of

DESIGNS = Path("sweep/designs")
"""Folder of the dataset in that of a scenario."""

_SHOWN = (".md", ".html", ".svg", ".png", ".yaml")
_ENDS = ("", "_low", "_high")
_QUANTILES = {"smallest": 0.0, "quantile_05": 0.05, "median": 0.5, "quantile_95": 0.95, "largest": 1.0}


def sweep_record(options: Scenario, folder: Path) -> Record:
    """The run of a scenario's many designs, from what its stages wrote into `folder`."""
    swept = bool(options.sweep.parameters)
    asked = {
        "sweep": swept,
        "sensitivity": swept and options.sensitivity is not None,
        "infer_settings": options.infer_settings is not None,
        "optimise_robust": bool(options.optimise_robust.uncertain),
    }
    stages = [stage for stage in METRICS if asked[stage]]
    if not stages:
        raise InputError(
            "sweep.parameters, optimise_robust.uncertain: name nothing, so there is nothing to publish; give the "
            "options that the designs were made with"
        )
    metrics, datasets, files, spent = {}, [], {}, {}
    for stage in stages:
        metrics |= METRICS[stage](options, folder)
        datasets += [folder / DESIGNS] if stage == "sweep" else sorted((folder / stage).glob("[!.]*.parquet"))
        shown = (path for path in sorted((folder / stage).rglob("*")) if path.suffix in _SHOWN)
        files |= {str(path.relative_to(folder)): path for path in shown}
        benchmark = folder / f"benchmarks/{stage}.tsv"
        spent |= {f"{stage}_{name}": cost for name, cost in costs([benchmark] if benchmark.is_file() else []).items()}
    names = {folder / table.path: name for name, table in schema.TABLES.items()}
    given = configuration(options, options.model_fields_set - {"description"})
    return Record(
        "sweep",
        params=given["params"],
        metrics=metrics,
        datasets=tuple(
            Dataset(names.get(path, f"{path.parent.name}_{path.stem}"), path, "result") for path in datasets
        ),
        files=given["files"] | files,
        costs=spent,
    )


def _sweep(options: Scenario, folder: Path) -> dict[str, float]:
    """How many designs there are and failed; of each measure mean, deviation and quantiles."""
    designs = designs_of(options)
    check_dataset(designs, folder / DESIGNS)
    reasons = parquet.read_columns(folder / DESIGNS, ["reason"])["reason"]
    failed = len(reasons) - reasons.null_count
    metrics = {"designs": len(reasons), "failed": failed, "failed_percent": 100 * failed / len(reasons)}
    for column in designs.measured:
        name, factor = name_and_factor(column)
        values = factor * parquet.read_columns(folder / DESIGNS, [column.name])[column.name].to_numpy()
        values = values[np.isfinite(values)]
        if len(values):
            sizes = {"mean": values.mean(), "deviation": values.std(), "counted": len(values)}
            sizes |= {quantile: np.quantile(values, share) for quantile, share in _QUANTILES.items()}
            metrics |= {f"{name}/{size}": value for size, value in sizes.items()}
    return metrics


def _sensitivity(options: Scenario, folder: Path) -> dict[str, float]:
    """Held-out quality of each measure's surrogate, and its indices where it has some."""
    metrics = {
        f"q2/{row['measure']}{end}": row[f"q2{end}"] for row in _rows("sensitivity_surrogates", folder) for end in _ENDS
    }
    for row in _rows("sensitivity_indices", folder):
        of = f"{row['measure']} by {row['parameter']}"
        metrics |= {f"{index}/{of}{end}": row[f"{index}{end}"] for index in ("first_order", "total") for end in _ENDS}
    return {name: value for name, value in metrics.items() if pd.notna(value)}


def _infer_settings(options: Scenario, folder: Path) -> dict[str, float]:
    """In which share of the designs the paper's printed numbers come out, alone and together."""
    names = ["together", "farthest", *(one.column for one in NUMBERS)]
    designs = parquet.read_columns(folder / "infer_settings/designs.parquet", names).to_pandas()
    shares = (departures(designs) <= options.infer_settings.within).mean(axis=0)
    return {
        "printed/together_percent": 100 * designs["together"].mean(),
        "printed/farthest_off_in_nearest_percent": 100 * designs["farthest"].min(),
        **{f"printed/{one.column}_percent": 100 * share for one, share in zip(NUMBERS, shares, strict=True)},
    }


def _optimise_robust(options: Scenario, folder: Path) -> dict[str, float]:
    """Lengths side by side, gains, and how often constraints hold, on fresh draws."""
    metrics = {}
    for name, section in {
        "lengths": "{lengths}/",
        "gains": "{lengths} beside {beside}/",
        "constraints": "{lengths} keeps {constraint}/",
    }.items():
        table = schema.TABLES[f"optimise_robust_{name}"]
        for row in _rows(table.name, folder):
            metrics |= numbers(table, row, section=section.format(**row))
    return metrics


METRICS: dict[str, Callable[[Scenario, Path], dict[str, float]]] = {
    "sweep": _sweep,
    "sensitivity": _sensitivity,
    "infer_settings": _infer_settings,
    "optimise_robust": _optimise_robust,
}
"""What each stage adds, by its folder."""


def _rows(name: str, folder: Path) -> list[dict]:
    return parquet.read(schema.TABLES[name], folder / schema.TABLES[name].path).to_dict("records")
