"""The stages that work on many designs of a scenario: sweeps, and what is asked of them."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from jointgap.core.files import check_writable, write_text
from jointgap.core.schema import (
    INFER_SETTINGS_SETTINGS,
    OPTIMISE_ROBUST_CANDIDATES,
    OPTIMISE_ROBUST_CONSTRAINTS,
    OPTIMISE_ROBUST_FRESH,
    OPTIMISE_ROBUST_GAINS,
    OPTIMISE_ROBUST_LENGTHS,
    SENSITIVITY_EFFECTS,
    SENSITIVITY_INDICES,
    SENSITIVITY_SURROGATES,
)
from jointgap.core.stage import Option, Stages, Workers

if TYPE_CHECKING:  # slow to load
    from jointgap.config import Scenario
    from jointgap.scenario.results import ScenarioResults

DESIGN_STAGES = Stages()

_MOTION = ("mechanism", "simulate")

_Designs = Annotated[
    Path, Option("--designs", type="folder", required=True, help="Folder of the designs that `jointgap sweep` wrote.")
]


@DESIGN_STAGES.stage(sections=(*_MOTION, "sweep"))
def sweep_designs(
    scenario: "Scenario",
    first: Annotated[int, Option("--first", type=0, required=True, help="First design, from 0 on.")],
    number: Annotated[int, Option("--number", type=1, required=True, help="How many designs.")],
    designs: Annotated[
        Path,
        Option(
            "--designs",
            type="file",
            required=True,
            help="Parquet file to write: these designs and what was measured of them.",
        ),
    ],
    workers: Workers,
) -> None:
    """Simulate and measure some designs of the sweep, for `jointgap sweep`; those that the file holds are kept."""
    from jointgap.designs.run import write_designs
    from jointgap.designs.sampling import designs_of

    write_designs(designs_of(scenario), first, number, designs, DESIGN_STAGES["sweep-designs"].digest, workers)


@DESIGN_STAGES.stage(
    files=("sweep/summary.md", "sweep/summary.html"),
    sections=(*_MOTION, "sweep"),
    does="sweep",
    memory=2500,
    minutes=60,
)
def sweep(
    scenario: "Scenario",
    folder: Annotated[
        Path,
        Option(
            "--folder", type="folder", required=True, help="Folder to write designs/, summary.md and summary.html to."
        ),
    ],
    workers: Workers,
) -> str:
    """Simulate and measure many designs: parameters with ranges, distributions or lists, drawn or on a grid.

    The scenario's section `sweep` says which. The folder's `designs` is a dataset of Parquet files that pandas, polars
    and duckdb read as one table, a row a design; designs that fail are rows with their reason. What is there already is
    kept: a sweep that was killed goes on, and one with a larger number of the same Sobol sequence adds designs.
    A grid of two or three parameters is drawn as a map.

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
      jointgap sweep --options mine.yaml --folder results/mine
    """
    from jointgap.core import plot
    from jointgap.core.page import to_html, to_markdown
    from jointgap.core.parquet import read_columns
    from jointgap.designs.page import MAP, grid_map, has_map, page
    from jointgap.designs.run import write_dataset
    from jointgap.designs.sampling import designs_of

    designs, dataset = designs_of(scenario), folder / "designs"
    check_writable(folder / "summary.html", folder / "summary.md")
    code = DESIGN_STAGES["sweep-designs"].digest
    write_dataset(designs, dataset, scenario.sweep.designs_per_job, code, workers)
    if has_map(designs.kind, designs.axes):
        names = [*(axis.key for axis in designs.axes), *(column.name for column in designs.measured)]
        plot.save(grid_map(read_columns(dataset, names).to_pandas(), designs.axes), folder / MAP)
    summary = page(designs, dataset)
    write_text(folder / "summary.html", to_html(summary, folder))
    text = to_markdown(summary, ".")
    write_text(folder / "summary.md", text)
    return text


@DESIGN_STAGES.stage(
    writes=(SENSITIVITY_SURROGATES, SENSITIVITY_INDICES, SENSITIVITY_EFFECTS),
    files=("sensitivity/summary.md", "sensitivity/summary.html"),
    sections=(*_MOTION, "sweep", "sensitivity"),
    does="sensitivity",
    memory=2500,
    minutes=60,
)
def sensitivity(
    scenario: "Scenario",
    designs: _Designs,
    folder: Annotated[
        Path,
        Option(
            "--folder",
            type="folder",
            required=True,
            help="Folder to write summary.md, summary.html, tables and figures/ to.",
        ),
    ],
) -> str:
    """Tell which parameter of a sweep decides which measure: Sobol indices from a surrogate of each.

    Reads the designs that `jointgap sweep` simulated. Each measure gets a surrogate, which is judged by designs that it
    was not trained on; where it predicts them badly there are no indices, and the page says so. The sections `sweep`
    and `sensitivity` of the scenario say what was drawn, and of which measures indices are wanted (all by default).

    Writes summary.html and summary.md, three tables and figures.

    \b
    Example:
      jointgap sweep --options mine.yaml --folder results/mine/sweep
      jointgap sensitivity --options mine.yaml --designs results/mine/sweep/designs --folder results/mine/sensitivity
    """
    from jointgap.config.designs import Sensitivity
    from jointgap.designs.run import check_dataset
    from jointgap.designs.sampling import designs_of
    from jointgap.designs.sensitivity import what_decides, write_results

    drawn = designs_of(scenario)
    check_dataset(drawn, designs)
    return write_results(what_decides(drawn, designs, scenario.sensitivity or Sensitivity()), folder)


@DESIGN_STAGES.stage(
    writes=(INFER_SETTINGS_SETTINGS,),
    files=(
        "infer_settings/summary.md",
        "infer_settings/summary.html",
        "infer_settings/nearest_scenario.yaml",
    ),
    sections=(*_MOTION, "sweep", "infer_settings"),
    does="infer settings",
    memory=2500,
    minutes=60,
)
def infer_settings(
    scenario: "Scenario",
    designs: _Designs,
    folder: Annotated[
        Path,
        Option(
            "--folder",
            type="folder",
            required=True,
            help="Folder to write summary.md, summary.html, tables and a scenario to.",
        ),
    ],
) -> str:
    """Infer the paper's unreported settings from its printed numbers (rejection sampling).

    Reads the designs that `jointgap sweep` simulated with `sweep.printed_numbers`, and accepts those that reproduce all
    printed numbers within `infer_settings.within`.

    Writes summary.html and summary.md, the designs with the nearest first, where the accepted ones lie, and the nearest
    settings as a scenario to run.

    \b
    Example:
      cat > mine.yaml <<END
      mechanism: config/mechanisms/erkaya2009.yaml
      simulate: {revolutions: 1, samples_per_revolution: 1800, tolerance: 1e-9 m}
      sweep:
        printed_numbers: true
        parameters: {friction: {from: 0, to: 0.3}, window_start: {from: 0 deg, to: 90 deg}}
      END
      jointgap sweep --options mine.yaml --folder results/mine/sweep
      jointgap infer-settings --options mine.yaml --designs results/mine/sweep/designs \
        --folder results/mine/infer_settings
    """
    from jointgap.designs.infer_settings import check_infer_settings, infer, write_results
    from jointgap.designs.run import check_dataset
    from jointgap.designs.sampling import designs_of

    check_infer_settings(scenario)
    check_dataset(designs_of(scenario), designs)
    return write_results(infer(scenario, designs), folder)


@DESIGN_STAGES.stage(
    writes=(OPTIMISE_ROBUST_LENGTHS, OPTIMISE_ROBUST_GAINS, OPTIMISE_ROBUST_CONSTRAINTS, OPTIMISE_ROBUST_CANDIDATES),
    files=(OPTIMISE_ROBUST_FRESH.path, "optimise_robust/summary.md", "optimise_robust/summary.html"),
    sections=(*_MOTION, "optimise", "optimise_robust"),
    does="optimise robustly",
    memory=2500,
    minutes=120,
    threads=8,
)
def optimise_robust(results: "ScenarioResults", workers: Workers) -> str:
    """Search link lengths that hold whatever is uncertain, and judge them on fresh draws.

    The scenario's section `optimise_robust` says what is uncertain (clearances, friction, masses, speed, tolerances of
    the lengths), and what of the error of the transmission angle is minimised: its mean plus standard deviations, or a
    quantile. Bounds and constraints of the lengths are those of the section `optimise`, its first box.

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
    from jointgap.core import plot
    from jointgap.core.page import to_html, to_markdown
    from jointgap.core.parquet import write
    from jointgap.designs.robust import draw_robust, headline, page, verdict
    from jointgap.designs.robust import optimise_robust as optimised

    found = optimised(results.scenario, workers)
    folder = results.path / "optimise_robust"
    write(found.fresh_table, found.fresh, results.path / OPTIMISE_ROBUST_FRESH.path)
    results.write(OPTIMISE_ROBUST_CANDIDATES, found.candidates)
    results.write(OPTIMISE_ROBUST_CONSTRAINTS, found.comparison.constraints)
    results.write(OPTIMISE_ROBUST_GAINS, found.comparison.gains)
    results.write(OPTIMISE_ROBUST_LENGTHS, found.comparison.lengths)
    for name, drawing in draw_robust(found).items():
        plot.save(drawing, folder / name)
    shown = page(found, results.scenario, results.path.resolve().name)
    write_text(folder / "summary.html", to_html(shown, folder))
    write_text(folder / "summary.md", to_markdown(shown, "."))
    return "\n".join([headline(found), *verdict(found)])


_MANY_DESIGNS = (
    "sweep",
    "sensitivity",
    "infer-settings",
    "optimise-robust",
)


@DESIGN_STAGES.stage(
    reads=DESIGN_STAGES.written_by(*_MANY_DESIGNS),
    files=("track_sweep/published.json",),
    sections=tuple(
        dict.fromkeys(["description", *(one for name in _MANY_DESIGNS for one in DESIGN_STAGES[name].sections)])
    ),
    does="publish the sweep to MLflow",
    minutes=20,
    publishes=True,
)
def track_sweep(results: "ScenarioResults") -> None:
    """Publish what a scenario asks of many designs to MLflow, all of them as one run; nothing twice."""
    from jointgap.core.publish import publish_records
    from jointgap.designs.mlflow_run import sweep_record

    scenario, folder = results.scenario, results.path.resolve()
    content = [sweep_record(scenario, results.path)]
    summary = publish_records(folder.name, scenario.description, content, None, folder.parent)
    write_text(results.path / "track_sweep/published.json", json.dumps(summary, indent=2) + "\n")
