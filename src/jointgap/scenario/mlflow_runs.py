"""MLflow runs of a scenario: one per stage, with nested runs per network and per pair of lengths.

The part of a metric's name before the slash is its section on MLflow's pages.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core import parquet, schema
from jointgap.core.publish import Dataset, Record, configuration, costs, numbers
from jointgap.core.schema import OPTIMISE_OPTIMA, OPTIMISE_WORTH
from jointgap.lengths.region import LEAST_FORCE
from jointgap.networks.network import Network, to_files
from jointgap.scenario import chosen_lengths
from jointgap.scenario.figure_data import MODES

MEASURES = ("rms", "mean_absolute", "peak", "sum_of_squares")
_UNITS = {
    "largest_pin_force": "N",
    "torque_ripple": "N_m",
}  # of objectives other than the transmission angle
_UNUSED = ["undefined_points", "range", "iterations_to_paper", "held_out_mse_at_paper", "seed"]
_OVERALL = {"weights", "iterations", "paper_mse"}  # equal in all regions
_LOGARITHMS = (
    "training_mse",
    "held_out_mse",
    "paper_mse",
    "spline_held_out_mse",
    "smoothing_spline_held_out_mse",
)
_VERDICTS = [
    f"number {verdict}" for verdict in ("agrees", "differs", "reached", "missed", "undecided")
]
_VERDICTS += [f"claim {verdict}" for verdict in ("holds", "does not hold", "undecided")]


@dataclass(frozen=True)
class _Finished:
    """Results of the stages of a scenario."""

    options: Scenario
    sections: Mapping[str, Sequence[str]]  # sections of the options that each stage reads
    files: Mapping[str, Path]  # Parquet files by ``table`` or ``table/output``
    folder: Path

    def names(self, *of: str) -> list[str]:
        """Names of the files of tables, one per output where there are several."""
        return [name for table in of for name in self.files if name.partition("/")[0] == table]

    def read(self, table: str) -> pd.DataFrame:
        """All files of a table, concatenated; empty without files."""
        frames = [
            parquet.read(schema.TABLES[table], self.files[name]) for name in self.names(table)
        ]
        return (
            pd.concat(frames, ignore_index=True)
            if frames
            else pd.DataFrame(columns=schema.TABLES[table].names)
        )

    def record(
        self,
        stage: str,
        output: str = "",
        *,
        read=(),
        written=(),
        files=None,
        job: str = "",
        **more,
    ) -> Record:
        """A run with its configuration, datasets and costs (of the `job`, by default the
        stage's)."""
        of = configuration(
            self.options, set(self.sections[stage]) & set(self.sections["track"]) - {"description"}
        )
        tables = [(name, "input") for name in read] + [(name, "result") for name in written]
        datasets = tuple(
            Dataset(name, self.files[name], kind) for name, kind in tables if name in self.files
        )
        jobs = self.folder / "benchmarks" / (job or stage)
        spent = costs(
            [
                path
                for path in (jobs.with_suffix(".tsv"), *sorted(jobs.glob("*.tsv")))
                if path.is_file()
            ]
        )
        shown = of["files"] | (files or {})
        return Record(
            stage, output, of["params"], datasets=datasets, files=shown, costs=spent, **more
        )


def scenario_records(
    options: Scenario,
    sections: Mapping[str, Sequence[str]],
    files: Mapping[str, Path],
    folder: Path,
) -> list[Record]:
    """The runs of one scenario, each before its nested runs.

    Parquet `files` by ``table`` or ``table/output``; figures and benchmarks from `folder`.
    """
    finished = _Finished(options, sections, files, folder)
    stages = {
        "trajectory": _simulate,
        "fit_errors": _surrogate,
        "kinematics_errors": _kinematics,
        "optimise_optima": _optimise,
        "comparison": _compare,
    }
    records = [
        record
        for table, stage in stages.items()
        if finished.names(table)
        for record in stage(finished)
    ]
    pictures = [
        path
        for path in sorted((folder / "figures").glob("*"))
        if path.suffix in (".svg", ".png", ".gif")
    ]
    if pictures:
        metrics = {"figures": len({path.stem for path in pictures})}
        shown = {f"figures/{path.name}": path for path in pictures}
        records.append(finished.record("figures", metrics=metrics, files=shown))
    return records


def _simulate(finished: _Finished) -> list[Record]:
    samples, events = finished.read("trajectory"), finished.read("events")
    angle, speed = np.rad2deg(samples["transmission_angle"]), 30.0 / np.pi * samples["crank_speed"]
    metrics = {
        "samples": len(samples),
        "smallest_transmission_angle_deg": angle.min(),
        "largest_transmission_angle_deg": angle.max(),
        "peak_slider_acceleration_m_s2": samples["slider_acceleration"].abs().max(),
        "peak_crank_torque_N_m": samples["crank_torque"].abs().max(),
        "peak_guide_moment_N_m": samples["guide_moment"].abs().max(),
        "lowest_crank_speed_rpm": speed.min(),
        "highest_crank_speed_rpm": speed.max(),
    }
    for joint in finished.options.mechanism.applied().loose:
        metrics[f"{joint}_peak_normal_force_N"] = samples[f"{joint}_normal_force"].max()
        for mode in MODES:
            metrics[f"{joint}_{mode}_share"] = (samples[f"{joint}_mode"] == mode).mean()
        if finished.names("events"):
            own = events[events["joint"] == joint]
            impacts, rebounds = own[own["event"] == "impact"], own[own["maxima"] <= 1]
            metrics[f"{joint}_impacts"] = len(impacts)
            metrics[f"{joint}_peak_approach_speed_m_s"] = (
                impacts["approach_speed"].max() if len(impacts) else 0.0
            )
            metrics[f"{joint}_largest_impulse_N_s"] = (
                rebounds["impulse"].max() if len(rebounds) else 0.0
            )
    return [finished.record("simulate", metrics=metrics, written=["trajectory", "events"])]


def _surrogate(finished: _Finished) -> list[Record]:
    errors, seed = finished.read("fit_errors"), finished.options.surrogate.seeds[0]
    errors = errors[errors["seed"] == seed]
    metrics, curves = {}, {}
    for model, rows in errors[errors["region"] == "all"].groupby("model", sort=False):
        metrics |= {
            f"{model}_outputs": len(rows),
            f"{model}_outputs_of_the_paper": rows["paper_mse"].notna().sum(),
        }
        for kind in ("training", "held_out"):
            metrics[f"{model}_outputs_{kind}_at_paper"] = (
                rows[f"{kind}_mse"] <= rows["paper_mse"]
            ).sum()
            metrics[f"{model}_largest_{kind}_mse"] = rows[f"{kind}_mse"].max()
        metrics[f"{model}_outputs_better_than_spline"] = (
            rows["held_out_mse"] <= rows["spline_held_out_mse"]
        ).sum()
    nested = [
        _network(finished, *key, rows)
        for key, rows in errors.groupby(["model", "output"], sort=False)
    ]
    for record in nested:
        model, _, output = record.output.rpartition(" ")
        for name, curve in record.curves.items():
            if name.startswith("log10_"):
                curves[
                    f"log10_{f'{model}_' if model else ''}{name.removeprefix('log10_')}/{output}"
                ] = curve
    written = finished.names("fit_errors")
    return [
        finished.record(
            "surrogate", metrics=metrics, curves=curves, read=["trajectory"], written=written
        ),
        *nested,
    ]


def _network(finished: _Finished, model: str, output: str, rows: pd.DataFrame) -> Record:
    """One output of one model, with its curves and weights."""
    metrics, curves, files = {}, {}, {}
    measured = rows.select_dtypes("number").drop(columns=_UNUSED, errors="ignore").astype(float)
    for region, row in zip(rows["region"], measured.to_dict("records"), strict=True):
        ending = "" if region == "all" else f"_{region}"
        metrics |= {
            name if name in _OVERALL else f"{name}{ending}": value for name, value in row.items()
        }
    metrics |= {
        f"log10_{name}": np.log10(metrics[name])
        for name in _LOGARITHMS
        if metrics.get(name, 0.0) > 0
    }
    seed, history, fit = (
        finished.options.surrogate.seeds[0],
        f"fit_history/{output}",
        f"fit/{output}",
    )
    written = [f"fit_errors/{output}", fit, history]
    if fit in finished.files:
        files = to_files(
            Network.from_frame(parquet.read(schema.FIT, finished.files[fit]), seed, model), output
        )
    if history in finished.files:
        training = parquet.read(schema.FIT_HISTORY, finished.files[history])
        own = training[(training["model"] == model) & (training["seed"] == seed)].set_index(
            "iteration"
        )
        curves = {"mse": own["mse"].dropna(), "mse_held_out": own["held_out_mse"].dropna()}
        with np.errstate(divide="ignore"):  # log10(0): dropped later
            curves |= {f"log10_{name}": np.log10(curve) for name, curve in curves.items()}
        metrics |= _over_seeds(finished.options, training) if model == "network" else {}
    return finished.record(
        "surrogate",
        output if model == "network" else f"{model} {output}",
        metrics=metrics,
        curves=curves,
        read=["trajectory"],
        written=written,
        files={f"network/{name}": content for name, content in files.items()},
        job=f"surrogate/{output}",
        notes={"model": model, "stop": rows["stop"].iloc[0]},
    )


def _over_seeds(options: Scenario, history: pd.DataFrame) -> dict[str, float]:
    """Training error of all seeds after the iterations allowed for each."""
    own = options.surrogate
    allowed = min(own.iterations, own.seed_iterations) if len(own.seeds) > 1 else own.iterations
    history = history[(history["model"] == "network") & (history["iteration"] <= allowed)]
    last = history.groupby("seed")["mse"].last()
    found = {"median": last.median(), "lowest": last.min(), "highest": last.max()}
    return {"seeds": len(last), "seeds_iterations": allowed} | {
        f"seeds_mse_{end}": mse for end, mse in found.items()
    }


def _kinematics(finished: _Finished) -> list[Record]:
    errors, contradictions = (
        finished.read("kinematics_errors"),
        finished.read("kinematics_contradictions"),
    )
    both = [
        errors,
        contradictions.assign(source=contradictions["surrogate"] + " contradicts itself"),
    ]
    first = pd.concat(both).query("region == 'first_revolution'")
    names = first["source"] + "/" + first["quantity"] + "_rms_over_range"
    metrics = dict(zip(names, first["rms_over_range"], strict=True))
    read = ["trajectory", *finished.names("fit")]
    written = ["kinematics", "kinematics_errors", "kinematics_contradictions"]
    return [finished.record("kinematics", metrics=metrics, read=read, written=written)]


def _optimise(finished: _Finished) -> list[Record]:
    """The run of the stage repeats the paper's optimum (networks, first box, genetic), without
    networks that of the page; in a main box without an optimum it has the reason instead.
    """
    points, box = finished.read("optimise_optima"), next(iter(finished.options.optimise.boxes))
    optima = points[
        points["point"] == points["source"] + "_" + points["box"] + "_" + points["method"]
    ]
    unmet = points[points["point"] == f"{LEAST_FORCE}_{box}"]
    if optima.empty and unmet.empty:
        return []
    wanted = (
        optima["source"].str.startswith("network")
        & (optima["box"] == box)
        & (optima["method"] == "genetic")
    )
    read = ["trajectory", *finished.names("fit")]
    written = [name for name in finished.files if name.startswith("optimise_")]
    own = finished.record("optimise", read=read, written=written)
    nested = [_optimum(finished, row, own.params) for row in optima.to_dict("records")]
    if len(unmet):
        return [replace(own, notes={"box": box, "status": unmet["status"].iloc[0]}), *nested]
    if not wanted.any():
        frames = {table: finished.read(table) for table in chosen_lengths.NEEDED}
        wanted = (
            optima["point"] == chosen_lengths.choose_lengths(frames, finished.options).row["point"]
        )
    main = nested[int(np.argmax(wanted.to_numpy()))]
    return [replace(own, metrics=main.metrics, curves=main.curves, notes=main.notes), *nested]


def _optimum(finished: _Finished, row: dict, params: Mapping[str, str]) -> Record:
    mechanism, point = finished.options.mechanism.applied(), row["point"]
    counts = ("evaluations", "evaluations_within_1_percent", "evaluations_within_0_1_percent")
    metrics = numbers(OPTIMISE_OPTIMA, row, "crank_length", "rod_length", "invariant", *counts)
    metrics["ratio"] = row["ratio"]
    for link, original in (("crank", mechanism.crank.length), ("rod", mechanism.rod.length)):
        # MLflow's pages would round a relative change of 0.001 away
        metrics[f"{link}_length_change_um"] = round(1e6 * (row[f"{link}_length"] - original), 3)
    sizes = (*MEASURES, *(f"{measure}_reduction" for measure in MEASURES))
    metrics |= numbers(OPTIMISE_OPTIMA, row, *sizes, section="frozen/")
    name = finished.options.optimise.objective
    is_angle, unit = name == "transmission_angle", _UNITS.get(name, "rad2")
    if not is_angle:
        metrics[f"search/{name}_{unit}"] = row["objective"]
        metrics[f"search/{name}_reduction_percent"] = 100 * row["objective_reduction"]
    resimulated, worth = finished.read("optimise_resimulated"), finished.read("optimise_worth")
    for again in resimulated[resimulated["point"] == point].to_dict("records"):
        metrics |= _resimulated(**again)
    names = ("smallest_transmission_angle", "largest_departure", "stroke_change")
    names += ("outer_dead_centre_change", "inner_dead_centre_change")
    for lengths in worth[worth["point"] == point].to_dict("records"):
        metrics |= numbers(OPTIMISE_WORTH, lengths, *names, section=f"{lengths['cycle']}_cycle/")
    notes = {
        name: row[name] or ""
        for name in ("point", "source", "box", "method", "active_bounds", "status")
    }
    path = _path(finished, row)
    curve = f"{'sum_of_squares' if is_angle else name}_{unit}"
    return Record(
        "optimise", point, params, metrics, {curve: path} if len(path) else {}, notes=notes
    )


def _resimulated(stretch: str, measure: str, **row: Any) -> dict[str, float]:
    """Re-simulated reductions with their spread, and errors; those of the RMS error and of another
    objective also as ``gain_*``.
    """
    metrics, section = {}, f"resimulated_{stretch}/{measure}"
    for end in ("", "_low", "_high"):
        metrics[f"{section}_reduction{end}_percent"] = 100 * row[f"reduction{end}"]
        if measure == "rms":
            over = {"window": "window", "settled": "revolution"}[stretch]
            metrics[f"gain_{over}{end}_percent"] = round(100 * row[f"reduction{end}"], 4)
        elif measure in _UNITS:
            metrics[f"gain_{measure}{end}_percent"] = round(100 * row[f"reduction{end}"], 4)
    estimate = "of_search" if measure in _UNITS else "if_frozen"
    metrics[f"{section}_reduction_{estimate}_percent"] = 100 * row["frozen_reduction"]
    metrics[f"{section}_share_better"] = row["share_better"]
    unit, factor = ({"sum_of_squares": "rad2"} | _UNITS).get(measure, "deg"), 1.0
    if unit == "deg":
        factor = np.rad2deg(1.0)
    return metrics | {
        f"{section}_{name}_{unit}": factor * row[name] for name in ("error", "original_error")
    }


def _path(finished: _Finished, row: dict) -> pd.Series:
    """The objective during the search: best of each generation, or along the path of the best
    start."""
    table, step = {"genetic": ("population", "generation"), "local": ("paths", "iteration")}[
        row["method"]
    ]
    rows = finished.read(f"optimise_{table}")
    rows = rows[(rows["source"] == row["source"]) & (rows["box"] == row["box"])]
    if row["method"] == "local" and len(rows):
        rows = rows[
            rows["start"]
            == rows.sort_values("iteration").groupby("start")["objective"].last().idxmin()
        ]
    return rows.groupby(step)["objective"].min()


def _compare(finished: _Finished) -> list[Record]:
    rows = finished.read("comparison")
    found = list(rows["kind"] + " " + rows["verdict"])
    metrics = {f"verdicts/{verdict}": found.count(verdict) for verdict in _VERDICTS}
    for row in rows.to_dict("records"):
        name = " ".join(re.sub(r"[^\w\-. ]", "", row["item"]).split())[
            :200
        ]  # MLflow rejects other characters
        metrics |= {
            f"{column}/{name}": row[column] for column in ("ours", "ratio") if pd.notna(row[column])
        }
    text = finished.files["comparison"].with_suffix(".md")  # written by the stage next to the table
    files = {text.name: text} if text.is_file() else {}
    return [finished.record("compare", metrics=metrics, written=["comparison"], files=files)]
