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
    """The results of a scenario."""
    from jointgap.config import parse_options
    from jointgap.stages.scenario_results import ScenarioResults

    return ScenarioResults(path, parse_options(options), places)


def add_command(name: str, text: str, command: Callable[..., Any], options: Sequence[Decorator], section: str) -> None:
    """Add a subcommand."""

    def show(**given: Any) -> None:
        if shown := command(**given):
            click.echo(shown)

    for option in reversed(options):
        show = option(show)
    cli.command(name, help=text)(show)
    if all(name not in names for names in cli.sections.values()):
        cli.sections[section].append(name)


class SectionedGroup(click.Group):
    """A group whose help lists the subcommands by what they are for."""

    sections: dict[str, list[str]]
    """Names of subcommands by heading, in order."""

    removed: dict[str, str]
    """Commands of earlier versions, with what to use instead."""

    def resolve_command(self, ctx: click.Context, args: list[str]):
        """The subcommand that `args` name; of one that is gone a line with what to use instead."""
        if args and args[0] in self.removed:
            ctx.fail(f"{args[0]} is gone; {self.removed[args[0]]}.")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the subcommands of `ctx` with the `formatter`, a section for each heading."""
        shown = {name for name in self.list_commands(ctx) if not self.commands[name].hidden}
        longest = max(map(len, shown))
        for heading, names in self.sections.items():
            rows = [
                (f"{name:<{longest}}", self.commands[name].get_short_help_str(formatter.width - longest - 6))
                for name in names
                if name in shown
            ]
            with formatter.section(heading):
                formatter.write_dl(rows)


@click.group(cls=SectionedGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="jointgap")
def cli() -> None:
    """Slider-cranks with loose joints: simulate, learn, optimise, compare.

    `make run` and `make campaign` call the stages of the workflow in their order. Every stage reads and writes Parquet
    files whose columns carry units; `jointgap describe FILE` shows them.
    """


cli.removed = dict.fromkeys(("study", "study-points"), "use `jointgap sweep` with sweep.design: grid")

OF_SCENARIO, OF_CAMPAIGN, OF_TRIALS = (
    f"Workflow: {part}" for part in ("stages of a scenario", "stages of a campaign", "blind trials")
)
"""Headings of the subcommands that the workflow calls."""

cli.sections = {
    "Your mechanism": ["simulate", "ensemble", "growth", "cycles", "effects"],
    "Your measurement": ["preflight", "analyse", "trend"],
    "Results": ["dashboard", "describe", "export"],
    "Configuration": ["config", "schema"],
    **{heading: [] for heading in (OF_SCENARIO, OF_CAMPAIGN, OF_TRIALS)},
}
