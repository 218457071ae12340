"""The command line: one subcommand per stage. Only here do stages meet files."""

import sys
from pathlib import Path

import click

IN = click.Path(dir_okay=False, path_type=Path)
OUT = click.Path(dir_okay=False, path_type=Path)

options_option = click.option(
    "--options", required=True, help="The scenario: JSON text, or the path of a YAML or JSON file (config/README.md)."
)


def need(flag: str, meaning: str, kind: click.Path = IN):
    """A required option that names a file."""
    return click.option(flag, type=kind, required=True, help=meaning)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="jointgap")
def cli() -> None:
    """Slider-cranks with loose joints: simulate, learn, optimise, compare.

    Every stage reads and writes Parquet files whose columns carry units; `jointgap describe FILE` shows them.
    """


@cli.command()
@options_option
@need("--trajectory", "Parquet file to write: motion and forces at samples uniform in crank angle.", OUT)
@need("--events", "Parquet file to write: beginnings and ends of contact.", OUT)
def simulate(options: str, trajectory: Path, events: Path) -> None:
    """Simulate the mechanism with contact in its clearance joints."""
    from jointgap import tables
    from jointgap.config import parse_options
    from jointgap.dynamics import simulate

    scenario = parse_options(options)
    run = simulate(scenario.mechanism, scenario.simulate)
    tables.write(tables.EVENTS, run.events, events)
    tables.write(tables.TRAJECTORY, run.samples, trajectory)


@cli.command()
@click.argument("file", type=IN)
def describe(file: Path) -> None:
    """Show the columns of a Parquet FILE with their units and meaning."""
    from rich.console import Console
    from rich.table import Table

    from jointgap.tables import describe

    shown = Table("column", "unit", "description", title=str(file))
    for row in describe(file).itertuples(index=False):
        shown.add_row(*row)
    Console().print(shown)


@cli.command()
@click.argument("file", type=IN)
@click.option("--scenario", help="Name of the scenario; the first one of `run` when absent.")
def config(file: Path, scenario: str | None) -> None:
    """Check the configuration FILE and print one scenario of it, complete and in SI, as JSON for --options."""
    from jointgap.config import read_yaml, resolve
    from jointgap.errors import InputError, did_you_mean

    scenarios = resolve(read_yaml(file), (Path(), file.parent, file.parent.parent), str(file))
    name = scenario or next(iter(scenarios))
    if name not in scenarios:
        raise InputError(f"{file}: no scenario '{name}' in run; {did_you_mean(name, scenarios)}")
    click.echo(scenarios[name].model_dump_json(indent=2))


@cli.command()
@click.option("--write", "path", type=OUT, help="File to write; printed when absent.")
def schema(path: Path | None) -> None:
    """Give the JSON schema of a configuration, for editors that complete and check YAML."""
    import json

    from jointgap.config import json_schema
    from jointgap.tables import write_whole

    text = json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"
    if path is None:
        click.echo(text, nl=False)
    else:
        write_whole(path, lambda temporary: Path(temporary).write_text(text, encoding="utf-8"))


def main() -> None:
    """Run the command line; a mistake in the input ends with its message and exit code 2, not a traceback."""
    from jointgap.errors import InputError, SimulationError

    try:
        cli()
    except (InputError, SimulationError) as error:
        for line in str(error).splitlines():
            click.echo(f"jointgap: error: {line}", err=True)
        sys.exit(2)
