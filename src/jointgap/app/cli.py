"""The command line."""

import errno
import gc
import json
import os
import signal
import sys
import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.core import schema as known
from jointgap.core.files import check_writable, package_data, write_text
from jointgap.core.progress import progress_listener
from jointgap.core.stage import Option, Stage, Stages, options_of
from jointgap.designs.stages import DESIGN_STAGES
from jointgap.scenario.stages import SCENARIO_STAGES, open_results

FILE = click.Path(dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)


def required(flag: str, meaning: str, kind: click.Path = FILE) -> Callable:
    """A required option `flag` for a file, or for a folder if `kind` is `FOLDER`."""
    return click.option(flag, type=kind, required=True, help=meaning)


def click_option(name: str, option: Option) -> Callable:
    """The option or argument of a command for an `option` of a stage."""
    settings = dict(option.settings)
    if "type" in settings:
        kind = settings["type"]
        settings["type"] = {"file": FILE, "folder": FOLDER}.get(kind) or click.IntRange(min=kind)
    if not option.flags[0].startswith("-"):
        return click.argument(name, **settings)
    return click.option(*option.flags, name, **settings)


def add_command(stages: Stages, stage: Stage, section: str) -> None:
    """Add the subcommand of a stage."""
    state_options = options_of(stages.open_state)

    def command(**values: Any) -> None:
        arguments = {name: values.pop(name) for name in state_options}
        if text := stages.run(stages[stage.name], stages.open_state(**arguments), **values):
            click.echo(text)

    options = state_options | options_of(stages.run) | options_of(stage.function)
    for name, option in reversed(options.items()):
        command = click_option(name, option)(command)
    cli.command(stage.name, help=stage.help)(command)
    if not any(stage.name in names for names in cli.sections.values()):
        cli.sections[section].append(stage.name)


REMOVED = package_data("app/removed.yaml")
"""Commands and options of earlier versions, with what to use instead."""


class SectionedGroup(click.Group):
    """A group whose help lists the subcommands by purpose."""

    sections: dict[str, list[str]]
    """Names of subcommands by heading, in order."""

    def resolve_command(self, ctx: click.Context, args: list[str]):
        """The subcommand in `args`; a removed one fails with its replacement."""
        if args and (hint := REMOVED["commands"].get(args[0])):
            ctx.fail(f"{args[0]} was removed; {hint}.")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the subcommand; Ctrl-C ends it with the exit code of an interrupted program."""
        try:
            return super().invoke(ctx)
        except click.NoSuchOption as error:
            if hint := REMOVED["options"].get(error.option_name):
                ctx.fail(f"{error.option_name} was removed; {hint}.")
            raise
        except KeyboardInterrupt:
            click.echo("jointgap: interrupted", err=True)
            ctx.exit(128 + signal.SIGINT)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the subcommands of `ctx` with the `formatter`, a section for each heading."""
        width = max(map(len, self.commands))
        for heading, names in self.sections.items():
            with formatter.section(heading):
                helps = (
                    self.commands[name].get_short_help_str(formatter.width - width - 6)
                    for name in names
                )
                names = (f"{name:<{width}}" for name in names)
                formatter.write_dl(list(zip(names, helps, strict=True)))


@click.group(
    cls=SectionedGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(package_name="jointgap")
def cli() -> None:
    """Slider-cranks and other linkages with loose joints: simulate, optimise, identify missing
    effects.

    `make run` and `make campaign` run all stages of the workflow. Stages read and write Parquet
    files with units; `jointgap describe FILE` shows them.
    """


OF_SCENARIO, OF_CAMPAIGN = (f"Workflow: stages of a {part}" for part in ("scenario", "campaign"))
cli.sections = {
    "Your mechanism": ["look", "simulate", "cycles", "effects"],
    "Your measurement": ["new", "measure", "preflight", "analyse", "analyse-model", "trend"],
    "Results": ["dashboard", "describe", "export"],
    "Configuration": ["config", "schema"],
    OF_SCENARIO: ["report", "overview"],
    OF_CAMPAIGN: [],
}

for _stages, _section in (
    (CAMPAIGN_STAGES, OF_CAMPAIGN),
    (SCENARIO_STAGES, OF_SCENARIO),
    (DESIGN_STAGES, OF_SCENARIO),
):
    for _stage in _stages.values():
        add_command(_stages, _stage, _section)


@cli.command()
@click.argument("campaign", type=FILE)
@click.option(
    "--folder",
    type=FOLDER,
    help="Folder of the campaign's results; default: results/campaigns/NAME.",
)
@click.option("--anyway", is_flag=True, help="Go on where channels contradict each other.")
def analyse(campaign: Path, folder: Path | None, anyway: bool) -> None:
    """Identify the effect that the model of CAMPAIGN lacks: all stages, up to verdict.json, summary
    and figures.

    `make campaign` does the same with parallel stages, resumes interrupted runs, and optimises
    again.
    """
    from jointgap.app.run_summary import verdict_lines
    from jointgap.campaign.analyse import analyse as analyse_campaign
    from jointgap.campaign.campaign_files import end_after_failures
    from jointgap.campaign.state import CampaignState

    state = CampaignState(campaign, folder)
    analyse_campaign(campaign, state.folder.path, pictures=True, anyway=anyway)
    click.echo("\n".join(verdict_lines(state.folder.path)))
    end_after_failures(state.folder)


@cli.command("analyse-model")
@click.argument("folder", type=FOLDER)
@click.option("--results", type=FOLDER, help="Folder of results; default: results/models/NAME.")
@click.option("--preflight", is_flag=True, help="Only print what the data can show.")
@click.option("--track", is_flag=True, help="Publish verdict, fits and figures to MLflow.")
def analyse_model(folder: Path, results: Path | None, preflight: bool, track: bool) -> None:
    """Identify the effect that a model of your own lacks.

    FOLDER contains model.yaml, the Python file of the model's class, and the measured data. Writes
    verdict.json, tables, figures and a page.
    """
    from jointgap.app.run_summary import verdict_lines
    from jointgap.axis import analyse as models
    from jointgap.campaign.campaign_files import end_after_failures

    if preflight:
        click.echo(models.preflight_model(folder))
        return
    state = models.ModelState(folder, results)
    models.analyse_model(folder, state.folder.path)
    if track:
        models.publish_model(state.folder.path)
    click.echo("\n".join(verdict_lines(state.folder.path)))
    end_after_failures(state.folder)


@cli.command()
@click.argument("campaign", type=FILE)
def preflight(campaign: Path) -> None:
    """Analyse identifiability of the planned CAMPAIGN.

    Prints the smallest detectable size of each effect, indistinguishable effects, and the most
    useful further speed or channel. Data files are not required; if they exist, their number of
    samples is used.
    """
    from jointgap.app.preflight import preflight as analyse_plan

    click.echo(analyse_plan(campaign).text)


@cli.group()
def new() -> None:
    """Write a campaign file or a mechanism file to start from; files that exist are not
    replaced."""


@new.command()
@click.argument("files", metavar="FILE...", type=FILE, nargs=-1, required=True)
@click.option(
    "--name", default="rig", show_default=True, help="Name of the campaign and of its two files."
)
@click.option(
    "--mechanism",
    default="",
    help="Mechanism file that exists, of any linkage; default: a slider-crank to fill in.",
)
def rig(files: tuple[Path, ...], name: str, mechanism: str) -> None:
    """Write NAME.yaml and NAME_mechanism.yaml for measured FILEs, one of each run.

    Columns, units and speeds are guessed from headings and values, with the reason of each guess as
    a comment. FILL_IN marks what the files do not contain, such as masses.

    \b
    Example:
      jointgap new rig slow.csv fast.csv
      jointgap measure rig.yaml
      jointgap analyse rig.yaml
    """
    from jointgap.rig.guess import new_rig

    click.echo(new_rig(files, name, mechanism))


@new.command()
@click.option(
    "--name", default="mechanism", show_default=True, help="Name of the file, without .yaml."
)
def mechanism(name: str) -> None:
    """Write the mechanism file NAME.yaml with comments; FILL_IN marks the values to fill in."""
    from jointgap.rig.guess import new_mechanism

    click.echo(new_mechanism(name))


@cli.command()
@click.argument("campaigns", metavar="CAMPAIGN...", type=FILE, nargs=-1, required=True)
@click.option(
    "--results",
    type=FOLDER,
    default=Path("results/campaigns"),
    show_default=True,
    help="Folder of the campaigns' results, each in a folder of its name.",
)
@click.option(
    "--folder",
    type=FOLDER,
    default=Path("results/trend"),
    show_default=True,
    help="Output folder of the trend.",
)
def trend(campaigns: tuple[Path, ...], results: Path, folder: Path) -> None:
    """Show the growth over time of clearances and other effects, from analysed campaigns of one
    rig.

    Each campaign file has its `date`; run `make campaign` or `jointgap analyse` first.
    """
    from jointgap.campaign.trend import trend as write_trend

    click.echo(write_trend(campaigns, results, folder))


@cli.command()
@click.argument("mechanism")
@click.option(
    "--speed",
    "speeds",
    multiple=True,
    required=True,
    help="Crank speed, such as '240 rpm'; repeatable.",
)
def look(mechanism: str, speeds: tuple[str, ...]) -> None:
    """Show motion and joint forces of a MECHANISM, a file or a shipped name, at one or several
    speeds, on one page.

    Writes look_NAME.html to the current folder: bodies, crank torque, and the force in each joint,
    with peaks and their crank angles.

    \b
    Example:
      jointgap look erkaya2009 --speed "240 rpm" --speed "480 rpm"
    """
    from jointgap.app.look import check_linkage, write_look
    from jointgap.config import load_mechanism
    from jointgap.core.units import option_in_si

    name = Path(mechanism).stem
    path = Path(f"look_{name}.html")
    values = [option_in_si("--speed", speed, "rad/s") for speed in speeds]
    check_writable(path)
    made = load_mechanism(mechanism)
    check_linkage(made, mechanism)
    write_look(made, values, name, path)
    click.echo(path)


WIDTH = 100  # columns, also without a terminal


@cli.command()
@click.argument("name", required=False)
def effects(name: str | None) -> None:
    """List the physical effects for mechanism files (law, parameters with units and bounds,
    reference), and the sensor faults that a campaign checks.

    With NAME, show this effect in full, with an example for the mechanism file.
    """
    from jointgap.config import EFFECTS
    from jointgap.core.errors import InputError, did_you_mean
    from jointgap.effects.base import effects_named, name_rules
    from jointgap.rig.sensors import FAULTS

    if name in EFFECTS:
        click.echo(_effect(name, EFFECTS[name], is_detailed=True))
    elif name and name not in FAULTS and (found := effects_named(name)):
        headings = {effect: f"{name} (at a {effect.ON})" for effect in found}
        headings = headings if len(found) > 1 else dict.fromkeys(found, name)
        pages = (_effect(heading, effect, True) for effect, heading in headings.items())
        click.echo("\n\n".join(pages))
    elif name in FAULTS:
        click.echo(_fault(name, FAULTS[name]))
    elif name is not None:
        site = name.partition("_")[0]
        names = [*EFFECTS, *FAULTS, *(rule.replace("{site}", site) for rule in name_rules())]
        raise InputError(f"effect '{name}': no such effect; {did_you_mean(name, names)}")
    else:
        click.echo("\n\n".join(_effect(key, effect) for key, effect in EFFECTS.items()))
        click.echo("\nv, x: slider's velocity, position; w, theta: crank's speed, angle; t: time.")
        click.echo("Effects act only where listed. Details and an example: jointgap effects NAME\n")
        click.echo("\n\n".join(_fault(key, fault) for key, fault in FAULTS.items()))


def _effect(name: str, effect: Any, is_detailed: bool = False) -> str:
    """An effect with law and parameters; in detail with its meaning and an example."""
    from jointgap.config import example, parameters_of

    lines = [
        f"site: {effect.SITE}",
        f"law: {effect.LAW}",
        f"reference: {effect.REFERENCE}",
        "parameters:",
    ]
    if is_detailed:
        lines.insert(0, " ".join(effect.__doc__.split()))
    for row in parameters_of(effect):
        limits = f"{row.bounds or 'any'} {row.unit.removeprefix('1')}".rstrip()
        line = f"  {row.name} [{limits}]" if row.unit else f"  {row.name}"
        if row.default:
            line += f", default {row.default}"
        lines.append(f"{line}: {row.meaning}" if is_detailed else line)
    text = _wrapped(name, lines)
    if not is_detailed:
        return text
    yaml = _yaml({"effects": [example(effect)]}).rstrip().replace("\n", "\n    ")
    return f"{text}\n\nin the mechanism file:\n\n    {yaml}"


def _fault(name: str, fault: Any) -> str:
    """A sensor fault with law and parameters."""
    names = [f"{key} [{unit or 'unit of the channel'}]" for key, unit in fault.parameters.items()]
    law = f"sensor fault; reading y of the true value u: {fault.law}"
    return _wrapped(name, [law, f"parameter{'s' * (len(names) > 1)}: {', '.join(names)}"])


def _wrapped(name: str, lines: Sequence[str]) -> str:
    lines = [textwrap.fill(line, WIDTH, subsequent_indent="    ") for line in lines]
    return "\n".join([click.style(name, bold=True), *lines])


def _yaml(content: Any) -> str:
    import yaml

    return yaml.safe_dump(content, sort_keys=False, width=WIDTH)


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
        for row in rows
    )
    return "\n".join(line.rstrip() for line in lines)


_scenarios = {"nargs": 2, "multiple": True, "help": "Name and options of a scenario, repeatable."}


@cli.command()
@required(
    "--results",
    "Folder of the scenarios' folders; receives overview.md, .html and .parquet.",
    FOLDER,
)
@click.option("--scenario", "scenarios", required=True, **_scenarios)
def overview(results: Path, scenarios: tuple[tuple[str, str], ...]) -> None:
    """Compare the optima of all scenarios: assumptions, frozen and re-simulated reductions."""
    from jointgap.scenario.overview import write_overview

    check_writable(*(results / f"overview.{suffix}" for suffix in ("md", "html", "parquet")))
    write_overview(
        {name: open_results(options, results / name) for name, options in scenarios}, results
    )


@cli.command()
@required("--results", "Folder of the folders of results.", FOLDER)
@required("--report", "HTML file to write; its links hold where it lies in that folder.")
@click.option("--scenario", "scenarios", **_scenarios)
@click.option("--campaign", "campaigns", multiple=True, help="Name of a campaign, repeatable.")
def report(
    results: Path, report: Path, scenarios: tuple[tuple[str, str], ...], campaigns: tuple[str, ...]
) -> None:
    """Write the report: the results of all scenarios and campaigns of a run, with figures, in one
    HTML file."""
    from jointgap.app.report import write_report

    check_writable(report)
    opened = {name: open_results(options, results / name) for name, options in scenarios}
    write_report(opened, campaigns, results, report)


@cli.command()
@click.option(
    "--results",
    type=FOLDER,
    default=Path("results"),
    show_default=True,
    help="Folder of the default store.",
)
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    default=5000,
    show_default=True,
    help="First port to try.",
)
def dashboard(results: Path, port: int) -> None:
    """Serve MLflow's pages locally, and print links to the comparisons of scenarios."""
    from jointgap.app.dashboard import dashboard

    dashboard(results, port, say=click.echo)


@cli.command()
@click.argument("name", metavar="FILE_OR_NAME")
def describe(name: str) -> None:
    """Show units and descriptions of the columns of a Parquet file.

    The name of a table, such as trajectory, works without a file. The name of a column shows the
    tables that have it.
    """
    from jointgap.core import parquet

    if Path(name).exists() or Path(name).suffix or "/" in name:
        title, rows = name, [("column", "unit", "description"), *parquet.describe(name).to_numpy()]
    else:
        title, rows = known.describe(name)
    click.echo(f"{title}\n{_aligned(rows)}")


@cli.command()
@click.argument("source", metavar="FILE_OR_FOLDER", type=click.Path(exists=True, path_type=Path))
@click.option(
    "--to", type=FOLDER, help="Folder to write into; beside each Parquet file when absent."
)
@click.option(
    "--unit",
    "units",
    multiple=True,
    help="Unit to write instead of the SI unit, such as mm, deg or rpm; repeatable.",
)
@click.option("--force", is_flag=True, help="Write over files that are there.")
def export(source: Path, to: Path | None, units: tuple[str, ...], force: bool) -> None:
    """Convert a Parquet FILE, or all in a FOLDER, to CSV with units in the column names, for
    spreadsheets and MATLAB.

    \b
    Example:
      jointgap export results/paper/simulate --to csv --unit mm --unit deg --unit rpm
    """
    from jointgap.core.export import export as exported

    for path in exported(source, to, units, force):
        click.echo(path)


@cli.command()
@click.argument("files", type=FILE, nargs=-1, required=True)
@click.option("--scenario", help="Name of the scenario; the first one of `run` when absent.")
def config(files: tuple[Path, ...], scenario: str | None) -> None:
    """Check configuration FILES, each overriding those before it, and print one scenario, with all
    keys in SI, as JSON for --options. Warnings, such as of an implausible mass, go to the standard
    error output.
    """
    from jointgap.config import Mechanism, load, read_yaml
    from jointgap.config.yaml_files import merge, plain_speeds
    from jointgap.core.errors import InputError, did_you_mean
    from jointgap.lengths.region import check_constraints
    from jointgap.motion.linkage import linkage_remarks
    from jointgap.motion.mechanism_warnings import remarks

    content, folders, warnings = {}, [], []
    for file in files:
        content = merge(content, read_yaml(file))
        folders = [file.parent, file.parent.parent, *folders]
        warnings += plain_speeds(file)
    folders = (Path(), *folders)
    source = " with ".join(map(str, files))
    scenarios = load.resolve(content, folders, source)
    check_constraints(scenarios, source)
    name = scenario or next(iter(scenarios))
    if name not in scenarios:
        raise InputError(
            f"{source}: run lists no scenario '{name}'; {did_you_mean(name, scenarios)}"
        )
    selected = scenarios[name]
    if isinstance(selected.mechanism, Mechanism):
        warnings += remarks(selected.mechanism, selected.simulate.highest_speed)
    else:
        warnings += linkage_remarks(selected.mechanism, selected.simulate)
    for warning in warnings:
        click.echo(f"jointgap: {warning}", err=True)
    click.echo(selected.model_dump_json(indent=2, by_alias=True))


@cli.command()
@click.option("--write", "path", type=FILE, help="File to write; printed when absent.")
@click.option("--campaign", is_flag=True, help="Of a campaign file, not of a configuration.")
def schema(path: Path | None, campaign: bool) -> None:
    """Print the JSON schema of a configuration or a campaign, for editors that complete and check
    YAML."""
    from jointgap.config.load import campaign_json_schema, json_schema

    content = campaign_json_schema() if campaign else json_schema()
    text = json.dumps(content, indent=2, ensure_ascii=False)
    if path is None:
        click.echo(text)
    else:
        write_text(path, f"{text}\n")


_SECONDS_BETWEEN_LINES = 60.0
_SECONDS_ON_A_TERMINAL = 2.0


@contextmanager
def progress_shown() -> Iterator[None]:
    """Show the progress of long computations: on a terminal in one line that is overwritten and at
    the end removed, otherwise a line a minute."""
    is_terminal = sys.stderr.isatty() and os.environ.get("TERM", "dumb") != "dumb"
    interval = _SECONDS_ON_A_TERMINAL if is_terminal else _SECONDS_BETWEEN_LINES
    last_time = time.monotonic()

    def show(task: str, done: int, total: int | None) -> None:
        nonlocal last_time
        now = time.monotonic()
        if is_terminal and done == total:
            click.echo("\r\x1b[K", nl=False, err=True)
        elif now - last_time >= interval:
            last_time = now
            line = f"jointgap: {task}: {done}{f' of {total}' if total else ''}"
            click.echo(f"\r{line}\x1b[K" if is_terminal else line, nl=not is_terminal, err=True)

    with progress_listener(show):
        yield


def main() -> None:
    """Run the command line; an InputError ends with its message and exit code 2, without a
    traceback."""
    from jointgap.core.errors import InputError, SimulationError

    # Imports and figures allocate many objects and few cycles: by default, the garbage collector
    # takes a tenth of the time of a short command.
    gc.set_threshold(100_000)
    # One thread, even if Snakemake allows more: for small matrices further threads cost more
    # processor time than they save, and another order of summation changes the last bits.
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    try:
        with progress_shown():
            cli()
    except (InputError, SimulationError) as error:
        message = str(error)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise
        file = error.filename or "the log of this command, or a temporary file"
        message = (
            f"{file}: cannot be written ({error.strerror}); free disk space, then run the command"
            " again"
        )
    else:
        return
    text = "".join(f"jointgap: error: {line}\n" for line in message.splitlines())
    try:
        click.echo(text, err=True, nl=False)
    # no space for the job's log: write to the open file number of the workflow's terminal
    except OSError:
        if terminal := os.environ.get("JOINTGAP_TERMINAL"):
            os.write(int(terminal), text.encode())
    sys.exit(2)
