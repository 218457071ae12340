"""The study of clearance, speed and friction."""

from pathlib import Path

import click

from jointgap.cli.ensemble_commands import workers_option
from jointgap.cli.group import IN, OUT, cli, need, options_option


@cli.command()
@options_option
@click.option(
    "--folder",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="Folder to write points.parquet, the figures and summary.md to.",
)
@click.option(
    "--points", "parts", type=IN, multiple=True, help="What `study-points` wrote, repeatable; simulated when absent."
)
@workers_option
def study(options: str, folder: Path, parts: tuple[Path, ...], workers: int | None) -> None:
    """Map what clearance, speed and friction do: peak force, transmission angle, contact, acceleration orders, jerk.

    The scenario's section `study` says which values. Each point is simulated from several starts; points where only
    statistics hold are marked.

    \b
    Example:
      cat > mine.yaml <<END
      mechanism: config/mechanisms/erkaya2009.yaml
      study:
        clearance: [0.1 mm, 0.3 mm, 1 mm]
        speed: {from: 300 rpm, to: 900 rpm, number: 3}
        friction: [0, 0.1]
      END
      jointgap study --options mine.yaml --folder results/mine
    """
    from jointgap import tables
    from jointgap.config import parse_options
    from jointgap.figures import style
    from jointgap.sweep.study_figures import draw_study
    from jointgap.sweep.study_page import summary
    from jointgap.sweep.study_points import join_points, simulate_points

    scenario = parse_options(options)
    place, text = folder / "points.parquet", folder / "summary.md"
    tables.check_writable(place, text)
    frames = [tables.read(tables.STUDY, part) for part in parts] or [simulate_points(scenario, workers=workers)]
    points = join_points(frames, scenario.study)
    tables.write(tables.STUDY, points, place)
    words = summary(points, scenario)
    tables.write_text(text, words)
    for name, drawing in draw_study(points, scenario).items():
        style.save(drawing, folder / name)
    click.echo(words)


@cli.command("study-points")
@options_option
@click.option(
    "--speed", "number", type=click.IntRange(min=0), required=True, help="Which of the speeds, counted from 0."
)
@need("--points", "Parquet file to write: the points of this speed.", OUT)
@workers_option
def study_points(options: str, number: int, points: Path, workers: int | None) -> None:
    """Simulate one speed of the study, for `jointgap study --points`."""
    from jointgap import tables
    from jointgap.config import parse_options
    from jointgap.sweep.study_points import simulate_points

    scenario = parse_options(options)
    tables.check_writable(points)
    tables.write(tables.STUDY, simulate_points(scenario, number, workers), points)
