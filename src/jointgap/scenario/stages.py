"""The stages of a scenario in their order. Each imports its packages only when it runs."""

import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from jointgap.core import schema
from jointgap.core.files import write_text
from jointgap.core.stage import Option, ResultsOption, ScenarioOptions, Stages
from jointgap.networks import OF_NETWORKS

if TYPE_CHECKING:
    from jointgap.config import Scenario
    from jointgap.config.scenario_results import ScenarioResults


def open_results(options: ScenarioOptions, results: ResultsOption) -> "ScenarioResults":
    """The results of a scenario."""
    from jointgap.config import scenario_results

    opened = scenario_results.open_results(options, results)
    opened.scenario.check_slider_crank(f"{opened.source}: ")
    return opened


SCENARIO_STAGES = Stages(open_results)


def stages_of(scenario: "Scenario") -> list[str]:
    """The stages of a scenario: networks and the comparison with the paper only where its options
    ask for them."""
    if not scenario.mechanism.applied().loose:
        return ["simulate", "animate"]
    left_out = set() if scenario.networks else {"surrogate"}
    left_out |= set() if scenario.paper else {"compare"}
    return [name for name in SCENARIO_STAGES.jobs() if name not in left_out]


def drawn(networks: bool) -> list[str]:
    """Names of the still figures, with or without those of the networks."""
    from jointgap.scenario.figures import FIGURES

    left_out = set() if networks else {"predictions", *(table.name for table in OF_NETWORKS)}
    return [name for name in FIGURES.still if left_out.isdisjoint(FIGURES.needed_tables([name]))]


PUBLISHED, IMPACTS_PAGE = "track/published.json", "figures/impacts.html"
"""Files in the folder of a scenario: the publishing summary, and the interactive page of the
impacts."""

_MOTION = ("mechanism", "simulate")
_LEARNING = (*_MOTION, "networks", "paper", "surrogate")
_OPTIMUM = (*_LEARNING, "optimise")
_DRAWN, _PAGE = (*_OPTIMUM, "figures"), ("description", *_OPTIMUM)


@SCENARIO_STAGES.stage(
    writes=(schema.TRAJECTORY, schema.EVENTS), sections=_MOTION, does="simulate the contact"
)
def simulate(results: "ScenarioResults") -> None:
    """Simulate the slider-crank: joints loose or ideal, with contact, friction and the listed
    effects.

    Reads the sections `mechanism` (bodies, joints, contacts, effects) and `simulate` (drive,
    duration, tolerances) of the scenario. The drive is a constant speed, a measured angle or a
    motor.

    Writes two tables (`jointgap describe FILE` explains their columns). Warnings go to the standard
    error output, such as an effective restitution that differs from the configured one. A
    simulation that fails reports time, crank angle and state, and writes no table.

    \b
    Example:
      echo '{mechanism: config/mechanisms/erkaya2009.yaml, simulate: {speed: 300 rpm}}' > mine.yaml
      jointgap simulate --options mine.yaml --results results/mine

    Available effects: `jointgap effects`. All keys: config/README.md.
    """
    from jointgap.motion.mechanism_warnings import remarks
    from jointgap.motion.slider_crank import simulate as simulated

    scenario = results.scenario
    for remark in remarks(scenario.mechanism, scenario.simulate.highest_speed):
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
        str,
        Option(
            "--output-name",
            required=True,
            help="Output to learn: a column such as r2 or gamma3_ddot.",
        ),
    ],
) -> None:
    """Train the networks of one output with Levenberg-Marquardt: the paper's network and a
    regularised one."""
    import pandas as pd

    from jointgap.config.scenario_results import outputs_of
    from jointgap.core.errors import InputError, did_you_mean
    from jointgap.motion.slider_crank import simulate as simulate_motion
    from jointgap.networks.train import SAMPLING, train, train_regularised

    outputs = outputs_of(results.scenario.mechanism)
    if output not in outputs:
        raise InputError(f"--output-name {output}: no such output; {did_you_mean(output, outputs)}")
    trajectory, options = results.read("trajectory"), results.scenario.surrogate
    # the first revolution in fine steps, too large to store
    samples = SAMPLING * results.scenario.simulate.samples_per_revolution
    fine_steps = {"revolutions": 1, "samples_per_revolution": samples}
    fine_options = results.scenario.simulate.model_copy(update=fine_steps)
    fine = simulate_motion(results.scenario.mechanism, fine_options).samples
    fits = train(trajectory, output, options)
    fits.append(train_regularised(trajectory, fine, output, options))
    for table, part in (("fit_history", "history"), ("fit_errors", "errors"), ("fit", "weights")):
        frame = pd.concat([getattr(fit, part)() for fit in fits], ignore_index=True)
        results.write(table, frame, output)


_TRAINED = SCENARIO_STAGES.written_by("simulate", "surrogate")


@SCENARIO_STAGES.stage(
    reads=_TRAINED,
    writes=(schema.KINEMATICS, schema.KINEMATICS_ERRORS, schema.KINEMATICS_CONTRADICTIONS),
    sections=_LEARNING,
    does="kinematics from networks and simulation",
)
def kinematics(results: "ScenarioResults") -> None:
    """Evaluate the paper's kinematic equations with networks and simulated clearances; compare with
    the simulation."""
    from jointgap.scenario.kinematics import kinematics as tables_of
    from jointgap.scenario.trained import trained_surrogates

    scenario, points = results.scenario, results.scenario.surrogate.training_points
    motion = results.read("trajectory"), trained_surrogates(results)
    results.write_all(tables_of(scenario.mechanism.applied(), scenario.simulate, points, *motion))


@SCENARIO_STAGES.stage(
    reads=_TRAINED,
    writes=tuple(table for table in schema.TABLES.values() if table.path.startswith("optimise/")),
    sections=_OPTIMUM,
    does="optimise the link lengths",
)
def optimise(results: "ScenarioResults") -> None:
    """Optimise the link lengths for the configured objective, and simulate the optima again."""
    from jointgap.lengths.optimise import optimise as find_optima
    from jointgap.scenario.trained import trained_surrogates

    scenario, points = results.scenario, results.scenario.surrogate.training_points
    motion = results.read("trajectory"), trained_surrogates(results)
    mechanism = scenario.mechanism.applied()
    results.write_all(find_optima(mechanism, scenario.simulate, scenario.optimise, points, *motion))


_COMPUTED = (*_TRAINED, *SCENARIO_STAGES.written_by("kinematics", "optimise"))


@SCENARIO_STAGES.stage(reads=_COMPUTED, sections=_DRAWN, does="draw the figures")
def figures(
    results: "ScenarioResults",
    names: Annotated[
        Sequence[str],
        Option(
            "--figure",
            multiple=True,
            help="Name of a figure, repeatable; all still figures when absent.",
        ),
    ] = (),
) -> None:
    """Draw the figures, the paper's and others: SVG, PNG and the plotted data."""
    from jointgap.core import plot
    from jointgap.scenario.figure_data import revolution
    from jointgap.scenario.figures import FIGURES, draw
    from jointgap.scenario.trained import predictions, trained_surrogates

    names = names or drawn(results.scenario.networks)
    tables = set(FIGURES.needed_tables(names))
    frames = results.read_all(tables - {"predictions"})
    if "predictions" in tables:
        samples = revolution(frames["trajectory"], results.scenario, 1)
        frames["predictions"] = predictions(trained_surrogates(results), samples)
    for name in names:
        plot.save(draw(name, frames, results.scenario), results.path / "figures" / name)


@SCENARIO_STAGES.stage(
    reads=(schema.TRAJECTORY, schema.EVENTS),
    files=("figures/animation.gif", IMPACTS_PAGE),
    sections=_DRAWN,
    does="animate, and write the page of the impacts",
)
def animate(results: "ScenarioResults") -> None:
    """Draw the animation (GIF and plotted data) and write the page of `jointgap explore`."""
    figures(results, ("animation",))
    explore(results)


@SCENARIO_STAGES.stage(
    reads=(schema.TRAJECTORY, schema.EVENTS), files=(IMPACTS_PAGE,), sections=_MOTION
)
def explore(results: "ScenarioResults") -> None:
    """Write figures/impacts.html: gaps, contact forces and modes over the crank angle, with zoom.

    The page (5 MB or more) is self-contained and opens in any browser offline. Requires plotly.
    """
    from jointgap.scenario.impacts_page import impacts_page

    page = impacts_page(
        results.read("trajectory"), results.read("events"), results.scenario, results.name
    )
    write_text(results.path / IMPACTS_PAGE, page)


@SCENARIO_STAGES.stage(
    reads=_COMPUTED,
    writes=(schema.COMPARISON,),
    files=("comparison.md", "comparison.html"),
    sections=_PAGE,
    does="compare with the paper",
)
def compare(
    results: "ScenarioResults",
    siblings: Annotated[
        Sequence[tuple[str, str]],
        Option(
            "--beside",
            nargs=2,
            multiple=True,
            help=(
                "Name and options of a scenario that differs only in its loose joints; its results"
                " are in the folder next to --results. Repeatable."
            ),
        ),
    ] = (),
) -> None:
    """Compare every number and claim of the paper with the results."""
    from jointgap.core.page import write_page
    from jointgap.paper.compare import NEEDED, comparison_page, variant_optimum
    from jointgap.paper.compare import compare as compared

    frames = results.read_all(NEEDED)  # first: rejects a trajectory of other options
    variants = [(results.path.name, results)]
    variants += [(name, open_results(text, results.path.parent / name)) for name, text in siblings]
    optima = [
        variant_optimum(name, variant.scenario, variant.read("optimise_resimulated"))
        for name, variant in variants
    ]
    result = compared(frames, results.scenario, optima)
    write_page(results.path / "comparison", comparison_page(result, results.scenario))
    results.write("comparison", result)


@SCENARIO_STAGES.stage(
    reads=_COMPUTED,
    files=("summary.json", "summary.md", "summary.html"),
    sections=_PAGE,
    does="write the summary page",
    after=("figures", "animate"),
)
def summarise(results: "ScenarioResults") -> str:
    """Write the summary page: lengths, gain, side effects and remarks.

    The page includes the figures in the scenario's folder.
    """
    from jointgap.core.page import write_page
    from jointgap.scenario.chosen_lengths import NEEDED, choose_lengths, document
    from jointgap.scenario.repeatability import samples_repeat_until
    from jointgap.scenario.summary_page import page

    scenario, name = results.scenario, results.path.name
    tables = [*NEEDED, "fit_errors"] if scenario.networks else NEEDED
    lengths = choose_lengths(results.read_all(tables), scenario)
    summary = document(lengths, name)
    repeat_until = samples_repeat_until(scenario.mechanism, scenario.simulate)
    write_page(results.path / "summary", page(lengths, name, repeat_until), "figures")
    text = json.dumps(summary, indent=2, ensure_ascii=False)
    write_text(results.path / "summary.json", f"{text}\n")
    return "\n".join([summary["headline"], *(f"- {remark}" for remark in summary["remarks"])])


@SCENARIO_STAGES.stage(
    reads=(*_COMPUTED, schema.COMPARISON),
    files=(PUBLISHED,),
    sections=_PAGE,
    does="publish to MLflow",
    after=("figures", "animate"),
    minutes=20,
    publishes=True,
)
def track(results: "ScenarioResults") -> None:
    """Publish a scenario's tables and figures to MLflow; repeated publishing adds nothing."""
    from jointgap.core.errors import InputError
    from jointgap.core.publish import publish_records
    from jointgap.scenario.mlflow_runs import scenario_records

    if not (files := results.files(SCENARIO_STAGES["track"].reads)):
        raise InputError(
            f"{results.path}: no tables to publish; give the results folder of a scenario"
        )
    sections = {stage.name: stage.sections for stage in SCENARIO_STAGES.values()}
    records = scenario_records(results.scenario, sections, files, results.path)
    folder = results.path.resolve().parent
    summary = publish_records(results.name, results.scenario.description, records, None, folder)
    write_text(results.path / PUBLISHED, json.dumps(summary, indent=2) + "\n")
