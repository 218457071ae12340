"""The group of all subcommands, and what they share."""

from pathlib import Path

import click

IN = click.Path(dir_okay=False, path_type=Path)
OUT = click.Path(dir_okay=False, path_type=Path)

options_option = click.option(
    "--options", required=True, help="The scenario: JSON text, or the path of a YAML or JSON file (config/README.md)."
)

results_option = click.option(
    "--results",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="The scenario's results folder: tables are read and written at their places in it.",
)


def need(flag: str, meaning: str, kind: click.Path = IN):
    """A required option that names a file."""
    return click.option(flag, type=kind, required=True, help=meaning)


def opened(options: str, results: Path):
    """The scenario in `--options`, and its results folder."""
    from jointgap.config import parse_options
    from jointgap.results import Results

    scenario = parse_options(options)
    return scenario, Results(results, scenario)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="jointgap")
def cli() -> None:
    """Slider-cranks with loose joints: simulate, learn, optimise, compare.

    Every stage reads and writes Parquet files whose columns carry units; `jointgap describe FILE` shows them.
    """
