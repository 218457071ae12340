"""MLflow runs of a scenario: one per stage, with nested runs per network and per pair of lengths.

The part of a metric's name before the slash is its section on MLflow's pages.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core import parquet, schema
from jointgap.core.publish import Dataset, Record, configuration, costs, numbers
from jointgap.core.schema import OPTIMISE_OPTIMA, OPTIMISE_WORTH
from jointgap.lengths.objective import GOALS, MEASURES
from jointgap.lengths.region import LEAST_FORCE
from jointgap.networks.network import Network, to_files
from jointgap.scenario.chosen_lengths import NEEDED, choose_lengths
from jointgap.scenario.figure_data import MODES

_UNUSED = ["undefined_points", "range", "iterations_to_paper", "held_out_mse_at_paper", "seed"]
_OVERALL = {"weights", "iterations", "paper_mse"}  # equal in all regions
_VERDICTS = {
    "number": ("agrees", "differs", "reached", "missed", "undecided"),
    "claim": ("holds", "does not hold", "undecided"),
}


@dataclass(frozen=True)
class _Results:
    """Results of the stages of a scenario."""

    scenario: Scenario
    sections: Mapping[str, Sequence[str]]  # of the configuration that each stage reads
    files: Mapping[str, Path]  # Parquet files by ``table`` or ``table/output``
    folder: Path

    def names(self, table: str) -> list[str]:
        """Names of the files of a table, one per output where there are several."""
        return [name for name in self.files if name.partition("/")[0] == table]

    def read(self, table: str, part: str = "") -> pd.DataFrame:
        """All files of a table, or one `part`, concatenated; empty without files."""
        names = self.names(table)
        if part:
            names = [name for name in names if name == f"{table}/{part}"]
        empty = pd.DataFrame(columns=schema.TABLES[table].names)
        frames = [parquet.read(schema.TABLES[table], self.files[name]) for name in names]
        return pd.concat(frames, ignore_index=True) if frames else empty

    def record(
        self, stage: str, output: str = "", *, read=(), written=(), files=None, job="", **content
    ) -> Record:
        """A run with its configuration, datasets and costs (of the `job`, by default the
        stage's)."""
        sections = set(self.sections[stage]) & set(self.sections["track"]) - {"description"}
        options = configuration(self.scenario, sections)
        contexts = dict.fromkeys(read, "input") | dict.fromkeys(written, "result")
        benchmark = self.folder / "benchmarks" / (job or stage)
        benchmarks = [benchmark.with_suffix(".tsv"), *sorted(benchmark.glob("*.tsv"))]
        return Record(
            stage,
            output,
            options["params"],
            datasets=tuple(
                Dataset(name, self.files[name], context)
                for name, context in contexts.items()
                if name in self.files
            ),
            files=options["files"] | (files or {}),
            costs=costs([path for path in benchmarks if path.is_file()]),
            **content,
        )


def scenario_records(
    scenario: Scenario,
    sections: Mapping[str, Sequence[str]],
    files: Mapping[str, Path],
    folder: Path,
) -> list[Record]:
    """The runs of one scenario, each before its nested runs.

    Parquet `files` by ``table`` or ``table/output``; figures and benchmarks from `folder`.
    """
    results = _Results(scenario, sections, files, folder)
    runs = {
        "trajectory": _simulate,
        "fit_errors": _surrogate,
        "kinematics_errors": _kinematics,
        "optimise_optima": _optimise,
        "comparison": _compare,
    }
    records = []
    for table, run in runs.items():
        if results.names(table):
            records += run(results)
    formats = (".svg", ".png", ".gif")
    pictures = [path for path in sorted((folder / "figures").glob("*")) if path.suffix in formats]
    if pictures:
        metrics = {"figures": len({path.stem for path in pictures})}
        artifacts = {f"figures/{path.name}": path for path in pictures}
        records.append(results.record("figures", metrics=metrics, files=artifacts))
    return records


def _simulate(results: _Results) -> Iterator[Record]:
    samples, events = results.read("trajectory"), results.read("events")
    angle = np.degrees(samples["transmission_angle"])
    speed = 30.0 / np.pi * samples["crank_speed"]
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
    for joint in results.scenario.mechanism.applied().loose:
        metrics[f"{joint}_peak_normal_force_N"] = samples[f"{joint}_normal_force"].max()
        for mode in MODES:
            metrics[f"{joint}_{mode}_share"] = (samples[f"{joint}_mode"] == mode).mean()
        if results.names("events"):
            contacts = events[events["joint"] == joint]
            approach = contacts.loc[contacts["event"] == "impact", "approach_speed"]
            impulse = contacts.loc[contacts["maxima"] <= 1, "impulse"]
            metrics[f"{joint}_impacts"] = len(approach)
            metrics[f"{joint}_peak_approach_speed_m_s"] = max([0.0, *approach])
            metrics[f"{joint}_largest_impulse_N_s"] = max([0.0, *impulse])
    yield results.record("simulate", metrics=metrics, written=["trajectory", "events"])


def _surrogate(results: _Results) -> list[Record]:
    errors = results.read("fit_errors")
    errors = errors[errors["seed"] == results.scenario.surrogate.seeds[0]]
    metrics, curves = {}, {}
    for model, rows in errors[errors["region"] == "all"].groupby("model", sort=False):
        is_better = rows["held_out_mse"] <= rows["spline_held_out_mse"]
        metrics[f"{model}_outputs"] = len(rows)
        metrics[f"{model}_outputs_of_the_paper"] = rows["paper_mse"].notna().sum()
        metrics[f"{model}_outputs_better_than_spline"] = is_better.sum()
        for kind in ("training", "held_out"):
            error = rows[f"{kind}_mse"]
            metrics[f"{model}_outputs_{kind}_at_paper"] = (error <= rows["paper_mse"]).sum()
            metrics[f"{model}_largest_{kind}_mse"] = error.max()
    nested = []
    for (model, output), rows in errors.groupby(["model", "output"], sort=False):
        nested.append(_network(results, model, output, rows))
        prefix = "log10_" if model == "network" else f"log10_{model}_"
        for name in ("mse", "mse_held_out"):
            if f"log10_{name}" in nested[-1].curves:
                curves[f"{prefix}{name}/{output}"] = nested[-1].curves[f"log10_{name}"]
    record = results.record(
        "surrogate",
        metrics=metrics,
        curves=curves,
        read=["trajectory"],
        written=results.names("fit_errors"),
    )
    return [record, *nested]


def _network(results: _Results, model: str, output: str, rows: pd.DataFrame) -> Record:
    """One output of one model, with its curves and weights."""
    seed = results.scenario.surrogate.seeds[0]
    metrics, curves, files = {}, {}, {}
    errors = rows.select_dtypes("number").drop(columns=_UNUSED, errors="ignore").astype(float)
    for region, row in zip(rows["region"], errors.to_dict("records"), strict=True):
        for name, value in row.items():
            is_common = region == "all" or name in _OVERALL
            metrics[name if is_common else f"{name}_{region}"] = value
    for name in errors.filter(regex="mse$"):
        if metrics[name] > 0:
            metrics[f"log10_{name}"] = np.log10(metrics[name])
    fit, history = results.read("fit", output), results.read("fit_history", output)
    if len(fit):
        files = to_files(Network.from_frame(fit, seed, model), output)
    if len(history):
        training = history[(history["model"] == model) & (history["seed"] == seed)]
        training = training.set_index("iteration")
        curves = {"mse": training["mse"], "mse_held_out": training["held_out_mse"]}
        curves = {name: curve.dropna() for name, curve in curves.items()}
        with np.errstate(divide="ignore"):  # log10(0): dropped later
            curves |= {f"log10_{name}": np.log10(curve) for name, curve in curves.items()}
        if model == "network":
            metrics |= _over_seeds(results.scenario, history)
    return results.record(
        "surrogate",
        output if model == "network" else f"{model} {output}",
        metrics=metrics,
        curves=curves,
        read=["trajectory"],
        written=[f"{table}/{output}" for table in ("fit_errors", "fit", "fit_history")],
        files={f"network/{name}": content for name, content in files.items()},
        job=f"surrogate/{output}",
        notes={"model": model, "stop": rows["stop"].iloc[0]},
    )


def _over_seeds(scenario: Scenario, history: pd.DataFrame) -> dict[str, float]:
    """Training error of all seeds after the iterations allowed for each."""
    options = scenario.surrogate
    iterations = options.iterations
    if len(options.seeds) > 1:
        iterations = min(iterations, options.seed_iterations)
    history = history[(history["model"] == "network") & (history["iteration"] <= iterations)]
    mse = history.groupby("seed")["mse"].last()
    return {
        "seeds": len(mse),
        "seeds_iterations": iterations,
        "seeds_mse_median": mse.median(),
        "seeds_mse_lowest": mse.min(),
        "seeds_mse_highest": mse.max(),
    }


def _kinematics(results: _Results) -> Iterator[Record]:
    contradictions = results.read("kinematics_contradictions")
    contradictions["source"] = contradictions["surrogate"] + " contradicts itself"
    errors = pd.concat([results.read("kinematics_errors"), contradictions])
    errors = errors.query("region == 'first_revolution'")
    names = errors["source"] + "/" + errors["quantity"] + "_rms_over_range"
    yield results.record(
        "kinematics",
        metrics=dict(zip(names, errors["rms_over_range"], strict=True)),
        read=["trajectory", *results.names("fit")],
        written=["kinematics", "kinematics_errors", "kinematics_contradictions"],
    )


def _optimise(results: _Results) -> list[Record]:
    """The run of the stage repeats the paper's optimum (networks, first box, genetic), without
    networks the chosen lengths; in a main box without an optimum it has the reason instead.
    """
    points, box = results.read("optimise_optima"), next(iter(results.scenario.optimise.boxes))
    names = points["source"] + "_" + points["box"] + "_" + points["method"]
    optima = points[points["point"] == names]
    infeasible = points[points["point"] == f"{LEAST_FORCE}_{box}"]
    if optima.empty and infeasible.empty:
        return []
    record = results.record(
        "optimise",
        read=["trajectory", *results.names("fit")],
        written=[name for name in results.files if name.startswith("optimise_")],
    )
    nested = {row["point"]: _optimum(results, row, record) for row in optima.to_dict("records")}
    if len(infeasible):
        notes = {"box": box, "status": infeasible["status"].iloc[0]}
        return [replace(record, notes=notes), *nested.values()]
    main = f"networks_{box}_genetic"
    if main not in nested:
        tables = {table: results.read(table) for table in NEEDED}
        main = choose_lengths(tables, results.scenario).row["point"]
    content = {name: getattr(nested[main], name) for name in ("metrics", "curves", "notes")}
    return [replace(record, **content), *nested.values()]


def _optimum(results: _Results, row: dict, stage: Record) -> Record:
    """The run of a pair of lengths: a `row` of the table optimise_optima."""
    mechanism, point = results.scenario.mechanism.applied(), row["point"]
    counts = ("evaluations", "evaluations_within_1_percent", "evaluations_within_0_1_percent")
    metrics = numbers(OPTIMISE_OPTIMA, row, "crank_length", "rod_length", "invariant", *counts)
    metrics["ratio"] = row["ratio"]
    for link in ("crank", "rod"):
        # MLflow's pages would round a relative change of 0.001 away
        change = row[f"{link}_length"] - getattr(mechanism, link).length
        metrics[f"{link}_length_change_um"] = round(1e6 * change, 3)
    sizes = (*MEASURES, *(f"{measure}_reduction" for measure in MEASURES))
    metrics |= numbers(OPTIMISE_OPTIMA, row, *sizes, section="frozen/")
    objective = results.scenario.optimise.objective
    curve = "sum_of_squares_rad2"
    if objective != "transmission_angle":
        curve = f"{objective}_{GOALS[objective].unit.replace(' ', '_')}"
        metrics[f"search/{curve}"] = row["objective"]
        metrics[f"search/{objective}_reduction_percent"] = 100 * row["objective_reduction"]
    for gain in results.read("optimise_resimulated").query(f"point == {point!r}").iloc:
        metrics |= _resimulated(gain)
    names = ("smallest_transmission_angle", "largest_departure", "stroke_change")
    names += ("outer_dead_centre_change", "inner_dead_centre_change")
    for cycle in results.read("optimise_worth").query(f"point == {point!r}").iloc:
        metrics |= numbers(OPTIMISE_WORTH, cycle, *names, section=f"{cycle['cycle']}_cycle/")
    path = _path(results, row)
    notes = ("point", "source", "box", "method", "active_bounds", "status")
    return Record(
        "optimise",
        point,
        stage.params,
        metrics,
        {curve: path} if len(path) else {},
        notes={name: row[name] or "" for name in notes},
    )


def _resimulated(gain: pd.Series) -> dict[str, float]:
    """Re-simulated reductions with their spread, and errors; those of the RMS error and of another
    objective also as ``gain_*``.
    """
    measure, section = gain["measure"], f"resimulated_{gain['stretch']}/{gain['measure']}"
    short, estimate, unit, factor = "", "if_frozen", "deg", np.rad2deg(1.0)
    if measure == "rms":
        short = {"window": "gain_window", "settled": "gain_revolution"}[gain["stretch"]]
    elif measure == "sum_of_squares":
        unit, factor = "rad2", 1.0
    elif measure not in MEASURES:
        short, estimate = f"gain_{measure}", "of_search"
        unit, factor = GOALS[measure].unit.replace(" ", "_"), 1.0
    metrics = {
        f"{section}_reduction_{estimate}_percent": 100 * gain["frozen_reduction"],
        f"{section}_share_better": gain["share_better"],
        f"{section}_error_{unit}": factor * gain["error"],
        f"{section}_original_error_{unit}": factor * gain["original_error"],
    }
    for end in ("", "_low", "_high"):
        reduction = 100 * gain[f"reduction{end}"]
        metrics[f"{section}_reduction{end}_percent"] = reduction
        if short:
            metrics[f"{short}{end}_percent"] = round(reduction, 4)
    return metrics


def _path(results: _Results, row: dict) -> pd.Series:
    """The objective during the search: best of each generation, or along the path of the best
    start."""
    search = f"source == {row['source']!r} and box == {row['box']!r}"
    if row["method"] == "genetic":
        population = results.read("optimise_population").query(search)
        return population.groupby("generation")["objective"].min()
    paths = results.read("optimise_paths").query(search).set_index("iteration").sort_index()
    if paths.empty:
        return paths["objective"]
    best = paths.groupby("start")["objective"].last().idxmin()
    return paths.loc[paths["start"] == best, "objective"]


def _compare(results: _Results) -> Iterator[Record]:
    rows = results.read("comparison")
    metrics = {
        f"verdicts/{kind} {verdict}": ((rows["kind"] == kind) & (rows["verdict"] == verdict)).sum()
        for kind, verdicts in _VERDICTS.items()
        for verdict in verdicts
    }
    for row in rows.to_dict("records"):
        # MLflow rejects other characters
        name = " ".join(re.sub(r"[^\w\-. ]", "", row["item"]).split())[:200]
        for column in ("ours", "ratio"):
            if pd.notna(row[column]):
                metrics[f"{column}/{name}"] = row[column]
    page = results.files["comparison"].with_suffix(".md")  # written by the stage next to the table
    files = {page.name: page} if page.is_file() else {}
    yield results.record("compare", metrics=metrics, written=["comparison"], files=files)
