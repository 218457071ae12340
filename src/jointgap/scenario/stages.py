"""The stages of a scenario, from the simulated contact to tracked runs, in their order.

Each imports what it needs when it runs: the command line is there at once, and a job loads nothing that it does not
use."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from jointgap.core.files import write_text
from jointgap.core.schema import (
    CLEARANCE_FIT,
    COMPARISON,
    EVENTS,
    FIT,
    FIT_ERRORS,
    FIT_HISTORY,
    KINEMATICS,
    KINEMATICS_CONTRADICTIONS,
    KINEMATICS_ERRORS,
    OPTIMISE_FLOOR,
    OPTIMISE_LOADS,
    OPTIMISE_OPTIMA,
    OPTIMISE_PATHS,
    OPTIMISE_POPULATION,
    OPTIMISE_RESIMULATED,
    OPTIMISE_TOLERANCE,
    OPTIMISE_VALLEY,
    OPTIMISE_WORTH,
    OVERVIEW,
    TRAJECTORY,
)
from jointgap.core.stage import Option, Stages
from jointgap.networks import OF_NETWORKS

if TYPE_CHECKING:
    import pandas as pd

    from jointgap.config import Scenario
    from jointgap.scenario.results import ScenarioResults

SCENARIO_STAGES = Stages()


def stages_of(scenario: "Scenario") -> list[str]:
    """The stages that a scenario goes through: networks and the comparison with the paper where they are asked for."""
    if not scenario.mechanism.applied().loose:
        return ["simulate", "animate"]
    left_out = set() if scenario.networks else {"surrogate", "clearance", "learned-figures"}
    left_out |= set() if scenario.paper else {"compare"}
    return [name for name in SCENARIO_STAGES.jobs() if name not in left_out]


def drawn(learned: bool) -> list[str]:
    """Names of the figures that need networks, or that need none."""
    from jointgap.scenario.figures import FIGURES

    of_networks = {"predictions", *(table.name for table in OF_NETWORKS)}
    return [name for name in FIGURES.still if learned != of_networks.isdisjoint(FIGURES.needed_tables([name]))]


PUBLISHED = "track/published.json"
"""Place of what was published where."""

IMPACTS_PAGE = "figures/impacts.html"
"""Place of the page to zoom into the impacts, in the folder of a scenario."""

_MOTION = ("mechanism", "simulate")
_LEARNING = (*_MOTION, "networks", "paper", "surrogate")
_OPTIMUM = (*_LEARNING, "optimise")


@SCENARIO_STAGES.stage(writes=(TRAJECTORY, EVENTS), sections=_MOTION, does="simulate the contact")
def simulate(results: "ScenarioResults") -> None:
    """Simulate the slider-crank: each joint loose or ideal, with contact, friction and the effects that are listed.

    Reads the sections `mechanism` and `simulate` of the scenario: bodies, joints, contacts and effects; what drives the
    crank (constant speed, a measured angle or a motor), how long, and how exactly.

    Writes two tables (`jointgap describe FILE` explains their columns). Remarks, such as a contact law that delivers
    another restitution than the one asked for, go to the standard error output. A simulation that cannot go on ends
    with its time, crank angle and state, and writes nothing.

    \b
    Example:
      echo '{mechanism: config/mechanisms/erkaya2009.yaml, simulate: {speed: 300 rpm}}' > mine.yaml
      jointgap simulate --options mine.yaml --trajectory motion.parquet --events events.parquet

    Effects to switch on: `jointgap effects`. All keys: config/README.md.
    """
    from jointgap.dynamics.mechanism_warnings import remarks
    from jointgap.dynamics.simulation import simulate as simulated

    scenario = results.scenario
    for remark in remarks(scenario.mechanism):
        print(f"jointgap: {remark}", file=sys.stderr)
    run = simulated(scenario.mechanism, scenario.simulate)
    results.write(EVENTS, run.events)
    results.write(TRAJECTORY, run.samples)


@SCENARIO_STAGES.stage(
    reads=(TRAJECTORY,),
    writes=(FIT, FIT_HISTORY, FIT_ERRORS),
    sections=_LEARNING,
    does="train the networks of {output}",
    minutes=60,
)
def surrogate(
    results: "ScenarioResults",
    output: Annotated[
        str, Option("--output-name", required=True, help="What to learn: a column such as r2 or gamma3_ddot.")
    ],
) -> None:
    """Train the networks of one output with Levenberg-Marquardt: the paper's, and a regularised one whose errors
    hold.
    """
    import pandas as pd

    from jointgap.core.errors import InputError, did_you_mean
    from jointgap.networks.train import SAMPLING, train, train_regularised
    from jointgap.scenario.results import outputs_of

    outputs = outputs_of(results.scenario.mechanism)
    if output not in outputs:
        raise InputError(f"--output-name {output}: no such output; {did_you_mean(output, outputs)}")
    trajectory, options = results.read(TRAJECTORY), results.scenario.surrogate
    fine = _first_revolution(results.scenario, min(SAMPLING, options.clearance_sampling))
    fits = [*train(trajectory, output, options), train_regularised(trajectory, fine, output, options)]
    for table, frames in (
        (FIT_HISTORY, [fit.history() for fit in fits]),
        (FIT_ERRORS, [fit.errors() for fit in fits]),
        (FIT, [fit.weights() for fit in fits]),
    ):
        results.write(table, pd.concat(frames, ignore_index=True), output)


def _first_revolution(scenario: "Scenario", multiple: int) -> "pd.DataFrame":
    """The same motion with a multiple of the samples; too large to keep."""
    from jointgap.dynamics.simulation import simulate as simulated

    samples = scenario.simulate.samples_per_revolution * multiple
    finer = scenario.simulate.model_copy(update={"revolutions": 1, "samples_per_revolution": samples})
    return simulated(scenario.mechanism, finer).samples


@SCENARIO_STAGES.stage(
    reads=(TRAJECTORY,),
    writes=(CLEARANCE_FIT, FIT_ERRORS.at("clearance")),
    sections=_LEARNING,
    does="train the second surrogate",
    memory=3000,
    minutes=20,
)
def clearance(results: "ScenarioResults") -> None:
    """Train the second surrogate: one network per loose joint for the clearance vector, all outputs from it."""
    from jointgap.networks.clearance import train_clearance
    from jointgap.scenario.results import CLEARANCE, outputs_of

    outputs_of(results.scenario.mechanism)  # complains where there is nothing to learn
    held_out, scenario = results.read(TRAJECTORY), results.scenario
    fine = _first_revolution(scenario, scenario.surrogate.clearance_sampling)
    trained = train_clearance(held_out, fine, scenario.surrogate, scenario.mechanism.applied().loose)
    results.write(FIT_ERRORS, trained.errors(), CLEARANCE)
    results.write(CLEARANCE_FIT, trained.weights())


_TRAINED = SCENARIO_STAGES.written_by("simulate", "surrogate", "clearance")


@SCENARIO_STAGES.stage(
    reads=_TRAINED,
    writes=(KINEMATICS, KINEMATICS_ERRORS, KINEMATICS_CONTRADICTIONS),
    sections=_LEARNING,
    does="kinematics from networks and simulation",
)
def kinematics(results: "ScenarioResults") -> None:
    """Feed the paper's equations by networks and by the simulation, and hold them against the simulation."""
    from jointgap.scenario.kinematics import kinematics as compared
    from jointgap.scenario.trained import trained_surrogates

    scenario = results.scenario
    result = compared(
        scenario.mechanism.applied(),
        scenario.simulate,
        scenario.surrogate.training_points,
        results.read(TRAJECTORY),
        trained_surrogates(results),
    )
    results.write(KINEMATICS_ERRORS, result.errors)
    results.write(KINEMATICS_CONTRADICTIONS, result.contradictions)
    results.write(KINEMATICS, result.motion)


@SCENARIO_STAGES.stage(
    reads=_TRAINED,
    writes=(
        OPTIMISE_OPTIMA,
        OPTIMISE_POPULATION,
        OPTIMISE_PATHS,
        OPTIMISE_TOLERANCE,
        OPTIMISE_VALLEY,
        OPTIMISE_FLOOR,
        OPTIMISE_RESIMULATED,
        OPTIMISE_WORTH,
        OPTIMISE_LOADS,
    ),
    sections=_OPTIMUM,
    does="optimise the link lengths",
)
def optimise(results: "ScenarioResults") -> None:
    """Search the link lengths for the transmission angle, and simulate again what was found."""
    from jointgap.lengths.optimise import optimise as optimised
    from jointgap.scenario.trained import trained_surrogates

    scenario = results.scenario
    result = optimised(
        scenario.mechanism.applied(),
        scenario.simulate,
        scenario.optimise,
        scenario.surrogate.training_points,
        results.read(TRAJECTORY),
        trained_surrogates(results),
    )
    for table in SCENARIO_STAGES["optimise"].writes:
        results.write(table, getattr(result, table.name.removeprefix("optimise_")))


_COMPUTED = (*_TRAINED, *SCENARIO_STAGES.written_by("kinematics", "optimise"))


@SCENARIO_STAGES.stage(reads=_COMPUTED, sections=(*_OPTIMUM, "figures"), does="draw the figures")
def figures(
    results: "ScenarioResults",
    names: Annotated[
        Sequence[str],
        Option("--figure", multiple=True, help="Name of a figure, repeatable; all still figures when absent."),
    ] = (),
    folder: Annotated[
        Path | None,
        Option("--folder", type="folder", help="Folder to write to; figures/ among the results when absent."),
    ] = None,
) -> None:
    """Draw the paper's figures and ours: SVG, PNG, and the plotted data beside each."""
    from jointgap.scenario.figures import FIGURES, draw_all
    from jointgap.scenario.figures_base import predictions
    from jointgap.scenario.trained import trained_surrogates

    wanted = names or [*(drawn(True) if results.scenario.networks else ()), *drawn(False)]
    needed = FIGURES.needed_tables(wanted)
    frames = results.read_all(name for name in needed if name != "predictions")
    if "predictions" in needed:
        frames["predictions"] = predictions(trained_surrogates(results), frames["trajectory"], results.scenario)
    draw_all(frames, results.scenario, folder or results.path / "figures", wanted)


@SCENARIO_STAGES.stage(reads=_COMPUTED, sections=(*_OPTIMUM, "figures"), does="draw the figures of the networks")
def learned_figures(results: "ScenarioResults") -> None:
    """Draw the figures of the networks alone."""
    figures(results, drawn(True))


@SCENARIO_STAGES.stage(
    reads=(TRAJECTORY, EVENTS),
    files=("figures/animation.gif", IMPACTS_PAGE),
    sections=(*_OPTIMUM, "figures"),
    does="animate, and a page to zoom into the impacts",
)
def animate(results: "ScenarioResults") -> None:
    """Draw the animation of the motion, a GIF with the plotted data beside it, and the page of `jointgap explore`."""
    figures(results, ("animation",))
    explore(results)


@SCENARIO_STAGES.stage(reads=(TRAJECTORY, EVENTS), files=(IMPACTS_PAGE,), sections=_MOTION)
def explore(results: "ScenarioResults") -> None:
    """Write figures/impacts.html, to zoom into the impacts: gaps, contact forces and modes over the crank angle.

    The page is complete in itself, 5 MB and more, and opens in any browser without a network. Needs plotly.
    """
    from jointgap.scenario.impacts_page import impacts_page

    page = impacts_page(results.read(TRAJECTORY), results.read(EVENTS), results.scenario, results.path.resolve().name)
    write_text(results.path / IMPACTS_PAGE, page)


@SCENARIO_STAGES.stage(
    reads=_COMPUTED,
    writes=(COMPARISON,),
    files=("comparison.md", "comparison.html"),
    sections=("description", *_OPTIMUM),
    does="compare with the paper",
)
def compare(
    results: "ScenarioResults",
    siblings: Annotated[
        Mapping[str, "ScenarioResults"],
        Option(
            "--beside",
            nargs=2,
            multiple=True,
            help="Name and options of a scenario, in the folder beside --results, that differs in its loose joints "
            "alone; repeatable.",
        ),
    ],
) -> None:
    """Put every number and claim of the paper beside ours."""
    from jointgap.core.page import to_html, to_markdown
    from jointgap.paper.compare import NEEDED, comparison_page, variant_optimum
    from jointgap.paper.compare import compare as compared

    frames = results.read_all(NEEDED)
    compared_with = {results.path.name: results, **siblings}
    variants = [
        variant_optimum(name, each.scenario, each.read(OPTIMISE_RESIMULATED)) for name, each in compared_with.items()
    ]
    result = compared(frames, results.scenario, variants)
    write_text(results.path / "comparison.html", to_html(comparison_page(result, results.scenario)))
    write_text(results.path / "comparison.md", to_markdown(comparison_page(result, results.scenario)))
    results.write(COMPARISON, result)


@SCENARIO_STAGES.stage(
    reads=_COMPUTED,
    files=("summary.json", "summary.md", "summary.html"),
    sections=("description", *_OPTIMUM),
    does="put what came out on one page",
    after=("figures", "learned-figures", "animate"),
)
def summarise(results: "ScenarioResults") -> str:
    """Put the outcome on one page: lengths, gain, price and remarks, for whoever designs the mechanism.

    The page takes in the figures that lie in the scenario's folder.
    """
    from jointgap.core.page import to_html, to_markdown
    from jointgap.scenario.outcome import NEEDED, outcome, remarks
    from jointgap.scenario.page import document, page

    frames = results.read_all(results.made(NEEDED))
    found = outcome(frames, results.scenario)
    remarked, name = remarks(found), results.path.name
    shown, known = page(found, name, remarked), document(found, name, remarked)
    write_text(results.path / "summary.html", to_html(shown, results.path / "figures"))
    write_text(results.path / "summary.md", to_markdown(shown))
    write_text(results.path / "summary.json", json.dumps(known, indent=2, ensure_ascii=False) + "\n")
    return "\n".join([known["headline"], *(f"- {remark}" for remark in remarked)])


@SCENARIO_STAGES.stage(
    reads=(*_COMPUTED, COMPARISON),
    writes=(OVERVIEW,),
    files=("overview.md", "overview.html"),
    sections=("description", *_OPTIMUM),
)
def overview(scenarios: Mapping[str, "ScenarioResults"], folder: Path) -> None:
    """Put the scenarios' optima side by side: frozen, simulated again, and what they assume."""
    from jointgap.core.page import to_html, to_markdown
    from jointgap.core.parquet import write
    from jointgap.scenario import overview as pages

    needed = {name: (results.read_all(pages.NEEDED), results.scenario) for name, results in scenarios.items()}
    result = pages.overview(needed)
    page = pages.overview_page(result)
    write_text(folder / "overview.html", to_html(page, folder))
    write_text(folder / "overview.md", to_markdown(page, "."))
    write(OVERVIEW, result, folder / OVERVIEW.path)


@SCENARIO_STAGES.stage(
    reads=(*_COMPUTED, COMPARISON),
    files=(PUBLISHED,),
    sections=("description", *_OPTIMUM),
    does="publish to MLflow",
    after=("figures", "learned-figures", "animate"),
    minutes=20,
    publishes=True,
)
def track(results: "ScenarioResults") -> None:
    """Publish a scenario's tables and figures to MLflow; nothing twice."""
    from jointgap.core.errors import InputError
    from jointgap.core.publish import publish_records
    from jointgap.scenario.mlflow_runs import scenario_records

    if not (files := results.files(SCENARIO_STAGES["track"].reads)):
        raise InputError(f"{results.path}: holds no tables, so there is nothing to publish; give a scenario's folder")
    sections = {stage.name: stage.sections for stage in SCENARIO_STAGES.values()}
    content, folder = scenario_records(results.scenario, sections, files, results.path), results.path.resolve()
    summary = publish_records(folder.name, results.scenario.description, content, None, folder.parent)
    write_text(results.path / PUBLISHED, json.dumps(summary, indent=2) + "\n")
