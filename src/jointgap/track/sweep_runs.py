"""Many designs: one run for all that a scenario asks of them, not one a design."""

from collections.abc import Iterable
from pathlib import Path

from jointgap.config import Scenario
from jointgap.core.errors import InputError
from jointgap.track.finished_tables import read_costs
from jointgap.track.run_parameters import run_parameters
from jointgap.track.run_record import Dataset, Record
from jointgap.track.sweep_run_parts import PARTS

_SHOWN = (".md", ".html", ".svg", ".png", ".yaml")
_OF_A_PARAMETER = {"clearance": "clearance_mm", "speed": "speed_rpm"}
"""What a run's parameter is called that one of many designs takes the place of, where the names differ."""


def sweep_record(options: Scenario, folder: Path) -> Record:
    """The run of a scenario's many designs, with what each stage adds that the scenario asks for."""
    parts = {name: part for name, of in PARTS.items() if (part := of(options, folder)) is not None}
    if not parts:
        raise InputError(
            "sweep.parameters, optimise_robust.uncertain, design_networks.parameters: name nothing, so there is "
            "nothing to publish; give the options that the designs were made with"
        )
    params, metrics, datasets = run_parameters(options), {}, []
    for part in parts.values():
        for key in part.varied:
            params.pop(_OF_A_PARAMETER.get(key, key), None)
    for part in parts.values():
        params |= part.params
        metrics |= part.metrics
        datasets += [Dataset(name, folder / path, "result") for name, path in part.tables.items()]
    return Record(
        "sweep",
        params=params,
        metrics=metrics,
        datasets=tuple(datasets),
        files={"options.json": _options(options)} | _pages(folder, parts),
        costs=_costs(folder, parts),
    )


def _options(options: Scenario) -> bytes:
    sections = options.model_fields_set - {"description"}
    return (options.model_dump_json(include=sections, by_alias=True, indent=2) + "\n").encode()


def _pages(folder: Path, parts: Iterable[str]) -> dict[str, Path]:
    """Pages and figures, by their place in the scenario's folder."""
    found = (path for part in parts for path in sorted((folder / part).rglob("*")) if path.suffix in _SHOWN)
    return {str(path.relative_to(folder)): path for path in found}


def _costs(folder: Path, parts: Iterable[str]) -> dict[str, float]:
    """What the stages cost that are one job."""
    costs = read_costs([path for part in parts if (path := folder / f"benchmarks/{part}.tsv").is_file()])
    return {f"{stage}_{name}": value for stage, cost in costs.items() for name, value in cost.items()}
