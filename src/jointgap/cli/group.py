"""The group of all subcommands, and what they share."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:  # loads pandas
    from jointgap.stages.scenario_results import ScenarioResults

FILE = click.Path(dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

options_option = click.option(
    "--options", required=True, help="The scenario: path of a YAML or JSON file (config/README.md), or JSON text."
)

workers_option = click.option(
    "--workers", type=click.IntRange(min=1), help="Runs side by side; as many as there are cores when absent."
)


def need(flag: str, meaning: str, kind: click.Path = FILE) -> Decorator:
    """A required option `flag` that names a file, or a folder if `kind` is `FOLDER`; `meaning` is its help."""
    return click.option(flag, type=kind, required=True, help=meaning)


def open_results(options: str, path: Path, places: Mapping[str, Path] | None = None) -> "ScenarioResults":
    """The results of a scenario.

    Parameters
    ----------
    options : str
        Value of ``--options``.
    path : Path
        The scenario's folder.
    places : mapping of str to Path, optional
        Files of tables that lie elsewhere, by the table's name.
    """
    from jointgap.config import parse_options
    from jointgap.stages.scenario_results import ScenarioResults

    return ScenarioResults(path, parse_options(options), places)


def add_command(name: str, text: str, command: Callable[..., Any], options: Sequence[Decorator]) -> None:
    """Add a subcommand.

    Parameters
    ----------
    name, text : str
        What it is called, and its help.
    command : callable
        Takes the values of the options; what it returns is shown.
    options : sequence of decorators
        As of `click.option`.
    """

    def show(**given: Any) -> None:
        if shown := command(**given):
            click.echo(shown)

    for option in reversed(options):
        show = option(show)
    cli.command(name, help=text)(show)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="jointgap")
def cli() -> None:
    """Slider-cranks with loose joints: simulate, learn, optimise, compare.

    Every stage reads and writes Parquet files whose columns carry units; `jointgap describe FILE` shows them.
    """
