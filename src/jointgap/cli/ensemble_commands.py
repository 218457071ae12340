"""Many motions at once."""

import math
from pathlib import Path

import click

from jointgap.cli.group import FOLDER, cli, need, options_option, workers_option


@cli.command()
@options_option
@need("--folder", "Folder to write samples.parquet, events.parquet and runs.parquet to.", FOLDER)
@workers_option
def ensemble(options: str, folder: Path, workers: int | None) -> None:
    """Simulate many motions: every combination of varied values, each from several starts.

    The scenario's section `ensemble` says what varies: speed, clearance, friction and restitution (of all loose
    joints), or any key by its path. A run that fails is reported in runs.parquet with its reason; the others go on.

    \b
    Example:
      cat > mine.yaml <<END
      mechanism: config/mechanisms/erkaya2009.yaml
      simulate: {revolutions: 10, samples_per_revolution: 720, tolerance: 1e-9 m}
      ensemble:
        vary:
          speed: {from: 200 rpm, to: 1200 rpm, number: 6}
          friction: [0, 0.05, 0.2]
          mechanism.slider.mass: [0.3 kg, 0.6 kg]
        members: 5
      END
      jointgap ensemble --options mine.yaml --folder results/mine
    """
    from jointgap.config import parse_options
    from jointgap.ensembles.ensemble import ensemble_runs, write_ensemble

    scenario = parse_options(options)
    varied = scenario.ensemble
    total = math.prod(map(len, varied.vary.values())) * varied.members
    written = write_ensemble(ensemble_runs(scenario.mechanism, scenario.simulate, varied), folder, workers, total)
    for run, reason in written.reasons.items():
        click.echo(f"jointgap: run {run} failed: {reason}", err=True)
    click.echo(
        f"{folder}: {written.runs} runs, {written.failed} failed; {written.events} events, {written.steps} steps"
    )


@cli.command()
@options_option
@need("--growth", "Parquet file to write: growth of the change over the crank angle.")
@click.option("--change", default="1e-11 m", show_default=True, help="Size of the change of the start.")
@workers_option
def growth(options: str, growth: Path, change: str, workers: int | None) -> None:
    """Tell how far samples of a motion can be compared, and from where on statistics alone.

    Simulates the scenario's motion again from starts that differ by a hair, and prints what the difference grows to. In
    a chaotic motion another code, or the same on another machine, gives other samples after that angle.
    """
    from jointgap import tables
    from jointgap.config import parse_options
    from jointgap.ensembles.growth import measure_growth
    from jointgap.errors import InputError

    scenario, size = parse_options(options), _quantity("--change", change, "m")
    tables.check_writable(growth)
    if not size > 0:
        raise InputError(f"--change {change!r}: must be a positive length, e.g. '1e-11 m'")
    result = measure_growth(scenario.mechanism, scenario.simulate, size, workers=workers)
    tables.write(tables.GROWTH, result.frame(), growth)
    click.echo(result.verdict)


@cli.command()
@options_option
@need("--trajectory", "Parquet file to read: the simulated motion.")
@need("--events", "Parquet file to read: its events.")
@need(
    "--folder",
    "Folder to write section.parquet, revolutions.parquet, impacts.parquet and eccentricity.parquet to.",
    FOLDER,
)
@click.option("--angle", default="0 deg", show_default=True, help="Crank angle of the Poincare section.")
@click.option(
    "--first-revolution",
    type=click.IntRange(min=1),
    default=2,
    show_default=True,
    help="First revolution that counts as settled.",
)
def cycles(options: str, trajectory: Path, events: Path, folder: Path, angle: str, first_revolution: int) -> None:
    """Statistics over revolutions: contact, impacts, orbits, Poincare section, and whether the motion repeats."""
    from jointgap import tables
    from jointgap.config import parse_options
    from jointgap.ensembles.cycle_statistics import cycles
    from jointgap.stages.scenario_results import read_trajectory

    scenario, turned = parse_options(options), _quantity("--angle", angle, "rad")
    places = [folder / f"{name}.parquet" for name in ("section", "revolutions", "impacts", "eccentricity")]
    tables.check_writable(*places)
    samples, rows = read_trajectory(trajectory, scenario), tables.read(tables.EVENTS, events)
    statistics = cycles(samples, rows, scenario.mechanism, scenario.simulate, first_revolution, turned)
    frames = (
        (tables.POINCARE_SECTION, statistics.section),
        (tables.JOINT_REVOLUTIONS, statistics.revolutions),
        (tables.IMPACT_DISTRIBUTION, statistics.impacts),
        (tables.ECCENTRICITY, statistics.eccentricity),
    )
    for (table, frame), place in zip(frames, places, strict=True):
        tables.write(table, frame, place)
    click.echo(statistics.summary)


def _quantity(option: str, text: str, unit: str) -> float:
    """The value of an option in `unit`."""
    from jointgap.errors import InputError
    from jointgap.quantities import to_si

    try:
        return to_si(text, unit)
    except ValueError as error:
        raise InputError(f"{option} {text!r}: {error}") from error
