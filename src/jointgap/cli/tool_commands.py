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
@click.option("--browser/--no-browser", default=True, show_default=True, help="Open the comparison in the browser.")
def dashboard(results: Path, port: int, browser: bool) -> None:
    """Serve MLflow's pages on this machine, open the comparison of the scenarios, and print its address."""
    from jointgap.track.dashboard import dashboard

    dashboard(results, port, say=click.echo, browse=browser)


@cli.command()
@click.argument("file", type=FILE)
def describe(file: Path) -> None:
    """Show the columns of a Parquet FILE with their units and meaning."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from jointgap.tables import describe

    shown = Table("column", "unit", "description", title=Text(str(file)))
    for row in describe(file).itertuples(index=False):
        shown.add_row(*map(Text, row))  # of a plain string rich takes what stands in brackets for its own marks
    Console().print(shown)


@cli.command()
@click.argument("source", metavar="FILE_OR_FOLDER", type=click.Path(exists=True, path_type=Path))
@click.option("--to", type=FOLDER, help="Folder to write into; beside each Parquet file when absent.")
@click.option(
    "--unit",
    "units",
    multiple=True,
    help="Unit to write instead of the SI unit of its dimension, such as mm, deg or rpm; repeatable.",
)
@click.option("--force", is_flag=True, help="Write over files that are there.")
def export(source: Path, to: Path | None, units: tuple[str, ...], force: bool) -> None:
    """Write a Parquet FILE, or all of a FOLDER, as CSV with the unit behind each name, for spreadsheets and MATLAB.

    \b
    Example:
      jointgap export results/paper/simulate --to csv --unit mm --unit deg --unit rpm
    """
    from jointgap.tables.export import export as exported

    for path in exported(source, to, units, force):
        click.echo(path)


@cli.command()
@click.argument("files", type=FILE, nargs=-1, required=True)
@click.option("--scenario", help="Name of the scenario; the first one of `run` when absent.")
@click.option("--sources", is_flag=True, help="Print a table instead: each key, its value as written, and its file.")
def config(files: tuple[Path, ...], scenario: str | None, sources: bool) -> None:
    """Check the configuration FILES, each laid over those before it, and print one scenario, complete and in SI, as
    JSON for --options.
    """
    from jointgap.config import load, read_yaml
    from jointgap.config.layers import Layer, merged
    from jointgap.errors import InputError, did_you_mean
    from jointgap.link_lengths.region import check_constraints

    layers = [Layer(str(file), read_yaml(file)) for file in files]
    folders = (Path(), *(folder for file in reversed(files) for folder in (file.parent, file.parent.parent)))
    source = " with ".join(map(str, files))
    scenarios = load.resolve(merged(layers), folders, source)
    check_constraints(scenarios, source)
    name = scenario or next(iter(scenarios))
    if name not in scenarios:
        raise InputError(f"{source}: no scenario '{name}' in run; {did_you_mean(name, scenarios)}")
    if not sources:
        click.echo(scenarios[name].model_dump_json(indent=2))
        return
    rows = load.sources_of(scenarios[name], name, layers, folders)
    widths = [max(len(row[place]) for row in rows) for place in (0, 1)]
    for key, source, value in rows:
        click.echo(f"{key:<{widths[0]}}  {source:<{widths[1]}}  {value}")


@cli.command()
@click.option("--write", "path", type=FILE, help="File to write; printed when absent.")
@click.option("--campaign", is_flag=True, help="Of a campaign file, not of a configuration.")
def schema(path: Path | None, campaign: bool) -> None:
    """Give the JSON schema of a configuration or a campaign, for editors that complete and check YAML."""
    import json

    from jointgap import tables
    from jointgap.config import json_schema
    from jointgap.config.load import campaign_json_schema

    text = json.dumps(campaign_json_schema() if campaign else json_schema(), indent=2, ensure_ascii=False) + "\n"
    if path is None:
        click.echo(text, nl=False)
    else:
        tables.write_text(path, text)
