"""One subcommand per stage."""

from pathlib import Path

import click

from jointgap.cli.group import OUT, cli, need, opened, options_option, results_option


@cli.command()
@options_option
@need("--trajectory", "Parquet file to write: motion, forces and modes at samples uniform in crank angle.", OUT)
@need(
    "--events",
    "Parquet file to write: impacts and separations with approach speed, impulse, peak force, duration.",
    OUT,
)
def simulate(options: str, trajectory: Path, events: Path) -> None:
    """Simulate the slider-crank: each joint loose or ideal, with contact, friction and the effects that are listed.

    Reads the sections `mechanism` and `simulate` of the scenario: bodies, joints, contacts and effects; what drives the
    crank (constant speed, a measured angle or a motor), how long, and how exactly.

    Writes two tables (`jointgap describe FILE` explains their columns). Remarks, such as a contact law that delivers
    another restitution than the one asked for, go to the standard error output. A simulation that cannot go on ends with
    its time, crank angle and state, and writes nothing.

    \b
    Example:
      echo '{mechanism: config/mechanisms/erkaya2009.yaml, simulate: {speed: 300 rpm}}' > mine.yaml
      jointgap simulate --options mine.yaml --trajectory motion.parquet --events events.parquet

    Effects to switch on: `jointgap effects`. All keys: config/README.md.
    """
    from jointgap import tables
    from jointgap.config import parse_options
    from jointgap.dynamics import simulate
    from jointgap.dynamics.model.mechanism_warnings import remarks

    scenario = parse_options(options)
    tables.check_writable(trajectory, events)
    for remark in remarks(scenario.mechanism):
        click.echo(f"jointgap: {remark}", err=True)
    run = simulate(scenario.mechanism, scenario.simulate)
    tables.write(tables.EVENTS, run.events, events)
    tables.write(tables.TRAJECTORY, run.samples, trajectory)


@cli.command()
@options_option
@need("--trajectory", "Parquet file to read: the simulated motion.")
@click.option("--output-name", required=True, help="The output to learn: a column such as r2 or gamma3_ddot.")
@need("--fit", "Parquet file to write: weights of the networks, a row each.", OUT)
@need("--history", "Parquet file to write: error after every iteration.", OUT)
@need("--errors", "Parquet file to write: errors at and between the training points.", OUT)
def surrogate(options: str, trajectory: Path, output_name: str, fit: Path, history: Path, errors: Path) -> None:
    """Train the paper's network of one output with Levenberg-Marquardt."""
    from jointgap import tables
    from jointgap.config import parse_options
    from jointgap.errors import InputError, did_you_mean
    from jointgap.results import outputs_of, read_trajectory
    from jointgap.surrogate.train import train

    scenario = parse_options(options)
    outputs = outputs_of(scenario.mechanism)
    if output_name not in outputs:
        raise InputError(f"--output-name {output_name}: no such output; {did_you_mean(output_name, outputs)}")
    tables.check_writable(fit, history, errors)
    trained = train(read_trajectory(trajectory, scenario), output_name, scenario.surrogate)
    tables.write(tables.FIT_HISTORY, trained.history(), history)
    tables.write(tables.FIT_ERRORS, trained.errors(), errors)
    tables.write(tables.FIT, trained.weights(), fit)


@cli.command()
@options_option
@need("--trajectory", "Parquet file to read: the simulated motion, whose samples are held out.")
@need("--fit", "Parquet file to write: the networks of the loose joints, a row a neuron.", OUT)
@need("--errors", "Parquet file to write: errors at its own points and at the samples held out.", OUT)
def clearance(options: str, trajectory: Path, fit: Path, errors: Path) -> None:
    """Train the second surrogate: one network per loose joint for the clearance vector, all outputs from it."""
    from jointgap import tables
    from jointgap.config import parse_options
    from jointgap.dynamics import simulate
    from jointgap.results import outputs_of, read_trajectory
    from jointgap.surrogate.train_clearance import train_clearance

    scenario = parse_options(options)
    outputs_of(scenario.mechanism)  # complains where there is nothing to learn
    tables.check_writable(fit, errors)
    held_out = read_trajectory(trajectory, scenario)
    samples = scenario.simulate.samples_per_revolution * scenario.surrogate.clearance_sampling
    finer = scenario.simulate.model_copy(update={"revolutions": 1, "samples_per_revolution": samples})
    fine = simulate(scenario.mechanism, finer).samples  # the same motion; too large to keep
    trained = train_clearance(held_out, fine, scenario.surrogate, scenario.mechanism.applied().loose)
    tables.write(tables.FIT_ERRORS, trained.errors(), errors)
    tables.write(tables.CLEARANCE_FIT, trained.weights(), fit)


@cli.command()
@options_option
@results_option
def kinematics(options: str, results: Path) -> None:
    """Feed the paper's equations by networks and by the simulation, and hold them against the simulation."""
    from jointgap import tables
    from jointgap.kinematics import kinematics

    scenario, folder = opened(options, results)
    folder.check_writable("kinematics")
    found = kinematics(
        scenario.mechanism.applied(),
        scenario.simulate,
        scenario.surrogate.training_points,
        folder.read(tables.TRAJECTORY),
        folder.surrogates(),
    )
    folder.write(tables.KINEMATICS_ERRORS, found.errors)
    folder.write(tables.KINEMATICS_CONTRADICTIONS, found.contradictions)
    folder.write(tables.KINEMATICS, found.motion)


@cli.command()
@options_option
@results_option
def optimise(options: str, results: Path) -> None:
    """Search the link lengths for the transmission angle, and simulate again what was found."""
    from jointgap import tables
    from jointgap.optimise.optimise_stage import optimise

    scenario, folder = opened(options, results)
    folder.check_writable("optimise")
    found = optimise(
        scenario.mechanism.applied(),
        scenario.simulate,
        scenario.optimise,
        scenario.surrogate.training_points,
        folder.read(tables.TRAJECTORY),
        folder.surrogates(),
    )
    for table, frame in (
        (tables.POPULATION, found.population),
        (tables.PATHS, found.paths),
        (tables.TOLERANCE, found.tolerance),
        (tables.VALLEY, found.valley),
        (tables.FLOOR, found.floor),
        (tables.RESIMULATED, found.resimulated),
        (tables.WORTH, found.worth),
        (tables.OPTIMA, found.optima),
    ):
        folder.write(table, frame)


@cli.command()
@options_option
@results_option
@click.option("--figure", "names", multiple=True, help="Name of a figure, repeatable; all still figures when absent.")
@click.option("--folder", type=click.Path(file_okay=False, path_type=Path), required=True, help="Folder to write to.")
def figures(options: str, results: Path, names: tuple[str, ...], folder: Path) -> None:
    """Draw the paper's figures and ours: SVG, PNG, and the plotted data beside each."""
    from jointgap.figures.catalogue import FIGURES, needed_tables
    from jointgap.figures.draw_figures import draw_all
    from jointgap.figures.figure_data import predictions
    from jointgap.results import PLACES

    wanted, (scenario, stored) = names or FIGURES, opened(options, results)
    needed = needed_tables(wanted)
    frames = stored.frames(name for name in needed if name in PLACES)
    if "predictions" in needed:
        frames["predictions"] = predictions(stored.surrogates(), frames["trajectory"], scenario)
    draw_all(frames, scenario, folder, wanted)


@cli.command()
@options_option
@results_option
@click.option(
    "--beside",
    nargs=2,
    multiple=True,
    help="Name and options of a scenario, in the folder beside --results, that differs in its loose joints alone; repeatable.",
)
def compare(options: str, results: Path, beside: tuple[tuple[str, str], ...]) -> None:
    """Put every number and claim of the paper beside ours."""
    from jointgap import tables
    from jointgap.paper.comparison import NEEDED, compare
    from jointgap.paper.comparison_page import page
    from jointgap.paper.looseness_variants import variant_optimum
    from jointgap.report.page import to_html, to_markdown

    scenario, folder = opened(options, results)
    texts = {results / "comparison.html": to_html, results / "comparison.md": to_markdown}
    tables.check_writable(*texts, results / "comparison.parquet")
    frames = folder.frames(NEEDED)
    others = {name: opened(more, results.parent / name) for name, more in beside}
    variants = [
        variant_optimum(name, one, place.read(tables.RESIMULATED))
        for name, (one, place) in {results.name: (scenario, folder), **others}.items()
    ]
    found = compare(frames, scenario, variants)
    for path, write in texts.items():
        tables.write_text(path, write(page(found, scenario)))
    folder.write(tables.COMPARISON, found)


@cli.command()
@options_option
@results_option
@click.option("--scenario", required=True, help="Name of the scenario: with stage and output it identifies a run.")
@click.option("--store", type=click.Path(file_okay=False, path_type=Path), required=True, help="Folder of the store.")
@need("--published", "JSON file to write: what was published where.", OUT)
def track(options: str, results: Path, scenario: str, store: Path, published: Path) -> None:
    """Publish a scenario's tables and figures to MLflow; nothing twice."""
    import json

    from jointgap import tables
    from jointgap.errors import InputError
    from jointgap.track.publish import publish

    section, folder = opened(options, results)
    if not (files := folder.files()):
        raise InputError(f"{results}: holds no tables, so there is nothing to publish; give a scenario's folder")
    summary = publish(
        scenario,
        section,
        files,
        sorted(path for path in (results / "figures").glob("*") if path.suffix in (".svg", ".png", ".gif")),
        sorted((results / "benchmarks").rglob("*.tsv")),
        None,
        store,
    )
    tables.write_text(published, json.dumps(summary, indent=2) + "\n")
