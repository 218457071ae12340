"""A subcommand for each stage of a scenario, made from its record."""

import inspect
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from jointgap import tables
from jointgap.cli.group import (
    FILE,
    FOLDER,
    OF_SCENARIO,
    add_command,
    need,
    open_results,
    options_option,
    workers_option,
)
from jointgap.stages.record import Stage
from jointgap.stages.scenario_stages import SCENARIO_STAGES
from jointgap.tables import TRAJECTORY, Table

_scenario = click.option(
    "--scenario", "scenarios", nargs=2, multiple=True, required=True, help="Name and options of a scenario, repeatable."
)
_published = (
    click.option(
        "--scenario", "name", required=True, help="Name of the scenario: with stage and output it identifies a run."
    ),
    need("--store", "Folder of the store.", FOLDER),
    need("--published", "JSON file to write: what was published where."),
)
_OPTIONS = {
    "surrogate": (
        click.option(
            "--output-name", "output", required=True, help="What to learn: a column such as r2 or gamma3_ddot."
        ),
    ),
    "figures": (
        click.option(
            "--figure", "names", multiple=True, help="Name of a figure, repeatable; all still figures when absent."
        ),
        click.option("--folder", type=FOLDER, help="Folder to write to; figures/ among the results when absent."),
    ),
    "compare": (
        click.option(
            "--beside",
            "siblings",
            nargs=2,
            multiple=True,
            help="Name and options of a scenario, in the folder beside --results, that differs in its loose joints "
            "alone; repeatable.",
        ),
    ),
    "track": _published,
    "track-sweep": _published,
    "sweep-designs": (
        click.option("--first", type=click.IntRange(min=0), required=True, help="First design, from 0 on."),
        click.option("--number", type=click.IntRange(min=1), required=True, help="How many designs."),
        need("--designs", "Parquet file to write: these designs and what was measured of them."),
        workers_option,
    ),
    "optimise-robust": (workers_option,),
    "design-networks": (workers_option,),
    "compare-searches": (workers_option,),
    "sweep": (
        need("--folder", "Folder to write designs/, summary.md and summary.html to.", FOLDER),
        workers_option,
    ),
    "infer-settings": (
        need("--designs", "Folder of the designs that `jointgap sweep` wrote.", FOLDER),
        need("--folder", "Folder to write summary.md, summary.html, tables and figures/ to.", FOLDER),
    ),
    "sensitivity": (
        need("--designs", "Folder of the designs that `jointgap sweep` wrote.", FOLDER),
        need("--folder", "Folder to write summary.md, summary.html, tables and figures/ to.", FOLDER),
    ),
}
"""Options of a stage besides the scenario's and its results, by the names of its function's arguments."""


def _flagged(stage: Stage) -> dict[str, Table]:
    """Tables of a stage whose files can be named one by one, by the name of the option: where there is one file of
    each.
    """
    named = stage.writes and set(stage.reads) <= {TRAJECTORY}
    return {Path(table.path).stem: table for table in (*stage.reads, *stage.writes)} if named else {}


def _results_command(stage: Stage) -> None:
    flagged = _flagged(stage)

    def command(options: str, results: Path | None, **given: Any) -> str | None:
        files = {flag: given.pop(flag) for flag in flagged}
        if results is None and None in files.values():
            missing = next(flag for flag, file in files.items() if file is None)
            raise click.UsageError(f"Missing option '--{missing}', or '--results' for all of them.")
        places = {flagged[flag].name: file for flag, file in files.items() if file is not None}
        stored = open_results(options, results or Path(), places)
        if "siblings" in given:
            given["siblings"] = {name: open_results(more, results.parent / name) for name, more in given["siblings"]}
        written = [stored.place(table, given.get("output", "")) for table in stage.writes]
        tables.check_writable(*written, *(stored.path / file for file in stage.files))
        return stage.function(stored, **given)

    folder = click.option(
        "--results",
        type=FOLDER,
        required=not flagged,
        help="The scenario's results folder: tables are read and written at their places in it.",
    )
    files = [
        click.option(
            f"--{flag}",
            type=FILE,
            help=f"Parquet file to {'read' if table in stage.reads else 'write'}: {table.description[0].lower()}"
            f"{table.description[1:]}.",
        )
        for flag, table in flagged.items()
    ]
    add_command(
        stage.name, stage.help, command, [options_option, folder, *files, *_OPTIONS.get(stage.name, ())], OF_SCENARIO
    )


def _with_file(line: str, options: str, sections: Iterable[str]) -> str:
    """The `line` of an error, which begins with the file of the options where it is about a key of their `sections`."""
    about_key = re.match(r"[a-z_]+", line)
    if about_key is None or about_key[0] not in sections or line[about_key.end() :][:1] not in (".", ":"):
        return line
    return f"{'--options' if options.lstrip().startswith('{') else options}: {line}"


def _scenario_command(stage: Stage) -> None:
    def command(options: str, **given: Any) -> str | None:
        from jointgap.config import parse_options
        from jointgap.errors import InputError

        scenario = parse_options(options)
        try:
            return stage.function(scenario, **given)
        except InputError as error:
            raise InputError(
                *(_with_file(line, options, type(scenario).model_fields) for line in error.args)
            ) from error

    add_command(stage.name, stage.help, command, [options_option, *_OPTIONS[stage.name]], OF_SCENARIO)


def _overview(results: Path, scenarios: tuple[tuple[str, str], ...]) -> None:
    stage = SCENARIO_STAGES["overview"]
    tables.check_writable(*(results / path for path in stage.outputs()))
    stage.function({name: open_results(options, results / name) for name, options in scenarios}, results)


def _report(
    results: Path,
    report: Path,
    scenarios: tuple[tuple[str, str], ...],
    campaigns: tuple[str, ...],
) -> None:
    tables.check_writable(report)
    opened = {name: open_results(options, results / name) for name, options in scenarios}
    SCENARIO_STAGES["report"].function(opened, campaigns, results, report)


_NAMED = "Name and options of a scenario"
_REPORT_OPTIONS = [
    need("--results", "Folder of the folders of results.", FOLDER),
    need("--report", "HTML file to write; its links hold where it lies in that folder."),
    click.option("--scenario", "scenarios", nargs=2, multiple=True, help=f"{_NAMED}, repeatable."),
    click.option("--campaign", "campaigns", multiple=True, help="Name of a campaign, repeatable."),
]

for _stage in SCENARIO_STAGES.values():
    if _stage.name == "overview":
        _folder = need(
            "--results", "Folder of the scenarios' folders; overview.md, .html and .parquet go there.", FOLDER
        )
        add_command(_stage.name, _stage.help, _overview, [_folder, _scenario], OF_SCENARIO)
    elif _stage.name == "report":
        add_command(_stage.name, _stage.help, _report, _REPORT_OPTIONS, OF_SCENARIO)
    elif "results" in inspect.signature(_stage.function).parameters:
        _results_command(_stage)
    else:
        _scenario_command(_stage)
