"""The catalogue of effects on the screen."""

import click

from jointgap.cli.group import cli

WIDTH = 100  # columns; also where the output is no terminal and its width unknown


@cli.command()
@click.argument("name", required=False)
def effects(name: str | None) -> None:
    """Show the physical effects that a mechanism file can list: law, parameters with units and bounds, reference; and
    the faults of sensors that a campaign looks for.

    With NAME, show that effect in full, and what to paste into the mechanism file.
    """
    from jointgap.config import EFFECTS
    from jointgap.errors import InputError, did_you_mean
    from jointgap.slider_crank.sensor_faults import FAULTS

    if name is None:
        _catalogue(EFFECTS)
        _faults(FAULTS)
    elif name in FAULTS:
        _faults({name: FAULTS[name]})
    elif name in EFFECTS:
        _page_of(name, EFFECTS[name])
    else:
        raise InputError(f"effect '{name}': no such effect; {did_you_mean(name, [*EFFECTS, *FAULTS])}")


def _limits(row) -> str:
    """Bounds and unit of a parameter; empty for text and mappings."""
    return f"{row.bounds or 'any'} {row.unit if row.unit != '1' else ''}".rstrip() if row.unit else ""


def _catalogue(catalogue) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from jointgap.effects.describe import parameters_of

    shown = Table(show_lines=True, width=WIDTH, highlight=False)
    shown.add_column("effect, site", width=24, overflow="fold")
    shown.add_column("law, reference")
    shown.add_column("parameters", width=34, overflow="fold")
    for name, effect in catalogue.items():
        rows = (f"{row.name}: {limits}" if (limits := _limits(row)) else row.name for row in parameters_of(effect))
        shown.add_row(
            Text.assemble((name, "bold"), "\n", effect.SITE),
            Text.assemble(effect.LAW, "\n", (effect.REFERENCE, "dim")),
            Text("\n".join(rows)),
        )
    console = Console(width=WIDTH)
    console.print(shown)
    console.print(
        "v, x: slider's velocity, position; w, theta: crank's speed, angle; t: time.\n"
        "None acts unless it is listed. One in full, with what to paste: jointgap effects NAME",
        markup=False,
        highlight=False,
    )


def _faults(faults) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    shown = Table(show_lines=True, width=WIDTH, highlight=False)
    shown.add_column("fault of a sensor", width=24, overflow="fold")
    shown.add_column("reading y of the true u")
    shown.add_column("parameter", width=22, overflow="fold")
    for name, fault in faults.items():
        unit = {"": "channel's unit", "1": ""}.get(fault.unit, fault.unit)
        shown.add_row(Text(name, "bold"), Text(fault.law), Text(f"{fault.parameter} {unit}".rstrip()))
    Console(width=WIDTH).print(shown)


def _page_of(name: str, effect) -> None:
    import inspect
    import textwrap

    import yaml

    from jointgap.effects.describe import example, parameters_of

    click.echo(click.style(name, bold=True))
    for label, text in (
        ("", inspect.cleandoc(effect.__doc__).replace("\n\n", " ")),
        ("site: ", effect.SITE),
        ("law: ", effect.LAW),
        ("reference: ", effect.REFERENCE),
    ):
        click.echo(textwrap.fill(label + " ".join(text.split()), WIDTH, subsequent_indent=" " * len(label)))
    click.echo("parameters:")
    for row in parameters_of(effect):
        default = f", default {row.default}" if row.default else ""
        limits = _limits(row)
        click.echo(
            textwrap.fill(
                f"  {row.name}{f' [{limits}]' if limits else ''}{default}: {row.meaning}",
                WIDTH,
                subsequent_indent="    ",
            )
        )
    click.echo("\nin the mechanism file:\n")
    snippet = yaml.safe_dump({"effects": [example(effect)]}, sort_keys=False, width=WIDTH)
    click.echo(textwrap.indent(snippet, "    "), nl=False)
