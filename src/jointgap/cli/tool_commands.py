"""Subcommands beside the stages: look at files, check a configuration."""

from pathlib import Path

import click

from jointgap.cli.group import FILE, FOLDER, cli


@cli.command()
@click.option(
    "--results",
    type=FOLDER,
    default=Path("results"),
    show_default=True,
    help="Folder that holds the default store.",
)
@click.option("--port", type=click.IntRange(1, 65535), default=5000, show_default=True, help="First port to try.")
def dashboard(results: Path, port: int) -> None:
    """Open MLflow's pages on this machine and print an address that compares the scenarios.

    \f
    Parameters
    ----------
    results : Path
        Folder that holds the default store.
    port : int
        First port to try.
    """
    from jointgap.track.dashboard import dashboard

    dashboard(results, port, say=click.echo)


@cli.command()
@click.argument("file", type=FILE)
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
@click.argument("file", type=FILE)
@click.option("--scenario", help="Name of the scenario; the first one of `run` when absent.")
def config(file: Path, scenario: str | None) -> None:
    """Check the configuration FILE and print one scenario of it, complete and in SI, as JSON for --options.

    \f
    Parameters
    ----------
    file : Path
        The configuration.
    scenario : str, optional
        Name; the first one of `run` when absent.
    """
    from jointgap.config import read_yaml, resolve
    from jointgap.errors import InputError, did_you_mean

    scenarios = resolve(read_yaml(file), (Path(), file.parent, file.parent.parent), str(file))
    name = scenario or next(iter(scenarios))
    if name not in scenarios:
        raise InputError(f"{file}: no scenario '{name}' in run; {did_you_mean(name, scenarios)}")
    click.echo(scenarios[name].model_dump_json(indent=2))


@cli.command()
@click.option("--write", "path", type=FILE, help="File to write; printed when absent.")
@click.option("--campaign", is_flag=True, help="Of a campaign file, not of a configuration.")
def schema(path: Path | None, campaign: bool) -> None:
    """Give the JSON schema of a configuration or a campaign, for editors that complete and check YAML.

    \f
    Parameters
    ----------
    path : Path, optional
        File to write; printed when absent.
    campaign : bool
        Of a campaign file, not of a configuration.
    """
    import json

    from jointgap import tables
    from jointgap.config import json_schema
    from jointgap.config.load import campaign_json_schema

    text = json.dumps(campaign_json_schema() if campaign else json_schema(), indent=2, ensure_ascii=False) + "\n"
    if path is None:
        click.echo(text, nl=False)
    else:
        tables.write_text(path, text)
