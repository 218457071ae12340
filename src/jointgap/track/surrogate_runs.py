"""Surrogates: a run for the scenario, and under it one for each output of each model."""

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.networks.network import Network
from jointgap.track.finished_tables import FinishedTables
from jointgap.track.network_files import clearance_to_files, to_files
from jointgap.track.run_record import Curve, Record

NETWORK = "network"
"""The paper's model; its runs are named by the output alone."""
REGULARISED = "regularised"
"""The recipe whose errors hold between its training points."""
CLEARANCE = "clearance"
"""The second surrogate: one network a joint, from which all outputs of the joint follow."""

_OVERALL = ("weights", "iterations", "paper_mse")
_BY_REGION = (
    "training_points",
    "held_out_points",
    "training_mse",
    "held_out_mse",
    "spline_held_out_mse",
    "smoothing_spline_held_out_mse",
    "held_out_peak",
    "training_rms",
    "held_out_rms",
    "spline_held_out_rms",
    "training_mse_over_variance",
    "held_out_mse_over_variance",
    "spline_held_out_mse_over_variance",
)
_CURVES = {"mse": "mse", "mse_held_out": "held_out_mse"}
"""Columns of a history by the curve's name; held_out_mse is the number at the end."""
_REGIONS = {"all": "", "past_60_deg": "_past_60_deg"}
_LOGARITHMS = ("training_mse", "held_out_mse", "paper_mse", "spline_held_out_mse", "smoothing_spline_held_out_mse")
"""Given as log10 too: the interface shows small numbers as 0.00."""


def surrogate_records(finished: FinishedTables) -> list[Record]:
    """The scenario's run, then its nested ones."""
    if not finished.has(tables.FIT_ERRORS):
        return []
    errors = finished.read(tables.FIT_ERRORS)
    seed = finished.options.surrogate.seeds[0]
    errors = errors[errors["seed"].isna() | (errors["seed"] == seed)]
    models = errors[["model", "output"]].drop_duplicates().itertuples(index=False, name=None)
    curves = {key: _curves(finished, *key, seed) for key in models}
    nested = [
        _fit(finished, model, output, rows, curves[model, output])
        for (model, output), rows in errors.groupby(["model", "output"], sort=False)
    ]
    return [_scenario_run(finished, errors, curves), *nested]


def _scenario_run(
    finished: FinishedTables, errors: pd.DataFrame, curves: dict[tuple[str, str], dict[str, Curve]]
) -> Record:
    """How many outputs reach the paper's errors, and all curves: the run that scenarios are compared by."""
    metrics = {}
    of_all_regions = errors[errors["region"] == "all"]
    for model, rows in of_all_regions.groupby("model", sort=False):
        metrics |= {f"{model}_outputs": len(rows), f"{model}_outputs_of_the_paper": rows["paper_mse"].notna().sum()}
        for kind in ("training", "held_out"):
            metrics[f"{model}_outputs_{kind}_at_paper"] = (rows[f"{kind}_mse"] <= rows["paper_mse"]).sum()
            metrics[f"{model}_largest_{kind}_mse"] = rows[f"{kind}_mse"].max()
        metrics[f"{model}_outputs_better_than_spline"] = (rows["held_out_mse"] <= rows["spline_held_out_mse"]).sum()
    return Record(
        "surrogate",
        metrics=metrics,
        curves={
            f"log10_{'' if model == NETWORK else f'{model}_'}{kind}/{output}": _log10(curve)
            for (model, output), of_fit in curves.items()
            for kind, curve in of_fit.items()
        },
        datasets=finished.datasets(["trajectory"], finished.names(tables.FIT_ERRORS)),
        costs=finished.cost("surrogate"),
        **finished.configuration("surrogate"),
    )


def _fit(finished: FinishedTables, model: str, output: str, rows: pd.DataFrame, curves: dict[str, Curve]) -> Record:
    """One output of one model; networks of one output with their curves and weights."""
    metrics = {}
    for row in rows.to_dict("records"):
        suffix = _REGIONS[row["region"]]
        metrics |= {f"{name}{suffix}": row[name] for name in _BY_REGION} | {name: row[name] for name in _OVERALL}
    metrics |= {f"log10_{name}": np.log10(metrics[name]) for name in _LOGARITHMS if metrics.get(name, 0.0) > 0}
    configuration = finished.configuration("surrogate")
    if model == CLEARANCE:
        results = [f"fit_errors/{output}", f"fit_errors/{model}", *finished.names(tables.CLEARANCE_FIT)]
    else:
        results = [f"fit_errors/{output}", f"fit/{output}", f"fit_history/{output}"]
    if model == NETWORK:
        metrics |= _over_seeds(finished, output)
    files = {f"network/{name}": content for name, content in _weights(finished, model, output).items()}
    return Record(
        "surrogate",
        output if model == NETWORK else f"{model} {output}",
        metrics=metrics,
        curves=curves | {f"log10_{kind}": _log10(curve) for kind, curve in curves.items()},
        datasets=finished.datasets(["trajectory"], results),
        costs=finished.cost(f"surrogate/{model if model == CLEARANCE else output}"),
        params=configuration["params"],
        files=configuration["files"] | files,
        notes={"model": model, "stop": rows["stop"].iloc[0]},
    )


def _weights(finished: FinishedTables, model: str, output: str) -> dict[str, bytes]:
    """The files of the network that gives the output; none if its table was not finished."""
    if model != CLEARANCE and f"fit/{output}" in finished.tables:
        fit = tables.read(tables.FIT, finished.tables[f"fit/{output}"])
        return to_files(Network.from_frame(fit, finished.options.surrogate.seeds[0], model), output)
    if model == CLEARANCE and finished.has(tables.CLEARANCE_FIT):
        return clearance_to_files(finished.read(tables.CLEARANCE_FIT), tables.number_of(output))
    return {}


def _history(finished: FinishedTables, output: str) -> pd.DataFrame | None:
    name = f"fit_history/{output}"
    return tables.read(tables.FIT_HISTORY, finished.tables[name]) if name in finished.tables else None


def _curves(finished: FinishedTables, model: str, output: str, seed: int) -> dict[str, Curve]:
    """Training and held-out error over the iterations; of the paper's networks the latter after some of them."""
    history = None if model == CLEARANCE else _history(finished, output)
    if history is None:
        return {}
    rows = history[(history["model"] == model) & (history["seed"] == seed)]
    judged = {name: rows[rows[column].notna()].set_index("iteration")[column] for name, column in _CURVES.items()}
    return {name: Curve(curve.index.to_numpy(), curve.to_numpy()) for name, curve in judged.items() if len(curve)}


def _log10(curve: Curve) -> Curve:
    with np.errstate(divide="ignore"):  # an error of exactly 0 has no logarithm and is left out
        return Curve(curve.steps, np.log10(curve.values))


def _over_seeds(finished: FinishedTables, output: str) -> dict[str, float]:
    """Training error of all seeds after as many iterations as each of them was allowed."""
    history = _history(finished, output)
    if history is None:
        return {}
    options = finished.options.surrogate
    allowed = min(options.iterations, options.seed_iterations) if len(options.seeds) > 1 else options.iterations
    history = history[history["model"] == NETWORK]
    last = history[history["iteration"] <= allowed].groupby("seed")["mse"].last()
    return {
        "seeds": len(last),
        "seeds_iterations": allowed,
        "seeds_mse_median": last.median(),
        "seeds_mse_lowest": last.min(),
        "seeds_mse_highest": last.max(),
    }
