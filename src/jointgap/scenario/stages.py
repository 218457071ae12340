"""The stages of a scenario, from the simulated contact to tracked runs, in their order.

Each imports what it needs when it runs: the command line is there at once, and a job loads nothing that it does not
use."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from jointgap.core import schema
from jointgap.core.files import write_text
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
    left_out = set() if scenario.networks else {"surrogate", "clearance"}
    left_out |= set() if scenario.paper else {"compare"}
    return [name for name in SCENARIO_STAGES.jobs() if name not in left_out]


def drawn(networks: bool) -> list[str]:
    """Names of the still figures of a scenario that trains networks, or none."""
    from jointgap.scenario.figures import FIGURES

    left_out = set() if networks else {"predictions", *(table.name for table in OF_NETWORKS)}
    return [name for name in FIGURES.still if left_out.isdisjoint(FIGURES.needed_tables([name]))]


PUBLISHED, IMPACTS_PAGE = "track/published.json", "figures/impacts.html"
"""Places, in the folder of a scenario, of what was published where, and of the page to zoom into the impacts."""

_MOTION = ("mechanism", "simulate")
_LEARNING = (*_MOTION, "networks", "paper", "surrogate")
_OPTIMUM = (*_LEARNING, "optimise")
_SHOWN, _TOLD = (*_OPTIMUM, "figures"), ("description", *_OPTIMUM)


@SCENARIO_STAGES.stage(writes=(schema.TRAJECTORY, schema.EVENTS), sections=_MOTION, does="simulate the contact")
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
    results.write_all({"events": run.events, "trajectory": run.samples})


@SCENARIO_STAGES.stage(
    reads=(schema.TRAJECTORY,),
    writes=(schema.FIT, schema.FIT_HISTORY, schema.FIT_ERRORS),
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
    trajectory, options = results.read("trajectory"), results.scenario.surrogate
    fine = _first_revolution(results.scenario, min(SAMPLING, options.clearance_sampling))
    fits = [*train(trajectory, output, options), train_regularised(trajectory, fine, output, options)]
    for table, part in (("fit_history", "history"), ("fit_errors", "errors"), ("fit", "weights")):
        results.write(table, pd.concat([getattr(fit, part)() for fit in fits], ignore_index=True), output)


def _first_revolution(scenario: "Scenario", multiple: int) -> "pd.DataFrame":
    """The same motion with a multiple of the samples; too large to keep."""
    from jointgap.dynamics.simulation import simulate as simulated

    samples = scenario.simulate.samples_per_revolution * multiple
    finer = scenario.simulate.model_copy(update={"revolutions": 1, "samples_per_revolution": samples})
    return simulated(scenario.mechanism, finer).samples


@SCENARIO_STAGES.stage(
    reads=(schema.TRAJECTORY,),
    writes=(schema.CLEARANCE_FIT, schema.FIT_ERRORS.at("clearance")),
    sections=_LEARNING,
    does="train the second surrogate",
    memory=3000,
    minutes=20,
)
def clearance(results: "ScenarioResults") -> None:
    """Train the second surrogate: one network per loose joint for the clearance vector, all outputs from it."""
    from jointgap.networks.clearance import train_clearance
    from jointgap.scenario.results import outputs_of

    outputs_of(results.scenario.mechanism)  # complains where there is nothing to learn
    held_out, scenario = results.read("trajectory"), results.scenario
    fine = _first_revolution(scenario, scenario.surrogate.clearance_sampling)
    trained = train_clearance(held_out, fine, scenario.surrogate, scenario.mechanism.applied().loose)
    results.write_all({"fit_errors": trained.errors(), "clearance_fit": trained.weights()}, "clearance")


_TRAINED = SCENARIO_STAGES.written_by("simulate", "surrogate", "clearance")


@SCENARIO_STAGES.stage(
    reads=_TRAINED,
    writes=(schema.KINEMATICS, schema.KINEMATICS_ERRORS, schema.KINEMATICS_CONTRADICTIONS),
    sections=_LEARNING,
    does="kinematics from networks and simulation",
)
def kinematics(results: "ScenarioResults") -> None:
    """Feed the paper's equations by networks and by the simulation, and hold them against the simulation."""
    from jointgap.scenario.kinematics import kinematics as compared
    from jointgap.scenario.trained import trained_surrogates

    scenario, points = results.scenario, results.scenario.surrogate.training_points
    given = results.read("trajectory"), trained_surrogates(results)
    results.write_all(compared(scenario.mechanism.applied(), scenario.simulate, points, *given))


@SCENARIO_STAGES.stage(
    reads=_TRAINED,
    writes=tuple(table for table in schema.TABLES.values() if table.path.startswith("optimise/")),
    sections=_OPTIMUM,
    does="optimise the link lengths",
)
def optimise(results: "ScenarioResults") -> None:
    """Search the link lengths for the transmission angle, and simulate again what was found."""
    from jointgap.lengths.optimise import optimise as optimised
    from jointgap.scenario.trained import trained_surrogates

    scenario, points = results.scenario, results.scenario.surrogate.training_points
    given = results.read("trajectory"), trained_surrogates(results)
    found = optimised(scenario.mechanism.applied(), scenario.simulate, scenario.optimise, points, *given)
    for table in SCENARIO_STAGES["optimise"].writes:
        results.write(table, getattr(found, table.name.removeprefix("optimise_")))


_COMPUTED = (*_TRAINED, *SCENARIO_STAGES.written_by("kinematics", "optimise"))


@SCENARIO_STAGES.stage(reads=_COMPUTED, sections=_SHOWN, does="draw the figures")
def figures(
    results: "ScenarioResults",
    names: Annotated[
        Sequence[str],
        Option("--figure", multiple=True, help="Name of a figure, repeatable; all still figures when absent."),
    ] = (),
) -> None:
    """Draw the paper's figures and ours: SVG, PNG, and the plotted data beside each."""
    from jointgap.core import plot
    from jointgap.scenario.figure_data import revolution
    from jointgap.scenario.figures import FIGURES, draw
    from jointgap.scenario.trained import predictions, trained_surrogates

    wanted = names or drawn(results.scenario.networks)
    needed = set(FIGURES.needed_tables(wanted))
    frames = results.read_all(needed - {"predictions"})
    if "predictions" in needed:
        first = revolution(frames["trajectory"], results.scenario, 1)
        frames["predictions"] = predictions(trained_surrogates(results), first)
    for name in wanted:
        plot.save(draw(name, frames, results.scenario), results.path / "figures" / name)


@SCENARIO_STAGES.stage(
    reads=(schema.TRAJECTORY, schema.EVENTS),
    files=("figures/animation.gif", IMPACTS_PAGE),
    sections=_SHOWN,
    does="animate, and a page to zoom into the impacts",
)
def animate(results: "ScenarioResults") -> None:
    """Draw the animation of the motion, a GIF with the plotted data beside it, and the page of `jointgap explore`."""
    figures(results, ("animation",))
    explore(results)


@SCENARIO_STAGES.stage(reads=(schema.TRAJECTORY, schema.EVENTS), files=(IMPACTS_PAGE,), sections=_MOTION)
def explore(results: "ScenarioResults") -> None:
    """Write figures/impacts.html, to zoom into the impacts: gaps, contact forces and modes over the crank angle.

    The page is complete in itself, 5 MB and more, and opens in any browser without a network. Needs plotly.
    """
    from jointgap.scenario.impacts_page import impacts_page

    page = impacts_page(results.read("trajectory"), results.read("events"), results.scenario, results.name)
    write_text(results.path / IMPACTS_PAGE, page)


@SCENARIO_STAGES.stage(
    reads=_COMPUTED,
    writes=(schema.COMPARISON,),
    files=("comparison.md", "comparison.html"),
    sections=_TOLD,
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
    from jointgap.core.page import write_page
    from jointgap.paper.compare import NEEDED, comparison_page, variant_optimum
    from jointgap.paper.compare import compare as compared

    frames = results.read_all(NEEDED)  # first: a trajectory of other options is refused
    variants = [
        variant_optimum(name, each.scenario, each.read("optimise_resimulated"))
        for name, each in {results.path.name: results, **siblings}.items()
    ]
    result = compared(frames, results.scenario, variants)
    write_page(results.path / "comparison", comparison_page(result, results.scenario))
    results.write("comparison", result)


@SCENARIO_STAGES.stage(
    reads=_COMPUTED,
    files=("summary.json", "summary.md", "summary.html"),
    sections=_TOLD,
    does="put what came out on one page",
    after=("figures", "animate"),
)
def summarise(results: "ScenarioResults") -> str:
    """Put the outcome on one page: lengths, gain, price and remarks, for whoever designs the mechanism.

    The page takes in the figures that lie in the scenario's folder.
    """
    from jointgap.core.page import write_page
    from jointgap.scenario.outcome import NEEDED, document, outcome, page, remarks

    needed = [*NEEDED, "fit_errors"] if results.scenario.networks else NEEDED
    found = outcome(results.read_all(needed), results.scenario)
    remarked, name = remarks(found), results.path.name
    known = document(found, name, remarked)
    write_page(results.path / "summary", page(found, name, remarked), "figures")
    write_text(results.path / "summary.json", json.dumps(known, indent=2, ensure_ascii=False) + "\n")
    return "\n".join([known["headline"], *(f"- {remark}" for remark in remarked)])


@SCENARIO_STAGES.stage(
    reads=(*_COMPUTED, schema.COMPARISON),
    writes=(schema.OVERVIEW,),
    files=("overview.md", "overview.html"),
    sections=_TOLD,
)
def overview(scenarios: Mapping[str, "ScenarioResults"], folder: Path) -> None:
    """Put the scenarios' optima side by side: frozen, simulated again, and what they assume."""
    from jointgap.core.page import write_page
    from jointgap.core.parquet import write
    from jointgap.scenario import overview as pages

    needed = {name: (results.read_all(pages.NEEDED), results.scenario) for name, results in scenarios.items()}
    result = pages.overview(needed)
    write_page(folder / "overview", pages.overview_page(result))
    write(schema.OVERVIEW, result, folder / schema.OVERVIEW.path)


@SCENARIO_STAGES.stage(
    reads=(*_COMPUTED, schema.COMPARISON),
    files=(PUBLISHED,),
    sections=_TOLD,
    does="publish to MLflow",
    after=("figures", "animate"),
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
    content, folder = scenario_records(results.scenario, sections, files, results.path), results.path.resolve().parent
    summary = publish_records(results.name, results.scenario.description, content, None, folder)
    write_text(results.path / PUBLISHED, json.dumps(summary, indent=2) + "\n")
