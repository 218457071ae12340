"""What is worth tracking of each stage: from tables to records, one function a stage."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.config import Scenario
from jointgap.config.scenario import SECTIONS
from jointgap.track import weights
from jointgap.track.costs import read_costs
from jointgap.track.record import Dataset, Record, flatten

Tables = Mapping[str, Path]
Costs = Mapping[str, Mapping[str, float]]


def records(options: Scenario, given: Tables, figures: Sequence[Path], benchmarks: Sequence[Path]) -> list[Record]:
    """The runs that one scenario's finished tables make, the stage's own run before those nested in it."""
    costs = read_costs(benchmarks)
    found: list[Record] = []
    for stage in STAGES:
        found += stage(options, given, costs)
    if figures:
        found.append(_figures(options, figures, costs))
    return found


def _configuration(options: Scenario, stage: str) -> dict:
    """The options that the stage reads, as parameters and as a file."""
    sections = set(SECTIONS[stage]) & set(SECTIONS["track"]) - {"description"}  # others hold their defaults only
    included = options.model_dump(mode="json", include=sections)
    # the joints carry their contact; by name it would give each scenario parameters of its own
    included["mechanism"].pop("contacts")
    text = options.model_dump_json(include=sections, indent=2) + "\n"
    return {"params": flatten(included), "files": {"options.json": text.encode()}}


def _datasets(given: Tables, inputs: Sequence[str], results: Sequence[str] = ()) -> tuple[Dataset, ...]:
    """Those of the named tables that were given."""
    return tuple(
        Dataset(name, given[name], context)
        for context, names in (("input", inputs), ("result", results))
        for name in names
        if name in given
    )


def _parts(given: Tables, table: str) -> dict[str, str]:
    """Names ``table/part`` by part, in the order given."""
    return {name.partition("/")[2]: name for name in given if name.startswith(f"{table}/")}


def _simulate(options: Scenario, given: Tables, costs: Costs) -> list[Record]:
    if "trajectory" not in given:
        return []
    samples = tables.read(tables.TRAJECTORY, given["trajectory"])
    metrics = {
        "samples": len(samples),
        "smallest_transmission_angle_deg": np.rad2deg(samples.transmission_angle.min()),
        "largest_transmission_angle_deg": np.rad2deg(samples.transmission_angle.max()),
        "peak_slider_acceleration_m_s2": samples.slider_acceleration.abs().max(),
        "peak_crank_torque_N_m": samples.crank_torque.abs().max(),
    }
    for joint in ("crank_pin", "piston_pin"):
        force = samples[f"{joint}_normal_force"]
        metrics[f"{joint}_peak_normal_force_N"] = force.max()
        metrics[f"{joint}_contact_share"] = (force > 0).mean()
    if "events" in given:
        metrics |= _event_metrics(tables.read(tables.EVENTS, given["events"]))
    return [
        Record(
            "simulate",
            metrics=metrics,
            datasets=_datasets(given, (), ("trajectory", "events")),
            costs=costs.get("simulate", {}),
            **_configuration(options, "simulate"),
        )
    ]


def _event_metrics(events: pd.DataFrame) -> dict[str, float]:
    metrics = {}
    for joint in ("crank_pin", "piston_pin"):
        impacts = events[(events.joint == joint) & (events.event == "impact")]
        metrics[f"{joint}_impacts"] = len(impacts)
        metrics[f"{joint}_peak_approach_speed_m_s"] = impacts.approach_speed.max() if len(impacts) else 0.0
    return metrics


def _surrogate(options: Scenario, given: Tables, costs: Costs) -> list[Record]:
    fits = _parts(given, "fit")
    if not fits:
        return []
    configuration = _configuration(options, "surrogate")
    nested = []
    for output, name in fits.items():
        fit = tables.read(tables.FIT, given[name])
        default = fit[fit.seed == options.surrogate.seeds[0]]
        network = weights.to_files(weights.from_table(default), output)
        nested.append(
            Record(
                "surrogate",
                output,
                datasets=_datasets(given, ("trajectory",), (name,)),
                costs=costs.get(f"surrogate/{output}", {}),
                params=configuration["params"],
                files={f"network/{file}": content for file, content in network.items()},
            )
        )
    return [Record("surrogate", **configuration), *nested]


def _figures(options: Scenario, figures: Sequence[Path], costs: Costs) -> Record:
    configuration = _configuration(options, "figures")
    files = {f"figures/{path.name}": path for path in figures}
    return Record(
        "figures",
        metrics={"figures": len(figures)},
        params=configuration["params"],
        files=configuration["files"] | files,
        costs=costs.get("figures", {}),
    )


STAGES = (_simulate, _surrogate)
