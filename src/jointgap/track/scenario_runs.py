"""What is tracked of a scenario: from finished tables to records, a function a stage. The larger stages have modules of
their own.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.tables import EVENTS, TRAJECTORY
from jointgap.tables.compare_tables import COMPARISON
from jointgap.tables.kinematics_tables import KINEMATICS_CONTRADICTIONS, KINEMATICS_ERRORS
from jointgap.tables.surrogate_tables import CLEARANCE_FIT, FIT
from jointgap.track.finished_tables import FinishedTables, TablePaths, read_costs
from jointgap.track.optimise_runs import optimise_records
from jointgap.track.run_record import Record
from jointgap.track.surrogate_runs import surrogate_records

MODES = ("flight", "impact", "contact")
VERDICTS = {
    "number": ("agrees", "differs", "reached", "missed", "cannot be told"),
    "claim": ("holds", "does not hold", "cannot be told"),
}


def records(
    options: Scenario,
    sections: Mapping[str, Sequence[str]],
    tables: TablePaths,
    figures: Sequence[Path],
    benchmarks: Sequence[Path],
) -> list[Record]:
    """The runs that one scenario's finished tables make, a stage's own run before those nested in it."""
    finished = FinishedTables(options, sections, dict(tables), read_costs(benchmarks))
    stages = (_simulate_records, surrogate_records, _kinematics_records, optimise_records, _compare_records)
    return [record for stage in stages for record in stage(finished)] + _figure_records(finished, figures)


def _simulate_records(finished: FinishedTables) -> list[Record]:
    """Simulation: impacts, forces, modes, angles."""
    if not finished.has(TRAJECTORY):
        return []
    loose = finished.options.mechanism.applied().loose
    metrics = _motion(finished.read(TRAJECTORY), loose)
    if finished.has(EVENTS):
        metrics |= _impacts(finished.read(EVENTS), loose)
    datasets = finished.datasets([], ["trajectory", "events"])
    return [
        Record(
            "simulate",
            metrics=metrics,
            datasets=datasets,
            costs=finished.cost("simulate"),
            **finished.configuration("simulate"),
        )
    ]


def _motion(samples: pd.DataFrame, loose: tuple[str, ...]) -> dict[str, float]:
    metrics = {
        "samples": len(samples),
        "smallest_transmission_angle_deg": np.rad2deg(samples["transmission_angle"].min()),
        "largest_transmission_angle_deg": np.rad2deg(samples["transmission_angle"].max()),
        "peak_slider_acceleration_m_s2": samples["slider_acceleration"].abs().max(),
        "peak_crank_torque_N_m": samples["crank_torque"].abs().max(),
        "peak_guide_moment_N_m": samples["guide_moment"].abs().max(),
        "lowest_crank_speed_rpm": 30.0 / np.pi * samples["crank_speed"].min(),
        "highest_crank_speed_rpm": 30.0 / np.pi * samples["crank_speed"].max(),
    }
    for joint in loose:
        metrics[f"{joint}_peak_normal_force_N"] = samples[f"{joint}_normal_force"].max()
        metrics |= {f"{joint}_{mode}_share": (samples[f"{joint}_mode"] == mode).mean() for mode in MODES}
    return metrics


def _impacts(events: pd.DataFrame, loose: tuple[str, ...]) -> dict[str, float]:
    metrics = {}
    for joint in loose:
        impacts = events[(events["joint"] == joint) & (events["event"] == "impact")]
        metrics[f"{joint}_impacts"] = len(impacts)
        metrics[f"{joint}_peak_approach_speed_m_s"] = impacts["approach_speed"].max() if len(impacts) else 0.0
        rebounds = events[(events["joint"] == joint) & (events["maxima"] <= 1)]
        metrics[f"{joint}_largest_impulse_N_s"] = rebounds["impulse"].max() if len(rebounds) else 0.0
    return metrics


def _kinematics_records(finished: FinishedTables) -> list[Record]:
    """Kinematics: how far each source of motion is from the simulation, how far the fits contradict each other.

    Metrics begin with the source, so that the interface files them under it.
    """
    if not finished.has(KINEMATICS_ERRORS):
        return []
    metrics = {}
    errors = finished.read(KINEMATICS_ERRORS)
    for row in errors[errors["region"] == "first_revolution"].to_dict("records"):
        metrics[f"{row['source']}/{row['quantity']}_rms_over_range"] = row["rms_over_range"]
    if finished.has(KINEMATICS_CONTRADICTIONS):
        contradictions = finished.read(KINEMATICS_CONTRADICTIONS)
        for row in contradictions[contradictions["region"] == "first_revolution"].to_dict("records"):
            key = f"{row['surrogate']} contradicts itself/{row['quantity']}_rms_over_range"
            metrics[key] = row["rms_over_range"]
    fits = finished.names(FIT) + finished.names(CLEARANCE_FIT)
    results = ["kinematics", "kinematics_errors", "kinematics_contradictions"]
    return [
        Record(
            "kinematics",
            metrics=metrics,
            datasets=finished.datasets(["trajectory", *fits], results),
            costs=finished.cost("kinematics"),
            **finished.configuration("kinematics"),
        )
    ]


def _compare_records(finished: FinishedTables) -> list[Record]:
    """Comparison with the paper: verdicts counted, our numbers and their ratios, the text."""
    if not finished.has(COMPARISON):
        return []
    rows = finished.read(COMPARISON)
    metrics = {
        f"verdicts/{kind} {verdict}": int(((rows["kind"] == kind) & (rows["verdict"] == verdict)).sum())
        for kind, verdicts in VERDICTS.items()
        for verdict in verdicts
    }
    for row in rows.to_dict("records"):
        metrics |= {
            f"{column}/{_metric_name(row['item'])}": row[column]
            for column in ("ours", "ratio")
            if pd.notna(row[column])
        }
    configuration = finished.configuration("compare")
    text = finished.tables[COMPARISON.name].with_suffix(".md")  # the stage writes it beside the table
    return [
        Record(
            "compare",
            metrics=metrics,
            datasets=finished.datasets([], [COMPARISON.name]),
            costs=finished.cost("compare"),
            params=configuration["params"],
            files=configuration["files"] | ({text.name: text} if text.is_file() else {}),
        )
    ]


def _metric_name(item: str) -> str:
    """`item` without the signs that MLflow does not take in a metric's name."""
    return " ".join(re.sub(r"[^\w\-. ]", "", item).split())[:200]


def _figure_records(finished: FinishedTables, figures: Sequence[Path]) -> list[Record]:
    """Figures: one run that holds them all, if there are any."""
    if not figures:
        return []
    configuration = finished.configuration("figures")
    files = configuration["files"] | {f"figures/{path.name}": path for path in figures}
    metrics = {"figures": len({path.stem for path in figures})}
    return [
        Record("figures", metrics=metrics, params=configuration["params"], files=files, costs=finished.cost("figures"))
    ]
