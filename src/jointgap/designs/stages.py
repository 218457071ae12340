"""The stages for many designs of a scenario: the sweep, and the studies of its designs.

A study is a section of a scenario, its tables, a stage and a module of the same name, which may
have `check(scenario)`, which rejects infeasible options.
"""

import json
import shutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any

from jointgap.core import schema
from jointgap.core.files import check_writable, write_text
from jointgap.core.schema import TABLES
from jointgap.core.stage import Option, ResultsOption, ScenarioOptions, Stages, Workers

if TYPE_CHECKING:  # slow to load
    from jointgap.config import Scenario
    from jointgap.config.scenario_results import ScenarioResults
    from jointgap.core.publish import Record


def open_results(options: ScenarioOptions, results: ResultsOption) -> "ScenarioResults":
    """The results of a scenario."""
    from jointgap.config import scenario_results

    return scenario_results.open_results(options, results)


DESIGN_STAGES = Stages(open_results)

SWEPT_DESIGNS = "sweep/designs"
"""Dataset of `jointgap sweep` in the folder of a scenario."""
_SWEPT = ("mechanism", "simulate", "sweep")


def _study(
    sections: tuple[str, ...], files: tuple[str, ...] = (), **record: Any
) -> Callable[[Callable], Callable]:
    """A decorator for the stage of a study, which writes the tables of its folder, a page, its
    numbers and further `files`."""

    def register(function: Callable) -> Callable:
        name = function.__name__
        tables = tuple(table for table in TABLES.values() if table.path.startswith(f"{name}/"))
        paths = ("summary.md", "summary.html", "summary.json", *files)
        attributes = {"does": name.replace("_", " "), "memory": 2500} | record
        return DESIGN_STAGES.stage(
            writes=tables,
            files=tuple(f"{name}/{path}" for path in paths),
            sections=sections,
            **attributes,
        )(function)

    return register


def studies_of(scenario: "Scenario", checked: bool = False) -> list[str]:
    """Names of the stages that the sections of a scenario request; InputError where one, `checked`,
    is infeasible."""
    from jointgap.config.load import validate

    requested = []
    for name, (stage,) in DESIGN_STAGES.jobs().items():
        section = getattr(scenario, name.replace("-", "_"), None)
        keys = ("parameters", "uncertain")
        if section is None or not all(getattr(section, key, True) for key in keys):
            continue
        if checked and (check := getattr(_module(name), "check", None)):
            # the sections that the job reads, with their defaults
            sections = json.loads(stage.options(scenario))
            check(validate(type(scenario), sections, "its configuration"))
        if scenario.sweep.parameters or "sweep" not in stage.sections:
            requested.append(name)
    return requested


def _module(name: str) -> ModuleType:
    return import_module(f"jointgap.designs.{name.replace('-', '_')}")


@DESIGN_STAGES.stage(sections=_SWEPT)
def sweep_designs(
    results: "ScenarioResults",
    first: Annotated[
        int, Option("--first", type=0, required=True, help="Number of the first design, from 0.")
    ],
    number: Annotated[int, Option("--number", type=1, required=True, help="Number of designs.")],
    designs: Annotated[
        Path,
        Option(
            "--designs",
            type="file",
            required=True,
            help="Parquet file to write: the designs and their measures.",
        ),
    ],
    workers: Workers,
) -> None:
    """Simulate and measure a part of the sweep's designs, for `jointgap sweep`; designs in the file
    are kept."""
    from jointgap.designs.dataset import write_designs
    from jointgap.designs.sampling import designs_of

    code = DESIGN_STAGES["sweep-designs"].digest
    write_designs(designs_of(results.scenario), first, number, designs, code, workers)


@_study(_SWEPT, minutes=60)
def sweep(results: "ScenarioResults", workers: Workers) -> str:
    """Simulate and measure many designs: parameters with ranges, distributions or lists, sampled or
    on a grid.

    The scenario's section `sweep` defines the designs. The folder's `designs` is a dataset of
    Parquet files with one row per design, for pandas, polars or duckdb. Failed designs are rows
    with their reason. Finished designs are kept: an interrupted sweep resumes, and a larger number
    extends a Sobol sequence. A grid of two or three parameters is also drawn as a map.

    `starts: 15` simulates each design from 15 slightly different starts, a row each; the page shows
    medians over the starts. The samples and events of the designs in `trajectories` are written
    too, as by `jointgap simulate`.

    \b
    Example:
      cat > mine.yaml <<END
      mechanism: config/mechanisms/erkaya2009.yaml
      simulate: {revolutions: 4, samples_per_revolution: 1800, tolerance: 1e-9 m}
      sweep:
        number: 256
        parameters:
          clearance: {from: 0.1 mm, to: 1 mm, distribution: log_uniform}
          friction: {from: 0, to: 0.2}
          crank_length: {distribution: normal, mean: 150 mm, deviation: 0.05 mm}
      END
      jointgap sweep --options mine.yaml --results results/mine
    """
    return write_sweep(results.scenario, results.path / "sweep", workers)


def write_sweep(scenario: "Scenario", folder: Path, workers: int | None = None) -> str:
    """Simulate and measure the designs of a scenario's sweep, and write dataset, page and figures;
    returns the page as Markdown."""
    from jointgap.designs.dataset import write_dataset, write_trajectories
    from jointgap.designs.sampling import designs_of
    from jointgap.designs.sweep import sweep_study

    designs, dataset = designs_of(scenario), folder / "designs"
    check_writable(folder / "summary.html", folder / "summary.md")
    code = DESIGN_STAGES["sweep-designs"].digest
    write_dataset(designs, dataset, scenario.sweep.designs_per_job, code, workers)
    write_trajectories(designs, folder / "trajectories")
    return sweep_study(designs, dataset).write(folder)


@_study((*_SWEPT, "sensitivity"), minutes=60)
def sensitivity(results: "ScenarioResults") -> str:
    """Compute Sobol indices of each measure of a sweep from a surrogate (variance-based
    sensitivity).

    Reads the designs of `jointgap sweep`. Each measure gets a surrogate, which is tested on
    held-out designs. Measures without an accurate surrogate have no indices; the page lists them.
    The sections `sweep` and `sensitivity` of the scenario define the designs and the measures (all
    by default).

    Writes summary.html and summary.md, three tables and figures.

    \b
    Example:
      jointgap sweep --options mine.yaml --results results/mine
      jointgap sensitivity --options mine.yaml --results results/mine
    """
    from jointgap.config.designs import Sensitivity
    from jointgap.designs.dataset import checked_dataset
    from jointgap.designs.sensitivity import sensitivity_indices
    from jointgap.designs.sensitivity_study import FIGURES, sensitivity_study

    scenario, dataset = results.scenario, results.path / SWEPT_DESIGNS
    designs, folder = checked_dataset(scenario, dataset), results.path / "sensitivity"
    result = sensitivity_indices(designs, dataset, scenario.sensitivity or Sensitivity())
    # figures of measures that no longer have indices
    shutil.rmtree(folder / FIGURES, ignore_errors=True)
    return sensitivity_study(result).write(folder)


@_study((*_SWEPT, "infer_settings"), files=("nearest_scenario.yaml",), minutes=60)
def infer_settings(results: "ScenarioResults") -> str:
    """Infer the paper's unreported settings from its printed numbers (rejection sampling).

    Reads the designs that `jointgap sweep` simulated with `sweep.printed_numbers`, and accepts
    those that reproduce all printed numbers within `infer_settings.within`.

    Writes summary.html and summary.md, the designs sorted by distance, the ranges of the accepted
    settings, and the nearest settings as a scenario file.

    \b
    Example:
      cat > mine.yaml <<END
      mechanism: config/mechanisms/erkaya2009.yaml
      simulate: {revolutions: 1, samples_per_revolution: 1800, tolerance: 1e-9 m}
      sweep:
        printed_numbers: true
        parameters: {friction: {from: 0, to: 0.3}, window_start: {from: 0 deg, to: 90 deg}}
      END
      jointgap sweep --options mine.yaml --results results/mine
      jointgap infer-settings --options mine.yaml --results results/mine
    """
    from jointgap.designs import infer_settings as module
    from jointgap.designs.dataset import checked_dataset

    scenario, dataset = results.scenario, results.path / SWEPT_DESIGNS
    folder = results.path / "infer_settings"
    module.check(scenario)
    designs = checked_dataset(scenario, dataset)
    inferred = module.infer(designs, scenario.infer_settings, dataset)
    write_text(folder / module.NEAREST_FILE, module.nearest_configuration(inferred))
    return module.inference_study(inferred).write(folder)


@_study(
    ("mechanism", "simulate", "optimise", "optimise_linkage", "optimise_robust"),
    minutes=120,
    threads=8,
)
def optimise_robust(results: "ScenarioResults", workers: Workers) -> str:
    """Optimise link lengths under uncertainty, and validate them on independent samples.

    The scenario's section `optimise_robust` defines the uncertain parameters (clearances, friction,
    masses, speed, tolerances of the lengths) and the objective: mean plus standard deviations, or a
    quantile, of the error of the transmission angle. Bounds and constraints of the lengths are
    those of the first box of the section `optimise`; of a linkage those of `optimise_linkage`.

    \b
    Example:
      cat > mine.yaml <<END
      mechanism: config/mechanisms/erkaya2009.yaml
      simulate: {revolutions: 4, samples_per_revolution: 1800, tolerance: 1e-9 m}
      optimise_robust:
        generations: 4
        uncertain:
          clearance: {from: 0.5 mm, to: 1.5 mm}
          friction: {from: 0, to: 0.2}
          crank_length: {distribution: normal, mean: 0 mm, deviation: 0.05 mm}
      END
      jointgap optimise-robust --options mine.yaml --results results/mine
    """
    from jointgap.core.facts import sentences
    from jointgap.designs.optimise_robust import optimise_robust as optimise
    from jointgap.designs.robust_study import robust_study

    scenario, name = results.scenario, results.path.resolve().name
    study = robust_study(optimise(scenario, workers), scenario, name)
    study.write(results.path / "optimise_robust")
    return "\n".join([study.title, *sentences(study.facts)])


@DESIGN_STAGES.stage(
    reads=tuple(table for stage in DESIGN_STAGES.values() for table in stage.writes),
    files=("track_sweep/published.json",),
    sections=(
        "description",
        *dict.fromkeys(name for stage in DESIGN_STAGES.values() for name in stage.sections),
    ),
    does="publish the sweep to MLflow",
    minutes=20,
    publishes=True,
)
def track_sweep(results: "ScenarioResults") -> None:
    """Publish the studies of a scenario's designs to MLflow as one run; repeated publishing adds
    nothing."""
    from jointgap.core.publish import publish_records

    scenario, folder = results.scenario, results.path.resolve()
    records = [sweep_record(scenario, results.path)]
    summary = publish_records(folder.name, scenario.description, records, None, folder.parent)
    write_text(results.path / "track_sweep/published.json", json.dumps(summary, indent=2) + "\n")


@DESIGN_STAGES.stage(
    writes=(
        schema.POINCARE_SECTION,
        schema.JOINT_REVOLUTIONS,
        schema.IMPACT_DISTRIBUTION,
        schema.ECCENTRICITY,
    ),
    sections=("mechanism", "simulate"),
)
def cycles(
    results: "ScenarioResults",
    angle: Annotated[
        str,
        Option(
            "--angle",
            default="0 deg",
            show_default=True,
            help="Crank angle of the Poincare section.",
        ),
    ],
    first_revolution: Annotated[
        int,
        Option(
            "--first-revolution",
            type=1,
            default=2,
            show_default=True,
            help="First settled revolution.",
        ),
    ],
) -> str:
    """Compute statistics over revolutions: contact, impacts, orbits, Poincaré section,
    periodicity; run `jointgap simulate` first."""
    from jointgap.core.units import option_in_si
    from jointgap.designs.statistics import cycles

    section_angle, scenario = option_in_si("--angle", angle, "rad"), results.scenario
    statistics = cycles(
        results.read("trajectory"),
        results.read("events"),
        scenario.mechanism,
        scenario.simulate,
        first_revolution,
        section_angle,
    )
    results.write_all(statistics.tables)
    return statistics.summary


_ARTIFACTS = (".md", ".html", ".svg", ".png", ".yaml")


def sweep_record(scenario: "Scenario", folder: Path) -> "Record":
    """The MLflow run of a scenario's studies, from their results in `folder`."""
    from jointgap.core.errors import InputError
    from jointgap.core.publish import Dataset, Record, configuration, costs
    from jointgap.designs.dataset import checked_dataset
    from jointgap.designs.study import SUMMARY

    table_names = {folder / table.path: name for name, table in TABLES.items()}
    metrics, datasets, files, spent = {}, [], {}, {}
    for study in (name.replace("-", "_") for name in studies_of(scenario)):
        tables = sorted((folder / study).glob("[!.]*.parquet"))
        if study == "sweep":
            tables = [folder / SWEPT_DESIGNS]
            checked_dataset(scenario, *tables)
        for path in tables:
            name = table_names.get(path, f"{path.parent.name}_{path.stem}")
            datasets.append(Dataset(name, path, "result"))
        summary = folder / study / SUMMARY
        if not summary.is_file():
            command = study.replace("_", "-")
            raise InputError(f"{summary}: is missing; run `jointgap {command}` first")
        metrics |= json.loads(summary.read_text(encoding="utf-8"))
        paths = sorted((folder / study).rglob("*"))
        files |= {
            str(path.relative_to(folder)): path for path in paths if path.suffix in _ARTIFACTS
        }
        benchmark = folder / f"benchmarks/{study}.tsv"
        measured = costs([benchmark] if benchmark.is_file() else [])
        spent |= {f"{study}_{key}": cost for key, cost in measured.items()}
    if not metrics:
        raise InputError(
            "sweep.parameters, optimise_robust.uncertain: both are empty, so there is nothing to"
            " publish; give the options of the designs"
        )
    options = configuration(scenario, scenario.model_fields_set - {"description"})
    return Record(
        "sweep",
        "",
        options["params"],
        metrics,
        datasets=tuple(datasets),
        files=options["files"] | files,
        costs=spent,
    )
