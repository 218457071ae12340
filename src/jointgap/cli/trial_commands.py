"""Subcommands of blind trials, made from their records."""

import click

from jointgap.app.cli import FILE, FOLDER, OF_TRIALS, add_command, need
from jointgap.trials.trial_stages import TRIAL_STAGES

_code = click.option("--code", default="", help="Digest of the code; trials made by the same are not made again.")
_set = click.option("--set", "name", required=True, help="What the set is called.")

_OPTIONS = {
    "blind-conceal": (
        need("--sets", "YAML file with the sets of trials."),
        _set,
        click.option("--batch", type=click.IntRange(min=0), required=True, help="Which batch of it, counted from 0."),
        need("--campaigns", "Folder for the campaigns, one each in a folder.", FOLDER),
        need("--sealed", "Folder for the truth, one file each.", FOLDER),
        need("--listed", "Text file to write: the batch's identifiers."),
        need("--truth", "JSON file to write: the batch's truth."),
        _code,
    ),
    "blind-analyse": (
        need("--listed", "Text file with the batch's identifiers."),
        need("--campaigns", "Folder of the campaigns.", FOLDER),
        need("--verdicts", "Folder for what is found, one folder each.", FOLDER),
        need("--found", "JSON file to write: the batch's verdicts, and what the baselines name."),
        _code,
    ),
    "blind-score": (
        _set,
        click.option("--truth", "truths", type=FILE, multiple=True, required=True, help="A batch's truth; repeatable."),
        click.option(
            "--found", "founds", type=FILE, multiple=True, required=True, help="A batch's verdicts; repeatable."
        ),
        need("--folder", "Folder for trials.parquet, summary.md and the figures.", FOLDER),
    ),
    "blind-track": (
        _set,
        need("--folder", "Folder of the score.", FOLDER),
        need("--store", "Folder of the store.", FOLDER),
        need("--published", "JSON file to write: what was published where."),
    ),
}
"""Options of each, by the names of its function's arguments."""

for _stage in TRIAL_STAGES.values():
    add_command(_stage.name, _stage.help, _stage.function, _OPTIONS[_stage.name], OF_TRIALS)
